//! Finer pixels: what a pixel shows of voxels that are finer than it.
//!
//! In: a view whose footprints are narrower than the low-pass. Out: how many pixels to draw for one; and from the picture of
//! those the picture, seen through a Gaussian. EWA's low-pass widens each splat to a pixel before its depth is put through the
//! exponential, so opaque detail comes out too opaque: 11 to 37 dB from what it should be (docs/studies/sampling.md). Finer pixels composite
//! voxels at their own width, and light is filtered afterwards:
//!
//! ```text
//! view -> factor x factor pixels for each -> draw -> Gaussian of LOW_PASS^2 - width^2 -> picture
//! ```
//!
//! Every renderer can draw the larger picture: the same camera, more columns and rows.

#![expect(clippy::cast_possible_truncation, reason = "weights are single precision")]

use std::ops::Range;

use glam::{DVec3, Vec4};

use super::frame::in_range;
use super::kernel::{LOW_PASS, narrowest};
use super::view::{MAX_SIZE, PixelMap, View};
use super::{Camera, Frame, Sampling, Settings};
use crate::error::Result;
use crate::traverse::VoxelBox;
use crate::volume::Grid;

/// Standard deviation of a footprint across its narrowest direction, in pixels, from which on a picture's own pixels do. Up to
/// 0.49 finer ones were nearer to a picture of sixteen times as many in all of 36 views (docs/studies/sampling.md).
pub(super) const WIDE_ENOUGH: f64 = 0.53;
/// Part of the low-pass that finer pixels of footprints need not be wider than where 32 dB are enough.
const FEWEST: f64 = 0.5;
/// Finer pixels of a picture, at most: 256 MiB where they are all there at a time.
const MOST_PIXELS: u64 = 1 << 24;
/// Finer pixels that are drawn at once, if rows are not too long for it: 16 MiB, frame and bands.
const AT_ONCE: u32 = 1 << 19;

/// How much finer pixels are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finer {
    /// Pixels for one, along a side; at least 2.
    factor: u32,
    /// Columns and rows of the picture.
    size: [u32; 2],
    /// Standard deviation of the Gaussian, in finer pixels.
    sigma: f64,
}

/// Draws a picture by `draw`, which is given the settings: supersampled, then filtered, where the settings and the view ask
/// for it. `bounds`: of all voxels; `None` if there are none.
///
/// # Errors
/// As [`View::new`]; as `draw`; if memory cannot be had.
pub fn supersampled<T>(
    grid: &Grid,
    bounds: Option<VoxelBox>,
    camera: &Camera,
    settings: &Settings,
    draw: impl FnOnce(&Settings) -> Result<(Frame, T)>,
) -> Result<(Frame, T)> {
    let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
    let Some(finer) = bounds.and_then(|bounds| Finer::of(&view, &bounds, settings)) else { return draw(settings) };
    let (frame, stats) = draw(&Settings { size: finer.size(), ..settings.clone() })?;
    let mut picture = Frame::transparent(settings.size)?;
    finer.reduce(&frame, &finer.whole(), settings.threads, &mut picture);
    Ok((picture, stats))
}

impl Finer {
    /// For a view of the voxels in `bounds`; `None` if the picture's own pixels do, if twice as many along a side are too many, or
    /// if `settings` want none. In perspective the middle of what is drawn says how wide footprints are.
    pub fn of(view: &View, bounds: &VoxelBox, settings: &Settings) -> Option<Finer> {
        if settings.keeps_pixels() {
            return None;
        }
        let width = f64::from(width_in_the_middle(view, bounds, settings));
        // Not so for NaN.
        let is_fine = width < WIDE_ENOUGH;
        if !is_fine {
            return None;
        }
        let low_pass = f64::from(LOW_PASS);
        let wanted = if settings.sampling() == Sampling::Fewest { FEWEST * low_pass } else { low_pass };
        let pixels = u64::from(view.size[0]) * u64::from(view.size[1]);
        let fits = |factor: u32| {
            view.size.iter().all(|side| side.saturating_mul(factor) <= MAX_SIZE)
                && pixels * u64::from(factor).pow(2) <= MOST_PIXELS
        };
        let mut factor = 1;
        while fits(factor + 1) && (factor == 1 || f64::from(factor) * width < wanted) {
            factor += 1;
        }
        if factor == 1 {
            return None;
        }
        // What finer pixels leave to be widened by the low-pass of their own.
        let width = width.max(low_pass / f64::from(factor));
        let sigma = f64::from(factor) * (low_pass * low_pass - width * width).sqrt();
        Some(Finer { factor, size: view.size, sigma })
    }

