//! A view: a camera over a grid at a picture size, as transforms from voxels to pixels.
//!
//! In: [`Camera`], grid, size. Out: `pixel_from_voxel` (parallel) or `camera_from_voxel` (perspective), the viewpoint
//! in voxel units for the walk, and how large a box of voxels is on the screen. Pixel (0, 0) is centred at (0, 0);
//! x to the right, y down. Lengths on the way are counted in *mean voxels*, the cube root of a cell's volume, so that
//! neither tiny nor huge spacings leave single precision.

use std::ops::Range;

use glam::DVec3;

use super::camera::{Camera, Projection, SOUND_LENGTHS, WorldFrame};
use super::kernel::KernelShape;
use crate::error::{Error, Result};
use crate::traverse::{Viewpoint, VoxelBox};
use crate::volume::Grid;

/// Largest number of columns or rows of a picture.
pub const MAX_SIZE: u32 = 16_384;

/// An affine map from voxel coordinates: three factors and a constant.
pub type Affine = [f64; 4];

/// From voxels to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelMap {
    /// Parallel projection.
    Parallel {
        /// Column and row.
        pixel_from_voxel: [Affine; 2],
        /// Pixels per mean voxel.
        scale: f64,
    },
    /// Perspective: column `centre.x + focal * t0 / t2`, row `centre.y - focal * t1 / t2`.
    Perspective {
        /// To the right, up, and along the view, in mean voxels from the eye.
        camera_from_voxel: [Affine; 3],
        /// Pixels per unit of tangent.
        focal: f64,
        /// Pixel that the view axis meets.
        centre: [f64; 2],
        /// Voxels nearer than this along the view axis are not drawn; in mean voxels, above 0.
        near: f64,
    },
}

/// A camera over a grid, at a picture size.
#[derive(Debug, Clone)]
pub struct View {
    /// Columns, rows.
    pub size: [u32; 2],
    /// The eye or direction in voxel units, for the walk.
    pub viewpoint: Viewpoint,
    /// From voxels to pixels.
    pub map: PixelMap,
    /// World length of a mean voxel.
    pub mean_voxel: f64,
    /// Unit vectors to the picture's right, to its top, along the view; by index axis direction.
    pub axes: [[f64; 3]; 3],
    /// The eye in voxel coordinates times spacing; meaningless for a parallel view.
    pub eye_scaled: [f64; 3],
    /// Length of a kernel's cut-off ellipsoid along the view axis is at most this, in mean voxels.
    pub(super) reach: f64,
    /// Distance between voxels on each axis, in mean voxels.
    pub steps: [f64; 3],
}

