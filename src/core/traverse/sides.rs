//! Lines with voxels on both sides of the eye: from ascending coordinates to the order of a two-sided axis.
//!
//! In: the coordinates of a line, and where the eye is. Out: the same voxels from far to near, sixteen at a time.
//! Which of two voxels is farther cannot be predicted, so no branch depends on it: [`merge_ends`] takes sixteen from
//! both ends.

use super::decode::ChunkWriter;
use super::order::SplitForm;
use super::simd::{CHUNK, LineChunk, merge_ends};

/// How the voxels of a line follow each other from far to near.
#[derive(Clone, Copy)]
pub(super) struct Sides {
    eye: f64,
    form: SplitForm,
    /// Twice the eye's coordinate, rounded down, and limited to the axis.
    doubled_eye: u32,
    axis_len: u32,
}

impl Sides {
    /// Returns the order of voxels on the two sides of `eye`, on an axis of `axis_len` points.
    pub(super) fn new(eye: f64, form: SplitForm, axis_len: u32) -> Sides {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "an eye beyond the axis is at its end"
        )]
        let doubled_eye = ((2.0 * eye) as u32).min(2 * axis_len.saturating_sub(1));
        Sides { eye, form, doubled_eye, axis_len }
    }

    /// Returns the coordinates that must follow those of a line.
    #[inline(always)]
    pub(super) fn beyond(self) -> [u16; CHUNK] {
        [u16::try_from(self.doubled_eye + 1).unwrap_or(u16::MAX); CHUNK]
    }

    /// Gives `writer` the voxels of a line from far to near, up to sixteen at a time. If it writes downward, each
    /// chunk's voxels are reversed.
    ///
    /// `coordinates` are one chunk of zeros, the ascending coordinates of the line, and [`beyond`](Self::beyond).
    #[inline(always)]
    pub(super) fn order<const DOWN: bool>(self, coordinates: &[u16], writer: &mut ChunkWriter<DOWN>) {
        match self.form {
            SplitForm::Interleaved => self.interleave(coordinates, writer),
            SplitForm::Split => self.split(coordinates, writer),
        }
    }

    #[inline(always)]
    fn interleave<const DOWN: bool>(self, coordinates: &[u16], writer: &mut ChunkWriter<DOWN>) {
        let (mut low, mut high) = (CHUNK, coordinates.len() - CHUNK);
        while low < high {
            let (lows, highs) = (chunk_from(coordinates, low), chunk_from(coordinates, high - CHUNK));
            let ends = [index_of(low), index_of(high)];
            let (chunk, low_count) = merge_ends::<DOWN>(lows, highs, ends, self.doubled_eye, self.axis_len);
            writer.write(chunk, (high - low).min(CHUNK));
            (low, high) = (low + low_count, high - (CHUNK - low_count));
        }
    }

    #[inline(always)]
    fn split<const DOWN: bool>(self, coordinates: &[u16], writer: &mut ChunkWriter<DOWN>) {
        let end = coordinates.len() - CHUNK;
        let meet = CHUNK + coordinates[CHUNK..end].partition_point(|&c| f64::from(c) < self.eye);
        // A coordinate equal to the eye's is the nearest of both sides: it comes last.
        let above = meet + usize::from(meet < end && f64::from(coordinates[meet]) == self.eye);
        // Which places of the line come next, and whether upward.
        for (from, to, is_up) in [(CHUNK, meet, true), (above, end, false), (meet, above, true)] {
            for done in (0..to - from).step_by(CHUNK) {
                let low = if is_up { from + done } else { to - done - CHUNK };
                let indices = std::array::from_fn(|i| index_of(low).wrapping_add(COUNTING[i]));
                let chunk = LineChunk { coordinates: *chunk_from(coordinates, low), indices };
                writer.write(if is_up == DOWN { chunk.reversed() } else { chunk }, (to - from - done).min(CHUNK));
            }
        }
    }
}

/// Returns sixteen coordinates from `place` on.
#[inline(always)]
fn chunk_from(coordinates: &[u16], place: usize) -> &[u16; CHUNK] {
    coordinates[place..].first_chunk().expect("there is a chunk before the line and one after it")
}

/// Counts voxels of a chunk.
const COUNTING: [u16; CHUNK] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Returns the index in its line of the voxel at `place`, after one chunk of zeros.
#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "lines have at most 65,535 voxels")]
fn index_of(place: usize) -> u16 {
    place.wrapping_sub(CHUNK) as u16
}
