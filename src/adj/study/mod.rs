//! `adj study`: measures our structure and those of other methods.

mod accuracy;
mod cache;
mod cache_tables;
mod layouts;
mod levels;
mod memory;
mod orders;
pub(super) mod output;
mod sets;
mod speed;
mod walk;

use clap::{Args, Subcommand};

use self::sets::{SetArguments, SetChoice};
use super::Answer;
use super::progress::{Progress, interrupted};
use super::values::{Word, choice};
use adjsplat::error::{Error, Result};
use adjsplat_study::baselines::Method;
use adjsplat_study::lane_walk::CodesRead;
use adjsplat_study::report::Report;
use adjsplat_study::{GoOn, Subject};

/// Measure this file format against the paper's and others: speed, memory, cache misses and accuracy
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj study memory --quick\n  adj study speed head.adj --plot speed.svg --json speed.json\n  adj study walk head.adj"
)]
pub(super) struct Arguments {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    Accuracy(Box<accuracy::Arguments>),
    Speed(speed::Arguments),
    Walk(walk::Arguments),
    Memory(memory::Arguments),
    Cache(Box<cache::Arguments>),
    Layouts(layouts::Arguments),
    Levels(levels::Arguments),
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    match &arguments.study {
        Study::Accuracy(arguments) => accuracy::run(arguments),
        Study::Speed(arguments) => speed::run(arguments),
        Study::Walk(arguments) => walk::run(arguments),
        Study::Memory(arguments) => memory::run(arguments),
        Study::Cache(arguments) => cache::run(arguments),
        Study::Layouts(arguments) => layouts::run(arguments),
        Study::Levels(arguments) => levels::run(arguments),
    }
}

/// Returns an empty table whose columns are the words of `columns`.
fn table_of(columns: &'static str) -> Report {
    Report::new(&columns.split(' ').collect::<Vec<_>>())
}

/// The flag for which methods to measure.
#[derive(Debug, Args)]
struct MethodArguments {
    /// Methods to measure, with commas between; all by default
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = choice(Method::ALL.map(|m| (m.name(), m, ""))))]
    methods: Vec<Method>,
}

impl MethodArguments {
    fn chosen(&self) -> Vec<Method> {
        if self.methods.is_empty() { Method::ALL.to_vec() } else { self.methods.clone() }
    }
}

/// Values of the flags for which codes a walk reads of each voxel.
const CODES: [Word<CodesRead>; 3] = [
    ("steps", CodesRead::Nothing, "The steps between voxels alone"),
    ("value", CodesRead::Values, "Also the value"),
    ("value+normal", CodesRead::ValuesAndNormals, "Also value and normal"),
];

/// Loads one set of `list` after another, calls `study` with it, and drops it; shows a progress bar.
fn each_set(
    sets: &SetArguments,
    list: Vec<SetChoice>,
    quiet: bool,
    mut study: impl FnMut(&Subject, GoOn) -> Result<()>,
) -> Result<()> {
    let mut progress = Progress::new(quiet);
    for (index, wanted) in list.iter().enumerate() {
        if interrupted() {
            return Err(Error::Interrupted);
        }
        let set = sets.load(wanted)?;
        let lanes = set.lanes()?;
        let what = format!("{}/{} {}", index + 1, list.len(), set.name);
        let subject = set.subject(&lanes)?;
        study(&subject, &mut |done, total| progress.show(&what, done, total))?;
    }
    Ok(())
}
