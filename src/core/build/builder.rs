//! The builder: from a volume to its visible voxels.
//!
//! In: a [`SlabSource`] and a [`TransferFunction`]. Out: the rows of its visible voxels and what their codes mean, from
//! which lanes are [assembled](super::assemble). A voxel is visible where its opacity is above 0; its value is
//! quantised over the visible range, its normal is the gradient's direction. The result depends on the input and the
//! options alone, not on memory or threads.
//!
//! Slices stream through once. They are swept a second time, and that first, only where what is visible depends on the
//! largest gradient of the data: [`BuildOptions::needs_survey`].

use std::ops::ControlFlow;
use std::path::PathBuf;

use super::assemble::Assembler;
use super::budget::Budget;
use super::plan::{Plan, nothing_visible};
use super::sieve::Sieve;
use super::spill::{GROUP_ROWS, RowArrays, Spill, SpilledRows, SpilledVolume};
use super::store::Store;
use super::sweep::{Field, Piece, Resident, sweep};
use crate::arena::curve::TileOrder;
use crate::arena::lane::OwnedLane;
use crate::arena::layout::{Channels, Facts};
use crate::classify::{TransferFunction, gradient, normal};
use crate::error::{Error, Result};
use crate::parallel::in_order;
use crate::volume::{Axis, Header, Sample, SampleType, SlabSource};
use crate::with_sample_type;

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

/// What a build may take.
#[derive(Debug, Clone, Default)]
pub struct Resources {
    /// Bytes of memory that the process may take at most; `None` for no limit.
    pub memory: Option<u64>,
    /// Threads that work; 0 counts as 1. With more than one, another reads ahead where memory allows.
    pub threads: usize,
    /// Folder for a temporary file, where visible voxels go that do not fit the memory; `None` to hold all.
    pub folder: Option<PathBuf>,
}

/// What a build is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Reading the samples for their range.
    Survey,
    /// Reading, classifying and packing.
    Pack,
    /// Making the lane along this axis.
    Assemble(Axis),
    /// Waiting for the disk to have it all.
    Flush,
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
    /// Visible voxels whose code stands for a value that is transparent: too few bits for the transfer function's
    /// narrow features.
    pub blurred_away: u64,
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

/// A volume's visible voxels and what they mean.
pub struct Classified {
    /// The header's part.
    pub facts: Facts,
    /// The visible voxels.
    pub rows: SpilledVolume,
    /// The transfer function with everything filled in that the volume decides.
    pub transfer: TransferFunction,
    /// Of the samples.
    pub findings: Findings,
}

/// Builds the lanes of `source`, which must be at its first slice, in memory and on one thread.
///
/// # Errors
/// As [`classify`].
pub fn build(source: &mut dyn SlabSource, options: &BuildOptions, observer: &mut dyn Observer) -> Result<Built> {
    let classified = classify(source, options, &Resources::default(), observer)?;
    let lanes = classified.lanes(options.lane_count, 1, observer)?;
    let Classified { facts, transfer, findings, .. } = classified;
    Ok(Built { facts, lanes, transfer, findings })
}

impl Classified {
    /// Lanes in memory, along x, then y, then z, assembled by `threads` threads.
    ///
    /// # Errors
    /// What reading the rows gives; [`Error::Interrupted`] if the observer says so.
    pub fn lanes(&self, lane_count: u8, threads: usize, observer: &mut dyn Observer) -> Result<Vec<OwnedLane>> {
        let Facts { grid, channels, tile_order, .. } = &self.facts;
        let assembler = Assembler::new(&self.rows, *tile_order, None, threads);
        let assembled = |axis| {
            let mut lane = OwnedLane::new(axis, grid.dims, *channels);
            assembler.lane(axis, observer, &mut |_| Ok(()), &mut |run| {
                lane.append(run);
                Ok(())
            })?;
            Ok(lane)
        };
        [Axis::X, Axis::Y, Axis::Z].into_iter().take(lane_count.into()).map(assembled).collect()
    }
}

