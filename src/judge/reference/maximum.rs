//! The reference of the maximum modes: a ray caster that keeps the largest interpolated value.
//!
//! In: visible voxels, a camera, [`JudgeSettings`]. Out: a [`ReferencePicture`].
//!
//! ```text
//! N(i)  = (value - lowest) / (largest - lowest) of visible voxel i; 0 at all other grid points
//! pixel = largest trilinear interpolation of N where the pixel's ray meets a slice, or is half-way between two
//! ```
//!
//! Slices lie across the axis of the grid that the view follows most. Rays begin at the near plane.

use glam::DVec3;

use adjsplat::error::Result;
use adjsplat::internals::PixelMap;
use adjsplat::splat::{Camera, Mode, StopRequest, View, WorldFrame};
use adjsplat::traverse::Viewpoint;

use super::picture::ReferencePicture;
use super::ray::{Ray, Rays};
use super::splat::JudgeSettings;
use super::voxels::VisibleVoxels;
use crate::allocate::filled;

/// Draws the largest value on the ray of each pixel, in the mode of `settings`.
pub(super) fn draw(
    visible: &VisibleVoxels,
    camera: &Camera,
    view: &View,
    settings: &JudgeSettings,
    stop: Option<&StopRequest>,
) -> Result<ReferencePicture> {
    let mut picture = ReferencePicture::filled(settings.size, [0.0; 4])?;
    let Some(field) = ValueField::new(visible, settings)? else { return Ok(picture) };
    let rays = Rays::new(camera, view, WorldFrame::of(visible.grid()));
    let (Viewpoint::Parallel { direction } | Viewpoint::Perspective { toward: direction, .. }) = view.viewpoint;
    // The first of equal ones.
    let slow = [2, 1, 0].into_iter().max_by(|&a, &b| direction[a].abs().total_cmp(&direction[b].abs())).unwrap_or(0);
    picture.draw(settings.threads, stop, |(): &mut (), column, row| {
        let largest = field.largest(&rays.through(column, row), slow, view);
        match (settings.mode, visible.transfer()) {
            (Mode::Maximum, Some(transfer)) => {
                let [red, green, blue] = transfer.colour(field.value(largest)).map(f64::from);
                [red * largest, green * largest, blue * largest, largest]
            }
            _ => [largest; 4],
        }
    })?;
    Ok(picture)
}

/// The normalised values of a box of grid points; 0 outside the box.
struct ValueField {
    /// The first grid point of the box.
    low: [i64; 3],
    /// The number of grid points of the box along x, y and z.
    points: [i64; 3],
    /// Normalised values, x fastest.
    values: Vec<f64>,
    /// The values of the volume that are 0 and 1.
    ends: [f64; 2],
}

impl ValueField {
    /// Returns the values of the visible voxels that are not clipped; `None` if there are none.
    fn new(visible: &VisibleVoxels, settings: &JudgeSettings) -> Result<Option<ValueField>> {
        let Some((low, high)) = visible.bounds() else { return Ok(None) };
        let (low, points) = (low.map(i64::from), std::array::from_fn(|a| i64::from(high[a]) - i64::from(low[a]) + 1));
        let count = points.iter().map(|points| points.unsigned_abs()).product::<u64>();
        let values = filled("the values of all grid points", count, 0.0)?;
        let lowest = visible.lowest_value();
        let largest = visible.voxels().iter().map(|voxel| voxel.value).fold(lowest, f64::max);
        let world = WorldFrame::of(visible.grid());
        let mut field = ValueField { low, points, values, ends: [lowest, largest] };
        for voxel in visible.voxels() {
            if let Some(at) = field.index(voxel.position.map(i64::from))
                && settings.draws(voxel.position, &world)
                && largest > lowest
            {
                field.values[at] = (voxel.value - lowest) / (largest - lowest);
            }
        }
        Ok(Some(field))
    }

    fn index(&self, position: [i64; 3]) -> Option<usize> {
        let [x, y, z]: [i64; 3] = std::array::from_fn(|a| position[a] - self.low[a]);
        let [columns, rows, slices] = self.points;
        let is_inside = (0..columns).contains(&x) && (0..rows).contains(&y) && (0..slices).contains(&z);
        if is_inside { usize::try_from((z * rows + y) * columns + x).ok() } else { None }
    }

    /// Returns the value of the volume that a normalised value stands for.
    fn value(&self, normalised: f64) -> f64 {
        self.ends[0] + normalised * (self.ends[1] - self.ends[0])
    }

    /// Returns the largest sample of a ray, whose slices lie across the axis `slow`.
    fn largest(&self, ray: &Ray, slow: usize, view: &View) -> f64 {
        let is_seen = |point: DVec3| match &view.map {
            PixelMap::Parallel { .. } => true,
            PixelMap::Perspective { camera_from_voxel: [_, _, [x, y, z, at]], .. } => {
                DVec3::new(*x, *y, *z).dot(point) + at >= view.ray_start()
            }
        };
        let (from, to) = (2 * self.low[slow] - 1, 2 * (self.low[slow] + self.points[slow]) - 1);
        let points = (from..=to).map(|half_slices| {
            let slice = half_slices as f64 / 2.0;
            let mut point = ray.origin + ray.direction * ((slice - ray.origin[slow]) / ray.direction[slow]);
            point[slow] = slice;
            point
        });
        points.filter(|&point| is_seen(point)).map(|point| self.interpolated(point)).fold(0.0, f64::max)
    }

    /// Returns the trilinear interpolation at a point in voxel coordinates.
    fn interpolated(&self, point: DVec3) -> f64 {
        let first = point.floor();
        let [x, y, z] = (point - first).to_array();
        let mut sum = 0.0;
        for corner in 0..8 {
            let [right, above, behind] = [corner & 1, corner >> 1 & 1, corner >> 2];
            #[expect(clippy::cast_possible_truncation, reason = "saturates: far outside the box")]
            let [i, j, k] = first.to_array().map(|c| c as i64);
            let at = [i.saturating_add(right), j.saturating_add(above), k.saturating_add(behind)];
            let weight = |far: i64, fraction: f64| if far == 1 { fraction } else { 1.0 - fraction };
            if let Some(index) = self.index(at) {
                sum += weight(right, x) * weight(above, y) * weight(behind, z) * self.values[index];
            }
        }
        sum
    }
}
