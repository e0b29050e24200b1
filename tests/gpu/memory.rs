//! Video memory: below its ceiling, whatever the structure; and no bit of a picture depends on it.

use adjsplat::Error;
use adjsplat::arena::Record;
use adjsplat::arena::TileOrder;
use adjsplat::arena::layout::Facts;
use adjsplat::build::Built;
use adjsplat::splat::gpu::GpuStats;
use adjsplat::splat::gpu::adapter::OpenedDevice;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, QuadFormat};
use adjsplat::splat::{Camera, Frame, Lanes as _, Orbit, Quality, Scene, Settings, Surround, cpu};
use adjsplat::traverse::{Order, SplitForm};
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::pictures::{decibels, shows};
use adjsplat_tests::scenes::{CODES, Draw as _, LIT_LAYERS, PLAIN, lane, transfer};
use adjsplat_tests::{at_full, say};

use crate::compare::worst;
use crate::device::{device, own_device};
use crate::scenes::{inside, phantom, zoomed};

/// Leaves about 1 MiB for a lane, beside chunks of 65,536 records and half of a small picture.
const TIGHT: u64 = 8 << 20;
const PLENTY: u64 = 512 << 20;

fn renderer<'a>(opened: &OpenedDevice, built: &'a Built, vram: u64) -> GpuRenderer<'a> {
    let options = GpuOptions::default().with_vram(vram).with_compositor(Compositor::Tiles);
    GpuRenderer::new(opened.device.clone(), opened.queue.clone(), built.scene(), options).unwrap()
}

/// Bytes that the device has given out, where it says so.
fn allocated(opened: &OpenedDevice) -> u64 {
    opened.device.generate_allocator_report().map_or(0, |report| report.total_allocated_bytes)
}

/// Draws, and holds the memory in use after each chunk to `vram`.
fn drawn(
    opened: &OpenedDevice,
    renderer: &mut GpuRenderer,
    camera: &Camera,
    settings: &Settings,
    vram: u64,
) -> (Frame, GpuStats, u64) {
    let mut most = 0;
    let mut look = |_: &adjsplat::internals::gpu_stages::Probe| most = most.max(allocated(opened));
    let (frame, stats) = renderer.render_probed(camera, settings, Some(&mut look)).unwrap();
    assert!(stats.vram_bytes <= vram, "{} bytes of {vram}: {stats:?}", stats.vram_bytes);
    assert!(most <= vram, "the device gave out {most} bytes of {vram}");
    (frame, stats, most)
}

