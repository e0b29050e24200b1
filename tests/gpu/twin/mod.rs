//! Twins: each stage of the device renderer on the processor, in a file of its shader's name.
//!
//! In and out: what the shader reads and writes, as slices. A twin is the shader line by line, one invocation after the
//! other. `stages` runs a stage and its twin on the same buffers and compares what they wrote: whole numbers are equal
//! bit for bit. Twins round each step to single precision; a device may fuse steps, and be a few units in the last place
//! off in exponentials and roots.

pub(crate) mod bin;
mod near;
pub(crate) mod project;
pub(crate) mod splat;
pub(crate) mod tile;
pub(crate) mod walk;

use adjsplat::internals::REACH as PROCESSORS_REACH;
use adjsplat::internals::gpu_stages::{NOTHING, Splat};

/// Largest half-width of a footprint, in pixels; that of the processor's renderer.
pub(crate) const REACH: f32 = PROCESSORS_REACH;

/// A splat of no pixels.
const EMPTY: Splat = Splat {
    columns: NOTHING,
    rows: NOTHING,
    corner_x: 0.0,
    corner_y: 0.0,
    falloff_x: 0.0,
    falloff_y: 0.0,
    shear: 0.0,
    peak: 0.0,
    red: 0.0,
    green: 0.0,
    blue: 0.0,
    on_rays: 0.0,
};

fn low_half(word: u32) -> i32 {
    (word & 0xffff).cast_signed()
}

fn high_half(word: u32) -> i32 {
    (word >> 16).cast_signed()
}

/// Returns element `index` of packed elements of `bits` bits; 0 beyond the last word.
fn element(words: &[u32], index: u32, bits: u32) -> u32 {
    let in_a_word = 32 / bits;
    let word = words.get((index / in_a_word) as usize).copied().unwrap_or(0);
    (word >> (bits * (index % in_a_word))) & (u32::MAX >> (32 - bits))
}

/// Returns `1 - 2^-x` for `x` of 0 to 125.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 125")]
pub(crate) fn absorbed(x: f32) -> f32 {
    let whole = x.round_ties_even();
    let f = x - whole;
    let square = f * f;
    let low = std::f32::consts::LN_2 + -2.402_265e-1 * f;
    let middle = 5.550_357_4e-2 + -9.618_237e-3 * f;
    let high = 1.339_073_5e-3 + -1.540_351_3e-4 * f;
    let series = low + square * (middle + square * high);
    let scale = f32::from_bits(0x3f80_0000 - ((whole as u32) << 23));
    (1.0 - scale) + scale * (f * series)
}
