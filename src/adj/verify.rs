//! `adj verify`: checks that a file is complete and valid.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::flags::one_line;
use super::memory_shares::{LEAST_RESIDENT, memory_of_pages};
use super::size::memory;
use super::{Answer, print_line, print_note};
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};
use adjsplat::file::AdjFile;

/// Check .adj files and collections for damage: every checksum and every rule of the format
///
/// Exit code 0: all are sound; 1: one is damaged, and the first broken rule is printed; 2: one could not be read, such as a
/// collection whose manifest breaks a rule. The others are checked all the same.
#[derive(Debug, Args)]
#[command(after_help = "Example: adj verify head.adj")]
pub(super) struct Arguments {
    /// The .adj files; of a collection every brick is checked, and each that is not sound is named
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Print one JSON object for each file
    #[arg(long)]
    json: bool,
    /// Most memory to take, from 64MiB: 500MB, 2GiB; no limit by default
    #[arg(long, value_name = "SIZE", value_parser = memory)]
    memory: Option<u64>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let mut answer = Answer::Yes;
    let mut trouble: Option<Error> = None;
    for path in &arguments.files {
        let found = match Collection::is_at(path) {
            true => check_collection(path, arguments),
            false => check_file(path, arguments),
        };
        match found {
            Ok(true) => {}
            Ok(false) => answer = Answer::No,
            Err(error) => {
                if arguments.json {
                    let report =
                        json!({ "file": path.display().to_string(), "sound": null, "error": one_line(&error) });
                    print_line(&report.to_string());
                }
                // The remaining files are still checked; the caller prints the last error.
                if let Some(earlier) = trouble.replace(error) {
                    print_note(&one_line(&earlier));
                }
            }
        }
    }
    trouble.map_or(Ok(answer), Err)
}

/// Checks an .adj file, and prints what is wrong; returns whether it is sound.
fn check_file(path: &Path, arguments: &Arguments) -> Result<bool> {
    let start = Instant::now();
    let (bytes, fault) = match check(path, arguments.memory) {
        Ok(bytes) => (bytes, None),
        Err(Error::Format { fault, .. }) => (0, Some(fault)),
        Err(error) => return Err(error),
    };
    let file = path.display().to_string();
    print_line(&match &fault {
        _ if arguments.json => {
            let report =
                fault.as_ref().map(|f| json!({ "at": f.at, "rule": f.rule, "expected": f.expected, "got": f.got }));
            json!({ "file": file, "sound": fault.is_none(), "fault": report }).to_string()
        }
        None => {
            format!("{file}: sound ({bytes} bytes, {:.1} GB/s)", bytes as f64 / 1e9 / start.elapsed().as_secs_f64())
        }
        Some(fault) => format!("{file}: not sound: {fault}"),
    });
    Ok(fault.is_none())
}

/// Checks all bricks of a collection, and prints what is wrong; returns whether it is sound.
fn check_collection(path: &Path, arguments: &Arguments) -> Result<bool> {
    let start = Instant::now();
    let collection = Collection::open(path)?;
    let files = collection.bricks().iter().filter_map(|brick| brick.file.as_ref()).chain(collection.preview());
    // Opened again one by one, each with all of the memory.
    let mut found: Vec<Error> = files.filter_map(|file| check(file.path(), arguments.memory).err()).collect();
    if found.is_empty() {
        found = collection.check_rules();
    }
    let faults: Vec<String> =
        collection.faults().iter().chain(collection.preview_fault()).chain(&found).map(one_line).collect();
    let (name, bricks) = (path.display().to_string(), collection.bricks().len());
    if arguments.json {
        let report = json!({ "file": name, "sound": faults.is_empty(), "bricks": bricks, "faults": faults });
        print_line(&report.to_string());
    } else if faults.is_empty() {
        print_line(&format!("{name}: sound ({bricks} bricks, {:.2} s)", start.elapsed().as_secs_f64()));
    } else {
        faults.iter().for_each(|fault| print_line(fault));
        let files = match &collection.manifest().preview {
            Some(_) => format!("{bricks} bricks and a preview"),
            None => format!("{bricks} bricks"),
        };
        print_line(&format!("{name}: not sound: {} of {files}", faults.len()));
    }
    Ok(faults.is_empty())
}

/// Checks the whole file; returns its length in bytes.
fn check(path: &Path, memory: Option<u64>) -> Result<u64> {
    let mut file = AdjFile::open(path)?;
    if let Some(memory) = memory {
        // The pages read to open the file, and all that the system mapped with them, need not stay.
        file = file.keep_resident_below(LEAST_RESIDENT)?;
        let bytes = file.arena()?.bytes().len() as u64;
        file = file.keep_resident_below(memory_of_pages(memory, bytes))?;
    }
    Ok(file.check()?.bytes)
}
