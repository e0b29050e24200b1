//! Coarse views: where footprints are wide, fewer samples than pixels are enough.
//!
//! In: a view whose narrowest footprint is wide. Out: the same view with fewer, larger pixels; and the picture,
//! interpolated from that view's frame by cubic B-splines. A picture of Gaussian footprints has hardly any detail finer
//! than a footprint: at a standard deviation of [`ENOUGH`] pixels, a footprint's frequencies fall to 1 % of its mean at
//! half the sampling rate. The edges of opaque voxels are sharper than their footprints: where a splat's depth at its
//! centre is p > 1, `1 - exp(-p exp(-r^2 / 2 sigma^2))` rises within sigma / sqrt(2 ln p), and that width decides how
//! many samples are needed (docs/studies/sampling.md).
//!
//! ```text
//! view -> fewer pixels, with a margin -> draw -> coefficients (a recursive filter) -> columns -> rows -> picture
//! ```
//!
//! Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993: a recursive filter, then weights.

use std::f64::consts::TAU;

use glam::Vec4;
use multiversion::multiversion;

use super::project::jacobian;
use crate::error::Result;
use crate::splat::frame::in_range;
use crate::splat::kernel::narrowest_sigma;
use crate::splat::supersample::sigma_at_centre;
use crate::splat::view::{PixelMap, View, apply, single};
use crate::splat::{Blending, Frame, Mode, Sampling, Settings};
use crate::traverse::VoxelBox;

/// Standard deviation of the narrowest footprint of a coarse view, in samples. At 0.97, footprints of the standard
/// kernel are 6.5 samples wide, and the error is at least 45 dB below the picture.
const ENOUGH: f64 = 0.97;
/// Like [`ENOUGH`], for an error 32 dB below the picture. Measured: 37 dB and more; with 0.5, 30 dB.
const FEWEST: f64 = 0.62;
/// Largest number of samples per pixel, along a side, at which a coarse view is worth its interpolation.
const MAX_FACTOR: f64 = 0.8;
/// Width of the margin that a coarse picture's edge is interpolated from, in samples; the next weigh below 0.268^5.
const MARGIN: u32 = 6;
/// Shortest side of a picture, in pixels, that may have a coarse view.
const MIN_SIDE: u32 = 64;

/// Returns `enough` or `fewest`, by the sampling of `settings`. `None` if they ask for every pixel or more samples, or
/// for another mode or blending, which has other edges.
pub(super) fn limit(settings: &Settings, enough: f64, fewest: f64) -> Option<f64> {
    let limit = match settings.sampling() {
        Sampling::EveryPixel | Sampling::Finer => return None,
        Sampling::Enough => enough,
        Sampling::Fewest => fewest,
    };
    (settings.mode == Mode::Composite && settings.blending == Blending::Exponential).then_some(limit)
}

/// A view with fewer samples than the picture has pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CoarseView {
    /// Samples per pixel, along a side; below 1.
    factor: f64,
    /// Columns and rows of the picture.
    size: [u32; 2],
}

