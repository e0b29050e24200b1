//! What every approximation costs, beside the bound that docs/NUMERICS.md derives for it.

use adjsplat::build::Built;
use adjsplat::splat::{Camera, Frame, Lighting, Projection, Quality, Sampling, Settings};
use adjsplat::traverse::Sense;
use adjsplat::volume::{Grid, SampleType};
use adjsplat_tests::pictures::{alphas, apart};
use adjsplat_tests::scenes::{Draw as _, built, options, phantom, transfer};

use crate::extremes::model::{Judge as _, coded, constant, parallel, solid};

/// Opacities of a code: 0 to 0.005, so that a hundred thousand splats at a pixel matter to the last.
fn opacity(code: u16) -> f64 {
    f64::from(code) / 255.0 * 0.005
}

/// Columns of 4 x 4 x 30,000 voxels of every opacity and two colours on one pixel.
#[test]
fn rounding_stays_within_its_bound_over_half_a_million_layers() {
    let scale = 1e-2f64;
    let kept = -(-0.5 * (3.0f64 / 0.7).powi(2)).exp_m1();
    let per_pixel = std::f64::consts::TAU * 0.36 * kept / (scale * scale);
    // Depth of a voxel that is `opacity` at the pixel, per millionth of a voxel.
    let opaque = |code: u16| ((-opacity(code)).ln_1p() * per_pixel * 1e-6).exp_m1().abs();
    for least in [1u16, 40, 160] {
        let points: Vec<String> = (0..=255)
            .map(|code: u16| {
                let (red, blue) = if code.is_multiple_of(2) { (1, 0) } else { (0, 1) };
                format!(r##"{{"value": {code}, "colour": [{red}, 0, {blue}], "opacity": {:e}}}"##, opaque(code))
            })
            .collect();
        let transfer = transfer(&format!(
            r#"{{"kind": "points", "reference_length": 1e-6, "shaded": false, "points": [{}]}}"#,
            points.join(",")
        ));
        let code = move |[x, y, z]: [u16; 3]| {
            let mixed = u32::from(z).wrapping_mul(2_654_435_761) ^ (u32::from(x) * 7 + u32::from(y) * 31);
            least + (mixed >> 16) as u16 % (256 - least)
        };
        let grid = Grid::new([4, 4, 30_000], [1.0; 3]).unwrap();
        let model = coded(grid, transfer, |at| Some(code(at)));
        let camera = parallel([1.5, 1.5, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 3.0 / scale);
        // In double precision, in an order of the walk: the weights of a layer differ by 3e-4 and colours alternate, so
        // that the order within a layer is of no consequence.
        let (mut light, mut red, mut blue) = (1.0f64, 0.0, 0.0);
        let mut splats_until_dark = 0u32;
        for z in 0..30_000u16 {
            for (x, y) in (0..4u16).flat_map(|x| (0..4).map(move |y| (x, y))) {
                let code = code([x, y, z]);
                let off = [f64::from(x) - 1.5, f64::from(y) - 1.5].iter().map(|c| (c * scale).powi(2)).sum::<f64>();
                let taken = light * -((-opacity(code)).ln_1p() * (-off / 0.72).exp()).exp_m1();
                if code.is_multiple_of(2) {
                    red += taken
                } else {
                    blue += taken
                }
                light -= taken;
                splats_until_dark += u32::from(light > 2f64.powi(-25));
            }
        }
        for sense in [Sense::FrontToBack, Sense::BackToFront] {
            let settings = Settings::every_pixel([3, 3]).with_quality(Quality::Reference).with_sense(sense);
            let (frame, stats) = model.render(&camera, &settings);
            assert_eq!(stats.splats_drawn, 480_000);
            let got = frame.pixel(1, 1).map(f64::from);
            let error =
                [got[0] - red, got[2] - blue, got[3] - (1.0 - light)].map(f64::abs).into_iter().fold(0.0, f64::max);
            // 2^-25 for each splat until nothing is left, in the transmittance and in each sum.
            let bound = f64::from(splats_until_dark) * 2f64.powi(-24);
            println!(
                "opacities {:.1e} to 5e-3, {splats_until_dark} splats matter, {sense:?}: off by {error:.1e}, bound {bound:.1e}",
                opacity(least)
            );
            assert!(error <= bound, "{least} {sense:?}: {error:e}, not {bound:e}");
        }
    }
}

/// Peak to peak, axis on: the worst view (docs/NUMERICS.md).
/// The largest radius of a kernel is six standard deviations, which some sharpened kernels of `reference` exceeded by rounding.
#[test]
fn every_sharpness_is_a_kernel_that_can_be_drawn() {
    for quality in Quality::ALL {
        for thousandths in 0..=1_000u16 {
            let sharpness = f32::from(thousandths) / 1_000.0;
            assert!(quality.kernel().sharpened(sharpness).unwrap().check().is_ok(), "{quality:?} {sharpness}");
        }
    }
}

#[test]
fn ripple_is_what_each_quality_promises() {
    // The largest are spikes at points of the lattice, where four splats end: pixels meet some of them.
    for (quality, sharpness, promised) in [
        (Quality::Draft, 0.0, 6.1e-4),
        (Quality::Standard, 0.0, 4.8e-4),
        (Quality::High, 0.0, 4.8e-4),
        (Quality::Standard, 1.0, 2.06e-2),
        (Quality::High, 1.0, 2.06e-2),
    ] {
        let model = solid([24, 24, 1], [1.0; 3], constant(0.5, 1.0));
        // 160 pixels to a voxel, two voxels across.
        let camera = parallel([11.5, 11.5, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 2.0);
        let kernel = quality.kernel().sharpened(sharpness).unwrap();
        let settings = Settings::every_pixel([320, 320]).with_quality(quality).with_kernel(kernel);
        let (frame, _) = model.draw(&camera, &settings);
        let depths: Vec<f64> = alphas(&frame).map(|alpha| -(-alpha).ln_1p() / -(0.5f64).ln()).collect();
        let mean = depths.iter().sum::<f64>() / depths.len() as f64;
        let (low, high) =
            depths.iter().fold((f64::MAX, 0.0f64), |(low, high), depth| (low.min(*depth), high.max(*depth)));
        println!("{quality:?}, {sharpness}: mean depth {mean:.6}, ripple {:.2e} peak to peak", high - low);
        assert!((mean - 1.0).abs() <= 1e-3, "{quality:?}, {sharpness}: {mean}");
        let ratio = (high - low) / promised;
        assert!((0.75..=1.1).contains(&ratio), "{quality:?}, {sharpness}: {:e}", high - low);
    }
}

/// The integral of a kernel along each pixel's ray is known exactly.
#[test]
fn a_footprint_in_a_perspective_is_the_integral_along_each_ray() {
    let (sigma, radius) = (0.7f64, 4.2f64);
    let kept = -(-0.5 * (radius / sigma).powi(2)).exp_m1();
    // A footprint is at least 8.4 voxels away at this quality; nearer than 0.7 / 0.083 voxels, kernels have none.
    for narrowness in [0.007, 0.028, 0.083, 0.12] {
        for degrees in [0.0f64, 30.0, 45.0, 60.0] {
            let (depth, tangent) = (sigma / narrowness, degrees.to_radians().tan());
            // Twelve pixels a sigma on the axis.
            let focal = 12.0 / narrowness;
            let columns = 2 * (focal * tangent + 200.0) as u32 + 1;
            let size = [columns, 301];
            let fov = 2.0 * (150.5 / focal).atan().to_degrees();
            let mut grid = Grid::new([1; 3], [1.0; 3]).unwrap();
            grid.origin = [depth * tangent, 0.0, -depth];
            let model = coded(grid, constant(0.1, 1.0), |_| Some(1));
            let camera =
                Camera::new([0.0; 3], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], Projection::Perspective { fov }).unwrap();
            let settings = Settings::every_pixel(size).with_quality(Quality::Reference);
            let (frame, _) = model.render(&camera, &settings);
            let peak = -(0.9f64).ln() / (std::f64::consts::TAU * sigma * sigma * kept);
            let mut most = 0.0f64;
            for (row, column) in (0..size[1]).flat_map(|row| (0..columns).map(move |column| (row, column))) {
                let ray =
                    [(f64::from(column) - f64::from(columns / 2)) / focal, (150.0 - f64::from(row)) / focal, -1.0];
                let length = ray.iter().map(|c| c * c).sum::<f64>();
                let m = [depth * tangent, 0.0, -depth];
                let cross =
                    [m[1] * ray[2] - m[2] * ray[1], m[2] * ray[0] - m[0] * ray[2], m[0] * ray[1] - m[1] * ray[0]];
                let square = cross.iter().map(|c| c * c).sum::<f64>() / length;
                let exact = peak * (-square / (2.0 * sigma * sigma)).exp();
                let got = -(-f64::from(frame.pixel(column, row)[3])).ln_1p();
                most = most.max((got - exact).abs() / peak);
            }
            println!("sigma/z {narrowness}, {degrees} degrees: {most:.1e} of the peak");
            // The peak is 0.03: a transmittance in single precision holds 2^-25 / 0.03, which is 1e-6 of it. The rest is from places
            // and directions in single precision.
            assert!(most <= 2e-6, "{narrowness} {degrees}: {most:e}");
        }
    }
}

fn gyroid(text: &str, value_bits: u8, normal_bits: u8) -> Built {
    let mut source = phantom("gyroid", [40, 44, 36], SampleType::U16, [1.0; 3]);
    built(&mut *source, &options(transfer(text)).with_value_bits(value_bits).with_normal_bits(normal_bits))
}

/// Parallel views, lit from the eye.
fn pictures(built: &Built) -> Vec<Frame> {
    [(0.0, 0.0), (31.0, 24.0), (-100.0, 60.0)]
        .map(|(azimuth, elevation)| {
            let lighting = Some(Lighting { toward_light: [0.0, 0.0, 1.0], ..Lighting::default() });
            let settings = Settings::every_pixel([120, 120]).with_quality(Quality::Reference).with_lighting(lighting);
            built.frame(&built.orbit(azimuth, elevation, None, [120, 120]), &settings)
        })
        .into()
}

/// A value is off by half a step at most: by that times the steepest slope of the opacity, over what is left of the
/// light, each depth; times depth and transmittance, at most 1/e of a pixel.
#[test]
fn eight_bits_of_value_change_a_picture_within_half_a_step() {
    let text = r##"{ "kind": "points", "shaded": false, "points": [
        { "value": 100, "colour": "#ffffff", "opacity": 0.1 }, { "value": 128, "colour": "#ffffff", "opacity": 0.6 },
        { "value": 156, "colour": "#ffffff", "opacity": 0.1 }] }"##;
    let (narrow, wide) = (gyroid(text, 8, 0), gyroid(text, 16, 0));
    let half_steps = [&narrow, &wide].map(|built| built.facts.scales.value_step / 2.0).iter().sum::<f64>();
    let slope = 0.5 / 28.0;
    // Relative error of a depth, largest where opacities are least.
    let relative = (1..=50)
        .map(|n| 0.09 + 0.01 * f64::from(n))
        .map(|opacity: f64| slope * half_steps / (1.0 - opacity) / -(-opacity).ln_1p())
        .fold(0.0, f64::max);
    let bound = relative / std::f64::consts::E;
    let most = pictures(&narrow).iter().zip(pictures(&wide)).map(|(a, b)| apart(a, &b)).fold(0.0, f64::max);
    println!("values of 8 bits against 16: {most:.1e}, bound {bound:.1e}");
    assert!(most > 0.0 && most <= bound, "{most:e}, not {bound:e}");
}

