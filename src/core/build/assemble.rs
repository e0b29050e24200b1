//! Assembly: from rows to a lane, in the order of its tiles and in bounded memory.
//!
//! In: [`Rows`]. Out: the lane's tiles in their order, some at a time ([`TileRun`]). A first reading counts the records
//! of every tile. The counts cut the tile order into runs that fit the memory; then each run reads the rows that it
//! touches, deals their voxels out to its lines and packs them, on a thread of its own.
//!
//! A run ends where the bits of the order's key say so (the halves of a binary trie): on a space-filling curve it is
//! a compact patch of the face, and the rows that it reads are few beside its own.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use zerocopy::byteorder::little_endian::{U16, U32, U64};

use super::budget::{RECORD_BYTES, RUN_RECORDS, free_for_runs, large_tile_bytes};
use super::builder::{Observer, Phase, go_on};
use crate::arena::curve::TileOrder;
use crate::arena::lane::STEPPING;
use crate::arena::layout::{Channels, TILE_EDGE, TileRecord};
use crate::arena::pack::{ChannelArrays, Record, TileRun};
use crate::arena::rows::{Region, Rows};
use crate::error::Result;
use crate::parallel::in_order;
use crate::volume::Axis;

/// What assembles lanes, one after the other.
pub struct Assembler<'a> {
    rows: &'a dyn Rows,
    tile_order: TileOrder,
    memory: Option<u64>,
    threads: usize,
    /// Buffers of the threads that are not at work. They serve lane after lane: freed and taken again they would
    /// leave holes in the allocator's memory (measured: 22 MiB at a budget of 64).
    dealers: Mutex<Vec<Dealer>>,
}

/// What a lane has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LaneTotals {
    /// Tiles that are not empty.
    pub tiles: u64,
    /// Lines that are not empty.
    pub lines: u64,
    /// Records, stepping voxels included.
    pub records: u64,
    /// Visible voxels.
    pub voxels: u64,
}

/// A tile of the lane that is not empty.
#[derive(Debug, Clone, Copy)]
struct Place {
    key: u32,
    u: u16,
    v: u16,
    records: u32,
}

impl<'a> Assembler<'a> {
    /// An assembler of lanes of `rows`, with their tiles in `tile_order`.
    ///
    /// `memory`: bytes that the process may take at most; `None` for no limit. `threads`: that work; 0 counts as 1.
    pub fn new(rows: &'a dyn Rows, tile_order: TileOrder, memory: Option<u64>, threads: usize) -> Assembler<'a> {
        Assembler { rows, tile_order, memory, threads: threads.max(1), dealers: Mutex::default() }
    }

    /// Assembles the lane along `axis`: calls `begin` once with what it has in all, then `take` with its runs in order.
    ///
    /// # Errors
    /// What reading the rows, `begin` or `take` give; [`crate::error::Error::Interrupted`] if the observer says so.
    pub fn lane(
        &self,
        axis: Axis,
        observer: &mut dyn Observer,
        begin: &mut dyn FnMut(&LaneTotals) -> Result<()>,
        take: &mut dyn FnMut(TileRun) -> Result<()>,
    ) -> Result<()> {
        let face = Face::new(self.rows.dims(), axis);
        let phase = Phase::Assemble(axis);
        go_on(observer, phase, 0, 1)?;
        let (places, totals) = face.census(self.rows, self.tile_order, self.threads)?;
        begin(&totals)?;
        let fullest = places.iter().map(|place| u64::from(place.records)).max().unwrap_or(0);
        let free = free_for_runs(self.memory, self.rows.memory(), face.tiles());
        let limit = (free / RECORD_BYTES / self.threads as u64).clamp(1, RUN_RECORDS);
        // A tile comes out whole: where one is too large for every thread's share, fewer threads work.
        let threads = free / (2 * large_tile_bytes(fullest, self.rows.channels())).max(1);
        let fewer = usize::try_from(threads).unwrap_or(self.threads).clamp(1, self.threads);
        let threads = if fullest > limit { fewer } else { self.threads };
        let mut runs = Vec::new();
        // Several runs a thread, so that none waits long for the others.
        let fair = totals.records.div_ceil(8 * threads as u64).max(1 << 14);
        cut(&places, 0, limit.min(fair), &mut runs);
        let mut done = 0;
        let dealers = || self.dealers.lock().unwrap_or_else(PoisonError::into_inner);
        let work = |(): &mut (), run: usize| {
            let mut dealer = dealers().pop().unwrap_or_default();
            let packed = dealer.run(self.rows, &face, &places[runs[run].clone()], limit);
            dealers().push(dealer);
            packed
        };
        in_order(
            runs.len(),
            threads,
            || (),
            work,
            |_, run| {
                done += run.arrays.steps.len() as u64;
                take(run)?;
                go_on(observer, phase, done, totals.records)
            },
        )
    }
}

/// Cuts `places`, the first of which is number `first`, into runs of at most `limit` records.
fn cut(places: &[Place], first: usize, limit: u64, runs: &mut Vec<Range<usize>>) {
    let records: u64 = places.iter().map(|place| u64::from(place.records)).sum();
    let ([start, .., end], true) = (places, records > limit) else {
        if !places.is_empty() {
            runs.push(first..first + places.len());
        }
        return;
    };
    let bit = 1 << (31 - (start.key ^ end.key).leading_zeros());
    let (below, above) = places.split_at(places.partition_point(|place| place.key & bit == 0));
    cut(below, first, limit, runs);
    cut(above, first + below.len(), limit, runs);
}

/// The face of a lane: where a voxel of a row lies on it.
struct Face {
    axis: Axis,
    dims: [u32; 3],
    /// Tiles along u and v.
    tiles: [u32; 2],
}

impl Face {
    fn new(dims: [u32; 3], axis: Axis) -> Face {
        let tiles = axis.others().map(|a| dims[a.index()].div_ceil(TILE_EDGE.into()));
        Face { axis, dims, tiles }
    }

