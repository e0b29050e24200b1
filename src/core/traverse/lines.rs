//! The lines of a walk in order, slice by slice, without their voxels.
//!
//! In: a lane and an order. Out: the lines of every slice that is not empty, in the slow order, and within a slice in
//! the medium order. O(tiles + lines); channels are not read. A walk decodes the lines; a graphics device decodes them
//! itself.

use super::gather::{GatheredLine, LineGatherer};
use super::order::{AxisOrder, Order};
use super::tiles::TileRows;
use super::walk::Visitor;
use crate::arena::layout::TileRecord;
use crate::arena::{Lane, LineEnds};

/// Calls `visit` with the coordinate and the lines of each slice of `lane`, in `order`. Each line gets what `tile_of`
/// returns for its tile's index and the tile.
///
/// # Panics
/// If the lane does not run along the order's fast axis.
pub(crate) fn ordered_lines<T: Copy + Default, V: Visitor + ?Sized>(
    lane: &Lane,
    order: &Order,
    visitor: &mut V,
    tile_of: impl Fn(u32, &TileRecord) -> T + Copy,
    visit: impl FnMut(&mut V, u16, &[GatheredLine<T>]),
) {
    assert_eq!(lane.axis, order.fast, "a walk needs the lane along its fast axis");
    let rows = TileRows::new(lane, order.slow, |bounds| visitor.wants_tile(bounds));
    match lane.line_ends {
        LineEnds::Narrow(ends) => {
            let line_end = |i: usize| ends.get(i).map(|e| u32::from(e.get())).or_else(|| lane.patched_line_end(i));
            slices(lane, order, &rows, line_end, visitor, tile_of, visit);
        }
        LineEnds::Wide(ends) => {
            let line_end = |i: usize| ends.get(i).map(|e| e.get()).or_else(|| lane.patched_line_end(i));
            slices(lane, order, &rows, line_end, visitor, tile_of, visit);
        }
    }
}

fn slices<T: Copy + Default, V: Visitor + ?Sized>(
    lane: &Lane,
    order: &Order,
    rows: &TileRows,
    line_end: impl Fn(usize) -> Option<u32> + Copy,
    visitor: &mut V,
    tile_of: impl Fn(u32, &TileRecord) -> T + Copy,
    mut visit: impl FnMut(&mut V, u16, &[GatheredLine<T>]),
) {
    let mut gather = LineGatherer::new(lane, order);
    let (mut mediums, mut two_sided) = (Vec::new(), Vec::new());
    let slices = rows.slices();
    order.along[order.slow.index()].for_each_index(&slices, |index| {
        let slow = slices[index];
        let gathered = gather.lines_of(rows, slow, line_end, tile_of, visitor);
        let lines = match order.along[order.medium.index()] {
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
        visit(visitor, slow, lines);
    });
}
