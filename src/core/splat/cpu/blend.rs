//! Blend modes: how a splat changes a pixel.
//!
//! In: a splat's optical depth at a pixel, in units of ln 2 (0 outside its footprint), and the pixel's values. Out: the
//! pixel's new values. Red, green, blue and alpha go through one formula, each with its own *ink*: a component of the splat's
//! colour, or a constant for alpha. Alpha is a transmittance, an opacity or a sum of optical depths, depending on the mode. A
//! depth of 0 leaves the pixel's bits unchanged, so a kernel may run over pixels outside its footprint.

use crate::splat::arith::{absorbed, absorbed_small, at_least, at_most, keep_if, near_absorbed};

/// A blend mode: a formula for a pixel's values after a splat, and its constants.
pub trait Blend {
    /// The alpha of an empty pixel.
    const INITIAL_ALPHA: f32 = 0.0;
    /// Whether a pixel stops changing once its transmittance is low.
    const STOPS: bool = false;
    /// The ink of every splat for alpha.
    const ALPHA_INK: f32 = 1.0;

    /// Returns the factor by which the ink is multiplied, from a splat's optical depth; 0 for depth 0.
    ///
    /// `IS_SMALL`: the depth is at most `arith::SMALL_DEPTH`; takes less time and gives the same bits.
    #[inline(always)]
    fn amount<const IS_SMALL: bool>(depth: f32) -> f32 {
        if IS_SMALL { absorbed_small(depth) } else { absorbed(depth) }
    }

    /// Returns almost the same as [`amount`](Self::amount), in less time: its relative error is at most 2e-5.
    #[inline(always)]
    fn near_amount(depth: f32) -> f32 {
        near_absorbed(depth)
    }

    /// Returns a pixel's red, green, blue or alpha after a splat, from its `value` and the pixel's `alpha` before.
    ///
    /// `stop` is the transmittance below which the pixel no longer changes; 0 for never.
    fn blend(value: f32, alpha: f32, amount: f32, ink: f32, stop: f32) -> f32;

    /// Returns a pixel's alpha after a splat: the bits of [`blend`](Self::blend) with [`ALPHA_INK`](Self::ALPHA_INK).
    #[inline(always)]
    fn fade(alpha: f32, amount: f32, stop: f32) -> f32 {
        Self::blend(alpha, alpha, amount, Self::ALPHA_INK, stop)
    }
}

/// Compositing front to back; alpha is the transmittance. A pixel below `stop` keeps its values.
pub struct FrontToBack;

impl Blend for FrontToBack {
    const INITIAL_ALPHA: f32 = 1.0;
    const STOPS: bool = true;
    const ALPHA_INK: f32 = -1.0;

    #[inline(always)]
    fn blend(value: f32, alpha: f32, amount: f32, ink: f32, stop: f32) -> f32 {
        value + keep_if(alpha >= stop, alpha * amount) * ink
    }

    #[inline(always)]
    fn fade(alpha: f32, amount: f32, stop: f32) -> f32 {
        alpha - keep_if(alpha >= stop, alpha * amount)
    }
}

/// Compositing front to back by opacity times weight; alpha is the transmittance.
pub(crate) struct LinearFrontToBack;

impl Blend for LinearFrontToBack {
    const INITIAL_ALPHA: f32 = FrontToBack::INITIAL_ALPHA;
    const STOPS: bool = FrontToBack::STOPS;
    const ALPHA_INK: f32 = FrontToBack::ALPHA_INK;

    #[inline(always)]
    fn amount<const IS_SMALL: bool>(opacity: f32) -> f32 {
        if IS_SMALL { opacity } else { at_most(opacity, 1.0) }
    }

    #[inline(always)]
    fn blend(value: f32, alpha: f32, amount: f32, ink: f32, stop: f32) -> f32 {
        FrontToBack::blend(value, alpha, amount, ink, stop)
    }
}

/// Returns the light that a pixel loses to a sheet (a slice's summed splats): in all, and per unit of its optical
/// depth.
///
/// `depth` is the sheet's optical depth in units of ln 2.
#[inline(always)]
pub(crate) fn sheet_loss(transmittance: f32, depth: f32, stop: f32) -> [f32; 2] {
    /// The largest argument that `absorbed` allows; the sum of a few of the strongest splats exceeds it.
    const MAX_SUM: f32 = 125.0;
    let loss = keep_if(transmittance >= stop, transmittance * absorbed(at_most(depth, MAX_SUM)));
    [loss, loss / at_least(depth, f32::MIN_POSITIVE)]
}

/// Compositing back to front; alpha is the transmittance.
pub(crate) struct BackToFront;

impl Blend for BackToFront {
    const INITIAL_ALPHA: f32 = 1.0;
    const ALPHA_INK: f32 = 0.0;

    #[inline(always)]
    fn blend(value: f32, _: f32, amount: f32, ink: f32, _: f32) -> f32 {
        value + amount * (ink - value)
    }
}

/// Compositing front to back of faint splats (`faint.rs`); alpha is the opacity.
pub(crate) struct FaintFrontToBack;

impl Blend for FaintFrontToBack {
    #[inline(always)]
    fn blend(value: f32, alpha: f32, amount: f32, ink: f32, _: f32) -> f32 {
        value + (1.0 - alpha) * amount * ink
    }
}

/// Compositing back to front of faint splats; alpha is the opacity.
pub(crate) struct FaintBackToFront;

impl Blend for FaintBackToFront {
    #[inline(always)]
    fn blend(value: f32, alpha: f32, amount: f32, ink: f32, stop: f32) -> f32 {
        BackToFront::blend(value, alpha, amount, ink, stop)
    }
}

/// Sums of colour times optical depth; alpha is the sum of optical depths, in units of ln 2.
pub(crate) struct Additive;

impl Blend for Additive {
    #[inline(always)]
    fn amount<const IS_SMALL: bool>(depth: f32) -> f32 {
        depth
    }

    #[inline(always)]
    fn near_amount(depth: f32) -> f32 {
        depth
    }

    #[inline(always)]
    fn blend(value: f32, _: f32, amount: f32, ink: f32, _: f32) -> f32 {
        value + amount * ink
    }
}
