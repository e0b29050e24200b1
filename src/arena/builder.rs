//! The builder: from a volume to lanes.
//!
//! In: a [`SlabSource`] and a [`TransferFunction`]. Out: the lanes of its visible voxels and what their codes mean.
//! Slices stream through once: a voxel is visible where its opacity is above 0; its value is quantised over the
//! visible range, its normal is the gradient's direction. The x lane is packed as slices come, the others are
//! transposed from it. The result depends on the input and the options alone.
//!
//! A first pass over the samples (a survey) is made only where the visible range or the largest gradient is not
//! known without it: [`BuildOptions::needs_survey`].

use std::collections::VecDeque;
use std::ops::ControlFlow;

use super::curve::TileOrder;
use super::lane::OwnedLane;
use super::layout::{Channels, Facts, Scales};
use super::pack::{LanePacker, Record};
use super::transpose::transpose;
use crate::classify::quantise::Quantiser;
use crate::classify::smooth::Smoother;
use crate::classify::{MagnitudeCodec, Neighbourhood, TransferFunction, gradient, normal};
use crate::error::{Error, Result};
use crate::volume::{Axis, Grid, Header, Sample, SampleType, Samples, SlabSource};
use crate::with_samples;

/// What to build.
#[derive(Debug, Clone)]
pub struct BuildOptions {
    /// Which samples are visible, and whether their opacity needs the gradient's magnitude.
    pub transfer: TransferFunction,
    /// 1: x. 2: x and y. 3: x, y and z, so that no view needs a lane that is not there.
    pub lane_count: u8,
    /// Order of the tiles in memory.
    pub tile_order: TileOrder,
    /// Bits of a value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each component of a normal: 0 for none, 8 or 16.
    pub normal_bits: u8,
}

/// What a build is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading the samples for their range.
    Survey,
    /// Reading, classifying and packing.
    Pack,
    /// Making the lane along this axis.
    Transpose(Axis),
}

/// Told of a build's progress, and may stop it.
pub trait Observer {
    /// `done` of `total` slices (or lanes) are behind. `Break` stops the build with [`Error::Interrupted`].
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()>;
}

/// An observer that lets a build run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unobserved;

impl Observer for Unobserved {
    fn progress(&mut self, _phase: Phase, _done: u64, _total: u64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// What was found in the samples on the way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Findings {
    /// Lowest finite sample, in its own unit; +infinity if there is none.
    pub lowest: f64,
    /// Highest finite sample, in its own unit; -infinity if there is none.
    pub highest: f64,
    /// Samples that are NaN or infinite: transparent.
    pub not_finite: u64,
    /// Whether the samples were read twice.
    pub surveyed: bool,
}

/// Lanes in memory and what they mean.
#[derive(Debug, Clone)]
pub struct Built {
    /// The header's part.
    pub facts: Facts,
    /// Along x, then y, then z, as many as asked for.
    pub lanes: Vec<OwnedLane>,
    /// The transfer function with everything filled in that the volume decides.
    pub transfer: TransferFunction,
    /// Of the samples.
    pub findings: Findings,
}

/// Builds the lanes of `source`, which must be at its first slice.
///
/// # Errors
/// [`Error::Input`] if an option is out of range or nothing is visible; [`Error::Interrupted`] if the observer says
/// so; and what reading the source gives.
pub fn build(source: &mut dyn SlabSource, options: &BuildOptions, observer: &mut dyn Observer) -> Result<Built> {
    options.check()?;
    let header = source.header().clone();
    header.grid.check()?;
    let plan = Plan::new(source, &header, options, observer)?;
    let mut packer = LanePacker::new(Axis::X, header.grid.dims, plan.channels, options.tile_order);
    let findings = pack(source, &header, &plan, &mut packer, observer)?;
    if packer.visible() == 0 {
        return Err(nothing_visible(&findings));
    }
    let visible_voxels = packer.visible();
    let mut lanes = vec![packer.finish()];
    for axis in [Axis::Y, Axis::Z].into_iter().take(usize::from(options.lane_count) - 1) {
        go_on(observer, Phase::Transpose(axis), axis.index() as u64 - 1, options.lane_count.into())?;
        lanes.push(transpose(&lanes[0].view(), axis, options.tile_order));
    }
    let facts = Facts {
        grid: header.grid,
        channels: plan.channels,
        tile_order: options.tile_order,
        scales: Scales {
            value_low: plan.quantiser.low(),
            value_step: plan.quantiser.step(),
            magnitude_scale: plan.magnitudes.largest(),
        },
        visible_voxels,
    };
    let findings = Findings { surveyed: plan.surveyed, ..findings };
    Ok(Built { facts, lanes, transfer: plan.transfer, findings })
}

impl BuildOptions {
    fn check(&self) -> Result<()> {
        if !(1..=3).contains(&self.lane_count) {
            return Err(Error::input("lanes", "must be x, xy or xyz"));
        }
        for (what, bits, choices) in
            [("value bits", self.value_bits, &[8, 16][..]), ("normal bits", self.normal_bits, &[0, 8, 16])]
        {
            if !choices.contains(&bits) {
                return Err(Error::input(what, format!("are {bits}, but must be one of {choices:?}")));
            }
        }
        Ok(())
    }

