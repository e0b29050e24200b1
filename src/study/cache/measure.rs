//! Measures one walk through a memory hierarchy that starts empty.

use super::geometry::Geometry;
use super::model::{CacheFigures, CacheModel};
use crate::baselines::{Normal, Receiver, Viewing, VoxelCube, Walker};
use crate::trace::Untraced;

/// Returns the hierarchy's figures for one walk, and the number of voxels and cubes; if `reuse`, also reuse distances.
///
/// An untraced walk comes first, so that scratch arrays that grow have their final size.
pub fn measure<W: Walker>(walker: &mut W, viewing: &Viewing, geometry: &Geometry, reuse: bool) -> (CacheFigures, u64) {
    walker.walk(viewing, &mut VisitCounter::default(), &mut Untraced);
    let mut model = CacheModel::new(geometry, &walker.arrays(), reuse);
    let mut count = VisitCounter::default();
    walker.walk(viewing, &mut count, &mut model);
    (model.figures(), count.visited)
}

/// Counts the voxels and cubes that it receives.
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
