//! What lies in front of a part of a scene: pixels that are opaque already hide the part.
//!
//! In: the picture of the parts in front. Out: which rectangles of pixels, and which tiles, the part cannot change by more
//! than the transmittance at which rays end.

use super::tile_buffer::TILE_SHIFT;
use crate::error::Result;
use crate::splat::frame::{Frame, zeroed};

/// The pixels that parts in front left open.
pub(super) struct Front {
    size: [usize; 2],
    /// For each pixel, with a row and a column of zeros before: how many pixels above and to the left are open.
    open: Box<[u32]>,
}

impl Front {
    /// `stop`: the transmittance below which a pixel is opaque.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`](crate::Error::OutOfMemory): it takes 4 bytes a pixel.
    pub(super) fn new(picture: &Frame, stop: f32) -> Result<Front> {
        let size = picture.size().map(|side| side as usize);
        let width = size[0] + 1;
        let mut open = zeroed::<u32>((width * (size[1] + 1)) as u64)?;
        for (y, row) in picture.pixels().chunks_exact(4 * size[0]).enumerate() {
            let mut of_row = 0;
            for (x, pixel) in row.chunks_exact(4).enumerate() {
                of_row += u32::from(1.0 - pixel[3] >= stop);
                open[(y + 1) * width + x + 1] = open[y * width + x + 1] + of_row;
            }
        }
        Ok(Front { size, open })
    }

    /// Returns whether all pixels from column `left` to `right` and from row `top` to `bottom` are opaque, as far as they are
    /// in the picture.
    pub(super) fn hides(&self, [left, right]: [f64; 2], [top, bottom]: [f64; 2]) -> bool {
        let ends = |low: f64, high: f64, side: usize| {
            let side = side as f64;
            [low.floor().clamp(0.0, side) as usize, (high.ceil() + 1.0).clamp(0.0, side) as usize]
        };
        let ([x0, x1], [y0, y1]) = (ends(left, right, self.size[0]), ends(top, bottom, self.size[1]));
        let at = |x: usize, y: usize| i64::from(self.open[y * (self.size[0] + 1) + x]);
        x0 >= x1 || y0 >= y1 || at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0) == 0
    }

    /// Returns whether all pixels of the tile in `column` and `row` of the picture's grid are opaque.
    pub(super) fn hides_tile(&self, column: i32, row: i32) -> bool {
        let side = |tile: i32| [f64::from(tile << TILE_SHIFT), f64::from((tile << TILE_SHIFT) + 3)];
        self.hides(side(column), side(row))
    }
}
