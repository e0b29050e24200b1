//! The builder: from a volume to its visible voxels, and to lanes.
//!
//! In: a [`SlabSource`], which reads a volume slice by slice, and a transfer function. A voxel is visible if its
//! opacity is above 0. Its value is quantised over the visible range; its normal is computed from the gradient. The
//! result depends only on the input and the options, not on memory or threads.
//!
//! Slices are read once, or twice if visibility depends on the data's largest gradient:
//! [`BuildOptions::needs_survey`].

use super::assemble::Assembler;
use super::budget::Budget;
use super::classified::ClassifiedRows;
use super::codes::choose_codes;
use super::encoder::{VoxelEncoder, nothing_visible};
use super::options::{BuildOptions, GradientSource, Resources};
use super::progress::{Observer, Phase, report};
use super::scan::VisibleScan;
use super::spill::{RowArrays, SpilledRows, SpilledVoxels};
use super::store::SpillStore;
use super::summary::SampleSummary;
use super::sweep::{RowBlock, sweep};
use super::visibility::VisibilityTest;
use super::window::SliceWindow;
use crate::arena::layout::Facts;
use crate::arena::{OwnedLane, Region, Rows};
use crate::classify::TransferFunction;
use crate::classify::gradient::GridAxes;
use crate::error::Result;
use crate::volume::{Axis, Header, SlabSource};
use crate::with_sample_type;

/// The result of a build in memory.
#[derive(Debug, Clone)]
pub struct Built {
    /// Grid, channel widths and scales: the contents of a file's header.
    pub facts: Facts,
    /// The lanes along x, y and z, as many as the options ask for.
    pub lanes: Vec<OwnedLane>,
    /// The transfer function, completed with everything that depends on the volume.
    pub transfer: TransferFunction,
    /// Statistics of the volume's samples.
    pub samples: SampleSummary,
}

/// The visible voxels of a volume with their codes, before lanes are built from them.
#[non_exhaustive]
pub struct Classified {
    /// Grid, channel widths and scales: the contents of a file's header.
    pub facts: Facts,
    /// The visible voxels, as rows along x.
    pub rows: ClassifiedRows,
    /// The transfer function, completed with everything that depends on the volume.
    pub transfer: TransferFunction,
    /// Statistics of the volume's samples.
    pub samples: SampleSummary,
}

/// Builds lanes in memory, on one thread. `source` must be at its first slice.
///
/// # Errors
/// The same as [`classify`].
pub fn build(source: &mut dyn SlabSource, options: &BuildOptions, observer: &mut dyn Observer) -> Result<Built> {
    let classified = classify(source, options, &Resources::default(), observer)?;
    let lanes = classified.lanes(options.lane_count, 1, observer)?;
    let Classified { facts, transfer, samples, .. } = classified;
    Ok(Built { facts, lanes, transfer, samples })
}

impl Classified {
    /// Builds the first `lane_count` lanes (along x, y, z) in memory, on `threads` threads.
    ///
    /// # Errors
    /// Any error of reading the rows; [`Error::Interrupted`](crate::Error::Interrupted) if the observer cancels.
    pub fn lanes(&self, lane_count: u8, threads: usize, observer: &mut dyn Observer) -> Result<Vec<OwnedLane>> {
        lanes_of(&self.rows, &self.facts, lane_count, threads, observer)
    }
}

/// Builds the first `lane_count` lanes (along x, y, z) of `rows` in memory, on `threads` threads.
///
/// # Errors
/// The errors of [`Classified::lanes`].
pub(crate) fn lanes_of(
    rows: &dyn Rows,
    facts: &Facts,
    lane_count: u8,
    threads: usize,
    observer: &mut dyn Observer,
) -> Result<Vec<OwnedLane>> {
    let Facts { grid, channels, tile_order, .. } = facts;
    let assembler = Assembler::new(rows, *tile_order, None, threads);
    let assembled = |axis| {
        let mut lane = OwnedLane::new(axis, grid.dims, *channels);
        assembler.lane(axis, observer, &mut |_| Ok(()), &mut |run| {
            lane.append(run);
            Ok(())
        })?;
        Ok(lane)
    };
    Axis::ALL.into_iter().take(lane_count.into()).map(assembled).collect()
}

