// Stage: resolve. In: the window's accumulated pixels. Out: linear premultiplied colours in a texture.
// Rust's side: resolve.rs; the formulas are those of Table::finish in composite.rs. Tested by tests/gpu/embed.rs.

struct ResolveUniform {
    window: vec4<i32>, // First column and row, one past the last column and row.
    background: vec4<f32>, // Linear colour of the background; w is 1 if there is a background, else 0.
    mode: u32, // The number of a Mode of composite.rs, which says what pixels hold.
    last: u32, // Index of the ramp's last entry.
    unused: vec2<u32>,
}

const COMPOSITE: u32 = 0u;
const MAXIMUM: u32 = 1u;
const ADDITIVE: u32 = 3u;

@group(0) @binding(0) var<uniform> uniforms: ResolveUniform;
// The colours of normalised values, at equal steps from 0 to 1.
@group(0) @binding(1) var<storage, read> ramp: array<vec4<f32>>;
// Each fragment function has one of these two.
@group(0) @binding(2) var<storage, read> pixels: array<vec4<f32>>;
@group(0) @binding(2) var target_pixels: texture_2d<f32>;

// Returns a corner of a triangle that covers the whole window.
@vertex
fn corner(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn colour(value: vec4<f32>) -> vec4<f32> {
    // A maximum is the largest of its finished sample and its sums, which may round to above 1.
    let largest = min(max(max(value.x, value.y), max(value.z, value.w)), 1.0);
    var shown = vec4<f32>(largest);
    if uniforms.mode == COMPOSITE {
        shown = vec4<f32>(value.xyz, 1.0 - value.w);
    } else if uniforms.mode == ADDITIVE {
        let sum = clamp(value, vec4<f32>(0.0), vec4<f32>(125.0));
        shown = vec4<f32>(absorbed(sum.x), absorbed(sum.y), absorbed(sum.z), absorbed(sum.w));
    } else if uniforms.mode == MAXIMUM {
        let at = clamp(largest, 0.0, 1.0) * f32(uniforms.last);
        let low = min(u32(at), uniforms.last - 1u);
        shown = vec4<f32>(largest * mix(ramp[low].xyz, ramp[low + 1u].xyz, at - f32(low)), largest);
    }
    let behind = uniforms.background.w * (1.0 - shown.w);
    return vec4<f32>(shown.xyz + behind * uniforms.background.xyz, shown.w + behind);
}

fn in_window(position: vec4<f32>) -> vec2<i32> {
    return vec2<i32>(floor(position.xy)) - uniforms.window.xy;
}

@fragment
fn from_buffer(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = in_window(position);
    return colour(pixels[u32(at.y * (uniforms.window.z - uniforms.window.x) + at.x)]);
}

@fragment
fn from_target(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return colour(textureLoad(target_pixels, in_window(position), 0));
}
