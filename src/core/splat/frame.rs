//! A finished picture.
//!
//! In: a renderer's pixels. Out: the same pixels over a background, or as sRGB samples for a picture file.

use std::ops::Range;

use bytemuck::Zeroable;
use glam::Vec4;

use super::srgb_bytes::SRGB_BYTES;
use super::{Mode, require_pixels};
use crate::classify::colour::srgb_from_linear;
use crate::error::{Error, Result};
use crate::parallel::in_parts;

/// A picture: red, green, blue, alpha for each pixel, row after row from the top; linear light, premultiplied by alpha.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    size: [u32; 2],
    pixels: Box<[f32]>,
}

impl Frame {
    /// Creates a transparent frame of `size` columns and rows.
    ///
    /// # Errors
    /// [`Error::Input`] if a side of `size` is 0; [`Error::OutOfMemory`].
    pub fn transparent(size: [u32; 2]) -> Result<Frame> {
        require_pixels(size)?;
        let floats = (u64::from(size[0]) * u64::from(size[1])).saturating_mul(4);
        Ok(Frame { size, pixels: zeroed(floats)? })
    }

    /// Returns the number of columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns all pixels, four numbers each, row after row.
    pub fn pixels(&self) -> &[f32] {
        &self.pixels
    }

    /// Returns all pixels for writing, four numbers each, row after row.
    pub fn pixels_mut(&mut self) -> &mut [f32] {
        &mut self.pixels
    }

    /// Fills all rows on several threads: passes `fill` the index and the pixels of each row.
    pub(crate) fn fill_rows(&mut self, threads: usize, fill: impl Fn(usize, &mut [[f32; 4]]) + Sync) {
        self.fill_some_rows(0..self.size[1], threads, fill);
    }

    /// Fills the given `rows` on several threads; see [`Frame::fill_rows`].
    pub(crate) fn fill_some_rows(
        &mut self,
        rows: Range<u32>,
        threads: usize,
        fill: impl Fn(usize, &mut [[f32; 4]]) + Sync,
    ) {
        let len = self.size[0] as usize;
        let [from, to] = [rows.start, rows.end].map(|row| row as usize);
        let pixels = &mut self.pixels.as_chunks_mut().0[len * from..len * to];
        in_parts(pixels, len, threads, |first, rows| {
            (from + first..).zip(rows.chunks_exact_mut(len)).for_each(|(row, pixels)| fill(row, pixels));
        });
    }

    /// Returns the pixel in `column` and `row`.
    ///
    /// # Panics
    /// If the pixel lies outside the picture.
    pub fn pixel(&self, column: u32, row: u32) -> [f32; 4] {
        assert!(column < self.size[0] && row < self.size[1], "pixel ({column}, {row}) lies outside {:?}", self.size);
        let at = 4 * (row as usize * self.size[0] as usize + column as usize);
        [self.pixels[at], self.pixels[at + 1], self.pixels[at + 2], self.pixels[at + 3]]
    }

    /// Puts the picture over an opaque background, whose colour is in linear light.
    pub fn over(&mut self, background: [f32; 3]) {
        for pixel in self.pixels.chunks_exact_mut(4) {
            let clear = 1.0 - pixel[3];
            for (channel, behind) in pixel.iter_mut().zip(background) {
                *channel += clear * behind;
            }
            pixel[3] = 1.0;
        }
    }

    /// Puts `farther` behind the picture: what it shows lies behind all that the picture shows.
    ///
    /// In [`Mode::Composite`] colours are seen through what is clear; in [`Mode::Additive`] depths add up. Pictures in the
    /// maximum modes cannot be put together, as colours do not say which value was the largest.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn put_behind(&mut self, farther: &Frame, mode: Mode) {
        assert_eq!(self.size, farther.size, "pictures of one size");
        for (near, far) in self.pixels.chunks_exact_mut(4).zip(farther.pixels.chunks_exact(4)) {
            let clear = 1.0 - near[3];
            for (near, far) in near.iter_mut().zip(far) {
                let clear = if mode == Mode::Additive { 1.0 - *near } else { clear };
                *near += clear * far;
            }
        }
    }

    /// Returns samples of 8 bits for a picture file: sRGB, not premultiplied.
    pub fn to_srgb8(&self) -> Vec<u8> {
        let table = &*SRGB_BYTES;
        self.samples(|channel| table.byte(channel), |alpha| integer(alpha.into(), 255.0).to_le_bytes()[0])
    }

    /// Returns samples of 16 bits for a picture file: sRGB, not premultiplied.
    pub fn to_srgb16(&self) -> Vec<u16> {
        let white = 65_535.0;
        self.samples(
            |channel| integer(srgb_from_linear(channel.clamp(0.0, 1.0).into()), white),
            |alpha| integer(alpha.into(), white),
        )
    }

    /// Returns four samples a pixel: of its colours in linear light, not premultiplied, and of alpha.
    fn samples<T: Copy + Default>(&self, colour: impl Fn(f32) -> T, alpha: impl Fn(f32) -> T) -> Vec<T> {
        let mut samples = vec![T::default(); self.pixels.len()];
        for (samples, [r, g, b, a]) in samples.as_chunks_mut().0.iter_mut().zip(self.pixels.as_chunks().0) {
            let whole = |channel: &f32| colour(if *a > 0.0 { channel / a } else { 0.0 });
            *samples = [whole(r), whole(g), whole(b), alpha(*a)];
        }
        samples
    }
}

/// Returns the integer next to a share of `white`; 0 for NaN.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65,535")]
fn integer(share: f64, white: f64) -> u16 {
    (share.clamp(0.0, 1.0) * white + 0.5) as u16
}

/// Allocates `count` zeroes for a picture.
pub(crate) fn zeroed<T: Zeroable>(count: u64) -> Result<Box<[T]>> {
    let refused = || Error::out_of_memory("the picture", (size_of::<T>() as u64).saturating_mul(count));
    let count = usize::try_from(count).map_err(|_| refused())?;
    bytemuck::allocation::try_zeroed_slice_box(count).map_err(|()| refused())
}

/// Clamps a pixel that interpolation or rounding moved out of range: colours to 0 and above, alpha to 0 to 1.
#[inline(always)]
pub(crate) fn in_range(pixel: Vec4) -> [f32; 4] {
    pixel.max(Vec4::ZERO).min(Vec4::new(f32::MAX, f32::MAX, f32::MAX, 1.0)).to_array()
}
