//! The tiles of a lane's face (its lines as a 2-D array), grouped by rows along the slow axis, to find a slice's lines.
//!
//! In: a lane's tile records in any order. Out: for each group of eight slices, the tiles that hold their lines, by
//! ascending medium coordinate. A counting sort in O(tiles), once per walk. The occupancy masks also show which slices
//! are empty; the paper stores box-edge voxels for that.

use super::walk::VoxelBox;
use crate::arena::layout::TILE_EDGE;
use crate::arena::{Lane, TileRecord};
use crate::volume::Axis;

/// Tiles of a lane's face, grouped by rows of eight slices.
pub(super) struct TileRows<'a> {
    lane: Lane<'a>,
    /// Indices into the lane's tiles, row by row, each row by ascending medium coordinate.
    sorted: Vec<u32>,
    /// Index in `sorted` at which each row starts; the last element is the end of the last row.
    starts: Vec<u32>,
    /// Whether the slow axis is the second axis of the lane's face.
    pub(super) slow_is_v: bool,
}

impl<'a> TileRows<'a> {
    /// Groups those tiles of `lane` whose bounds `wants` accepts.
    pub(super) fn new(lane: &Lane<'a>, slow: Axis, mut wants: impl FnMut(&VoxelBox) -> bool) -> TileRows<'a> {
        let [u, v] = lane.axis.others();
        let slow_is_v = slow == v;
        let (slow, medium) = if slow_is_v { (v, u) } else { (u, v) };
        let tiles_along = |axis: Axis| lane.dims[axis.index()].div_ceil(u32::from(TILE_EDGE)) as usize;
        let place = |tile: &TileRecord| {
            let (u, v) = (usize::from(tile.tile_u.get()), usize::from(tile.tile_v.get()));
            if slow_is_v { (v, u) } else { (u, v) }
        };
        let (rows, columns) = (tiles_along(slow), tiles_along(medium));
        // A tile outside the face can only come from a damaged file.
        let inside = |tile: &TileRecord| place(tile).0 < rows && place(tile).1 < columns;
        let wanted: Vec<u32> = (0u32..)
            .zip(lane.sweep_tiles())
            .filter(|(_, tile)| inside(tile) && wants(&tile_bounds(lane, tile)))
            .map(|(index, _)| index)
            .collect();
        let by_column = counting_sort(&wanted, columns, |index| place(tile_of(lane, index)).1).0;
        let (sorted, starts) = counting_sort(&by_column, rows, |index| place(tile_of(lane, index)).0);
        TileRows { lane: *lane, sorted, starts, slow_is_v }
    }

    /// Returns the coordinates of the slices that are not empty, ascending.
    pub(super) fn slices(&self) -> Vec<u16> {
        let mut slices = Vec::new();
        for row in 0..self.starts.len() - 1 {
            let union = self.row(row).fold(0, |union, (_, tile)| union | tile.occupancy.get());
            for within in 0..TILE_EDGE {
                let lines =
                    if self.slow_is_v { union >> (8 * within) & 0xff } else { union >> within & 0x0101_0101_0101_0101 };
                if lines != 0 {
                    slices.push(u16::try_from(row).unwrap_or(u16::MAX).saturating_mul(TILE_EDGE) + within);
                }
            }
        }
        slices
    }

    /// Iterates over the tiles of the eight slices from `8 * row` on, each after its index in the lane, by ascending
    /// medium coordinate.
    pub(super) fn row(&self, row: usize) -> impl ExactSizeIterator<Item = (u32, &'a TileRecord)> {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        let lane = self.lane;
        self.sorted[range].iter().map(move |&index| (index, tile_of(&lane, index)))
    }
}

/// Returns the tile at `index`, which must exist.
#[inline(always)]
fn tile_of<'a>(lane: &Lane<'a>, index: u32) -> &'a TileRecord {
    lane.tile(index as usize).expect("an index of a tile that was looked at before")
}

/// Returns a box around the voxels of a tile.
pub(crate) fn tile_bounds(lane: &Lane, tile: &TileRecord) -> VoxelBox {
    let across = |axis: Axis, tile: u16| {
        let last = u16::try_from(lane.dims[axis.index()] - 1).unwrap_or(u16::MAX);
        let first = tile.saturating_mul(TILE_EDGE);
        (axis, [first, first.saturating_add(TILE_EDGE - 1).min(last)])
    };
    let [u, v] = lane.axis.others();
    let along = (lane.axis, [tile.low.get(), tile.high.get()]);
    VoxelBox::from_sides([across(u, tile.tile_u.get()), across(v, tile.tile_v.get()), along])
}

/// Sorts `items` stably by `key`, a number below `keys`; also returns the index at which each key's items start.
fn counting_sort(items: &[u32], keys: usize, key: impl Fn(u32) -> usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0u32; keys + 1];
    for &item in items {
        starts[key(item) + 1] += 1;
    }
    for k in 0..keys {
        starts[k + 1] += starts[k];
    }
    let mut next = starts.clone();
    let mut sorted = vec![0; items.len()];
    for &item in items {
        let slot = &mut next[key(item)];
        sorted[*slot as usize] = item;
        *slot += 1;
    }
    (sorted, starts)
}
