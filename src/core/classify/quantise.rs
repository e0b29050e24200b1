//! Quantisation: stores values as codes of 8 or 16 bits, spread over the visible range only.
//!
//! If the samples are whole numbers, and the range holds few enough of them or of multiples of their common step, each
//! sample has its own code and is restored bit for bit. Otherwise codes are spread evenly: `low + code * step`.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::volume::SampleType;

/// Maps values to codes of 8 or 16 bits and back. Always valid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantiser {
    low: f64,
    high: f64,
    largest_code: u16,
    /// Distance between the values of neighbouring codes; 0 if there is one code only.
    step: f64,
    exact: Option<ExactCodes>,
}

/// The largest size of whole numbers that are all stored with every digit: 2^53.
const LARGEST: u64 = 1 << 53;

/// Whole numbers that occur in a volume, before slope and intercept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct WholeNumbers {
    /// The lowest one.
    pub lowest: i64,
    /// The highest one.
    pub highest: i64,
    /// The largest number of which all differences are multiples; 0 if there is one number only.
    pub step: u64,
}

impl WholeNumbers {
    /// Returns what one sample makes known; `None` if it is not whole, or too large for all its digits to be stored.
    #[inline]
    pub fn of(sample: f64) -> Option<WholeNumbers> {
        let is_whole = sample.fract() == 0.0 && sample.abs() <= LARGEST as f64;
        #[expect(clippy::cast_possible_truncation, reason = "saturates, and counts only if it is whole and below 2^53")]
        let number = sample as i64;
        is_whole.then_some(WholeNumbers { lowest: number, highest: number, step: 0 })
    }

    /// Returns what both make known.
    #[inline]
    pub fn and(self, other: WholeNumbers) -> WholeNumbers {
        let apart = self.lowest.abs_diff(other.lowest);
        let mut step = self.step;
        for part in [other.step, apart] {
            if step != 1 && part != 0 && (step == 0 || part % step != 0) {
                step = greatest_common_divisor(step, part);
            }
        }
        WholeNumbers { lowest: self.lowest.min(other.lowest), highest: self.highest.max(other.highest), step }
    }
}

fn greatest_common_divisor(mut a: u64, mut b: u64) -> u64 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// The codes of whole-number samples: one code for each multiple of a step. A sample's value is `raw * slope +
/// intercept`.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ExactCodes {
    /// The raw sample that code 0 stands for. Higher codes count upward, or downward if the slope is negative.
    raw: i64,
    /// Distance between the raw samples of neighbouring codes; above 0.
    raw_step: i64,
    slope: f64,
    intercept: f64,
}

impl Quantiser {
    /// Creates a quantiser for the values of `range`, both ends inclusive, with codes of 8 or 16 `bits`.
    ///
    /// `slope` and `intercept` are those of the volume's header. For whole-number samples the range may be infinite: it
    /// is then narrowed to the sample values inside it, or to its low end if there are none.
    ///
    /// # Errors
    /// [`Error::Input`] if `bits` is neither 8 nor 16, if slope or intercept is not finite or the slope is 0, if the
    /// range's low end is above its high end or one is NaN, or if the range is infinite for floating-point samples.
    pub fn new(range: [f64; 2], bits: u8, sample_type: SampleType, slope: f64, intercept: f64) -> Result<Quantiser> {
        let [low, high] = range;
        let largest_code = match bits {
            8 => 255,
            16 => u16::MAX,
            _ => return Err(Error::input("value bits", format!("are {bits}, but must be 8 or 16"))),
        };
        if low.is_nan() || high.is_nan() || low > high {
            return Err(Error::input("visible range", format!("is {low}..{high}; its low end must not be above")));
        }
        if !(slope.is_finite() && slope != 0.0 && intercept.is_finite()) {
            let why = format!("are {slope} and {intercept}, but must be finite and the slope not 0");
            return Err(Error::input("slope and intercept", why));
        }
        let Some(type_range) = sample_type.integer_range() else {
            return Quantiser::even(low, high, largest_code);
        };
        let Some((first, last)) = samples_inside(low, high, type_range, slope, intercept) else {
            let alone = if low.is_finite() { low } else { high };
            return Quantiser::even(alone, alone, largest_code);
        };
        let exact = ExactCodes { raw: first, raw_step: 1, slope, intercept };
        let all = WholeNumbers { lowest: first.min(last), highest: first.max(last), step: 1 };
        Quantiser::exact(all, bits, slope, intercept)
            .map_or_else(|| Quantiser::even(exact.value(0), exact.value_of(last), largest_code), Ok)
    }

    /// Creates a quantiser that restores `samples` bit for bit; `None` if they need more than `bits`, 8 or 16, or have a size above 2^53.
    ///
    /// `slope` and `intercept` are those of the volume's header; the slope is not 0.
    pub fn exact(samples: WholeNumbers, bits: u8, slope: f64, intercept: f64) -> Option<Quantiser> {
        let WholeNumbers { lowest, highest, step } = samples;
        if lowest.unsigned_abs().max(highest.unsigned_abs()) > LARGEST {
            return None;
        }
        let raw_step = i64::try_from(step.max(1)).ok()?;
        let codes = highest.abs_diff(lowest) / step.max(1);
        let largest_code = u16::try_from(codes).ok().filter(|&code| bits == 16 || code <= 255)?;
        let raw = if slope > 0.0 { lowest } else { highest };
        let exact = ExactCodes { raw, raw_step, slope, intercept };
        let step = if largest_code == 0 { 0.0 } else { slope.abs() * raw_step as f64 };
        let (low, high) = (exact.value(0), exact.value(largest_code));
        Some(Quantiser { low, high, largest_code, step, exact: Some(exact) })
    }

