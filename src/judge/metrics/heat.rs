//! Draws a heat map: where, and how much, two pictures differ.
//!
//! In: two frames. Out: a frame that shows each pixel's largest absolute difference of linear premultiplied samples as
//! a colour, from black for none to pale yellow for the largest. The colours follow a curve in Oklab on which lightness
//! rises evenly with the difference. So equal steps look equal, also when printed in grey.
//!
//! Source of the colour space: B. Ottosson, "A perceptual color space for image processing", 2020.

use adjsplat::error::{Error, Result};
use adjsplat::splat::Frame;

/// A heat map: the differences of two pictures, shown as colours.
#[derive(Debug, Clone, PartialEq)]
pub struct HeatMap {
    /// The frame that shows the differences as colours.
    pub frame: Frame,
    /// The largest difference, which is shown in the brightest colour.
    pub brightest: f64,
}

impl HeatMap {
    /// Creates the heat map of the absolute differences of two pictures.
    ///
    /// # Errors
    /// [`Error::Input`] if the sizes differ; [`Error::Limit`] if the memory cannot be had.
    pub fn new(a: &Frame, b: &Frame) -> Result<HeatMap> {
        if a.size() != b.size() {
            return Err(Error::input("pictures", "differ in size; compare pictures of one size"));
        }
        let pairs = a.pixels().as_chunks::<4>().0.iter().zip(b.pixels().as_chunks::<4>().0);
        let difference =
            |(a, b): (&[f32; 4], &[f32; 4])| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
        let differences: Vec<f64> = pairs.map(difference).collect();
        let brightest = differences.iter().copied().fold(0.0, f64::max);
        let colours: Vec<[f32; 3]> = (0..=255u8).map(|step| colour(f64::from(step) / 255.0)).collect();
        let mut frame = Frame::transparent(a.size())?;
        for (pixel, difference) in frame.pixels_mut().as_chunks_mut::<4>().0.iter_mut().zip(differences) {
            let fraction = if brightest > 0.0 { difference / brightest } else { 0.0 };
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255, and it saturates")]
            let [r, g, b] = colours[usize::from((255.0 * fraction + 0.5) as u8)];
            *pixel = [r, g, b, 1.0];
        }
        Ok(HeatMap { frame, brightest })
    }
}

/// Returns the linear colour for a fraction of the largest difference: violet, red and orange lie between black and
/// yellow.
fn colour(fraction: f64) -> [f32; 3] {
    let lightness = 0.97 * fraction;
    let hue = (300.0 + 165.0 * fraction).to_radians();
    let wanted = 0.23 * (std::f64::consts::PI * fraction).sin();
    // The most colourful value that a display can show at that lightness and hue.
    let chroma = (0..=64)
        .rev()
        .map(|step| wanted * f64::from(step) / 64.0)
        .find(|&chroma| linear_from_oklab(lightness, chroma, hue).iter().all(|c| (-1e-9..=1.0 + 1e-9).contains(c)));
    #[expect(clippy::cast_possible_truncation, reason = "single precision is a frame's")]
    linear_from_oklab(lightness, chroma.unwrap_or(0.0), hue).map(|c| c.clamp(0.0, 1.0) as f32)
}

fn linear_from_oklab(lightness: f64, chroma: f64, hue: f64) -> [f64; 3] {
    let (b, a) = hue.sin_cos();
    let (a, b) = (chroma * a, chroma * b);
    let cube = |x: f64| x * x * x;
    let l = cube(lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b);
    let m = cube(lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b);
    let s = cube(lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
}
