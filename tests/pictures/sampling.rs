//! Pictures of which only as many pixels are drawn as wide footprints need, beside those of which all are.

use adjsplat::build::Built;
use adjsplat::splat::{Camera, Code, Frame, Mode, Orbit, Projection, Sampling, Settings};
use adjsplat_tests::pictures::{apart, decibels};
use adjsplat_tests::scenes::{Draw as _, built_phantom};

fn build(name: &str, dims: [u64; 3], opacity: f64) -> Built {
    built_phantom(name, dims, [opacity; 2])
}

fn camera(built: &Built, zoom: f64, fov: Option<f64>, size: [u32; 2]) -> Camera {
    built.camera(Orbit { azimuth: 37.0, elevation: 21.0, zoom, fov, ..Orbit::default() }, size)
}

fn enough(settings: &Settings) -> Settings {
    settings.clone().with_sampling(Sampling::Enough)
}

#[test]
fn enough_pixels_give_the_picture_of_all() {
    let size = [320, 240];
    // Bounds leave a few decibels to what was measured. In opaque noise every splat is an edge.
    for (name, dims, opacity, lowest) in
        [("gyroid", [48, 40, 44], 0.7, 48.0), ("shells", [40, 40, 40], 0.3, 56.0), ("noise", [24, 24, 24], 1.0, 45.0)]
    {
        let built = build(name, dims, opacity);
        let mut coarser = 0;
        for (zoom, fov) in [(1.0, None), (3.0, None), (1.0, Some(45.0)), (2.5, Some(60.0))] {
            let camera = camera(&built, zoom, fov, size);
            let settings = Settings::every_pixel(size);
            let (all, some) = (built.frame(&camera, &settings), built.frame(&camera, &enough(&settings)));
            let (near, most) = (decibels(&all, &some, 0.0), apart(&all, &some));
            println!("{name} zoom {zoom} fov {fov:?}: {near:.1} dB, largest {most:.3}");
            coarser += u32::from(all != some);
            assert!(near > lowest, "{name} zoom {zoom} fov {fov:?}: {near:.1} dB");
        }
        assert!(coarser >= 3, "{name}: pixels were left out in {coarser} views only");
    }
}

#[test]
fn enough_pixels_have_the_same_bits_for_any_threads() {
    let built = build("gyroid", [32, 32, 32], 0.5);
    let size = [200, 333];
    let camera = camera(&built, 1.3, Some(40.0), size);
    let one = built.frame(&camera, &enough(&Settings::every_pixel(size)));
    for threads in [2, 3, 7] {
        assert!(
            one == built.frame(&camera, &enough(&Settings::every_pixel(size).with_threads(threads))),
            "{threads} threads"
        );
    }
}

#[test]
fn where_nothing_is_nothing_is_drawn() {
    let built = build("corners", [25, 25, 25], 1.0);
    let size = [300, 300];
    let camera = camera(&built, 0.8, None, size);
    let settings = Settings::every_pixel(size);
    let (all, some) = (built.frame(&camera, &settings), built.frame(&camera, &enough(&settings)));
    let drawn = |frame: &Frame| frame.pixels().chunks_exact(4).filter(|pixel| pixel[3] != 0.0).count();
    let (all, some) = (drawn(&all), drawn(&some));
    // Three coarse pixels at most beyond a splat's edge: its own, its neighbour and rounding.
    assert!(all > 500 && some < 2 * all, "{some} pixels where {all} were drawn");
    assert!(some < 300 * 300 / 2);
}

/// Views in perspective from near and far, wide angles, and one at which the volume is behind the picture's edges.
#[test]
fn perspectives_on_the_lattice_keep_44_decibels() {
    for (name, opacity) in [("gyroid", 0.5), ("shells", 1.0), ("marschner-lobb", 0.6)] {
        let built = build(name, [64, 56, 60], opacity);
        for (zoom, fov) in [(1.0, 20.0), (1.0, 75.0), (0.7, 40.0), (4.0, 50.0)] {
            let size = [200, 240];
            let camera = camera(&built, zoom, Some(fov), size);
            let every = Settings::every_pixel(size).with_sampling(Sampling::Finer);
            let near = decibels(&built.frame(&camera, &every), &built.frame(&camera, &enough(&every)), 1e-3);
            println!("{name} zoom {zoom} fov {fov}: {near:.1} dB");
            assert!(near > 44.0, "{name} zoom {zoom} fov {fov}: {near:.1} dB");
        }
    }
}

