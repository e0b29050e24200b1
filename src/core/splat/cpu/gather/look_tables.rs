//! Tables of looks and of light, for parallel views of many voxels: all voxels see the same light.
//!
//! In: a frame's projector. Out: the colour and depth of a record by two look-ups, with the bits of
//! [`Projector::colour`].

use multiversion::multiversion;

use crate::classify::normal::Coherence;
use crate::splat::composite::Look;
use crate::splat::cpu::lattice::Lattice;
use crate::splat::cpu::looks::shade;
use crate::splat::cpu::project::{Projector, VECTOR_WIDTH, limited};
use crate::splat::cpu::voxel_block::{BLOCK, VoxelBlock};
use crate::splat::shade::Lights;

/// Looks by value code and light by normal code, for parallel views: all voxels see the same light.
pub(super) struct LookTables {
    /// For each value code: colour and optical depth, that of a splat unless voxels have coverages.
    looks: Box<[Look; 256]>,
    /// For each normal code: a factor on the colour, and a highlight; `None` if voxels are not lit.
    light: Option<Box<[[f32; 2]; 1 << 16]>>,
}

impl LookTables {
    /// Creates the tables of a frame. `None` if the view is not parallel, codes are longer, or there are
    /// few voxels.
    pub(super) fn new(projector: &Projector, lattice: &Lattice) -> Option<LookTables> {
        /// Computing the light of each code takes as long as that of this number of voxels.
        const MANY: usize = 1 << 16;
        let channels = projector.lane.channels;
        let is_short = channels.value_bits == 8 && channels.normal_bits <= 8;
        if projector.is_perspective() || !is_short || projector.lane.values.len() < 2 * MANY {
            return None;
        }
        let mut looks = Box::new(*projector.table.of_bytes()?);
        if let Some(strength) = lattice.strength()
            && projector.is_on_grid()
        {
            looks.iter_mut().for_each(|look| look[3] = limited(look[3], strength));
        }
        let light = projector.lights.as_ref().map(|lights| {
            let light = vec![[0.0; 2]; 1 << 16].into_boxed_slice();
            let mut light: Box<[_; 1 << 16]> = light.try_into().expect("as many as were asked for");
            light_of_codes(projector, lights, &mut light);
            light
        });
        Some(LookTables { looks, light })
    }

    /// Computes the colours and depths of a block's voxels.
    #[inline(always)]
    pub(super) fn colour(&self, projector: &Projector, voxels: &VoxelBlock, looks: &mut [[f32; 4]]) {
        let records = &voxels.records[..voxels.count.min(BLOCK)];
        let mut values = [0u8; BLOCK];
        for (value, &record) in values.iter_mut().zip(records) {
            *value = projector.short_value(record);
        }
        match &self.light {
            None => {
                for (look, &value) in looks.iter_mut().zip(&values) {
                    *look = self.looks[usize::from(value)];
                }
            }
            Some(light) => {
                let mut normals = [0u16; BLOCK];
                for (normal, &record) in normals.iter_mut().zip(records) {
                    *normal = projector.short_normal(record);
                }
                for ((look, &value), &normal) in looks.iter_mut().zip(&values).zip(&normals) {
                    let unlit = self.looks[usize::from(value)];
                    let [factor, highlight] = light[usize::from(normal)];
                    // The depth goes through the same vector instructions as the colours.
                    let lit = unlit.map(|part| part * factor + highlight);
                    *look = [lit[0], lit[1], lit[2], unlit[3]];
                }
            }
        }
        if !projector.is_on_grid() {
            for (look, &record) in looks.iter_mut().zip(records) {
                look[3] *= projector.lane.coverage(record).share;
            }
        }
    }
}

/// Computes the light of each normal code.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn light_of_codes(projector: &Projector, lights: &Lights, light: &mut [[f32; 2]; 1 << 16]) {
    for (first, light) in (0u32..).step_by(BLOCK).zip(light.as_chunks_mut::<BLOCK>().0) {
        let codes = std::array::from_fn(|k| first + k as u32);
        let eye = |_| lights.eye.map(|component| [component; VECTOR_WIDTH]);
        let [factors, highlights] = shade(lights, &projector.normals(&codes, BLOCK), BLOCK, eye);
        for k in 0..BLOCK {
            let shade = [factors[k], highlights[k]];
            let has_coherence = projector.lane.channels.coherence;
            light[k] = if has_coherence { lights.scatter(shade, Coherence::of_code(codes[k], 8)) } else { shade };
        }
    }
}
