//! Our lanes with their tiles stored in another order.

use crate::subject::{Subject, VisibleVoxel};
use adjsplat::arena::{OwnedLane, Record, TileOrder};
use adjsplat::internals::LanePacker;
use adjsplat::volume::Axis;

/// Packs a subject's voxels into lanes along x, y and z, with tiles in `tile_order`. O(n log n).
pub fn repacked(subject: &Subject, tile_order: TileOrder) -> [OwnedLane; 3] {
    Axis::ALL.map(|axis| {
        let [u, v] = axis.others();
        let at = |voxel: &VisibleVoxel, axis: Axis| voxel.position[axis.index()];
        let mut voxels: Vec<&VisibleVoxel> = subject.voxels.iter().collect();
        voxels.sort_by_key(|voxel| (at(voxel, v), at(voxel, u), at(voxel, axis)));
        let mut packer = LanePacker::new(axis, subject.dims(), subject.facts.channels, tile_order);
        for line in voxels.chunk_by(|a, b| at(a, u) == at(b, u) && at(a, v) == at(b, v)) {
            let record = |voxel: &VisibleVoxel| Record {
                value: voxel.value.into(),
                normal: voxel.normal.into(),
                magnitude: 0,
                coverage: 0,
            };
            packer.line(at(line[0], u), at(line[0], v), line.iter().map(|voxel| (at(voxel, axis), record(voxel))));
        }
        packer.finish()
    })
}
