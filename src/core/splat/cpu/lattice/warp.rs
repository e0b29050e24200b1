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
//! voxels are much smaller, the plane is halved first: the mean of two pixels becomes one. If it is narrow along one axis of the plane
//! only, the spline is along that axis, and the Gaussian along the other.
//!
//! Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993: a recursive filter, then weights.

use std::f64::consts::LOG2_E;
use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x4, f32x16, f64x8, i32x16};

use super::Lattice;
use super::low_pass::LowPass;
use crate::error::Result;
use crate::parallel::in_parts;
use crate::splat::Frame;
use crate::splat::arith::{at_least, at_most, near_exp2_neg};
use crate::splat::cpu::tile_buffer::halve_rows;

/// Smallest standard deviation of a blur that is done, in pixels. A smaller one changes no value by more than 0.001.
const MIN_BLUR: f64 = 0.03;
/// How many pixels of a row are computed together.
const TOGETHER: usize = 16;
/// The pole of the cubic B-spline's recursive filter: sqrt(3) - 2.
const POLE: f32 = -0.267_949_2;
/// A factor of -6 times [`POLE`]. The two passes of the filter leave it out, and [`spline_weights`] include it instead.
const GAIN: f32 = 6.0 * 0.267_949_2;
/// Pixels of the plane for which it is worthwhile to start a thread.
const PART: usize = 1 << 16;

/// Computes the picture from `plane`: the frame drawn on `lattice`, perhaps halved. Its alphas are at most `most`. The result
/// does not depend on `level` and `threads`.
pub(in super::super) fn warp(
    lattice: &Lattice,
    mut plane: Frame,
    most: f32,
    level: Level,
    threads: usize,
) -> Result<Frame> {
    let LowPass { halvings, covariance, is_wide, .. } = lattice.low_pass;
    let mut plane_from_pixel = lattice.plane_from_pixel;
    for halving in 0..halvings[0].max(halvings[1]) {
        let halves = halvings.map(|halvings| halving < halvings);
        // What is kept was halved once when it was drawn.
        if halving > 0 {
            plane = halved(&plane, halves, threads)?;
        }
        let divisor = plane_from_pixel[2];
        for (line, _) in plane_from_pixel.iter_mut().zip(halves).filter(|(_, halved)| *halved) {
            // Pixel 0 of the halved plane lies between pixels 0 and 1.
            *line = [0, 1, 2].map(|k: usize| 0.5 * (line[k] - 0.5 * divisor[k]));
        }
    }
    let mut picture = Frame::transparent(lattice.picture)?;
    let [columns, rows] = plane.size().map(|side| side as usize);
    let plane_threads = threads.min(columns * rows / PART).max(1);
    // How many of the plane's pixels, from a place on, matter for it on each side.
    let around = is_wide.map(|is_wide| if is_wide { TAPS / 2 } else { 2 });
    let reach = match is_wide {
        [false, false] => 1,
        [true, true] => TAPS / 2,
        _ => TAPS / 2 + MOST_ASIDE.ceil() as usize,
    };
    let Some(covered) = Covered::of(&plane, reach, plane_threads) else {
        return Ok(picture);
    };
    let inner = |range: &Range<usize>, end: usize, around: usize| {
        [range.start.max(around - 1) as f64, range.end.min(end - around) as f64 - 0.001]
    };
    let within = [inner(&covered.columns, columns, around[0]), inner(&covered.rows, rows, around[1])];
    let len = 4 * columns;
    let drawn = &mut plane.pixels_mut()[len * covered.rows.start..len * covered.rows.end];
    if !is_wide[0] {
        filter_rows(drawn, len, covered.columns.clone(), level, plane_threads);
    }
    if !is_wide[1] {
        filter_columns(drawn, len, covered.columns, level, plane_threads);
    }
    let samples = Plane { values: plane.pixels().as_chunks().0, covered: &covered.near, columns, within };
    let map = &plane_from_pixel;
    match is_wide {
        [true, true] => picture.fill_rows(threads, |y, row| {
            dispatch!(level, simd => blur(simd, &samples, map, covariance, y as f64, row));
        }),
        [false, false] => {
            let corners = corners(covariance);
            let is_point = corners.as_flattened().iter().all(|distance| distance.abs() < MIN_BLUR);
            picture.fill_rows(threads, |y, row| match is_point {
                true => dispatch!(level, simd => resample(simd, &samples, map, &[[0.0; 2]], most, y as f64, row)),
                false => dispatch!(level, simd => resample(simd, &samples, map, &corners, most, y as f64, row)),
            });
        }
        [is_across, _] => picture.fill_rows(threads, |y, row| match is_across {
            true => dispatch!(level, simd => blur_along::<_, 0>(simd, &samples, map, covariance, most, y as f64, row)),
            false => dispatch!(level, simd => blur_along::<_, 1>(simd, &samples, map, covariance, most, y as f64, row)),
        }),
    }
    Ok(picture)
}

