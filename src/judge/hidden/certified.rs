//! Hidden for certain: what a bound on all lines from outside proves.
//!
//! ```text
//! for each kernel, each axis, each sense of it: march over the layers across the axis, from the front
//!     cost(c)  optical depth that a line gains in the layer at least, if it crosses it in cell c
//!              = max(S1 * min over 3 x 3 of tau, S2 * min over 5 x 5 of tau)                       weight.rs
//!     F(c)     = min of D over the 9 cells that the line may have crossed in the layer in front
//!     D(c)     = F(c) + cost(c)
//!     a voxel is hidden from here if exp(-F) <= eps in all cells where a line may cross that meets its footprint
//! hidden: from everywhere
//! ```
//!
//! A straight line has a steepest axis, along which it shifts by a cell at most on either other axis from layer to
//! layer; so its cells are one of the paths over which F is the minimum, and F bounds the optical depth in the layers
//! in front. The walk composites layers in that order wherever the line's steepest axis is the walk's slow one: in
//! every parallel view, and in a perspective one on every ray that is steepest along the axis that the view is.
//! Layers' own voxels never count. Cells outside are open: lines come from anywhere.
//!
//! Certified are the kernels of draft, standard and high, for views from outside as [`super`] defines them.

use super::weight::{LayerWeights, layer_weights};
use super::{Culling, Stage, Watch, go_on};
use adjsplat::arena::record_set::carry;
use adjsplat::arena::{Lane, RecordSet};
use adjsplat::error::{Error, Result};
use adjsplat::internals::LOG2_E;
use adjsplat::splat::camera::WorldFrame;
use adjsplat::splat::composite::{MAX_DEPTH, Table};
use adjsplat::splat::{KernelShape, Quality, Scene, Settings};
use adjsplat::traverse::{AxisOrder, Batch, Order, walk};
use adjsplat::volume::Axis;

/// What affine footprints of perspective views, and sums in single precision, may lack of the weight.
const MARGIN: f64 = 0.98;
/// Optical depths need not be told apart from here on.
const ENOUGH: f32 = 64.0;

/// Adds to `seen`, of the lane along x, the voxels that are not proven hidden.
///
/// # Errors
/// [`Error::Limit`] if the memory does not suffice; [`Error::Input`] if the grid's axes are not at right angles;
/// [`Error::Interrupted`] if `watch` says so.
pub(super) fn uncertain(scene: &Scene, seen: &RecordSet, culling: &Culling, watch: Watch) -> Result<()> {
    let frame = WorldFrame::of(&scene.facts.grid);
    let [x, y, z] = frame.steps.map(|step| step.normalize());
    if [x.dot(y), y.dot(z), z.dot(x)].iter().any(|cosine| cosine.abs() > 1e-3) {
        let why = "needs a grid whose axes are at right angles; leave it out to find hidden voxels by sampling";
        return Err(Error::input("--cull-hidden-certified", why));
    }
    let x_lane = scene.lanes.lane(Axis::X)?;
    let Some((low, high)) = x_lane.bounds() else { return Ok(()) };
    let mean = scene.facts.grid.mean_spacing();
    let lengths = scene.facts.grid.spacing.map(|step| step / mean);
    let kernels = [Quality::Draft, Quality::Standard, Quality::High].map(Quality::kernel);
    let need = -(culling.eps.ln());
    let table = Table::new(scene, &x_lane, &Settings::every_pixel([1, 1]), mean)?;
    let mut done = 0;
    let mut known: Vec<([f64; 3], KernelShape, LayerWeights)> = Vec::new();
    for slow in Axis::ALL {
        let fast = if slow == Axis::X { Axis::Y } else { Axis::X };
        let lane = scene.lanes.lane(fast)?;
        let open = RecordSet::new(lane.steps.len())?;
        for kernel in kernels {
            // Equal distances, which are common, have equal weights.
            let [u, v] = slow.others();
            let apart = [slow, u, v].map(|axis| lengths[axis.index()]);
            let found = known.iter().find(|(other, shape, _)| *other == apart && *shape == kernel);
            let weights = found.map_or_else(|| layer_weights(kernel, slow, lengths), |(.., weights)| *weights);
            known.push((apart, kernel, weights));
            let strongest = peak(kernel) * lengths.iter().copied().fold(0.0, f64::max);
            for along in [AxisOrder::Ascending, AxisOrder::Descending] {
                let march = March { lane, table: &table, slow, low, high, weights, kernel, need };
                march.run(along, MAX_DEPTH / strongest, &open, culling.memory)?;
                done += 1;
                go_on(watch, Stage::Look, done, 18)?;
            }
        }
        if fast == Axis::X {
            seen.add_all(&open);
        } else {
            carry(&lane, &|record| open.contains(record), &x_lane, seen)?;
        }
    }
    Ok(())
}

/// A kernel's largest weight, of a line that is as long as a voxel in a voxel.
fn peak(kernel: KernelShape) -> f64 {
    f64::from(kernel.normalisation()) / f64::from(kernel.sigma).powi(2)
}

struct March<'a> {
    lane: Lane<'a>,
    table: &'a Table<'a>,
    slow: Axis,
    low: [u16; 3],
    high: [u16; 3],
    weights: LayerWeights,
    kernel: KernelShape,
    need: f64,
}

