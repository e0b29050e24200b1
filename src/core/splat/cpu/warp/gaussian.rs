//! The low-pass where voxels are smaller than pixels: a Gaussian over the spline's coefficients.
//!
//! In: the plane's coefficients, and variances. Out: rows of the picture.

use std::f64::consts::LOG2_E;

use fearless_simd::f32x4;
use fearless_simd::prelude::*;

use super::plane::{Plane, PlanePoints, TOGETHER};
use super::spline::{GAIN, in_range};
use crate::splat::arith::{at_least, at_most, exp2_neg};

/// The Gaussian of a low-pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Variances {
    /// Of the low-pass, in square pixels of the picture.
    pub(super) low_pass: f64,
    /// Of the spline, along columns and along rows of the plane, in its square pixels.
    pub(super) spline: [f64; 2],
}

/// Computes a row of the picture: around each pixel, the mean of the plane's spline under a Gaussian. The row is empty before.
#[inline(always)]
pub(super) fn blur<S: Simd, const TAPS: usize>(
    simd: S,
    from: &Plane,
    map: &[[f64; 3]; 3],
    variances: Variances,
    most: f32,
    y: f64,
    row: &mut [[f32; 4]],
) {
    let mut gaussian = Gaussian::new(variances.on_plane(map, [0.0, y]));
    let is_perspective = map[2][0] != 0.0 || map[2][1] != 0.0;
    let line = map.map(|[a, b, c]| [a, b * y + c]);
    let columns = from.columns_seen(line, row.len());
    for first in columns.clone().step_by(TOGETHER) {
        let lines = line.map(|[step, start]| [step, first as f64 * step + start]);
        let at = PlanePoints::of(simd, lines, from);
        let pixels = &mut row[first..columns.end.min(first + TOGETHER)];
        for (i, pixel) in pixels.iter_mut().enumerate().filter(|(i, _)| at.near >> i & 1 == 1) {
            if is_perspective {
                gaussian = Gaussian::new(variances.on_plane(map, [(first + i) as f64, y]));
            }
            let values = from.values.get((at.pixel[i] as usize).wrapping_sub((TAPS / 2 - 1) * (from.columns + 1))..);
            let fractions = at.fraction.map(|side| side[i]);
            let mean = gaussian.mean::<TAPS>(fractions, values.unwrap_or_default(), from.columns);
            *pixel = in_range(f32x4::simd_from(simd, mean), most);
        }
    }
}

