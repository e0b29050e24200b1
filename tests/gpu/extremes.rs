//! The extremes of tests/pictures/extremes on graphics devices: finite, the same every time, and the processor's picture; or,
//! where the targets of quads are narrow, off by what is known of them.

use adjsplat::Error;
use adjsplat::build::Built;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, QuadFormat};
use adjsplat::splat::{Camera, Frame, Mode, Projection, Quality, Settings, StopRequest, cpu};
use adjsplat::traverse::{Sense, VoxelBox};
use adjsplat::volume::SampleType;
use adjsplat::volume::phantom::Phantom;
use adjsplat_tests::pictures::bits;
use adjsplat_tests::scenes::{Draw as _, LIT_LAYERS, built, options, transfer};
use adjsplat_tests::{at_full, say};

use crate::compare::{drawn, worst};
use crate::device::device;
use crate::scenes::{block, inside, phantom};

const UP: [f64; 3] = [0.0, 1.0, 0.0];
const ALONG: [f64; 3] = [0.0, 0.0, 1.0];

/// What adds up in 32 bits.
fn compositors() -> Vec<Compositor> {
    let blends = device().is_some_and(|opened| opened.facts.blends_float32);
    std::iter::once(Compositor::Tiles).chain(blends.then_some(Compositor::Quads(QuadFormat::Float32))).collect()
}

fn renderer(built: &Built, compositor: Compositor) -> Option<GpuRenderer<'_>> {
    let opened = device()?;
    let options = GpuOptions::default().with_vram(512 << 20).with_compositor(compositor);
    Some(GpuRenderer::new(opened.device.clone(), opened.queue.clone(), built.scene(), options).unwrap())
}

/// The picture: finite, and the same a second time.
fn draw(renderer: &mut GpuRenderer, camera: &Camera, settings: &Settings) -> Frame {
    let (frame, _) = renderer.render(camera, settings).unwrap();
    let (again, _) = renderer.render(camera, settings).unwrap();
    assert!(frame.pixels().iter().all(|value| value.is_finite()), "not finite: {settings:?}");
    assert!(bits(&frame) == bits(&again), "another picture the second time: {settings:?}");
    frame
}

/// Holds the device's pictures to the processor's within `bound`.
fn check(what: &str, built: &Built, views: &[(Camera, Settings)], bound: f32) {
    if device().is_none() {
        return;
    }
    for compositor in compositors() {
        let Some(mut renderer) = renderer(built, compositor) else { return };
        let mut most = 0.0f32;
        for (camera, settings) in views {
            let want = drawn(&built.scene(), camera, settings);
            let got = draw(&mut renderer, camera, settings);
            let (apart, at) = worst(&got, &want);
            most = most.max(apart);
            assert!(
                apart <= bound,
                "{what}, {compositor:?}: {apart:e} at {at:?}, not {bound:e}: {camera:?} {settings:?}"
            );
        }
        say(&format!("{what}, {compositor:?}: within {most:.1e}"));
    }
}

fn parallel(target: [f64; 3], along: [f64; 3], up: [f64; 3], height: f64) -> Camera {
    let position = std::array::from_fn(|a| target[a] - along[a]);
    Camera::new(position, target, up, Projection::Parallel { height }).unwrap()
}

fn reference(size: [u32; 2]) -> Settings {
    Settings::every_pixel(size).with_quality(Quality::Reference)
}

fn voxels(dims: [u64; 3], spacing: [f64; 3], places: Vec<[u32; 3]>, opacity: f64) -> Built {
    let text = format!(
        r##"{{ "kind": "points", "shaded": false, "reference_length": 1, "points": [
            {{ "value": 0, "colour": "#ffffff", "opacity": 0 }}, {{ "value": 254, "colour": "#ffffff", "opacity": 0 }},
            {{ "value": 255, "colour": "#ffffff", "opacity": {opacity:e} }}] }}"##
    );
    let mut source = Phantom::Voxels(places).open(dims, SampleType::U8, spacing).unwrap();
    built(&mut *source, &options(transfer(&text)).with_normal_bits(0))
}

