//! Bytes for screens and picture files, without a power for each.
//!
//! In: linear light. Out: the nearest sRGB byte. The exponent and the first bits of a number choose a part of a table, which holds
//! one byte or two. If it holds two, the number is compared with the least number of the second. For a picture of 934 x 624
//! pixels, powers take 16 ms, this table 3.

use std::sync::LazyLock;

use crate::classify::colour::linear_from_srgb;

/// Below this number all bytes are 0.
const LEAST: f32 = 1.0 / 8192.0;
/// Bits of a number that do not choose the part of the table. With parts half as many, some would hold three bytes.
const DROPPED: u32 = 16;
const PARTS: usize = ((1.0_f32.to_bits() - LEAST.to_bits()) >> DROPPED) as usize + 1;

/// The nearest sRGB bytes of numbers in linear light.
pub(super) struct SrgbBytes {
    /// The byte at the beginning of each part.
    bytes: [u8; PARTS],
    /// The least number of each byte, and one that is never reached.
    begins: [f32; 257],
}

pub(super) static SRGB_BYTES: LazyLock<SrgbBytes> = LazyLock::new(SrgbBytes::new);

impl SrgbBytes {
    fn new() -> SrgbBytes {
        let mut begins = [0.0; 257];
        for (byte, begin) in begins.iter_mut().enumerate().skip(1) {
            *begin = rounded_up(linear_from_srgb((byte as f64 - 0.5) / 255.0));
        }
        begins[256] = f32::INFINITY;
        let (mut byte, mut linear) = (0, LEAST);
        let bytes = [(); PARTS].map(|()| {
            byte += u8::from(linear >= begins[usize::from(byte) + 1]);
            linear = f32::from_bits(linear.to_bits() + (1 << DROPPED));
            byte
        });
        SrgbBytes { bytes, begins }
    }

    /// Returns the byte of a number; numbers below 0 and NaN are as 0, numbers above 1 as 1.
    #[inline(always)]
    #[expect(clippy::manual_clamp, reason = "so that NaN becomes the least number")]
    pub(super) fn byte(&self, linear: f32) -> u8 {
        let linear = linear.max(LEAST).min(1.0);
        let byte = self.bytes[((linear.to_bits() - LEAST.to_bits()) >> DROPPED) as usize];
        byte + u8::from(linear >= self.begins[usize::from(byte) + 1])
    }
}

/// Returns the least single number that is not below a positive one.
#[expect(clippy::cast_possible_truncation, reason = "rounded")]
fn rounded_up(number: f64) -> f32 {
    let nearest = number as f32;
    if f64::from(nearest) < number { nearest.next_up() } else { nearest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classify::colour::srgb_from_linear;

    /// The byte by the formula.
    fn expected(linear: f32) -> f64 {
        (srgb_from_linear(f64::from(linear).clamp(0.0, 1.0)) * 255.0).round()
    }

    #[test]
    fn bytes_are_those_of_the_formula() {
        for bits in (0..=1.5_f32.to_bits()).step_by(997) {
            let linear = f32::from_bits(bits);
            assert_eq!(f64::from(SRGB_BYTES.byte(linear)), expected(linear), "{linear}");
        }
    }

    #[test]
    fn a_byte_begins_where_the_formula_rounds_up_to_it() {
        for byte in 1..=255_u8 {
            let begin = SRGB_BYTES.begins[usize::from(byte)];
            assert_eq!([begin.next_down(), begin].map(|linear| SRGB_BYTES.byte(linear)), [byte - 1, byte]);
            let [before, behind] = [begin.next_down().next_down(), begin.next_up()].map(expected);
            assert_eq!([before, behind], [byte - 1, byte].map(f64::from));
        }
    }

    #[test]
    fn numbers_out_of_range_are_clamped() {
        let numbers = [f32::NAN, f32::NEG_INFINITY, -1.0, -0.0, 2.0, f32::MAX, f32::INFINITY];
        assert_eq!(numbers.map(|number| SRGB_BYTES.byte(number)), [0, 0, 0, 0, 255, 255, 255]);
    }
}
