//! Scenes and views for the judges.

use adjsplat::splat::{Camera, Orbit, Projection, Surround};
use adjsplat::volume::Grid;
use adjsplat_judge::reference::{
    Judge, JudgeSettings, RayJudge, RaySettings, ReferencePicture, ReferenceVoxel, VisibleVoxels,
};

/// Threads that these tests take.
pub(crate) const THREADS: usize = 2;

/// A voxel that is not lit; its value is 0.
pub(crate) fn voxel(position: [u16; 3], depth: f64, colour: [f32; 3]) -> ReferenceVoxel {
    ReferenceVoxel { position, depth, colour, normal: [0.0; 3], value: 0.0 }
}

/// Voxels of a grid of `dims` points, where `look` gives optical depth and colour.
pub(crate) fn made(
    dims: [u16; 3],
    spacing: [f64; 3],
    look: impl Fn([u16; 3]) -> Option<(f64, [f32; 3])>,
) -> VisibleVoxels {
    let grid = Grid::new(dims.map(u64::from), spacing).unwrap();
    let mut voxels = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                if let Some((depth, colour)) = look([x, y, z]) {
                    voxels.push(voxel([x, y, z], depth, colour));
                }
            }
        }
    }
    VisibleVoxels::new(grid, voxels).unwrap()
}

/// A camera on an orbit around all of a grid.
pub(crate) fn orbit(grid: &Grid, azimuth: f64, elevation: f64, fov: Option<f64>, size: [u32; 2]) -> Camera {
    let orbit = Orbit { azimuth, elevation, fov, ..Orbit::default() };
    Camera::orbiting(orbit, Surround::of_grid(grid), size).unwrap()
}

/// A parallel view along +z of the point (`x`, `y`, 0), `height` high.
pub(crate) fn down_z([x, y]: [f64; 2], height: f64) -> Camera {
    let projection = Projection::Parallel { height };
    Camera::new([x, y, -100.0], [x, y, 0.0], [0.0, 1.0, 0.0], projection).unwrap()
}

pub(crate) fn splatted(visible: &VisibleVoxels, camera: &Camera, settings: JudgeSettings) -> ReferencePicture {
    Judge::of_voxels(visible.clone()).draw(camera, &JudgeSettings { threads: THREADS, ..settings }).unwrap()
}

pub(crate) fn integrated(visible: &VisibleVoxels, camera: &Camera, settings: RaySettings) -> ReferencePicture {
    RayJudge::new(visible).draw(camera, &RaySettings { threads: THREADS, ..settings }).unwrap()
}

/// Pixels with no sample above this are empty.
pub(crate) const EMPTY: f64 = 1e-6;

/// Slope of log error over log step, by least squares; `points`: of an axis, in inverse proportion to the step.
pub(crate) fn order_of_convergence(points: &[u64], errors: &[f64]) -> f64 {
    let count = errors.len() as f64;
    let logs = || points.iter().zip(errors).map(|(&points, error)| (-(points as f64).ln(), error.ln()));
    let (mean_x, mean_y) = logs().fold((0.0, 0.0), |(sx, sy), (x, y)| (sx + x / count, sy + y / count));
    let slope = logs().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>();
    slope / logs().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>()
}
