//! Frames against the processor's: at least 50 dB over the pixels that show something.
//!
//! Both splat the same voxels in the same order, with the same footprints and the same exponential; what is left are
//! single precision's roundings, places of perspective views (double precision there, single here), which differ by
//! some 1e-4 pixels, and pixels on the very edge of a footprint. On software drivers they agree to more than 100 dB.

use adjsplat::arena::{Arena, LaneSet, Overlay, OwnedLane};
use adjsplat::build::Built;
use adjsplat::classify::TransferFunction;
use adjsplat::file::arena_bytes;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, QuadFormat};
use adjsplat::splat::{Camera, ClipPlane, Lighting, Mode, Projection, Quality, Scene, Settings, cpu};
use adjsplat::traverse::{Sense, SplitForm, VoxelBox};
use adjsplat_tests::pictures::{decibels, shows};
use adjsplat_tests::scenes::{Draw as _, LIT_LAYERS, built, fitting, real_volumes, transfer, volume};
use adjsplat_tests::walks::parallel_orders;
use adjsplat_tests::{at_full, say};

use crate::compare::{drawn, worst};
use crate::device::device;
use crate::scenes::{EDGES, block, inside, phantom, zoomed};

const LEAST_DB: f64 = 50.0;

/// Ways of making pixels that must give the processor's picture: those that add up in 32 bits.
fn compositors() -> Vec<Compositor> {
    let blends = device().is_some_and(|opened| opened.facts.blends_float32);
    let quads = blends.then_some(Compositor::Quads(QuadFormat::Float32));
    if !blends {
        say("SKIPPED: quads in 32 bits, which this device does not blend");
    }
    std::iter::once(Compositor::Tiles).chain(quads).collect()
}

/// Holds the device's frames to the processor's.
fn check(what: &str, scene: Scene, views: &[(Camera, Settings)]) {
    let Some(opened) = device() else { return };
    for compositor in compositors() {
        let options = GpuOptions::default().with_vram(512 << 20).with_compositor(compositor);
        let mut renderer = GpuRenderer::new(opened.device.clone(), opened.queue.clone(), scene, options).unwrap();
        let mut least = f64::INFINITY;
        for (camera, settings) in views {
            let want = drawn(&scene, camera, settings);
            let (got, _) = renderer.render(camera, settings).unwrap();
            assert!(shows(&want), "{what}: shows nothing");
            let (found, (most, at)) = (decibels(&got, &want, 0.0), worst(&got, &want));
            least = least.min(found);
            assert!(found >= LEAST_DB, "{what}, {compositor:?}: {found:.1} dB, {most} at {at:?}: {settings:?}");
        }
        say(&format!("{what}, {compositor:?}: at least {least:.1} dB in {} views", views.len()));
    }
}

fn check_one(what: &str, built: &Built, camera: Camera, settings: Settings) {
    check(what, built.scene(), &[(camera, settings)]);
}

fn high(size: [u32; 2]) -> Settings {
    Settings::every_pixel(size).with_quality(Quality::High)
}

fn gyroid(dims: [u64; 3], spacing: [f64; 3]) -> Built {
    phantom("gyroid", dims, spacing, transfer(LIT_LAYERS), 8)
}

#[test]
fn all_48_orders() {
    let built = gyroid([20, 24, 22], [1.0, 1.2, 0.9]);
    let size = [64, 64];
    let camera = built.orbit(31.0, 24.0, None, size);
    let settings = parallel_orders().step_by(at_full(1, 5)).map(|order| high(size).with_order(order));
    check("orders", built.scene(), &settings.map(|settings| (camera, settings)).collect::<Vec<_>>());
}

