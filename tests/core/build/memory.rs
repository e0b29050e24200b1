//! Memory and threads have no say in what is built.

use adjsplat::arena::{Levels, TileOrder};
use adjsplat::build::{BuildOptions, Resources, Unobserved, build, classify};
use adjsplat::classify::TransferFunction;
use adjsplat::file::{RowsOutput, arena_bytes, write_rows};
use adjsplat::internals::Budget;
use adjsplat::volume::{SampleType, SlabSource as _};
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
