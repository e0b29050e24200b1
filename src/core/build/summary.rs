//! Statistics of the samples that a build reads.

use serde::{Deserialize, Serialize};

use super::codes::CodeLoss;
use super::encoder::VoxelEncoder;
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
    /// Labels that the palette does not name, and which are therefore not drawn.
    pub unnamed: UnnamedLabels,
    /// Number of different visible values, if samples are whole numbers that are not stored exactly and have so few
    /// values (at most 256) that they may be labels.
    pub rounded_labels: Option<u32>,
}

/// Labels of a label map that the palette does not name. The label 0, the background, is none of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[non_exhaustive]
pub struct UnnamedLabels {
    /// Number of voxels with such a label.
    pub voxels: u64,
    /// The lowest of the labels, ascending; `None` fills up the end.
    pub lowest: [Option<i64>; 4],
}

impl UnnamedLabels {
    /// Adds `voxels` voxels with `label`.
    pub(super) fn add(&mut self, label: i64, voxels: u64) {
        self.voxels += voxels;
        let [.., last] = self.lowest;
        if self.lowest.contains(&Some(label)) || last.is_some_and(|last| last < label) {
            return;
        }
        let after = self.lowest.iter().position(|known| known.is_none_or(|known| known > label));
        if let Some(place) = after {
            self.lowest[place..].rotate_right(1);
            self.lowest[place] = Some(label);
        }
    }

    fn join(&mut self, other: &UnnamedLabels) {
        other.lowest.iter().flatten().for_each(|&label| self.add(label, 0));
        self.voxels = self.voxels.saturating_add(other.voxels);
    }
}

/// Most different values that are taken for labels.
const MOST_LABELS: usize = 256;

/// The different values of samples, as long as they are few.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct FewValues {
    /// In ascending order; empty if they are many.
    values: Vec<f64>,
    are_many: bool,
}

impl FewValues {
    /// Returns values that are too many to be kept.
    pub(super) fn many() -> FewValues {
        FewValues { values: Vec::new(), are_many: true }
    }

    pub(super) fn add(&mut self, value: f64) {
        if self.are_many {
            return;
        }
        if let Err(place) = self.values.binary_search_by(|known| known.total_cmp(&value)) {
            self.values.insert(place, value);
            if self.values.len() > MOST_LABELS {
                *self = FewValues::many();
            }
        }
    }

    pub(super) fn join(&mut self, other: &FewValues) {
        if other.are_many {
            *self = FewValues::many();
        }
        other.values.iter().for_each(|&value| self.add(value));
    }

    /// Returns all values in ascending order; `None` if they are many.
    pub(super) fn all(&self) -> Option<&[f64]> {
        (!self.are_many).then_some(&self.values)
    }
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
            unnamed: UnnamedLabels::default(),
            rounded_labels: None,
        }
    }
}

impl SampleSummary {
    /// Adds what the codes of `encoder` lose in the `voxels` visible voxels.
    pub(crate) fn with_loss(self, encoder: &VoxelEncoder, loss: &CodeLoss, voxels: u64) -> SampleSummary {
        SampleSummary {
            blurred_away: loss.blurred_away,
            rounding: loss.rounding,
            rounded_labels: encoder.rounded_labels(&loss.samples, voxels),
            ..self
        }
    }

    pub(crate) fn join(&mut self, other: &SampleSummary) {
        self.lowest = self.lowest.min(other.lowest);
        self.highest = self.highest.max(other.highest);
        self.not_finite = self.not_finite.saturating_add(other.not_finite);
        self.unnamed.join(&other.unnamed);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_unnamed_labels_are_kept_in_order_however_they_come() {
        let [mut a, mut b] = [UnnamedLabels::default(); 2];
        [9, 3, 9, 70].into_iter().for_each(|label| a.add(label, 2));
        [5, -4, 3, 1000].into_iter().for_each(|label| b.add(label, 1));
        a.join(&b);
        assert_eq!(a, UnnamedLabels { voxels: 12, lowest: [-4, 3, 5, 9].map(Some) });
    }

    #[test]
    fn values_count_as_few_up_to_their_most() {
        let mut values = FewValues::default();
        (0..512u32).for_each(|i| values.add(f64::from(i % 256)));
        assert_eq!(values.all().map(<[f64]>::len), Some(256));
        values.add(0.5);
        assert_eq!(values.all(), None);
    }

    #[test]
    fn values_of_bricks_are_few_only_if_their_union_is() {
        let brick = |from: u32, count: u32| {
            let mut values = FewValues::default();
            (from..from + count).for_each(|i| values.add(f64::from(i)));
            values
        };
        let count = |bricks: &[FewValues]| {
            let mut all = FewValues::default();
            bricks.iter().for_each(|brick| all.join(brick));
            all.all().map(<[f64]>::len)
        };
        assert_eq!(count(&[brick(0, 100), brick(50, 100), brick(0, 3)]), Some(150));
        assert_eq!(count(&[brick(0, 200), brick(100, 200)]), None);
        assert_eq!(count(&[brick(0, 239), brick(0, 300)]), None);
        assert_eq!(count(&[brick(0, 300), brick(0, 239)]), None);
    }
}
