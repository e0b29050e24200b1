// Quads through a list of indices: quad k is splat ranks[k]. This text stands after common.wgsl and splat.wgsl.

@group(0) @binding(2) var<storage, read> ranks: array<u32>;

@vertex
fn ranked_corner(@builtin(vertex_index) vertex: u32) -> Corner {
    return corner_of(ranks[vertex / 6u], vertex % 6u);
}
