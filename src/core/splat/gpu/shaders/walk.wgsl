// Stage: walk. In: a slab of a lane as the file has it, its lines in visit order. Out: voxels in visit order.
// Twin: twin/walk.rs
//
// One invocation follows the steps of one scan line; a workgroup has the lines of one block. Every record has a place,
// so that a line's places follow from the directory alone; a stepping voxel leaves its own empty. A line is read from
// its low end, or from the eye's coordinate to both ends; back to front is the reverse of front to back.
//
// Nothing read from the lane is trusted: a line that is out of bounds has no records, and its places are few enough.

// A tile of the face, word by word: arena/layout.rs, TileRecord.
struct Tile {
    // tile_u in the low half, tile_v in the high half.
    tile_uv: u32,
    first_line: u32,
    first_record: u32,
    first_record_high: u32,
    occupancy: u32,
    occupancy_high: u32,
    // low in the low half, high in the high half.
    low_high: u32,
}

// Up to 64 lines of the list, and where their voxels go.
struct Block {
    first_line: u32,
    line_count: u32,
    first_slot: u32,
    // One past the last.
    end_slot: u32,
}

@group(0) @binding(0) var<uniform> shot: Shot;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> tiles: array<Tile>;
@group(0) @binding(3) var<storage, read> line_ends: array<u32>;
@group(0) @binding(4) var<storage, read> steps: array<u32>;
// Tile in the high 26 bits, line of the tile in the low 6.
@group(0) @binding(5) var<storage, read> lines: array<u32>;
@group(0) @binding(6) var<storage, read> blocks: array<Block>;
@group(0) @binding(7) var<storage, read_write> voxels: array<Voxel>;

// Lines of a block.
const LINES: u32 = 64u;
// What a stepping voxel advances.
const STEPPING: i32 = 255;

var<workgroup> ends: array<u32, LINES>;

fn line_end(line: u32) -> u32 {
    if shot.line_end_bytes == 4u {
        return line_ends[line];
    }
    return (line_ends[line >> 1u] >> (16u * (line & 1u))) & 0xffffu;
}

fn step_byte(record: u32) -> i32 {
    return i32((steps[record >> 2u] >> (8u * (record & 3u))) & 0xffu);
}

fn distance(step: i32) -> i32 {
    return select(step, STEPPING, step == 0);
}

fn put(slot: u32, at: i32, line: vec2<u32>, record: u32, step: i32) {
    let along = u32(at) & 0xffffu;
    var xyz = vec3<u32>(along, line.x, line.y);
    if shot.fast_axis == 1u {
        xyz = vec3<u32>(line.x, along, line.y);
    } else if shot.fast_axis == 2u {
        xyz = vec3<u32>(line.x, line.y, along);
    }
    voxels[slot] = Voxel(xyz.x | (xyz.y << 16u), xyz.z, select(record, NO_RECORD, step == 0));
}

@compute @workgroup_size(64)
fn walk(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = blocks[chunk.first_block + group.x];
    var first = 0u;
    var count = 0u;
    var line = vec2<u32>(0u, 0u);
    if local < block.line_count {
        let entry = lines[block.first_line + local];
        let tile = tiles[entry >> 6u];
        let bit = entry & 63u;
        let below = (1u << (bit & 31u)) - 1u;
        let is_high = bit >= 32u;
        let rank = countOneBits(tile.occupancy & select(below, 0xffffffffu, is_high))
            + countOneBits(tile.occupancy_high & select(0u, below, is_high));
        let index = tile.first_line + rank;
        var start = 0u;
        if rank > 0u {
            start = line_end(index - 1u);
        }
        first = tile.first_record + start;
        count = min(line_end(index) - start, shot.longest);
        line = vec2<u32>(8u * (tile.tile_uv & 0xffffu) + (bit & 7u), 8u * (tile.tile_uv >> 16u) + (bit >> 3u));
    }
    ends[local] = count;
    workgroupBarrier();
    for (var reach = 1u; reach < LINES; reach = 2u * reach) {
        var before = 0u;
        if local >= reach {
            before = ends[local - reach];
        }
        workgroupBarrier();
        ends[local] += before;
        workgroupBarrier();
    }
    let first_slot = block.first_slot + ends[local] - count;
    if first_slot > block.end_slot || count > block.end_slot - first_slot {
        return;
    }
    let last_slot = first_slot + count - 1u;

    if shot.fast_order <= DESCENDING {
        var at = -1;
        for (var k = 0u; k < count; k++) {
            let step = step_byte(first + k);
            at += distance(step);
            put(select(first_slot + k, last_slot - k, shot.fast_order == DESCENDING), at, line, first + k, step);
        }
        return;
    }

    // From where the eye's plane meets the line to both of its ends.
    var high = 0u;
    var low_at = -1;
    var high_at = -1;
    while high < count {
        high_at = low_at + distance(step_byte(first + high));
        if high_at >= shot.eye_ceil {
            break;
        }
        low_at = high_at;
        high++;
    }
    var low = high;
    for (var k = 0u; k < count; k++) {
        // The nearer side; the high one where they are as near. Split: the high side first.
        let low_is_nearer = shot.fast_order == INTERLEAVED && low_at + high_at > shot.eye_twice;
        let slot = select(first_slot + k, last_slot - k, shot.back_to_front == 1u);
        if low > 0u && (high >= count || low_is_nearer) {
            low--;
            let step = step_byte(first + low);
            put(slot, low_at, line, first + low, step);
            low_at -= distance(step);
        } else {
            put(slot, high_at, line, first + high, step_byte(first + high));
            high++;
            if high < count {
                high_at += distance(step_byte(first + high));
            }
        }
    }
}
