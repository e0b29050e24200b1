//! Packing: from the voxels of scan lines to a lane.
//!
//! In: lines by ascending v, then u, with voxels by ascending coordinate. Out: an [`OwnedLane`] with its tiles in tile
//! order. Lines are collected for eight values of v at a time (a strip); then their tiles are complete.

use std::ops::Range;

use zerocopy::byteorder::little_endian::{U16, U32, U64};

use super::curve::TileOrder;
use super::lane::{STEPPING, stored_line_ends};
use super::layout::{Channels, TILE_EDGE, TileRecord};
use super::owned_lane::OwnedLane;
use crate::volume::Axis;

/// The stored codes of one voxel (a code is the number that stands for a value).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Record {
    /// Code of the value.
    pub value: u16,
    /// Code of the normal, octahedral u in the low half; ignored if the arena stores no normals. 0 stands for (0, 0, 1), and
    /// [`normal::none`](crate::classify::normal::none) returns the code of no normal.
    pub normal: u32,
    /// Code of the gradient magnitude; ignored if the arena stores no magnitudes.
    pub magnitude: u8,
    /// Code of the [`Coverage`](super::Coverage), how much of the voxel is visible and where; ignored, and 0, if the arena
    /// stores no coverages.
    pub coverage: u16,
}

/// A voxel that is being sorted into its line.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LineVoxel {
    /// Number of the line, among those that are sorted together.
    pub(crate) line: u32,
    /// Coordinate along the line.
    pub(crate) t: u16,
    pub(crate) record: Record,
}

/// Records of consecutive lines, as one array per channel.
#[derive(Debug, Default)]
pub(crate) struct ChannelArrays {
    pub(crate) steps: Vec<u8>,
    pub(crate) values: Vec<u8>,
    pub(crate) normals: Vec<u8>,
    pub(crate) magnitudes: Vec<u8>,
    pub(crate) coverages: Vec<u8>,
}

/// Consecutive tiles of a lane, whose first lines and first records count from the start of the run.
#[derive(Debug, Default)]
pub struct TileRun {
    pub(crate) tiles: Vec<TileRecord>,
    pub(crate) line_ends: Vec<u32>,
    pub(crate) arrays: ChannelArrays,
}

impl ChannelArrays {
    #[inline(always)]
    fn push(&mut self, channels: Channels, step: u8, record: Record) {
        self.steps.push(step);
        let [low, high] = record.value.to_le_bytes();
        self.values.push(low);
        if channels.value_bits == 16 {
            self.values.push(high);
        }
        match channels.normal_bits {
            0 => {}
            8 => self.normals.extend_from_slice(&record.normal.to_le_bytes()[..2]),
            _ => self.normals.extend_from_slice(&record.normal.to_le_bytes()),
        }
        if channels.magnitude_bits == 8 {
            self.magnitudes.push(record.magnitude);
        }
        let coverage = record.coverage.to_le_bytes();
        self.coverages.extend_from_slice(&coverage[..usize::from(channels.coverage_bits / 8)]);
    }

    /// Appends the given records of `other`.
    fn append(&mut self, channels: Channels, other: &ChannelArrays, records: Range<usize>) {
        let ChannelArrays { steps, values, normals, magnitudes, coverages } = self;
        let from = [&other.steps, &other.values, &other.normals, &other.magnitudes, &other.coverages];
        let to = [steps, values, normals, magnitudes, coverages];
        for ((to, from), width) in to.into_iter().zip(from).zip(channels.widths()) {
            to.extend_from_slice(&from[width * records.start..width * records.end]);
        }
    }

    pub(crate) fn with_capacity(channels: Channels, records: usize) -> ChannelArrays {
        let [steps, values, normals, magnitudes, coverages] =
            channels.widths().map(|width| Vec::with_capacity(width * records));
        ChannelArrays { steps, values, normals, magnitudes, coverages }
    }
}

impl TileRun {
    /// Appends a line to tile (u, v), including stepping voxels. The lines of a tile come one after the other, in the
    /// order of their bits.
    ///
    /// # Panics
    /// If the voxels are not in ascending order, or there are none.
    #[inline]
    pub(crate) fn push_line(
        &mut self,
        channels: Channels,
        (u, v): (u16, u16),
        bit: u32,
        voxels: impl Iterator<Item = (u16, Record)>,
    ) {
        let TileRun { tiles, line_ends, arrays } = self;
        if tiles.last().is_none_or(|tile| (tile.tile_u.get(), tile.tile_v.get()) != (u, v)) {
            let first_line = u32::try_from(line_ends.len()).expect("a face has fewer than 2^32 lines");
            tiles.push(TileRecord {
                tile_u: U16::new(u),
                tile_v: U16::new(v),
                first_line: U32::new(first_line),
                first_record: U64::new(arrays.steps.len() as u64),
                occupancy: U64::ZERO,
                low: U16::MAX_VALUE,
                high: U16::ZERO,
            });
        }
        let mut next = 0u32; // one past the last coordinate, because the first step counts from -1
        let (mut low, mut high) = (None, 0);
        for (coordinate, record) in voxels {
            assert!(u32::from(coordinate) >= next, "voxels come by ascending coordinate");
            let mut gap = u32::from(coordinate) + 1 - next;
            while gap > STEPPING {
                arrays.push(channels, 0, Record::default());
                gap -= STEPPING;
            }
            arrays.push(channels, u8::try_from(gap).expect("at most 255 is left"), record);
            next = u32::from(coordinate) + 1;
            (low, high) = (low.or(Some(coordinate)), coordinate);
        }
        let tile = tiles.last_mut().expect("pushed above, if not before");
        tile.low = U16::new(tile.low.get().min(low.expect("a line that is packed has a voxel")));
        tile.high = U16::new(tile.high.get().max(high));
        tile.occupancy = U64::new(tile.occupancy.get() | 1 << bit);
        let end = arrays.steps.len() as u64 - tile.first_record.get();
        line_ends.push(u32::try_from(end).expect("64 lines of 65,535 records stay below 2^32"));
    }
}

