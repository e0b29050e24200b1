//! The voxels of a lane as rows along x, read in place; a closure keeps, changes or drops each voxel.
//!
//! In: the lane along x and the closure. Out: [`Rows`], from which [`crate::file::write_rows`] makes a file. Memory: the
//! current row and an index of the tiles (4 bytes per tile).
//!
//! Safe on any bytes: a damaged lane yields voxels inside the grid, at most as many as it has records, and the same
//! voxels each time it is read.

use std::ops::Range;

use super::Arena;
use super::lane::Lane;
use super::layout::{Channels, TILE_EDGE, TileRecord};
use super::pack::Record;
use super::rows::{Region, Rows, Voxel};
use crate::error::Result;
use crate::volume::Axis;
use crate::volume::grid::coordinate16;

/// Yields the voxels of a lane along x row by row. `keep` receives a voxel's (x, y, z), record index and codes, and
/// returns the codes to yield, or `None` to drop the voxel.
pub struct LaneRows<'a, K> {
    lane: Lane<'a>,
    /// Indices of the lane's tiles, sorted by tile row v, then tile column u.
    tiles: Vec<u32>,
    /// The box of grid points that is read, in the lane's coordinates.
    window: [Range<u32>; 3],
    /// The grid point of the lane that becomes grid point (0, 0, 0) of the rows.
    origin: [u16; 3],
    dims: [u32; 3],
    channels: Channels,
    keep: K,
}

impl<'a> Arena<'a> {
    /// Returns the voxels as rows along x.
    pub fn rows(&self) -> LaneRows<'a, impl Fn([u16; 3], usize, Record) -> Option<Record> + use<>> {
        LaneRows::new(self.x_lane(), |_, _, record| Some(record))
    }
}

impl<'a, K: Fn([u16; 3], usize, Record) -> Option<Record> + Sync> LaneRows<'a, K> {
    /// Creates the rows of `lane`, with each voxel replaced by the record that `keep` returns, or dropped.
    ///
    /// # Panics
    /// If `lane` does not run along x.
    pub fn new(lane: Lane<'a>, keep: K) -> LaneRows<'a, K> {
        assert!(lane.axis == Axis::X, "rows run along x");
        LaneRows {
            tiles: tiles_by_row(&lane),
            window: lane.dims.map(|points| 0..points),
            origin: [0; 3],
            dims: lane.dims,
            channels: lane.channels,
            keep,
            lane,
        }
    }

    /// Limits the rows to the voxels in `window`; the grid keeps its size.
    pub fn within(mut self, window: &Region) -> LaneRows<'a, K> {
        for (a, part) in window.sides().into_iter().enumerate() {
            let high = part.end.min(self.lane.dims[a]);
            self.window[a] = part.start.min(high)..high;
        }
        self
    }

    /// Limits the rows to the voxels in `window`, and shrinks the grid to it.
    ///
    /// # Panics
    /// If `window` contains no grid point.
    pub fn cropped(self, window: &Region) -> LaneRows<'a, K> {
        let mut rows = self.within(window);
        assert!(rows.window.iter().all(|part| !part.is_empty()), "a window holds at least one point");
        rows.origin = std::array::from_fn(|a| coordinate16(rows.window[a].start));
        rows.dims = std::array::from_fn(|a| rows.window[a].end - rows.window[a].start);
        rows
    }

    /// Sets the channels of the records that `keep` returns.
    pub fn with_channels(mut self, channels: Channels) -> LaneRows<'a, K> {
        self.channels = channels;
        self
    }

    /// Returns the part of the window that is inside `region`, in the lane's coordinates.
    fn inside(&self, region: &Region) -> [Range<u32>; 3] {
        std::array::from_fn(|a| {
            let shift = |end: u32| end.saturating_add(self.origin[a].into());
            let (part, window) = (region.sides()[a], &self.window[a]);
            shift(part.start).max(window.start)..shift(part.end).min(window.end)
        })
    }
}

