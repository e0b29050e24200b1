//! The low-pass of a lattice: how its picture is filtered where voxels are smaller than pixels.
//!
//! In: how far apart the picture's pixels are on the plane, and the width of footprints. Out: how often the plane is halved
//! before it is warped, and the Gaussian that is left to do.

use crate::splat::kernel::LOW_PASS;
use crate::splat::view::MAX_SIZE;

/// Width of the plane's margin around the voxels beside what a pixel of the picture takes on one side, in its pixels after halving, so
/// that the voxels' edge is interpolated correctly.
const MARGIN: f64 = 2.0;
/// Smallest standard deviation that is applied, in pixels of the picture. A smaller one changes no value by more than 0.001.
const MIN_BLUR: f64 = 0.03;
/// Standard deviation in pixels of the plane above which more of them are taken.
const WIDE: f64 = 2.0;
/// Standard deviation of the low-pass in the picture's middle, along columns and along rows of the plane, above which the
/// plane is halved first; in the plane's pixels.
const HALVED_ABOVE: f64 = 1.4;
/// Least width of a pixel of the picture on the halved plane, where a line along an axis crosses it, as a standard deviation in pixels of
/// the plane.
const LEAST_ACROSS_HALVED: f64 = 0.6;

/// How a plane is filtered where voxels are small. Pairs are along columns and along rows of the plane.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct LowPass {
    /// How often the drawn plane is halved, which turns two pixels into one, before it is warped.
    pub(in super::super) halvings: [u32; 2],
    /// Standard deviation of the whole filter, in pixels of the picture.
    pub(in super::super) deviation: f64,
    /// The most pixels of the halved plane to a pixel of the picture, along either axis.
    pub(super) most_per_pixel: f64,
}

impl LowPass {
    /// `middle`: how far a place on the plane moves, along columns and along rows, per column and per row of the picture, in the
    /// middle of the picture; `ends`: the same at the ends of the part that shows voxels; `width`: the standard deviation of the
    /// narrowest footprint in pixels of the picture.
    pub(super) fn new(middle: [[f64; 2]; 2], ends: &[[[f64; 2]; 2]], width: f64) -> LowPass {
        let variance = (f64::from(LOW_PASS * LOW_PASS) - width * width).max(0.0);
        let deviation = variance.sqrt();
        let moved = |moves: &[[f64; 2]; 2]| moves.map(|[x, y]| x.hypot(y));
        let deviations = moved(&middle).map(|moved| deviation * moved);
        let (mut least, mut most) = (moved(&middle), moved(&middle));
        for moved in ends.iter().map(moved) {
            for side in 0..2 {
                (least[side], most[side]) = (least[side].min(moved[side]), most[side].max(moved[side]));
            }
        }
        // The ellipse's width, where a line along an axis crosses its middle, as a share of its whole extent along that axis.
        let across = deviation * deviation * (middle[0][0] * middle[1][1] - middle[0][1] * middle[1][0]).abs();
        let share = if deviation > 0.0 { across / (deviations[0] * deviations[1]) } else { 1.0 };
        // Voxels of unlike spacings may have a plane that is much finer one way than the other.
        let halvings = [0, 1].map(|side: usize| {
            let wanted = (deviations[side] / HALVED_ABOVE).log2().ceil();
            wanted.min((deviation * least[side] * share / LEAST_ACROSS_HALVED).log2().floor()).clamp(0.0, 12.0) as u32
        });
        let halved = |side: usize| most[side] / f64::from(1u32 << halvings[side]);
        LowPass { halvings, deviation, most_per_pixel: halved(0).max(halved(1)) }
    }

    /// Returns how many pixels of the halved plane along a side a pixel of the picture takes: 4 if there is nothing to filter.
    pub(in super::super) fn taps(&self) -> usize {
        match self.deviation {
            ..MIN_BLUR => 4,
            deviation if deviation * self.most_per_pixel <= WIDE => 8,
            _ => 16,
        }
    }

    /// Returns the variance along columns and along rows that a Gaussian over the coefficients of the spline through the halved plane has
    /// beside that of the low-pass, in square pixels: a cubic B-spline's, less what halving has smoothed already: 1/16 at first.
    pub(in super::super) fn spline_variance(&self) -> [f64; 2] {
        let of_halvings = |halvings: i32| if halvings == 0 { 0.0 } else { 0.25 - 0.75 * 0.25f64.powi(halvings) };
        self.halvings.map(|halvings| 1.0 / 3.0 - of_halvings(halvings as i32))
    }

    /// Returns the first pixel of a plane that covers what lies between `low` and `high` pixels along columns (`side` 0) or rows (1),
    /// and how many there are.
    pub(super) fn pixels_between(self, side: usize, low: f64, high: f64) -> Option<(f64, u32)> {
        let margin = (MARGIN + 0.5 * self.taps() as f64) * f64::from(1u32 << self.halvings[side]);
        let first = low.floor() - margin;
        let pixels = (high.ceil() - first + margin + 1.0).max(2.0 * margin);
        (pixels <= f64::from(MAX_SIZE) - 4.0).then_some((first, (pixels as u32).next_multiple_of(4)))
    }
}
