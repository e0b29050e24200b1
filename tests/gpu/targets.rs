//! What quads lose in targets of 16 and 8 bits: nothing to see where opacities are large, and much where they are
//! small, because a step below half a unit in the last place changes nothing any more (THEORY.md 3.3).

use adjsplat::arena::builder::Built;
use adjsplat::splat::gpu::{Compositor, Options, Renderer, Target};
use adjsplat::splat::{Camera, Projection, Quality, Settings, cpu};
use adjsplat::traverse::Sense;

use crate::compare::psnr;
use crate::device::{device, say};
use crate::scenes::{block, orbit, phantom, scene, transfer};

const SIZE: [u32; 2] = [9, 9];

fn renderer(built: &Built, compositor: Compositor) -> Option<Renderer<'_>> {
    let opened = device()?;
    let options = Options { vram: 256 << 20, compositor: Some(compositor) };
    Some(Renderer::new(opened.device.clone(), opened.queue.clone(), scene(built), options).unwrap())
}

#[test]
fn half_floats_are_good_enough_for_large_opacities() {
    // Each voxel of 0.1 to 0.6; a splat at a pixel has about a third of that.
    let text = r##"{ "kind": "points", "shaded": false, "points": [
        { "value": 100, "colour": "#ff2010", "opacity": 0.3 },
        { "value": 128, "colour": "#20c040", "opacity": 0.95 },
        { "value": 156, "colour": "#2030ff", "opacity": 0.3 }] }"##;
    let built = phantom("gyroid", [40, 44, 36], [1.0; 3], transfer(text), 8);
    let Some(mut renderer) = renderer(&built, Compositor::Quads(Target::Float16)) else { return };
    let size = [112, 96];
    for (azimuth, elevation, fov) in [(31.0, 24.0, None), (-100.0, 60.0, Some(45.0))] {
        for sense in [Sense::BackToFront, Sense::FrontToBack] {
            let settings = Settings { quality: Quality::High, sense, ..Settings::new(size) };
            let camera = orbit(&built, azimuth, elevation, fov, size);
            let (got, _) = renderer.render(&camera, &settings).unwrap();
            let (want, _) = cpu::render(&scene(&built), &camera, &settings).unwrap();
            let found = psnr(&got, &want);
            say(&format!("16 bits, {azimuth} {sense:?}: {found:.1} dB"));
            assert!(found >= 40.0, "{azimuth}, {sense:?}: {found:.1} dB");
        }
    }
}

/// A view along a column: each splat's centre is that of the middle pixel.
fn along() -> (Camera, Settings) {
    let projection = Projection::Parallel { height: f64::from(SIZE[1]) };
    let camera = Camera::new([0.0, 0.0, 5_000.0], [0.0; 3], [0.0, 1.0, 0.0], projection).unwrap();
    let settings =
        Settings { quality: Quality::Reference, sense: Sense::BackToFront, lighting: None, ..Settings::new(SIZE) };
    (camera, settings)
}

/// A white column of `count` voxels, each of which takes `part` of the light at the pixel of its centre.
fn column(count: u64, part: f64) -> Built {
    let (camera, settings) = along();
    let (single, _) = cpu::render(&scene(&block([1, 1, 1], "#ffffff", 0.5)), &camera, &settings).unwrap();
    // Optical depth at the centre per optical depth of a voxel.
    let weight = (-f64::from(single.pixel(4, 4)[3])).ln_1p() / (-0.5f64).ln_1p();
    block([1, 1, count], "#ffffff", -((-part).ln_1p() / weight).exp_m1())
}

/// Back to front, a pixel no longer changes once what a splat would add is below half a unit in its last place (or a
/// whole one, where a device rounds toward 0): it is off by that over the opacity.
#[test]
fn narrow_targets_stagnate_where_opacities_are_small_and_wide_ones_do_not() {
    let (part, count) = (0.01, 1_000u64);
    let built = column(count, part);
    let (camera, settings) = along();
    let exact = 1.0 - (1.0 - part).powi(1_000);
    let error = |compositor| {
        let (frame, _) = renderer(&built, compositor)?.render(&camera, &settings).unwrap();
        let error = (f64::from(frame.pixel(4, 4)[0]) - exact).abs();
        say(&format!("{count} voxels of {part}, {compositor:?}: {error:.2e}"));
        Some(error)
    };
    let Some(tiles) = error(Compositor::Tiles) else { return };
    // Calibrating by a picture costs a few units in the last place of `part`.
    assert!(tiles < 1e-5, "{tiles:e}");
    if device().is_some_and(|opened| opened.facts.blends_float32) {
        let wide = error(Compositor::Quads(Target::Float32)).unwrap();
        assert!(wide < 1e-5, "{wide:e}");
    }
    for (target, known) in [(Target::Float16, 0.025), (Target::Unorm8, 0.165)] {
        let found = error(Compositor::Quads(target)).unwrap();
        assert!((known / 2.0..=known * 2.0).contains(&found), "{target:?}: {found}, not about {known}");
    }
}
