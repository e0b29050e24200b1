//! Benchmark of the check: nanoseconds a record, on one thread, in files with three lanes in memory.
//!
//! `cargo bench --bench check` prints a table: the whole check, its checksums alone, and a plain reading of all lanes
//! as the twin. The counts that the check gives are asserted. With `--test` the volumes are small.

use std::time::Instant;

use adjsplat::arena::layout::{Facts, Scales};
use adjsplat::arena::pack::{LanePacker, Record};
use adjsplat::arena::transpose::transpose;
use adjsplat::arena::{Arena, Channels, TileOrder};
use adjsplat::file::arena_bytes;
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, SampleType, Samples};
use xxhash_rust::xxh3::xxh3_64;

/// Four bytes a record: what a shaded scene has.
const CHANNELS: Channels = Channels { value_bits: 8, normal_bits: 8, magnitude_bits: 0 };

/// The file of a phantom, with codes that differ from voxel to voxel.
fn file_of(phantom: &Phantom, edge: u64) -> Vec<u8> {
    let mut source = phantom.open([edge; 3], SampleType::U8, [1.0; 3]).expect("a sound phantom");
    let grid = source.header().grid.clone();
    let (low, high) = phantom.visible_range();
    let mut slice = Samples::zeros(SampleType::U8, usize::try_from(grid.slice_len()).expect("fits"));
    let mut packer = LanePacker::new(Axis::X, grid.dims, CHANNELS, TileOrder::Morton);
    let edge = u16::try_from(edge).expect("at most 65,535");
    for z in 0..edge {
        source.read_slice(&mut slice).expect("a phantom has all its slices");
        for y in 0..edge {
            let row = usize::from(y) * usize::from(edge);
            let visible = (0..edge).filter(|&x| (low..=high).contains(&slice.get(row + usize::from(x))));
            packer.line(
                y,
                z,
                visible.map(|x| (x, Record { value: x % 251, normal: u32::from(x ^ y ^ z), magnitude: 0 })),
            );
        }
    }
    let visible_voxels = packer.visible();
    let x_lane = packer.finish();
    let [y_lane, z_lane] = [Axis::Y, Axis::Z].map(|axis| transpose(&x_lane.view(), axis, TileOrder::Morton));
    let scales = Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 0.0 };
    let facts = Facts { grid, channels: CHANNELS, tile_order: TileOrder::Morton, scales, visible_voxels };
    arena_bytes(&facts, &[x_lane, y_lane, z_lane], "{}")
}

/// Sums of coordinates and codes of all lanes, record by record.
fn read_plainly(arena: &Arena) -> u64 {
    let mut sum = 0u64;
    for lane in arena.lanes() {
        for line in lane.lines() {
            for (coordinate, record) in lane.line_voxels(line.records) {
                let codes = u64::from(lane.value_code(record)) + u64::from(lane.normal_code(record));
                sum = sum.wrapping_add(u64::from(coordinate) + u64::from(line.u) + u64::from(line.v) + codes);
            }
        }
    }
    sum
}

/// The shortest of some runs, in seconds.
fn time<T>(runs: usize, mut run: impl FnMut() -> T) -> f64 {
    let once = |_| {
        let start = Instant::now();
        std::hint::black_box(run());
        start.elapsed().as_secs_f64()
    };
    (0..runs).map(once).fold(f64::INFINITY, f64::min)
}

fn main() {
    // As criterion decides it: cargo passes --bench when it measures.
    let is_test = !std::env::args().any(|a| a == "--bench") || std::env::args().any(|a| a == "--test");
    let (runs, full) = if is_test { (1, [32; 3]) } else { (7, [512, 512, 256]) };
    println!("ns a record          records      check   checksums   plain reading   check, GB/s");
    let phantoms = [Phantom::Gyroid, Phantom::Vessels, Phantom::Noise { visible: 0.01 }];
    for (phantom, edge) in phantoms.iter().zip(full) {
        let file = file_of(phantom, edge);
        let arena = Arena::new(&file).expect("the library's own file");
        let checked = arena.check().expect("a sound file");
        let records: u64 = checked.lanes.iter().map(|lane| lane.records).sum();
        assert_eq!(checked.lanes.len(), 3);
        assert_eq!(records, arena.lanes().map(|lane| lane.record_count()).sum::<u64>());
        let per_record = |seconds: f64| seconds * 1e9 / records as f64;
        let check = time(runs, || arena.check());
        let sums =
            time(runs, || arena.sections().iter().map(|s| xxh3_64(arena.section_bytes(s))).fold(0, |a, b| a ^ b));
        let plain = time(runs, || read_plainly(&arena));
        println!(
            "{:<16} {records:>11} {:>10.2} {:>11.2} {:>15.2} {:>13.1}",
            format!("{} {edge}^3", phantom.name()),
            per_record(check),
            per_record(sums),
            per_record(plain),
            file.len() as f64 / 1e9 / check
        );
    }
}