#[test]
fn modes_shading_and_crops() {
    let built = gyroid([44, 48, 40], [1.0; 3]);
    let size = [112, 96];
    let cameras = [built.orbit(31.0, 24.0, None, size), built.orbit(200.0, -35.0, Some(50.0), size)];
    let base = high(size);
    let crop = Some(VoxelBox { low: [8, 0, 13], high: [40, 30, 39] });
    let clip = ClipPlane { point: [22.0, 20.0, 25.0], normal: [1.0, -0.7, 0.4] };
    let glossy = Lighting { ambient: 0.1, diffuse: 0.5, specular: 1.0, shininess: 90, toward_light: [1.0, 1.0, 0.2] };
    let settings = [
        base.clone(),
        base.clone().with_sense(Sense::BackToFront),
        base.clone().with_mode(Mode::Additive),
        base.clone().with_mode(Mode::Additive).with_exposure(None),
        base.clone().with_mode(Mode::Maximum),
        base.clone().with_mode(Mode::MaximumGrey),
        base.clone().with_lighting(None),
        base.clone().with_lighting(glossy),
        base.clone().with_crop(crop),
        base.clone().with_clip(clip),
        base.clone().with_clip(clip).with_crop(crop).with_mode(Mode::Maximum),
        base.clone().with_quality(Quality::Draft).with_termination(0.0),
        base.with_quality(Quality::Reference),
    ];
    let views = cameras.iter().flat_map(|camera| settings.iter().map(|settings| (*camera, settings.clone())));
    // An odd number of settings: each has one of the two cameras.
    let views = views.step_by(at_full(1, 2));
    check("modes", built.scene(), &views.collect::<Vec<_>>());
}

#[test]
fn eyes_outside_inside_and_on_a_voxel() {
    let built = gyroid([40, 44, 36], [1.0, 1.0, 1.3]);
    let size = [96, 80];
    let mut views = vec![(built.orbit(31.0, 24.0, Some(40.0), size), high(size))];
    for (eye, toward) in [
        ([20.3, 21.7, 18.1], [1.0, 0.5, -0.2]),
        ([20.5, 22.0, 18.0], [-0.3, 1.0, 0.6]),
        ([20.0, 22.0, 18.0], [0.2, 0.1, 1.0]),
        ([-3.0, 20.0, 18.5], [1.0, 0.1, 0.0]),
    ] {
        for form in [SplitForm::Split, SplitForm::Interleaved] {
            for sense in [Sense::FrontToBack, Sense::BackToFront] {
                views.push((inside(&built, eye, toward), high(size).with_form(form).with_sense(sense)));
            }
        }
    }
    let views: Vec<_> = views.into_iter().step_by(at_full(1, 3)).collect();
    check("eyes", built.scene(), &views);
}

#[test]
fn eyes_before_a_face() {
    // From 8 voxels on, none is near the eye; from 9 on, the pipeline is compiled without such voxels.
    let built = gyroid([20, 44, 36], [1.0, 1.0, 1.3]);
    let places = [6.5, 7.99, 9.02].into_iter().flat_map(|before| [[-before, 1.0], [19.0 + before, -1.0]]);
    let view = |[x, toward]: [f64; 2]| (inside(&built, [x, 20.0, 18.5], [toward, 0.0, 0.0]), high([96, 80]));
    let views: Vec<_> = places.map(view).collect();
    check("before a face", built.scene(), &views);
}

