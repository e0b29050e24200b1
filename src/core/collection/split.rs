//! From one `.adj` file to a collection, without the volume.

use std::path::Path;

use super::manifest::{BrickEntry, Manifest, brick_description, fingerprint};
use super::{Collection, Partition};
use crate::arena::layout::Facts;
use crate::arena::{Arena, LaneRows, Region, Rows};
use crate::build::Observer;
use crate::build::progress::{Phase, report};
use crate::error::Result;
use crate::file::{AdjFile, RowsOutput, write_folder_atomically, write_rows};
use crate::volume::Axis;

/// Writes the voxels of `arena` as a collection at `path`, with a brick for each box of each of `partitions`, one to three.
///
/// `memory` bounds the bytes that the process may use; `threads` work. Reads each brick's part of the lane along x. The
/// folder appears complete or not at all.
///
/// # Errors
/// [`Error::Input`](crate::Error::Input) if something exists at `path`, if the arena's description is no JSON, or if the partition is of another
/// grid; [`Error::Io`](crate::Error::Io) if nothing can be written there;
/// [`Error::Interrupted`](crate::Error::Interrupted) if the observer cancels.
pub fn split(
    arena: &Arena,
    partitions: &[Partition],
    path: &Path,
    memory: Option<u64>,
    threads: usize,
    observer: &mut dyn Observer,
) -> Result<Collection> {
    let whole = arena.facts();
    let text = std::str::from_utf8(arena.description()).unwrap_or_default();
    let lane_count = u8::try_from(arena.lanes().count()).expect("there are three axes");
    let lane = arena.lane(Axis::X).expect("every arena that opens has the lane along x");
    let total = partitions.iter().map(|partition| partition.len() as u64).sum();
    write_folder_atomically(&|| false, path, |folder| {
        let (mut written, mut all) = (0, Vec::new());
        for (number, partition) in partitions.iter().enumerate() {
            let mut bricks = Vec::new();
            for region in partition.boxes() {
                report(observer, Phase::Pack, written, total)?;
                written += 1;
                let rows = LaneRows::new(lane, |_, _, record| Some(record)).cropped(&region);
                let mut voxels = 0u64;
                rows.read(Region::of_grid(rows.dims()), &mut |_, _, found| voxels += found.len() as u64)?;
                let facts = Facts { grid: region.grid(&whole.grid), visible_voxels: voxels, ..whole.clone() };
                let description = brick_description(text, &region, whole.grid.dims);
                let output = RowsOutput { facts, description: &description, lane_count, memory, threads };
                let place = BrickPlace { partition: number, region };
                place.write(folder, &rows, voxels, &output, observer)?;
                bricks.push(place.found(folder)?);
            }
            all.push(bricks);
        }
        Manifest::new(whole, lane_count, text, all)?.write(folder)
    })?;
    Collection::open(path)
}

/// Where a brick lies: its partition, and its box in the whole.
pub(super) struct BrickPlace {
    pub(super) partition: usize,
    pub(super) region: Region,
}

impl BrickPlace {
    /// Writes a brick of `voxels` visible voxels into `folder`; none if there are no voxels.
    pub(super) fn write(
        &self,
        folder: &Path,
        rows: &dyn Rows,
        voxels: u64,
        output: &RowsOutput,
        observer: &mut dyn Observer,
    ) -> Result<()> {
        if voxels > 0 {
            write_rows(&folder.join(self.file()), rows, output, observer)?;
        }
        Ok(())
    }

    /// Returns the entry of the brick that was written into `folder`; one without voxels if there is none.
    pub(super) fn found(&self, folder: &Path) -> Result<BrickEntry> {
        let (low, size, file) = (self.region.low(), self.region.size(), self.file());
        let path = folder.join(&file);
        if !path.exists() {
            return Ok(BrickEntry { file: None, low, size, visible_voxels: 0, fingerprint: None });
        }
        let brick = AdjFile::open(&path)?;
        let arena = brick.arena()?;
        let (visible_voxels, number) = (arena.facts().visible_voxels, arena.fingerprint());
        Ok(BrickEntry { file: Some(file), low, size, visible_voxels, fingerprint: Some(fingerprint(number)) })
    }

    /// Returns the name of the brick's file: the partition, and z, y and x of its lowest point.
    fn file(&self) -> String {
        let ([x, y, z], partition) = (self.region.low(), self.partition);
        format!("brick-{partition}-{z:05}-{y:05}-{x:05}.adj")
    }
}
