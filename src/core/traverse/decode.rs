//! Decoding: from the steps of lines to the coordinates and records of a batch.
//!
//! In: lines of one slice in medium order, all inside the channels. Out: a [`Batch`] in the fast order. The
//! departures for speed are those of the walk, [`super::walk`].

use std::ops::Range;

use super::gather::Line;
use super::order::AxisOrder;
use super::prefix::{CHUNK, prefix_sum, reversed, zero_steps};
use super::walk::Batch;
use crate::arena::Lane;

/// Voxels that a batch holds unless a single line has more.
const BATCH: usize = 2_048;
/// Largest distance of a batch's records from its first line's.
const REACH: u64 = 1 << 31;

/// As many lines as fit a batch.
pub(super) struct Group {
    /// How many; at least 1.
    pub(super) line_count: usize,
    /// Their records.
    pub(super) records: u64,
    /// [`REACH`] below the first line's records, so that offsets from it fit 32 bits on both sides.
    pub(super) base: u64,
}

/// A group whose lines lie in more pieces of the channels than this, of [`PIECE`] records each, is cut.
const MOST_PIECES: u64 = 2;
/// As many bytes as a system maps at once.
const PIECE: u64 = 1 << 16;

impl Group {
    /// Cuts the group, of the first of `lines`, so that what a pager is told of at once stays small: at most 24 pieces
    /// in all channels, which have up to 8 bytes a record ([`crate::arena::pager::IN_FLIGHT`]).
    pub(super) fn stay_near(&mut self, lines: &[Line]) {
        let (mut pieces, mut last, mut records) = (0, None, 0);
        for (index, line) in lines[..self.line_count].iter().enumerate() {
            let (first, end) = (line.first_record / PIECE, (line.first_record + u64::from(line.count) - 1) / PIECE);
            pieces += end - first + u64::from(last != Some(first));
            if index > 0 && pieces > MOST_PIECES {
                (self.line_count, self.records) = (index, records);
                return;
            }
            (last, records) = (Some(end), records + u64::from(line.count));
        }
    }
}

/// The first group of `lines`, of which there is at least one, with at most `capacity` records.
#[inline(always)]
pub(super) fn group(lines: &[Line], capacity: usize) -> Group {
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
    Group { line_count, records, base }
}

impl Line {
    /// The records that decoding it reads: the last sixteen steps may reach beyond its own.
    pub(super) fn records_read(&self) -> std::ops::Range<usize> {
        let start = usize::try_from(self.first_record).unwrap_or(usize::MAX);
        start..start.saturating_add(usize::from(self.count) + CHUNK)
    }
}

/// The arrays of a batch, all of one length, with a margin of one chunk at either end.
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

    /// The arrays as slices that the compiler sees to be of one length: one bounds check serves three.
    #[inline(always)]
    fn places(&mut self) -> Places<'_> {
        let len = self.fast.len();
        Places { medium: &mut self.medium[..len], fast: &mut self.fast[..len], record: &mut self.record[..len] }
    }
}

/// [`BatchArrays`] for writing.
struct Places<'a> {
    medium: &'a mut [u16],
    fast: &'a mut [u16],
    record: &'a mut [u32],
}

/// The steps of a lane, and the lane for those of its patch.
#[derive(Clone, Copy)]
struct Steps<'a> {
    own: &'a [u8],
    lane: &'a Lane<'a>,
}

/// Decodes lines of one lane.
pub(super) struct Decoder<'a> {
    lane: &'a Lane<'a>,
    capacity: usize,
    fast: AxisOrder,
    batch: BatchArrays,
    /// One line's voxels in ascending order, for a fast axis with two sides.
    line: BatchArrays,
}

impl<'a> Decoder<'a> {
    /// For lines of `lane` whose voxels come in the order `fast`.
    pub(super) fn new(lane: &'a Lane<'a>, fast: AxisOrder) -> Decoder<'a> {
        let longest = lane.dims[lane.axis.index()] as usize;
        let capacity = longest.max(BATCH);
        let line = if matches!(fast, AxisOrder::TwoSided { .. }) { longest } else { 0 };
        let (batch, line) = (BatchArrays::new(capacity), BatchArrays::new(line));
        Decoder { lane, capacity, fast, batch, line }
    }

    /// Records that a group may have.
    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Decodes a group of lines of slice `slow`.
    #[inline(always)]
    pub(super) fn decode(&mut self, lines: &[Line], base: u64, slow: u16) -> Batch<'_> {
        let steps = Steps { own: self.lane.steps, lane: self.lane };
        let range = match self.fast {
            AxisOrder::Ascending => {
                let mut places = self.batch.places();
                let mut end = CHUNK;
                for line in lines {
                    end = decode_up(steps, line, base, &mut places, end);
                }
                CHUNK..end
            }
            AxisOrder::Descending => {
                let mut places = self.batch.places();
                let top = CHUNK + self.capacity;
                let mut start = top;
                for line in lines.iter().rev() {
                    start = decode_down(steps, line, base, &mut places, start);
                }
                start..top
            }
            AxisOrder::TwoSided { .. } => {
                let places = self.batch.places();
                let mut end = CHUNK;
                for line in lines {
                    let line_end = decode_up(steps, line, base, &mut self.line.places(), CHUNK);
                    let (coordinates, records) = (&self.line.fast[CHUNK..line_end], &self.line.record[CHUNK..line_end]);
                    self.fast.for_each_index(coordinates, |index| {
                        places.medium[end] = line.medium;
                        places.fast[end] = coordinates[index];
                        places.record[end] = records[index];
                        end += 1;
                    });
                }
                CHUNK..end
            }
        };
        let range = match self.lane.shown {
            None => range,
            Some(_) => keep_shown(self.lane, base, &mut self.batch.places(), range),
        };
        let BatchArrays { medium, fast, record } = &self.batch;
        Batch { slow, medium: &medium[range.clone()], fast: &fast[range.clone()], record: &record[range], base }
    }
}

