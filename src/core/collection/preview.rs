//! The preview of a collection: every n-th grid point along each axis, as one `.adj` file that fits any machine.
//!
//! In: the rows of each brick, when it is written. Out: a part of the preview for each brick; at the end the parts are
//! joined. Which points are kept depends on their place in the whole alone, so the preview does not depend on the bricks.
//! Every kept voxel stands for the n x n x n points around it: spacings are n times as long, and opacities still refer to
//! the lengths of the whole.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::BrickEntry;
use super::joined::JoinedRows;
use super::manifest::fingerprint;
use super::split::BrickPlace;
use crate::arena::layout::{Channels, Facts};
use crate::arena::{LaneRows, Region, Rows, Voxel};
use crate::build::Observer;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::file::{AdjFile, RowsOutput, write_rows};
use crate::volume::{Axis, Grid};

/// The name of the preview's file in a collection's folder.
const PREVIEW: &str = "preview.adj";
/// Most voxels of a preview, if nobody says how coarse it is to be: about 200 MB.
const VOXELS: u64 = 1 << 24;

/// What a manifest says of the preview.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PreviewEntry {
    /// The preview's file in the collection's folder.
    pub file: String,
    /// The preview has every so many grid points along each axis, from the first on.
    pub every: u32,
    /// Number of visible voxels of the preview.
    pub visible_voxels: u64,
    /// Fingerprint of the file: the checksum of its header and section table, as 16 hexadecimal digits.
    pub fingerprint: String,
}

/// Returns how coarse the preview of so many voxels is by default; 1 if they need none.
pub(super) fn default_every(visible_voxels: u64) -> u32 {
    let fits = |every: &u32| visible_voxels.div_ceil(u64::from(*every).pow(3)) <= VOXELS;
    (1..=u16::MAX.into()).find(fits).unwrap_or(u16::MAX.into())
}

/// Returns the grid of every `every`-th point of `whole`.
pub(super) fn preview_grid(whole: &Grid, every: u32) -> Grid {
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
fn description(whole: &str, grid: &Grid, every: u32) -> String {
    let mut description: Value = serde_json::from_str(whole).unwrap_or(Value::Null);
    if !description.is_object() {
        description = json!({});
    }
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

    /// Counts the voxels.
    fn count(&self) -> Result<u64> {
        let mut voxels = 0u64;
        if !self.dims.contains(&0) {
            self.read(Region::of_grid(self.dims), &mut |_, _, found| voxels += found.len() as u64)?;
        }
        Ok(voxels)
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
        let voxels = rows.count()?;
        let path = folder.join(self.preview_file());
        if voxels == 0 {
            return remove_if_there(&path);
        }
        let facts =
            Facts { grid: part.grid(&preview_grid(whole, every)), visible_voxels: voxels, ..output.facts.clone() };
        write_rows(&path, &rows, &RowsOutput { facts, description: "{}", lane_count: 1, ..*output }, observer)?;
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
    let description = description(output.description, &whole.grid, every);
    let path = folder.join(PREVIEW);
    let facts = Facts { grid, ..whole.clone() };
    let (facts, _) = write_rows(&path, &rows, &RowsOutput { facts, description: &description, ..*output }, observer)?;
    let number = AdjFile::open(&path)?.arena()?.fingerprint();
    let (visible_voxels, fingerprint) = (facts.visible_voxels, fingerprint(number));
    Ok(Some(PreviewEntry { file: PREVIEW.into(), every, visible_voxels, fingerprint }))
}

/// Returns the rows of a file.
fn lane_rows(file: &AdjFile) -> Result<Box<dyn Rows + '_>> {
    let lane = file.arena()?.lane(Axis::X).expect("every arena that opens has the lane along x");
    Ok(Box::new(LaneRows::new(lane, |_, _, record| Some(record))))
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
