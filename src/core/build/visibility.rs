//! The visibility test: tells which samples may be visible; it is built before the first sample is read.
//!
//! In: a transfer function and a volume's header. Out: a table or formula that accepts or refuses a sample. If opacity
//! depends on the gradient, accepted samples are tested again with their gradient magnitude.

use super::options::BuildOptions;
use super::summary::UnnamedLabels;
use crate::classify::TransferFunction;
use crate::error::Result;
use crate::volume::{Header, Sample, SampleType};

pub(super) struct VisibilityTest {
    transfer: TransferFunction,
    uses_gradient: bool,
    domain: (f64, f64),
    slope: f64,
    intercept: f64,
    /// Whether a sample is a label that the palette does not name, indexed by the sample's bits; empty for samples of more
    /// than 16 bits, and for functions that are no palette.
    unnamed: Vec<bool>,
    /// Whether a sample may be visible, indexed by the sample's bits; empty for samples of more than 16 bits.
    table: Vec<bool>,
    /// The lowest and highest accepted sample; `None` if there is none or the table is empty.
    ends: Option<[f64; 2]>,
}

impl VisibilityTest {
    /// Creates the test. `largest_magnitude` is set if a first reading of the volume has found it.
    pub(super) fn new(
        header: &Header,
        options: &BuildOptions,
        largest_magnitude: Option<f64>,
    ) -> Result<VisibilityTest> {
        let mut transfer = options.transfer.clone().with_voxel_length(header.grid.mean_spacing())?;
        if let Some(largest) = largest_magnitude.filter(|&largest| largest > 0.0) {
            transfer = transfer.with_largest_magnitude(largest)?;
        }
        let mut test = VisibilityTest {
            uses_gradient: transfer.uses_gradient(),
            domain: transfer.domain(f64::INFINITY),
            transfer,
            slope: header.slope,
            intercept: header.intercept,
            unnamed: Vec::new(),
            table: Vec::new(),
            ends: None,
        };
        if test.transfer.is_labels() {
            test.unnamed = tabulated(header.sample_type, |sample| test.unnamed_label(sample).is_some());
        }
        let mut ends: Option<[f64; 2]> = None;
        test.table = tabulated(header.sample_type, |sample| {
            let accepted = test.may_be_visible(sample * test.slope + test.intercept);
            if accepted {
                ends = Some([ends.map_or(sample, |[low, _]| low), sample]);
            }
            accepted
        });
        test.ends = ends;
        Ok(test)
    }

    fn may_be_visible(&self, value: f64) -> bool {
        let inside = value.is_finite() && value >= self.domain.0 && value <= self.domain.1;
        inside && (self.uses_gradient || self.transfer.opacity(value, 0.0) > 0.0)
    }

    fn unnamed_label(&self, sample: f64) -> Option<i64> {
        self.transfer.unnamed_label(sample * self.slope + self.intercept)
    }

    /// Adds those of `samples` that are labels without a name in the palette. Does nothing for other functions.
    pub(super) fn add_unnamed<T: Sample>(&self, samples: &[T], unnamed: &mut UnnamedLabels) {
        if !self.transfer.is_labels() {
            return;
        }
        for run in samples.chunk_by(|a, b| a == b) {
            if run[0].small_bits().is_none_or(|bits| self.unnamed[bits])
                && let Some(label) = self.unnamed_label(run[0].to_f64())
            {
                unnamed.add(label, run.len() as u64);
            }
        }
    }

    #[inline(always)]
    pub(super) fn value<T: Sample>(&self, sample: T) -> f64 {
        sample.to_f64() * self.slope + self.intercept
    }

    #[inline(always)]
    pub(super) fn passes<T: Sample>(&self, sample: T) -> bool {
        match sample.small_bits() {
            Some(bits) => self.table[bits],
            None => self.may_be_visible(self.value(sample)),
        }
    }

    /// Returns whether an accepted sample is visible, given its gradient magnitude.
    #[inline]
    pub(super) fn is_visible(&self, value: f64, magnitude: f64) -> bool {
        self.transfer.opacity(value, magnitude) > 0.0
    }

    /// Returns whether the volume's faces show the cut of a body of this value.
    #[inline]
    pub(super) fn shows_cut(&self, value: f64) -> bool {
        self.transfer.shows_cut(value)
    }

    /// Returns whether cuts are capped surfaces, which are as opaque as the surface.
    pub(super) fn is_capped(&self) -> bool {
        self.transfer.cap().is_some()
    }

    /// Returns an inclusive range of samples that contains all accepted ones; `None` if no sample is accepted.
    pub(super) fn ends<T: Sample>(&self) -> Option<[T; 2]> {
        if !self.table.is_empty() {
            return Some(self.ends?.map(T::below));
        }
        // With slope and intercept, rounding would have to be bounded: then the range is that of the type.
        let raw = self.slope == 1.0 && self.intercept == 0.0;
        let [lowest, highest] = T::ENDS;
        let [low, high] = if raw { [T::below(self.domain.0), T::above(self.domain.1)] } else { T::ENDS };
        (low <= high).then_some([if low > lowest { low } else { lowest }, if high < highest { high } else { highest }])
    }
}

/// Returns `entry(sample)` for each sample of an 8-bit or 16-bit type, indexed by the sample's bits; empty for others.
///
/// The calls of `entry` come in ascending order of the samples.
pub(super) fn tabulated<E: Clone + Default>(sample_type: SampleType, mut entry: impl FnMut(f64) -> E) -> Vec<E> {
    let Some((lowest, highest)) = sample_type.integer_range().filter(|_| sample_type.bytes() <= 2) else {
        return Vec::new();
    };
    #[expect(clippy::cast_possible_truncation, reason = "whole numbers of at most 16 bits")]
    let (lowest, highest) = (lowest as i32, highest as i32);
    // All bits of the type are set: it keeps the low bits of a number.
    let largest = highest - lowest;
    let index = |number: i32| usize::try_from(number & largest).expect("0 to 65,535");
    let mut table = vec![E::default(); index(largest) + 1];
    for number in lowest..=highest {
        table[index(number)] = entry(number.into());
    }
    table
}
