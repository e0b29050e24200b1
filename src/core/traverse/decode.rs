//! Decoding: from the steps of lines to the coordinates and records of a batch.
//!
//! In: lines of one slice in medium order, all inside the channels. Out: a [`Batch`], each line in fast order. The
//! module [`super::walk`] lists the departures for speed.

use std::ops::Range;

use multiversion::multiversion;

use super::order::{AxisOrder, Sense};
use super::sides::Sides;
use super::simd::{CHUNK, LineChunk, prefix_sum, reversed, zero_steps};
use super::slice_lines::SliceLine;
use super::walk::Batch;
use crate::arena::{Lane, VisibleCodes};

/// Largest number of voxels in a batch, unless a single line has more.
const BATCH: usize = 2_048;
/// Largest distance, in records, of a batch's records from those of its first line.
const REACH: u64 = 1 << 31;

/// How many consecutive lines fit in one batch, and their number of records.
pub(super) struct LineGroup {
    pub(super) line_count: usize,
    pub(super) records: u64,
    /// Record index that is [`REACH`] below the first line's; offsets from it fit in 32 bits, also for earlier records.
    pub(super) base: u64,
}

/// Largest number of blocks of [`MAPPED_RECORDS`] records, in each channel, over which a group's lines may spread.
const MOST_BLOCKS: u64 = 2;
/// Number of records in the smallest block of a file that a system maps at once, at one byte per record.
const MAPPED_RECORDS: u64 = 1 << 16;

impl LineGroup {
    /// Shortens this group of the first of `lines`. The pager (which is told what is about to be read) is then told of
    /// at most 24 blocks at once, in channels of up to 8 bytes per record ([`crate::arena::pager::in_flight`]).
    pub(super) fn stay_near(&mut self, lines: &[SliceLine]) {
        let (mut blocks, mut last, mut records) = (0, None, 0);
        for (index, line) in lines[..self.line_count].iter().enumerate() {
            let (first, end) =
                (line.first_record / MAPPED_RECORDS, (line.first_record + u64::from(line.count) - 1) / MAPPED_RECORDS);
            blocks += end - first + u64::from(last != Some(first));
            if index > 0 && blocks > MOST_BLOCKS {
                (self.line_count, self.records) = (index, records);
                return;
            }
            (last, records) = (Some(end), records + u64::from(line.count));
        }
    }
}

/// Returns a group of the first of `lines` (at least one line), with at most `capacity` records.
#[inline(always)]
pub(super) fn group(lines: &[SliceLine], capacity: usize) -> LineGroup {
    let base = lines[0].first_record.saturating_sub(REACH);
    let mut records = 0;
    let mut line_count = 0;
    for line in lines {
        let more = records + u64::from(line.count);
        let is_near = line.first_record.wrapping_sub(base) < 2 * REACH - u64::from(u16::MAX);
        if line_count > 0 && (more > capacity as u64 || !is_near) {
            break;
        }
        records = more;
        line_count += 1;
    }
    LineGroup { line_count, records, base }
}

impl SliceLine {
    /// Returns the indices of the records that decoding reads: the last sixteen steps may reach beyond the line.
    pub(super) fn records_read(&self) -> std::ops::Range<usize> {
        let start = usize::try_from(self.first_record).unwrap_or(usize::MAX);
        start..start.saturating_add(usize::from(self.count) + CHUNK)
    }
}

/// The arrays of a batch, all of equal length, with space for one chunk (sixteen voxels) at each end.
struct DecodeBuffer {
    medium: Vec<u16>,
    fast: Vec<u16>,
    record: Vec<u32>,
}

impl DecodeBuffer {
    fn new(capacity: usize) -> DecodeBuffer {
        let len = capacity + 2 * CHUNK;
        DecodeBuffer { medium: vec![0; len], fast: vec![0; len], record: vec![0; len] }
    }

    #[inline(always)]
    fn places(&mut self) -> BatchSlices<'_> {
        BatchSlices { medium: &mut self.medium, fast: &mut self.fast, record: &mut self.record }.equal()
    }
}

/// The arrays of a [`DecodeBuffer`], for writing.
struct BatchSlices<'a> {
    medium: &'a mut [u16],
    fast: &'a mut [u16],
    record: &'a mut [u32],
}

impl<'a> BatchSlices<'a> {
    /// Returns slices that the compiler knows to have equal length: one bounds check serves all three.
    #[inline(always)]
    fn equal(self) -> BatchSlices<'a> {
        let len = self.fast.len();
        BatchSlices { medium: &mut self.medium[..len], fast: &mut self.fast[..len], record: &mut self.record[..len] }
    }
}

