//! Benchmark of the walk: visible voxels a second, coordinates and records included, on one thread.
//!
//! `cargo bench --bench traverse` times a few named orders beside the twin, a dense scan of the same volume.
//! `-- --table` prints instead what all 48 orders of parallel views take, in nanoseconds a visible voxel, beside dense
//! scans in the six nests. Other words after `--` keep only the volumes that have one of them in their name. Every
//! walk's visited set is asserted: how many voxels, and sums of their coordinates and records, which no order changes.
//! With `--test` the volumes are small and each walk runs once, of both.

use std::hint::black_box;
use std::time::{Duration, Instant};

use adjsplat::arena::Record;
use adjsplat::arena::{Channels, Lane, OwnedLane, TileOrder};
use adjsplat::internals::LanePacker;
use adjsplat::internals::transpose;
use adjsplat::traverse::{AxisOrder, Batch, Order, Sense, SplitForm, Viewpoint, walk};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, SampleType, Samples, SlabSource};
use adjsplat_tests::runs_once;
use criterion::{BenchmarkId, Criterion, Throughput};

/// One byte a voxel: what a walk reads does not depend on it.
const CHANNELS: Channels =
    Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };

/// A volume, dense and as lanes.
struct Scene {
    name: String,
    dims: [u32; 3],
    /// Whether a sample is visible, x fastest.
    visible: Vec<bool>,
    lanes: [OwnedLane; 3],
    /// What every walk must add up to, by lane.
    sums: [Sums; 3],
}

/// What does not depend on the order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Sums {
    voxels: u64,
    x: u64,
    y: u64,
    z: u64,
    records: u64,
}

impl Scene {
    fn new(name: String, source: &mut dyn SlabSource, (low, high): (f64, f64)) -> Scene {
        let header = source.header().clone();
        let dims = header.grid.dims;
        let row_len = dims[0] as usize;
        let mut slice = Samples::zeros(header.sample_type, usize::try_from(header.grid.slice_len()).expect("fits"));
        let mut packer = LanePacker::new(Axis::X, dims, CHANNELS, TileOrder::Morton);
        let mut visible = Vec::new();
        let narrow = |c: u32| u16::try_from(c).expect("at most 65,535 points an axis");
        for z in 0..dims[2] {
            source.read_slice(&mut slice).expect("the volume can be read");
            let from = visible.len();
            visible.extend((0..slice.len()).map(|i| (low..=high).contains(&slice.get(i))));
            for (y, row) in (0..).zip(visible[from..].chunks_exact(row_len)) {
                let voxels = (0..).zip(row).filter(|(_, v)| **v).map(|(x, _)| (x, Record::default()));
                packer.line(narrow(y), narrow(z), voxels);
            }
        }
        let x_lane = packer.finish();
        let [y_lane, z_lane] = [Axis::Y, Axis::Z].map(|axis| transpose(&x_lane.view(), axis, TileOrder::Morton));
        let lanes = [x_lane, y_lane, z_lane];
        let mut sums = [Sums::default(); 3];
        for (index, _) in (0u64..).zip(&visible).filter(|(_, v)| **v) {
            let [nx, ny, _] = dims.map(u64::from);
            sums[0].voxels += 1;
            sums[0].x += index % nx;
            sums[0].y += index / nx % ny;
            sums[0].z += index / (nx * ny);
        }
        for (axis, lane) in lanes.iter().enumerate() {
            let records = (0u64..).zip(&lane.steps).filter(|(_, step)| **step != 0).map(|(record, _)| record).sum();
            sums[axis] = Sums { records, ..sums[0] };
        }
        Scene { name, dims, visible, lanes, sums }
    }

    fn phantom(phantom: &Phantom, edge: u64) -> Scene {
        let mut source = phantom.open([edge; 3], SampleType::U8, [1.0; 3]).expect("a sound phantom");
        Scene::new(format!("{} {edge}^3", phantom.name()), &mut *source, phantom.visible_range())
    }

