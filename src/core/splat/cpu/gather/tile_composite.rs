//! Composites splats with a tile of the lattice while its pixels are in registers.
//!
//! In: the splats on a tile's list, in visit order, and where their weights come from. Out: the tile's pixels, and whether any of
//! them may still change.

use super::slab::Slab;
use super::stamps::Stamps;
use crate::splat::block_kernel::SHAPES;
use crate::splat::cpu::blend::Blend;
use crate::splat::cpu::lattice::{Footprints, Lattice, TileRays, near_weight};
use crate::splat::cpu::project::{Projector, limited};
use crate::splat::cpu::tile_buffer::{TILE_PIXELS, TileBuffer};

/// How many splats' amounts are computed together in a perspective. If a tile closes, the rest of them are computed in vain.
const FEW: usize = 8;

/// Where the weights of splats come from.
pub(super) struct Weights<'a> {
    pub(super) stamps: Option<&'a Stamps>,
    pub(super) footprints: Option<&'a Footprints>,
    pub(super) lattice: &'a Lattice,
}

impl Weights<'_> {
    /// Blends splats with a tile; returns whether any of its pixels may still change.
    #[inline(always)]
    pub(super) fn blend<B: Blend, const STAMPED: bool, const ONE_DEPTH: bool>(
        &self,
        projector: &Projector,
        slab: &Slab,
        splats: &[u32],
        tiles: &mut TileBuffer,
        tile: [i32; 2],
    ) -> bool {
        let Some((_, pixels)) = tiles.tile(tile[0], tile[1]) else { return false };
        let (mut values, mut is_open, stop) = (*pixels, true, projector.stop);
        if STAMPED {
            let Some(stamps) = self.stamps else { return false };
            let lower = stamps.lower(tile);
            for &splat in splats {
                let (Some(look), Some(key)) = (slab.look(splat), slab.weight_key(splat)) else { break };
                let Some(stamp) = stamps.stamp(key - lower) else { break };
                if ONE_DEPTH {
                    // The stamps are of the visible codes' depth; a function may hide others.
                    if look[3] == 0.0 {
                        continue;
                    }
                    is_open = values.blend::<B>(stamp, look, stop);
                } else {
                    is_open = values.blend::<B>(&amounts::<B>(stamp, look[3]), look, stop);
                }
                if !is_open {
                    break;
                }
            }
        } else if let Some(footprints) = self.footprints {
            let later = footprints.later(tile);
            for &splat in splats {
                let (Some(look), Some(key)) = (slab.look(splat), slab.weight_key(splat)) else { break };
                let weights = footprints.weights(key + later);
                is_open = values.blend::<B>(&amounts::<B>(weights, look[3]), look, stop);
                if !is_open {
                    break;
                }
            }
        } else {
            let rays = self.lattice.tile(tile);
            // All shapes at once take as long as this many one by one.
            let (is_displaced, are_many) = (!projector.is_on_grid(), splats.len() > SHAPES);
            let kernels = (is_displaced && are_many).then(|| self.lattice.kernels(tile));
            let mut amounts = [[0.0; TILE_PIXELS]; FEW];
            'splats: for few in splats.chunks(FEW) {
                let shape = |splat| Some(slab.weight_key(splat)? as usize % SHAPES);
                let count = match &kernels {
                    None if is_displaced => {
                        let rays_of = |splat| Some(TileRays::new(tile, self.lattice.kernel(tile, shape(splat)?)));
                        compute_amounts::<B>(rays_of, projector.cut, slab, few, &mut amounts)
                    }
                    None => compute_amounts::<B>(|_| Some(rays), projector.cut, slab, few, &mut amounts),
                    Some(kernels) => {
                        let rays_of = |splat| Some(TileRays::new(tile, kernels[shape(splat)?]));
                        compute_amounts::<B>(rays_of, projector.cut, slab, few, &mut amounts)
                    }
                };
                for (amounts, &splat) in amounts.iter().zip(few).take(count) {
                    let Some(look) = slab.look(splat) else { break 'splats };
                    is_open = values.blend::<B>(amounts, look, stop);
                    if !is_open {
                        break 'splats;
                    }
                }
            }
        }
        *pixels = values;
        is_open
    }
}

/// Returns the factors of a splat's ink at pixels, from its weights there and its optical depth at the centre.
#[inline(always)]
fn amounts<B: Blend>(weights: &[f32; TILE_PIXELS], peak: f32) -> [f32; TILE_PIXELS] {
    let mut amounts = [0.0; TILE_PIXELS];
    for i in 0..TILE_PIXELS {
        amounts[i] = B::near_amount(peak * weights[i]);
    }
    amounts
}

/// Computes the amounts of at most [`FEW`] splats at the pixels of a tile, from exponents to depths to amounts; returns of how
/// many.
///
/// Each step is done for all splats before the next step. Within one splat, each step waits for the one before; several splats
/// keep a processor busy. Measured: docs/studies/splats.md.
#[inline(always)]
fn compute_amounts<B: Blend>(
    rays_of: impl Fn(u32) -> Option<TileRays>,
    cut: f32,
    slab: &Slab,
    splats: &[u32],
    amounts: &mut [[f32; TILE_PIXELS]; FEW],
) -> usize {
    let (mut peaks, mut count) = ([0.0; FEW], 0);
    for ((exponents, peak), &splat) in amounts.iter_mut().zip(&mut peaks).zip(splats) {
        let (Some(&[.., depth]), Some(place)) = (slab.look(splat), slab.place(splat)) else { break };
        let Some(rays) = rays_of(splat) else { break };
        *exponents = rays.exponents(place);
        *peak = limited(depth, rays.strength());
        count += 1;
    }
    for (values, peak) in amounts.iter_mut().zip(peaks).take(count) {
        for value in values {
            *value = peak * near_weight(*value, cut);
        }
    }
    for depths in amounts.iter_mut().take(count) {
        for depth in depths {
            *depth = B::near_amount(*depth);
        }
    }
    count
}
