//! The preview of a collection: every n-th grid point along each axis, as one `.adj` file that fits any machine.
//!
//! Where bricks hold levels of detail, it is one of these instead, joined.
//!
//! In: the rows of each brick, when it is written. Out: a part of the preview for each brick; at the end the parts are
//! joined. Which points are kept depends on their place in the whole alone, so the preview does not depend on the bricks.
//! Every kept voxel stands for the n x n x n points around it: spacings are n times as long, and opacities still refer to
//! the lengths of the whole.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::BrickEntry;
use super::joined::JoinedRows;
use super::levels::{Level, levels_of, rows_of};
use super::manifest::{Manifest, fingerprint};
use super::split::BrickPlace;
use crate::arena::layout::{Channels, Facts};
use crate::arena::{Levels, Region, Rows, Voxel};
use crate::build::Observer;
use crate::build::description::description_object;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::file::{AdjFile, RowsOutput, write_rows};
use crate::volume::Grid;

/// The name of the preview's file in a collection's folder.
const PREVIEW: &str = "preview.adj";
/// Most voxels of a preview, if nobody says how coarse it is to be: about 200 MB.
const VOXELS: u64 = 1 << 24;

/// What a manifest says of the preview.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PreviewEntry {
    /// The preview's file in the collection's folder.
    pub file: String,
    /// Number of the whole's grid points per point of the preview, along each axis. The preview has every n-th point, from the first
    /// on; if it is a level, this is the most points along an axis that one of the level stands for.
    pub every: u32,
    /// The level of detail of the whole that the preview is; `None` if it has every n-th point.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub level: Option<u8>,
    /// Number of visible voxels of the preview.
    pub visible_voxels: u64,
    /// Fingerprint of the file: the checksum of its header and section table, as 16 hexadecimal digits.
    pub fingerprint: String,
}

/// Returns how coarse the preview of a collection of `visible_voxels` voxels is by default; 1 if it needs none.
pub(super) fn default_every(visible_voxels: u64) -> u32 {
    let fits = |every: &u32| visible_voxels.div_ceil(u64::from(*every).pow(3)) <= VOXELS;
    (1..=u16::MAX.into()).find(fits).unwrap_or(u16::MAX.into())
}

impl PreviewEntry {
    /// Returns what the header of the preview's file says, given that of the whole; the number of voxels is the preview's.
    pub(super) fn facts(&self, whole: &Facts) -> Facts {
        let of_level = self.level.and_then(|level| levels_of(whole, level).pop());
        let facts = match of_level {
            Some(level) => level.facts,
            None => Facts { grid: preview_grid(&whole.grid, self.every), ..whole.clone() },
        };
        Facts { visible_voxels: self.visible_voxels, ..facts }
    }

    /// Checks what joining and drawing do not need: the preview's tile order, lanes and transfer function, and its `every`. C11
    pub(super) fn check(&self, manifest: &Manifest, file: &AdjFile) -> Result<()> {
        let arena = file.arena()?;
        let whole = description(manifest.description(), &manifest.grid, self.every, self.level);
        let function = |text: &str| {
            let function = description_object(text.as_bytes())["transfer_function"].take();
            serde_json::from_value::<TransferFunction>(function).ok()
        };
        let of_preview = std::str::from_utf8(arena.description()).ok().and_then(function);
        let level = self.level.and_then(|number| levels_of(&manifest.facts(), number).pop());
        let tests = [
            ("tile order", arena.facts().tile_order == manifest.tile_order),
            ("number of lanes", arena.lanes().count() == usize::from(manifest.lanes)),
            ("distance between points (\"every\")", level.is_none_or(|level| points(&level) == self.every)),
            ("transfer function", of_preview == function(&whole)),
        ];
        match tests.into_iter().find(|(_, is_right)| !is_right) {
            None => Ok(()),
            Some((what, _)) => {
                let why = format!("has another {what} than the manifest says (C11); make the collection again");
                Err(Error::input(file.path().display().to_string(), why))
            }
        }
    }
}

