//! Supersampling: several samples per pixel where voxels are smaller than pixels, then a Gaussian filter.
//!
//! In: a view whose footprints are narrower than the low-pass. Out: how many samples per pixel to draw, and the picture
//! filtered from them. Without it, EWA's low-pass widens each splat to a pixel before the exponential of its depth is
//! taken, and opaque detail comes out too opaque: 11.8 to 27.4 dB from the truth (docs/studies/sampling.md). With it,
//! voxels are composited at their own width, and light is filtered afterwards:
//!
//! ```text
//! view -> factor x factor samples per pixel -> draw -> Gaussian of LOW_PASS^2 - width^2 -> picture
//! ```
//!
//! Samples are drawn as far around the picture as the Gaussian reaches, so that a pixel at the picture's border is what it would be in
//! a larger picture. Every renderer can draw the samples: a camera that sees a little more, and more columns and rows.

#![expect(clippy::cast_possible_truncation, reason = "weights are single precision")]

use std::ops::Range;

use glam::{DVec3, Vec4};

use super::frame::in_range;
use super::kernel::{LOW_PASS, SPLAT_LOW_PASS, area, jacobian, narrowest_sigma, widened};
use super::view::{MAX_SIZE, PixelMap, View, apply, single};
use super::{Camera, Frame, Mode, Sampling, Settings};
use crate::error::Result;
use crate::traverse::VoxelBox;
use crate::volume::Grid;

/// Smallest standard deviation of the filter, in samples, for an even number of samples: they lie beside a pixel's middle,
/// not on it. With three samples, any filter is right.
const NARROWEST: f64 = 0.5;
/// Standard deviation, in samples, that stands for all narrower ones, so that no sum of weights is 0.
const LEAST_SIGMA: f64 = 0.1;
/// Width that samples' footprints must reach where 32 dB are enough, as a fraction of the low-pass's width.
const FEWEST: f32 = 0.5;
/// Largest number of samples along a side of a pixel. Without it voxels of 1 x 1 x 1000 took as many samples as fit into
/// memory, for errors below 60 dB.
const MAX_FACTOR: u32 = 16;
/// From which crowding on there may be fewer samples, in proportion. Without it a picture of 200 x 200 at 176 degrees took half a minute.
const CROWDED: f64 = 4.0;
/// Places along each axis of the drawn part that count for it, and their least distance from the eye's plane, in mean spacings.
const CELLS: usize = 16;
const LEAST_DEPTH: f64 = 0.5;
/// Largest number of samples of a picture: 256 MiB if all are in memory at once.
const MAX_SAMPLES: f64 = 16_777_216.0;
/// Number of samples of a strip, unless rows are too long for it: 16 MiB for its frame and bands.
pub(super) const STRIP_SAMPLES: u32 = 1 << 19;
/// The same where memory is short: pictures take longer, as each strip walks over all voxels.
pub(super) const SMALL_STRIP_SAMPLES: u32 = 1 << 17;

/// A number of samples per pixel, and the filter from samples to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Supersampling {
    /// Number of samples along a side of a pixel; at least 2.
    factor: u32,
    /// Columns and rows of the picture.
    size: [u32; 2],
    /// Number of samples on each side of the picture.
    around: u32,
    /// Standard deviation of the Gaussian, in samples.
    sigma: f64,
    /// Number of samples of a strip.
    strip_samples: u32,
}

/// Draws a picture by calling `draw` with settings and the low-pass of splats; supersamples if the settings and the view ask for it.
///
/// `bounds` is a box of all voxels; `None` if there are none.
///
/// # Errors
/// The errors of [`View::new`] and of `draw`; [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub fn supersampled<T>(
    grid: &Grid,
    bounds: Option<VoxelBox>,
    camera: &Camera,
    settings: &Settings,
    draw: impl FnOnce(&Camera, &Settings, f32) -> Result<(Frame, T)>,
) -> Result<(Frame, T)> {
    let (supersampling, low_pass) = Supersampling::of(grid, bounds, camera, settings)?;
    let Some(supersampling) = supersampling else { return draw(camera, settings, low_pass) };
    let (camera, settings) = supersampling.of_samples(camera, settings);
    let (samples, stats) = draw(&camera, &settings, low_pass)?;
    Ok((supersampling.picture(&samples, settings.threads)?, stats))
}

