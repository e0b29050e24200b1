//! `adj study`: the structure beside its rivals.

mod accuracy;
mod cache;
mod layouts;
mod memory;
mod orders;
mod output;
mod sets;
mod speed;
mod walk;

use std::ops::ControlFlow;

use clap::{Args, Subcommand};

use self::sets::{SetArguments, Wanted};
use super::Answer;
use super::progress::{Progress, interrupted};
use adjsplat::error::{Error, Result};
use adjsplat_study::Subject;
use adjsplat_study::baselines::Method;

/// Measure our structure beside the paper's and others: speed, walks, memory, caches; and what speed costs in accuracy.
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
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    match &arguments.study {
        Study::Accuracy(arguments) => accuracy::run(arguments),
        Study::Speed(arguments) => speed::run(arguments),
        Study::Walk(arguments) => walk::run(arguments),
        Study::Memory(arguments) => memory::run(arguments),
        Study::Cache(arguments) => cache::run(arguments),
        Study::Layouts(arguments) => layouts::run(arguments),
    }
}

/// The methods of these names; all for none.
///
/// # Errors
/// [`Error::Input`] for a name that is none.
fn choose(names: &[String]) -> Result<Vec<Method>> {
    if names.is_empty() {
        return Ok(Method::ALL.to_vec());
    }
    names.iter().map(|name| Method::named(name)).collect()
}

/// Names the flag whose value the library refused.
fn for_flag<T>(flag: &str, result: Result<T>) -> Result<T> {
    result.map_err(|error| match error {
        Error::Input { why, .. } => Error::input(flag, why),
        other => other,
    })
}

/// Is told what is done of how much, and may stop the work.
type GoOn<'a> = &'a mut dyn FnMut(u64, u64) -> ControlFlow<()>;

/// Studies one set after another, each loaded, studied and dropped, with a progress bar.
///
/// # Errors
/// As loading a set, and as `study`; [`Error::Interrupted`] by Ctrl-C.
fn each_set(sets: &SetArguments, quiet: bool, study: impl FnMut(&Subject, GoOn) -> Result<()>) -> Result<()> {
    each_of(sets, sets.list()?, quiet, study)
}

/// The same of the sets in `list`.
///
/// # Errors
/// Likewise.
fn each_of(
    sets: &SetArguments,
    list: Vec<Wanted>,
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
        let what = format!("{}/{} {}", index + 1, list.len(), set.name());
        let subject = set.subject(&lanes)?;
        study(&subject, &mut |done, total| {
            progress.show(&what, done, total);
            if interrupted() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
    }
    Ok(())
}
