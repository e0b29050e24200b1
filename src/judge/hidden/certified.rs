//! Finds certified hidden voxels: a bound on all lines of sight from outside proves that they are hidden.
//!
//! ```text
//! for each kernel, each axis, each of its two directions: march over the layers across the axis, from the front
//!     cost(c)  least optical depth that a line gains in the layer if it crosses it in cell c
//!              = max(S1 * min over 3 x 3 of tau, S2 * min over 5 x 5 of tau)                       weight.rs
//!     F(c)     = min of D over the 9 cells in which the line may have crossed the layer before
//!     D(c)     = F(c) + cost(c)
//!     hidden from this side: exp(-F) <= eps in all cells where a line that meets the voxel's footprint may cross
//! hidden: from all sides
//! ```
//!
//! A line moves by at most one cell on either other axis from layer to layer, if the march follows the line's steepest
//! axis. So its cells are one of the paths that F minimises over, and F bounds the optical depth in front. The
//! renderer's walk (its order of voxels) composites layers in the march's order if its outermost axis is the line's
//! steepest one. That holds in every parallel view, and in perspective for the rays whose steepest axis is the view's.
//! A voxel's own layer does not count. Nothing outside the volume hides a voxel: lines may come from anywhere.
//!
//! The proof covers the kernels of the draft, standard and high qualities, also cut off earlier as those of faint voxels are, for views
//! from outside as [`super`] defines them.

use super::box_minimum::box_minimum;
use super::carry::carry;
use super::weight::layer_weights;
use super::{Culling, CullingObserver, CullingStage, report_step};
use adjsplat::arena::Lane;
use adjsplat::error::{Error, Result};
use adjsplat::internals::MAX_DEPTH;
use adjsplat::internals::RecordSet;
use adjsplat::internals::scatter::Table;
use adjsplat::splat::WorldFrame;
use adjsplat::splat::{KernelShape, Quality, Scene, Settings};
use adjsplat::traverse::{AxisOrder, Batch, Order, walk};
use adjsplat::volume::Axis;

/// The fraction of a kernel's weight that is left after the losses by single precision, and by the footprints of a perspective if they
/// were affine.
const MARGIN: f64 = 0.98;
/// The largest optical depth that the march tells apart; larger ones are treated as equal.
const ENOUGH: f32 = 64.0;

/// Adds the voxels that are not proven hidden to `seen`, a set of records (stored voxels) of the lane along x.
///
/// # Errors
/// [`Error::Limit`] if the memory does not suffice; [`Error::Input`] if the grid's axes are not at right angles;
/// [`Error::Interrupted`] if the observer cancels.
pub(super) fn possibly_visible(
    scene: &Scene,
    seen: &RecordSet,
    culling: &Culling,
    observer: CullingObserver,
) -> Result<()> {
    let frame = WorldFrame::of(&scene.facts.grid);
    let [x, y, z] = frame.steps.map(|step| step.normalize());
    if [x.dot(y), y.dot(z), z.dot(x)].iter().any(|cosine| cosine.abs() > 1e-3) {
        let why = "need a grid whose axes are at right angles; find hidden voxels by sampling instead";
        return Err(Error::input("certified hidden voxels", why));
    }
    let x_lane = scene.lanes.lane(Axis::X)?;
    let Some((low, high)) = x_lane.bounds() else { return Ok(()) };
    let mean = scene.facts.grid.mean_spacing();
    let lengths = scene.facts.grid.spacing.map(|step| step / mean);
    let need = -(culling.eps.ln());
    let table = Table::new(scene, &x_lane, &Settings::every_pixel([1, 1]), mean)?;
    let deepest = table.deepest() * lengths.into_iter().fold(0.0, f64::max);
    let mut kernels = Vec::new();
    for kernel in [Quality::Draft, Quality::Standard, Quality::High].map(Quality::kernel) {
        for kernel in [kernel, kernel.of_depth(deepest)] {
            if !kernels.contains(&kernel) {
                kernels.push(kernel);
            }
        }
    }
    let mut done = 0;
    let mut known: Vec<([f64; 3], KernelShape, [f64; 2])> = Vec::new();
    for slow in Axis::ALL {
        let fast = if slow == Axis::X { Axis::Y } else { Axis::X };
        let lane = scene.lanes.lane(fast)?;
        let open = RecordSet::new(lane.steps.len())?;
        for &kernel in &kernels {
            // Axes often have equal distances between voxels, and then equal weights.
            let [u, v] = slow.others();
            let spacings = [slow, u, v].map(|axis| lengths[axis.index()]);
            let found = known.iter().find(|(other, shape, _)| *other == spacings && *shape == kernel);
            let weights = found.map_or_else(|| layer_weights(kernel, slow, lengths), |(.., weights)| *weights);
            known.push((spacings, kernel, weights));
            let strongest = peak(kernel) * lengths.iter().copied().fold(0.0, f64::max);
            for along in [AxisOrder::Ascending, AxisOrder::Descending] {
                let march = March { lane, table: &table, slow, low, high, weights, kernel, need };
                march.run(along, MAX_DEPTH / strongest, &open, culling.memory)?;
                done += 1;
                report_step(observer, CullingStage::Look, done, 6 * kernels.len() as u64)?;
            }
        }
        carry(&lane, &|record| open.contains(record), &x_lane, seen)?;
    }
    Ok(())
}

