//! Lanes that only the device holds: they arrive part after part, and draw the pictures of a lane in memory.

use std::ops::Range;
use std::sync::Arc;

use adjsplat::arena::{Arena, CodeCounts, Directory};
use adjsplat::limits::Limits;
use adjsplat::splat::gpu::adapter::OpenedDevice;
use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, Resident};
use adjsplat::splat::{Lanes as _, Mode, Orbit, Settings};
use adjsplat::volume::Axis;
use adjsplat::{Build, Error, Model, Volume};
use adjsplat_tests::scenes::transfer;

use crate::device::device;
use crate::scenes::EDGES;

/// An .adj file with three lanes, normals and magnitudes.
fn file() -> Vec<u8> {
    let at = |i: u32| [i % 40, i / 40 % 34, i / 1360].map(|c| c as f32 - 17.0);
    let value = |i: u32| 220.0 - 9.0 * at(i).iter().map(|c| c * c).sum::<f32>().sqrt() + (i * 7 % 13) as f32;
    let volume = Volume::new([40, 34, 36], (0..40 * 34 * 36).map(value).collect::<Vec<_>>()).unwrap();
    let model = Build::new(transfer(EDGES)).run(&volume).unwrap();
    model.arena().unwrap().bytes().to_vec()
}

fn directory(file: &[u8]) -> Directory {
    let head = &file[..file.len().min(Directory::HEAD as usize)];
    let mut directory = Directory::new(head, file.len() as u64, &Limits::default(), "a.adj").unwrap();
    let bytes = |range: &Range<u64>| file[range.start as usize..range.end as usize].to_vec();
    let heads: Vec<_> = directory.level_heads().iter().map(bytes).collect();
    directory.add_levels(&heads, &Limits::default(), "a.adj").unwrap();
    while let [range, ..] = &directory.wanted(1 << 20)[..] {
        directory.append(&bytes(range)).unwrap();
    }
    directory
}

fn opened(device: &OpenedDevice) -> Resident {
    let options = GpuOptions::default().with_compositor(Compositor::Tiles);
    pollster::block_on(Resident::new(device.device.clone(), device.queue.clone(), options)).unwrap()
}

/// Hands the lane along `axis` to the device; `wanted` parts of it at most. Returns the codes of what was handed over.
fn hand_over(file: &[u8], model: &Model, resident: &mut Resident, axis: Axis, wanted: usize) -> CodeCounts {
    let (directory, mut codes) = (directory(file), CodeCounts::default());
    for part in directory.parts(axis, 3_000..=10_000).iter().take(wanted) {
        let channels = part.ranges.each_ref().map(|range| &file[range.start as usize..range.end as usize]);
        let lane = model.lane(axis).unwrap();
        assert!(!resident.has_lane(0, axis));
        pollster::block_on(resident.receive(0, &lane, part.first, channels)).unwrap();
        codes.add(lane.channels, channels);
    }
    codes
}

