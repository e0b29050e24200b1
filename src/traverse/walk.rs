//! The walk: from a lane and an order to batches of voxels.
//!
//! In: a [`Lane`] whose axis is the order's fast one. Out: [`Batch`]es, each of one slice, whose voxels come in the
//! order's sequence. Nothing is allocated per slice, line or voxel.
//!
//! ```text
//! for each non-empty slice in the slow order
//!     gather its lines, tile by tile, from the occupancy masks (ascending)
//!     for each line in the medium order, in groups that fill a batch
//!         decode its steps into coordinates, in the fast order
//! ```
//!
//! Departures for speed:
//! 1. Sixteen steps become coordinates at once, by a prefix sum, and are stored whether the line has as many
//!    records or not: the next line overwrites what is too much. Lines of up to sixteen records, which is most of
//!    them, so cost no mispredicted branch.
//! 2. Where the fast axis runs down, a group is filled from its end: ascending lines, read as they lie.
//! 3. Whether stepping voxels are among sixteen steps is one test; only then are they read one by one.
//!
//! Safe on any bytes: a line outside the channels, or longer than its axis, is skipped, and no walk visits more
//! records than the lane has.

use super::order::{AxisOrder, Order};
use super::prefix::{CHUNK, prefix_sum};
use super::tiles::TileRows;
use crate::arena::layout::{TILE_EDGE, TileRecord};
use crate::arena::{Lane, LineEnds};
use crate::volume::Axis;

/// A box of voxels, by x, y, z.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VoxelBox {
    /// Lowest coordinates.
    pub low: [u16; 3],
    /// Highest coordinates, inclusive.
    pub high: [u16; 3],
}

/// Voxels of one slice in visit order.
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

/// Voxels that a batch holds unless a single line has more.
const BATCH: usize = 2_048;

/// Walks `lane` in `order`.
///
/// # Panics
/// If the lane does not run along the order's fast axis.
pub fn walk<V: Visitor + ?Sized>(lane: &Lane, order: &Order, visitor: &mut V) {
    assert_eq!(lane.axis, order.fast, "a walk needs the lane along its fast axis");
    let rows = TileRows::new(lane, order.slow, |bounds| visitor.wants_tile(bounds));
    match lane.line_ends {
        LineEnds::Narrow(ends) => Walker::new(lane, order, |i| ends.get(i).map(|e| e.get().into())).run(&rows, visitor),
        LineEnds::Wide(ends) => Walker::new(lane, order, |i| ends.get(i).map(|e| e.get())).run(&rows, visitor),
    }
}

/// One line of the slice at hand.
#[derive(Debug, Clone, Copy)]
struct Line {
    first_record: u64,
    /// At most the length of the fast axis.
    count: u16,
    medium: u16,
}

struct Walker<'a, E> {
    lane: Lane<'a>,
    order: Order,
    line_end: E,
    /// Lines of the slice, ascending.
    lines: Vec<Line>,
    /// Their coordinates, for the medium order.
    mediums: Vec<u16>,
    group: Group,
    /// Records that may still be visited: a bound on the work of a damaged file.
    budget: u64,
}

impl<'a, E: Fn(usize) -> Option<u32>> Walker<'a, E> {
    fn new(lane: &Lane<'a>, order: &Order, line_end: E) -> Self {
        let longest = lane.dims[lane.axis.index()] as usize;
        Walker {
            lane: *lane,
            order: *order,
            line_end,
            lines: Vec::new(),
            mediums: Vec::new(),
            group: Group::new(longest.max(BATCH), order.along[order.fast.index()]),
            budget: lane.record_count(),
        }
    }

    fn run<V: Visitor + ?Sized>(mut self, rows: &TileRows, visitor: &mut V) {
        let slices = rows.slices();
        self.order.along[self.order.slow.index()]
            .for_each_index(&slices, |index| self.slice(rows, slices[index], visitor));
    }

    fn slice<V: Visitor + ?Sized>(&mut self, rows: &TileRows, slow: u16, visitor: &mut V) {
        self.gather(rows, slow, visitor);
        let medium_order = self.order.along[self.order.medium.index()];
        let (lines, mediums, group, lane) = (&self.lines, &self.mediums, &mut self.group, &self.lane);
        medium_order.for_each_index(mediums, |index| {
            let line = lines[index];
            if !group.fits(&line) {
                group.deliver(lane, slow, visitor);
            }
            group.add(line);
        });
        group.deliver(lane, slow, visitor);
    }

