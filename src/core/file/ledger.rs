//! The ledger: which parts of a map have been read since its pages were last released.
//!
//! The system maps pages around a fault, in aligned pieces of 64 KiB (Linux: `fault_around_bytes`), so that is the
//! unit: a piece that was told of counts as resident in full. Threads share one ledger and never wait for each
//! other, except while pages are released.
//!
//! A thread may touch, after a release, what it told of before. Such pieces are resident and not counted until the
//! next release; a reader has at most [`IN_FLIGHT`](crate::arena::pager::IN_FLIGHT) bytes of them.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

/// Bytes of a piece, a power of two.
pub(super) const PIECE: u64 = 1 << 16;

/// What has been read of one map.
#[derive(Debug)]
pub(super) struct Ledger {
    /// First address of the map, and its length.
    base: usize,
    len: usize,
    /// A bit for each piece that the map meets.
    pieces: Box<[AtomicU64]>,
    /// Bits set; for a moment off by what other threads are setting.
    held: AtomicI64,
    /// Pieces that may be held.
    most: i64,
}

impl Ledger {
    /// For the map `bytes`, of which at most `most_bytes` may be resident, at least one piece.
    pub(super) fn new(bytes: &[u8], most_bytes: u64) -> Ledger {
        let base = bytes.as_ptr().addr();
        let first = base as u64 / PIECE;
        let last = (base as u64 + bytes.len() as u64) / PIECE;
        let words = (last - first + 1).div_ceil(64);
        Ledger {
            base,
            len: bytes.len(),
            pieces: (0..words).map(|_| AtomicU64::new(0)).collect(),
            held: AtomicI64::new(0),
            most: i64::try_from(most_bytes / PIECE).unwrap_or(i64::MAX).max(1),
        }
    }

    /// Notes that `bytes` are about to be read; whether more is held than may be. Bytes outside the map are nobody's.
    #[inline]
    pub(super) fn note(&self, bytes: &[u8]) -> bool {
        let start = bytes.as_ptr().addr();
        let inside = start.checked_sub(self.base).is_some_and(|offset| offset + bytes.len() <= self.len);
        if bytes.is_empty() || !inside {
            return false;
        }
        let first = self.base as u64 / PIECE;
        let (from, to) = (start as u64 / PIECE - first, (start + bytes.len() - 1) as u64 / PIECE - first);
        let mut new = 0;
        for piece in from..=to {
            let Some(word) = usize::try_from(piece / 64).ok().and_then(|word| self.pieces.get(word)) else { break };
            let bit = 1 << (piece % 64);
            // Looked at first: most pieces are known, and a look is shared by all processors.
            if word.load(Ordering::Relaxed) & bit == 0 && word.fetch_or(bit, Ordering::Relaxed) & bit == 0 {
                new += 1;
            }
        }
        new > 0 && self.held.fetch_add(new, Ordering::Relaxed) + new > self.most
    }

    /// Whether more is held than may be.
    pub(super) fn is_full(&self) -> bool {
        self.held.load(Ordering::Relaxed) > self.most
    }

    /// Nothing is held any more.
    pub(super) fn clear(&self) {
        let cleared: u32 = self.pieces.iter().map(|word| word.swap(0, Ordering::Relaxed).count_ones()).sum();
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
        let piece = |index: usize| &bytes[index * SIZE..][..1];
        let ledger = Ledger::new(&bytes, 4 * PIECE);
        for _ in 0..3 {
            assert!((0..4).all(|index| !ledger.note(piece(index))));
        }
        assert!(ledger.note(piece(30)) && ledger.is_full());
        ledger.clear();
        assert!(!ledger.is_full() && ledger.held.load(Ordering::Relaxed) == 0);
        // A range counts every piece that it meets; one that is not in the map none.
        assert!(ledger.note(&bytes[..5 * SIZE + 1]));
        ledger.clear();
        let others = vec![0u8; 40 * SIZE];
        assert!(!ledger.note(&others) && !ledger.note(&bytes[..0]));
        assert_eq!(ledger.held.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn threads_share_one_count() {
        let bytes = vec![0u8; 64 * SIZE];
        let ledger = Ledger::new(&bytes, u64::MAX);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| bytes.chunks(1000).for_each(|chunk| assert!(!ledger.note(chunk))));
            }
        });
        let held = ledger.held.load(Ordering::Relaxed);
        assert!((64..=65).contains(&held), "{held}");
    }
}
