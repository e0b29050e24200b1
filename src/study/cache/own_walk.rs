//! Our own walk, access by access.
//!
//! In: the lanes along x, y and z, and a trace. Out: the voxels that [`crate::traverse::walk()`] visits, in the same
//! batches, while the trace is told of what that walk reads and writes, in the same sequence, and of what the renderer's
//! first stage reads of each batch.
//!
//! This is the walk's plain twin. The walk itself tells only its pager, and that in pieces which are too coarse for a
//! cache: all channels of a line at once, all ends of a tile. tests/study holds the two together: the same batches, the
//! same tiles, ends and lines in the same sequence as the walk tells its pager.
//!
//! ```text
//! tiles of the face -> two counting sorts by column and row        traverse/tiles.rs
//! slice: its tiles -> its lines, from their ends                   traverse/gather.rs
//! group of lines: sixteen steps at a time -> batch                 traverse/decode.rs
//! batch, 128 voxels at a time: coordinates; values; normals        splat/cpu/project.rs
//! ```
//!
//! Not told: what stays in registers, where an axis with two sides looks for the eye, and the copies of a vector that
//! grows (it is as if each had its room from the start).

use super::scratch::Scratch;
use crate::arena::layout::TILE_EDGE;
use crate::arena::{Lane, LineEnds, TileRecord};
use crate::splat::cpu::raster::BLOCK;
use crate::study::baselines::{Normal, Receiver, Viewing, Walker};
use crate::study::trace::{Array, Trace};
use crate::traverse::{AxisOrder, Batch, Order};
use crate::volume::Axis;

/// What is read of a voxel's codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum CodesRead {
    /// None: coordinates alone.
    Nothing,
    /// Its value.
    Values,
    /// Its value and its normal.
    ValuesAndNormals,
}

/// Our lanes as a [`Walker`].
#[derive(Debug, Clone)]
pub struct OwnWalk<'a> {
    /// Along x, y and z; without patches.
    lanes: [Lane<'a>; 3],
    codes: CodesRead,
}

/// Steps that are read at once, and the margin of a batch's arrays.
const CHUNK: usize = 16;
/// Voxels that a batch holds unless a single line has more.
const BATCH: usize = 2_048;
/// Largest distance of a batch's records from its first line's.
const REACH: u64 = 1 << 31;

/// Arrays of a lane, by their place among its five.
const TILES: usize = 0;
const LINE_ENDS: usize = 1;
const STEPS: usize = 2;
const VALUES: usize = 3;
const NORMALS: usize = 4;
const OF_A_LANE: usize = 5;
const NAMES: [[&str; OF_A_LANE]; 3] = [
    ["tiles x", "line ends x", "steps x", "values x", "normals x"],
    ["tiles y", "line ends y", "steps y", "values y", "normals y"],
    ["tiles z", "line ends z", "steps z", "values z", "normals z"],
];

/// Number of the first array that holds nothing between walks, then each by what it is for.
const SCRATCH: usize = 3 * OF_A_LANE;
const WANTED: usize = SCRATCH;
const BY_COLUMN: usize = SCRATCH + 1;
const SORTED: usize = SCRATCH + 2;
const COLUMN_STARTS: usize = SCRATCH + 3;
const COLUMN_NEXT: usize = SCRATCH + 4;
const ROW_STARTS: usize = SCRATCH + 5;
const ROW_NEXT: usize = SCRATCH + 6;
const SLICES: usize = SCRATCH + 7;
const LINES: usize = SCRATCH + 8;
const MEDIUMS: usize = SCRATCH + 9;
const TWO_SIDED: usize = SCRATCH + 10;
const BATCH_ARRAYS: usize = SCRATCH + 11;
const LINE_ARRAYS: usize = SCRATCH + 14;

