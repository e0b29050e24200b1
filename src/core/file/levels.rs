//! Makes the coarser levels of a file, before the file itself is written.
//!
//! In: rows of voxels. Out: levels, each a complete `.adj` file, in memory or in a file without a name. Of each level the
//! lane along x is written first: the other lanes, and the next level, are made from that.

use std::fs::File;
use std::ops::ControlFlow;
use std::path::Path;

use super::atomic_temporary::unnamed;
use super::map::AdjFile;
use super::write::{RowsOutput, arena_bytes, facts_of_rows, write_rows_to};
use crate::arena::layout::Facts;
use crate::arena::levels::level_facts;
use crate::arena::pager::IN_FLIGHT;
use crate::arena::{Arena, CoarserRows, LaneRows, LevelLook, Levels, Region, Rows};
use crate::build::builder::lanes_of;
use crate::build::progress::{Observer, Phase};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::volume::Axis;

/// The description of a level: it has no facts of its own.
const DESCRIPTION: &str = "{}";
/// Largest part of the memory, and most bytes, that the resident pages of a level may take while the next is made from it.
const RESIDENT_SHARE: u64 = 32;
const RESIDENT_BYTES: u64 = 16 << 20;

/// A level that was made.
pub(super) trait Made: Sized {
    fn arena(&self) -> Result<Arena<'_>>;
}

impl Made for Vec<u8> {
    fn arena(&self) -> Result<Arena<'_>> {
        Arena::new(self).map_err(|fault| Error::Format { path: "memory".into(), fault })
    }
}

impl Made for AdjFile {
    fn arena(&self) -> Result<Arena<'_>> {
        AdjFile::arena(self)
    }
}

/// Writes rows as a level with the given facts and number of lanes.
type Write<'a, M> = &'a mut dyn FnMut(&dyn Rows, &Facts, u8, &mut dyn Observer) -> Result<M>;

/// Returns the `wanted` levels of `rows`, from level 1 on, with `lane_count` lanes each.
fn levels<M: Made>(
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
    write: Write<M>,
) -> Result<Vec<M>> {
    let (wanted, look) = (output.levels, LevelLook::new(output.description.as_bytes(), &output.facts));
    let mut facts = output.facts.clone();
    if wanted == Levels::Auto {
        facts.visible_voxels = 0;
        let count = &mut |_: u16, _: u16, voxels: &[_]| facts.visible_voxels += voxels.len() as u64;
        rows.read(Region::of_grid(rows.dims()), count)?;
    }
    let mut levels: Vec<M> = Vec::new();
    for number in 1.. {
        let next = level_facts(&facts).filter(|_| wanted.want(number, &facts.grid, facts.visible_voxels));
        let Some((coarser, factors)) = next else { break };
        let observer = &mut LevelObserver { observer, number };
        let first = with_rows(levels.last(), rows, |below| {
            let rows = CoarserRows::new(below, facts.grid.spacing, factors, &look, output.threads.max(1));
            write(&rows, &coarser, 1, observer)
        })?;
        let voxels = first.arena()?.facts().visible_voxels;
        if !wanted.keep(voxels, facts.visible_voxels) {
            break;
        }
        let coarser = Facts { visible_voxels: voxels, ..coarser };
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
    let arena = level.arena()?;
    let lane = arena.lane(Axis::X).expect("by R10 every arena that opens has the lane along x");
    make(&LaneRows::new(lane, |_, _, record| Some(record)))
}

/// Returns the levels of a file of `rows`, each in a file without a name in `folder`.
pub(crate) fn levels_in_files(
    folder: &Path,
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<AdjFile>> {
    let limit = most_resident(output);
    let held = limit.map_or(0, |limit| limit + output.threads.max(1) as u64 * IN_FLIGHT);
    let memory = output.memory.map(|memory| memory.saturating_sub(held));
    let write = &mut |rows: &dyn Rows, facts: &Facts, lane_count: u8, observer: &mut dyn Observer| {
        bounded(in_file(folder, rows, facts, &RowsOutput { lane_count, memory, ..output.clone() }, observer)?, limit)
    };
    levels(rows, output, observer, write)
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

/// Writes `rows` as a level to a file without a name in `folder`.
fn in_file(
    folder: &Path,
    rows: &dyn Rows,
    facts: &Facts,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<AdjFile> {
    let file: File = unnamed(folder)?;
    let (facts, levels) = (facts.clone(), Levels::default());
    let output = RowsOutput { facts, description: DESCRIPTION, levels, ..output.clone() };
    write_rows_to(&file, folder, folder, rows, &output, observer)?;
    AdjFile::of(&file, folder, &Limits::default())
}

/// Returns the bytes of the levels of a file of `rows`.
pub(super) fn levels_in_memory(
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<Vec<u8>>> {
    let write = &mut |rows: &dyn Rows, facts: &Facts, lane_count: u8, observer: &mut dyn Observer| {
        in_memory(rows, facts, lane_count, output.threads, observer)
    };
    levels(rows, output, observer, write)
}

/// Returns the bytes of `rows` as a level.
fn in_memory(
    rows: &dyn Rows,
    facts: &Facts,
    lane_count: u8,
    threads: usize,
    observer: &mut dyn Observer,
) -> Result<Vec<u8>> {
    let lanes = lanes_of(rows, facts, lane_count, threads, observer)?;
    let facts = facts_of_rows(facts, rows);
    let visible_voxels = lanes[0].steps.iter().filter(|&&step| step != 0).count() as u64;
    Ok(arena_bytes(&Facts { visible_voxels, ..facts }, &lanes, DESCRIPTION))
}

/// Returns levels that are there already, from level 1 on, as files without a name in `folder`.
pub(super) fn given_levels_in_files(
    folder: &Path,
    levels: &[Box<dyn Rows + '_>],
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<AdjFile>> {
    let limit = most_resident(output);
    given(levels, output, observer, |rows, facts, observer| {
        bounded(in_file(folder, rows, facts, output, observer)?, limit)
    })
}

/// Returns the bytes of levels that are there already, from level 1 on.
pub(super) fn given_levels_in_memory(
    levels: &[Box<dyn Rows + '_>],
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<Vec<u8>>> {
    given(levels, output, observer, |rows, facts, observer| {
        in_memory(rows, facts, output.lane_count, output.threads, observer)
    })
}

/// Writes each of `levels` with `write`, which receives the facts that it has above a file of `output`.
fn given<M>(
    levels: &[Box<dyn Rows + '_>],
    output: &RowsOutput,
    observer: &mut dyn Observer,
    mut write: impl FnMut(&dyn Rows, &Facts, &mut dyn Observer) -> Result<M>,
) -> Result<Vec<M>> {
    let mut facts = output.facts.clone();
    let mut written = Vec::new();
    for (number, rows) in (1..).zip(levels) {
        let Some((coarser, _)) = level_facts(&facts) else { break };
        written.push(write(&**rows, &coarser, &mut LevelObserver { observer, number })?);
        facts = coarser;
    }
    Ok(written)
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
