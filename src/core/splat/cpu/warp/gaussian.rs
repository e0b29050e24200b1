//! Gaussians over the plane's pixels: the low-pass where voxels are smaller than pixels.
//!
//! In: the plane, and a covariance on the picture. Out: rows of the picture.

use std::f64::consts::LOG2_E;

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x16, i32x16};

use super::plane::{Plane, PlanePoints, TOGETHER};
use super::spline::{in_range, spline_weights, weighted};
use crate::splat::arith::{at_least, at_most, near_exp2_neg};

/// Computes a row of the picture: the plane's pixels under a Gaussian of this covariance, in square pixels of the picture, around
/// each pixel. The row is empty before.
#[inline(always)]
pub(super) fn blur<S: Simd>(
    simd: S,
    from: &Plane,
    map: &[[f64; 3]; 3],
    covariance: [f64; 3],
    y: f64,
    row: &mut [[f32; 4]],
) {
    let mut gaussian = Gaussian::new(on_plane(map, [0.0, y], covariance));
    let is_perspective = map[2][0] != 0.0 || map[2][1] != 0.0;
    let line = map.map(|[a, b, c]| [a, b * y + c]);
    let columns = from.columns_seen(line, row.len());
    for first in columns.clone().step_by(TOGETHER) {
        let lines = line.map(|[step, start]| [step, first as f64 * step + start]);
        let at = PlanePoints::of(simd, lines, from);
        let pixels = &mut row[first..columns.end.min(first + TOGETHER)];
        for (i, pixel) in pixels.iter_mut().enumerate().filter(|(i, _)| at.near >> i & 1 == 1) {
            if is_perspective {
                gaussian = Gaussian::new(on_plane(map, [(first + i) as f64, y], covariance));
            }
            let values = from.values.get((at.pixel[i] as usize).wrapping_sub((TAPS / 2 - 1) * (from.columns + 1))..);
            let fractions = at.fraction.map(|side| side[i]);
            *pixel = gaussian.mean(fractions, values.unwrap_or_default(), from.columns);
        }
    }
}

/// Computes a row of the picture: the plane under a Gaussian of this covariance, in square pixels of the picture, around each
/// pixel. It is wide along columns (`ALONG` 0) or rows (1) of the plane, where it takes its pixels; along the other axis two points
/// of the spline, one standard deviation away on both sides, stand for it. The row is empty before.
#[inline(always)]
pub(super) fn blur_along<S: Simd, const ALONG: usize>(
    simd: S,
    from: &Plane,
    map: &[[f64; 3]; 3],
    covariance: [f64; 3],
    most: f32,
    y: f64,
    row: &mut [[f32; 4]],
) {
    let line = map.map(|[a, b, c]| [a, b * y + c]);
    let columns = from.columns_seen(line, row.len());
    let rows = from.rows();
    // From the first four of the Gaussian's values to the others.
    let next = if ALONG == 0 { 4 } else { 4 * from.columns };
    let is_perspective = map[2][0] != 0.0 || map[2][1] != 0.0;
    // How far the points are from the middle, and how fast the Gaussian falls along the line through each.
    let (mut away, mut fall) = ([[0.0; TOGETHER]; 2], [0.0; TOGETHER]);
    let mut is_known = false;
    for first in columns.clone().step_by(TOGETHER) {
        let pixels = &mut row[first..columns.end.min(first + TOGETHER)];
        let middle = PlanePoints::of(simd, line.map(|[step, start]| [step, first as f64 * step + start]), from);
        if middle.near == 0 {
            continue;
        }
        for i in (0..TOGETHER).filter(|_| !is_known) {
            let [xx, mixed, yy] = on_plane(map, [(first + i) as f64, y], covariance);
            let (wide, narrow) = if ALONG == 0 { (xx, yy) } else { (yy, xx) };
            let distance = narrow.max(LEAST_NARROW).sqrt();
            let slant = mixed / distance;
            (away[ALONG][i], away[1 - ALONG][i]) = (slant as f32, distance as f32);
            fall[i] = (0.5 * LOG2_E / (wide - slant * slant).max(LEAST_WIDE)) as f32;
        }
        is_known = !is_perspective;
        let mut sums = [f32x4::splat(simd, 0.0); TOGETHER];
        for sign in [-1.0, 1.0] {
            let at = [0, 1].map(|side: usize| middle.fraction[side] + f32x16::from_slice(simd, &away[side]) * sign);
            let whole = at.map(|at| at.floor());
            let past = [at[0] - whole[0], at[1] - whole[1]];
            let start =
                [0, 1].map(|side: usize| (whole[side] - BEFORE[usize::from(side == ALONG)]).to_int::<i32x16<S>>());
            let start = (start[1] * i32x16::splat(simd, from.columns as i32) + start[0]).to_array();
            let (spline, gaussian) = (spline_weights(past[1 - ALONG]), gaussian_weights(past[ALONG].to_array(), fall));
            for (i, sum) in sums.iter_mut().enumerate().take(pixels.len()).filter(|(i, _)| middle.near >> i & 1 == 1) {
                let at = middle.pixel[i].wrapping_add(start[i]) as usize;
                for (half, gaussian) in gaussian.as_chunks().0.iter().enumerate() {
                    let weights = if ALONG == 0 { [gaussian, &spline] } else { [&spline, gaussian] };
                    *sum += weighted(simd, &rows, at.wrapping_add(half * next), weights, i);
                }
            }
        }
        for (i, (pixel, sum)) in pixels.iter_mut().zip(sums).enumerate() {
            if middle.near >> i & 1 == 1 {
                *pixel = in_range(sum * 0.5, most);
            }
        }
    }
}

