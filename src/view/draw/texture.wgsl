// A picture that fills the viewport.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var filtering: sampler;

struct Corner {
    @builtin(position) place: vec4f,
    @location(0) share: vec2f,
}

// One triangle, twice as large as the viewport along each axis.
@vertex
fn corner(@builtin(vertex_index) index: u32) -> Corner {
    let share = vec2f(f32(index & 1u), f32(index >> 1u)) * 2.0;
    return Corner(vec4f(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y, 0.0, 1.0), share);
}

@fragment
fn colour(corner: Corner) -> @location(0) vec4f {
    return textureSample(picture, filtering, corner.share);
}
