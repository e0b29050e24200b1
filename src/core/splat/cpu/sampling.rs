//! Sampling: wide footprints need fewer pixels than the picture has.
//!
//! In: a view whose narrowest footprint is wide. Out: the same view with fewer, larger pixels to draw, and from what is
//! drawn there the picture, by cubic B-spline interpolation. A picture of Gaussian footprints has hardly any detail
//! finer than a footprint: with a standard deviation of [`ENOUGH`] pixels a footprint's frequencies fall to 1 % of its
//! mean at half the sampling rate. What does have finer detail are the edges of what is opaque: where a splat's depth at
//! its centre is p > 1, `1 - exp(-p exp(-r^2 / 2 sigma^2))` rises within sigma / sqrt(2 ln p), and that width counts.
//! Measured beside every pixel drawn: docs/studies/sampling.md.
//!
//! ```text
//! view -> fewer pixels, with a margin -> draw -> coefficients (a recursive filter) -> columns -> rows -> picture
//! ```
//!
//! Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993: interpolation by a recursive filter, then the
//! B-spline's weights.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "places are inside pictures of 16,384 pixels a side; weights are single precision"
)]

use std::f64::consts::TAU;

use glam::Vec4;
use multiversion::multiversion;

use super::project::jacobian;
use crate::error::Result;
use crate::splat::finer::width_in_the_middle;
use crate::splat::frame::in_range;
use crate::splat::kernel::narrowest;
use crate::splat::view::{PixelMap, View};
use crate::splat::{Blending, Frame, Sampling, Settings};
use crate::traverse::VoxelBox;

/// Standard deviation, in pixels, of the narrowest footprint of a coarse view: at 0.97 footprints of the standard kernel
/// are 6.5 pixels wide, and what is left out is 45 dB below the picture or more.
const ENOUGH: f64 = 0.97;
/// The same where 32 dB below the picture are enough: measured at 37 dB and more; with 0.5, at 30.
const FEWEST: f64 = 0.62;
/// Views whose pixels would not become fewer than by this factor a side are drawn as they are.
const WORTH_IT: f64 = 0.8;
/// Pixels around a coarse picture, so that its edge is interpolated like the rest: what is beyond has less than
/// 0.268^5 of a say.
const MARGIN: u32 = 6;
/// Pictures with a shorter side are drawn as they are.
const SMALL: u32 = 64;

/// A coarse view of the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Coarse {
    /// Coarse pixels per pixel, along a side; below 1.
    factor: f64,
    /// Columns and rows of the picture.
    size: [u32; 2],
}

impl Coarse {
    /// The coarse view that is enough for the voxels in `bounds`, whose optical depth per mean voxel is `deepest` at
    /// most; `None` if every pixel is needed, or if splats are put together in another way than the edges of what is opaque are
    /// computed for.
    pub(super) fn of(view: &View, bounds: &VoxelBox, deepest: f64, settings: &Settings) -> Option<Coarse> {
        if settings.keeps_pixels() || settings.blending != Blending::Exponential {
            return None;
        }
        let kernel = settings.kernel();
        let enough = match settings.sampling() {
            Sampling::EveryPixel | Sampling::Finer => return None,
            Sampling::Enough => ENOUGH,
            Sampling::Fewest => FEWEST,
        };
        if view.size.into_iter().any(|side| side < SMALL) {
            return None;
        }
        let single = |map: &[f64; 4]| [map[0] as f32, map[1] as f32, map[2] as f32];
        let sigma = match &view.map {
            PixelMap::Parallel { pixel_from_voxel, .. } => {
                narrowest(pixel_from_voxel.map(|map| single(&map)), kernel.sigma)
            }
            PixelMap::Perspective { camera_from_voxel, focal, near, .. } => {
                // The farthest voxels have the narrowest footprints, and the farthest one is a corner.
                let corners = (0..8).map(|corner: u32| {
                    let at: [f64; 3] = std::array::from_fn(|a| {
                        f64::from(if corner >> a & 1 == 0 { bounds.low[a] } else { bounds.high[a] })
                    });
                    let [t0, t1, t2] = camera_from_voxel.map(|m| m[0] * at[0] + m[1] * at[1] + m[2] * at[2] + m[3]);
                    let t2 = t2.max(*near);
                    let rows = jacobian(
                        &camera_from_voxel.map(|map| single(&map)),
                        (t0 / t2) as f32,
                        (t1 / t2) as f32,
                        (focal / t2) as f32,
                    );
                    narrowest(rows, kernel.sigma)
                });
                corners.fold(f32::INFINITY, f32::min)
            }
        };
        // Drafts let the farthest voxels have half of what those in the middle need.
        let sigma = match (settings.sampling(), &view.map) {
            (Sampling::Fewest, PixelMap::Perspective { .. }) => {
                width_in_the_middle(view, bounds, settings).min(2.0 * sigma).max(sigma)
            }
            _ => sigma,
        };
        let peak = deepest / (TAU * f64::from(kernel.sigma).powi(2));
        let sharpness = (2.0 * peak.max(1.0).ln()).sqrt().max(1.0);
        let factor = enough * sharpness / f64::from(sigma);
        // Not so coarse that a picture is all margin; and a footprint that is not finite says nothing.
        let factor = factor.max(1.0 / 16.0);
        (factor <= WORTH_IT).then_some(Coarse { factor, size: view.size })
    }

