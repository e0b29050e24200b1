//! The ray judge: the emission-absorption integral itself.
//!
//! In: visible voxels, a camera, [`Settings`]. Out: a [`Picture`]. The field that splats stand for is a sum of Gaussians,
//! each voxel's extinction and its colour times extinction around its place, so that in index space
//!
//! ```text
//! extinction(x) = sum of depth_i g(x - i)               g: Gaussian of sigma spacings, whose integral is 1
//! emission(x)   = sum of depth_i colour_i g(x - i)
//! d colour / dt = emission exp(-d),   d depth / dt = extinction      along each pixel's ray, from the eye
//! ```
//!
//! Along a ray each of them is a Gaussian of t with known place, width and size, so a ray gathers them once, from the
//! cells that it passes, and what is left is an initial value problem: solved by Dormand and Prince's pair of fourth and
//! fifth order with steps no longer than a standard deviation, whose local errors add up to the tolerance at most. Nothing
//! is projected, no splat is put before another, no low-pass is applied: pixels are points.
//!
//! Source: Dormand and Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6, 1980.

use glam::DVec3;

use super::light::Lights;
use super::picture::Picture;
use super::voxels::VisibleVoxels;
use adjsplat::error::{Error, Result};
use adjsplat::splat::camera::WorldFrame;
use adjsplat::splat::view::PixelMap;
use adjsplat::splat::{Camera, Lighting, Quality, View};

/// Voxels along an edge of a cell.
const CELL: u16 = 4;
/// Where kernels end, in standard deviations: `e^-18` is 1.5e-8.
const REACH: f64 = 6.0;

/// How the judge integrates.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Columns and rows, each 1 to 16,384.
    pub size: [u32; 2],
    /// Standard deviation of the kernel, in voxel spacings; above 0.
    pub sigma: f64,
    /// Largest error of a sample from the integral, of a full scale of 1; 1e-12 to 1e-2.
    pub tolerance: f64,
    /// Lighting of voxels that have a normal; `None` for none.
    pub lighting: Option<Lighting>,
    /// World distance along the view axis below which voxels are not there; `None` as for the splat judge.
    pub near: Option<f64>,
    /// Threads, at least 1. The picture does not depend on it.
    pub threads: usize,
}

