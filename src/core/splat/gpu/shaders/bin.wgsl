// Stage: bin. In: splats in visit order. Out: for each tile of the window a mask of the batches with splats on it.
// Twin: twin/bin.rs
//
// Bits are in visit order, so that a tile finds its batches in order and nothing is sorted; a mask has a fixed size,
// so that nothing can overflow, however large splats are.

@group(0) @binding(0) var<uniform> shot: Shot;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read_write> masks: array<atomic<u32>>;

@compute @workgroup_size(256)
fn bin(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let batch = group.x;
    let slot = batch * BATCH + local;
    let columns = splats[slot].columns;
    if columns == NOTHING {
        return;
    }
    let rows = splats[slot].rows;
    let bit = 1u << (batch & 31u);
    let low = max(vec2<i32>(low_half(columns), low_half(rows)), shot.window.xy);
    let high = min(vec2<i32>(high_half(columns), high_half(rows)), shot.window.zw - 1);
    let first = (low - shot.window.xy) / TILE;
    let last = (high - shot.window.xy) / TILE;
    for (var row = first.y; row <= last.y; row++) {
        for (var column = first.x; column <= last.x; column++) {
            let tile = u32(row) * shot.tile_columns + u32(column);
            let word = tile * shot.mask_words + (batch >> 5u);
            // Most splats find that a neighbour was here: a look is cheaper than a change.
            if (atomicLoad(&masks[word]) & bit) == 0u {
                atomicOr(&masks[word], bit);
            }
        }
    }
}
