//! A band of the base plane: its pixels, and which of them can no longer change.
//!
//! In: a rectangle of the plane. Out: rows of reds, greens, blues and transmittances, each row with columns to spare so
//! that eight pixels can always be read and written at once. Cells of 8 x 8 pixels count those that may still change, and
//! blocks of 8 x 8 cells their cells that have such pixels.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "coordinates lie on a plane of 16,384 pixels a side"
)]

use std::ops::Range;

use super::planes::{Count, Rect};
use crate::error::{Error, Result};
use crate::splat::arith::keep_if;

/// Pixels that are read and written at once.
pub(super) const EIGHT: usize = 8;
/// Columns that are asked about at once, at most. As many are to spare, as they may begin at the band's last pixel.
pub(super) const WIDE: usize = 16;

/// Side of a cell in pixels, as a shift; and of a block.
const CELL: i32 = 3;
const BLOCK_OF_CELLS: i32 = 6;

/// A band of the plane.
pub(super) struct Rows {
    pub(super) rect: Rect,
    /// Columns of each of the four values' rows, and [`WIDE`] to spare.
    pitch: usize,
    values: Box<[f32]>,
    /// Pixels of each cell that may still change.
    cells: Count,
    /// Cells of each block that have such pixels.
    blocks: Count,
}

impl Rows {
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub(super) fn new(rect: Rect) -> Result<Rows> {
        let columns = (rect.x1 - rect.x0) as usize;
        let pitch = columns + WIDE;
        let rows = (rect.y1 - rect.y0) as usize;
        let len = 4 * pitch * rows;
        let mut values = Vec::new();
        values.try_reserve_exact(len).map_err(|_| Error::out_of_memory("the picture", 4 * len as u64))?;
        values.resize(len, 0.0);
        for row in values.chunks_exact_mut(4 * pitch) {
            row[3 * pitch..][..columns].fill(1.0);
        }
        let (cells, blocks) = (Count::new(rect, CELL, 0), Count::new(rect, BLOCK_OF_CELLS, CELL));
        Ok(Rows { rect, pitch, values: values.into_boxed_slice(), cells, blocks })
    }

    /// Where row `y`'s reds begin in column `x`.
    #[inline(always)]
    fn at(&self, x: i32, y: i32) -> usize {
        4 * self.pitch * (y - self.rect.y0) as usize + (x - self.rect.x0) as usize
    }

    /// Whether one of `COLUMNS` columns from `x` on may still change in one of `count` rows from `y` on; the column lies in
    /// the band, and they are [`WIDE`] at most.
    #[inline(always)]
    pub(super) fn are_open<const COLUMNS: usize>(&self, x: i32, y: i32, count: usize, stop: f32) -> bool {
        let mut most = [-1.0f32; COLUMNS];
        let rows = self.clipped(y, count);
        let (mut at, stride) = (self.at(x, y + rows.start as i32) + 3 * self.pitch, 4 * self.pitch);
        for _ in rows {
            let clear: &[f32; COLUMNS] = self.values[at..].first_chunk().expect("rows have columns to spare");
            for i in 0..COLUMNS {
                most[i] = if clear[i] > most[i] { clear[i] } else { most[i] };
            }
            at += stride;
        }
        let mut are_open = false;
        for most in most {
            are_open |= most >= stop;
        }
        are_open
    }

    /// Those of `count` rows from `y` on that lie in the band.
    #[inline(always)]
    fn clipped(&self, y: i32, count: usize) -> Range<usize> {
        let from = (self.rect.y0 - y).max(0) as usize;
        let to = (self.rect.y1 - y).max(0) as usize;
        from..to.min(count)
    }

