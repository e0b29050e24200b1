//! A view: the transforms from voxel coordinates of a grid to the pixels of a picture.
//!
//! In: a [`Camera`], a grid, a picture's size. Out: the transforms, the viewpoint in voxel units for the walk, and the
//! pixels that a box of voxels covers. Pixel (0, 0) is centred at (0, 0); x to the right, y down. Lengths are in *mean
//! spacings*, the cube root of a cell's volume, so that neither tiny nor huge spacings exceed single precision.

use std::ops::Range;

use glam::DVec3;

use super::camera::{Camera, Projection, SOUND_LENGTHS, WorldFrame};
use super::kernel::KernelShape;
use super::near::{NEAR, NEAR_RADII};
use super::{require, require_pixels, require_positive};
use crate::error::{Error, Result};
use crate::traverse::{Viewpoint, VoxelBox};
use crate::volume::Grid;

/// The largest number of columns or rows of a picture.
pub const MAX_SIZE: u32 = 16_384;

/// An affine map from voxel coordinates to a number: three factors and a constant.
pub type Affine = [f64; 4];

/// Returns the value of the affine `map` at a point in voxel coordinates.
pub(crate) fn apply(map: &Affine, point: [f64; 3]) -> f64 {
    map[0] * point[0] + map[1] * point[1] + map[2] * point[2] + map[3]
}

/// Returns the three factors of an affine map in single precision.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "footprints are computed in single precision")]
pub(crate) fn single(map: &Affine) -> [f32; 3] {
    [map[0] as f32, map[1] as f32, map[2] as f32]
}

/// The transform from voxel coordinates to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelMap {
    /// Parallel projection.
    Parallel {
        /// The maps from voxel coordinates to column and row.
        pixel_from_voxel: [Affine; 2],
        /// Pixels per mean spacing.
        scale: f64,
    },
    /// Perspective projection: column `centre.x + focal * t0 / t2`, row `centre.y - focal * t1 / t2`, where t is the
    /// result of `camera_from_voxel`.
    Perspective {
        /// The maps from voxel coordinates to distances from the eye to the right, up and forward, in mean spacings.
        camera_from_voxel: [Affine; 3],
        /// The focal length: pixels per unit of the tangent of the angle to the view axis.
        focal: f64,
        /// The column and row of the point that the view axis meets.
        centre: [f64; 2],
        /// Distance along the view axis from which voxels have footprints, in mean spacings; above 0.
        /// Nearer ones are integrated along each ray (`near.rs`), unless they are clipped ([`View::clip`]).
        near: f64,
    },
}

/// The view of a camera over a grid, at a picture size.
#[derive(Debug, Clone)]
pub struct View {
    /// Columns and rows of the picture.
    pub size: [u32; 2],
    /// The eye, or the direction of a parallel view, in voxel units.
    pub viewpoint: Viewpoint,
    /// The transform from voxel coordinates to pixels.
    pub map: PixelMap,
    /// World length of a path as long as the mean spacing, the cube root of a cell's volume.
    pub mean_voxel: f64,
    /// Unit vectors to the picture's right, to its top, and forward; their components are along the grid's axes.
    pub axes: [[f64; 3]; 3],
    /// Position of the eye along the grid's axes, in mean spacings; meaningless for a parallel view.
    pub eye_scaled: [f64; 3],
    /// Distance along the view axis below which voxels are not drawn, in mean spacings; minus infinity if none is set.
    pub clip: f64,
    /// Upper bound of the kernel's half extent along the view axis, in mean spacings.
    pub(super) reach: f64,
    /// The distance between voxels on each axis, in mean spacings.
    pub steps: [f64; 3],
    /// Largest distance of a drawn voxel from its grid point, in voxels: its offset, or 1 in a maximum.
    pub(super) margin: f64,
}

