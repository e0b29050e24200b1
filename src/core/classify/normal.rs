//! Unit normals in two or four bytes: octahedral encoding with the best of four roundings.
//!
//! In: a gradient. Out: a code for the unit vector opposite to it, so that normals of bright objects face outward. The
//! octahedron |x| + |y| + |z| = 1 is unfolded onto the square [-1, 1]^2; its coordinates u, v are signed fractions of
//! 127 or 32,767. Of the four codes around (u, v) the one nearest in angle is kept. The spare code, -128 or -32,768
//! for both, means "no normal". Bytes: u in the low half, v in the high half, little endian.
//!
//! Error: at most sqrt(2)/127 rad = 0.638 degrees for 2x8 bits, in the middle of an octant; sqrt(2)/32,767 = 0.00247
//! degrees for 2x16. Measured over 2 million random directions (tests/core/classify.rs), in degrees: for 2x8 bits the
//! mean is 0.315 and the largest 0.636; for 2x16 bits they are 0.00122 and 0.00245.
//!
//! Source: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2), 2014.
//! Departs from it: the four candidates are compared by the squared sine of their angle to the exact vector, from a
//! cross product with their small difference. This needs no root, and single precision is enough for both widths.

use glam::Vec4;

/// The code of 2x8 bits that means "no normal".
pub const NONE8: u16 = 0x8080;
/// The code of 2x16 bits that means "no normal".
pub const NONE16: u32 = 0x8000_8000;

/// Returns the 2x8-bit code nearest to the direction opposite to `gradient`; [`NONE8`] if it is zero or not finite.
#[inline]
pub fn encode8(gradient: [f64; 3]) -> u16 {
    match nearest(gradient, 127.0) {
        #[expect(clippy::cast_possible_truncation, reason = "the low byte of each is meant")]
        Some([u, v]) => u16::from_le_bytes([u as u8, v as u8]),
        None => NONE8,
    }
}

/// Returns the 2x16-bit code nearest to the direction opposite to `gradient`; [`NONE16`] if it is zero or not finite.
#[inline]
pub fn encode16(gradient: [f64; 3]) -> u32 {
    match nearest(gradient, 32_767.0) {
        #[expect(clippy::cast_possible_truncation, reason = "the low half of each is meant")]
        Some([u, v]) => u32::from(u as u16) | u32::from(v as u16) << 16,
        None => NONE16,
    }
}

/// Decodes a 2x8-bit code to a unit vector, and [`NONE8`] to the zero vector. Accepts any code; branch-free.
#[inline(always)]
pub fn decode8(code: u16) -> [f32; 3] {
    let [u, v] = code.to_le_bytes().map(|byte| f32::from(byte.cast_signed()).max(-127.0));
    unfold(u, v, 127.0, if code == NONE8 { 0.0 } else { 1.0 })
}

/// Decodes a 2x16-bit code to a unit vector, and [`NONE16`] to the zero vector. Accepts any code; branch-free.
#[inline(always)]
pub fn decode16(code: u32) -> [f32; 3] {
    #[expect(clippy::cast_possible_truncation, reason = "halves of the code")]
    let [u, v] = [code as u16, (code >> 16) as u16].map(|half| f32::from(half.cast_signed()).max(-32_767.0));
    unfold(u, v, 32_767.0, if code == NONE16 { 0.0 } else { 1.0 })
}

#[inline(always)]
fn unfold(u: f32, v: f32, scale: f32, length: f32) -> [f32; 3] {
    let z = scale - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    let x = u - fold.copysign(u);
    let y = v - fold.copysign(v);
    let factor = length / (x * x + y * y + z * z).sqrt();
    [x * factor, y * factor, z * factor]
}

/// Returns u and v of the best of the four codes around `-gradient`, as two's complement numbers in the low bits.
#[inline(always)]
fn nearest(gradient: [f64; 3], scale: f64) -> Option<[u64; 2]> {
    let [x, y, z] = gradient.map(|component| -component);
    let sum = x.abs() + y.abs() + z.abs();
    let [x, y, z, sum] = if (1e-280..1e280).contains(&sum) { [x, y, z, sum] } else { rescaled(x, y, z)? };
    let factor = scale / sum;
    let [x, y, z] = [x * factor, y * factor, z * factor];
    // Folds the lower half of the octahedron outward; there the three coordinates add up to `scale`.
    let fold = (-z).max(0.0);
    let [u, v] = [x + fold.copysign(x), y + fold.copysign(y)];
    // Kept below the largest code, so that the candidate with 1 added is inside the square.
    let low_u = whole(u - 0.5).max(-scale).min(scale - 1.0);
    let low_v = whole(v - 0.5).max(-scale).min(scale - 1.0);
    // Candidate k adds bit 0 of k to u and bit 1 to v.
    let us = Vec4::new(0.0, 1.0, 0.0, 1.0) + narrow(low_u);
    let vs = Vec4::new(0.0, 0.0, 1.0, 1.0) + narrow(low_v);
    let zs = Vec4::splat(narrow(scale)) - us.abs() - vs.abs();
    let fold = (-zs).max(Vec4::ZERO);
    let [xs, ys] = [us - fold.copysign(us), vs - fold.copysign(vs)];
    // Differences of the candidates from the exact position; whole parts first, so that no digit is lost.
    let [(whole_x, part_x), (whole_y, part_y), (whole_z, part_z)] = [split(x), split(y), split(z)];
    let [dx, dy, dz] = [xs - whole_x - part_x, ys - whole_y - part_y, zs - whole_z - part_z];
    let [x, y, z] = [narrow(x), narrow(y), narrow(z)];
    let cross = [dy * z - dz * y, dz * x - dx * z, dx * y - dy * x];
    let sines = (cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]) / (xs * xs + ys * ys + zs * zs);
    let best = sines.cmpeq(Vec4::splat(sines.min_element())).bitmask().trailing_zeros();
    let code = |low: f64, add: u32| (low + WHOLE).to_bits().wrapping_add(u64::from(add & 1));
    Some([code(low_u, best), code(low_v, best >> 1)])
}

/// If this is added to a number within 2^51 of 0, the low bits of the sum are the nearest integer.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// Rounds to the nearest integer by adding a constant: without SSE4, round() and casts take many instructions.
#[inline(always)]
fn whole(number: f64) -> f64 {
    (number + WHOLE) - WHOLE
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
fn narrow(number: f64) -> f32 {
    number as f32
}

#[inline(always)]
fn split(number: f64) -> (f32, f32) {
    let whole = whole(number);
    (narrow(whole), narrow(number - whole))
}

/// Returns a vector scaled to a largest component of 1, and its absolute sum; `None` if it is zero or not finite.
#[cold]
fn rescaled(x: f64, y: f64, z: f64) -> Option<[f64; 4]> {
    let largest = x.abs().max(y.abs()).max(z.abs());
    if largest == 0.0 || !(x.is_finite() && y.is_finite() && z.is_finite()) {
        return None;
    }
    let [x, y, z] = [x / largest, y / largest, z / largest];
    Some([x, y, z, x.abs() + y.abs() + z.abs()])
}
