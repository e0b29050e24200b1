//! Sorts tiles by row and column: two counting sorts, traced access by access.

use super::scratch_sizes::{BY_COLUMN, COLUMN_NEXT, COLUMN_STARTS, ROW_NEXT, ROW_STARTS, SORTED, WANTED};
use super::store::LaneStore;
use super::traced_vec::TracedVec;
use crate::trace::Trace;

/// Returns the tiles sorted by row of the slow axis, and in each row by column, and the index where each row starts.
/// O(tiles).
///
/// `slow_is_v`: whether rows run along the face's second axis. `first_array`: the number by which `trace` knows the first
/// array that is made here.
pub(super) fn sorted_tiles<S: LaneStore, T: Trace>(
    store: &S,
    slow_is_v: bool,
    [rows, columns]: [usize; 2],
    first_array: usize,
    trace: &mut T,
) -> (TracedVec<u32>, TracedVec<u32>) {
    let place = |tile: u32, trace: &mut T| {
        let [u, v] = store.place(tile, trace).map(usize::from);
        if slow_is_v { [v, u] } else { [u, v] }
    };
    let mut wanted = TracedVec::new(first_array + WANTED, store.tile_count() as usize);
    let mut count = 0;
    for tile in 0..store.tile_count() {
        let [row, column] = place(tile, trace);
        // A renderer reads the extent to decide whether it needs the tile; this walk needs all tiles.
        store.extent(tile, trace);
        if row < rows && column < columns {
            wanted.set(count, tile, trace);
            count += 1;
        }
    }
    let mut sort = |tiles: &TracedVec<u32>, keys: usize, which: usize, arrays: [usize; 3]| {
        let [starts, next, sorted] = arrays.map(|array| first_array + array);
        let (mut starts, mut next) = (TracedVec::new(starts, keys + 1), TracedVec::new(next, keys + 1));
        let mut sorted = TracedVec::new(sorted, count);
        for item in 0..count {
            let slot = place(tiles.get(item, trace), trace)[which] + 1;
            let more = starts.get(slot, trace) + 1;
            starts.set(slot, more, trace);
        }
        for slot in 0..keys {
            let sum = starts.get(slot, trace) + starts.get(slot + 1, trace);
            starts.set(slot + 1, sum, trace);
        }
        for slot in 0..=keys {
            let start = starts.get(slot, trace);
            next.set(slot, start, trace);
        }
        for item in 0..count {
            let tile = tiles.get(item, trace);
            let slot = place(tile, trace)[which];
            let at = next.get(slot, trace);
            sorted.set(at as usize, tile, trace);
            next.set(slot, at + 1, trace);
        }
        (sorted, starts)
    };
    let (by_column, _) = sort(&wanted, columns, 1, [COLUMN_STARTS, COLUMN_NEXT, BY_COLUMN]);
    sort(&by_column, rows, 0, [ROW_STARTS, ROW_NEXT, SORTED])
}
