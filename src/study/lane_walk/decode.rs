//! Decodes scan lines into batches (arrays of voxels), sixteen steps at a time, as the production walk does.

use super::store::{CHUNK, LaneStore};
use super::traced_vec::TracedVec;
use crate::trace::{Trace, Untraced};

/// Largest distance between the index of a record in a batch and that of the batch's first line.
const REACH: u64 = 1 << 31;

/// A scan line of the current slice.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SliceLine {
    pub(super) first_record: u64,
    pub(super) count: u16,
    pub(super) medium: u16,
}

impl SliceLine {
    fn start(self) -> usize {
        usize::try_from(self.first_record).expect("a sound line lies in memory")
    }
}

/// The coordinates of voxels on the medium and fast axis, and the indices of their records.
pub(super) struct TracedBatch {
    pub(super) medium: TracedVec<u16>,
    pub(super) fast: TracedVec<u16>,
    pub(super) record: TracedVec<u32>,
}

impl TracedBatch {
    pub(super) fn new(first_array: usize, len: usize) -> TracedBatch {
        TracedBatch {
            medium: TracedVec::new(first_array, len),
            fast: TracedVec::new(first_array + 1, len),
            record: TracedVec::new(first_array + 2, len),
        }
    }

    /// Traces the write of sixteen voxels at index `from` and after it, as one access per array.
    #[inline]
    pub(super) fn write_chunk<T: Trace>(&self, from: usize, trace: &mut T) {
        self.medium.write(from, CHUNK, trace);
        self.fast.write(from, CHUNK, trace);
        self.record.write(from, CHUNK, trace);
    }

    /// Returns the coordinate on the fast axis and the record of the voxel at `place`; the read is not traced.
    pub(super) fn voxel(&self, place: usize) -> (u16, u32) {
        (self.fast.items()[place], self.record.items()[place])
    }

    /// Stores one voxel at `place`. It traces the write unless `is_traced`, which says that its chunk was traced.
    #[inline]
    pub(super) fn put<T: Trace>(
        &mut self,
        place: usize,
        medium: u16,
        (fast, record): (u16, u32),
        is_traced: bool,
        trace: &mut T,
    ) {
        if is_traced {
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

/// Groups the lines that fit one batch, starting at line `first`. Returns the index after the last of them, and the
/// base: the record that the batch's record indices are relative to.
#[inline]
pub(super) fn group<T: Trace>(
    lines: &TracedVec<SliceLine>,
    first: usize,
    count: usize,
    capacity: usize,
    trace: &mut T,
) -> (usize, u64) {
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

/// Up to sixteen consecutive voxels of a line: coordinate, and index of the record relative to the batch's base record.
struct StepChunk {
    voxels: [(u16, u32); CHUNK],
    count: usize,
    /// Whether the voxels were decoded at once, as there are no stepping records (records without a voxel) among them.
    at_once: bool,
}

/// Decodes lines of one lane; indices of records in a batch count from record `base`.
pub(super) struct LineDecoder<'s, S> {
    pub(super) store: &'s S,
    pub(super) base: u64,
}

impl<S: LaneStore> LineDecoder<'_, S> {
    /// Calls `take` with the voxels of a line, sixteen records at a time.
    #[inline]
    fn step_chunks<T: Trace>(&self, line: SliceLine, trace: &mut T, mut take: impl FnMut(&StepChunk, &mut T)) {
        let count = usize::from(line.count);
        let mut previous = u16::MAX;
        for done in (0..count).step_by(CHUNK) {
            let steps = self.store.steps(line.start() + done, trace);
            let valid = CHUNK.min(count - done);
            let mut chunk = StepChunk { voxels: [(0, 0); CHUNK], count: 0, at_once: false };
            let first = line.first_record + done as u64 - self.base;
            for (offset, &step) in (first..).zip(&steps[..valid]) {
                previous = previous.wrapping_add(if step == 0 { 255 } else { u16::from(step) });
                let offset = u32::try_from(offset).expect("lines of a group lie near its base");
                chunk.voxels[chunk.count] = (previous, offset);
                chunk.count += usize::from(step != 0);
            }
            chunk.at_once = chunk.count == valid;
            take(&chunk, trace);
        }
    }

    /// Writes a line's voxels in ascending order to `out` from index `at` on; returns the index after the last one.
    pub(super) fn up<T: Trace>(&self, line: SliceLine, out: &mut TracedBatch, at: usize, trace: &mut T) -> usize {
        let mut end = at;
        self.step_chunks(line, trace, |chunk, trace| {
            if chunk.at_once {
                out.write_chunk(end, trace);
            }
            for &voxel in &chunk.voxels[..chunk.count] {
                out.put(end, line.medium, voxel, chunk.at_once, trace);
                end += 1;
            }
        });
        end
    }

    /// Writes a line's voxels in descending order to the places of `out` below `at`; returns the index of the first
    /// one.
    pub(super) fn down<T: Trace>(&self, line: SliceLine, out: &mut TracedBatch, at: usize, trace: &mut T) -> usize {
        let mut start = at;
        self.step_chunks(line, trace, |chunk, trace| {
            if chunk.at_once {
                out.write_chunk(start - CHUNK, trace);
            }
            for &voxel in &chunk.voxels[..chunk.count] {
                start -= 1;
                out.put(start, line.medium, voxel, chunk.at_once, trace);
            }
        });
        start
    }

    /// Decodes a line whose voxels are on both sides of the eye, ascending, from index `at` of `out` on; returns the
    /// index after the last one, and whether the line has stepping records.
    ///
    /// The walk first writes coordinates alone. Where it finds a stepping record it starts again and writes all three
    /// arrays.
    pub(super) fn ascending<T: Trace>(
        &self,
        line: SliceLine,
        out: &mut TracedBatch,
        at: usize,
        trace: &mut T,
    ) -> (usize, bool) {
        let count = usize::from(line.count);
        let has_stepping = (0..count).step_by(CHUNK).any(|done| {
            let steps = self.store.steps(line.start() + done, trace);
            let has_stepping = steps[..CHUNK.min(count - done)].contains(&0);
            if !has_stepping {
                out.fast.write(at + done, CHUNK, trace);
            }
            has_stepping
        });
        let end = if has_stepping { self.up(line, out, at, trace) } else { self.up(line, out, at, &mut Untraced) };
        // The chunk that closes the line.
        out.fast.write(end, CHUNK, trace);
        (end, has_stepping)
    }
}
