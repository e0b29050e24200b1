//! Opacities from none to all, and depths from a millionth to hundreds.

use adjsplat::splat::{Mode, Quality, Settings};
use adjsplat::traverse::Order;
use adjsplat::volume::Grid;
use adjsplat_tests::pictures::{alphas, apart, bits};
use adjsplat_tests::scenes::transfer;

use crate::extremes::model::{Judge as _, coded, constant, middle, parallel, peak_weight, solid, worst};

const UP: [f64; 3] = [0.0, 1.0, 0.0];
const MODES: [Mode; 4] = [Mode::Composite, Mode::Additive, Mode::Maximum, Mode::MaximumGrey];

/// One voxel in the middle of 9 x 9 pixels, 8 of which are a voxel's width.
fn one_voxel(opacity: f64) -> f64 {
    let model = solid([1; 3], [1.0; 3], constant(opacity, 1.0));
    let settings = Settings::every_pixel([9, 9]);
    let (frame, _) = model.draw(&parallel([0.0; 3], [0.0, 0.0, 1.0], UP, 9.0 / 8.0), &settings);
    f64::from(frame.pixel(4, 4)[3])
}

#[test]
fn no_voxels_and_no_opacity_leave_the_background_as_it_is() {
    let grid = || Grid::new([6, 5, 4], [1.0; 3]).unwrap();
    let nothing = coded(grid(), constant(0.5, 1.0), |_| None);
    let transparent = coded(grid(), constant(0.0, 1.0), |_| Some(7));
    let background = [0.1, 0.7, 0.3];
    for model in [&nothing, &transparent] {
        for mode in MODES {
            // A maximum shows values, not opacities.
            if mode.is_maximum() && model.facts.visible_voxels > 0 {
                continue;
            }
            let settings = Settings::every_pixel([20, 10]).with_mode(mode);
            let (mut frame, stats) = model.draw(&parallel(middle(&grid()), [1.0, 2.0, 3.0], UP, 8.0), &settings);
            assert!(stats.splats_drawn == 0 && frame.pixels().iter().all(|value| value.to_bits() == 0), "{mode:?}");
            frame.over(background);
            let [red, green, blue] = background;
            assert!(frame.pixels().as_chunks().0.iter().all(|pixel| *pixel == [red, green, blue, 1.0]));
        }
    }
}

/// 2^-23: the transmittance is stored with an error of 2^-25, and subtracting it from 1 rounds once more; the depth's
/// own error of a few 2^-23 counts only times depth and transmittance, 0.006.
#[test]
fn an_opaque_voxel_lets_through_what_its_largest_depth_says() {
    let weight = peak_weight(&Settings::every_pixel([9, 9]));
    let want = -(-16.0 * weight).exp_m1();
    let got = one_voxel(1.0);
    assert!((got - want).abs() <= 2f64.powi(-23), "{got} {want}");
}

#[test]
fn opacities_a_step_below_one_are_finite_and_in_order() {
    let weight = peak_weight(&Settings::every_pixel([9, 9]));
    let mut before = 0.0;
    for missing in [0.5, 1e-3, 2f64.powi(-20), 2f64.powi(-24), 2f64.powi(-53), 0.0] {
        let got = one_voxel(1.0 - missing);
        let depth = (-missing.ln()).min(16.0);
        let want = -(-depth * weight).exp_m1();
        // As for an opaque one; a depth of ln 2 counts with 0.2 of 2^-22.
        assert!((got - want).abs() <= 2f64.powi(-22), "1 - {missing:e}: {got} {want}");
        assert!(got >= before, "1 - {missing:e}: {got} after {before}");
        before = got;
    }
    // Beyond a depth of 16 all are the same.
    assert_eq!(one_voxel(1.0 - 2f64.powi(-24)).to_bits(), one_voxel(1.0).to_bits());
}

#[test]
fn the_smallest_opacities_are_finite_and_change_nothing() {
    for opacity in [5e-324, 1e-310, 1e-46, 1e-40, 1e-38, 1e-20, 1e-9] {
        assert_eq!(one_voxel(opacity), 0.0, "{opacity:e}");
    }
}

