//! Twin of `shaders/splat.wgsl` and of what a device blends: from splats to the pixels of a target.

use half::f16;

use super::near::splat_depth;
use super::{absorbed, high_half, low_half};
use adjsplat::internals::gpu_stages::BlendMode;
use adjsplat::internals::gpu_stages::{FrameUniform, NOTHING, Splat};
use adjsplat::splat::gpu::QuadFormat;

/// How a device rounds a blended value to its target; devices may do either.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rounding {
    /// To the nearest value of the target.
    Nearest,
    /// To the neighbour nearer to 0.
    TowardZero,
}

/// Draws the splats of a chunk, in order, onto the pixels that the previous chunk left. Each fragment is blended in single
/// precision and rounded to the target.
///
/// # Panics
/// If `pixels` are fewer than the window has.
pub(crate) fn splat(
    frame: &FrameUniform,
    blend: BlendMode,
    (target, rounding): (QuadFormat, Rounding),
    splats: &[Splat],
    pixels: &mut [[f32; 4]],
) {
    let [x0, y0, x1, y1] = frame.window;
    for splat in splats.iter().filter(|splat| splat.columns != NOTHING) {
        let (left, top) = (low_half(splat.columns), low_half(splat.rows));
        for y in top.max(y0)..=high_half(splat.rows).min(y1 - 1) {
            for x in left.max(x0)..=high_half(splat.columns).min(x1 - 1) {
                let source = fragment(blend, splat, splat_depth(frame, splat, [x, y]));
                let place = (y - y0).cast_unsigned() * (x1 - x0).cast_unsigned() + (x - x0).cast_unsigned();
                let pixel = &mut pixels[place as usize];
                *pixel = blended(blend, target, source, *pixel).map(|value| rounded(target, rounding, value));
            }
        }
    }
}

/// Returns the colour of the fragment shader.
fn fragment(blend: BlendMode, splat: &Splat, depth: f32) -> [f32; 4] {
    let ink = [splat.red, splat.green, splat.blue, 1.0];
    match blend {
        BlendMode::Additive => ink.map(|ink| ink * depth),
        _ => ink.map(|ink| ink * absorbed(depth)),
    }
}

/// Returns the pixel after the blend state; a source for 8 bits is clamped to 0 to 1 before.
fn blended(blend: BlendMode, target: QuadFormat, source: [f32; 4], pixel: [f32; 4]) -> [f32; 4] {
    let source = if target == QuadFormat::Unorm8 { source.map(|value| value.clamp(0.0, 1.0)) } else { source };
    let [sr, sg, sb, sa] = source;
    let [r, g, b, a] = pixel;
    match blend {
        BlendMode::FrontToBack => [sr * a + r, sg * a + g, sb * a + b, a * (1.0 - sa)],
        BlendMode::BackToFront => [sr + r * (1.0 - sa), sg + g * (1.0 - sa), sb + b * (1.0 - sa), a * (1.0 - sa)],
        BlendMode::Additive => [sr + r, sg + g, sb + b, sa + a],
        BlendMode::Maximum => panic!("a maximum is drawn in tiles"),
    }
}

/// Returns the value as the target stores it.
fn rounded(target: QuadFormat, rounding: Rounding, value: f32) -> f32 {
    match target {
        QuadFormat::Float32 => value,
        QuadFormat::Float16 => {
            let nearest = f16::from_f32(value);
            let is_farther = nearest.to_f32().abs() > value.abs();
            match rounding {
                Rounding::TowardZero if is_farther => f16::from_bits(nearest.to_bits() - 1).to_f32(),
                _ => nearest.to_f32(),
            }
        }
        QuadFormat::Unorm8 => {
            let steps = value.clamp(0.0, 1.0) * 255.0;
            let whole = if rounding == Rounding::Nearest { steps.round_ties_even() } else { steps.floor() };
            whole / 255.0
        }
    }
}
