//! Twin of `shaders/near.wgsl`: the optical depth of a splat at a pixel, also of voxels near the eye.

use super::low_half;
use adjsplat::internals::gpu_stages::{FrameUniform, Splat};

/// Returns the optical depth of a splat on a pixel's ray, in units of ln 2; 0 outside its kernel.
pub(crate) fn splat_depth(frame: &FrameUniform, splat: &Splat, [x, y]: [i32; 2]) -> f32 {
    let ray = ray_at(frame, [x, y]);
    if splat.falloff_y < 0.0 {
        let offset = [splat.corner_x, splat.corner_y, splat.falloff_x];
        return near_depth(frame, offset, splat.shear, splat.peak, &ray);
    }
    let dx = splat.corner_x + (x - low_half(splat.columns)) as f32;
    let dy = splat.corner_y + (y - low_half(splat.rows)) as f32;
    let u = dx - splat.shear * dy;
    let (mut q, mut peak) = (splat.falloff_x * (u * u) + splat.falloff_y * (dy * dy), splat.peak);
    if splat.on_rays == 1.0 {
        (q, peak) = (q * ray.per_square, (peak * ray.stretch).min(frame.max_depth));
    }
    if q <= frame.cut_exponent { peak * (-q).exp2() } else { 0.0 }
}

/// The ray of a pixel.
struct Ray {
    /// Unit vector in voxel coordinates.
    direction: [f32; 3],
    /// One over the square of the direction's length before.
    per_square: f32,
    stretch: f32,
}

fn ray_at(frame: &FrameUniform, [x, y]: [i32; 2]) -> Ray {
    let tangent = [x as f32 - frame.centre[0], y as f32 - frame.centre[1]].map(|at| at / frame.focal);
    let [right, up, forward] = frame.rays;
    let along = [0, 1, 2].map(|a| forward[a] + right[a] * tangent[0] - up[a] * tangent[1]);
    let per_square = 1.0 / dot(along, along).max(f32::MIN_POSITIVE);
    let per_length = per_square.sqrt();
    let stretch = (1.0 + (tangent[0] * tangent[0] + tangent[1] * tangent[1])).sqrt() * per_length;
    Ray { direction: along.map(|c| c * per_length), per_square, stretch }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn tail_ratio(z: f32) -> f32 {
    let q = 1.0 / (1.0 + 0.28 * z);
    let square = q * q;
    let low = -0.001_111_21 + 0.125_905_96 * q;
    let middle = 0.035_174_4 + 0.327_135_5 * q;
    let high = (-0.294_952_74 + 0.420_143_79 * q) + -0.112_295_58 * square;
    low + square * (middle + square * high)
}

fn near_depth(frame: &FrameUniform, r: [f32; 3], at_eye: f32, peak: f32, ray: &Ray) -> f32 {
    let u = ray.direction;
    let aside = [r[1] * u[2] - r[2] * u[1], r[2] * u[0] - r[0] * u[2], r[0] * u[1] - r[1] * u[0]];
    let q = 0.5 * std::f32::consts::LOG2_E / (frame.near_sigma * frame.near_sigma) * dot(aside, aside);
    let t = dot(r, u);
    let mut weight = at_eye * tail_ratio((t.abs() / frame.near_sigma).min(6.0));
    if t > 0.0 {
        let whole = if q <= frame.cut_exponent { (-q).exp2() } else { 0.0 };
        weight = (whole - weight).max(0.0);
    }
    (peak * (frame.rays[2][3] * ray.stretch)).min(frame.max_depth) * weight
}
