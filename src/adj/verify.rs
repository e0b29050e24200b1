//! `adj verify`: is the file whole and sound?

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::room::memory_of_pages;
use super::size::parse_memory;
use super::{Answer, one_line, print_note, print_result};
use adjsplat::error::{Error, Result};
use adjsplat::file::AdjFile;

/// Check every byte of .adj files: checksums, structure, and that all lanes hold the same voxels.
///
/// Exit code 0: sound; 1: not, with the first broken rule of the format; 2: one could not be read.
#[derive(Debug, Args)]
#[command(after_help = "Example: adj verify head.adj")]
pub(super) struct Arguments {
    /// The files.
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// One JSON object a file.
    #[arg(long)]
    json: bool,
    /// Most memory that the program may take, from 64MiB; no limit unless given.
    #[arg(long, value_name = "SIZE")]
    memory: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let memory = arguments.memory.as_deref().map(parse_memory).transpose()?;
    let mut answer = Answer::Yes;
    let mut trouble = None;
    for path in &arguments.files {
        let start = Instant::now();
        let fault = match check(path, memory) {
            Ok(bytes) => {
                let rate = bytes as f64 / 1e9 / start.elapsed().as_secs_f64();
                if !arguments.json {
                    print_result(&format!("{}: sound ({bytes} bytes, {rate:.1} GB/s)", path.display()));
                }
                None
            }
            Err(Error::Format { fault, .. }) => Some(fault),
            Err(error) => {
                // The other files are judged all the same; the last trouble is told by the caller.
                if let Some(earlier) = trouble.replace(error) {
                    print_note(&one_line(&earlier));
                }
                continue;
            }
        };
        if arguments.json {
            let told =
                fault.as_ref().map(|f| json!({ "at": f.at, "rule": f.rule, "expected": f.expected, "got": f.got }));
            let file = path.display().to_string();
            print_result(&json!({ "file": file, "sound": fault.is_none(), "fault": told }).to_string());
        } else if let Some(fault) = &fault {
            print_result(&format!("{}: not sound: {fault}", path.display()));
        }
        if fault.is_some() {
            answer = Answer::No;
        }
    }
    trouble.map_or(Ok(answer), Err)
}

/// Checks everything; the file's length.
fn check(path: &Path, memory: Option<u64>) -> Result<u64> {
    let mut file = AdjFile::open(path)?;
    if let Some(memory) = memory {
        file = file.keep_resident_below(memory_of_pages(memory))?;
    }
    let checked = file.arena()?.check();
    checked.map(|found| found.bytes).map_err(|fault| Error::Format { path: path.to_path_buf(), fault })
}
