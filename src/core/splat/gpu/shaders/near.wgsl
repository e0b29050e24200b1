// Shared by the stages tile and splat: the optical depth of a splat on a pixel's ray, also of voxels near the eye, which are
// integrated along it. It stands between common.wgsl and the stage's own text. near.rs explains it.
// Twin: tests/gpu/twin/near.rs

// Whether splats may be of voxels near the eye. In software the test costs time (docs/studies/gpu.md). The study of order
// keeps the default.
override HAS_NEAR: bool = true;

// The ray of a pixel.
struct Ray {
    direction: vec3<f32>, // Unit vector in voxel coordinates.
    per_square: f32, // One over the square of the direction's length before.
    stretch: f32, // Length in mean spacings for that length in voxel coordinates.
}

// Returns the ray of the pixel `at` in a perspective view; of no use in a parallel one.
fn ray_at(at: vec2<i32>) -> Ray {
    if frame.is_perspective == 0u {
        return Ray();
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

// Returns a splat's optical depth at a pixel, in units of ln 2; 0 outside its kernel. `away`: from the centre of its footprint to the
// pixel; of a voxel near the eye as in Splat. `shape`: as in SplatVectors.
fn splat_depth(away: vec2<f32>, shape: vec4<f32>, on_rays: f32, ray: Ray) -> f32 {
    if HAS_NEAR && shape.y < 0.0 {
        return near_depth(vec3<f32>(away, shape.x), shape.z, shape.w, ray);
    }
    let u = away.x - shape.z * away.y;
    var q = shape.x * (u * u) + shape.y * (away.y * away.y);
    var peak = shape.w;
    if on_rays == 1.0 {
        q *= ray.per_square;
        peak = min(peak * ray.stretch, frame.max_depth);
    }
    return select(0.0, peak * exp2(-q), q <= frame.cut_exponent);
}
