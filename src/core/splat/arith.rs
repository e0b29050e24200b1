//! The two exponentials of a splat's pixel, in plain single precision.
//!
//! In: non-negative arguments in units of ln 2. Out: `2^-x` and `1 - 2^-x`. Both split x into the nearest integer n
//! and a rest f in [-1/2, 1/2]; a polynomial gives the rest and 2^-n is put together from bits. There is no branch,
//! no call and no fused multiply-add, so that a compiler may run eight at once on any processor and every one of them
//! gives the same bits.
//!
//! Source: Remez polynomials computed for this file (relative errors below, before rounding).

/// Adding and subtracting it rounds a number below 2^22 in magnitude to the nearest integer, which then sits in the
/// low bits of the sum.
const ROUND: f32 = 12_582_912.0;

/// log2(e): an optical depth times this is in units of ln 2.
pub const LOG2_E: f32 = std::f32::consts::LOG2_E;

/// `2^-x` for `x` in -125..=125; relative error at most 2e-7.
#[inline(always)]
pub(crate) fn exp2_neg(x: f32) -> f32 {
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    power_of_half(rounded) * (1.0 - f * rest(f))
}

/// `1 - 2^-x` for `x` in 0..=125; relative error at most 3e-7 however small `x` is.
///
/// The form keeps what `1 - exp2_neg(x)` would round away: a million layers of optical depth 1e-6 still add up.
#[inline(always)]
pub(crate) fn absorbed(x: f32) -> f32 {
    let rounded = x + ROUND;
    let f = x - (rounded - ROUND);
    let scale = power_of_half(rounded);
    (1.0 - scale) + scale * (f * rest(f))
}

/// Largest argument of [`absorbed_little`], with room for rounding below 1/2.
pub(crate) const LITTLE: f32 = 0.499;

/// [`absorbed`] for `x` in 0..=1/2, bit for bit: there n is 0, so there is nothing to split or to scale.
#[inline(always)]
pub(crate) fn absorbed_little(x: f32) -> f32 {
    x * rest(x)
}

/// `(1 - 2^-f) / f` for `f` in -1/2 ..= 1/2, within 1.1e-8; pairs of terms go together (Estrin), which halves the
/// chain of dependent steps.
#[inline(always)]
fn rest(f: f32) -> f32 {
    let square = f * f;
    let low = std::f32::consts::LN_2 + -2.402_265e-1 * f;
    let middle = 5.550_357_4e-2 + -9.618_237e-3 * f;
    let high = 1.339_073_5e-3 + -1.540_351_3e-4 * f;
    low + square * (middle + square * high)
}

/// `2^-n` from `n + ROUND`.
#[inline(always)]
fn power_of_half(rounded: f32) -> f32 {
    f32::from_bits(0x3f80_0000_u32.wrapping_sub(rounded.to_bits() << 23))
}

/// `value` if `keep`, else 0, with no branch: the compiler would turn a plain `if` around much arithmetic into a jump,
/// and eight pixels could no longer go together.
#[inline(always)]
pub(crate) fn keep_if(keep: bool, value: f32) -> f32 {
    f32::from_bits(value.to_bits() & 0_u32.wrapping_sub(u32::from(keep)))
}

/// The smaller of two numbers, `limit` for NaN; one instruction where `f32::min` takes three.
#[inline(always)]
pub(crate) fn at_most(value: f32, limit: f32) -> f32 {
    if value < limit { value } else { limit }
}

/// The larger of two numbers, `limit` for NaN.
#[inline(always)]
pub(crate) fn at_least(value: f32, limit: f32) -> f32 {
    if value > limit { value } else { limit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_exponentials_keep_their_promise() {
        let (mut worst_power, mut worst_rest, mut worst_absorbed) = (0.0f64, 0.0f64, 0.0f64);
        for step in 1..2_000_000u32 {
            let x = step as f32 * 1.5e-5;
            let exact = (-f64::from(x)).exp2();
            let lost = -(-f64::from(x) * std::f64::consts::LN_2).exp_m1();
            worst_power = worst_power.max((f64::from(exp2_neg(x)) / exact - 1.0).abs());
            worst_absorbed = worst_absorbed.max((f64::from(absorbed(x)) / lost - 1.0).abs());
            if x <= LITTLE {
                assert_eq!(absorbed(x).to_bits(), absorbed_little(x).to_bits());
            }
            if x < 1.0 {
                worst_rest = worst_rest.max((1.0 - f64::from(absorbed(x)) - exact).abs() / exact);
            }
        }
        println!("2^-x within {worst_power:.1e}, 1 - 2^-x within {worst_absorbed:.1e}");
        assert!(worst_power <= 2e-7, "{worst_power:e}");
        assert!(worst_absorbed <= 3e-7, "{worst_absorbed:e}");
        assert!(worst_rest <= 2e-7, "{worst_rest:e}");
        assert_eq!(absorbed(0.0), 0.0);
        assert!((f64::from(absorbed(1e-20)) / (1e-20 * std::f64::consts::LN_2) - 1.0).abs() < 1e-6);
        assert!(absorbed(125.0) <= 1.0 && exp2_neg(125.0) > 0.0);
    }
}