/// Roundings of a device's division, root and exponential: some 2^-22 of a depth, which counts with at most 1/e.
const ROUNDING: f32 = 2e-6;

#[test]
fn opacities_from_denormal_to_one() {
    for missing in [0.5, 1e-3, 2f64.powi(-24), 2f64.powi(-53), 0.0] {
        let built = voxels([1; 3], [1.0; 3], vec![[0; 3]], 1.0 - missing);
        check(
            &format!("opacity 1 - {missing:e}"),
            &built,
            &[(parallel([0.0; 3], ALONG, UP, 1.1), reference([9, 9]))],
            ROUNDING,
        );
    }
    for opacity in [5e-324, 1e-310, 1e-40, 1e-20, 1e-9] {
        let built = voxels([1; 3], [1.0; 3], vec![[0; 3]], opacity);
        let views = [Mode::Composite, Mode::Additive]
            .map(|mode| (parallel([0.0; 3], ALONG, UP, 1.1), reference([9, 9]).with_mode(mode)));
        check(&format!("opacity {opacity:e}"), &built, &views, 1e-9);
    }
}

#[test]
fn splats_from_a_billionth_of_a_pixel_to_a_billion() {
    let built = voxels([1; 3], [1.0; 3], vec![[0; 3]], 0.5);
    for pixels in [1e-9, 1e-6, 1e-3, 0.1, 1.0, 30.0, 1e3, 1e6, 1e9] {
        let mut views = Vec::new();
        for mode in [Mode::Composite, Mode::Additive, Mode::Maximum] {
            for (x, y) in [(0.0, 0.0), (0.5, 0.5), (7.3, -11.1)] {
                let target = [x / pixels, y / pixels, 0.0];
                views.push((parallel(target, ALONG, UP, 33.0 / pixels), reference([41, 33]).with_mode(mode)));
            }
        }
        // A pixel on a footprint's edge is 1e-4 of a peak of 0.25.
        check(&format!("{pixels:e} pixels a voxel"), &built, &views, ROUNDING + 3e-5);
    }
}

#[test]
fn voxels_far_off_the_picture() {
    let built = voxels([1; 3], [1.0; 3], vec![[0; 3]], 0.9);
    let mut views = Vec::new();
    for off in [1e3, 1e6, 2.2e9, 4.3e9, 1e12, 1e18, 1e30] {
        for (x, y) in [(off, 0.0), (0.0, -off), (-off, off)] {
            views.push((parallel([x, y, 0.0], ALONG, UP, 30.0), reference([40, 30])));
        }
        let camera = Camera::new([off, 0.0, -10.0], [off, 0.0, 0.0], UP, Projection::Perspective { fov: 40.0 });
        views.push((camera.unwrap(), reference([40, 30])));
    }
    check("far off", &built, &views, 0.0);
}

#[test]
fn spacings_from_tiny_to_huge() {
    for unit in [1e-100, 1e-30, 1.0, 1e30, 1e100] {
        let built = phantom("gyroid", [20, 18, 16], [unit; 3], transfer(LIT_LAYERS), 8);
        let target = [9.5, 8.5, 7.5].map(|c| c * unit);
        let from = |distance: f64| {
            let position = [9.5, 8.7, 8.0].map(|c| c * unit + distance * unit);
            Camera::new(position, target, [0.0, unit, 0.0], Projection::Perspective { fov: 40.0 }).unwrap()
        };
        let flat = parallel(target, [0.3 * unit, 0.5 * unit, unit], [0.0, unit, 0.0], 24.0 * unit);
        let views = [flat, from(25.0), from(2.37)].map(|camera| (camera, reference([48, 40])));
        // Places of perspective views are in single precision: some 1e-4 of a pixel, times a depth's slope.
        check(&format!("spacing {unit:e}"), &built, &views, 1e-3);
    }
}

