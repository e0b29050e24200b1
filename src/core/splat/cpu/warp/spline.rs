//! Cubic B-splines through the plane's pixels.
//!
//! In: the plane. Out: the spline's coefficients, in its place; rows of the picture, at points on it.
//!
//! Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993: a recursive filter, then weights.

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x4, f32x16};

use super::covered::Covered;
use super::plane::{Plane, PlanePoints, TOGETHER};
use crate::parallel::in_parts;
use crate::splat::arith::at_most;

/// The pole of the cubic B-spline's recursive filter: sqrt(3) - 2.
const POLE: f32 = -0.267_949_2;
/// A factor of -6 times [`POLE`]. The two passes of the filter leave it out, and [`spline_weights`] include it instead.
pub(super) const GAIN: f32 = 6.0 * 0.267_949_2;

/// Returns the weights, times [`GAIN`], of four neighbouring coefficients at points `t` (0 to 1) past the second one.
#[inline(always)]
fn spline_weights<S: Simd>(t: f32x16<S>) -> [[f32; TOGETHER]; 4] {
    let s = 1.0 - t;
    let [a, d] = [s * s * s * (GAIN / 6.0), t * t * t * (GAIN / 6.0)];
    let [b, c] = [2.0 / 3.0 - t * t * (2.0 - t) / 2.0, 2.0 / 3.0 - s * s * (2.0 - s) / 2.0];
    [a.to_array(), (b * GAIN).to_array(), (c * GAIN).to_array(), d.to_array()]
}

/// How many rows the filter takes at once: two full vectors, which hides that each pixel waits for the one before.
const ROWS: usize = 8;

/// Applies the recursive filter to rows of `len` numbers, to the right and back, where they are covered. With
/// [`filter_columns`] it turns samples into the coefficients of the B-spline through them, divided by the square of
/// [`GAIN`].
pub(super) fn filter_rows(rows: &mut [f32], len: usize, covered: &Covered, instructions: Level, threads: usize) {
    // Whole groups, as the rows of a group are filtered over the columns of all of them: each thread's first row must begin one.
    in_parts(rows, ROWS * len, threads, |from, rows| {
        for (group, rows) in (from..).zip(rows.chunks_mut(ROWS * len)) {
            let first = ROWS * group;
            let columns = covered.columns_of(first..first + rows.len() / len);
            let lines = rows.chunks_exact_mut(len).map(|row| &mut row.as_chunks_mut().0[columns.clone()]);
            let mut lines: Vec<&mut [[f32; 4]]> = lines.collect();
            dispatch!(instructions, _ => match lines.as_chunks_mut::<ROWS>().0 {
                [lines] => filter_lines(lines),
                _ => lines.as_chunks_mut::<1>().0.iter_mut().for_each(filter_lines),
            });
        }
    });
}

/// Filters lines of one length, to the right and back.
#[inline(always)]
fn filter_lines<const N: usize>(lines: &mut [&mut [[f32; 4]]; N]) {
    let pixels = lines.iter().map(|line| line.len()).min().unwrap_or(0);
    filter_along(lines, 0..pixels);
    filter_along(lines, (0..pixels).rev());
}

#[inline(always)]
fn filter_along<const N: usize>(lines: &mut [&mut [[f32; 4]]; N], pixels: impl Iterator<Item = usize>) {
    let mut before = [[0.0; 4]; N];
    for i in pixels {
        before = next(lines.each_ref().map(|line| line[i]), before);
        lines.iter_mut().zip(before).for_each(|(line, value)| line[i] = value);
    }
}

/// Returns the filter's values at some pixels, from the pixels and the values before.
#[inline(always)]
fn next<const N: usize>(pixels: [[f32; 4]; N], before: [[f32; 4]; N]) -> [[f32; 4]; N] {
    let mut values = [[0.0; 4]; N];
    for i in 0..N {
        for c in 0..4 {
            values[i][c] = pixels[i][c] + POLE * normal(before[i][c]);
        }
    }
    values
}

/// Returns 0 for what has decayed: over empty pixels the filter would go on with denormal numbers, which are slow.
#[inline(always)]
fn normal(value: f32) -> f32 {
    if value.abs() < 1e-20 { 0.0 } else { value }
}

/// Applies the recursive filter to columns, downward and back; see [`filter_rows`].
pub(super) fn filter_columns(rows: &mut [f32], len: usize, covered: &Covered, instructions: Level, threads: usize) {
    /// Columns of a strip: strips of many rows stay in the second-level cache.
    const STRIP: usize = 32;
    let ranges = (0..len / 4).step_by(STRIP).map(|first| covered.rows_of(first..first + STRIP));
    let mut strips: Vec<_> = ranges.map(|rows| (rows, Vec::new())).collect();
    for (index, row) in rows.chunks_exact_mut(len).enumerate() {
        for ((rows, strip), part) in strips.iter_mut().zip(row.chunks_mut(4 * STRIP)) {
            if rows.contains(&index) {
                strip.push(part);
            }
        }
    }
    in_parts(&mut strips, 1, threads, |_, strips| {
        strips.iter_mut().for_each(|(_, strip)| dispatch!(instructions, _ => filter_strip(strip)));
    });
}

