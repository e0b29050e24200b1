//! The line list: what the processor does for a walk on the device.
//!
//! In: a lane and an order; how many bytes of a lane the device holds at a time. Out: slabs, each some of the lane's
//! tiles and a run of lines in visit order, cut into blocks. A list depends on the nesting and on the directions of the
//! slow and the medium axis alone (with an eye between, on which half of which voxel it is in), so that it stays as it
//! is while a camera turns within one order.
//!
//! ```text
//! slices in the slow order -> as many as there is room for -> slab: tiles as the lane has them, lines in visit order
//! lines -> blocks of 64 -> per frame: those in view, in chunks of as many records as the buffers hold
//! ```

use super::layout::LINES;
use crate::arena::layout::line_end_bytes;
use crate::arena::{Lane, TileRecord};
use crate::error::{Error, Result};
use crate::traverse::{AxisOrder, Order, OrderedLine, Sense, SplitForm, VoxelBox, ordered_lines};
use crate::volume::Axis;

/// Largest number of records of a block of more than one line.
const BLOCK_RECORDS: u32 = 1 << 14;

/// Bytes of a line in the lists on the device: its word, and its share of a block.
pub(crate) const LINE_BYTES: u64 = 8;

/// What a list depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Key {
    slow: Axis,
    medium: Axis,
    along: [Direction; 2],
}

/// The direction of an axis: two eyes of one value put all whole coordinates in the same order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Ascending,
    Descending,
    TwoSided { twice: i64, is_half: bool, form: SplitForm, sense: Sense },
}

impl Direction {
    #[expect(clippy::cast_possible_truncation, reason = "an eye within the grid")]
    fn new(order: AxisOrder) -> Direction {
        match order {
            AxisOrder::Ascending => Direction::Ascending,
            AxisOrder::Descending => Direction::Descending,
            AxisOrder::TwoSided { eye, form, sense } => {
                let twice = 2.0 * eye;
                Direction::TwoSided { twice: twice.floor() as i64, is_half: twice == twice.floor(), form, sense }
            }
        }
    }
}

impl Key {
    pub(crate) fn new(order: &Order) -> Key {
        let along = [order.slow, order.medium].map(|axis| Direction::new(order.along[axis.index()]));
        Key { slow: order.slow, medium: order.medium, along }
    }
}

/// A line list.
#[derive(Debug)]
pub(crate) struct LineList {
    pub(crate) key: Key,
    /// In visit order.
    pub(crate) slabs: Vec<Slab>,
    /// All voxels that there may be.
    pub(crate) bounds: VoxelBox,
    /// Records of all lines.
    pub(crate) records: u64,
}

/// What is on the device at a time: tiles of a lane, and lines that lie in them.
#[derive(Debug)]
pub(crate) struct Slab {
    /// Indices of the tiles, ascending.
    pub(crate) tiles: Vec<u32>,
    /// Lines in visit order: index of the tile in `tiles` in the high 26 bits, line of the tile in the low 6.
    pub(crate) lines: Vec<u32>,
    pub(crate) blocks: Vec<LineBlock>,
}

/// Some lines in visit order.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LineBlock {
    pub(crate) first_line: u32,
    pub(crate) line_count: u32,
    pub(crate) records: u32,
    pub(crate) bounds: VoxelBox,
}

/// How much of a lane there may be on the device at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Room {
    /// Bytes of tiles, line ends, channels and lists.
    pub(crate) bytes: u64,
    /// Records, by the device's largest binding.
    pub(crate) records: u64,
    /// Lines, likewise.
    pub(crate) lines: u64,
    /// Tiles, likewise.
    pub(crate) tiles: u64,
}