impl<'a> OwnWalk<'a> {
    /// Of lanes along x, y and z, of which a voxel's `codes` are read as it is visited.
    ///
    /// # Panics
    /// If the lanes run along other axes, or have patches.
    pub fn new(lanes: [Lane<'a>; 3], codes: CodesRead) -> OwnWalk<'a> {
        assert!(lanes.iter().map(|lane| lane.axis).eq(Axis::ALL) && lanes.iter().all(|lane| lane.patch.is_none()));
        OwnWalk { lanes, codes }
    }

    /// Walks in `order`, handing over batches as the walk does.
    pub fn walk_batches<T: Trace>(&self, order: &Order, trace: &mut T, visit: &mut impl FnMut(&Batch)) {
        let lane = self.lanes[order.fast.index()];
        let mut passage = Passage::new(lane, *order, self.codes, self.room(), trace);
        passage.slices(visit);
    }

    /// Elements that the scratch arrays have room for, on any lane.
    fn room(&self) -> Room {
        let longest = |lane: &Lane| lane.dims.into_iter().max().unwrap_or(0) as usize;
        Room {
            tiles: self.lanes.iter().map(|lane| lane.tiles.len()).max().unwrap_or(0),
            points: self.lanes.iter().map(longest).max().unwrap_or(0),
        }
    }
}

/// Sizes of scratch arrays.
#[derive(Debug, Clone, Copy)]
struct Room {
    /// Tiles of the lane that has most.
    tiles: usize,
    /// Grid points of the longest axis.
    points: usize,
}

impl Room {
    /// Lines of a slice, whole tiles.
    fn lines(self) -> usize {
        self.points.next_multiple_of(usize::from(TILE_EDGE))
    }

    fn batch(self) -> usize {
        self.points.max(BATCH) + 2 * CHUNK
    }
}

impl Walker for OwnWalk<'_> {
    fn method(&self) -> &'static str {
        "adjsplat"
    }

    fn arrays(&self) -> Vec<Array> {
        let mut arrays = Vec::new();
        for (lane, names) in self.lanes.iter().zip(NAMES) {
            let sizes = [
                size_of_val(lane.tiles),
                lane.line_ends.len() * end_bytes(lane),
                lane.steps.len(),
                lane.values.len(),
                lane.normals.len(),
            ];
            arrays.extend(names.into_iter().zip(sizes).map(|(name, bytes)| Array {
                name,
                bytes: bytes as u64,
                scratch: false,
            }));
        }
        let room = self.room();
        let rows = room.lines() / usize::from(TILE_EDGE) + 1;
        let (batch, line) = (room.batch(), room.points + 2 * CHUNK);
        let scratch: [(&str, usize); 17] = [
            ("wanted tiles", 4 * room.tiles),
            ("tiles by column", 4 * room.tiles),
            ("tiles by row", 4 * room.tiles),
            ("starts of columns", 4 * rows),
            ("next of columns", 4 * rows),
            ("starts of rows", 4 * rows),
            ("next of rows", 4 * rows),
            ("slices", 2 * room.points),
            ("lines", size_of::<Line>() * room.lines()),
            ("mediums", 2 * room.lines()),
            ("lines of two sides", size_of::<Line>() * room.lines()),
            ("batch medium", 2 * batch),
            ("batch fast", 2 * batch),
            ("batch record", 4 * batch),
            ("line medium", 2 * line),
            ("line fast", 2 * line),
            ("line record", 4 * line),
        ];
        arrays.extend(scratch.map(|(name, bytes)| Array { name, bytes: bytes as u64, scratch: true }));
        arrays
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let lane = self.lanes[order.fast.index()];
        let axes = [order.slow.index(), order.medium.index(), order.fast.index()];
        self.walk_batches(order, trace, &mut |batch| {
            for index in 0..batch.len() {
                let mut position = [0; 3];
                for (axis, at) in axes.into_iter().zip([batch.slow, batch.medium[index], batch.fast[index]]) {
                    position[axis] = at;
                }
                let record = batch.record_index(index);
                // A subject's codes are of 8 and 2 x 8 bits.
                let value = u8::try_from(lane.value_code(record)).unwrap_or(u8::MAX);
                let normal = u16::try_from(lane.normal_code(record)).unwrap_or(0);
                receiver.voxel(position, value, Normal::Code(normal));
            }
        });
    }
}

fn end_bytes(lane: &Lane) -> usize {
    match lane.line_ends {
        LineEnds::Narrow(_) => 2,
        LineEnds::Wide(_) => 4,
    }
}

/// One line of the slice at hand: as the walk's.
#[derive(Debug, Clone, Copy, Default)]
struct Line {
    first_record: u64,
    count: u16,
    medium: u16,
}

