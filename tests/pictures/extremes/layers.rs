//! Depths of a million splats and more on one pixel.
//!
//! A file's longest line has 65,535 voxels. So columns of 13 x 12 of them are drawn a thousandth of a pixel apart: all
//! ten million voxels lie on the middle pixel, each widened to it, with the same weight to a part in 2,000. A crop to
//! 4 x 4 columns is the million.

use std::sync::OnceLock;

use adjsplat::build::Built;
use adjsplat::splat::{Camera, Frame, Quality, Settings, Stats, cpu};
use adjsplat::traverse::{Sense, VoxelBox};
use adjsplat_tests::scenes::{Draw as _, transfer};

use crate::extremes::model::{coded, constant, parallel, solid};

/// Pixels per voxel.
const SCALE: f64 = 1e-3;
const SIZE: [u32; 2] = [3, 3];
const LONGEST: u64 = 65_535;

fn columns() -> &'static Built {
    static COLUMNS: OnceLock<Built> = OnceLock::new();
    COLUMNS.get_or_init(|| solid([13, 12, LONGEST], [1.0; 3], constant(0.5, 1.0)))
}

/// Along the columns, with the middle of the first 4 x 4, or of all, in the picture's.
fn camera(is_million: bool) -> Camera {
    let target = if is_million { [1.5, 1.5, 0.0] } else { [6.0, 5.5, 0.0] };
    parallel(target, [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], f64::from(SIZE[1]) / SCALE)
}

fn settings(is_million: bool) -> Settings {
    let crop = is_million.then_some(VoxelBox { low: [0; 3], high: [3, 3, u16::MAX] });
    Settings::every_pixel(SIZE).with_quality(Quality::Reference).with_crop(crop)
}

/// Optical depth of a voxel per optical depth at the middle pixel: the low-pass's own, 0.6 px wide, cut off at 3/0.7.
fn voxel_per_pixel() -> f64 {
    let kept = -(-0.5 * (3.0f64 / 0.7).powi(2)).exp_m1();
    std::f64::consts::TAU * 0.36 * kept / (SCALE * SCALE)
}

/// The columns with splats that take `part` of a pixel's light each.
fn draw(part: f64, is_million: bool, settings: &Settings) -> (Frame, Stats) {
    let depth = -(-part).ln_1p() * voxel_per_pixel();
    // Per millionth of a voxel, so that any depth is an opacity.
    let transfer = constant(-(-depth * 1e-6).exp_m1(), 1e-6);
    let scene = adjsplat::splat::Scene { transfer: &transfer, ..columns().scene() };
    cpu::render(&scene, &camera(is_million), settings).unwrap()
}

/// What is let through by the middle pixel, and exactly: each of the columns weighs as its distance says.
fn transmittance(part: f64, is_million: bool, sense: Sense) -> (f64, f64) {
    let (frame, stats) = draw(part, is_million, &settings(is_million).with_sense(sense));
    let side = if is_million { [4, 4] } else { [13, 12] };
    assert_eq!(stats.splats_drawn, side[0] * side[1] * LONGEST);
    let mut weight = 0.0;
    for x in 0..side[0] {
        for y in 0..side[1] {
            let off = [x as f64 - (side[0] - 1) as f64 / 2.0, y as f64 - (side[1] - 1) as f64 / 2.0];
            let square = off.iter().map(|c| (c * SCALE).powi(2)).sum::<f64>();
            weight += (-square / 0.72).exp();
        }
    }
    (1.0 - f64::from(frame.pixel(1, 1)[3]), (weight * LONGEST as f64 * (-part).ln_1p()).exp())
}

/// In single precision alone a transmittance near 1 loses 2^-24 a splat or nothing, whatever was asked: 1e-7 a million
/// times would let through 0.882 in the place of 0.900, and 2e-8 ten million times everything.
#[test]
fn tiny_opacities_add_up_over_a_million_layers() {
    for (part, is_million) in [(1e-7, true), (1e-6, true), (1e-5, true), (2e-8, false), (1e-7, false)] {
        for sense in [Sense::FrontToBack, Sense::BackToFront] {
            let (got, want) = transmittance(part, is_million, sense);
            println!("{part:e}, a million: {is_million}, {sense:?}: {got:.6}, exactly {want:.6}");
            assert!((got - want).abs() <= 1e-4, "{part:e}, a million: {is_million}, {sense:?}: {got}, not {want}");
        }
    }
}

/// Denormal depths over a million layers: everything is let through.
#[test]
fn denormal_opacities_over_a_million_layers_change_nothing() {
    let mut milliseconds = [0.0; 2];
    for (time, part) in milliseconds.iter_mut().zip([1e-6, 1e-40]) {
        let (frame, stats) = draw(part, true, &settings(true));
        *time = stats.frame_ms;
        assert!(part > 1e-20 || frame.pixel(1, 1).iter().all(|value| *value < 1e-30), "{:?}", frame.pixel(1, 1));
    }
    println!("opacity 1e-6: {:.1} ms, 1e-40: {:.1} ms", milliseconds[0], milliseconds[1]);
}

/// The front colour is all that is seen; behind it transmittance falls through the smallest numbers to 0.
#[test]
fn a_million_half_opaque_layers_end_cleanly() {
    let (frame, all) = draw(0.5, true, &settings(true));
    let [red, green, blue, alpha] = frame.pixel(1, 1);
    assert!(alpha == 1.0 && [red, green, blue].iter().all(|c| (c - 1.0).abs() <= 1e-6), "{:?}", frame.pixel(1, 1));
    let (early, few) = draw(0.5, true, &settings(true).with_termination(1e-5));
    assert!((early.pixel(1, 1)[3] - 1.0).abs() <= 1e-5, "{:?}", early.pixel(1, 1));
    // Rays end after 17 of them; but pixels at the corner of the picture, where weights are less, go on.
    assert!(few.splats_drawn < all.splats_drawn / 100, "{few:?}");
}

/// Colours with depth: red in front, blue behind. Emission weighs by what is in front, in closed form.
#[test]
fn colours_of_a_million_layers_mix_as_their_depths_say() {
    let part = 2e-6f64;
    let depth = -(-part).ln_1p() * voxel_per_pixel();
    let opacity = -(-depth * 1e-6f64).exp_m1();
    let transfer = transfer(&format!(
        r##"{{"kind": "points", "reference_length": 1e-6, "shaded": false, "points": [
            {{"value": 0, "colour": [1, 0, 0], "opacity": {opacity:e}}},
            {{"value": 1, "colour": [0, 0, 1], "opacity": {opacity:e}}}]}}"##
    ));
    // Half of the layers are red: the near ones, as the view goes up.
    let model = coded(columns().facts.grid.clone(), transfer, |[x, y, z]| {
        (x < 4 && y < 4).then_some(u16::from(u64::from(z) >= LONGEST / 2))
    });
    let half = -part * 16.0 * (LONGEST as f64) / 2.0;
    let (red, blue) = (-half.exp_m1(), half.exp() * -half.exp_m1());
    for sense in [Sense::FrontToBack, Sense::BackToFront] {
        let settings = settings(true).with_sense(sense);
        let (frame, _) = model.render(&camera(true), &settings);
        let got = frame.pixel(1, 1).map(f64::from);
        println!("{sense:?}: {got:?}, exactly {red} and {blue}");
        assert!((got[0] - red).abs() <= 1e-4 && (got[2] - blue).abs() <= 1e-4, "{sense:?}: {got:?}, {red} {blue}");
    }
}
