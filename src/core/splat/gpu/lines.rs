//! The line list: what the processor prepares for a walk on the device.
//!
//! In: a lane and an order; how much of a lane the device can hold at a time. Out: slabs, each some of the lane's tiles
//! and a run of lines in visit order, cut into blocks. A list depends only on the nesting of the axes and on the
//! directions of the slow and the medium axis (with the eye inside the grid: on which half of which voxel the eye is
//! in). So a list stays valid while a turning camera keeps its order.

use super::layout::LINES;
use super::slab_buffers::{SlabSizes, slab_sizes};
use crate::arena::layout::{TILE_EDGE, line_end_bytes};
use crate::arena::{Lane, TileRecord};
use crate::error::{Error, Result};
use crate::parallel::in_parts;
use crate::traverse::{AxisOrder, Batch, Order, OrderedSlices, SliceLine, VoxelBox};

const LINES_OF_THREAD: usize = 1 << 14; // Fewest lines that are worth another thread: some tenths of a millisecond.
const BLOCK_RECORDS: u32 = 1 << 14; // Most records in a block, unless the block has only one line.

pub(crate) const LINE_BYTES: u64 = 8; // Bytes per line on the device: its word in the list, its share of a block.

/// Returns the part of `order` that a list depends on: orders with equal keys have equal lists. Voxel coordinates are
/// integers, so the key replaces the eye by one point for all eyes in the same half of a voxel.
pub(crate) fn list_key(order: &Order) -> Order {
    let mut key = *order;
    key.along[order.fast.index()] = AxisOrder::Ascending;
    for axis in &mut key.along {
        if let AxisOrder::TwoSided { eye, .. } = axis {
            let twice = 2.0 * *eye;
            *eye = if twice == twice.floor() { *eye } else { twice.floor() / 2.0 + 0.25 };
        }
    }
    key
}

/// All lines of a lane in visit order.
#[derive(Debug)]
pub(crate) struct LineList {
    pub(crate) key: Order,     // What the list depends on: see [`list_key`].
    pub(crate) room: LaneSize, // How much of a lane the device can hold, of which the slabs depend.
    pub(crate) slabs: Vec<Slab>,
    pub(crate) bounds: VoxelBox, // A box around all voxels.
    pub(crate) records: u64,     // Number of records of all lines.
}

/// A part of a lane that is on the device at a time: some tiles, and the lines that lie in them.
#[derive(Debug, Default)]
pub(crate) struct Slab {
    pub(crate) tiles: Vec<u32>, // Indices of the tiles, ascending.
    pub(crate) sizes: SlabSizes,
    /// Lines in visit order. The high 26 bits are an index in `tiles`, the low 6 bits a line of that tile.
    pub(crate) lines: Vec<u32>,
    pub(crate) blocks: Vec<ListBlock>,
}

/// Up to [`LINES`] consecutive lines of a slab.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ListBlock {
    pub(crate) first_line: u32,
    pub(crate) line_count: u32,
    pub(crate) records: u32,
    pub(crate) bounds: VoxelBox,
}

/// An amount of a lane: how much some tiles take, or how much may be on the device at a time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct LaneSize {
    pub(crate) bytes: u64, // Bytes of tiles, line ends, channels and lists.
    pub(crate) records: u64,
    pub(crate) lines: u64,
    pub(crate) tiles: u64,
}

impl LaneSize {
    /// Returns how much a whole lane takes, with its line list.
    pub(crate) fn of_lane(lane: &Lane) -> LaneSize {
        let lines = line_count(lane);
        let bytes = lane.bytes() + LINE_BYTES * lines;
        LaneSize { bytes, records: lane.record_count(), lines, tiles: lane.tiles.len() as u64 }
    }

    /// Returns how much tile `index` takes, with its line ends and records.
    fn of_tile(lane: &Lane, index: u32) -> LaneSize {
        let Some(tile) = lane.tile(index as usize) else { return LaneSize::default() };
        let lines = u64::from(tile.occupancy.get().count_ones());
        let records = lane.tile_records(tile);
        let line_end = u64::from(line_end_bytes(lane.dims[lane.axis.index()]));
        let bytes = size_of::<TileRecord>() as u64
            + lines * (line_end + LINE_BYTES)
            + records.saturating_mul(lane.channels.record_bytes());
        LaneSize { bytes, records, lines, tiles: 1 }
    }

