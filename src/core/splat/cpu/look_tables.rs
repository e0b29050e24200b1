//! Tables of looks and of light, for parallel views of many voxels: all voxels see the same light.
//!
//! In: a frame's projector. Out: the colour and depth of a record by two look-ups, with the bits of
//! [`Projector::colour`].

use multiversion::multiversion;

use super::project::{Projector, limited};
use crate::classify::normal;
use crate::splat::composite::Look;
use crate::splat::shade::Lights;
use crate::splat::view::PixelMap;

/// Looks by value code and light by normal code, for parallel views: all voxels see the same light.
pub(super) struct LookTables {
    /// For each value code: colour and optical depth.
    looks: Box<[Look; 256]>,
    /// For each normal code: a factor on the colour, and a highlight; `None` if voxels are not lit.
    light: Option<Box<[[f32; 2]]>>,
}

impl LookTables {
    /// Creates the tables of a frame. `None` if the view is not parallel, codes are longer, or there are few voxels.
    pub(super) fn new(projector: &Projector, strength: f32) -> Option<LookTables> {
        /// Computing the light of each code takes as long as that of this number of voxels.
        const MANY: usize = 1 << 16;
        let channels = projector.lane.channels;
        let is_short = channels.value_bits == 8 && channels.normal_bits <= 8;
        let is_parallel = matches!(projector.map, PixelMap::Parallel { .. });
        if !is_parallel || !is_short || projector.lane.values.len() < 2 * MANY {
            return None;
        }
        let mut looks = Box::new(*projector.table.of_bytes()?);
        looks.iter_mut().for_each(|look| look[3] = limited(look[3], strength));
        let light = projector.lights.as_ref().map(|lights| {
            let mut light = vec![[0.0; 2]; MANY].into_boxed_slice();
            light_of_codes(lights, &mut light);
            light
        });
        Some(LookTables { looks, light })
    }

    /// Returns the depth and the colour of a record's voxel.
    #[inline(always)]
    pub(super) fn of(&self, projector: &Projector, record: usize) -> (f32, [f32; 3]) {
        let [red, green, blue, depth] = self.looks[usize::from(projector.short_value(record))];
        let Some(light) = &self.light else { return (depth, [red, green, blue]) };
        let normal = projector.short_normal(record);
        let [factor, highlight] = light[usize::from(normal)];
        (depth, [red * factor + highlight, green * factor + highlight, blue * factor + highlight])
    }
}

/// Computes the light of each normal code.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn light_of_codes(lights: &Lights, light: &mut [[f32; 2]]) {
    for (code, light) in (0..=u16::MAX).zip(light) {
        *light = lights.shade(normal::decode8(code), lights.eye);
    }
}
