//! The lines of a walk in order, without their voxels: a graphics device decodes the voxels itself.
//!
//! In: a lane and an order. Out: every line that is not empty, slice by slice in the slow order, within a slice in the
//! medium order. O(tiles + lines); channels are not read. Lines that a [walk](super::walk()) would skip are skipped.

use super::order::{AxisOrder, Order};
use super::tiles::TileRows;
use crate::arena::Lane;
use crate::arena::layout::TILE_EDGE;
use crate::arena::pager::tell;

/// A scan line at its position in the walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct OrderedLine {
    /// Coordinate on the slow axis (that of the walk's outermost loop).
    pub slow: u16,
    /// Coordinate on the medium axis (that of the walk's middle loop).
    pub medium: u16,
    /// Index, in the lane, of the tile that holds the line.
    pub tile: u32,
    /// The line's bit in its tile's occupancy mask.
    pub bit: u8,
    /// Number of records, including stepping voxels (records that only bridge a gap): 1 to the length of the fast axis.
    pub records: u32,
    /// Lowest and highest coordinate on the fast axis of the voxels of all lines in the tile.
    pub extent: [u16; 2],
}

/// Calls `visit` with the lines of `lane`, in `order`.
///
/// # Panics
/// If the lane does not run along the order's fast axis.
pub(crate) fn ordered_lines(lane: &Lane, order: &Order, mut visit: impl FnMut(OrderedLine)) {
    assert_eq!(lane.axis, order.fast, "a walk needs the lane along its fast axis");
    let rows = TileRows::new(lane, order.slow, |_| true);
    let slow_is_v = order.slow == lane.axis.others()[1];
    let slices = rows.slices();
    let (mut gathered, mut mediums) = (Vec::new(), Vec::new());
    order.along[order.slow.index()].for_each_index(&slices, |index| {
        let slow = slices[index];
        gathered.clear();
        for (tile, record) in rows.numbered_row(usize::from(slow / TILE_EDGE)) {
            let within = slow % TILE_EDGE;
            let medium_tile = if slow_is_v { record.tile_u.get() } else { record.tile_v.get() };
            let occupied = record.occupancy.get();
            let bit_of = |medium: u16| if slow_is_v { 8 * within + medium } else { 8 * medium + within };
            if (0..TILE_EDGE).all(|medium| occupied >> bit_of(medium) & 1 == 0) {
                continue;
            }
            tell(lane.pager, || lane.line_ends.bytes_of(record.lines()));
            let Some(room) = lane.record_count().checked_sub(record.first_record.get()) else { continue };
            for medium in 0..TILE_EDGE {
                let bit = bit_of(medium);
                if occupied >> bit & 1 == 0 {
                    continue;
                }
                let Some([start, end]) = line_bounds(lane, record.first_line.get(), occupied, bit) else { continue };
                let records = end.wrapping_sub(start);
                let is_sound = records.wrapping_sub(1) < lane.dims[lane.axis.index()] && u64::from(end) <= room;
                if is_sound && start <= end {
                    gathered.push(OrderedLine {
                        slow,
                        medium: TILE_EDGE.wrapping_mul(medium_tile).wrapping_add(medium),
                        tile,
                        bit: u8::try_from(bit).unwrap_or(0),
                        records,
                        extent: [record.low.get(), record.high.get()],
                    });
                }
            }
        }
        match order.along[order.medium.index()] {
            AxisOrder::Ascending => gathered.iter().for_each(|&line| visit(line)),
            AxisOrder::Descending => gathered.iter().rev().for_each(|&line| visit(line)),
            sides @ AxisOrder::TwoSided { .. } => {
                mediums.clear();
                mediums.extend(gathered.iter().map(|line| line.medium));
                sides.for_each_index(&mediums, |index| visit(gathered[index]));
            }
        }
    });
}

/// Returns start and end of the line at `bit`, in records from its tile's first record.
fn line_bounds(lane: &Lane, first_line: u32, occupied: u64, bit: u16) -> Option<[u32; 2]> {
    let rank = (occupied & ((1 << bit) - 1)).count_ones();
    let line = first_line.checked_add(rank)? as usize;
    let start = if rank == 0 { 0 } else { lane.line_end(line - 1)? };
    Some([start, lane.line_end(line)?])
}
