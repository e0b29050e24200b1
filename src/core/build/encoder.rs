//! The encoding of visible voxels, which is decided once all samples have been read.
//!
//! In: the volume's header, the options, the samples' range. Out: [`VoxelEncoder`], with the completed transfer
//! function and the mapping of values and gradient magnitudes to codes.

use super::options::BuildOptions;
use super::summary::{FewValues, SampleSummary};
use super::visibility::tabulated;
use crate::arena::layout::{Channels, Scales};
use crate::arena::visible::NOTICEABLE_OPACITY;
use crate::classify::gradient::GridAxes;
use crate::classify::{MagnitudeCodec, Quantiser, TransferFunction};
use crate::error::{Error, Result};
use crate::volume::{Header, Sample, SampleType};

/// Maps samples and gradient magnitudes to stored codes.
pub(crate) struct VoxelEncoder {
    pub(crate) transfer: TransferFunction,
    pub(crate) channels: Channels,
    pub(crate) quantiser: Quantiser,
    pub(super) magnitudes: MagnitudeCodec,
    /// The code of the magnitude on a cap.
    cap_code: u8,
    /// The code of each sample, indexed by the sample's bits; empty for samples of more than 16 bits.
    table: Vec<u16>,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    sample_type: SampleType,
}

impl VoxelEncoder {
    /// Creates the encoder for values of `bits`. `samples` describes all samples; `largest_magnitude` is set if a first
    /// reading found it.
    pub(crate) fn new(
        header: &Header,
        options: &BuildOptions,
        bits: u8,
        samples: &SampleSummary,
        largest_magnitude: Option<f64>,
    ) -> Result<VoxelEncoder> {
        let (lowest, highest) = if options.needs_data_range(header.sample_type) {
            (samples.lowest, samples.highest)
        } else {
            let (low, high) = header.sample_type.integer_range().unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
            let ends = [low * header.slope + header.intercept, high * header.slope + header.intercept];
            (ends[0].min(ends[1]), ends[0].max(ends[1]))
        };
        let grid = &header.grid;
        let uses_gradient = options.transfer.uses_gradient();
        // A difference of two samples is at most their range: this bounds the gradient on all axes.
        let steepest = GridAxes::of(grid).largest_magnitude(grid.spacing.map(|h| 1.0 / h));
        let bound = if uses_gradient { ((highest - lowest) * steepest).min(f64::MAX) } else { 0.0 };
        let mut transfer = options.transfer.clone().with_voxel_length(grid.mean_spacing())?;
        let cap_magnitude = transfer.cap_magnitude(lowest, highest);
        let largest = largest_magnitude.unwrap_or(bound).max(cap_magnitude.unwrap_or(0.0));
        if largest > 0.0 {
            transfer = transfer.with_largest_magnitude(largest)?;
        }
        // Without the samples' range this is the range of their type, which says nothing about the data if it has more than 8 bits.
        let is_of_data = options.needs_data_range(header.sample_type) || header.sample_type.bytes() == 1;
        if is_of_data && lowest.is_finite() && highest.is_finite() {
            transfer = transfer.with_value_range(lowest, highest)?;
        }
        let domain = transfer.domain(largest);
        let range = [domain.0.max(lowest), domain.1.min(highest)];
        let (slope, intercept) = (header.slope, header.intercept);
        let quantiser = if transfer.is_labels() { Quantiser::for_labels } else { Quantiser::new };
        let quantiser = quantiser(range, bits, header.sample_type, slope, intercept)?;
        let magnitudes = MagnitudeCodec::new(if uses_gradient { largest } else { 0.0 })?;
        let channels = Channels { value_bits: bits, ..options.channels() };
        let cap_code = magnitudes.encode(cap_magnitude.unwrap_or(f64::INFINITY));
        let table = Vec::new();
        let sample_type = header.sample_type;
        let encoder =
            VoxelEncoder { transfer, channels, quantiser, magnitudes, cap_code, table, slope, intercept, sample_type };
        Ok(encoder.with_quantiser(quantiser))
    }

    /// Replaces the mapping of values to codes.
    pub(super) fn with_quantiser(self, quantiser: Quantiser) -> VoxelEncoder {
        let table = tabulated(self.sample_type, |sample| quantiser.encode(sample * self.slope + self.intercept));
        VoxelEncoder { quantiser, table, ..self }
    }

    /// Returns the scales for the file's header, which give codes their meaning.
    pub(crate) fn scales(&self) -> Scales {
        Scales {
            value_low: self.quantiser.low(),
            value_step: self.quantiser.step(),
            magnitude_scale: self.magnitudes.largest(),
        }
    }

    #[inline(always)]
    fn value<T: Sample>(&self, sample: T) -> f64 {
        sample.to_f64() * self.slope + self.intercept
    }

    /// Returns the code of a gradient magnitude, which is infinite on a cap.
    #[inline(always)]
    pub(super) fn magnitude_code(&self, magnitude: f64) -> u8 {
        if magnitude == f64::INFINITY { self.cap_code } else { self.magnitudes.encode(magnitude) }
    }

    #[inline(always)]
    pub(super) fn code<T: Sample>(&self, sample: T) -> u16 {
        match sample.small_bits() {
            Some(bits) => self.table[bits],
            None => self.quantiser.encode(self.value(sample)),
        }
    }

    /// Returns by how much a visible sample's value is rounded.
    pub(super) fn rounding<T: Sample>(&self, sample: T) -> f64 {
        (self.value(sample) - self.quantiser.decode(self.code(sample))).abs()
    }

    /// Returns whether a noticeable voxel would be stored under a code whose value is transparent.
    pub(super) fn blurs_away<T: Sample>(&self, sample: T, magnitude: u8) -> bool {
        let magnitude = self.magnitudes.decode(magnitude);
        let opacity = |value| self.transfer.opacity(value, magnitude);
        opacity(self.value(sample)) >= NOTICEABLE_OPACITY && opacity(self.quantiser.decode(self.code(sample))) == 0.0
    }

    /// Returns how many whole-number `samples` the `voxels` visible voxels have, if they may be labels and are rounded.
    pub(super) fn rounded_labels(&self, samples: &FewValues, voxels: u64) -> Option<u32> {
        /// Fewest voxels of a label, on average.
        const VOXELS: u64 = 8;
        // Even codes may meet values, but for rounding.
        let is_rounded = |&value: &f64| {
            (self.quantiser.decode(self.quantiser.encode(value)) - value).abs() > self.slope.abs() / 128.0
        };
        let values = samples.all()?.iter().map(|sample| sample * self.slope + self.intercept);
        let count = values.len() as u64;
        let found = voxels >= VOXELS * count && values.into_iter().any(|value| is_rounded(&value));
        found.then(|| u32::try_from(count).expect("they are few"))
    }
}

pub(crate) fn nothing_visible(samples: &SampleSummary) -> Error {
    let SampleSummary { lowest, highest, not_finite, unnamed, .. } = *samples;
    if unnamed.voxels > 0 {
        let why = format!("the palette names none of the labels, which run from {lowest} to {highest}; add them to it");
        return Error::input("nothing is visible", why);
    }
    if lowest > highest {
        return Error::input("nothing is visible", format!("none of the samples is a number ({not_finite} are not)"));
    }
    let middle = (lowest / 2.0 + highest / 2.0).clamp(lowest, highest);
    let why = format!("the samples run from {lowest} to {highest}; try the range {middle}..{highest}");
    Error::input("nothing is visible", why)
}
