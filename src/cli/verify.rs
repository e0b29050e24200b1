//! `adj verify`: is the file whole and sound?

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::{Answer, print_result};
use crate::error::{Error, Result};
use crate::file::AdjFile;

/// Check every byte of .adj files: checksums, structure, and that all lanes hold the same voxels.
///
/// Exit code 0: sound; 1: not, with the first broken rule of the format; 2: could not be read.
#[derive(Debug, Args)]
#[command(after_help = "Example: adj verify head.adj")]
pub(super) struct Arguments {
    /// The files.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// One JSON object a file.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let mut answer = Answer::Yes;
    for path in &arguments.files {
        let start = Instant::now();
        let fault = match AdjFile::open(path).and_then(|file| check(&file)) {
            Ok(()) => None,
            Err(Error::Format { fault, .. }) => Some(fault),
            Err(error) => return Err(error),
        };
        if arguments.json {
            let fault =
                fault.as_ref().map(|f| json!({ "at": f.at, "rule": f.rule, "expected": f.expected, "got": f.got }));
            let sound = fault.is_none();
            print_result(&json!({ "file": path.display().to_string(), "sound": sound, "fault": fault }).to_string());
        } else {
            let bytes = std::fs::metadata(path).map_err(Error::io("read", path))?.len();
            let rate = bytes as f64 / 1e9 / start.elapsed().as_secs_f64();
            print_result(&match &fault {
                None => format!("{}: sound ({bytes} bytes, {rate:.1} GB/s)", path.display()),
                Some(fault) => format!("{}: not sound: {fault}", path.display()),
            });
        }
        if fault.is_some() {
            answer = Answer::No;
        }
    }
    Ok(answer)
}

fn check(file: &AdjFile) -> Result<()> {
    let checked = file.arena()?.check();
    checked.map(|_| ()).map_err(|fault| Error::Format { path: file.path().to_path_buf(), fault })
}
