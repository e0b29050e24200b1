//! Gradient magnitudes in one byte, on a logarithmic scale.
//!
//! Code 1..=255 stands for `largest * 2^((code - 255) / 16)`; code 0 for zero and magnitudes nearer to zero than to
//! code 1. With 16 codes per octave the relative error is at most half the distance of two codes, 2^(1/32) - 1 = 2.2 %,
//! over 15.9 octaves below the largest.

use crate::error::{Error, Result};

const CODES_PER_OCTAVE: f64 = 16.0;

/// Encodes gradient magnitudes, up to a given largest one, in one byte.
#[derive(Debug, Clone)]
pub struct MagnitudeCodec {
    largest: f64,
    /// log2 of `largest`; infinite if `largest` is 0.
    octave: f64,
    decoded: Box<[f64; 256]>,
}

impl MagnitudeCodec {
    /// Creates a codec for magnitudes from 0 to `largest`, in units per world length.
    ///
    /// # Errors
    /// [`Error::Input`] if `largest` is negative or not finite.
    pub fn new(largest: f64) -> Result<MagnitudeCodec> {
        if !(largest.is_finite() && largest >= 0.0) {
            let why = format!("is {largest}, but must be finite and 0 or above");
            return Err(Error::input("largest gradient magnitude", why));
        }
        let octave = if largest > 0.0 { largest.log2() } else { f64::INFINITY };
        let magnitude = |code: usize| largest * ((code as f64 - 255.0) / CODES_PER_OCTAVE).exp2();
        let decoded = std::array::from_fn(|code| if code == 0 { 0.0 } else { magnitude(code) });
        Ok(MagnitudeCodec { largest, octave, decoded: Box::new(decoded) })
    }

    /// Returns the magnitude that code 255 stands for, in units per world length.
    pub fn largest(&self) -> f64 {
        self.largest
    }

    /// Returns the code nearest to `magnitude` by ratio; 255 above the largest, 0 for NaN.
    #[inline]
    pub fn encode(&self, magnitude: f64) -> u8 {
        let code = 255.0 + CODES_PER_OCTAVE * (magnitude.log2() - self.octave);
        // The cast saturates: negative numbers and NaN become 0.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the saturating cast is meant")]
        let code = (code + 0.5) as u8;
        code
    }

    /// Returns the magnitude of `code`, in units per world length.
    #[inline(always)]
    pub fn decode(&self, code: u8) -> f64 {
        self.decoded[usize::from(code)]
    }
}