/// Returns the low-pass of splats in a view of the voxels in `bounds` that has these samples for each pixel; `None`: one.
///
/// It is the picture's, unless samples are close enough for the voxels at the centre.
pub(crate) fn splat_low_pass(
    view: &View,
    bounds: &VoxelBox,
    settings: &Settings,
    supersampling: Option<&Supersampling>,
) -> f32 {
    let factor = supersampling.map_or(1, |supersampling| supersampling.factor) as f32;
    let is_enough = is_filtered(settings) && factor * sigma_at_centre(view, bounds, settings) >= least_width(settings);
    if is_enough { SPLAT_LOW_PASS } else { LOW_PASS }
}

/// Returns whether the settings allow several samples for a pixel.
fn is_filtered(settings: &Settings) -> bool {
    settings.mode == Mode::Composite && !settings.keeps_pixels()
}

/// Returns the width that samples' footprints must reach.
fn least_width(settings: &Settings) -> f32 {
    if settings.sampling() == Sampling::Fewest { FEWEST * LOW_PASS } else { LOW_PASS }
}

impl Supersampling {
    /// Returns the supersampling for a camera's view of a grid with voxels in `bounds`, `None` if one sample per pixel is
    /// drawn; and the low-pass of splats.
    pub(crate) fn of(
        grid: &Grid,
        bounds: Option<VoxelBox>,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<(Option<Supersampling>, f32)> {
        let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
        let Some(bounds) = bounds else { return Ok((None, LOW_PASS)) };
        let supersampling = Supersampling::new(&view, &bounds, settings);
        Ok((supersampling, splat_low_pass(&view, &bounds, settings, supersampling.as_ref())))
    }

    /// Returns the one of two supersamplings that draws more samples; `None` draws one per pixel.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only renderers on graphics devices ask for it"))]
    pub(crate) fn finer(one: Option<Supersampling>, other: Option<Supersampling>) -> Option<Supersampling> {
        let factor = |supersampling: &Supersampling| supersampling.factor;
        if one.as_ref().map(factor) >= other.as_ref().map(factor) { one } else { other }
    }

    /// Returns the camera and the settings with which the samples are drawn.
    pub(crate) fn of_samples(&self, camera: &Camera, settings: &Settings) -> (Camera, Settings) {
        let size = self.size();
        let ratio = f64::from(size[1]) / f64::from(self.size[1] * self.factor);
        (camera.with_height_times(ratio), Settings { size, ..settings.clone() })
    }

    /// Returns the picture of all samples.
    pub(crate) fn picture(&self, samples: &Frame, threads: usize) -> Result<Frame> {
        let mut picture = Frame::transparent(self.size)?;
        self.reduce(samples, &self.whole(), threads, &mut picture);
        Ok(picture)
    }

    /// Returns the supersampling for a view of the voxels in `bounds`.
    ///
    /// `None` if one sample per pixel is enough, if even two along a side are too many, or if `settings` ask for none.
    /// In perspective the footprints at the centre of the visible voxels decide.
    pub(crate) fn new(view: &View, bounds: &VoxelBox, settings: &Settings) -> Option<Supersampling> {
        if !is_filtered(settings) {
            return None;
        }
        let width = f64::from(sigma_at_centre(view, bounds, settings));
        let low_pass = f64::from(LOW_PASS);
        // The comparison is false for NaN.
        let is_narrow = width < low_pass;
        if !is_narrow {
            return None;
        }
        let is_draft = settings.sampling() == Sampling::Fewest;
        let wanted = f64::from(least_width(settings));
        // The low-pass also widens narrow footprints to its own width in samples.
        let sigma = |factor: u32| {
            let factor = f64::from(factor);
            factor * (low_pass * low_pass - width.max(low_pass / factor).powi(2)).max(0.0).sqrt()
        };
        let is_enough = |factor: u32| {
            let is_filtered = is_draft || factor % 2 == 1 || sigma(factor) >= NARROWEST;
            factor > 1 && f64::from(factor) * width >= wanted && is_filtered
        };
        let crowded = (crowding(view, bounds, settings) / CROWDED).max(1.0);
        let pixels = crowded * f64::from(view.size[0]) * f64::from(view.size[1]);
        let of_factor = |factor: u32| {
            let sigma = sigma(factor).max(LEAST_SIGMA);
            let around = Filter::new(factor, sigma).before;
            Supersampling { factor, size: view.size, around, sigma, strip_samples: settings.strip_samples }
        };
        let fits = |factor: u32| {
            factor <= MAX_FACTOR
                && pixels * f64::from(factor * factor) <= MAX_SAMPLES
                && of_factor(factor).size().iter().all(|side| *side <= MAX_SIZE)
        };
        let mut factor = 1;
        while fits(factor + 1) && !is_enough(factor) {
            factor += 1;
        }
        (factor > 1).then(|| of_factor(factor))
    }

    /// Returns the supersampling that makes a picture of `size` from pictures with `factor` pixels for each of its own along a side,
    /// beyond which nothing is to be seen; `None` for 1.
    pub(crate) fn of_pixels(factor: u32, size: [u32; 2]) -> Option<Supersampling> {
        let [of_picture, of_sample] = [f64::from(factor), 1.0].map(|samples| samples * f64::from(LOW_PASS));
        let sigma = (of_picture * of_picture - of_sample * of_sample).sqrt();
        (factor > 1).then_some(Supersampling { factor, size, around: 0, sigma, strip_samples: STRIP_SAMPLES })
    }

    /// Returns the number of columns and rows of samples.
    fn size(&self) -> [u32; 2] {
        self.size.map(|side| side.saturating_mul(self.factor).saturating_add(2 * self.around))
    }

    /// Returns the number of samples.
    pub(crate) fn samples(&self) -> u64 {
        self.size().map(u64::from).iter().product()
    }

    /// Returns the whole picture as one strip.
    fn whole(&self) -> Strip {
        Strip { rows: 0..self.size[1], sample_rows: 0..self.size()[1] }
    }

    /// Cuts the picture into strips, from top to bottom.
    pub(crate) fn strips(&self) -> Vec<Strip> {
        let filter = Filter::new(self.factor, self.sigma);
        let [columns, rows] = self.size();
        // The rows that the filter needs around a strip are drawn again for the next strip: they should be few.
        let taps = filter.weights.len() as u32;
        let height = ((self.strip_samples / columns).max(3 * taps) - taps) / self.factor;
        let strip = |from: u32| {
            let to = self.size[1].min(from + height);
            let first = self.first_sample(from).saturating_sub(filter.before);
            let end = (self.first_sample(to - 1) + taps).saturating_sub(filter.before);
            Strip { rows: from..to, sample_rows: first..end.min(rows) }
        };
        (0..self.size[1]).step_by(height as usize).map(strip).collect()
    }

    /// Returns the number of columns and rows of samples of the largest strip.
    pub(crate) fn strip_size(&self) -> [u32; 2] {
        let most = self.strips().iter().map(|strip| strip.sample_rows.len()).max();
        [self.size()[0], most.map_or(0, |rows| rows as u32)]
    }

    /// Returns the view of a strip's samples.
    pub(crate) fn view(&self, view: &View, strip: &Strip) -> View {
        view.with_pixels(f64::from(self.factor), self.size(), self.around.into()).with_rows(strip.sample_rows.clone())
    }

    /// Returns the first sample of a row or column of the picture.
    fn first_sample(&self, pixel: u32) -> u32 {
        self.around + pixel * self.factor
    }

    /// Filters the samples of a strip into `picture`.
    pub(crate) fn reduce(&self, samples: &Frame, strip: &Strip, threads: usize, picture: &mut Frame) {
        let filter = Filter::new(self.factor, self.sigma);
        let all_columns = 0..samples.size()[0];
        let columns: Vec<ClippedFilter> =
            (0..self.size[0]).map(|column| filter.clipped(self.first_sample(column), &all_columns)).collect();
        let len = 4 * samples.size()[0] as usize;
        picture.fill_some_rows(strip.rows.clone(), threads, |row, out| {
            let mut sums = vec![0.0f32; len];
            let part = filter.clipped(self.first_sample(row as u32), &strip.sample_rows);
            for (line, weight) in samples.pixels()[len * part.first..].chunks_exact(len).zip(part.weights) {
                sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += weight * value);
            }
            for (pixel, part) in out.iter_mut().zip(&columns) {
                let weighted = sums.as_chunks().0[part.first..].iter().zip(part.weights);
                let sum = weighted.fold(Vec4::ZERO, |sum, (values, weight)| sum + *weight * Vec4::from_array(*values));
                *pixel = in_range(sum);
            }
        });
    }
}

