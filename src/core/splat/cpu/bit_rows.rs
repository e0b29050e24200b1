//! Rows of bits: which tiles may still change, and which voxels of a line may be seen.
//!
//! In: columns to set or clear. Out: whether any or all bits of a rectangle are set, and runs of set bits.

/// A table of bits, row by row.
#[derive(Default)]
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

    /// Iterates over the runs of bits of `row` that are set between two columns, from left to right if `rises`, else from right to
    /// left.
    #[inline(always)]
    pub(super) fn runs_on_way(&self, row: usize, span: [u16; 2], rises: bool) -> RunsOnWay<'_> {
        RunsOnWay {
            words: &self.bits[self.words * row..][..self.words],
            span: span.map(usize::from),
            rises,
            next: 0,
            bits: 0,
        }
    }

    /// Calls `visit` with the first and last column of each run of bits that are set in a row; a run that crosses from one
    /// word to the next comes in parts.
    #[inline(always)]
    pub(super) fn each_run(&self, row: usize, mut visit: impl FnMut([usize; 2])) {
        for (word, &bits) in self.bits[self.words * row..][..self.words].iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                let run = first_run(bits);
                bits &= (u64::MAX << run[1]) << 1;
                visit(run.map(|bit| 64 * word + bit));
            }
        }
    }
}

/// The runs of bits that are set, on the way from one column to another: the column where each begins, and where it ends.
pub(super) struct RunsOnWay<'a> {
    words: &'a [u64],
    /// First and last column.
    span: [usize; 2],
    rises: bool,
    /// Number of words that were begun.
    next: usize,
    /// Bits of the last one of them that are left; bit 0 is the column met first.
    bits: u64,
}

impl Iterator for RunsOnWay<'_> {
    type Item = [u16; 2];

    #[inline(always)]
    fn next(&mut self) -> Option<[u16; 2]> {
        let [first, last] = self.span.map(|column| column / 64);
        // Places are counted on the way, from the beginning of its first word.
        let column = |place: usize| (if self.rises { 64 * first + place } else { 64 * last + 63 - place }) as u16;
        let mut run: Option<[usize; 2]> = None;
        loop {
            if self.bits == 0 {
                if self.next > last - first {
                    break;
                }
                let word = if self.rises { first + self.next } else { last - self.next };
                let bits = self.words.get(word).map_or(0, |bits| bits & part(word, self.span));
                self.bits = if self.rises { bits } else { bits.reverse_bits() };
                self.next += 1;
                continue;
            }
            let [begin, end] = first_run(self.bits).map(|bit| 64 * (self.next - 1) + bit);
            if run.is_some_and(|run| run[1] + 1 != begin) {
                break;
            }
            self.bits &= (u64::MAX << (end % 64)) << 1;
            run = Some([run.map_or(begin, |run| run[0]), end]);
            // At the end of a word the run may go on in the next one.
            if end % 64 < 63 {
                break;
            }
        }
        run.map(|run| run.map(column))
    }
}

/// Returns the first and the last bit of the first run of bits that are set in a word; there must be one.
#[inline(always)]
fn first_run(bits: u64) -> [usize; 2] {
    let first = bits.trailing_zeros();
    let last = first + (!(bits >> first)).trailing_zeros() - 1;
    [first as usize, last as usize]
}

/// Returns the bits of a word between two columns of its row.
#[inline(always)]
fn part(word: usize, [left, right]: [usize; 2]) -> u64 {
    let first = if word == left / 64 { u64::MAX << (left % 64) } else { u64::MAX };
    let last = if word == right / 64 { u64::MAX >> (63 - right % 64) } else { u64::MAX };
    first & last
}
