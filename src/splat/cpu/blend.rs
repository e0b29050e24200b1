//! What a splat does to a pixel: the five ways of putting splats together.
//!
//! In: a splat's optical depth at a pixel in units of ln 2 (0 outside its cut-off), then the pixel's red, green, blue
//! and fourth value. Out: the pixel's new values. Every way leaves a pixel of optical depth 0 as it was, bit for bit,
//! so that a kernel may run over pixels that a splat does not cover.

use super::arith::{absorbed, at_most, keep_if};

/// A splat's uniform inputs to its pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ink {
    pub(crate) red: f32,
    pub(crate) green: f32,
    pub(crate) blue: f32,
    /// Transmittance below which a pixel no longer changes; 0 for never.
    pub(crate) stop: f32,
}

/// A pixel: red, green, blue and the fourth plane.
pub(crate) type Pixel = [f32; 4];

/// One way of compositing.
pub(crate) trait Blend: Copy + Send + Sync {
    /// What the fourth plane starts as.
    const FOURTH: f32;
    /// Whether pixels can freeze.
    const STOPS: bool;
    /// What can be computed of an optical depth before the pixel is known; 0 for 0.
    fn amount(depth: f32) -> f32;
    /// The pixel after a splat of that amount.
    fn blend(pixel: Pixel, amount: f32, ink: &Ink) -> Pixel;
}

/// Front to back; the fourth plane is the transmittance. Pixels below `stop` are frozen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FrontToBack;

impl Blend for FrontToBack {
    const FOURTH: f32 = 1.0;
    const STOPS: bool = true;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        absorbed(depth)
    }

    #[inline(always)]
    fn blend([r, g, b, t]: Pixel, amount: f32, ink: &Ink) -> Pixel {
        let taken = keep_if(t >= ink.stop, t * amount);
        [r + taken * ink.red, g + taken * ink.green, b + taken * ink.blue, t - taken]
    }
}

/// Back to front; the fourth plane is the transmittance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BackToFront;

impl Blend for BackToFront {
    const FOURTH: f32 = 1.0;
    const STOPS: bool = false;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        absorbed(depth)
    }

    #[inline(always)]
    fn blend([r, g, b, t]: Pixel, a: f32, ink: &Ink) -> Pixel {
        [r + a * (ink.red - r), g + a * (ink.green - g), b + a * (ink.blue - b), t - t * a]
    }
}

/// Sums of colour times optical depth; the fourth plane is the sum of optical depth, in units of ln 2.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Additive;

impl Blend for Additive {
    const FOURTH: f32 = 0.0;
    const STOPS: bool = false;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        depth
    }

    #[inline(always)]
    fn blend([r, g, b, sum]: Pixel, depth: f32, ink: &Ink) -> Pixel {
        [r + depth * ink.red, g + depth * ink.green, b + depth * ink.blue, sum + depth]
    }
}

/// What a voxel's weight is multiplied by before it is capped at 1: cells stay whole, with no dips between voxels, as
/// long as a kernel is wide enough to weigh more than 1/e at a cell's corner, which takes a sigma of 1/2.
const WHOLE_CELL: f32 = std::f32::consts::E;

/// The largest normalised value, at full weight over its cell; the fourth plane holds it, ink's red the voxel's.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Maximum;

impl Blend for Maximum {
    const FOURTH: f32 = 0.0;
    const STOPS: bool = false;

    #[inline(always)]
    fn amount(depth: f32) -> f32 {
        depth * WHOLE_CELL
    }

    #[inline(always)]
    fn blend([r, g, b, most]: Pixel, weighted: f32, ink: &Ink) -> Pixel {
        let value = at_most(weighted, ink.red);
        [r, g, b, if value > most { value } else { most }]
    }
}