/// A normal is off by 0.638 degrees at most: diffuse light by that, times its weight, and highlights by their steepest
/// slope, times theirs. Colours are means of what is so off.
#[test]
fn eight_bits_of_normal_change_a_picture_within_their_angle() {
    let text = r##"{ "kind": "points", "points": [
        { "value": 100, "colour": "#ffffff", "opacity": 0.1 }, { "value": 128, "colour": "#ffffff", "opacity": 0.6 },
        { "value": 156, "colour": "#ffffff", "opacity": 0.1 }] }"##;
    let (narrow, wide) = (gyroid(text, 16, 8), gyroid(text, 16, 16));
    let angle = (0.638f64 + 0.0025).to_radians();
    let lighting = Lighting::default();
    // The steepest slope of a power n of a cosine is below 0.607 times the root of n.
    let glossy = 0.607 * f64::from(lighting.shininess).sqrt() * f64::from(lighting.specular);
    let bound = angle * (f64::from(lighting.diffuse) + glossy);
    let most = pictures(&narrow).iter().zip(pictures(&wide)).map(|(a, b)| apart(a, &b)).fold(0.0, f64::max);
    println!("normals of 8 bits against 16: {most:.1e}, bound {bound:.1e}");
    assert!(most > 0.0 && most <= bound, "{most:e}, not {bound:e}");
}

