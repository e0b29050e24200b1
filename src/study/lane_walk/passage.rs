//! One walk through one lane.
//!
//! In: a [`Store`], an order. Out: blocks of voxels, with the codes that were asked for.

use std::ops::Range;

use super::CodesRead;
use super::scratch::Scratch;
use super::sort::sorted_tiles;
use super::store::{CHUNK, Mask, Store, has_bit, rank};
use crate::trace::{Array, Trace};
use adjsplat::internals::scatter::BLOCK;
use adjsplat::traverse::{AxisOrder, Batch, Order};
use adjsplat::volume::Axis;

/// Voxels that a batch holds unless a single line has more.
const BATCH: usize = 2_048;
/// Largest distance of a batch's records from its first line's.
const REACH: u64 = 1 << 31;

/// Up to [`BLOCK`] voxels of a batch, as the renderer's first stage takes them.
pub(crate) struct Visited<'a> {
    pub(crate) batch: &'a Batch<'a>,
    /// Which of the batch's voxels.
    pub(crate) block: Range<usize>,
    /// Their codes; zeros for those that are not read.
    pub(crate) values: &'a [u8],
    pub(crate) normals: &'a [u16],
}

impl Visited<'_> {
    /// Each voxel's index in the block, and its place, x, y, z.
    #[inline]
    pub(crate) fn positions(&self, order: &Order) -> impl Iterator<Item = (usize, [u16; 3])> {
        let axes = [order.slow.index(), order.medium.index(), order.fast.index()];
        let batch = self.batch;
        self.block.clone().enumerate().map(move |(index, voxel)| (index, position(axes, batch, voxel)))
    }
}

#[inline(always)]
fn position([slow, medium, fast]: [usize; 3], batch: &Batch, voxel: usize) -> [u16; 3] {
    let mut position = [0; 3];
    (position[slow], position[medium], position[fast]) = (batch.slow, batch.medium[voxel], batch.fast[voxel]);
    position
}

/// Walks `store` in `order`, reading `codes`.
///
/// # Panics
/// If the lane does not run along the order's fast axis, or is not sound.
pub(crate) fn passage<S: Store, T: Trace>(
    store: &S,
    order: &Order,
    codes: CodesRead,
    room: Room,
    trace: &mut T,
    visit: &mut impl FnMut(&Visited),
) {
    assert_eq!(store.axis(), order.fast, "a walk needs the lane along its fast axis");
    Passage::new(store, *order, codes, room, trace).slices(visit);
}

/// Sizes of scratch arrays that do for any lane of a walker, and the number of the first.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    first_array: usize,
    /// Tiles of the lane that has most.
    tiles: usize,
    /// Grid points of the longest axis.
    points: usize,
    edge: usize,
}

/// Numbers of the scratch arrays.
pub(super) struct Numbers {
    pub(super) wanted: usize,
    pub(super) by_column: usize,
    pub(super) sorted: usize,
    pub(super) column_starts: usize,
    pub(super) column_next: usize,
    pub(super) row_starts: usize,
    pub(super) row_next: usize,
    slices: usize,
    lines: usize,
    mediums: usize,
    two_sided: usize,
    batch: usize,
    line: usize,
}

impl Room {
    /// For `lanes`; scratch arrays are numbered from `first_array`.
    pub(crate) fn of<S: Store>(lanes: &[S], first_array: usize) -> Room {
        let most = |of: fn(&S) -> u32| lanes.iter().map(of).max().unwrap_or(0) as usize;
        Room {
            first_array,
            tiles: most(Store::tile_count),
            points: most(|lane| lane.dims().into_iter().max().unwrap_or(0)),
            edge: most(|lane| lane.edge().into()),
        }
    }

    fn numbers(self) -> Numbers {
        let number = |index: usize| self.first_array + index;
        Numbers {
            wanted: number(0),
            by_column: number(1),
            sorted: number(2),
            column_starts: number(3),
            column_next: number(4),
            row_starts: number(5),
            row_next: number(6),
            slices: number(7),
            lines: number(8),
            mediums: number(9),
            two_sided: number(10),
            batch: number(11),
            line: number(14),
        }
    }

