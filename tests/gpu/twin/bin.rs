//! Twin of `shaders/bin.wgsl`: from splats to their boxes and each tile's mask of batches.

use super::{high_half, low_half};
use adjsplat::internals::gpu_stages::{BATCH, FrameUniform, NOTHING, SUMMARY_WORDS, Splat, TILE_SIDE};

/// Sets the bit of each batch in the mask of each tile that a splat of the batch meets, and the bit of its word in the summary
/// before the mask; `masks` are 0 before. Returns the splats' boxes.
///
/// # Panics
/// If a splat does not meet the window.
pub(crate) fn bin(frame: &FrameUniform, splats: &[Splat], masks: &mut [u32]) -> Vec<[u32; 2]> {
    for (splat, slot) in splats.iter().zip(0u32..) {
        if splat.columns == NOTHING {
            continue;
        }
        let batch = slot / BATCH;
        let tile_of = |pixel: i32, first: i32| (pixel - first).cast_unsigned() / TILE_SIDE;
        let [x0, y0, x1, y1] = frame.window;
        let (left, right) = (low_half(splat.columns).max(x0), high_half(splat.columns).min(x1 - 1));
        let (top, bottom) = (low_half(splat.rows).max(y0), high_half(splat.rows).min(y1 - 1));
        for row in tile_of(top, y0)..=tile_of(bottom, y0) {
            for column in tile_of(left, x0)..=tile_of(right, x0) {
                let tile = row * frame.tile_columns + column;
                let row = tile * frame.mask_words;
                masks[(row + SUMMARY_WORDS + batch / 32) as usize] |= 1 << (batch % 32);
                masks[(row + batch / 1024) as usize] |= 1 << (batch / 32 % 32);
            }
        }
    }
    splats.iter().map(|splat| [splat.columns, splat.rows]).collect()
}
