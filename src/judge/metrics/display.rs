//! Converts a frame to what a display shows: over a background, in sRGB.

use adjsplat::splat::Frame;

/// A picture in sRGB, as a display shows it.
pub(super) struct DisplayPicture {
    /// The numbers of columns and rows.
    pub(super) size: [usize; 2],
    /// Red, green and blue of each pixel, row by row, each 0 to 1.
    pub(super) colours: Vec<[f64; 3]>,
}

impl DisplayPicture {
    pub(super) fn new(frame: &Frame, background: [f32; 3]) -> DisplayPicture {
        let behind = background.map(f64::from);
        let shown = |&[r, g, b, alpha]: &[f32; 4]| {
            let clear = 1.0 - f64::from(alpha);
            let over = [r, g, b].map(f64::from);
            std::array::from_fn(|c| encoded(over[c] + clear * behind[c]))
        };
        let colours = frame.pixels().as_chunks::<4>().0.iter().map(shown).collect();
        DisplayPicture { size: frame.size().map(|side| side as usize), colours }
    }

    /// Returns the plane that holds `of(colour)` for each pixel.
    pub(super) fn plane(&self, of: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
        self.colours.iter().map(|&colour| of(colour)).collect()
    }
}

/// Applies the sRGB transfer function (IEC 61966-2-1) to a linear value.
fn encoded(linear: f64) -> f64 {
    let linear = linear.clamp(0.0, 1.0);
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Applies the inverse of the sRGB transfer function; returns the linear value.
pub(super) fn decoded(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}
