//! The overlay: voxels added and removed after the fact, over an arena that stays as it is.
//!
//! In: an open arena and edits. Out: lanes that a walk visits as if they had been built from the edited voxels, in
//! exact order, and [`Rows`] that write them to a new file.
//!
//! ```text
//! edits         by place: the record that is there instead, or none
//! patch         for a lane: the tiles that hold edits packed anew, with their lines and records; made on first need
//! lane          the arena's lines and records, in place, then the patch's; one table of tiles for both
//! ```
//!
//! Memory: about 40 bytes an edit. Each lane that is asked for adds its tile table (28 bytes a tile) and the records of
//! the tiles that hold edits: up to 64 lines for a lone voxel, so edits side by side are cheap and scattered ones are
//! not. Time: an edit looks its place up in O(log tiles) and one line; the first use of a lane after an edit packs its
//! patch anew, in O(tiles + records of the tiles that hold edits). Without edits nothing is made and nothing is slower.
//!
//! ```
//! use adjsplat::arena::pack::Record;
//! use adjsplat::arena::{Arena, LaneSet, Overlay, TileOrder, builder};
//! use adjsplat::classify::TransferFunction;
//! use adjsplat::volume::{SampleType, phantom::Phantom};
//!
//! let mut shells = Phantom::from_name("shells")?.open([32; 3], SampleType::U8, [1.0; 3])?;
//! let options = builder::BuildOptions {
//!     transfer: TransferFunction::range(100.0, f64::INFINITY)?,
//!     lane_count: 1,
//!     tile_order: TileOrder::Morton,
//!     value_bits: 8,
//!     normal_bits: 0,
//! };
//! let built = builder::build(&mut *shells, &options, &mut builder::Unobserved)?;
//! let bytes = adjsplat::file::arena_bytes(&built.facts, &built.lanes, "{}");
//! let lanes = LaneSet::new(Arena::new(&bytes).expect("it was just built"), None);
//!
//! let mut overlay = Overlay::new(&lanes);
//! overlay.insert([0, 0, 0], Record { value: 7, ..Record::default() })?;
//! assert_eq!(overlay.facts()?.visible_voxels, built.facts.visible_voxels + 1);
//! assert_eq!(overlay.remove([0, 0, 0])?.map(|record| record.value), Some(7));
//! # Ok::<(), adjsplat::Error>(())
//! ```

use std::collections::BTreeMap;
use std::sync::OnceLock;

use zerocopy::byteorder::little_endian::{U32, U64};

use super::curve::TileOrder;
use super::lane::{Lane, OwnedLane};
use super::lane_rows::LaneRows;
use super::lanes::LaneSet;
use super::layout::{Facts, TILE_EDGE, TileRecord};
use super::pack::{LanePacker, Record};
use super::rows::Rows;
use super::visible::VisibleCodes;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::volume::Axis;

/// An arena with voxels added and removed.
#[derive(Debug)]
pub struct Overlay<'a> {
    lanes: &'a LaneSet<'a>,
    /// By z, y, x, where it differs from the arena: the record that is there, or `None`.
    edits: BTreeMap<[u16; 3], Option<Record>>,
    visible_voxels: u64,
    shown: Option<VisibleCodes>,
    patches: [OnceLock<Patch>; 3],
}

