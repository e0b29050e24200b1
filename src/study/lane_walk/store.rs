//! Where the bytes of a lane lie: answers what a walk asks of a lane, and traces the bytes that each answer reads.

use crate::trace::{Trace, WalkerArray, along_axes};
use adjsplat::arena::layout::{TILE_EDGE, line_end_bytes};
use adjsplat::arena::{Lane, TileRecord};
use adjsplat::volume::Axis;

/// Number of steps (distances from a voxel to the next on its line) that are read at once.
pub(crate) const CHUNK: usize = 16;

/// The non-empty lines of a tile: bit `edge * v + u` for the line at (u, v) in the tile. A tile has up to 16 x 16
/// lines.
pub(crate) type Mask = [u64; 4];

/// Returns whether bit number `bit` of `mask` is set.
#[inline(always)]
pub(crate) fn has_bit(mask: &Mask, bit: u32) -> bool {
    mask[bit as usize / 64] >> (bit % 64) & 1 == 1
}

/// Returns how many set bits of `mask` come before bit number `bit`.
#[inline(always)]
pub(crate) fn rank(mask: &Mask, bit: u32) -> u32 {
    let word = bit as usize / 64;
    let before: u32 = mask[..word].iter().map(|bits| bits.count_ones()).sum();
    before + (mask[word] & ((1 << (bit % 64)) - 1)).count_ones()
}

/// Where a tile's lines and records start.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TileStart {
    /// The tile's position on the face (the lane's lines as a 2-D array), in tiles.
    pub(crate) place: [u16; 2],
    /// Index of the tile's first line among the lane's lines.
    pub(crate) first_line: u64,
    /// Index of the tile's first record among the lane's records.
    pub(crate) first_record: u64,
}

/// A lane (all scan lines along one axis) in some memory layout.
pub(crate) trait LaneStore {
    /// Returns the axis along which the lane's lines run.
    fn axis(&self) -> Axis;
    /// Returns the grid points along x, y and z.
    fn dims(&self) -> [u32; 3];
    /// Returns the number of lines along a side of a tile: 1, 4, 8 or 16.
    fn edge(&self) -> u16;
    /// Returns the number of the lane's records, with stepping records, which bridge long gaps and hold no voxel.
    fn record_count(&self) -> u64;
    /// Returns the number of the lane's non-empty tiles.
    fn tile_count(&self) -> u32;
    /// Returns the position of a tile on the face (the lane's lines as a 2-D array), in tiles.
    fn place<T: Trace>(&self, tile: u32, trace: &mut T) -> [u16; 2];
    /// Reads the lowest and the highest coordinate of a tile's voxels, by which a renderer culls.
    fn extent<T: Trace>(&self, tile: u32, trace: &mut T);
    /// Returns which lines of a tile are not empty.
    fn mask<T: Trace>(&self, tile: u32, trace: &mut T) -> Mask;
    /// Reads the whole record of a tile, and returns where its lines and records start.
    fn start<T: Trace>(&self, tile: u32, trace: &mut T) -> TileStart;
    /// Returns where the tile's non-empty line number `rank` starts and ends, in records from the tile's first record.
    /// Returns `None` if the line is missing.
    fn line<T: Trace>(&self, tile: u32, start: &TileStart, rank: u32, trace: &mut T) -> Option<[u64; 2]>;
    /// Returns sixteen steps from record `from` on, padded with ones at the end of the lane.
    fn steps<T: Trace>(&self, from: usize, trace: &mut T) -> [u8; CHUNK];
    /// Returns the value code (stored number) of the voxel at `position`, whose record is number `record`.
    fn value<T: Trace>(&self, position: [u16; 3], record: usize, trace: &mut T) -> u8;
    /// Returns the normal code of the voxel at `position`, whose record is number `record`; 0 if there are no normals.
    fn normal<T: Trace>(&self, position: [u16; 3], record: usize, trace: &mut T) -> u16;
}

/// Our own lane, as it is stored.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OwnStore<'a>(pub(crate) Lane<'a>);

/// Numbers of a lane's arrays, relative to its first one; the last constant is their count.
const TILES: usize = 0;
const LINE_ENDS: usize = 1;
const STEPS: usize = 2;
const VALUES: usize = 3;
const NORMALS: usize = 4;
pub(super) const OF_A_LANE: usize = 5;
const NAMES: [[&str; OF_A_LANE]; 3] = along_axes!("tiles", "line ends", "steps", "values", "normals");