/// One line of the current strip.
struct PendingLine {
    u: u16,
    v: u16,
    /// Indices of the line's voxels among those of the strip.
    voxels: Range<usize>,
}

/// Packs lines of voxels into one lane.
pub struct LanePacker {
    axis: Axis,
    dims: [u32; 3],
    channels: Channels,
    tile_order: TileOrder,
    /// Coordinates and codes of the current strip's voxels (eight values of v), in order of arrival.
    pending: Vec<(u16, Record)>,
    pending_lines: Vec<PendingLine>,
    /// The finished strips, packed tile by tile.
    strips: Vec<TileRun>,
}

impl LanePacker {
    /// Creates a packer for the lane along `axis` of a grid with `dims` points.
    pub fn new(axis: Axis, dims: [u32; 3], channels: Channels, tile_order: TileOrder) -> LanePacker {
        let (pending, pending_lines, strips) = (Vec::new(), Vec::new(), Vec::new());
        LanePacker { axis, dims, channels, tile_order, pending, pending_lines, strips }
    }

    /// Appends the line at (u, v); lines must come by ascending v, then u.
    ///
    /// `voxels` yields voxels by ascending coordinate along the axis. Lines without voxels take no space.
    ///
    /// # Panics
    /// If lines or voxels are out of order; of voxels, possibly only in a later call.
    #[inline]
    pub fn line(&mut self, u: u16, v: u16, voxels: impl Iterator<Item = (u16, Record)>) {
        if let Some(last) = self.pending_lines.last() {
            assert!((last.v, last.u) < (v, u), "lines come by v, then u");
            if last.v / TILE_EDGE != v / TILE_EDGE {
                self.close_strip();
            }
        }
        let first = self.pending.len();
        self.pending.extend(voxels);
        let voxels = first..self.pending.len();
        if !voxels.is_empty() {
            self.pending_lines.push(PendingLine { u, v, voxels });
        }
    }

    /// Ends the current strip: packs its lines tile by tile.
    fn close_strip(&mut self) {
        self.pending_lines.sort_unstable_by_key(|line| (line.u / TILE_EDGE, line.v, line.u));
        let arrays = ChannelArrays::with_capacity(self.channels, self.pending.len());
        let mut strip = TileRun { arrays, ..TileRun::default() };
        for PendingLine { u, v, voxels } in self.pending_lines.drain(..) {
            let bit = v % TILE_EDGE * TILE_EDGE + u % TILE_EDGE;
            let voxels = self.pending[voxels].iter().copied();
            strip.push_line(self.channels, (u / TILE_EDGE, v / TILE_EDGE), bit.into(), voxels);
        }
        self.pending.clear();
        self.strips.push(strip);
    }

    /// Returns the lane, with its tiles in tile order.
    pub fn finish(mut self) -> OwnedLane {
        self.close_strip();
        let LanePacker { axis, dims, channels, tile_order, strips, .. } = self;
        let tiles = strips.iter().flat_map(|strip| strip.tiles.iter().map(move |tile| (strip, tile)));
        let mut sorted: Vec<(&TileRun, &TileRecord)> = tiles.collect();
        sorted.sort_unstable_by_key(|(_, tile)| tile.key(tile_order));
        let records = strips.iter().map(|strip| strip.arrays.steps.len()).sum();
        let mut arrays = ChannelArrays::with_capacity(channels, records);
        let (mut tiles, mut line_ends) = (Vec::with_capacity(sorted.len()), Vec::new());
        for (strip, tile) in sorted {
            let first_line = u32::try_from(line_ends.len()).expect("a face has fewer than 2^32 lines");
            let first_record = U64::new(arrays.steps.len() as u64);
            tiles.push(TileRecord { first_line: U32::new(first_line), first_record, ..*tile });
            let ends = &strip.line_ends[tile.lines()];
            let start = usize::try_from(tile.first_record.get()).expect("the strip is in memory");
            let count = ends.last().map_or(0, |&end| end as usize);
            arrays.append(channels, &strip.arrays, start..start + count);
            line_ends.extend_from_slice(ends);
        }
        let line_ends = stored_line_ends(&line_ends, dims[axis.index()]);
        let ChannelArrays { steps, values, normals, magnitudes, coverages } = arrays;
        OwnedLane { axis, dims, channels, tiles, line_ends, steps, values, normals, magnitudes, coverages }
    }
}