    /// Lines of a slice, whole tiles.
    fn lines(self) -> usize {
        self.points.next_multiple_of(self.edge.max(1))
    }

    /// The scratch arrays, by number.
    pub(crate) fn arrays(self) -> [Array; 17] {
        let rows = self.lines() / self.edge.max(1) + 1;
        let (batch, line) = (self.points.max(BATCH) + 2 * CHUNK, self.points + 2 * CHUNK);
        let sizes = [
            ("wanted tiles", 4 * self.tiles),
            ("tiles by column", 4 * self.tiles),
            ("tiles by row", 4 * self.tiles),
            ("starts of columns", 4 * rows),
            ("next of columns", 4 * rows),
            ("starts of rows", 4 * rows),
            ("next of rows", 4 * rows),
            ("slices", 2 * self.points),
            ("lines", size_of::<Line>() * self.lines()),
            ("mediums", 2 * self.lines()),
            ("lines of two sides", size_of::<Line>() * self.lines()),
            ("batch medium", 2 * batch),
            ("batch fast", 2 * batch),
            ("batch record", 4 * batch),
            ("line medium", 2 * line),
            ("line fast", 2 * line),
            ("line record", 4 * line),
        ];
        sizes.map(|(name, bytes)| Array { name, bytes: bytes as u64, scratch: true })
    }
}

/// One line of the slice at hand: as the walk's.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    first_record: u64,
    count: u16,
    medium: u16,
}

/// Coordinates and records of voxels.
struct BatchArrays {
    medium: Scratch<u16>,
    fast: Scratch<u16>,
    record: Scratch<u32>,
}

impl BatchArrays {
    fn new(first_array: usize, len: usize) -> BatchArrays {
        BatchArrays {
            medium: Scratch::new(first_array, len),
            fast: Scratch::new(first_array + 1, len),
            record: Scratch::new(first_array + 2, len),
        }
    }

    /// Tells of a piece of sixteen that is written at once.
    #[inline]
    fn write_piece<T: Trace>(&self, from: usize, trace: &mut T) {
        self.medium.write(from, CHUNK, trace);
        self.fast.write(from, CHUNK, trace);
        self.record.write(from, CHUNK, trace);
    }

    /// Writes one voxel; it `is_told` already where its piece was.
    #[inline]
    fn put<T: Trace>(&mut self, place: usize, medium: u16, (fast, record): (u16, u32), is_told: bool, trace: &mut T) {
        if is_told {
            self.medium.items_mut()[place] = medium;
            self.fast.items_mut()[place] = fast;
            self.record.items_mut()[place] = record;
        } else {
            self.medium.set(place, medium, trace);
            self.fast.set(place, fast, trace);
            self.record.set(place, record, trace);
        }
    }
}

struct Passage<'s, 't, S, T> {
    store: &'s S,
    order: Order,
    codes: CodesRead,
    slow_is_v: bool,
    trace: &'t mut T,
    /// Tiles by row, in each by column, and where rows start.
    sorted: Scratch<u32>,
    starts: Scratch<u32>,
    slices: Scratch<u16>,
    /// Lines of a slice, ascending; and in the order of an axis with two sides.
    lines: Scratch<Line>,
    mediums: Scratch<u16>,
    two_sided: Scratch<Line>,
    batch: BatchArrays,
    line: BatchArrays,
    /// Voxels that a batch has room for.
    capacity: usize,
}

