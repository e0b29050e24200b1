// Quads through a list of indices: instance k is splat ranks[k]. This text stands after common.wgsl and splat.wgsl.

@group(0) @binding(2) var<storage, read> ranks: array<u32>;

@vertex
fn ranked_corner(@builtin(vertex_index) vertex: u32, @builtin(instance_index) rank: u32) -> Corner {
    let slot = ranks[rank];
    let columns = splats[slot].columns;
    let rows = splats[slot].rows;
    let x = select(low_half(columns), high_half(columns) + 1, (vertex & 1u) == 1u);
    let y = select(low_half(rows), high_half(rows) + 1, (vertex & 2u) == 2u);
    let size = vec2<f32>(frame.window.zw - frame.window.xy);
    let at = vec2<f32>(vec2<i32>(x, y) - frame.window.xy) / size;
    return Corner(vec4<f32>(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, 0.0, 1.0), slot);
}
