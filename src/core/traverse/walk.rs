//! The walk: from a lane and an order to batches of voxels.
//!
//! In: a [`Lane`] whose axis is the order's fast one. Out: [`Batch`]es, each of one slice, whose voxels come in the
//! order's sequence. Nothing is allocated per slice, line or voxel.
//!
//! ```text
//! for each non-empty slice in the slow order
//!     gather its lines, tile by tile, from the occupancy masks (ascending)     gather.rs
//!     put them in the medium order
//!     in groups that fill a batch
//!         for each line, decode its steps into coordinates, in the fast order  decode.rs
//! ```
//!
//! Departures for speed:
//! 1. Sixteen steps become coordinates at once, by a prefix sum, and are stored whether the line has as many
//!    records or not: the next line overwrites what is too much. Lines of up to sixteen records, which is most of
//!    them, so cost no mispredicted branch.
//! 2. Where the fast axis runs down, a group is filled from its end: ascending lines, read as they lie.
//! 3. Whether stepping voxels are among sixteen steps is one test; only then are they read one by one.
//! 4. A medium axis of one direction takes the gathered lines as they are, or reversed in place; only two sides need
//!    another list.
//!
//! An [overlay](crate::arena::Overlay) costs only the lines that it changes: their ends and records lie past the
//! lane's own, where the bounds checks that every line passes anyway find them to be the patch's.
//!
//! Safe on any bytes: a line outside the channels, or longer than its axis, is skipped, and no walk visits more
//! records than the lane has.

use super::decode::{Decoder, group};
use super::gather::Gather;
use super::order::{AxisOrder, Order};
use super::tiles::TileRows;
use crate::arena::{Lane, LineEnds};

/// A box of voxels, by x, y, z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelBox {
    /// Lowest coordinates.
    pub low: [u16; 3],
    /// Highest coordinates, inclusive.
    pub high: [u16; 3],
}

impl VoxelBox {
    /// Whether the boxes have a voxel in common.
    #[inline(always)]
    pub(crate) fn meets(&self, other: &VoxelBox) -> bool {
        (0..3).all(|a| self.low[a] <= other.high[a] && self.high[a] >= other.low[a])
    }
}

/// Voxels of one slice in visit order.
///
/// Coordinates lie inside the grid if the lane is sound. On a damaged one they may be any; records are always inside
/// the lane's channels.
#[derive(Debug, Clone, Copy)]
pub struct Batch<'a> {
    /// Coordinate of all on the slow axis.
    pub slow: u16,
    /// Coordinates on the medium axis.
    pub medium: &'a [u16],
    /// Coordinates on the fast axis; as many.
    pub fast: &'a [u16],
    /// Records in the lane's channels, from `base`; as many.
    pub record: &'a [u32],
    /// What `record` is counted from.
    pub base: u64,
}

impl Batch<'_> {
    /// How many voxels.
    pub fn len(&self) -> usize {
        self.fast.len()
    }

    /// Whether there are no voxels; a walk delivers no such batch.
    pub fn is_empty(&self) -> bool {
        self.fast.is_empty()
    }

    /// Index in the lane's channels of voxel `index` of the batch.
    #[inline(always)]
    pub fn record_index(&self, index: usize) -> usize {
        // A lane's channels lie in memory, so the index fits.
        #[allow(clippy::cast_possible_truncation, reason = "see above; on any content it is bounds-checked later")]
        let base = self.base as usize;
        base + self.record[index] as usize
    }
}

/// What a walk asks and tells.
pub trait Visitor {
    /// Whether any voxel of the box could matter; asked for each tile (8 x 8 lines) before the walk.
    fn wants_tile(&mut self, _bounds: &VoxelBox) -> bool {
        true
    }

    /// Whether any voxel of the box could matter; asked for each tile of each slice (up to 8 lines), in ascending
    /// order, before the slice is visited.
    fn wants_row(&mut self, _bounds: &VoxelBox) -> bool {
        true
    }

    /// Voxels, in visit order.
    fn visit(&mut self, batch: &Batch);
}

impl<F: FnMut(&Batch)> Visitor for F {
    #[inline(always)]
    fn visit(&mut self, batch: &Batch) {
        self(batch);
    }
}

/// Walks `lane` in `order`.
///
/// # Panics
/// If the lane does not run along the order's fast axis.
pub fn walk<V: Visitor + ?Sized>(lane: &Lane, order: &Order, visitor: &mut V) {
    assert_eq!(lane.axis, order.fast, "a walk needs the lane along its fast axis");
    let rows = TileRows::new(lane, order.slow, |bounds| visitor.wants_tile(bounds));
    match lane.line_ends {
        LineEnds::Narrow(ends) => {
            let line_end = |i: usize| ends.get(i).map(|e| u32::from(e.get())).or_else(|| lane.patched_line_end(i));
            walk_slices(lane, order, &rows, line_end, visitor);
        }
        LineEnds::Wide(ends) => {
            let line_end = |i: usize| ends.get(i).map(|e| e.get()).or_else(|| lane.patched_line_end(i));
            walk_slices(lane, order, &rows, line_end, visitor);
        }
    }
}

fn walk_slices<V: Visitor + ?Sized>(
    lane: &Lane,
    order: &Order,
    rows: &TileRows,
    line_end: impl Fn(usize) -> Option<u32> + Copy,
    visitor: &mut V,
) {
    let along = |axis: crate::volume::Axis| order.along[axis.index()];
    let mut gather = Gather::new(lane, order);
    let (mut mediums, mut two_sided) = (Vec::new(), Vec::new());
    let mut decoder = Decoder::new(lane, along(order.fast));
    // What may still be visited: bounds the work that a damaged file can ask for.
    let mut budget = lane.record_count();
    let slices = rows.slices();
    along(order.slow).for_each_index(&slices, |index| {
        let slow = slices[index];
        let gathered = gather.lines_of(rows, slow, line_end, visitor);
        let mut lines = match along(order.medium) {
            AxisOrder::Ascending => &*gathered,
            AxisOrder::Descending => {
                gathered.reverse();
                &*gathered
            }
            sides @ AxisOrder::TwoSided { .. } => {
                mediums.clear();
                mediums.extend(gathered.iter().map(|line| line.medium));
                two_sided.clear();
                sides.for_each_index(&mediums, |index| two_sided.push(gathered[index]));
                &*two_sided
            }
        };
        while !lines.is_empty() {
            let mut group = group(lines, decoder.capacity());
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