impl March<'_> {
    /// Adds to `open` the records that are not hidden from the side where the march starts. `most`: largest optical
    /// depth of a mean voxel that no view cuts down.
    #[expect(clippy::cast_possible_truncation, reason = "single precision suffices within the margin")]
    fn run(&self, along: AxisOrder, most: f64, open: &RecordSet, memory: u64) -> Result<()> {
        let medium = Axis::ALL.into_iter().find(|&axis| axis != self.slow && axis != self.lane.axis);
        let medium = medium.expect("there are three axes");
        let mut order = Order { slow: self.slow, medium, fast: self.lane.axis, along: [AxisOrder::Ascending; 3] };
        order.along[self.slow.index()] = along;
        let side = |axis: Axis| usize::from(self.high[axis.index()] - self.low[axis.index()]) + 1;
        let (wide, high) = (side(order.fast), side(medium));
        let need = (PLANES * wide * high * size_of::<f32>()) as u64;
        if need > memory {
            let what = "memory for the layers of certified hidden voxels in bytes (or find them by sampling)";
            return Err(Error::Limit { what: what.into(), need, have: memory });
        }
        let mut layers = Layers::new(wide, high);
        // A line that meets the footprint crosses the voxel's layer up to so many cells away.
        let reach = (f64::from(self.kernel.radius) * 3.0f64.sqrt() + 0.5).floor() as usize;
        let [one, two] = [self.weights.three, self.weights.five].map(|weight| (weight * MARGIN) as f32);
        let (low_fast, low_medium) = (self.low[order.fast.index()], self.low[medium.index()]);
        let place = |m: u16, f: u16| {
            let (m, f) = (m.checked_sub(low_medium)?, f.checked_sub(low_fast)?);
            let (m, f) = (usize::from(m), usize::from(f));
            (m < high && f < wide).then(|| m * wide + f)
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
                let Some(place) = place(batch.medium[j], batch.fast[j]) else { continue };
                if layers.before[place] < enough {
                    open.insert(record);
                }
                let look = self.table.look(self.lane.value_code(record), self.lane.magnitude_code(record));
                layers.tau[place] = (f64::from(look[3]) / f64::from(LOG2_E)).min(most) as f32;
            }
        });
        Ok(())
    }
}

/// Planes that a march works with.
const PLANES: usize = 5;

/// The layer at hand, and what lies in front of it.
struct Layers {
    wide: usize,
    /// Optical depth per mean voxel of the layer's voxels; 0 where there is none.
    tau: Vec<f32>,
    /// Least optical depth up to and with the layer before.
    gained: Vec<f32>,
    /// Least of `gained` over all cells where a line may have crossed that meets a footprint of the layer at hand.
    before: Vec<f32>,
    scratch: Vec<f32>,
    across: Vec<f32>,
}

impl Layers {
    fn new(wide: usize, high: usize) -> Layers {
        let plane = || vec![0.0; wide * high];
        Layers { wide, tau: plane(), gained: plane(), before: plane(), scratch: plane(), across: plane() }
    }

    /// Puts the layer behind, and `gap` empty ones, and starts the next.
    fn advance(&mut self, one: f32, two: f32, gap: usize, reach: usize) {
        let Layers { wide, tau, gained, before, scratch, across } = self;
        least(gained, scratch, across, *wide, 1);
        gained.copy_from_slice(scratch);
        for (weight, cells) in [(one, 1), (two, 2)] {
            least(tau, scratch, across, *wide, cells);
            // The larger of the two: the first leaves its cost in `before`.
            for ((cost, least), sum) in before.iter_mut().zip(&*scratch).zip(gained.iter_mut()) {
                if cells == 1 {
                    *cost = weight * least;
                } else {
                    *sum = (*sum + cost.max(weight * least)).min(ENOUGH);
                }
            }
        }
        if gap > 0 {
            least(gained, scratch, across, *wide, gap);
            gained.copy_from_slice(scratch);
        }
        least(gained, before, across, *wide, reach + 1);
        tau.fill(0.0);
    }
}

/// The least of each square of `2 reach + 1` cells, of which those outside are 0.
fn least(plane: &[f32], out: &mut [f32], across: &mut [f32], wide: usize, reach: usize) {
    let high = plane.len() / wide;
    if 2 * reach >= wide || 2 * reach >= high {
        out.fill(0.0);
        return;
    }
    let window = 2 * reach + 1;
    for (row, to) in plane.chunks_exact(wide).zip(across.chunks_exact_mut(wide)) {
        to.fill(0.0);
        let inner = &mut to[reach..wide - reach];
        inner.copy_from_slice(&row[..wide - 2 * reach]);
        for shift in 1..window {
            for (least, next) in inner.iter_mut().zip(&row[shift..]) {
                *least = if *next < *least { *next } else { *least };
            }
        }
    }
    out.fill(0.0);
    for y in reach..high - reach {
        let to = &mut out[y * wide..][..wide];
        to.copy_from_slice(&across[(y - reach) * wide..][..wide]);
        for row in across[(y - reach + 1) * wide..(y + reach + 1) * wide].chunks_exact(wide) {
            for (least, next) in to.iter_mut().zip(row) {
                *least = if *next < *least { *next } else { *least };
            }
        }
    }
}
