//! Builds: which samples of a volume a model keeps.

use std::path::PathBuf;

use adjsplat::arena::Levels;
use adjsplat::build::{BuildOptions, SampleSummary, Suggestion};
use adjsplat::error::{Error, Result};
use adjsplat::volume::SlabSource;
use adjsplat::{Build, TransferFunction};
use pyo3::prelude::*;

use crate::errors::exception;
use crate::model::Model;
use crate::source::Source;
use crate::transfer::parsed;
use crate::watch::Watch;

/// What is stored, and what a build may use.
#[derive(FromPyObject)]
pub(crate) struct Packing {
    /// 1, 2 or 3 lanes: along x, y, z.
    lanes: u8,
    value_bits: Option<u8>,
    normal_bits: Option<u8>,
    levels: Wanted,
    memory: Option<u64>,
    threads: Option<usize>,
}

/// Which coarser levels of detail are made: a number of them, or as many as are of use.
#[derive(FromPyObject)]
pub(crate) enum Wanted {
    Count(u8),
    Auto(#[allow(dead_code, reason = "the only word is auto")] String),
}

impl Wanted {
    pub(crate) fn levels(&self) -> Levels {
        match self {
            Wanted::Count(count) => Levels::Count(*count),
            Wanted::Auto(_) => Levels::Auto,
        }
    }
}

impl Packing {
    /// Returns the options of a build of what `transfer` shows.
    pub(crate) fn options(&self, transfer: TransferFunction) -> BuildOptions {
        let options = BuildOptions::new(transfer)
            .with_lane_count(self.lanes)
            .with_value_bits(self.value_bits)
            .with_levels(self.levels.levels());
        match self.normal_bits {
            Some(bits) => options.with_normal_bits(bits),
            None => options,
        }
    }
}

/// Builds a model of `source`: in the file `out`, or in memory. Returns it with warnings, one line each.
///
/// `transfer` is JSON; or "file" for the palette in the volume's file; or None for what suits the volume.
#[pyfunction]
pub(crate) fn build(
    py: Python<'_>,
    source: &Source,
    transfer: Option<&str>,
    out: Option<PathBuf>,
    packing: Packing,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Model, Vec<String>)> {
    let transfer = match transfer {
        None => Visible::Suggested,
        Some("file") => Visible::OwnPalette,
        Some(text) => Visible::By(parsed(text)?),
    };
    let raised = source.raised.clone();
    let mut watch = Watch::new(progress, raised.clone());
    let built = py.detach(|| {
        let mut volume = source.volume();
        // An earlier build, or one that was stopped, may have left it further on.
        volume.rewind()?;
        let transfer = match transfer {
            Visible::By(transfer) => transfer,
            Visible::OwnPalette => own_palette(&**volume)?,
            Visible::Suggested => match &source.own_transfer {
                Some(transfer) => transfer.clone(),
                None => Suggestion::for_volume(&mut **volume, &mut watch)?.transfer()?,
            },
        };
        let mut build = Build::new(packing.options(transfer));
        if let Some(memory) = packing.memory {
            build = build.with_memory(memory);
        }
        if let Some(threads) = packing.threads {
            build = build.with_threads(threads);
        }
        match out {
            Some(out) => build.write_observed(&mut **volume, out, &mut watch),
            None => build.run_observed(&mut **volume, &mut watch),
        }
    });
    let model = raised.or(built)?;
    Ok((Model::of(model), watch.samples.map(|samples| warnings(&samples)).unwrap_or_default()))
}

/// What a build is asked to show.
enum Visible {
    Suggested,
    OwnPalette,
    By(TransferFunction),
}

fn own_palette(source: &dyn SlabSource) -> Result<TransferFunction> {
    match Suggestion::stated(source)? {
        Some(suggestion @ Suggestion::StatedLabels(_)) => suggestion.transfer(),
        _ => Err(Error::input("labels", "are to be the file's, but it names none; try \"distinct\"")),
    }
}

pub(crate) fn warnings(samples: &SampleSummary) -> Vec<String> {
    let mut lines = Vec::new();
    let counted = |count, one: &str, many: &str| format!("{count} {}", if count == 1 { one } else { many });
    if samples.blurred_away > 0 {
        lines.push(format!(
            "{} transparent, as transparent values have the same codes; take value_bits=16 or a narrower range",
            counted(samples.blurred_away, "visible voxel turns", "visible voxels turn")
        ));
    }
    if samples.unnamed.voxels > 0 {
        let labels: Vec<String> = samples.unnamed.lowest.iter().flatten().map(i64::to_string).collect();
        lines.push(format!(
            "{} that the palette does not name ({}, ...); such voxels are not drawn",
            counted(samples.unnamed.voxels, "voxel has a label", "voxels have labels"),
            labels.join(", ")
        ));
    }
    if let Some(count) = samples.rounded_labels {
        lines.push(format!(
            "the visible samples have only {count} different values, which are stored rounded; if they are labels, give \
             labels="
        ));
    }
    if samples.not_finite > 0 {
        let found = counted(samples.not_finite, "sample is", "samples are");
        lines.push(format!("{found} NaN or infinite and therefore transparent"));
    }
    lines
}

/// Reads `None` as all processors for other work than builds.
pub(crate) fn threads_or_all(threads: Option<usize>) -> PyResult<usize> {
    match threads {
        Some(0) => Err(exception(Error::input("threads", "are 0, but must be at least 1"))),
        Some(threads) => Ok(threads),
        None => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
    }
}
