//! Makes the coarser levels of a file, before the file itself is written.
//!
//! In: rows of voxels. Out: levels, each a complete `.adj` file, in memory or in a file without a name. Of each level the
//! lane along x is written first: the other lanes, and the next level, are made from that.

use std::ops::ControlFlow;
use std::path::Path;

use super::map::AdjFile;
use super::write::{GivenLevels, RowsOutput, arena_bytes, facts_of_rows, open_rows};
use crate::arena::layout::Facts;
use crate::arena::levels::level_facts;
use crate::arena::pager::in_flight;
use crate::arena::{Arena, CoarserRows, LevelLook, Levels, Rows};
use crate::build::builder::lanes_of;
use crate::build::progress::{Observer, Phase};
use crate::error::{Error, Result};
use crate::parallel::MOST_THREADS;

/// The description of a level: it has no facts of its own.
const DESCRIPTION: &str = "{}";
/// Largest part of the memory, and most bytes, that the resident pages of a level may take while the next is made from it.
const RESIDENT_SHARE: u64 = 32;
const RESIDENT_BYTES: u64 = 16 << 20;

/// A level that was made.
pub(super) trait Made: Sized {
    fn arena(&self) -> Result<Arena<'_>>;
    /// Takes no more memory than it must until it is read again.
    fn rest(&self) -> Result<()>;
}

impl Made for Vec<u8> {
    fn arena(&self) -> Result<Arena<'_>> {
        Arena::new(self).map_err(|fault| Error::Format { path: "memory".into(), fault })
    }

    fn rest(&self) -> Result<()> {
        Ok(())
    }
}

impl Made for AdjFile {
    fn arena(&self) -> Result<Arena<'_>> {
        AdjFile::arena(self)
    }

    fn rest(&self) -> Result<()> {
        AdjFile::rest(self)
    }
}

/// Writes rows as a level with the given facts and number of lanes.
type Write<'a, M> = &'a mut dyn FnMut(&dyn Rows, &Facts, u8, &mut dyn Observer) -> Result<M>;

/// Returns the levels that are `given`, or else the wanted levels of `rows`, from level 1 on, with `output.lane_count` lanes each.
fn levels<M: Made>(
    rows: &dyn Rows,
    given: Option<&GivenLevels>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
    write: Write<M>,
) -> Result<Vec<M>> {
    if let Some(given) = given {
        return written(given, output, observer, write);
    }
    let (wanted, look) = (output.levels, LevelLook::new(output.description.as_bytes(), &output.facts));
    let mut facts = output.facts.clone();
    if wanted == Levels::Auto {
        facts.visible_voxels = rows.count()?;
    }
    let mut levels: Vec<M> = Vec::new();
    for number in 1.. {
        let next = level_facts(&facts).filter(|_| wanted.want(number, &facts.grid, facts.visible_voxels));
        let Some((coarser, factors)) = next else { break };
        let observer = &mut LevelObserver { observer, number };
        let first = with_rows(levels.last(), rows, |below| {
            let rows =
                CoarserRows::new(below, facts.grid.spacing, factors, &look, output.threads.clamp(1, MOST_THREADS));
            write(&rows, &coarser, 1, observer)
        })?;
        let voxels = first.arena()?.facts().visible_voxels;
        if !wanted.keep(voxels, facts.visible_voxels) {
            break;
        }
        let coarser = Facts { visible_voxels: voxels, ..coarser };
        levels.last().map_or(Ok(()), M::rest)?;
        levels.push(match output.lane_count {
            0 | 1 => first,
            lanes => with_rows(Some(&first), rows, |rows| write(rows, &coarser, lanes, observer))?,
        });
        facts = coarser;
    }
    Ok(levels)
}

/// Calls `make` with the voxels of `level`; without one, with `rows`.
fn with_rows<M: Made>(level: Option<&M>, rows: &dyn Rows, make: impl FnOnce(&dyn Rows) -> Result<M>) -> Result<M> {
    let Some(level) = level else { return make(rows) };
    make(&level.arena()?.rows())
}

/// Returns the levels of a file of `rows`, those that are `given` or new ones, each in a file without a name in `folder`.
pub(crate) fn levels_in_files(
    folder: &Path,
    rows: &dyn Rows,
    given: Option<&GivenLevels>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<AdjFile>> {
    let limit = most_resident(output);
    let readers = output.threads.clamp(1, MOST_THREADS) as u64;
    // The most memory that the level takes from which the next is made. None is made from one that is given.
    let mut held = 0;
    let write = &mut |rows: &dyn Rows, facts: &Facts, lane_count: u8, observer: &mut dyn Observer| {
        let (facts, levels) = (facts.clone(), Levels::default());
        let memory = output.memory.map(|memory| memory.saturating_sub(held));
        let output = RowsOutput { facts, description: DESCRIPTION, lane_count, memory, levels, ..output.clone() };
        let level = bounded(open_rows(folder, rows, &output, observer)?, limit)?;
        if let (Some(limit), None) = (limit, given) {
            held = limit + readers * in_flight(level.arena()?.bytes().len() as u64);
        }
        Ok(level)
    };
    levels(rows, given, output, observer, write)
}

/// Returns the most bytes of a level's file that may be resident; `None` for no limit.
pub(super) fn most_resident(output: &RowsOutput) -> Option<u64> {
    // Where the system cannot release pages, it may take them back by itself.
    output.memory.filter(|_| cfg!(unix)).map(|memory| (memory / RESIDENT_SHARE).min(RESIDENT_BYTES))
}

pub(super) fn bounded(level: AdjFile, limit: Option<u64>) -> Result<AdjFile> {
    match limit {
        Some(limit) => level.keep_resident_below(limit),
        None => Ok(level),
    }
}

/// Returns the bytes of the levels of a file of `rows`, those that are `given` or new ones.
pub(super) fn levels_in_memory(
    rows: &dyn Rows,
    given: Option<&GivenLevels>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<Vec<u8>>> {
    let write = &mut |rows: &dyn Rows, facts: &Facts, lane_count: u8, observer: &mut dyn Observer| {
        let lanes = lanes_of(rows, facts, lane_count, output.threads, observer)?;
        let facts = facts_of_rows(facts, rows);
        let visible_voxels = lanes[0].steps.iter().filter(|&&step| step != 0).count() as u64;
        Ok(arena_bytes(&Facts { visible_voxels, ..facts }, &lanes, DESCRIPTION))
    };
    levels(rows, given, output, observer, write)
}

/// Writes levels that are `given`, from level 1 on.
fn written<M>(
    given: &GivenLevels,
    output: &RowsOutput,
    observer: &mut dyn Observer,
    write: Write<M>,
) -> Result<Vec<M>> {
    let mut facts = output.facts.clone();
    let mut levels = Vec::new();
    for (number, rows) in (1..).zip(&given.rows) {
        let Some((coarser, _)) = level_facts(&facts) else { break };
        levels.push(write(&**rows, &coarser, output.lane_count, &mut LevelObserver { observer, number })?);
        facts = coarser;
    }
    Ok(levels)
}

/// Tells an observer that lanes are those of a level.
struct LevelObserver<'a> {
    observer: &'a mut dyn Observer,
    number: u8,
}

impl Observer for LevelObserver<'_> {
    fn progress(&mut self, _phase: Phase, done: u64, total: u64) -> ControlFlow<()> {
        self.observer.progress(Phase::Level(self.number), done, total)
    }
}
