//! The base plane: a plane on which every slice of a parallel view is a lattice of pixels.
//!
//! In: a parallel view and the order of its walk. Out: the same view onto a plane whose columns and rows are those of a
//! slice's voxels, each slice shifted with the slant of the view; and the picture, interpolated from the plane by cubic
//! B-splines.
//!
//! ```text
//! column = fast   + slope_f * slow + a          pixel = A (column, row) + b
//! row    = medium + slope_m * slow + c
//! ```
//!
//! All voxels of a slice share one footprint, pixel for pixel ([`stamp`](super::stamp)); a large picture costs little
//! more.
//!
//! Source: Lacroute and Levoy, "Fast volume rendering using a shear-warp factorization", 1994.

use glam::Vec4;
use multiversion::multiversion;

use super::coarse::{columns_to_coefficients, covered, limit, spline_weights, to_coefficients};
use super::{row_buffer, stamp};
use crate::error::Result;
use crate::splat::frame::in_range;
use crate::splat::kernel::{LOW_PASS, footprint, narrowest_sigma};
use crate::splat::supersample::WIDE_ENOUGH;
use crate::splat::view::{MAX_SIZE, PixelMap, View, single};
use crate::splat::{Frame, Settings};
use crate::traverse::{Order, Sense, VoxelBox};

/// Width of the plane's margin around the voxels, in its pixels, so that the voxels' edge is interpolated correctly.
const MARGIN: f64 = 6.0;
/// Largest ratio of the plane's pixel count to the picture's (over the same area) at which a plane is worthwhile.
const MAX_PIXELS: f64 = 6.0;
/// Largest standard deviation of a kernel, in pixels of the picture along either direction of the plane, at which the
/// plane is more exact than splats in the picture, which the low-pass filter widens. Up to 0.49 the plane was nearer to
/// supersampled pictures in all of 36 views, by 5 to 19 dB; at 0.56 in 15 of 18 (docs/studies/sampling.md).
const ENOUGH: f64 = WIDE_ENOUGH;
/// Like [`ENOUGH`], where 32 dB suffice: the worst views, along or nearly along an axis, have 34 dB at any magnification,
/// but opaque waves near the Nyquist frequency 29 dB.
const FEWEST: f64 = 2.1;
/// Smallest width of a plane's pixel, in pixels of the picture. If it is smaller along both directions, the four points
/// that are sampled per pixel of the picture miss parts of the pixel.
const FINEST: f64 = 0.4;

/// The base plane of a view, and how voxels, the plane and the picture map to each other.
#[derive(Debug, Clone)]
pub(super) struct BasePlane {
    /// The view with the plane's pixels in place of the picture's.
    pub(super) view: View,
    /// Columns and rows of the picture.
    picture: [u32; 2],
    /// The maps from a pixel of the picture to a column and a row of the plane: factors of x and of y, and a constant.
    plane_from_pixel: [[f64; 3]; 2],
    /// Variance of the low-pass filter along x and along y, in square pixels of the picture.
    blur: f64,
}