    /// Whether a volume of `sample_type` must be read once before it is built.
    ///
    /// Samples of 8 bits never (but for region boundaries): all their values have codes. Others if the visible range
    /// is open at an end, or if the opacity depends on the gradient, whose largest magnitude is not known.
    pub fn needs_survey(&self, sample_type: SampleType) -> bool {
        let (low, high) = self.transfer.domain(f64::INFINITY);
        let open = low == f64::NEG_INFINITY || high == f64::INFINITY;
        self.needs_largest_magnitude() || (sample_type.bytes() > 1 && (open || self.transfer.uses_gradient()))
    }

    /// Whether the transfer function is relative to the largest gradient of the data.
    fn needs_largest_magnitude(&self) -> bool {
        self.transfer.clone().with_largest_magnitude(2.0).is_ok_and(|filled| filled != self.transfer)
    }
}

fn go_on(observer: &mut dyn Observer, phase: Phase, done: u64, total: u64) -> Result<()> {
    match observer.progress(phase, done, total) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Interrupted),
    }
}

/// What is decided before the first slice is packed.
struct Plan {
    transfer: TransferFunction,
    channels: Channels,
    quantiser: Quantiser,
    magnitudes: MagnitudeCodec,
    surveyed: bool,
}

impl Plan {
    fn new(
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

        let mut transfer = options.transfer.clone().with_voxel_length(voxel_length(grid))?;
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
                Findings { lowest, highest, not_finite: 0, surveyed }
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

    fn needs_gradients(&self) -> bool {
        self.channels.normal_bits > 0 || self.channels.magnitude_bits > 0
    }

    /// The record of a sample, if it is visible. `gradient`: of the field, where it is needed.
    #[inline]
    fn record(&self, value: f64, code: u16, gradient: impl Fn() -> [f64; 3]) -> Option<Record> {
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

    /// The code of a value that may be visible, depending on its gradient.
    fn candidate(&self, value: f64, domain: (f64, f64)) -> Option<u16> {
        if !(value >= domain.0 && value <= domain.1) {
            return None;
        }
        let visible = self.channels.magnitude_bits > 0 || self.transfer.opacity(value, 0.0) > 0.0;
        visible.then(|| self.quantiser.encode(value))
    }
}

/// Geometric mean of the spacings.
pub fn voxel_length(grid: &Grid) -> f64 {
    // By logarithms: the product of three tiny or huge spacings leaves the range of numbers.
    (grid.spacing.iter().map(|h| h.ln()).sum::<f64>() / 3.0).exp()
}

fn nothing_visible(findings: &Findings) -> Error {
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
        Findings { lowest: self.lowest, highest: self.highest, not_finite: self.not_finite, surveyed: true }
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
    let mut slices = Slices::new(source, header, if gradients { Field::Values } else { Field::None }, None)?;
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

fn pack(
    source: &mut dyn SlabSource,
    header: &Header,
    plan: &Plan,
    packer: &mut LanePacker,
    observer: &mut dyn Observer,
) -> Result<Findings> {
    let field = match (plan.needs_gradients(), plan.transfer.is_labels()) {
        (false, _) => Field::None,
        (true, false) => Field::Values,
        (true, true) => Field::Visibility,
    };
    let depth = header.grid.dims[2];
    let mut tally = Tally::default();
    let mut slices = Slices::new(source, header, field, Some(&plan.transfer))?;
    let domain = (plan.quantiser.low(), plan.quantiser.high());
    let codes = CodeTable::new(header, plan, domain);
    for z in 0..depth {
        go_on(observer, Phase::Pack, z.into(), depth.into())?;
        slices.advance()?;
        tally.add(slices.samples(), header);
        let hood = slices.neighbourhood();
        let z = u16::try_from(z).expect("a grid has at most 65,535 slices");
        with_samples!(slices.samples(), samples => {
            pack_slice(samples, z, header, plan, &codes, hood.as_ref(), packer);
        });
    }
    let Tally { lowest, highest, not_finite } = tally;
    Ok(Findings { lowest, highest, not_finite, surveyed: false })
}

fn pack_slice<T: Sample>(
    samples: &[T],
    z: u16,
    header: &Header,
    plan: &Plan,
    codes: &CodeTable,
    hood: Option<&Neighbourhood>,
    packer: &mut LanePacker,
) {
    let width = header.grid.dims[0] as usize;
    for (y, row) in (0u16..).zip(samples.chunks_exact(width)) {
        let voxels = row.iter().enumerate().filter_map(|(x, &sample)| {
            let code = codes.code(sample, plan)?;
            let value = codes.value(sample);
            let gradient = || hood.map_or([0.0; 3], |hood| hood.gradient(x, usize::from(y)));
            let record = plan.record(value, code, gradient)?;
            Some((u16::try_from(x).expect("a row has at most 65,535 samples"), record))
        });
        packer.line(y, z, voxels);
    }
}

/// Which samples may be visible, and their codes; by table for samples of 8 and 16 bits.
struct CodeTable {
    /// Code + 1 by the sample's bits, 0 where it is invisible; empty for wider samples.
    table: Vec<u32>,
    slope: f64,
    intercept: f64,
    domain: (f64, f64),
}

impl CodeTable {
    fn new(header: &Header, plan: &Plan, domain: (f64, f64)) -> CodeTable {
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
    fn value<T: Sample>(&self, sample: T) -> f64 {
        self.scaled(sample.to_f64())
    }

    #[inline(always)]
    fn code<T: Sample>(&self, sample: T, plan: &Plan) -> Option<u16> {
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
struct Tally {
    lowest: f64,
    highest: f64,
    not_finite: u64,
}

impl Default for Tally {
    fn default() -> Tally {
        Tally { lowest: f64::INFINITY, highest: f64::NEG_INFINITY, not_finite: 0 }
    }
}

impl Tally {
    fn add(&mut self, samples: &Samples, header: &Header) {
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

/// What gradients are taken of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Field {
    /// None are taken.
    None,
    /// The samples' values.
    Values,
    /// Whether a voxel is visible, smoothed: label maps.
    Visibility,
}

/// A slice and its neighbours, moving up the volume.
struct Slices<'a> {
    source: &'a mut dyn SlabSource,
    header: &'a Header,
    field: Field,
    transfer: Option<&'a TransferFunction>,
    smoother: Option<Smoother>,
    /// Slices read so far, and the index of the current one.
    read: u32,
    current: Option<u32>,
    /// Samples from the current slice on.
    samples: VecDeque<Samples>,
    /// Fields from the slice before the current one on; `first_field` is the first one's slice.
    fields: VecDeque<Vec<f32>>,
    first_field: u32,
    spare_samples: Vec<Samples>,
    spare_fields: Vec<Vec<f32>>,
    slice_len: usize,
}

impl<'a> Slices<'a> {
    fn new(
        source: &'a mut dyn SlabSource,
        header: &'a Header,
        field: Field,
        transfer: Option<&'a TransferFunction>,
    ) -> Result<Slices<'a>> {
        // The first slice shows whether there is memory for one at all.
        let spare_samples = vec![header.new_slice()?];
        let slice_len = spare_samples[0].len();
        let [width, height, _] = header.grid.dims.map(|d| d as usize);
        Ok(Slices {
            source,
            header,
            field,
            transfer,
            smoother: (field == Field::Visibility).then(|| Smoother::new([width, height])),
            read: 0,
            current: None,
            samples: VecDeque::new(),
            fields: VecDeque::new(),
            first_field: 0,
            spare_samples,
            spare_fields: Vec::new(),
            slice_len,
        })
    }

    /// Moves to the next slice.
    fn advance(&mut self) -> Result<()> {
        let next = self.current.map_or(0, |z| z + 1);
        if self.current.is_some() {
            self.spare_samples.extend(self.samples.pop_front());
        }
        if next >= 2 && self.field != Field::None {
            self.spare_fields.extend(self.fields.pop_front());
            self.first_field += 1;
        }
        self.current = Some(next);
        let depth = self.header.grid.dims[2];
        let fields_end = |this: &Self| this.first_field + u32::try_from(this.fields.len()).unwrap_or(u32::MAX);
        while self.samples.is_empty() || (self.field != Field::None && fields_end(self) < (next + 2).min(depth)) {
            if self.read < depth {
                self.read_slice()?;
            } else {
                self.drain_smoother()?;
            }
        }
        Ok(())
    }

    fn read_slice(&mut self) -> Result<()> {
        let mut samples = match self.spare_samples.pop() {
            Some(samples) => samples,
            None => self.header.new_slice()?,
        };
        self.source.read_slice(&mut samples)?;
        self.read += 1;
        if self.field != Field::None {
            let mut field = self.field()?;
            let (slope, intercept) = (self.header.slope, self.header.intercept);
            match (self.field, self.transfer) {
                (Field::Visibility, Some(transfer)) => {
                    let visible = |raw: f64| transfer.opacity(raw * slope + intercept, 0.0) > 0.0;
                    with_samples!(&samples, samples => fill_visibility(samples, &mut field, visible));
                }
                _ => with_samples!(&samples, samples => fill_values(samples, &mut field, slope, intercept)),
            }
            let spare = self.spare_fields.pop();
            match &mut self.smoother {
                Some(smoother) => {
                    let mut smoothed = spare.map_or_else(|| new_field(self.slice_len), Ok)?;
                    if smoother.push(&field, &mut smoothed) {
                        self.fields.push_back(smoothed);
                    } else {
                        self.spare_fields.push(smoothed);
                    }
                    self.spare_fields.push(field);
                }
                None => {
                    self.spare_fields.extend(spare);
                    self.fields.push_back(field);
                }
            }
        }
        self.samples.push_back(samples);
        Ok(())
    }

    /// A field to fill.
    fn field(&mut self) -> Result<Vec<f32>> {
        self.spare_fields.pop().map_or_else(|| new_field(self.slice_len), Ok)
    }

    fn drain_smoother(&mut self) -> Result<()> {
        let mut smoothed = self.field()?;
        let given = self.smoother.as_mut().is_some_and(|smoother| smoother.finish(&mut smoothed));
        assert!(given, "a smoother gives as many slices as it takes");
        self.fields.push_back(smoothed);
        Ok(())
    }

    /// The current slice.
    fn samples(&self) -> &Samples {
        self.samples.front().expect("advance was called")
    }

    /// The current slice's field among its neighbours'; `None` without a field.
    fn neighbourhood(&self) -> Option<Neighbourhood<'_>> {
        let z = self.current?;
        let slice = |z: u32| self.fields.get(z.checked_sub(self.first_field)? as usize).map(Vec::as_slice);
        let [width, height, _] = self.header.grid.dims.map(|d| d as usize);
        let below = z.checked_sub(1).and_then(slice);
        Some(Neighbourhood::new(below, slice(z)?, slice(z + 1), [width, height], self.header.grid.spacing))
    }
}

fn new_field(len: usize) -> Result<Vec<f32>> {
    let mut field = Vec::new();
    let refused = |_| Error::Limit { what: "a slice for gradients".into(), need: 4 * len as u64, have: 0 };
    field.try_reserve_exact(len).map_err(refused)?;
    field.resize(len, 0.0);
    Ok(field)
}

fn fill_values<T: Sample>(samples: &[T], field: &mut [f32], slope: f64, intercept: f64) {
    if slope == 1.0 && intercept == 0.0 {
        field.iter_mut().zip(samples).for_each(|(f, s)| *f = s.to_f32());
    } else {
        #[allow(clippy::cast_possible_truncation, reason = "gradients are taken of single-precision fields")]
        field.iter_mut().zip(samples).for_each(|(f, s)| *f = (s.to_f64() * slope + intercept) as f32);
    }
}

fn fill_visibility<T: Sample>(samples: &[T], field: &mut [f32], visible: impl Fn(f64) -> bool) {
    // Labels come in runs: look each run's first one up.
    let mut last = None;
    for (f, &sample) in field.iter_mut().zip(samples) {
        if last.is_none_or(|(label, _)| label != sample) {
            last = Some((sample, if visible(sample.to_f64()) { 1.0 } else { 0.0 }));
        }
        *f = last.map_or(0.0, |(_, indicator)| indicator);
    }
}
