//! Assembly: from rows of voxels to a lane, in tile order and with bounded memory.
//!
//! In: [`Rows`]. Out: the lane's tiles in order, in parts ([`TileRun`]). A first pass counts the records of each tile.
//! By these counts, the tiles are divided into runs (consecutive tiles) that fit in memory. Then one thread per run
//! reads the rows that the run touches, sorts their voxels by line and packs them.
//!
//! Runs are divided by the bits of a tile's position in the order, like a binary trie. On a space-filling curve each
//! run is then a compact patch of the face (the lane's lines as a 2-D array), and reads few voxels of other runs.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use super::budget::{RECORD_BYTES, RUN_RECORDS, free_for_runs, large_tile_bytes};
use super::progress::{Observer, Phase, report};
use super::sort_lines::LineSorter;
use crate::arena::lane::STEPPING;
use crate::arena::layout::TILE_EDGE;
use crate::arena::pack::TileRun;
use crate::arena::{Region, Rows, TileOrder};
use crate::error::Result;
use crate::parallel::{MOST_THREADS, in_order};
use crate::volume::Axis;

/// Builds lanes from a source of rows, one lane after the other.
pub(crate) struct Assembler<'a> {
    rows: &'a dyn Rows,
    tile_order: TileOrder,
    memory: Option<u64>,
    threads: usize,
    /// Buffers of idle threads, reused from lane to lane: freeing and allocating them would fragment memory (measured:
    /// 22 MiB at a budget of 64).
    sorters: Mutex<Vec<LineSorter>>,
}

/// The size of a lane, counted before the lane is built.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct LaneTotals {
    pub(crate) tiles: u64,
    pub(crate) lines: u64,
    /// Number of records, including those that only bridge a distance.
    pub(crate) records: u64,
    pub(crate) voxels: u64,
}

/// A tile that is not empty, with its position in the tile order.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileSlot {
    key: u32,
    pub(super) u: u16,
    pub(super) v: u16,
    pub(super) records: u32,
}

impl<'a> Assembler<'a> {
    /// Creates an assembler of lanes with the voxels of `rows`; the lanes' tiles are stored in `tile_order`.
    ///
    /// `memory` is the most bytes of memory that the process may use; `None` for no limit. 0 `threads` count as 1.
    pub(crate) fn new(rows: &'a dyn Rows, tile_order: TileOrder, memory: Option<u64>, threads: usize) -> Assembler<'a> {
        Assembler { rows, tile_order, memory, threads: threads.clamp(1, MOST_THREADS), sorters: Mutex::default() }
    }

    /// Builds the lane along `axis`: calls `begin` once with the lane's size, then `take` with its tiles, run by run.
    ///
    /// # Errors
    /// Any error of reading the rows, of `begin` or of `take`; [`Error::Interrupted`](crate::Error::Interrupted) if the
    /// observer cancels.
    pub(crate) fn lane(
        &self,
        axis: Axis,
        observer: &mut dyn Observer,
        begin: &mut dyn FnMut(&LaneTotals) -> Result<()>,
        take: &mut dyn FnMut(TileRun) -> Result<()>,
    ) -> Result<()> {
        let face = LaneFace::new(self.rows.dims(), axis);
        let phase = Phase::Assemble(axis);
        report(observer, phase, 0, 1)?;
        let mut go_on = || report(observer, phase, 0, 1);
        let (slots, totals) = face.census(self.rows, self.tile_order, self.threads, &mut go_on)?;
        begin(&totals)?;
        let fullest = slots.iter().map(|slot| u64::from(slot.records)).max().unwrap_or(0);
        let free = free_for_runs(self.memory, self.rows.memory(), face.tiles());
        let limit = (free / RECORD_BYTES / self.threads as u64).clamp(1, RUN_RECORDS);
        // A tile is packed as a whole: if one exceeds a thread's share, fewer threads work.
        let threads = free / (2 * large_tile_bytes(fullest, self.rows.channels())).max(1);
        let fewer = usize::try_from(threads).unwrap_or(self.threads).clamp(1, self.threads);
        let threads = if fullest > limit { fewer } else { self.threads };
        let mut runs = Vec::new();
        // Several runs per thread, so that no thread waits long for the others.
        let fair = totals.records.div_ceil(8 * threads as u64).max(1 << 14);
        divide(&slots, 0, limit.min(fair), &mut runs);
        let mut done = 0;
        let sorters = || self.sorters.lock().unwrap_or_else(PoisonError::into_inner);
        let work = |(): &mut (), run: usize| {
            let mut sorter = sorters().pop().unwrap_or_default();
            let packed = sorter.pack_run(self.rows, &face, &slots[runs[run].clone()], limit);
            sorters().push(sorter);
            packed
        };
        let write = |_, run: TileRun| {
            done += run.arrays.steps.len() as u64;
            take(run)?;
            report(observer, phase, done, totals.records)
        };
        in_order(runs.len(), threads, || (), work, write)
    }
}

/// Divides `slots`, the first of which has index `first`, into runs of at most `limit` records.
fn divide(slots: &[TileSlot], first: usize, limit: u64, runs: &mut Vec<Range<usize>>) {
    let records: u64 = slots.iter().map(|slot| u64::from(slot.records)).sum();
    let ([start, .., end], true) = (slots, records > limit) else {
        if !slots.is_empty() {
            runs.push(first..first + slots.len());
        }
        return;
    };
    let bit = 1 << (31 - (start.key ^ end.key).leading_zeros());
    let (below, above) = slots.split_at(slots.partition_point(|slot| slot.key & bit == 0));
    divide(below, first, limit, runs);
    divide(above, first + below.len(), limit, runs);
}

/// The face of a lane (its lines as a 2-D array): maps voxels of rows to lines.
pub(super) struct LaneFace {
    axis: Axis,
    dims: [u32; 3],
    /// Number of tiles along u and v.
    tiles: [u32; 2],
}

impl LaneFace {
    pub(super) fn new(dims: [u32; 3], axis: Axis) -> LaneFace {
        let tiles = axis.others().map(|a| dims[a.index()].div_ceil(TILE_EDGE.into()));
        LaneFace { axis, dims, tiles }
    }

