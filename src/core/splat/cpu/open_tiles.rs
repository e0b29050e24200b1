//! Which tiles may still change: a bit a tile, in rows.

/// Which tiles of a band may still change: a bit a tile.
pub(super) struct OpenTiles {
    /// Number of words for a row.
    words: usize,
    bits: Vec<u64>,
}

impl OpenTiles {
    pub(super) fn new(columns: usize, rows: usize) -> OpenTiles {
        let words = columns.div_ceil(64);
        OpenTiles { words, bits: vec![0; words * rows] }
    }

    pub(super) fn clear_all(&mut self) {
        self.bits.fill(0);
    }

    pub(super) fn set(&mut self, row: usize, column: usize) {
        self.bits[self.words * row + column / 64] |= 1 << (column % 64);
    }

    #[inline(always)]
    pub(super) fn clear(&mut self, row: usize, column: usize) {
        self.bits[self.words * row + column / 64] &= !(1 << (column % 64));
    }

    /// Returns whether any tile of `row` between two columns is open.
    pub(super) fn any(&self, row: usize, [left, right]: [i32; 2]) -> bool {
        let bits = &self.bits[self.words * row..][..self.words];
        let (left, right) = (left.max(0) as usize, right.min(64 * self.words as i32 - 1));
        if right < left as i32 {
            return false;
        }
        let right = right as usize;
        (left / 64..=right / 64).any(|word| {
            let first = if word == left / 64 { u64::MAX << (left % 64) } else { u64::MAX };
            let last = if word == right / 64 { u64::MAX >> (63 - right % 64) } else { u64::MAX };
            bits[word] & first & last != 0
        })
    }

    /// Calls `visit` with the first and last column of each run of open tiles of `row`.
    #[inline(always)]
    pub(super) fn each_run(&self, row: usize, mut visit: impl FnMut(usize, usize)) {
        let bits = &self.bits[self.words * row..][..self.words];
        for (word, &bits) in bits.iter().enumerate() {
            let mut left = bits;
            while left != 0 {
                let from = left.trailing_zeros() as usize;
                let len = (!(left >> from)).trailing_zeros() as usize;
                visit(64 * word + from, 64 * word + from + len - 1);
                left = if from + len >= 64 { 0 } else { left & (u64::MAX << (from + len)) };
            }
        }
    }
}