    /// Collects the slice's lines by ascending medium coordinate.
    fn gather<V: Visitor + ?Sized>(&mut self, rows: &TileRows, slow: u16, visitor: &mut V) {
        self.lines.clear();
        self.mediums.clear();
        let within = slow % TILE_EDGE;
        let slow_is_v = self.order.slow == self.lane.axis.others()[1];
        for tile in rows.row(usize::from(slow / TILE_EDGE)) {
            let lines = if slow_is_v { RowOfLines::of_v(tile, within) } else { RowOfLines::of_u(tile, within) };
            if lines.occupied == 0 || !visitor.wants_row(&self.row_bounds(tile, slow, slow_is_v)) {
                continue;
            }
            let first_line = tile.first_line.get() as usize;
            let first_medium = TILE_EDGE.wrapping_mul(if slow_is_v { tile.tile_u.get() } else { tile.tile_v.get() });
            let (longest, records) = (self.lane.dims[self.lane.axis.index()], self.lane.record_count());
            let mut occupied = lines.occupied;
            while occupied != 0 {
                #[allow(clippy::cast_possible_truncation, reason = "a bit of a byte is below 8")]
                let bit = occupied.trailing_zeros() as u16;
                occupied &= occupied - 1;
                let rank = usize::from((lines.ranks >> (8 * bit)) as u8);
                let Some(end) = (self.line_end)(first_line + rank) else { return };
                let start = if rank == 0 { 0 } else { (self.line_end)(first_line + rank - 1).unwrap_or(end) };
                let count = end.wrapping_sub(start);
                let first_record = tile.first_record.get().wrapping_add(start.into());
                // So no sum of a batch's base and a record overflows.
                if count > longest || first_record >= records {
                    continue;
                }
                let Some(budget) = self.budget.checked_sub(count.into()) else { return };
                self.budget = budget;
                let medium = first_medium.wrapping_add(bit);
                #[allow(clippy::cast_possible_truncation, reason = "no line is longer than 65,535")]
                self.lines.push(Line { first_record, count: count as u16, medium });
                self.mediums.push(medium);
            }
        }
    }

    fn row_bounds(&self, tile: &TileRecord, slow: u16, slow_is_v: bool) -> VoxelBox {
        let medium_tile = if slow_is_v { tile.tile_u.get() } else { tile.tile_v.get() };
        let first = medium_tile.wrapping_mul(TILE_EDGE);
        let bounds = |axis: Axis| {
            if axis == self.order.slow {
                (slow, slow)
            } else if axis == self.order.fast {
                (tile.low.get(), tile.high.get())
            } else {
                (first, first.saturating_add(TILE_EDGE - 1))
            }
        };
        let [x, y, z] = Axis::ALL.map(bounds);
        VoxelBox { low: [x.0, y.0, z.0], high: [x.1, y.1, z.1] }
    }
}

/// The up to eight lines that a tile has in one slice.
struct RowOfLines {
    /// Bit m: whether there is a line at medium coordinate m of the tile.
    occupied: u8,
    /// Byte m: how many of the tile's lines come before that one.
    ranks: u64,
}

/// 1 in each byte.
const ONES: u64 = 0x0101_0101_0101_0101;

impl RowOfLines {
    /// Lines of one v; u is the medium axis. Bits of one byte of the mask.
    #[inline(always)]
    fn of_v(tile: &TileRecord, v: u16) -> RowOfLines {
        let mask = tile.occupancy.get();
        let shift = 8 * u32::from(v);
        #[allow(clippy::cast_possible_truncation, reason = "one byte is wanted")]
        let occupied = (mask >> shift) as u8;
        let before = (mask & ((1 << shift) - 1)).count_ones();
        // Spread the eight bits over eight bytes; the prefix sum of bytes is a multiplication by ONES.
        let spread =
            ((u64::from(occupied) * ONES) & 0x8040_2010_0804_0201).wrapping_add(0x7f7f_7f7f_7f7f_7f7f) >> 7 & ONES;
        let ranks = (spread.wrapping_mul(ONES) << 8).wrapping_add(u64::from(before).wrapping_mul(ONES));
        RowOfLines { occupied, ranks }
    }

