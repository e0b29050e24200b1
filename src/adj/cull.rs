//! `--cull-hidden`: a file without the voxels that no view from outside shows.
//!
//! In: an `.adj` file and the flags. Out: another one without its hidden voxels, that says so in its description.

use std::ops::ControlFlow;
use std::path::Path;

use clap::Args;
use serde_json::{Value, json};

use super::progress::{Progress, interrupted};
use super::stored::stored_transfer;
use adjsplat::arena::layout::Facts;
use adjsplat::arena::{LaneRows, LaneSet};
use adjsplat::error::{Error, Result};
use adjsplat::file::{AdjFile, RowsOutput, write_rows};
use adjsplat::splat::Scene;
use adjsplat::volume::Axis;
use adjsplat_judge::hidden::{Algorithm, Culling, CullingStage, DEFAULT_EPS, DEFAULT_VIEWS, find};

/// What no view from outside shows.
#[derive(Debug, Args)]
#[command(next_help_heading = "Hidden voxels")]
pub(super) struct CullArguments {
    /// Leave out voxels that no view from outside shows: pictures change by at most EPS (1/512 unless given), measured
    /// on views that did not decide. Inside views, crops and other transfer functions show that they are missing.
    #[arg(long, value_name = "EPS", num_args = 0..=1, require_equals = true)]
    cull_hidden: Option<Option<f64>>,
    /// Leave out only voxels that are proven hidden in all parallel views from outside (in perspective for most rays): fewer.
    #[arg(long)]
    cull_hidden_certified: bool,
    /// Views that decide what is hidden; 26 axes and diagonals and 200 others always judge.
    #[arg(long, value_name = "N")]
    cull_views: Option<u32>,
}

impl CullArguments {
    /// What the flags ask for, if they ask for anything, with so many bytes of memory and threads.
    ///
    /// # Errors
    /// [`Error::Input`] if a number cannot be used.
    pub(super) fn culling(&self, memory: u64, threads: usize) -> Result<Option<Culling>> {
        let eps = match self.cull_hidden {
            Some(eps) => eps.unwrap_or(DEFAULT_EPS),
            None if self.cull_hidden_certified => DEFAULT_EPS,
            None if self.cull_views.is_some() => {
                return Err(Error::input("--cull-views", "is for --cull-hidden; give that too"));
            }
            None => return Ok(None),
        };
        if !(eps > 0.0 && eps < 1.0) {
            let why = format!("is {eps}, but must be above 0 and below 1, such as 0.002");
            return Err(Error::input("--cull-hidden", why));
        }
        let views = self.cull_views.unwrap_or(DEFAULT_VIEWS);
        if !(1..=100_000).contains(&views) {
            return Err(Error::input("--cull-views", format!("is {views}, but must be 1 to 100000")));
        }
        let certified = self.cull_hidden_certified;
        Ok(Some(Culling {
            eps,
            algorithm: if certified { Algorithm::Certified } else { Algorithm::Sampled },
            views,
            judging_views: 200,
            threads,
            memory,
        }))
    }
}

/// What culling did.
pub(super) struct Culled {
    /// Of the file that was written.
    pub(super) facts: Facts,
    /// Its bytes.
    pub(super) bytes: u64,
    /// What is to be told.
    pub(super) report: Value,
}

impl Culled {
    /// The report as a line for people.
    pub(super) fn line(&self) -> String {
        let part = |name: &str| self.report[name].as_f64().unwrap_or(0.0);
        format!(
            "{} of {} voxels are hidden ({:.1} %, {}): {} instead of {}; {} other views change by {:.5} at most",
            self.report["removed"],
            self.report["visible_before"],
            100.0 * part("removed") / part("visible_before").max(1.0),
            self.report["algorithm"].as_str().unwrap_or_default(),
            indicatif::HumanBytes(self.bytes),
            indicatif::HumanBytes(self.report["bytes_before"].as_u64().unwrap_or(0)),
            self.report["judging_views"],
            part("worst_difference"),
        )
    }
}

/// Writes what is not hidden of the file at `input` to `output`, in as many lanes.
///
/// # Errors
/// What opening, finding and writing give; [`Error::Interrupted`] on Ctrl-C.
pub(super) fn cull(input: &Path, output: &Path, culling: &Culling, quiet: bool) -> Result<Culled> {
    let file = AdjFile::open(input)?;
    let arena = file.arena()?;
    let facts = arena.facts().clone();
    let bytes_before = arena.bytes().len() as u64;
    let lane_count = u8::try_from(arena.lanes().count()).expect("there are three axes");
    let transfer = stored_transfer(&arena, input)?;
    let mut description: Value = serde_json::from_slice(arena.description()).unwrap_or(Value::Null);
    // Lanes that are not stored are derived, and count too.
    let lanes = LaneSet::new(arena, Some(culling.memory));
    let scene = Scene { facts: &facts, lanes: &lanes, transfer: &transfer };
    let mut progress = Progress::new(quiet);
    let mut watch = |stage, done, total| {
        let what = match stage {
            CullingStage::Look => "look",
            CullingStage::Compare => "compare",
        };
        progress.show(what, done, total);
        if interrupted() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let hidden = find(&scene, culling, &mut watch)?;
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
    };
    let (written, bytes) = write_rows(output, &rows, &wanted, &mut Progress::new(quiet))?;
    let mut report = record;
    report["visible_before"] = json!(facts.visible_voxels);
    report["bytes_before"] = json!(bytes_before);
    report["bytes_after"] = json!(bytes);
    report["passes"] = json!(hidden.passes);
    report["memory_limit"] = json!(culling.memory);
    Ok(Culled { facts: written, bytes, report })
}