/// Samples less than a voxel in front of the eye lacked the voxels behind it: 42 dB.
#[test]
fn a_maximum_among_voxels_in_wide_views() {
    let built =
        phantom("noise", [20, 22, 24], [1.0, 0.8, 1.3], transfer(r#"{ "kind": "range", "low": 0, "high": 255 }"#), 8);
    let mut views = Vec::new();
    for eye in [[9.7, 1.03, 15.1], [10.2, 8.4, 17.6], [10.0, 8.0, 13.0], [9.5, -0.4, 15.0], [18.6, 16.5, 29.5]] {
        for fov in [120.0, 150.0, 175.0] {
            let camera = Camera::new(eye, [9.5, 8.4, 15.0], [0.1, 0.2, 1.0], Projection::Perspective { fov }).unwrap();
            views.push((camera, high([96, 80]).with_mode(Mode::MaximumGrey)));
        }
    }
    check("a maximum among voxels", built.scene(), &views);
}

#[test]
fn anisotropic_and_mirrored_grids() {
    let flat = gyroid([48, 44, 8], [1.0, 1.0, 20.0]);
    let size = [96, 96];
    let views = |built: &Built| {
        let camera = |fov| built.orbit(31.0, 24.0, fov, size);
        vec![(camera(None), high(size)), (camera(Some(50.0)), high(size))]
    };
    check("1:1:20", flat.scene(), &views(&flat));
    let mut mirrored = gyroid([40, 36, 32], [1.0, 1.5, 0.8]);
    mirrored.facts.grid.direction = [[-1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.0, 0.8, -0.6]];
    mirrored.facts.grid.origin = [30.0, -200.0, 7.0];
    check("mirrored", mirrored.scene(), &views(&mirrored));
}

#[test]
fn widths_of_channels_and_gradients() {
    let size = at_full([96, 96], [64, 64]);
    for (what, text, bits) in
        [("16 bits", LIT_LAYERS, 16), ("gradient, 8 bits", EDGES, 8), ("gradient, 16 bits", EDGES, 16)]
    {
        let built = phantom("gyroid", [40, 44, 36], [1.0; 3], transfer(text), bits);
        let views = [
            (built.orbit(31.0, 24.0, None, size), high(size)),
            (built.orbit(131.0, -24.0, Some(60.0), size), high(size)),
        ];
        check(what, built.scene(), &views);
    }
}

#[test]
fn another_transfer_function() {
    let Some(opened) = device() else { return };
    let built = phantom("gyroid", [40, 44, 36], [1.0; 3], transfer(EDGES), 8);
    let size = [96, 96];
    let (camera, settings) = (built.orbit(31.0, 24.0, None, size), high(size));
    let sheet = TransferFunction::range(110.0, 140.0).unwrap().with_shaded(false);
    let edges = transfer(&EDGES.replace("#20c040", "#f0c040").replace("0.6", "0.3"));
    let options = GpuOptions::default().with_vram(512 << 20).with_compositor(Compositor::Tiles);
    let mut renderer = GpuRenderer::new(opened.device.clone(), opened.queue.clone(), built.scene(), options).unwrap();
    let (_, first) = renderer.render(&camera, &settings).unwrap();
    assert!(first.upload_bytes > 0);
    for (what, other) in [("sheet", &sheet), ("edges", &edges)] {
        renderer.set_transfer(other);
        let (got, stats) = renderer.render(&camera, &settings).unwrap();
        let (want, _) = cpu::render(&Scene { transfer: other, ..built.scene() }, &camera, &settings).unwrap();
        assert!(decibels(&got, &want, 0.0) >= LEAST_DB, "{what}: {}", decibels(&got, &want, 0.0));
        assert_eq!(stats.upload_bytes, 0, "{what}: the lane stays on the device");
    }
}

#[test]
fn overlays_with_edits_and_with_fewer_voxels_shown() {
    for text in [LIT_LAYERS, EDGES] {
        let built = phantom("gyroid", [28, 32, 24], [1.0; 3], transfer(text), 8);
        let bytes = arena_bytes(&built.facts, &built.lanes, "{}");
        let lanes = LaneSet::new(Arena::new(&bytes).unwrap(), None);
        let mut overlay = Overlay::new(&lanes);
        let size = [72, 72];
        let views = [
            (built.orbit(31.0, 24.0, None, size), high(size)),
            (built.orbit(131.0, 64.0, Some(60.0), size), high(size)),
        ];
        let record = lanes_record(&built);
        for k in 0..400u32 {
            overlay.insert([k % 20 + 5, k * 7 % 32, k * 3 % 24], record).unwrap();
            overlay.remove([k * 5 % 28, k * 11 % 32, k % 24]).unwrap();
        }
        let edited = |overlay: &Overlay| {
            let facts = overlay.facts().unwrap();
            check("overlay", Scene { facts: &facts, lanes: overlay, transfer: &built.transfer }, &views);
        };
        edited(&overlay);
        overlay.set_opacity_threshold(&built.transfer, 0.3).unwrap();
        edited(&overlay);
    }
}

/// Some voxel's record.
fn lanes_record(built: &Built) -> adjsplat::arena::Record {
    built.lanes[0].view().record(100)
}

#[test]
fn near_and_far_views_and_odd_pictures() {
    let built = gyroid([24, 24, 24], [1.0; 3]);
    let size = [128, 96];
    check_one("zoomed in", &built, zoomed(&built, 31.0, 24.0, None, 60.0, size), high(size));
    check_one("zoomed in, perspective", &built, zoomed(&built, 31.0, 24.0, Some(50.0), 40.0, size), high(size));
    check_one("sub-pixel", &built, zoomed(&built, 31.0, 24.0, None, 0.08, size), high(size));
    check_one("sub-pixel, perspective", &built, zoomed(&built, 31.0, 24.0, Some(50.0), 0.08, size), high(size));
    let of_samples = Settings::new([14, 12]).with_quality(Quality::High);
    for fov in [None, Some(50.0)] {
        let camera = zoomed(&built, 31.0, 24.0, fov, 2.0, of_samples.size);
        check_one("cut by the border, supersampled", &built, camera, of_samples.clone());
    }
    // Voxels in the middle have 0.65 pixels, far ones 0.45.
    let settings = Settings::new([44, 40]).with_quality(Quality::High);
    let camera = zoomed(&built, 31.0, 24.0, Some(50.0), 1.0, settings.size);
    check_one("far voxels narrower than a sample", &built, camera, settings);
    for size in [[1, 1], [1, 65], [700, 3]] {
        let views = [None, Some(50.0)].map(|fov| (built.orbit(31.0, 24.0, fov, size), high(size)));
        check(&format!("{size:?}"), built.scene(), &views);
    }
}

/// Where a pixel ends early what it would still take is below the threshold.
#[test]
fn early_termination() {
    let built = block([40, 40, 40], "#ff8040", 0.5);
    let size = [96, 96];
    let camera = built.orbit(31.0, 24.0, None, size);
    let Some(opened) = device() else { return };
    let options = GpuOptions::default().with_vram(512 << 20).with_compositor(Compositor::Tiles);
    let mut renderer = GpuRenderer::new(opened.device.clone(), opened.queue.clone(), built.scene(), options).unwrap();
    for termination in [1.0 / 32.0, 1.0 / 1024.0, 1e-5] {
        let settings = high(size).with_termination(termination);
        let (got, _) = renderer.render(&camera, &settings).unwrap();
        let (want, _) = cpu::render(&built.scene(), &camera, &settings).unwrap();
        let (whole, _) = cpu::render(&built.scene(), &camera, &settings.with_termination(0.0)).unwrap();
        assert!(decibels(&got, &want, 0.0) >= LEAST_DB, "{termination}: {}", decibels(&got, &want, 0.0));
        let (most, at) = worst(&got, &whole);
        // 2e-5: some hundred roundings.
        assert!(most <= termination + 2e-5, "{termination}: {most} at {at:?}");
        assert!(termination < 1e-3 || most > 1e-4, "{termination}: pixels do not end early");
    }
}

#[test]
fn an_empty_scene() {
    let Some(opened) = device() else { return };
    // A structure that has lost all of its voxels: the builder makes none without.
    let mut built = gyroid([16, 16, 16], [1.0; 3]);
    let Built { facts, lanes, .. } = &mut built;
    facts.visible_voxels = 0;
    lanes.iter_mut().for_each(|lane| *lane = OwnedLane::new(lane.axis, lane.dims, lane.channels));
    for compositor in compositors() {
        let options = GpuOptions::default().with_vram(64 << 20).with_compositor(compositor);
        let mut renderer =
            GpuRenderer::new(opened.device.clone(), opened.queue.clone(), built.scene(), options).unwrap();
        for mode in [Mode::Composite, Mode::Additive, Mode::Maximum] {
            for fov in [None, Some(50.0)] {
                let settings = high([40, 30]).with_mode(mode);
                let (frame, stats) = renderer.render(&built.orbit(0.0, 0.0, fov, [40, 30]), &settings).unwrap();
                assert!(!shows(&frame));
                assert_eq!((stats.splats_drawn, stats.splats_skipped), (0, 0));
            }
        }
    }
}

#[test]
fn real_sets() {
    if device().is_none() {
        return;
    }
    for (path, transfer) in real_volumes().into_iter().step_by(at_full(1, 3)) {
        let built = built(&mut *volume(&path), &fitting(transfer, 8));
        let size = [112, 112];
        let views = [(20.0, 15.0, None), (-100.0, 60.0, Some(45.0))]
            .map(|(azimuth, elevation, fov)| (built.orbit(azimuth, elevation, fov, size), high(size)));
        check(&path.file_name().unwrap_or_default().to_string_lossy(), built.scene(), &views);
    }
}
