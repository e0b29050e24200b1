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
//! Source: Unser, Aldroubi and Eden, "B-spline signal processing", 1993.

mod gaussian;
mod plane;
mod spline;

use std::ops::Range;

use fearless_simd::{Level, dispatch};

pub(super) use self::gaussian::MOST_ASIDE;
use self::gaussian::{TAPS, blur, blur_along};
use self::plane::Plane;
use self::spline::{filter_columns, filter_rows, resample};
use super::lattice::{Lattice, LowPass};
use super::tile_buffer::halve_rows;
use crate::error::Result;
use crate::parallel::in_parts;
use crate::splat::Frame;

/// Smallest standard deviation of a blur that is done, in pixels. A smaller one changes no value by more than 0.001.
const MIN_BLUR: f64 = 0.03;
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
        filter_rows(drawn, len, covered.columns.clone(), instructions, plane_threads);
    }
    if !is_wide[1] {
        filter_columns(drawn, len, covered.columns, instructions, plane_threads);
    }
    let samples = Plane { values: plane.pixels().as_chunks().0, covered: &covered.near, columns, within };
    let map = &plane_from_pixel;
    match is_wide {
        [true, true] => picture.fill_rows(threads, |y, row| {
            dispatch!(instructions, simd => blur(simd, &samples, map, covariance, y as f64, row));
        }),
        [false, false] => {
            let corners = corners(covariance);
            let is_point = corners.as_flattened().iter().all(|distance| distance.abs() < MIN_BLUR);
            picture.fill_rows(threads, |y, row| match is_point {
                true => dispatch!(instructions, simd => resample(simd, &samples, map, &[[0.0; 2]], most, y as f64, row)),
                false => dispatch!(instructions, simd => resample(simd, &samples, map, &corners, most, y as f64, row)),
            });
        }
        [is_across, _] => picture.fill_rows(threads, |y, row| match is_across {
            true => dispatch!(instructions, simd => blur_along::<_, 0>(simd, &samples, map, covariance, most, y as f64, row)),
            false => dispatch!(instructions, simd => blur_along::<_, 1>(simd, &samples, map, covariance, most, y as f64, row)),
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
