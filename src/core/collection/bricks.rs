//! Opening a collection: its manifest, and its bricks one by one.
//!
//! In: a folder. Out: [`Collection`], in which a brick that is missing, damaged or of another build is a fault with the
//! brick's name; the others can still be joined and drawn.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::joined::JoinedRows;
use super::levels::{limits_of_whole, rows_of};
use super::manifest::{BrickEntry, Manifest, fingerprint};
use crate::arena::lanes::LevelLanes;
use crate::arena::layout::{Channels, Facts, LevelLimits};
use crate::arena::{Checked, Detail, LaneSet, Region, Rows};
use crate::build::Observer;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::file::{AdjFile, GivenLevels, RowsOutput, bytes_of_rows, open_rows_and_levels, write_rows_and_levels};
use crate::limits::Limits;
use crate::volume::Grid;
use crate::volume::source::obtainable;

/// An open collection: a manifest, and the bricks that fit it.
#[derive(Debug)]
pub struct Collection {
    path: PathBuf,
    manifest: Manifest,
    bricks: Vec<Brick>,
    preview: Option<Result<AdjFile>>,
    faults: Vec<Error>,
    /// The facts of the levels of the whole, level 1 first.
    levels: Vec<Facts>,
    /// Their limits; none if a brick does not say its own.
    level_limits: Vec<LevelLimits>,
    /// The function that the whole was built with.
    build_function: Option<TransferFunction>,
}

/// A brick of an open collection.
#[derive(Debug)]
pub struct Brick {
    /// What the manifest says of the brick.
    pub entry: BrickEntry,
    /// The brick's file, memory-mapped; `None` if it has no voxels, or a fault.
    pub file: Option<AdjFile>,
    /// The derived lanes of the file and of its levels; `None` without a file.
    lanes: Option<Arc<LevelLanes>>,
}

impl Collection {
    /// Opens the collection in the folder `path`, with default limits.
    ///
    /// # Errors
    /// The errors of [`Collection::open_with`].
    pub fn open(path: impl AsRef<Path>) -> Result<Collection> {
        Collection::open_with(path, &Limits::default())
    }

    /// Opens a collection that need not be trusted. Reads the manifest and the bricks' headers.
    ///
    /// What is wrong with single bricks is no error here: see [`Collection::faults`].
    ///
    /// # Errors
    /// The errors of [`Manifest::read`].
    pub fn open_with(path: impl AsRef<Path>, limits: &Limits) -> Result<Collection> {
        let path = path.as_ref().to_path_buf();
        let manifest = Manifest::read(&path, limits)?;
        let description = manifest.description().as_bytes();
        let build_function = TransferFunction::of_description(description, manifest.grid.mean_spacing());
        let (mut bricks, mut faults) = (Vec::new(), Vec::new());
        for entry in manifest.partitions.iter().flatten() {
            let facts = Facts {
                grid: entry.region().grid(&manifest.grid),
                visible_voxels: entry.visible_voxels,
                ..manifest.facts()
            };
            let content = Content { facts, levels: manifest.levels, fingerprint: entry.fingerprint.as_deref() };
            let opened = entry.file.as_ref().map(|name| opened(&path.join(name), &content, limits));
            let with_lanes = |file: AdjFile| {
                let arena = file.arena()?;
                let level = |number| arena.level(number).filter(|_| number <= manifest.levels);
                let lanes = LevelLanes::new(&arena, level, build_function.clone(), limits.derived_bytes);
                Ok((file, Arc::new(lanes)))
            };
            let opened = opened.map(|file| file.and_then(with_lanes)).transpose();
            let (file, lanes) = opened
                .unwrap_or_else(|fault| {
                    faults.push(fault);
                    None
                })
                .unzip();
            bricks.push(Brick { entry: entry.clone(), file, lanes });
        }
        let preview = manifest.preview.as_ref().map(|entry| {
            let facts = entry.facts(&manifest.facts());
            let content = Content { facts, levels: 0, fingerprint: Some(&entry.fingerprint) };
            opened(&path.join(&entry.file), &content, limits)
        });
        let levels = manifest.levels().into_iter().map(|level| level.facts).collect();
        let mut collection =
            Collection { path, manifest, bricks, preview, faults, levels, level_limits: Vec::new(), build_function };
        collection.sum_up_levels();
        Ok(collection)
    }

    /// Checks every byte of every brick. Bricks that are not sound are left out from now on, and named in [`Collection::faults`].
    pub fn leave_out_damaged(&mut self) {
        for brick in &mut self.bricks {
            if let Err(fault) = brick.check() {
                self.faults.push(fault);
                (brick.file, brick.lanes) = (None, None);
            }
        }
        self.sum_up_levels();
    }

