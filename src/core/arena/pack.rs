//! Packing: from the voxels of scan lines to a lane.
//!
//! In: lines by ascending v, then u, with voxels by ascending coordinate. Out: an [`OwnedLane`] with its tiles in tile
//! order. Lines are collected for eight values of v at a time (a strip); then their tiles are complete.

use zerocopy::byteorder::little_endian::{U16, U32, U64};

use super::curve::TileOrder;
use super::lane::STEPPING;
use super::layout::{Channels, TILE_EDGE, TileRecord};
use super::owned_lane::{OwnedLane, OwnedLineEnds};
use crate::volume::Axis;

/// The stored codes of one voxel (a code is the number that stands for a value).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Record {
    /// Code of the value.
    pub value: u16,
    /// Code of the normal, octahedral u in the low half; ignored if the arena stores no normals.
    pub normal: u32,
    /// Code of the gradient magnitude; ignored if the arena stores no magnitudes.
    pub magnitude: u8,
}

/// Records of consecutive lines, as one array per channel.
#[derive(Debug, Default)]
pub(crate) struct ChannelArrays {
    pub(crate) steps: Vec<u8>,
    pub(crate) values: Vec<u8>,
    pub(crate) normals: Vec<u8>,
    pub(crate) magnitudes: Vec<u8>,
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
    }

    /// Appends the records of a line, including stepping voxels; returns the line's lowest and highest coordinate.
    ///
    /// # Panics
    /// If the voxels are not in ascending order, or there are none.
    #[inline]
    pub(crate) fn push_line(&mut self, channels: Channels, voxels: impl Iterator<Item = (u16, Record)>) -> (u16, u16) {
        let mut next = 0u32; // one past the last coordinate, because the first step counts from -1
        let mut low = None;
        let mut high = 0;
        for (coordinate, record) in voxels {
            assert!(u32::from(coordinate) >= next, "voxels come by ascending coordinate");
            let mut gap = u32::from(coordinate) + 1 - next;
            while gap > STEPPING {
                self.push(channels, 0, Record::default());
                gap -= STEPPING;
            }
            self.push(channels, u8::try_from(gap).expect("at most 255 is left"), record);
            next = u32::from(coordinate) + 1;
            low = low.or(Some(coordinate));
            high = coordinate;
        }
        (low.expect("a line that is packed has a voxel"), high)
    }

    /// Appends the records `from..to` of `other`.
    fn append(&mut self, channels: Channels, other: &ChannelArrays, from: usize, to: usize) {
        let value = usize::from(channels.value_bits / 8);
        let normal = usize::from(channels.normal_bits / 4);
        let magnitude = usize::from(channels.magnitude_bits / 8);
        self.steps.extend_from_slice(&other.steps[from..to]);
        self.values.extend_from_slice(&other.values[value * from..value * to]);
        self.normals.extend_from_slice(&other.normals[normal * from..normal * to]);
        self.magnitudes.extend_from_slice(&other.magnitudes[magnitude * from..magnitude * to]);
    }

    pub(crate) fn with_capacity(channels: Channels, records: usize) -> ChannelArrays {
        ChannelArrays {
            steps: Vec::with_capacity(records),
            values: Vec::with_capacity(records * usize::from(channels.value_bits / 8)),
            normals: Vec::with_capacity(records * usize::from(channels.normal_bits / 4)),
            magnitudes: Vec::with_capacity(records * usize::from(channels.magnitude_bits / 8)),
        }
    }
}

/// A packed tile, with the positions of its line ends and of its records in the [`LanePacker`].
struct PackedTile {
    u: u16,
    v: u16,
    occupancy: u64,
    low: u16,
    high: u16,
    strip: usize,
    first_record: usize,
    record_count: usize,
    first_line: usize,
}

/// One line of the current strip, with its range of records.
struct PendingLine {
    u: u16,
    v: u16,
    from: usize,
    to: usize,
    low: u16,
    high: u16,
}

/// Packs lines of voxels into one lane.
pub struct LanePacker {
    axis: Axis,
    dims: [u32; 3],
    channels: Channels,
    tile_order: TileOrder,
    /// Records of the current strip (eight values of v), in order of arrival.
    pending: ChannelArrays,
    pending_lines: Vec<PendingLine>,
    /// Records of the finished strips; within a strip, tile by tile.
    strips: Vec<ChannelArrays>,
    tiles: Vec<PackedTile>,
    /// Line ends of all tiles, in the order of `tiles`.
    ends: Vec<u32>,
    visible: u64,
}