/// Some rows of a picture, and the rows of samples that they need.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Strip {
    rows: Range<u32>,
    sample_rows: Range<u32>,
}

/// The weights of the samples around a pixel, along a row or a column.
struct Filter {
    /// Number of samples between the first weight and the first sample of the pixel.
    before: u32,
    weights: Vec<f32>,
}

/// The part of a filter that lies within a range of samples.
struct ClippedFilter<'a> {
    /// Index of the first sample, counted from the start of that range.
    first: usize,
    weights: &'a [f32],
}

impl Filter {
    /// Returns the weights of the samples around the middle of a pixel with `factor` samples a side; they add up to 1.
    fn new(factor: u32, sigma: f64) -> Filter {
        let middle = (f64::from(factor) - 1.0) / 2.0;
        // Cut off at five standard deviations, which loses 6e-7, but not before the pixel's own samples.
        let reach = (5.0 * sigma).max(middle);
        let first = (middle - reach).ceil();
        let count = (middle + reach).floor() - first;
        let weights: Vec<f64> = (0..=count as i32)
            .map(|index| (-0.5 * ((first + f64::from(index) - middle) / sigma).powi(2)).exp())
            .collect();
        let total: f64 = weights.iter().sum();
        #[expect(clippy::cast_sign_loss, reason = "the first weight is that of the pixel's first sample, or before it")]
        let before = -first as u32;
        Filter { before, weights: weights.into_iter().map(|weight| (weight / total) as f32).collect() }
    }