impl View {
    /// Returns the view of `camera` over `grid` for a picture of `size` columns and rows.
    ///
    /// `near` is the world distance along the view axis below which voxels are not drawn. `None` clips none: rays start
    /// at the eye.
    ///
    /// # Errors
    /// [`Error::Input`] if a side of `size` or `near` is not above 0; [`Error::Limit`] if a side is above [`MAX_SIZE`].
    pub fn new(camera: &Camera, grid: &Grid, size: [u32; 2], kernel: KernelShape, near: Option<f64>) -> Result<View> {
        check_size(size)?;
        near.map_or(Ok(()), |near| require_positive(near, "near distance"))?;
        grid.check()?;
        let world = WorldFrame::of(grid);
        let mean_voxel = mean_voxel(&world);
        let [right, up, forward] = camera.axes();
        let eye = DVec3::from_array(camera.anchor());
        let from_eye = |axis: DVec3| -> Affine {
            let [x, y, z] = world.steps.map(|step| axis.dot(step) / mean_voxel);
            [x, y, z, axis.dot(world.origin - eye) / mean_voxel]
        };
        let [columns, rows] = size.map(f64::from);
        let centre = [(columns - 1.0) / 2.0, (rows - 1.0) / 2.0];
        let camera_from_voxel = [from_eye(right), from_eye(up), from_eye(forward)];
        let steps = world.steps.map(|step| step.length() / mean_voxel);
        // By how much the distance from the eye's plane changes at most in a step of length 1 in voxel coordinates.
        let steepness = camera_from_voxel[2][..3].iter().map(|c| c * c).sum::<f64>().sqrt();
        let reach = f64::from(kernel.radius) * steepness;
        let clip = near.map_or(f64::NEG_INFINITY, |near| near / mean_voxel);
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
                let nearest = NEAR.max(NEAR_RADII * f64::from(kernel.radius));
                let near = clip.max(nearest * steepness);
                let map = PixelMap::Perspective { camera_from_voxel, focal, centre, near };
                (map, Viewpoint::Perspective { eye: eye_voxel, toward: unit(toward) })
            }
        };
        let numbers = match &map {
            PixelMap::Parallel { pixel_from_voxel, .. } => pixel_from_voxel.as_flattened(),
            PixelMap::Perspective { camera_from_voxel, .. } => camera_from_voxel.as_flattened(),
        };
        let is_finite = numbers.iter().chain(&toward).all(|c| c.is_finite());
        let is_sound = world.steps.iter().all(|step| SOUND_LENGTHS.contains(&step.length()));
        let why = "is too near or too far for the grid's spacing: the transform is not finite";
        require(is_sound && is_finite, "camera", why)?;
        let by_axis = |vector: DVec3| grid.direction.map(|axis| DVec3::from_array(axis).dot(vector));
        let eye_scaled = std::array::from_fn(|a| eye_voxel[a] * steps[a]);
        let axes = [by_axis(right), by_axis(up), by_axis(forward)];
        Ok(View { size, viewpoint, map, mean_voxel, axes, eye_scaled, clip, reach, steps, margin: 0.0 })
    }

    /// Returns whether the view is a perspective.
    pub(crate) fn is_perspective(&self) -> bool {
        matches!(self.map, PixelMap::Perspective { .. })
    }

    /// Returns the distance along the view axis at which the rays of a maximum begin, in mean spacings: at the clip, or as
    /// near to the eye as single precision allows.
    pub fn ray_start(&self) -> f64 {
        self.clip.max(1e-3)
    }

    /// Returns the view with `factor` pixels along each side of a pixel, in a picture of `size` that has `margin` more
    /// pixels on the left and at the top.
    pub(crate) fn with_pixels(&self, factor: f64, size: [u32; 2], margin: f64) -> View {
        // The picture begins at -1/2, as pixel 0 is centred at 0.
        let scaled = |at: f64| (at + 0.5) * factor - 0.5 + margin;
        let map = match self.map {
            PixelMap::Parallel { pixel_from_voxel, scale } => PixelMap::Parallel {
                pixel_from_voxel: pixel_from_voxel
                    .map(|[x, y, z, at]| [x * factor, y * factor, z * factor, scaled(at)]),
                scale: scale * factor,
            },
            PixelMap::Perspective { camera_from_voxel, focal, centre, near } => {
                PixelMap::Perspective { camera_from_voxel, focal: focal * factor, centre: centre.map(scaled), near }
            }
        };
        View { map, size, ..self.clone() }
    }

    /// Returns the view of the given `rows` of the picture.
    pub(crate) fn with_rows(&self, rows: Range<u32>) -> View {
        let mut view = View { size: [self.size[0], rows.end - rows.start], ..self.clone() };
        match &mut view.map {
            PixelMap::Parallel { pixel_from_voxel: [_, row], .. } => row[3] -= f64::from(rows.start),
            PixelMap::Perspective { centre, .. } => centre[1] -= f64::from(rows.start),
        }
        view
    }

    /// Returns whether a voxel of a grid of `dims` points may be so near the eye that it has no footprint.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only renderers on graphics devices ask for it"))]
    pub(crate) fn has_near(&self, dims: [u32; 3]) -> bool {
        let PixelMap::Perspective { camera_from_voxel: [.., forward], near, .. } = &self.map else { return false };
        // Voxels that are partly visible lie beside their grid points, by less than a voxel. What graphics devices round is
        // far less than a thousandth.
        let corner = std::array::from_fn(|a| if forward[a] < 0.0 { f64::from(dims[a]) } else { -1.0 });
        apply(forward, corner) < 1.001 * near
    }

    /// Returns a box on the screen that holds all footprints of the voxels in `bounds`: first and last column, then
    /// first and last row.
    ///
    /// `None` if all voxels are clipped or behind the eye. Where the eye is among the voxels, ends may be infinite.
    /// `half_widths`: half a footprint's size in a parallel view, in pixels.
    pub fn pixel_bounds(&self, bounds: &VoxelBox, half_widths: [f64; 2]) -> Option<[f64; 4]> {
        let middle: [f64; 3] = std::array::from_fn(|a| (f64::from(bounds.low[a]) + f64::from(bounds.high[a])) / 2.0);
        let extent: [f64; 3] =
            std::array::from_fn(|a| (f64::from(bounds.high[a]) - f64::from(bounds.low[a])) / 2.0 + self.margin);
        let at = |map: &Affine| apply(map, middle);
        let spread = |m: &Affine| m[0].abs() * extent[0] + m[1].abs() * extent[1] + m[2].abs() * extent[2];
        match &self.map {
            PixelMap::Parallel { pixel_from_voxel: [column, row], .. } => {
                let (x, y) = (at(column), at(row));
                let (dx, dy) = (spread(column) + half_widths[0] + 1.0, spread(row) + half_widths[1] + 1.0);
                Some([x - dx, x + dx, y - dy, y + dy])
            }
            PixelMap::Perspective { camera_from_voxel: [right, up, forward], focal, centre, near } => {
                let (lowest, farthest) = (at(forward) - spread(forward), at(forward) + spread(forward));
                if farthest < self.clip.max(-self.reach) {
                    return None;
                }
                let length = |[x, y, z, _]: &Affine| (x * x + y * y + z * z).sqrt();
                let radius = self.reach / length(forward);
                // The tangents of points up to `aside` away from the box, between two depths.
                let tangents = |map: &Affine, aside: f64, [nearest, farthest]: [f64; 2]| {
                    let (low, high) = (at(map) - spread(map) - aside, at(map) + spread(map) + aside);
                    [
                        low / if low < 0.0 { nearest } else { farthest },
                        high / if high < 0.0 { farthest } else { nearest },
                    ]
                };
                let (mut columns, mut rows) = ([f64::INFINITY, f64::NEG_INFINITY], [f64::INFINITY, f64::NEG_INFINITY]);
                let mut add = |[left, right]: [f64; 2], [bottom, top]: [f64; 2], half_width: f64| {
                    columns[0] = columns[0].min(centre[0] + focal * left - half_width);
                    columns[1] = columns[1].max(centre[0] + focal * right + half_width);
                    rows[0] = rows[0].min(centre[1] - focal * top - half_width);
                    rows[1] = rows[1].max(centre[1] - focal * bottom + half_width);
                };
                if lowest < *near && self.clip < *near {
                    // Rays that pass a kernel pass the ball of its radius. One pixel more is for rounding.
                    let nearest = (lowest.max(self.clip) - self.reach).max(f64::MIN_POSITIVE);
                    let depths = [nearest, farthest.min(*near) + self.reach];
                    let seen = |map: &Affine| tangents(map, radius * length(map), depths);
                    add(seen(right), seen(up), 1.0);
                }
                if farthest >= *near {
                    let depths = [lowest.max(*near), farthest];
                    let (across, above) = (tangents(right, 0.0, depths), tangents(up, 0.0, depths));
                    // A footprint is at most as large as the kernel's longest half-axis times the Jacobian's norm, at most
                    // focal * |t| / t2^2, plus the low-pass.
                    let most = |[low, high]: [f64; 2]| low.abs().max(high.abs());
                    let tangent = most(across).hypot(most(above));
                    let [x, y, z] = self.steps;
                    let longest = radius * (x * x + y * y + z * z).sqrt();
                    let half_width = focal * longest / depths[0] * (1.0 + tangent * tangent).sqrt();
                    // What the perspective adds to boxes: `Footprint::in_perspective`.
                    let half_width = half_width / (1.0 - self.reach / depths[0]);
                    add(across, above, half_width + LOW_PASS_REACH);
                }
                Some([columns[0], columns[1], rows[0], rows[1]])
            }
        }
    }
}