/// Returns four points around a pixel, in pixels of the picture, whose mean blurs with this covariance: each is one standard
/// deviation away along two axes.
fn corners([xx, xy, yy]: [f64; 3]) -> [[f64; 2]; 4] {
    let distance = xx.max(0.0).sqrt();
    let aside = if distance > 0.0 { xy / distance } else { 0.0 };
    let other = (yy - aside * aside).max(0.0).sqrt();
    [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
        .map(|[one, two]: [f64; 2]| [one * distance, one * aside + two * other])
}

/// Returns the plane with half as many columns, rows, or both, as `halves` says. Its pixels are means;
/// beyond the edges, pixels are 0.
pub(in super::super) fn halved(plane: &Frame, halves: [bool; 2], threads: usize) -> Result<Frame> {
    let columns = plane.size()[0] as usize;
    let each = halves.map(|halved| 1 + u32::from(halved));
    let mut halved = Frame::transparent([0, 1].map(|side: usize| plane.size()[side].div_ceil(each[side])))?;
    let rows = plane.pixels().as_chunks().0;
    halved.fill_rows(threads, |y, row| halve_rows(&rows[each[1] as usize * y * columns..], columns, halves, row));
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

/// Applies the recursive filter to rows of `len` numbers, to the right and back, within a range of columns. With
/// [`filter_columns`] it turns samples into the coefficients of the B-spline through them, divided by the square of
/// [`GAIN`]. Beyond the range, samples are 0.
fn filter_rows(rows: &mut [f32], len: usize, columns: Range<usize>, level: Level, threads: usize) {
    in_parts(rows, len, threads, |_, rows| {
        let lines = rows.chunks_exact_mut(len).map(|row| &mut row.as_chunks_mut().0[columns.clone()]);
        let mut lines: Vec<&mut [[f32; 4]]> = lines.collect();
        dispatch!(level, _ => {
            let (groups, rest) = lines.as_chunks_mut::<ROWS>();
            groups.iter_mut().for_each(filter_lines);
            rest.as_chunks_mut::<1>().0.iter_mut().for_each(filter_lines);
        });
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
fn filter_columns(rows: &mut [f32], len: usize, columns: Range<usize>, level: Level, threads: usize) {
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
    in_parts(&mut strips, 1, threads, |_, strips| {
        strips.iter_mut().for_each(|strip| dispatch!(level, _ => filter_strip(strip)));
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
#[inline(always)]
fn resample<S: Simd, const POINTS: usize>(
    simd: S,
    from: &Plane,
    map: &[[f64; 3]; 3],
    points: &[[f64; 2]; POINTS],
    most: f32,
    y: f64,
    row: &mut [[f32; 4]],
) {
    let line = |[dx, dy]: [f64; 2], x: f64| map.map(|[a, b, c]| [a, (x + dx) * a + (b * (y + dy) + c)]);
    let seen = points.map(|point| from.columns_seen(line(point, 0.0), row.len()));
    let seen = seen.into_iter().filter(|columns| !columns.is_empty());
    let columns = seen.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end)).unwrap_or_default();
    let rows = from.rows();
    for first in columns.clone().step_by(TOGETHER) {
        let pixels = &mut row[first..columns.end.min(first + TOGETHER)];
        let mut at = [PlanePoints::at_zero(simd); POINTS];
        let mut weights = [[[[0.0; TOGETHER]; 4]; 2]; POINTS];
        let mut near = 0;
        for (at, point) in at.iter_mut().zip(points) {
            *at = PlanePoints::of(simd, line(*point, first as f64), from);
            near |= at.near;
        }
        if near == 0 {
            continue;
        }
        for (at, weights) in at.iter().zip(&mut weights) {
            *weights = [spline_weights(at.fraction[0]), spline_weights(at.fraction[1])];
        }
        for (i, pixel) in pixels.iter_mut().enumerate() {
            if near >> i & 1 == 0 {
                continue;
            }
            let mut sum = f32x4::splat(simd, 0.0);
            for (at, [across, down]) in at.iter().zip(&weights) {
                if POINTS == 1 || at.near >> i & 1 == 1 {
                    let first = (at.pixel[i] as usize).wrapping_sub(from.columns + 1);
                    sum += weighted(simd, &rows, first, [across, down], i);
                }
            }
            *pixel = in_range(sum * (1.0 / POINTS as f32), most);
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
fn in_range<S: Simd>(pixel: f32x4<S>, largest: f32) -> [f32; 4] {
    let pixel = pixel.max(0.0);
    let most = BRIGHTEST * at_most(pixel[3], largest);
    pixel.min(f32x4::simd_from(pixel.simd, [most, most, most, largest])).to_array()
}

/// The brightest colour of a voxel: white in full light with the strongest highlight.
const BRIGHTEST: f32 = 2.0;

impl Plane<'_> {
    /// Returns the values from each of its first four rows on, all of one length.
    fn rows(&self) -> [&[[f32; 4]]; 4] {
        let len = self.values.len() - 3 * self.columns;
        [0, 1, 2, 3].map(|row| &self.values[row * self.columns..][..len])
    }

    /// Returns the columns of a row of the picture that see what was drawn. Each of the three `lines` is a step and a first
    /// number; the first two, divided by the third, are columns and rows of the plane.
    fn columns_seen(&self, [u, v, divisor]: [[f64; 2]; 3], columns: usize) -> Range<usize> {
        let (mut first, mut last) = (0.0f64, columns as f64 - 1.0);
        // Each is positive in the columns in question.
        let past = |line: [f64; 2], low: f64| [0, 1].map(|k: usize| line[k] - low * divisor[k]);
        let before = |line: [f64; 2], high: f64| past(line, high).map(|number| -number);
        let [[left, right], [top, bottom]] = self.within;
        for [step, start] in [past(u, left), before(u, right), past(v, top), before(v, bottom), divisor] {
            let zero = -start / step;
            if step > 0.0 {
                first = first.max(zero.ceil());
            } else if step < 0.0 {
                last = last.min(zero.floor());
            } else if start < 0.0 {
                return 0..0;
            }
        }
        if first <= last { first as usize..last as usize + 1 } else { 0..0 }
    }
}

/// Computes a row of the picture: the plane's pixels under a Gaussian of this covariance, in square pixels of the picture, around
/// each pixel. The row is empty before.
#[inline(always)]
fn blur<S: Simd>(simd: S, from: &Plane, map: &[[f64; 3]; 3], covariance: [f64; 3], y: f64, row: &mut [[f32; 4]]) {
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
fn blur_along<S: Simd, const ALONG: usize>(
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
pub(super) const MOST_ASIDE: f64 = 2.5;

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
const TAPS: usize = 8;

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

/// Points on the plane, [`TOGETHER`] of them.
#[derive(Clone, Copy)]
struct PlanePoints<S: Simd> {
    /// The index of the plane's pixel at or before each point.
    pixel: [i32; TOGETHER],
    /// The distance past that pixel, 0 to 1, along columns and along rows.
    fraction: [f32x16<S>; 2],
    /// A bit for each point: whether something was drawn near it.
    near: u32,
}

impl<S: Simd> PlanePoints<S> {
    #[inline(always)]
    fn at_zero(simd: S) -> PlanePoints<S> {
        PlanePoints { pixel: [0; TOGETHER], fraction: [f32x16::splat(simd, 0.0); 2], near: 0 }
    }

    /// Returns the points whose columns and rows are quotients: each of the three `lines` is a step and a first number,
    /// and the third is the divisor.
    #[inline(always)]
    fn of(simd: S, [u, v, divisor]: [[f64; 2]; 3], plane: &Plane) -> PlanePoints<S> {
        let mut factor = [f64x8::splat(simd, 1.0 / divisor[1]); 2];
        if divisor[0] != 0.0 {
            let [low, high] = along(simd, divisor);
            factor = [1.0 / low, 1.0 / high];
        }
        let mut pixel = [i32x16::splat(simd, 0); 2];
        let mut fraction = [f32x16::splat(simd, 0.0); 2];
        for (side, line) in [u, v].into_iter().enumerate() {
            let [low, high] = along(simd, line);
            let (low, high) = (low * factor[0], high * factor[1]);
            let (low_floor, high_floor) = (low.floor(), high.floor());
            pixel[side] = low_floor.narrow(high_floor).to_int();
            fraction[side] = (low - low_floor).narrow(high - high_floor);
        }
        let (pitch, zero) = (i32x16::splat(simd, plane.columns as i32), i32x16::splat(simd, 0));
        let first = pixel[1] * pitch + pixel[0];
        let right = fraction[0].simd_ge(0.5).select(zero + 1, zero);
        let nearest = (first + right + fraction[1].simd_ge(0.5).select(pitch, zero)).to_array();
        let mut near = 0;
        for i in 0..TOGETHER {
            near |= u32::from(plane.covered.get(nearest[i] as usize).is_some_and(|near| *near)) << i;
        }
        PlanePoints { pixel: first.to_array(), fraction, near }
    }
}

/// Returns the first numbers of a line.
#[inline(always)]
fn along<S: Simd>(simd: S, [step, first]: [f64; 2]) -> [f64x8<S>; 2] {
    let low = f64x8::simd_from(simd, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    [low * step + first, (low + 8.0) * step + first]
}
