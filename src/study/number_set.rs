//! Sets of numbers, such as touched bytes. Each number has one bit, so adding a range takes one step per 64 numbers.

/// A set of numbers from 0 to a limit.
#[derive(Debug, Clone, Default)]
pub(crate) struct NumberSet {
    words: Vec<u64>,
    count: u64,
}

impl NumberSet {
    /// Returns an empty set for the numbers below `numbers`.
    pub(crate) fn new(numbers: u64) -> NumberSet {
        let words = usize::try_from(numbers.div_ceil(64)).expect("arrays that lie in memory have that many bytes");
        NumberSet { words: vec![0; words], count: 0 }
    }

    /// Adds the numbers from `first` to `end`, exclusive, and returns how many are new.
    #[inline]
    pub(crate) fn add(&mut self, first: u64, end: u64) -> u64 {
        let before = self.count;
        let mut from = first;
        while from < end {
            let bit = from % 64;
            let upto = (from - bit + 64).min(end);
            let mask = (u64::MAX >> (64 - (upto - from))) << bit;
            let word = &mut self.words[usize::try_from(from / 64).expect("below their number")];
            self.count += u64::from((mask & !*word).count_ones());
            *word |= mask;
            from = upto;
        }
        self.count - before
    }

    /// Adds `number`, unless it is at or above the limit, rounded up to a multiple of 64.
    pub(crate) fn insert(&mut self, number: u64) {
        if number / 64 < self.words.len() as u64 {
            self.add(number, number + 1);
        }
    }

    /// Returns how many numbers are in the set.
    pub(crate) fn count(&self) -> u64 {
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_count_each_number_once() {
        let mut set = NumberSet::new(1000);
        assert_eq!(set.add(60, 70), 10);
        assert_eq!(set.add(0, 64), 60);
        assert_eq!(set.add(64, 128), 58);
        assert_eq!(set.add(5, 5), 0);
        assert_eq!(set.add(0, 1000), 1000 - 128);
        assert_eq!(set.count(), 1000);
    }
}