    /// Columns and rows of finer pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size.map(|side| side * self.factor)
    }

    /// The whole picture as one.
    pub fn whole(&self) -> Strip {
        Strip { rows: 0..self.size[1], finer: 0..self.size()[1] }
    }

    /// The picture in parts, from top to bottom.
    pub(crate) fn strips(&self) -> Vec<Strip> {
        let taps = self.taps();
        let [columns, rows] = self.size();
        // Rows around a strip's own are drawn for the next one again: they should not be most of it.
        let around = taps.weights.len() as u32;
        let some = ((AT_ONCE / columns).max(3 * around) - around) / self.factor;
        let strip = |from: u32| {
            let to = self.size[1].min(from + some);
            let first = (from * self.factor).saturating_sub(taps.before);
            let end = ((to - 1) * self.factor + taps.weights.len() as u32).saturating_sub(taps.before);
            Strip { rows: from..to, finer: first..end.min(rows) }
        };
        (0..self.size[1]).step_by(some as usize).map(strip).collect()
    }

    /// Columns and rows of finer pixels of the largest strip.
    pub(crate) fn strip_size(&self) -> [u32; 2] {
        let most = self.strips().iter().map(|strip| strip.finer.len()).max();
        [self.size()[0], most.map_or(0, |rows| rows as u32)]
    }

    /// A strip of `view` in finer pixels.
    pub(crate) fn view(&self, view: &View, strip: &Strip) -> View {
        view.with_pixels(f64::from(self.factor), self.size(), 0.0).with_rows(strip.finer.clone())
    }

    /// A strip of `picture`, from its finer pixels; what lies beyond the edge of all of them is as what is within.
    ///
    /// O(finer pixels). The result does not depend on `threads`.
    pub fn reduce(&self, finer: &Frame, strip: &Strip, threads: usize, picture: &mut Frame) {
        let taps = self.taps();
        let columns: Vec<Part> =
            (0..self.size[0]).map(|column| taps.part(column * self.factor, &(0..finer.size()[0]))).collect();
        let (width, len) = (4 * self.size[0] as usize, 4 * finer.size()[0] as usize);
        picture.rows_in_shares(strip.rows.clone(), threads, |first, out| {
            let mut sums = vec![0.0f32; len];
            for (row, out) in (first as u32..).zip(out.chunks_exact_mut(width)) {
                sums.fill(0.0);
                let part = taps.part(row * self.factor, &strip.finer);
                for (line, weight) in finer.pixels()[len * part.first..].chunks_exact(len).zip(part.weights) {
                    let weight = part.share * weight;
                    sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += weight * value);
                }
                let sums = sums.as_chunks::<4>().0;
                for (pixel, part) in out.as_chunks_mut::<4>().0.iter_mut().zip(&columns) {
                    let seen = sums[part.first..].iter().zip(part.weights);
                    let sum = seen.fold(Vec4::ZERO, |sum, (values, weight)| sum + *weight * Vec4::from_array(*values));
                    *pixel = in_range(part.share * sum);
                }
            }
        });
    }

    /// Weights around the middle of a pixel; they add up to 1.
    fn taps(&self) -> Taps {
        let factor = f64::from(self.factor);
        let middle = (factor - 1.0) / 2.0;
        // Five standard deviations lose 6e-7.
        let reach = 5.0 * self.sigma;
        let first = (middle - reach).ceil();
        let count = (middle + reach).floor() - first;
        let weights: Vec<f64> = (0..=count as i32)
            .map(|place| (-0.5 * ((first + f64::from(place) - middle) / self.sigma).powi(2)).exp())
            .collect();
        let total: f64 = weights.iter().sum();
        #[expect(clippy::cast_sign_loss, reason = "the Gaussian is wider than a finer pixel's half: see `WIDE_ENOUGH`")]
        let before = -first as u32;
        Taps { before, weights: weights.into_iter().map(|weight| (weight / total) as f32).collect() }
    }
}

/// Some rows of a picture, and the finer rows that they show.
#[derive(Debug, Clone, PartialEq)]
pub struct Strip {
    rows: Range<u32>,
    finer: Range<u32>,
}

struct Taps {
    /// How many finer pixels before a pixel's first the taps begin.
    before: u32,
    weights: Vec<f32>,
}

/// Those of a pixel's taps that lie in a picture.
struct Part<'a> {
    /// The place of the first.
    first: usize,
    weights: &'a [f32],
    /// One over their sum.
    share: f32,
}