impl LineList {
    /// The list of `lane` in `order`: one slab if there is room for all of it, else as few as there are slices to share.
    ///
    /// # Errors
    /// [`Error::Limit`] if there is no room for the tiles of a single slice.
    pub(crate) fn new(lane: &Lane, order: &Order, room: Room) -> Result<LineList> {
        let nesting = [order.slow.index(), order.medium.index(), order.fast.index()];
        let lines = line_count(lane);
        let bytes = lane.bytes() + LINE_BYTES * lines;
        let whole = Load { bytes, records: lane.record_count(), lines, tiles: lane.tiles.len() as u64 };
        let mut open = Open::new(lane, nesting, whole.fits(room));
        let mut slabs = Vec::new();
        let mut slice: Vec<OrderedLine> = Vec::new();
        let mut refused = None;
        let mut end_slice = |slice: &mut Vec<OrderedLine>| {
            if refused.is_none() && !open.take(slice, room) {
                slabs.extend(open.close());
                if !open.take(slice, room) {
                    refused = Some(open.load_of(slice));
                }
            }
            slice.clear();
        };
        ordered_lines(lane, order, |line| {
            if slice.last().is_some_and(|last| last.slow != line.slow) {
                end_slice(&mut slice);
            }
            slice.push(line);
        });
        if !slice.is_empty() {
            end_slice(&mut slice);
        }
        if let Some(load) = refused {
            return Err(load.refusal(room));
        }
        slabs.extend(open.close());
        let bounds = slabs.iter().flat_map(|slab: &Slab| &slab.blocks).map(|block| block.bounds).reduce(union);
        let bounds = bounds.unwrap_or(VoxelBox { low: [0; 3], high: [0; 3] });
        let records = slabs.iter().flat_map(|slab| &slab.blocks).map(|block| u64::from(block.records)).sum();
        Ok(LineList { key: Key::new(order), slabs, bounds, records })
    }
}

/// What tiles take.
#[derive(Debug, Clone, Copy, Default)]
struct Load {
    bytes: u64,
    records: u64,
    lines: u64,
    tiles: u64,
}

impl Load {
    fn fits(self, room: Room) -> bool {
        self.bytes <= room.bytes && self.records <= room.records && self.lines <= room.lines && self.tiles <= room.tiles
    }

    /// What of a single slice is too much.
    fn refusal(self, room: Room) -> Error {
        let (what, need, have) = if self.bytes > room.bytes {
            ("video memory in bytes for the tiles of one slice (give more video memory)", self.bytes, room.bytes)
        } else if self.records > room.records {
            ("records of one slice in a device's largest binding (draw on the processor)", self.records, room.records)
        } else if self.lines > room.lines {
            ("lines of one slice in a device's largest binding (draw on the processor)", self.lines, room.lines)
        } else {
            ("tiles of one slice in a device's largest binding (draw on the processor)", self.tiles, room.tiles)
        };
        Error::Limit { what: what.into(), need, have }
    }

    fn add(&mut self, other: Load) {
        self.bytes = self.bytes.saturating_add(other.bytes);
        self.records = self.records.saturating_add(other.records);
        self.lines += other.lines;
        self.tiles += other.tiles;
    }
}

/// The slab that lines are put into.
struct Open<'a> {
    lane: &'a Lane<'a>,
    nesting: [usize; 3],
    /// Whether it holds the whole lane, so that nothing has to be counted.
    is_whole: bool,
    /// Whether each of the lane's tiles is in the slab.
    has_tile: Vec<bool>,
    load: Load,
    slab: Slab,
}

