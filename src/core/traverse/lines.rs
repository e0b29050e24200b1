//! The lines of a walk in order, slice by slice, without their voxels.
//!
//! In: a lane and an order. Out: the lines of every slice that is not empty, in the slow order, and within a slice in
//! the medium order. O(tiles + lines); channels are not read. A walk decodes the lines; a graphics device decodes them
//! itself.

use std::ops::Range;

use super::order::{AxisOrder, Order};
use super::slice_lines::{SliceLine, SliceLines};
use super::tiles::TileRows;
use super::walk::{Visitor, VoxelBox};
use crate::arena::layout::TileRecord;
use crate::arena::{Lane, LineEnds};

/// The slices of a lane that are not empty, in the slow order of a walk.
pub(crate) struct OrderedSlices<'a> {
    lane: Lane<'a>,
    order: Order,
    rows: TileRows<'a>,
    slices: Vec<u16>,
}

impl<'a> OrderedSlices<'a> {
    /// Finds the slices of those tiles of `lane` whose bounds `wants` accepts.
    ///
    /// # Panics
    /// If the lane does not run along the order's fast axis.
    pub(crate) fn new(lane: &Lane<'a>, order: &Order, wants: impl FnMut(&VoxelBox) -> bool) -> OrderedSlices<'a> {
        assert_eq!(lane.axis, order.fast, "a walk needs the lane along its fast axis");
        let rows = TileRows::new(lane, order.slow, wants);
        let ascending = rows.slices();
        let mut slices = Vec::with_capacity(ascending.len());
        order.along[order.slow.index()].for_each_index(&ascending, |index| slices.push(ascending[index]));
        OrderedSlices { lane: *lane, order: *order, rows, slices }
    }

    /// Returns the number of slices.
    pub(crate) fn len(&self) -> usize {
        self.slices.len()
    }

    /// Calls `visit` with the coordinate and the lines of each slice of `part`. Each line gets what `tile_of` returns for its
    /// tile's index and the tile.
    pub(crate) fn visit<T: Copy + Default, V: Visitor + ?Sized>(
        &self,
        part: Range<usize>,
        visitor: &mut V,
        tile_of: impl Fn(u32, &TileRecord) -> T + Copy,
        visit: impl FnMut(&mut V, u16, &[SliceLine<T>]),
    ) {
        let lane = &self.lane;
        match lane.line_ends {
            LineEnds::Narrow(ends) => {
                let line_end = |i: usize| ends.get(i).map(|e| u32::from(e.get())).or_else(|| lane.patched_line_end(i));
                self.visit_slices(part, line_end, visitor, tile_of, visit);
            }
            LineEnds::Wide(ends) => {
                let line_end = |i: usize| ends.get(i).map(|e| e.get()).or_else(|| lane.patched_line_end(i));
                self.visit_slices(part, line_end, visitor, tile_of, visit);
            }
        }
    }

    fn visit_slices<T: Copy + Default, V: Visitor + ?Sized>(
        &self,
        part: Range<usize>,
        line_end: impl Fn(usize) -> Option<u32> + Copy,
        visitor: &mut V,
        tile_of: impl Fn(u32, &TileRecord) -> T + Copy,
        mut visit: impl FnMut(&mut V, u16, &[SliceLine<T>]),
    ) {
        let mut slice_lines = SliceLines::new(&self.lane, &self.order);
        let (mut mediums, mut two_sided) = (Vec::new(), Vec::new());
        for &slow in &self.slices[part] {
            let found = slice_lines.lines_of(&self.rows, slow, line_end, tile_of, visitor);
            let lines = match self.order.along[self.order.medium.index()] {
                AxisOrder::Ascending => &*found,
                AxisOrder::Descending => {
                    found.reverse();
                    &*found
                }
                sides @ AxisOrder::TwoSided { .. } => {
                    mediums.clear();
                    mediums.extend(found.iter().map(|line| line.medium));
                    two_sided.clear();
                    sides.for_each_index(&mediums, |index| two_sided.push(found[index]));
                    &*two_sided
                }
            };
            visit(visitor, slow, lines);
        }
    }
}