/// One walk through one lane.
struct Passage<'a, 't, T> {
    lane: Lane<'a>,
    order: Order,
    codes: CodesRead,
    slow_is_v: bool,
    /// Number of the lane's first array.
    arrays: usize,
    trace: &'t mut T,
    /// Tiles by row, in each by column, and where rows start.
    sorted: Scratch<u32>,
    starts: Scratch<u32>,
    /// Lines of a slice, ascending; and in the order of an axis with two sides.
    lines: Scratch<Line>,
    mediums: Scratch<u16>,
    two_sided: Scratch<Line>,
    batch: BatchArrays,
    line: BatchArrays,
    /// Voxels that a batch has room for.
    capacity: usize,
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
}

/// Bytes of fields of a tile record: where, and how many.
const PLACE: (usize, usize) = (0, 4);
const OCCUPANCY: (usize, usize) = (16, 8);
const EXTENT: (usize, usize) = (24, 4);
const WHOLE: (usize, usize) = (0, size_of::<TileRecord>());

impl<'a, 't, T: Trace> Passage<'a, 't, T> {
    fn new(lane: Lane<'a>, order: Order, codes: CodesRead, room: Room, trace: &'t mut T) -> Self {
        // A walk makes a batch's arrays for its own lane.
        let longest = lane.dims[lane.axis.index()] as usize;
        let mut passage = Passage {
            lane,
            order,
            codes,
            slow_is_v: order.slow == lane.axis.others()[1],
            arrays: OF_A_LANE * lane.axis.index(),
            trace,
            sorted: Scratch::new(SORTED, 0),
            starts: Scratch::new(ROW_STARTS, 0),
            lines: Scratch::new(LINES, room.lines()),
            mediums: Scratch::new(MEDIUMS, room.lines()),
            two_sided: Scratch::new(TWO_SIDED, room.lines()),
            batch: BatchArrays::new(BATCH_ARRAYS, longest.max(BATCH) + 2 * CHUNK),
            line: BatchArrays::new(LINE_ARRAYS, longest + 2 * CHUNK),
            capacity: longest.max(BATCH),
        };
        passage.sort_tiles();
        passage
    }