impl View {
    /// The view of `camera` over `grid`.
    ///
    /// `near`: world distance along the view axis below which voxels are not drawn; `None` for as far as the kernel
    /// reaches, nearer than which a footprint would wrap around the eye.
    ///
    /// # Errors
    /// [`Error::Input`] if a side of `size` is 0, or `near` is not finite and above 0; [`Error::Limit`] if a side is
    /// above [`MAX_SIZE`].
    pub fn new(camera: &Camera, grid: &Grid, size: [u32; 2], kernel: KernelShape, near: Option<f64>) -> Result<View> {
        check_size(size)?;
        if let Some(near) = near.filter(|near| !(near.is_finite() && *near > 0.0)) {
            return Err(Error::input("near distance", format!("is {near}, but must be finite and above 0")));
        }
        grid.check()?;
        let world = WorldFrame::of(grid);
        let mean_voxel = mean_voxel(&world);
        let [right, up, forward] = camera.axes();
        let eye = DVec3::from_array(camera.position());
        let from_eye = |axis: DVec3| -> Affine {
            let [x, y, z] = world.steps.map(|step| axis.dot(step) / mean_voxel);
            [x, y, z, axis.dot(world.origin - eye) / mean_voxel]
        };
        let [columns, rows] = size.map(f64::from);
        let centre = [(columns - 1.0) / 2.0, (rows - 1.0) / 2.0];
        let camera_from_voxel = [from_eye(right), from_eye(up), from_eye(forward)];
        let steps = world.steps.map(|step| step.length() / mean_voxel);
        let along: f64 = camera_from_voxel[2][..3].iter().map(|c| c * c).sum();
        let reach = f64::from(kernel.radius) * along.sqrt();
        let toward = world.voxel_from_world_vector(forward);
        let eye_voxel = world.voxel_from_world_vector(eye - world.origin);
        let (map, viewpoint) = match camera.projection() {
            Projection::Parallel { height } => {
                let scale = rows / height * mean_voxel;
                let [x, y, _] = camera_from_voxel;
                let mut column = x.map(|c| c * scale);
                let mut row = y.map(|c| -c * scale);
                column[3] += centre[0];
                row[3] += centre[1];
                let map = PixelMap::Parallel { pixel_from_voxel: [column, row], scale };
                (map, Viewpoint::Parallel { direction: unit(toward) })
            }
            Projection::Perspective { fov } => {
                let focal = rows / 2.0 / (fov.to_radians() / 2.0).tan();
                let near = near.map_or(reach, |near| near / mean_voxel);
                let map = PixelMap::Perspective { camera_from_voxel, focal, centre, near };
                (map, Viewpoint::Perspective { eye: eye_voxel, toward: unit(toward) })
            }
        };
        let numbers = match &map {
            PixelMap::Parallel { pixel_from_voxel, .. } => pixel_from_voxel.as_flattened(),
            PixelMap::Perspective { camera_from_voxel, .. } => camera_from_voxel.as_flattened(),
        };
        let is_sound = world.steps.iter().all(|step| SOUND_LENGTHS.contains(&step.length()));
        if !(is_sound && numbers.iter().chain(&toward).all(|c| c.is_finite())) {
            let why = "is too near or too far for this grid's spacing; its transform is not finite (spacings 1e-150 to 1e150)";
            return Err(Error::input("camera", why));
        }
        let by_axis = |vector: DVec3| grid.direction.map(|axis| DVec3::from_array(axis).dot(vector));
        let eye_scaled = std::array::from_fn(|a| eye_voxel[a] * steps[a]);
        let axes = [by_axis(right), by_axis(up), by_axis(forward)];
        Ok(View { size, viewpoint, map, mean_voxel, axes, eye_scaled, reach, steps })
    }

    /// The same view with `factor` pixels for each along a side, a picture of `size` that has `margin` more on the left and at
    /// the top.
    pub(crate) fn with_pixels(&self, factor: f64, size: [u32; 2], margin: f64) -> View {
        // Pixel 0 is centred at 0, so that the picture begins at -1/2.
        let place = |at: f64| (at + 0.5) * factor - 0.5 + margin;
        let map = match self.map {
            PixelMap::Parallel { pixel_from_voxel, scale } => PixelMap::Parallel {
                pixel_from_voxel: pixel_from_voxel.map(|[x, y, z, at]| [x * factor, y * factor, z * factor, place(at)]),
                scale: scale * factor,
            },
            PixelMap::Perspective { camera_from_voxel, focal, centre, near } => {
                PixelMap::Perspective { camera_from_voxel, focal: focal * factor, centre: centre.map(place), near }
            }
        };
        View { map, size, ..self.clone() }
    }

    /// Some rows of the picture as a picture.
    pub(crate) fn with_rows(&self, rows: Range<u32>) -> View {
        let mut view = View { size: [self.size[0], rows.end - rows.start], ..self.clone() };
        match &mut view.map {
            PixelMap::Parallel { pixel_from_voxel: [_, row], .. } => row[3] -= f64::from(rows.start),
            PixelMap::Perspective { centre, .. } => centre[1] -= f64::from(rows.start),
        }
        view
    }

