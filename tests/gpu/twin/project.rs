//! Twin of `shaders/project.wgsl`: from voxels and their channels to splats.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the device's conversions: single precision, and the nearest number that there is"
)]

use super::{EMPTY, REACH, element};
use adjsplat::internals::LOW_PASS;
use adjsplat::splat::gpu::layout::{NO_RECORD, NOTHING, Row, Shot, Splat, Voxel};

/// Beyond this a pixel is not told from others so far away.
const FAR: f32 = 5.0e8;
/// What a pixel may lie outside a footprint's box.
const NEARLY_HALF: f32 = 0.4999;

/// What the stage reads of a slab and of the tables, as words.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Channels<'a> {
    /// Value codes.
    pub(crate) values: &'a [u32],
    /// Normal codes.
    pub(crate) normals: &'a [u32],
    /// Magnitude codes.
    pub(crate) magnitudes: &'a [u32],
    /// By value code: colour, and optical depth or normalised value.
    pub(crate) looks: &'a [[f32; 4]],
    /// By value code and magnitude code: optical depth.
    pub(crate) depths: &'a [f32],
}

#[derive(Clone, Copy)]
struct Place {
    nearest: i32,
    rest: f32,
    is_near: bool,
}

struct Print {
    across: f32,
    along: f32,
    shear: f32,
    half: [f32; 2],
    density: f32,
}

