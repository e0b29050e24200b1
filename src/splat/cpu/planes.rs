//! The accumulation buffer of a band: four planes per picture row.
//!
//! In: a rectangle of the picture, in absolute pixel coordinates. Out: rows of red, green, blue and transmittance as
//! separate arrays, with guard pixels on both sides that a kernel eight pixels wide may overwrite. The pitch keeps
//! rows away from multiples of 4,096 bytes: at such a pitch all rows of a splat fall into one cache set and stores
//! block the loads of the next row (measured: four times slower).

use crate::error::{Error, Result};

/// Pixels that a kernel handles at once.
pub(crate) const WIDE: usize = 8;

/// Guard pixels on either side of a row.
const GUARD: usize = 8;
/// The same, for coordinates.
const GUARD_COLUMNS: i32 = 8;

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

/// Planes of one band. What the fourth plane holds is the blend's business.
#[derive(Debug)]
pub(crate) struct Planes {
    pub(crate) rect: Rect,
    pitch: usize,
    floats: Vec<f32>,
}

/// Where eight neighbouring pixels of each plane lie.
pub(crate) struct Eight<'a> {
    pub(crate) red: &'a mut [f32; WIDE],
    pub(crate) green: &'a mut [f32; WIDE],
    pub(crate) blue: &'a mut [f32; WIDE],
    pub(crate) fourth: &'a mut [f32; WIDE],
}

impl Planes {
    /// Planes for `rect`: colours 0, the fourth plane `fourth`.
    ///
    /// # Errors
    /// [`Error::Limit`] if the memory cannot be had.
    pub(crate) fn new(rect: Rect, fourth: f32) -> Result<Planes> {
        let pitch = pitch_for(rect.width());
        let len = 4 * pitch * rect.height();
        let mut floats = Vec::new();
        floats.try_reserve_exact(len).map_err(|_| Error::Limit {
            what: "memory for the picture in bytes".into(),
            need: 4 * len as u64,
            have: 0,
        })?;
        floats.resize(len, 0.0);
        for row in floats.chunks_exact_mut(4 * pitch) {
            row[3 * pitch..].fill(fourth);
        }
        Ok(Planes { rect, pitch, floats })
    }

    /// The four planes of row `y`, each with its guards. `y` lies in the rectangle.
    #[inline(always)]
    pub(crate) fn row(&mut self, y: i32) -> Row<'_> {
        let start = (y - self.rect.y0) as usize * 4 * self.pitch;
        let (red, rest) = self.floats[start..start + 4 * self.pitch].split_at_mut(self.pitch);
        let (green, rest) = rest.split_at_mut(self.pitch);
        let (blue, fourth) = rest.split_at_mut(self.pitch);
        Row { left: self.rect.x0 - GUARD_COLUMNS, red, green, blue, fourth }
    }

    /// Pixel (`x`, `y`) of the fourth plane; the pixel lies in the rectangle.
    #[inline(always)]
    pub(crate) fn fourth(&self, x: i32, y: i32) -> f32 {
        let row = (y - self.rect.y0) as usize * 4 + 3;
        self.floats[row * self.pitch + GUARD + (x - self.rect.x0) as usize]
    }

    /// Pixels of row `y` without guards: red, green, blue, fourth.
    pub(crate) fn pixels(&self, y: i32) -> [&[f32]; 4] {
        let start = (y - self.rect.y0) as usize * 4 * self.pitch + GUARD;
        let width = self.rect.width();
        [0, 1, 2, 3].map(|plane| &self.floats[start + plane * self.pitch..][..width])
    }
}

/// One row of all four planes.
pub(crate) struct Row<'a> {
    left: i32,
    red: &'a mut [f32],
    green: &'a mut [f32],
    blue: &'a mut [f32],
    fourth: &'a mut [f32],
}

impl Row<'_> {
    /// Eight pixels from column `x`; `x` is at most eight columns left of the rectangle and left of its right end.
    #[inline(always)]
    pub(crate) fn eight(&mut self, x: i32) -> Eight<'_> {
        let at = (x - self.left) as usize;
        Eight {
            red: (&mut self.red[at..at + WIDE]).try_into().expect("eight"),
            green: (&mut self.green[at..at + WIDE]).try_into().expect("eight"),
            blue: (&mut self.blue[at..at + WIDE]).try_into().expect("eight"),
            fourth: (&mut self.fourth[at..at + WIDE]).try_into().expect("eight"),
        }
    }
}

/// Floats per plane row: an odd multiple of four, so that a row of four planes is an odd number of cache lines.
fn pitch_for(width: usize) -> usize {
    let mut quads = (width + 2 * GUARD).div_ceil(4) | 1;
    while !(8..=248).contains(&(quads % 256)) {
        quads += 2;
    }
    4 * quads
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_rows_of_a_splat_are_a_multiple_of_a_page_apart() {
        for width in 1..=16_384 {
            let pitch = pitch_for(width);
            assert!(pitch >= width + 2 * GUARD);
            for planes in 1..=64 {
                let apart = planes * pitch * 4 % 4096;
                assert!(apart != 0, "width {width}: {planes} planes apart");
            }
        }
    }
}