#[test]
fn one_axis_a_thousand_times_as_coarse() {
    for coarse in 0..3 {
        let mut spacing = [1.0; 3];
        spacing[coarse] = 1000.0;
        let built = phantom("gyroid", [16; 3], spacing, transfer(LIT_LAYERS), 8);
        let target = spacing.map(|h| 7.5 * h);
        let mut views = Vec::new();
        for along in [[0.0, 0.0, 1.0], [1.0, 0.2, 0.3], [1.0, 1.0, 1.0], [0.0, 1.0, 1e-3]] {
            let along = [0, 1, 2].map(|a| along[a] * spacing[a]);
            for height in [20.0, 2e4] {
                views.push((parallel(target, along, [0.3, 0.8, 0.2], height), reference([48, 48])));
            }
        }
        // Splats are up to 1000 pixels long and 0.6 wide: in single precision their ridge is placed to 1e-4 of that.
        check(&format!("1:1000 along {coarse}"), &built, &views, 2e-3);
    }
}

#[test]
fn ties_and_eyes_on_voxels() {
    let built = phantom("gyroid", [24; 3], [1.0; 3], transfer(LIT_LAYERS), 8);
    let mut views = Vec::new();
    let directions = [[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [0.0, 0.0, -1.0]];
    for (index, along) in directions.into_iter().enumerate() {
        for axis in (at_full(0, index % 3)..3).step_by(at_full(1, 3)) {
            let mut beside: [f64; 3] = along;
            beside[axis] *= 1.0 + 4.0 * f64::EPSILON;
            for along in [along, beside] {
                views.push((parallel([11.5; 3], along, [0.1, 0.7, 0.3], 40.0), reference([48, 48])));
            }
        }
    }
    // Both draw in one order, whichever it is.
    check("ties", &built, &views, 1e-4);
    let mut views = Vec::new();
    for eye in [
        [12.0, 12.0, 12.0],
        [12.0, 12.0, 12.5],
        [12.0, 12.5, 12.5],
        [0.0, 0.0, 0.0],
        [23.0, 4.0, 5.5],
        [-8.0, 12.0, 12.0],
    ] {
        for near in [None, Some(0.5)] {
            views.push((inside(&built, eye, [1.0, 0.4, -0.3]), reference([48, 40]).with_near(near)));
        }
    }
    // Near the eye footprints are the size of the picture, and depths single precision's.
    check("eyes", &built, &views, 4e-3);
    let distance = 1e9;
    let camera = Camera::new(
        [11.5, 11.5, 11.5 + distance],
        [11.5; 3],
        UP,
        Projection::Perspective { fov: 2.0 * (20.0 / distance).atan().to_degrees() },
    );
    check("an eye at 1e9", &built, &[(camera.unwrap(), reference([48, 48]))], 1e-3);
}

#[test]
fn angles_of_view_from_none_to_all() {
    let built = phantom("gyroid", [24; 3], [1.0; 3], transfer(LIT_LAYERS), 8);
    for fov in [1e-6, 60.0, 170.0, 179.9] {
        let camera = Camera::new([11.5, 11.5, -9.0], [11.5; 3], UP, Projection::Perspective { fov }).unwrap();
        check(&format!("{fov} degrees"), &built, &[(camera, reference([40, 40]))], 1e-3);
    }
}

/// A picture of half a minute went on after Ctrl-C.
#[test]
fn a_requested_stop_ends_drawing_and_the_next_picture_is_right() {
    let built = phantom("gyroid", [24; 3], [1.0; 3], transfer(LIT_LAYERS), 8);
    let (camera, settings) = (parallel([11.5; 3], [0.3, 0.4, 1.0], UP, 30.0), reference([40, 40]));
    for compositor in compositors() {
        let Some(mut renderer) = renderer(&built, compositor) else { continue };
        let (wanted, _) = renderer.render(&camera, &settings).unwrap();
        let (stop, made) = (StopRequest::default(), StopRequest::default());
        made.make();
        assert!(matches!(renderer.render(&camera, &settings.clone().with_stop(made)), Err(Error::Interrupted)));
        let (frame, _) = renderer.render(&camera, &settings.clone().with_stop(stop)).unwrap();
        assert!(bits(&frame) == bits(&wanted), "{compositor:?}");
    }
}

/// Mesa's llvmpipe, before version 25, ends the loops of an invocation after 65,535 turns: the last voxels of such lines were lost.
#[test]
fn a_line_of_as_many_voxels_as_a_line_may_have() {
    let built = voxels([65_535, 1, 1], [1.0; 3], (0..65_535).map(|x| [x, 0, 0]).collect(), 0.3);
    let mut views = Vec::new();
    for at in [0.0, 65_534.0] {
        views.push((parallel([at, 0.0, 0.0], [0.3, 0.2, 1.0], UP, 9.0), reference([33, 17])));
    }
    for at in [-3.0, 100.2, 40_000.7, 65_537.0] {
        let projection = Projection::Perspective { fov: 60.0 };
        let toward = if at < 32_768.0 { 65_534.0 } else { 0.0 };
        let camera = Camera::new([at, 1.5, 2.5], [at + (toward - at).signum() * 4.0, 0.0, 0.0], UP, projection);
        views.push((camera.unwrap(), reference([33, 17])));
    }
    check("a full line", &built, &views, 1e-3);
}

/// Gaps that need stepping voxels, ends of the longest line, along and across.
#[test]
fn the_longest_line_and_its_gaps() {
    for axis in 0..3 {
        let mut dims = [1; 3];
        dims[axis] = 65_535;
        let place = |at: u32| {
            let mut place = [0; 3];
            place[axis] = at;
            place
        };
        let at = [0, 255, 511, 1_021, 1_532, 65_534];
        let built = voxels(dims, [1.0; 3], at.map(place).to_vec(), 0.9);
        let along = [0, 1, 2].map(|a| f64::from(u8::from(a == axis)));
        let across = [0, 1, 2].map(|a| f64::from(u8::from(a == (axis + 1) % 3)));
        let side = [0, 1, 2].map(|a| f64::from(u8::from(a == (axis + 2) % 3)));
        let mut views = vec![(parallel([0.0; 3], along, side, 4.0), reference([17, 17]))];
        for at in at {
            let mut target = [0.0; 3];
            target[axis] = f64::from(at);
            views.push((parallel(target, across, side, 9.0), reference([33, 17])));
        }
        check(&format!("gaps along {axis}"), &built, &views, ROUNDING + 1e-4);
    }
}

#[test]
fn sizes_of_pictures() {
    let built = block([4; 3], "#ffffff", 0.5);
    let target = [1.5; 3];
    for size in [[1, 1], [1, 16_384], [16_384, 1], [16_384, 3]] {
        let camera = parallel(target, [0.3, 0.2, 1.0], UP, f64::from(size[1]));
        check(&format!("{size:?}"), &built, &[(camera, reference(size))], ROUNDING + 1e-4);
    }
    let Some(mut renderer) = renderer(&built, Compositor::Tiles) else { return };
    for size in [[0, 0], [0, 9], [9, 0], [16_385, 1], [u32::MAX, u32::MAX]] {
        let refusal =
            renderer.render(&parallel(target, ALONG, UP, 9.0), &Settings::every_pixel(size)).unwrap_err().to_string();
        assert!(refusal.contains("picture size") && refusal.lines().count() == 1, "{size:?}: {refusal}");
    }
}

/// 16 splats a layer on one pixel, each of `part` of its light: as `layers` of tests/pictures/extremes has them.
fn columns(part: f64, layers: u64) -> (Built, Camera, Settings, f64) {
    let scale = 1e-3f64;
    let kept = -(-0.5 * (3.0f64 / 0.7).powi(2)).exp_m1();
    let depth = -(-part).ln_1p() * std::f64::consts::TAU * 0.36 * kept / (scale * scale);
    let opacity = -(-depth * 1e-6f64).exp_m1();
    let text = format!(
        r##"{{ "kind": "points", "shaded": false, "reference_length": 1e-6, "points": [
            {{ "value": 0, "colour": "#ffffff", "opacity": {opacity:e} }}] }}"##
    );
    let built = phantom("constant", [4, 4, layers], [1.0; 3], transfer(&text), 8);
    let camera = parallel([1.5, 1.5, 0.0], ALONG, UP, 3.0 / scale);
    let settings = reference([3, 3]).with_lighting(None);
    (built, camera, settings, (16.0 * layers as f64 * (-part).ln_1p()).exp())
}

