//! Views in which a set is compared with the reference.
//!
//! In: a grid and a box of voxels. Out: cameras and picture sizes. Pictures are so large that the footprint of the
//! narrowest kernel is at least as wide as EWA's low-pass filter. So the filter does nothing, and all kernels have one
//! reference picture. One view has voxels finer than pixels, where the filter acts.

use adjsplat::error::Result;
use adjsplat::splat::{Camera, Orbit, Projection, Surround};
use adjsplat::volume::Grid;

/// A view, and how it is judged.
#[derive(Debug, Clone, PartialEq)]
pub struct JudgedView {
    /// The view's name in tables.
    pub name: &'static str,
    /// The view's camera.
    pub camera: Camera,
    /// Columns and rows of the view's picture.
    pub size: [u32; 2],
    /// Pixels from one to the next of the farthest voxels, along the axis of the smallest spacing, seen at a right
    /// angle.
    pub pixels_per_voxel: f64,
    /// Whether voxels are finer than pixels: the reference is then drawn on finer pixels and filtered by the low-pass.
    pub is_fine: bool,
}

/// Zoom in pixels per voxel. The narrowest sigma in use, 0.5 voxels, is then 0.62 pixels; the low-pass has 0.6.
const PIXELS: f64 = 1.25;
/// Zoom of close views in pixels per voxel: splats are wide, and pixels may be skipped.
const CLOSE: f64 = 3.0;
/// Longest side in pixels. Larger pictures are cropped to the middle, as comparing a pixel takes longer than drawing
/// it.
const LONGEST: u32 = 512;
/// Zoom of the view with voxels finer than pixels, in pixels per voxel.
const FINE: f64 = 0.6;

/// A view before the size of its picture is known.
struct ViewPlan {
    name: &'static str,
    azimuth: f64,
    elevation: f64,
    fov: Option<f64>,
    pixels: f64,
}

const PLANS: [ViewPlan; 8] = [
    ViewPlan { name: "along an axis", azimuth: 0.0, elevation: 0.0, fov: None, pixels: PIXELS },
    ViewPlan { name: "oblique", azimuth: 33.0, elevation: 21.0, fov: None, pixels: PIXELS },
    ViewPlan { name: "nearly along an axis", azimuth: 187.0, elevation: 4.0, fov: None, pixels: PIXELS },
    ViewPlan { name: "diagonal", azimuth: -44.0, elevation: 35.0, fov: None, pixels: PIXELS },
    ViewPlan { name: "close", azimuth: 120.0, elevation: -28.0, fov: None, pixels: CLOSE },
    ViewPlan { name: "perspective", azimuth: 33.0, elevation: 21.0, fov: Some(30.0), pixels: PIXELS },
    // In this view the nearest voxels appear ten times as large as the farthest.
    ViewPlan { name: "wide perspective", azimuth: -110.0, elevation: 15.0, fov: Some(75.0), pixels: 1.0 },
    ViewPlan { name: "fine voxels", azimuth: 33.0, elevation: 21.0, fov: None, pixels: FINE },
];

/// Returns the views of the voxels from `low` to `high`; if `quick`, only the oblique one.
///
/// # Errors
/// Any error of [`Camera::orbiting`].
pub fn views(grid: &Grid, low: [u16; 3], high: [u16; 3], quick: bool) -> Result<Vec<JudgedView>> {
    let around = Surround::of_voxels(grid, low, high);
    let plans = PLANS.iter().filter(|plan| !quick || plan.name == "oblique");
    plans.map(|plan| plan.view(grid, around)).collect()
}

impl ViewPlan {
    fn view(&self, grid: &Grid, around: Surround) -> Result<JudgedView> {
        let ViewPlan { name, azimuth, elevation, fov, pixels } = *self;
        let orbit = |zoom: f64| Orbit { azimuth, elevation, zoom, fov, ..Orbit::default() };
        let camera = Camera::orbiting(orbit(1.0), around, [1, 1])?;
        let closest = grid.finest_spacing();
        // This is the world length that the picture covers at the depth of the farthest voxels.
        let shown = match camera.projection() {
            Projection::Parallel { height } => height,
            Projection::Perspective { fov } => {
                let eye = camera.position();
                let apart = (0..3).map(|a| (eye[a] - around.centre[a]).powi(2)).sum::<f64>().sqrt();
                2.0 * (fov.to_radians() / 2.0).tan() * (apart + around.radius)
            }
        };
        // Close views show the middle. Their picture is as large as one that shows everything at [`PIXELS`].
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most a picture's longest side")]
        let side = (shown / closest * pixels.min(PIXELS)).ceil().clamp(1.0, f64::from(LONGEST)) as u32;
        let zoom = (pixels * shown / closest / f64::from(side)).max(1.0);
        let camera = Camera::orbiting(orbit(zoom), around, [side, side])?;
        let pixels_per_voxel = f64::from(side) / shown * closest * zoom;
        Ok(JudgedView { name, camera, size: [side; 2], pixels_per_voxel, is_fine: pixels < 1.0 })
    }
}