    pub(super) fn tiles(&self) -> u64 {
        self.tiles.iter().map(|&tiles| u64::from(tiles)).product()
    }

    /// Returns the box of grid points on the lines whose u is in `us` and whose v is in `vs`.
    pub(super) fn region(&self, us: Range<u32>, vs: Range<u32>) -> Region {
        let [_, dim_y, dim_z] = self.dims;
        match self.axis {
            Axis::X => Region { xs: 0..self.dims[0], ys: us, zs: vs },
            Axis::Y => Region { xs: us, ys: 0..dim_y, zs: vs },
            Axis::Z => Region { xs: us, ys: vs, zs: 0..dim_z },
        }
    }

    /// Returns the line (u, v) of a voxel at (x, y, z), and its coordinate along the line.
    #[inline(always)]
    pub(super) fn locate(&self, x: u16, y: u16, z: u16) -> (u16, u16, u16) {
        match self.axis {
            Axis::X => (y, z, x),
            Axis::Y => (x, z, y),
            Axis::Z => (x, y, z),
        }
    }

    /// Counts the records of each tile; returns the tiles that are not empty, in tile order, and the size of the lane.
    /// `go_on` is asked after each row of tiles.
    fn census(
        &self,
        rows: &dyn Rows,
        tile_order: TileOrder,
        threads: usize,
        go_on: &mut dyn FnMut() -> Result<()>,
    ) -> Result<(Vec<TileSlot>, LaneTotals)> {
        let edge = u32::from(TILE_EDGE);
        let [columns, strips] = self.tiles;
        let mut slots = Vec::new();
        let mut totals = LaneTotals::default();
        // For each line of the strip of tiles: its last coordinate so far plus 1; 0 for an empty line.
        let scratch = || vec![0u32; (columns * edge * edge) as usize];
        let count = |ends: &mut Vec<u32>, strip: usize| {
            let strip = u32::try_from(strip).expect("at most 8,192 strips");
            let mut tiles = vec![0u32; columns as usize];
            let mut totals = LaneTotals::default();
            let region = self.region(0..columns * edge, strip * edge..(strip + 1) * edge);
            if rows.is_void(&region) {
                return Ok((Vec::new(), totals));
            }
            ends.fill(0);
            rows.read(region, &mut |y, z, voxels| {
                for voxel in voxels {
                    let (u, v, t) = self.locate(voxel.x, y, z);
                    let end = &mut ends[usize::from(v % TILE_EDGE) * (columns * edge) as usize + usize::from(u)];
                    let gap = u32::from(t) + 1 - *end;
                    totals.lines += u64::from(*end == 0);
                    totals.voxels += 1;
                    tiles[usize::from(u / TILE_EDGE)] += 1 + (gap - 1) / STEPPING;
                    *end = u32::from(t) + 1;
                }
            })?;
            Ok((tiles, totals))
        };
        in_order(strips as usize, threads, scratch, count, |strip, (tiles, strip_totals)| {
            let v = u16::try_from(strip).expect("at most 8,192 strips");
            for (u, records) in (0u16..).zip(tiles).filter(|(_, records)| *records > 0) {
                slots.push(TileSlot { key: tile_order.key(u, v), u, v, records });
                totals.tiles += 1;
                totals.records += u64::from(records);
            }
            totals.lines += strip_totals.lines;
            totals.voxels += strip_totals.voxels;
            go_on()
        })?;
        slots.sort_unstable_by_key(|slot| slot.key);
        Ok((slots, totals))
    }
}