/// Slabs of dust have long directories, solid ones long channels: buffers that served both would be too large.
#[test]
fn dust_beside_a_solid_stays_within() {
    let Some(opened) = own_device() else { return };
    let grid = Grid::new([192, 192, 1_600], [1.0; 3]).unwrap();
    let tile_order = TileOrder::Morton;
    let lanes = vec![lane(Axis::X, grid.dims, PLAIN, tile_order, |[x, _, z]| {
        (x == 0 || z >= 1_560).then_some(Record { value: 200, normal: 0, magnitude: 0, coverage: 0 })
    })];
    let visible_voxels = lanes[0].view().record_count();
    let facts = Facts { grid, channels: PLAIN, tile_order, scales: CODES, visible_voxels };
    let transfer = transfer(r#"{ "kind": "range", "low": 1, "opacity": 0.01 }"#);
    let scene = Scene { facts: &facts, lanes: &lanes, transfer: &transfer };
    let size = [40, 56];
    let around = Surround::of_grid(&facts.grid);
    let camera = Camera::orbiting(Orbit { azimuth: 20.0, elevation: 40.0, ..Orbit::default() }, around, size).unwrap();
    // Slow z, medium y, fast x.
    let order = Some(Order::parallel(5, 0));
    // The lane that fits is listed on all threads, the one that does not on one.
    let settings = Settings::every_pixel(size).with_quality(Quality::Draft).with_order(order).with_threads(4);
    let options = |vram| GpuOptions::default().with_vram(vram).with_compositor(Compositor::Quads(QuadFormat::Float16));
    let draw = |vram| {
        let mut renderer = GpuRenderer::new(opened.device.clone(), opened.queue.clone(), scene, options(vram)).unwrap();
        drawn(&opened, &mut renderer, &camera, &settings, vram)
    };
    let (whole, one, _) = draw(PLENTY);
    let (frame, many, most) = draw(TIGHT);
    say(&format!("dust: {} slabs, {} bytes of {TIGHT}, {most} by the device", many.slabs, many.vram_bytes));
    assert!(one.slabs == 1 && many.slabs > 3, "{} and {} slabs", one.slabs, many.slabs);
    assert!(shows(&whole) && frame == whole);
}

/// Rows do not divide evenly among three threads; a smaller picture would have fewer.
#[test]
fn pixels_do_not_depend_on_threads() {
    let Some(opened) = own_device() else { return };
    let built = phantom("gyroid", [24; 3], [1.0; 3], transfer(LIT_LAYERS), 8);
    let settings = Settings::every_pixel([301, 333]);
    let camera = built.orbit(31.0, 24.0, None, settings.size);
    for compositor in [Compositor::Tiles, Compositor::Quads(QuadFormat::Float16)] {
        let mut renderer = renderer(&opened, &built, PLENTY);
        renderer.set_compositor(Some(compositor)).unwrap();
        let [one, three] =
            [1, 3].map(|threads| renderer.render(&camera, &settings.clone().with_threads(threads)).unwrap().0);
        assert!(shows(&one) && one == three, "{compositor:?}");
    }
}

/// 4 bytes a record: 4 MB of them, of which there is room for 1.
#[test]
fn a_structure_that_is_too_large_gives_the_same_picture() {
    let Some(opened) = own_device() else { return };
    let text = r#"{ "kind": "range", "low": 1, "opacity": 0.05 }"#;
    let built = phantom("constant", [110, 100, 100], [1.0; 3], transfer(text), 8);
    let lane_bytes = built.lanes[0].view().bytes();
    let size = at_full([64, 56], [32, 28]);
    let settings = Settings::every_pixel(size).with_quality(Quality::Draft);
    let views = [
        ("parallel", built.orbit(31.0, 24.0, None, size), SplitForm::default()),
        ("inside, in turn", inside(&built, [50.3, 44.5, 61.0], [1.0, 0.4, 0.2]), SplitForm::Interleaved),
        ("inside, split", inside(&built, [50.3, 44.5, 61.0], [0.1, 0.3, -1.0]), SplitForm::Split),
    ];
    // One after the other: the two would share a device's memory.
    let whole: Vec<Frame> = {
        let mut renderer = renderer(&opened, &built, PLENTY);
        let frame = |(what, camera, form): &(&str, Camera, SplitForm)| {
            let settings = settings.clone().with_form(*form);
            let (frame, stats, _) = drawn(&opened, &mut renderer, camera, &settings, PLENTY);
            assert_eq!((stats.slabs, stats.windows), (1, 1), "{what}");
            assert!(shows(&frame));
            frame
        };
        views.iter().map(frame).collect()
    };
    let before = allocated(&opened);
    let mut renderer = renderer(&opened, &built, TIGHT);
    for ((what, camera, form), whole) in views.iter().zip(&whole) {
        let settings = settings.clone().with_form(*form);
        let (frame, stats, most) = drawn(&opened, &mut renderer, camera, &settings, TIGHT + before);
        say(&format!(
            "{what}: {} slabs, {} windows, {} chunks, {} bytes of {TIGHT} by its own count, {} by the device's",
            stats.slabs,
            stats.windows,
            stats.chunks,
            stats.vram_bytes,
            most - before.min(most)
        ));
        assert!(stats.vram_bytes <= TIGHT);
        assert_eq!(stats.windows, 1, "{what}");
        assert!(stats.slabs >= 3 && stats.chunks as usize > stats.slabs * stats.windows, "{what}: {stats:?}");
        let largest_slab = lane_bytes / 3;
        assert!(stats.upload_bytes > 0 && largest_slab < TIGHT);
        assert!(frame == *whole, "{what}: {:?} apart, {:.1} dB", worst(&frame, whole), decibels(&frame, whole, 0.0));
    }
}

/// A picture whose pixels do not fit either is drawn in windows. Boxes of splats end at a window's border, and places
/// counted from there are rounded anew: by units in the last place.
#[test]
fn windows_give_the_same_picture() {
    let Some(opened) = own_device() else { return };
    let built = phantom("gyroid", [40, 44, 36], [1.0; 3], transfer(LIT_LAYERS), 8);
    let size = [300, 280];
    let settings = Settings::every_pixel(size).with_quality(Quality::High);
    for fov in [None, Some(50.0)] {
        let camera = built.orbit(31.0, 24.0, fov, size);
        let (whole, one, _) = drawn(&opened, &mut renderer(&opened, &built, PLENTY), &camera, &settings, PLENTY);
        let (frame, many, _) = drawn(&opened, &mut renderer(&opened, &built, TIGHT), &camera, &settings, PLENTY);
        assert!(many.vram_bytes <= TIGHT, "{many:?}");
        assert!(one.windows == 1 && many.windows > 1, "{} and {}", one.windows, many.windows);
        let (most, at) = worst(&frame, &whole);
        assert!(frame == whole, "{fov:?}: {most:e} apart at {at:?}, {:.1} dB", decibels(&frame, &whole, 0.0));
    }
}

#[test]
fn pictures_of_other_sizes_one_after_the_other_stay_within() {
    let Some(opened) = own_device() else { return };
    let built = phantom("gyroid", [40, 40, 40], [1.0; 3], transfer(LIT_LAYERS), 8);
    let vram = 12 << 20;
    let mut renderer = renderer(&opened, &built, vram);
    for (index, size) in [[32, 32], [300, 260], [200, 180], [16, 300], [100, 100]].into_iter().enumerate() {
        let settings = Settings::every_pixel(size).with_quality(Quality::Draft);
        let views = [(10.0, 5.0), (80.0, 5.0), (10.0, 80.0)].into_iter().skip(at_full(0, index % 3));
        for (azimuth, elevation) in views.step_by(at_full(1, 3)) {
            let camera = built.orbit(azimuth, elevation, None, size);
            let (_, stats, _) = drawn(&opened, &mut renderer, &camera, &settings, vram);
            assert!(stats.vram_bytes <= vram);
        }
    }
}

#[test]
fn a_lane_is_uploaded_once_as_it_is() {
    let Some(opened) = device() else { return };
    for bits in [8, 16] {
        let built = phantom("gyroid", [24, 28, 20], [1.0; 3], transfer(LIT_LAYERS), bits);
        let mut renderer = renderer(opened, &built, PLENTY);
        let size = [40, 40];
        let settings = Settings::every_pixel(size);
        for (azimuth, elevation, axis) in [(10.0, 5.0, Axis::Z), (10.0, 5.0, Axis::Z)] {
            let camera = built.orbit(azimuth, elevation, None, size);
            let (_, first) = renderer.render(&camera, &settings).unwrap();
            let (_, second) = renderer.render(&camera, &settings).unwrap();
            let lane = built.lanes.lane(axis).unwrap();
            assert!([0, lane.bytes()].contains(&first.upload_bytes), "{first:?}");
            assert_eq!(second.upload_bytes, 0);
        }
        let mut fresh = self::renderer(opened, &built, PLENTY);
        for (nesting, axis) in [(0, Axis::Z), (1, Axis::Y), (3, Axis::X)] {
            let settings = settings.clone().with_order(Order::parallel(nesting, 0));
            let camera = built.orbit(10.0, 5.0, None, size);
            let bytes = built.lanes.lane(axis).unwrap().bytes();
            assert_eq!(fresh.render(&camera, &settings).unwrap().1.upload_bytes, bytes, "{bits} bits, {axis:?}");
            assert_eq!(fresh.render(&camera, &settings).unwrap().1.upload_bytes, 0, "{bits} bits, {axis:?}");
        }
    }
}

#[test]
fn lanes_stay_on_the_device_while_the_transfer_function_changes() {
    let Some(opened) = device() else { return };
    let built = phantom("gyroid", [24, 28, 20], [1.0; 3], transfer(LIT_LAYERS), 8);
    let size = [40, 40];
    let (camera, settings) = (built.orbit(10.0, 5.0, None, size), Settings::every_pixel(size));
    let mut resident = renderer(opened, &built, PLENTY).into_resident();
    for (index, opacity) in ["0.6", "0.2", "0.6"].into_iter().enumerate() {
        let transfer = transfer(&LIT_LAYERS.replace("0.6", opacity));
        let scene = Scene { transfer: &transfer, ..built.scene() };
        let mut renderer = resident.renderer(scene);
        let (frame, stats) = renderer.render(&camera, &settings).unwrap();
        assert_eq!(stats.upload_bytes > 0, index == 0, "{opacity}: {stats:?}");
        resident = renderer.into_resident();
        let options = GpuOptions::default().with_vram(PLENTY).with_compositor(Compositor::Tiles);
        let mut fresh = GpuRenderer::new(opened.device.clone(), opened.queue.clone(), scene, options).unwrap();
        assert!(fresh.render(&camera, &settings).unwrap().0.pixels() == frame.pixels(), "{opacity}");
    }
}

#[test]
fn a_line_list_lasts_as_long_as_its_order() {
    let Some(opened) = device() else { return };
    let built = phantom("gyroid", [24, 28, 20], [1.0; 3], transfer(LIT_LAYERS), 8);
    let mut renderer = renderer(opened, &built, PLENTY);
    let size = [40, 40];
    let settings = Settings::every_pixel(size);
    let mut lists = |settings: &Settings, azimuth| {
        let (_, stats) = renderer.render(&built.orbit(azimuth, 10.0, None, size), settings).unwrap();
        (stats.line_lists, stats.list_bytes > 0)
    };
    assert_eq!(lists(&settings, 30.0), (1, true));
    assert_eq!(lists(&settings, 33.0), (0, false), "the same order");
    assert_eq!(lists(&settings, 36.0), (0, false), "the same order");
    let ordered = |down| settings.clone().with_order(Order::parallel(0, down));
    assert_eq!(lists(&ordered(0), 20.0).0, 1);
    assert_eq!(lists(&ordered(0b100), 20.0), (0, false), "the fast axis the other way");
    assert_eq!(lists(&ordered(0b010), 20.0), (1, true), "the medium axis the other way");
    assert_eq!(lists(&ordered(0b011), 20.0), (1, true), "the slow axis the other way");
}

#[test]
fn too_little_video_memory_is_a_clear_error() {
    let Some(opened) = device() else { return };
    let built = phantom("gyroid", [24, 28, 20], [1.0; 3], transfer(LIT_LAYERS), 8);
    let size = [40, 40];
    for vram in [0, 1, 1 << 20, 4 << 20] {
        match renderer(opened, &built, vram).render(&built.orbit(0.0, 0.0, None, size), &Settings::every_pixel(size)) {
            Err(Error::Limit { what, need, have }) => {
                assert!(what.contains("video memory") && need > have && have == vram, "{what}: {need}, {have}");
            }
            other => panic!("{vram} bytes: {other:?}"),
        }
    }
}

/// The largest number of columns, which no device need have for a texture.
#[test]
fn a_picture_of_16384_columns() {
    let Some(opened) = device() else { return };
    let built = phantom("gyroid", [256, 8, 8], [1.0; 3], transfer(LIT_LAYERS), 8);
    let size = [16_384, 64];
    let settings = Settings::every_pixel(size).with_quality(Quality::Draft);
    let camera = zoomed(&built, 4.0, 3.0, None, 250.0, size);
    let (want, _) = cpu::render(&built.scene(), &camera, &settings).unwrap();
    for vram in [24 << 20, PLENTY] {
        let (got, stats) = renderer(opened, &built, vram).render(&camera, &settings).unwrap();
        assert!(stats.vram_bytes <= vram);
        let found = decibels(&got, &want, 0.0);
        say(&format!("16,384 columns in {} windows: {found:.1} dB", stats.windows));
        let filled = |column| (0..64).any(|row| want.pixel(column, row)[3] > 0.0);
        assert!((0..1_000).any(filled) && (15_384..16_384).any(filled), "it reaches from end to end");
        assert!(found >= 50.0, "{found:.1} dB, {:?}", worst(&got, &want));
    }
}
