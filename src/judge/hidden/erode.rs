//! Erodes a set of voxels: keeps only the voxels whose neighbours are all in the set.
//!
//! In: a set of records (stored voxels) of the lane along x. Out: its records that have no grid point outside the set
//! within a box around them. Points outside the grid are outside the set. A ring of tables holds a few slices, one byte
//! per grid point.

use super::box_minimum::box_minimum;
use crate::allocate::filled;
use adjsplat::arena::layout::TILE_EDGE;
use adjsplat::arena::{Lane, LineSpan};
use adjsplat::error::Result;
use adjsplat::internals::RecordSet;
use adjsplat::volume::Axis;

/// The number of slices that a row of tiles covers.
const EDGE: usize = TILE_EDGE as usize;

/// Returns the bytes that [`erode`] needs for its tables.
pub(super) fn erode_bytes(dims: [u32; 3], reach: usize) -> u64 {
    u64::from(dims[0]) * u64::from(dims[1]) * (EDGE + 2 * reach + 1) as u64
}

/// Returns the records of `set` whose neighbours up to `reach` steps away, diagonals included, are all in `set`.
///
/// `lane` runs along x. Takes O(grid points) time and [`erode_bytes`] of memory.
///
/// # Errors
/// [`Error::OutOfMemory`](adjsplat::Error::OutOfMemory) if the memory cannot be had.
pub(super) fn erode(lane: &Lane, set: &RecordSet, reach: usize) -> Result<RecordSet> {
    assert!(lane.axis == Axis::X, "sets are of the lane along x");
    let [width, height, depth] = lane.dims.map(|points| points as usize);
    let inner = RecordSet::new(lane.steps.len())?;
    let (slice, ring) = (width * height, EDGE + 2 * reach);
    let mut tables = filled("slices' neighbourhoods", (slice * ring) as u64, 0u8)?;
    let mut tiles: Vec<(usize, usize)> =
        lane.tiles.iter().map(|tile| usize::from(tile.tile_v.get())).zip(0..).collect();
    tiles.sort_unstable();
    let lines_of = |row: usize| {
        let first = tiles.partition_point(|tile| tile.0 < row);
        tiles[first..]
            .iter()
            .take_while(move |tile| tile.0 == row)
            .flat_map(|tile| lane.tile_lines(&lane.tiles[tile.1], u64::MAX))
    };
    // A table first says for each point whether it is in the set, then whether its neighbours within the slice are too.
    let mut scratch = vec![0u8; slice];
    for row in 0..=(depth + reach).div_ceil(EDGE) {
        for z in row * EDGE..(row + 1) * EDGE {
            tables[z % ring * slice..][..slice].fill(0);
        }
        for line in lines_of(row) {
            if let Some(start) = line_start(&line, width, height, depth) {
                let table = &mut tables[line.v as usize % ring * slice + start..][..width];
                for (x, _) in lane.line_voxels(line.records).filter(|&(_, record)| set.contains(record)) {
                    if let Some(point) = table.get_mut(x as usize) {
                        *point = 1;
                    }
                }
            }
        }
        for z in row * EDGE..((row + 1) * EDGE).min(depth) {
            box_minimum(&mut tables[z % ring * slice..][..slice], &mut scratch, width, reach);
        }
        // Slices whose neighbours have all been read are at least `reach` slices behind the newest.
        let newest = (row + 1) * EDGE;
        let ready = newest.saturating_sub(EDGE + reach)..newest.saturating_sub(reach).min(depth);
        for row in ready.start / EDGE..=ready.end.saturating_sub(1) / EDGE {
            for line in lines_of(row) {
                let z = line.v as usize;
                if !ready.contains(&z) || z < reach || z + reach >= depth {
                    continue;
                }
                let Some(start) = line_start(&line, width, height, depth) else { continue };
                let whole = |x: usize| (z - reach..=z + reach).all(|z| tables[z % ring * slice + start + x] != 0);
                for (x, record) in lane.line_voxels(line.records).filter(|&(x, _)| (x as usize) < width) {
                    if set.contains(record) && whole(x as usize) {
                        inner.insert(record);
                    }
                }
            }
        }
    }
    Ok(inner)
}

/// Returns the index at which a line of voxels starts in a slice's table; `None` if the line is outside the grid.
fn line_start(line: &LineSpan, width: usize, height: usize, depth: usize) -> Option<usize> {
    ((line.u as usize) < height && (line.v as usize) < depth).then(|| line.u as usize * width)
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::arena::{Channels, Record, TileOrder};
    use adjsplat::internals::LanePacker;

    #[test]
    fn what_stays_has_all_its_neighbours() {
        let dims = [21u32, 19, 27];
        let channels =
            Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };
        let there = |[x, y, z]: [i32; 3]| (x * 7 + y * 13 + z * 29) % 97 != 0;
        let chosen = |[x, y, z]: [i32; 3]| (x * 5 + y * 3 + z * 11) % 89 != 0;
        let mut packer = LanePacker::new(Axis::X, dims, channels, TileOrder::Morton);
        for (z, y) in (0..27u16).flat_map(|z| (0..19u16).map(move |y| (z, y))) {
            let line = (0..21u16).filter(|&x| there([x.into(), y.into(), z.into()])).map(|x| (x, Record::default()));
            packer.line(y, z, line);
        }
        let lane = packer.finish();
        let lane = lane.view();
        let set = RecordSet::new(lane.steps.len()).unwrap();
        let each = |visit: &mut dyn FnMut([i32; 3], usize)| {
            for line in lane.lines() {
                for (x, record) in lane.line_voxels(line.records.clone()) {
                    visit([x, line.u, line.v].map(u32::cast_signed), record);
                }
            }
        };
        each(&mut |at, record| {
            if chosen(at) {
                set.insert(record);
            }
        });
        let inside = |at: [i32; 3]| (0..3).all(|a| (0..dims[a].cast_signed()).contains(&at[a]));
        for reach in 0..3i32 {
            let inner = erode(&lane, &set, usize::try_from(reach).unwrap()).unwrap();
            let near = || (-reach..=reach).flat_map(move |z| (-reach..=reach).map(move |y| (y, z)));
            let mut count = 0;
            each(&mut |[x, y, z], record| {
                let whole = near()
                    .flat_map(|(dy, dz)| (-reach..=reach).map(move |dx| [x + dx, y + dy, z + dz]))
                    .all(|at| inside(at) && there(at) && chosen(at));
                assert_eq!(inner.contains(record), whole, "{x} {y} {z}, reach {reach}");
                count += u64::from(whole);
            });
            assert_eq!(inner.count(), count);
            assert!(count > 50, "reach {reach}: {count}");
        }
    }
}
