//! A finished picture: linear light, premultiplied, single precision.
//!
//! In: a renderer's pixels. Out: the same over a background, or as sRGB samples for a picture file. Rows run down.

use std::ops::Range;

use glam::Vec4;

use crate::error::{Error, Result};

/// Red, green, blue, alpha for each pixel, row after row from the top; linear light, premultiplied by alpha.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    size: [u32; 2],
    pixels: Vec<f32>,
}

impl Frame {
    /// A frame of nothing.
    ///
    /// # Errors
    /// [`Error::Input`] if a side of `size` (columns, rows) is 0; [`Error::OutOfMemory`].
    pub fn transparent(size: [u32; 2]) -> Result<Frame> {
        if size.contains(&0) {
            return Err(Error::input("picture size", "is 0, but must be at least 1 in both directions"));
        }
        let floats = u64::from(size[0]) * u64::from(size[1]) * 4;
        let refused = || Error::out_of_memory("the picture", 4 * floats);
        let len = usize::try_from(floats).map_err(|_| refused())?;
        let mut pixels = Vec::new();
        pixels.try_reserve_exact(len).map_err(|_| refused())?;
        pixels.resize(len, 0.0);
        Ok(Frame { size, pixels })
    }

    /// Columns and rows.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// All pixels: four numbers each.
    pub fn pixels(&self) -> &[f32] {
        &self.pixels
    }

    /// All pixels, to be written.
    pub fn pixels_mut(&mut self) -> &mut [f32] {
        &mut self.pixels
    }

    /// Shares all rows out among threads: each is told the first of its rows.
    pub(crate) fn in_shares(&mut self, threads: usize, fill: impl Fn(usize, &mut [f32]) + Sync) {
        self.rows_in_shares(0..self.size[1], threads, fill);
    }

    /// The same of some rows.
    pub(crate) fn rows_in_shares(&mut self, rows: Range<u32>, threads: usize, fill: impl Fn(usize, &mut [f32]) + Sync) {
        let len = 4 * self.size[0] as usize;
        let [from, to] = [rows.start, rows.end].map(|row| row as usize);
        let pixels = &mut self.pixels[len * from..len * to];
        let share = (to - from).div_ceil(threads.max(1)).max(1);
        if threads <= 1 {
            return fill(from, pixels);
        }
        std::thread::scope(|scope| {
            for (index, rows) in pixels.chunks_mut(share * len).enumerate() {
                let fill = &fill;
                scope.spawn(move || fill(from + index * share, rows));
            }
        });
    }

    /// Pixel in `column` and `row`.
    ///
    /// # Panics
    /// If it lies outside the picture.
    pub fn pixel(&self, column: u32, row: u32) -> [f32; 4] {
        assert!(column < self.size[0] && row < self.size[1], "pixel ({column}, {row}) lies outside {:?}", self.size);
        let at = 4 * (row as usize * self.size[0] as usize + column as usize);
        [self.pixels[at], self.pixels[at + 1], self.pixels[at + 2], self.pixels[at + 3]]
    }

    /// Puts the picture over an opaque background of a linear colour.
    pub fn over(&mut self, background: [f32; 3]) {
        for pixel in self.pixels.chunks_exact_mut(4) {
            let clear = 1.0 - pixel[3];
            for (channel, behind) in pixel.iter_mut().zip(background) {
                *channel += clear * behind;
            }
            pixel[3] = 1.0;
        }
    }

    /// Samples of 8 bits for a picture file: sRGB, not premultiplied.
    pub fn to_srgb8(&self) -> Vec<u8> {
        self.encoded(255.0).map(|sample| u8::try_from(sample).unwrap_or(u8::MAX)).collect()
    }

    /// Samples of 16 bits for a picture file: sRGB, not premultiplied.
    pub fn to_srgb16(&self) -> Vec<u16> {
        self.encoded(65_535.0).collect()
    }

    fn encoded(&self, most: f32) -> impl Iterator<Item = u16> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65,535")]
        let whole = move |value: f32| (value.clamp(0.0, 1.0) * most + 0.5) as u16;
        self.pixels.chunks_exact(4).flat_map(move |pixel| {
            let alpha = pixel[3];
            let part = |channel: f32| whole(srgb_from_linear(if alpha > 0.0 { channel / alpha } else { 0.0 }));
            [part(pixel[0]), part(pixel[1]), part(pixel[2]), whole(alpha)]
        })
    }
}

/// A pixel without what interpolation and rounding take beyond its range: colours of 0 and more, alpha of 0 to 1.
#[inline(always)]
pub(crate) fn in_range(pixel: Vec4) -> [f32; 4] {
    pixel.max(Vec4::ZERO).min(Vec4::new(f32::MAX, f32::MAX, f32::MAX, 1.0)).to_array()
}

/// The sRGB transfer function, IEC 61966-2-1; NaN gives 0.
pub fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear.max(0.0) * 12.92 } else { 1.055 * linear.min(1.0).powf(1.0 / 2.4) - 0.055 }
}
