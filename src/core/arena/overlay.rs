//! Overlays: voxels added to and removed from an arena that itself stays unchanged.
//!
//! In: an open arena and edits. Out: lanes that a walk visits, in exact order, as if they had been built from the edited
//! voxels; and [`Rows`] that write these to a new file.
//!
//! ```text
//! edits         by position: the new record, or none
//! patch         for a lane: the tiles that hold edits, packed again on first use
//! lane          the arena's lines and records, then the patch's; one table of tiles for both
//! ```
//!
//! Memory: 20 to 35 bytes per edit. Each lane in use adds its tile table (28 bytes per tile) and all records of the
//! tiles that hold edits, up to 64 lines for a single voxel: edits side by side are cheap, scattered ones are not.
//!
//! Time: an edit searches the tiles in O(log tiles) and one line. The first use of a lane after an edit packs its patch,
//! in O(tiles + records of the tiles with edits). Without edits nothing is slower. Measured by `benches/overlay.rs`:
//! docs/studies/overlay.md.
//!
//! ```
//! use adjsplat::arena::{LaneSet, Overlay, Record};
//! use adjsplat::classify::normal;
//! use adjsplat::{Build, TransferFunction, Volume};
//!
//! let volume = Volume::new([32; 3], (0..32 * 32 * 32).map(|i| (i % 251) as u8).collect::<Vec<_>>())?;
//! let model = Build::new(TransferFunction::range(100.0, f64::INFINITY)?).run(&volume)?;
//! let lanes = LaneSet::new(model.arena()?, None);
//!
//! let mut overlay = Overlay::new(&lanes);
//! // The code of no normal. A default record's stands for the normal (0, 0, 1).
//! let unlit = normal::none(model.arena()?.facts().channels.normal_bits);
//! overlay.insert([0, 0, 0], Record { value: 7, normal: unlit, ..Record::default() })?;
//! assert_eq!(overlay.facts()?.visible_voxels, model.visible_voxels() + 1);
//! assert_eq!(overlay.remove([0, 0, 0])?.map(|record| record.value), Some(7));
//! # Ok::<(), adjsplat::Error>(())
//! ```

use std::sync::OnceLock;

use super::coverage::Coverage;
use super::lane::Lane;
use super::lane_rows::LaneRows;
use super::lanes::LaneSet;
use super::layout::{Facts, TILE_EDGE};
use super::pack::Record;
use super::patch::{Edits, Patch, find_tile};
use super::rows::Rows;
use super::visible::VisibleCodes;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::volume::Axis;
use crate::volume::grid::coordinate16;

/// An arena with voxels added and removed; the arena itself stays unchanged.
#[derive(Debug)]
pub struct Overlay<'a> {
    lanes: &'a LaneSet<'a>,
    edits: Edits,
    visible_voxels: u64,
    shown: Option<VisibleCodes>,
    patches: [OnceLock<Patch>; 3],
}

