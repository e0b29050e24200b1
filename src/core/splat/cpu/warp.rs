//! The warp: from the lattice's pixels to the picture, by cubic B-splines.
//!
//! In: the frame drawn on a [`Lattice`]. Out: the picture.
//!
//! ```text
//! plane -> coefficients of the spline (a recursive filter along rows, then columns) -> homography -> picture
//! ```
//!
//! Where voxels are smaller than pixels, a Gaussian is the low-pass. If it is narrow, four points of the spline around
//! each pixel of the picture stand for it. If not, it takes the plane's pixels themselves, and no spline is needed; where
//! voxels are much smaller, the plane is halved first: the mean of two by two pixels becomes one.
//!
//! Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993: a recursive filter, then weights.

use std::ops::Range;

use multiversion::multiversion;

use super::lattice::{Lattice, LowPass};
use crate::error::Result;
use crate::parallel::in_parts;
use crate::splat::Frame;
use crate::splat::arith::{at_least, at_most, near_exp2_neg};

/// Smallest standard deviation of a blur that is done, in pixels. A smaller one changes no value by more than 0.001.
const MIN_BLUR: f64 = 0.03;
/// How many pixels of a row are computed together.
const TOGETHER: usize = 16;
/// The pole of the cubic B-spline's recursive filter: sqrt(3) - 2.
const POLE: f32 = -0.267_949_2;
/// A factor of -6 times [`POLE`]. The two passes of the filter leave it out, and [`spline_weights`] include it instead.
const GAIN: f32 = 6.0 * 0.267_949_2;

/// Computes the picture from `plane`, the frame drawn on `lattice`, whose alphas are at most `most`. The result does not
/// depend on `threads`.
pub(super) fn warp(lattice: &Lattice, mut plane: Frame, most: f32, threads: usize) -> Result<Frame> {
    let LowPass { halvings, variance, is_wide } = lattice.low_pass;
    let mut plane_from_pixel = lattice.plane_from_pixel;
    for _ in 0..halvings {
        plane = halved(&plane, threads)?;
        let [across, down, divisor] = plane_from_pixel;
        // Pixel 0 of the halved plane lies between pixels 0 and 1.
        let halve = |line: [f64; 3]| [0, 1, 2].map(|k: usize| 0.5 * (line[k] - 0.5 * divisor[k]));
        plane_from_pixel = [halve(across), halve(down), divisor];
    }
    let mut picture = Frame::transparent(lattice.picture)?;
    let [columns, rows] = plane.size().map(|side| side as usize);
    // How many of the plane's pixels, from a place on, matter for it on each side.
    let around = if is_wide { TAPS / 2 } else { 2 };
    let Some(covered) = Covered::of(&plane, if is_wide { around } else { 1 }, threads) else { return Ok(picture) };
    let inner = |range: &Range<usize>, end: usize| {
        [range.start.max(around - 1) as f64, range.end.min(end - around) as f64 - 0.001]
    };
    let within = [inner(&covered.columns, columns), inner(&covered.rows, rows)];
    if is_wide {
        let samples = Plane { values: plane.pixels().as_chunks().0, covered: &covered.near, columns, within };
        picture.fill_rows(threads, |y, row| blur(&samples, &plane_from_pixel, variance, y as f64, row));
        return Ok(picture);
    }
    let len = 4 * columns;
    let drawn = &mut plane.pixels_mut()[len * covered.rows.start..len * covered.rows.end];
    filter_rows(drawn, len, covered.columns.clone(), threads);
    filter_columns(drawn, len, covered.columns, threads);
    // The mean of four points, each one standard deviation from the pixel in x and in y, blurs with that variance.
    let distance = variance.sqrt();
    let corners = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].map(|point| point.map(|c| c * distance));
    let points = if distance < MIN_BLUR { &[[0.0; 2]][..] } else { &corners };
    let coefficients = Plane { values: plane.pixels().as_chunks().0, covered: &covered.near, columns, within };
    picture.fill_rows(threads, |y, row| resample(&coefficients, &plane_from_pixel, points, most, y as f64, row));
    Ok(picture)
}

/// Returns the plane whose pixels are the means of two by two pixels; beyond the edges, pixels are 0.
fn halved(plane: &Frame, threads: usize) -> Result<Frame> {
    let columns = plane.size()[0] as usize;
    let mut halved = Frame::transparent(plane.size().map(|side| side.div_ceil(2)))?;
    let rows: Vec<&[[f32; 4]]> = plane.pixels().as_chunks().0.chunks_exact(columns).collect();
    halved.fill_rows(threads, |y, row| {
        for line in rows.iter().skip(2 * y).take(2) {
            for (pixel, pair) in row.iter_mut().zip(line.chunks(2)) {
                for part in pair {
                    for c in 0..4 {
                        pixel[c] += 0.25 * part[c];
                    }
                }
            }
        }
    });
    Ok(halved)
}