/// Ten thousand million million opaque layers to the mean voxel: depths are capped, pixels are opaque.
#[test]
fn reference_lengths_from_tiny_to_huge_are_finite() {
    for (reference, want) in
        [(5e-324, 1.0), (1e-310, 1.0), (1e-300, 1.0), (1e-16, 1.0), (1e30, 0.0), (1e300, 0.0), (f64::MAX, 0.0)]
    {
        let transfer = transfer(&format!(
            r##"{{"kind": "points", "reference_length": {reference:e}, "shaded": false, "points": [
                {{"value": 0, "colour": "#ffffff", "opacity": 0}}, {{"value": 1, "colour": "#ffffff", "opacity": 0}},
                {{"value": 2, "colour": "#ffffff", "opacity": 0.9}}]}}"##
        ));
        // Transparent voxels at x = 0.
        let grid = Grid::new([5, 4, 4], [1.0; 3]).unwrap();
        let model = coded(grid, transfer, |[x, _, _]| Some(x.min(1) * 2));
        for mode in MODES {
            for exposure in [Some(1.0), None] {
                // No ray ends before it is dark.
                let settings =
                    Settings::every_pixel([21, 21]).with_mode(mode).with_exposure(exposure).with_termination(0.0);
                let (frame, stats) = model.draw(&parallel([2.0, 1.5, 1.5], [0.0, 0.0, 1.0], UP, 6.0), &settings);
                // Transparent voxels are not drawn, nor depths that underflow; maxima show values.
                let drawn = if reference < 1e100 || mode.is_maximum() { 64 } else { 0 };
                assert_eq!(stats.splats_drawn, drawn, "{reference:e} {mode:?}");
                if mode == Mode::Composite {
                    // A depth of 16 is capped, seen from between four voxels.
                    assert!((frame.pixel(10, 10)[3] - want).abs() < 1e-6, "{reference:e}: {:?}", frame.pixel(10, 10));
                }
            }
        }
    }
}

/// A slab of 12 layers across z, seen through its middle along `direction`, in voxels.
fn slab(depth: f64, direction: [f64; 3], quality: Quality) -> (Vec<f64>, f64) {
    // Opacity per millionth of a voxel: up to 16 of depth in each.
    let reference = 1e-6;
    let model = solid([64, 64, 12], [1.0; 3], constant(-(-depth / 12.0 * reference).exp_m1(), reference));
    let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
    let settings = Settings::every_pixel([50, 50]).with_quality(quality).with_termination(0.0);
    let camera = parallel([31.5, 31.5, 5.5], direction, UP, 2.0);
    let (frame, _) = model.draw(&camera, &settings);
    (alphas(&frame).collect(), depth * length / direction[2])
}