impl Settings {
    /// The kernel of [`Quality::Reference`] with lighting, to 1e-7.
    pub fn new(size: [u32; 2]) -> Settings {
        let sigma = f64::from(Quality::Reference.kernel().sigma);
        Settings { size, sigma, tolerance: 1e-7, lighting: Some(Lighting::default()), near: None, threads: 1 }
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

/// The ray judge of some voxels. Made for small scenes: a ray costs about a microsecond a voxel near it.
#[derive(Debug)]
pub struct Judge<'a> {
    visible: &'a VisibleVoxels,
    cells: Vec<Cell>,
    /// Indices of voxels, cell by cell.
    members: Vec<u32>,
}

/// Some voxels that lie together.
#[derive(Debug)]
struct Cell {
    /// Its middle, in index space.
    centre: DVec3,
    members: std::ops::Range<usize>,
}

impl<'a> Judge<'a> {
    /// The judge of `visible`.
    pub fn new(visible: &'a VisibleVoxels) -> Judge<'a> {
        let voxels = visible.voxels();
        let cell_of = |at: u32| voxels[at as usize].position.map(|c| c / CELL);
        let count = u32::try_from(voxels.len()).expect("voxels are fewer than 2^32");
        let mut members: Vec<u32> = (0..count).collect();
        members.sort_by_key(|&at| cell_of(at));
        let mut cells = Vec::new();
        let mut first = 0;
        for group in members.chunk_by(|&a, &b| cell_of(a) == cell_of(b)) {
            let half = f64::from(CELL - 1) / 2.0;
            let corner = DVec3::from_array(cell_of(group[0]).map(|c| f64::from(c * CELL)));
            cells.push(Cell { centre: corner + half, members: first..first + group.len() });
            first += group.len();
        }
        Judge { visible, cells, members }
    }

    /// What `camera` sees.
    ///
    /// # Errors
    /// [`Error::Input`] if a setting is out of its range; [`Error::OutOfMemory`].
    pub fn draw(&self, camera: &Camera, settings: &Settings) -> Result<Picture> {
        settings.check()?;
        let view = View::new(camera, self.visible.grid(), settings.size, Quality::Reference.kernel(), settings.near)?;
        let rays = Rays::new(camera, &view, WorldFrame::of(self.visible.grid()));
        let colours = self.colours(&view, settings);
        let mut picture = Picture::filled(settings.size, [0.0; 4])?;
        let columns = settings.size[0] as usize;
        let next_row = std::sync::Mutex::new(picture.pixels_mut().chunks_mut(columns).enumerate());
        std::thread::scope(|scope| {
            for _ in 0..settings.threads {
                scope.spawn(|| {
                    let mut bumps = Vec::new();
                    loop {
                        let taken = next_row.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
                        let Some((row, pixels)) = taken else { return };
                        for (column, pixel) in pixels.iter_mut().enumerate() {
                            let ray = rays.through(column, row);
                            self.gather(&ray, &colours, settings.sigma, &mut bumps);
                            *pixel = integrate(&bumps, settings.sigma / ray.speed, ray.start, settings.tolerance);
                        }
                    }
                });
            }
        });
        Ok(picture)
    }

    /// Colours as this view sees them; black and no depth for voxels that are too near.
    fn colours(&self, view: &View, settings: &Settings) -> Vec<(f64, [f64; 3])> {
        let lights = settings.lighting.map(|lighting| Lights::new(lighting, view));
        let seen = |position: [u16; 3]| match &view.map {
            PixelMap::Parallel { .. } => true,
            PixelMap::Perspective { camera_from_voxel: [_, _, along], near, .. } => {
                let [x, y, z] = position.map(f64::from);
                along[0] * x + along[1] * y + along[2] * z + along[3] >= *near
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

    /// The kernels that a ray passes, by their places along it.
    fn gather(&self, ray: &Ray, colours: &[(f64, [f64; 3])], sigma: f64, bumps: &mut Vec<Bump>) {
        bumps.clear();
        let voxels = self.visible.voxels();
        let unit = ray.direction / ray.speed;
        let reach = REACH * sigma;
        let half_diagonal = f64::from(CELL - 1) / 2.0 * 3.0f64.sqrt();
        // Integral of a kernel along a line through its middle, per mean voxel.
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
                bumps.push(Bump { at: place.dot(unit) / ray.speed, amount, emission: colour.map(|c| c * amount) });
            }
        }
        bumps.sort_unstable_by(|a, b| a.at.total_cmp(&b.at));
    }
}

/// A voxel's kernel along a ray.
#[derive(Debug, Clone, Copy)]
struct Bump {
    /// Where it is highest, in mean voxels along the ray.
    at: f64,
    /// Its optical depth in all.
    amount: f64,
    /// Colour times that.
    emission: [f64; 3],
}

/// A ray in index space: `origin + t * direction`, t in mean voxels.
struct Ray {
    origin: DVec3,
    direction: DVec3,
    /// Length of `direction`.
    speed: f64,
    /// Where the integral starts.
    start: f64,
}

/// The rays of a picture's pixels.
struct Rays {
    world: WorldFrame,
    map: PixelMap,
    /// To the right, up, along the view; of a mean voxel's length.
    axes: [DVec3; 3],
    /// In world space, from the grid's origin.
    eye: DVec3,
    centre: [f64; 2],
}

impl Rays {
    fn new(camera: &Camera, view: &View, world: WorldFrame) -> Rays {
        let axes = camera.axes().map(|axis| axis * view.mean_voxel);
        let eye = DVec3::from_array(camera.position()) - world.origin;
        let centre = view.size.map(|side| (f64::from(side) - 1.0) / 2.0);
        Rays { world, map: view.map, axes, eye, centre }
    }

    fn through(&self, column: usize, row: usize) -> Ray {
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

/// Optical depth, then red, green and blue.
type State = [f64; 4];

/// Weights of Dormand and Prince's stages.
const STAGES: [&[f64]; 6] = [
    &[1.0 / 5.0],
    &[3.0 / 40.0, 9.0 / 40.0],
    &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
    &[19_372.0 / 6_561.0, -25_360.0 / 2_187.0, 64_448.0 / 6_561.0, -212.0 / 729.0],
    &[9_017.0 / 3_168.0, -355.0 / 33.0, 46_732.0 / 5_247.0, 49.0 / 176.0, -5_103.0 / 18_656.0],
    &[35.0 / 384.0, 0.0, 500.0 / 1_113.0, 125.0 / 192.0, -2_187.0 / 6_784.0, 11.0 / 84.0],
];
/// Where the stages are, of a step.
const PLACES: [f64; 6] = [1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
/// Fifth order less fourth.
const DIFFERENCE: [f64; 7] =
    [71.0 / 57_600.0, 0.0, -71.0 / 16_695.0, 71.0 / 1_920.0, -17_253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];

/// The pixel of a ray past `bumps`, all `width` wide (standard deviation, mean voxels), from `start` on.
fn integrate(bumps: &[Bump], width: f64, start: f64, tolerance: f64) -> [f64; 4] {
    let (Some(first), Some(last)) = (bumps.first(), bumps.last()) else { return [0.0; 4] };
    let reach = REACH * width;
    let (mut t, end) = (start.max(first.at - reach), last.at + reach);
    if t >= end {
        return [0.0; 4];
    }
    // Errors of steps in proportion to their lengths add up to the tolerance.
    let per_length = tolerance / (end - t);
    let field = Field { bumps, width, density: 1.0 / ((2.0 * std::f64::consts::PI).sqrt() * width) };
    let mut state: State = [0.0; 4];
    let mut slopes = [[0.0; 4]; 7];
    slopes[0] = field.slope(t, state);
    let mut step = width / 4.0;
    // A pixel behind whose transmittance less than the tolerance is left does not change by more.
    while t < end && state[0] < -(tolerance * 0.1).ln() {
        step = step.min(end - t);
        let mut ahead = state;
        for (stage, weights) in STAGES.iter().enumerate() {
            ahead = state;
            for (weight, slope) in weights.iter().zip(&slopes) {
                (0..4).for_each(|c| ahead[c] += step * weight * slope[c]);
            }
            slopes[stage + 1] = field.slope(t + PLACES[stage] * step, ahead);
        }
        let error_of = |c: usize| DIFFERENCE.iter().zip(&slopes).map(|(d, slope)| step * d * slope[c]).sum::<f64>();
        // An error of optical depth counts by what it changes behind it.
        let dimmed = (-state[0]).exp();
        let error = (0..4).map(|c| error_of(c).abs() * if c == 0 { dimmed } else { 1.0 }).fold(0.0, f64::max);
        let share = error / (per_length * step);
        if share <= 1.0 || step < 1e-9 * width {
            t += step;
            state = ahead;
            slopes[0] = slopes[6];
        }
        let factor = if share > 0.0 { 0.9 * share.powf(-0.25) } else { 5.0 };
        step = (step * factor.clamp(0.2, 5.0)).min(width);
    }
    [state[1], state[2], state[3], -(-state[0]).exp_m1()]
}

/// What a ray passes.
struct Field<'a> {
    bumps: &'a [Bump],
    width: f64,
    /// Of a Gaussian of integral 1 at its middle.
    density: f64,
}

impl Field<'_> {
    fn slope(&self, t: f64, state: State) -> State {
        let reach = REACH * self.width;
        let from = self.bumps.partition_point(|bump| bump.at < t - reach);
        let mut sums = [0.0; 4];
        for bump in self.bumps[from..].iter().take_while(|bump| bump.at <= t + reach) {
            let apart = (t - bump.at) / self.width;
            let weight = (-0.5 * apart * apart).exp();
            sums[0] += weight * bump.amount;
            (0..3).for_each(|c| sums[c + 1] += weight * bump.emission[c]);
        }
        let dimmed = (-state[0]).exp() * self.density;
        [sums[0] * self.density, sums[1] * dimmed, sums[2] * dimmed, sums[3] * dimmed]
    }
}
