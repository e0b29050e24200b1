//! `adj join`: makes one `.adj` file of a collection.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::build::check_adj_output;
use super::flags::one_line;
use super::progress::Progress;
use super::resources::ResourceArguments;
use super::{Answer, print_line, print_note};
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};

/// Join a collection to one .adj file: the bytes that one build of the whole volume makes
///
/// The bricks are mapped: their pages are not counted as memory, because the system can take them back.
#[derive(Debug, Args)]
#[command(after_help = "Example: adj join head.adjs -o head.adj")]
pub(super) struct Arguments {
    /// The collection's folder
    #[arg(value_name = "IN.adjs")]
    input: PathBuf,
    /// The .adj file to write
    #[arg(short, long, value_name = "OUT.adj")]
    output: PathBuf,
    /// Leave out bricks that are missing or damaged, and name them
    #[arg(long)]
    partial: bool,
    /// Do not check the bricks first: faster, but damage may pass into the output
    #[arg(long)]
    no_verify: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    /// Show no progress bar
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    resources: ResourceArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let start = Instant::now();
    let mut collection = opened(&arguments.input)?;
    check_adj_output(&arguments.output, collection.files())?;
    if !arguments.no_verify {
        collection.leave_out_damaged();
    }
    name_faults(&collection, arguments.partial)?;
    let (memory, threads) = (Some(arguments.resources.memory()), arguments.resources.threads());
    let mut progress = Progress::new(arguments.quiet);
    let (facts, bytes) = collection.join(&arguments.output, memory, threads, &mut progress)?;
    drop(progress);
    let (path, visible, seconds) = (arguments.output.display(), facts.visible_voxels, start.elapsed().as_secs_f64());
    let missing = collection.faults().len();
    print_line(&if arguments.json {
        json!({
            "output": path.to_string(),
            "bricks": collection.bricks().len(),
            "bricks_left_out": missing,
            "visible_voxels": visible,
            "bytes_total": bytes,
            "seconds": seconds,
        })
        .to_string()
    } else {
        format!("{path}: {visible} voxels, {}, {seconds:.2} s", indicatif::HumanBytes(bytes))
    });
    Ok(Answer::Yes)
}

/// Opens a collection.
///
/// # Errors
/// [`Error::Input`] if `path` is a file; the errors of [`Collection::open`].
pub(super) fn opened(path: &Path) -> Result<Collection> {
    if std::fs::metadata(path).is_ok_and(|found| !found.is_dir()) {
        return Err(Error::input(path.display().to_string(), "is a file; give the folder of a collection, NAME.adjs"));
    }
    Collection::open(path)
}

/// Names each brick that cannot be used.
///
/// # Errors
/// [`Error::Input`] if there are such bricks, unless `partial`.
pub(super) fn name_faults(collection: &Collection, partial: bool) -> Result<()> {
    let (faults, all) = (collection.faults(), collection.bricks().len());
    for fault in faults {
        print_note(&one_line(fault));
    }
    match faults.len() {
        0 => {}
        missing if partial => print_note(&format!("note: {missing} of {all} bricks are left out")),
        missing => {
            let why = format!("{missing} of {all} bricks cannot be used; mend them, or leave them out with --partial");
            return Err(Error::input(collection.path().display().to_string(), why));
        }
    }
    Ok(())
}
