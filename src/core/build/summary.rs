//! Statistics of the samples that a build reads.

use crate::volume::{Header, Sample};

/// Statistics of the samples that a build has read.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SampleSummary {
    /// Lowest finite value, in the samples' own unit; +infinity if there is none.
    pub lowest: f64,
    /// Highest finite value, in the samples' own unit; -infinity if there is none.
    pub highest: f64,
    /// Number of samples that are NaN or infinite, and therefore transparent.
    pub not_finite: u64,
    /// Whether the volume was read twice.
    pub surveyed: bool,
    /// Number of visible voxels that became transparent, because codes are too coarse for a narrow feature of the
    /// transfer function.
    pub blurred_away: u64,
    /// The most by which the stored value of a visible voxel differs from its own; 0 if all are stored exactly.
    pub rounding: f64,
}

impl Default for SampleSummary {
    fn default() -> SampleSummary {
        SampleSummary {
            lowest: f64::INFINITY,
            highest: f64::NEG_INFINITY,
            not_finite: 0,
            surveyed: false,
            blurred_away: 0,
            rounding: 0.0,
        }
    }
}

impl SampleSummary {
    pub(super) fn join(&mut self, other: &SampleSummary) {
        self.lowest = self.lowest.min(other.lowest);
        self.highest = self.highest.max(other.highest);
        self.not_finite += other.not_finite;
    }
}

/// Collects the range of the finite raw samples, and the number of samples that are not finite.
pub(super) struct RawRange<T> {
    ends: Option<[T; 2]>,
    not_finite: u64,
}

impl<T> Default for RawRange<T> {
    fn default() -> RawRange<T> {
        RawRange { ends: None, not_finite: 0 }
    }
}

impl<T: Sample> RawRange<T> {
    /// Adds samples and returns their own finite range; `None` if none is finite.
    #[inline(always)]
    pub(super) fn add(&mut self, block: &[T]) -> Option<[T; 2]> {
        let [lowest, highest] = T::ENDS;
        // Starting from the opposite ends keeps the loop free of branches; NaN compares false.
        let (mut low, mut high, mut finite) = (highest, lowest, 0u64);
        if T::TYPE.integer_range().is_some() {
            for &sample in block {
                low = if sample < low { sample } else { low };
                high = if sample > high { sample } else { high };
            }
            finite = block.len() as u64;
        } else {
            for &sample in block {
                let is_finite = sample >= lowest && sample <= highest;
                low = if is_finite && sample < low { sample } else { low };
                high = if is_finite && sample > high { sample } else { high };
                finite += u64::from(is_finite);
            }
            self.not_finite += block.len() as u64 - finite;
        }
        if finite == 0 {
            return None;
        }
        let [from, to] = self.ends.unwrap_or([low, high]);
        self.ends = Some([if low < from { low } else { from }, if high > to { high } else { to }]);
        Some([low, high])
    }

    pub(super) fn summary(&self, header: &Header) -> SampleSummary {
        let mut summary = SampleSummary { not_finite: self.not_finite, ..SampleSummary::default() };
        for raw in self.ends.into_iter().flatten() {
            let value = raw.to_f64() * header.slope + header.intercept;
            summary.lowest = summary.lowest.min(value);
            summary.highest = summary.highest.max(value);
        }
        summary
    }
}
