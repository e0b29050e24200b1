//! Stage 2: from splats to pixels.
//!
//! In: a block of projected splats in visit order, the tiles of a band. Out: the band's pixels.
//!
//! A splat is drawn on every tile of 4 x 4 pixels that its box meets, sixteen pixels at once; a wide splat is drawn
//! only on tiles that its ellipse meets. Frozen tiles are skipped. Pixels of a tile outside the ellipse get depth 0;
//! pixels outside the band are never read. A pixel's bits depend on absolute coordinates only.

use crate::splat::arith::SMALL_DEPTH;
use crate::splat::composite::Look;
use crate::splat::cpu::blend::Blend;
use crate::splat::cpu::splats::{AFFINE, SplatKernel, Splats};
use crate::splat::cpu::tile_buffer::{TILE_PIXELS, TILE_SHIFT, TileBuffer, tile_pixels};
use crate::splat::cpu::voxel_block::BLOCK;
use crate::splat::near::{EyeRays, NearKernel};

/// Draws a block's kept splats; `rays` are those of a perspective. Returns how many touched the band.
///
/// `cut` is the exponent at the kernel's cut-off, `stop` the transmittance below which a pixel no longer changes.
#[inline(always)]
pub(in super::super) fn draw<B: Blend>(
    tiles: &mut TileBuffer,
    splats: &Splats,
    rays: Option<&EyeRays>,
    [cut, stop]: [f32; 2],
) -> u64 {
    let mut drawn = 0;
    for k in 0..splats.count.min(BLOCK) {
        let j = usize::from(splats.kept[k]) % BLOCK;
        let look = &splats.looks[k];
        let peak = look[3];
        let ([low_x, high_x], [low_y, high_y]) = splats.clipped(j, tiles.rect);
        // Stage 1 lists only splats that reach the band; this test keeps other splats from writing outside the tiles.
        if peak <= 0.0 || low_x > high_x || low_y > high_y {
            continue;
        }
        drawn += 1;
        let place = [[low_x >> TILE_SHIFT, high_x >> TILE_SHIFT], [low_y >> TILE_SHIFT, high_y >> TILE_SHIFT]];
        if let (Some(rays), Some(kernel)) = (rays, splats.near(j)) {
            draw_near::<B>(tiles, rays, kernel, peak, place, look, stop);
            continue;
        }
        let kernel = splats.kernel(j, cut, peak);
        match rays.filter(|_| splats.is_on_rays(j)) {
            None if peak <= SMALL_DEPTH => draw_splat::<B, true>(tiles, None, &kernel, place, look, stop),
            None => draw_splat::<B, false>(tiles, None, &kernel, place, look, stop),
            Some(rays) if peak * rays.most_stretch <= SMALL_DEPTH => {
                draw_splat::<B, true>(tiles, Some(rays), &kernel, place, look, stop);
            }
            Some(rays) => draw_splat::<B, false>(tiles, Some(rays), &kernel, place, look, stop),
        }
    }
    drawn
}

/// Draws a splat on tile columns `left..=right`, tile rows `top..=bottom`; `rays` if it is on rays. `IS_SMALL`: its depth on any ray is
/// up to [`SMALL_DEPTH`].
#[inline(always)]
fn draw_splat<B: Blend, const IS_SMALL: bool>(
    tiles: &mut TileBuffer,
    rays: Option<&EyeRays>,
    kernel: &SplatKernel,
    [[left, right], [top, bottom]]: [[i32; 2]; 2],
    look: &Look,
    stop: f32,
) {
    let root = kernel.ellipse.u_factor.sqrt();
    for row in top..bottom + 1 {
        let tile_row = kernel.tile_row(root, row);
        let (mut from, mut to) = (left, right);
        if right - left >= WIDE {
            // The square of a direction's length is convex: it is largest at a corner of the row of tiles.
            let most = rays.map_or(1.0, |rays| rays.largest_square([left, right + 1], [row, row + 1]));
            let [first, last] = kernel.chord(row, most);
            (from, to) = (from.max(first), to.min(last));
        }
        for column in from..to + 1 {
            let (index, tile, mut amounts) = if let Some(rays) = rays {
                let Some((index, tile, lengths)) = tiles.tile_and_rays(column, row, rays) else { continue };
                let lengths = |i: usize| [lengths.per_square[i], lengths.stretch[i]];
                (index, tile, kernel.depths(root, &tile_row, column, lengths))
            } else {
                let Some((index, tile)) = tiles.tile(column, row) else { continue };
                (index, tile, kernel.depths(root, &tile_row, column, |_| AFFINE))
            };
            for i in 0..TILE_PIXELS {
                amounts[i] = B::amount::<IS_SMALL>(amounts[i]);
            }
            if !tile.blend::<B>(&amounts, look, stop) {
                tiles.freeze(index, column, row);
            }
        }
    }
}

/// Draws a voxel near the eye on tile columns `left..=right`, tile rows `top..=bottom`.
#[inline(always)]
fn draw_near<B: Blend>(
    tiles: &mut TileBuffer,
    rays: &EyeRays,
    kernel: &NearKernel,
    peak: f32,
    [[left, right], [top, bottom]]: [[i32; 2]; 2],
    look: &Look,
    stop: f32,
) {
    for row in top..bottom + 1 {
        let (mut from, mut to) = (left, right);
        if right - left >= WIDE {
            let chord = rays.chord(kernel, [0, 1, 2, 3].map(|line| (row << TILE_SHIFT) + line));
            (from, to) = (from.max(chord[0] >> TILE_SHIFT), to.min(chord[1] >> TILE_SHIFT));
        }
        for column in from..to + 1 {
            let Some((index, tile)) = tiles.tile(column, row) else { continue };
            let (columns, rows) = tile_pixels(column, row);
            let mut amounts = rays.depths(kernel, &rays.rays(columns, rows), peak);
            for i in 0..TILE_PIXELS {
                amounts[i] = B::amount::<false>(amounts[i]);
            }
            if !tile.blend::<B>(&amounts, look, stop) {
                tiles.freeze(index, column, row);
            }
        }
    }
}

/// A splat is wide if its last tile in a row is at least this many tiles after the first one. Only then does finding
/// the tiles that its ellipse meets save time.
const WIDE: i32 = 3;
