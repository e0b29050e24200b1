//! Finds the lines of one slice from the occupancy masks of its tiles.
//!
//! In: the tiles of a slice by ascending coordinate on the medium axis (that of the walk's middle loop). Out:
//! [`SliceLine`]s, ascending. Each line is checked here once to lie inside the channels (the arrays of records);
//! later stages rely on it.

use super::order::Order;
use super::tiles::TileRows;
use super::walk::{Visitor, VoxelBox};
use crate::arena::Lane;
use crate::arena::layout::{TILE_EDGE, TileRecord};
use crate::arena::pager::tell;

/// A scan line of a slice, and what its user wants to know about its tile.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct SliceLine<T = ()> {
    /// Index of the line's first record; all records of the line are inside the channels.
    pub(crate) first_record: u64,
    /// Number of the line's records: 1 to the length of the fast axis.
    pub(crate) count: u16,
    pub(crate) medium: u16,
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only lists for graphics devices note tiles"))]
    pub(crate) tile: T,
}

/// Finds the scan lines of slices, one slice after another.
pub(super) struct SliceLines<'a, T> {
    lane: Lane<'a>,
    order: Order,
    /// The lines of the current slice; the memory is reused.
    lines: Vec<SliceLine<T>>,
}

impl<'a, T: Copy + Default> SliceLines<'a, T> {
    /// Prepares to find the lines of `lane` in slices across the slow axis of `order`.
    pub(super) fn new(lane: &Lane<'a>, order: &Order) -> SliceLines<'a, T> {
        SliceLines { lane: *lane, order: *order, lines: Vec::new() }
    }

    /// Returns the lines of slice `slow` by ascending medium coordinate; `tile_of` is told a tile's index and the tile.
    #[inline(always)]
    pub(super) fn lines_of<V: Visitor + ?Sized>(
        &mut self,
        rows: &TileRows,
        slow: u16,
        line_end: impl Fn(usize) -> Option<u32>,
        tile_of: impl Fn(u32, &TileRecord) -> T,
        visitor: &mut V,
    ) -> &mut [SliceLine<T>] {
        let tiles = rows.row(usize::from(slow / TILE_EDGE));
        let room = tiles.len() * usize::from(TILE_EDGE);
        if self.lines.len() < room {
            self.lines.resize(room, SliceLine::default());
        }
        // Copied out of `self`, so that they stay in registers while `lines` is written.
        let (slow_is_v, order, lane) = (rows.slow_is_v, self.order, self.lane);
        let (longest, record_count) = (u64::from(lane.dims[lane.axis.index()]), lane.record_count());
        let lines = &mut self.lines[..];
        let within = slow % TILE_EDGE;
        let mut count = 0;
        for (index, tile) in tiles {
            let row = if slow_is_v { TileRow::of_v(tile, within) } else { TileRow::of_u(tile, within) };
            let medium_tile = if slow_is_v { tile.tile_u.get() } else { tile.tile_v.get() };
            if row.occupied == 0 || !visitor.wants_row(&row_bounds(&order, medium_tile, tile, slow)) {
                continue;
            }
            tell(lane.pager, || lane.line_ends.bytes_of(tile.lines()));
            let first_record = tile.first_record.get();
            let Some(records) = record_count.checked_sub(first_record) else { continue };
            let first_line = tile.first_line.get() as usize;
            let first_medium = TILE_EDGE.wrapping_mul(medium_tile);
            let mut occupied = row.occupied;
            while occupied != 0 {
                #[allow(clippy::cast_possible_truncation, reason = "a bit of a byte is below 8")]
                let bit = occupied.trailing_zeros() as u16;
                occupied &= occupied - 1;
                let rank = (row.ranks >> (8 * bit) & 0xff) as usize;
                // With 32-bit addresses a damaged number may wrap around to another line, which is checked too.
                let line = first_line.wrapping_add(rank);
                let Some(end) = line_end(line) else { break };
                let start = if rank == 0 { 0 } else { line_end(line.wrapping_sub(1)).unwrap_or(end) };
                // A line that ends before it starts gets a count above the length of any axis. 64 bits are needed: in
                // 32 bits a start near 2^32 would give a small count.
                let (start, end) = (u64::from(start), u64::from(end));
                let line_records = end.wrapping_sub(start);
                #[allow(clippy::cast_possible_truncation, reason = "only kept if it is at most 65,535")]
                let line = SliceLine {
                    first_record: first_record + start,
                    count: line_records as u16,
                    medium: first_medium.wrapping_add(bit),
                    tile: tile_of(index, tile),
                };
                lines[count] = line;
                let is_sound = line_records.wrapping_sub(1) < longest && end <= records;
                count += usize::from(is_sound);
            }
        }
        &mut lines[..count]
    }
}

/// Returns a box that contains all voxels of `tile` in slice `slow`.
#[inline(always)]
fn row_bounds(order: &Order, medium_tile: u16, tile: &TileRecord, slow: u16) -> VoxelBox {
    let first = medium_tile.wrapping_mul(TILE_EDGE);
    VoxelBox::from_sides([
        (order.slow, [slow, slow]),
        (order.medium, [first, first.saturating_add(TILE_EDGE - 1)]),
        (order.fast, [tile.low.get(), tile.high.get()]),
    ])
}

/// The lines, at most eight, that a tile has in one slice.
struct TileRow {
    /// Bit m is set if there is a line at medium coordinate m of the tile.
    occupied: u8,
    /// Byte m is the number of the tile's lines before the line at medium coordinate m.
    ranks: u64,
}

const ONES: u64 = 0x0101_0101_0101_0101;

impl TileRow {
    /// Reads the lines with one v, where u is the medium axis: the bits of one byte of the mask.
    #[inline(always)]
    fn of_v(tile: &TileRecord, v: u16) -> TileRow {
        let mask = tile.occupancy.get();
        let shift = 8 * u32::from(v);
        #[allow(clippy::cast_possible_truncation, reason = "one byte is wanted")]
        let occupied = (mask >> shift) as u8;
        let before = (mask & ((1 << shift) - 1)).count_ones();
        // Spreads eight bits over eight bytes; multiplying by ONES gives the prefix sums of the bytes.
        let spread =
            ((u64::from(occupied) * ONES) & 0x8040_2010_0804_0201).wrapping_add(0x7f7f_7f7f_7f7f_7f7f) >> 7 & ONES;
        let ranks = (spread.wrapping_mul(ONES) << 8).wrapping_add(u64::from(before).wrapping_mul(ONES));
        TileRow { occupied, ranks }
    }

    /// Reads the lines with one u, where v is the medium axis: one bit of each byte of the mask.
    #[inline(always)]
    fn of_u(tile: &TileRecord, u: u16) -> TileRow {
        let mask = tile.occupancy.get();
        let column = mask >> u & ONES;
        // Moves the bit of byte i to bit i: each partial product has its own bit of the top byte.
        #[allow(clippy::cast_possible_truncation, reason = "the top byte is what is left")]
        let occupied = (column.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8;
        let bytes_below = mask_bytes_popcount(mask).wrapping_mul(ONES) << 8;
        let bits_below = mask_bytes_popcount(mask & ONES.wrapping_mul((1 << u) - 1));
        TileRow { occupied, ranks: bytes_below.wrapping_add(bits_below) }
    }
}

#[inline(always)]
fn mask_bytes_popcount(mask: u64) -> u64 {
    let pairs = mask - (mask >> 1 & 0x5555_5555_5555_5555);
    let fours = (pairs & 0x3333_3333_3333_3333) + (pairs >> 2 & 0x3333_3333_3333_3333);
    (fours + (fours >> 4)) & 0x0f0f_0f0f_0f0f_0f0f
}