impl LanePacker {
    /// Creates a packer for the lane along `axis` of a grid with `dims` points.
    pub fn new(axis: Axis, dims: [u32; 3], channels: Channels, tile_order: TileOrder) -> LanePacker {
        LanePacker {
            axis,
            dims,
            channels,
            tile_order,
            pending: ChannelArrays::default(),
            pending_lines: Vec::new(),
            strips: Vec::new(),
            tiles: Vec::new(),
            ends: Vec::new(),
            visible: 0,
        }
    }

    /// Appends the line at (u, v); lines must come by ascending v, then u.
    ///
    /// `voxels` yields voxels by ascending coordinate along the axis. Lines without voxels take no space.
    ///
    /// # Panics
    /// If lines or voxels are out of order.
    #[inline]
    pub fn line(&mut self, u: u16, v: u16, voxels: impl Iterator<Item = (u16, Record)>) {
        if let Some(last) = self.pending_lines.last() {
            assert!((last.v, last.u) < (v, u), "lines come by v, then u");
            if last.v / TILE_EDGE != v / TILE_EDGE {
                self.close_strip();
            }
        }
        let mut voxels = voxels.inspect(|_| self.visible += 1).peekable();
        if voxels.peek().is_some() {
            let from = self.pending.steps.len();
            let (low, high) = self.pending.push_line(self.channels, voxels);
            self.pending_lines.push(PendingLine { u, v, from, to: self.pending.steps.len(), low, high });
        }
    }

    /// Returns the number of voxels that were appended so far.
    pub fn visible(&self) -> u64 {
        self.visible
    }

    /// Ends the current strip: groups its lines and records by tile.
    fn close_strip(&mut self) {
        let mut lines = std::mem::take(&mut self.pending_lines);
        let place = |line: &PendingLine| (line.u / TILE_EDGE, line.v, line.u);
        lines.sort_unstable_by_key(place);
        let mut strip = ChannelArrays::with_capacity(self.channels, self.pending.steps.len());
        for tile_lines in lines.chunk_by(|a, b| a.u / TILE_EDGE == b.u / TILE_EDGE) {
            let first_record = strip.steps.len();
            let first_line = self.ends.len();
            let mut occupancy = 0u64;
            for line in tile_lines {
                strip.append(self.channels, &self.pending, line.from, line.to);
                occupancy |= 1 << ((line.v % TILE_EDGE) * TILE_EDGE + line.u % TILE_EDGE);
                let end = strip.steps.len() - first_record;
                self.ends.push(u32::try_from(end).expect("64 lines of 65,535 records stay below 2^32"));
            }
            self.tiles.push(PackedTile {
                u: tile_lines[0].u / TILE_EDGE,
                v: tile_lines[0].v / TILE_EDGE,
                occupancy,
                low: tile_lines.iter().map(|l| l.low).min().expect("a chunk is not empty"),
                high: tile_lines.iter().map(|l| l.high).max().expect("a chunk is not empty"),
                strip: self.strips.len(),
                first_record,
                record_count: strip.steps.len() - first_record,
                first_line,
            });
        }
        self.strips.push(strip);
        self.pending = ChannelArrays::default();
        lines.clear();
        self.pending_lines = lines;
    }

    /// Returns the lane, with its tiles in tile order.
    pub fn finish(mut self) -> OwnedLane {
        self.close_strip();
        let (tiles, channels) = (&mut self.tiles, self.channels);
        tiles.sort_unstable_by_key(|tile| self.tile_order.key(tile.u, tile.v));
        let records = self.strips.iter().map(|strip| strip.steps.len()).sum();
        let mut arrays = ChannelArrays::with_capacity(channels, records);
        let mut line_ends = OwnedLineEnds::for_line(self.dims[self.axis.index()]);
        let mut table = Vec::with_capacity(tiles.len());
        let mut line_count = 0u32;
        for tile in tiles.iter() {
            table.push(TileRecord {
                tile_u: U16::new(tile.u),
                tile_v: U16::new(tile.v),
                first_line: U32::new(line_count),
                first_record: U64::new(arrays.steps.len() as u64),
                occupancy: U64::new(tile.occupancy),
                low: U16::new(tile.low),
                high: U16::new(tile.high),
            });
            let (from, to) = (tile.first_record, tile.first_record + tile.record_count);
            arrays.append(channels, &self.strips[tile.strip], from, to);
            let lines = tile.occupancy.count_ones();
            self.ends[tile.first_line..][..lines as usize].iter().for_each(|&end| line_ends.push(end));
            line_count += lines;
        }
        OwnedLane {
            axis: self.axis,
            dims: self.dims,
            channels,
            tiles: table,
            line_ends,
            steps: arrays.steps,
            values: arrays.values,
            normals: arrays.normals,
            magnitudes: arrays.magnitudes,
        }
    }
}
