//! The voxels of a scan line, in the order of a visit: where a line ends, and which of its voxels lie between two columns.
//!
//! In: a batch's coordinates along one axis. Out: ranges of indices.

use std::ops::Range;

use crate::splat::cpu::voxel_block::GROUP;

/// Returns how many of the first coordinates are equal. Those that are equal must be neighbours, as in a slice, which has one line at
/// each coordinate.
#[inline(always)]
pub(super) fn same(coordinates: &[u16]) -> usize {
    /// How many are compared together, without a branch on each, so that a compiler uses vectors.
    const TOGETHER: usize = 2 * GROUP;
    let Some(first) = coordinates.first() else { return 0 };
    let (chunks, rest) = coordinates.as_chunks::<TOGETHER>();
    let mut count = 0;
    for chunk in chunks {
        count += usize::from(chunk.iter().map(|other| u16::from(other == first)).sum::<u16>());
        if chunk[TOGETHER - 1] != *first {
            return count;
        }
    }
    count + rest.iter().take_while(|other| *other == first).count()
}

/// Returns the least and the greatest of at most [`GROUP`] coordinates.
#[inline(always)]
pub(super) fn ends(coordinates: &[u16]) -> [u16; 2] {
    let widen = |ends: [u16; 2], &at: &u16| [ends[0].min(at), ends[1].max(at)];
    // A compiler uses vectors where it knows the length.
    match coordinates.first_chunk::<GROUP>() {
        Some(group) => group.iter().fold([u16::MAX, 0], widen),
        None => coordinates.iter().fold([u16::MAX, 0], widen),
    }
}

/// Most voxels of a line with gaps that is tested in groups.
const SHORT: usize = 2 * GROUP;

/// The voxels of a line that is visited from one end to the other.
pub(super) struct OneWay<'a> {
    fasts: &'a [u16],
    pub(super) rises: bool,
    has_gaps: bool,
    /// How many voxels were taken or passed over.
    done: usize,
}

impl<'a> OneWay<'a> {
    /// `None` if coordinates neither rise nor fall all along, as where a line has voxels on both sides of the eye; or if the line
    /// has gaps and is so short that a look at all its voxels is faster.
    #[inline(always)]
    pub(super) fn of(fasts: &'a [u16]) -> Option<OneWay<'a>> {
        let (&first, &last) = (fasts.first()?, fasts.last()?);
        let rises = first <= last;
        let has_gaps = usize::from(first.abs_diff(last)) + 1 != fasts.len();
        if has_gaps && fasts.len() <= SHORT {
            return None;
        }
        // Without a branch on each pair, so that a compiler uses vectors.
        let pairs = fasts.iter().zip(&fasts[1..]);
        let turns = if rises {
            pairs.fold(0, |turns, (&before, &after)| turns | (before.max(after) ^ after))
        } else {
            pairs.fold(0, |turns, (&before, &after)| turns | (before.min(after) ^ after))
        };
        (turns == 0).then_some(OneWay { fasts, rises, has_gaps, done: 0 })
    }

    /// Returns the least and the greatest coordinate.
    #[inline(always)]
    pub(super) fn ends(&self) -> [u16; 2] {
        let ends = [self.fasts[0], self.fasts[self.fasts.len() - 1]];
        if self.rises { ends } else { [ends[1], ends[0]] }
    }

    /// Returns the indices of the voxels from column `near` to column `far`, on the way of the visit. They lie between the line's
    /// ends, and beyond the columns of the call before.
    #[inline(always)]
    pub(super) fn take(&mut self, [near, far]: [u16; 2]) -> Range<usize> {
        let OneWay { fasts, rises, has_gaps, done } = *self;
        if !has_gaps {
            return near.abs_diff(fasts[0]).into()..usize::from(far.abs_diff(fasts[0])) + 1;
        }
        // Places rise on the way, by at least 1 from one voxel to the next. So a voxel's index is at most its distance from the line's
        // first voxel, and as many voxels as lie behind it are at most its distance from the last one.
        let place = |fast: u16| if rises { i32::from(fast) } else { -i32::from(fast) };
        let (first, last, len) = (place(fasts[0]), place(fasts[fasts.len() - 1]), fasts.len());
        let first_from = |at: i32, least: usize| {
            let least = len.saturating_sub((last - at).max(0) as usize + 1).max(least);
            let most = len.min((at - first).max(0) as usize).max(least);
            least + fasts[least..most].partition_point(|fast| place(*fast) < at)
        };
        let start = first_from(place(near), done);
        let end = first_from(place(far) + 1, start);
        self.done = end;
        start..end
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::cpu::bit_rows::BitRows;

    /// A line over three words of bits: with gaps or without, from the left or from the right.
    fn lines() -> Vec<Vec<u16>> {
        let rising = [(3..190).collect(), (3..190).filter(|c| c % 7 != 2 && c % 31 > 4).collect()];
        rising.into_iter().flat_map(|line: Vec<u16>| [line.iter().rev().copied().collect(), line]).collect()
    }

    #[test]
    fn taken_are_the_voxels_of_columns_that_are_set() {
        for fasts in lines() {
            for runs in
                [vec![[0, 199]], vec![[3, 3], [5, 63], [64, 70], [100, 150], [189, 189]], vec![[30, 32], [127, 128]]]
            {
                for span in [[3, 189], [40, 120]] {
                    let mut shown = BitRows::new(200, 2);
                    runs.iter().for_each(|run| shown.set(1, *run));
                    let mut line = OneWay::of(&fasts).unwrap();
                    let mut taken = Vec::new();
                    for columns in shown.runs_on_way(1, span, line.rises) {
                        taken.extend(line.take(columns).map(|index| fasts[index]));
                    }
                    let wanted = fasts
                        .iter()
                        .copied()
                        .filter(|&fast| (span[0]..=span[1]).contains(&fast) && shown.get(1, fast.into()));
                    assert_eq!(taken, wanted.collect::<Vec<_>>(), "{runs:?} {span:?}");
                }
            }
        }
    }

    #[test]
    fn runs_that_cross_words_come_whole() {
        let mut shown = BitRows::new(256, 1);
        [[1, 1], [60, 200]].iter().for_each(|run| shown.set(0, *run));
        assert_eq!(shown.runs_on_way(0, [0, 255], true).collect::<Vec<_>>(), [[1, 1], [60, 200]]);
        assert_eq!(shown.runs_on_way(0, [0, 255], false).collect::<Vec<_>>(), [[200, 60], [1, 1]]);
        assert_eq!(shown.runs_on_way(0, [64, 127], true).collect::<Vec<_>>(), [[64, 127]]);
    }

    #[test]
    fn equal_coordinates_are_counted_up_to_the_next_line() {
        for len in [1, 15, 31, 32, 33, 64, 65, 100] {
            for next in [0, 1, 31, 40] {
                let mut mediums = vec![7; len];
                mediums.extend(vec![8; next]);
                assert_eq!(same(&mediums), len, "then {next} others");
            }
        }
        assert_eq!(same(&[]), 0);
    }

    #[test]
    fn a_line_that_turns_is_not_one_way() {
        let around: Vec<u16> = (0..40).flat_map(|k| [100 - k, 101 + k]).collect();
        assert!(OneWay::of(&around).is_none());
        let mut turns: Vec<u16> = (0..40).collect();
        turns[39] = 1;
        assert!(OneWay::of(&turns).is_none());
        assert!(OneWay::of(&[7]).is_some_and(|line| line.ends() == [7, 7]));
        assert!(OneWay::of(&[]).is_none());
    }
}
