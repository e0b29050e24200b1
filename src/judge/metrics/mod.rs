//! Metrics: numbers that say how much two pictures differ.
//!
//! In: two frames of one size, and a background. Out: [`Metrics`]. Errors of light (largest error, RMSE, PSNR, energy)
//! compare linear premultiplied samples of the pixels that are not empty in both pictures: pixels that are empty in
//! both would hide the errors. Visible errors (SSIM, FLIP, errors of display values) compare the pictures over the
//! background, in sRGB.

mod display;
mod filter;
mod flip;
mod heat;
mod ssim;

use adjsplat::error::{Error, Result};
use adjsplat::splat::Frame;
use display::DisplayPicture;

pub use heat::HeatMap;

/// The differences between a picture and the reference picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Metrics {
    /// `10 log10(1 / mean squared error)` of linear samples, in decibels; infinite for equal pictures.
    pub psnr: f64,
    /// The mean structural similarity of display luma, -1 to 1; 1 for equal pictures.
    pub ssim: f64,
    /// The mean FLIP, 0 to 1; 0 for equal pictures.
    pub flip: f64,
    /// The largest difference between a linear sample of the picture and that of the reference.
    pub max_abs: f64,
    /// The column and row of the first pixel that has the largest difference.
    pub max_at: [u32; 2],
    /// The root of the mean squared error of linear samples.
    pub rmse: f64,
    /// The sum of the picture's light and alpha divided by that of the reference, minus 1; 0 if both are empty.
    pub energy: f64,
    /// The errors of the red, green and blue that a display shows, each 0 to 1.
    pub display: SampleErrors,
}

/// The errors of one kind of samples, such as display values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleErrors {
    /// The peak signal-to-noise ratio in decibels; infinite for equal pictures.
    pub psnr: f64,
    /// The root of the mean squared error.
    pub rmse: f64,
    /// The largest difference between a sample of the picture and that of the reference.
    pub max_abs: f64,
}

/// Compares the picture `other` with the reference picture `right`.
///
/// `background` is the linear colour behind both pictures when display values are compared.
///
/// # Errors
/// [`Error::Input`] if the sizes differ, or if a sample is not a finite number.
pub fn compare(right: &Frame, other: &Frame, background: [f32; 3]) -> Result<Metrics> {
    let (shown, linear) = linear_errors(right, other)?;
    let [a, b] = [right, other].map(|frame| DisplayPicture::new(frame, background));
    let seen = ErrorSums::of(&shown, |at| (a.colours[at], b.colours[at]));
    let [before, after] =
        [right, other].map(|frame| frame.pixels().iter().map(|&sample| f64::from(sample)).sum::<f64>());
    let errors = linear.errors();
    let columns = right.size()[0] as usize;
    let index = |at: usize| u32::try_from(at).expect("a picture's sides are 32-bit");
    Ok(Metrics {
        psnr: errors.psnr,
        ssim: ssim::mean(&a, &b),
        flip: flip::mean(&a, &b),
        max_abs: errors.max_abs,
        max_at: [index(linear.worst_at % columns), index(linear.worst_at / columns)],
        rmse: errors.rmse,
        energy: if before == after { 0.0 } else { after / before - 1.0 },
        display: seen.errors(),
    })
}

/// Returns [`Metrics::psnr`] alone, which is much faster than all metrics.
///
/// # Errors
/// The errors of [`compare`].
pub fn psnr(right: &Frame, other: &Frame) -> Result<f64> {
    Ok(linear_errors(right, other)?.1.errors().psnr)
}

/// Checks that two pictures can be compared.
fn check(right: &Frame, other: &Frame) -> Result<()> {
    if right.size() != other.size() {
        let [[a, b], [c, d]] = [right.size(), other.size()];
        return Err(Error::input("pictures", format!("are {a}x{b} and {c}x{d}; compare pictures of one size")));
    }
    for (which, frame) in [("first", right), ("second", other)] {
        if !frame.pixels().iter().all(|sample| sample.is_finite()) {
            return Err(Error::input(format!("{which} picture"), "has samples that are no finite numbers"));
        }
    }
    Ok(())
}

/// Returns the indices of the pixels that are not empty in both pictures, and the errors of their linear samples.
fn linear_errors(right: &Frame, other: &Frame) -> Result<(Vec<usize>, ErrorSums)> {
    check(right, other)?;
    let (rights, others) = (right.pixels().as_chunks::<4>().0, other.pixels().as_chunks::<4>().0);
    let shown: Vec<usize> = (0..rights.len()).filter(|&at| rights[at] != [0.0; 4] || others[at] != [0.0; 4]).collect();
    let errors = ErrorSums::of(&shown, |at| (rights[at].map(f64::from), others[at].map(f64::from)));
    Ok((shown, errors))
}

/// The sums of errors over samples, from which the metrics are computed.
struct ErrorSums {
    squares: f64,
    samples: usize,
    worst: f64,
    worst_at: usize,
}

impl ErrorSums {
    fn of<const N: usize>(shown: &[usize], pair: impl Fn(usize) -> ([f64; N], [f64; N])) -> ErrorSums {
        let mut tally = ErrorSums { squares: 0.0, samples: shown.len() * N, worst: 0.0, worst_at: 0 };
        for &at in shown {
            let (a, b) = pair(at);
            for (a, b) in a.into_iter().zip(b) {
                let difference = (a - b).abs();
                tally.squares += difference * difference;
                if difference > tally.worst {
                    (tally.worst, tally.worst_at) = (difference, at);
                }
            }
        }
        tally
    }

    fn errors(&self) -> SampleErrors {
        let mean = self.squares / self.samples.max(1) as f64;
        SampleErrors { psnr: 10.0 * mean.recip().log10(), rmse: mean.sqrt(), max_abs: self.worst }
    }
}
