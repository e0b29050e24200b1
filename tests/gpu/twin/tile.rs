//! Twin of `shaders/tile.wgsl`: from splats and the tiles' masks to pixels.

use super::{WHOLE_CELL, absorbed, depth_at, high_half, low_half};
use adjsplat::splat::gpu::layout::{BATCH, Shot, Splat, TILE};
use adjsplat::splat::gpu::stages::Blend;

/// Puts `splats`, a chunk's, onto `pixels`, which start as the chunk before left them.
///
/// # Panics
/// If masks or pixels are fewer than the window has.
pub(crate) fn tile(shot: &Shot, blend: Blend, splats: &[Splat], masks: &[u32], pixels: &mut [[f32; 4]]) {
    let [x0, y0, x1, y1] = shot.window;
    let mut at = 0;
    for y in y0..y1 {
        for x in x0..x1 {
            let [column, row] = [x - x0, y - y0].map(|place| place.cast_unsigned() / TILE);
            let first_word = ((row * shot.tile_columns + column) * shot.mask_words) as usize;
            let mask = &masks[first_word..first_word + shot.mask_words as usize];
            pixels[at] = pixel(shot, blend, splats, mask, [x, y], pixels[at]);
            at += 1;
        }
    }
}

fn pixel(shot: &Shot, blend: Blend, splats: &[Splat], mask: &[u32], [x, y]: [i32; 2], mut pixel: [f32; 4]) -> [f32; 4] {
    for (batch, splats) in splats.chunks(BATCH as usize).enumerate() {
        if mask[batch / 32] >> (batch % 32) & 1 == 0 {
            continue;
        }
        for splat in splats {
            let columns = low_half(splat.columns)..=high_half(splat.columns);
            let rows = low_half(splat.rows)..=high_half(splat.rows);
            if blend == Blend::FrontToBack && pixel[3] < shot.stop {
                return pixel;
            }
            // The device looks at whole tiles, whose pixels outside a box are outside its ellipse too.
            if columns.contains(&x) && rows.contains(&y) {
                let dx = splat.corner_x + (x - columns.start()) as f32;
                let dy = splat.corner_y + (y - rows.start()) as f32;
                let depth = depth_at(dx, dy, splat, shot.cut);
                if depth > 0.0 {
                    pixel = blended(blend, pixel, splat, depth);
                }
            }
        }
    }
    pixel
}

fn blended(blend: Blend, pixel: [f32; 4], splat: &Splat, depth: f32) -> [f32; 4] {
    let ink = |fourth: f32| [splat.red, splat.green, splat.blue, fourth];
    let each = |ink: [f32; 4], value: &dyn Fn(f32, f32) -> f32| std::array::from_fn(|c| value(pixel[c], ink[c]));
    match blend {
        Blend::FrontToBack => each(ink(-1.0), &|value, ink| value + pixel[3] * absorbed(depth) * ink),
        Blend::BackToFront => each(ink(0.0), &|value, ink| value + absorbed(depth) * (ink - value)),
        Blend::Additive => each(ink(1.0), &|value, ink| value + depth * ink),
        Blend::Maximum => each(ink(1.0), &|value, ink| value.max(ink.min(depth * WHOLE_CELL))),
    }
}
