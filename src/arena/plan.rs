//! The plan of a build: what is decided before the first slice is packed.
//!
//! In: a volume's header, what to build, and, where that is not enough, a survey of the samples. Out: [`Plan`]: the
//! transfer function with everything filled in that the volume decides, the codecs, and [`CodeTable`], which samples
//! may be visible.

use super::builder::{BuildOptions, Findings, Observer, Phase, go_on};
use super::layout::Channels;
use super::pack::Record;
use super::window::{Field, Window};
use crate::classify::quantise::Quantiser;
use crate::classify::{MagnitudeCodec, TransferFunction, gradient, normal};
use crate::error::{Error, Result};
use crate::volume::{Header, Sample, SampleType, Samples, SlabSource};
use crate::with_samples;

/// An opacity that one would miss.
const SEEN: f64 = 0.02;

/// What is decided before the first slice is packed.
pub(super) struct Plan {
    pub(super) transfer: TransferFunction,
    pub(super) channels: Channels,
    pub(super) quantiser: Quantiser,
    pub(super) magnitudes: MagnitudeCodec,
    pub(super) surveyed: bool,
}

impl Plan {
    pub(super) fn new(
        source: &mut dyn SlabSource,
        header: &Header,
        options: &BuildOptions,
        observer: &mut dyn Observer,
    ) -> Result<Plan> {
        let surveyed = options.needs_survey(header.sample_type);
        let (lowest, highest, largest) = if surveyed {
            let survey = survey(source, header, options.needs_largest_magnitude(), observer)?;
            source.rewind()?;
            if survey.lowest > survey.highest {
                return Err(nothing_visible(&survey.findings()));
            }
            (survey.lowest, survey.highest, survey.largest_magnitude)
        } else {
            let (low, high) = header.sample_type.integer_range().unwrap_or((f64::NEG_INFINITY, f64::INFINITY));
            let ends = [low * header.slope + header.intercept, high * header.slope + header.intercept];
            (ends[0].min(ends[1]), ends[0].max(ends[1]), None)
        };
        let grid = &header.grid;
        let uses_gradient = options.transfer.uses_gradient();
        // No difference is larger than the range over the spacing, on any axis.
        let steepest = grid.spacing.iter().map(|h| 1.0 / (h * h)).sum::<f64>().sqrt();
        let bound = if uses_gradient { ((highest - lowest) * steepest).min(f64::MAX) } else { 0.0 };
        let largest = largest.unwrap_or(bound);

        let mut transfer = options.transfer.clone().with_voxel_length(grid.mean_spacing())?;
        if largest > 0.0 {
            transfer = transfer.with_largest_magnitude(largest)?;
        }
        if lowest.is_finite() && highest.is_finite() {
            transfer = transfer.with_value_range(lowest, highest)?;
        }
        let domain = transfer.domain(largest);
        let (low, high) = (domain.0.max(lowest), domain.1.min(highest));
        if low > high {
            // The range of the type says little: only the samples' own tells the user what to ask for.
            let found = if surveyed {
                Findings { lowest, highest, not_finite: 0, surveyed, blurred_away: 0 }
            } else {
                survey(source, header, false, observer)?.findings()
            };
            return Err(nothing_visible(&found));
        }
        let quantiser = if transfer.is_labels() { Quantiser::for_labels } else { Quantiser::new };
        let quantiser = quantiser(low, high, options.value_bits, header.sample_type, header.slope, header.intercept)?;
        let channels = Channels {
            value_bits: options.value_bits,
            normal_bits: options.normal_bits,
            magnitude_bits: if uses_gradient { 8 } else { 0 },
        };
        let magnitudes = MagnitudeCodec::new(if uses_gradient { largest } else { 0.0 })?;
        Ok(Plan { transfer, channels, quantiser, magnitudes, surveyed })
    }

    pub(super) fn needs_gradients(&self) -> bool {
        self.channels.normal_bits > 0 || self.channels.magnitude_bits > 0
    }

    /// The record of a sample, if it is visible. `gradient`: of the field, where it is needed.
    #[inline]
    pub(super) fn record(&self, value: f64, code: u16, gradient: impl Fn() -> [f64; 3]) -> Option<Record> {
        let mut record = Record { value: code, normal: 0, magnitude: 0 };
        if self.needs_gradients() {
            let gradient = gradient();
            if self.channels.magnitude_bits > 0 {
                let magnitude = gradient::magnitude(gradient);
                if self.transfer.opacity(value, magnitude) <= 0.0 {
                    return None;
                }
                record.magnitude = self.magnitudes.encode(magnitude);
            }
            record.normal = match self.channels.normal_bits {
                0 => 0,
                8 => normal::encode8(gradient).into(),
                _ => normal::encode16(gradient),
            };
        }
        Some(record)
    }

    /// Whether a voxel that can be seen is stored under a code whose value is transparent.
    #[inline]
    pub(super) fn blurs_away(&self, value: f64, record: Record) -> bool {
        if self.quantiser.is_lossless() {
            return false;
        }
        let magnitude = self.magnitudes.decode(record.magnitude);
        let opacity = |value| self.transfer.opacity(value, magnitude);
        opacity(value) >= SEEN && opacity(self.quantiser.decode(record.value)) == 0.0
    }

    /// The code of a value that may be visible, depending on its gradient.
    fn candidate(&self, value: f64, domain: (f64, f64)) -> Option<u16> {
        if !(value >= domain.0 && value <= domain.1) {
            return None;
        }
        let visible = self.channels.magnitude_bits > 0 || self.transfer.opacity(value, 0.0) > 0.0;
        visible.then(|| self.quantiser.encode(value))
    }
}

