//! What a splat does to a pixel: the ways of putting splats together.
//!
//! In: a splat's optical depth at a pixel in units of ln 2 (0 outside its cut-off), then the pixel's values. Out: the
//! pixel's new values. A pixel's red, green, blue and fourth value lie side by side, so one formula serves all four:
//! what differs is the splat's *ink*, which has a number for each. Every way leaves a pixel of optical depth 0 as it
//! was, bit for bit, so that a kernel may run over pixels that a splat does not cover.

use crate::splat::arith::{absorbed, absorbed_little, at_least, at_most, keep_if};

/// One way of compositing.
pub trait Blend: Copy + Send + Sync {
    /// What the fourth value starts as.
    const FOURTH: f32;
    /// Whether pixels can freeze.
    const STOPS: bool;
    /// A splat's ink for the fourth value.
    const INK: f32;
    /// What can be computed of an optical depth before the pixel is known; 0 for 0.
    fn amount(depth: f32) -> f32;
    /// The same for depths up to [`LITTLE`](crate::splat::arith::LITTLE): the same bits for less work.
    fn little(depth: f32) -> f32;
    /// One of a pixel's values after a splat of that amount. `stop`: transmittance below which the pixel no longer
    /// changes; 0 for never.
    fn blend(value: f32, fourth: f32, amount: f32, ink: f32, stop: f32) -> f32;
}

/// Front to back; the fourth value is the transmittance. Pixels below `stop` are frozen.
#[derive(Debug, Clone, Copy)]
pub struct FrontToBack;

impl Blend for FrontToBack {
    const FOURTH: f32 = 1.0;
    const STOPS: bool = true;
    const INK: f32 = -1.0;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        absorbed(depth)
    }

    #[inline(always)]
    fn little(depth: f32) -> f32 {
        absorbed_little(depth)
    }

    #[inline(always)]
    fn blend(value: f32, fourth: f32, amount: f32, ink: f32, stop: f32) -> f32 {
        value + keep_if(fourth >= stop, fourth * amount) * ink
    }
}

/// Front to back, opacity times weight; the fourth value is the transmittance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LinearFrontToBack;

impl Blend for LinearFrontToBack {
    const FOURTH: f32 = FrontToBack::FOURTH;
    const STOPS: bool = FrontToBack::STOPS;
    const INK: f32 = FrontToBack::INK;

    #[inline(always)]
    fn amount(opacity: f32) -> f32 {
        at_most(opacity, 1.0)
    }

    #[inline(always)]
    fn little(opacity: f32) -> f32 {
        opacity
    }

    #[inline(always)]
    fn blend(value: f32, fourth: f32, amount: f32, ink: f32, stop: f32) -> f32 {
        FrontToBack::blend(value, fourth, amount, ink, stop)
    }
}

/// What a pixel takes of a sheet, front to back, and that per optical depth of the sheet. `depth` in units of ln 2.
#[inline(always)]
pub(crate) fn sheet_parts(transmittance: f32, depth: f32, stop: f32) -> [f32; 2] {
    /// More than the exponential takes; a sheet of a few splats of the largest depth has it.
    const MOST: f32 = 125.0;
    let part = keep_if(transmittance >= stop, transmittance * absorbed(at_most(depth, MOST)));
    [part, part / at_least(depth, f32::MIN_POSITIVE)]
}

/// Back to front; the fourth value is the transmittance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BackToFront;

impl Blend for BackToFront {
    const FOURTH: f32 = 1.0;
    const STOPS: bool = false;
    const INK: f32 = 0.0;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        absorbed(depth)
    }

    #[inline(always)]
    fn little(depth: f32) -> f32 {
        absorbed_little(depth)
    }

    #[inline(always)]
    fn blend(value: f32, _: f32, amount: f32, ink: f32, _: f32) -> f32 {
        value + amount * (ink - value)
    }
}

/// Front to back, where a pixel takes little: the fourth value is the opacity, as fine as it is small (`deep.rs`).
#[derive(Debug, Clone, Copy)]
pub(crate) struct FaintFrontToBack;

impl Blend for FaintFrontToBack {
    const FOURTH: f32 = 0.0;
    const STOPS: bool = false;
    const INK: f32 = 1.0;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        absorbed(depth)
    }

    #[inline(always)]
    fn little(depth: f32) -> f32 {
        absorbed_little(depth)
    }

    #[inline(always)]
    fn blend(value: f32, fourth: f32, amount: f32, ink: f32, _: f32) -> f32 {
        value + (1.0 - fourth) * amount * ink
    }
}

/// Back to front; the fourth value is the opacity.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FaintBackToFront;

impl Blend for FaintBackToFront {
    const FOURTH: f32 = 0.0;
    const STOPS: bool = false;
    const INK: f32 = 1.0;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        absorbed(depth)
    }

    #[inline(always)]
    fn little(depth: f32) -> f32 {
        absorbed_little(depth)
    }

    #[inline(always)]
    fn blend(value: f32, _: f32, amount: f32, ink: f32, _: f32) -> f32 {
        value + amount * (ink - value)
    }
}

/// Sums of colour times optical depth; the fourth value is the sum of optical depth, in units of ln 2.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Additive;

impl Blend for Additive {
    const FOURTH: f32 = 0.0;
    const STOPS: bool = false;
    const INK: f32 = 1.0;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        depth
    }

    #[inline(always)]
    fn little(depth: f32) -> f32 {
        depth
    }

    #[inline(always)]
    fn blend(value: f32, _: f32, amount: f32, ink: f32, _: f32) -> f32 {
        value + amount * ink
    }
}

/// What a voxel's weight is multiplied by before it is capped at 1: cells stay whole, with no dips between voxels, as
/// long as a kernel is wide enough to weigh more than 1/e at a cell's corner, which takes a sigma of 1/2.
pub const WHOLE_CELL: f32 = std::f32::consts::E;

/// The largest normalised value, at full weight over its cell; red holds it, as red's ink is the voxel's value.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Maximum;

impl Blend for Maximum {
    const FOURTH: f32 = 0.0;
    const STOPS: bool = false;
    const INK: f32 = 1.0;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        depth * WHOLE_CELL
    }

    #[inline(always)]
    fn little(depth: f32) -> f32 {
        depth * WHOLE_CELL
    }

    #[inline(always)]
    fn blend(value: f32, _: f32, amount: f32, ink: f32, _: f32) -> f32 {
        let offered = at_most(amount, ink);
        if offered > value { offered } else { value }
    }
}
