//! The accumulation buffer of a band.
//!
//! In: a rectangle of the picture, in absolute pixel coordinates. Out: rows of pixels, red, green, blue and a fourth
//! value side by side, with guard pixels on all sides that a kernel may overwrite. Memory is touched two whole pixels
//! at a time, always at the same 32 bytes: neighbouring splats overlap, and a processor hands a store on to the next
//! load only where that asks for no more than was stored. Footprints of eight pixels and more pay for it (see
//! `raster.rs`). The pitch keeps rows away from multiples of 4,096 bytes: at such a pitch all rows of a splat fall
//! into one cache set and stores block the loads of the next row (measured: four times slower).

use crate::error::{Error, Result};

/// Guard pixels on every side; at least.
const GUARD: i32 = 16;

/// A half-open rectangle of pixels, in absolute picture coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rect {
    /// First column.
    pub x0: i32,
    /// First row; rows run downward.
    pub y0: i32,
    /// One past the last column.
    pub x1: i32,
    /// One past the last row.
    pub y1: i32,
}

impl Rect {
    /// Columns; 0 if the rectangle is empty.
    pub(crate) fn width(&self) -> usize {
        usize::try_from(self.x1 - self.x0).unwrap_or(0)
    }

    /// Rows; 0 if the rectangle is empty.
    pub(crate) fn height(&self) -> usize {
        usize::try_from(self.y1 - self.y0).unwrap_or(0)
    }
}

/// Two neighbouring pixels, the first in an even column.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(crate) struct Pair(pub(crate) [f32; 8]);

/// Pixels of one band. What the fourth value holds is the blend's business.
#[derive(Debug)]
pub(crate) struct Planes {
    pub(crate) rect: Rect,
    /// Pairs from row to row.
    pitch: usize,
    /// Column and row of the first pixel, a guard; the column is even.
    left: i32,
    top: i32,
    pairs: Vec<Pair>,
}

impl Planes {
    /// Pixels for `rect`: colours 0, the fourth value `fourth`.
    ///
    /// # Errors
    /// [`Error::Limit`] if the memory cannot be had.
    pub(crate) fn new(rect: Rect, fourth: f32) -> Result<Planes> {
        let (left, top) = ((rect.x0 & !1) - GUARD, rect.y0 - GUARD);
        let guards = 2 * GUARD as usize;
        let pitch = pitch_for(rect.width() + guards + 1);
        let len = pitch * (rect.height() + guards);
        let mut pairs = Vec::new();
        pairs.try_reserve_exact(len).map_err(|_| Error::Limit {
            what: "memory for the picture in bytes".into(),
            need: (size_of::<Pair>() * len) as u64,
            have: 0,
        })?;
        pairs.resize(len, Pair([0.0, 0.0, 0.0, fourth, 0.0, 0.0, 0.0, fourth]));
        Ok(Planes { rect, pitch, left, top, pairs })
    }

    /// Index of the pair that holds pixel (`x`, `y`), which may be a guard.
    #[inline(always)]
    pub(crate) fn index(&self, x: i32, y: i32) -> usize {
        (y - self.top) as usize * self.pitch + ((x - self.left) >> 1) as usize
    }

    /// Pairs from row to row.
    #[inline(always)]
    pub(crate) fn pitch(&self) -> usize {
        self.pitch
    }

    /// All pairs.
    #[inline(always)]
    pub(crate) fn pairs(&mut self) -> &mut [Pair] {
        &mut self.pairs
    }

    /// Fourth value of pixel (`x`, `y`), which lies in the rectangle.
    #[inline(always)]
    pub(crate) fn fourth(&self, x: i32, y: i32) -> f32 {
        let Pair(pair) = &self.pairs[self.index(x, y)];
        if x & 1 == 0 { pair[3] } else { pair[7] }
    }

    /// Pixel (`x`, `y`), which lies in the rectangle.
    pub(crate) fn pixel(&mut self, x: i32, y: i32) -> &mut [f32; 4] {
        let index = self.index(x, y);
        let (pixels, _) = self.pairs[index].0.as_chunks_mut();
        &mut pixels[(x & 1) as usize]
    }

    /// Pixels of row `y` without guards.
    pub(crate) fn pixels(&self, y: i32) -> impl Iterator<Item = &[f32; 4]> {
        let row = &self.pairs[self.index(self.left, y)..][..self.pitch];
        let skip = usize::try_from(self.rect.x0 - self.left).unwrap_or(0);
        row.iter().flat_map(|Pair(pair)| pair.as_chunks().0).skip(skip).take(self.rect.width())
    }
}

/// Pairs per row of at least so many pixels: up to eight rows keep off each other's places in a page.
fn pitch_for(pixels: usize) -> usize {
    /// Pairs in 4,096 bytes.
    const PAGE: usize = 128;
    let mut pitch = pixels.div_ceil(2);
    while !(1..=8).all(|rows| (5..=PAGE - 5).contains(&(rows * pitch % PAGE))) {
        pitch += 1;
    }
    pitch
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_rows_of_a_splat_are_a_multiple_of_a_page_apart() {
        for pixels in 1..=16_417 {
            let pitch = pitch_for(pixels);
            assert!(2 * pitch >= pixels && pitch < pixels / 2 + 64, "{pixels}: {pitch}");
            for rows in 1..8 {
                let apart = rows * pitch * size_of::<Pair>() % 4096;
                assert!((160..=4096 - 160).contains(&apart), "{pixels} pixels: {rows} rows apart");
            }
        }
    }
}