impl CoarseView {
    /// Returns the coarse view of the voxels in `bounds`; `deepest` is the largest optical depth of any of them, along
    /// a ray as long as the mean voxel spacing.
    ///
    /// `None` if every pixel needs a sample.
    pub(super) fn new(view: &View, bounds: &VoxelBox, deepest: f64, settings: &Settings) -> Option<CoarseView> {
        let enough = limit(settings, ENOUGH, FEWEST)?;
        let kernel = settings.kernel();
        if view.size.into_iter().any(|side| side < MIN_SIDE) {
            return None;
        }
        let at_centre = sigma_at_centre(view, bounds, settings);
        let sigma = match &view.map {
            PixelMap::Parallel { .. } => at_centre,
            PixelMap::Perspective { camera_from_voxel, focal, near, .. } => {
                let steps = camera_from_voxel.each_ref().map(single);
                // The farthest voxels have the narrowest footprints, and the farthest one is a corner.
                let corners = (0..8).map(|corner: u32| {
                    let at = [0, 1, 2].map(|a| [bounds.low[a], bounds.high[a]][(corner >> a & 1) as usize].into());
                    let [t0, t1, t2] = camera_from_voxel.each_ref().map(|map| apply(map, at));
                    let t2 = t2.max(*near);
                    let rows = jacobian(&steps, (t0 / t2) as f32, (t1 / t2) as f32, (focal / t2) as f32);
                    narrowest_sigma(rows, kernel.sigma)
                });
                let narrowest = corners.fold(f32::INFINITY, f32::min);
                // With [`Sampling::Fewest`], the farthest voxels may be sampled half as finely as they need, but no
                // coarser than what voxels in the middle need.
                let is_fewest = settings.sampling() == Sampling::Fewest;
                if is_fewest { at_centre.min(2.0 * narrowest).max(narrowest) } else { narrowest }
            }
        };
        let peak = deepest / (TAU * f64::from(kernel.sigma).powi(2));
        let sharpness = (2.0 * peak.max(1.0).ln()).sqrt().max(1.0);
        let factor = enough * sharpness / f64::from(sigma);
        // The limit keeps a coarse picture from being mostly margin; it also replaces NaN.
        let factor = factor.max(1.0 / 16.0);
        (factor <= MAX_FACTOR).then_some(CoarseView { factor, size: view.size })
    }

    /// Returns `view` with fewer samples.
    pub(super) fn view(&self, view: &View) -> View {
        let side = |pixels: u32| (f64::from(pixels) * self.factor).ceil() as u32 + 2 * MARGIN;
        view.with_pixels(self.factor, self.size.map(side), f64::from(MARGIN))
    }

    /// Computes the picture from `coarse`, the frame of the coarse view. The result does not depend on `threads`.
    pub(super) fn enlarge(&self, mut coarse: Frame, threads: usize) -> Result<Frame> {
        let [columns, rows] = coarse.size().map(|side| side as usize);
        let covered = covered(&coarse);
        columns_to_coefficients(coarse.pixels_mut(), 4 * columns);
        coarse.fill_rows(threads, |_, row| to_coefficients(row));
        let column_taps = self.taps(self.size[0], columns);
        let mut wide = Frame::transparent([self.size[0], coarse.size()[1]])?;
        wide.fill_rows(threads, |row, out| {
            let line = &coarse.pixels().as_chunks().0[columns * row..][..columns];
            for (pixel, tap) in out.iter_mut().zip(&column_taps) {
                let samples: &[[f32; 4]; 4] = line[tap.first..].first_chunk().expect("four samples inside the margin");
                *pixel = std::array::from_fn(|c| (0..4).map(|k| tap.weights[k] * samples[k][c]).sum());
            }
        });
        drop(coarse);
        let mut picture = Frame::transparent(self.size)?;
        let row_taps = self.taps(self.size[1], rows);
        picture.fill_rows(threads, |row, out| {
            let (tap, len) = (&row_taps[row], 4 * out.len());
            let samples = [0, 1, 2, 3].map(|k| &wide.pixels()[len * (tap.first + k)..][..len]);
            weighted_sum(samples, tap.weights, out.as_flattened_mut());
            let covered = &covered[columns * tap.nearest..][..columns];
            for (pixel, column) in out.iter_mut().zip(&column_taps) {
                // Pixels without a covered neighbour stay empty.
                let factor = if covered[column.nearest] { 1.0 } else { 0.0 };
                *pixel = in_range(factor * Vec4::from_array(*pixel));
            }
        });
        Ok(picture)
    }

    /// Returns, for each of the picture's `count` columns (or rows), the samples that it is interpolated from. The
    /// coarse frame has `samples` columns (or rows).
    fn taps(&self, count: u32, samples: usize) -> Vec<SplineTaps> {
        let taps = |index: u32| {
            let at = (f64::from(index) + 0.5) * self.factor - 0.5 + f64::from(MARGIN);
            let first = (at.floor() as usize).saturating_sub(1).min(samples - 4);
            let weights = spline_weights((at - at.floor()) as f32);
            SplineTaps { first, nearest: (at.round() as usize).min(samples - 1), weights }
        };
        (0..count).map(taps).collect()
    }
}

