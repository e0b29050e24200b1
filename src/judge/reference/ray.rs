//! The ray casting reference: it computes the emission-absorption integral itself.
//!
//! In: visible voxels, a camera, [`RaySettings`]. Out: a [`ReferencePicture`]. The integral is over the field that
//! splats approximate, a sum of Gaussians. In index space, with `g` a Gaussian of `sigma` spacings whose integral is 1:
//!
//! ```text
//! extinction(x) = sum of depth_i g(x - i)
//! emission(x)   = sum of depth_i colour_i g(x - i)
//! d colour / dt = emission exp(-d),   d depth / dt = extinction      along each pixel's ray, from the eye
//! ```
//!
//! Along a ray, each voxel's kernel is a Gaussian of t. A ray gathers these Gaussians from the cells of voxels that it
//! passes, and integrates them ([`super::integrate`]). Nothing is projected, sorted by depth or filtered: pixels are
//! points.

use glam::DVec3;

use super::integrate::{RayGaussian, integrate};
use super::light::ReferenceLights;
use super::picture::ReferencePicture;
use super::voxels::VisibleVoxels;
use adjsplat::error::{Error, Result};
use adjsplat::internals::PixelMap;
use adjsplat::splat::{Camera, Lighting, Quality, StopRequest, View, WorldFrame};

/// The number of voxels along an edge of a cell (a cube of voxels).
const CELL: u16 = 4;
/// The radius of a kernel, in standard deviations: there its value is `e^-18` = 1.5e-8 of the maximum.
pub(super) const REACH: f64 = 6.0;

/// The settings of a picture that [`RayJudge`] draws.
#[derive(Debug, Clone, PartialEq)]
pub struct RaySettings {
    /// The numbers of columns and rows of the picture, each 1 to 16,384.
    pub size: [u32; 2],
    /// The standard deviation of the Gaussian kernel, in voxel spacings; above 0.
    pub sigma: f64,
    /// The largest error of a sample whose full scale is 1; from 1e-12 to 1e-2.
    pub tolerance: f64,
    /// The lighting of voxels that have a normal; `None` draws plain colours.
    pub lighting: Option<Lighting>,
    /// The distance along the view axis below which voxels are not drawn, in world length; `None` draws all. In
    /// perspective the integral starts at the eye.
    pub near: Option<f64>,
    /// The number of threads, at least 1. The picture does not depend on it.
    pub threads: usize,
}

impl RaySettings {
    /// Returns settings with the kernel of [`Quality::Reference`], lighting and a tolerance of 1e-7.
    pub fn new(size: [u32; 2]) -> RaySettings {
        let sigma = f64::from(Quality::Reference.kernel().sigma);
        RaySettings { size, sigma, tolerance: 1e-7, lighting: Some(Lighting::default()), near: None, threads: 1 }
    }

    fn check(&self) -> Result<()> {
        if !(self.sigma.is_finite() && self.sigma > 0.0) {
            return Err(Error::input("kernel sigma", format!("is {}, but must be finite and above 0", self.sigma)));
        }
        if !(1e-12..=1e-2).contains(&self.tolerance) {
            return Err(Error::input("tolerance", format!("is {}, but must be 1e-12 to 1e-2", self.tolerance)));
        }
        if self.threads == 0 {
            return Err(Error::input("threads", "are 0, but must be at least 1"));
        }
        self.lighting.map_or(Ok(()), |lighting| lighting.check())
    }
}

/// A ray casting renderer for small scenes: a ray takes about a microsecond per voxel near it.
#[derive(Debug)]
pub struct RayJudge<'a> {
    visible: &'a VisibleVoxels,
    cells: Vec<VoxelCell>,
    /// The indices of the voxels, sorted by cell.
    members: Vec<u32>,
    stop: Option<&'a StopRequest>,
}

/// A cell: a small cube of neighbouring voxels.
#[derive(Debug)]
struct VoxelCell {
    /// The centre of the cell, in index space.
    centre: DVec3,
    members: std::ops::Range<usize>,
}