    fn tiles(&self) -> u64 {
        self.tiles.iter().map(|&tiles| u64::from(tiles)).product()
    }

    /// The rows of lines `us`, `vs`.
    fn region(&self, us: Range<u32>, vs: Range<u32>) -> Region {
        let [_, dim_y, dim_z] = self.dims;
        match self.axis {
            Axis::X => Region { xs: 0..self.dims[0], ys: us, zs: vs },
            Axis::Y => Region { xs: us, ys: 0..dim_y, zs: vs },
            Axis::Z => Region { xs: us, ys: vs, zs: 0..dim_z },
        }
    }

    /// u, v and the coordinate along the lane of a voxel.
    #[inline(always)]
    fn locate(&self, x: u16, y: u16, z: u16) -> (u16, u16, u16) {
        match self.axis {
            Axis::X => (y, z, x),
            Axis::Y => (x, z, y),
            Axis::Z => (x, y, z),
        }
    }

    /// The tiles that are not empty, in their order, and what the lane has in all.
    fn census(&self, rows: &dyn Rows, tile_order: TileOrder, threads: usize) -> Result<(Vec<Place>, LaneTotals)> {
        let edge = u32::from(TILE_EDGE);
        let [columns, strips] = self.tiles;
        let mut places = Vec::new();
        let mut totals = LaneTotals::default();
        // By line of the strip: one past the last coordinate, 0 on an empty one.
        let scratch = || vec![0u32; (columns * edge * edge) as usize];
        let count = |ends: &mut Vec<u32>, strip: usize| {
            let strip = u32::try_from(strip).expect("at most 8,192 strips");
            let mut tiles = vec![0u32; columns as usize];
            let mut totals = LaneTotals::default();
            ends.fill(0);
            let region = self.region(0..columns * edge, strip * edge..(strip + 1) * edge);
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
                places.push(Place { key: tile_order.key(u, v), u, v, records });
                totals.tiles += 1;
                totals.records += u64::from(records);
            }
            totals.lines += strip_totals.lines;
            totals.voxels += strip_totals.voxels;
            Ok(())
        })?;
        places.sort_unstable_by_key(|place| place.key);
        Ok((places, totals))
    }
}

/// A voxel on its way to its line.
#[derive(Debug, Clone, Copy)]
struct Dealt {
    /// The tile's number in the run times 64, plus the line's bit.
    line: u32,
    t: u16,
    value: u16,
    normal: u32,
    magnitude: u8,
}

/// What deals voxels out to lines; its buffers serve one run after the other.
#[derive(Default)]
struct Dealer {
    voxels: Vec<Dealt>,
    /// Where each line's voxels start in `order`.
    starts: Vec<u32>,
    /// Voxels by line.
    order: Vec<u32>,
    /// By tile of the run's bounding box: its number in the run plus 1, or 0.
    numbers: Vec<u32>,
}

