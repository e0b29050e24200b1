//! The warp: from the lattice's pixels to the picture, by cubic B-splines.
//!
//! In: the frame drawn on a [`Lattice`]. Out: the picture.
//!
//! ```text
//! plane -> coefficients of the spline (a recursive filter along rows, then columns) -> homography -> picture
//! ```
//!
//! Where voxels are smaller than pixels, the plane is halved first if they are much smaller: the mean of two pixels becomes one. The
//! low-pass is then a Gaussian over the coefficients of the spline. A cubic B-spline is nearly a Gaussian of variance 1/3, so one
//! that is wider by this stands for both.
//!
//! Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993.

mod gaussian;
mod plane;
mod spline;

use std::ops::Range;

use fearless_simd::{Level, dispatch};

use self::gaussian::{Variances, blur};
use self::plane::Plane;
use self::spline::{filter_columns, filter_rows, resample};
use super::lattice::{Lattice, LowPass};
use super::tile_buffer::halve_rows;
use crate::error::Result;
use crate::parallel::in_parts;
use crate::splat::Frame;

/// Pixels of the plane for which it is worthwhile to start a thread.
const PART: usize = 1 << 16;

/// Computes the picture from `plane`: the frame drawn on `lattice`, perhaps halved. Its alphas are at most `most`. The result
/// does not depend on `instructions` and `threads`.
pub(super) fn warp(
    lattice: &Lattice,
    mut plane: Frame,
    most: f32,
    instructions: Level,
    threads: usize,
) -> Result<Frame> {
    let LowPass { halvings, deviation, .. } = lattice.low_pass;
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
    let taps = lattice.low_pass.taps();
    // How many of the plane's pixels, from a place on, matter for it on each side.
    let around = taps / 2;
    let Some(covered) = Covered::of(&plane, around - 1, plane_threads) else {
        return Ok(picture);
    };
    let inner = |range: &Range<usize>, end: usize| {
        [range.start.max(around - 1) as f64, range.end.min(end - around) as f64 - 0.001]
    };
    let within = [inner(&covered.columns, columns), inner(&covered.rows, rows)];
    let len = 4 * columns;
    let drawn = &mut plane.pixels_mut()[len * covered.rows.start..len * covered.rows.end];
    filter_rows(drawn, len, covered.columns.clone(), instructions, plane_threads);
    filter_columns(drawn, len, covered.columns, instructions, plane_threads);
    let samples = Plane { values: plane.pixels().as_chunks().0, covered: &covered.near, columns, within };
    let map = &plane_from_pixel;
    let variances = Variances { low_pass: deviation * deviation, spline: lattice.low_pass.spline_variance() };
    picture.fill_rows(threads, |y, row| match taps {
        4 => dispatch!(instructions, simd => resample(simd, &samples, map, most, y as f64, row)),
        8 => dispatch!(instructions, simd => blur::<_, 8>(simd, &samples, map, variances, most, y as f64, row)),
        _ => dispatch!(instructions, simd => blur::<_, 16>(simd, &samples, map, variances, most, y as f64, row)),
    });
    Ok(picture)
}

/// Returns the plane with half as many columns, rows, or both, as `halves` says. Its pixels are means;
/// beyond the edges, pixels are 0.
pub(super) fn halved(plane: &Frame, halves: [bool; 2], threads: usize) -> Result<Frame> {
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
