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

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat, either) slot: u32,
}

// Returns the corner `k` of a splat's triangles, 0 to 5; all corners of a slot without a splat are at one place.
fn corner_of(slot: u32, k: u32) -> Corner {
    let columns = splats[slot].columns;
    let rows = splats[slot].rows;
    let low = max(vec2<i32>(low_half(columns), low_half(rows)), frame.window.xy);
    let high = min(vec2<i32>(high_half(columns), high_half(rows)) + 1, frame.window.zw);
    let is_nothing = columns == NOTHING;
    let x = select(low.x, high.x, (k == 1u || k >= 4u) && !is_nothing);
    let y = select(low.y, high.y, (k == 2u || k == 3u || k == 5u) && !is_nothing);
    let size = vec2<f32>(frame.window.zw - frame.window.xy);
    let at = vec2<f32>(vec2<i32>(x, y) - frame.window.xy) / size;
    return Corner(vec4<f32>(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, 0.0, 1.0), slot);
}

@vertex
fn corner(@builtin(vertex_index) vertex: u32) -> Corner {
    return corner_of(vertex / 6u, vertex % 6u);
}

@fragment
fn pixel(in: Corner) -> @location(0) vec4<f32> {
    let splat = splats[in.slot];
    let at = vec2<i32>(floor(in.position.xy)) + frame.window.xy;
    let from_low = vec2<f32>(at - vec2<i32>(low_half(splat.columns), low_half(splat.rows)));
    let away = select(from_low, vec2<f32>(0.0), splat.falloff_y < 0.0);
    let dx = splat.corner_x + away.x;
    let dy = splat.corner_y + away.y;
    let depth = splat_depth(dx, dy, splat.falloff_x, splat.falloff_y, splat.shear, splat.peak, at);
    let colour = vec4<f32>(splat.red, splat.green, splat.blue, 1.0);
    return colour * select(absorbed(depth), depth, BLEND == ADDITIVE);
}
