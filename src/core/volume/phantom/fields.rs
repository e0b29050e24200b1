//! The phantoms' formulas, evaluated one row at a time.
//!
//! In: a position on the grid. Out: values from 0 to 255. Terms that depend on one or two indices are tabulated in
//! double precision, so that a sample costs a few single-precision operations.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::Phantom;
use super::vessels::vessels;
use crate::error::{Error, Result};

/// Lowest visible value of the shells: one voxel from a shell's middle.
pub(super) const SHELL_EDGE: f64 = 191.0;
/// Lowest and highest visible value of the gyroid's sheet: 3.2 % of the samples. Half-integers, so that all sample
/// types show the same voxels.
pub(super) const GYROID_SHEET: (f64, f64) = (117.5, 138.5);

/// A function on the grid: called with y, z and a row, it fills the row with the values at y and z, from 0 to 255.
pub(super) type Field = Box<dyn FnMut(u32, u32, &mut [f32]) + Send>;

/// Creates the function of `phantom` on a grid of `dims` points.
pub(super) fn field(phantom: &Phantom, dims: [u32; 3]) -> Result<Field> {
    Ok(match phantom {
        Phantom::Constant => Box::new(|_, _, row| row.fill(200.0)),
        Phantom::Shells => shells(dims),
        Phantom::Gyroid => gyroid(dims),
        Phantom::MarschnerLobb => marschner_lobb(dims),
        Phantom::Hydrogen => hydrogen(dims),
        Phantom::Vessels => vessels(dims),
        Phantom::Noise { visible } => noise(dims, *visible)?,
        Phantom::Corners => {
            let corner = |bits: u32| [0, 1, 2].map(|a| if bits >> a & 1 == 0 { 0 } else { dims[a] - 1 });
            single_voxels(dims, (0..8).map(corner).chain([dims.map(|points| points / 2)]).collect())?
        }
        Phantom::Voxels(places) => single_voxels(dims, places.clone())?,
    })
}

