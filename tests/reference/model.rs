//! What splatting itself costs: splats in order of depth against the integral, in decibels.

use adjsplat::reference::{VisibleVoxels, ray, splat};

use crate::scenes::{decibels, integrated, made, orbit, splatted};

/// A well-mixed number for each place.
fn noise([x, y, z]: [u16; 3]) -> f64 {
    let mut bits = u64::from(x) | u64::from(y) << 16 | u64::from(z) << 32;
    for _ in 0..2 {
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    }
    (bits >> 11) as f64 / (1u64 << 53) as f64
}

fn radius(at: [u16; 3]) -> f64 {
    at.map(|c| (f64::from(c) - 15.5).powi(2)).iter().sum::<f64>().sqrt()
}

fn opaque_shell() -> VisibleVoxels {
    let depth = -(0.05f64).ln();
    made([32; 3], [1.0; 3], |at| {
        let colour = at.map(|c| f32::from(c) / 31.0);
        (10.0..13.0).contains(&radius(at)).then_some((depth, colour))
    })
}

fn checker_ball() -> VisibleVoxels {
    made([32; 3], [1.0; 3], |at| {
        let odd = at.iter().map(|c| c / 4).sum::<u16>() % 2 == 1;
        let colour = if odd { [1.0, 0.2, 0.1] } else { [0.1, 0.3, 1.0] };
        (radius(at) < 13.0).then_some((-(0.7f64).ln(), colour))
    })
}

fn thin_shell() -> VisibleVoxels {
    made([32; 3], [1.0; 3], |at| {
        (10.0..13.0).contains(&radius(at)).then_some((0.1, at.map(|c| f32::from(c) / 31.0)))
    })
}

fn tenth_noise() -> VisibleVoxels {
    made([32; 3], [1.0; 3], |at| {
        let colour = [noise(at.map(|c| c + 100)), noise(at.map(|c| c + 200)), noise(at.map(|c| c + 300))];
        (noise(at) < 0.1).then_some((-(0.1f64).ln(), colour.map(|c| c as f32)))
    })
}

#[test]
fn exponential_blending_comes_far_nearer_to_the_integral_than_the_classic_form() {
    for (name, scene) in
        [("opaque shell", opaque_shell()), ("checker ball", checker_ball()), ("noise", tenth_noise()), ("thin shell", thin_shell())]
    {
        for (azimuth, elevation) in [(0.0, 0.0), (33.0, 21.0)] {
            let size = [64, 64];
            let camera = orbit(scene.grid(), azimuth, elevation, None, size);
            let rays = integrated(&scene, &camera, ray::Settings { sigma: 0.6, tolerance: 1e-5, ..ray::Settings::new(size) });
            let of = |blending, order| {
                let settings = splat::Settings { sigma: 0.6, blending, order, ..splat::Settings::new(size) };
                decibels(&splatted(&scene, &camera, settings), &rays)
            };
            let exponential = of(splat::Blending::Exponential, splat::Order::Sorted);
            let nested = of(splat::Blending::Exponential, splat::Order::Nested);
            let linear = of(splat::Blending::Linear, splat::Order::Sorted);
            println!("{name} {azimuth} {elevation}: exponential {exponential:.1}, nested {nested:.1}, linear {linear:.1} dB");
            assert!(exponential > 44.0, "{name}: {exponential}");
            assert!(linear < 47.0 && linear < exponential - 9.0, "{name}: {linear} against {exponential}");
        }
    }
}
