//! Benchmark of the builder: millions of samples a second, from slices in the cache.
//!
//! `cargo bench --bench build` prints a table for 8- and 16-bit phantoms: a plain copy of the slices, keeping what is
//! visible with its gradients on one thread and on two, assembling lane x and all three from that, and the obvious
//! twin: every sample looked up, every gradient taken. All find the same voxels, which is asserted. With `--test` the
//! volumes are small.

use std::time::Instant;

use adjsplat::Result;
use adjsplat::arena::TileOrder;
use adjsplat::arena::builder::{BuildOptions, Classified, Resources, Unobserved, classify};
use adjsplat::classify::{Neighbourhood, TransferFunction, normal};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Header, SampleType, Samples, SlabSource};

/// A volume in memory; small enough for the last cache, it costs a copy to read.
struct InMemory {
    header: Header,
    samples: Samples,
    read: usize,
}

impl InMemory {
    fn new(phantom: &Phantom, dims: [u64; 3], sample_type: SampleType) -> InMemory {
        let mut source = phantom.open(dims, sample_type, [1.0; 3]).expect("a sound phantom");
        let header = source.header().clone();
        let mut samples = Samples::zeros(sample_type, usize::try_from(header.grid.len()).expect("fits"));
        let mut slice = header.new_slice().expect("memory for a slice");
        let bytes = slice.bytes().len();
        for part in samples.bytes_mut().chunks_exact_mut(bytes) {
            source.read_slice(&mut slice).expect("a phantom has all its slices");
            part.copy_from_slice(slice.bytes());
        }
        InMemory { header, samples, read: 0 }
    }
}

impl SlabSource for InMemory {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        let len = slice.bytes().len();
        slice.bytes_mut().copy_from_slice(&self.samples.bytes()[self.read * len..][..len]);
        self.read += 1;
        Ok(())
    }

    fn rewind(&mut self) -> Result<()> {
        self.read = 0;
        Ok(())
    }
}

/// Visible voxels and the sum of their normals' codes, one sample after the other.
fn plainly(volume: &InMemory, transfer: &TransferFunction) -> (u64, u64) {
    let [width, height, depth] = volume.header.grid.dims.map(|d| d as usize);
    let (slope, intercept) = (volume.header.slope, volume.header.intercept);
    #[allow(clippy::cast_possible_truncation, reason = "gradients are taken of single-precision fields")]
    let field: Vec<f32> =
        (0..volume.samples.len()).map(|i| (volume.samples.get(i) * slope + intercept) as f32).collect();
    let slice = |z: usize| &field[z * width * height..][..width * height];
    let (mut count, mut sum) = (0, 0);
    for z in 0..depth {
        let (below, above) = (z.checked_sub(1).map(slice), (z + 1 < depth).then(|| slice(z + 1)));
        let hood = Neighbourhood::new(below, slice(z), above, [width, height], volume.header.grid.spacing);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let sample = volume.samples.get((z * height + y) * width + x);
            if transfer.opacity(sample * slope + intercept, 0.0) > 0.0 {
                count += 1;
                sum += u64::from(normal::encode8(hood.gradient(x, y)));
            }
        }
    }
    (count, sum)
}

/// The shortest of some runs, in seconds, and what the last one gave.
fn time<T>(runs: usize, mut run: impl FnMut() -> T) -> (f64, T) {
    let mut once = || {
        let start = Instant::now();
        let result = std::hint::black_box(run());
        (start.elapsed().as_secs_f64(), result)
    };
    (1..runs).fold(once(), |best, _| {
        let next = once();
        (best.0.min(next.0), next.1)
    })
}

fn main() {
    // As criterion decides it: cargo passes --bench when it measures.
    let is_test = !std::env::args().any(|a| a == "--bench") || std::env::args().any(|a| a == "--test");
    let (runs, edge) = if is_test { (1, 32) } else { (5, 256) };
    println!(
        "million samples a second   visible      read   keep, 1 thread   2 threads   + lane x   + xyz   plain twin"
    );
    let phantoms = [Phantom::Gyroid, Phantom::Shells, Phantom::Vessels, Phantom::Noise { visible: 0.01 }];
    for (phantom, sample_type) in
        phantoms.iter().flat_map(|p| [SampleType::U8, SampleType::U16, SampleType::F32].map(|ty| (p, ty)))
    {
        let mut volume = InMemory::new(phantom, [edge; 3], sample_type);
        let (low, high) = phantom.visible_range();
        let transfer = TransferFunction::range(low, high).expect("a sound range");
        let options = BuildOptions {
            transfer: transfer.clone(),
            lane_count: 3,
            tile_order: TileOrder::Morton,
            value_bits: 8,
            normal_bits: 8,
        };
        let mut keep = |threads: usize| -> Classified {
            volume.rewind().expect("in memory");
            let resources = Resources { threads, ..Resources::default() };
            classify(&mut volume, &options, &resources, &mut Unobserved).expect("builds")
        };
        let (one, classified) = time(runs, || keep(1));
        let (two, _) = time(runs, || keep(2));
        let (x, lanes) = time(runs, || classified.lanes(1, 1, &mut Unobserved).expect("builds"));
        let (xyz, _) = time(runs, || classified.lanes(3, 1, &mut Unobserved).expect("builds"));
        let mut slice = volume.header.new_slice().expect("memory for a slice");
        let (read, _) = time(runs, || {
            volume.rewind().expect("in memory");
            (0..edge).for_each(|_| volume.read_slice(&mut slice).expect("in memory"));
        });
        let (plain, (count, normals)) = time(if is_test { 1 } else { 2 }, || plainly(&volume, &transfer));
        assert_eq!(classified.facts.visible_voxels, count);
        let lane = lanes[0].view();
        assert_eq!((0..lane.steps.len()).map(|record| u64::from(lane.normal_code(record))).sum::<u64>(), normals);
        let rate = |seconds: f64| volume.header.grid.len() as f64 / 1e6 / seconds;
        println!(
            "{:<26} {:>6.2} % {:>9.0} {:>16.0} {:>11.0} {:>10.0} {:>7.0} {:>12.0}",
            format!("{} {edge}^3 {}", phantom.name(), sample_type.name()),
            100.0 * count as f64 / volume.header.grid.len() as f64,
            rate(read),
            rate(one),
            rate(two),
            rate(one + x),
            rate(one + xyz),
            rate(plain)
        );
    }
}