#[test]
fn pictures_are_those_of_lanes_in_memory() {
    let Some(device) = device() else { return };
    let file = file();
    let whole = Model::from_bytes(file.clone()).unwrap();
    let directory = Arc::new(directory(&file));
    let model = |codes| Model::from_directory(directory.clone(), vec![codes], "a.adj").unwrap();
    let (mut there, mut resident) = (opened(device), opened(device));
    let mut codes = CodeCounts::default();
    for axis in Axis::ALL {
        codes = hand_over(&file, &model(codes.clone()), &mut resident, axis, usize::MAX);
        assert!(resident.has_lane(0, axis));
    }
    let model = model(codes);
    for (azimuth, elevation) in [(0.0, 0.0), (80.0, 10.0), (20.0, 80.0), (10.0, 60.0)] {
        for mode in [Mode::Composite, Mode::Maximum, Mode::Additive] {
            let orbit = Orbit { azimuth, elevation, ..Orbit::default() };
            let settings = Settings::every_pixel([70, 60]).with_mode(mode);
            let camera = whole.camera(&orbit, &settings).unwrap();
            let mut judge = there.renderer(whole.scene());
            let want = judge.render(&camera, &settings).unwrap().0;
            let mut renderer: GpuRenderer = resident.renderer(model.scene());
            let (got, stats) = renderer.render(&camera, &settings).unwrap();
            assert_eq!(stats.upload_bytes, 0);
            assert!(want.pixels().iter().any(|sample| *sample > 0.1));
            // The mean optical depth, which is x-ray's exposure, is a sum in another order.
            let most = want.pixels().iter().zip(got.pixels()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(most <= if mode == Mode::Additive { 1e-5 } else { 0.0 }, "{azimuth} {mode:?}: {most}");
            (there, resident) = (judge.into_resident(), renderer.into_resident());
        }
    }
}

#[test]
fn what_has_not_arrived_is_not_drawn() {
    let Some(device) = device() else { return };
    let file = file();
    let directory = Arc::new(directory(&file));
    let model = Model::from_directory(directory, Vec::new(), "a.adj").unwrap();
    let settings = Settings::every_pixel([70, 60]);
    let camera = model.camera(&Orbit { azimuth: 80.0, ..Orbit::default() }, &settings).unwrap();
    let order = Model::from_bytes(file.clone()).unwrap();
    let (_, all) = opened(device).renderer(order.scene()).render(&camera, &settings).unwrap();
    // Looking along x, lines run along z.
    let mut before = 0;
    for parts in [0, 2, 4, usize::MAX] {
        let mut resident = opened(device);
        hand_over(&file, &model, &mut resident, Axis::Z, parts);
        let (_, stats) = resident.renderer(model.scene()).render(&camera, &settings).unwrap();
        assert!(stats.splats_drawn > before || parts == 0 && stats.splats_drawn == 0, "{parts}: {stats:?}");
        before = stats.splats_drawn;
    }
    assert_eq!(before, all.splats_drawn);
}

#[test]
fn tiles_come_back_as_they_were() {
    let Some(device) = device() else { return };
    let file = file();
    let whole = Arena::new(&file).unwrap();
    let model = Model::from_directory(Arc::new(directory(&file)), Vec::new(), "a.adj").unwrap();
    let mut resident = opened(device);
    for axis in Axis::ALL {
        hand_over(&file, &model, &mut resident, axis, usize::MAX);
        let (lane, want) = (model.lane(axis).unwrap(), whole.lane(axis).unwrap());
        let [u, _] = axis.others().map(Axis::index);
        for (low, high) in [(0, 50), (9, 20), (60, 70)] {
            let wants = |bounds: &adjsplat::traverse::VoxelBox| bounds.low[u] <= high && bounds.high[u] >= low;
            let back = pollster::block_on(resident.tiles_back(&lane, wants)).unwrap();
            let view = back.view();
            let of = |lane: adjsplat::arena::Lane<'_>| {
                let tiles = lane.tiles.iter().filter(|tile| {
                    let first = tile.tile_u.get() * 8;
                    first <= high && first + 7 >= low
                });
                let lines = tiles.flat_map(|tile| lane.tile_lines(tile, u64::MAX));
                lines
                    .map(|line| {
                        let voxels = lane.line_voxels(line.records.clone());
                        (line.u, line.v, voxels.map(|(t, record)| (t, lane.record(record))).collect::<Vec<_>>())
                    })
                    .collect::<Vec<_>>()
            };
            assert!(of(view) == of(want), "{axis:?} {low}..{high}");
            assert_eq!(view.tiles.is_empty(), low == 60);
        }
    }
}

#[test]
fn records_of_another_lane_are_refused() {
    let Some(device) = device() else { return };
    let file = file();
    let model = Model::from_directory(Arc::new(directory(&file)), Vec::new(), "a.adj").unwrap();
    let lane = model.lane(Axis::X).unwrap();
    let mut resident = opened(device);
    let mut refused = |lane, first, channels| {
        let fault = pollster::block_on(resident.receive(0, lane, first, channels)).unwrap_err();
        assert!(matches!(&fault, Error::Input { what, .. } if what == "records"), "{fault}");
    };
    let zeros = [0; 64];
    let [steps, values, normals, magnitudes, coverages] = lane.channels.widths().map(|width| &zeros[..4 * width]);
    refused(&lane, 2, [steps, values, normals, magnitudes, coverages]);
    refused(&lane, lane.record_count() / 4 * 4, [steps, values, normals, magnitudes, coverages]);
    refused(&lane, u64::MAX - 3, [steps, values, normals, magnitudes, coverages]);
    refused(&lane, 0, [steps, values, normals, &[], coverages]);
    refused(&lane, 0, [&steps[..3], &values[..3], &normals[..6], &magnitudes[..3], coverages]);
    let whole = Model::from_bytes(file.clone()).unwrap();
    refused(&whole.lane(Axis::X).unwrap(), 0, [steps, values, normals, magnitudes, coverages]);
}

/// The device drew with the line list of the scene before, or with its tables.
#[test]
fn a_forgotten_scene_leaves_nothing_to_the_next() {
    let Some(device) = device() else { return };
    let settings = Settings::every_pixel([70, 60]);
    let samples = |count: u32, step: u32| (0..count).map(|i| (i * step % 251) as f32).collect::<Vec<_>>();
    let function = || transfer(EDGES);
    let small = Build::new(function()).run(&Volume::new([12, 9, 10], samples(1_080, 7)).unwrap()).unwrap();
    let large = Model::from_bytes(file()).unwrap();
    for (first, next) in [(&large, &small), (&small, &large)] {
        for by_lane in [false, true] {
            let draw = |resident: Resident, model: &Model| {
                let camera = model.camera(&Orbit { azimuth: 30.0, ..Orbit::default() }, &settings).unwrap();
                let mut renderer = resident.renderer(model.scene());
                let frame = renderer.render(&camera, &settings).unwrap().0;
                (renderer.into_resident(), frame)
            };
            let (mut resident, _) = draw(opened(device), first);
            if by_lane {
                Axis::ALL.into_iter().for_each(|axis| resident.forget_lane(0, axis));
            } else {
                resident.forget_scene();
            }
            let (_, got) = draw(resident, next);
            let (_, want) = draw(opened(device), next);
            assert!(got == want, "{by_lane}");
        }
    }
}