    /// `view` with fewer pixels.
    pub(super) fn view(&self, view: &View) -> View {
        let side = |pixels: u32| (f64::from(pixels) * self.factor).ceil() as u32 + 2 * MARGIN;
        view.with_pixels(self.factor, self.size.map(side), f64::from(MARGIN))
    }

    /// The picture, from the frame of the coarse view.
    ///
    /// O(pixels). The result does not depend on `threads`.
    ///
    /// # Errors
    /// If memory cannot be had.
    pub(super) fn enlarge(&self, mut coarse: Frame, threads: usize) -> Result<Frame> {
        let [columns, rows] = coarse.size().map(|side| side as usize);
        let mask = covered(&coarse);
        columns_to_coefficients(coarse.pixels_mut(), 4 * columns);
        let places = self.places(self.size[0], columns);
        let width = self.size[0] as usize;
        let mut wide = Frame::transparent([self.size[0], coarse.size()[1]])?;
        wide.in_shares(threads, |first, wide| {
            for (row, out) in (first..).zip(wide.chunks_exact_mut(4 * width)) {
                let mut line: Vec<[f32; 4]> =
                    coarse.pixels()[4 * columns * row..][..4 * columns].as_chunks().0.to_vec();
                to_coefficients(&mut line);
                for (pixel, place) in out.as_chunks_mut::<4>().0.iter_mut().zip(&places) {
                    let taps: &[[f32; 4]; 4] = line[place.first..].first_chunk().expect("four taps inside the margin");
                    *pixel = std::array::from_fn(|c| (0..4).map(|k| place.weights[k] * taps[k][c]).sum());
                }
            }
        });
        drop(coarse);
        let mut picture = Frame::transparent(self.size)?;
        let across: Vec<usize> = places.iter().map(|place| place.nearest).collect();
        let places = self.places(self.size[1], rows);
        let wide = wide.pixels();
        picture.in_shares(threads, |first, out| {
            for (row, place) in out.chunks_exact_mut(4 * width).zip(&places[first..]) {
                let tap = |k: usize| &wide[4 * width * (place.first + k)..][..4 * width];
                blend([tap(0), tap(1), tap(2), tap(3)], place.weights, row);
                let mask = &mask[columns * place.nearest..][..columns];
                for (pixel, &column) in row.as_chunks_mut::<4>().0.iter_mut().zip(&across) {
                    // Nothing is where nothing was drawn near.
                    let here = if mask[column] { 1.0 } else { 0.0 };
                    *pixel = in_range(here * Vec4::from_array(*pixel));
                }
            }
        });
        Ok(picture)
    }

    /// Where each of `count` columns (or rows) lies among `coarse` ones.
    fn places(&self, count: u32, coarse: usize) -> Vec<Place> {
        let place = |index: u32| {
            let at = (f64::from(index) + 0.5) * self.factor - 0.5 + f64::from(MARGIN);
            let first = (at.floor() as usize).saturating_sub(1).min(coarse - 4);
            let weights = spline((at - at.floor()) as f32);
            Place { first, nearest: (at.round() as usize).min(coarse - 1), weights }
        };
        (0..count).map(place).collect()
    }
}

