//! Measuring: one walk through an empty hierarchy.

use super::geometry::Geometry;
use super::model::{CacheFigures, CacheModel};
use crate::baselines::{Normal, Receiver, Viewing, VoxelCube, Walker};
use crate::trace::Untraced;

/// What the hierarchy of `geometry` does on one walk; `reuse`: whether distances are followed. Also how many voxels and
/// cubes were handed over.
///
/// The walker walks once before, untraced: arrays that grow have grown then.
pub fn measure<W: Walker>(walker: &mut W, viewing: &Viewing, geometry: &Geometry, reuse: bool) -> (CacheFigures, u64) {
    walker.walk(viewing, &mut VisitCounter::default(), &mut Untraced);
    let mut model = CacheModel::new(geometry, &walker.arrays(), reuse);
    let mut count = VisitCounter::default();
    walker.walk(viewing, &mut count, &mut model);
    (model.figures(), count.visited)
}

/// Counts what it is given.
#[derive(Debug, Default)]
struct VisitCounter {
    visited: u64,
}

impl Receiver for VisitCounter {
    #[inline]
    fn voxel(&mut self, _: [u16; 3], _: u8, _: Normal) {
        self.visited += 1;
    }

    #[inline]
    fn cube(&mut self, _: &VoxelCube) {
        self.visited += 1;
    }
}