/// Which pixels of a plane something was drawn on.
struct Covered {
    /// The rows and columns of these pixels, and of those around them that the filter changes.
    rows: Range<usize>,
    columns: Range<usize>,
    /// For each pixel of the plane: whether something was drawn on it or on a pixel near it.
    near: Vec<bool>,
}

impl Covered {
    /// `None` if nothing was drawn. `reach`: how many columns and rows away pixels are near.
    fn of(plane: &Frame, reach: usize, threads: usize) -> Option<Covered> {
        /// How far the filter carries values, in pixels: 0.268^16 is 7e-10.
        const CARRIED: usize = 16;
        let [columns, rows] = plane.size().map(|side| side as usize);
        let mut drawn = vec![false; columns * rows];
        in_parts(&mut drawn, columns, threads, |from, drawn| {
            for (drawn, pixel) in drawn.iter_mut().zip(&plane.pixels().as_chunks::<4>().0[columns * from..]) {
                *drawn = pixel[3] > 0.0;
            }
        });
        let lines: Vec<&[bool]> = drawn.chunks_exact(columns).collect();
        let top = lines.iter().position(|line| line.contains(&true))?;
        let bottom = lines.iter().rposition(|line| line.contains(&true))?;
        let (mut left, mut right) = (columns, 0);
        for line in &lines[top..=bottom] {
            left = line[..left].iter().position(|drawn| *drawn).unwrap_or(left);
            right = line[right..].iter().rposition(|drawn| *drawn).map_or(right, |last| right + last);
        }
        let mut near = vec![false; columns * rows];
        in_parts(&mut near, columns, threads, |from, near| {
            for (row, near) in (from..).zip(near.chunks_exact_mut(columns)) {
                for line in &lines[row.saturating_sub(reach)..rows.min(row + reach + 1)] {
                    near.iter_mut().zip(*line).for_each(|(near, drawn)| *near |= drawn);
                }
                for _ in 0..reach {
                    for column in 1..columns {
                        near[column - 1] |= near[column];
                    }
                    for column in (1..columns).rev() {
                        near[column] |= near[column - 1];
                    }
                }
            }
        });
        let carried = |from: usize, to: usize, end: usize| from.saturating_sub(CARRIED)..(to + CARRIED + 1).min(end);
        Some(Covered { rows: carried(top, bottom, rows), columns: carried(left, right, columns), near })
    }
}

/// Returns the weights, times [`GAIN`], of four neighbouring coefficients at a point `t` (0 to 1) past the second one.
#[inline(always)]
fn spline_weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        GAIN / 6.0 * (s * s * s),
        GAIN * (2.0 / 3.0 - t * t * (2.0 - t) / 2.0),
        GAIN * (2.0 / 3.0 - s * s * (2.0 - s) / 2.0),
        GAIN / 6.0 * (t * t * t),
    ]
}

/// How many rows the filter takes at once: a full vector, which hides that each pixel waits for the one before.
const ROWS: usize = 4;

/// Applies the recursive filter to rows of `len` numbers, to the right and back, within a range of columns. With
/// [`filter_columns`] it turns samples into the coefficients of the B-spline through them, divided by the square of
/// [`GAIN`]. Beyond the range, samples are 0.
fn filter_rows(rows: &mut [f32], len: usize, columns: Range<usize>, threads: usize) {
    in_parts(rows, len, threads, |_, rows| {
        rows.chunks_mut(ROWS * len).for_each(|rows| filter_row_group(rows, len, columns.clone()));
    });
}

/// Filters up to [`ROWS`] rows.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn filter_row_group(rows: &mut [f32], len: usize, columns: Range<usize>) {
    let mut lines = rows.chunks_exact_mut(len).map(|row| &mut row.as_chunks_mut().0[columns.clone()]);
    match [lines.next(), lines.next(), lines.next(), lines.next()] {
        [Some(a), Some(b), Some(c), Some(d)] => filter_lines([a, b, c, d]),
        fewer => fewer.into_iter().flatten().for_each(|line| filter_lines([line])),
    }
}

