//! Measures one walk through a memory hierarchy that starts empty.

use super::geometry::Geometry;
use super::model::{CacheFigures, CacheModel};
use crate::baselines::{Structure, Viewing, Walker as _};

/// Returns the hierarchy's figures for one walk, and the number of voxels and cubes; if `reuse`, also reuse distances.
///
/// An untraced walk comes first, so that scratch arrays that grow have their final size.
pub fn measure(walk: &mut Structure, viewing: &Viewing, geometry: &Geometry, reuse: bool) -> (CacheFigures, u64) {
    walk.summed(viewing);
    let mut model = CacheModel::new(geometry, &walk.arrays(), reuse);
    let visited = walk.traced(viewing, &mut model).count;
    (model.figures(), visited)
}