/// Registers and targets of 32 bits hold a transmittance near 1 to 2^-24: what a splat takes is rounded to a multiple of
/// that. The processor draws such scenes in stacks of slices; a device does not, and this is where it stops being right.
#[test]
fn a_million_faint_layers_on_a_device_are_off_by_what_is_known() {
    if device().is_none() {
        return;
    }
    for (part, senses) in [(1e-7, &[Sense::FrontToBack, Sense::BackToFront][..]), (1e-5, &[Sense::FrontToBack])] {
        let (built, camera, settings, exact) = columns(part, 65_535);
        let (want, _) = cpu::render(&built.scene(), &camera, &settings).unwrap();
        let cpu_error = (1.0 - f64::from(want.pixel(1, 1)[3]) - exact).abs();
        assert!(cpu_error <= 1e-4, "{part:e}: {cpu_error:e}");
        for compositor in compositors() {
            for &sense in &senses[at_full(0, senses.len() - 1)..] {
                let Some(mut renderer) = renderer(&built, compositor) else { return };
                let (frame, _) = renderer.render(&camera, &settings.clone().with_sense(sense)).unwrap();
                let got = 1.0 - f64::from(frame.pixel(1, 1)[3]);
                let error = (got - exact).abs();
                say(&format!("{part:e} a million times, {compositor:?}, {sense:?}: {got:.4}, exactly {exact:.4}"));
                // Half a unit in the last place a splat, as long as something is left, and what it weighs at the end: at
                // most part / 2^-24 of the depth each.
                let splats = (1_048_560.0f64).min(17.0 / part);
                assert!(error <= splats * 2f64.powi(-24), "{part:e} {compositor:?} {sense:?}: {error:e}");
                assert!(part > 1e-6 || error > 1e-4, "{part:e} {compositor:?}: better than known: {error:e}");
            }
        }
        for target in [QuadFormat::Float16, QuadFormat::Unorm8] {
            let settings = settings.clone().with_sense(Sense::BackToFront);
            let Some(mut renderer) = renderer(&built, Compositor::Quads(target)) else { return };
            let (frame, _) = renderer.render(&camera, &settings).unwrap();
            let got = 1.0 - f64::from(frame.pixel(1, 1)[3]);
            say(&format!("{part:e} a million times, {target:?}: {got:.4}, exactly {exact:.4}"));
            // Eight bits never see such a splat. Of sixteen it takes a whole unit in the last place where a device rounds
            // toward 0, until nothing is left, and else nothing.
            let known = if target == QuadFormat::Unorm8 { got == 1.0 } else { got == 1.0 || got < 0.01 };
            assert!(known, "{part:e} {target:?}: {got}");
        }
    }
}