    /// The segmented frog, where there is the folder of real volumes.
    fn frog() -> Option<Scene> {
        let path = adjsplat_tests::real_volume("frogtissue/frogtissue.mhd")?;
        let mut source = adjsplat_tests::scenes::volume(&path);
        Some(Scene::new("frog".into(), &mut *source, (1.0, 255.0)))
    }

    fn lane(&self, order: &Order) -> Lane<'_> {
        self.lanes[order.fast.index()].view()
    }

    /// Seconds of one walk that leaves its batches where they are.
    fn time_walk(&self, order: &Order) -> f64 {
        let lane = self.lane(order);
        let start = Instant::now();
        let mut voxels = 0;
        walk(&lane, order, &mut |batch: &Batch| {
            voxels += black_box(batch).len() as u64;
        });
        let elapsed = start.elapsed().as_secs_f64();
        assert_eq!(voxels, self.sums[0].voxels);
        elapsed
    }

    /// Seconds of one walk whose coordinates and records are added up; the sums are asserted.
    fn time_sums(&self, order: &Order) -> f64 {
        let lane = self.lane(order);
        let start = Instant::now();
        let mut sums = Sums::default();
        let mut along = [0u64; 3];
        walk(&lane, order, &mut |batch: &Batch| {
            let count = batch.len() as u64;
            sums.voxels += count;
            along[order.slow.index()] += u64::from(batch.slow) * count;
            along[order.medium.index()] += batch.medium.iter().map(|&c| u64::from(c)).sum::<u64>();
            along[order.fast.index()] += batch.fast.iter().map(|&c| u64::from(c)).sum::<u64>();
            sums.records += batch.base * count + batch.record.iter().map(|&r| u64::from(r)).sum::<u64>();
        });
        [sums.x, sums.y, sums.z] = along;
        let elapsed = start.elapsed().as_secs_f64();
        assert_eq!(sums, self.sums[order.fast.index()], "{}: {order:?}", self.name);
        elapsed
    }

    /// Seconds of a dense scan in the nest of `order`, which must be one of parallel views.
    fn time_dense(&self, order: &Order) -> f64 {
        let stride = [1, self.dims[0] as usize, self.dims[0] as usize * self.dims[1] as usize];
        // First index, distance to the next, count, along each loop's axis.
        let [slow, medium, fast] = [order.slow, order.medium, order.fast].map(|axis| {
            let count = self.dims[axis.index()] as usize;
            let step = stride[axis.index()].cast_signed();
            match order.along[axis.index()] {
                AxisOrder::Ascending => (0, step, count),
                _ => (step * (count.cast_signed() - 1), -step, count),
            }
        });
        let along =
            |(first, step, count): (isize, isize, usize)| (0..count.cast_signed()).map(move |i| first + i * step);
        let start = Instant::now();
        let mut voxels = 0u64;
        for s in along(slow) {
            for m in along(medium) {
                for f in along(fast) {
                    let index = s + m + f;
                    if self.visible[index.cast_unsigned()] {
                        voxels += 1;
                        black_box(index);
                    }
                }
            }
        }
        let elapsed = start.elapsed().as_secs_f64();
        assert_eq!(voxels, self.sums[0].voxels);
        elapsed
    }

    fn ns_per_voxel(&self, seconds: f64) -> f64 {
        seconds * 1e9 / self.sums[0].voxels as f64
    }
}

/// Shortest of `runs` times.
fn shortest(runs: usize, mut time: impl FnMut() -> f64) -> f64 {
    (0..runs).map(|_| time()).fold(f64::INFINITY, f64::min)
}

/// "median worst" of some numbers.
fn median_and_worst(mut numbers: Vec<f64>) -> String {
    numbers.sort_by(f64::total_cmp);
    format!("{:7.2} {:7.2}", numbers[numbers.len() / 2], numbers[numbers.len() - 1])
}

