//! The low-pass of a lattice: how its picture is filtered where voxels are smaller than pixels.
//!
//! In: how far apart the picture's pixels are on the plane, and the width of footprints. Out: how often the plane is halved
//! before it is warped, and the Gaussian that is left to do.

use crate::splat::kernel::LOW_PASS;
use crate::splat::view::MAX_SIZE;

/// Width of the plane's margin around the voxels, in its pixels after halving, so that the voxels' edge is interpolated
/// correctly.
const MARGIN: f64 = 6.0;
/// Standard deviation of the low-pass in the picture's middle, along columns and along rows of the plane, above which the
/// plane is halved first; in the plane's pixels.
const HALVED_ABOVE: f64 = 1.4;
/// Smallest one at which the pixels lie so near to each other that none is missed.
const LEAST_WIDE: f64 = 0.62;
/// The largest after halving, in the picture's middle: a plane that is seen obliquely is halved less.
const MOST_WIDE: f64 = 2.0;
/// Least width of a pixel of the picture on the halved plane, where a line along an axis crosses it, as a standard deviation in pixels of
/// the plane; and the least of the filter that is left to do.
const LEAST_ACROSS_HALVED: f64 = 0.6;
const LEAST_ACROSS: f64 = 0.45;

/// How a plane is filtered where voxels are small. Pairs are along columns and along rows of the plane.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct LowPass {
    /// How often the drawn plane is halved, which turns two pixels into one, before it is warped.
    pub(in super::super) halvings: [u32; 2],
    /// Covariance (xx, xy, yy) of the Gaussian that is left to do, in square pixels of the picture.
    pub(in super::super) covariance: [f64; 3],
    /// Whether it is so wide, in the picture's middle, that it may take the plane's pixels as they are.
    pub(in super::super) is_wide: [bool; 2],
    /// Standard deviation of the whole filter, in pixels of the picture.
    pub(in super::super) deviation: f64,
}

impl LowPass {
    /// `moves`: how far a place on the plane moves, along columns and along rows, per column and per row of the picture; `width`: the
    /// standard deviation of the narrowest footprint in pixels of the picture.
    ///
    /// `None` if the plane is seen so obliquely that a pixel of the picture is a long, thin, slanted ellipse on it.
    pub(super) fn new(moves: [[f64; 2]; 2], width: f64) -> Option<LowPass> {
        let variance = (f64::from(LOW_PASS * LOW_PASS) - width * width).max(0.0);
        let deviation = variance.sqrt();
        let deviations = moves.map(|[x, y]| deviation * x.hypot(y));
        // The ellipse's width, where a line along an axis crosses its middle, as a share of its whole extent along that axis.
        let across = deviation * deviation * (moves[0][0] * moves[1][1] - moves[0][1] * moves[1][0]).abs();
        let share = if deviation > 0.0 { across / (deviations[0] * deviations[1]) } else { 1.0 };
        // Voxels of unlike spacings may have a plane that is much finer one way than the other.
        let halvings = deviations.map(|deviation| {
            let wanted = (deviation / HALVED_ABOVE).log2().ceil();
            wanted.min((deviation * share / LEAST_ACROSS_HALVED).log2().floor()).clamp(0.0, 12.0) as u32
        });
        let kept = |side: usize| moves[side].map(|moves| moves / f64::from(1u32 << halvings[side]));
        let [[a, b], [c, d]] = [kept(0), kept(1)];
        // Covariance in pixels of what is kept. The mean of 2^n pixels is a filter, too.
        let of_mean = halvings.map(|halvings| (1.0 - 0.25f64.powi(halvings as i32)) / 12.0);
        let squares = [variance * (a * a + b * b) - of_mean[0], variance * (c * c + d * d) - of_mean[1]];
        let mixed = variance * (a * c + b * d);
        let (finer, coarser) = if squares[0] > squares[1] { (0, 1) } else { (1, 0) };
        let mut is_wide = squares.map(|square| square >= LEAST_WIDE * LEAST_WIDE);
        if is_wide[finer] {
            // The variance along the finer axis less that on a line along this axis.
            let slant = mixed * mixed / squares[coarser].max(f64::MIN_POSITIVE);
            let thinnest = if is_wide[coarser] {
                squares[coarser] - mixed * mixed / squares[finer]
            } else {
                squares[finer] - slant
            };
            let is_thin = thinnest < LEAST_ACROSS * LEAST_ACROSS;
            let is_slanted = if is_wide[coarser] { is_thin } else { slant > LEAST_WIDE * LEAST_WIDE };
            if squares[finer] > MOST_WIDE * MOST_WIDE || is_slanted {
                return None;
            }
            is_wide[finer] = !is_thin;
        }
        let ([xx, yy], area) = (squares, a * d - b * c);
        let covariance = [
            d * d * xx - 2.0 * b * d * mixed + b * b * yy,
            -c * d * xx + (a * d + b * c) * mixed - a * b * yy,
            c * c * xx - 2.0 * a * c * mixed + a * a * yy,
        ];
        let covariance = covariance.map(|part| part / (area * area));
        Some(LowPass { halvings, covariance, is_wide, deviation })
    }

    /// Returns whether pixels of the plane are so fine that not all are kept, or that they are averaged as they are.
    pub(super) fn is_averaged(&self) -> bool {
        self.is_wide != [false; 2] || self.halvings != [0; 2]
    }

    /// Returns the first pixel of a plane that covers what lies between `low` and `high` pixels along columns (`side` 0) or rows (1),
    /// and how many there are.
    pub(super) fn pixels_between(self, side: usize, low: f64, high: f64) -> Option<(f64, u32)> {
        let margin = MARGIN * f64::from(1u32 << self.halvings[side]);
        let first = low.floor() - margin;
        let pixels = (high.ceil() - first + margin + 1.0).max(2.0 * margin);
        (pixels <= f64::from(MAX_SIZE) - 4.0).then_some((first, (pixels as u32).next_multiple_of(4)))
    }
}