pub(super) fn nothing_visible(findings: &Findings) -> Error {
    let Findings { lowest, highest, not_finite, .. } = *findings;
    if lowest > highest {
        return Error::input("nothing is visible", format!("none of the samples is a number ({not_finite} are not)"));
    }
    let middle = (lowest / 2.0 + highest / 2.0).clamp(lowest, highest);
    let why = format!("the samples run from {lowest} to {highest}; try --range {middle}..{highest}");
    Error::input("nothing is visible", why)
}

/// The result of a first pass.
struct Survey {
    lowest: f64,
    highest: f64,
    not_finite: u64,
    largest_magnitude: Option<f64>,
}

impl Survey {
    fn findings(&self) -> Findings {
        Findings {
            lowest: self.lowest,
            highest: self.highest,
            not_finite: self.not_finite,
            surveyed: true,
            blurred_away: 0,
        }
    }
}

fn survey(
    source: &mut dyn SlabSource,
    header: &Header,
    gradients: bool,
    observer: &mut dyn Observer,
) -> Result<Survey> {
    let mut tally = Tally::default();
    let mut largest = 0.0f64;
    let [width, height, depth] = header.grid.dims.map(|d| d as usize);
    let mut slices = Window::new(source, header, if gradients { Field::Values } else { Field::None }, None)?;
    for z in 0..depth {
        go_on(observer, Phase::Survey, z as u64, depth as u64)?;
        slices.advance()?;
        tally.add(slices.samples(), header);
        if let Some(hood) = slices.neighbourhood() {
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                largest = largest.max(gradient::magnitude(hood.gradient(x, y)));
            }
        }
    }
    let Tally { lowest, highest, not_finite } = tally;
    Ok(Survey { lowest, highest, not_finite, largest_magnitude: gradients.then_some(largest) })
}

/// Which samples may be visible, and their codes; by table for samples of 8 and 16 bits.
pub(super) struct CodeTable {
    /// Code + 1 by the sample's bits, 0 where it is invisible; empty for wider samples.
    table: Vec<u32>,
    slope: f64,
    intercept: f64,
    domain: (f64, f64),
}

impl CodeTable {
    pub(super) fn new(header: &Header, plan: &Plan, domain: (f64, f64)) -> CodeTable {
        let mut codes = CodeTable { table: Vec::new(), slope: header.slope, intercept: header.intercept, domain };
        let signed = matches!(header.sample_type, SampleType::I8 | SampleType::I16);
        let bits = 8 * header.sample_type.bytes();
        if bits <= 16 {
            let count = 1i32 << bits;
            let number = |index: i32| if signed && index >= count / 2 { index - count } else { index };
            let code = |index| plan.candidate(codes.scaled(f64::from(number(index))), domain);
            codes.table = (0..count).map(|index| code(index).map_or(0, |code| u32::from(code) + 1)).collect();
        }
        codes
    }

    #[inline(always)]
    fn scaled(&self, raw: f64) -> f64 {
        raw * self.slope + self.intercept
    }

    #[inline(always)]
    pub(super) fn value<T: Sample>(&self, sample: T) -> f64 {
        self.scaled(sample.to_f64())
    }

    #[inline(always)]
    pub(super) fn code<T: Sample>(&self, sample: T, plan: &Plan) -> Option<u16> {
        match sample.small_bits() {
            Some(bits) => {
                let entry = self.table[bits];
                #[allow(clippy::cast_possible_truncation, reason = "the table holds codes + 1, at most 65,536")]
                (entry != 0).then(|| (entry - 1) as u16)
            }
            None => plan.candidate(self.value(sample), self.domain),
        }
    }
}

/// Range and count of what is not a number, over slices.
pub(super) struct Tally {
    pub(super) lowest: f64,
    pub(super) highest: f64,
    pub(super) not_finite: u64,
}

impl Default for Tally {
    fn default() -> Tally {
        Tally { lowest: f64::INFINITY, highest: f64::NEG_INFINITY, not_finite: 0 }
    }
}

impl Tally {
    pub(super) fn add(&mut self, samples: &Samples, header: &Header) {
        let (ends, not_finite) = with_samples!(samples, samples => range_of(samples));
        self.not_finite += not_finite;
        for raw in ends.into_iter().flatten() {
            let value = raw * header.slope + header.intercept;
            self.lowest = self.lowest.min(value);
            self.highest = self.highest.max(value);
        }
    }
}

/// Lowest and highest finite sample, and how many are not finite.
fn range_of<T: Sample>(samples: &[T]) -> (Option<[f64; 2]>, u64) {
    if T::TYPE.integer_range().is_some() {
        let ends = samples.iter().copied().fold(None, |ends, s| match ends {
            None => Some((s, s)),
            Some((low, high)) => Some((if s < low { s } else { low }, if s > high { s } else { high })),
        });
        return (ends.map(|(low, high)| [low.to_f64(), high.to_f64()]), 0);
    }
    let (mut low, mut high, mut not_finite) = (f64::INFINITY, f64::NEG_INFINITY, 0);
    for value in samples.iter().map(|s| s.to_f64()) {
        if value.is_finite() {
            (low, high) = (low.min(value), high.max(value));
        } else {
            not_finite += 1;
        }
    }
    ((low <= high).then_some([low, high]), not_finite)
}