/// Reads a volume and keeps its visible voxels. `source` must be at its first slice.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) if an option is out of range or nothing is visible;
/// [`Error::Limit`](crate::Error::Limit) if the allowed memory is too small;
/// [`Error::Interrupted`](crate::Error::Interrupted) if the observer cancels; [`Error::Io`](crate::Error::Io) if the
/// temporary file cannot be written; any error of reading the source.
pub fn classify(
    source: &mut dyn SlabSource,
    options: &BuildOptions,
    resources: &Resources,
    observer: &mut dyn Observer,
) -> Result<Classified> {
    options.check()?;
    let header = source.header().clone();
    header.check()?;
    let budget = Budget::new(&header, options, resources, source.buffer_bytes())?;
    let all = Region::of_grid(header.grid.dims);
    let surveyed = options.needs_survey();
    let mut largest_magnitude = None;
    if surveyed {
        largest_magnitude = Some(survey(source, &header, &all, options, &budget, observer)?);
        source.rewind()?;
    }
    let (spill, found) = keep_visible(source, &header, &all, options, largest_magnitude, &budget, resources, observer)?;
    let samples = SampleSummary { surveyed, ..found };
    if spill.voxels == 0 {
        return Err(nothing_visible(&samples));
    }
    let encoder = |bits| VoxelEncoder::new(&header, options, bits, &samples, largest_magnitude);
    let threads = budget.schedule.threads;
    let whole = || spill.whole_numbers(threads).map(Some);
    let chosen = choose_codes(&encoder, options.value_bits, whole, |encoder| spill.loss(encoder, threads).map(Some))?;
    let (encoder, loss) = chosen.expect("nothing is left open");
    let rows = ClassifiedRows { spill, encoder };
    let samples = samples.with_loss(&rows.encoder, &loss, rows.spill.voxels);
    let facts = Facts {
        grid: header.grid,
        channels: rows.encoder.channels,
        tile_order: options.tile_order,
        scales: rows.encoder.scales(),
        visible_voxels: rows.spill.voxels,
    };
    let transfer = rows.encoder.transfer.clone();
    Ok(Classified { facts, rows, transfer, samples })
}

/// Returns the largest gradient magnitude of the samples in `kept`.
pub(crate) fn survey(
    source: &mut dyn SlabSource,
    header: &Header,
    kept: &Region,
    options: &BuildOptions,
    budget: &Budget,
    observer: &mut dyn Observer,
) -> Result<f64> {
    let (depth, axes) = (header.grid.dims[2], GridAxes::of(&header.grid));
    let mut largest = 0.0f64;
    let work = |(): &mut (), window: &SliceWindow, block: &RowBlock| {
        if !kept.zs.contains(&block.z) {
            return Ok(0.0);
        }
        Ok(with_sample_type!(header.sample_type, T => {
            let hood = window.values::<T>(block.z);
            let rows = block.rows.start.max(kept.ys.start)..block.rows.end.min(kept.ys.end);
            let places = rows.flat_map(|y| kept.xs.clone().map(move |x| (x as usize, y as usize)));
            places.map(|(x, y)| axes.magnitude(hood.slopes(x, y))).fold(0.0, f64::max)
        }))
    };
    let take = |block: &RowBlock, magnitude: f64| {
        largest = largest.max(magnitude);
        report(observer, Phase::Survey, block.z.into(), depth.into())
    };
    sweep(source, header, GradientSource::Values, &options.transfer, budget.schedule, || (), work, take)?;
    Ok(largest)
}

/// Returns all visible voxels in `kept`, in their temporary store, and the statistics of all samples there.
#[expect(clippy::too_many_arguments, reason = "the pass of a build, with all that it depends on")]
pub(crate) fn keep_visible(
    source: &mut dyn SlabSource,
    header: &Header,
    kept: &Region,
    options: &BuildOptions,
    largest_magnitude: Option<f64>,
    budget: &Budget,
    resources: &Resources,
    observer: &mut dyn Observer,
) -> Result<(SpilledVoxels, SampleSummary)> {
    let [_, height, depth] = header.grid.dims;
    let test = &VisibilityTest::new(header, options, largest_magnitude)?;
    let store = SpillStore::new(resources.folder.as_deref(), budget.spill_memory);
    let mut spill = SpilledVoxels::new(header, options.channels(), store);
    let channels = options.channels();
    let gradients = options.gradient_source();
    let mut summary = SampleSummary::default();
    let work = |row: &mut RowArrays, window: &SliceWindow, block: &RowBlock| {
        Ok(with_sample_type!(header.sample_type, T => {
            let scan = VisibleScan { samples: window.typed::<T>(block.z), header, test, channels, kept };
            match gradients {
                GradientSource::None => scan.rows(block, row, &|_, _| [0.0; 3]),
                GradientSource::Values => {
                    let hood = window.values::<T>(block.z);
                    scan.rows(block, row, &|x, y| hood.slopes(x, y))
                }
                GradientSource::Visibility => {
                    let hood = window.visibility(block.z);
                    scan.rows(block, row, &|x, y| hood.slopes(x, y))
                }
            }
        }))
    };
    let take = |block: &RowBlock, (rows, samples): (SpilledRows, SampleSummary)| {
        summary.join(&samples);
        spill.append(&rows)?;
        let ended = block.rows.end == height;
        if ended {
            spill.end_slice()?;
        }
        // Progress is reported per block of rows: a single slice can take long.
        report(observer, Phase::Pack, u64::from(block.z) + u64::from(ended), depth.into())
    };
    sweep(source, header, gradients, &options.transfer, budget.schedule, RowArrays::default, work, take)?;
    Ok((spill, summary))
}
