//! The looks of voxels: colour and optical depth by code, with light.
//!
//! In: the records of a block's voxels that are drawn. Out: their colours and optical depths.

use super::project::{Projector, VECTOR_WIDTH};
use super::voxel_block::{BLOCK, Coordinates, VoxelBlock};
use crate::arena::layout::Channels;
use crate::classify::normal::{self, Coherence};
use crate::splat::arith::at_least;
use crate::splat::composite::Look;
use crate::splat::shade::Lights;

impl Projector<'_> {
    /// Computes the looks, with light, of the voxels of a block whose numbers are in `kept`.
    #[inline(always)]
    pub(super) fn colour(&self, voxels: &VoxelBlock, kept: &[u8], looks: &mut [Look]) {
        // The most common kind of look table is recognised once here, not for every voxel.
        let table = self.table.of_bytes().filter(|_| self.lane.channels.value_bits == 8 && self.is_on_grid());
        for (look, &j) in looks.iter_mut().zip(kept) {
            let record = voxels.records[usize::from(j) % BLOCK];
            *look = match table {
                Some(table) => table[usize::from(self.short_value(record))],
                None => self.look(record),
            };
        }
        if let Some(lights) = &self.lights {
            let Channels { normal_bits, coherence, .. } = self.lane.channels;
            let codes = self.normal_codes(voxels, kept);
            let normals = self.normals(&codes, kept.len());
            let coherences = coherence.then(|| codes.map(|code| Coherence::of_code(code, normal_bits)));
            self.light(lights, (&normals, coherences.as_ref()), &voxels.positions, kept, looks);
        }
    }

    /// Returns the value code of a record, in a lane whose values have 8 bits.
    #[inline(always)]
    pub(super) fn short_value(&self, record: usize) -> u8 {
        match self.lane.values.get(record) {
            Some(&code) => code,
            None => self.lane.value_code(record) as u8,
        }
    }

    /// Returns the normal code of a record, in a lane whose normals have 8 bits a component.
    #[inline(always)]
    pub(super) fn short_normal(&self, record: usize) -> u16 {
        match self.lane.normals.as_chunks::<2>().0.get(record) {
            Some(&code) => u16::from_le_bytes(code),
            None => self.lane.normal_code(record) as u16,
        }
    }

    /// Returns the look (colour and optical depth) of a record's voxel, of which only a part may be visible.
    #[inline(always)]
    pub(super) fn look(&self, record: usize) -> Look {
        let [red, green, blue, depth] = self.whole_look(record);
        [red, green, blue, depth * self.lane.coverage(record).share]
    }

    /// Returns the look of a record's voxel, were it wholly visible. Its last number is a maximum's normalised value, if one is drawn.
    #[inline(always)]
    pub(super) fn whole_look(&self, record: usize) -> Look {
        let magnitude = if self.table.needs_magnitude() { self.lane.magnitude_code(record) } else { 0 };
        self.table.look(self.lane.value_code(record), magnitude)
    }

    /// Returns the codes of the kept voxels' normals.
    #[inline(always)]
    fn normal_codes(&self, voxels: &VoxelBlock, kept: &[u8]) -> [u32; BLOCK] {
        let mut codes = [0u32; BLOCK];
        let is_short = self.lane.channels.normal_bits == 8;
        for (code, &j) in codes.iter_mut().zip(kept) {
            let record = voxels.records[usize::from(j) % BLOCK];
            *code = if is_short { self.short_normal(record).into() } else { self.lane.normal_code(record) };
        }
        codes
    }

    /// Returns the x, y and z components of the unit normals of the first `count` codes.
    #[inline(always)]
    pub(super) fn normals(&self, codes: &[u32; BLOCK], count: usize) -> [[f32; BLOCK]; 3] {
        let mut normals = [[0.0f32; BLOCK]; 3];
        if self.lane.channels.normal_bits == 8 {
            for from in (0..count.min(BLOCK)).step_by(VECTOR_WIDTH) {
                let mut parts = [[0.0; VECTOR_WIDTH]; 3];
                for k in 0..VECTOR_WIDTH {
                    [parts[0][k], parts[1][k], parts[2][k]] = normal::decode8(codes[from + k] as u16);
                }
                for (normals, parts) in normals.iter_mut().zip(&parts) {
                    normals[from..from + VECTOR_WIDTH].copy_from_slice(parts);
                }
            }
        } else {
            for k in 0..BLOCK {
                [normals[0][k], normals[1][k], normals[2][k]] = normal::decode16(codes[k]);
            }
        }
        normals
    }

    /// Applies the light to the colours of the voxels whose numbers are in `kept`, by their unit normals and by how alike the normals
    /// are that each stands for.
    #[inline(always)]
    pub fn light<C: Coordinates>(
        &self,
        lights: &Lights,
        (normals, coherences): (&[[f32; BLOCK]; 3], Option<&[Coherence; BLOCK]>),
        positions: &C,
        kept: &[u8],
        looks: &mut [Look],
    ) {
        let count = kept.len().min(BLOCK);
        let mut shades = if !self.is_perspective() {
            shade(lights, normals, count, |_| lights.eye.map(|component| [component; VECTOR_WIDTH]))
        } else {
            let [s, m, f] = self.slow_medium_fast;
            let mut toward_eye = [[0.0f32; BLOCK]; 3];
            for k in 0..count {
                let [slow, medium, fast] = positions.at(usize::from(kept[k]) % BLOCK).map(|c| c as f32);
                toward_eye[s][k] = self.eye[s] - self.steps[s] * slow;
                toward_eye[m][k] = self.eye[m] - self.steps[m] * medium;
                toward_eye[f][k] = self.eye[f] - self.steps[f] * fast;
            }
            let toward_eye = toward_eye.each_ref().map(|component| component.as_chunks::<VECTOR_WIDTH>().0);
            shade(lights, normals, count, |chunk| {
                let [mut x, mut y, mut z] = toward_eye.map(|component| component[chunk]);
                for k in 0..VECTOR_WIDTH {
                    let length = at_least(x[k] * x[k] + y[k] * y[k] + z[k] * z[k], f32::MIN_POSITIVE).sqrt();
                    (x[k], y[k], z[k]) = (x[k] / length, y[k] / length, z[k] / length);
                }
                [x, y, z]
            })
        };
        if let Some(coherences) = coherences {
            for (k, &coherence) in coherences.iter().enumerate() {
                [shades[0][k], shades[1][k]] = lights.scatter([shades[0][k], shades[1][k]], coherence);
            }
        }
        for (look, k) in looks.iter_mut().zip(0..count) {
            let [red, green, blue, depth] = *look;
            let [factor, highlight] = [shades[0][k], shades[1][k]];
            *look = [red * factor + highlight, green * factor + highlight, blue * factor + highlight, depth];
        }
    }
}

/// Returns [`Lights::shade`] of the first `count` voxels of a block; `eye` returns the unit vectors to the eye of one chunk of them.
#[inline(always)]
pub(super) fn shade(
    lights: &Lights,
    normals: &[[f32; BLOCK]; 3],
    count: usize,
    eye: impl Fn(usize) -> [[f32; VECTOR_WIDTH]; 3],
) -> [[f32; BLOCK]; 2] {
    // A copy, which the compiler knows not to overlap with the results.
    let (lights, mut shades) = (*lights, [[0.0; BLOCK]; 2]);
    let [x, y, z] = normals.each_ref().map(|component| component.as_chunks::<VECTOR_WIDTH>().0);
    for chunk in 0..count.div_ceil(VECTOR_WIDTH) {
        let from = chunk * VECTOR_WIDTH;
        let parts = lights.shade([&x[chunk], &y[chunk], &z[chunk]], &eye(chunk));
        for (shades, part) in shades.iter_mut().zip(&parts) {
            shades[from..from + VECTOR_WIDTH].copy_from_slice(part);
        }
    }
    shades
}
