//! The pixels of a band of the base plane, in rows. Also tracks the pixels that may still change (*open* pixels).
//!
//! In: a rectangle of the plane. Out: rows of reds, greens, blues and transmittances, each with spare columns so that
//! eight pixels can always be read and written at once. Each cell of 8 x 8 pixels has a count of its open pixels, and
//! each block of 8 x 8 cells a count of its open cells.

use std::ops::Range;

use super::task::BandPixels;
use super::tile_buffer::{OpenCounts, Rect};
use crate::error::Result;
use crate::splat::arith::keep_if;
use crate::splat::frame::zeroed;

/// How many pixels of a row are read and written at once.
pub(super) const EIGHT: usize = 8;
/// Most columns tested at once. A test may start in any column of the band, so each row ends with so many spare ones.
pub(super) const WIDE: usize = 16;

/// Side of a cell in pixels, as a power of 2.
const CELL: i32 = 3;
/// Side of a block of cells in pixels, as a power of 2.
const BLOCK: i32 = 6;

/// The pixels of a band of the plane.
pub(super) struct RowBuffer {
    pub(super) rect: Rect,
    /// Length of a row of one colour, in values: the band's columns and [`WIDE`] more.
    pitch: usize,
    values: Box<[f32]>,
    /// For each cell: how many of its pixels may still change.
    open_pixels: OpenCounts,
    /// For each block: how many of its cells have pixels that may still change.
    open_cells: OpenCounts,
}

impl RowBuffer {
    /// Creates the pixels of `rect`, which is not empty, with colours 0 and transmittances 1.
    pub(super) fn new(rect: Rect) -> Result<RowBuffer> {
        let columns = (rect.x1 - rect.x0) as usize;
        let pitch = columns + WIDE;
        let rows = (rect.y1 - rect.y0) as usize;
        let mut values: Box<[f32]> = zeroed((4 * pitch * rows) as u64)?;
        for row in values.chunks_exact_mut(4 * pitch) {
            row[3 * pitch..][..columns].fill(1.0);
        }
        let (open_pixels, open_cells) = (OpenCounts::new(rect, CELL, 0), OpenCounts::new(rect, BLOCK, CELL));
        Ok(RowBuffer { rect, pitch, values, open_pixels, open_cells })
    }

    /// Returns the index in `values` of the red of pixel (`x`, `y`).
    #[inline(always)]
    fn index(&self, x: i32, y: i32) -> usize {
        4 * self.pitch * (y - self.rect.y0) as usize + (x - self.rect.x0) as usize
    }

    /// Returns whether any pixel may still change in the `COLUMNS` columns (at most [`WIDE`]) that start at `x` and the
    /// `count` rows that start at `y`. Column `x` must lie in the band; the rows need not.
    #[inline(always)]
    pub(super) fn are_open<const COLUMNS: usize>(&self, x: i32, y: i32, count: usize, stop: f32) -> bool {
        let mut most = [-1.0f32; COLUMNS];
        let rows = self.clipped_rows(y, count);
        let (mut index, stride) = (self.index(x, y + rows.start as i32) + 3 * self.pitch, 4 * self.pitch);
        for _ in rows {
            let clear: &[f32; COLUMNS] = self.values[index..].first_chunk().expect("rows have spare columns");
            for i in 0..COLUMNS {
                most[i] = if clear[i] > most[i] { clear[i] } else { most[i] };
            }
            index += stride;
        }
        let mut are_open = false;
        for most in most {
            are_open |= most >= stop;
        }
        are_open
    }

    /// Returns which of the `count` rows that start at `y` lie in the band, counted from `y`.
    #[inline(always)]
    fn clipped_rows(&self, y: i32, count: usize) -> Range<usize> {
        let from = (self.rect.y0 - y).max(0) as usize;
        let to = (self.rect.y1 - y).max(0) as usize;
        from..to.min(count)
    }

