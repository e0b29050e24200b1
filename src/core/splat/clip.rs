//! Which voxels a frame draws: those in a box of indices and on one side of a plane.
//!
//! In: the crop and the clip plane of the settings, and the grid. Out: tests of voxels, of boxes and of scan lines. The plane
//! is rounded to whole numbers, so that every renderer, also one on a graphics device, draws the same voxels.

use glam::DVec3;

use super::Settings;
use super::camera::SOUND_LENGTHS;
use crate::arena::layout::TILE_EDGE;
use crate::error::{Error, Result};
use crate::traverse::VoxelBox;
use crate::volume::Grid;

/// A plane that cuts a volume open: voxels whose centres lie behind it are not drawn.
///
/// A plane across an axis is exact. Of others, voxels behind the plane by less than 0.001 voxels may be drawn in volumes of
/// 512 points a side, by less than 0.02 voxels in those of 2,048, and by less than 20 in the largest (65,535).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipPlane {
    /// A point of the plane, in world coordinates.
    pub point: [f64; 3],
    /// The direction, in world coordinates, to the side that is drawn; not 0, of any length.
    pub normal: [f64; 3],
}

impl ClipPlane {
    /// Checks that the numbers are finite and that the normal has a direction.
    ///
    /// # Errors
    /// [`Error::Input`] if not.
    pub fn check(&self) -> Result<()> {
        let is_finite = self.point.iter().chain(&self.normal).all(|number| number.is_finite());
        if is_finite && self.unit_normal().is_some() {
            return Ok(());
        }
        Err(Error::input("clip plane", "must have a finite point and a finite normal that is not 0"))
    }

    /// Returns the normal with length 1; `None` if it has no direction.
    fn unit_normal(&self) -> Option<DVec3> {
        let normal = DVec3::from_array(self.normal);
        // The squares of other numbers overflow, or lose their digits.
        let largest = normal.abs().max_element();
        if SOUND_LENGTHS.contains(&largest) { normal.try_normalize() } else { (normal / largest).try_normalize() }
    }
}

/// The voxels that a frame draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ClipRegion {
    /// The box that holds them.
    pub(crate) crop: VoxelBox,
    pub(crate) plane: Option<IndexPlane>,
}

/// A plane in voxel indices: voxels whose product with the normal is at least `least` are drawn.
///
/// Products wrap around for indices outside the grid's tiles, which only damaged files have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct IndexPlane {
    pub(crate) normal: [i32; 3],
    pub(crate) least: i32,
}

impl ClipRegion {
    pub(super) fn new(settings: &Settings, grid: &Grid) -> ClipRegion {
        let crop = settings.crop.unwrap_or(VoxelBox::ALL);
        ClipRegion { crop, plane: settings.clip.map(|plane| IndexPlane::new(&plane, grid)) }
    }

    /// Returns whether a voxel is drawn.
    #[inline(always)]
    pub(crate) fn contains(&self, voxel: [u16; 3]) -> bool {
        let in_crop = (0..3).all(|a| voxel[a] >= self.crop.low[a] && voxel[a] <= self.crop.high[a]);
        in_crop && self.plane.is_none_or(|plane| plane.shows(voxel))
    }

    /// Returns whether any voxel of a box may be drawn.
    #[inline(always)]
    pub(crate) fn meets(&self, bounds: &VoxelBox) -> bool {
        bounds.meets(&self.crop) && self.plane.is_none_or(|plane| plane.shows(plane.corner(bounds, true)))
    }

    /// Returns whether all voxels of a box are drawn.
    #[cfg_attr(not(feature = "gpu"), expect(dead_code, reason = "only renderers on graphics devices ask for it"))]
    pub(crate) fn covers(&self, bounds: &VoxelBox) -> bool {
        self.contains(bounds.low)
            && self.contains(bounds.high)
            && self.plane.is_none_or(|plane| plane.shows(plane.corner(bounds, false)))
    }

