//! Sets of a lane's records, with one bit per record.
//!
//! Several threads may add records at once: since records are only added, the order does not matter.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::lane::Lane;
use crate::error::{Error, Result};

/// A set of records of one lane. A record is identified by its index in the lane's channels.
#[derive(Debug)]
pub struct RecordSet {
    words: Vec<AtomicU64>,
    len: usize,
}

impl RecordSet {
    /// Creates an empty set for a lane of `len` records; the set takes `len / 8` bytes.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn new(len: usize) -> Result<RecordSet> {
        let count = len.div_ceil(64);
        let mut words = Vec::new();
        words.try_reserve_exact(count).map_err(|_| Error::out_of_memory("a set of records", 8 * count as u64))?;
        words.resize_with(count, AtomicU64::default);
        Ok(RecordSet { words, len })
    }

    /// Returns the number of records of the lane, in the set or not.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether the lane has no records.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns how many bytes a set for a lane of `len` records takes.
    pub fn bytes_for(len: usize) -> u64 {
        8 * len.div_ceil(64) as u64
    }

    /// Adds the record with index `record`; ignores an index past the lane's last record.
    #[inline]
    pub fn insert(&self, record: usize) {
        if let Some(word) = self.words.get(record / 64).filter(|_| record < self.len) {
            let bit = 1 << (record % 64);
            // Most records are in the set already, and loading is cheaper than writing.
            if word.load(Relaxed) & bit == 0 {
                word.fetch_or(bit, Relaxed);
            }
        }
    }

    /// Returns whether the set contains the record with index `record`; false past the lane's last record.
    #[inline]
    pub fn contains(&self, record: usize) -> bool {
        self.words.get(record / 64).is_some_and(|word| word.load(Relaxed) >> (record % 64) & 1 == 1)
    }

    /// Returns the number of records in the set.
    pub fn count(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.load(Relaxed).count_ones())).sum()
    }

    /// Adds all records of another set for the same lane.
    pub fn add_all(&self, other: &RecordSet) {
        for (word, more) in self.words.iter().zip(&other.words) {
            word.fetch_or(more.load(Relaxed), Relaxed);
        }
    }
}

/// Largest size of the table that [`carry`] allocates, in bytes.
const TABLE_BYTES: usize = 64 << 20;

/// Converts a set of voxels from record indices of lane `from` to those of lane `to`.
///
/// `set` tells whether a record of `from` is in the set; the records of `to` that hold the same voxels are added to
/// `into`. A *slab* is eight coordinates on the axis along which neither lane runs. In both lanes it consists of whole
/// tiles, so a table with one bit per voxel of a slab converts between them. Time: O(records + lines of the face),
/// several times that only if a slab's table would exceed 64 MiB.
///
/// # Panics
/// If both lanes run along the same axis.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn carry(from: &Lane, set: &dyn Fn(usize) -> bool, to: &Lane, into: &RecordSet) -> Result<()> {
    assert!(from.axis != to.axis, "the lanes run along different axes");
    let wide = from.dims[to.axis.index()] as usize;
    let long = from.dims[from.axis.index()] as usize;
    let part = (TABLE_BYTES / wide.max(1)).clamp(1, long.max(1));
    let mut table: Vec<u8> = Vec::new();
    let bytes = wide * part;
    table.try_reserve_exact(bytes).map_err(|_| Error::out_of_memory("a slab's voxels", bytes as u64))?;
    let (from_slabs, to_slabs) = (slabs(from, to), slabs(to, from));
    for first in (0..long).step_by(part) {
        let mut remaining = to_slabs.as_slice();
        for tiles in from_slabs.chunk_by(|a, b| a.0 == b.0) {
            table.clear();
            table.resize(bytes, 0);
            let slab = tiles[0].0;
            let before = remaining.partition_point(|tile| tile.0 < slab);
            let (own, later) = remaining[before..].split_at(remaining[before..].partition_point(|tile| tile.0 == slab));
            remaining = later;
            // Index and bit in the table of the voxel at `a` along the lane `from` and `b` along `to`.
            let place = |a: u32, b: u32| {
                let (a, b) = ((a as usize).checked_sub(first)?, b as usize);
                (a < part && b < wide).then(|| a * wide + b)
            };
            for &(_, tile) in tiles {
                for line in from.tile_lines(&from.tiles[tile], u64::MAX) {
                    let (across, bit) = (line_at(from, &line, to), line_bit(from, &line, to));
                    for (along, _) in from.line_voxels(line.records).filter(|&(_, record)| set(record)) {
                        if let Some(at) = place(along, across) {
                            table[at] |= bit;
                        }
                    }
                }
            }
            for &(_, tile) in own {
                for line in to.tile_lines(&to.tiles[tile], u64::MAX) {
                    let (across, bit) = (line_at(to, &line, from), line_bit(to, &line, from));
                    for (along, record) in to.line_voxels(line.records) {
                        if place(across, along).is_some_and(|at| table[at] & bit != 0) {
                            into.insert(record);
                        }
                    }
                }
            }
        }
    }
    Ok(())
}

/// Returns the slab and the index of each tile of `lane`, sorted by slab. Slabs divide the axis along which neither
/// lane runs.
fn slabs(lane: &Lane, other: &Lane) -> Vec<(u16, usize)> {
    let along_u = lane.axis.others()[0] != other.axis;
    let slab = |tile: &super::TileRecord| if along_u { tile.tile_u.get() } else { tile.tile_v.get() };
    let mut slabs: Vec<(u16, usize)> = lane.tiles.iter().map(slab).zip(0..).collect();
    slabs.sort_unstable();
    slabs
}

/// Returns the coordinate of a line of `lane` on the axis of `other`.
fn line_at(lane: &Lane, line: &super::lane::LineSpan, other: &Lane) -> u32 {
    if lane.axis.others()[0] == other.axis { line.u } else { line.v }
}

/// Returns the bit that stands for a line's coordinate inside its slab.
fn line_bit(lane: &Lane, line: &super::lane::LineSpan, other: &Lane) -> u8 {
    1 << ((if lane.axis.others()[0] == other.axis { line.v } else { line.u }) % 8)
}
