//! From one `.adj` file to a collection, without the volume.

use std::path::Path;

use super::levels::{Level, allowed, levels_of, rows_of};
use super::manifest::{BrickEntry, Manifest, brick_description, described, fingerprint};
use super::partition::check_count;
use super::preview::{PreviewForm, choice, join_level, join_preview, remove_if_there, remove_parts};
use super::{Collection, Partition};
use crate::arena::layout::Facts;
use crate::arena::{Arena, Levels, Region, Rows};
use crate::build::Observer;
use crate::build::progress::{Phase, report};
use crate::error::{Error, Result};
use crate::file::{AdjFile, GivenLevels, RowsOutput, write_folder_atomically, write_rows_and_levels};
use crate::volume::Grid;

/// Writes the voxels of `arena` as a collection at `path`, with a brick for each box of each of `partitions`, one to three.
///
/// Bricks hold the parts of the file's coarser levels of detail whose blocks no cut divides; the levels from the first that a cut
/// divides on are left out.
///
/// Its preview has every `preview`-th grid point along each axis; with 0 or 1 it has none. By default it has at most 2^24 voxels,
/// and none if the whole has no more.
///
/// `memory` bounds the bytes that the process may use; `threads` work. Reads each brick's part of the lane along x. The
/// folder appears complete or not at all.
///
/// # Errors
/// [`Error::Input`] if something exists at `path`, if the arena's description is no JSON, or if there are not one to three
/// partitions of the arena's grid; [`Error::Io`] if nothing can be written there;
/// [`Error::Interrupted`] if the observer cancels.
pub fn split(
    arena: &Arena,
    partitions: &[Partition],
    preview: Option<u32>,
    path: &Path,
    memory: Option<u64>,
    threads: usize,
    observer: &mut dyn Observer,
) -> Result<Collection> {
    let whole = arena.facts();
    check_count("split", partitions.len())?;
    if let Some(partition) = partitions.iter().find(|partition| partition.dims() != whole.grid.dims) {
        let why = format!("is of {:?} points, but the grid has {:?}", partition.dims(), whole.grid.dims);
        return Err(Error::input("partition", why));
    }
    let text = std::str::from_utf8(arena.description()).unwrap_or_default();
    described(text)?;
    let lane_count = u8::try_from(arena.lanes().count()).expect("there are three axes");
    let mut levels = levels_of(whole, arena.level_count());
    levels.truncate(allowed(partitions, &levels));
    let level_count = u8::try_from(levels.len()).expect("at most 15");
    let voxels_of = |number| arena.level(number).map_or(0, |level| level.facts().visible_voxels);
    let preview = choice(preview, whole.visible_voxels, &levels, voxels_of);
    let all_voxels =
        RowsOutput { facts: whole.clone(), description: text, lane_count, memory, threads, levels: Levels::default() };
    let total = partitions.iter().map(|partition| partition.len() as u64).sum();
    write_folder_atomically(&|| false, path, |folder| {
        let (mut written, mut all) = (0, Vec::new());
        for (number, partition) in partitions.iter().enumerate() {
            let mut bricks = Vec::new();
            for region in partition.boxes() {
                report(observer, Phase::Pack, written, total)?;
                written += 1;
                let rows = arena.rows().cropped(&region);
                let voxels = rows.count()?;
                let facts = Facts { grid: region.grid(&whole.grid), visible_voxels: voxels, ..whole.clone() };
                let description = brick_description(text, &region, whole.grid.dims);
                let output = RowsOutput { facts, description: &description, ..all_voxels.clone() };
                let of_level = |(number, level): (u8, &Level)| rows_of(arena, number, Some(&level.place(&region)));
                let levels = (1..).zip(&levels).map(of_level).collect::<Result<Vec<_>>>()?;
                let place = BrickPlace { partition: number, region };
                // Bricks are then drawn from the levels that the whole is drawn from.
                let limits = Some(arena.level_limits().iter().take(level_count.into()).copied().collect());
                place.write(folder, &rows, voxels, &GivenLevels { rows: levels, limits }, &output, observer)?;
                if let (0, PreviewForm::EveryNth(every)) = (number, preview) {
                    place.write_preview(folder, &rows, every, &whole.grid, &output, observer)?;
                }
                bricks.push(place.found(folder, whole, level_count)?);
            }
            all.push(bricks);
        }
        let preview = match (partitions.first(), all.first(), preview) {
            (Some(first), Some(bricks), PreviewForm::EveryNth(every)) => {
                let preview = join_preview(folder, bricks, every, &all_voxels, observer)?;
                remove_parts(folder, first.boxes())?;
                preview
            }
            (_, Some(bricks), PreviewForm::Level(number)) => {
                join_level(folder, bricks, &levels, number, &all_voxels, observer)?
            }
            _ => None,
        };
        Manifest::new(whole, [lane_count, level_count], text, all, preview)?.write(folder)
    })?;
    Collection::open(path)
}

/// Where a brick lies: its partition, and its box in the whole.
pub(super) struct BrickPlace {
    pub(super) partition: usize,
    pub(super) region: Region,
}

impl BrickPlace {
    /// Writes a brick of `voxels` visible voxels, with `levels`, into `folder`; none if there are no voxels.
    pub(super) fn write(
        &self,
        folder: &Path,
        rows: &dyn Rows,
        voxels: u64,
        levels: &GivenLevels,
        output: &RowsOutput,
        observer: &mut dyn Observer,
    ) -> Result<()> {
        let path = folder.join(self.file());
        if voxels == 0 {
            return remove_if_there(&path);
        }
        write_rows_and_levels(&path, rows, Some(levels), output, observer).map(|_| ())
    }

    /// Returns the entry of the brick that was written into `folder`; one without voxels if there is none. `whole` are the facts
    /// of the joined file, `levels` is its number of levels.
    ///
    /// # Errors
    /// [`Error::Input`] if the file has another place or other codes; the errors of [`AdjFile::open`].
    pub(super) fn found(&self, folder: &Path, whole: &Facts, levels: u8) -> Result<BrickEntry> {
        let (low, size, file) = (self.region.low(), self.region.size(), self.file());
        let path = folder.join(&file);
        if !path.try_exists().map_err(Error::io("open", &path))? {
            return Ok(BrickEntry { file: None, low, size, visible_voxels: 0, fingerprint: None });
        }
        let brick = AdjFile::open(&path)?;
        let arena = brick.arena()?;
        let Facts { grid, channels, scales, visible_voxels, .. } = arena.facts().clone();
        let place = Grid { unit: None, ..self.region.grid(&whole.grid) };
        let is_of_plan = (grid, channels, scales) == (place, whole.channels, whole.scales);
        if !is_of_plan || arena.level_count() != levels {
            return Err(Error::input(path.display().to_string(), "is of another plan; build this brick again"));
        }
        let number = arena.fingerprint();
        Ok(BrickEntry { file: Some(file), low, size, visible_voxels, fingerprint: Some(fingerprint(number)) })
    }

    /// Returns the name of the brick's file: the partition, and z, y and x of its lowest point.
    fn file(&self) -> String {
        let ([x, y, z], partition) = (self.region.low(), self.partition);
        format!("brick-{partition}-{z:05}-{y:05}-{x:05}.adj")
    }
}