impl BasePlane {
    /// Returns the base plane of a parallel view of the voxels in `bounds`.
    ///
    /// `None` if the view is not parallel, `order` is not the view's own, stamps cannot do the blending (only front to
    /// back, exponential), or the plane would be too coarse for `settings`, too fine or too large.
    pub(super) fn new(view: &View, order: &Order, bounds: &VoxelBox, settings: &Settings) -> Option<BasePlane> {
        let coarsest = limit(settings, ENOUGH, FEWEST).filter(|_| settings.sense == Sense::FrontToBack)?;
        let kernel = settings.kernel();
        let PixelMap::Parallel { pixel_from_voxel: [x, y], scale } = &view.map else { return None };
        let [slow, medium, fast] = [order.slow.index(), order.medium.index(), order.fast.index()];
        let area = x[fast] * y[medium] - x[medium] * y[fast];
        // The inverse of the matrix A. The columns of A are a voxel's steps, in pixels, along the fast and the medium
        // axis.
        let inverse = [[y[medium] / area, -x[medium] / area], [-y[fast] / area, x[fast] / area]];
        let transform = |[a, b]: [f64; 2], [p, q]: [f64; 2]| a * p + b * q;
        let slope = inverse.map(|row| transform(row, [x[slow], y[slow]]));
        let sigma = f64::from(kernel.sigma);
        let steps = [fast, medium].map(|axis| x[axis].hypot(y[axis]));
        // A slope above 1 means that the view runs along another axis than the slow one.
        if !slope.iter().all(|slope| slope.abs() < 1.001)
            || steps.iter().any(|step| sigma * step > coarsest)
            || steps.iter().all(|step| *step < FINEST)
            || area.abs() < 1.0 / MAX_PIXELS
        {
            return None;
        }
        let base = |axis: usize, slope: f64| {
            let mut map = [0.0; 4];
            (map[axis], map[slow]) = (1.0, slope);
            map
        };
        let mut plane_from_voxel = [base(fast, slope[0]), base(medium, slope[1])];
        // The plane covers only what both the picture shows and the voxels occupy.
        let [columns, rows] = view.size.map(f64::from);
        let corners = [[0.0, 0.0], [columns, 0.0], [0.0, rows], [columns, rows]]
            .map(|[across, down]: [f64; 2]| [across - 0.5 - x[3], down - 0.5 - y[3]]);
        let mut size = [0; 2];
        let mut first = [0.0; 2];
        for side in 0..2 {
            let shown = corners.map(|corner| transform(inverse[side], corner));
            let shown_low = shown.into_iter().fold(f64::INFINITY, f64::min);
            let shown_high = shown.into_iter().fold(-f64::INFINITY, f64::max);
            let axis = [fast, medium][side];
            let ends = [bounds.low[slow], bounds.high[slow]].map(|at| slope[side] * f64::from(at));
            let reach = f64::from(kernel.radius) * 1.5 + 1.0;
            let low = f64::from(bounds.low[axis]) + ends[0].min(ends[1]) - reach;
            let high = f64::from(bounds.high[axis]) + ends[0].max(ends[1]) + reach;
            let (low, high) = (low.max(shown_low - 2.0), high.min(shown_high + 2.0));
            first[side] = low.floor() - MARGIN;
            let pixels = (high.ceil() - first[side] + MARGIN + 1.0).max(2.0 * MARGIN);
            if pixels.is_nan() || pixels > f64::from(MAX_SIZE) {
                return None;
            }
            size[side] = pixels as u32;
            plane_from_voxel[side][3] = -first[side];
        }
        let plane_from_pixel = [0, 1].map(|side| {
            let [a, b]: [f64; 2] = inverse[side];
            [a, b, -first[side] - a * x[3] - b * y[3]]
        });
        let ellipse = footprint(plane_from_voxel.each_ref().map(single), kernel.sigma, kernel.cut_off()).ellipse;
        if ellipse.half_x.max(ellipse.half_y) >= stamp::MAX_HALF_WIDTH {
            return None;
        }
        let sigma = narrowest_sigma([single(x), single(y)], kernel.sigma);
        let blur = (f64::from(LOW_PASS * LOW_PASS) - f64::from(sigma * sigma)).max(0.0);
        let map = PixelMap::Parallel { pixel_from_voxel: plane_from_voxel, scale: scale / area.abs().sqrt() };
        let view_of_plane = View { map, size, ..view.clone() };
        Some(BasePlane { view: view_of_plane, picture: view.size, plane_from_pixel, blur })
    }

    /// Computes the picture from `plane`, the frame drawn on the plane. The result does not depend on `threads`.
    pub(super) fn warp(&self, mut plane: Frame, threads: usize) -> Result<Frame> {
        let columns = plane.size()[0] as usize;
        let covered = covered(&plane);
        plane.fill_rows(threads, |_, row| to_coefficients(row));
        columns_to_coefficients(plane.pixels_mut(), 4 * columns);
        let mut picture = Frame::transparent(self.picture)?;
        // The mean of four points, each one standard deviation from the pixel in x and in y, blurs with that variance.
        let distance = self.blur.sqrt();
        let corners = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].map(|point| point.map(|c| c * distance));
        let points = if distance < MIN_BLUR { &[[0.0; 2]][..] } else { &corners };
        let coefficients = Coefficients { values: plane.pixels().as_chunks().0, covered: &covered, columns };
        picture.fill_rows(threads, |y, row| {
            resample(&coefficients, &self.plane_from_pixel, points, y as f64, row);
        });
        Ok(picture)
    }
}

/// Returns the most bytes for a plane of `pixels` pixels: rows of bands, the plane's frame, the mask of covered pixels.
pub(super) fn memory_need(pixels: u64) -> u64 {
    const PIXEL: u64 = 2 * 16 + 2;
    const SPARE_COLUMNS: u64 = 16 * row_buffer::WIDE as u64 * MAX_SIZE as u64;
    PIXEL.saturating_mul(pixels).saturating_add(SPARE_COLUMNS)
}