#[inline(always)]
fn filter_strip(strip: &mut [&mut [f32]]) {
    for row in 1..strip.len() {
        let (above, below) = strip.split_at_mut(row);
        follow(below[0], above[row - 1]);
    }
    for row in (1..strip.len()).rev() {
        let (above, below) = strip.split_at_mut(row);
        follow(above[row - 1], below[0]);
    }
}

#[inline(always)]
fn follow(row: &mut [f32], before: &[f32]) {
    for (value, before) in row.iter_mut().zip(before) {
        *value += POLE * normal(*before);
    }
}

/// Computes a row of the picture: the plane's spline at each pixel. The row is empty before.
#[inline(always)]
pub(super) fn resample<S: Simd>(simd: S, from: &Plane, map: &[[f64; 3]; 3], most: f32, y: f64, row: &mut [[f32; 4]]) {
    let line = map.map(|[a, b, c]| [a, b * y + c]);
    let columns = from.columns_seen(line, row.len());
    let rows = from.rows();
    for first in columns.clone().step_by(TOGETHER) {
        let at = PlanePoints::of(simd, line.map(|[step, start]| [step, first as f64 * step + start]), from);
        if at.near == 0 {
            continue;
        }
        let [across, down] = at.fraction.map(spline_weights);
        let pixels = &mut row[first..columns.end.min(first + TOGETHER)];
        for (i, pixel) in pixels.iter_mut().enumerate().filter(|(i, _)| at.near >> i & 1 == 1) {
            let first = (at.pixel[i] as usize).wrapping_sub(from.columns + 1);
            *pixel = in_range(weighted(simd, &rows, first, [&across, &down], i), most);
        }
    }
}

/// Returns the sum of four columns and rows of values, from index `first` on, times weights number `i` of each column and row.
#[inline(always)]
fn weighted<S: Simd>(
    simd: S,
    rows: &[&[[f32; 4]]; 4],
    first: usize,
    [across, down]: [&[[f32; TOGETHER]; 4]; 2],
    i: usize,
) -> f32x4<S> {
    // Sums down the columns first: all four columns and colours together fill a vector.
    let mut sums = f32x16::splat(simd, 0.0);
    for k in 0..4 {
        let Some(values): Option<&[[f32; 4]; 4]> = rows[k].get(first..).and_then(<[_]>::first_chunk) else { break };
        sums += f32x16::from_slice(simd, values.as_flattened()) * down[k][i];
    }
    let (left, right) = sums.split();
    let ((a, b), (c, d)) = (left.split(), right.split());
    (a * across[0][i] + b * across[1][i]) + (c * across[2][i] + d * across[3][i])
}

/// Limits a pixel to what interpolation may not leave: alpha to 0 to `largest`, and colours to 0 and above, 0 where alpha is 0.
#[inline(always)]
pub(super) fn in_range<S: Simd>(pixel: f32x4<S>, largest: f32) -> [f32; 4] {
    let pixel = pixel.max(0.0);
    let most = BRIGHTEST * at_most(pixel[3], largest);
    pixel.min(f32x4::simd_from(pixel.simd, [most, most, most, largest])).to_array()
}

/// The brightest colour of a voxel: white in full light with the strongest highlight.
const BRIGHTEST: f32 = 2.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::Frame;

    /// Groups of rows began at each thread's first row, so the columns over which a row was filtered depended on the threads.
    #[test]
    fn any_number_of_threads_filters_rows_to_the_same_bits() {
        const SIDES: [u32; 2] = [160, 516];
        let filtered = |threads: usize| {
            let mut plane = Frame::transparent(SIDES).unwrap();
            for (i, pixel) in plane.pixels_mut().as_chunks_mut::<4>().0.iter_mut().enumerate() {
                let [x, y] = [i % 160, i / 160].map(|at| at as f32);
                if (4.0 * (x - 80.0)).hypot(y - 258.0) < 250.0 {
                    *pixel = [0.2, 0.4, 0.6, 0.8];
                }
            }
            let covered = Covered::of(&plane, 1, threads).unwrap();
            filter_rows(plane.pixels_mut(), 4 * 160, &covered, Level::new(), threads);
            plane
        };
        let by_one = filtered(1);
        for threads in [2, 3, 4, 7] {
            assert!(filtered(threads).pixels() == by_one.pixels(), "{threads} threads");
        }
    }
}
