//! Memory and threads have no say in what is built.

use std::ops::ControlFlow;

use adjsplat::arena::{Levels, TileOrder};
use adjsplat::build::{BuildOptions, Observer, Phase, Resources, Unobserved, build, classify};
use adjsplat::classify::TransferFunction;
use adjsplat::file::{RowsOutput, arena_bytes, write_rows};
use adjsplat::internals::{Budget, description};
use adjsplat::volume::{SampleType, SlabSource as _};
use adjsplat::{Build, Error};
use adjsplat_tests::scenes::options;

use super::classification::blob;
use super::dense::{SampleVolume, random_at};

/// The least memory that a build of `volume` takes.
fn least(volume: &SampleVolume, options: &BuildOptions, resources: &Resources) -> u64 {
    let enough = |memory| {
        let resources = Resources { memory: Some(memory), ..resources.clone() };
        Budget::new(volume.header(), options, &resources, 0).is_ok()
    };
    assert!(!enough(1 << 20), "a megabyte is too little for anything");
    let (mut below, mut at) = (1u64 << 20, 1u64 << 40);
    while below + 1 < at {
        let middle = u64::midpoint(below, at);
        if enough(middle) { at = middle } else { below = middle }
    }
    at
}

#[test]
fn any_budget_and_any_number_of_threads_give_the_bytes_of_a_build_in_memory() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let dims = [75, 61, 53];
    let lone = |p: [u32; 3]| if random_at(p) > 0.97 { 90.0 } else { 0.0 };
    let smooth = SampleVolume::new(dims, SampleType::U16, [1.0, 0.5, 2.0], blob);
    let labels = SampleVolume::new(dims, SampleType::U8, [1.0; 3], |p| (blob(p) / 16.0).floor());
    let sparse = SampleVolume::new([9, 700, 13], SampleType::F32, [1.0; 3], lone);
    let range = TransferFunction::range(60.0, f64::INFINITY).expect("sound");
    let surface = TransferFunction::contour(60.0).expect("sound");
    let palette = TransferFunction::preset("labels").expect("a preset");
    for (volume, transfer, tile_order) in [
        (&smooth, range.clone(), TileOrder::Morton),
        (&smooth, surface, TileOrder::Hilbert),
        (&labels, palette, TileOrder::Rows),
        (&sparse, range, TileOrder::Morton),
    ] {
        let options = options(transfer).with_tile_order(tile_order).with_normal_bits(16);
        let built = build(&mut volume.clone(), &options, &mut Unobserved).expect("builds");
        let expected = arena_bytes(&built.facts, &built.lanes, "{}");
        for threads in [1, 2, 5] {
            let free = Resources { memory: None, threads, folder: Some(folder.path().into()) };
            let tight = Resources { memory: Some(least(volume, &options, &free)), ..free.clone() };
            for resources in [&free, &tight] {
                let visible = classify(&mut volume.clone(), &options, resources, &mut Unobserved).expect("builds");
                assert_eq!(visible.samples, built.samples);
                assert_eq!(visible.transfer, built.transfer);
                // With no memory at all every tile is a run of its own, and is dealt out line by line.
                for memory in [None, resources.memory, Some(0)] {
                    let output = RowsOutput {
                        facts: visible.facts.clone(),
                        description: "{}",
                        lane_count: options.lane_count,
                        memory,
                        threads,
                        levels: Levels::default(),
                    };
                    let path = folder.path().join("built.adj");
                    let (facts, bytes) = write_rows(&path, &visible.rows, &output, &mut Unobserved).expect("writes");
                    assert_eq!(facts.visible_voxels, built.facts.visible_voxels);
                    let written = std::fs::read(&path).expect("it was written");
                    assert_eq!(written.len() as u64, bytes);
                    assert!(written == expected, "{threads} threads, {memory:?}");
                }
            }
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("it is there").count(), 1, "nothing else stays");
}

#[test]
fn levels_are_the_same_for_any_budget_and_any_number_of_threads_and_in_memory() {
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let path = folder.path().join("built.adj");
    let smooth = SampleVolume::new([75, 61, 53], SampleType::U16, [1.0, 0.9, 1.2], blob);
    let labels = SampleVolume::new([75, 61, 53], SampleType::U8, [1.0; 3], |p| (blob(p) / 16.0).floor());
    let range = TransferFunction::range(60.0, f64::INFINITY).expect("sound");
    let palette = TransferFunction::preset("labels").expect("a preset");
    for (volume, transfer, lanes) in [(&smooth, range, 3), (&labels, palette, 1)] {
        let options = options(transfer).with_levels(3).with_lane_count(lanes);
        let build = Build::new(options.clone());
        let model = build.run(volume.clone()).expect("builds");
        let expected = model.arena().expect("opens").bytes();
        assert_eq!(model.arena().expect("opens").level_count(), 3);
        model.arena().expect("opens").check().expect("sound");
        for threads in [1, 2, 5] {
            let free = Resources { memory: None, threads, folder: Some(folder.path().into()) };
            for memory in [None, Some(least(volume, &options, &free)), Some(0)] {
                let resources = Resources { memory: memory.filter(|&bytes| bytes > 0), ..free.clone() };
                let visible = classify(&mut volume.clone(), &options, &resources, &mut Unobserved).expect("builds");
                let description = description(volume.header(), &visible).expect("short");
                let output = RowsOutput {
                    facts: visible.facts.clone(),
                    description: &description,
                    lane_count: lanes,
                    memory,
                    threads,
                    levels: Levels::Count(3),
                };
                write_rows(&path, &visible.rows, &output, &mut Unobserved).expect("writes");
                assert!(std::fs::read(&path).expect("it was written") == expected, "{threads} threads, {memory:?}");
            }
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("it is there").count(), 1, "nothing else stays");
}

#[test]
fn a_build_that_is_cancelled_while_levels_are_made_leaves_nothing() {
    struct Cancels(u8);
    impl Observer for Cancels {
        fn progress(&mut self, phase: Phase, _: u64, _: u64) -> ControlFlow<()> {
            if phase == Phase::Level(self.0) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        }
    }
    let folder = tempfile::tempdir().expect("there is a temporary folder");
    let volume = SampleVolume::new([75, 61, 53], SampleType::U16, [1.0; 3], blob);
    let build = Build::new(options(TransferFunction::range(60.0, f64::INFINITY).expect("sound"))).with_levels(3);
    for level in 1..=3 {
        let built = build.write_observed(volume.clone(), folder.path().join("a.adj"), &mut Cancels(level));
        assert!(matches!(built, Err(Error::Interrupted)), "level {level}");
        assert_eq!(std::fs::read_dir(folder.path()).expect("it is there").count(), 0, "nothing stays");
    }
}

#[test]
fn more_levels_than_there_are_numbers_for_are_refused() {
    let volume = SampleVolume::new([9, 9, 9], SampleType::U16, [1.0; 3], |_| 90.0);
    let build = Build::new(options(TransferFunction::range(60.0, f64::INFINITY).expect("sound"))).with_levels(16);
    let told = build.run(volume).map(drop).expect_err("too many").to_string();
    assert!(told.contains("levels") && told.contains("0 to 15"), "{told}");
}
