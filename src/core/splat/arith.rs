//! The two exponentials of a splat's pixel, in single precision.
//!
//! In: non-negative arguments in units of ln 2. Out: `2^-x` and `1 - 2^-x`. Both split x into the nearest integer n and
//! a fraction f in [-1/2, 1/2]. A polynomial takes f, and 2^-n is made of bits. Without branches, calls or fused
//! multiply-adds, a compiler may compute eight at once, and every processor gives the same bits.
//!
//! Source: Remez polynomials computed for this file (relative errors below, before rounding).

/// Adding and subtracting this rounds a number below 2^22 to the nearest integer, which is in the low bits of the sum.
const ROUND: f32 = 12_582_912.0;

/// An optical depth times this factor is in units of ln 2: log2(e).
pub(crate) const LOG2_E: f32 = std::f32::consts::LOG2_E;

/// Returns `2^-x` for `x` in -125..=125; relative error at most 2e-7.
#[inline(always)]
pub(crate) fn exp2_neg(x: f32) -> f32 {
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    power_of_half(rounded) * (1.0 - f * loss_ratio(f))
}

/// Returns `1 - 2^-x` for `x` in 0..=125; relative error at most 3e-7 however small `x` is.
///
/// `1 - exp2_neg(x)` would round small values away; with this, a million layers of optical depth 1e-6 still add up.
#[inline(always)]
pub(crate) fn absorbed(x: f32) -> f32 {
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    let scale = power_of_half(rounded);
    (1.0 - scale) + scale * (f * loss_ratio(f))
}

/// Returns `2^-x` for `x` in 0..=125; relative error at most 8e-5. Takes about half as long as [`exp2_neg`].
#[inline(always)]
pub(crate) fn near_exp2_neg(x: f32) -> f32 {
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    let square = f * f;
    let power = (0.999_928_1 + -0.693_261 * f) + square * (0.242_61 + -0.055_171_1 * f);
    f32::from_bits(power.to_bits().wrapping_sub(rounded.to_bits() << 23))
}

/// Returns `1 - 2^-x` for `x` in 0..=125; relative error at most 2e-5 however small `x` is.
#[inline(always)]
pub(crate) fn near_absorbed(x: f32) -> f32 {
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    let scale = power_of_half(rounded);
    let ratio = (0.693_136_9 + -0.240_232_5 * f) + (f * f) * (0.055_837_1 + -0.009_618_1 * f);
    (1.0 - scale) + scale * (f * ratio)
}

/// Largest argument of [`absorbed_small`]; slightly below 1/2 because of rounding.
pub(crate) const SMALL_DEPTH: f32 = 0.499;

/// Returns the same as [`absorbed`], bit for bit, for `x` up to [`SMALL_DEPTH`]: n is 0 there, so x is not split.
#[inline(always)]
pub(crate) fn absorbed_small(x: f32) -> f32 {
    x * loss_ratio(x)
}

/// Returns `(1 - 2^-f) / f` for `f` in -1/2..=1/2, within 1.1e-8. Estrin's scheme halves the chain of operations.
#[inline(always)]
fn loss_ratio(f: f32) -> f32 {
    let square = f * f;
    let low = std::f32::consts::LN_2 + -2.402_265e-1 * f;
    let middle = 5.550_357_4e-2 + -9.618_237e-3 * f;
    let high = 1.339_073_5e-3 + -1.540_351_3e-4 * f;
    low + square * (middle + square * high)
}

/// Returns `2^-n`; `rounded` is `n + ROUND`.
#[inline(always)]
fn power_of_half(rounded: f32) -> f32 {
    f32::from_bits(0x3f80_0000_u32.wrapping_sub(rounded.to_bits() << 23))
}

/// Returns `value` if `keep`, else 0, without a branch: from a plain `if` around much arithmetic the compiler makes a
/// jump, and then cannot compute eight pixels at once.
#[inline(always)]
pub(crate) fn keep_if(keep: bool, value: f32) -> f32 {
    f32::from_bits(value.to_bits() & 0_u32.wrapping_sub(u32::from(keep)))
}

/// Returns the smaller number, and `limit` if `value` is NaN; one instruction where `f32::min` takes three.
#[inline(always)]
pub(crate) fn at_most(value: f32, limit: f32) -> f32 {
    if value < limit { value } else { limit }
}

/// Returns the larger number, and `limit` if `value` is NaN.
#[inline(always)]
pub(crate) fn at_least(value: f32, limit: f32) -> f32 {
    if value > limit { value } else { limit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_are_as_exact_as_their_comments_say() {
        let (mut powers, mut losses) = ([0.0f64; 2], [0.0f64; 2]);
        for step in 1..2_000_000u32 {
            let x = step as f32 * 1.5e-5;
            let exact = (-f64::from(x)).exp2();
            let lost = -(-f64::from(x) * std::f64::consts::LN_2).exp_m1();
            for (worst, power) in powers.iter_mut().zip([exp2_neg(x), near_exp2_neg(x)]) {
                *worst = worst.max((f64::from(power) / exact - 1.0).abs());
            }
            for (worst, loss) in losses.iter_mut().zip([absorbed(x), near_absorbed(x)]) {
                *worst = worst.max((f64::from(loss) / lost - 1.0).abs());
            }
            if x <= SMALL_DEPTH {
                assert_eq!(absorbed(x).to_bits(), absorbed_small(x).to_bits());
            }
        }
        assert!(powers[0] <= 2e-7 && powers[1] <= 8e-5, "{powers:?}");
        assert!(losses[0] <= 3e-7 && losses[1] <= 2e-5, "{losses:?}");
        assert_eq!(near_absorbed(0.0), 0.0);
        assert_eq!(absorbed(0.0), 0.0);
        assert!((f64::from(absorbed(1e-20)) / (1e-20 * std::f64::consts::LN_2) - 1.0).abs() < 1e-6);
        assert!(absorbed(125.0) <= 1.0 && exp2_neg(125.0) > 0.0);
    }
}
