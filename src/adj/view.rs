//! `adj view`: shows files in a window.

use std::path::PathBuf;

use clap::Args;

use super::Answer;
use adjsplat::error::{Error, Result};

/// Show .adj files or volumes in a window: turn, cut and colour them, and save pictures
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj view head.adj\n  adj view ct-series/                     (a folder of DICOM slices)\n  adj view before.adj after.adj           (each in a tab of its own)\nWithout a display, draw with adj render, or look in a browser with adj serve."
)]
pub(super) struct Arguments {
    /// .adj files, or volumes that adj build reads, each in a tab of its own; none opens an empty window
    #[arg(value_name = "IN")]
    input: Vec<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    for path in &arguments.input {
        std::fs::metadata(path).map_err(Error::io("open", path))?;
    }
    show(&arguments.input)
}

#[cfg(feature = "view")]
fn show(files: &[PathBuf]) -> Result<Answer> {
    adjsplat_view::run(files.to_vec()).map(|()| Answer::Yes)
}

#[cfg(not(feature = "view"))]
fn show(_: &[PathBuf]) -> Result<Answer> {
    Err(Error::input(
        "adj view",
        "was left out of this program; build it with --features view, or draw with adj render",
    ))
}
