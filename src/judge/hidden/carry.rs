//! Carries a set of records from one lane to another: the same voxels have other record indices there.

use crate::allocate::filled;
use adjsplat::arena::{Lane, LineSpan, TileRecord};
use adjsplat::error::Result;
use adjsplat::internals::RecordSet;

/// Largest size of the table that [`carry`] allocates, in bytes.
const TABLE_BYTES: usize = 64 << 20;

/// Converts a set of voxels from record indices of lane `from` to those of lane `to`.
///
/// `set` tells whether a record of `from` is in the set; the records of `to` that hold the same voxels are added to
/// `into`. Both may be the same lane. A *slab* is eight coordinates on the axis along which neither lane runs. In both lanes it consists of whole
/// tiles, so a table with one bit per voxel of a slab converts between them. Time: O(records + lines of the face),
/// several times that only if a slab's table would exceed 64 MiB.
///
/// # Errors
/// [`Error::OutOfMemory`](adjsplat::Error::OutOfMemory).
pub(super) fn carry(from: &Lane, set: &dyn Fn(usize) -> bool, to: &Lane, into: &RecordSet) -> Result<()> {
    if from.axis == to.axis {
        (0..from.steps.len()).filter(|&record| set(record)).for_each(|record| into.insert(record));
        return Ok(());
    }
    let wide = from.dims[to.axis.index()] as usize;
    let long = from.dims[from.axis.index()] as usize;
    let part = (TABLE_BYTES / wide.max(1)).clamp(1, long.max(1));
    let mut table = filled("a slab's voxels", (wide * part) as u64, 0u8)?;
    let (from_slabs, to_slabs) = (slabs(from, to), slabs(to, from));
    for first in (0..long).step_by(part) {
        let mut remaining = to_slabs.as_slice();
        for tiles in from_slabs.chunk_by(|a, b| a.0 == b.0) {
            table.fill(0);
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
    let slab = |tile: &TileRecord| if along_u { tile.tile_u.get() } else { tile.tile_v.get() };
    let mut slabs: Vec<(u16, usize)> = lane.tiles.iter().map(slab).zip(0..).collect();
    slabs.sort_unstable();
    slabs
}

/// Returns the coordinate of a line of `lane` on the axis of `other`.
fn line_at(lane: &Lane, line: &LineSpan, other: &Lane) -> u32 {
    if lane.axis.others()[0] == other.axis { line.u } else { line.v }
}

/// Returns the bit that stands for a line's coordinate inside its slab.
fn line_bit(lane: &Lane, line: &LineSpan, other: &Lane) -> u8 {
    1 << ((if lane.axis.others()[0] == other.axis { line.v } else { line.u }) % 8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::arena::{Channels, OwnedLane, Record, TileOrder};
    use adjsplat::internals::{LanePacker, transpose};
    use adjsplat::volume::Axis;

    fn place(lane: &Lane, u: u32, v: u32, along: u32) -> [u32; 3] {
        let mut at = [0; 3];
        let [a, b] = lane.axis.others();
        (at[a.index()], at[b.index()], at[lane.axis.index()]) = (u, v, along);
        at
    }

    #[test]
    fn a_set_reaches_the_same_voxels_in_every_lane() {
        let dims = [300u32, 21, 17];
        let channels =
            Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };
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
