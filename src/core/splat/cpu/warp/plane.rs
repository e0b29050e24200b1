//! The plane that a picture is computed from, and points on it.
//!
//! In: pixels, and which of them something was drawn near; lines of points. Out: for each point, the pixel before it, how far past
//! that it lies, and whether something was drawn near.

use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{f32x16, f64x8, i32x16};

/// How many pixels of a row are computed together.
pub(super) const TOGETHER: usize = 16;

/// A plane's pixels, or the coefficients of the B-spline through them.
pub(super) struct Plane<'a> {
    pub(super) values: &'a [[f32; 4]],
    /// For each pixel: whether something was drawn near it.
    pub(super) covered: &'a [bool],
    /// Number of columns of the plane.
    pub(super) columns: usize,
    /// First and last column, and first and last row, between which there are such pixels.
    pub(super) within: [[f64; 2]; 2],
}

impl Plane<'_> {
    /// Returns the values from each of its first four rows on, all of one length.
    pub(super) fn rows(&self) -> [&[[f32; 4]]; 4] {
        let len = self.values.len() - 3 * self.columns;
        [0, 1, 2, 3].map(|row| &self.values[row * self.columns..][..len])
    }

    /// Returns the columns of a row of the picture that see what was drawn. Each of the three `lines` is a step and a first
    /// number; the first two, divided by the third, are columns and rows of the plane.
    pub(super) fn columns_seen(&self, [u, v, divisor]: [[f64; 2]; 3], columns: usize) -> Range<usize> {
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

/// Points on the plane, [`TOGETHER`] of them.
#[derive(Clone, Copy)]
pub(super) struct PlanePoints<S: Simd> {
    /// The index of the plane's pixel at or before each point.
    pub(super) pixel: [i32; TOGETHER],
    /// The distance past that pixel, 0 to 1, along columns and along rows.
    pub(super) fraction: [f32x16<S>; 2],
    /// A bit for each point: whether something was drawn near it.
    pub(super) near: u32,
}

impl<S: Simd> PlanePoints<S> {
    /// Returns the points whose columns and rows are quotients: each of the three `lines` is a step and a first number,
    /// and the third is the divisor.
    #[inline(always)]
    pub(super) fn of(simd: S, [u, v, divisor]: [[f64; 2]; 3], plane: &Plane) -> PlanePoints<S> {
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
