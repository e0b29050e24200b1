//! One level: sets of places, each in order of last use.
//!
//! In: numbers of lines, or of pages. Out: which are there. What is not there comes in for the one that was used
//! longest ago in its set (LRU).

use super::geometry::Associativity;

/// No line has this number: addresses are below 2^63.
const EMPTY: u64 = u64::MAX;

/// A set-associative LRU cache of numbers.
#[derive(Debug, Clone)]
pub struct CacheLevel {
    ways: usize,
    sets: u64,
    /// Set after set; in each the number that was used last comes first.
    held: Vec<u64>,
}

impl CacheLevel {
    /// An empty one.
    ///
    /// # Panics
    /// If the sets of `shape` are not whole, or it has no places.
    pub fn new(shape: Associativity) -> CacheLevel {
        assert!(shape.ways > 0 && shape.places > 0 && shape.places.is_multiple_of(shape.ways), "sets are whole");
        let size = |count: u64| usize::try_from(count).expect("places fit the memory that models them");
        CacheLevel { ways: size(shape.ways), sets: shape.places / shape.ways, held: vec![EMPTY; size(shape.places)] }
    }

    /// Uses `number`; whether it was there. It is afterwards. Up to `ways` comparisons.
    #[inline]
    pub fn touch(&mut self, number: u64) -> bool {
        let set = usize::try_from(number % self.sets).expect("below the number of sets") * self.ways;
        let held = &mut self.held[set..set + self.ways];
        let place = held.iter().position(|&other| other == number);
        held[..=place.unwrap_or(self.ways - 1)].rotate_right(1);
        held[0] = number;
        place.is_some()
    }
}