impl<'a> Overlay<'a> {
    /// No edits yet.
    pub fn new(lanes: &'a LaneSet<'a>) -> Overlay<'a> {
        let visible_voxels = lanes.arena().facts().visible_voxels;
        Overlay { lanes, edits: BTreeMap::new(), visible_voxels, shown: None, patches: Default::default() }
    }

    /// Puts a voxel at `at` (x, y, z), in the place of one that is there; what was there.
    ///
    /// Codes of channels that the arena has not are ignored.
    ///
    /// # Errors
    /// [`Error::Input`] if `at` is outside the grid, or a code does not fit its channel.
    pub fn insert(&mut self, at: [u32; 3], record: Record) -> Result<Option<Record>> {
        let place = self.place(at)?;
        let channels = self.lanes.arena().facts().channels;
        let normal = if channels.normal_bits == 0 { 0 } else { record.normal };
        let magnitude = if channels.magnitude_bits == 0 { 0 } else { record.magnitude };
        let widths = [
            ("value", u32::from(record.value), u32::from(channels.value_bits)),
            ("normal", normal, 2 * u32::from(channels.normal_bits)),
        ];
        for (what, code, bits) in widths {
            if u64::from(code) >> bits != 0 {
                let why = format!("is {code}, but the file's channel has {bits} bits");
                return Err(Error::input(format!("{what} code of voxel {at:?}"), why));
            }
        }
        Ok(self.put(place, Some(Record { value: record.value, normal, magnitude })))
    }

    /// Takes the voxel at `at` (x, y, z) away; what was there.
    ///
    /// # Errors
    /// [`Error::Input`] if `at` is outside the grid.
    pub fn remove(&mut self, at: [u32; 3]) -> Result<Option<Record>> {
        let place = self.place(at)?;
        Ok(self.put(place, None))
    }

    /// The voxel at `at` (x, y, z), shown or not; `None` where there is none, and outside the grid.
    pub fn get(&self, at: [u32; 3]) -> Option<Record> {
        let [x, y, z] = self.place(at).ok()?;
        self.edits.get(&[z, y, x]).copied().unwrap_or_else(|| self.stored([x, y, z]))
    }

    /// Shows only voxels whose opacity under `transfer`, judged by their codes, is at least `threshold`, and above 0.
    ///
    /// The others stay where they are: a walk passes them over, [`Overlay::rows`] leaves them out. Takes a table of 32
    /// bytes to 2 MiB, and a look into it for each voxel of a walk.
    ///
    /// # Errors
    /// As [`VisibleCodes::new`].
    pub fn set_opacity_threshold(&mut self, transfer: &TransferFunction, threshold: f64) -> Result<()> {
        let facts = self.lanes.arena().facts();
        self.shown = Some(VisibleCodes::new(transfer, facts.channels, &facts.scales, threshold)?);
        Ok(())
    }

    /// Shows all voxels again.
    pub fn clear_opacity_threshold(&mut self) {
        self.shown = None;
    }

    /// How many voxels differ from the arena's.
    pub fn edit_count(&self) -> usize {
        self.edits.len()
    }

    /// What the arena says of itself, the voxels that are shown counted: O(1), or O(records) with a threshold.
    ///
    /// # Errors
    /// As [`Overlay::lane`].
    pub fn facts(&self) -> Result<Facts> {
        let mut visible_voxels = self.visible_voxels;
        if self.shown.is_some() {
            visible_voxels = 0;
            self.lane(Axis::X)?.each_record(|_| visible_voxels += 1);
        }
        Ok(Facts { visible_voxels, ..self.lanes.arena().facts().clone() })
    }

    /// The lane along `axis` with all edits; its patch is packed on first use after an edit.
    ///
    /// # Errors
    /// As [`LaneSet::lane`]; and [`Error::Limit`] if there are more lines than a tile can name.
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

    /// The voxels that are shown, to write to a file.
    ///
    /// # Errors
    /// As [`Overlay::lane`].
    pub fn rows(&self) -> Result<impl Rows> {
        let lane = self.lane(Axis::X)?;
        let shown = lane.shown;
        Ok(LaneRows::new(lane, move |_, _, record| shown.is_none_or(|shown| shown.has(record)).then_some(record)))
    }

    /// `at` as coordinates inside the grid.
    fn place(&self, at: [u32; 3]) -> Result<[u16; 3]> {
        let dims = self.lanes.arena().facts().grid.dims;
        if (0..3).any(|a| at[a] >= dims[a]) {
            let [nx, ny, nz] = dims;
            return Err(Error::input(format!("voxel {at:?}"), format!("lies outside the {nx} x {ny} x {nz} grid")));
        }
        Ok(at.map(|c| u16::try_from(c).expect("a grid has at most 65,535 points an axis")))
    }

    /// Makes `record` what is at a place; what was there.
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

    /// What the arena has at a place.
    fn stored(&self, [x, y, z]: [u16; 3]) -> Option<Record> {
        let arena = self.lanes.arena();
        let lane = arena.lane(Axis::X).expect("by R10 every arena that opens has the lane along x");
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

/// The tile at (u, v) of a lane whose tiles lie in `order`.
fn find_tile<'l>(lane: &Lane<'l>, order: TileOrder, u: u16, v: u16) -> Option<&'l TileRecord> {
    let key = order.key(u, v);
    let place = |tile: &TileRecord| order.key(tile.tile_u.get(), tile.tile_v.get());
    lane.tiles.binary_search_by_key(&key, place).ok().map(|index| &lane.tiles[index])
}

/// A lane's changed tiles.
#[derive(Debug)]
struct Patch {
    /// All tiles of the lane, changed or not, in the tile order.
    tiles: Vec<TileRecord>,
    /// Lines and records of the changed ones.
    records: OwnedLane,
}

/// An edit by its place in a lane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edit {
    v: u16,
    u: u16,
    at: u16,
    /// Index in the order of the edits; no two share a place.
    index: usize,
}