    /// Composites a splat behind the pixels of eight columns that start at `x` and `count` rows that start at `y`. It
    /// takes the part `amounts` of each pixel's light; pixels below `stop` keep their values.
    #[inline(always)]
    pub(super) fn composite(
        &mut self,
        [x, y]: [i32; 2],
        amounts: &[[f32; EIGHT]; EIGHT],
        count: usize,
        ink: &[f32; 4],
        stop: f32,
    ) {
        let rows = self.clipped_rows(y, count.min(EIGHT));
        if rows.is_empty() {
            return;
        }
        let (index, pitch) = (self.index(x, y + rows.start as i32), self.pitch);
        let [red, green, blue, _] = *ink;
        let (mut before, mut closed_rows) = ([[0.0; EIGHT]; EIGHT], 0u8);
        let mut remaining = &mut self.values[index..];
        for row in rows {
            let (reds, others) = remaining.split_at_mut(pitch);
            let (greens, others) = others.split_at_mut(pitch);
            let (blues, clear) = others.split_at_mut(pitch);
            let now = first_eight(clear);
            let old = *now;
            let losses = losses(&old, &amounts[row], stop);
            let new = difference(&old, &losses);
            *now = new;
            before[row] = old;
            add_scaled(first_eight(reds), &losses, red);
            add_scaled(first_eight(greens), &losses, green);
            add_scaled(first_eight(blues), &losses, blue);
            closed_rows |= u8::from(any_closed(&old, &new, stop)) << row;
            // There is no row after the last one.
            remaining = clear.get_mut(pitch..).unwrap_or_default();
        }
        if closed_rows != 0 {
            self.count_closed([x, y], &before, closed_rows, stop);
        }
    }

    /// Returns whether no pixel of `rect`, which lies in the band, can change any more.
    pub(super) fn is_closed(&self, rect: Rect) -> bool {
        let cells = |low: i32, high: i32| (low >> CELL..=(high - 1) >> CELL).map(|cell| cell << CELL);
        cells(rect.y0, rect.y1)
            .all(|y| cells(rect.x0, rect.x1).all(|x| self.open_cells.is_zero(x, y) || self.open_pixels.is_zero(x, y)))
    }

    /// Updates the counts of open pixels for those pixels of a splat that fell below `stop`, in the rows whose bit in
    /// `closed_rows` is set. `before` has the transmittances before the splat.
    #[cold]
    #[inline(never)]
    fn count_closed(&mut self, [x, y]: [i32; 2], before: &[[f32; EIGHT]; EIGHT], closed_rows: u8, stop: f32) {
        for (row, before) in before.iter().enumerate().filter(|(row, _)| closed_rows >> row & 1 != 0) {
            let y = y + row as i32;
            let index = self.index(x, y) + 3 * self.pitch;
            for (i, before) in before.iter().enumerate() {
                let x = x + i as i32;
                let is_closed = *before >= stop && self.values[index + i] < stop;
                if is_closed && self.open_pixels.close_one(x, y) {
                    self.open_cells.close_one(x, y);
                }
            }
        }
    }
}

impl BandPixels for RowBuffer {
    fn rect(&self) -> Rect {
        self.rect
    }

    fn visit_row(&self, y: i32, mut visit: impl FnMut(i32, [f32; 4])) {
        let index = self.index(self.rect.x0, y);
        let [red, green, blue, clear] = [0, 1, 2, 3].map(|plane| &self.values[index + plane * self.pitch..]);
        for (i, x) in (self.rect.x0..self.rect.x1).enumerate() {
            visit(x, [red[i], green[i], blue[i], clear[i]]);
        }
    }
}

/// Returns the first eight values of a row.
#[inline(always)]
fn first_eight(values: &mut [f32]) -> &mut [f32; EIGHT] {
    values.first_chunk_mut().expect("rows have spare columns")
}

// Each function does one step for all eight pixels: the compiler does not vectorise one loop around all steps.

/// Returns the light that each pixel loses to a splat.
#[inline(always)]
fn losses(before: &[f32; EIGHT], amounts: &[f32; EIGHT], stop: f32) -> [f32; EIGHT] {
    let mut losses = [0.0; EIGHT];
    for i in 0..EIGHT {
        losses[i] = keep_if(before[i] >= stop, before[i] * amounts[i]);
    }
    losses
}

/// Returns the transmittances after the losses.
#[inline(always)]
fn difference(before: &[f32; EIGHT], losses: &[f32; EIGHT]) -> [f32; EIGHT] {
    let mut after = [0.0; EIGHT];
    for i in 0..EIGHT {
        after[i] = before[i] - losses[i];
    }
    after
}

/// Adds each loss times `ink`, the splat's amount of one colour, to the value of its pixel.
#[inline(always)]
fn add_scaled(values: &mut [f32; EIGHT], losses: &[f32; EIGHT], ink: f32) {
    let mut new = [0.0; EIGHT];
    for i in 0..EIGHT {
        new[i] = values[i] + losses[i] * ink;
    }
    *values = new;
}

/// Returns whether the transmittance of any pixel fell below `stop`, so that the pixel no longer changes.
#[inline(always)]
fn any_closed(before: &[f32; EIGHT], after: &[f32; EIGHT], stop: f32) -> bool {
    let mut any = false;
    for i in 0..EIGHT {
        any |= (before[i] >= stop) & (after[i] < stop);
    }
    any
}
