//! What quads lose in targets of 16 and 8 bits: nothing to see where opacities are large, and much where they are
//! small, because a step below half a unit in the last place changes nothing any more.

use adjsplat::build::Built;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, QuadFormat};
use adjsplat::splat::{Camera, Projection, Quality, Settings, cpu};
use adjsplat::traverse::Sense;
use adjsplat_tests::pictures::decibels;
use adjsplat_tests::say;
use adjsplat_tests::scenes::{Draw as _, transfer};

use crate::device::device;
use crate::scenes::{block, phantom};

const SIZE: [u32; 2] = [9, 9];

fn renderer(built: &Built, compositor: Compositor) -> Option<GpuRenderer<'_>> {
    let opened = device()?;
    let options = GpuOptions::default().with_vram(256 << 20).with_compositor(compositor);
    Some(GpuRenderer::new(opened.device.clone(), opened.queue.clone(), built.scene(), options).unwrap())
}

/// 16 bits hold a pixel of up to 1 within 2^-12, and a hundred splats add up to 40 dB, where each is rounded to
/// nearest. A device may as well round toward 0 (Mesa's llvmpipe does): front to back a hundred of them add up one way,
/// while back to front each splat shrinks the roundings behind it. That is the device's own, as the twin with the same
/// rounding shows (`stages`).
#[test]
fn half_floats_are_good_enough_for_large_opacities() {
    // Each voxel of 0.3 to 0.95; a splat at a pixel takes 0.1 to 0.6.
    let text = r##"{ "kind": "points", "shaded": false, "points": [
        { "value": 100, "colour": "#ff2010", "opacity": 0.3 },
        { "value": 128, "colour": "#20c040", "opacity": 0.95 },
        { "value": 156, "colour": "#2030ff", "opacity": 0.3 }] }"##;
    let built = phantom("gyroid", [40, 44, 36], [1.0; 3], transfer(text), 8);
    let Some(mut renderer) = renderer(&built, Compositor::Quads(QuadFormat::Float16)) else { return };
    let rounds_toward_zero =
        column_error(Compositor::Quads(QuadFormat::Float16)).is_some_and(|error| error > TOWARD_ZERO);
    if rounds_toward_zero {
        say("this device rounds toward 0 in 16 bits");
    }
    let size = [112, 96];
    for (azimuth, elevation, fov) in [(31.0, 24.0, None), (-100.0, 60.0, Some(45.0))] {
        for sense in [Sense::BackToFront, Sense::FrontToBack] {
            let settings = Settings::every_pixel(size).with_quality(Quality::High).with_sense(sense);
            let camera = built.orbit(azimuth, elevation, fov, size);
            let (got, _) = renderer.render(&camera, &settings).unwrap();
            let (want, _) = cpu::render(&built.scene(), &camera, &settings).unwrap();
            let found = decibels(&got, &want, 0.0);
            let least = if rounds_toward_zero && sense == Sense::FrontToBack { 30.0 } else { 40.0 };
            say(&format!("16 bits, {azimuth} {sense:?}: {found:.1} dB"));
            assert!(found >= least, "{azimuth}, {sense:?}: {found:.1} dB");
        }
    }
}

/// A view along a column: each splat's centre is that of the middle pixel.
fn along() -> (Camera, Settings) {
    let projection = Projection::Parallel { height: f64::from(SIZE[1]) };
    let camera = Camera::new([0.0, 0.0, 5_000.0], [0.0; 3], [0.0, 1.0, 0.0], projection).unwrap();
    let settings =
        Settings::every_pixel(SIZE).with_quality(Quality::Reference).with_sense(Sense::BackToFront).with_lighting(None);
    (camera, settings)
}

/// A white column of `count` voxels, each of which takes `part` of the light at the pixel of its centre.
fn column(count: u64, part: f64) -> Built {
    let (camera, settings) = along();
    let (single, _) = block([1, 1, 1], "#ffffff", 0.5).render(&camera, &settings);
    // Optical depth at the centre per optical depth of a voxel.
    let weight = (-f64::from(single.pixel(4, 4)[3])).ln_1p() / (-0.5f64).ln_1p();
    block([1, 1, count], "#ffffff", -((-part).ln_1p() / weight).exp_m1())
}

/// Opacity and number of the column's voxels.
const PART: f64 = 0.01;
const COUNT: u64 = 1_000;
/// Between the errors in 16 bits of rounding to nearest, half a unit over the opacity, and toward 0, a unit over it.
const TOWARD_ZERO: f64 = 0.036;

/// What the middle pixel of the column's picture is off by.
fn column_error(compositor: Compositor) -> Option<f64> {
    let built = column(COUNT, PART);
    let (camera, settings) = along();
    let (frame, _) = renderer(&built, compositor)?.render(&camera, &settings).unwrap();
    let exact = 1.0 - (1.0 - PART).powi(COUNT as i32);
    let error = (f64::from(frame.pixel(4, 4)[0]) - exact).abs();
    say(&format!("{COUNT} voxels of {PART}, {compositor:?}: {error:.2e}"));
    Some(error)
}

/// Back to front, a pixel no longer changes once what a splat would add is below half a unit in its last place (or a
/// whole one, where a device rounds toward 0): it is off by that over the opacity. An NVIDIA H200 blends 16 bits in a way of
/// its own, with a quarter of that error.
#[test]
fn narrow_targets_stagnate_where_opacities_are_small_and_wide_ones_do_not() {
    let Some(tiles) = column_error(Compositor::Tiles) else { return };
    // Calibrating by a picture costs a few units in the last place of the opacity.
    assert!(tiles < 1e-5, "{tiles:e}");
    if device().is_some_and(|opened| opened.facts.blends_float32) {
        let wide = column_error(Compositor::Quads(QuadFormat::Float32)).unwrap();
        assert!(wide < 1e-5, "{wide:e}");
    }
    for (target, known) in [(QuadFormat::Float16, 0.025), (QuadFormat::Unorm8, 0.165)] {
        let found = column_error(Compositor::Quads(target)).unwrap();
        let is_own_way = target == QuadFormat::Float16 && device().is_some_and(|opened| !opened.facts.is_software());
        let least = known / if is_own_way { 10.0 } else { 2.0 };
        assert!((least..=known * 2.0).contains(&found), "{target:?}: {found}, not about {known}");
    }
}
