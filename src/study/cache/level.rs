//! One level of the model: a cache or a translation buffer, in sets of places with least recently used replacement.

use super::geometry::Associativity;

/// Marks an empty place: addresses are below 2^63.
const EMPTY: u64 = u64::MAX;

/// A set-associative cache of line or page numbers, which replaces the least recently used one (LRU).
#[derive(Debug, Clone)]
pub struct CacheLevel {
    ways: usize,
    sets: u64,
    /// The line or page numbers, set after set; in each set the most recently used number comes first.
    held: Vec<u64>,
}

impl CacheLevel {
    /// Returns an empty cache.
    ///
    /// # Panics
    /// If `shape` has no places, or if its ways do not divide its places.
    pub fn new(shape: Associativity) -> CacheLevel {
        assert!(shape.ways > 0 && shape.places > 0 && shape.places.is_multiple_of(shape.ways), "sets are whole");
        let size = |count: u64| usize::try_from(count).expect("places fit the memory that models them");
        CacheLevel { ways: size(shape.ways), sets: shape.places / shape.ways, held: vec![EMPTY; size(shape.places)] }
    }

    /// Touches line or page `number`, and returns whether it was in the cache. At most `ways` comparisons.
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
