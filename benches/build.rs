//! Benchmark of the builder: samples a second, from slices in the cache.
//!
//! `cargo bench --bench build`. One group a phantom and sample type: a plain copy of the slices (the least that reading
//! costs), keeping what is visible with its gradients on one thread and on two, whole builds of lane x and of all three
//! on one thread, and the obvious twin: every sample looked up, every gradient of what is visible taken. The twin says
//! which voxels are visible and what their normals are; every build must say the same. With `--test` the volumes are
//! small.

use std::time::Duration;

use adjsplat::arena::OwnedLane;
use adjsplat::build::{BuildOptions, Classified, Resources, Unobserved, classify};
use adjsplat::classify::{Neighbourhood, TransferFunction, normal};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{SampleType, SlabSource, Volume};
use adjsplat_tests::runs_once;
use criterion::{Criterion, Throughput};

/// Visible voxels and the sum of their normals' codes, one sample after the other.
fn plainly(volume: &Volume, transfer: &TransferFunction) -> (u64, u64) {
    let [width, height, depth] = volume.grid().dims.map(|d| d as usize);
    let (slope, intercept) = (volume.slices().header().slope, volume.slices().header().intercept);
    #[allow(clippy::cast_possible_truncation, reason = "gradients are taken of single-precision fields")]
    let field: Vec<f32> =
        (0..volume.samples().len()).map(|i| (volume.samples().get(i) * slope + intercept) as f32).collect();
    let slice = |z: usize| &field[z * width * height..][..width * height];
    let (mut count, mut sum) = (0, 0);
    for z in 0..depth {
        let (below, above) = (z.checked_sub(1).map(slice), (z + 1 < depth).then(|| slice(z + 1)));
        let hood = Neighbourhood::new(below, slice(z), above, [width, height], volume.grid().spacing);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let sample = volume.samples().get((z * height + y) * width + x);
            if transfer.opacity(sample * slope + intercept, 0.0) > 0.0 {
                count += 1;
                let outward: [f64; 3] = [(x, width), (y, height), (z, depth)].map(|(at, points)| match at {
                    0 => -1.0,
                    at if at + 1 == points => 1.0,
                    _ => 0.0,
                });
                // A cut by a face looks out of it, which is down the gradient.
                let slopes = if outward == [0.0; 3] { hood.slopes(x, y) } else { outward.map(|c| -c) };
                sum += u64::from(normal::encode8(slopes));
            }
        }
    }
    (count, sum)
}

/// What a build found, to be held against what [`plainly`] gives.
fn found(lane: &OwnedLane) -> (u64, u64) {
    let lane = lane.view();
    let visible = lane.lines().map(|line| lane.line_voxels(line.records).count() as u64).sum();
    (visible, (0..lane.steps.len()).map(|record| u64::from(lane.normal_code(record))).sum())
}

fn bench(criterion: &mut Criterion, phantom: &Phantom, sample_type: SampleType, edge: u64) {
    let volume =
        Volume::read(&mut *phantom.open([edge; 3], sample_type, [1.0; 3]).expect("a sound phantom")).expect("fits");
    let (low, high) = phantom.visible_range();
    let options = BuildOptions::new(TransferFunction::range(low, high).expect("a sound range")).with_normal_bits(8);
    let want = plainly(&volume, &options.transfer);
    let keep = |volume: &Volume, threads: usize| -> Classified {
        let resources = Resources { threads, ..Resources::default() };
        classify(&mut volume.slices(), &options, &resources, &mut Unobserved).expect("builds")
    };
    let build = |volume: &Volume, lane_count: u8| -> Vec<OwnedLane> {
        keep(volume, 1).lanes(lane_count, 1, &mut Unobserved).expect("builds")
    };
    for lane in build(&volume, 3) {
        assert_eq!(found(&lane), want, "{} {}, lane {}", phantom.name(), sample_type.name(), lane.axis.name());
    }

    let mut group = criterion.benchmark_group(format!("build {} {edge}^3 {}", phantom.name(), sample_type.name()));
    group.throughput(Throughput::Elements(volume.grid().points()));
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    let mut slice = volume.slices().header().new_slice().expect("memory for a slice");
    group.bench_function("copy", |bencher| {
        bencher.iter(|| {
            let mut slices = volume.slices();
            (0..edge).for_each(|_| slices.read_slice(&mut slice).expect("in memory"));
            std::hint::black_box(slice.bytes());
        });
    });
    for (name, threads) in [("keep visible, 1 thread", 1), ("keep visible, 2 threads", 2)] {
        group.bench_function(name, |bencher| {
            bencher.iter(|| assert_eq!(keep(&volume, threads).facts.visible_voxels, want.0));
        });
    }
    for (name, lane_count) in [("lane x", 1), ("three lanes", 3)] {
        group.bench_function(name, |bencher| bencher.iter(|| build(&volume, lane_count)));
    }
    group.bench_function("plain twin", |bencher| {
        bencher.iter(|| assert_eq!(plainly(&volume, &options.transfer), want));
    });
    group.finish();
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let is_test = runs_once();
    let edge = if is_test { 32 } else { 256 };
    for (phantom, sample_type) in [
        (Phantom::Gyroid, SampleType::U8),
        (Phantom::Gyroid, SampleType::U16),
        (Phantom::Gyroid, SampleType::F32),
        (Phantom::Shells, SampleType::U8),
        (Phantom::Vessels, SampleType::U8),
        (Phantom::Noise { visible: 0.01 }, SampleType::U8),
    ] {
        bench(&mut criterion, &phantom, sample_type, edge);
    }
    criterion.final_summary();
}
