// Stage: resolve. In: the window's pixels as they were accumulated. Out: colours in a texture, premultiplied, linear.
// Rust's side: resolve.rs, Finish in composite.rs.

struct Finish {
    // The window's first column and row, one past the last.
    window: vec4<i32>,
    // Colour behind; the fourth is 1 if there is one.
    background: vec4<f32>,
    // One of the constants below.
    mode: u32,
    // Last entry of the ramp.
    last: u32,
    unused: vec2<u32>,
}

const TRANSMITTANCE: u32 = 0u;
const SUM: u32 = 1u;
const MAXIMUM: u32 = 2u;

@group(0) @binding(0) var<uniform> finish: Finish;
// Colours of normalised values.
@group(0) @binding(1) var<storage, read> ramp: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> pixels: array<vec4<f32>>;
@group(0) @binding(3) var target_pixels: texture_2d<f32>;

// A triangle over the whole window.
@vertex
fn corner(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn colour(value: vec4<f32>) -> vec4<f32> {
    var shown = vec4<f32>(value.x);
    if finish.mode == TRANSMITTANCE {
        shown = vec4<f32>(value.xyz, 1.0 - value.w);
    } else if finish.mode == SUM {
        let sum = clamp(value, vec4<f32>(0.0), vec4<f32>(125.0));
        shown = vec4<f32>(absorbed(sum.x), absorbed(sum.y), absorbed(sum.z), absorbed(sum.w));
    } else if finish.mode == MAXIMUM {
        let at = clamp(value.x, 0.0, 1.0) * f32(finish.last);
        let low = min(u32(at), finish.last - 1u);
        shown = vec4<f32>(value.x * mix(ramp[low].xyz, ramp[low + 1u].xyz, at - f32(low)), value.x);
    }
    let behind = finish.background.w * (1.0 - shown.w);
    return vec4<f32>(shown.xyz + behind * finish.background.xyz, shown.w + behind);
}

fn place(position: vec4<f32>) -> vec2<i32> {
    return vec2<i32>(floor(position.xy)) - finish.window.xy;
}

@fragment
fn from_buffer(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = place(position);
    return colour(pixels[u32(at.y * (finish.window.z - finish.window.x) + at.x)]);
}

@fragment
fn from_target(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return colour(textureLoad(target_pixels, place(position), 0));
}
