//! Comparisons of pictures, sample by sample: four samples a pixel, in single or double precision.

use adjsplat::splat::Frame;
use adjsplat_judge::reference::ReferencePicture;

/// A picture that can be compared.
pub trait Samples {
    /// Returns the samples, four a pixel.
    fn samples(&self) -> impl ExactSizeIterator<Item = f64>;
}

impl Samples for Frame {
    fn samples(&self) -> impl ExactSizeIterator<Item = f64> {
        self.pixels().iter().map(|sample| f64::from(*sample))
    }
}

impl Samples for ReferencePicture {
    fn samples(&self) -> impl ExactSizeIterator<Item = f64> {
        self.pixels().as_flattened().iter().copied()
    }
}

fn pairs(a: &impl Samples, b: &impl Samples) -> impl Iterator<Item = (f64, f64)> {
    assert_eq!(a.samples().len(), b.samples().len(), "pictures of one size");
    a.samples().zip(b.samples())
}

/// Returns the largest difference of two pictures' samples.
pub fn apart(a: &impl Samples, b: &impl Samples) -> f64 {
    pairs(a, b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Returns the root of the mean squared difference over pixels of which one has a sample above `floor`.
pub fn rmse(a: &impl Samples, b: &impl Samples, floor: f64) -> f64 {
    let samples: Vec<(f64, f64)> = pairs(a, b).collect();
    let shown = samples.as_chunks::<4>().0.iter().filter(|pixel| pixel.iter().any(|(a, b)| a.max(*b) > floor));
    let (sum, count) = shown.flatten().fold((0.0, 0.0), |(sum, count), (a, b)| (sum + (a - b).powi(2), count + 1.0));
    if count == 0.0 { 0.0 } else { f64::sqrt(sum / count) }
}

/// Returns [`rmse`] as a peak signal-to-noise ratio in decibels: full scale is 1, equal pictures have infinity.
pub fn decibels(a: &impl Samples, b: &impl Samples, floor: f64) -> f64 {
    -20.0 * rmse(a, b, floor).log10()
}

/// Returns a frame's samples as bits, so that frames can be compared bit for bit.
pub fn bits(frame: &Frame) -> Vec<u32> {
    frame.pixels().iter().map(|sample| sample.to_bits()).collect()
}

/// Returns the fourth sample of each pixel: its opacity.
pub fn alphas(frame: &Frame) -> impl Iterator<Item = f64> {
    frame.pixels().iter().skip(3).step_by(4).map(|alpha| f64::from(*alpha))
}

/// Returns whether a picture shows anything.
pub fn shows(frame: &Frame) -> bool {
    frame.pixels().iter().any(|&sample| sample > 0.0)
}
