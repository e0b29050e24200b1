//! Sixteen voxels at once: the inner loops of the walk.
//!
//! In: sixteen one-byte steps (distances along a scan line, from record to record). Out: the coordinate after each, and
//! which steps are 0. A walk of a 512^3 gyroid takes 5 ns per voxel if plain code computes these sums, and 1.4 with
//! SSE2, which every x86-64 processor has.
//!
//! In: sixteen coordinates at each end of a line that has voxels on both sides of the eye. Out: the sixteen that are
//! farthest from the eye, far voxels first ([`merge_ends`]).
#![cfg_attr(
    target_arch = "x86_64",
    allow(unsafe_code, reason = "functions of the standard library that need SSE2, which x86-64 always has")
)]

#[cfg(not(target_arch = "x86_64"))]
pub(super) use plain::{prefix_sum, reversed, zero_steps};
#[cfg(target_arch = "x86_64")]
pub(super) use sse2::{prefix_sum, reversed, zero_steps};

pub(super) const CHUNK: usize = 16;

/// Sixteen voxels of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LineChunk {
    pub(super) coordinates: [u16; CHUNK],
    /// The place of each voxel among those of the line, which are counted from its low end.
    pub(super) indices: [u16; CHUNK],
}

impl LineChunk {
    /// Returns the same voxels in reverse order.
    #[inline(always)]
    pub(super) fn reversed(self) -> LineChunk {
        LineChunk { coordinates: reversed(self.coordinates), indices: reversed(self.indices) }
    }
}