impl Variances {
    /// Returns the covariance of both together on the plane, in its square pixels, around a place of the picture.
    #[inline(always)]
    fn on_plane(&self, map: &[[f64; 3]; 3], [x, y]: [f64; 2]) -> [f64; 3] {
        let [u, v, w] = map.map(|[a, b, c]| a * x + b * y + c);
        let step = |line: [f64; 3], at: f64| [0, 1].map(|k: usize| (line[k] - at / w * map[2][k]) / w);
        // How far a place on the plane moves, along columns and along rows, per column and per row of the picture.
        let [[a, b], [c, d]] = [step(map[0], u), step(map[1], v)];
        let product = |[a, b]: [f64; 2], [c, d]: [f64; 2]| self.low_pass * (a * c + b * d);
        [product([a, b], [a, b]) + self.spline[0], product([a, b], [c, d]), product([c, d], [c, d]) + self.spline[1]]
    }
}

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

    /// Returns the weighted mean, times the square of [`GAIN`], of `TAPS` by `TAPS` of `values`, rows of which are `pitch` apart. The
    /// place is past number `TAPS / 2` of the columns and rows by `fractions`.
    #[inline(always)]
    fn mean<const TAPS: usize>(&self, fractions: [f32; 2], values: &[[f32; 4]], pitch: usize) -> [f32; 4] {
        let [across, both, down] = self.factors;
        // Every so many rows have weights of their own. The others follow from the row before, as the ratios of neighbours do; along
        // more of them, a weight that is rounded to 0 in the first row would be missing in the last.
        let run = 64 / TAPS;
        let first = |fraction: f32| -((TAPS / 2 - 1) as f32) - fraction;
        let power = |x: f32| exp2_neg(at_most(at_least(x, -120.0), 120.0));
        let fall = power(2.0 * down);
        let (mut weights, mut ratios) = ([0.0f32; TAPS], [0.0f32; TAPS]);
        let mut sums = [0.0f32; 16];
        let mut total = [0.0f32; TAPS];
        for (row, values) in values.chunks(pitch).take(TAPS).enumerate() {
            let Some(values): Option<&[[f32; 4]; TAPS]> = values.first_chunk() else { break };
            if row.is_multiple_of(run) {
                let y = row as f32 + first(fractions[1]);
                for column in 0..TAPS {
                    let x = column as f32 + first(fractions[0]);
                    weights[column] = power((across * x + both * y) * x + down * (y * y));
                    ratios[column] = power(both * x + down * (2.0 * y + 1.0));
                }
            }
            for (total, weight) in total.iter_mut().zip(weights) {
                *total += weight;
            }
            for (weights, values) in weights.as_chunks::<4>().0.iter().zip(values.as_chunks::<4>().0) {
                for k in 0..4 {
                    for c in 0..4 {
                        sums[4 * k + c] += weights[k] * values[k][c];
                    }
                }
            }
            for column in 0..TAPS {
                weights[column] *= ratios[column];
                ratios[column] *= fall;
            }
        }
        let total = GAIN * GAIN / total.iter().sum::<f32>();
        [0, 1, 2, 3].map(|c: usize| total * ((sums[c] + sums[4 + c]) + (sums[8 + c] + sums[12 + c])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of `taps` by `taps` values, with each weight computed by itself.
    fn plain_mean(taps: usize, [xx, xy, yy]: [f64; 3], fractions: [f32; 2], values: &[[f32; 4]], pitch: usize) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for row in 0..taps {
            for column in 0..taps {
                let at = |index: usize, fraction: f32| index as f64 - (taps / 2 - 1) as f64 - f64::from(fraction);
                let (x, y) = (at(column, fractions[0]), at(row, fractions[1]));
                let weight = (-0.5 * (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy)).exp();
                sum += weight * f64::from(values[row * pitch + column][2]);
                total += weight;
            }
        }
        sum / total
    }

    #[test]
    fn weights_that_follow_from_those_of_the_row_before_are_the_gaussians() {
        const PITCH: usize = 19;
        let value = |i: usize| (i * 7919 % 1009) as f32 / 1009.0;
        let values: Vec<[f32; 4]> = (0..PITCH * 16).map(|i| [0.0, 1.0, value(i), 0.5]).collect();
        // Narrow, long and thin, slanted both ways, and as wide as they come.
        let narrow = [[0.25, 0.0, 0.25], [0.3, 0.0, 4.3], [4.2, 3.9, 4.2], [2.3, -1.4, 1.2]];
        let wide = [[16.0, -15.7, 16.0], [0.34, 0.2, 15.0], [16.3, 0.0, 0.34], [9.0, 2.0, 7.0]];
        for fractions in [[0.0, 0.0], [0.99, 0.02], [0.4, 0.6], [0.02, 0.99]] {
            for covariance in narrow {
                let mean = Gaussian::new(covariance).mean::<8>(fractions, &values, PITCH);
                let plain = plain_mean(8, covariance, fractions, &values, PITCH) * f64::from(GAIN * GAIN);
                assert!((f64::from(mean[2]) - plain).abs() < 1e-5, "{covariance:?} {fractions:?}: {mean:?}, {plain}");
            }
            for covariance in wide {
                let mean = Gaussian::new(covariance).mean::<16>(fractions, &values, PITCH);
                let plain = plain_mean(16, covariance, fractions, &values, PITCH) * f64::from(GAIN * GAIN);
                assert!((f64::from(mean[2]) - plain).abs() < 1e-5, "{covariance:?} {fractions:?}: {mean:?}, {plain}");
            }
        }
    }
}