#[test]
fn a_hundred_thousand_half_opaque_splats_on_a_device_end_cleanly() {
    let (built, camera, settings, _) = columns(0.5, 6_250);
    let crop = Some(VoxelBox { low: [0; 3], high: [3, 3, 999] });
    let views = [settings.clone(), settings.clone().with_termination(1e-5), settings.with_crop(crop)]
        .map(|settings| (camera, settings));
    // Rays that end early lack 1e-5.
    check("half opaque", &built, &views, 2e-5);
}

#[test]
fn transfer_functions_of_huge_values() {
    let text = r##"{ "kind": "points", "shaded": false, "points": [
        { "value": -1.7e308, "colour": "#ff2010", "opacity": 0.1 }, { "value": 128, "colour": "#20c040", "opacity": 0.2 },
        { "value": 128, "colour": "#20c040", "opacity": 0.6 }, { "value": 1.7e308, "colour": "#2030ff", "opacity": 0.9 }] }"##;
    let built = phantom("gyroid", [20; 3], [1.0; 3], transfer(text), 8);
    let views = [([0.3, 0.5, 1.0], 30.0), ([1.0, 0.0, 0.0], 8.0)]
        .map(|(along, height)| (parallel([9.5; 3], along, UP, height), reference([40, 40])));
    check("huge values", &built, &views, 1e-4);
}