/// Returns 64 random bits, and moves `state` to the next (SplitMix64, Steele et al. 2014).
pub fn next_random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut bits = *state;
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Hashes `index` to 64 well-mixed bits.
pub(super) fn hash(index: u64) -> u64 {
    next_random(&mut index.wrapping_mul(0x9e37_79b9_7f4a_7c15))
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

/// Shells of radius k/6.5 of half the longest axis, k = 1..=6; values fall by 64 per voxel on either side.
fn shells(dims: [u32; 3]) -> Field {
    let apart = settled(longest(dims) / 13.0);
    let (first, per_shell) = (from_middle(0, dims[0]), 1.0 / apart);
    Box::new(move |y, z, row| {
        let (y, z) = (from_middle(y, dims[1]), from_middle(z, dims[2]));
        let beyond = z * z + y * y;
        for (x, value) in row.iter_mut().enumerate() {
            let x = first + x as f32;
            let radius = (x * x + beyond).sqrt();
            // Adding 1/2 and truncating is faster than round() without a rounding instruction.
            #[expect(clippy::cast_possible_truncation, reason = "a small number of shells")]
            let nearest = ((radius * per_shell + 0.5) as i32).clamp(1, 6) as f32;
            *value = (255.0 - 64.0 * (radius - nearest * apart).abs()).max(0.0);
        }
    })
}

/// sin x cos y + sin y cos z + sin z cos x, scaled so that the surface (zero) has the value 128.
fn gyroid(dims: [u32; 3]) -> Field {
    /// Phase on each axis, in radians; keeps grid rows off the surface's planes of symmetry.
    const PHASE: [f64; 3] = [0.4, 1.1, 2.3];
    let table = |wave: fn(f64) -> f64| -> [Vec<f32>; 3] {
        [0, 1, 2].map(|axis| {
            let angle = |at: u32| f64::from(at) * 4.0 * TAU / longest(dims) + PHASE[axis];
            (0..dims[axis]).map(|at| settled(wave(angle(at)))).collect()
        })
    };
    let (sin, cos) = (table(f64::sin), table(f64::cos));
    Box::new(move |y, z, row| {
        let [(sin_y, cos_y), (sin_z, cos_z)] =
            [(1, y as usize), (2, z as usize)].map(|(axis, at)| (sin[axis][at], cos[axis][at]));
        let fixed = sin_y * cos_z;
        for ((value, sin), cos) in row.iter_mut().zip(&sin[0]).zip(&cos[0]) {
            let height = sin * cos_y + fixed + sin_z * cos;
            *value = (128.0 + 210.0 * height).clamp(0.0, 255.0);
        }
    })
}

/// (1 - sin(pi z / 2) + a (1 + cos(2 pi f cos(pi r / 2)))) / (2 (1 + a)) with f = 6 and a = 1/4.
fn marschner_lobb(dims: [u32; 3]) -> Field {
    const FREQUENCY: f64 = 6.0;
    const RIPPLE: f64 = 0.25;
    const SCALE: f64 = 255.0 / (2.0 * (1.0 + RIPPLE));
    // The term that depends on x and y, for one slice; computed when the first row is asked for.
    let mut ripple: Vec<f32> = Vec::new();
    Box::new(move |y, z, row| {
        if ripple.is_empty() {
            let [width, height, _] = dims;
            ripple = (0..height)
                .flat_map(|y| (0..width).map(move |x| centred(x, width).hypot(centred(y, height))))
                .map(|r| 1.0 + (TAU * FREQUENCY * (FRAC_PI_2 * r).cos()).cos())
                .map(|wave| settled(SCALE * RIPPLE * wave))
                .collect();
        }
        let fixed = settled(SCALE * (1.0 - (PI / 2.0 * centred(z, dims[2])).sin()));
        let ripples = &ripple[y as usize * row.len()..];
        for (value, ripple) in row.iter_mut().zip(ripples) {
            *value = (fixed + ripple).min(255.0);
        }
    })
}

/// e^(-2r/3) (3 z^2 - r^2)^2 with r in Bohr radii, divided by its maximum.
fn hydrogen(dims: [u32; 3]) -> Field {
    const REACH: f64 = 22.0;
    let place = move |at: u32, axis: usize| f64::from(from_middle(at, dims[axis])) * 2.0 * REACH / longest(dims);
    // The maximum lies at (0, 0, 6): (2 * 36)^2 e^-4.
    let highest = 5184.0 * (-4.0f64).exp();
    Box::new(move |y, z, row| {
        let (y, z) = (place(y, 1), place(z, 2));
        for (x, value) in (0..).zip(row) {
            let x = place(x, 0);
            let squared = x * x + y * y + z * z;
            let lobe = 3.0 * z * z - squared;
            let density = (-2.0 / 3.0 * squared.sqrt()).exp() * lobe * lobe / highest;
            *value = settled(255.0 * density.min(1.0));
        }
    })
}

/// Values from 1 to 255 at a share `visible` of the points, 0 elsewhere.
fn noise(dims: [u32; 3], visible: f64) -> Result<Field> {
    if !(0.0..=1.0).contains(&visible) {
        return Err(Error::input("visible share of noise", format!("is {visible}, but must be from 0 to 1")));
    }
    // A sample is visible if the low 32 bits of its hash are below this.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 2^32")]
    let threshold = (visible * 4_294_967_296.0).round() as u64;
    Ok(Box::new(move |y, z, row| {
        let first = (u64::from(z) * u64::from(dims[1]) + u64::from(y)) * u64::from(dims[0]);
        for (index, value) in (first..).zip(row) {
            let bits = hash(index);
            let is_visible = bits & 0xffff_ffff < threshold;
            // 1..=255 with equal probability, within 2^-32.
            *value = if is_visible { (1 + (((bits >> 32) * 255) >> 32)) as f32 } else { 0.0 };
        }
    }))
}

/// Single bright voxels at `places`.
fn single_voxels(dims: [u32; 3], mut places: Vec<[u32; 3]>) -> Result<Field> {
    if let Some(outside) = places.iter().find(|place| (0..3).any(|a| place[a] >= dims[a])) {
        let why = format!("is outside the grid of {} x {} x {} points", dims[0], dims[1], dims[2]);
        return Err(Error::input(format!("voxel {outside:?}"), why));
    }
    places.sort_unstable_by_key(|[x, y, z]| [*z, *y, *x]);
    Ok(Box::new(move |y, z, row| {
        row.fill(0.0);
        let start = places.partition_point(|place| [place[2], place[1]] < [z, y]);
        for place in places[start..].iter().take_while(|place| [place[2], place[1]] == [z, y]) {
            row[place[0] as usize] = 255.0;
        }
    }))
}