    /// Counts the visible voxels of the whole's levels, and finds their limits.
    fn sum_up_levels(&mut self) {
        for number in 0..self.levels.len() {
            let of_bricks = self.once().iter().filter_map(|brick| brick.lanes.as_ref()?.levels.get(number));
            self.levels[number].visible_voxels = of_bricks.map(|facts| facts.visible_voxels).sum();
        }
        let with_lanes = self.once().iter().filter_map(|brick| Some((brick, brick.lanes.as_ref()?)));
        let bricks = with_lanes.filter(|(_, lanes)| !lanes.levels.is_empty());
        let bricks = bricks.map(|(brick, lanes)| (brick.entry.visible_voxels, &lanes.limits[..]));
        self.level_limits = limits_of_whole(self.levels.len(), bricks);
    }

    /// Returns whether `path` is a collection: a folder with a manifest, or one whose name says that there should be one.
    pub fn is_at(path: &Path) -> bool {
        let is_named = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("adjs"));
        path.join(super::MANIFEST).is_file() || is_named && path.is_dir()
    }

    /// Returns the collection's folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the manifest.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Returns the paths of the files that the manifest names, and its own.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let Manifest { partitions, preview, .. } = &self.manifest;
        let bricks = partitions.iter().flatten().filter_map(|brick| brick.file.as_deref());
        let names = bricks.chain(preview.iter().map(|preview| preview.file.as_str())).chain([super::MANIFEST]);
        names.map(|name| self.path.join(name))
    }

    /// Returns the bricks, partition after partition, each by ascending z, then y, then x.
    pub fn bricks(&self) -> &[Brick] {
        &self.bricks
    }

    /// Returns the indices of the bricks of partition `number`.
    pub(super) fn bricks_of(&self, number: usize) -> Range<usize> {
        let partitions = &self.manifest.partitions;
        let start = partitions[..number].iter().map(Vec::len).sum();
        start..start + partitions[number].len()
    }

    /// Returns the bricks that hold the whole once: those of the partition that lacks the fewest voxels.
    pub(super) fn once(&self) -> &[Brick] {
        let there = |bricks: &Range<usize>| {
            let usable = self.bricks[bricks.clone()].iter().filter(|brick| brick.file.is_some());
            usable.map(|brick| brick.entry.visible_voxels).sum::<u64>()
        };
        // Of several the first.
        let partitions = (0..self.manifest.partitions.len()).rev().map(|number| self.bricks_of(number));
        &self.bricks[partitions.max_by_key(there).expect("there is a partition")]
    }

    /// Returns the number of visible voxels in bricks without faults.
    pub(super) fn visible_voxels(&self) -> u64 {
        let usable = self.once().iter().filter(|brick| brick.file.is_some());
        usable.map(|brick| brick.entry.visible_voxels).sum()
    }

    /// Returns the file of the whole with fewer grid points, memory-mapped; `None` if there is none, or if it has a fault.
    pub fn preview(&self) -> Option<&AdjFile> {
        self.preview.as_ref().and_then(|opened| opened.as_ref().ok())
    }

    /// Returns what is wrong with the preview; `None` if it can be used, or if there is none. The bricks do not need it.
    pub fn preview_fault(&self) -> Option<&Error> {
        self.preview.as_ref().and_then(|opened| opened.as_ref().err())
    }

    /// Returns the grid of the whole.
    pub fn grid(&self) -> &Grid {
        &self.manifest.grid
    }

    /// Returns the contents of the headers of the whole's coarser levels of detail, which bricks hold parts of; level 1 first.
    pub fn levels(&self) -> &[Facts] {
        &self.levels
    }

    /// Returns the levels with their limits, which are means of those of bricks, and the function that the whole was built with.
    pub(super) fn detail(&self) -> Detail<'_> {
        let Collection { levels, level_limits: limits, build_function, .. } = self;
        Detail { levels, limits, build_function: build_function.as_ref() }
    }

    /// Returns what is wrong with bricks, an error for each that names its file: missing, damaged, of another build.
    pub fn faults(&self) -> &[Error] {
        &self.faults
    }

    /// Refuses a collection that lacks bricks.
    ///
    /// # Errors
    /// [`Error::Input`] that says how many bricks cannot be used, and names the first with its fault.
    pub fn require_all(&self) -> Result<()> {
        let Some(first) = self.faults.first() else { return Ok(()) };
        let (count, all) = (self.faults.len(), self.bricks.len());
        Err(Error::input(self.path.display().to_string(), format!("{count} of {all} bricks cannot be used; {first}")))
    }

    /// Checks every byte of every brick and of the preview, and if all are right, [`Collection::check_rules`]; returns what is wrong,
    /// an error for each file.
    pub fn check(&self) -> Vec<Error> {
        let files = self.bricks.iter().filter_map(|brick| brick.file.as_ref()).chain(self.preview());
        let faults: Vec<Error> = files.filter_map(|file| file.check().err()).collect();
        if faults.is_empty() { self.check_rules() } else { faults }
    }

    /// Checks that bricks and the preview follow the rules C11 and C12 where joining and drawing do not need them; returns what is
    /// wrong. Reads headers and descriptions.
    pub fn check_rules(&self) -> Vec<Error> {
        let levels_of = |file: &AdjFile| {
            let (count, wanted) = (file.arena()?.level_count(), self.manifest.levels);
            if count == wanted {
                return Ok(());
            }
            let s = if count == 1 { "" } else { "s" };
            let why = format!("has {count} level{s} of detail, but the manifest says {wanted} (C12)");
            Err(Error::input(file.path().display().to_string(), format!("{why}; make the collection again")))
        };
        let bricks = self.bricks.iter().filter_map(|brick| levels_of(brick.file.as_ref()?).err());
        let preview = self.manifest.preview.as_ref().zip(self.preview());
        bricks.chain(preview.and_then(|(entry, file)| entry.check(&self.manifest, file).err())).collect()
    }

    /// Returns the visible voxels of all bricks without faults, as rows of the whole grid.
    ///
    /// # Errors
    /// [`Error::Format`] if a file was changed in place since it was opened.
    pub fn rows(&self) -> Result<impl Rows + '_> {
        self.joined_rows(0, &self.manifest.facts(), Region::clone)
    }

    /// Returns the voxels of level `number` of all bricks without faults, as rows of a grid in which a brick has a `place`.
    fn joined_rows(&self, number: u8, facts: &Facts, place: impl Fn(&Region) -> Region) -> Result<JoinedRows<'_>> {
        let mut bricks = Vec::new();
        for Brick { entry, file, .. } in self.once() {
            let Some(file) = file else { continue };
            bricks.push((place(&entry.region()), rows_of(&file.arena()?, number, None)?));
        }
        // Where one has levels of an older version, only the directions of normals count.
        let coherence = facts.channels.coherence && bricks.iter().all(|(_, rows)| rows.channels().coherence);
        Ok(JoinedRows { dims: facts.grid.dims, channels: Channels { coherence, ..facts.channels }, bricks })
    }

    /// Returns the first `most` levels of all bricks without faults, to be drawn at once.
    fn levels_to_draw(&self, most: usize) -> Result<GivenLevels<'_>> {
        let (rows, mut limits) = (self.level_rows(most)?, self.level_limits.clone());
        limits.truncate(rows.len());
        Ok(GivenLevels { rows, limits: Some(limits) })
    }

    /// Returns the voxels of the first `most` levels of all bricks without faults, from level 1 on.
    fn level_rows(&self, most: usize) -> Result<Vec<Box<dyn Rows + '_>>> {
        let levels = (1..).zip(self.manifest.levels()).take(most);
        let rows = levels.map(|(number, level)| {
            let rows = self.joined_rows(number, &level.facts, |region| level.place(region))?;
            Ok(Box::new(rows) as Box<dyn Rows + '_>)
        });
        rows.collect()
    }

    /// Joins the bricks in memory: returns the bytes of the `.adj` file that [`Collection::join`] writes, but with no more than
    /// `levels` coarser levels of detail, whose limits are means of those of the bricks.
    ///
    /// # Errors
    /// [`Error::Limit`] if the bricks' files are larger than `most` bytes in all; any error of reading them.
    pub fn joined_bytes(
        &self,
        levels: usize,
        most: u64,
        threads: usize,
        observer: &mut dyn Observer,
    ) -> Result<Vec<u8>> {
        let mut need = 0u64;
        let once = self.once();
        for file in once.iter().filter_map(|brick| brick.file.as_ref()) {
            need = need.saturating_add(file.arena()?.bytes().len() as u64);
        }
        let what = "bytes of memory, to join its bricks (open its preview, or a brick)";
        Limits::default().check(&self.path, what, need, most.min(obtainable(need)))?;
        let rows = self.rows()?;
        let visible_voxels = self.visible_voxels();
        if visible_voxels == 0 {
            return Err(Error::input(self.path.display().to_string(), "none of its bricks can be used"));
        }
        let facts = Facts { visible_voxels, ..self.manifest.facts() };
        let output = RowsOutput { facts, threads, ..self.output() };
        bytes_of_rows(&rows, Some(&self.levels_to_draw(levels)?), &output, observer)
    }

    /// Joins the bricks like [`Collection::join`], but with no more than `levels` coarser levels of detail, and to a file without
    /// a name in `folder`, which disappears when it is closed.
    ///
    /// # Errors
    /// The errors of [`open_rows`](crate::file::open_rows).
    pub fn joined_file(
        &self,
        levels: usize,
        folder: &Path,
        memory: Option<u64>,
        threads: usize,
        observer: &mut dyn Observer,
    ) -> Result<AdjFile> {
        let output = RowsOutput { memory, threads, ..self.output() };
        open_rows_and_levels(folder, &self.rows()?, Some(&self.levels_to_draw(levels)?), &output, observer)
    }

    /// Joins the bricks to an `.adj` file at `path`, with bounded memory; returns its header facts and length in bytes. Pages of
    /// the mapped bricks are not counted, because the system can take them back.
    ///
    /// Without faults it has the bytes of the file that one build of the whole volume makes. Bricks with faults are left
    /// out: ask [`Collection::require_all`] first. Bytes of bricks are not checked: see [`Collection::leave_out_damaged`].
    ///
    /// # Errors
    /// The errors of [`write_rows`](crate::file::write_rows).
    pub fn join(
        &self,
        path: &Path,
        memory: Option<u64>,
        threads: usize,
        observer: &mut dyn Observer,
    ) -> Result<(Facts, u64)> {
        let output = RowsOutput { memory, threads, ..self.output() };
        let levels = GivenLevels { rows: self.level_rows(usize::MAX)?, limits: None };
        write_rows_and_levels(path, &self.rows()?, Some(&levels), &output, observer)
    }

    /// Returns what the joined file holds beside the voxels, to be written by one thread.
    fn output(&self) -> RowsOutput<'_> {
        RowsOutput {
            facts: self.manifest.facts(),
            description: self.manifest.description(),
            lane_count: self.manifest.lanes,
            memory: None,
            threads: 1,
            levels: self.manifest.levels.into(),
        }
    }
}

