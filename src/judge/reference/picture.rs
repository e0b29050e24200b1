//! The pictures that the reference renderers return.

use adjsplat::error::{Error, Result};
use adjsplat::splat::Frame;

/// A picture in double precision: premultiplied linear red, green, blue and alpha, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePicture {
    size: [u32; 2],
    pixels: Vec<[f64; 4]>,
}

impl ReferencePicture {
    /// Returns a picture of `size` (columns, rows, at least 1 each) filled with `pixel`.
    ///
    /// # Errors
    /// [`Error::Limit`] if the memory cannot be had.
    pub(super) fn filled(size: [u32; 2], pixel: [f64; 4]) -> Result<ReferencePicture> {
        let count = u64::from(size[0]) * u64::from(size[1]);
        let refused = || Error::out_of_memory("the picture", 32 * count);
        let len = usize::try_from(count).map_err(|_| refused())?;
        let mut pixels = Vec::new();
        pixels.try_reserve_exact(len).map_err(|_| refused())?;
        pixels.resize(len, pixel);
        Ok(ReferencePicture { size, pixels })
    }

    /// Returns the numbers of columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns all pixels, row by row from the top.
    pub fn pixels(&self) -> &[[f64; 4]] {
        &self.pixels
    }

    pub(super) fn pixels_mut(&mut self) -> &mut [[f64; 4]] {
        &mut self.pixels
    }

    /// Returns the pixel at `column` and `row`.
    ///
    /// # Panics
    /// If the pixel lies outside the picture.
    pub fn pixel(&self, column: u32, row: u32) -> [f64; 4] {
        assert!(column < self.size[0] && row < self.size[1], "pixel ({column}, {row}) lies outside {:?}", self.size);
        self.pixels[row as usize * self.size[0] as usize + column as usize]
    }

    /// Returns the picture with each sample rounded to single precision.
    ///
    /// # Errors
    /// [`Error::Limit`] if the memory cannot be had.
    pub fn to_frame(&self) -> Result<Frame> {
        let mut frame = Frame::transparent(self.size)?;
        #[expect(clippy::cast_possible_truncation, reason = "single precision is a frame's")]
        for (single, double) in frame.pixels_mut().iter_mut().zip(self.pixels.as_flattened()) {
            *single = *double as f32;
        }
        Ok(frame)
    }
}
