//! Orders of compositing, by sorting.
//!
//! In: voxels and a view. Out: their indices, near first. *Nested*: three nested loops, the axis most aligned with the
//! view (in index space) outermost, each axis from its near side to its far side, by the distance from the eye's plane;
//! this is what a walk should do. *Sorted*: by the distance from the eye, or along a parallel view.

use super::voxels::Voxel;
use adjsplat::splat::View;
use adjsplat::splat::view::PixelMap;

/// In which order splats are composited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Order {
    /// Slow, medium and fast axis nested; both sides of the eye's plane in turn.
    #[default]
    Nested,
    /// By Euclidean distance to the eye; along the view axis for a parallel view.
    Sorted,
}

/// Indices of `voxels` on a grid of `dims` points, near first.
pub(super) fn front_to_back(voxels: &[Voxel], dims: [u32; 3], view: &View, order: Order) -> Vec<u32> {
    let index = |at: usize| u32::try_from(at).expect("voxels are fewer than 2^32");
    match order {
        Order::Nested => {
            let mut axes = [0, 1, 2];
            let direction = view.direction();
            axes.sort_by(|&a, &b| direction[b].abs().total_cmp(&direction[a].abs()));
            let ranks = [0, 1, 2].map(|a| ranks(dims[a], direction[a], view.eye().map(|eye| eye[a])));
            let key = |voxel: &Voxel| {
                axes.iter().fold(0u64, |key, &a| key << 16 | u64::from(ranks[a][usize::from(voxel.position[a])]))
            };
            let mut keys: Vec<(u64, u32)> = voxels.iter().enumerate().map(|(at, v)| (key(v), index(at))).collect();
            keys.sort_unstable();
            keys.into_iter().map(|(_, at)| at).collect()
        }
        Order::Sorted => {
            let mut keys: Vec<(f64, u32)> =
                voxels.iter().enumerate().map(|(at, v)| (distance(v, view), index(at))).collect();
            keys.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            keys.into_iter().map(|(_, at)| at).collect()
        }
    }
}

/// The place of each coordinate of an axis in its order, near first.
fn ranks(points: u32, direction: f64, eye: Option<f64>) -> Vec<u16> {
    let last = points - 1;
    let mut coordinates: Vec<u32> = (0..points).collect();
    match eye {
        None if direction < 0.0 => coordinates.reverse(),
        None => {}
        Some(eye) if eye <= 0.0 => {}
        Some(eye) if eye >= f64::from(last) => coordinates.reverse(),
        // Of two that are as far the low one is composited first from the back: it comes last from the front.
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

/// Squared distance from the eye, or depth along a parallel view; in mean voxels.
fn distance(voxel: &Voxel, view: &View) -> f64 {
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