/// Offset and number of bytes of each field of a tile record.
const PLACE: (usize, usize) = (0, 4);
const OCCUPANCY: (usize, usize) = (16, 8);
const EXTENT: (usize, usize) = (24, 4);
const WHOLE: (usize, usize) = (0, size_of::<TileRecord>());

impl OwnStore<'_> {
    /// Returns the lane's arrays, in the order of their numbers.
    pub(crate) fn arrays(&self) -> [WalkerArray; OF_A_LANE] {
        let lane = &self.0;
        let sizes = [
            size_of_val(lane.tiles),
            lane.line_ends.as_bytes().len(),
            lane.steps.len(),
            lane.values.len(),
            lane.normals.len(),
        ];
        let names = NAMES[lane.axis.index()];
        std::array::from_fn(|i| WalkerArray { name: names[i], bytes: sizes[i] as u64, scratch: false })
    }

    /// Returns the number by which a trace names an array of the lane.
    fn array(&self, number: usize) -> usize {
        OF_A_LANE * self.0.axis.index() + number
    }

    fn end_bytes(&self) -> usize {
        line_end_bytes(self.0.dims[self.0.axis.index()]).into()
    }

    /// Returns tile number `index`, and traces a read of `bytes` at `offset` in its record.
    #[inline]
    fn tile<T: Trace>(&self, index: u32, (offset, bytes): (usize, usize), trace: &mut T) -> &TileRecord {
        trace.read(self.array(TILES), index as usize * size_of::<TileRecord>() + offset, bytes);
        &self.0.tiles[index as usize]
    }

    #[inline]
    fn line_end<T: Trace>(&self, line: usize, trace: &mut T) -> Option<u64> {
        let end = self.0.line_end(line)?;
        let bytes = self.end_bytes();
        trace.read(self.array(LINE_ENDS), line * bytes, bytes);
        Some(end.into())
    }
}

impl LaneStore for OwnStore<'_> {
    fn axis(&self) -> Axis {
        self.0.axis
    }

    fn dims(&self) -> [u32; 3] {
        self.0.dims
    }

    fn edge(&self) -> u16 {
        TILE_EDGE
    }

    fn record_count(&self) -> u64 {
        self.0.record_count()
    }

    fn tile_count(&self) -> u32 {
        u32::try_from(self.0.tiles.len()).expect("a face has fewer than 2^32 tiles")
    }

    #[inline]
    fn place<T: Trace>(&self, tile: u32, trace: &mut T) -> [u16; 2] {
        let tile = self.tile(tile, PLACE, trace);
        [tile.tile_u.get(), tile.tile_v.get()]
    }

    #[inline]
    fn extent<T: Trace>(&self, tile: u32, trace: &mut T) {
        self.tile(tile, EXTENT, trace);
    }

    #[inline]
    fn mask<T: Trace>(&self, tile: u32, trace: &mut T) -> Mask {
        [self.tile(tile, OCCUPANCY, trace).occupancy.get(), 0, 0, 0]
    }

    #[inline]
    fn start<T: Trace>(&self, tile: u32, trace: &mut T) -> TileStart {
        let tile = self.tile(tile, WHOLE, trace);
        TileStart {
            place: [tile.tile_u.get(), tile.tile_v.get()],
            first_line: tile.first_line.get().into(),
            first_record: tile.first_record.get(),
        }
    }

    #[inline]
    fn line<T: Trace>(&self, _: u32, start: &TileStart, rank: u32, trace: &mut T) -> Option<[u64; 2]> {
        let line = usize::try_from(start.first_line + u64::from(rank)).ok()?;
        let end = self.line_end(line, trace)?;
        let first = if rank == 0 { 0 } else { self.line_end(line - 1, trace)? };
        Some([first, end])
    }

    #[inline]
    fn steps<T: Trace>(&self, from: usize, trace: &mut T) -> [u8; CHUNK] {
        let steps = &self.0.steps[from..];
        let count = steps.len().min(CHUNK);
        trace.read(self.array(STEPS), from, count);
        let mut chunk = [1; CHUNK];
        chunk[..count].copy_from_slice(&steps[..count]);
        chunk
    }

    #[inline]
    fn value<T: Trace>(&self, _: [u16; 3], record: usize, trace: &mut T) -> u8 {
        trace.read(self.array(VALUES), record, 1);
        self.0.values[record]
    }

    #[inline]
    fn normal<T: Trace>(&self, _: [u16; 3], record: usize, trace: &mut T) -> u16 {
        if self.0.normals.is_empty() {
            return 0;
        }
        trace.read(self.array(NORMALS), 2 * record, 2);
        u16::from_le_bytes([self.0.normals[2 * record], self.0.normals[2 * record + 1]])
    }
}
