//! Reads the bytes of a lane in some layout as a walk does, and traces each read.

use super::lane::{BASES, LINES, LayoutLane, NORMAL, TILES, VALUE_OR_SLOT};
use super::records::{PayloadBricks, brick_of};
use crate::lane_walk::store::{CHUNK, LaneStore, Mask, TileStart};
use crate::trace::Trace;
use adjsplat::volume::Axis;

impl LayoutLane {
    /// Reads `N` bytes of the record of tile number `tile`, starting at byte `from` of the record.
    #[inline]
    fn tile<const N: usize, T: Trace>(&self, tile: u32, from: usize, trace: &mut T) -> [u8; N] {
        let at = tile as usize * self.layout.tile_bytes()[0] + from;
        trace.read(self.arrays_from() + TILES, at, N);
        *self.tiles[at..].first_chunk().expect("a tile's record is whole")
    }

    #[inline]
    fn line_end<T: Trace>(&self, line: usize, bytes: usize, trace: &mut T) -> Option<u64> {
        let at = line * self.line_bytes;
        let record = self.lines.get(at..at + self.line_bytes)?;
        trace.read(self.arrays_from() + LINES, at, bytes);
        let mut end = [0; 8];
        let width = self.line_bytes.min(4);
        end[..width].copy_from_slice(&record[..width]);
        Some(u64::from_le_bytes(end))
    }

    /// Reads the slot (place in its brick) of the voxel at `position` and its brick's start; returns its index in the
    /// payload.
    #[inline]
    fn brick_place<T: Trace>(&self, bricks: &PayloadBricks, position: [u16; 3], record: usize, trace: &mut T) -> usize {
        let slot = self.records.code(VALUE_OR_SLOT, record, trace);
        let brick = brick_of(position, bricks.across);
        trace.read(BASES, 4 * brick, 4);
        bricks.bases[brick] as usize + usize::from(slot)
    }
}

impl LaneStore for LayoutLane {
    fn axis(&self) -> Axis {
        self.axis
    }

    fn dims(&self) -> [u32; 3] {
        self.dims
    }

    fn edge(&self) -> u16 {
        self.layout.edge
    }

    fn record_count(&self) -> u64 {
        self.records.len() as u64
    }

    fn tile_count(&self) -> u32 {
        u32::try_from(self.tiles.len() / self.layout.tile_bytes()[0]).expect("a face has fewer than 2^32 tiles")
    }

    #[inline]
    fn place<T: Trace>(&self, tile: u32, trace: &mut T) -> [u16; 2] {
        let [a, b, c, d] = self.tile(tile, 0, trace);
        [u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])]
    }

    #[inline]
    fn extent<T: Trace>(&self, tile: u32, trace: &mut T) {
        let [bytes, ..] = self.layout.tile_bytes();
        self.tile::<4, T>(tile, bytes - 4, trace);
    }

    #[inline]
    fn mask<T: Trace>(&self, tile: u32, trace: &mut T) -> Mask {
        let [_, from, _] = self.layout.tile_bytes();
        match self.layout.edge {
            1 => [1, 0, 0, 0],
            4 => [u16::from_le_bytes(self.tile(tile, from, trace)).into(), 0, 0, 0],
            8 => [u64::from_le_bytes(self.tile(tile, from, trace)), 0, 0, 0],
            _ => {
                let bytes: [u8; 32] = self.tile(tile, from, trace);
                let words = bytes.as_chunks().0;
                std::array::from_fn(|word| u64::from_le_bytes(words[word]))
            }
        }
    }

    #[inline]
    fn start<T: Trace>(&self, tile: u32, trace: &mut T) -> TileStart {
        let [bytes, ..] = self.layout.tile_bytes();
        let at = tile as usize * bytes;
        trace.read(self.arrays_from() + TILES, at, bytes);
        let record = &self.tiles[at..at + bytes];
        let number_16 = |from: usize| u16::from_le_bytes([record[from], record[from + 1]]);
        let number = |from: usize, bytes: usize| {
            record[from..from + bytes].iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
        };
        let (first_line, first_record) =
            if self.layout.edge == 1 { (tile.into(), number(4, 8)) } else { (number(4, 4), number(8, 8)) };
        TileStart { place: [number_16(0), number_16(2)], first_line, first_record }
    }

    #[inline]
    fn line<T: Trace>(&self, tile: u32, start: &TileStart, rank: u32, trace: &mut T) -> Option<[u64; 2]> {
        if self.layout.edge == 1 {
            let end = if tile + 1 < self.tile_count() {
                u64::from_le_bytes(self.tile(tile + 1, 4, trace))
            } else {
                self.record_count()
            };
            return Some([0, end - start.first_record]);
        }
        let line = usize::try_from(start.first_line + u64::from(rank)).ok()?;
        let end = self.line_end(line, self.line_bytes, trace)?;
        let first = if rank == 0 { 0 } else { self.line_end(line - 1, self.line_bytes.min(4), trace)? };
        Some([first, end])
    }

    #[inline]
    fn steps<T: Trace>(&self, from: usize, trace: &mut T) -> [u8; CHUNK] {
        self.records.chunk(from, trace)
    }

    #[inline]
    fn value<T: Trace>(&self, position: [u16; 3], record: usize, trace: &mut T) -> u8 {
        let code = match &self.bricks {
            Some(bricks) => bricks.payload.code(0, self.brick_place(bricks, position, record, trace), trace),
            None => self.records.code(VALUE_OR_SLOT, record, trace),
        };
        u8::try_from(code).expect("a code of one byte")
    }

    #[inline]
    fn normal<T: Trace>(&self, position: [u16; 3], record: usize, trace: &mut T) -> u16 {
        match &self.bricks {
            Some(bricks) => bricks.payload.code(1, self.brick_place(bricks, position, record, trace), trace),
            None => self.records.code(NORMAL, record, trace),
        }
    }
}
