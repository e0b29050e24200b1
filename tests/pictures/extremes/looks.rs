//! Transfer functions with steps, single points, and values as large as numbers go.

use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Mode, Settings};
use adjsplat::volume::Grid;
use adjsplat_tests::scenes::transfer;

use crate::extremes::model::{Judge as _, coded, parallel, peak_weight};

/// Alpha of a row of voxels that are far enough apart, one for each code, at their centres.
fn row(transfer: TransferFunction, low: f64, step: f64, codes: &[u16]) -> Vec<f64> {
    let count = codes.len() as u64;
    let grid = Grid::new([8 * count, 1, 1], [1.0; 3]).unwrap();
    let mut model = coded(grid, transfer, |[x, _, _]| (x % 8 == 4).then(|| codes[usize::from(x / 8)]));
    (model.facts.scales.value_low, model.facts.scales.value_step) = (low, step);
    // Eight pixels a voxel; voxel 8 n + 4 is centred in column 64 n + 32.
    let columns = 64 * codes.len() as u32;
    let target = [(f64::from(columns) - 1.0) / 2.0 / 8.0, 0.0, 0.0];
    let settings = Settings::every_pixel([columns, 17]);
    let camera = parallel(target, [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], 17.0 / 8.0);
    for mode in [Mode::Additive, Mode::Maximum, Mode::MaximumGrey] {
        model.draw(&camera, &settings.clone().with_mode(mode).with_exposure(None));
    }
    let (frame, _) = model.draw(&camera, &settings);
    // The camera looks along z with -y up: x runs to the right.
    (0..codes.len() as u32).map(|n| f64::from(frame.pixel(64 * n + 32, 8)[3])).collect()
}

fn want(opacity: f64) -> f64 {
    let depth = (-(-opacity).ln_1p()).min(16.0);
    -(-depth * peak_weight(&Settings::every_pixel([9, 9]))).exp_m1()
}

fn assert_row(transfer: TransferFunction, low: f64, step: f64, codes: &[u16], opacities: &[f64]) {
    let got = row(transfer, low, step, codes);
    for ((code, got), opacity) in codes.iter().zip(got).zip(opacities) {
        // A few roundings of a transmittance, and of the pixel's place.
        assert!((got - want(*opacity)).abs() <= 2e-6, "code {code}: {got}, not {}", want(*opacity));
    }
}

fn points(list: &[(f64, f64)]) -> TransferFunction {
    let list: Vec<String> = list
        .iter()
        .map(|(value, opacity)| format!(r##"{{"value": {value:e}, "colour": "#ffffff", "opacity": {opacity}}}"##))
        .collect();
    transfer(&format!(
        r#"{{"kind": "points", "shaded": false, "reference_length": 1, "points": [{}]}}"#,
        list.join(",")
    ))
}

#[test]
fn a_step_has_one_side_or_the_other() {
    let step = points(&[(0.0, 0.2), (100.0, 0.2), (100.0, 0.9), (255.0, 0.9)]);
    let at_step = step.opacity(100.0, 0.0);
    assert!(at_step == 0.2 || at_step == 0.9, "{at_step}");
    assert_row(step, 0.0, 1.0, &[0, 99, 100, 101, 255], &[0.2, 0.2, at_step, 0.9, 0.9]);
}

#[test]
fn a_single_point_is_one_opacity_for_all() {
    for value in [0.0, -1e308, 1e308, 5e-324] {
        assert_row(points(&[(value, 0.4)]), 0.0, 1.0, &[0, 1, 128, 255], &[0.4; 4]);
    }
}

#[test]
fn values_as_large_as_numbers_go_are_interpolated() {
    let most = f64::MAX;
    let wide = points(&[(-most, 0.0), (most, 0.8)]);
    // The difference of the two ends is more than a number holds.
    for (value, opacity) in [(-most, 0.0), (0.0, 0.4), (most / 2.0, 0.6), (most, 0.8)] {
        let got = wide.opacity(value, 0.0);
        assert!((got - opacity).abs() <= 1e-12, "{value:e}: {got}");
        assert!(wide.colour(value).iter().all(|c| (0.0..=1.0).contains(c)), "{value:e}");
    }
    // Codes of values from -1.5e308 to 1.5e308: once the last code's was infinite, and its voxels transparent.
    let ends = [-1.5e308, 1.5e308].map(|value| 0.4 + 0.4 * (value / most));
    assert_row(wide, -1.5e308, 3e306 / 2.55, &[0, 255], &ends);
}

#[test]
fn values_as_small_as_numbers_go_are_interpolated() {
    let tiny = points(&[(0.0, 0.0), (5e-324, 0.5), (1e-310, 0.9)]);
    assert_eq!((tiny.opacity(0.0, 0.0), tiny.opacity(5e-324, 0.0), tiny.opacity(1.0, 0.0)), (0.0, 0.5, 0.9));
    assert_row(tiny, 0.0, 1.0, &[1, 2], &[0.9, 0.9]);
}

#[test]
fn ranges_and_regions_of_huge_values_are_finite() {
    let range =
        transfer(r#"{"kind": "range", "low": -1.7e308, "high": 1.7e308, "shaded": false, "reference_length": 1}"#);
    let region = transfer(
        r##"{"kind": "region", "shaded": false, "reference_length": 1, "knots": [
            {"value": -1.7e308, "colour": "#ff0000", "opacity": 0.1},
            {"value": 1.7e308, "colour": "#0000ff", "opacity": 0.9}], "largest_magnitude": 1e308}"##,
    );
    for transfer in [range, region] {
        for value in [-1.7e308, -1.0, 0.0, 5e-324, 1e308, 1.7e308] {
            for magnitude in [0.0, 5e-324, 1.0, 1e308, f64::MAX] {
                let opacity = transfer.opacity(value, magnitude);
                assert!((0.0..=1.0).contains(&opacity), "{value:e} {magnitude:e}: {opacity}");
                assert!(transfer.colour(value).iter().all(|c| (0.0..=1.0).contains(c)), "{value:e}");
            }
        }
        row(transfer, -1.5e308, 3e306 / 2.55, &[0, 100, 255]);
    }
}
