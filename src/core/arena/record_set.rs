//! Sets of a lane's records, with one bit per record.
//!
//! Several threads may add records at once: since records are only added, the order does not matter.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::error::{Error, Result};

/// A set of records of one lane. A record is identified by its index in the lane's channels.
#[derive(Debug)]
pub struct RecordSet {
    words: Vec<AtomicU64>,
    len: usize,
}

impl RecordSet {
    /// Creates an empty set for a lane of `len` records; the set takes `len / 8` bytes.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(len: usize) -> Result<RecordSet> {
        let count = len.div_ceil(64);
        let mut words = Vec::new();
        words.try_reserve_exact(count).map_err(|_| Error::out_of_memory("a set of records", 8 * count as u64))?;
        words.resize_with(count, AtomicU64::default);
        Ok(RecordSet { words, len })
    }

    /// Returns the number of records of the lane, in the set or not.
    pub fn lane_records(&self) -> usize {
        self.len
    }

    /// Returns how many bytes a set for a lane of `len` records takes.
    pub fn bytes_for(len: usize) -> u64 {
        8 * len.div_ceil(64) as u64
    }

    /// Adds the record with index `record`; ignores an index past the lane's last record.
    #[inline]
    pub fn insert(&self, record: usize) {
        if let Some(word) = self.words.get(record / 64).filter(|_| record < self.len) {
            let bit = 1 << (record % 64);
            // Most records are in the set already, and loading is cheaper than writing.
            if word.load(Relaxed) & bit == 0 {
                word.fetch_or(bit, Relaxed);
            }
        }
    }

    /// Returns whether the set contains the record with index `record`; false past the lane's last record.
    #[inline]
    pub fn contains(&self, record: usize) -> bool {
        self.words.get(record / 64).is_some_and(|word| word.load(Relaxed) >> (record % 64) & 1 == 1)
    }

    /// Returns the number of records in the set.
    pub fn count(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.load(Relaxed).count_ones())).sum()
    }
}