    /// Pixel box of all footprints of the voxels in `bounds`: columns low and high, rows low and high.
    ///
    /// Never too small; `None` if nothing of it can be drawn. `half`: half-widths of a footprint in a parallel view.
    pub fn pixel_bounds(&self, bounds: &VoxelBox, half: [f64; 2]) -> Option<[f64; 4]> {
        let middle: [f64; 3] = std::array::from_fn(|a| (f64::from(bounds.low[a]) + f64::from(bounds.high[a])) / 2.0);
        let extent: [f64; 3] = std::array::from_fn(|a| (f64::from(bounds.high[a]) - f64::from(bounds.low[a])) / 2.0);
        let at = |m: &Affine| m[0] * middle[0] + m[1] * middle[1] + m[2] * middle[2] + m[3];
        let spread = |m: &Affine| m[0].abs() * extent[0] + m[1].abs() * extent[1] + m[2].abs() * extent[2];
        match &self.map {
            PixelMap::Parallel { pixel_from_voxel: [column, row], .. } => {
                let (x, y) = (at(column), at(row));
                let (dx, dy) = (spread(column) + half[0] + 1.0, spread(row) + half[1] + 1.0);
                Some([x - dx, x + dx, y - dy, y + dy])
            }
            PixelMap::Perspective { camera_from_voxel: [right, up, along], focal, centre, near } => {
                let (depth, depth_spread) = (at(along), spread(along));
                if depth + depth_spread < *near {
                    return None;
                }
                let nearest = (depth - depth_spread).max(*near);
                let farthest = depth + depth_spread;
                let side = |m: &Affine| {
                    let (middle, spread) = (at(m), spread(m));
                    let (low, high) = (middle - spread, middle + spread);
                    (
                        low / if low < 0.0 { nearest } else { farthest },
                        high / if high < 0.0 { farthest } else { nearest },
                    )
                };
                let ((left, right), (bottom, top)) = (side(right), side(up));
                // A footprint's half-width: the Jacobian's norm is at most focal * |t| / t2^2, the kernel's length at
                // most its reach along its longest axis; and the low-pass.
                let tangent = left.abs().max(right.abs()).hypot(bottom.abs().max(top.abs()));
                let longest = self.reach_of_kernel();
                let half = focal * longest / nearest * (1.0 + tangent * tangent).sqrt() + LOW_PASS_REACH;
                Some([
                    centre[0] + focal * left - half,
                    centre[0] + focal * right + half,
                    centre[1] - focal * top - half,
                    centre[1] - focal * bottom + half,
                ])
            }
        }
    }

    /// Unit direction of view through the picture's centre, in index space.
    pub fn direction(&self) -> [f64; 3] {
        match self.viewpoint {
            Viewpoint::Parallel { direction } => direction,
            Viewpoint::Perspective { toward, .. } => toward,
        }
    }

    /// The eye in voxel coordinates; `None` for a parallel view.
    pub fn eye(&self) -> Option<[f64; 3]> {
        match self.viewpoint {
            Viewpoint::Parallel { .. } => None,
            Viewpoint::Perspective { eye, .. } => Some(eye),
        }
    }

    /// Longest half-axis of the kernel's cut-off ellipsoid is at most this, in mean voxels.
    fn reach_of_kernel(&self) -> f64 {
        let [x, y, z] = self.steps;
        let along = match &self.map {
            PixelMap::Perspective { camera_from_voxel, .. } => camera_from_voxel[2],
            PixelMap::Parallel { .. } => return 0.0,
        };
        let forward = (along[0] * along[0] + along[1] * along[1] + along[2] * along[2]).sqrt();
        // `reach` is the cut-off radius times `forward`.
        self.reach / forward * (x * x + y * y + z * z).sqrt()
    }
}

/// # Errors
/// [`Error::Input`] if a side of `size` is 0; [`Error::Limit`] if one is above [`MAX_SIZE`].
pub(crate) fn check_size(size: [u32; 2]) -> Result<()> {
    for side in size {
        if side == 0 {
            return Err(Error::input("picture size", "is 0, but must be at least 1 in both directions"));
        }
        if side > MAX_SIZE {
            let what = "picture size in pixels".to_string();
            return Err(Error::Limit { what, need: side.into(), have: MAX_SIZE.into() });
        }
    }
    Ok(())
}

/// Half-width in pixels that the low-pass can add, at any cut-off in use.
const LOW_PASS_REACH: f64 = 6.0;

/// Cube root of a cell's volume, in world length.
fn mean_voxel(world: &WorldFrame) -> f64 {
    let [x, y, z] = world.steps;
    let [ux, uy, uz] = [x.normalize(), y.normalize(), z.normalize()];
    let skew = ux.dot(uy.cross(uz)).abs();
    x.length().cbrt() * y.length().cbrt() * z.length().cbrt() * skew.cbrt()
}

fn unit(vector: [f64; 3]) -> [f64; 3] {
    let largest = vector.iter().fold(0.0f64, |most, c| most.max(c.abs()));
    let scaled = DVec3::from_array(vector) / largest;
    scaled.normalize().to_array()
}