    /// The tile at `index`, of which `(offset, bytes)` is read.
    fn tile(&mut self, index: u32, (offset, bytes): (usize, usize)) -> &'a TileRecord {
        let index = index as usize;
        self.trace.read(self.arrays + TILES, index * size_of::<TileRecord>() + offset, bytes);
        &self.lane.tiles[index]
    }

    /// Row and column of a tile.
    fn place(&self, tile: &TileRecord) -> (usize, usize) {
        let (u, v) = (usize::from(tile.tile_u.get()), usize::from(tile.tile_v.get()));
        if self.slow_is_v { (v, u) } else { (u, v) }
    }

    /// Tiles by row and column: two counting sorts.
    fn sort_tiles(&mut self) {
        let across = |axis: Axis| self.lane.dims[axis.index()].div_ceil(u32::from(TILE_EDGE)) as usize;
        let (rows, columns) = (across(self.order.slow), across(self.order.medium));
        let mut wanted = Scratch::new(WANTED, self.lane.tiles.len());
        let mut count = 0;
        for index in 0..u32::try_from(self.lane.tiles.len()).expect("a face has fewer than 2^32 tiles") {
            let tile = self.tile(index, PLACE);
            self.tile(index, EXTENT);
            let (row, column) = self.place(tile);
            if row < rows && column < columns {
                wanted.set(count, index, self.trace);
                count += 1;
            }
        }
        let (by_column, _) =
            self.counting_sort(&wanted, count, columns, [COLUMN_STARTS, COLUMN_NEXT, BY_COLUMN], |p| p.1);
        (self.sorted, self.starts) =
            self.counting_sort(&by_column, count, rows, [ROW_STARTS, ROW_NEXT, SORTED], |p| p.0);
    }

    /// The first `count` of `tiles` by a key below `keys`; and where each key's start. Uses three arrays by number.
    fn counting_sort(
        &mut self,
        tiles: &Scratch<u32>,
        count: usize,
        keys: usize,
        [starts, next, sorted]: [usize; 3],
        key: impl Fn((usize, usize)) -> usize,
    ) -> (Scratch<u32>, Scratch<u32>) {
        let (mut starts, mut next) = (Scratch::new(starts, keys + 1), Scratch::new(next, keys + 1));
        let mut sorted = Scratch::new(sorted, count);
        for item in 0..count {
            let index = tiles.get(item, self.trace);
            let tile = self.tile(index, PLACE);
            let slot = key(self.place(tile)) + 1;
            let more = starts.get(slot, self.trace) + 1;
            starts.set(slot, more, self.trace);
        }
        for slot in 0..keys {
            let sum = starts.get(slot, self.trace) + starts.get(slot + 1, self.trace);
            starts.set(slot + 1, sum, self.trace);
        }
        for slot in 0..=keys {
            let start = starts.get(slot, self.trace);
            next.set(slot, start, self.trace);
        }
        for item in 0..count {
            let index = tiles.get(item, self.trace);
            let tile = self.tile(index, PLACE);
            let slot = key(self.place(tile));
            let at = next.get(slot, self.trace);
            sorted.set(at as usize, index, self.trace);
            next.set(slot, at + 1, self.trace);
        }
        (sorted, starts)
    }

    /// Where the tiles of `row` lie among the sorted ones.
    fn row(&mut self, row: usize) -> std::ops::Range<usize> {
        self.starts.get(row, self.trace) as usize..self.starts.get(row + 1, self.trace) as usize
    }

    /// Every slice in the slow order.
    fn slices(&mut self, visit: &mut impl FnMut(&Batch)) {
        let mut slices = Scratch::new(SLICES, self.lane.dims[self.order.slow.index()] as usize);
        let mut count = 0;
        for row in 0..self.starts.len() - 1 {
            let mut union = 0;
            for item in self.row(row) {
                let index = self.sorted.get(item, self.trace);
                union |= self.tile(index, OCCUPANCY).occupancy.get();
            }
            for within in 0..TILE_EDGE {
                if self.mediums_of(union, within).next().is_some() && count < slices.len() {
                    slices.set(
                        count,
                        u16::try_from(row).unwrap_or(u16::MAX).saturating_mul(TILE_EDGE) + within,
                        self.trace,
                    );
                    count += 1;
                }
            }
        }
        let numbers = slices.items()[..count].to_vec();
        let mut budget = self.lane.record_count();
        let along = |axis: Axis| self.order.along[axis.index()];
        let (slow_order, medium_order) = (along(self.order.slow), along(self.order.medium));
        slow_order.for_each_index(&numbers, |index| {
            let slow = slices.get(index, self.trace);
            let count = self.gather(slow);
            let is_two_sided = matches!(medium_order, AxisOrder::TwoSided { .. });
            match medium_order {
                AxisOrder::Ascending => {}
                AxisOrder::Descending => {
                    for low in 0..count / 2 {
                        let (a, b) = (self.lines.get(low, self.trace), self.lines.get(count - 1 - low, self.trace));
                        self.lines.set(low, b, self.trace);
                        self.lines.set(count - 1 - low, a, self.trace);
                    }
                }
                AxisOrder::TwoSided { .. } => {
                    for item in 0..count {
                        let line = self.lines.get(item, self.trace);
                        self.mediums.set(item, line.medium, self.trace);
                    }
                    let mut to = 0;
                    medium_order.for_each_index(&self.mediums.items()[..count], |from| {
                        let line = self.lines.get(from, self.trace);
                        self.two_sided.set(to, line, self.trace);
                        to += 1;
                    });
                }
            }
            let mut first = 0;
            while first < count {
                let lines = if is_two_sided { &self.two_sided } else { &self.lines };
                let (end, base, records) = group(lines, first, count, self.capacity, self.trace);
                let Some(left) = budget.checked_sub(records) else { return };
                budget = left;
                self.decode(first..end, is_two_sided, base, slow, visit);
                first = end;
            }
        });
    }

    /// Medium coordinates within a tile whose mask is `occupied`, of its lines in slice `within`, and their bits.
    fn mediums_of(&self, occupied: u64, within: u16) -> impl Iterator<Item = (u16, u32)> + use<T> {
        let slow_is_v = self.slow_is_v;
        (0..TILE_EDGE)
            .map(move |medium| (medium, u32::from(if slow_is_v { 8 * within + medium } else { 8 * medium + within })))
            .filter(move |(_, bit)| occupied >> bit & 1 == 1)
    }

    /// Lists the lines of slice `slow`, ascending; how many.
    fn gather(&mut self, slow: u16) -> usize {
        let (record_count, longest) = (self.lane.record_count(), u64::from(self.lane.dims[self.lane.axis.index()]));
        let mut count = 0;
        for item in self.row(usize::from(slow / TILE_EDGE)) {
            let index = self.sorted.get(item, self.trace);
            let occupied = self.tile(index, OCCUPANCY).occupancy.get();
            let within = slow % TILE_EDGE;
            if self.mediums_of(occupied, within).next().is_none() {
                continue;
            }
            // Whether the row is wanted, and where its lines and records lie.
            let tile = self.tile(index, WHOLE);
            let first_record = tile.first_record.get();
            let Some(records) = record_count.checked_sub(first_record) else { continue };
            let first_medium = TILE_EDGE.wrapping_mul(u16::try_from(self.place(tile).1).unwrap_or(u16::MAX));
            for (medium, bit) in self.mediums_of(occupied, within) {
                let rank = (occupied & ((1 << bit) - 1)).count_ones() as usize;
                let number = (tile.first_line.get() as usize).wrapping_add(rank);
                let Some(end) = self.line_end(number) else { break };
                let start = if rank == 0 { 0 } else { self.line_end(number.wrapping_sub(1)).unwrap_or(end) };
                let (start, end) = (u64::from(start), u64::from(end));
                let line_records = end.wrapping_sub(start);
                #[allow(clippy::cast_possible_truncation, reason = "only kept if it is at most 65,535")]
                let line = Line {
                    first_record: first_record + start,
                    count: line_records as u16,
                    medium: first_medium.wrapping_add(medium),
                };
                self.lines.set(count, line, self.trace);
                count += usize::from(line_records.wrapping_sub(1) < longest && end <= records);
            }
        }
        count
    }

    fn line_end(&mut self, line: usize) -> Option<u32> {
        let end = self.lane.line_end(line)?;
        let bytes = end_bytes(&self.lane);
        self.trace.read(self.arrays + LINE_ENDS, line * bytes, bytes);
        Some(end)
    }

    /// Decodes lines of slice `slow` and hands them over.
    fn decode(
        &mut self,
        lines: std::ops::Range<usize>,
        is_two_sided: bool,
        base: u64,
        slow: u16,
        visit: &mut impl FnMut(&Batch),
    ) {
        let list = if is_two_sided { &self.two_sided } else { &self.lines };
        let steps = Steps { lane: &self.lane, array: self.arrays + STEPS, base };
        let range = match self.order.along[self.order.fast.index()] {
            AxisOrder::Ascending => {
                let mut end = CHUNK;
                for item in lines {
                    end = steps.decode_up(list.get(item, self.trace), &mut self.batch, end, self.trace);
                }
                CHUNK..end
            }
            AxisOrder::Descending => {
                let top = CHUNK + self.capacity;
                let mut start = top;
                for item in lines.rev() {
                    start = steps.decode_down(list.get(item, self.trace), &mut self.batch, start, self.trace);
                }
                start..top
            }
            sides @ AxisOrder::TwoSided { .. } => {
                let mut end = CHUNK;
                for item in lines {
                    let line = list.get(item, self.trace);
                    let line_end = steps.decode_up(line, &mut self.line, CHUNK, self.trace);
                    let coordinates = self.line.fast.items()[CHUNK..line_end].to_vec();
                    sides.for_each_index(&coordinates, |index| {
                        self.batch.medium.set(end, line.medium, self.trace);
                        let fast = self.line.fast.get(CHUNK + index, self.trace);
                        self.batch.fast.set(end, fast, self.trace);
                        let record = self.line.record.get(CHUNK + index, self.trace);
                        self.batch.record.set(end, record, self.trace);
                        end += 1;
                    });
                }
                CHUNK..end
            }
        };
        if range.is_empty() {
            return;
        }
        let batch = Batch {
            slow,
            medium: &self.batch.medium.items()[range.clone()],
            fast: &self.batch.fast.items()[range.clone()],
            record: &self.batch.record.items()[range.clone()],
            base,
        };
        visit(&batch);
        self.batch.be_read(&self.lane, base, range, self.codes, self.arrays, self.trace);
    }
}