impl<'a> RayJudge<'a> {
    /// Creates a judge that casts rays through `visible`. It sorts the voxels into the cells of a coarse grid, so that a
    /// ray looks only at voxels near it.
    pub fn new(visible: &'a VisibleVoxels) -> RayJudge<'a> {
        let voxels = visible.voxels();
        let cell_of = |at: u32| voxels[at as usize].position.map(|c| c / CELL);
        let count = u32::try_from(voxels.len()).expect("voxels are fewer than 2^32");
        let mut members: Vec<u32> = (0..count).collect();
        members.sort_by_key(|&at| cell_of(at));
        let mut cells = Vec::new();
        let mut first = 0;
        for group in members.chunk_by(|&a, &b| cell_of(a) == cell_of(b)) {
            let half_width = f64::from(CELL - 1) / 2.0;
            let corner = DVec3::from_array(cell_of(group[0]).map(|c| f64::from(c * CELL)));
            cells.push(VoxelCell { centre: corner + half_width, members: first..first + group.len() });
            first += group.len();
        }
        RayJudge { visible, cells, members, stop: None }
    }

    /// Sets the request that ends drawing with [`Error::Interrupted`]; `None` for never.
    #[must_use]
    pub fn with_stop(self, stop: Option<&'a StopRequest>) -> RayJudge<'a> {
        RayJudge { stop, ..self }
    }

    /// Draws what `camera` sees.
    ///
    /// # Errors
    /// [`Error::Input`] if a setting is out of its range; [`Error::Limit`] if the memory cannot be had; [`Error::Interrupted`] if
    /// the [stop](RayJudge::with_stop) is requested.
    pub fn draw(&self, camera: &Camera, settings: &RaySettings) -> Result<ReferencePicture> {
        settings.check()?;
        let view = View::new(camera, self.visible.grid(), settings.size, Quality::Reference.kernel(), settings.near)?;
        let rays = Rays::new(camera, &view, WorldFrame::of(self.visible.grid()));
        let colours = self.colours(&view, settings);
        let mut picture = ReferencePicture::filled(settings.size, [0.0; 4])?;
        picture.draw(settings.threads, self.stop, |gaussians: &mut Vec<RayGaussian>, column, row| {
            let ray = rays.through(column, row);
            self.gather(&ray, &colours, settings.sigma, gaussians);
            integrate(gaussians, settings.sigma / ray.speed, ray.start, settings.tolerance)
        })?;
        Ok(picture)
    }

    /// Returns each voxel's optical depth (0 if the voxel is clipped) and its colour in this view.
    fn colours(&self, view: &View, settings: &RaySettings) -> Vec<(f64, [f64; 3])> {
        let lights = settings.lighting.map(|lighting| ReferenceLights::new(lighting, view));
        let seen = |position: [u16; 3]| match &view.map {
            PixelMap::Parallel { .. } => true,
            PixelMap::Perspective { camera_from_voxel: [_, _, along], .. } => {
                let [x, y, z] = position.map(f64::from);
                along[0] * x + along[1] * y + along[2] * z + along[3] >= view.clip
            }
        };
        let voxels = self.visible.voxels().iter();
        voxels
            .map(|voxel| {
                let colour = lights.map_or_else(|| voxel.colour.map(f64::from), |lights| lights.lit(voxel));
                (if seen(voxel.position) { voxel.depth } else { 0.0 }, colour)
            })
            .collect()
    }

    /// Fills `gaussians` with the kernels along a ray, sorted by their centres.
    fn gather(&self, ray: &Ray, colours: &[(f64, [f64; 3])], sigma: f64, gaussians: &mut Vec<RayGaussian>) {
        gaussians.clear();
        let voxels = self.visible.voxels();
        let unit = ray.direction / ray.speed;
        let reach = REACH * sigma;
        let half_diagonal = f64::from(CELL - 1) / 2.0 * 3.0f64.sqrt();
        // The integral of a kernel along a line through its centre, per mean spacing.
        let through = 1.0 / (std::f64::consts::TAU * sigma * sigma) / ray.speed;
        for cell in &self.cells {
            if (cell.centre - ray.origin).cross(unit).length() > reach + half_diagonal {
                continue;
            }
            for &at in &self.members[cell.members.clone()] {
                let place = DVec3::from_array(voxels[at as usize].position.map(f64::from)) - ray.origin;
                let aside = place.cross(unit).length_squared();
                let (depth, colour) = colours[at as usize];
                if aside > reach * reach || depth == 0.0 {
                    continue;
                }
                let amount = depth * through * (-0.5 * aside / (sigma * sigma)).exp();
                let centre = place.dot(unit) / ray.speed;
                gaussians.push(RayGaussian { centre, amount, emission: colour.map(|c| c * amount) });
            }
        }
        gaussians.sort_unstable_by(|a, b| a.centre.total_cmp(&b.centre));
    }
}

/// A ray in index space: `origin + t * direction`, t in mean spacings.
pub(super) struct Ray {
    pub(super) origin: DVec3,
    pub(super) direction: DVec3,
    /// The length of `direction`, in voxel spacings per mean spacing.
    speed: f64,
    /// The parameter t at which the integral starts, in mean spacings.
    start: f64,
}

/// The rays of the pixels of a picture.
pub(super) struct Rays {
    world: WorldFrame,
    map: PixelMap,
    /// The directions right, up and forward; each as long as the mean spacing.
    axes: [DVec3; 3],
    /// The position of the eye (of the target, in a parallel view) in world space, relative to the grid's origin.
    eye: DVec3,
    centre: [f64; 2],
}

impl Rays {
    pub(super) fn new(camera: &Camera, view: &View, world: WorldFrame) -> Rays {
        let axes = camera.axes().map(|axis| axis * view.mean_voxel);
        let eye = DVec3::from_array(camera.anchor()) - world.origin;
        let centre = view.size.map(|side| (f64::from(side) - 1.0) / 2.0);
        Rays { world, map: view.map, axes, eye, centre }
    }

    pub(super) fn through(&self, column: usize, row: usize) -> Ray {
        let [x, y] = [column as f64 - self.centre[0], self.centre[1] - row as f64];
        let [right, up, forward] = self.axes;
        let (origin, direction, start) = match self.map {
            PixelMap::Parallel { scale, .. } => {
                (self.eye + right * (x / scale) + up * (y / scale), forward, f64::NEG_INFINITY)
            }
            PixelMap::Perspective { focal, .. } => {
                let (x, y) = (x / focal, y / focal);
                let toward = (right * x + up * y + forward) / (1.0 + x * x + y * y).sqrt();
                (self.eye, toward, 0.0)
            }
        };
        let index = |vector| DVec3::from_array(self.world.voxel_from_world_vector(vector));
        let direction = index(direction);
        Ray { origin: index(origin), direction, speed: direction.length(), start }
    }
}