impl Taps {
    /// Of the pixel whose first finer one is `at`; of finer ones there are those of `all`, the first at place 0.
    fn part(&self, at: u32, all: &Range<u32>) -> Part<'_> {
        let from = all.start.max(at.saturating_sub(self.before));
        let left_out = (from + self.before - at) as usize;
        let weights = &self.weights[left_out..];
        let weights = &weights[..weights.len().min((all.end - from) as usize)];
        Part { first: (from - all.start) as usize, weights, share: 1.0 / weights.iter().sum::<f32>() }
    }
}

/// Standard deviation of a footprint across its narrowest direction, in pixels: of any voxel of a parallel view, in perspective of
/// one in the middle of what is drawn of `bounds`, as if the view went there.
pub(super) fn width_in_the_middle(view: &View, bounds: &VoxelBox, settings: &Settings) -> f32 {
    let sigma = settings.kernel().sigma;
    let single = |map: &[f64; 4]| [map[0] as f32, map[1] as f32, map[2] as f32];
    match &view.map {
        PixelMap::Parallel { pixel_from_voxel, .. } => narrowest(pixel_from_voxel.each_ref().map(single), sigma),
        PixelMap::Perspective { camera_from_voxel, focal, near, .. } => {
            let VoxelBox { low, high } = settings.crop.unwrap_or(*bounds);
            let middle = [0, 1, 2].map(|a| {
                let (low, high) = (low[a].max(bounds.low[a]), high[a].min(bounds.high[a]));
                (f64::from(low) + f64::from(high)) / 2.0
            });
            let [right, up, along] = camera_from_voxel;
            let place = |m: &[f64; 4]| m[0] * middle[0] + m[1] * middle[1] + m[2] * middle[2] + m[3];
            let toward = DVec3::new(place(right), place(up), place(along));
            let distance = toward.length().max(*near);
            let direction = toward.try_normalize().unwrap_or(DVec3::Z);
            let (across, above) = direction.any_orthonormal_pair();
            let scale = focal / distance;
            let row = |axis: DVec3| [0, 1, 2].map(|a| (scale * axis.dot(DVec3::new(right[a], up[a], along[a]))) as f32);
            narrowest([row(across), row(above)], sigma)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_lie_around_the_middle_of_a_pixel_and_add_up_to_one() {
        for (factor, sigma) in [(2, 0.56), (2, 1.04), (3, 1.5), (5, 2.94)] {
            let Taps { before, weights } = Finer { factor, size: [1, 1], sigma }.taps();
            let places = || (0..).map(|tap| f64::from(tap) - f64::from(before) - f64::from(factor - 1) / 2.0);
            let moment = |power: i32| -> f64 {
                places().zip(&weights).map(|(place, weight)| place.powi(power) * f64::from(*weight)).sum()
            };
            // Rounding to single precision; samples two to a standard deviation have a Gaussian's width within 2 %.
            assert!((moment(0) - 1.0).abs() < 1e-6 && moment(1).abs() < 1e-5, "{} {}", moment(0), moment(1));
            assert!((moment(2) / (sigma * sigma) - 1.0).abs() < 0.06, "{factor} {sigma}: {}", moment(2));
        }
    }

    #[test]
    fn strips_are_the_whole_picture_bit_for_bit() {
        for size in [[1, 1], [700, 500], [9, 2000], [2048, 300]] {
            let finer = Finer { factor: 3, size, sigma: 1.4 };
            let strips = finer.strips();
            let (mut whole, [columns, rows]) = (Frame::transparent(finer.size()).unwrap(), finer.size());
            for (index, value) in whole.pixels_mut().iter_mut().enumerate() {
                *value = (index % 1009) as f32 / 1009.0;
            }
            let [mut once, mut by_strips] = [0; 2].map(|_| Frame::transparent(size).unwrap());
            finer.reduce(&whole, &finer.whole(), 1, &mut once);
            let mut next = 0;
            for strip in &strips {
                assert_eq!(strip.rows.start, next);
                next = strip.rows.end;
                assert!(strip.finer.end <= rows && strip.finer.len() <= finer.strip_size()[1] as usize);
                let mut part = Frame::transparent([columns, strip.finer.len() as u32]).unwrap();
                let first = 4 * (columns * strip.finer.start) as usize;
                part.pixels_mut().copy_from_slice(&whole.pixels()[first..][..4 * columns as usize * strip.finer.len()]);
                finer.reduce(&part, strip, 2, &mut by_strips);
            }
            assert_eq!(next, size[1]);
            assert!(once == by_strips, "{size:?} in {} strips", strips.len());
            let pixels = finer.strip_size()[0] * finer.strip_size()[1];
            assert!(pixels <= AT_ONCE.max(columns * 3 * 15), "{size:?}: {pixels}");
        }
    }
}