    /// Returns the part of the filter that lies within the samples `all`, for the pixel whose first sample is `sample`.
    fn clipped(&self, sample: u32, all: &Range<u32>) -> ClippedFilter<'_> {
        let from = all.start.max(sample.saturating_sub(self.before));
        let weights = &self.weights[(from + self.before - sample) as usize..];
        let weights = &weights[..weights.len().min((all.end - from) as usize)];
        ClippedFilter { first: (from - all.start) as usize, weights }
    }
}

/// Returns how many times as large as at the centre footprints are in the mean of all places in the drawn part of `bounds`; 1 in a parallel
/// view. In a wide perspective it is large, as voxels beside the eye cover much of the picture.
fn crowding(view: &View, bounds: &VoxelBox, settings: &Settings) -> f64 {
    let PixelMap::Perspective { camera_from_voxel, focal, .. } = &view.map else { return 1.0 };
    let VoxelBox { low, high } = drawn(bounds, settings);
    let steps = camera_from_voxel.each_ref().map(single);
    let picture = f64::from(view.size[0]) * f64::from(view.size[1]);
    let area = |[right, up, depth]: [f64; 3]| {
        let nearness = 1.0 / depth.max(LEAST_DEPTH);
        let [tan_x, tan_y] = [right, up].map(|aside| (aside * nearness) as f32);
        let rows = jacobian(&steps, tan_x, tan_y, (focal * nearness) as f32);
        f64::from(area(rows, settings.fine_kernel().sigma)).min(picture)
    };
    let at = |place: [f64; 3]| camera_from_voxel.each_ref().map(|map| apply(map, place));
    let places = (0..CELLS.pow(3)).map(|cell| {
        let cells = [cell % CELLS, cell / CELLS % CELLS, cell / (CELLS * CELLS)];
        at([0, 1, 2].map(|a| {
            let part = (cells[a] as f64 + 0.5) / CELLS as f64;
            f64::from(low[a]) + part * f64::from(high[a] - low[a])
        }))
    });
    let sum: f64 = places.filter(|[.., depth]| *depth > 0.0).map(area).sum();
    let distance = DVec3::from_array(at(centre(bounds, settings))).length();
    sum / CELLS.pow(3) as f64 / area([0.0, 0.0, distance])
}