    fn add(self, other: LaneSize) -> LaneSize {
        LaneSize {
            bytes: self.bytes.saturating_add(other.bytes),
            records: self.records.saturating_add(other.records),
            lines: self.lines + other.lines,
            tiles: self.tiles + other.tiles,
        }
    }

    /// Returns an error that names the first amount of a slice of this size that is too large for `room`.
    fn check(self, room: LaneSize) -> Result<()> {
        let amounts = [
            ("video memory in bytes for the tiles of one slice (give more video memory)", self.bytes, room.bytes),
            ("records of one slice in a device's largest binding (draw on the processor)", self.records, room.records),
            ("lines of one slice in a device's largest binding (draw on the processor)", self.lines, room.lines),
            ("tiles of one slice in a device's largest binding (draw on the processor)", self.tiles, room.tiles),
        ];
        let excess = amounts.into_iter().find(|(_, need, have)| need > have);
        excess.map_or(Ok(()), |(what, need, have)| Err(Error::Limit { what: what.into(), need, have }))
    }
}

impl LineList {
    /// Lists the lines of `lane` in `order`: as one slab, on up to `threads` threads, if the whole lane fits `room`; else as
    /// slabs of as many slices as fit. [`Error::Limit`] if the tiles of a single slice do not fit.
    pub(crate) fn new(lane: &Lane, order: &Order, room: LaneSize, threads: usize) -> Result<LineList> {
        let slices = OrderedSlices::new(lane, order, |_| true);
        let is_whole = LaneSize::of_lane(lane).check(room).is_ok();
        let mut slabs = if is_whole {
            Slab::of_lane(lane, order, &slices, threads).into_iter().collect()
        } else {
            let mut builder = ListBuilder::new(lane, order, room);
            let mut outcome = Ok(());
            slices.visit(0..slices.len(), &mut no_voxels, listed, |_, slow, lines| {
                if outcome.is_ok() && !lines.is_empty() {
                    outcome = builder.add_slice(slow, lines);
                }
            });
            outcome?;
            builder.close_slab();
            builder.closed
        };
        for slab in &mut slabs {
            slab.sizes = slab_sizes(lane, &slab.tiles)?;
        }
        let blocks = || slabs.iter().flat_map(|slab| &slab.blocks);
        let bounds = blocks().map(|block| block.bounds).reduce(union);
        let bounds = bounds.unwrap_or(VoxelBox { low: [0; 3], high: [0; 3] });
        let records = blocks().map(|block| u64::from(block.records)).sum();
        Ok(LineList { key: list_key(order), room, bounds, records, slabs })
    }
}

/// The visitor of a walk that visits no voxels.
fn no_voxels(_: &Batch) {}

/// A line of a slice, and its tile.
type OrderedLine = SliceLine<ListedTile>;

/// The tile of a line.
#[derive(Debug, Clone, Copy, Default)]
struct ListedTile {
    index: u32,       // Its index in the lane.
    extent: [u16; 2], // Lowest and highest coordinate on the fast axis of the voxels of all its lines.
}

fn listed(index: u32, record: &TileRecord) -> ListedTile {
    ListedTile { index, extent: [record.low.get(), record.high.get()] }
}

/// Cuts the lines of a lane that does not fit, slice by slice, into slabs.
struct ListBuilder<'a> {
    lane: &'a Lane<'a>,
    order: Order,
    room: LaneSize,
    has_tile: Vec<bool>, // Whether each of the lane's tiles is in the open slab.
    size: LaneSize,      // Size of the open slab.
    open: Slab,
    closed: Vec<Slab>,
}

