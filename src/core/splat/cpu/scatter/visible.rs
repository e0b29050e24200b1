//! Marking the voxels that a view shows.
//!
//! In: a block of projected splats and the pixels drawn so far. Out: marks on the records of splats that meet, at any
//! pixel of their footprint, a transmittance of at least the termination bound. If all unmarked voxels are removed,
//! the view changes by less than that threshold. Splats of one block do not hide each other: the error is to mark too
//! many voxels.

use crate::arena::RecordSet;
use crate::splat::cpu::project::Projector;
use crate::splat::cpu::splats::Splats;
use crate::splat::cpu::tile_buffer::TileBuffer;
use crate::splat::cpu::voxel_block::{BLOCK, VoxelBlock};

/// The marks of the records that a view shows.
#[derive(Debug, Clone, Copy)]
pub struct VisibleRecords<'a> {
    /// A set that receives the marks; its indices count from `first`.
    pub records: &'a RecordSet,
    /// Index of the record of the lane to which mark 0 belongs.
    pub first: usize,
}

impl VisibleRecords<'_> {
    /// Marks the records of a block's visible splats.
    pub(super) fn mark(&self, projector: &Projector, voxels: &VoxelBlock, splats: &Splats, tiles: &TileBuffer) {
        for k in 0..splats.count.min(BLOCK) {
            let j = usize::from(splats.kept[k]) % BLOCK;
            let Some(record) = voxels.records[j].checked_sub(self.first) else { continue };
            if record >= self.records.lane_records() || self.records.contains(record) {
                continue;
            }
            let kernel = splats.kernel(j, projector.cut, 1.0);
            let depth = |x, y| match (&projector.rays, splats.near(j)) {
                (Some(rays), Some(kernel)) => rays.depths(kernel, &rays.rays([x], [y]), 1.0)[0],
                (rays, _) => kernel.depth(x, y, rays.as_ref().filter(|_| splats.is_on_rays(j))),
            };
            let ([low_x, high_x], [low_y, high_y]) = splats.clipped(j, tiles.rect);
            let mut pixels = (low_y..=high_y).flat_map(|y| (low_x..=high_x).map(move |x| (x, y)));
            if pixels.any(|(x, y)| tiles.pixel(x, y)[3] >= projector.stop && depth(x, y) > 0.0) {
                self.records.insert(record);
            }
        }
    }
}
