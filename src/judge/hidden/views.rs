//! Chooses the views that decide which voxels are hidden, and the views that measure how pictures change without them.
//!
//! In: the box of the visible voxels. Out: cameras outside it, each with a picture size and a kernel. No deciding view
//! is also a measuring view.

use std::f64::consts::PI;

use glam::DVec3;

use super::CLEARANCE;
use adjsplat::arena::layout::Facts;
use adjsplat::error::Result;
use adjsplat::internals::next_random;
use adjsplat::splat::{Camera, KernelShape, MAX_SIZE, Projection, Quality, Surround, WorldFrame};

/// The distance between the closest voxels, in pixels. Footprints of every kernel are then larger than the low-pass
/// filter, which would make more voxels show, yet small enough to be drawn fast.
const PIXELS_PER_VOXEL: f64 = 1.5;

/// The same distance at the far end of a perspective view: the least at which footprints exceed the low-pass filter.
const PIXELS_PER_FARTHEST: f64 = 1.2;

/// A view of the visible voxels: a camera, a picture size and a kernel.
#[derive(Debug, Clone, Copy)]
pub(super) struct CullingView {
    pub(super) camera: Camera,
    pub(super) size: [u32; 2],
    pub(super) kernel: KernelShape,
}

/// The box of the visible voxels, which the views look at.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewTarget {
    centre: DVec3,
    radius: f64,
    frame: WorldFrame,
    /// The smallest and the largest distance between neighbouring voxels, in world length.
    finest: f64,
    coarsest: f64,
    low: [u16; 3],
    high: [u16; 3],
}

impl ViewTarget {
    /// Creates the target from the box of voxels with indices `low` to `high`, inclusive.
    pub(super) fn new(facts: &Facts, (low, high): ([u16; 3], [u16; 3])) -> ViewTarget {
        let Surround { centre, radius } = Surround::of_voxels(&facts.grid, low, high);
        let coarsest = facts.grid.spacing.into_iter().fold(0.0, f64::max);
        ViewTarget {
            centre: DVec3::from_array(centre),
            // Footprints reach beyond the outermost voxels.
            radius: radius + 3.5 * coarsest,
            frame: WorldFrame::of(&facts.grid),
            finest: facts.grid.finest_spacing(),
            coarsest,
            low,
            high,
        }
    }

    /// Returns a parallel view of the whole target, along `direction`; no side of the picture exceeds `most` pixels.
    fn parallel(&self, direction: DVec3, kernel: KernelShape, most: u32) -> Result<CullingView> {
        let side = pixels(2.0 * self.radius / self.finest * PIXELS_PER_VOXEL, most);
        let eye = self.centre - direction * (2.0 * self.radius);
        let projection = Projection::Parallel { height: 2.0 * self.radius };
        let camera = Camera::new(eye.to_array(), self.centre.to_array(), any_up(direction), projection)?;
        Ok(CullingView { camera, size: [side; 2], kernel })
    }

    /// Returns a perspective view from `eye` to `target` with a vertical angle of `fov` degrees; no side exceeds `most`
    /// pixels.
    fn perspective(&self, eye: DVec3, target: DVec3, fov: f64, kernel: KernelShape, most: u32) -> Result<CullingView> {
        // Pixels are small enough for the far end of the target; nearer voxels are larger.
        let width = 2.0 * (fov.to_radians() / 2.0).tan() * (eye.distance(self.centre) + self.radius);
        let side = pixels(width / self.finest * PIXELS_PER_FARTHEST, most);
        let projection = Projection::Perspective { fov };
        let camera = Camera::new(eye.to_array(), target.to_array(), any_up(target - eye), projection)?;
        Ok(CullingView { camera, size: [side; 2], kernel })
    }

    /// Returns a perspective view of the whole target along `direction`; the eye is `away` radii from the centre.
    fn whole_volume(&self, direction: DVec3, away: f64, kernel: KernelShape, most: u32) -> Result<CullingView> {
        let fov = 2.0 * (1.0 / away).asin().to_degrees();
        self.perspective(self.centre - direction * (away * self.radius), self.centre, fov, kernel, most)
    }

    /// Returns a view to the centre from near a face of the box; `place` holds three fractions from 0 to 1 that place
    /// the eye.
    fn beside_face(&self, face: usize, place: [f64; 3], kernel: KernelShape, most: u32) -> Result<CullingView> {
        let axis = face / 2;
        let clear = CLEARANCE * self.coarsest / self.frame.steps[axis].length();
        let at = std::array::from_fn(|a| {
            let (low, high) = (f64::from(self.low[a]), f64::from(self.high[a]));
            match (a == axis, face % 2) {
                (true, 0) => low - clear,
                (true, _) => high + clear,
                _ => low + place[a] * (high - low),
            }
        });
        self.perspective(self.frame.world_from_voxel(at), self.centre, 60.0, kernel, most)
    }
}