#[test]
fn the_lattice_of_a_perspective_is_drawn_alike_by_its_plain_twin() {
    let built = build("gyroid", [30, 26, 28], 0.6);
    let size = [70, 61];
    for (azimuth, elevation) in [(0.0, 0.0), (37.0, 21.0), (190.0, 45.0), (268.0, -60.0)] {
        let orbit = Orbit { azimuth, elevation, fov: Some(35.0), ..Orbit::default() };
        let camera = built.camera(orbit, size);
        let settings = enough(&Settings::every_pixel(size));
        let fast = built.frame(&camera, &settings);
        assert!(fast != built.frame(&camera, &Settings::every_pixel(size)), "every pixel was drawn");
        for code in [Code::Plain, Code::Portable, Code::Avx2] {
            assert!(fast == built.frame(&camera, &settings.clone().with_code(code)), "{azimuth} {elevation} {code:?}");
        }
    }
}

#[test]
fn maxima_take_every_pixel() {
    let coarse = build("gyroid", [16, 16, 16], 0.5);
    for mode in [Mode::Maximum, Mode::MaximumGrey] {
        let settings = Settings::every_pixel([128, 128]).with_mode(mode);
        let view = camera(&coarse, 1.0, None, settings.size);
        assert!(coarse.frame(&view, &settings) == coarse.frame(&view, &enough(&settings)), "{mode:?}");
    }
}

/// Along an axis in a wide angle, where all pixels of a tile have the slope of its middle, 50 dB were measured; elsewhere 59.
#[test]
fn x_rays_on_the_lattice_keep_48_decibels_and_are_drawn_alike_by_their_plain_twin() {
    let built = build("gyroid", [30, 26, 28], 0.6);
    let size = [118, 121];
    for (azimuth, elevation, fov) in
        [(0.0, 0.0, None), (37.0, 21.0, None), (190.0, 45.0, Some(35.0)), (0.0, 0.0, Some(60.0))]
    {
        let camera = built.camera(Orbit { azimuth, elevation, fov, ..Orbit::default() }, size);
        let all = Settings::every_pixel(size).with_mode(Mode::Additive);
        let some = enough(&all);
        let (every, fast) = (built.frame(&camera, &all), built.frame(&camera, &some));
        assert!(fast != every, "every pixel was drawn");
        let near = decibels(&every, &fast, 0.0);
        assert!(near > 48.0, "{azimuth} {elevation} {fov:?}: {near:.1} dB");
        for settings in [some.clone().with_code(Code::Plain), some.clone().with_code(Code::Avx2), some.with_threads(3)]
        {
            assert!(fast == built.frame(&camera, &settings), "{azimuth} {elevation} {fov:?}");
        }
    }
}

/// At 50 times the opacities, an x-ray on the lattice had 35 decibels.
#[test]
fn an_overexposed_x_ray_takes_every_pixel() {
    let built = build("gyroid", [30, 26, 28], 0.6);
    let all = Settings::every_pixel([90, 80]).with_mode(Mode::Additive).with_exposure(Some(50.0));
    let view = camera(&built, 1.0, None, all.size);
    assert!(built.frame(&view, &all) == built.frame(&view, &enough(&all)));
}

/// Where the lattice's filter ends, 2 % of the light may be left: exposed 55 times as much, this had 33.4 dB.
#[test]
fn an_overexposed_x_ray_of_small_voxels_shows_the_ends_of_pixels() {
    let built = build("gyroid", [30, 26, 28], 0.6);
    let view = camera(&built, 1.0, None, [6, 16]);
    for exposure in [None, Some(0.2), Some(1.0), Some(3.0)] {
        let all = Settings::every_pixel([6, 16]).with_mode(Mode::Additive).with_exposure(exposure);
        let near = decibels(&built.frame(&view, &all), &built.frame(&view, &enough(&all)), 0.0);
        assert!(near > 46.0, "{exposure:?}: {near:.1} dB");
    }
}

#[test]
fn a_picture_that_cuts_the_volume_has_no_seam_at_its_border() {
    let built = build("shells", [40, 40, 40], 0.5);
    let size = [256, 256];
    let camera = camera(&built, 4.0, None, size);
    let settings = Settings::every_pixel(size);
    let (all, some) = (built.frame(&camera, &settings), built.frame(&camera, &enough(&settings)));
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
    let built = build("shells", [32, 32, 32], 0.4);
    let size = [160, 120];
    let inside =
        Camera::new([3.0, 1.0, 2.0], [8.0, 9.0, 3.0], [0.0, 0.0, 1.0], Projection::Perspective { fov: 80.0 }).unwrap();
    let settings = Settings::every_pixel(size);
    let (all, some) = (built.frame(&inside, &settings), built.frame(&inside, &enough(&settings)));
    let near = decibels(&all, &some, 0.0);
    assert!(near > 45.0, "{near:.1} dB");
}