/// Most pixels of the plane that a point of [`blur_along`] is away from the middle along the axis on which the low-pass is narrow.
pub(in super::super) const MOST_ASIDE: f64 = 2.5;

/// How many values before the one at or before a point a spline takes, and how many a Gaussian.
const BEFORE: [f32; 2] = [1.0, (TAPS / 2 - 1) as f32];
/// The least variance in [`blur_along`] along the narrow axis, by whose root slants are divided; in square pixels of the plane.
const LEAST_NARROW: f64 = 1e-6;
/// The same along the wide axis: weights of a narrower Gaussian would jump from pixel to pixel.
const LEAST_WIDE: f64 = 0.2;

/// Returns the weights of [`TAPS`] values around places that are `past` the middle one of them, 0 to 1; `fall` is by how much the
/// logarithm to base 2 falls at distance 1.
#[inline(always)]
fn gaussian_weights(past: [f32; TOGETHER], fall: [f32; TOGETHER]) -> [[f32; TOGETHER]; TAPS] {
    let (mut weights, mut total) = ([[0.0; TOGETHER]; TAPS], [0.0; TOGETHER]);
    for (k, weights) in weights.iter_mut().enumerate() {
        for i in 0..TOGETHER {
            let distance = k as f32 - BEFORE[1] - past[i];
            weights[i] = near_exp2_neg(at_most(fall[i] * (distance * distance), 120.0));
            total[i] += weights[i];
        }
    }
    for weights in &mut weights {
        for i in 0..TOGETHER {
            weights[i] /= total[i];
        }
    }
    weights
}

/// Returns the covariance on the plane, in its square pixels, of a Gaussian around a place of the picture.
#[inline(always)]
fn on_plane(map: &[[f64; 3]; 3], [x, y]: [f64; 2], [xx, xy, yy]: [f64; 3]) -> [f64; 3] {
    let [u, v, w] = map.map(|[a, b, c]| a * x + b * y + c);
    let step = |line: [f64; 3], at: f64| [0, 1].map(|k: usize| (line[k] - at / w * map[2][k]) / w);
    // How far a place on the plane moves, along columns and along rows, per column and per row of the picture.
    let [[a, b], [c, d]] = [step(map[0], u), step(map[1], v)];
    let product = |[a, b]: [f64; 2], [c, d]: [f64; 2]| a * c * xx + (a * d + b * c) * xy + b * d * yy;
    [product([a, b], [a, b]), product([a, b], [c, d]), product([c, d], [c, d])]
}

/// Pixels of the plane along a side that a Gaussian takes.
pub(super) const TAPS: usize = 8;

/// A Gaussian of the picture, on the plane around one place.
struct Gaussian {
    /// The logarithm to base 2 of the weight falls by the first times the square of the distance along columns, by the
    /// third times that along rows, and by the second times the product of the two distances.
    factors: [f32; 3],
}

impl Gaussian {
    /// `covariance`: in square pixels of the plane.
    fn new([xx, xy, yy]: [f64; 3]) -> Gaussian {
        let scale = 0.5 * LOG2_E / (xx * yy - xy * xy);
        Gaussian { factors: [yy, -2.0 * xy, xx].map(|factor| (scale * factor) as f32) }
    }

    /// Returns the weighted mean of [`TAPS`] by [`TAPS`] of `values`, rows of which are `pitch` apart. The place is past
    /// the fourth column and row by `fractions`.
    #[inline(always)]
    fn mean(&self, fractions: [f32; 2], values: &[[f32; 4]], pitch: usize) -> [f32; 4] {
        let [across, both, down] = self.factors;
        let mut sums = [0.0f32; 16];
        let mut total = [0.0f32; TAPS];
        for (row, values) in values.chunks(pitch).take(TAPS).enumerate() {
            let Some(values): Option<&[[f32; 4]; TAPS]> = values.first_chunk() else { break };
            let y = row as f32 - (TAPS / 2 - 1) as f32 - fractions[1];
            let mut weights = [0.0f32; TAPS];
            for (column, weight) in weights.iter_mut().enumerate() {
                let x = column as f32 - (TAPS / 2 - 1) as f32 - fractions[0];
                *weight = near_exp2_neg(at_most(at_least((across * x + both * y) * x + down * (y * y), 0.0), 120.0));
            }
            for (total, weight) in total.iter_mut().zip(weights) {
                *total += weight;
            }
            for half in [0, TAPS / 2] {
                for k in 0..4 {
                    for c in 0..4 {
                        sums[4 * k + c] += weights[half + k] * values[half + k][c];
                    }
                }
            }
        }
        let total = 1.0 / total.iter().sum::<f32>();
        [0, 1, 2, 3].map(|c: usize| total * ((sums[c] + sums[4 + c]) + (sums[8 + c] + sums[12 + c])))
    }
}
