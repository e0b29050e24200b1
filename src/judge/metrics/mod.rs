//! Metrics: how far two pictures are apart.
//!
//! In: two frames of one size, and a background. Out: [`Metrics`]. Numbers of light (largest error, RMSE, PSNR, energy)
//! are of linear premultiplied samples, over the pixels at which one of the pictures is not empty: empty ones would make
//! any picture look right. What stands for an eye (SSIM, FLIP, and the errors of display values) is of the
//! pictures over the background, as sRGB.
//!
//! The module stands beside the renderers, not in the studies: the program's `compare`, studies and tests all ask it.

mod display;
mod filter;
mod flip;
mod heat;
mod ssim;

use adjsplat::error::{Error, Result};
use adjsplat::splat::Frame;
use display::Display;

pub use heat::Heat;

/// How far a picture is from another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Metrics {
    /// `10 log10(1 / mean squared error)` in decibels; infinite for equal pictures.
    pub psnr: f64,
    /// Mean structural similarity of display luma; 1 for equal pictures.
    pub ssim: f64,
    /// Mean FLIP, 0 to 1; 0 for equal pictures.
    pub flip: f64,
    /// Largest difference of two samples.
    pub max_abs: f64,
    /// Column and row of the first pixel that has it.
    pub max_at: [u32; 2],
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Light and alpha of the second picture in all, over that of the first, less 1; 0 if both are empty.
    pub energy: f64,
    /// The same errors of display values, 0 to 1, of red, green and blue.
    pub display: Errors,
}

/// Errors of one kind of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// In decibels; infinite for equal pictures.
    pub psnr: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Largest difference of two samples.
    pub max_abs: f64,
}

/// Compares a picture with one that is right.
///
/// `background`: linear colour behind both, for what an eye sees.
///
/// # Errors
/// [`Error::Input`] if the sizes differ, or if a sample is not a finite number.
pub fn compare(right: &Frame, other: &Frame, background: [f32; 3]) -> Result<Metrics> {
    if right.size() != other.size() {
        let [[a, b], [c, d]] = [right.size(), other.size()];
        return Err(Error::input("pictures", format!("are {a}x{b} and {c}x{d}; compare pictures of one size")));
    }
    for (which, frame) in [("first", right), ("second", other)] {
        if !frame.pixels().iter().all(|sample| sample.is_finite()) {
            return Err(Error::input(format!("{which} picture"), "has samples that are no finite numbers"));
        }
    }
    let (rights, others) = (right.pixels().as_chunks::<4>().0, other.pixels().as_chunks::<4>().0);
    let shown: Vec<usize> = (0..rights.len()).filter(|&at| rights[at] != [0.0; 4] || others[at] != [0.0; 4]).collect();
    let [a, b] = [right, other].map(|frame| Display::new(frame, background));
    let linear = Tally::of(&shown, |at| (rights[at].map(f64::from), others[at].map(f64::from)));
    let seen = Tally::of(&shown, |at| (a.colours[at], b.colours[at]));
    let sum = |pixels: &[[f32; 4]]| pixels.as_flattened().iter().map(|&sample| f64::from(sample)).sum::<f64>();
    let (before, after) = (sum(rights), sum(others));
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

/// Sums over samples.
struct Tally {
    squares: f64,
    samples: usize,
    worst: f64,
    worst_at: usize,
}

impl Tally {
    fn of<const N: usize>(shown: &[usize], pair: impl Fn(usize) -> ([f64; N], [f64; N])) -> Tally {
        let mut tally = Tally { squares: 0.0, samples: shown.len() * N, worst: 0.0, worst_at: 0 };
        for &at in shown {
            let (a, b) = pair(at);
            for (a, b) in a.into_iter().zip(b) {
                let apart = (a - b).abs();
                tally.squares += apart * apart;
                if apart > tally.worst {
                    (tally.worst, tally.worst_at) = (apart, at);
                }
            }
        }
        tally
    }

    fn errors(&self) -> Errors {
        let mean = self.squares / self.samples.max(1) as f64;
        Errors { psnr: -10.0 * mean.log10(), rmse: mean.sqrt(), max_abs: self.worst }
    }
}
