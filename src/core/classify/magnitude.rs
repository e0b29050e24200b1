//! Gradient magnitudes in one byte, on a logarithmic scale.
//!
//! In: a magnitude and the largest there is. Out: code 1..=255 for `largest * 2^((code - 255) / 16)`, 0 for zero and
//! everything nearer to zero than to code 1. Sixteen codes an octave: relative error at most half a step,
//! 2^(1/32) - 1 = 2.2 %, over 15.9 octaves below the largest.

use crate::error::{Error, Result};

const CODES_PER_OCTAVE: f64 = 16.0;

/// A codec for magnitudes up to a stated largest.
#[derive(Debug, Clone)]
pub struct MagnitudeCodec {
    largest: f64,
    /// log2 of `largest`; infinite if that is 0.
    octave: f64,
    decoded: Box<[f64; 256]>,
}

impl MagnitudeCodec {
    /// A codec for magnitudes from 0 to `largest`, in units per world length.
    ///
    /// # Errors
    /// [`Error::Input`] if `largest` is not finite or below 0.
    pub fn new(largest: f64) -> Result<MagnitudeCodec> {
        if !(largest.is_finite() && largest >= 0.0) {
            let why = format!("is {largest}, but must be finite and 0 or above");
            return Err(Error::input("largest gradient magnitude", why));
        }
        let octave = if largest > 0.0 { largest.log2() } else { f64::INFINITY };
        let mut decoded = Box::new([0.0; 256]);
        for (code, magnitude) in decoded.iter_mut().enumerate().skip(1) {
            *magnitude = largest * ((code as f64 - 255.0) / CODES_PER_OCTAVE).exp2();
        }
        Ok(MagnitudeCodec { largest, octave, decoded })
    }

    /// The largest magnitude, that of code 255.
    pub fn largest(&self) -> f64 {
        self.largest
    }

    /// The nearest code, by ratio; 255 above the largest, 0 for NaN.
    #[inline]
    pub fn encode(&self, magnitude: f64) -> u8 {
        let code = 255.0 + CODES_PER_OCTAVE * (magnitude.log2() - self.octave);
        // Saturates: below 0 and NaN give 0.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the saturating cast is meant")]
        let code = (code + 0.5) as u8;
        code
    }

    /// The magnitude of a code, in units per world length.
    #[inline(always)]
    pub fn decode(&self, code: u8) -> f64 {
        self.decoded[usize::from(code)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_is_at_most_half_a_step() {
        for largest in [1e-300, 1e-30, 0.37, 1.0, 255.0, 4e9, 1e300] {
            let codec = MagnitudeCodec::new(largest).unwrap();
            let mut worst = 0.0f64;
            for step in 0..200_000 {
                let magnitude = largest * (-f64::from(step) * 15.89 / 200_000.0).exp2();
                let decoded = codec.decode(codec.encode(magnitude));
                worst = worst.max((decoded / magnitude - 1.0).abs());
            }
            assert!(worst < 0.0220, "{worst} at {largest}");
            assert!(worst > 0.0215, "the bound is sharp: {worst}");
        }
    }

    #[test]
    fn every_code_comes_back_and_the_ends_hold() {
        let codec = MagnitudeCodec::new(93.5).unwrap();
        for code in 1..=255 {
            assert_eq!(codec.encode(codec.decode(code)), code);
        }
        let codes = [0.0, -1.0, f64::NAN, 5e-324, 93.5, 1e300, f64::INFINITY].map(|m| codec.encode(m));
        assert_eq!(codes, [0, 0, 0, 0, 255, 255, 255]);
        assert_eq!(codec.decode(255), 93.5);
        let flat = MagnitudeCodec::new(0.0).unwrap();
        assert_eq!((flat.encode(0.0), flat.decode(0), flat.decode(255)), (0, 0.0, 0.0));
        for wrong in [f64::NAN, f64::INFINITY, -1.0] {
            assert!(MagnitudeCodec::new(wrong).unwrap_err().to_string().contains("must be finite"));
        }
    }
}