fn pixels(needed: f64, most: u32) -> u32 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    let side = needed.ceil().clamp(16.0, f64::from(most)) as u32;
    side
}

/// Returns a vector at right angles to `direction`, as the camera's up; always the same for the same direction.
fn any_up(direction: DVec3) -> [f64; 3] {
    direction.any_orthogonal_vector().to_array()
}

/// Returns number `index` of `count` directions spread evenly over the sphere.
///
/// Source: Fibonacci sphere; Swinbank and Purser, "Fibonacci grids", 2006.
fn sphere_direction(index: u32, count: u32) -> DVec3 {
    let golden = PI * (5.0f64.sqrt() - 1.0);
    let z = 1.0 - (2.0 * f64::from(index) + 1.0) / f64::from(count);
    let across = (1.0 - z * z).sqrt();
    let (sin, cos) = (golden * f64::from(index)).sin_cos();
    DVec3::new(across * cos, across * sin, z)
}

/// Returns the 26 directions along axes and diagonals of the grid.
fn axes_and_diagonals(frame: &WorldFrame) -> impl Iterator<Item = DVec3> + '_ {
    let signs = |n: i32| [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
    (0..27).filter(|&n| n != 13).map(move |n| {
        let [x, y, z] = signs(n).map(f64::from);
        (frame.steps[0] * x + frame.steps[1] * y + frame.steps[2] * z).normalize()
    })
}

/// Returns the kernels of views: that of `standard` and `high`, that of `draft`, and the shortest of all, of faint voxels.
fn kernels() -> [KernelShape; 3] {
    let [standard, draft] = [Quality::Standard, Quality::Draft].map(Quality::kernel);
    [standard, draft, draft.of_depth(0.0)]
}

/// Returns the deciding views: along all axes and diagonals with every kernel, then `count` all around, then some near
/// faces.
pub(super) fn deciding(target: &ViewTarget, count: u32) -> Result<Vec<CullingView>> {
    let mut views = Vec::new();
    for direction in axes_and_diagonals(&target.frame) {
        for kernel in kernels() {
            views.push(target.parallel(direction, kernel, MAX_SIZE)?);
        }
    }
    let mut random = RandomNumbers(1);
    for index in 0..count {
        let direction = sphere_direction(index, count);
        // Neighbours on the sphere are a Fibonacci number of indices apart: kernels alternate among them too.
        let kernel = kernels()[(index % 4).saturating_sub(1) as usize];
        views.push(match index % 5 {
            3 => target.whole_volume(direction, 1.0 + random.number() * 3.0 + 0.15, kernel, MAX_SIZE)?,
            _ => target.parallel(direction, kernel, MAX_SIZE)?,
        });
    }
    for face in 0..6 {
        for _ in 0..(count / 60).max(1) {
            let place = [random.number(), random.number(), random.number()];
            views.push(target.beside_face(face, place, Quality::Standard.kernel(), MAX_SIZE)?);
        }
    }
    Ok(views)
}

/// The longest side of a measuring view's picture, in pixels: two pictures are in memory at once.
pub(super) const JUDGING_SIDE: u32 = 1_536;

/// Returns the measuring views of a round: perspective views along all axes and diagonals, and `count` random ones.
pub(super) fn judging(target: &ViewTarget, count: u32, round: u32) -> Result<Vec<CullingView>> {
    let mut random = RandomNumbers(0x9e37_79b9 + u64::from(round));
    let mut views = Vec::new();
    for direction in axes_and_diagonals(&target.frame) {
        let kernel = Quality::Standard.kernel();
        views.push(target.whole_volume(direction, 1.3 + f64::from(round), kernel, JUDGING_SIDE)?);
    }
    for index in 0..count {
        let z = 2.0 * random.number() - 1.0;
        let (sin, cos) = (2.0 * PI * random.number()).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let direction = DVec3::new(across * cos, across * sin, z);
        let kernel = kernels()[(index % 4).saturating_sub(1) as usize];
        views.push(match index % 6 {
            0..=2 => target.parallel(direction, kernel, JUDGING_SIDE)?,
            3 | 4 => target.whole_volume(direction, 1.15 + 3.0 * random.number(), kernel, JUDGING_SIDE)?,
            _ => {
                let place = [random.number(), random.number(), random.number()];
                target.beside_face((index / 6 % 6) as usize, place, kernel, JUDGING_SIDE)?
            }
        });
    }
    Ok(views)
}

/// Generates random numbers from 0 to 1, the same on every machine.
///
/// Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014 (SplitMix64).
struct RandomNumbers(u64);

impl RandomNumbers {
    fn number(&mut self) -> f64 {
        (next_random(&mut self.0) >> 11) as f64 / (1u64 << 53) as f64
    }
}
