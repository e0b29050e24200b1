//! The phantoms' formulas, evaluated one row at a time.
//!
//! In: a position on the grid. Out: values from 0 to 255. Terms that depend on one or two indices are tabulated in
//! double precision, so that a sample costs a few single-precision operations.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::Phantom;
use super::vessels::Vessels;
use crate::error::{Error, Result};
use crate::volume::Grid;

/// Lowest visible value of the shells: one voxel from a shell's middle.
pub(super) const SHELL_EDGE: f64 = 191.0;
/// Lowest and highest visible value of the gyroid's sheet: 3.2 % of the samples. Half-integers, so that all sample
/// types show the same voxels.
pub(super) const GYROID_SHEET: (f64, f64) = (117.5, 138.5);

/// A function on the grid that is evaluated row by row.
pub(super) trait PhantomField: Send {
    /// Fills `row` with the values of row `y` in slice `z`, from 0 to 255.
    fn row(&mut self, y: u32, z: u32, row: &mut [f32]);
}

/// Creates the function of `phantom` on `grid`.
pub(super) fn field(phantom: &Phantom, grid: &Grid) -> Result<Box<dyn PhantomField>> {
    let dims = grid.dims;
    Ok(match phantom {
        Phantom::Constant => Box::new(Constant),
        Phantom::Shells => Box::new(Shells::new(dims)),
        Phantom::Gyroid => Box::new(Gyroid::new(dims)),
        Phantom::MarschnerLobb => Box::new(MarschnerLobb::new(dims)),
        Phantom::Hydrogen => Box::new(Hydrogen::new(dims)),
        Phantom::Vessels => Box::new(Vessels::new(dims)),
        Phantom::Noise { visible } => Box::new(Noise::new(dims, *visible)?),
        Phantom::Corners => {
            let corner = |bits: u32| [0, 1, 2].map(|a| if bits >> a & 1 == 0 { 0 } else { dims[a] - 1 });
            let places = (0..8).map(corner).chain([dims.map(|points| points / 2)]).collect();
            Box::new(SingleVoxels::new(dims, places)?)
        }
        Phantom::Voxels(places) => Box::new(SingleVoxels::new(dims, places.clone())?),
    })
}