impl<'a> Open<'a> {
    fn new(lane: &'a Lane<'a>, nesting: [usize; 3], is_whole: bool) -> Open<'a> {
        let has_tile = if is_whole { Vec::new() } else { vec![false; lane.tiles.len()] };
        let slab = Slab { tiles: Vec::new(), lines: Vec::new(), blocks: Vec::new() };
        Open { lane, nesting, is_whole, has_tile, load: Load::default(), slab }
    }

    /// What the tiles of `slice` take that are not here yet.
    fn load_of(&self, slice: &[OrderedLine]) -> Load {
        // Lines of a tile need not come one after the other: with an eye between, two tiles take turns.
        let mut tiles: Vec<u32> = slice.iter().map(|line| line.tile).collect();
        tiles.sort_unstable();
        tiles.dedup();
        let mut load = Load::default();
        for tile in tiles.into_iter().filter(|&tile| !self.has_tile[tile as usize]) {
            load.add(tile_load(self.lane, tile));
        }
        load
    }

    /// Takes the lines of a slice if there is room for their tiles.
    fn take(&mut self, slice: &[OrderedLine], room: Room) -> bool {
        if !self.is_whole {
            let mut load = self.load_of(slice);
            load.add(self.load);
            if !load.fits(room) {
                return false;
            }
            self.load = load;
            for line in slice {
                if !std::mem::replace(&mut self.has_tile[line.tile as usize], true) {
                    self.slab.tiles.push(line.tile);
                }
            }
        }
        for line in slice {
            self.slab.add(line, self.nesting);
        }
        true
    }

    /// The slab, if it has lines; a new one is begun.
    fn close(&mut self) -> Option<Slab> {
        let empty = Slab { tiles: Vec::new(), lines: Vec::new(), blocks: Vec::new() };
        let mut slab = std::mem::replace(&mut self.slab, empty);
        self.load = Load::default();
        if self.is_whole {
            slab.tiles = (0..u32::try_from(self.lane.tiles.len()).expect("a face has at most 2^26 tiles")).collect();
        } else {
            slab.tiles.sort_unstable();
            let place = |tile| slab.tiles.binary_search(&tile).expect("a line's tile is in its slab");
            for line in &mut slab.lines {
                *line = u32::try_from(place(*line >> 6)).expect("a place among the tiles") << 6 | *line & 63;
            }
            self.has_tile.fill(false);
        }
        (!slab.lines.is_empty()).then_some(slab)
    }
}

impl Slab {
    fn add(&mut self, line: &OrderedLine, [slow, medium, fast]: [usize; 3]) {
        let mut bounds = VoxelBox { low: [0; 3], high: [0; 3] };
        for (axis, [low, high]) in [(slow, [line.slow; 2]), (medium, [line.medium; 2]), (fast, line.extent)] {
            (bounds.low[axis], bounds.high[axis]) = (low, high);
        }
        let first_line = u32::try_from(self.lines.len()).expect("a face has fewer than 2^32 lines");
        self.lines.push(line.tile << 6 | u32::from(line.bit));
        match self.blocks.last_mut() {
            Some(block) if block.line_count < LINES && block.records + line.records <= BLOCK_RECORDS => {
                block.line_count += 1;
                block.records += line.records;
                block.bounds = union(block.bounds, bounds);
            }
            _ => self.blocks.push(LineBlock { first_line, line_count: 1, records: line.records, bounds }),
        }
    }
}

/// Lines of `lane`, its patch's included.
pub(crate) fn line_count(lane: &Lane) -> u64 {
    (lane.line_ends.len() + lane.patch.map_or(0, |patch| patch.view().line_ends.len())) as u64
}

fn union(a: VoxelBox, b: VoxelBox) -> VoxelBox {
    VoxelBox {
        low: std::array::from_fn(|axis| a.low[axis].min(b.low[axis])),
        high: std::array::from_fn(|axis| a.high[axis].max(b.high[axis])),
    }
}

/// What a tile takes with its line ends and records.
fn tile_load(lane: &Lane, index: u32) -> Load {
    let Some(tile) = lane.tile(index as usize) else { return Load::default() };
    let lines = u64::from(tile.occupancy.get().count_ones());
    let records = lane.tile_records(tile);
    let line_end = u64::from(line_end_bytes(lane.dims[lane.axis.index()]));
    let bytes = size_of::<TileRecord>() as u64
        + lines * (line_end + LINE_BYTES)
        + records.saturating_mul(lane.channels.record_bytes());
    Load { bytes, records, lines, tiles: 1 }
}