impl BatchArrays {
    /// Tells what the renderer's first stage reads of the voxels in `range`, a block at a time.
    fn be_read<T: Trace>(
        &self,
        lane: &Lane,
        base: u64,
        range: std::ops::Range<usize>,
        codes: CodesRead,
        arrays: usize,
        trace: &mut T,
    ) {
        for from in range.clone().step_by(BLOCK) {
            let count = BLOCK.min(range.end - from);
            self.medium.read(from, count, trace);
            self.fast.read(from, count, trace);
            let channels = [
                (CodesRead::Values, VALUES, usize::from(lane.channels.value_bits / 8)),
                (CodesRead::ValuesAndNormals, NORMALS, usize::from(lane.channels.normal_bits / 4)),
            ];
            for (needs, array, bytes) in channels {
                if codes >= needs && bytes > 0 {
                    for index in from..from + count {
                        let record = base + u64::from(self.record.get(index, trace));
                        let record = usize::try_from(record).expect("records of a sound line lie in memory");
                        trace.read(arrays + array, record * bytes, bytes);
                    }
                }
            }
        }
    }
}

/// The first group of the lines `first..count`: its end, its base and its records.
fn group<T: Trace>(
    lines: &Scratch<Line>,
    first: usize,
    count: usize,
    capacity: usize,
    trace: &mut T,
) -> (usize, u64, u64) {
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
    (end, base, records)
}