impl<'s, 't, S: Store, T: Trace> Passage<'s, 't, S, T> {
    fn new(store: &'s S, order: Order, codes: CodesRead, room: Room, trace: &'t mut T) -> Self {
        let points = |axis: Axis| store.dims()[axis.index()];
        let across = |axis: Axis| points(axis).div_ceil(store.edge().into()) as usize;
        let slow_is_v = order.slow == store.axis().others()[1];
        let numbers = room.numbers();
        let sides = [across(order.slow), across(order.medium)];
        let (sorted, starts) = sorted_tiles(store, slow_is_v, sides, &numbers, trace);
        // A walk makes a batch's arrays for its own lane.
        let longest = points(store.axis()) as usize;
        let capacity = longest.max(BATCH);
        Passage {
            store,
            order,
            codes,
            slow_is_v,
            trace,
            sorted,
            starts,
            slices: Scratch::new(numbers.slices, points(order.slow) as usize),
            lines: Scratch::new(numbers.lines, room.lines()),
            mediums: Scratch::new(numbers.mediums, room.lines()),
            two_sided: Scratch::new(numbers.two_sided, room.lines()),
            batch: BatchArrays::new(numbers.batch, capacity + 2 * CHUNK),
            line: BatchArrays::new(numbers.line, longest + 2 * CHUNK),
            capacity,
        }
    }

    /// Where the tiles of `row` lie among the sorted ones.
    fn row(&mut self, row: usize) -> Range<usize> {
        self.starts.get(row, self.trace) as usize..self.starts.get(row + 1, self.trace) as usize
    }

    /// Bit in a mask of the line at `medium` of a tile, in its slice `within`.
    #[inline(always)]
    fn bit(&self, within: u16, medium: u16) -> u32 {
        let edge = self.store.edge();
        u32::from(if self.slow_is_v { edge * within + medium } else { edge * medium + within })
    }

    #[inline(always)]
    fn has_lines(&self, mask: &Mask, within: u16) -> bool {
        (0..self.store.edge()).any(|medium| has_bit(mask, self.bit(within, medium)))
    }

    /// Lists the slices that are not empty; how many.
    fn find_slices(&mut self) -> usize {
        let edge = self.store.edge();
        let mut count = 0;
        for row in 0..self.starts.len() - 1 {
            let mut union = Mask::default();
            for item in self.row(row) {
                let mask = self.store.mask(self.sorted.get(item, self.trace), self.trace);
                union.iter_mut().zip(mask).for_each(|(all, bits)| *all |= bits);
            }
            for within in 0..edge {
                if self.has_lines(&union, within) && count < self.slices.len() {
                    let slice = u16::try_from(row).unwrap_or(u16::MAX).saturating_mul(edge) + within;
                    self.slices.set(count, slice, self.trace);
                    count += 1;
                }
            }
        }
        count
    }

    /// Visits every slice in the slow order.
    fn slices(&mut self, visit: &mut impl FnMut(&Visited)) {
        let count = self.find_slices();
        let numbers = self.slices.items()[..count].to_vec();
        let along = |axis: Axis| self.order.along[axis.index()];
        let (slow_order, medium_order) = (along(self.order.slow), along(self.order.medium));
        let is_two_sided = matches!(medium_order, AxisOrder::TwoSided { .. });
        slow_order.for_each_index(&numbers, |index| {
            let slow = self.slices.get(index, self.trace);
            let count = self.gather(slow);
            match medium_order {
                AxisOrder::Ascending => {}
                AxisOrder::Descending => self.reverse_lines(count),
                AxisOrder::TwoSided { .. } => self.part_lines(medium_order, count),
            }
            let mut first = 0;
            while first < count {
                let lines = if is_two_sided { &self.two_sided } else { &self.lines };
                let (end, base) = group(lines, first, count, self.capacity, self.trace);
                self.decode(first..end, is_two_sided, base, slow, visit);
                first = end;
            }
        });
    }

    fn reverse_lines(&mut self, count: usize) {
        for low in 0..count / 2 {
            let high = count - 1 - low;
            let (a, b) = (self.lines.get(low, self.trace), self.lines.get(high, self.trace));
            self.lines.set(low, b, self.trace);
            self.lines.set(high, a, self.trace);
        }
    }

    /// Puts the lines in an order of two sides.
    fn part_lines(&mut self, sides: AxisOrder, count: usize) {
        for item in 0..count {
            let line = self.lines.get(item, self.trace);
            self.mediums.set(item, line.medium, self.trace);
        }
        let mut to = 0;
        sides.for_each_index(&self.mediums.items()[..count], |from| {
            let line = self.lines.get(from, self.trace);
            self.two_sided.set(to, line, self.trace);
            to += 1;
        });
    }

