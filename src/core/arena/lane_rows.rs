//! The rows of a lane, read in place, with voxels kept, changed or dropped by a closure.
//!
//! In: the lane along x and the closure. Out: [`Rows`], from which [`crate::file::write_rows`] makes a file. Memory: the
//! current row and an index of the tiles (4 bytes per tile and per row of tiles).
//!
//! Safe on any bytes: from a damaged lane it yields some voxels inside the grid, at most as many as there are records,
//! and the same ones at each reading.

use std::ops::Range;

use super::lane::Lane;
use super::layout::{Channels, TILE_EDGE, TileRecord};
use super::pack::Record;
use super::rows::{Region, Rows, Voxel};
use crate::error::Result;
use crate::volume::Axis;

/// Rows of a lane along x. `keep` receives (x, y, z), the record's index and its codes, and returns what to keep.
pub struct LaneRows<'a, K> {
    lane: Lane<'a>,
    tiles: TilesByRow,
    /// The region that is read, in the lane's coordinates.
    window: [Range<u32>; 3],
    /// The lane's coordinates of the rows' point (0, 0, 0).
    origin: [u16; 3],
    dims: [u32; 3],
    channels: Channels,
    keep: K,
}

impl<'a, K: Fn([u16; 3], usize, Record) -> Option<Record> + Sync> LaneRows<'a, K> {
    /// Creates the rows of `lane`, with each voxel replaced by what `keep` returns.
    ///
    /// # Panics
    /// If `lane` does not run along x.
    pub fn new(lane: Lane<'a>, keep: K) -> LaneRows<'a, K> {
        assert!(lane.axis == Axis::X, "rows run along x");
        LaneRows {
            tiles: TilesByRow::new(&lane),
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
        let parts = [&window.xs, &window.ys, &window.zs];
        for (a, part) in parts.into_iter().enumerate() {
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
        rows.origin = std::array::from_fn(|a| narrow(rows.window[a].start));
        rows.dims = std::array::from_fn(|a| rows.window[a].end - rows.window[a].start);
        rows
    }

    /// Sets the channels of the records that `keep` returns.
    pub fn with_channels(mut self, channels: Channels) -> LaneRows<'a, K> {
        self.channels = channels;
        self
    }

    /// Returns the part of the window inside `region`, in the lane's coordinates.
    fn inside(&self, region: &Region) -> [Range<u32>; 3] {
        let parts = [&region.xs, &region.ys, &region.zs];
        std::array::from_fn(|a| {
            let shift = |end: u32| end.saturating_add(self.origin[a].into());
            let window = &self.window[a];
            shift(parts[a].start).max(window.start)..shift(parts[a].end).min(window.end)
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
        4 * (self.tiles.tiles.len() + self.tiles.starts.len()) as u64
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let [xs, ys, zs] = self.inside(&region);
        if xs.is_empty() || ys.is_empty() || zs.is_empty() {
            return Ok(());
        }
        let edge = u32::from(TILE_EDGE);
        let mut voxels: Vec<Voxel> = Vec::new();
        for tile_v in zs.start / edge..=(zs.end - 1) / edge {
            for tile in self.tiles.row(&self.lane, tile_v, ys.start / edge..=(ys.end - 1) / edge) {
                let wanted = wanted_lines(tile, &ys, &zs);
                for line in self.lane.tile_lines(tile, wanted) {
                    if line.records.len() > self.lane.dims[0] as usize {
                        continue;
                    }
                    let (y, z) = (narrow(line.u), narrow(line.v));
                    voxels.clear();
                    for (x, index) in self.lane.line_voxels(line.records) {
                        if x >= xs.end {
                            break;
                        }
                        if x >= xs.start
                            && let Some(record) = (self.keep)([narrow(x), y, z], index, self.lane.record(index))
                        {
                            voxels.push(Voxel { x: narrow(x) - self.origin[0], record });
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

/// Converts a coordinate inside a grid.
fn narrow(coordinate: u32) -> u16 {
    u16::try_from(coordinate).expect("inside a grid of at most 65,535 points an axis")
}

/// Returns a mask of the lines of `tile` inside `us` and `vs`.
fn wanted_lines(tile: &TileRecord, us: &Range<u32>, vs: &Range<u32>) -> u64 {
    let edge = u32::from(TILE_EDGE);
    // Bits `from..to` of eight, for a range that overlaps the tile.
    let eight = |range: &Range<u32>, tile: u16| {
        let first = u32::from(tile) * edge;
        let end = |end: u32| end.saturating_sub(first).min(edge);
        (1u64 << end(range.end)) - (1u64 << end(range.start))
    };
    let (columns, rows) = (eight(us, tile.tile_u.get()), eight(vs, tile.tile_v.get()));
    // Bit i of `rows` becomes byte i.
    let spread = (0..8).map(|row| (rows >> row & 1) * (0xff << (8 * row))).sum::<u64>();
    spread & columns.wrapping_mul(0x0101_0101_0101_0101)
}

/// The tiles of a lane sorted by v, then u.
struct TilesByRow {
    /// Indices of tiles.
    tiles: Vec<u32>,
    /// Start of each v in `tiles`, and the end of the last.
    starts: Vec<u32>,
}

impl TilesByRow {
    fn new(lane: &Lane) -> TilesByRow {
        let [across, up] = lane.axis.others().map(|a| lane.dims[a.index()].div_ceil(u32::from(TILE_EDGE)));
        let place = |tile: &TileRecord| (tile.tile_v.get(), tile.tile_u.get());
        let mut budget = lane.record_count();
        // In a sound lane each tile occurs once, inside the face, with ascending line ends and no more records than the
        // lane has. A damaged lane must not cost more.
        let mut is_sound = |tile: &TileRecord| {
            let inside = u32::from(tile.tile_u.get()) < across && u32::from(tile.tile_v.get()) < up;
            let first = u64::from(tile.first_line.get());
            let lines = first..first + u64::from(tile.occupancy.get().count_ones());
            let end = |line: u64| usize::try_from(line).ok().and_then(|line| lane.line_end(line)).unwrap_or(0);
            let ascending = lines.map(end).is_sorted();
            let left = budget.checked_sub(lane.tile_records(tile)).filter(|_| inside && ascending);
            budget = left.unwrap_or(budget);
            left.is_some()
        };
        let sound = (0u32..).zip(lane.tiles).filter(|(_, tile)| is_sound(tile));
        let mut tiles: Vec<u32> = sound.map(|(index, _)| index).collect();
        tiles.sort_by_key(|&index| place(&lane.tiles[index as usize]));
        tiles.dedup_by_key(|&mut index| place(&lane.tiles[index as usize]));
        let mut starts = vec![0; up as usize + 1];
        for &index in &tiles {
            starts[usize::from(lane.tiles[index as usize].tile_v.get()) + 1] += 1;
        }
        for v in 0..up as usize {
            starts[v + 1] += starts[v];
        }
        TilesByRow { tiles, starts }
    }

    /// Returns the tiles at `v` whose u is in `us`, ascending.
    fn row<'t>(
        &self,
        lane: &Lane<'t>,
        v: u32,
        us: std::ops::RangeInclusive<u32>,
    ) -> impl Iterator<Item = &'t TileRecord> {
        let all = &self.tiles[self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize];
        let tiles = lane.tiles;
        let u = move |index: u32| u32::from(tiles[index as usize].tile_u.get());
        let from = all.partition_point(|&index| u(index) < *us.start());
        let to = all.partition_point(|&index| u(index) <= *us.end());
        all[from..to].iter().map(move |&index| &tiles[index as usize])
    }
}
