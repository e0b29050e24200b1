//! Which part of a plane something was drawn on. The filter and the picture look at no other.
//!
//! In: a plane. Out: for each row, the columns that the filter changes; for each pixel, whether something was drawn near it.

use std::ops::Range;

use crate::parallel::in_parts;
use crate::splat::Frame;

/// How far the filter carries values, in pixels: 0.268^16 is 7e-10.
const CARRIED: usize = 16;

/// Which part of a plane something was drawn on.
pub(super) struct Covered {
    /// For each row: the columns on which something was drawn, and those around them to which the filter carries values.
    spans: Vec<Range<usize>>,
    /// For each pixel: whether something was drawn on it or near it.
    pub(super) near: Vec<bool>,
}

impl Covered {
    /// `None` if nothing was drawn. `reach`: how many columns and rows away pixels are near.
    pub(super) fn of(plane: &Frame, reach: usize, threads: usize) -> Option<Covered> {
        let [columns, rows] = plane.size().map(|side| side as usize);
        let words = columns.div_ceil(64);
        let mut drawn = vec![0u64; words * rows];
        in_parts(&mut drawn, words, threads, |from, drawn| {
            let pixels = plane.pixels().as_chunks::<4>().0[columns * from..].chunks_exact(columns);
            for (bits, row) in drawn.chunks_exact_mut(words).zip(pixels) {
                for (bits, pixels) in bits.iter_mut().zip(row.chunks(64)) {
                    *bits = pixels.iter().rev().fold(0, |bits, pixel| bits << 1 | u64::from(pixel[3] > 0.0));
                }
            }
        });
        let lines: Vec<&[u64]> = drawn.chunks_exact(words).collect();
        let mut near = vec![false; columns * rows];
        in_parts(&mut near, columns, threads, |from, near| {
            let mut line = vec![0; words];
            for (row, near) in (from..).zip(near.chunks_exact_mut(columns)) {
                line.fill(0);
                for other in &lines[row.saturating_sub(reach)..rows.min(row + reach + 1)] {
                    line.iter_mut().zip(*other).for_each(|(bits, other)| *bits |= other);
                }
                (0..reach).for_each(|_| spread(&mut line));
                for (bits, near) in line.iter().zip(near.chunks_mut(64)) {
                    near.iter_mut().enumerate().for_each(|(i, near)| *near = bits >> i & 1 == 1);
                }
            }
        });
        let spans: Vec<_> = lines.iter().map(|line| span(line, columns)).collect();
        spans.iter().any(|span| !span.is_empty()).then_some(Covered { spans, near })
    }

    /// Returns the columns that the filter changes in any of some rows.
    pub(super) fn columns_of(&self, rows: Range<usize>) -> Range<usize> {
        let spans = self.spans[rows].iter().filter(|span| !span.is_empty());
        spans.cloned().reduce(|a, b| a.start.min(b.start)..a.end.max(b.end)).unwrap_or_default()
    }

    /// Returns the rows that the filter changes in any of some columns.
    pub(super) fn rows_of(&self, columns: Range<usize>) -> Range<usize> {
        let meets = |span: &Range<usize>| span.start.max(columns.start) < span.end.min(columns.end);
        let Some(first) = self.spans.iter().position(meets) else { return 0..0 };
        let last = self.spans.iter().rposition(meets).unwrap_or(first);
        first.saturating_sub(CARRIED)..(last + CARRIED + 1).min(self.spans.len())
    }
}

/// Sets the bits beside those that are set in a row.
fn spread(row: &mut [u64]) {
    let mut left = 0;
    for word in 0..row.len() {
        let right = row.get(word + 1).map_or(0, |next| next << 63);
        let bits = row[word];
        row[word] = bits | bits << 1 | left | bits >> 1 | right;
        left = bits >> 63;
    }
}

/// Returns the columns from the first to the last bit that is set in a row, and those to which the filter carries values.
fn span(row: &[u64], columns: usize) -> Range<usize> {
    let Some(first) = row.iter().position(|bits| *bits != 0) else { return 0..0 };
    let last = row.iter().rposition(|bits| *bits != 0).unwrap_or(first);
    let left = 64 * first + row[first].trailing_zeros() as usize;
    let right = 64 * last + 63 - row[last].leading_zeros() as usize;
    left.saturating_sub(CARRIED)..(right + CARRIED + 1).min(columns)
}