impl Brick {
    /// Checks every byte of the brick's file; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Format`] with the first broken rule.
    pub fn check(&self) -> Result<Option<Checked>> {
        self.file.as_ref().map(AdjFile::check).transpose()
    }

    /// Returns the lanes of the brick's file and of its levels, stored or derived; `None` if it has no file.
    pub(super) fn lanes(&self) -> Result<Option<LaneSet<'_>>> {
        let Some((file, lanes)) = self.file.as_ref().zip(self.lanes.as_ref()) else { return Ok(None) };
        Ok(Some(LaneSet::sharing(file.arena()?, lanes.clone())))
    }
}

/// What a manifest says of the content of a file.
struct Content<'a> {
    facts: Facts,
    levels: u8,
    fingerprint: Option<&'a str>,
}

/// Opens a brick or a preview, and compares it with what the manifest says of it.
fn opened(path: &Path, content: &Content, limits: &Limits) -> Result<AdjFile> {
    let wrong = |why: &str| Err(Error::input(path.display().to_string(), why));
    if std::fs::metadata(path).is_err_and(|fault| fault.kind() == std::io::ErrorKind::NotFound) {
        return wrong("is missing; copy it into the folder again, or build it again");
    }
    let file = AdjFile::open_with(path, limits)?;
    let arena = file.arena()?;
    let facts = arena.facts();
    // A preview may be a level of an older version.
    let codes = Channels { coherence: content.facts.channels.coherence, ..facts.channels };
    if (codes, facts.scales) != (content.facts.channels, content.facts.scales) {
        return wrong("has other codes than the collection; build it again with the collection's plan");
    }
    if facts.grid != (Grid { unit: None, ..content.facts.grid.clone() }) {
        return wrong("has another grid than its place in the collection");
    }
    let number = fingerprint(arena.fingerprint());
    if (facts.visible_voxels, Some(number.as_str())) != (content.facts.visible_voxels, content.fingerprint) {
        return wrong("is of another build than the collection's manifest; build it again, or restore the old file");
    }
    if content.levels != 0 && arena.level_count() != content.levels {
        return wrong("has other levels of detail than the collection; build it again with the collection's plan");
    }
    Ok(file)
}
