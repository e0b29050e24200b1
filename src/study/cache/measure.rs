//! Measures one walk through an empty hierarchy.

use super::geometry::Geometry;
use super::model::{CacheFigures, CacheModel};
use crate::baselines::{Normal, Receiver, Viewing, VoxelCube, Walker};
use crate::trace::Untraced;

/// Returns what the hierarchy does on one walk, and the number of voxels and cubes; `reuse` also measures distances.
///
/// An untraced walk comes first, so that growing arrays have their size.
pub fn measure<W: Walker>(walker: &mut W, viewing: &Viewing, geometry: &Geometry, reuse: bool) -> (CacheFigures, u64) {
    walker.walk(viewing, &mut VisitCounter::default(), &mut Untraced);
    let mut model = CacheModel::new(geometry, &walker.arrays(), reuse);
    let mut count = VisitCounter::default();
    walker.walk(viewing, &mut count, &mut model);
    (model.figures(), count.visited)
}

/// Counts voxels and cubes.
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