/// Returns the largest weight of a kernel for a line that runs one voxel's length inside a voxel.
fn peak(kernel: KernelShape) -> f64 {
    f64::from(kernel.normalisation()) / f64::from(kernel.sigma).powi(2)
}

struct March<'a> {
    lane: Lane<'a>,
    table: &'a Table<'a>,
    slow: Axis,
    low: [u16; 3],
    high: [u16; 3],
    weights: [f64; 2],
    kernel: KernelShape,
    need: f64,
}

impl March<'_> {
    /// Adds to `open` the records (stored voxels) that are not hidden from the side where the march starts. `most` is
    /// the largest optical depth of a path as long as the mean spacing that the renderer does not clamp in any view.
    #[expect(clippy::cast_possible_truncation, reason = "single precision suffices within the margin")]
    fn run(&self, along: AxisOrder, most: f64, open: &RecordSet, memory: u64) -> Result<()> {
        let medium = Axis::ALL.into_iter().find(|&axis| axis != self.slow && axis != self.lane.axis);
        let medium = medium.expect("there are three axes");
        let mut order = Order { slow: self.slow, medium, fast: self.lane.axis, along: [AxisOrder::Ascending; 3] };
        order.along[self.slow.index()] = along;
        let side = |axis: Axis| usize::from(self.high[axis.index()] - self.low[axis.index()]) + 1;
        let (width, height) = (side(order.fast), side(medium));
        let need = (PLANES * width * height * size_of::<f32>()) as u64;
        if need > memory {
            let what = "memory for the layers of certified hidden voxels in bytes (or find them by sampling)";
            return Err(Error::Limit { what: what.into(), need, have: memory });
        }
        let mut layers = MarchLayers::new(width, height);
        // A line that meets the footprint crosses the voxel's layer at most this many cells away.
        let reach = (f64::from(self.kernel.radius) * 3.0f64.sqrt() + 0.5).floor() as usize;
        let [one, two] = self.weights.map(|weight| (weight * MARGIN) as f32);
        let (low_fast, low_medium) = (self.low[order.fast.index()], self.low[medium.index()]);
        let cell = |m: u16, f: u16| {
            let (m, f) = (m.checked_sub(low_medium)?, f.checked_sub(low_fast)?);
            let (m, f) = (usize::from(m), usize::from(f));
            (m < height && f < width).then(|| m * width + f)
        };
        let enough = self.need as f32;
        let mut at: Option<u16> = None;
        walk(&self.lane, &order, &mut |batch: &Batch| {
            if at != Some(batch.slow) {
                let gap = at.map_or(0, |at| usize::from(at.abs_diff(batch.slow)) - 1);
                layers.advance(one, two, gap, reach);
                at = Some(batch.slow);
            }
            for j in 0..batch.len() {
                let record = batch.record_index(j);
                let Some(cell) = cell(batch.medium[j], batch.fast[j]) else { continue };
                if layers.before[cell] < enough {
                    open.insert(record);
                }
                let look = self.table.look(self.lane.value_code(record), self.lane.magnitude_code(record));
                layers.tau[cell] = (f64::from(look[3]) / f64::from(std::f32::consts::LOG2_E)).min(most) as f32;
            }
        });
        Ok(())
    }
}

/// The number of planes of `f32` that [`MarchLayers`] holds.
const PLANES: usize = 5;

/// The layer of voxels that the march has reached, and the optical depth in front of it.
struct MarchLayers {
    width: usize,
    /// Optical depth per mean spacing of each voxel of the layer; 0 where there is no voxel.
    tau: Vec<f32>,
    /// For each cell, the least optical depth of a line up to and including the layer before.
    gained: Vec<f32>,
    /// For each cell, the minimum of `gained` over the cells where a line that meets a footprint of this layer may have
    /// crossed.
    before: Vec<f32>,
    scratch: Vec<f32>,
    across: Vec<f32>,
}

impl MarchLayers {
    fn new(width: usize, height: usize) -> MarchLayers {
        let plane = || vec![0.0; width * height];
        MarchLayers { width, tau: plane(), gained: plane(), before: plane(), scratch: plane(), across: plane() }
    }

    /// Adds the cost of this layer to `gained`, passes `gap` empty layers, and starts the next layer.
    fn advance(&mut self, one: f32, two: f32, gap: usize, reach: usize) {
        let MarchLayers { width, tau, gained, before, scratch, across } = self;
        box_minimum(gained, across, *width, 1);
        for (weight, cells) in [(one, 1), (two, 2)] {
            scratch.copy_from_slice(tau);
            box_minimum(scratch, across, *width, cells);
            // The cost is the larger of the 3 x 3 and the 5 x 5 value; the first round of this loop leaves its value in
            // `before`.
            for ((cost, least), sum) in before.iter_mut().zip(&*scratch).zip(gained.iter_mut()) {
                if cells == 1 {
                    *cost = weight * least;
                } else {
                    *sum = (*sum + cost.max(weight * least)).min(ENOUGH);
                }
            }
        }
        if gap > 0 {
            box_minimum(gained, across, *width, gap);
        }
        before.copy_from_slice(gained);
        box_minimum(before, across, *width, reach + 1);
        tau.fill(0.0);
    }
}