impl Patch {
    fn new(lane: &Lane, order: TileOrder, edits: &BTreeMap<[u16; 3], Option<Record>>) -> Patch {
        let [u_axis, v_axis] = lane.axis.others();
        let along = |[z, y, x]: [u16; 3], axis: Axis| [x, y, z][axis.index()];
        let records: Vec<Option<Record>> = edits.values().copied().collect();
        let mut sorted: Vec<Edit> = (0..)
            .zip(edits.keys())
            .map(|(index, &place)| {
                let [v, u, at] = [v_axis, u_axis, lane.axis].map(|axis| along(place, axis));
                Edit { v, u, at, index }
            })
            .collect();
        sorted.sort_unstable();

        let mut packer = LanePacker::new(lane.axis, lane.dims, lane.channels, order);
        let mut changed = Vec::new();
        let mut line = Vec::new();
        for strip in sorted.chunk_by(|a, b| a.v / TILE_EDGE == b.v / TILE_EDGE) {
            let tile_v = strip[0].v / TILE_EDGE;
            let mut tile_us: Vec<u16> = strip.iter().map(|edit| edit.u / TILE_EDGE).collect();
            tile_us.sort_unstable();
            tile_us.dedup();
            let tiles: Vec<Option<&TileRecord>> = tile_us.iter().map(|&u| find_tile(lane, order, u, tile_v)).collect();
            changed.extend(tile_us.iter().map(|&u| order.key(u, tile_v)));
            let mut rest = strip;
            for within_v in 0..TILE_EDGE {
                for (&tile_u, tile) in tile_us.iter().zip(&tiles) {
                    for within_u in 0..TILE_EDGE {
                        let (u, v) =
                            (u32::from(tile_u * TILE_EDGE + within_u), u32::from(tile_v * TILE_EDGE + within_v));
                        if u >= lane.dims[u_axis.index()] || v >= lane.dims[v_axis.index()] {
                            continue;
                        }
                        let count = rest.partition_point(|edit| (u32::from(edit.v), u32::from(edit.u)) <= (v, u));
                        let (here, later) = rest.split_at(count);
                        rest = later;
                        let bit = 1 << (within_v * TILE_EDGE + within_u);
                        let stored = tile.and_then(|tile| lane.tile_lines(tile, bit).next());
                        line.clear();
                        merge(lane, stored.map(|line| line.records).unwrap_or_default(), here, &records, &mut line);
                        let (u, v) = (tile_u * TILE_EDGE + within_u, tile_v * TILE_EDGE + within_v);
                        packer.line(u, v, line.iter().copied());
                    }
                }
            }
        }
        let records = packer.finish();
        let mut tiles: Vec<TileRecord> = Vec::with_capacity(lane.tiles.len() + records.tiles.len());
        let key = |tile: &TileRecord| order.key(tile.tile_u.get(), tile.tile_v.get());
        changed.sort_unstable();
        tiles.extend(lane.tiles.iter().filter(|tile| changed.binary_search(&key(tile)).is_err()));
        let lines = u32::try_from(lane.line_ends.len()).expect("checked with the patch's lines");
        tiles.extend(records.tiles.iter().map(|tile| TileRecord {
            first_line: U32::new(tile.first_line.get() + lines),
            first_record: U64::new(tile.first_record.get() + lane.steps.len() as u64),
            ..*tile
        }));
        // Two runs in order: a merge.
        tiles.sort_by_key(key);
        Patch { tiles, records }
    }
}

/// A stored line and the edits on it, by ascending place, as one line.
fn merge(
    lane: &Lane,
    stored: std::ops::Range<usize>,
    edits: &[Edit],
    records: &[Option<Record>],
    line: &mut Vec<(u16, Record)>,
) {
    let points = lane.dims[lane.axis.index()];
    // A damaged line may be longer than its axis.
    let stored = if stored.len() <= points as usize { stored } else { 0..0 };
    let mut edits = edits.iter().peekable();
    let voxels = lane.line_voxels(stored).take_while(|&(at, _)| at < points);
    for (at, index) in voxels {
        let at = u16::try_from(at).expect("inside a grid of at most 65,535 points an axis");
        while let Some(edit) = edits.next_if(|edit| edit.at < at) {
            line.extend(records[edit.index].map(|record| (edit.at, record)));
        }
        match edits.next_if(|edit| edit.at == at) {
            Some(edit) => line.extend(records[edit.index].map(|record| (at, record))),
            None => line.push((at, lane.record(index))),
        }
    }
    line.extend(edits.filter_map(|edit| Some((edit.at, records[edit.index]?))));
}
