//! Rows of bits: which tiles may still change, and which voxels of a line may be seen.

/// A table of bits, row by row.
pub(super) struct BitRows {
    /// Number of words for a row.
    words: usize,
    bits: Vec<u64>,
}

impl BitRows {
    /// Creates a table of zeros.
    pub(super) fn new(columns: usize, rows: usize) -> BitRows {
        let words = columns.div_ceil(64);
        BitRows { words, bits: vec![0; words * rows] }
    }

    pub(super) fn clear_all(&mut self) {
        self.bits.fill(0);
    }

    #[inline(always)]
    pub(super) fn clear_row(&mut self, row: usize) {
        self.bits[self.words * row..][..self.words].fill(0);
    }

    #[inline(always)]
    pub(super) fn clear(&mut self, row: usize, column: usize) {
        self.bits[self.words * row + column / 64] &= !(1 << (column % 64));
    }

    /// Sets the bits of `row` from column `left` to `right`.
    #[inline(always)]
    pub(super) fn set(&mut self, row: usize, [left, right]: [usize; 2]) {
        for word in left / 64..=right / 64 {
            self.bits[self.words * row + word] |= part(word, [left, right]);
        }
    }

    /// Returns whether any bit of `row` between two columns, which may lie outside the table, is set.
    #[inline(always)]
    pub(super) fn any(&self, row: usize, [left, right]: [i32; 2]) -> bool {
        let (left, right) = (left.max(0), right.min(64 * self.words as i32 - 1));
        left <= right && self.any_in([row, row], [left as usize, right as usize])
    }

    /// Returns whether any bit of the rows from `top` to `bottom` and the columns from `left` to `right` is set.
    #[inline(always)]
    pub(super) fn any_in(&self, [top, bottom]: [usize; 2], [left, right]: [usize; 2]) -> bool {
        let rows = &self.bits[self.words * top..self.words * (bottom + 1)];
        let mut rows = rows.chunks_exact(self.words);
        let (first, last) = (left / 64, right / 64);
        if first == last {
            let mask = part(first, [left, right]);
            return rows.any(|row| row[first] & mask != 0);
        }
        rows.any(|row| (first..=last).any(|word| row[word] & part(word, [left, right]) != 0))
    }

    /// Returns whether the bit of `row` and `column` is set; columns outside the table are not.
    #[inline(always)]
    pub(super) fn get(&self, row: usize, column: usize) -> bool {
        let words = &self.bits[self.words * row..][..self.words];
        words.get(column / 64).is_some_and(|word| word >> (column % 64) & 1 == 1)
    }

    /// Returns whether all bits of `row` between two columns, of which there are at most 64, are set.
    #[inline(always)]
    pub(super) fn all(&self, row: usize, [left, right]: [u16; 2]) -> bool {
        let words = &self.bits[self.words * row..][..self.words];
        let (at, len) = (usize::from(left), right.wrapping_sub(left));
        let [word, next] = [at / 64, at / 64 + 1].map(|word| words.get(word).copied().unwrap_or(0));
        let bits = word >> (at % 64) | next << 1 << (63 - at % 64);
        len < 64 && !bits << (63 - len) == 0
    }

    /// Sets the first row to what is set in any of the rows of `other` from `first` to `last`.
    #[inline(always)]
    pub(super) fn set_to_any(&mut self, other: &BitRows, [first, last]: [usize; 2]) {
        self.clear_row(0);
        for row in first..=last {
            for (word, other) in self.bits.iter_mut().zip(&other.bits[other.words * row..][..other.words]) {
                *word |= other;
            }
        }
    }

    /// Returns the bits of `row` in a word of 64 columns, without those before column `left` and after `right`.
    #[inline(always)]
    pub(super) fn word(&self, row: usize, word: usize, [left, right]: [usize; 2]) -> u64 {
        self.bits[self.words * row..][..self.words].get(word).map_or(0, |bits| bits & part(word, [left, right]))
    }

    /// Calls `visit` with the first and last column of each run of bits that are set in a row; a run that crosses from one
    /// word to the next comes in parts.
    #[inline(always)]
    pub(super) fn each_run(&self, row: usize, mut visit: impl FnMut([usize; 2])) {
        for (word, &bits) in self.bits[self.words * row..][..self.words].iter().enumerate() {
            runs(bits).for_each(|run| visit(run.map(|bit| 64 * word + bit)));
        }
    }
}

/// Iterates over the runs of bits that are set in a word: the first and the last bit of each.
#[inline(always)]
pub(super) fn runs(mut bits: u64) -> impl Iterator<Item = [usize; 2]> {
    std::iter::from_fn(move || {
        if bits == 0 {
            return None;
        }
        let first = bits.trailing_zeros();
        let last = first + (!(bits >> first)).trailing_zeros() - 1;
        bits &= (u64::MAX << last) << 1;
        Some([first, last].map(|bit| bit as usize))
    })
}

/// Returns the bits of a word between two columns of its row.
#[inline(always)]
fn part(word: usize, [left, right]: [usize; 2]) -> u64 {
    let first = if word == left / 64 { u64::MAX << (left % 64) } else { u64::MAX };
    let last = if word == right / 64 { u64::MAX >> (63 - right % 64) } else { u64::MAX };
    first & last
}