fn parallel_orders() -> impl Iterator<Item = Order> {
    (0..6).flat_map(|nesting| (0..8).map(move |descending| Order::parallel(nesting, descending)))
}

/// Prints a scene's line of the table.
fn tabulate(scene: &Scene, is_test: bool) {
    // The shortest of nine: what else runs on the machine only adds.
    let runs = if is_test { 1 } else { 9 };
    let all = |time: &dyn Fn(&Order) -> f64| {
        parallel_orders().map(|order| scene.ns_per_voxel(shortest(runs, || time(&order)))).collect()
    };
    let walks = median_and_worst(all(&|order| scene.time_walk(order)));
    let sums = median_and_worst(all(&|order| scene.time_sums(order)));
    let dense = (0..6).map(|nesting| scene.ns_per_voxel(scene.time_dense(&Order::parallel(nesting, 0)))).collect();
    let lane = scene.lanes[0].view();
    let a_line = scene.sums[0].voxels as f64 / lane.line_ends.len().max(1) as f64;
    println!(
        "{:<16} {:>9} {a_line:>7.1}  {walks}  {sums}  {}",
        scene.name,
        scene.sums[0].voxels,
        median_and_worst(dense)
    );
}

/// Times a few orders with criterion.
fn bench(criterion: &mut Criterion, scene: &Scene) {
    let eye = scene.dims.map(|d| f64::from(d) * 0.45);
    let viewpoint = Viewpoint::Perspective { eye, toward: [1.0, 2.0, 3.0] };
    let inside = Order::new(viewpoint, scene.dims, Sense::BackToFront, SplitForm::Interleaved).expect("sound");
    let mut group = criterion.benchmark_group(format!("walk {}", scene.name));
    group.throughput(Throughput::Elements(scene.sums[0].voxels));
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(2));
    for (name, order) in [
        ("z y x, ascending", Order::parallel(5, 0)),
        ("z y x, descending", Order::parallel(5, 7)),
        ("x y z, ascending", Order::parallel(0, 0)),
        ("y z x, x descending", Order::parallel(3, 1)),
        ("z y x, eye inside", inside),
    ] {
        scene.time_sums(&order);
        group.bench_function(BenchmarkId::from_parameter(name), |b| b.iter(|| scene.time_walk(&order)));
    }
    let order = Order::parallel(5, 0);
    group.bench_function("plain twin: dense scan, z y x", |b| b.iter(|| scene.time_dense(&order)));
    group.finish();
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_test = runs_once();
    let is_wanted = |name: &str| {
        let words: Vec<&String> = arguments.iter().filter(|a| !a.starts_with('-')).collect();
        words.is_empty() || words.iter().any(|word| name.contains(word.as_str()))
    };
    let full = |edge: u64| if is_test { 48 } else { edge };
    let phantoms = [
        (Phantom::Gyroid, 512),
        (Phantom::Shells, 512),
        (Phantom::Vessels, 512),
        (Phantom::Noise { visible: 0.01 }, 256),
    ];
    let scenes = phantoms.iter().filter(|(phantom, _)| is_wanted(phantom.name())).map(|(phantom, edge)| {
        // One at a time: a scene of 512^3 takes 150 MB.
        Some(Scene::phantom(phantom, full(*edge)))
    });
    let frog = std::iter::once_with(|| if is_wanted("frog") && !is_test { Scene::frog() } else { None });
    // Criterion would refuse --table.
    let only_table = arguments.iter().any(|a| a == "--table");
    let mut criterion = if only_table { Criterion::default() } else { Criterion::default().configure_from_args() };
    if only_table {
        println!("ns a visible voxel, median and worst of the 48 orders (dense: of six nests)");
        println!("                    voxels  a line   walk            and add up       dense scan");
    }
    for scene in scenes.chain(frog).flatten() {
        if only_table || is_test {
            tabulate(&scene, is_test);
        }
        if !only_table {
            bench(&mut criterion, &scene);
        }
    }
    criterion.final_summary();
}
