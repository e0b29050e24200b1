//! Finds orders of compositing by sorting.
//!
//! In: voxels and a view. Out: the indices of the voxels, nearest first.

use super::voxels::ReferenceVoxel;
use adjsplat::internals::PixelMap;
use adjsplat::splat::View;
use adjsplat::traverse::Viewpoint;

/// The order in which splats are composited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum SplatOrder {
    /// In three nested loops over the axes, as the renderers visit voxels. The axis most aligned with the view is
    /// outermost; along each axis voxels are sorted by their distance from the eye's plane.
    #[default]
    Nested,
    /// Sorted by distance from the eye; in a parallel view by depth along the view axis.
    Sorted,
}

/// Returns the indices of `voxels`, nearest first; `dims` is the number of points of their grid along x, y, z.
pub(super) fn front_to_back(voxels: &[ReferenceVoxel], dims: [u32; 3], view: &View, order: SplatOrder) -> Vec<u32> {
    let index = |at: usize| u32::try_from(at).expect("voxels are fewer than 2^32");
    match order {
        SplatOrder::Nested => {
            let mut axes = [0, 1, 2];
            let (direction, eye) = match view.viewpoint {
                Viewpoint::Parallel { direction } => (direction, None),
                Viewpoint::Perspective { eye, toward } => (toward, Some(eye)),
            };
            axes.sort_by(|&a, &b| direction[b].abs().total_cmp(&direction[a].abs()));
            let ranks = [0, 1, 2].map(|a| ranks(dims[a], direction[a], eye.map(|eye| eye[a])));
            let key = |voxel: &ReferenceVoxel| {
                axes.iter().fold(0u64, |key, &a| key << 16 | u64::from(ranks[a][usize::from(voxel.position[a])]))
            };
            let mut keys: Vec<(u64, u32)> = voxels.iter().enumerate().map(|(at, v)| (key(v), index(at))).collect();
            keys.sort_unstable();
            keys.into_iter().map(|(_, at)| at).collect()
        }
        SplatOrder::Sorted => {
            let mut keys: Vec<(f64, u32)> =
                voxels.iter().enumerate().map(|(at, v)| (distance(v, view), index(at))).collect();
            keys.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            keys.into_iter().map(|(_, at)| at).collect()
        }
    }
}

/// Returns the rank of each coordinate of an axis with `points` points; the nearest has rank 0.
fn ranks(points: u32, direction: f64, eye: Option<f64>) -> Vec<u16> {
    let last = points - 1;
    let mut coordinates: Vec<u32> = (0..points).collect();
    match eye {
        None if direction < 0.0 => coordinates.reverse(),
        None => {}
        Some(eye) if eye <= 0.0 => {}
        Some(eye) if eye >= f64::from(last) => coordinates.reverse(),
        // Of two equally distant coordinates, the higher one comes first in front-to-back order.
        Some(eye) => coordinates.sort_by(|&a, &b| {
            let [near, far] = [a, b].map(|at| (f64::from(at) - eye).abs());
            near.total_cmp(&far).then(b.cmp(&a))
        }),
    }
    let mut ranks = vec![0; coordinates.len()];
    for (rank, coordinate) in (0..).zip(coordinates) {
        ranks[coordinate as usize] = rank;
    }
    ranks
}

/// Returns the squared distance of a voxel from the eye, or its depth in a parallel view; in mean spacings.
fn distance(voxel: &ReferenceVoxel, view: &View) -> f64 {
    let [x, y, z] = voxel.position.map(f64::from);
    match &view.map {
        PixelMap::Parallel { .. } => {
            let [_, _, forward] = view.axes;
            (0..3).map(|a| forward[a] * view.steps[a] * [x, y, z][a]).sum()
        }
        PixelMap::Perspective { camera_from_voxel, .. } => {
            camera_from_voxel.iter().map(|m| m[0] * x + m[1] * y + m[2] * z + m[3]).map(|t| t * t).sum()
        }
    }
}