impl<'a> ListBuilder<'a> {
    fn new(lane: &'a Lane<'a>, order: &Order, room: LaneSize) -> ListBuilder<'a> {
        let has_tile = vec![false; lane.tiles.len()];
        let (size, open) = (LaneSize::default(), Slab::default());
        ListBuilder { lane, order: *order, room, has_tile, size, open, closed: Vec::new() }
    }

    /// Adds the lines of a slice to the open slab, or to a new slab if the open one has no room for their tiles.
    fn add_slice(&mut self, slow: u16, slice: &[OrderedLine]) -> Result<()> {
        let mut size = self.size.add(self.added_size(slice));
        if size.check(self.room).is_err() {
            self.close_slab();
            size = self.added_size(slice);
            size.check(self.room)?;
        }
        self.size = size;
        for line in slice {
            if !std::mem::replace(&mut self.has_tile[line.tile.index as usize], true) {
                self.open.tiles.push(line.tile.index);
            }
            self.open.add(slow, line, &self.order);
        }
        Ok(())
    }

    /// Returns the size of those tiles of `slice` that the open slab does not have.
    fn added_size(&self, slice: &[OrderedLine]) -> LaneSize {
        // The lines of a tile need not be consecutive: with the eye inside the grid, the lines of two tiles alternate.
        let mut tiles: Vec<u32> = slice.iter().map(|line| line.tile.index).collect();
        tiles.sort_unstable();
        tiles.dedup();
        let added = tiles.into_iter().filter(|&tile| !self.has_tile[tile as usize]);
        added.map(|tile| LaneSize::of_tile(self.lane, tile)).fold(LaneSize::default(), LaneSize::add)
    }

    /// Closes the open slab, which is dropped if it has no lines, and opens an empty one.
    fn close_slab(&mut self) {
        let mut slab = std::mem::take(&mut self.open);
        self.size = LaneSize::default();
        slab.tiles.sort_unstable();
        let index = |tile| slab.tiles.binary_search(&tile).expect("a line's tile is in its slab");
        for line in &mut slab.lines {
            *line = u32::try_from(index(*line >> 6)).expect("an index of a tile") << 6 | *line & 63;
        }
        self.has_tile.fill(false);
        if !slab.lines.is_empty() {
            self.closed.push(slab);
        }
    }
}

impl Slab {
    /// Returns all of a lane, listed on up to `threads` threads; `None` if it has no lines.
    fn of_lane(lane: &Lane, order: &Order, slices: &OrderedSlices, threads: usize) -> Option<Slab> {
        let lines = usize::try_from(line_count(lane)).unwrap_or(usize::MAX);
        let count = threads.min(lines / LINES_OF_THREAD).clamp(1, slices.len().max(1));
        let mut parts: Vec<Slab> = std::iter::repeat_with(Slab::default).take(count).collect();
        in_parts(&mut parts, 1, count, |index, part| {
            let range = slices.len() * index / count..slices.len() * (index + 1) / count;
            slices.visit(range, &mut no_voxels, listed, |_, slow, lines| {
                lines.iter().for_each(|line| part[0].add(slow, line, order));
            });
        });
        let mut whole = parts.into_iter().reduce(Slab::joined).filter(|slab| !slab.lines.is_empty())?;
        whole.tiles = (0..u32::try_from(lane.tiles.len()).expect("a face has at most 2^26 tiles")).collect();
        Some(whole)
    }

    /// Returns this slab with the lines and blocks of the `next` after its own.
    fn joined(mut self, next: Slab) -> Slab {
        let before = u32::try_from(self.lines.len()).expect("a face has fewer than 2^32 lines");
        self.lines.extend(next.lines);
        let moved = |block: ListBlock| ListBlock { first_line: before + block.first_line, ..block };
        self.blocks.extend(next.blocks.into_iter().map(moved));
        self
    }

    fn add(&mut self, slow: u16, line: &OrderedLine, order: &Order) {
        let sides = [(order.slow, [slow; 2]), (order.medium, [line.medium; 2]), (order.fast, line.tile.extent)];
        let bounds = VoxelBox::from_sides(sides);
        let first_line = u32::try_from(self.lines.len()).expect("a face has fewer than 2^32 lines");
        let records = line.count.into();
        let [u, v] = order.fast.others().map(|axis| u32::from(bounds.low[axis.index()] % TILE_EDGE));
        self.lines.push(line.tile.index << 6 | v << 3 | u);
        match self.blocks.last_mut() {
            Some(block) if block.line_count < LINES && block.records + records <= BLOCK_RECORDS => {
                block.line_count += 1;
                block.records += records;
                block.bounds = union(block.bounds, bounds);
            }
            _ => self.blocks.push(ListBlock { first_line, line_count: 1, records, bounds }),
        }
    }
}

/// Returns the number of lines of `lane`, its patch's included.
pub(crate) fn line_count(lane: &Lane) -> u64 {
    (lane.line_ends.len() + lane.patch.map_or(0, |patch| patch.view().line_ends.len())) as u64
}

fn union(a: VoxelBox, b: VoxelBox) -> VoxelBox {
    VoxelBox {
        low: std::array::from_fn(|axis| a.low[axis].min(b.low[axis])),
        high: std::array::from_fn(|axis| a.high[axis].max(b.high[axis])),
    }
}
