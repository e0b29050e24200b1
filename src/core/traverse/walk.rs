//! The walk: from a lane (all scan lines along one axis) and an order to batches of voxels.
//!
//! In: a [`Lane`] that runs along the order's fast axis. Out: [`Batch`]es of voxels of one slice each, in visiting
//! order. Nothing is allocated per slice, line or voxel.
//!
//! ```text
//! for each slice that is not empty, in the slow order
//!     find its lines, tile by tile, from the occupancy masks (ascending)       slice_lines.rs
//!     put them in the medium order                                             lines.rs
//!     in groups that fill a batch
//!         for each line, decode its steps to coordinates, in the fast order    decode.rs
//!         if the lane hides some voxels, keep those that it shows              decode.rs
//! ```
//!
//! Departures for speed:
//! 1. A prefix sum turns sixteen steps into coordinates at once, and all sixteen are stored; the next line overwrites
//!    the surplus. Most lines have at most sixteen records; they cost no mispredicted branch.
//! 2. Where the fast axis runs downward, a group is filled from its end: lines are read in ascending order as stored.
//! 3. One test tells whether sixteen steps contain stepping voxels; only then are they read one by one.
//! 4. Where the fast axis has voxels on both sides of the eye, each line is decoded ascending first. Then sixteen
//!    voxels at a time are merged from its two ends without a branch that depends on them (sides.rs). Processors with
//!    AVX2 run a version of their own of this part.
//! 5. If the medium axis has one direction, the lines found are used as they are or reversed in place. Only a
//!    two-sided order needs another list.
//!
//! An [overlay](crate::arena::Overlay) costs only the lines that it changes. Their ends and records follow the lane's
//! own; the bounds check that every line needs anyway finds them.
//!
//! Safe on any bytes: lines outside the channels or longer than their axis are skipped, and no walk visits more records
//! than the lane has.

use super::decode::{Decoder, group};
use super::lines::OrderedSlices;
use super::order::Order;
use crate::arena::Lane;
use crate::volume::Axis;

/// A box of voxels, by grid coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelBox {
    /// Lowest coordinates x, y, z.
    pub low: [u16; 3],
    /// Highest coordinates x, y, z, inclusive.
    pub high: [u16; 3],
}

impl VoxelBox {
    /// The box of all voxels, of any grid.
    pub(crate) const ALL: VoxelBox = VoxelBox { low: [0; 3], high: [u16::MAX; 3] };

    /// Returns the box of all voxels of a grid with so many points along x, y and z.
    pub(crate) fn of_dims(dims: [u32; 3]) -> VoxelBox {
        VoxelBox { low: [0; 3], high: dims.map(|points| u16::try_from(points.saturating_sub(1)).unwrap_or(u16::MAX)) }
    }

    /// Returns the voxels that are in both boxes; `None` if there are none.
    pub(crate) fn and(&self, other: &VoxelBox) -> Option<VoxelBox> {
        let low = [0, 1, 2].map(|a: usize| self.low[a].max(other.low[a]));
        let high = [0, 1, 2].map(|a: usize| self.high[a].min(other.high[a]));
        Some(VoxelBox { low, high }).filter(VoxelBox::is_ordered)
    }

    /// Returns the box with these lowest and highest coordinates; the axes may come in any order.
    #[inline(always)]
    pub(crate) fn from_sides(sides: [(Axis, [u16; 2]); 3]) -> VoxelBox {
        let mut bounds = VoxelBox { low: [0; 3], high: [0; 3] };
        for (axis, [low, high]) in sides {
            (bounds.low[axis.index()], bounds.high[axis.index()]) = (low, high);
        }
        bounds
    }

    /// Returns whether no low end is above its high end.
    pub(crate) fn is_ordered(&self) -> bool {
        (0..3).all(|a| self.low[a] <= self.high[a])
    }

    /// Returns whether the boxes share a voxel.
    #[inline(always)]
    pub fn meets(&self, other: &VoxelBox) -> bool {
        (0..3).all(|a| self.low[a] <= other.high[a] && self.high[a] >= other.low[a])
    }
}

/// Voxels of one slice, in visiting order.
///
/// In a sound lane, coordinates lie inside the grid. In a damaged one they may be arbitrary; records are always inside
/// the lane's channels.
#[derive(Debug, Clone, Copy)]
pub struct Batch<'a> {
    /// Coordinate of all voxels on the slow axis (that of the outermost loop).
    pub slow: u16,
    /// Coordinate of each voxel on the medium axis (that of the middle loop).
    pub medium: &'a [u16],
    /// Coordinate of each voxel on the fast axis (that of the innermost loop).
    pub fast: &'a [u16],
    /// Index of each voxel's record in the lane's channels, minus `base`.
    pub record: &'a [u32],
    /// Add this to an element of `record` to get the index in the lane's channels.
    pub base: u64,
}

impl Batch<'_> {
    /// Returns the number of voxels.
    pub fn len(&self) -> usize {
        self.fast.len()
    }

    /// Returns whether there are no voxels; a walk yields no such batch.
    pub fn is_empty(&self) -> bool {
        self.fast.is_empty()
    }

    /// Returns the index, in the lane's channels, of the record of voxel `index` of the batch.
    #[inline(always)]
    pub fn record_index(&self, index: usize) -> usize {
        // A lane's channels lie in memory, so the index fits.
        #[allow(clippy::cast_possible_truncation, reason = "see above; on any content it is bounds-checked later")]
        let base = self.base as usize;
        base + self.record[index] as usize
    }
}

/// Receives the voxels of a walk, and can skip parts of the volume.
pub trait Visitor {
    /// Returns whether to visit a tile (8 x 8 lines) with these bounds. Called for all tiles before the walk.
    fn wants_tile(&mut self, _bounds: &VoxelBox) -> bool {
        true
    }

    /// Returns whether to visit the lines of a tile (at most 8) in one slice. Called in ascending order before
    /// the slice is visited.
    fn wants_row(&mut self, _bounds: &VoxelBox) -> bool {
        true
    }

    /// Receives voxels in visiting order.
    fn visit(&mut self, batch: &Batch);
}

impl<F: FnMut(&Batch)> Visitor for F {
    #[inline(always)]
    fn visit(&mut self, batch: &Batch) {
        self(batch);
    }
}

/// Visits the voxels of `lane` in `order`.
///
/// # Panics
/// If the lane does not run along the order's fast axis.
pub fn walk(lane: &Lane, order: &Order, visitor: &mut dyn Visitor) {
    let mut decoder = Decoder::new(lane, order.along[order.fast.index()]);
    // Number of records that may still be visited: limits the work that a damaged file can cause.
    let mut budget = lane.record_count();
    let no_facts_of_tiles = |_, _: &_| ();
    let slices = OrderedSlices::new(lane, order, |bounds| visitor.wants_tile(bounds));
    slices.visit(0..slices.len(), visitor, no_facts_of_tiles, |visitor, slow, mut lines| {
        while !lines.is_empty() {
            let mut group = group(lines, decoder.capacity);
            if lane.pager.is_some() {
                group.stay_near(lines);
                for line in &lines[..group.line_count] {
                    lane.about_to_read(line.records_read());
                }
            }
            let Some(left) = budget.checked_sub(group.records) else { return };
            budget = left;
            let (now, later) = lines.split_at(group.line_count);
            lines = later;
            let batch = decoder.decode(now, group.base, slow);
            if !batch.is_empty() {
                visitor.visit(&batch);
            }
        }
    });
}