/// Reads `source`, which must be at its first slice, and keeps what is visible.
///
/// # Errors
/// [`Error::Input`] if an option is out of range or nothing is visible; [`Error::Limit`] if the memory cannot do;
/// [`Error::Interrupted`] if the observer says so; [`Error::Io`] if the temporary file cannot be written; and what
/// reading the source gives.
pub fn classify(
    source: &mut dyn SlabSource,
    options: &BuildOptions,
    resources: &Resources,
    observer: &mut dyn Observer,
) -> Result<Classified> {
    options.check()?;
    let header = source.header().clone();
    header.grid.check()?;
    let budget = Budget::new(&header, options, resources, source.buffer_bytes())?;
    let surveyed = options.needs_survey();
    let largest_magnitude = if surveyed {
        let largest = survey(source, &header, options, &budget, observer)?;
        source.rewind()?;
        Some(largest)
    } else {
        None
    };
    let sieve = Sieve::new(&header, options, largest_magnitude)?;
    let store = Store::new(resources.folder.as_deref(), budget.spill_memory);
    let mut spill = Spill::new(&header, options.channels(), store);
    let found = keep_visible(source, &header, options, &sieve, &budget, &mut spill, observer)?;
    let mut findings = Findings { surveyed, ..found };
    if spill.voxels() == 0 {
        return Err(nothing_visible(&findings));
    }
    let plan = Plan::new(&header, options, &findings, largest_magnitude)?;
    let facts = Facts {
        grid: header.grid,
        channels: plan.channels,
        tile_order: options.tile_order,
        scales: plan.scales(),
        visible_voxels: spill.voxels(),
    };
    let transfer = plan.transfer.clone();
    let rows = SpilledVolume { spill, plan };
    if rows.plan.is_lossy() {
        let count = |(): &mut (), z: usize| {
            let z = u32::try_from(z).expect("a grid has at most 65,535 slices");
            rows.blurred_away(z..z + 1)
        };
        in_order(
            facts.grid.dims[2] as usize,
            budget.threads,
            || (),
            count,
            |_, count| {
                findings.blurred_away += count;
                Ok(())
            },
        )?;
    }
    Ok(Classified { facts, rows, transfer, findings })
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

    /// What is stored of a voxel.
    pub fn channels(&self) -> Channels {
        Channels {
            value_bits: self.value_bits,
            normal_bits: self.normal_bits,
            magnitude_bits: if self.transfer.uses_gradient() { 8 } else { 0 },
        }
    }

    /// Whether a volume must be read once before it is built.
    ///
    /// Only where opacity is relative to the largest gradient of the data (region boundaries that do not say it
    /// themselves): what is visible cannot be known before.
    pub fn needs_survey(&self) -> bool {
        self.transfer.clone().with_largest_magnitude(2.0).is_ok_and(|filled| filled != self.transfer)
    }

    /// Whether codes are spread over the range of the samples, not over that of their type.
    ///
    /// Samples of 8 bits have codes for all their values. Others need their own range if the visible range is open at
    /// an end, or if the opacity depends on the gradient, whose largest magnitude is not known.
    pub(super) fn needs_data_range(&self, sample_type: SampleType) -> bool {
        let (low, high) = self.transfer.domain(f64::INFINITY);
        let open = low == f64::NEG_INFINITY || high == f64::INFINITY;
        self.needs_survey() || (sample_type.bytes() > 1 && (open || self.transfer.uses_gradient()))
    }

    pub(super) fn field(&self) -> Field {
        let Channels { normal_bits, magnitude_bits, .. } = self.channels();
        match (normal_bits > 0 || magnitude_bits > 0, self.transfer.is_labels()) {
            (false, _) => Field::None,
            (true, false) => Field::Values,
            (true, true) => Field::Visibility,
        }
    }
}

pub(crate) fn go_on(observer: &mut dyn Observer, phase: Phase, done: u64, total: u64) -> Result<()> {
    match observer.progress(phase, done, total) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Interrupted),
    }
}

/// The largest magnitude of a gradient.
fn survey(
    source: &mut dyn SlabSource,
    header: &Header,
    options: &BuildOptions,
    budget: &Budget,
    observer: &mut dyn Observer,
) -> Result<f64> {
    let [width, _, depth] = header.grid.dims;
    let mut largest = 0.0f64;
    let work = |(): &mut (), resident: &Resident, piece: &Piece| {
        Ok(with_sample_type!(header.sample_type, T => {
            let hood = resident.values::<T>(piece.z);
            let places = piece.rows.clone().flat_map(|y| (0..width).map(move |x| (x as usize, y as usize)));
            places.map(|(x, y)| gradient::magnitude(hood.gradient(x, y))).fold(0.0, f64::max)
        }))
    };
    sweep(
        source,
        header,
        Field::Values,
        &options.transfer,
        budget.pace(),
        || (),
        work,
        |piece, magnitude| {
            largest = largest.max(magnitude);
            go_on(observer, Phase::Survey, piece.z.into(), depth.into())
        },
    )?;
    Ok(largest)
}

/// A piece's visible voxels, and what its samples are.
struct Kept {
    rows: SpilledRows,
    findings: Findings,
}

