//! Packing: from the voxels of scan lines to a lane.
//!
//! In: lines by ascending v, then u, with voxels by ascending coordinate. Out: an [`OwnedLane`] with its tiles in tile
//! order.

use std::ops::Range;

use zerocopy::byteorder::little_endian::{U16, U32, U64};

use super::curve::TileOrder;
use super::lane::STEPPING;
use super::layout::{Channels, TILE_EDGE, TileRecord};
use super::owned_lane::{OwnedLane, OwnedLineEnds};
use crate::volume::Axis;

/// The stored codes of one voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Record {
    /// Code of the value.
    pub value: u16,
    /// Code of the normal, u in the low half; ignored if the arena stores no normals.
    pub normal: u32,
    /// Code of the gradient magnitude; ignored if the arena stores no magnitudes.
    pub magnitude: u8,
}

/// The channels of some records, one array each.
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
    /// Appends one record.
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

    /// Appends the records of a line, including stepping voxels; returns its lowest and highest coordinate.
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

    /// Appends some records of `other`.
    fn append(&mut self, channels: Channels, other: &ChannelArrays, Range { start: from, end: to }: Range<usize>) {
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

/// A packed line, and where its records are in order of arrival.
struct PackedLine {
    u: u16,
    v: u16,
    low: u16,
    high: u16,
    records: Range<usize>,
}

/// Packs the lines of one lane.
pub struct LanePacker {
    axis: Axis,
    dims: [u32; 3],
    channels: Channels,
    tile_order: TileOrder,
    /// All records, in order of arrival.
    arrived: ChannelArrays,
    lines: Vec<PackedLine>,
    visible: u64,
}

impl LanePacker {
    /// Starts a lane along `axis` of a grid with `dims` points.
    pub fn new(axis: Axis, dims: [u32; 3], channels: Channels, tile_order: TileOrder) -> LanePacker {
        let (arrived, lines) = (ChannelArrays::default(), Vec::new());
        LanePacker { axis, dims, channels, tile_order, arrived, lines, visible: 0 }
    }

    /// Appends the line at (u, v); lines must come by ascending v, then u.
    ///
    /// `voxels` yields ascending coordinates along the axis. Lines without voxels take no space.
    ///
    /// # Panics
    /// If lines or voxels are out of order.
    #[inline]
    pub fn line(&mut self, u: u16, v: u16, voxels: impl Iterator<Item = (u16, Record)>) {
        if let Some(last) = self.lines.last() {
            assert!((last.v, last.u) < (v, u), "lines come by v, then u");
        }
        let mut voxels = voxels.inspect(|_| self.visible += 1).peekable();
        if voxels.peek().is_some() {
            let first = self.arrived.steps.len();
            let (low, high) = self.arrived.push_line(self.channels, voxels);
            self.lines.push(PackedLine { u, v, low, high, records: first..self.arrived.steps.len() });
        }
    }

    /// Returns the number of voxels so far.
    pub fn visible(&self) -> u64 {
        self.visible
    }

    /// Returns the lane, with its tiles in tile order.
    pub fn finish(mut self) -> OwnedLane {
        let tile = |line: &PackedLine| (line.u / TILE_EDGE, line.v / TILE_EDGE);
        self.lines.sort_by_cached_key(|line| (self.tile_order.key(tile(line).0, tile(line).1), line.v, line.u));
        let mut arrays = ChannelArrays::with_capacity(self.channels, self.arrived.steps.len());
        let mut line_ends = OwnedLineEnds::for_line(self.dims[self.axis.index()]);
        let mut tiles = Vec::new();
        let mut first_line = 0;
        for lines in self.lines.chunk_by(|a, b| tile(a) == tile(b)) {
            let first_record = arrays.steps.len();
            let mut occupancy = 0u64;
            for line in lines {
                arrays.append(self.channels, &self.arrived, line.records.clone());
                occupancy |= 1 << ((line.v % TILE_EDGE) * TILE_EDGE + line.u % TILE_EDGE);
                let end = arrays.steps.len() - first_record;
                line_ends.push(u32::try_from(end).expect("64 lines of 65,535 records stay below 2^32"));
            }
            tiles.push(TileRecord {
                tile_u: U16::new(lines[0].u / TILE_EDGE),
                tile_v: U16::new(lines[0].v / TILE_EDGE),
                first_line: U32::new(first_line),
                first_record: U64::new(first_record as u64),
                occupancy: U64::new(occupancy),
                low: U16::new(lines.iter().map(|line| line.low).min().expect("a chunk is not empty")),
                high: U16::new(lines.iter().map(|line| line.high).max().expect("a chunk is not empty")),
            });
            first_line += occupancy.count_ones();
        }
        let (axis, dims, channels) = (self.axis, self.dims, self.channels);
        let ChannelArrays { steps, values, normals, magnitudes } = arrays;
        OwnedLane { axis, dims, channels, tiles, line_ends, steps, values, normals, magnitudes }
    }
}
