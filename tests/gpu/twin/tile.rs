//! Twin of `shaders/tile.wgsl`: from splats and the tiles' masks to pixels.

use super::near::splat_depth;
use super::{WHOLE_CELL, absorbed, high_half, low_half};
use adjsplat::internals::gpu_stages::BlendMode;
use adjsplat::internals::gpu_stages::{BATCH, FrameUniform, Splat, TILE};

/// Composites the splats of a chunk onto the pixels that the previous chunk left.
///
/// # Panics
/// If masks or pixels are fewer than the window has.
pub(crate) fn tile(frame: &FrameUniform, blend: BlendMode, splats: &[Splat], masks: &[u32], pixels: &mut [[f32; 4]]) {
    let [x0, y0, x1, y1] = frame.window;
    let mut at = 0;
    for y in y0..y1 {
        for x in x0..x1 {
            let [column, row] = [x - x0, y - y0].map(|place| place.cast_unsigned() / TILE);
            let first_word = ((row * frame.tile_columns + column) * frame.mask_words) as usize;
            let mask = &masks[first_word..first_word + frame.mask_words as usize];
            pixels[at] = pixel(frame, blend, splats, mask, [x, y], pixels[at]);
            at += 1;
        }
    }
}

fn pixel(
    frame: &FrameUniform,
    blend: BlendMode,
    splats: &[Splat],
    mask: &[u32],
    [x, y]: [i32; 2],
    mut pixel: [f32; 4],
) -> [f32; 4] {
    for (batch, splats) in splats.chunks(BATCH as usize).enumerate() {
        if mask[batch / 32] >> (batch % 32) & 1 == 0 {
            continue;
        }
        for splat in splats {
            let columns = low_half(splat.columns)..=high_half(splat.columns);
            let rows = low_half(splat.rows)..=high_half(splat.rows);
            if blend == BlendMode::FrontToBack && pixel[3] < frame.termination {
                return pixel;
            }
            // The device draws whole tiles; their pixels outside a splat's box are outside its ellipse too.
            if columns.contains(&x) && rows.contains(&y) {
                let depth = splat_depth(frame, splat, [x, y]);
                if depth > 0.0 {
                    pixel = blended(blend, pixel, splat, depth);
                }
            }
        }
    }
    pixel
}

fn blended(blend: BlendMode, pixel: [f32; 4], splat: &Splat, depth: f32) -> [f32; 4] {
    let ink = |fourth: f32| [splat.red, splat.green, splat.blue, fourth];
    let each = |ink: [f32; 4], value: &dyn Fn(f32, f32) -> f32| std::array::from_fn(|c| value(pixel[c], ink[c]));
    match blend {
        BlendMode::FrontToBack => each(ink(-1.0), &|value, ink| value + pixel[3] * absorbed(depth) * ink),
        BlendMode::BackToFront => each(ink(0.0), &|value, ink| value + absorbed(depth) * (ink - value)),
        BlendMode::Additive => each(ink(1.0), &|value, ink| value + depth * ink),
        BlendMode::Maximum => each(ink(1.0), &|value, ink| value.max(ink.min(depth * WHOLE_CELL))),
    }
}