/// Smallest standard deviation of a blur that is done, in pixels. A smaller one changes no value by more than 0.001.
const MIN_BLUR: f64 = 0.03;

/// The coefficients of the B-spline through the pixels of a plane.
struct Coefficients<'a> {
    values: &'a [[f32; 4]],
    /// For each pixel: whether something was drawn on it or on one of its eight neighbours.
    covered: &'a [bool],
    columns: usize,
}

/// How many pixels of a row are computed together.
const TOGETHER: usize = 16;

/// Computes a row of the picture: the mean of the plane's spline at `points` around each pixel.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn resample(from: &Coefficients, map: &[[f64; 3]; 2], points: &[[f64; 2]], y: f64, row: &mut [[f32; 4]]) {
    let weight = 1.0 / points.len() as f32;
    let mut sides = [PlaneCoordinates::default(), PlaneCoordinates::default()];
    for (first, pixels) in (0u32..).step_by(TOGETHER).zip(row.chunks_mut(TOGETHER)) {
        let mut sums = [Vec4::ZERO; TOGETHER];
        for [dx, dy] in points {
            for (side, [a, b, c]) in sides.iter_mut().zip(map) {
                side.set(*a, (f64::from(first) + dx) * a + (b * (y + dy) + c));
            }
            from.add(&sides, &mut sums[..pixels.len()]);
        }
        for (pixel, sum) in pixels.iter_mut().zip(sums) {
            *pixel = in_range(sum * weight);
        }
    }
}

impl Coefficients<'_> {
    /// Adds the values of the spline at the coordinates (`u`, `v`) of some pixels to those pixels' `sums`.
    #[inline(always)]
    fn add(&self, [u, v]: &[PlaneCoordinates; 2], sums: &mut [Vec4]) {
        let ends = [self.columns, self.values.len() / self.columns].map(|side| side as i32 - 2);
        for (i, sum) in sums.iter_mut().enumerate() {
            // Outside the plane and at its border, nothing was drawn.
            if u.pixel[i] < 1 || v.pixel[i] < 1 || u.pixel[i] >= ends[0] || v.pixel[i] >= ends[1] {
                continue;
            }
            let (left, top) = (u.pixel[i] as usize, v.pixel[i] as usize);
            let nearest =
                self.columns * (top + usize::from(v.fraction[i] >= 0.5)) + left + usize::from(u.fraction[i] >= 0.5);
            if self.covered[nearest] {
                let weights = |side: &PlaneCoordinates| [0, 1, 2, 3].map(|k| side.weights[k][i]);
                *sum += self.spline(left - 1, top - 1, weights(u), weights(v));
            }
        }
    }

    /// Returns the value of the spline from 4 x 4 coefficients, of which the first is in column `left` and row `top`.
    #[inline(always)]
    fn spline(&self, left: usize, top: usize, column_weights: [f32; 4], row_weights: [f32; 4]) -> Vec4 {
        let row = |k: usize| {
            let pixels: &[[f32; 4]; 4] =
                self.values[self.columns * (top + k) + left..].first_chunk().expect("four pixels are around");
            let [a, b, c, d] = pixels.map(Vec4::from_array);
            (a * column_weights[0] + b * column_weights[1]) + (c * column_weights[2] + d * column_weights[3])
        };
        (row(0) * row_weights[0] + row(1) * row_weights[1]) + (row(2) * row_weights[2] + row(3) * row_weights[3])
    }
}

/// The coordinates on the plane (its columns, or its rows) of [`TOGETHER`] pixels of the picture.
#[derive(Default)]
struct PlaneCoordinates {
    /// For each pixel: the plane's column (or row) at or before it.
    pixel: [i32; TOGETHER],
    /// For each pixel: its distance past that column (or row), 0 to 1.
    fraction: [f32; TOGETHER],
    /// For each pixel: the weights of the spline's four coefficients.
    weights: [[f32; TOGETHER]; 4],
}

impl PlaneCoordinates {
    /// Sets the coordinates to `first`, `first + step`, `first + 2 step` and so on, with their weights.
    #[inline(always)]
    fn set(&mut self, step: f64, first: f64) {
        for i in 0..TOGETHER {
            let at = first + i as f64 * step;
            let floor = at.floor();
            (self.pixel[i], self.fraction[i]) = (floor as i32, (at - floor) as f32);
        }
        let [a, b, c, d] = &mut self.weights;
        for i in 0..TOGETHER {
            [a[i], b[i], c[i], d[i]] = spline_weights(self.fraction[i]);
        }
    }
}