/// Hashes `index` to 64 well-mixed bits (the finaliser of SplitMix64, Steele et al. 2014).
pub(super) fn hash(index: u64) -> u64 {
    let mut bits = index.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Rounds to a multiple of 2^-20, so that the last digit of a sine, which differs between platforms, has no effect.
#[expect(clippy::cast_possible_truncation, reason = "a multiple of 2^-20, at most a few")]
fn settled(number: f64) -> f32 {
    ((number * 1_048_576.0).round() / 1_048_576.0) as f32
}

/// Maps index `at` to -1..=1 along an axis of `points`; 0 for a single point.
fn centred(at: u32, points: u32) -> f64 {
    if points == 1 { 0.0 } else { f64::from(at) * 2.0 / f64::from(points - 1) - 1.0 }
}

/// Returns the distance of index `at` from the axis' middle, in voxels; exact.
#[expect(clippy::cast_possible_truncation, reason = "a multiple of 1/2 below 2^16")]
fn from_middle(at: u32, points: u32) -> f32 {
    (f64::from(at) - f64::from(points - 1) / 2.0) as f32
}

fn longest(dims: [u32; 3]) -> f64 {
    f64::from(dims[0].max(dims[1]).max(dims[2]))
}

struct Constant;

impl PhantomField for Constant {
    fn row(&mut self, _y: u32, _z: u32, row: &mut [f32]) {
        row.fill(200.0);
    }
}

/// Shells of radius k/6.5 of half the longest axis, k = 1..=6; values fall by 64 per voxel on either side.
struct Shells {
    dims: [u32; 3],
    apart: f32,
}

impl Shells {
    fn new(dims: [u32; 3]) -> Shells {
        Shells { dims, apart: settled(longest(dims) / 13.0) }
    }
}

impl PhantomField for Shells {
    fn row(&mut self, y: u32, z: u32, row: &mut [f32]) {
        let (y, z) = (from_middle(y, self.dims[1]), from_middle(z, self.dims[2]));
        let beyond = z * z + y * y;
        let (first, per_shell) = (from_middle(0, self.dims[0]), 1.0 / self.apart);
        for (x, value) in row.iter_mut().enumerate() {
            let x = first + x as f32;
            let radius = (x * x + beyond).sqrt();
            // Adding 1/2 and truncating is faster than round() without a rounding instruction.
            #[expect(clippy::cast_possible_truncation, reason = "a small number of shells")]
            let nearest = ((radius * per_shell + 0.5) as i32).clamp(1, 6) as f32;
            *value = (255.0 - 64.0 * (radius - nearest * self.apart).abs()).max(0.0);
        }
    }
}

/// sin x cos y + sin y cos z + sin z cos x, scaled so that the surface (zero) has the value 128.
struct Gyroid {
    sin: [Vec<f32>; 3],
    cos: [Vec<f32>; 3],
}

impl Gyroid {
    /// Phase on each axis, in radians; keeps grid rows off the surface's planes of symmetry.
    const PHASE: [f64; 3] = [0.4, 1.1, 2.3];

    fn new(dims: [u32; 3]) -> Gyroid {
        let table = |wave: fn(f64) -> f64| {
            [0, 1, 2].map(|axis| {
                let angle = |at: u32| f64::from(at) * 4.0 * TAU / longest(dims) + Gyroid::PHASE[axis];
                (0..dims[axis]).map(|at| settled(wave(angle(at)))).collect()
            })
        };
        Gyroid { sin: table(f64::sin), cos: table(f64::cos) }
    }
}

impl PhantomField for Gyroid {
    fn row(&mut self, y: u32, z: u32, row: &mut [f32]) {
        let [(sin_y, cos_y), (sin_z, cos_z)] =
            [(1, y as usize), (2, z as usize)].map(|(axis, at)| (self.sin[axis][at], self.cos[axis][at]));
        let fixed = sin_y * cos_z;
        for ((value, sin), cos) in row.iter_mut().zip(&self.sin[0]).zip(&self.cos[0]) {
            let height = sin * cos_y + fixed + sin_z * cos;
            *value = (128.0 + 210.0 * height).clamp(0.0, 255.0);
        }
    }
}

/// (1 - sin(pi z / 2) + a (1 + cos(2 pi f cos(pi r / 2)))) / (2 (1 + a)) with f = 6 and a = 1/4.
struct MarschnerLobb {
    dims: [u32; 3],
    /// The term that depends on x and y, for one slice.
    ripple: Vec<f32>,
}

impl MarschnerLobb {
    const FREQUENCY: f64 = 6.0;
    const RIPPLE: f64 = 0.25;
    const SCALE: f64 = 255.0 / (2.0 * (1.0 + Self::RIPPLE));

    fn new(dims: [u32; 3]) -> MarschnerLobb {
        MarschnerLobb { dims, ripple: Vec::new() }
    }
}

impl PhantomField for MarschnerLobb {
    fn row(&mut self, y: u32, z: u32, row: &mut [f32]) {
        if self.ripple.is_empty() {
            let [width, height, _] = self.dims;
            self.ripple = (0..height)
                .flat_map(|y| (0..width).map(move |x| centred(x, width).hypot(centred(y, height))))
                .map(|r| 1.0 + (TAU * Self::FREQUENCY * (FRAC_PI_2 * r).cos()).cos())
                .map(|wave| settled(Self::SCALE * Self::RIPPLE * wave))
                .collect();
        }
        let fixed = settled(Self::SCALE * (1.0 - (PI / 2.0 * centred(z, self.dims[2])).sin()));
        let ripples = &self.ripple[y as usize * row.len()..];
        for (value, ripple) in row.iter_mut().zip(ripples) {
            *value = (fixed + ripple).min(255.0);
        }
    }
}

/// e^(-2r/3) (3 z^2 - r^2)^2 with r in Bohr radii, divided by its maximum.
struct Hydrogen {
    dims: [u32; 3],
}

impl Hydrogen {
    const REACH: f64 = 22.0;

    fn new(dims: [u32; 3]) -> Hydrogen {
        Hydrogen { dims }
    }

    fn place(&self, at: u32, axis: usize) -> f64 {
        f64::from(from_middle(at, self.dims[axis])) * 2.0 * Self::REACH / longest(self.dims)
    }
}

impl PhantomField for Hydrogen {
    fn row(&mut self, y: u32, z: u32, row: &mut [f32]) {
        // The maximum lies at (0, 0, 6): (2 * 36)^2 e^-4.
        let highest = 5184.0 * (-4.0f64).exp();
        let (y, z) = (self.place(y, 1), self.place(z, 2));
        for (x, value) in (0..).zip(row) {
            let x = self.place(x, 0);
            let squared = x * x + y * y + z * z;
            let lobe = 3.0 * z * z - squared;
            let density = (-2.0 / 3.0 * squared.sqrt()).exp() * lobe * lobe / highest;
            *value = settled(255.0 * density.min(1.0));
        }
    }
}

struct Noise {
    dims: [u32; 3],
    /// A sample is visible if the low 32 bits of its hash are below this.
    threshold: u64,
}

impl Noise {
    fn new(dims: [u32; 3], visible: f64) -> Result<Noise> {
        if !(0.0..=1.0).contains(&visible) {
            return Err(Error::input("visible share of noise", format!("is {visible}, but must be from 0 to 1")));
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 2^32")]
        let threshold = (visible * 4_294_967_296.0).round() as u64;
        Ok(Noise { dims, threshold })
    }
}

impl PhantomField for Noise {
    fn row(&mut self, y: u32, z: u32, row: &mut [f32]) {
        let first = (u64::from(z) * u64::from(self.dims[1]) + u64::from(y)) * u64::from(self.dims[0]);
        for (index, value) in (first..).zip(row) {
            let bits = hash(index);
            let is_visible = bits & 0xffff_ffff < self.threshold;
            // 1..=255 with equal probability, within 2^-32.
            *value = if is_visible { (1 + (((bits >> 32) * 255) >> 32)) as f32 } else { 0.0 };
        }
    }
}

/// Single bright voxels, sorted by z, y, x.
struct SingleVoxels {
    places: Vec<[u32; 3]>,
}

impl SingleVoxels {
    fn new(dims: [u32; 3], mut places: Vec<[u32; 3]>) -> Result<SingleVoxels> {
        if let Some(outside) = places.iter().find(|place| (0..3).any(|a| place[a] >= dims[a])) {
            let why = format!("is outside the grid of {} x {} x {} points", dims[0], dims[1], dims[2]);
            return Err(Error::input(format!("voxel {outside:?}"), why));
        }
        places.sort_by_key(|[x, y, z]| [*z, *y, *x]);
        Ok(SingleVoxels { places })
    }
}

impl PhantomField for SingleVoxels {
    fn row(&mut self, y: u32, z: u32, row: &mut [f32]) {
        row.fill(0.0);
        let start = self.places.partition_point(|place| [place[2], place[1]] < [z, y]);
        for place in self.places[start..].iter().take_while(|place| [place[2], place[1]] == [z, y]) {
            row[place[0] as usize] = 255.0;
        }
    }
}
