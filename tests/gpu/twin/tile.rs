//! Twin of `shaders/tile.wgsl`: from splats and the tiles' masks to pixels.

use super::near::splat_depth;
use super::{absorbed, high_half, low_half};
use adjsplat::internals::gpu_stages::BlendMode;
use adjsplat::internals::gpu_stages::{BATCH, Chunk, FrameUniform, SUMMARY_WORDS, Splat, TILE_SIDE};

/// Composites the splats of a chunk onto the pixels that the previous chunk left.
///
/// # Panics
/// If masks or pixels are fewer than the window has.
pub(crate) fn tile(
    frame: &FrameUniform,
    chunk: &Chunk,
    blend: BlendMode,
    splats: &[Splat],
    masks: &[u32],
    pixels: &mut [[f32; 4]],
) {
    let [x0, y0, x1, y1] = frame.window;
    let mut at = 0;
    for y in y0..y1 {
        for x in x0..x1 {
            let [column, row] = [x - x0, y - y0].map(|place| place.cast_unsigned() / TILE_SIDE);
            let first_word = ((row * frame.tile_columns + column) * frame.mask_words) as usize;
            let mask = &masks[first_word + SUMMARY_WORDS as usize..first_word + frame.mask_words as usize];
            pixels[at] = pixel(frame, chunk, blend, splats, mask, [x, y], pixels[at]);
            at += 1;
        }
    }
}

fn pixel(
    frame: &FrameUniform,
    chunk: &Chunk,
    blend: BlendMode,
    splats: &[Splat],
    mask: &[u32],
    [x, y]: [i32; 2],
    mut pixel: [f32; 4],
) -> [f32; 4] {
    let mut slice = chunk.from_slice as f32;
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
                let dx = splat.corner_x + (x - columns.start()) as f32;
                let dy = splat.corner_y + (y - rows.start()) as f32;
                if blend == BlendMode::Maximum {
                    if splat.red != slice {
                        pixel = advanced(pixel, splat.red - slice);
                        slice = splat.red;
                    }
                    let weights = sample_weights(frame, splat, dx, dy);
                    (0..3).for_each(|k| pixel[k + 1] += splat.peak * weights[k]);
                    continue;
                }
                let depth = splat_depth(frame, splat, [x, y]);
                if depth > 0.0 {
                    pixel = blended(blend, pixel, splat, depth);
                }
            }
        }
    }
    let to_slice = chunk.to_slice as f32;
    if blend == BlendMode::Maximum && slice != to_slice { advanced(pixel, to_slice - slice) } else { pixel }
}

/// Returns a pixel whose sums that voxels `slices` slices ahead cannot add to are compared with its largest sample.
fn advanced([largest, before, at, after]: [f32; 4], slices: f32) -> [f32; 4] {
    let finished = largest.max(before).max(at);
    if slices == 1.0 { [finished, after, 0.0, 0.0] } else { [finished.max(after), 0.0, 0.0, 0.0] }
}

fn tent(distance: f32) -> f32 {
    if distance.abs() < 1.0 { 1.0 - distance.abs() } else { 0.0 }
}

/// Returns the weights of a voxel in the samples half a slice before it, at it and half a slice after it.
fn sample_weights(frame: &FrameUniform, splat: &Splat, dx: f32, dy: f32) -> [f32; 3] {
    let moved = frame.sample_rays.map(|ray| ray[0] * dx + ray[1] * dy);
    let (mut apart, mut step) = ([moved[1], moved[2]], [frame.sample_rays[1][2], frame.sample_rays[2][2]]);
    let mut shares = [0.5, 1.0, 0.5];
    if frame.is_perspective == 1 {
        let (from_eye, closeness) = ([splat.falloff_x, splat.falloff_y], splat.green);
        let (mut base, mut missed) = ([splat.shear, from_eye[0], from_eye[1]].map(|part| part * closeness), [0.0; 2]);
        if closeness == 0.0 {
            base = frame.sample_rays.map(|ray| ray[3]);
            missed = [0, 1].map(|a| base[a + 1] * splat.shear - from_eye[a] * base[0]);
        }
        let along = base[0] + moved[0];
        apart = [0, 1].map(|a| (missed[a] + (moved[a + 1] * splat.shear - from_eye[a] * moved[0])) / along);
        step = [0, 1].map(|a| 0.5 * (base[a + 1] + moved[a + 1]) / along);
        for (share, half) in shares.iter_mut().zip([-0.5, 0.0, 0.5]) {
            let is_seen = (splat.shear + half) / along >= frame.near;
            *share = if is_seen { *share } else { 0.0 };
        }
    }
    [0, 1, 2].map(|k| {
        let steps = k as f32 - 1.0;
        shares[k] * (tent(apart[0] + steps * step[0]) * tent(apart[1] + steps * step[1]))
    })
}

fn blended(blend: BlendMode, pixel: [f32; 4], splat: &Splat, depth: f32) -> [f32; 4] {
    let ink = |fourth: f32| [splat.red, splat.green, splat.blue, fourth];
    let each = |ink: [f32; 4], value: &dyn Fn(f32, f32) -> f32| std::array::from_fn(|c| value(pixel[c], ink[c]));
    match blend {
        BlendMode::FrontToBack => each(ink(-1.0), &|value, ink| value + pixel[3] * absorbed(depth) * ink),
        BlendMode::BackToFront => each(ink(0.0), &|value, ink| value + absorbed(depth) * (ink - value)),
        BlendMode::Additive => each(ink(1.0), &|value, ink| value + depth * ink),
        BlendMode::Maximum => pixel,
    }
}