/// Filters lines of one length, to the right and back.
#[inline(always)]
fn filter_lines<const N: usize>(mut lines: [&mut [[f32; 4]]; N]) {
    let pixels = lines.iter().map(|line| line.len()).min().unwrap_or(0);
    filter_along(&mut lines, 0..pixels);
    filter_along(&mut lines, (0..pixels).rev());
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
            values[i][c] = normal(pixels[i][c] + POLE * before[i][c]);
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
fn filter_columns(rows: &mut [f32], len: usize, columns: Range<usize>, threads: usize) {
    /// Numbers of a strip's row: strips of many rows stay in the second-level cache.
    const STRIP: usize = 128;
    let mut strips: Vec<Vec<&mut [f32]>> = Vec::new();
    for row in rows.chunks_exact_mut(len) {
        for (index, part) in row[4 * columns.start..4 * columns.end].chunks_mut(STRIP).enumerate() {
            if strips.len() == index {
                strips.push(Vec::new());
            }
            strips[index].push(part);
        }
    }
    in_parts(&mut strips, 1, threads, |_, strips| strips.iter_mut().for_each(|strip| filter_strip(strip)));
}

#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
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
        *value = normal(*value + POLE * before);
    }
}

/// A plane's pixels, or the coefficients of the B-spline through them.
struct Plane<'a> {
    values: &'a [[f32; 4]],
    /// For each pixel: whether something was drawn near it.
    covered: &'a [bool],
    /// Number of columns of the plane.
    columns: usize,
    /// First and last column, and first and last row, between which there are such pixels.
    within: [[f64; 2]; 2],
}

/// Computes a row of the picture: the mean of the plane's spline at `points` around each pixel. The row is empty before.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn resample(from: &Plane, map: &[[f64; 3]; 3], points: &[[f64; 2]], most: f32, y: f64, row: &mut [[f32; 4]]) {
    let weight = 1.0 / points.len() as f32;
    let mut at = PlanePoints::default();
    for (first, pixels) in (0u32..).step_by(TOGETHER).zip(row.chunks_mut(TOGETHER)) {
        for [dx, dy] in points {
            let lines = map.map(|[a, b, c]| [a, (f64::from(first) + dx) * a + (b * (y + dy) + c)]);
            if at.set(lines, &from.within) {
                from.add(&at, pixels);
            }
        }
        for pixel in pixels {
            *pixel = in_range(*pixel, weight, most);
        }
    }
}

/// Returns a pixel's sums times `weight`, limited to what interpolation may not leave: alpha to 0 to `largest`, and colours to 0
/// and above, 0 where alpha is 0.
#[inline(always)]
fn in_range(sums: [f32; 4], weight: f32, largest: f32) -> [f32; 4] {
    let most = BRIGHTEST * at_most(at_least(sums[3] * weight, 0.0), largest);
    let most = [most, most, most, largest];
    let mut pixel = [0.0; 4];
    for c in 0..4 {
        pixel[c] = at_most(at_least(sums[c] * weight, 0.0), most[c]);
    }
    pixel
}

/// The brightest colour of a voxel: white in full light with the strongest highlight.
const BRIGHTEST: f32 = 2.0;

impl Plane<'_> {
    /// Adds the values of the spline at some points to the pixels.
    #[inline(always)]
    fn add(&self, at: &PlanePoints, pixels: &mut [[f32; 4]]) {
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let [left, top] = [at.pixel[0][i] as usize, at.pixel[1][i] as usize];
            let [right, below] = [0, 1].map(|side: usize| usize::from(at.fraction[side][i] >= 0.5));
            if !at.inside[i] || !self.covered[self.columns * (top + below) + left + right] {
                continue;
            }
            // Sums down the columns first: all four columns and colours together fill a vector.
            let rows = &self.values[self.columns * (top - 1) + left - 1..][..3 * self.columns + 4];
            let mut sums = [0.0f32; 16];
            for k in 0..4 {
                let values: &[[f32; 4]; 4] = rows[self.columns * k..].first_chunk().expect("four pixels are around");
                let weight = at.weights[1][k][i];
                for (sum, value) in sums.iter_mut().zip(values.as_flattened()) {
                    *sum += weight * value;
                }
            }
            let [a, b, c, d] = [0, 1, 2, 3].map(|k: usize| at.weights[0][k][i]);
            for i in 0..4 {
                pixel[i] += (sums[i] * a + sums[4 + i] * b) + (sums[8 + i] * c + sums[12 + i] * d);
            }
        }
    }
}