/// What a preview shows of the whole, and with how many grid points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PreviewForm {
    /// None is made.
    None,
    /// Every n-th point.
    EveryNth(u32),
    /// One of the levels, from 1.
    Level(u8),
}

/// Chooses the preview of a collection of `visible_voxels` voxels.
///
/// `every`: points of the whole per point of the preview along an axis; `None` for a preview of about 2^24 voxels or fewer.
/// `voxels_of` counts the voxels of a level, from 1.
///
/// A level is preferred to every n-th point: it shows all voxels, as means.
pub(super) fn choice(
    every: Option<u32>,
    visible_voxels: u64,
    levels: &[Level],
    voxels_of: impl Fn(u8) -> u64,
) -> PreviewForm {
    let wanted = every.unwrap_or_else(|| default_every(visible_voxels)).max(1);
    let fits = |(number, level): &(u8, &Level)| match every {
        Some(every) => points(level) == every,
        None => voxels_of(*number) <= VOXELS,
    };
    match (1..).zip(levels).find(fits) {
        _ if wanted == 1 => PreviewForm::None,
        Some((number, _)) => PreviewForm::Level(number),
        None => PreviewForm::EveryNth(wanted),
    }
}

/// Returns the most points of the whole along an axis that one of a level stands for.
fn points(level: &Level) -> u32 {
    level.factors.into_iter().fold(1, u32::max)
}

/// Returns the grid of every `every`-th point of `whole`.
fn preview_grid(whole: &Grid, every: u32) -> Grid {
    Grid {
        dims: whole.dims.map(|points| points.div_ceil(every)),
        spacing: whole.spacing.map(|spacing| spacing * f64::from(every)),
        ..whole.clone()
    }
}

/// Returns the part of the preview's grid that lies in `brick`, a box of the whole; it may be empty.
fn part_of(brick: &Region, every: u32) -> Region {
    let side = |a: usize| {
        let side = brick.sides()[a];
        side.start.div_ceil(every)..side.end.div_ceil(every)
    };
    Region { xs: side(0), ys: side(1), zs: side(2) }
}

/// Returns the description of a preview: that of the whole, whose lengths stay those of the whole's voxels.
fn description(whole: &str, grid: &Grid, every: u32, level: Option<u8>) -> String {
    let mut description = description_object(whole.as_bytes());
    let stored = serde_json::from_value::<TransferFunction>(description["transfer_function"].clone());
    let length = grid.mean_spacing();
    let kept = stored.map_err(|_| ()).and_then(|function| {
        let reference = function.reference_length().unwrap_or(length);
        function
            .with_voxel_length(length)
            .and_then(|function| function.with_reference_length(reference))
            .map_err(|_| ())
    });
    // A function that cannot be read is no more readable in the preview.
    if let Ok(function) = kept {
        description["transfer_function"] = json!(function);
    }
    description["preview"] = json!({ "every": every, "of": grid.dims });
    if let Some(level) = level {
        description["preview"]["level"] = json!(level);
    }
    description.to_string()
}

/// Every n-th row and voxel of the rows of a brick.
struct EveryNth<'a> {
    rows: &'a dyn Rows,
    every: u32,
    /// The brick's first kept point, counted from its lowest point, along x, y, z.
    first: [u32; 3],
    dims: [u32; 3],
}

impl<'a> EveryNth<'a> {
    /// Returns those of `rows`, which are of the brick in `region`, that a preview of every `every`-th point has.
    fn of_brick(rows: &'a dyn Rows, region: &Region, every: u32) -> EveryNth<'a> {
        let (part, low) = (part_of(region, every), region.low());
        let first = std::array::from_fn(|a| part.low()[a] * every - low[a]);
        EveryNth { rows, every, first, dims: part.size() }
    }
}

impl Rows for EveryNth<'_> {
    fn dims(&self) -> [u32; 3] {
        self.dims
    }