/// Where splats are widened to a pixel their depths are averaged and not what they let through: a small picture of
/// something with holes is more opaque than the mean of a large one, and never less.
#[test]
fn small_pictures_of_things_with_holes_are_too_opaque_but_for_finer_pixels() {
    let grid = Grid::new([64, 64, 1], [1.0; 3]).unwrap();
    let model = coded(grid, constant(0.9, 1.0), |[x, y, _]| ((x / 2 + y / 2) % 2 == 0).then_some(1));
    let mean = |pixels: f64, size: u32, sampling: Sampling| {
        let camera = parallel([31.5, 31.5, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], f64::from(size) / pixels);
        let settings = Settings::every_pixel([size; 2]).with_quality(Quality::Reference).with_sampling(sampling);
        let (frame, _) = model.draw(&camera, &settings);
        alphas(&frame).sum::<f64>() / f64::from(size * size)
    };
    // 40 x 40 voxels in the middle.
    let every = Sampling::EveryPixel;
    let (large, same, small) = (mean(8.0, 320, every), mean(1.0, 40, every), mean(0.25, 10, every));
    let finer = mean(0.25, 10, Sampling::Finer);
    let most = -(0.1f64.ln() / 2.0).exp_m1();
    println!(
        "checkers of opacity 0.9: mean {large:.3} at 8 pixels a voxel, {same:.3} at 1, {small:.3} at 1/4; {most:.3} if even; {finer:.3} by finer pixels"
    );
    // Pixels on the edge see more of some checkers than of others.
    assert!((finer - large).abs() < 4e-3, "{finer} {large}");
    assert!(large < small - 0.01 && same < small - 0.01 && small <= most + 3e-3, "{large} {same} {small} {most}");
}
