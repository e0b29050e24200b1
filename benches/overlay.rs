//! Benchmark of the overlay: what an edit, the first use of a lane after it, and the walk over it take.
//!
//! `cargo bench --bench overlay` prints a table: no edits, a brush (a ball of 4,169 voxels), and as many single voxels
//! all over the grid; each with and without an opacity threshold that hides half of the voxels. The twin is the walk
//! over the arena itself. Every walk's count of voxels is asserted. With `--test` the volume is small and each walk
//! runs once.

use std::time::Instant;

use adjsplat::arena::Record;
use adjsplat::arena::{Arena, Lane, LaneSet, Overlay};
use adjsplat::build::{BuildOptions, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::file::arena_bytes;
use adjsplat::traverse::{Batch, Order, walk};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, SampleType};
use adjsplat_tests::runs_once;

/// Edits of the brush, and of the scattered voxels.
const EDITS: usize = 4_169;

fn main() {
    let once = runs_once();
    let side = if once { 48 } else { 256 };
    let phantom = Phantom::from_name("gyroid").expect("it is built in");
    let (low, high) = phantom.visible_range();
    let transfer = TransferFunction::range(low, high).expect("a sound range");
    let options = BuildOptions::new(transfer.clone()).with_lane_count(1).with_normal_bits(8);
    let mut source = phantom.open([side.into(); 3], SampleType::U8, [1.0; 3]).expect("a sound size");
    let built = build(&mut *source, &options, &mut Unobserved).expect("builds");
    let bytes = arena_bytes(&built.facts, &built.lanes, "{}");
    let lanes = LaneSet::new(Arena::new(&bytes).expect("it was just built"), None);
    let upper_half = TransferFunction::range(low / 2.0 + high / 2.0, high).expect("a sound range");

    println!("{} voxels; the arena's own walk: {:.3} ns a voxel", built.facts.visible_voxels, {
        let lane = lanes.lane(Axis::X).expect("stored");
        walk_ns(&lane, built.facts.visible_voxels, once)
    });
    println!("edits | ns an edit | ms to the lane | tiles | patch bytes | walk ns a voxel | with threshold");
    for (name, places) in [("none", Vec::new()), ("brush", brush(side)), ("scattered", scattered(side))] {
        let mut overlay = Overlay::new(&lanes);
        let start = Instant::now();
        for &place in &places {
            overlay.insert(place, Record::default()).expect("inside the grid");
        }
        let insert_ns = start.elapsed().as_secs_f64() * 1e9 / places.len().max(1) as f64;
        let start = Instant::now();
        let lane = overlay.lane(Axis::X).expect("no memory limit");
        let first_ms = start.elapsed().as_secs_f64() * 1e3;
        let (tiles, patch) = lane.patch.map_or((0, 0), |patch| (patch.tiles.len(), patch.view().bytes()));
        let walk = walk_ns(&lane, overlay.facts().expect("counts").visible_voxels, once);
        overlay.set_opacity_threshold(&upper_half, 0.0).expect("a sound threshold");
        let lane = overlay.lane(Axis::X).expect("no memory limit");
        let threshold = walk_ns(&lane, overlay.facts().expect("counts").visible_voxels, once);
        let count = overlay.edit_count();
        println!("{name} {count} | {insert_ns:.0} | {first_ms:.2} | {tiles} | {patch} | {walk:.3} | {threshold:.3}");
    }
}

/// Nanoseconds a voxel that is visited: the best of some walks.
fn walk_ns(lane: &Lane, expected: u64, once: bool) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..if once { 1 } else { 30 } {
        let start = Instant::now();
        let mut voxels = 0;
        walk(lane, &Order::parallel(5, 0), &mut |batch: &Batch| voxels += batch.len() as u64);
        best = best.min(start.elapsed().as_secs_f64());
        assert_eq!(voxels, expected);
    }
    best * 1e9 / expected as f64
}

/// A ball of radius 10 in the middle.
fn brush(side: u32) -> Vec<[u32; 3]> {
    let middle = side / 2;
    let ball = (0..21).flat_map(|z| (0..21).flat_map(move |y| (0..21).map(move |x| [x, y, z])));
    let inside = |p: &[u32; 3]| p.iter().map(|c| c.abs_diff(10).pow(2)).sum::<u32>() <= 100;
    let ball: Vec<[u32; 3]> = ball.filter(inside).map(|p| p.map(|c| middle + c - 10)).collect();
    assert_eq!(ball.len(), EDITS);
    ball
}

/// As many places all over the grid.
fn scattered(side: u32) -> Vec<[u32; 3]> {
    let mut random = adjsplat_tests::random::Random(1);
    (0..EDITS).map(|_| random.place([side; 3])).collect()
}
