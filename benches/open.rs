//! Benchmark of opening and checking: files a second and records a second, on one thread, files with three lanes.
//!
//! `cargo bench --bench open`. Two groups a phantom. *Open*: the header and section table of bytes in memory, of a file
//! that is mapped, and the plain twin, which reads the whole file first; the first two must not depend on the file's
//! size. *Check*: all rules, their checksums alone (the least that reading all bytes costs), and as the twin a plain
//! reading of all lanes, voxel by voxel. Facts, counts and sums are those that the file was made of. With `--test` the
//! volumes are small.

use std::path::Path;
use std::time::Duration;

use adjsplat::arena::Record;
use adjsplat::arena::layout::{Facts, Scales};
use adjsplat::arena::{Arena, Channels, TileOrder};
use adjsplat::file::{AdjFile, arena_bytes};
use adjsplat::internals::LanePacker;
use adjsplat::internals::transpose;
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, SampleType, Samples};
use adjsplat_tests::runs_once;
use criterion::{Criterion, Throughput};
use xxhash_rust::xxh3::xxh3_64;

/// Four bytes a record: what a shaded scene has.
const CHANNELS: Channels =
    Channels { value_bits: 8, normal_bits: 8, magnitude_bits: 0, coverage_bits: 0, coherence: false };

/// A file, and what is in it.
struct Content {
    bytes: Vec<u8>,
    facts: Facts,
    /// Sum of all voxels' coordinates and codes.
    sum: u64,
}

/// The file of a phantom, with codes that differ from voxel to voxel.
fn file_of(phantom: &Phantom, edge: u64) -> Content {
    let mut source = phantom.open([edge; 3], SampleType::U8, [1.0; 3]).expect("a sound phantom");
    let grid = source.header().grid.clone();
    let (low, high) = phantom.visible_range();
    let mut slice = Samples::zeros(SampleType::U8, usize::try_from(grid.slice_len()).expect("fits"));
    let mut packer = LanePacker::new(Axis::X, grid.dims, CHANNELS, TileOrder::Morton);
    let edge = u16::try_from(edge).expect("at most 65,535");
    let mut sum = 0u64;
    for z in 0..edge {
        source.read_slice(&mut slice).expect("a phantom has all its slices");
        for y in 0..edge {
            let row = usize::from(y) * usize::from(edge);
            let visible = (0..edge).filter(|&x| (low..=high).contains(&slice.get(row + usize::from(x))));
            let records = visible
                .map(|x| (x, Record { value: x % 251, normal: u32::from(x ^ y ^ z), magnitude: 0, coverage: 0 }));
            packer.line(
                y,
                z,
                records.inspect(|(x, record)| {
                    let coordinates = u64::from(*x) + u64::from(y) + u64::from(z);
                    sum += coordinates + u64::from(record.value) + u64::from(record.normal);
                }),
            );
        }
    }
    let x_lane = packer.finish();
    let visible_voxels = x_lane.view().record_count() - x_lane.view().stepping_voxels();
    let [y_lane, z_lane] = [Axis::Y, Axis::Z].map(|axis| transpose(&x_lane.view(), axis, TileOrder::Morton));
    let scales = Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 0.0 };
    let facts = Facts { grid, channels: CHANNELS, tile_order: TileOrder::Morton, scales, visible_voxels };
    let bytes = arena_bytes(&facts, &[x_lane, y_lane, z_lane], "{}");
    Content { bytes, facts, sum }
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

/// A file read whole, then opened.
fn open_plainly(path: &Path) -> u64 {
    let bytes = std::fs::read(path).expect("it was just written");
    Arena::new(&bytes).expect("the library's own file").facts().visible_voxels
}

fn bench(criterion: &mut Criterion, phantom: &Phantom, edge: u64) {
    let Content { bytes, facts, sum } = file_of(phantom, edge);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("phantom.adj");
    std::fs::write(&path, &bytes).expect("room for the file");
    let arena = Arena::new(&bytes).expect("the library's own file");
    assert_eq!(*arena.facts(), facts);
    assert_eq!(*AdjFile::open(&path).expect("opens").arena().expect("opened before").facts(), facts);
    let checked = arena.check().expect("a sound file");
    assert_eq!((checked.lanes.len(), checked.visible_voxels), (3, facts.visible_voxels));
    let records: u64 = checked.lanes.iter().map(|lane| lane.records).sum();
    assert_eq!(records, arena.lanes().map(|lane| lane.record_count()).sum::<u64>());

    let name = format!("{} {edge}^3", phantom.name());
    let (warm_up, measurement) = (Duration::from_millis(500), Duration::from_secs(2));
    let mut group = criterion.benchmark_group(format!("open {name}"));
    group.throughput(Throughput::Elements(1)).warm_up_time(warm_up).measurement_time(measurement);
    group.bench_function("bytes", |bencher| {
        bencher.iter(|| {
            let opened = Arena::new(&bytes).expect("the library's own file");
            assert_eq!(opened.facts().visible_voxels, facts.visible_voxels);
        });
    });
    group.bench_function("mapped file", |bencher| {
        bencher.iter(|| {
            let file = AdjFile::open(&path).expect("opens");
            assert_eq!(file.arena().expect("opened before").facts().visible_voxels, facts.visible_voxels);
        });
    });
    group.sample_size(10);
    group.bench_function("plain twin", |bencher| {
        bencher.iter(|| assert_eq!(open_plainly(&path), facts.visible_voxels));
    });
    group.finish();

    let mut group = criterion.benchmark_group(format!("check {name}"));
    group.throughput(Throughput::ElementsAndBytes { elements: records, bytes: bytes.len() as u64 });
    group.sample_size(10).warm_up_time(warm_up).measurement_time(measurement);
    group.bench_function("all rules", |bencher| {
        bencher.iter(|| assert_eq!(arena.check().as_ref(), Ok(&checked)));
    });
    group.bench_function("checksums", |bencher| {
        bencher.iter(|| {
            assert!(arena.sections().iter().all(|section| xxh3_64(arena.section_bytes(section)) == section.xxh3.get()));
        });
    });
    // Every lane holds every voxel.
    group.bench_function("plain twin", |bencher| bencher.iter(|| assert_eq!(read_plainly(&arena), 3 * sum)));
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let is_test = runs_once();
    let full = |edge: u64| if is_test { 32 } else { edge };
    for (phantom, edge) in [(Phantom::Gyroid, 512), (Phantom::Vessels, 512), (Phantom::Noise { visible: 0.01 }, 256)] {
        bench(&mut criterion, &phantom, full(edge));
    }
    criterion.final_summary();
}
