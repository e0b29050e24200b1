// Shared by the stages tile and splat: the optical depth of a splat on a pixel's ray, also of voxels near the eye, which are
// integrated along it. It stands between common.wgsl and the stage's own text. near.rs explains it.
// Twin: tests/gpu/twin/near.rs

// Whether splats may be of voxels near the eye. In software the test costs time (docs/studies/gpu.md). The study of order
// keeps the default.
override HAS_NEAR: bool = true;

// The ray of a pixel.
struct Ray {
    direction: vec3<f32>, // Unit vector in voxel coordinates; 0 in a parallel view.
    per_square: f32, // One over the square of the direction's length before; 1 in a parallel view, as the stretch.
    stretch: f32, // Length in mean spacings for that length in voxel coordinates.
}

// Returns the ray of the pixel `at`.
fn ray_at(at: vec2<i32>) -> Ray {
    if frame.is_perspective == 0u {
        return Ray(vec3<f32>(0.0), 1.0, 1.0);
    }
    let tangent = (vec2<f32>(at) - frame.centre) / frame.focal;
    let along = frame.rays[2].xyz + frame.rays[0].xyz * tangent.x - frame.rays[1].xyz * tangent.y;
    let per_square = 1.0 / max(dot(along, along), 1.17549435e-38);
    let per_length = sqrt(per_square);
    return Ray(along * per_length, per_square, sqrt(1.0 + dot(tangent, tangent)) * per_length);
}

// Returns exp(z^2 / 2) Phi(-z) for z of 0 to 6, Phi the normal distribution. Polynomial: near.rs.
fn tail_ratio(z: f32) -> f32 {
    let q = 1.0 / (1.0 + 0.28 * z);
    let square = q * q;
    let low = -0.00111121 + 0.12590596 * q;
    let middle = 0.0351744 + 0.3271355 * q;
    let high = (-0.29495274 + 0.42014379 * q) + -0.11229558 * square;
    return low + square * (middle + square * high);
}

// Returns the optical depth of a voxel near the eye on a ray, in units of ln 2: near.rs, depths.
fn near_depth(offset: vec3<f32>, at_eye: f32, peak: f32, ray: Ray) -> f32 {
    let aside = cross(offset, ray.direction);
    let q = 0.5 * LOG2_E / (frame.near_sigma * frame.near_sigma) * dot(aside, aside);
    let t = dot(offset, ray.direction);
    var weight = at_eye * tail_ratio(min(abs(t) / frame.near_sigma, 6.0));
    if t > 0.0 {
        weight = max(select(0.0, exp2(-q), q <= frame.cut_exponent) - weight, 0.0);
    }
    return min(peak * (frame.rays[2].w * ray.stretch), frame.max_depth) * weight;
}

// Returns a splat's optical depth on a pixel's ray, in units of ln 2; 0 outside its kernel. `dx`, `dy`: from the centre of its
// footprint to the pixel. Of a voxel near the eye, the numbers are as project.wgsl stores them.
fn splat_depth(dx: f32, dy: f32, falloff_x: f32, falloff_y: f32, shear: f32, peak: f32, ray: Ray) -> f32 {
    if HAS_NEAR && falloff_y < 0.0 {
        return near_depth(vec3<f32>(dx, dy, falloff_x), shear, peak, ray);
    }
    let u = dx - shear * dy;
    let q = (falloff_x * (u * u) + falloff_y * (dy * dy)) * ray.per_square;
    return select(0.0, min(peak * ray.stretch, frame.max_depth) * exp2(-q), q <= frame.cut_exponent);
}