fn keep_visible(
    source: &mut dyn SlabSource,
    header: &Header,
    options: &BuildOptions,
    sieve: &Sieve,
    budget: &Budget,
    spill: &mut Spill,
    observer: &mut dyn Observer,
) -> Result<Findings> {
    let [_, height, depth] = header.grid.dims;
    let channels = options.channels();
    let field = options.field();
    let mut findings = Findings::default();
    let work = |row: &mut RowArrays, resident: &Resident, piece: &Piece| {
        Ok(with_sample_type!(header.sample_type, T => {
            let keep = Keep { samples: resident.typed::<T>(piece.z), header, sieve, channels };
            match field {
                Field::None => keep.rows(piece, row, |_, _| [0.0; 3]),
                Field::Values => {
                    let hood = resident.values::<T>(piece.z);
                    keep.rows(piece, row, |x, y| hood.gradient(x, y))
                }
                Field::Visibility => {
                    let hood = resident.visibility(piece.z);
                    keep.rows(piece, row, |x, y| hood.gradient(x, y))
                }
            }
        }))
    };
    sweep(source, header, field, &options.transfer, budget.pace(), RowArrays::default, work, |piece, kept| {
        findings.join(&kept.findings);
        spill.append(&kept.rows)?;
        let ended = piece.rows.end == height;
        if ended {
            spill.end_slice()?;
        }
        // A slice may be so large that nobody wants to wait for its end.
        go_on(observer, Phase::Pack, u64::from(piece.z) + u64::from(ended), depth.into())
    })?;
    Ok(findings)
}

/// Samples to look at at once: most have nothing visible among them, which is seen without looking each up.
const BLOCK: usize = 64;

/// What tells the visible voxels of a slice.
struct Keep<'a, T> {
    samples: &'a [T],
    header: &'a Header,
    sieve: &'a Sieve,
    channels: Channels,
}

impl<T: Sample> Keep<'_, T> {
    /// The visible voxels of a piece; `gradient` by x and y.
    fn rows(&self, piece: &Piece, row: &mut RowArrays, gradient: impl Fn(usize, usize) -> [f64; 3]) -> Kept {
        let Keep { samples, header, sieve, channels } = *self;
        let width = header.grid.dims[0] as usize;
        let mut kept = Kept { rows: SpilledRows::default(), findings: Findings::default() };
        let ends = sieve.ends::<T>();
        let mut tally = Tally::default();
        for y in piece.rows.clone() {
            let line = &samples[y as usize * width..][..width];
            for (block, first) in line.chunks(BLOCK).zip((0..).step_by(BLOCK)) {
                let range = tally.add(block);
                let (Some([low, high]), Some([lowest, highest])) = (ends, range) else { continue };
                if highest < low || lowest > high {
                    continue;
                }
                for (&sample, x) in block.iter().zip(first..) {
                    if !sieve.passes(sample) {
                        continue;
                    }
                    if channels.magnitude_bits > 0 || channels.normal_bits > 0 {
                        let gradient = gradient(x, y as usize);
                        if channels.magnitude_bits > 0 {
                            let magnitude = gradient::magnitude(gradient);
                            if !sieve.is_visible(sieve.value(sample), magnitude) {
                                continue;
                            }
                            row.magnitudes.push(magnitude);
                        }
                        match channels.normal_bits {
                            0 => {}
                            8 => row.normals.extend_from_slice(&normal::encode8(gradient).to_le_bytes()),
                            _ => row.normals.extend_from_slice(&normal::encode16(gradient).to_le_bytes()),
                        }
                    }
                    row.xs.push(u16::try_from(x).expect("a row has at most 65,535 samples"));
                    row.samples.extend_from_slice(bytemuck::bytes_of(&sample));
                }
            }
            kept.rows.push(u16::try_from(y).expect("a slice has at most 65,535 rows"), row);
            if (y + 1) % GROUP_ROWS == 0 || y + 1 == piece.rows.end {
                kept.rows.end_group();
            }
        }
        kept.findings = tally.findings(header);
        kept
    }
}

/// Range of raw samples, and how many are no numbers.
struct Tally<T> {
    ends: Option<[T; 2]>,
    not_finite: u64,
}

impl<T> Default for Tally<T> {
    fn default() -> Tally<T> {
        Tally { ends: None, not_finite: 0 }
    }
}

impl<T: Sample> Tally<T> {
    /// Adds some samples; gives their range, without what is not finite.
    #[inline(always)]
    fn add(&mut self, block: &[T]) -> Option<[T; 2]> {
        let [lowest, highest] = T::ENDS;
        // Starting at the other end keeps the loop free of branches; NaN compares false.
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

    fn findings(&self, header: &Header) -> Findings {
        let mut findings = Findings { not_finite: self.not_finite, ..Findings::default() };
        for raw in self.ends.into_iter().flatten() {
            let value = raw.to_f64() * header.slope + header.intercept;
            findings.lowest = findings.lowest.min(value);
            findings.highest = findings.highest.max(value);
        }
        findings
    }
}

impl Default for Findings {
    fn default() -> Findings {
        Findings { lowest: f64::INFINITY, highest: f64::NEG_INFINITY, not_finite: 0, surveyed: false, blurred_away: 0 }
    }
}

impl Findings {
    fn join(&mut self, other: &Findings) {
        self.lowest = self.lowest.min(other.lowest);
        self.highest = self.highest.max(other.highest);
        self.not_finite += other.not_finite;
    }
}