    /// Lists the lines of slice `slow`, ascending; how many.
    fn gather(&mut self, slow: u16) -> usize {
        let edge = self.store.edge();
        let within = slow % edge;
        let longest = u64::from(self.store.dims()[self.store.axis().index()]);
        let record_count = self.store.record_count();
        let mut count = 0;
        for item in self.row(usize::from(slow / edge)) {
            let tile = self.sorted.get(item, self.trace);
            let mask = self.store.mask(tile, self.trace);
            if !self.has_lines(&mask, within) {
                continue;
            }
            // Whether the row is wanted, and where its lines and records lie.
            let start = self.store.start(tile, self.trace);
            let first_medium = edge.wrapping_mul(start.place[usize::from(!self.slow_is_v)]);
            for medium in 0..edge {
                let bit = self.bit(within, medium);
                if !has_bit(&mask, bit) {
                    continue;
                }
                let Some([first, end]) = self.store.line(tile, &start, rank(&mask, bit), self.trace) else { break };
                let records = end.wrapping_sub(first);
                #[allow(clippy::cast_possible_truncation, reason = "only kept if it is at most 65,535")]
                let line = Line {
                    first_record: start.first_record + first,
                    count: records as u16,
                    medium: first_medium.wrapping_add(medium),
                };
                self.lines.set(count, line, self.trace);
                let is_sound = records.wrapping_sub(1) < longest && start.first_record + end <= record_count;
                count += usize::from(is_sound);
            }
        }
        count
    }

    /// Decodes lines of slice `slow` and hands their voxels over.
    fn decode(
        &mut self,
        lines: Range<usize>,
        is_two_sided: bool,
        base: u64,
        slow: u16,
        visit: &mut impl FnMut(&Visited),
    ) {
        let list = if is_two_sided { &self.two_sided } else { &self.lines };
        let (store, trace) = (self.store, &mut *self.trace);
        let range = match self.order.along[self.order.fast.index()] {
            AxisOrder::Ascending => {
                let mut end = CHUNK;
                for item in lines {
                    end = decode_up(store, list.get(item, trace), base, &mut self.batch, end, trace);
                }
                CHUNK..end
            }
            AxisOrder::Descending => {
                let top = CHUNK + self.capacity;
                let mut start = top;
                for item in lines.rev() {
                    start = decode_down(store, list.get(item, trace), base, &mut self.batch, start, trace);
                }
                start..top
            }
            sides @ AxisOrder::TwoSided { .. } => {
                let mut end = CHUNK;
                for item in lines {
                    let line = list.get(item, trace);
                    let line_end = decode_up(store, line, base, &mut self.line, CHUNK, trace);
                    let coordinates = self.line.fast.items()[CHUNK..line_end].to_vec();
                    sides.for_each_index(&coordinates, |index| {
                        self.batch.medium.set(end, line.medium, trace);
                        let fast = self.line.fast.get(CHUNK + index, trace);
                        self.batch.fast.set(end, fast, trace);
                        let record = self.line.record.get(CHUNK + index, trace);
                        self.batch.record.set(end, record, trace);
                        end += 1;
                    });
                }
                CHUNK..end
            }
        };
        self.hand_over(range, base, slow, visit);
    }

    /// Reads the voxels in `range` of the batch as the renderer's first stage does, a block at a time.
    fn hand_over(&mut self, range: Range<usize>, base: u64, slow: u16, visit: &mut impl FnMut(&Visited)) {
        let BatchArrays { medium, fast, record } = &self.batch;
        let items = (&medium.items()[range.clone()], &fast.items()[range.clone()], &record.items()[range.clone()]);
        let batch = Batch { slow, medium: items.0, fast: items.1, record: items.2, base };
        let axes = [self.order.slow.index(), self.order.medium.index(), self.order.fast.index()];
        let (mut values, mut normals) = ([0; BLOCK], [0; BLOCK]);
        for from in (0..batch.len()).step_by(BLOCK) {
            let block = from..batch.len().min(from + BLOCK);
            medium.read(range.start + from, block.len(), self.trace);
            fast.read(range.start + from, block.len(), self.trace);
            if self.codes >= CodesRead::Values {
                for voxel in block.clone() {
                    record.read(range.start + voxel, 1, self.trace);
                    let place = position(axes, &batch, voxel);
                    values[voxel - from] = self.store.value(place, batch.record_index(voxel), self.trace);
                }
            }
            if self.codes >= CodesRead::ValuesAndNormals {
                for voxel in block.clone() {
                    record.read(range.start + voxel, 1, self.trace);
                    let place = position(axes, &batch, voxel);
                    normals[voxel - from] = self.store.normal(place, batch.record_index(voxel), self.trace);
                }
            }
            let count = block.len();
            visit(&Visited { batch: &batch, block, values: &values[..count], normals: &normals[..count] });
        }
    }
}