/// Returns the standard deviation of a footprint across its narrowest direction, in pixels.
///
/// In perspective it is that of a voxel at the centre of the drawn part of `bounds`, as if it were on the view axis.
pub(super) fn sigma_at_centre(view: &View, bounds: &VoxelBox, settings: &Settings) -> f32 {
    let sigma = settings.fine_kernel().sigma;
    let per_block = settings.blocks.0.map(|points| 1.0 / points as f32);
    match &view.map {
        PixelMap::Parallel { pixel_from_voxel, .. } => {
            narrowest_sigma(widened(pixel_from_voxel.each_ref().map(single), per_block), sigma)
        }
        PixelMap::Perspective { camera_from_voxel, focal, near, .. } => {
            let [right, up, forward] = camera_from_voxel;
            let centre = centre(bounds, settings);
            let toward = DVec3::from_array(camera_from_voxel.each_ref().map(|map| apply(map, centre)));
            let distance = toward.length().max(*near);
            let (across, above) = toward.try_normalize().unwrap_or(DVec3::Z).any_orthonormal_pair();
            let scale = focal / distance;
            let row =
                |axis: DVec3| [0, 1, 2].map(|a| (scale * axis.dot(DVec3::new(right[a], up[a], forward[a]))) as f32);
            narrowest_sigma(widened([row(across), row(above)], per_block), sigma)
        }
    }
}

/// Returns the part of `bounds` that is drawn.
fn drawn(bounds: &VoxelBox, settings: &Settings) -> VoxelBox {
    let crop = settings.crop.unwrap_or(*bounds);
    let both = |low: u16, high: u16| [low.min(high), high];
    let [x, y, z] = [0, 1, 2].map(|a| both(crop.low[a].max(bounds.low[a]), crop.high[a].min(bounds.high[a])));
    VoxelBox { low: [x[0], y[0], z[0]], high: [x[1], y[1], z[1]] }
}

/// Returns the middle of that part.
fn centre(bounds: &VoxelBox, settings: &Settings) -> [f64; 3] {
    let VoxelBox { low, high } = drawn(bounds, settings);
    [0, 1, 2].map(|a| (f64::from(low[a]) + f64::from(high[a])) / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::{Projection, Quality};

    /// They had 16 a side, and took half a minute: the nearest voxels cover much of the picture.
    #[test]
    fn very_wide_perspectives_have_no_more_samples_than_they_can_draw() {
        let (grid, size) = (Grid::new([256, 256, 128], [1.0; 3]).unwrap(), [200; 2]);
        let all = VoxelBox { low: [0; 3], high: [255, 255, 127] };
        let factor = |fov: f64| {
            let projection = Projection::Perspective { fov };
            let camera = Camera::new([128.0, -8.0, 64.0], [128.0, 128.0, 64.0], [0.0, 0.0, 1.0], projection).unwrap();
            let settings = Settings::new(size).with_quality(Quality::High);
            Supersampling::of(&grid, Some(all), &camera, &settings).unwrap().0.map_or(1, |finer| finer.factor)
        };
        // As many as voxels in the middle need up to 140 degrees.
        assert_eq!([60.0, 140.0, 176.0, 179.0].map(factor), [1, 4, 7, 7]);
    }

    #[test]
    fn strips_are_the_whole_picture_bit_for_bit() {
        for size in [[1, 1], [700, 500], [9, 2000], [2048, 300]] {
            let supersampling = Supersampling { factor: 3, size, around: 6, sigma: 1.4, strip_samples: STRIP_SAMPLES };
            let [columns, _] = supersampling.size();
            let mut samples = Frame::transparent(supersampling.size()).unwrap();
            for (index, value) in samples.pixels_mut().iter_mut().enumerate() {
                *value = (index % 1009) as f32 / 1009.0;
            }
            let [mut at_once, mut by_strips] = [0; 2].map(|_| Frame::transparent(size).unwrap());
            supersampling.reduce(&samples, &supersampling.whole(), 1, &mut at_once);
            for strip in &supersampling.strips() {
                let rows = &strip.sample_rows;
                let mut part = Frame::transparent([columns, rows.len() as u32]).unwrap();
                let [from, to] = [rows.start, rows.end].map(|row| 4 * (columns * row) as usize);
                part.pixels_mut().copy_from_slice(&samples.pixels()[from..to]);
                supersampling.reduce(&part, strip, 2, &mut by_strips);
            }
            assert!(at_once == by_strips, "{size:?}");
            let pixels = supersampling.strip_size()[0] * supersampling.strip_size()[1];
            assert!(pixels <= STRIP_SAMPLES.max(columns * 3 * 15), "{size:?}: {pixels}");
        }
    }
}