/// Returns the farthest sixteen of the voxels from index `low` to before index `high` of a line, and how many of them
/// lie at the low end. Far voxels come first or, if `DOWN`, last.
///
/// `lows` are the coordinates from `low` on, `highs` those before `high`; both ascend. `doubled_eye` is twice the
/// eye's coordinate, rounded down, and at most twice the last coordinate of the axis, which has `axis_len` points: two
/// voxels are equally far if their coordinates add up to it, and then the lower counts as farther. Where fewer than
/// sixteen voxels are left, the nearest results are arbitrary. `lows` must then go on with coordinates above
/// `doubled_eye` or the largest there is, `highs` with 0.
///
/// Whatever the coordinates, the result at distance `i` from the first has an index from `low` to `low + i`, or from
/// `high - 1 - i` to `high - 1`.
#[inline(always)]
pub(super) fn merge_ends<const DOWN: bool>(
    lows: &[u16; CHUNK],
    highs: &[u16; CHUNK],
    ends: [u16; 2],
    doubled_eye: u32,
    axis_len: u32,
) -> (LineChunk, usize) {
    #[cfg(target_arch = "x86_64")]
    if axis_len <= sse2::LONGEST_MERGED {
        return sse2::merge_ends::<DOWN>(lows, highs, ends, doubled_eye);
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = axis_len;
    let (chunk, low_count) = plain::merge_ends(lows, highs, ends, doubled_eye);
    (if DOWN { chunk.reversed() } else { chunk }, low_count)
}

#[cfg(target_arch = "x86_64")]
mod sse2 {
    use std::arch::x86_64::{
        __m128i, _mm_add_epi8, _mm_add_epi16, _mm_adds_epi16, _mm_and_si128, _mm_andnot_si128, _mm_castps_si128,
        _mm_castsi128_ps, _mm_cmpeq_epi8, _mm_cmpgt_epi16, _mm_max_epi16, _mm_min_epi16, _mm_movemask_epi8,
        _mm_or_si128, _mm_packs_epi16, _mm_set1_epi16, _mm_set1_epi32, _mm_setr_epi16, _mm_setzero_si128,
        _mm_shuffle_epi32, _mm_shuffle_ps, _mm_shufflehi_epi16, _mm_shufflelo_epi16, _mm_slli_epi32, _mm_slli_si128,
        _mm_srai_epi16, _mm_srli_epi32, _mm_srli_si128, _mm_sub_epi16, _mm_unpackhi_epi8, _mm_unpackhi_epi16,
        _mm_unpackhi_epi64, _mm_unpacklo_epi8, _mm_unpacklo_epi16, _mm_unpacklo_epi64, _mm_xor_si128,
    };

    use super::{CHUNK, LineChunk};

    /// Returns the coordinate after each of sixteen steps from `previous`, modulo 2^16.
    #[inline(always)]
    pub(in super::super) fn prefix_sum(steps: [u8; CHUNK], previous: u16) -> [u16; CHUNK] {
        let bytes: __m128i = bytemuck::must_cast(steps);
        // SAFETY: these functions need SSE2 and nothing else. The x86-64 instruction set includes SSE2, so there is no
        // machine that runs this code without it.
        unsafe {
            let zero = _mm_setzero_si128();
            let sums_of_eight = |mut sums: __m128i| {
                sums = _mm_add_epi16(sums, _mm_slli_si128::<2>(sums));
                sums = _mm_add_epi16(sums, _mm_slli_si128::<4>(sums));
                _mm_add_epi16(sums, _mm_slli_si128::<8>(sums))
            };
            let before = _mm_set1_epi16(previous.cast_signed());
            let low = _mm_add_epi16(sums_of_eight(_mm_unpacklo_epi8(bytes, zero)), before);
            let last_of_low = _mm_shuffle_epi32::<0xff>(_mm_shufflehi_epi16::<0xff>(low));
            let high = _mm_add_epi16(sums_of_eight(_mm_unpackhi_epi8(bytes, zero)), last_of_low);
            bytemuck::must_cast([low, high])
        }
    }

    /// Returns a mask in which bit i is set if step i is 0.
    #[inline(always)]
    pub(in super::super) fn zero_steps(steps: [u8; CHUNK]) -> u32 {
        // SAFETY: as in `prefix_sum`.
        unsafe { _mm_movemask_epi8(_mm_cmpeq_epi8(bytemuck::must_cast(steps), _mm_setzero_si128())).cast_unsigned() }
    }

    /// Returns the coordinates in reverse order.
    #[inline(always)]
    pub(in super::super) fn reversed(coordinates: [u16; CHUNK]) -> [u16; CHUNK] {
        let [low, high]: [__m128i; 2] = bytemuck::must_cast(coordinates);
        // Reverses the four coordinates of each half, then swaps the halves.
        // SAFETY: as in `prefix_sum`.
        let reverse = |eight| unsafe {
            _mm_shuffle_epi32::<0x4e>(_mm_shufflehi_epi16::<0x1b>(_mm_shufflelo_epi16::<0x1b>(eight)))
        };
        bytemuck::must_cast([reverse(high), reverse(low)])
    }

    /// Number of points of the longest axis whose lines [`merge_ends`] can merge: twice a difference of coordinates,
    /// and 1, fit in 16 bits with a sign.
    pub(super) const LONGEST_MERGED: u32 = 1 << 14;

    /// Does what [`super::merge_ends`] does, for axes of up to [`LONGEST_MERGED`] points.
    ///
    /// A voxel's key is twice its coordinate. Beyond the eye it is twice the coordinate's mirror image plus 1, so that
    /// ascending keys are the order of the merge, and a key tells the coordinate. Of two ascending lists the sixteen
    /// lowest are the lane-wise minima of one list and the other reversed. They rise and then fall, or the reverse, so
    /// four stages sort them (Batcher 1968). Where a list goes on beyond the eye, its keys exceed all that are sought,
    /// because sums saturate.
    #[inline(always)]
    pub(in super::super) fn merge_ends<const DOWN: bool>(
        lows: &[u16; CHUNK],
        highs: &[u16; CHUNK],
        [low, high]: [u16; 2],
        doubled_eye: u32,
    ) -> (LineChunk, usize) {
        #[allow(clippy::cast_possible_truncation, reason = "below twice the length of the longest axis")]
        let doubled_eye = doubled_eye as i16;
        let lows: [__m128i; 2] = bytemuck::must_cast(*lows);
        let highs: [__m128i; 2] = bytemuck::must_cast(*highs);
        // SAFETY: as in `prefix_sum`.
        unsafe {
            let (zero, one) = (_mm_setzero_si128(), _mm_set1_epi16(1));
            let (last, after) = (_mm_set1_epi16(doubled_eye), _mm_set1_epi16(doubled_eye.wrapping_add(1)));
            let is_high_first = |a, b| _mm_cmpgt_epi16(_mm_adds_epi16(a, b), last);
            let is_high = _mm_packs_epi16(is_high_first(lows[0], highs[0]), is_high_first(lows[1], highs[1]));
            let low_count = (_mm_movemask_epi8(is_high) | 1 << CHUNK).trailing_zeros() as usize;

            let lowest_keys = |a, b| {
                let mirrored = _mm_sub_epi16(last, b);
                _mm_min_epi16(_mm_adds_epi16(a, a), _mm_or_si128(_mm_adds_epi16(mirrored, mirrored), one))
            };
            let keys = sorted_bitonic::<DOWN>(lowest_keys(lows[0], highs[0]), lowest_keys(lows[1], highs[1]));
            let is_odd = keys.map(|keys| _mm_and_si128(keys, one));
            let odd = is_odd.map(|odd| _mm_sub_epi16(zero, odd));
            // The coordinate is half the key or, if that is odd, `doubled_eye` minus half of it: ~x + 1 is -x.
            let coordinate =
                |keys, odd| _mm_add_epi16(_mm_xor_si128(_mm_srai_epi16::<1>(keys), odd), _mm_and_si128(odd, after));
            let coordinates = [coordinate(keys[0], odd[0]), coordinate(keys[1], odd[1])];

            // The number of odd keys from the lowest up to each.
            let mut odds = _mm_packs_epi16(is_odd[0], is_odd[1]);
            if DOWN {
                odds = _mm_add_epi8(odds, _mm_srli_si128::<1>(odds));
                odds = _mm_add_epi8(odds, _mm_srli_si128::<2>(odds));
                odds = _mm_add_epi8(odds, _mm_srli_si128::<4>(odds));
                odds = _mm_add_epi8(odds, _mm_srli_si128::<8>(odds));
            } else {
                odds = _mm_add_epi8(odds, _mm_slli_si128::<1>(odds));
                odds = _mm_add_epi8(odds, _mm_slli_si128::<2>(odds));
                odds = _mm_add_epi8(odds, _mm_slli_si128::<4>(odds));
                odds = _mm_add_epi8(odds, _mm_slli_si128::<8>(odds));
            }
            let [first, second] = if DOWN {
                [_mm_setr_epi16(15, 14, 13, 12, 11, 10, 9, 8), _mm_setr_epi16(7, 6, 5, 4, 3, 2, 1, 0)]
            } else {
                [_mm_setr_epi16(0, 1, 2, 3, 4, 5, 6, 7), _mm_setr_epi16(8, 9, 10, 11, 12, 13, 14, 15)]
            };
            let (low, high) = (_mm_set1_epi16(low.cast_signed()), _mm_set1_epi16(high.cast_signed()));
            let index = |distances, odd, odds| {
                let upward = _mm_andnot_si128(odd, _mm_add_epi16(low, distances));
                _mm_sub_epi16(_mm_or_si128(upward, _mm_and_si128(odd, high)), odds)
            };
            let indices = [
                index(first, odd[0], _mm_unpacklo_epi8(odds, zero)),
                index(second, odd[1], _mm_unpackhi_epi8(odds, zero)),
            ];
            let chunk =
                LineChunk { coordinates: bytemuck::must_cast(coordinates), indices: bytemuck::must_cast(indices) };
            (chunk, low_count)
        }
    }

    /// Sorts sixteen numbers that first rise and then fall, or the reverse; those of `a` come before those of `b`. The
    /// result ascends or, if `DOWN`, descends.
    ///
    /// Compares numbers at distances 8, 4, 2 and 1, each time both halves at once.
    #[inline(always)]
    fn sorted_bitonic<const DOWN: bool>(a: __m128i, b: __m128i) -> [__m128i; 2] {
        // SAFETY: as in `prefix_sum`.
        unsafe {
            let sorted = |a, b| {
                let (low, high) = (_mm_min_epi16(a, b), _mm_max_epi16(a, b));
                if DOWN { (high, low) } else { (low, high) }
            };
            // 0 to 7 and 8 to 15.
            let (a, b) = sorted(a, b);
            // 0 to 3, 8 to 11 and 4 to 7, 12 to 15.
            let (a, b) = sorted(_mm_unpacklo_epi64(a, b), _mm_unpackhi_epi64(a, b));
            // 0 1, 8 9, 4 5, 12 13 and 2 3, 10 11, 6 7, 14 15.
            let (c, d) = (_mm_castsi128_ps(a), _mm_castsi128_ps(b));
            let (c, d) = (_mm_shuffle_ps::<0x88>(c, d), _mm_shuffle_ps::<0xdd>(c, d));
            let (a, b) = sorted(_mm_castps_si128(c), _mm_castps_si128(d));
            // 0 2, 8 10, 4 6, 12 14 and 1 3, 9 11, 5 7, 13 15.
            let even = _mm_set1_epi32(0xffff);
            let (a, b) = sorted(
                _mm_or_si128(_mm_and_si128(even, a), _mm_slli_epi32::<16>(b)),
                _mm_or_si128(_mm_srli_epi32::<16>(a), _mm_andnot_si128(even, b)),
            );
            // 0 to 3, 8 to 11 and 4 to 7, 12 to 15.
            let (a, b) = (_mm_unpacklo_epi16(a, b), _mm_unpackhi_epi16(a, b));
            [_mm_unpacklo_epi64(a, b), _mm_unpackhi_epi64(a, b)]
        }
    }
}

/// The same functions without SSE2; tests compare them with those above.
#[cfg_attr(all(target_arch = "x86_64", not(test)), allow(dead_code, reason = "only very long axes need one of these"))]
mod plain {
    use super::{CHUNK, LineChunk};

    #[cfg_attr(target_arch = "x86_64", cold, inline(never))]
    pub(in super::super) fn merge_ends(
        lows: &[u16; CHUNK],
        highs: &[u16; CHUNK],
        [low, high]: [u16; 2],
        doubled_eye: u32,
    ) -> (LineChunk, usize) {
        let mut chunk = LineChunk { coordinates: [0; CHUNK], indices: [0; CHUNK] };
        let (mut low_count, mut high_count) = (0, 0);
        for (coordinate, index) in chunk.coordinates.iter_mut().zip(&mut chunk.indices) {
            let (a, b) = (lows[usize::from(low_count)], highs[CHUNK - 1 - usize::from(high_count)]);
            let is_low = u32::from(a) + u32::from(b) <= doubled_eye;
            (*coordinate, *index) =
                if is_low { (a, low.wrapping_add(low_count)) } else { (b, high.wrapping_sub(1 + high_count)) };
            low_count += u16::from(is_low);
            high_count += u16::from(!is_low);
        }
        (chunk, low_count.into())
    }

    pub(in super::super) fn prefix_sum(steps: [u8; CHUNK], mut sum: u16) -> [u16; CHUNK] {
        steps.map(|step| {
            sum = sum.wrapping_add(step.into());
            sum
        })
    }

    pub(in super::super) fn zero_steps(steps: [u8; CHUNK]) -> u32 {
        (0..).zip(steps).map(|(bit, step)| u32::from(step == 0) << bit).sum()
    }

    pub(in super::super) fn reversed(mut coordinates: [u16; CHUNK]) -> [u16; CHUNK] {
        coordinates.reverse();
        coordinates
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traverse::{AxisOrder, Sense, SplitForm};

    /// Pseudorandom numbers below `end`.
    fn random(state: &mut u64, end: u64) -> u64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*state >> 33) % end
    }

    /// The voxels of `line` and their indices, from far to near, as `merge` takes them from both ends.
    fn merged(
        line: &[u16],
        doubled_eye: u32,
        merge: impl Fn(&[u16; CHUNK], &[u16; CHUNK], [u16; 2]) -> (LineChunk, usize),
    ) -> Vec<(u16, u16)> {
        let beyond = u16::try_from(doubled_eye + 1).unwrap_or(u16::MAX);
        let padded = [&[0; CHUNK], line, &[beyond; CHUNK]].concat();
        let (mut low, mut high) = (0, line.len());
        let mut voxels = Vec::new();
        while low < high {
            let ends = [low, high].map(|index| u16::try_from(index).unwrap());
            let [lows, highs] = [low + CHUNK, high].map(|place| *padded[place..].first_chunk().unwrap());
            let (chunk, low_count) = merge(&lows, &highs, ends);
            voxels.extend(chunk.coordinates.into_iter().zip(chunk.indices).take(high - low));
            (low, high) = (low + low_count, (high + low_count).saturating_sub(CHUNK));
        }
        voxels
    }

    #[test]
    fn ends_are_merged_by_distance_from_the_eye() {
        let mut state = 2;
        for case in 0..4_000u64 {
            let length: u64 = [40, 300, 16_384, 40_000, 65_535][(case % 5) as usize];
            let axis_len = u32::try_from(length).unwrap();
            let step = 2 * length / [1, 3, 40, 90, 500][(case / 5 % 5) as usize].min(length);
            let mut line = Vec::new();
            let mut at = random(&mut state, step);
            while at < length && line.len() < 1_000 {
                line.push(u16::try_from(at).unwrap());
                at += 1 + random(&mut state, step);
            }
            let quarters = random(&mut state, 4 * (length - 1));
            #[allow(clippy::cast_precision_loss, reason = "small numbers")]
            let eye = quarters as f64 / 4.0;
            let doubled_eye = u32::try_from(quarters / 2).unwrap();
            let mut expected = Vec::new();
            let sides = AxisOrder::TwoSided { eye, form: SplitForm::Interleaved, sense: Sense::BackToFront };
            sides.for_each_index(&line, |index| expected.push((line[index], u16::try_from(index).unwrap())));
            let reversed = |(chunk, count): (LineChunk, usize)| (chunk.reversed(), count);
            assert_eq!(merged(&line, doubled_eye, |a, b, e| plain::merge_ends(a, b, e, doubled_eye)), expected);
            assert_eq!(
                merged(&line, doubled_eye, |a, b, e| merge_ends::<false>(a, b, e, doubled_eye, axis_len)),
                expected
            );
            assert_eq!(
                merged(&line, doubled_eye, |a, b, e| reversed(merge_ends::<true>(a, b, e, doubled_eye, axis_len))),
                expected
            );
        }
    }

    #[test]
    #[allow(clippy::cast_possible_truncation, reason = "bits of a random number are wanted")]
    fn the_fast_functions_equal_the_plain_ones() {
        let mut state = 1u64;
        for _ in 0..10_000 {
            let steps = [(); CHUNK].map(|()| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 56) as u8
            });
            let previous = (state >> 40) as u16;
            assert_eq!(prefix_sum(steps, previous), plain::prefix_sum(steps, previous));
            let sums = prefix_sum(steps, previous);
            assert_eq!(reversed(sums), plain::reversed(sums));
            let sparse = steps.map(|step| step.saturating_sub(100));
            assert_eq!(zero_steps(sparse), plain::zero_steps(sparse));
        }
    }
}