impl<K: Fn([u16; 3], usize, Record) -> Option<Record> + Sync> Rows for LaneRows<'_, K> {
    fn dims(&self) -> [u32; 3] {
        self.dims
    }

    fn channels(&self) -> Channels {
        self.channels
    }

    fn memory(&self) -> u64 {
        4 * self.tiles.len() as u64
    }

    fn is_void(&self, region: &Region) -> bool {
        is_void(&self.lane, &self.tiles, &self.inside(region))
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let [xs, ys, zs] = self.inside(&region);
        if xs.is_empty() || ys.is_empty() || zs.is_empty() {
            return Ok(());
        }
        let edge = u32::from(TILE_EDGE);
        let mut voxels: Vec<Voxel> = Vec::new();
        for tile_v in zs.start / edge..=(zs.end - 1) / edge {
            let from = self.tiles.partition_point(|&index| row_position(&self.lane, index) < (tile_v, ys.start / edge));
            let in_row = |&&index: &&u32| row_position(&self.lane, index) <= (tile_v, (ys.end - 1) / edge);
            for tile in self.tiles[from..].iter().take_while(in_row).map(|&index| &self.lane.tiles[index as usize]) {
                for line in self.lane.tile_lines(tile, wanted_lines(tile, &ys, &zs)) {
                    if line.records.len() > self.lane.dims[0] as usize {
                        continue;
                    }
                    let (y, z) = (coordinate16(line.u), coordinate16(line.v));
                    voxels.clear();
                    for (x, index) in self.lane.line_voxels(line.records) {
                        if x >= xs.end {
                            break;
                        }
                        if x >= xs.start
                            && let Some(record) = (self.keep)([coordinate16(x), y, z], index, self.lane.record(index))
                        {
                            voxels.push(Voxel { x: coordinate16(x) - self.origin[0], record });
                        }
                    }
                    if !voxels.is_empty() {
                        row(y - self.origin[1], z - self.origin[2], &voxels);
                    }
                }
            }
        }
        Ok(())
    }
}

/// Returns whether none of `tiles`, which are sorted by row and column, meets a box; in O(log tiles) for each row of tiles. Tiles that do
/// may have no voxel in it.
fn is_void(lane: &Lane, tiles: &[u32], sides: &[Range<u32>; 3]) -> bool {
    if sides.iter().any(Range::is_empty) {
        return true;
    }
    let [_, [first_u, last_u], [first_v, last_v]] =
        [0, 1, 2].map(|a| [sides[a].start, sides[a].end - 1].map(|line| line / u32::from(TILE_EDGE)));
    // From the first tile at or after a place, the search goes on at the next place inside the box.
    let mut place = (first_v, first_u);
    loop {
        let at = tiles.partition_point(|&index| row_position(lane, index) < place);
        match tiles.get(at).map(|&index| row_position(lane, index)) {
            Some((v, u)) if v <= last_v => match u {
                _ if u < first_u => place = (v, first_u),
                _ if u > last_u => place = (v + 1, first_u),
                _ => return false,
            },
            _ => return true,
        }
    }
}

/// Returns a mask of the lines of `tile` whose u is in `us` and whose v is in `vs`.
fn wanted_lines(tile: &TileRecord, us: &Range<u32>, vs: &Range<u32>) -> u64 {
    let edge = u32::from(TILE_EDGE);
    // One bit per line along an edge of the tile: set if `range`, which overlaps the tile, contains the line.
    let eight = |range: &Range<u32>, tile: u16| {
        let first = u32::from(tile) * edge;
        let end = |end: u32| end.saturating_sub(first).min(edge);
        (1u64 << end(range.end)) - (1u64 << end(range.start))
    };
    let (columns, rows) = (eight(us, tile.tile_u.get()), eight(vs, tile.tile_v.get()));
    // Bit i of `rows` fills byte i.
    let spread = (0..8).map(|row| (rows >> row & 1) * (0xff << (8 * row))).sum::<u64>();
    spread & columns.wrapping_mul(0x0101_0101_0101_0101)
}

/// Returns the indices of a lane's undamaged tiles, sorted by tile row v, then tile column u.
fn tiles_by_row(lane: &Lane) -> Vec<u32> {
    let [across, up] = lane.axis.others().map(|a| lane.dims[a.index()].div_ceil(u32::from(TILE_EDGE)));
    let mut budget = lane.record_count();
    // In a sound lane each tile occurs once, inside the face, with ascending line ends and no more records than the
    // lane has. A damaged lane must not cost more.
    let mut is_sound = |tile: &TileRecord| {
        let inside = u32::from(tile.tile_u.get()) < across && u32::from(tile.tile_v.get()) < up;
        let ascending = tile.lines().map(|line| lane.line_end(line).unwrap_or(0)).is_sorted();
        let left = budget.checked_sub(lane.tile_records(tile)).filter(|_| inside && ascending);
        budget = left.unwrap_or(budget);
        left.is_some()
    };
    let sound = (0u32..).zip(lane.tiles).filter(|(_, tile)| is_sound(tile));
    let mut tiles: Vec<u32> = sound.map(|(index, _)| index).collect();
    // Of two tiles at one place the first stays.
    tiles.sort_unstable_by_key(|&index| (row_position(lane, index), index));
    tiles.dedup_by_key(|&mut index| row_position(lane, index));
    tiles
}

/// Returns the tile row v and the tile column u of tile `index`.
fn row_position(lane: &Lane, index: u32) -> (u32, u32) {
    let tile = &lane.tiles[index as usize];
    (tile.tile_v.get().into(), tile.tile_u.get().into())
}