/// The steps of a lane: its `own`, then those of the patch (the changed lines) of `lane`.
#[derive(Clone, Copy)]
struct LaneSteps<'a> {
    own: &'a [u8],
    lane: &'a Lane<'a>,
}

pub(super) struct Decoder<'a> {
    lane: &'a Lane<'a>,
    /// Largest number of records in a batch.
    pub(super) capacity: usize,
    fast: AxisOrder,
    batch: DecodeBuffer,
    /// The voxels of a few lines in ascending order, before they are put in the order of a two-sided fast axis.
    ascending: Vec<AscendingLine>,
}

impl<'a> Decoder<'a> {
    /// Creates a decoder for lines of `lane` that yields each line's voxels in the order `fast`.
    pub(super) fn new(lane: &'a Lane<'a>, fast: AxisOrder) -> Decoder<'a> {
        let longest = lane.dims[lane.axis.index()] as usize;
        let capacity = longest.max(BATCH);
        let count = if matches!(fast, AxisOrder::TwoSided { .. }) { LINES_AT_ONCE } else { 0 };
        let ascending = (0..count).map(|_| AscendingLine::new(longest)).collect();
        let batch = DecodeBuffer::new(capacity);
        Decoder { lane, capacity, fast, batch, ascending }
    }

    #[inline(always)]
    pub(super) fn decode(&mut self, lines: &[SliceLine], base: u64, slow: u16) -> Batch<'_> {
        let steps = LaneSteps { own: self.lane.steps, lane: self.lane };
        let range = match self.fast {
            AxisOrder::Ascending => {
                let mut places = self.batch.places();
                let mut end = CHUNK;
                for line in lines {
                    end = decode_line::<false>(steps, line, base, &mut places, end);
                }
                CHUNK..end
            }
            AxisOrder::Descending => {
                let mut places = self.batch.places();
                let top = CHUNK + self.capacity;
                let mut start = top;
                for line in lines.iter().rev() {
                    start = decode_line::<true>(steps, line, base, &mut places, start);
                }
                start..top
            }
            AxisOrder::TwoSided { eye, form, sense } => {
                let sides = Sides::new(eye, form, self.lane.dims[self.lane.axis.index()]);
                let (ascending, places) = (&mut self.ascending[..], self.batch.places());
                match sense {
                    Sense::BackToFront => {
                        CHUNK..decode_sides::<false>(steps, lines, base, sides, ascending, places, CHUNK)
                    }
                    Sense::FrontToBack => {
                        let top = CHUNK + self.capacity;
                        decode_sides::<true>(steps, lines, base, sides, ascending, places, top)..top
                    }
                }
            }
        };
        let range = match (self.lane.shown, self.lane.omitted) {
            (None, None) => range,
            _ => keep_shown(self.lane, base, self.batch.places(), range),
        };
        let DecodeBuffer { medium, fast, record } = &self.batch;
        Batch { slow, medium: &medium[range.clone()], fast: &fast[range.clone()], record: &record[range], base }
    }
}

/// Writes a line's voxels from `at` on in ascending order, or below `at` in descending order if `DOWN`.
///
/// Returns the index at which the next line continues.
#[inline(always)]
fn decode_line<const DOWN: bool>(
    steps: LaneSteps,
    line: &SliceLine,
    base: u64,
    out: &mut BatchSlices,
    mut at: usize,
) -> usize {
    let (from, offset) = place(line, base);
    let count = usize::from(line.count);
    let mut done = 0;
    // The first step counts from -1.
    let mut previous = u16::MAX;
    while done < count {
        let valid = (count - done).min(CHUNK);
        let chunk = load(steps, from + done);
        let first = offset.wrapping_add(u32_of(done));
        if has_stepping(chunk, valid) {
            for (lane, &step) in chunk.iter().enumerate().take(valid) {
                previous = previous.wrapping_add(if step == 0 { 255 } else { u16::from(step) });
                let slot = if DOWN { at - 1 } else { at };
                out.medium[slot] = line.medium;
                out.fast[slot] = previous;
                out.record[slot] = first.wrapping_add(u32_of(lane));
                let visible = usize::from(step != 0);
                at = if DOWN { at - visible } else { at + visible };
            }
        } else {
            let coordinates = prefix_sum(chunk, previous);
            previous = coordinates[CHUNK - 1];
            let low = if DOWN { at - CHUNK } else { at };
            *chunk_of(out.medium, low) = [line.medium; CHUNK];
            *chunk_of(out.fast, low) = if DOWN { reversed(coordinates) } else { coordinates };
            let lane_of = |slot| if DOWN { CHUNK - 1 - slot } else { slot };
            *chunk_of(out.record, low) = std::array::from_fn(|slot| first.wrapping_add(u32_of(lane_of(slot))));
            at = if DOWN { at - valid } else { at + valid };
        }
        done += CHUNK;
    }
    at
}