/// Makes a splat of each voxel; gives how many are drawn.
///
/// # Panics
/// If a value has no look.
pub(crate) fn project(shot: &Shot, voxels: &[Voxel], channels: &Channels, splats: &mut [Splat]) -> u32 {
    let mut drawn = 0;
    for (voxel, splat) in voxels.iter().zip(splats) {
        *splat = if voxel.record == NO_RECORD { EMPTY } else { splat_of(shot, voxel, channels) };
        drawn += u32::from(splat.columns != NOTHING);
    }
    drawn
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn leftover(row: &Row, at: [f32; 3]) -> f32 {
    row.rest[0] * at[0] + row.rest[1] * at[1] + row.rest[2] * at[2] + row.rest[3]
}

fn whole_sum(row: &Row, at: [i32; 3]) -> i32 {
    let product = |a: usize| row.whole[a].wrapping_mul(at[a]);
    product(0).wrapping_add(product(1)).wrapping_add(product(2)).wrapping_add(row.whole[3])
}

fn unit(shift: i32) -> f32 {
    (-shift as f32).exp2()
}

fn place(row: &Row, shift: i32, xyz: [u32; 3]) -> Place {
    let at = xyz.map(|c| c as f32);
    let sum = whole_sum(row, xyz.map(u32::cast_signed));
    let (mut nearest, mut rest) = (sum, 0.0);
    if shift > 0 {
        nearest = sum.wrapping_add(1 << (shift - 1)) >> shift;
        rest = sum.wrapping_sub(nearest << shift) as f32 * unit(shift);
    }
    rest += leftover(row, at);
    let more = rest.round_ties_even();
    Place { nearest: nearest.wrapping_add(more as i32), rest: rest - more, is_near: rest.abs() < FAR }
}

fn coordinate(row: &Row, shift: i32, xyz: [u32; 3]) -> f32 {
    whole_sum(row, xyz.map(u32::cast_signed)) as f32 * unit(shift) + leftover(row, xyz.map(|c| c as f32))
}

fn nearest_pixel(at: f32) -> Place {
    let bounded = at.clamp(-FAR, FAR);
    let nearest = bounded.round_ties_even();
    Place { nearest: nearest as i32, rest: bounded - nearest, is_near: true }
}

fn footprint(shot: &Shot, x: [f32; 3], y: [f32; 3]) -> Print {
    let log2_e = std::f32::consts::LOG2_E;
    let square = shot.sigma * shot.sigma;
    let crossed = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let (mut xx, xy, mut yy) = (square * dot(x, x), square * dot(x, y), square * dot(y, y));
    let mut determinant = square * square * dot(crossed, crossed);
    let trace = xx + yy;
    let root = (trace * trace - 4.0 * determinant).max(0.0).sqrt();
    let narrowest = 2.0 * determinant / (trace + root).max(f32::MIN_POSITIVE);
    let added = (LOW_PASS * LOW_PASS - narrowest).max(0.0);
    xx += added;
    yy += added;
    determinant = (determinant + added * (trace + added)).max(f32::MIN_POSITIVE);
    Print {
        across: 0.5 * log2_e * (yy / determinant),
        along: 0.5 * log2_e / yy,
        shear: xy / yy,
        half: [xx, yy].map(|variance| (shot.cut_off * variance.sqrt()).min(REACH)),
        density: 1.0 / determinant.sqrt(),
    }
}

fn signed(word: u32, bits: u32) -> f32 {
    let shift = 32 - bits;
    let largest = ((1u32 << (bits - 1)) - 1) as f32;
    ((((word << shift).cast_signed()) >> shift) as f32).max(-largest)
}

fn normal_of(shot: &Shot, channels: &Channels, record: u32) -> [f32; 3] {
    let bits = shot.normal_bits;
    let (code, none) = match bits {
        8 => (element(channels.normals, record, 16), 0x8080),
        _ => (element(channels.normals, record, 32), 0x8000_8000),
    };
    let (u, v) = (signed(code, bits), signed(code >> bits, bits));
    let z = ((1u32 << (bits - 1)) - 1) as f32 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    let x = u - if u < 0.0 { -fold } else { fold };
    let y = v - if v < 0.0 { -fold } else { fold };
    let factor = if code == none { 0.0 } else { 1.0 } / (x * x + y * y + z * z).sqrt();
    [x * factor, y * factor, z * factor]
}

/// Factor on the colour, highlight.
fn shade(shot: &Shot, normal: [f32; 3], eye: [f32; 3]) -> [f32; 2] {
    if dot(normal, normal) <= 0.5 {
        return [1.0, 0.0];
    }
    let light = [shot.light[0], shot.light[1], shot.light[2]];
    let between = [light[0] + eye[0], light[1] + eye[1], light[2] + eye[2]];
    let lit = dot(normal, light).abs();
    let glance = (dot(normal, between) / dot(between, between).max(1.0e-12).sqrt()).abs();
    let (mut power, mut square, mut bits) = (1.0, glance, shot.shininess);
    while bits != 0 {
        if bits & 1 == 1 {
            power *= square;
        }
        square *= square;
        bits >>= 1;
    }
    [shot.weights[0] + shot.weights[1] * lit, shot.weights[2] * power]
}

fn look_of(shot: &Shot, channels: &Channels, record: u32) -> [f32; 4] {
    let value = element(channels.values, record, shot.value_bits);
    let mut look = channels.looks[value as usize];
    if shot.by_magnitude == 1 {
        let magnitude = element(channels.magnitudes, record, 8);
        look[3] = channels.depths[(value << 8 | magnitude) as usize];
    }
    look
}

/// First and last pixel within `half` of a place, of those in `low ..= high`.
fn span(at: Place, half: f32, low: i32, high: i32) -> [i32; 2] {
    let first = at.nearest.wrapping_add((at.rest - half + NEARLY_HALF).round_ties_even() as i32);
    let last = at.nearest.wrapping_add((at.rest + half - NEARLY_HALF).round_ties_even() as i32);
    [first.max(low), last.min(high)]
}

fn splat_of(shot: &Shot, voxel: &Voxel, channels: &Channels) -> Splat {
    let xyz = [voxel.xy & 0xffff, voxel.xy >> 16, voxel.z];
    if (0..3).any(|a| xyz[a] < shot.crop_low[a] || xyz[a] > shot.crop_high[a]) {
        return EMPTY;
    }
    let mut strength = shot.ellipse[3];
    let (x, y, print);
    if shot.perspective == 0 {
        x = place(&shot.rows[0], shot.shift[0], xyz);
        y = place(&shot.rows[1], shot.shift[1], xyz);
        let [across, along, shear, _] = shot.ellipse;
        print = Print { across, along, shear, half: shot.half, density: 1.0 };
    } else {
        let distance = coordinate(&shot.rows[2], shot.shift[2], xyz);
        if distance < shot.near || distance.is_nan() {
            return EMPTY;
        }
        let closeness = 1.0 / distance;
        let tx = coordinate(&shot.rows[0], shot.shift[0], xyz) * closeness;
        let ty = coordinate(&shot.rows[1], shot.shift[1], xyz) * closeness;
        x = nearest_pixel(shot.centre[0] + shot.focal * tx);
        y = nearest_pixel(shot.centre[1] - shot.focal * ty);
        let scale = shot.focal * closeness;
        let across = shot.steps.map(|step| scale * (step[0] - tx * step[2]));
        let down = shot.steps.map(|step| scale * (ty * step[2] - step[1]));
        print = footprint(shot, across, down);
        strength *= print.density * (1.0 + tx * tx + ty * ty).sqrt() * (closeness * closeness);
    }
    let [x0, y0, x1, y1] = shot.window;
    let columns = span(x, print.half[0], x0, x1 - 1);
    let rows = span(y, print.half[1], 0, shot.picture_rows.cast_signed() - 1);
    let is_off = !x.is_near || !y.is_near || columns[0] > columns[1] || rows[0] > rows[1];
    let is_in_window = rows[0] < y1 && rows[1] >= y0;
    if is_off || !is_in_window || strength <= 0.0 || strength.is_nan() {
        return EMPTY;
    }
    let [red, green, blue, depth] = look_of(shot, channels, voxel.record);
    let peak = if shot.maximum == 1 { depth } else { (depth * strength).min(shot.most) };
    if peak <= 0.0 || peak.is_nan() {
        return EMPTY;
    }
    let mut ink = [red, green, blue];
    if shot.shininess > 0 {
        let mut toward = [shot.eye[0], shot.eye[1], shot.eye[2]];
        if shot.perspective == 1 {
            let sight: [f32; 3] = std::array::from_fn(|a| shot.eye[a] - xyz[a] as f32 * shot.steps[a][3]);
            let length = dot(sight, sight).max(f32::MIN_POSITIVE).sqrt();
            toward = sight.map(|c| c / length);
        }
        let [factor, highlight] = shade(shot, normal_of(shot, channels, voxel.record), toward);
        ink = ink.map(|c| c * factor + highlight);
    }
    Splat {
        columns: columns[0] as u32 | (columns[1] as u32) << 16,
        rows: rows[0] as u32 | (rows[1] as u32) << 16,
        corner_x: (columns[0] - x.nearest) as f32 - x.rest,
        corner_y: (rows[0] - y.nearest) as f32 - y.rest,
        across: print.across,
        along: print.along,
        shear: print.shear,
        peak,
        red: ink[0],
        green: ink[1],
        blue: ink[2],
    }
}