    fn channels(&self) -> Channels {
        self.rows.channels()
    }

    fn memory(&self) -> u64 {
        self.rows.memory()
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let dims = self.rows.dims();
        let side = |a: usize| {
            let side = region.sides()[a];
            let at = |index: u32| self.first[a].saturating_add(index.saturating_mul(self.every)).min(dims[a]);
            at(side.start)..at(side.end)
        };
        let region = Region { xs: side(0), ys: side(1), zs: side(2) };
        let kept = |coordinate: u16, a: usize| {
            let from = u32::from(coordinate) - self.first[a];
            from.is_multiple_of(self.every).then(|| u16::try_from(from / self.every).expect("below the coordinate"))
        };
        let mut voxels: Vec<Voxel> = Vec::new();
        self.rows.read(region, &mut |y, z, found| {
            let (Some(y), Some(z)) = (kept(y, 1), kept(z, 2)) else { return };
            voxels.clear();
            voxels.extend(found.iter().filter_map(|voxel| Some(Voxel { x: kept(voxel.x, 0)?, ..*voxel })));
            if !voxels.is_empty() {
                row(y, z, &voxels);
            }
        })
    }
}

impl BrickPlace {
    /// Returns the name of the file with this brick's part of the preview.
    fn preview_file(&self) -> String {
        let [x, y, z] = self.region.low();
        format!("preview-{z:05}-{y:05}-{x:05}.adj")
    }

    /// Writes this brick's part of a preview of every `every`-th point into `folder`; none if it has no voxels. `rows` are the
    /// brick's, `whole` describes the whole volume.
    pub(super) fn write_preview(
        &self,
        folder: &Path,
        rows: &dyn Rows,
        every: u32,
        whole: &Grid,
        output: &RowsOutput,
        observer: &mut dyn Observer,
    ) -> Result<()> {
        let part = part_of(&self.region, every);
        let rows = EveryNth::of_brick(rows, &self.region, every);
        let voxels = if part.is_empty() { 0 } else { rows.count()? };
        let path = folder.join(self.preview_file());
        if voxels == 0 {
            return remove_if_there(&path);
        }
        let facts =
            Facts { grid: part.grid(&preview_grid(whole, every)), visible_voxels: voxels, ..output.facts.clone() };
        write_rows(
            &path,
            &rows,
            &RowsOutput { facts, description: "{}", lane_count: 1, levels: Levels::default(), ..output.clone() },
            observer,
        )?;
        Ok(())
    }
}

/// Removes a file that an earlier run may have left.
pub(super) fn remove_if_there(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(fault) if fault.kind() != std::io::ErrorKind::NotFound => Err(Error::io("remove", path)(fault)),
        _ => Ok(()),
    }
}

