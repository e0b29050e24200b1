// Shared by the stages tile and splat: the optical depth of a splat at a pixel, also of voxels near the eye, which are
// integrated along the pixel's ray. It stands between common.wgsl and the stage's own text. near.rs explains it.
// Twin: tests/gpu/twin/near.rs

// Whether splats may be of voxels near the eye. In software the test costs time (docs/studies/gpu.md). The study of order
// keeps the default.
override HAS_NEAR: bool = true;

// The ray of a pixel.
struct Ray {
    direction: vec3<f32>, // Unit vector in voxel coordinates.
    strength: f32, // Peak of a kernel of optical depth 1.
}

// Returns the ray of the pixel `at` in a perspective view.
fn ray_at(at: vec2<i32>) -> Ray {
    let tangent = (vec2<f32>(at) - frame.centre) / frame.focal;
    let along = frame.rays[2].xyz + frame.rays[0].xyz * tangent.x - frame.rays[1].xyz * tangent.y;
    let per_length = inverseSqrt(max(dot(along, along), 1.17549435e-38));
    let stretch = sqrt(1.0 + dot(tangent, tangent)) * per_length;
    return Ray(along * per_length, frame.rays[2].w * stretch);
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
    return min(peak * ray.strength, frame.max_depth) * weight;
}

// Returns a splat's optical depth at the pixel `at`, in units of ln 2; 0 outside its kernel. `dx`, `dy`: from the centre
// of its footprint to the pixel. Of a voxel near the eye, the numbers are as project.wgsl stores them.
fn splat_depth(dx: f32, dy: f32, falloff_x: f32, falloff_y: f32, shear: f32, peak: f32, at: vec2<i32>) -> f32 {
    if HAS_NEAR && falloff_y < 0.0 {
        return near_depth(vec3<f32>(dx, dy, falloff_x), shear, peak, ray_at(at));
    }
    return depth_at(dx, dy, falloff_x, falloff_y, shear, peak, frame.cut_exponent);
}