    /// Returns the first and the last index that may be drawn on the scan line along axis `fast` through `voxel`; the first
    /// is above the last if there is none.
    #[inline(always)]
    pub(crate) fn on_line(&self, fast: usize, voxel: [u16; 3]) -> [u16; 2] {
        let (low, high) = (self.crop.low, self.crop.high);
        if (0..3).any(|a| a != fast && (voxel[a] < low[a] || voxel[a] > high[a])) {
            return [1, 0];
        }
        let ends = [low[fast], high[fast]];
        self.plane.map_or(ends, |plane| plane.on_line(fast, voxel, ends))
    }
}

impl IndexPlane {
    /// Rounds a plane. The products of indices in the grid's tiles, which may reach beyond it, stay below 2^30.
    fn new(plane: &ClipPlane, grid: &Grid) -> IndexPlane {
        // A plane's normal is a covector: a step along an axis moves by its product with the world vector of the step.
        let normal = plane.unit_normal().unwrap_or(DVec3::NAN);
        let steps = [0, 1, 2].map(|a| normal.dot(DVec3::from_array(grid.direction[a])) * grid.spacing[a]);
        let from_origin = normal.dot(DVec3::from_array(plane.point) - DVec3::from_array(grid.origin));
        let dims = grid.dims.map(|points| f64::from(points.next_multiple_of(TILE_EDGE.into())));
        let extent: f64 = (0..3).map(|a| steps[a].abs() * dims[a]).sum();
        // The longest step is a whole number, so that a plane across an axis is exact.
        let longest = steps.into_iter().map(f64::abs).fold(0.0, f64::max);
        let scale = (longest / extent * f64::from(1 << 30)).floor() / longest;
        let normal = steps.map(|step| (step * scale).round());
        // No voxel on the plane is lost to rounding.
        let error: f64 = (0..3).map(|a| (normal[a] - steps[a] * scale).abs() * dims[a]).sum();
        let least = (from_origin * scale - error).round() - 1.0;
        #[expect(clippy::cast_possible_truncation, reason = "the scale keeps steps small; a far plane saturates")]
        let whole = |number: f64| number as i32;
        IndexPlane { normal: normal.map(whole), least: whole(least) }
    }

    /// Returns whether voxels at this place are drawn.
    #[inline(always)]
    pub(crate) fn shows(&self, voxel: [u16; 3]) -> bool {
        let [x, y, z] = [0, 1, 2].map(|a| i32::from(voxel[a]).wrapping_mul(self.normal[a]));
        x.wrapping_add(y).wrapping_add(z) >= self.least
    }

    /// Returns the corner of a box that lies farthest in front of the plane, or farthest behind it.
    #[inline(always)]
    fn corner(&self, bounds: &VoxelBox, in_front: bool) -> [u16; 3] {
        [0, 1, 2].map(|a| if (self.normal[a] >= 0) == in_front { bounds.high[a] } else { bounds.low[a] })
    }

    /// Narrows the range `ends` of a scan line along axis `fast` to what is drawn; no first index is above it.
    #[inline(always)]
    fn on_line(&self, fast: usize, mut voxel: [u16; 3], [low, high]: [u16; 2]) -> [u16; 2] {
        voxel[fast] = 0;
        let at_zero = (0..3).map(|a| i64::from(voxel[a]) * i64::from(self.normal[a])).sum::<i64>();
        // The line is drawn where at_zero + index * step >= least.
        let (need, step) = (i64::from(self.least) - at_zero, i64::from(self.normal[fast]));
        let ends = match step {
            0 if need <= 0 => [i64::from(low), i64::from(high)],
            0 => return [1, 0],
            step if step > 0 => [i64::from(low).max(-(-need).div_euclid(step)), i64::from(high)],
            step => [i64::from(low), i64::from(high).min((-need).div_euclid(-step))],
        };
        let [from, to] = ends.map(|end| u16::try_from(end.clamp(-1, 65_536)).ok());
        match (from, to) {
            (Some(from), Some(to)) if from <= to => [from, to],
            _ => [1, 0],
        }
    }
}
