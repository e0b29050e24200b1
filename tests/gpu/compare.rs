//! Comparing pictures.

use adjsplat::splat::Frame;

/// Peak signal-to-noise ratio in dB, of all four channels, over the pixels that are not empty in both.
///
/// Infinite for equal ones. Full scale is 1.
pub(crate) fn psnr(got: &Frame, want: &Frame) -> f64 {
    assert_eq!(got.size(), want.size());
    let pixels = got.pixels().as_chunks::<4>().0.iter().zip(want.pixels().as_chunks::<4>().0);
    let (mut sum, mut count) = (0.0, 0u64);
    for (got, want) in pixels.filter(|(got, want)| got.iter().chain(*want).any(|&sample| sample != 0.0)) {
        sum += got.iter().zip(want).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>();
        count += 4;
    }
    if sum == 0.0 { f64::INFINITY } else { -10.0 * (sum / count as f64).log10() }
}

/// Largest difference of a sample, and where: column and row.
pub(crate) fn worst(got: &Frame, want: &Frame) -> (f32, [u32; 2]) {
    let apart = got.pixels().iter().zip(want.pixels()).map(|(a, b)| (a - b).abs());
    let (place, worst) = apart.enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap();
    let pixel = (place / 4) as u32;
    (worst, [pixel % got.size()[0], pixel / got.size()[0]])
}

/// Whether a picture shows anything.
pub(crate) fn shows(frame: &Frame) -> bool {
    frame.pixels().iter().any(|&sample| sample > 0.0)
}
