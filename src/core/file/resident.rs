//! Counts which parts of a file map were read since its pages were last released.
//!
//! The system maps more than the page that is read, so a file is counted in blocks that it maps at once
//! ([`block_bytes`](crate::arena::pager::block_bytes)). Threads share the count and never wait for each other, except while
//! pages are released.
//!
//! After a release, a thread may touch pages that it announced before the release. Such blocks are resident but not
//! counted until the next release; per reader they have at most [`in_flight`](crate::arena::pager::in_flight) bytes.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

/// The blocks of one file map that have been read since the last release of pages.
#[derive(Debug)]
pub(super) struct ResidentPages {
    /// First address of the map; `len` is its length in bytes.
    base: usize,
    len: usize,
    block_bytes: u64,
    /// One bit for each block that the map overlaps.
    blocks: Box<[AtomicU64]>,
    /// Number of set bits in `blocks`; briefly too small while other threads set bits.
    held: AtomicI64,
    most: i64,
}

impl ResidentPages {
    /// Starts counting for the map `bytes` in blocks of `block_bytes`; at most `most_bytes`, or one block, may be resident.
    pub(super) fn new(bytes: &[u8], block_bytes: u64, most_bytes: u64) -> ResidentPages {
        let base = bytes.as_ptr().addr();
        let first = base as u64 / block_bytes;
        let last = (base as u64 + bytes.len() as u64) / block_bytes;
        let words = (last - first + 1).div_ceil(64);
        ResidentPages {
            base,
            len: bytes.len(),
            block_bytes,
            blocks: (0..words).map(|_| AtomicU64::new(0)).collect(),
            held: AtomicI64::new(0),
            most: i64::try_from(most_bytes / block_bytes).unwrap_or(i64::MAX).max(1),
        }
    }

    /// Notes that `bytes` are about to be read; returns whether too many blocks are then resident. Ignores bytes
    /// outside the map.
    #[inline]
    pub(super) fn note(&self, bytes: &[u8]) -> bool {
        let start = bytes.as_ptr().addr();
        let inside = start.checked_sub(self.base).is_some_and(|offset| offset + bytes.len() <= self.len);
        if bytes.is_empty() || !inside {
            return false;
        }
        let block = |address: usize| address as u64 / self.block_bytes;
        let first = block(self.base);
        let (from, to) = (block(start) - first, block(start + bytes.len() - 1) - first);
        let mut new = 0;
        for block in from..=to {
            let Some(word) = usize::try_from(block / 64).ok().and_then(|word| self.blocks.get(word)) else { break };
            let bit = 1 << (block % 64);
            // Load first: most blocks are known, and processors share a line that is only read.
            if word.load(Ordering::Relaxed) & bit == 0 && word.fetch_or(bit, Ordering::Relaxed) & bit == 0 {
                new += 1;
            }
        }
        new > 0 && self.held.fetch_add(new, Ordering::Relaxed) + new > self.most
    }

    pub(super) fn is_full(&self) -> bool {
        self.held.load(Ordering::Relaxed) > self.most
    }

    /// Clears all bits; call it when pages are released.
    pub(super) fn clear(&self) {
        let cleared: u32 = self.blocks.iter().map(|word| word.swap(0, Ordering::Relaxed).count_ones()).sum();
        self.held.fetch_sub(cleared.into(), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 1 << 16;

    #[test]
    fn pieces_count_once_until_they_are_released() {
        let bytes = vec![0u8; 40 * SIZE];
        let block = |index: usize| &bytes[index * SIZE..][..1];
        let resident = ResidentPages::new(&bytes, SIZE as u64, 4 * SIZE as u64);
        for _ in 0..3 {
            assert!((0..4).all(|index| !resident.note(block(index))));
        }
        assert!(resident.note(block(30)) && resident.is_full());
        resident.clear();
        assert!(!resident.is_full() && resident.held.load(Ordering::Relaxed) == 0);
        // A range of bytes counts every block that it overlaps; bytes outside the map count none.
        assert!(resident.note(&bytes[..5 * SIZE + 1]));
        resident.clear();
        let others = vec![0u8; 40 * SIZE];
        assert!(!resident.note(&others) && !resident.note(&bytes[..0]));
        assert_eq!(resident.held.load(Ordering::Relaxed), 0);
    }
}