/// Joins the parts of the preview in `folder` that the builds of `bricks` left there to one file; `None` if it has no voxels.
/// A part that is not there is read from its brick. `output` and its facts are those of the joined file of all voxels.
pub(super) fn join_preview(
    folder: &Path,
    bricks: &[BrickEntry],
    every: u32,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Option<PreviewEntry>> {
    let whole = &output.facts;
    let grid = preview_grid(&whole.grid, every);
    let (mut parts, mut sources) = (Vec::new(), Vec::new());
    for entry in bricks {
        let (region, Some(file)) = (entry.region(), &entry.file) else { continue };
        let place = part_of(&region, every);
        let path = folder.join(BrickPlace { partition: 0, region: region.clone() }.preview_file());
        // Once it is open, a process that finishes too may remove it.
        if let Some(file) = opened_if_there(&path)? {
            let arena = file.arena()?;
            let found = arena.facts();
            let expected = unnamed(place.grid(&grid));
            if (found.channels, found.scales, &found.grid) != (whole.channels, whole.scales, &expected) {
                return Err(Error::input(path.display().to_string(), "is of another plan; build its brick again"));
            }
            parts.push((place, file));
        } else if !place.is_empty() {
            sources.push((region, AdjFile::open(&folder.join(file))?));
        }
    }
    let bricks_without = sources.iter().map(|(region, file)| Ok((region, lane_rows(file)?)));
    let bricks_without = bricks_without.collect::<Result<Vec<_>>>()?;
    let joined = parts.iter().map(|(place, file)| Ok((place.clone(), lane_rows(file)?)));
    let mut bricks = joined.collect::<Result<Vec<(Region, Box<dyn Rows + '_>)>>>()?;
    for (region, rows) in &bricks_without {
        let kept = EveryNth::of_brick(&**rows, region, every);
        if kept.count()? > 0 {
            bricks.push((part_of(region, every), Box::new(kept)));
        }
    }
    if bricks.is_empty() {
        return Ok(None);
    }
    bricks.sort_by_key(|(place, _)| (place.zs.start, place.ys.start, place.xs.start));
    let rows = JoinedRows { dims: grid.dims, channels: whole.channels, bricks };
    let facts = Facts { grid, ..whole.clone() };
    write(folder, &rows, facts, every, None, output, observer).map(Some)
}

/// Joins a level of `bricks` in `folder` to the file of the preview; `None` if no brick has voxels. `output` and its facts are
/// those of the joined file of all voxels, `number` is the level's of `levels`.
pub(super) fn join_level(
    folder: &Path,
    bricks: &[BrickEntry],
    levels: &[Level],
    number: u8,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Option<PreviewEntry>> {
    let level = &levels[usize::from(number) - 1];
    let files = bricks.iter().filter_map(|entry| Some((entry.region(), entry.file.as_ref()?)));
    let files = files.map(|(region, file)| Ok((region, AdjFile::open(&folder.join(file))?)));
    let files = files.collect::<Result<Vec<_>>>()?;
    let parts = files.iter().map(|(region, file)| Ok((level.place(region), rows_of(&file.arena()?, number, None)?)));
    let parts = parts.collect::<Result<Vec<_>>>()?;
    if parts.is_empty() {
        return Ok(None);
    }
    let facts = level.facts.clone();
    let rows = JoinedRows { dims: facts.grid.dims, channels: facts.channels, bricks: parts };
    write(folder, &rows, facts, points(level), Some(number), output, observer).map(Some)
}

/// Writes `rows` with `facts` as the file of the preview.
fn write(
    folder: &Path,
    rows: &dyn Rows,
    facts: Facts,
    every: u32,
    level: Option<u8>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<PreviewEntry> {
    let description = description(output.description, &output.facts.grid, every, level);
    let path = folder.join(PREVIEW);
    let output = RowsOutput { facts, description: &description, levels: Levels::default(), ..output.clone() };
    let (facts, _) = write_rows(&path, rows, &output, observer)?;
    let number = AdjFile::open(&path)?.arena()?.fingerprint();
    let (visible_voxels, fingerprint) = (facts.visible_voxels, fingerprint(number));
    Ok(PreviewEntry { file: PREVIEW.into(), every, level, visible_voxels, fingerprint })
}

/// Returns the rows of a file.
fn lane_rows(file: &AdjFile) -> Result<Box<dyn Rows + '_>> {
    rows_of(&file.arena()?, 0, None)
}

/// Opens a file that may be absent.
fn opened_if_there(path: &Path) -> Result<Option<AdjFile>> {
    match AdjFile::open(path) {
        Err(Error::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
        opened => opened.map(Some),
    }
}

/// Removes the parts of the preview of bricks in `boxes`.
pub(super) fn remove_parts(folder: &Path, boxes: impl Iterator<Item = Region>) -> Result<()> {
    boxes
        .map(|region| folder.join(BrickPlace { partition: 0, region }.preview_file()))
        .try_for_each(|path| remove_if_there(&path))
}

/// Returns a grid as headers store it: its unit is in the description.
fn unnamed(grid: Grid) -> Grid {
    Grid { unit: None, ..grid }
}