/// Writes the voxels of `lines` from `at` on, those of each line from far to near, or below `at` from near to far if
/// `DOWN`. `ascending` is memory for a few lines.
///
/// Returns the index at which the next lines continue.
#[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
fn decode_sides<const DOWN: bool>(
    steps: LaneSteps,
    lines: &[SliceLine],
    base: u64,
    sides: Sides,
    ascending: &mut [AscendingLine],
    out: BatchSlices,
    mut at: usize,
) -> usize {
    let mut out = out.equal();
    let mut remaining = lines;
    while !remaining.is_empty() {
        let count = remaining.len().min(ascending.len());
        let (now, later) = if DOWN { remaining.split_at(remaining.len() - count) } else { remaining.split_at(count) };
        let (now, later) = if DOWN { (later, now) } else { (now, later) };
        remaining = later;
        for (line, ascending) in now.iter().zip(&mut *ascending) {
            ascending.decode(steps, line, base, sides);
        }
        let both = now.iter().zip(&*ascending);
        if DOWN {
            for (line, ascending) in both.rev() {
                at = ascending.put_in_order::<DOWN>(line, base, sides, &mut out, at);
            }
        } else {
            for (line, ascending) in both {
                at = ascending.put_in_order::<DOWN>(line, base, sides, &mut out, at);
            }
        }
    }
    at
}

/// Number of lines that are decoded before their voxels are put in order. A processor waits when it reads what it has
/// just written in other pieces: with one line at a time a walk took a sixth longer.
const LINES_AT_ONCE: usize = 4;

/// The voxels of a line in ascending order: one chunk of zeros, the voxels, one chunk that closes the line.
struct AscendingLine {
    voxels: DecodeBuffer,
    /// Index at which the voxels end.
    end: usize,
    has_stepping: bool,
}

impl AscendingLine {
    /// Creates an empty line with room for `longest` voxels.
    fn new(longest: usize) -> AscendingLine {
        AscendingLine { voxels: DecodeBuffer::new(longest + CHUNK), end: CHUNK, has_stepping: false }
    }

    /// Decodes `line`. Records are written only if there are stepping voxels.
    #[inline(always)]
    fn decode(&mut self, steps: LaneSteps, line: &SliceLine, base: u64, sides: Sides) {
        self.end = CHUNK + usize::from(line.count);
        self.has_stepping = !decode_coordinates(steps, line, &mut self.voxels.fast);
        if self.has_stepping {
            self.end = decode_line::<false>(steps, line, base, &mut self.voxels.places(), CHUNK);
        }
        *chunk_of(&mut self.voxels.fast, self.end) = sides.beyond();
    }

    /// Writes the voxels of this line, which is `line`, from `at` on, from far to near, or below `at` from near to far
    /// if `DOWN`.
    ///
    /// Returns the index at which the next line continues.
    #[inline(always)]
    fn put_in_order<const DOWN: bool>(
        &self,
        line: &SliceLine,
        base: u64,
        sides: Sides,
        out: &mut BatchSlices,
        at: usize,
    ) -> usize {
        let first = place(line, base).1;
        let mut writer = ChunkWriter::<DOWN> { out, at, medium: line.medium, first };
        sides.order(&self.voxels.fast[..self.end + CHUNK], &mut writer);
        let end = writer.at;
        if self.has_stepping {
            let written = if DOWN { end..at } else { at..end };
            skip_stepping(&mut out.record[written], first, &self.voxels.record);
        }
        end
    }
}

/// Writes the voxels of a line, sixteen at a time, upward or, if `DOWN`, downward.
pub(super) struct ChunkWriter<'a, 'b, const DOWN: bool> {
    out: &'a mut BatchSlices<'b>,
    /// Where the next chunk starts or, if `DOWN`, ends.
    at: usize,
    medium: u16,
    /// The line's first record.
    first: u32,
}

impl<const DOWN: bool> ChunkWriter<'_, '_, DOWN> {
    /// Writes a chunk, of which the first `count` voxels are valid or, if `DOWN`, the last.
    #[inline(always)]
    pub(super) fn write(&mut self, chunk: LineChunk, count: usize) {
        let low = if DOWN { self.at - CHUNK } else { self.at };
        *chunk_of(self.out.medium, low) = [self.medium; CHUNK];
        *chunk_of(self.out.fast, low) = chunk.coordinates;
        *chunk_of(self.out.record, low) = chunk.indices.map(|index| self.first.wrapping_add(index.into()));
        self.at = if DOWN { self.at - count } else { self.at + count };
    }
}

