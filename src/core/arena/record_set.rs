//! A set of a lane's records, one bit each.
//!
//! Several threads may add to it at once: records are only ever added, so the order does not matter.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use super::lane::Lane;
use crate::error::{Error, Result};

/// Records of one lane, by their index in its channels.
#[derive(Debug)]
pub struct RecordSet {
    words: Vec<AtomicU64>,
    len: usize,
}

impl RecordSet {
    /// An empty set for a lane of `len` records; `len / 8` bytes.
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

    /// Records that there may be.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether no record can be in it.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Bytes that a set for `len` records takes.
    pub fn bytes_for(len: usize) -> u64 {
        8 * len.div_ceil(64) as u64
    }

    /// Adds a record; one beyond the end is ignored.
    #[inline]
    pub fn insert(&self, record: usize) {
        if let Some(word) = self.words.get(record / 64).filter(|_| record < self.len) {
            let bit = 1 << (record % 64);
            // Most additions are of records that are in already: a look is cheaper than a write.
            if word.load(Relaxed) & bit == 0 {
                word.fetch_or(bit, Relaxed);
            }
        }
    }

    /// Whether a record is in it; one beyond the end never is.
    #[inline]
    pub fn contains(&self, record: usize) -> bool {
        self.words.get(record / 64).is_some_and(|word| word.load(Relaxed) >> (record % 64) & 1 == 1)
    }

    /// Records in it.
    pub fn count(&self) -> u64 {
        self.words.iter().map(|word| u64::from(word.load(Relaxed).count_ones())).sum()
    }

    /// Adds what another set for the same lane has.
    pub fn add_all(&self, other: &RecordSet) {
        for (word, more) in self.words.iter().zip(&other.words) {
            word.fetch_or(more.load(Relaxed), Relaxed);
        }
    }
}

/// Largest table of [`carry`] in bytes.
const TABLE_BYTES: usize = 64 << 20;

/// Adds the voxels of the lane `from` whose records are in `set` to `into`, which is of the lane `to`.
///
/// Eight values of the axis along which neither lane runs are a *slab*. Both lanes store a slab's voxels in tiles of
/// its own, so one table of a slab's voxels, a bit each, leads from one to the other. Time: O(records + face), more
/// than once only where a slab's table would be above 64 MiB.
///
/// # Panics
/// If both lanes run along one axis.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn carry(from: &Lane, set: &dyn Fn(usize) -> bool, to: &Lane, into: &RecordSet) -> Result<()> {
    assert!(from.axis != to.axis, "the lanes run along different axes");
    let wide = from.dims[to.axis.index()] as usize;
    let long = from.dims[from.axis.index()] as usize;
    let piece = (TABLE_BYTES / wide.max(1)).clamp(1, long.max(1));
    let mut table: Vec<u8> = Vec::new();
    let bytes = wide * piece;
    table.try_reserve_exact(bytes).map_err(|_| Error::out_of_memory("a slab's voxels", bytes as u64))?;
    let (from_slabs, to_slabs) = (slabs(from, to), slabs(to, from));
    for first in (0..long).step_by(piece) {
        let mut rest = to_slabs.as_slice();
        for tiles in from_slabs.chunk_by(|a, b| a.0 == b.0) {
            table.clear();
            table.resize(bytes, 0);
            let slab = tiles[0].0;
            let before = rest.partition_point(|tile| tile.0 < slab);
            let (own, later) = rest[before..].split_at(rest[before..].partition_point(|tile| tile.0 == slab));
            rest = later;
            // A table's place and bit of the voxel at `a` along the lane `from` and `b` along `to`.
            let place = |a: u32, b: u32| {
                let (a, b) = ((a as usize).checked_sub(first)?, b as usize);
                (a < piece && b < wide).then(|| a * wide + b)
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

/// Slab and index of every tile of `lane`, by slab: slabs lie across what is neither its axis nor `other`'s.
fn slabs(lane: &Lane, other: &Lane) -> Vec<(u16, usize)> {
    let along_u = lane.axis.others()[0] != other.axis;
    let slab = |tile: &super::TileRecord| if along_u { tile.tile_u.get() } else { tile.tile_v.get() };
    let mut slabs: Vec<(u16, usize)> = lane.tiles.iter().map(slab).zip(0..).collect();
    slabs.sort_unstable();
    slabs
}

/// A line's coordinate on the other lane's axis.
fn line_at(lane: &Lane, line: &super::lane::LineSpan, other: &Lane) -> u32 {
    if lane.axis.others()[0] == other.axis { line.u } else { line.v }
}

/// The bit of a line's coordinate in its slab.
fn line_bit(lane: &Lane, line: &super::lane::LineSpan, other: &Lane) -> u8 {
    1 << ((if lane.axis.others()[0] == other.axis { line.v } else { line.u }) % 8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arena::layout::Channels;
    use crate::arena::pack::{LanePacker, Record};
    use crate::arena::transpose::transpose;
    use crate::arena::{OwnedLane, TileOrder};
    use crate::volume::Axis;

    fn place(lane: &Lane, u: u32, v: u32, along: u32) -> [u32; 3] {
        let mut at = [0; 3];
        let [a, b] = lane.axis.others();
        (at[a.index()], at[b.index()], at[lane.axis.index()]) = (u, v, along);
        at
    }

    #[test]
    fn a_set_reaches_the_same_voxels_in_every_lane() {
        let dims = [300u32, 21, 17];
        let channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0 };
        let there = |x: u32, y: u32, z: u32| (x * 7 + y * 13 + z * 29).is_multiple_of(5) || (x == 299 && y < 3);
        let chosen = |[x, y, z]: [u32; 3]| (x + 3 * y + 5 * z).is_multiple_of(3);
        let mut packer = LanePacker::new(Axis::X, dims, channels, TileOrder::Hilbert);
        for (z, y) in (0..17).flat_map(|z| (0..21).map(move |y| (z, y))) {
            let line = (0..300u16).filter(|&x| there(x.into(), y, z)).map(|x| (x, Record::default()));
            packer.line(u16::try_from(y).unwrap(), u16::try_from(z).unwrap(), line);
        }
        let x = packer.finish();
        let others = [Axis::Y, Axis::Z].map(|axis| transpose(&x.view(), axis, TileOrder::Hilbert));
        let lanes: Vec<OwnedLane> = std::iter::once(x).chain(others).collect();
        for (from, to) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))).filter(|(a, b)| a != b) {
            let (from, to) = (lanes[from].view(), lanes[to].view());
            let set = RecordSet::new(from.steps.len()).unwrap();
            for line in from.lines() {
                for (along, record) in from.line_voxels(line.records.clone()) {
                    if chosen(place(&from, line.u, line.v, along)) {
                        set.insert(record);
                    }
                }
            }
            let into = RecordSet::new(to.steps.len()).unwrap();
            carry(&from, &|record| set.contains(record), &to, &into).unwrap();
            assert_eq!(into.count(), set.count(), "{:?} to {:?}", from.axis, to.axis);
            for line in to.lines() {
                for (along, record) in to.line_voxels(line.records.clone()) {
                    let at = place(&to, line.u, line.v, along);
                    assert_eq!(into.contains(record), chosen(at), "{at:?}, {:?} to {:?}", from.axis, to.axis);
                }
            }
        }
    }
}
