// Stage: bin. In: splats in visit order. Out: their boxes; for each tile of the window, a mask with a bit for each batch
// (256 consecutive splats), set if one of its splats lies on the tile.
// Twin: tests/gpu/twin/bin.rs
//
// Before a mask comes its summary: a bit for each word that is not 0. Bits are in visit order, so a tile finds its batches
// in order and nothing is sorted. A mask has a fixed size, so large splats cannot make it overflow.

@group(0) @binding(0) var<uniform> frame: FrameUniform;
@group(0) @binding(1) var<storage, read> splats: array<SplatVectors>;
// Columns and rows of each splat: tiles look at many boxes for each splat that they draw.
@group(0) @binding(2) var<storage, read_write> boxes: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> masks: array<atomic<u32>>;

@compute @workgroup_size(256)
fn bin(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let batch = group.x;
    let slot = batch * BATCH + local;
    let place = splats[slot].place;
    let columns = place.x;
    let rows = place.y;
    boxes[slot] = place.xy;
    if columns == NOTHING {
        return;
    }
    let bit = 1u << (batch & 31u);
    let low = max(vec2<i32>(low_half(columns), low_half(rows)), frame.window.xy);
    let high = min(vec2<i32>(high_half(columns), high_half(rows)), frame.window.zw - 1);
    let first = (low - frame.window.xy) / TILE_SIDE;
    let last = (high - frame.window.xy) / TILE_SIDE;
    for (var row = first.y; row <= last.y; row++) {
        for (var column = first.x; column <= last.x; column++) {
            let tile = u32(row) * frame.tile_columns + u32(column);
            let row_word = tile * frame.mask_words;
            let word = row_word + SUMMARY_WORDS + (batch >> 5u);
            // Most bits are already set by a neighbouring splat, and a load is cheaper than an atomic change.
            if (atomicLoad(&masks[word]) & bit) == 0u {
                if atomicOr(&masks[word], bit) == 0u {
                    atomicOr(&masks[row_word + (batch >> 10u)], 1u << ((batch >> 5u) & 31u));
                }
            }
        }
    }
}
