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
//!
//! A voxel of a level of detail stands for several voxels. How alike their normals are, the *coherence*, is in the lowest
//! bit of u and the two lowest of v: of all codes with these three bits the nearest is taken. Then errors are up to 2.4
//! degrees with 2x8 bits.

use glam::Vec4;

/// The code of 2x8 bits that means "no normal".
pub const NONE8: u16 = 0x8080;
/// The code of 2x16 bits that means "no normal".
pub const NONE16: u32 = 0x8000_8000;

/// What a voxel of a level of detail is lit as: a share of its light is that of a normal, the rest of many normals or of none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coherence {
    /// How alike the normals are that the voxel stands for: 1 if they are one, 0 if they point to all directions alike.
    pub alike: f32,
    /// Which share of what is seen of the voxel has no normal.
    pub bare: f32,
}

impl Default for Coherence {
    fn default() -> Coherence {
        Coherence::ONE
    }
}

impl Coherence {
    /// Of a voxel with one normal, or with none.
    pub const ONE: Coherence = Coherence { alike: 1.0, bare: 0.0 };
    /// What bit 0 of u, and bits 0 and 1 of v above it, stand for. The light of blocks of eight voxels was 1.02 to 1.14 times as
    /// far from the truth with four numbers for `alike` as with all from 0 to 1 (docs/studies/levels.md).
    const OF_BITS: [Coherence; 8] = {
        let (alike, bare) = ([1.0, 0.85, 0.6, 0.25], [0.0, 0.2]);
        let mut of_bits = [Coherence::ONE; 8];
        let mut bits = 0;
        while bits < 8 {
            of_bits[bits] = Coherence { alike: alike[bits & 3], bare: bare[bits >> 2] };
            bits += 1;
        }
        of_bits
    };

    /// Returns the coherence in a code of 2 x `bits` bits. The code for no normal has [`Coherence::ONE`].
    #[inline(always)]
    pub fn of_code(code: u32, bits: u8) -> Coherence {
        Coherence::OF_BITS[(code & 1 | (code >> bits & 3) << 1) as usize]
    }

    /// Returns the bits that stand for the nearest numbers.
    fn bits(self) -> u8 {
        let nearest = |wanted: f32, of: fn(&Coherence) -> f32, choices: &[u8]| {
            let distance = |bits: &u8| (of(&Coherence::OF_BITS[usize::from(*bits)]) - wanted).abs();
            choices.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
        };
        nearest(self.alike, |c| c.alike, &[0, 1, 2, 3]) | nearest(self.bare, |c| c.bare, &[0, 4])
    }
}

/// Returns the 2x8-bit code nearest to the direction opposite to `gradient`; [`NONE8`] if it is zero or not finite.
#[inline]
pub fn encode8(gradient: [f64; 3]) -> u16 {
    code8(nearest(gradient, 127.0, Multiples::ALL))
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the low byte of each is meant")]
fn code8(nearest: Option<[u64; 2]>) -> u16 {
    nearest.map_or(NONE8, |[u, v]| u16::from_le_bytes([u as u8, v as u8]))
}

/// Returns the 2x16-bit code nearest to the direction opposite to `gradient`; [`NONE16`] if it is zero or not finite.
#[inline]
pub fn encode16(gradient: [f64; 3]) -> u32 {
    code16(nearest(gradient, 32_767.0, Multiples::ALL))
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the low half of each is meant")]
fn code16(nearest: Option<[u64; 2]>) -> u32 {
    nearest.map_or(NONE16, |[u, v]| u32::from(u as u16) | u32::from(v as u16) << 16)
}

/// Returns the code of 2 x `bits` bits, 8 or 16, nearest to the direction opposite to `gradient`, of those with the bits of
/// `coherence`; the code for no normal if the gradient is zero or not finite.
pub fn encode_coherent(gradient: [f64; 3], coherence: Coherence, bits: u8) -> u32 {
    let of_coherence = coherence.bits();
    let lattice = Multiples { lowest: [of_coherence & 1, of_coherence >> 1].map(f64::from), steps: [2.0, 4.0] };
    match bits {
        8 => code8(nearest(gradient, 127.0, lattice)).into(),
        _ => code16(nearest(gradient, 32_767.0, lattice)),
    }
}

/// Returns the code of 2 x `bits` bits, 8 or 16, that means "no normal".
pub fn none(bits: u8) -> u32 {
    if bits == 8 { NONE8.into() } else { NONE16 }
}

/// Decodes a code of 2 x `bits` bits: 8, 16, or 0 for no normals. Accepts any code.
#[inline(always)]
pub fn decode(code: u32, bits: u8) -> [f32; 3] {
    match bits {
        0 => [0.0; 3],
        #[expect(clippy::cast_possible_truncation, reason = "the code has 16 bits")]
        8 => decode8(code as u16),
        _ => decode16(code),
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

/// The whole numbers that u and v may be: one of each, and all at a multiple of a step from it.
#[derive(Clone, Copy)]
struct Multiples {
    lowest: [f64; 2],
    steps: [f64; 2],
}

impl Multiples {
    const ALL: Multiples = Multiples { lowest: [0.0; 2], steps: [1.0; 2] };

    /// Returns the lower of the two numbers around a coordinate, both from -`scale` to `scale`.
    #[inline(always)]
    fn below(&self, side: usize, coordinate: f64, scale: f64) -> f64 {
        let (lowest, step) = (self.lowest[side], self.steps[side]);
        let low = lowest + step * whole((coordinate - lowest) / step - 0.5);
        low + step * (f64::from(low < -scale) - f64::from(low + step > scale))
    }
}

/// Returns u and v of the best of the four codes of a lattice around `-gradient`, as two's complement numbers in the low bits.
#[inline(always)]
fn nearest(gradient: [f64; 3], scale: f64, lattice: Multiples) -> Option<[u64; 2]> {
    let [x, y, z] = gradient.map(|component| -component);
    let sum = x.abs() + y.abs() + z.abs();
    let [x, y, z, sum] = if (1e-280..1e280).contains(&sum) { [x, y, z, sum] } else { rescaled(x, y, z)? };
    let factor = scale / sum;
    let [x, y, z] = [x * factor, y * factor, z * factor];
    // Folds the lower half of the octahedron outward; there the three coordinates add up to `scale`.
    let fold = (-z).max(0.0);
    let [u, v] = [x + fold.copysign(x), y + fold.copysign(y)];
    let (low_u, low_v) = (lattice.below(0, u, scale), lattice.below(1, v, scale));
    // Candidate k adds a step to u if bit 0 of k is set, and to v if bit 1 is.
    let [step_u, step_v] = lattice.steps.map(narrow);
    let us = Vec4::new(0.0, step_u, 0.0, step_u) + narrow(low_u);
    let vs = Vec4::new(0.0, 0.0, step_v, step_v) + narrow(low_v);
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
    let code = |low: f64, step: f64, add: u32| (low + step * f64::from(add & 1) + WHOLE).to_bits();
    Some([code(low_u, lattice.steps[0], best), code(low_v, lattice.steps[1], best >> 1)])
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
