//! Computes SSIM: the structural similarity of the display luma of two pictures, at full resolution.
//!
//! In: two pictures as a display shows them. Out: the mean over all positions of an 11 x 11 Gaussian window (sigma 1.5)
//! inside the picture; K1 = 0.01, K2 = 0.03, population covariances. Luma is 0.2126 R' + 0.7152 G' + 0.0722 B'. If a
//! side is below 11 pixels, windows are centred on every pixel, and border pixels are repeated outside.
//!
//! Source: Wang, Bovik, Sheikh and Simoncelli, "Image Quality Assessment: From Error Visibility to Structural
//! Similarity", IEEE Trans. Image Processing 13(4), 2004.

use super::display::DisplayPicture;
use super::filter::{FilterKernel, filtered};

const RADIUS: usize = 5;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Returns the mean SSIM, -1 to 1.
pub(super) fn mean(a: &DisplayPicture, b: &DisplayPicture) -> f64 {
    let [columns, rows] = a.size;
    let [a, b] = [a, b].map(|picture| picture.plane(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b));
    let window = FilterKernel::gaussian(RADIUS, SIGMA);
    let smooth = |plane: &[f64]| filtered(plane, columns, &window, &window);
    let product = |a: &[f64], b: &[f64]| smooth(&a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<f64>>());
    let (mean_a, mean_b) = (smooth(&a), smooth(&b));
    let (aa, bb, ab) = (product(&a, &a), product(&b, &b), product(&a, &b));
    let margin = if columns.min(rows) > 2 * RADIUS { RADIUS } else { 0 };
    let (mut sum, mut places) = (0.0, 0u64);
    for y in margin..rows - margin {
        for at in y * columns + margin..(y + 1) * columns - margin {
            let (ma, mb) = (mean_a[at], mean_b[at]);
            let (va, vb, covariance) = (aa[at] - ma * ma, bb[at] - mb * mb, ab[at] - ma * mb);
            sum += (2.0 * ma * mb + C1) * (2.0 * covariance + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2));
            places += 1;
        }
    }
    sum / places as f64
}