/// The first group of the lines `first..count`: its end and its base.
#[inline]
fn group<T: Trace>(lines: &Scratch<Line>, first: usize, count: usize, capacity: usize, trace: &mut T) -> (usize, u64) {
    let base = lines.get(first, trace).first_record.saturating_sub(REACH);
    let mut records = 0;
    let mut end = first;
    while end < count {
        let line = lines.get(end, trace);
        let more = records + u64::from(line.count);
        let is_near = line.first_record.wrapping_sub(base) < 2 * REACH - u64::from(u16::MAX);
        if end > first && (more > capacity as u64 || !is_near) {
            break;
        }
        records = more;
        end += 1;
    }
    (end, base)
}

/// Up to sixteen voxels that follow each other on a line: coordinate and record from the base.
struct Piece {
    voxels: [(u16, u32); CHUNK],
    count: usize,
    /// Whether they were decoded at once: there are no stepping voxels among them.
    at_once: bool,
}

/// Calls `take` with the voxels of a line, sixteen records at a time.
#[inline]
fn pieces<S: Store, T: Trace>(store: &S, line: Line, base: u64, trace: &mut T, mut take: impl FnMut(&Piece, &mut T)) {
    let from = usize::try_from(line.first_record).expect("a sound line lies in memory");
    let count = usize::from(line.count);
    let mut previous = u16::MAX;
    for done in (0..count).step_by(CHUNK) {
        let steps = store.steps(from + done, trace);
        let valid = CHUNK.min(count - done);
        let mut piece = Piece { voxels: [(0, 0); CHUNK], count: 0, at_once: false };
        let first = line.first_record + done as u64 - base;
        for (offset, &step) in (first..).zip(&steps[..valid]) {
            previous = previous.wrapping_add(if step == 0 { 255 } else { u16::from(step) });
            let offset = u32::try_from(offset).expect("lines of a group lie near its base");
            piece.voxels[piece.count] = (previous, offset);
            piece.count += usize::from(step != 0);
        }
        piece.at_once = piece.count == valid;
        take(&piece, trace);
    }
}

/// Writes a line's voxels, ascending, from `at` up; gives the end.
fn decode_up<S: Store, T: Trace>(
    store: &S,
    line: Line,
    base: u64,
    out: &mut BatchArrays,
    at: usize,
    trace: &mut T,
) -> usize {
    let mut end = at;
    pieces(store, line, base, trace, |piece, trace| {
        if piece.at_once {
            out.write_piece(end, trace);
        }
        for &voxel in &piece.voxels[..piece.count] {
            out.put(end, line.medium, voxel, piece.at_once, trace);
            end += 1;
        }
    });
    end
}

/// Writes a line's voxels, descending, below `at`; gives the start.
fn decode_down<S: Store, T: Trace>(
    store: &S,
    line: Line,
    base: u64,
    out: &mut BatchArrays,
    at: usize,
    trace: &mut T,
) -> usize {
    let mut start = at;
    pieces(store, line, base, trace, |piece, trace| {
        if piece.at_once {
            out.write_piece(start - CHUNK, trace);
        }
        for &voxel in &piece.voxels[..piece.count] {
            start -= 1;
            out.put(start, line.medium, voxel, piece.at_once, trace);
        }
    });
    start
}