impl Dealer {
    /// Packs the tiles at `places`. A single one of more than `limit` records is dealt out a row of its lines at a time.
    fn run(&mut self, rows: &dyn Rows, face: &Face, places: &[Place], limit: u64) -> Result<TileRun> {
        let edge = u32::from(TILE_EDGE);
        let bounds = |coordinate: fn(&Place) -> u16| {
            let (low, high) = places.iter().map(coordinate).fold((u16::MAX, 0), |(l, h), c| (l.min(c), h.max(c)));
            u32::from(low)..u32::from(high) + 1
        };
        let (us, vs) = (bounds(|place| place.u), bounds(|place| place.v));
        let columns = us.len();
        self.numbers.clear();
        self.numbers.resize(columns * vs.len(), 0);
        for (number, place) in (1..).zip(places) {
            let [u, v] = [u32::from(place.u) - us.start, u32::from(place.v) - vs.start];
            self.numbers[v as usize * columns + u as usize] = number;
        }
        let records = places.iter().map(|place| place.records as usize).sum();
        let mut run = TileRun {
            tiles: places.iter().map(Place::without_lines).collect(),
            line_ends: Vec::new(),
            arrays: ChannelArrays::with_capacity(rows.channels(), records),
        };
        self.voxels.clear();
        self.voxels.reserve_exact(records.min(usize::try_from(limit).unwrap_or(usize::MAX)));
        let lines = vs.start * edge..vs.end * edge;
        let step = if records as u64 > limit && places.len() == 1 { 1 } else { lines.len() };
        for first in lines.clone().step_by(step) {
            let part = first..(first + u32::try_from(step).expect("at most 65,536 lines")).min(lines.end);
            let region = face.region(us.start * edge..us.end * edge, part);
            self.deal(rows, face, region, [us.start as usize, vs.start as usize, columns], places.len())?;
            self.pack(&mut run, rows.channels());
        }
        Ok(run)
    }

    /// Sorts the voxels of `region` by line. `first_u`, `first_v`, `columns`: of the box that `numbers` is for.
    fn deal(
        &mut self,
        rows: &dyn Rows,
        face: &Face,
        region: Region,
        [first_u, first_v, columns]: [usize; 3],
        tiles: usize,
    ) -> Result<()> {
        self.voxels.clear();
        // Each line's count stands two places on, so that the sums below make starts of them.
        self.starts.clear();
        self.starts.resize(64 * tiles + 2, 0);
        rows.read(region, &mut |y, z, voxels| {
            for voxel in voxels {
                let (u, v, t) = face.locate(voxel.x, y, z);
                let tile = [usize::from(u / TILE_EDGE) - first_u, usize::from(v / TILE_EDGE) - first_v];
                let Some(number) = self.numbers[tile[1] * columns + tile[0]].checked_sub(1) else { continue };
                let line = number * 64 + u32::from(v % TILE_EDGE * TILE_EDGE + u % TILE_EDGE);
                let Record { value, normal, magnitude } = voxel.record;
                self.voxels.push(Dealt { line, t, value, normal, magnitude });
                self.starts[line as usize + 2] += 1;
            }
        })?;
        for line in 2..self.starts.len() {
            self.starts[line] += self.starts[line - 1];
        }
        // `starts[line + 1]` is now where the line starts, and becomes where it ends.
        self.order.clear();
        self.order.resize(self.voxels.len(), 0);
        for (index, voxel) in (0..).zip(&self.voxels) {
            let next = &mut self.starts[voxel.line as usize + 1];
            self.order[*next as usize] = index;
            *next += 1;
        }
        Ok(())
    }

    /// Appends the lines that were dealt out; of a tile, those come after the ones that it has.
    fn pack(&self, run: &mut TileRun, channels: Channels) {
        let TileRun { tiles, line_ends, arrays } = run;
        for (tile, starts) in tiles.iter_mut().zip(self.starts.windows(65).step_by(64)) {
            for (bit, range) in starts.windows(2).enumerate().filter(|(_, range)| range[0] < range[1]) {
                if tile.occupancy.get() == 0 {
                    tile.first_line =
                        U32::new(u32::try_from(line_ends.len()).expect("a face has fewer than 2^32 lines"));
                    tile.first_record = U64::new(arrays.steps.len() as u64);
                }
                let line = &self.order[range[0] as usize..range[1] as usize];
                let voxels = line.iter().map(|&index| self.voxels[index as usize]);
                let voxels =
                    voxels.map(|Dealt { t, value, normal, magnitude, .. }| (t, Record { value, normal, magnitude }));
                let (low, high) = arrays.push_line(channels, voxels);
                tile.low = U16::new(tile.low.get().min(low));
                tile.high = U16::new(tile.high.get().max(high));
                tile.occupancy = U64::new(tile.occupancy.get() | 1 << bit);
                let end = arrays.steps.len() as u64 - tile.first_record.get();
                line_ends.push(u32::try_from(end).expect("64 lines of 65,535 records stay below 2^32"));
            }
        }
    }
}

impl Place {
    /// The tile's record, before its lines are packed.
    fn without_lines(&self) -> TileRecord {
        TileRecord {
            tile_u: U16::new(self.u),
            tile_v: U16::new(self.v),
            first_line: U32::ZERO,
            first_record: U64::ZERO,
            occupancy: U64::ZERO,
            low: U16::new(u16::MAX),
            high: U16::ZERO,
        }
    }
}
