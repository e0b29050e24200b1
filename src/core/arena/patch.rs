//! The patch of an overlay: the tiles of a lane that hold edits, packed again.
//!
//! In: a lane and edits. Out: new lines and records for the tiles with edits, and a tile table of the whole lane, which
//! refers to the new lines. Time: O(tiles + records of the tiles with edits). Memory: all records of these tiles.

use std::collections::{BTreeMap, BTreeSet};

use super::curve::TileOrder;
use super::lane::Lane;
use super::layout::{TILE_EDGE, TileRecord};
use super::owned_lane::OwnedLane;
use super::pack::{LanePacker, Record};
use crate::volume::grid::coordinate16;

/// The edits, by position (z, y, x): the voxel's new record, or `None` if it is removed. All differ from the arena.
pub(super) type Edits = BTreeMap<[u16; 3], Option<Record>>;

/// Returns the tile in column `u` and row `v` of a lane whose tiles lie in `order`; `None` if the lane stores none.
pub(super) fn find_tile<'l>(lane: &Lane<'l>, order: TileOrder, u: u16, v: u16) -> Option<&'l TileRecord> {
    let found = lane.tiles.binary_search_by_key(&order.key(u, v), |tile| tile.key(order));
    found.ok().map(|index| &lane.tiles[index])
}

#[derive(Debug)]
pub(super) struct Patch {
    /// All tiles of the lane, changed or not, in tile order.
    pub(super) tiles: Vec<TileRecord>,
    /// Lines and records of the changed tiles.
    pub(super) records: OwnedLane,
}

/// An edit in a lane's coordinates: line (u, v), and `at` along the line.
#[derive(Debug, Clone, Copy)]
struct LaneEdit {
    v: u16,
    u: u16,
    at: u16,
    record: Option<Record>,
}

impl Patch {
    /// Packs the tiles of `lane` that hold edits. `order` is the order of the lane's tiles in memory.
    pub(super) fn new(lane: &Lane, order: TileOrder, edits: &Edits) -> Patch {
        let [u_axis, v_axis] = lane.axis.others();
        let in_lane = |(&[z, y, x], &record): (&[u16; 3], &Option<Record>)| {
            let [v, u, at] = [v_axis, u_axis, lane.axis].map(|axis| [x, y, z][axis.index()]);
            LaneEdit { v, u, at, record }
        };
        let mut sorted: Vec<LaneEdit> = edits.iter().map(in_lane).collect();
        sorted.sort_unstable_by_key(|edit| (edit.v, edit.u, edit.at));

        let mut packer = LanePacker::new(lane.axis, lane.dims, lane.channels, order);
        let mut changed = BTreeSet::new();
        let mut line = Vec::new();
        for strip in sorted.chunk_by(|a, b| a.v / TILE_EDGE == b.v / TILE_EDGE) {
            let tile_v = strip[0].v / TILE_EDGE;
            let tile_us: BTreeSet<u16> = strip.iter().map(|edit| edit.u / TILE_EDGE).collect();
            let tiles: Vec<Option<&TileRecord>> = tile_us.iter().map(|&u| find_tile(lane, order, u, tile_v)).collect();
            changed.extend(tile_us.iter().map(|&u| order.key(u, tile_v)));
            let mut remaining = strip;
            for within_v in 0..TILE_EDGE {
                for (&tile_u, tile) in tile_us.iter().zip(&tiles) {
                    for within_u in 0..TILE_EDGE {
                        let (u, v) = (tile_u * TILE_EDGE + within_u, tile_v * TILE_EDGE + within_v);
                        if u32::from(u) >= lane.dims[u_axis.index()] || u32::from(v) >= lane.dims[v_axis.index()] {
                            continue;
                        }
                        let count = remaining.partition_point(|edit| (edit.v, edit.u) <= (v, u));
                        let here = remaining.split_off(..count).expect("a part of what remains");
                        let bit = 1 << (within_v * TILE_EDGE + within_u);
                        let stored = tile.and_then(|tile| lane.tile_lines(tile, bit).next());
                        line.clear();
                        merge(lane, stored.map(|line| line.records).unwrap_or_default(), here, &mut line);
                        packer.line(u, v, line.iter().copied());
                    }
                }
            }
        }
        let records = packer.finish();
        let mut tiles: Vec<TileRecord> = Vec::with_capacity(lane.tiles.len() + records.tiles.len());
        tiles.extend(lane.tiles.iter().filter(|tile| !changed.contains(&tile.key(order))));
        let lines = u32::try_from(lane.line_ends.len()).expect("checked with the patch's lines");
        tiles.extend(records.tiles.iter().map(|tile| tile.moved(lines, lane.steps.len() as u64)));
        // Unchanged and changed tiles are each sorted: this is a merge.
        tiles.sort_by_key(|tile| tile.key(order));
        Patch { tiles, records }
    }
}

/// Merges the `stored` records of a line with the edits on it, and appends the result to `line`, coordinates ascending.
fn merge(lane: &Lane, stored: std::ops::Range<usize>, edits: &[LaneEdit], line: &mut Vec<(u16, Record)>) {
    let points = lane.dims[lane.axis.index()];
    // A damaged line may be longer than its axis.
    let stored = if stored.len() <= points as usize { stored } else { 0..0 };
    let mut edits = edits.iter().peekable();
    let voxels = lane.line_voxels(stored).take_while(|&(at, _)| at < points);
    for (at, index) in voxels {
        let at = coordinate16(at);
        while let Some(edit) = edits.next_if(|edit| edit.at < at) {
            line.extend(edit.record.map(|record| (edit.at, record)));
        }
        match edits.next_if(|edit| edit.at == at) {
            Some(edit) => line.extend(edit.record.map(|record| (at, record))),
            None => line.push((at, lane.record(index))),
        }
    }
    line.extend(edits.filter_map(|edit| Some((edit.at, edit.record?))));
}