    /// Composites a splat of `count` rows, the first in row `y`, eight columns from `x` on, behind what is there.
    #[inline(always)]
    pub(super) fn put(
        &mut self,
        [x, y]: [i32; 2],
        amounts: &[[f32; EIGHT]; EIGHT],
        count: usize,
        ink: &[f32; 4],
        stop: f32,
    ) {
        let rows = self.clipped(y, count.min(EIGHT));
        if rows.is_empty() {
            return;
        }
        let (at, pitch) = (self.at(x, y + rows.start as i32), self.pitch);
        let [red, green, blue, _] = *ink;
        let (mut before, mut closed) = ([[0.0; EIGHT]; EIGHT], 0u8);
        let mut left = &mut self.values[at..];
        for row in rows {
            let (reds, rest) = left.split_at_mut(pitch);
            let (greens, rest) = rest.split_at_mut(pitch);
            let (blues, clear) = rest.split_at_mut(pitch);
            let now = first_eight(clear);
            let old = *now;
            let parts = parts(&old, &amounts[row], stop);
            let new = less(&old, &parts);
            *now = new;
            before[row] = old;
            add(first_eight(reds), &parts, red);
            add(first_eight(greens), &parts, green);
            add(first_eight(blues), &parts, blue);
            closed |= u8::from(crossed(&old, &new, stop)) << row;
            // The last row has no other behind it.
            left = clear.get_mut(pitch..).unwrap_or_default();
        }
        if closed != 0 {
            self.close([x, y], &before, closed, stop);
        }
    }

    /// Whether no pixel of `rect`, which lies in the band's, changes any more.
    pub(super) fn is_closed(&self, rect: Rect) -> bool {
        let cells = |low: i32, high: i32| (low >> CELL..=(high - 1) >> CELL).map(|cell| cell << CELL);
        cells(rect.y0, rect.y1)
            .all(|y| cells(rect.x0, rect.x1).all(|x| self.blocks.is_zero(x, y) || self.cells.is_zero(x, y)))
    }

    /// Counts the pixels of a splat's rows `closed`, a bit each, that changed for the last time since they were as `before`.
    #[cold]
    #[inline(never)]
    fn close(&mut self, [x, y]: [i32; 2], before: &[[f32; EIGHT]; EIGHT], closed: u8, stop: f32) {
        for (row, before) in before.iter().enumerate().filter(|(row, _)| closed >> row & 1 != 0) {
            let y = y + row as i32;
            let at = self.at(x, y) + 3 * self.pitch;
            for (i, before) in before.iter().enumerate() {
                if *before >= stop && self.values[at + i] < stop {
                    let x = x + i as i32;
                    let open = self.cells.at(x, y);
                    *open -= 1;
                    if *open == 0 {
                        *self.blocks.at(x, y) -= 1;
                    }
                }
            }
        }
    }

    /// Row `y`: its reds, greens, blues and transmittances.
    pub(super) fn row(&self, y: i32) -> [&[f32]; 4] {
        let columns = (self.rect.x1 - self.rect.x0) as usize;
        let at = self.at(self.rect.x0, y);
        [0, 1, 2, 3].map(|plane| &self.values[at + plane * self.pitch..][..columns])
    }
}

#[inline(always)]
fn first_eight(values: &mut [f32]) -> &mut [f32; EIGHT] {
    values.first_chunk_mut().expect("rows have columns to spare")
}

// Each step a function of its own on all eight pixels: of one loop around all steps the compiler makes eight by one.

/// What pixels take of a splat.
#[inline(always)]
fn parts(before: &[f32; EIGHT], amounts: &[f32; EIGHT], stop: f32) -> [f32; EIGHT] {
    let mut parts = [0.0; EIGHT];
    for i in 0..EIGHT {
        parts[i] = keep_if(before[i] >= stop, before[i] * amounts[i]);
    }
    parts
}

#[inline(always)]
fn less(before: &[f32; EIGHT], parts: &[f32; EIGHT]) -> [f32; EIGHT] {
    let mut after = [0.0; EIGHT];
    for i in 0..EIGHT {
        after[i] = before[i] - parts[i];
    }
    after
}

#[inline(always)]
fn add(values: &mut [f32; EIGHT], parts: &[f32; EIGHT], ink: f32) {
    let mut new = [0.0; EIGHT];
    for i in 0..EIGHT {
        new[i] = values[i] + parts[i] * ink;
    }
    *values = new;
}

/// Whether one of the pixels changed for the last time.
#[inline(always)]
fn crossed(before: &[f32; EIGHT], after: &[f32; EIGHT], stop: f32) -> bool {
    let mut any = false;
    for i in 0..EIGHT {
        any |= (before[i] >= stop) & (after[i] < stop);
    }
    any
}