impl<'a> Overlay<'a> {
    /// Creates an overlay without edits.
    pub fn new(lanes: &'a LaneSet<'a>) -> Overlay<'a> {
        let visible_voxels = lanes.arena().facts().visible_voxels;
        Overlay { lanes, edits: Edits::new(), visible_voxels, shown: None, patches: Default::default() }
    }

    /// Inserts or replaces the voxel at `at` (x, y, z), and returns the previous one.
    ///
    /// Codes of channels that the arena does not store are ignored. A coverage of 0 stands for wholly visible.
    ///
    /// # Errors
    /// [`Error::Input`] if `at` is outside the grid, or a code does not fit its channel or is no coverage.
    pub fn insert(&mut self, at: [u32; 3], record: Record) -> Result<Option<Record>> {
        let place = self.place(at)?;
        let channels = self.lanes.arena().facts().channels;
        let normal = if channels.normal_bits == 0 { 0 } else { record.normal };
        let magnitude = if channels.magnitude_bits == 0 { 0 } else { record.magnitude };
        let is_whole = channels.coverage_bits == 0 || record.coverage == 0;
        let coverage = if is_whole { Coverage::whole_code(channels) } else { record.coverage };
        let widths = [
            ("value", u32::from(record.value), u32::from(channels.value_bits)),
            ("normal", normal, 2 * u32::from(channels.normal_bits)),
            ("coverage", coverage.into(), u32::from(channels.coverage_bits)),
        ];
        for (what, code, bits) in widths {
            if u64::from(code) >> bits != 0 {
                let why = format!("is {code}, but the file's channel has {bits} bits");
                return Err(Error::input(format!("{what} code of voxel {at:?}"), why));
            }
        }
        if !Coverage::is_code(coverage, channels) {
            let why = format!("is {coverage}, which is no coverage of some of a block: R25 of the format");
            return Err(Error::input(format!("coverage code of voxel {at:?}"), why));
        }
        Ok(self.put(place, Some(Record { value: record.value, normal, magnitude, coverage })))
    }

    /// Removes the voxel at `at` (x, y, z), and returns it.
    ///
    /// # Errors
    /// [`Error::Input`] if `at` is outside the grid.
    pub fn remove(&mut self, at: [u32; 3]) -> Result<Option<Record>> {
        let place = self.place(at)?;
        Ok(self.put(place, None))
    }

    /// Returns the voxel at `at` (x, y, z), even if it is hidden; `None` if there is none or `at` is outside the grid.
    pub fn get(&self, at: [u32; 3]) -> Option<Record> {
        let [x, y, z] = self.place(at).ok()?;
        self.edits.get(&[z, y, x]).copied().unwrap_or_else(|| self.stored([x, y, z]))
    }

    /// Shows only voxels whose opacity with `transfer`, judged by their codes, is above 0 and at least `threshold`.
    ///
    /// Hidden voxels remain stored; walks skip them and [`Overlay::rows`] leaves them out. This costs a table of 32
    /// bytes to 2 MiB and one look-up per voxel of a walk.
    ///
    /// # Errors
    /// The same as [`VisibleCodes::new`].
    pub fn set_opacity_threshold(&mut self, transfer: &TransferFunction, threshold: f64) -> Result<()> {
        let facts = self.lanes.arena().facts();
        self.shown = Some(VisibleCodes::new(transfer, facts.channels, &facts.scales, threshold)?);
        Ok(())
    }

    /// Shows all voxels again.
    pub fn clear_opacity_threshold(&mut self) {
        self.shown = None;
    }

    /// Returns the number of positions at which the overlay differs from the arena.
    pub fn edit_count(&self) -> usize {
        self.edits.len()
    }

    /// Returns the header facts with the count of shown voxels. O(1), or O(records) with a threshold.
    ///
    /// # Errors
    /// The same as [`Overlay::lane`].
    pub fn facts(&self) -> Result<Facts> {
        let mut visible_voxels = self.visible_voxels;
        if self.shown.is_some() {
            visible_voxels = 0;
            self.lane(Axis::X)?.each_record(|_| visible_voxels += 1);
        }
        Ok(Facts { visible_voxels, ..self.lanes.arena().facts().clone() })
    }

    /// Returns the lane along `axis` with all edits. The first call after an edit packs the tiles that hold edits.
    ///
    /// # Errors
    /// The same as [`LaneSet::lane`]; [`Error::Limit`] if there are more lines than tiles can refer to.
    pub fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        let mut lane = self.lanes.lane(axis)?;
        lane.shown = self.shown.as_ref();
        if self.edits.is_empty() {
            return Ok(lane);
        }
        let lines_of_tile = u64::from(TILE_EDGE) * u64::from(TILE_EDGE);
        let need = lane.line_ends.len() as u64 + lines_of_tile * self.edits.len() as u64;
        if need > u32::MAX.into() {
            let what = format!("lines of the edited lane along {}; write it to a file first", axis.name());
            return Err(Error::Limit { what, need, have: u32::MAX.into() });
        }
        let tile_order = self.lanes.arena().facts().tile_order;
        let patch = self.patches[axis.index()].get_or_init(|| Patch::new(&lane, tile_order, &self.edits));
        lane.tiles = &patch.tiles;
        lane.patch = Some(&patch.records);
        Ok(lane)
    }

    /// Returns the shown voxels, for writing to a file.
    ///
    /// # Errors
    /// The same as [`Overlay::lane`].
    pub fn rows(&self) -> Result<impl Rows> {
        let lane = self.lane(Axis::X)?;
        Ok(LaneRows::new(lane, move |_, index, record| lane.shows(index).then_some(record)))
    }

    /// Converts `at` (x, y, z) to 16-bit coordinates, after checking that it is inside the grid.
    fn place(&self, at: [u32; 3]) -> Result<[u16; 3]> {
        let dims = self.lanes.arena().facts().grid.dims;
        if (0..3).any(|a| at[a] >= dims[a]) {
            let [nx, ny, nz] = dims;
            return Err(Error::input(format!("voxel {at:?}"), format!("lies outside the {nx} x {ny} x {nz} grid")));
        }
        Ok(at.map(coordinate16))
    }

    /// Sets the record at a position, or removes it if `record` is `None`, and returns the previous record.
    fn put(&mut self, [x, y, z]: [u16; 3], record: Option<Record>) -> Option<Record> {
        let stored = self.stored([x, y, z]);
        let place = [z, y, x];
        let before = self.edits.get(&place).copied().unwrap_or(stored);
        if record == before {
            return before;
        }
        if record == stored {
            self.edits.remove(&place);
        } else {
            self.edits.insert(place, record);
        }
        self.visible_voxels =
            self.visible_voxels.saturating_add(record.is_some().into()).saturating_sub(before.is_some().into());
        self.patches = Default::default();
        before
    }

    /// Returns the record that the arena itself stores at a position, without edits.
    fn stored(&self, [x, y, z]: [u16; 3]) -> Option<Record> {
        let arena = self.lanes.arena();
        let lane = arena.x_lane();
        let tile = find_tile(&lane, arena.facts().tile_order, y / TILE_EDGE, z / TILE_EDGE)?;
        let bit = 1 << (z % TILE_EDGE * TILE_EDGE + y % TILE_EDGE);
        let line = lane.tile_lines(tile, bit).next()?;
        let mut voxels = lane.line_voxels(line.records);
        voxels
            .find(|&(at, _)| at >= u32::from(x))
            .filter(|&(at, _)| at == u32::from(x))
            .map(|(_, index)| lane.record(index))
    }
}