    /// Creates a quantiser for a label map, in which every label keeps its own code.
    ///
    /// # Errors
    /// The errors of [`Quantiser::new`]; [`Error::Input`] if the labels are not whole numbers or need more than `bits`.
    pub fn for_labels(
        range: [f64; 2],
        bits: u8,
        sample_type: SampleType,
        slope: f64,
        intercept: f64,
    ) -> Result<Quantiser> {
        let refused = |why: String| Err(Error::input("label map", why));
        if sample_type.integer_range().is_none() {
            return refused(format!("has {} samples; convert it to whole numbers", sample_type.name()));
        }
        let quantiser = Quantiser::new(range, bits, sample_type, slope, intercept)?;
        if quantiser.exact.is_some() || quantiser.low == quantiser.high {
            return Ok(quantiser);
        }
        let Quantiser { low, high, .. } = quantiser;
        let wide_enough = bits == 8
            && Quantiser::new([low, high], 16, sample_type, slope, intercept).is_ok_and(|wide| wide.exact.is_some());
        refused(if wide_enough {
            format!("has labels up to {high}, more than 8 bits tell apart; use 16-bit values")
        } else {
            format!("has labels up to {high}, more than 16 bits tell apart; renumber it or choose fewer")
        })
    }

    fn even(low: f64, high: f64, largest_code: u16) -> Result<Quantiser> {
        if !(low.is_finite() && high.is_finite()) {
            let why = format!("is {low}..{high}; give finite ends, such as the data's lowest and highest value");
            return Err(Error::input("visible range", why));
        }
        let largest_code = if low == high { 0 } else { largest_code };
        let mut step = if low == high { 0.0 } else { ratio(low, high, largest_code.into()) };
        // Readers compute a value from its code alone. No code may be beyond the range, where nothing is visible.
        while value_of_code(low, step, largest_code.into()) > high {
            step = step.next_down();
        }
        Ok(Quantiser { low, high, largest_code, step, exact: None })
    }

    /// Returns the code nearest to `value`, clamped to the range; 0 for NaN.
    #[inline]
    pub fn encode(&self, value: f64) -> u16 {
        let code = match &self.exact {
            Some(exact) => {
                let from_first = ((value - exact.intercept) / exact.slope - exact.raw as f64) / exact.raw_step as f64;
                if exact.slope > 0.0 { from_first } else { -from_first }
            }
            None if self.largest_code == 0 => 0.0,
            None if value <= self.low => 0.0,
            None => ratio(self.low, value, self.step),
        };
        // The cast saturates: negative numbers and NaN become 0.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the saturating cast is meant")]
        let code = (code + 0.5) as u16;
        code.min(self.largest_code)
    }

    /// Returns the value of `code`, always finite; codes above the largest count as the largest.
    #[inline]
    pub fn decode(&self, code: u16) -> f64 {
        let code = code.min(self.largest_code);
        match &self.exact {
            Some(exact) => exact.value(code),
            None if code == self.largest_code => self.high,
            None => {
                let value = self.low + f64::from(code) * self.step;
                // The product overflows only for ranges wider than the largest number.
                let share = f64::from(code) / f64::from(self.largest_code);
                if value.is_finite() { value.min(self.high) } else { self.low * (1.0 - share) + self.high * share }
            }
        }
    }

    /// Returns the value of code 0.
    pub fn low(&self) -> f64 {
        self.low
    }

    /// Returns the value of the largest code.
    pub fn high(&self) -> f64 {
        self.high
    }

    /// Returns the distance between the values of neighbouring codes; 0 if there is only one code.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Returns the largest code in use; below 2^bits.
    pub fn largest_code(&self) -> u16 {
        self.largest_code
    }

    /// Returns whether every sample inside the range is restored bit for bit.
    pub fn is_lossless(&self) -> bool {
        self.exact.is_some() || self.largest_code == 0
    }
}

impl ExactCodes {
    #[inline(always)]
    fn value(&self, code: u16) -> f64 {
        let steps = i64::from(code) * self.raw_step;
        self.value_of(if self.slope > 0.0 { self.raw + steps } else { self.raw - steps })
    }

    #[inline(always)]
    fn value_of(&self, raw: i64) -> f64 {
        raw as f64 * self.slope + self.intercept
    }
}

/// Returns the value that readers compute of `code`, which may be fractional; finite if the lowest and highest codes have finite values.
#[inline]
pub(crate) fn value_of_code(low: f64, step: f64, code: f64) -> f64 {
    let value = low + code * step;
    // The product may overflow although the value is finite.
    if value.is_finite() { value } else { (low / 2.0 + code * (step / 2.0)) * 2.0 }
}

/// Returns `(to - from) / by`, also where the difference would overflow.
fn ratio(from: f64, to: f64, by: f64) -> f64 {
    let span = to - from;
    if span.is_finite() { span / by } else { (to / 2.0 - from / 2.0) / by * 2.0 }
}

/// Returns the two raw samples in `range` whose values are the lowest and the highest inside `low..=high`.
fn samples_inside(low: f64, high: f64, range: (f64, f64), slope: f64, intercept: f64) -> Option<(i64, i64)> {
    let value = |raw: f64| raw * slope + intercept;
    let inside = |raw: f64| low <= value(raw) && value(raw) <= high;
    // The estimate may be off by rounding, so its neighbours are tested too.
    let end = |bound: f64, toward: f64| {
        let estimate = ((bound - intercept) / slope).clamp(range.0, range.1).round();
        let candidates = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|off| estimate + off * toward);
        candidates.into_iter().find(|raw| (range.0..=range.1).contains(raw) && inside(*raw))
    };
    #[expect(clippy::cast_possible_truncation, reason = "whole numbers of at most 32 bits")]
    Some((end(low, slope.signum())? as i64, end(high, -slope.signum())? as i64))
}
