//! Erosion: the voxels of a set all of whose neighbours are in it too.
//!
//! In: a set of records of the lane along x. Out: the set without those that have a grid point that is not in the
//! set, be it empty or outside the grid, within a box of neighbours. Slices stream through a window of tables, a byte a
//! grid point of a slice.

use adjsplat::arena::lane::{Lane, LineSpan};
use adjsplat::arena::layout::TILE_EDGE;
use adjsplat::arena::record_set::RecordSet;
use adjsplat::error::{Error, Result};
use adjsplat::volume::Axis;

/// Slices' tables at work: those of a row of tiles, and as far as neighbours reach before and behind.
const EDGE: usize = TILE_EDGE as usize;

/// Bytes of tables that [`erode`] works with.
pub fn erode_bytes(dims: [u32; 3], reach: usize) -> u64 {
    u64::from(dims[0]) * u64::from(dims[1]) * (EDGE + 2 * reach + 1) as u64
}

/// Records of `set` all of whose neighbours up to `reach` steps away on every axis, diagonals too, are in `set`.
///
/// `lane` runs along x. Time: O(grid points), memory [`erode_bytes`].
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn erode(lane: &Lane, set: &RecordSet, reach: usize) -> Result<RecordSet> {
    assert!(lane.axis == Axis::X, "sets are of the lane along x");
    let [wide, high, deep] = lane.dims.map(|points| points as usize);
    let inner = RecordSet::new(lane.steps.len())?;
    let slice = wide * high;
    let mut tables: Vec<u8> = Vec::new();
    let bytes = slice * (EDGE + 2 * reach);
    tables.try_reserve_exact(bytes).map_err(|_| Error::out_of_memory("slices' neighbourhoods", bytes as u64))?;
    tables.resize(bytes, 0);
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
    // A slice's table has, first, whether a point is in the set; then whether all of its neighbours in the slice are.
    let ring = EDGE + 2 * reach;
    let mut scratch = vec![0u8; slice];
    for row in 0..=(deep + reach).div_ceil(EDGE) {
        for z in row * EDGE..(row + 1) * EDGE {
            tables[z % ring * slice..][..slice].fill(0);
        }
        for line in lines_of(row) {
            if let Some(start) = place(&line, wide, high, deep) {
                let table = &mut tables[line.v as usize % ring * slice + start..][..wide];
                for (x, _) in lane.line_voxels(line.records).filter(|&(_, record)| set.contains(record)) {
                    if let Some(point) = table.get_mut(x as usize) {
                        *point = 1;
                    }
                }
            }
        }
        for z in row * EDGE..((row + 1) * EDGE).min(deep) {
            shrink(&mut tables[z % ring * slice..][..slice], &mut scratch, wide, reach);
        }
        // Slices whose neighbours are all there: `reach` behind the newest.
        let newest = (row + 1) * EDGE;
        let ready = newest.saturating_sub(EDGE + reach)..newest.saturating_sub(reach).min(deep);
        for row in ready.start / EDGE..=ready.end.saturating_sub(1) / EDGE {
            for line in lines_of(row) {
                let z = line.v as usize;
                if !ready.contains(&z) || z < reach || z + reach >= deep {
                    continue;
                }
                let Some(start) = place(&line, wide, high, deep) else { continue };
                let whole = |x: usize| (z - reach..=z + reach).all(|z| tables[z % ring * slice + start + x] != 0);
                for (x, record) in lane.line_voxels(line.records).filter(|&(x, _)| (x as usize) < wide) {
                    if set.contains(record) && whole(x as usize) {
                        inner.insert(record);
                    }
                }
            }
        }
    }
    Ok(inner)
}

/// Where a line starts in a slice's table; `None` outside the grid.
fn place(line: &LineSpan, wide: usize, high: usize, deep: usize) -> Option<usize> {
    ((line.u as usize) < high && (line.v as usize) < deep).then(|| line.u as usize * wide)
}

/// Keeps the points of a slice whose neighbours within `reach` steps are all there.
fn shrink(points: &mut [u8], scratch: &mut [u8], wide: usize, reach: usize) {
    // Along x, then along y.
    for (row, out) in points.chunks_exact(wide).zip(scratch.chunks_exact_mut(wide)) {
        out.fill(0);
        let mut run = 0;
        for x in 0..wide {
            run = if row[x] != 0 { run + 1 } else { 0 };
            if run > 2 * reach {
                out[x - reach] = 1;
            }
        }
    }
    let high = points.len() / wide;
    points.fill(0);
    let mut runs = vec![0usize; wide];
    for y in 0..high {
        for x in 0..wide {
            runs[x] = if scratch[y * wide + x] != 0 { runs[x] + 1 } else { 0 };
            if runs[x] > 2 * reach {
                points[(y - reach) * wide + x] = 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::arena::TileOrder;
    use adjsplat::arena::layout::Channels;
    use adjsplat::arena::pack::{LanePacker, Record};

    #[test]
    fn what_stays_has_all_its_neighbours() {
        let dims = [21u32, 19, 27];
        let channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0 };
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