/// Checks that both sides of `size` are 1 to [`MAX_SIZE`] pixels.
pub(crate) fn check_size(size: [u32; 2]) -> Result<()> {
    require_pixels(size)?;
    let Some(side) = size.into_iter().find(|side| *side > MAX_SIZE) else { return Ok(()) };
    Err(Error::Limit { what: "picture size in pixels".into(), need: side.into(), have: MAX_SIZE.into() })
}

/// Upper bound of what the low-pass adds to half of a footprint's width, in pixels, at any cut-off in use.
const LOW_PASS_REACH: f64 = 6.0;

/// Returns the cube root of a cell's volume, in world length: `Grid::mean_spacing`, but for rounding.
fn mean_voxel(world: &WorldFrame) -> f64 {
    let [x, y, z] = world.steps;
    let [ux, uy, uz] = [x.normalize(), y.normalize(), z.normalize()];
    let skew = ux.dot(uy.cross(uz)).abs();
    x.length().cbrt() * y.length().cbrt() * z.length().cbrt() * skew.cbrt()
}

/// Returns `vector` scaled to length 1; divides by its largest component first, so that no square overflows.
fn unit(vector: [f64; 3]) -> [f64; 3] {
    let largest = vector.iter().fold(0.0f64, |most, c| most.max(c.abs()));
    (DVec3::from_array(vector) / largest).normalize().to_array()
}
