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

mod covered;
mod gaussian;
mod plane;
mod spline;

use std::ops::Range;

use fearless_simd::{Level, dispatch};

use self::covered::Covered;
use self::gaussian::{Variances, blur};
use self::plane::Plane;
use self::spline::{filter_columns, filter_rows, resample};
use super::lattice::{Lattice, LowPass};
use super::tile_buffer::halve_rows;
use crate::error::Result;
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
    filter_rows(plane.pixels_mut(), 4 * columns, &covered, instructions, plane_threads);
    filter_columns(plane.pixels_mut(), 4 * columns, &covered, instructions, plane_threads);
    let inner = |range: Range<usize>, end: usize| {
        [range.start.max(around - 1) as f64, range.end.min(end - around) as f64 - 0.001]
    };
    let within = [inner(covered.columns_of(0..rows), columns), inner(covered.rows_of(0..columns), rows)];
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