/// Computes a row of the picture: the plane's pixels under a Gaussian of variance `variance`, in square pixels of the
/// picture, around each pixel. The row is empty before.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn blur(from: &Plane, map: &[[f64; 3]; 3], variance: f64, y: f64, row: &mut [[f32; 4]]) {
    let mut at = PlanePoints::default();
    let mut gaussian = Gaussian::new(map, [0.0, y], variance);
    let is_perspective = map[2][0] != 0.0 || map[2][1] != 0.0;
    for (first, pixels) in (0u32..).step_by(TOGETHER).zip(row.chunks_mut(TOGETHER)) {
        let lines = map.map(|[a, b, c]| [a, f64::from(first) * a + (b * y + c)]);
        if !at.set(lines, &from.within) {
            continue;
        }
        for (i, pixel) in pixels.iter_mut().enumerate() {
            let [left, top] = [at.pixel[0][i] as usize, at.pixel[1][i] as usize];
            if at.inside[i] && from.covered[from.columns * top + left] {
                if is_perspective {
                    gaussian = Gaussian::new(map, [f64::from(first) + i as f64, y], variance);
                }
                let first = from.columns * (top + 1 - TAPS / 2) + left + 1 - TAPS / 2;
                *pixel = gaussian.mean([at.fraction[0][i], at.fraction[1][i]], &from.values[first..], from.columns);
            }
        }
    }
}

/// Pixels of the plane along a side that a Gaussian takes.
const TAPS: usize = 8;

/// A Gaussian of the picture, on the plane around one place.
struct Gaussian {
    /// The logarithm to base 2 of the weight falls by the first times the square of the distance along columns, by the
    /// third times that along rows, and by the second times the product of the two distances.
    factors: [f32; 3],
}

impl Gaussian {
    fn new(map: &[[f64; 3]; 3], [x, y]: [f64; 2], variance: f64) -> Gaussian {
        let [u, v, w] = map.map(|[a, b, c]| a * x + b * y + c);
        let step = |line: [f64; 3], at: f64| [0, 1].map(|k: usize| (line[k] - at / w * map[2][k]) / w);
        // How far a place on the plane moves, along columns and along rows, per column and per row of the picture.
        let [[a, b], [c, d]] = [step(map[0], u), step(map[1], v)];
        let area = a * d - b * c;
        let scale = 0.5 * std::f64::consts::LOG2_E / (variance * area * area);
        let factors = [scale * (c * c + d * d), -2.0 * scale * (a * c + b * d), scale * (a * a + b * b)];
        Gaussian { factors: factors.map(|factor| factor as f32) }
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

/// Points on the plane, [`TOGETHER`] of them; first their columns, then their rows.
#[derive(Default)]
struct PlanePoints {
    /// The plane's column (or row) at or before each point.
    pixel: [[i32; TOGETHER]; 2],
    /// The distance past that column (or row), 0 to 1.
    fraction: [[f32; TOGETHER]; 2],
    /// The weights of the spline's four coefficients.
    weights: [[[f32; TOGETHER]; 4]; 2],
    /// Whether something may be drawn there.
    inside: [bool; TOGETHER],
}

impl PlanePoints {
    /// Sets the points to columns and rows that are quotients: each of the three `lines` is a step and a first number,
    /// and the third is the divisor. Returns whether any point is `within` these columns and rows.
    #[inline(always)]
    fn set(&mut self, lines: [[f64; 2]; 3], within: &[[f64; 2]; 2]) -> bool {
        let mut any = false;
        let mut at = [[0.0f64; TOGETHER]; 2];
        for i in 0..TOGETHER {
            let [u, v, divisor] = lines.map(|[step, first]| first + i as f64 * step);
            let factor = 1.0 / divisor;
            (at[0][i], at[1][i]) = (u * factor, v * factor);
            let is_inside = (at[0][i] >= within[0][0])
                & (at[0][i] <= within[0][1])
                & (at[1][i] >= within[1][0])
                & (at[1][i] <= within[1][1])
                & (divisor > 0.0);
            self.inside[i] = is_inside;
            any |= is_inside;
        }
        if !any {
            return false;
        }
        for side in 0..2 {
            let (pixel, fraction) = (&mut self.pixel[side], &mut self.fraction[side]);
            for i in 0..TOGETHER {
                let floor = at[side][i].floor();
                (pixel[i], fraction[i]) = (floor as i32, (at[side][i] - floor) as f32);
            }
            let [a, b, c, d] = &mut self.weights[side];
            for i in 0..TOGETHER {
                [a[i], b[i], c[i], d[i]] = spline_weights(fraction[i]);
            }
        }
        true
    }
}
