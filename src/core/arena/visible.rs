//! Visible codes: which stored records a transfer function shows.
//!
//! In: a transfer function and the meaning of an arena's codes. Out: a table with one bit per value code, or per pair of
//! value and magnitude if opacity depends on both: 32 bytes to 2 MiB. Stored voxels are judged by their codes, not by
//! the samples that the codes came from.

use super::layout::{Channels, Facts, Scales};
use crate::classify::{MagnitudeCodec, TransferFunction};
use crate::error::{Error, Result};

/// Lowest opacity (0 to 1) at which the loss of a voxel is noticeable.
pub(crate) const NOTICEABLE_OPACITY: f64 = 0.02;

/// Returns the opacity of a stored voxel with value code `value`, from 0 to 1, per reference length.
///
/// `magnitude` is the voxel's gradient magnitude. A code at an end of the visible value range may decode to a value
/// just outside the range, by rounding; the voxel still counts as visible.
pub fn stored_opacity(transfer: &TransferFunction, scales: &Scales, value: u16, magnitude: f64) -> f64 {
    let value = scales.value(value.into());
    let opacity = transfer.opacity(value, magnitude);
    if opacity > 0.0 {
        return opacity;
    }
    let nudge = (scales.value_step * 1e-6).max(value.abs() * 1e-14);
    transfer.opacity(value - nudge, magnitude).max(transfer.opacity(value + nudge, magnitude))
}

/// Largest optical depth, both per reference length and of a splat at a pixel: `e^-16` is below 2^-23.
pub const MAX_DEPTH: f64 = 16.0;

/// Returns the optical depth of a stored voxel per reference length, from 0 to 16; see [`stored_opacity`].
pub(crate) fn stored_depth(transfer: &TransferFunction, scales: &Scales, value: u16, magnitude: f64) -> f64 {
    (-(-stored_opacity(transfer, scales, value, magnitude).clamp(0.0, 1.0)).ln_1p()).min(MAX_DEPTH)
}

/// Returns whether two functions give stored voxels the same opacities, within 0.05, once one factor is applied to all optical
/// depths of one of them.
pub(crate) fn are_alike(one: &TransferFunction, other: &TransferFunction, facts: &Facts) -> bool {
    const DIFFERENCE: f64 = 0.05;
    if one == other {
        return true;
    }
    let codec = MagnitudeCodec::new(facts.scales.magnitude_scale);
    let (magnitudes, values_apart) = match codec {
        Ok(codec) if facts.channels.magnitude_bits > 0 && (one.uses_gradient() || other.uses_gradient()) => {
            ((0..=u8::MAX).step_by(15).map(|code| codec.decode(code)).collect(), 16)
        }
        _ => (vec![f64::MAX], 1),
    };
    let step = if facts.channels.value_bits == 8 { 1 } else { values_apart };
    let codes = (0..=facts.channels.last_value_code())
        .step_by(step)
        .flat_map(|value| magnitudes.iter().map(move |&magnitude| (value, magnitude)));
    let depths: Vec<[f64; 2]> = codes
        .map(|(value, at)| [one, other].map(|function| stored_depth(function, &facts.scales, value, at)))
        .collect();
    let [sum, other_sum] = [0, 1].map(|k: usize| depths.iter().map(|depths| depths[k]).sum::<f64>());
    let factor = if sum > 0.0 { other_sum / sum } else { 1.0 };
    depths.iter().all(|[one, other]| ((-factor * one).exp() - (-other).exp()).abs() <= DIFFERENCE)
}

/// A table that tells which stored codes are visible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VisibleCodes {
    /// One bit per value code, or per pair of codes: the index is then the value's code times 256 plus the magnitude's.
    bits: Vec<u64>,
    by_magnitude: bool,
}

impl VisibleCodes {
    /// Collects the codes whose opacity with `transfer` is above 0 and at least `threshold`.
    ///
    /// # Errors
    /// [`Error::Input`] if opacity depends on gradient magnitudes and none are stored, if their scale is not valid, or if
    /// `threshold` is not from 0 to 1.
    pub fn new(
        transfer: &TransferFunction,
        channels: Channels,
        scales: &Scales,
        threshold: f64,
    ) -> Result<VisibleCodes> {
        if !(0.0..=1.0).contains(&threshold) {
            return Err(Error::input("opacity threshold", format!("is {threshold}, but must be from 0 to 1")));
        }
        let by_magnitude = transfer.uses_gradient();
        if by_magnitude && channels.magnitude_bits == 0 {
            let why = "needs gradient magnitudes, which this file does not store; build it again with this function";
            return Err(Error::input("transfer function", why));
        }
        let magnitudes: Vec<f64> = if by_magnitude {
            let codec = MagnitudeCodec::new(scales.magnitude_scale)?;
            (0..=255).map(|code| codec.decode(code)).collect()
        } else {
            vec![0.0]
        };
        Ok(VisibleCodes::of(channels, by_magnitude, |value, magnitude| {
            let opacity = stored_opacity(transfer, scales, value, magnitudes[usize::from(magnitude)]);
            opacity > 0.0 && opacity >= threshold
        }))
    }

    /// Collects the codes of values and magnitudes, or of values (with magnitude 0), that are `visible`.
    pub(crate) fn of(channels: Channels, by_magnitude: bool, visible: impl Fn(u16, u8) -> bool) -> VisibleCodes {
        let last_magnitude = if by_magnitude { u8::MAX } else { 0 };
        let (last, pairs) = (channels.last_value_code(), usize::from(last_magnitude) + 1);
        let bits = vec![0; ((usize::from(last) + 1) * pairs).div_ceil(64)];
        let mut codes = VisibleCodes { bits, by_magnitude };
        for value in 0..=last {
            for magnitude in (0..=last_magnitude).filter(|magnitude| visible(value, *magnitude)) {
                let place = codes.place(value, magnitude);
                codes.bits[place / 64] |= 1 << (place % 64);
            }
        }
        codes
    }

    /// Returns whether a voxel with these codes is visible.
    #[inline(always)]
    pub fn has(&self, value: u16, magnitude: u8) -> bool {
        let place = self.place(value, magnitude);
        self.bits.get(place / 64).is_some_and(|word| word >> (place % 64) & 1 == 1)
    }

    /// Returns a bit for each value code if they have 8 bits; `None` if they have 16, or visibility depends on magnitudes.
    pub(crate) fn of_bytes(&self) -> Option<&[u64; 4]> {
        self.bits.as_slice().try_into().ok()
    }

    /// Returns whether visibility depends on gradient magnitudes.
    pub(crate) fn by_magnitude(&self) -> bool {
        self.by_magnitude
    }

    fn place(&self, value: u16, magnitude: u8) -> usize {
        match self.by_magnitude {
            false => value.into(),
            true => usize::from(value) << 8 | usize::from(magnitude),
        }
    }
}