/// Where a pixel lies among coarse ones, along a side.
struct Place {
    /// First of its four taps.
    first: usize,
    nearest: usize,
    weights: [f32; 4],
}

/// Whether one of the nine pixels around each is not empty.
pub(super) fn covered(frame: &Frame) -> Vec<bool> {
    let [columns, rows] = frame.size().map(|side| side as usize);
    let drawn: Vec<bool> = frame.pixels().chunks_exact(4).map(|pixel| pixel[3] > 0.0).collect();
    let mut beside = vec![false; drawn.len()];
    for (row, out) in drawn.chunks_exact(columns).zip(beside.chunks_exact_mut(columns)) {
        for column in 0..columns {
            out[column] = row[column.saturating_sub(1)..columns.min(column + 2)].contains(&true);
        }
    }
    let mut covered = vec![false; drawn.len()];
    for row in 0..rows {
        for near in row.saturating_sub(1)..rows.min(row + 2) {
            let near = &beside[columns * near..][..columns];
            let out = &mut covered[columns * row..][..columns];
            out.iter_mut().zip(near).for_each(|(out, near)| *out |= near);
        }
    }
    covered
}

/// The pole of the cubic B-spline's recursive filter: the square root of 3, less 2.
const POLE: f32 = -0.267_949_2;
/// What both directions of the filter leave to be multiplied by: -6 times the pole. It is in the weights.
const GAIN: f32 = 6.0 * 0.267_949_2;

/// Weights of the four coefficients around a place `t` past the second, 0 to 1; with [`GAIN`].
#[inline(always)]
pub(super) fn spline(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        GAIN / 6.0 * (s * s * s),
        GAIN * (2.0 / 3.0 - t * t * (2.0 - t) / 2.0),
        GAIN * (2.0 / 3.0 - s * s * (2.0 - s) / 2.0),
        GAIN / 6.0 * (t * t * t),
    ]
}

/// Samples of a line to coefficients whose B-spline goes through them, but for [`GAIN`]; beyond its ends a line goes on
/// as it ends.
pub(super) fn to_coefficients(line: &mut [[f32; 4]]) {
    filter(line.iter_mut());
    filter(line.iter_mut().rev());
}

/// One direction of the filter.
fn filter<'a>(mut line: impl Iterator<Item = &'a mut [f32; 4]>) {
    let Some(first) = line.next() else { return };
    *first = first.map(|value| value / (1.0 - POLE));
    let mut before = *first;
    for pixel in line {
        before = std::array::from_fn(|c| pixel[c] + POLE * before[c]);
        *pixel = before;
    }
}

/// The same of all columns, of rows of `len` numbers.
pub(super) fn columns_to_coefficients(rows: &mut [f32], len: usize) {
    let count = rows.len() / len;
    let edge = |row: &mut [f32]| row.iter_mut().for_each(|value| *value /= 1.0 - POLE);
    let step = |row: &mut [f32], before: &[f32]| row.iter_mut().zip(before).for_each(|(v, b)| *v += POLE * b);
    edge(&mut rows[..len]);
    for row in 1..count {
        let (before, rest) = rows.split_at_mut(len * row);
        step(&mut rest[..len], &before[len * (row - 1)..]);
    }
    edge(&mut rows[len * (count - 1)..]);
    for row in (0..count - 1).rev() {
        let (rest, before) = rows.split_at_mut(len * (row + 1));
        step(&mut rest[len * row..], &before[..len]);
    }
}

/// The sum of four rows by their weights.
#[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
fn blend(taps: [&[f32]; 4], weights: [f32; 4], out: &mut [f32]) {
    let [a, b, c, d] = taps.map(|tap| &tap[..out.len()]);
    for i in 0..out.len() {
        out[i] = (weights[0] * a[i] + weights[1] * b[i]) + (weights[2] * c[i] + weights[3] * d[i]);
    }
}
