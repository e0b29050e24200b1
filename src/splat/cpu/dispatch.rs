//! The two hot stages, compiled once for each instruction set and chosen when the program runs.

use multiversion::multiversion;

use super::blend::Blend;
use super::freeze::Frozen;
use super::planes::Planes;
use super::raster::{self, Ellipses, Limits, Splats};

/// Stage 2 for the best instruction set of this processor.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
pub(crate) fn draw<B: Blend, E: Ellipses>(
    planes: &mut Planes,
    frozen: &mut Frozen,
    splats: &Splats,
    ellipses: &E,
    limits: Limits,
) -> u64 {
    raster::draw::<B, E>(planes, frozen, splats, ellipses, limits)
}

/// Stage 2 for AVX2, where the processor has it.
#[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
pub(crate) fn draw_avx2<B: Blend, E: Ellipses>(
    planes: &mut Planes,
    frozen: &mut Frozen,
    splats: &Splats,
    ellipses: &E,
    limits: Limits,
) -> u64 {
    raster::draw::<B, E>(planes, frozen, splats, ellipses, limits)
}

#[cfg(test)]
mod timing {
    use super::*;
    use crate::splat::cpu::{blend, planes::Rect, raster::{BLOCK, Ellipse}};
    #[test]
    fn timing() {
        for half in [1.5f32, 2.0, 2.5, 3.0, 4.0, 8.0] {
            let rect = Rect { x0: 0, y0: 0, x1: 1024, y1: 1024 };
            let mut planes = Planes::new(rect, 1.0).unwrap();
            let mut frozen = Frozen::new(rect);
            let mut splats = Splats::new();
            let sigma = half / 3.33;
            let a = 0.5 * 1.4427 / (sigma * sigma);
            let e = Ellipse { across: a, along: a, shear: 0.0, half_x: half, half_y: half };
            let cut = 5.55 * 1.4427;
            let step = std::env::var("STEP").map(|v| v.parse::<f32>().unwrap()).unwrap_or(sigma * 1.5); let blocks = 500;
            let mut total = [0.0f64; 3];
            for which in 0..3 {
                let start = std::time::Instant::now();
                let mut t = f64::INFINITY;
                for k in 0..blocks {
                    let (mut cx, mut cy) = ((k * 37 % 200) as f32 + 20.0, (k * 91 % 200) as f32 + 20.0);
                    splats.count = BLOCK;
                    for j in 0..BLOCK {
                        cx += step;
                        cy += sigma * 0.31;
                        splats.x[j] = cx.round() as i32; splats.rest_x[j] = cx - cx.round();
                        splats.y[j] = cy.round() as i32; splats.rest_y[j] = cy - cy.round();
                        splats.low_x[j] = (cx - half).ceil() as i32; splats.high_x[j] = (cx + half).floor() as i32;
                        splats.low_y[j] = (cy - half).ceil() as i32; splats.high_y[j] = (cy + half).floor() as i32;
                        splats.red[j] = 0.5; splats.green[j] = 0.3; splats.blue[j] = 0.2; splats.peak[j] = 0.001;
                    }
                    let s = std::time::Instant::now(); let mut n = 0; for _ in 0..8 {
                    let l = Limits { cut, stop: 1e-6 };
                    n = match which {
                        0 => draw::<blend::FrontToBack, _>(&mut planes, &mut frozen, &splats, &e, l),
                        1 => draw_avx2::<blend::FrontToBack, _>(&mut planes, &mut frozen, &splats, &e, l),
                        _ => raster::draw::<blend::FrontToBack, _>(&mut planes, &mut frozen, &splats, &e, l),
                    };
                    } t = t.min(s.elapsed().as_nanos() as f64 / 8.0);
                    assert!(n>0);
                }
                let _ = start;
                total[which] = t / BLOCK as f64;
            }
            eprintln!("half {half}: {total:?} ns");
        }
    }
}
