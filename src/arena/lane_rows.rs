//! Rows of a lane: what is left of an arena, given as rows again.
//!
//! In: the lane along x and which of its records are kept. Out: [`Rows`]. Memory: eight bytes a tile.

use super::lane::Lane;
use super::layout::{Channels, TILE_EDGE};
use super::pack::Record;
use super::rows::{Region, Rows, Voxel};
use crate::error::Result;
use crate::volume::Axis;

/// Which records of the lane along x stay, by their index.
pub type Kept<'a> = &'a (dyn Fn(usize) -> bool + Sync);

/// The voxels of a lane along x, or some of them.
pub struct LaneRows<'a> {
    lane: Lane<'a>,
    kept: Option<Kept<'a>>,
    /// `tile_v`, `tile_u` and index of every tile, in this order.
    tiles: Vec<(u16, u16, u32)>,
}

impl<'a> LaneRows<'a> {
    /// The rows of `lane`; `kept` says which records stay, `None` for all.
    ///
    /// # Panics
    /// If `lane` does not run along x.
    pub fn new(lane: Lane<'a>, kept: Option<Kept<'a>>) -> LaneRows<'a> {
        assert!(lane.axis == Axis::X, "rows are lines along x");
        let place = |tile: &super::TileRecord| (tile.tile_v.get(), tile.tile_u.get());
        let mut tiles: Vec<(u16, u16, u32)> =
            lane.tiles.iter().map(place).zip(0..).map(|((v, u), index)| (v, u, index)).collect();
        tiles.sort_unstable();
        // A sound lane has each tile once.
        tiles.dedup_by_key(|&mut (v, u, _)| (v, u));
        LaneRows { lane, kept, tiles }
    }
}

impl Rows for LaneRows<'_> {
    fn dims(&self) -> [u32; 3] {
        self.lane.dims
    }

    fn channels(&self) -> Channels {
        self.lane.channels
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let edge = u32::from(TILE_EDGE);
        let lane = &self.lane;
        let [xs, ys, zs] = [region.xs, region.ys, region.zs];
        let xs = xs.start..xs.end.min(lane.dims[0]);
        let (ys, zs) = (ys.start..ys.end.min(lane.dims[1]), zs.start..zs.end.min(lane.dims[2]));
        let first = self.tiles.partition_point(|&(v, ..)| u32::from(v) < zs.start / edge);
        let inside = |v: u16| u32::from(v) * edge < zs.end;
        let mut voxels = Vec::new();
        for &(_, tile_u, tile) in self.tiles[first..].iter().take_while(|&&(v, ..)| inside(v)) {
            let low = u32::from(tile_u) * edge;
            if low >= ys.end || low + edge <= ys.start {
                continue;
            }
            for line in lane.tile_lines(tile as usize) {
                if !(ys.contains(&line.u) && zs.contains(&line.v)) {
                    continue;
                }
                voxels.clear();
                let stays = |record: usize| self.kept.is_none_or(|kept| kept(record));
                let found = lane.line_voxels(line.records).filter(|(x, _)| xs.contains(x));
                voxels.extend(found.filter(|&(_, index)| stays(index)).map(|(x, index)| Voxel {
                    x: u16::try_from(x).unwrap_or(u16::MAX),
                    record: Record {
                        value: lane.value_code(index),
                        normal: lane.normal_code(index),
                        magnitude: lane.magnitude_code(index),
                    },
                }));
                if let ([_, ..], Ok(y), Ok(z)) = (voxels.as_slice(), u16::try_from(line.u), u16::try_from(line.v)) {
                    row(y, z, &voxels);
                }
            }
        }
        Ok(())
    }
}
