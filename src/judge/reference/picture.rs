//! The pictures that the reference renderers return.

use std::sync::{Mutex, PoisonError};

use crate::allocate::filled;
use adjsplat::error::{Error, Result};
use adjsplat::splat::{Frame, StopRequest};

/// Returns whether a request to stop drawing was made.
pub(super) fn is_made(stop: Option<&StopRequest>) -> bool {
    stop.is_some_and(StopRequest::is_made)
}

/// Returns [`Error::Interrupted`] if a request to stop drawing was made: pixels may then be missing.
pub(super) fn check_stop(stop: Option<&StopRequest>) -> Result<()> {
    if is_made(stop) { Err(Error::Interrupted) } else { Ok(()) }
}

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
    /// [`Error::OutOfMemory`](adjsplat::Error::OutOfMemory) if the memory cannot be had.
    pub(super) fn filled(size: [u32; 2], pixel: [f64; 4]) -> Result<ReferencePicture> {
        let pixels = filled("the picture", u64::from(size[0]) * u64::from(size[1]), pixel)?;
        Ok(ReferencePicture { size, pixels })
    }

    /// Sets each pixel to what `draw` returns for its column and row. Several threads take row after row; each has its own
    /// scratch memory.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if `stop` is made before all pixels are drawn.
    pub(super) fn draw<S: Default>(
        &mut self,
        threads: usize,
        stop: Option<&StopRequest>,
        draw: impl Fn(&mut S, usize, usize) -> [f64; 4] + Sync,
    ) -> Result<()> {
        let columns = self.size[0] as usize;
        let next_row = Mutex::new(self.pixels.chunks_mut(columns).enumerate());
        let draw_rows = || {
            let mut scratch = S::default();
            loop {
                let taken = next_row.lock().unwrap_or_else(PoisonError::into_inner).next();
                let Some((row, pixels)) = taken else { return };
                for (column, pixel) in pixels.iter_mut().enumerate() {
                    if is_made(stop) {
                        return;
                    }
                    *pixel = draw(&mut scratch, column, row);
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads {
                // The threads that the system gives.
                let _ = std::thread::Builder::new().spawn_scoped(scope, draw_rows);
            }
            draw_rows();
        });
        check_stop(stop)
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
    /// [`Error::OutOfMemory`](adjsplat::Error::OutOfMemory) if the memory cannot be had.
    pub fn to_frame(&self) -> Result<Frame> {
        let mut frame = Frame::transparent(self.size)?;
        #[expect(clippy::cast_possible_truncation, reason = "single precision is a frame's")]
        for (single, double) in frame.pixels_mut().iter_mut().zip(self.pixels.as_flattened()) {
            *single = *double as f32;
        }
        Ok(frame)
    }
}