/// The four samples of a row (or column) that a pixel is interpolated from.
struct SplineTaps {
    /// Index of the first of the four samples.
    first: usize,
    nearest: usize,
    weights: [f32; 4],
}

/// Returns for each pixel whether it or one of its eight neighbours is not empty.
pub(super) fn covered(frame: &Frame) -> Vec<bool> {
    let columns = frame.size()[0] as usize;
    let drawn: Vec<bool> = frame.pixels().chunks_exact(4).map(|pixel| pixel[3] > 0.0).collect();
    let in_row: Vec<bool> = drawn.chunks_exact(columns).flat_map(|row| with_neighbours(row, 1)).collect();
    with_neighbours(&in_row, columns)
}

/// Returns for each flag whether it, or the one `distance` before or after it, is set.
fn with_neighbours(flags: &[bool], distance: usize) -> Vec<bool> {
    let mut set = flags.to_vec();
    set.iter_mut().skip(distance).zip(flags).for_each(|(set, before)| *set |= before);
    set.iter_mut().zip(flags.iter().skip(distance)).for_each(|(set, after)| *set |= after);
    set
}

/// The pole of the cubic B-spline's recursive filter: sqrt(3) - 2.
const POLE: f32 = -0.267_949_2;
/// A factor of -6 times [`POLE`]. The two passes of the filter leave it out, and [`spline_weights`] include it instead.
const GAIN: f32 = 6.0 * 0.267_949_2;

/// Returns the weights, times [`GAIN`], of four neighbouring coefficients at a point `t` (0 to 1) past the second one.
#[inline(always)]
pub(super) fn spline_weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        GAIN / 6.0 * (s * s * s),
        GAIN * (2.0 / 3.0 - t * t * (2.0 - t) / 2.0),
        GAIN * (2.0 / 3.0 - s * s * (2.0 - s) / 2.0),
        GAIN / 6.0 * (t * t * t),
    ]
}

/// Turns the samples of a line into the coefficients of the B-spline through them, divided by [`GAIN`]. The first and
/// the last sample count as repeated beyond the ends.
pub(super) fn to_coefficients(line: &mut [[f32; 4]]) {
    filter(line.iter_mut());
    filter(line.iter_mut().rev());
}

/// Applies the recursive filter in one direction.
fn filter<'a>(mut line: impl Iterator<Item = &'a mut [f32; 4]>) {
    let Some(first) = line.next() else { return };
    *first = first.map(|value| value / (1.0 - POLE));
    let mut before = *first;
    for pixel in line {
        before = std::array::from_fn(|c| pixel[c] + POLE * before[c]);
        *pixel = before;
    }
}

/// Does what [`to_coefficients`] does for every column; a row has `len` numbers.
pub(super) fn columns_to_coefficients(rows: &mut [f32], len: usize) {
    filter_columns(rows.chunks_exact_mut(len));
    filter_columns(rows.chunks_exact_mut(len).rev());
}

/// Applies the recursive filter to all columns, downward or upward.
fn filter_columns<'a>(mut rows: impl Iterator<Item = &'a mut [f32]>) {
    let Some(mut before) = rows.next() else { return };
    before.iter_mut().for_each(|value| *value /= 1.0 - POLE);
    for row in rows {
        row.iter_mut().zip(&*before).for_each(|(value, before)| *value += POLE * before);
        before = row;
    }
}

/// Computes the weighted sum of four rows.
#[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
fn weighted_sum(rows: [&[f32]; 4], weights: [f32; 4], out: &mut [f32]) {
    let [a, b, c, d] = rows.map(|row| &row[..out.len()]);
    for i in 0..out.len() {
        out[i] = (weights[0] * a[i] + weights[1] * b[i]) + (weights[2] * c[i] + weights[3] * d[i]);
    }
}