    /// Lines of one u; v is the medium axis. One bit of each byte of the mask.
    #[inline(always)]
    fn of_u(tile: &TileRecord, u: u16) -> RowOfLines {
        let mask = tile.occupancy.get();
        let column = mask >> u & ONES;
        // Byte i of the column's bit moves to bit i: each partial product lands on its own bit of the top byte.
        #[allow(clippy::cast_possible_truncation, reason = "the top byte is what is left")]
        let occupied = (column.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8;
        let bytes_below = mask_bytes_popcount(mask).wrapping_mul(ONES) << 8;
        let bits_below = mask_bytes_popcount(mask & ONES.wrapping_mul((1 << u) - 1));
        RowOfLines { occupied, ranks: bytes_below.wrapping_add(bits_below) }
    }
}

/// Set bits of each byte.
#[inline(always)]
fn mask_bytes_popcount(mask: u64) -> u64 {
    let pairs = mask - (mask >> 1 & 0x5555_5555_5555_5555);
    let fours = (pairs & 0x3333_3333_3333_3333) + (pairs >> 2 & 0x3333_3333_3333_3333);
    (fours + (fours >> 4)) & 0x0f0f_0f0f_0f0f_0f0f
}

/// Lines that make up the next batch, and the batch.
struct Group {
    lines: Vec<Line>,
    records: usize,
    /// Half of 2^32 below the first line's records, so that offsets from it fit 32 bits on both sides.
    base: u64,
    capacity: usize,
    fast: AxisOrder,
    batch: BatchArrays,
    /// One line's voxels in ascending order, for a fast axis with two sides.
    line: BatchArrays,
}

/// The arrays of a batch, with a margin of one chunk at either end.
#[derive(Default)]
struct BatchArrays {
    medium: Vec<u16>,
    fast: Vec<u16>,
    record: Vec<u32>,
}

impl BatchArrays {
    fn new(capacity: usize) -> BatchArrays {
        let len = capacity + 2 * CHUNK;
        BatchArrays { medium: vec![0; len], fast: vec![0; len], record: vec![0; len] }
    }
}

/// Largest distance of a batch's records from its first line's.
const REACH: u64 = 1 << 31;

impl Group {
    fn new(capacity: usize, fast: AxisOrder) -> Group {
        let two_sided = matches!(fast, AxisOrder::TwoSided { .. });
        Group {
            lines: Vec::with_capacity(capacity),
            records: 0,
            base: 0,
            capacity,
            fast,
            batch: BatchArrays::new(capacity),
            line: if two_sided { BatchArrays::new(capacity) } else { BatchArrays::default() },
        }
    }

    #[inline(always)]
    fn fits(&self, line: &Line) -> bool {
        self.lines.is_empty()
            || (self.records + usize::from(line.count) <= self.capacity
                && line.first_record.wrapping_sub(self.base) < 2 * REACH - u64::from(u16::MAX))
    }

    #[inline(always)]
    fn add(&mut self, line: Line) {
        if self.lines.is_empty() {
            self.base = line.first_record.saturating_sub(REACH);
        }
        self.records += usize::from(line.count);
        self.lines.push(line);
    }

