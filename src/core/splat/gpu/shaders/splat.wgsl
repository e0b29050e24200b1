// Stage: splat. In: splats in visit order. Out: the window's pixels, blended by the device in the order of triangles.
// Twin: tests/gpu/twin/splat.rs
//
// Each splat is two triangles over its bounding box, six vertices in all. Instances of a quad would be blended alike, but
// SwiftShader takes two to three times as long for them (docs/studies/gpu.md). The blend states are in stages.rs.

@group(0) @binding(0) var<uniform> frame: FrameUniform;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;

// BLEND is the number of a BlendMode of stages.rs; a maximum is drawn in tiles only.
override BLEND: u32 = 0u;
const ADDITIVE: u32 = 2u;

// A pixel's numbers come with the corners: drivers in software take longer to load them for each pixel.
struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat, either) place: vec4<f32>, // First column and row in the window, `corner_x` and `corner_y`.
    @location(1) @interpolate(flat, either) shape: vec4<f32>, // `falloff_x`, `falloff_y`, `shear` and `peak`.
    @location(2) @interpolate(flat, either) colour: vec4<f32>, // `red`, `green`, `blue` and `on_rays`.
}

// Returns the corner `k` of a splat's triangles, 0 to 5; all corners of a slot without a splat are at one place.
fn corner_of(slot: u32, k: u32) -> Corner {
    let splat = splats[slot];
    let first = vec2<i32>(low_half(splat.columns), low_half(splat.rows)) - frame.window.xy;
    let last = vec2<i32>(high_half(splat.columns), high_half(splat.rows)) - frame.window.xy;
    let size = frame.window.zw - frame.window.xy;
    let low = max(first, vec2<i32>(0));
    let high = min(last + 1, size);
    let is_nothing = splat.columns == NOTHING;
    let x = select(low.x, high.x, (k == 1u || k >= 4u) && !is_nothing);
    let y = select(low.y, high.y, (k == 2u || k == 3u || k == 5u) && !is_nothing);
    let at = vec2<f32>(vec2<i32>(x, y)) / vec2<f32>(size);
    let position = vec4<f32>(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, 0.0, 1.0);
    let place = vec4<f32>(vec2<f32>(first), splat.corner_x, splat.corner_y);
    let shape = vec4<f32>(splat.falloff_x, splat.falloff_y, splat.shear, splat.peak);
    return Corner(position, place, shape, vec4<f32>(splat.red, splat.green, splat.blue, splat.on_rays));
}

@vertex
fn corner(@builtin(vertex_index) vertex: u32) -> Corner {
    return corner_of(vertex / 6u, vertex % 6u);
}

@fragment
fn pixel(in: Corner) -> @location(0) vec4<f32> {
    let at = floor(in.position.xy);
    // A voxel near the eye has no footprint.
    let away = in.place.zw + select(at - in.place.xy, vec2<f32>(0.0), HAS_NEAR && in.shape.y < 0.0);
    let of_picture = vec2<i32>(at) + frame.window.xy;
    let depth = splat_depth(away, in.shape, in.colour.w, ray_at(of_picture));
    return vec4<f32>(in.colour.xyz, 1.0) * select(absorbed(depth), depth, BLEND == ADDITIVE);
}
