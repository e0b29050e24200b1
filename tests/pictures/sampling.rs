//! Pictures of which only as many pixels are drawn as wide footprints need, beside those of which all are.

use adjsplat::arena::TileOrder;
use adjsplat::build::{BuildOptions, Built, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Camera, Frame, Mode, Orbit, Sampling, Scene, Settings, Surround, cpu};
use adjsplat::volume::SampleType;
use adjsplat::volume::phantom::Phantom;

fn built(name: &str, dims: [u64; 3], opacity: f64) -> Built {
    let phantom = Phantom::from_name(name).unwrap();
    let (low, high) = phantom.visible_range();
    let text = format!(
        r##"{{ "kind": "points", "shaded": true, "points": [
            {{ "value": {low}, "colour": "#ff4020", "opacity": {opacity} }},
            {{ "value": {high}, "colour": "#2060ff", "opacity": {opacity} }}] }}"##
    );
    let transfer = TransferFunction::from_json(&text).unwrap();
    let options =
        BuildOptions { transfer, lane_count: 3, tile_order: TileOrder::Morton, value_bits: 8, normal_bits: 8 };
    build(&mut *phantom.open(dims, SampleType::U8, [1.0; 3]).unwrap(), &options, &mut Unobserved).unwrap()
}

fn camera(built: &Built, zoom: f64, fov: Option<f64>, size: [u32; 2]) -> Camera {
    let around = Surround::of_grid(&built.facts.grid);
    let orbit = Orbit { azimuth: 37.0, elevation: 21.0, zoom, fov, ..Orbit::default() };
    Camera::orbiting(orbit, around, size).unwrap()
}

fn draw(built: &Built, camera: &Camera, settings: &Settings) -> Frame {
    let scene = Scene { facts: &built.facts, lanes: &built.lanes, transfer: &built.transfer };
    cpu::render(&scene, camera, settings).unwrap().0
}

fn enough(settings: &Settings) -> Settings {
    Settings { sampling: Sampling::Enough, ..settings.clone() }
}

/// Decibels between frames over pixels that are not empty in both, and the largest difference.
fn difference(a: &Frame, b: &Frame) -> (f64, f32) {
    let (mut sum, mut count, mut most) = (0.0, 0u32, 0.0f32);
    for (a, b) in a.pixels().chunks_exact(4).zip(b.pixels().chunks_exact(4)) {
        if a.iter().chain(b).any(|value| *value != 0.0) {
            for (a, b) in a.iter().zip(b) {
                sum += f64::from(a - b).powi(2);
                most = most.max((a - b).abs());
                count += 1;
            }
        }
    }
    (-10.0 * (sum / f64::from(count.max(1))).max(1e-20).log10(), most)
}

#[test]
fn enough_pixels_give_the_picture_of_all() {
    let size = [320, 240];
    // Bounds leave a few decibels to what was measured. In opaque noise every splat is an edge.
    for (name, dims, opacity, lowest) in
        [("gyroid", [48, 40, 44], 0.7, 51.0), ("shells", [40, 40, 40], 0.3, 60.0), ("noise", [24, 24, 24], 1.0, 45.0)]
    {
        let built = built(name, dims, opacity);
        let mut coarser = 0;
        for (zoom, fov) in [(1.0, None), (3.0, None), (1.0, Some(45.0)), (2.5, Some(60.0))] {
            let camera = camera(&built, zoom, fov, size);
            let settings = Settings::new(size);
            let (all, some) = (draw(&built, &camera, &settings), draw(&built, &camera, &enough(&settings)));
            let (decibels, most) = difference(&all, &some);
            println!("{name} zoom {zoom} fov {fov:?}: {decibels:.1} dB, largest {most:.3}");
            coarser += u32::from(all != some);
            assert!(decibels > lowest, "{name} zoom {zoom} fov {fov:?}: {decibels:.1} dB");
        }
        assert!(coarser >= 3, "{name}: pixels were left out in {coarser} views only");
    }
}

#[test]
fn enough_pixels_have_the_same_bits_for_any_threads() {
    let built = built("gyroid", [32, 32, 32], 0.5);
    let size = [200, 333];
    let camera = camera(&built, 1.3, Some(40.0), size);
    let one = draw(&built, &camera, &enough(&Settings::new(size)));
    for threads in [2, 3, 7] {
        assert!(
            one == draw(&built, &camera, &enough(&Settings { threads, ..Settings::new(size) })),
            "{threads} threads"
        );
    }
}

#[test]
fn where_nothing_is_nothing_is_drawn() {
    let built = built("corners", [25, 25, 25], 1.0);
    let size = [300, 300];
    let camera = camera(&built, 0.8, None, size);
    let settings = Settings::new(size);
    let (all, some) = (draw(&built, &camera, &settings), draw(&built, &camera, &enough(&settings)));
    let drawn = |frame: &Frame| frame.pixels().chunks_exact(4).filter(|pixel| pixel[3] != 0.0).count();
    let (all, some) = (drawn(&all), drawn(&some));
    // Three coarse pixels at most beyond a splat's edge: its own, its neighbour and rounding.
    assert!(all > 500 && some < 2 * all, "{some} pixels where {all} were drawn");
    assert!(some < 300 * 300 / 2);
}

#[test]
fn narrow_splats_and_other_modes_take_every_pixel() {
    let fine = built("gyroid", [96, 96, 96], 0.5);
    let small = [160, 160];
    let view = camera(&fine, 1.0, Some(40.0), small);
    let settings = Settings::new(small);
    assert!(draw(&fine, &view, &settings) == draw(&fine, &view, &enough(&settings)));
    let coarse = built("gyroid", [16, 16, 16], 0.5);
    for mode in [Mode::Maximum, Mode::MaximumGrey, Mode::Additive] {
        let settings = Settings { mode, ..Settings::new([128, 128]) };
        let view = camera(&coarse, 1.0, None, settings.size);
        assert!(draw(&coarse, &view, &settings) == draw(&coarse, &view, &enough(&settings)), "{mode:?}");
    }
}

#[test]
fn a_picture_that_cuts_the_volume_has_no_seam_at_its_border() {
    let built = built("shells", [40, 40, 40], 0.5);
    let size = [256, 256];
    let camera = camera(&built, 4.0, None, size);
    let settings = Settings::new(size);
    let (all, some) = (draw(&built, &camera, &settings), draw(&built, &camera, &enough(&settings)));
    let of =
        |frame: &Frame, at: u32| [frame.pixel(at, 0), frame.pixel(0, at), frame.pixel(at, 255), frame.pixel(255, at)];
    for at in 0..256 {
        for (a, b) in of(&all, at).as_flattened().iter().zip(of(&some, at).as_flattened()) {
            // As inside the picture: see the test of decibels.
            assert!((a - b).abs() < 0.05, "pixel {at} of a border: {a} and {b}");
        }
    }
}

#[test]
fn an_eye_inside_takes_every_pixel_or_shows_the_same() {
    let built = built("shells", [32, 32, 32], 0.4);
    let size = [160, 120];
    let inside = Camera::new(
        [3.0, 1.0, 2.0],
        [8.0, 9.0, 3.0],
        [0.0, 0.0, 1.0],
        adjsplat::splat::Projection::Perspective { fov: 80.0 },
    )
    .unwrap();
    let settings = Settings::new(size);
    let (all, some) = (draw(&built, &inside, &settings), draw(&built, &inside, &enough(&settings)));
    let (decibels, _) = difference(&all, &some);
    assert!(decibels > 45.0, "{decibels:.1} dB");
}