/// Ripple of the standard kernel, 0.4 % of the depth to either side, counts with depth times transmittance; beside it
/// stand 2^-25 for each of at most 13 splats in each of 12 layers, which is all that is left of very deep slabs.
/// Depths of a millionth are summed as such, so that they too are right within the ripple.
#[test]
fn slabs_of_any_depth_let_through_what_beer_and_lambert_say() {
    let tan = |degrees: f64| degrees.to_radians().tan();
    for depth in [1e-6, 0.1, 1.0, 10.0, 100.0, 700.0] {
        for direction in [
            [0.0, 0.0, 1.0],
            [tan(5.0), 0.0, 1.0],
            [tan(15.0), 0.1, 1.0],
            [0.0, tan(30.0), 1.0],
            [1.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
        ] {
            let (alphas, want) = slab(depth, direction, Quality::Standard);
            let ripple = 4.1e-3 * want * (-want * (1.0 - 4.1e-3)).exp();
            let rounding = if depth < 1e-3 { 0.0 } else { 160.0 * 2f64.powi(-25) };
            for alpha in alphas {
                let error = (alpha + (-want).exp_m1()).abs();
                assert!(error <= ripple + rounding, "{depth:e} along {direction:?}: {alpha} off by {error:e}");
            }
        }
    }
}

/// The mean over a period of the lattice is exact within 1e-4 of the depth.
#[test]
fn half_the_spacing_lets_the_same_light_through() {
    let mean = |layers: u64, spacing: f64| {
        let side = (48.0 / spacing) as u64;
        let model = solid([side, side, layers], [spacing; 3], constant(0.1, 1.0));
        let camera = parallel(middle(&model.facts.grid), [0.2, 0.1, 1.0], UP, 2.0);
        let (frame, _) = model.draw(&camera, &Settings::every_pixel([50, 50]).with_termination(0.0));
        alphas(&frame).map(|alpha| -(-alpha).ln_1p()).sum::<f64>() / 2500.0
    };
    let want = -(0.9f64).ln() * 8.0 * (0.05f64 + 1.0).sqrt();
    for (layers, spacing) in [(8, 1.0), (16, 0.5), (32, 0.25)] {
        let got = mean(layers, spacing);
        assert!((got / want - 1.0).abs() <= 1e-4, "{spacing}: {got} {want}");
    }
}

/// Detail at the limit of what the lattice holds.
#[test]
fn alternating_layers_and_checkers_stay_between_nothing_and_all() {
    let patterns: [fn([u16; 3]) -> bool; 3] =
        [|[_, _, z]| z % 2 == 0, |[x, y, z]| (x + y + z) % 2 == 0, |[x, y, _]| x % 2 == 0 || y % 2 == 0];
    for (number, shows) in patterns.into_iter().enumerate() {
        for opacity in [0.05, 0.7, 1.0] {
            let grid = Grid::new([16, 15, 14], [1.0; 3]).unwrap();
            let target = middle(&grid);
            let model = coded(grid, constant(opacity, 1.0), |at| shows(at).then_some(1));
            for along in [[0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.3, 0.5, 0.8]] {
                let settings = Settings::every_pixel([40, 40]).with_quality(Quality::Reference);
                let camera = parallel(target, along, [0.1, 1.0, 0.2], 24.0);
                let (frame, _) = model.draw(&camera, &settings);
                let (depths, splats) = model.depths(&camera, &settings, |_| (-(-opacity).ln_1p()).min(16.0));
                // Colours are sums of as many roundings as there are splats.
                let most = 1.0 + splats as f32 * 2f32.powi(-24);
                assert!(
                    frame.pixels().iter().all(|value| (0.0..=most).contains(value)),
                    "{number} {opacity} {along:?}"
                );
                assert!(alphas(&frame).all(|alpha| alpha <= 1.0));
                // Where a pixel lies on a footprint's edge one of the two may not count it: 1.02e-4 of the peak.
                let edge = 1.1e-4 * 0.33 * (-(-opacity).ln_1p()).min(16.0);
                let bound = splats as f64 * 2f64.powi(-25) + edge + 1e-5;
                let error = worst(&frame, &depths);
                assert!(error <= bound, "{number} {opacity} {along:?}: {error:e}, not {bound:e}");
            }
        }
    }
}

/// One colour: red, green and blue over alpha are that colour in every order, and over white less over black is what is
/// let through.
#[test]
fn one_colour_is_the_same_in_all_48_orders() {
    let transfer = transfer(
        r##"{"kind": "points", "points": [{"value": 0, "colour": "#8040c0", "opacity": 0.4}],
            "reference_length": 1, "shaded": false}"##,
    );
    let [red, green, blue] = transfer.colour(0.0);
    let model = coded(Grid::new([12; 3], [1.0; 3]).unwrap(), transfer, |[x, y, z]| ((x * y + z) % 3 != 0).then_some(1));
    let camera = parallel([5.5; 3], [0.3, -0.5, 0.8], UP, 16.0);
    let settings = Settings::every_pixel([32, 32]).with_quality(Quality::Reference);
    let (first, _) = model.draw(&camera, &settings);
    for order in (0..48).map(|n| Order::parallel(n / 8, (n % 8) as u8)) {
        let (frame, _) = model.draw(&camera, &settings.clone().with_order(order));
        // Some hundred splats at a pixel, 2^-24 each.
        assert!(apart(&frame, &first) <= 1e-5, "{order:?}: {:e}", apart(&frame, &first));
        for pixel in frame.pixels().as_chunks::<4>().0 {
            for (part, colour) in pixel.iter().zip([red, green, blue]) {
                assert!((part - colour * pixel[3]).abs() <= 2e-6, "{order:?} {pixel:?}");
            }
        }
        let (mut black, mut white) = (frame.clone(), frame.clone());
        black.over([0.0; 3]);
        white.over([1.0; 3]);
        for ((black, white), alpha) in
            black.pixels().iter().step_by(4).zip(white.pixels().iter().step_by(4)).zip(alphas(&frame))
        {
            assert!((f64::from(white - black) - (1.0 - alpha)).abs() <= 2e-7);
        }
    }
    assert!(bits(&first).iter().any(|&bits| bits != 0));
}