/// Writes a line's voxels, ascending, from `at` up; gives the end.
#[inline(always)]
fn decode_up(steps: Steps, line: &Line, base: u64, out: &mut Places, at: usize) -> usize {
    let (from, offset) = place(line, base);
    let count = usize::from(line.count);
    let mut end = at;
    let mut done = 0;
    // The first step is counted from -1.
    let mut previous = u16::MAX;
    while done < count {
        let valid = (count - done).min(CHUNK);
        let chunk = load(steps, from + done);
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
            *chunk_of(out.medium, end) = [line.medium; CHUNK];
            *chunk_of(out.fast, end) = coordinates;
            *chunk_of(out.record, end) = std::array::from_fn(|lane| first.wrapping_add(u32_of(lane)));
            end += valid;
        }
        done += CHUNK;
    }
    end
}

/// Writes a line's voxels, descending, below `at`; gives the start.
#[inline(always)]
fn decode_down(steps: Steps, line: &Line, base: u64, out: &mut Places, at: usize) -> usize {
    let (from, offset) = place(line, base);
    let count = usize::from(line.count);
    let mut start = at;
    let mut done = 0;
    let mut previous = u16::MAX;
    while done < count {
        let valid = (count - done).min(CHUNK);
        let chunk = load(steps, from + done);
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
            *chunk_of(out.medium, low) = [line.medium; CHUNK];
            *chunk_of(out.fast, low) = reversed(coordinates);
            *chunk_of(out.record, low) = std::array::from_fn(|lane| first.wrapping_add(u32_of(CHUNK - 1 - lane)));
            start -= valid;
        }
        done += CHUNK;
    }
    start
}

/// A line's first record as an index, and from `base`.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "an index of a slice; and a group's lines lie near its base")]
fn place(line: &Line, base: u64) -> (usize, u32) {
    (line.first_record as usize, line.first_record.wrapping_sub(base) as u32)
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

/// Sixteen steps from `from`, filled up where the channel ends.
#[inline(always)]
fn load(steps: Steps, from: usize) -> [u8; CHUNK] {
    let rest = steps.own.get(from..).unwrap_or_default();
    match rest.first_chunk() {
        Some(chunk) => *chunk,
        None => load_last(steps.lane, from),
    }
}

/// The channel's last steps, filled up; or the patch's.
#[cold]
fn load_last(lane: &Lane, from: usize) -> [u8; CHUNK] {
    let (own, patch) = (lane.steps, lane.patch.map_or(&[][..], |patch| &patch.steps));
    let rest = match from.checked_sub(own.len()) {
        None => &own[from..],
        Some(from) => patch.get(from..).unwrap_or_default(),
    };
    let mut chunk = [1; CHUNK];
    let count = rest.len().min(CHUNK);
    chunk[..count].copy_from_slice(&rest[..count]);
    chunk
}

/// Moves the voxels that are shown to the front of `range`; where they end.
fn keep_shown(lane: &Lane, base: u64, places: &mut Places, range: Range<usize>) -> Range<usize> {
    let base = usize::try_from(base).unwrap_or(usize::MAX);
    let mut end = range.start;
    for from in range.clone() {
        // Moved first and counted after: whether a voxel is shown is hard to foretell.
        places.medium[end] = places.medium[from];
        places.fast[end] = places.fast[from];
        places.record[end] = places.record[from];
        end += usize::from(lane.shows(base.saturating_add(places.record[end] as usize)));
    }
    range.start..end
}

/// Whether one of the first `valid` steps is 0.
#[inline(always)]
fn has_stepping(chunk: [u8; CHUNK], valid: usize) -> bool {
    zero_steps(chunk) << (32 - valid) != 0
}