/// The steps of a lane, as they are read.
struct Steps<'a> {
    lane: &'a Lane<'a>,
    /// Number of the array.
    array: usize,
    base: u64,
}

impl Steps<'_> {
    /// A line's voxels in pieces of up to sixteen, and whether a piece was decoded at once: without stepping voxels.
    fn pieces<T: Trace>(&self, line: Line, trace: &mut T, mut piece: impl FnMut(&[(u16, u32)], bool, &mut T)) {
        let from = usize::try_from(line.first_record).expect("a sound line lies in memory");
        let count = usize::from(line.count);
        let mut previous = u16::MAX;
        for done in (0..count).step_by(CHUNK) {
            let at = from + done;
            let steps = &self.lane.steps[at..(at + CHUNK).min(self.lane.steps.len())];
            trace.read(self.array, at, steps.len());
            let mut voxels = Vec::with_capacity(CHUNK);
            for (record, &step) in (line.first_record + done as u64..).zip(&steps[..CHUNK.min(count - done)]) {
                previous = previous.wrapping_add(if step == 0 { 255 } else { u16::from(step) });
                if step != 0 {
                    let offset = u32::try_from(record - self.base).expect("lines of a group lie near its base");
                    voxels.push((previous, offset));
                }
            }
            let at_once = voxels.len() == CHUNK.min(count - done);
            piece(&voxels, at_once, trace);
        }
    }

    /// Writes a line's voxels, ascending, from `at` up; gives the end.
    fn decode_up<T: Trace>(&self, line: Line, out: &mut BatchArrays, at: usize, trace: &mut T) -> usize {
        let mut end = at;
        self.pieces(line, trace, |voxels, at_once, trace| {
            if at_once {
                out.medium.write(end, CHUNK, trace);
                out.fast.write(end, CHUNK, trace);
                out.record.write(end, CHUNK, trace);
            }
            for (place, &(fast, record)) in (end..).zip(voxels) {
                out.put(place, line.medium, fast, record, at_once, trace);
            }
            end += voxels.len();
        });
        end
    }

    /// Writes a line's voxels, descending, below `at`; gives the start.
    fn decode_down<T: Trace>(&self, line: Line, out: &mut BatchArrays, at: usize, trace: &mut T) -> usize {
        let mut start = at;
        self.pieces(line, trace, |voxels, at_once, trace| {
            if at_once {
                out.medium.write(start - CHUNK, CHUNK, trace);
                out.fast.write(start - CHUNK, CHUNK, trace);
                out.record.write(start - CHUNK, CHUNK, trace);
            }
            for &(fast, record) in voxels {
                start -= 1;
                out.put(start, line.medium, fast, record, at_once, trace);
            }
        });
        start
    }
}

impl BatchArrays {
    /// Writes one voxel; told unless it was, with its piece.
    fn put<T: Trace>(&mut self, place: usize, medium: u16, fast: u16, record: u32, is_told: bool, trace: &mut T) {
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