    /// Decodes the group and hands it over.
    fn deliver<V: Visitor + ?Sized>(&mut self, lane: &Lane, slow: u16, visitor: &mut V) {
        let range = match self.fast {
            AxisOrder::Ascending => {
                let mut end = CHUNK;
                for line in &self.lines {
                    end = decode_up(lane.steps, line, self.base, &mut self.batch, end);
                }
                CHUNK..end
            }
            AxisOrder::Descending => {
                let top = CHUNK + self.capacity;
                let mut start = top;
                for line in self.lines.iter().rev() {
                    start = decode_down(lane.steps, line, self.base, &mut self.batch, start);
                }
                start..top
            }
            AxisOrder::TwoSided { .. } => {
                let mut end = CHUNK;
                for line in &self.lines {
                    let line_end = decode_up(lane.steps, line, self.base, &mut self.line, CHUNK);
                    let (coordinates, records) = (&self.line.fast[CHUNK..line_end], &self.line.record[CHUNK..line_end]);
                    self.fast.for_each_index(coordinates, |index| {
                        self.batch.medium[end] = line.medium;
                        self.batch.fast[end] = coordinates[index];
                        self.batch.record[end] = records[index];
                        end += 1;
                    });
                }
                CHUNK..end
            }
        };
        self.lines.clear();
        self.records = 0;
        if !range.is_empty() {
            let BatchArrays { medium, fast, record } = &self.batch;
            visitor.visit(&Batch {
                slow,
                medium: &medium[range.clone()],
                fast: &fast[range.clone()],
                record: &record[range],
                base: self.base,
            });
        }
    }
}

/// Writes a line's voxels, ascending, from `at` up; gives the end.
#[inline(always)]
fn decode_up(steps: &[u8], line: &Line, base: u64, out: &mut BatchArrays, at: usize) -> usize {
    let Some((from, offset)) = place(line, base) else { return at };
    let count = usize::from(line.count);
    let mut end = at;
    // The first step is counted from -1.
    let mut previous = u16::MAX;
    for done in (0..count).step_by(CHUNK) {
        let valid = (count - done).min(CHUNK);
        let Some(chunk) = load(steps, from + done, valid) else { return end };
        let first = offset.wrapping_add(u32_of(done));
        if has_stepping(chunk, valid) {
            for (lane, &step) in chunk.iter().enumerate().take(valid) {
                previous = previous.wrapping_add(if step == 0 { 255 } else { u16::from(step) });
                out.medium[end] = line.medium;
                out.fast[end] = previous;
                out.record[end] = first.wrapping_add(u32_of(lane));
                end += usize::from(step != 0);
            }
        } else {
            let coordinates = prefix_sum(chunk, previous);
            previous = coordinates[CHUNK - 1];
            *chunk_of(&mut out.medium, end) = [line.medium; CHUNK];
            *chunk_of(&mut out.fast, end) = coordinates;
            *chunk_of(&mut out.record, end) = std::array::from_fn(|lane| first.wrapping_add(u32_of(lane)));
            end += valid;
        }
    }
    end
}

/// Writes a line's voxels, descending, below `at`; gives the start.
#[inline(always)]
fn decode_down(steps: &[u8], line: &Line, base: u64, out: &mut BatchArrays, at: usize) -> usize {
    let Some((from, offset)) = place(line, base) else { return at };
    let count = usize::from(line.count);
    let mut start = at;
    let mut previous = u16::MAX;
    for done in (0..count).step_by(CHUNK) {
        let valid = (count - done).min(CHUNK);
        let Some(chunk) = load(steps, from + done, valid) else { return start };
        let first = offset.wrapping_add(u32_of(done));
        if has_stepping(chunk, valid) {
            for (lane, &step) in chunk.iter().enumerate().take(valid) {
                previous = previous.wrapping_add(if step == 0 { 255 } else { u16::from(step) });
                out.medium[start - 1] = line.medium;
                out.fast[start - 1] = previous;
                out.record[start - 1] = first.wrapping_add(u32_of(lane));
                start -= usize::from(step != 0);
            }
        } else {
            let coordinates = prefix_sum(chunk, previous);
            previous = coordinates[CHUNK - 1];
            let low = start - CHUNK;
            *chunk_of(&mut out.medium, low) = [line.medium; CHUNK];
            *chunk_of(&mut out.fast, low) = std::array::from_fn(|lane| coordinates[CHUNK - 1 - lane]);
            *chunk_of(&mut out.record, low) = std::array::from_fn(|lane| first.wrapping_add(u32_of(CHUNK - 1 - lane)));
            start -= valid;
        }
    }
    start
}

/// A line's first record as an index, and from `base`.
#[inline(always)]
fn place(line: &Line, base: u64) -> Option<(usize, u32)> {
    let offset = u32::try_from(line.first_record.wrapping_sub(base)).ok()?;
    Some((usize::try_from(line.first_record).ok()?, offset))
}

/// A number below a line's length.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "lines have at most 65,535 records")]
fn u32_of(index: usize) -> u32 {
    index as u32
}

/// Sixteen places of an array from `from`; the margins make room.
#[inline(always)]
fn chunk_of<T>(array: &mut [T], from: usize) -> &mut [T; CHUNK] {
    array[from..].first_chunk_mut().expect("the arrays have a margin of one chunk")
}

/// Sixteen steps from `from`, of which `valid` count; `None` if those are not all in the channel.
#[inline(always)]
fn load(steps: &[u8], from: usize, valid: usize) -> Option<[u8; CHUNK]> {
    let rest = steps.get(from..)?;
    match rest.first_chunk() {
        Some(chunk) => Some(*chunk),
        None => load_last(rest, valid),
    }
}

/// The channel's last steps, filled up.
#[cold]
fn load_last(rest: &[u8], valid: usize) -> Option<[u8; CHUNK]> {
    let mut chunk = [1; CHUNK];
    chunk[..valid].copy_from_slice(rest.get(..valid)?);
    Some(chunk)
}

/// Whether one of the first `valid` steps, at least one, is 0.
#[inline(always)]
fn has_stepping(chunk: [u8; CHUNK], valid: usize) -> bool {
    const LOW: u128 = u128::from_le_bytes([0x01; CHUNK]);
    const HIGH: u128 = u128::from_le_bytes([0x80; CHUNK]);
    let x = u128::from_le_bytes(chunk);
    // The lowest bit set marks the first zero byte; bits above it may be false, bits below never.
    let zeros = x.wrapping_sub(LOW) & !x & HIGH;
    zeros << (8 * (CHUNK - valid)) != 0
}
