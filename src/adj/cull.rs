//! `--cull-hidden`: writes a file without the voxels that no view from outside shows.
//!
//! In: an `.adj` file and the flags. Out: a file without its hidden voxels; its description says that they were
//! removed.

use std::path::Path;

use clap::Args;
use indicatif::HumanBytes;
use serde_json::{Value, json};

use super::build::{Written, write_adj};
use super::progress::Progress;
use super::stored::stored_transfer;
use super::values::number;
use adjsplat::arena::{LaneRows, LaneSet, Levels};
use adjsplat::error::{Error, Result};
use adjsplat::file::{AdjFile, RowsOutput};
use adjsplat::internals::description_object;
use adjsplat::splat::Scene;
use adjsplat::volume::Axis;
use adjsplat_judge::hidden::{Algorithm, Culling, CullingStage, DEFAULT_EPS, DEFAULT_VIEWS, check_memory, find};

/// The flags that say whether to leave out voxels that no view from outside shows.
#[derive(Debug, Args)]
#[command(next_help_heading = "Hidden voxels")]
pub(super) struct CullArguments {
    /// Leave out voxels that no view from outside shows. Pictures change by at most EPS (above 0, below 1;
    /// default 1/512). Views from inside and crops show gaps. It takes minutes: two for the 1.2 million voxels
    /// of an engine, of which it leaves out 2.9 % at the opacity 0.8 of --range, and 19 % if they are opaque
    #[arg(long, value_name = "EPS", num_args = 0..=1, require_equals = true, value_parser = fraction)]
    cull_hidden: Option<Option<f64>>,
    /// Leave out only voxels that are proven hidden from every direction: fewer than --cull-hidden
    #[arg(long)]
    cull_hidden_certified: bool,
    /// Views from which hidden voxels are found, 1 to 100000; 240 by default
    #[arg(long, value_name = "N", value_parser = number(1..=100_000u32))]
    cull_views: Option<u32>,
}

impl CullArguments {
    /// Returns how to look for hidden voxels, with `memory` bytes at most; `None` if no flag asks for it.
    ///
    /// # Errors
    /// [`Error::Input`] if `--cull-views` is given without a flag that removes voxels.
    pub(super) fn culling(&self, memory: u64, threads: usize) -> Result<Option<Culling>> {
        let eps = match self.cull_hidden {
            Some(eps) => eps.unwrap_or(DEFAULT_EPS),
            None if self.cull_hidden_certified => DEFAULT_EPS,
            None if self.cull_views.is_some() => {
                return Err(Error::input("--cull-views", "is for --cull-hidden; give that too"));
            }
            None => return Ok(None),
        };
        Ok(Some(Culling {
            eps,
            algorithm: if self.cull_hidden_certified { Algorithm::Certified } else { Algorithm::Sampled },
            views: self.cull_views.unwrap_or(DEFAULT_VIEWS),
            judging_views: 200,
            threads,
            memory,
        }))
    }
}

/// Parses a number above 0 and below 1.
fn fraction(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|eps| *eps > 0.0 && *eps < 1.0);
    number.ok_or_else(|| "must be above 0 and below 1, such as 0.002".into())
}

/// The result of removing hidden voxels from a file.
pub(super) struct Culled {
    /// The file without hidden voxels.
    pub(super) written: Written,
    /// Numbers of voxels, and the settings, for `--json`.
    pub(super) report: Value,
}

impl Culled {
    /// Returns the report as a line of text.
    pub(super) fn line(&self) -> String {
        let number = |name: &str| self.report[name].as_f64().unwrap_or(0.0);
        format!(
            "{} of {} voxels are hidden ({:.1} %, {}): {} instead of {}; {} other views change by {:.5} at most",
            self.report["removed"],
            self.report["visible_before"],
            100.0 * number("removed") / number("visible_before").max(1.0),
            self.report["algorithm"].as_str().unwrap_or_default(),
            HumanBytes(self.written.bytes),
            HumanBytes(self.report["bytes_before"].as_u64().unwrap_or(0)),
            self.report["judging_views"],
            number("worst_difference"),
        )
    }
}

/// Checks, before the visible voxels of a grid of `dims` points are found, that the memory may suffice for finding hidden ones.
pub(super) fn check_cull_memory(dims: [u32; 3], culling: &Culling) -> Result<()> {
    check_memory(dims, culling).map_err(|error| with_flag(error, culling))
}

/// Returns the error with the flag to change, if it is of memory.
fn with_flag(error: Error, culling: &Culling) -> Error {
    let Error::Limit { need, have, .. } = error else { return error };
    let (need, have, threads) = (need.div_ceil(1 << 20), HumanBytes(have), culling.threads);
    let fewer = if threads > 1 { format!(", or fewer --threads than {threads}") } else { String::new() };
    Error::input("--memory", format!("is {have}, but finding hidden voxels takes {need}MiB; give that much{fewer}"))
}

/// Writes the voxels of `file` without the hidden ones to `output`, with as many lanes, and with `levels`.
pub(super) fn cull(file: &AdjFile, output: &Path, culling: &Culling, levels: Levels, quiet: bool) -> Result<Culled> {
    let arena = file.arena()?;
    let facts = arena.facts().clone();
    let bytes_before = arena.bytes().len() as u64;
    let lane_count = u8::try_from(arena.lanes().count()).expect("there are three axes");
    let transfer = stored_transfer(&arena, file.path())?;
    let mut description = description_object(arena.description());
    // Lanes that the file does not store are derived, and their memory counts too.
    let lanes = LaneSet::new(arena, Some(culling.memory));
    let scene = Scene { facts: &facts, lanes: &lanes, transfer: &transfer };
    let mut progress = Progress::new(quiet);
    let mut watch = |stage, done, total| {
        let what = match stage {
            CullingStage::Look => "look",
            CullingStage::Compare => "compare",
        };
        progress.show(what, done, total)
    };
    let hidden = find(&scene, culling, &mut watch).map_err(|error| with_flag(error, culling))?;
    drop(progress);
    let algorithm = match culling.algorithm {
        Algorithm::Sampled => "sampled",
        Algorithm::Certified => "certified",
    };
    let record = json!({
        "algorithm": algorithm,
        "eps": culling.eps,
        "removed": hidden.count,
        "views": hidden.views,
        "judging_views": hidden.judging_views,
        "rounds": hidden.rounds,
        "worst_difference": hidden.worst_difference,
        "kernels": ["draft", "standard", "high"],
        "note": "left out for this transfer function, composited from outside: eyes inside, crops that cut in, \
                 other modes and other transfer functions show that voxels are missing",
    });
    description["hidden_voxels"] = record.clone();
    let rows =
        LaneRows::new(lanes.lane(Axis::X)?, |_, index, record| (!hidden.records.contains(index)).then_some(record));
    let wanted = RowsOutput {
        facts: facts.clone(),
        description: &description.to_string(),
        lane_count,
        memory: Some(culling.memory),
        threads: culling.threads,
        levels,
    };
    let written = write_adj(output, &rows, &wanted, quiet)?;
    let mut report = record;
    report["visible_before"] = json!(facts.visible_voxels);
    report["bytes_before"] = json!(bytes_before);
    report["bytes_after"] = json!(written.bytes);
    report["passes"] = json!(hidden.passes);
    report["memory_limit"] = json!(culling.memory);
    Ok(Culled { written, report })
}