/// Writes the coordinates of a line to `out`, ascending, after one chunk. Returns false, having written some of them,
/// if there are stepping voxels.
#[inline(always)]
fn decode_coordinates(steps: LaneSteps, line: &SliceLine, out: &mut [u16]) -> bool {
    let (from, _) = place(line, line.first_record);
    let count = usize::from(line.count);
    let mut previous = u16::MAX;
    for done in (0..count).step_by(CHUNK) {
        let chunk = load(steps, from + done);
        if has_stepping(chunk, (count - done).min(CHUNK)) {
            return false;
        }
        let coordinates = prefix_sum(chunk, previous);
        previous = coordinates[CHUNK - 1];
        *chunk_of(out, CHUNK + done) = coordinates;
    }
    true
}

/// Replaces records that were counted from `first` without stepping voxels; `line` are those of the line, after one
/// chunk.
#[cold]
fn skip_stepping(records: &mut [u32], first: u32, line: &[u32]) {
    for record in records {
        *record = line[CHUNK + record.wrapping_sub(first) as usize];
    }
}

/// Returns the index of a line's first record, and its distance from `base`.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "an index of a slice; and a group's lines lie near its base")]
fn place(line: &SliceLine, base: u64) -> (usize, u32) {
    (line.first_record as usize, line.first_record.wrapping_sub(base) as u32)
}

/// Converts an index in a line, which is below 65,535, to 32 bits.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "lines have at most 65,535 records")]
fn u32_of(index: usize) -> u32 {
    index as u32
}

/// Returns sixteen elements of an array from `from` on; the margins provide the space.
#[inline(always)]
fn chunk_of<T>(array: &mut [T], from: usize) -> &mut [T; CHUNK] {
    array[from..].first_chunk_mut().expect("the arrays have a margin of one chunk")
}

/// Returns sixteen steps from `from` on, padded with 1 at the end of the channel.
#[inline(always)]
fn load(steps: LaneSteps, from: usize) -> [u8; CHUNK] {
    let remaining = steps.own.get(from..).unwrap_or_default();
    match remaining.first_chunk() {
        Some(chunk) => *chunk,
        None => load_last(steps.lane, from),
    }
}

/// Returns the last steps of the lane's channel, or steps of its patch, padded with 1.
#[cold]
fn load_last(lane: &Lane, from: usize) -> [u8; CHUNK] {
    let (own, patch) = (lane.steps, lane.patch.map_or(&[][..], |patch| &patch.steps));
    let remaining = match from.checked_sub(own.len()) {
        None => &own[from..],
        Some(from) => patch.get(from..).unwrap_or_default(),
    };
    let mut chunk = [1; CHUNK];
    let count = remaining.len().min(CHUNK);
    chunk[..count].copy_from_slice(&remaining[..count]);
    chunk
}

/// Moves the voxels that `lane` shows (see `Lane::shows`) to the front of `range`; returns the range that they fill.
#[inline(never)]
fn keep_shown(lane: &Lane, base: u64, places: BatchSlices, range: Range<usize>) -> Range<usize> {
    let base = usize::try_from(base).unwrap_or(usize::MAX);
    let of_bytes = lane.shown.and_then(VisibleCodes::of_bytes);
    match of_bytes.filter(|_| lane.patch.is_none() && lane.omitted.is_none()) {
        // Codes of 8 bits have a path of their own: with `Lane::shows` a walk took 1.8 times as long.
        Some(shown) => keep(places, range, |record| {
            let code = lane.values.get(base.saturating_add(record));
            code.is_some_and(|code| shown[usize::from(code >> 6)] >> (code & 63) & 1 == 1)
        }),
        None => keep(places, range, |record| lane.shows(base.saturating_add(record))),
    }
}

/// Moves the voxels whose records `shows` accepts to the front of `range`; returns the range that they fill.
#[inline(always)]
fn keep(places: BatchSlices, range: Range<usize>, shows: impl Fn(usize) -> bool) -> Range<usize> {
    let places = places.equal();
    let mut end = range.start;
    for from in range.clone() {
        // Moves first and counts afterwards: branches on what is shown would be mispredicted.
        let record = places.record[from];
        places.medium[end] = places.medium[from];
        places.fast[end] = places.fast[from];
        places.record[end] = record;
        end += usize::from(shows(record as usize));
    }
    range.start..end
}

/// Returns whether one of the first `valid` steps is 0.
#[inline(always)]
fn has_stepping(chunk: [u8; CHUNK], valid: usize) -> bool {
    zero_steps(chunk) << (32 - valid) != 0
}
