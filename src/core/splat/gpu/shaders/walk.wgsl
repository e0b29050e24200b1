// Stage: walk. In: a slab (part of a lane) as it is in the file, lines in visit order. Out: voxels in visit order.
// Twin: tests/gpu/twin/walk.rs
//
// An invocation follows the steps of one scan line; a workgroup, the lines of one block. Each record has a slot, so the
// slots of a line follow from the line ends alone; a stepping record (one without a voxel) leaves its slot empty. A
// line is read from its low end, or from the eye's coordinate toward both ends; back to front is the reverse of front
// to back. Nothing read from the lane is trusted: a line out of bounds has no records, and line lengths are bounded.

// A tile of 8 x 8 lines of the lane, word by word: arena/layout.rs, TileRecord.
struct Tile {
    tile_uv: u32, // tile_u in the low half, tile_v in the high half.
    first_line: u32,
    first_record: u32,
    first_record_high: u32,
    occupancy: u32,
    occupancy_high: u32,
    low_high: u32, // TileRecord's low in the low half, its high in the high half.
}

// Up to 64 consecutive lines of the line list, and the slots of their records.
struct LineBlock {
    first_line: u32, // Index of the first line in `lines`.
    line_count: u32, // 1 to LINES.
    first_slot: u32, // Slot of the first record in the chunk.
    end_slot: u32, // One past the slot of the last record.
}

@group(0) @binding(0) var<uniform> frame: FrameUniform;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> tiles: array<Tile>;
@group(0) @binding(3) var<storage, read> line_ends: array<u32>;
@group(0) @binding(4) var<storage, read> steps: array<u32>;
// Stage project has no binding left for it, so the walk hands a voxel's coverage on.
@group(0) @binding(5) var<storage, read> coverages: array<u32>;
// The high 26 bits are the index of a tile, the low 6 bits a line of that tile.
@group(0) @binding(6) var<storage, read> lines: array<u32>;
@group(0) @binding(7) var<storage, read> blocks: array<LineBlock>;
@group(0) @binding(8) var<storage, read_write> voxels: array<vec4<u32>>; // VisitedVoxels.

const LINES: u32 = 64u; // Most lines of a block.
const STEPPING: i32 = 255; // By how many voxels a stepping record advances; its step byte is 0.

var<workgroup> ends: array<u32, LINES>;

fn line_end(line: u32) -> u32 {
    if frame.line_end_bytes == 4u {
        return line_ends[line];
    }
    return (line_ends[line >> 1u] >> (16u * (line & 1u))) & 0xffffu;
}

fn step_byte(record: u32) -> i32 {
    return i32((steps[record >> 2u] >> (8u * (record & 3u))) & 0xffu);
}

fn coverage_code(record: u32) -> u32 {
    if frame.coverage_bits == 0u {
        return 0u;
    }
    if frame.coverage_bits == 8u {
        return (coverages[record >> 2u] >> (8u * (record & 3u))) & 0xffu;
    }
    return (coverages[record >> 1u] >> (16u * (record & 1u))) & 0xffffu;
}

fn distance(step: i32) -> i32 {
    return select(step, STEPPING, step == 0);
}

fn write_voxel(slot: u32, at: i32, line: vec2<u32>, record: u32, step: i32) {
    let coordinate = u32(at) & 0xffffu;
    var xyz = vec3<u32>(coordinate, line.x, line.y);
    if frame.nesting.z == 1u {
        xyz = vec3<u32>(line.x, coordinate, line.y);
    } else if frame.nesting.z == 2u {
        xyz = vec3<u32>(line.x, line.y, coordinate);
    }
    let z_coverage = xyz.z | (coverage_code(record) << 16u);
    voxels[slot] = vec4<u32>(xyz.x | (xyz.y << 16u), z_coverage, select(record, NO_RECORD, step == 0), 0u);
}

// The records of a line, and the slots of their voxels.
struct Records {
    first: u32,
    count: u32,
    first_slot: u32,
    line: vec2<u32>,
}

// The two sides of a line that is visited from the eye's coordinate on. Below it, `low` records are left, the next of them at
// `low_at`; above it, those from `high` on, the next of them at `high_at`.
struct Sides {
    low: u32,
    high: u32,
    low_at: i32,
    high_at: i32,
}

// Returns the slot of the voxel that is visited as number `k`.
fn slot_of(records: Records, k: u32, is_back_to_front: bool) -> u32 {
    return select(records.first_slot + k, records.first_slot + records.count - 1u - k, is_back_to_front);
}

// Writes the voxel of record `k` of a line that is read from its low end, if there is one; returns its coordinate. The record
// before is at `before`.
fn visit(records: Records, k: u32, before: i32) -> i32 {
    if k >= records.count {
        return before;
    }
    let step = step_byte(records.first + k);
    let at = before + distance(step);
    write_voxel(slot_of(records, k, frame.fast_order == DESCENDING), at, records.line, records.first + k, step);
    return at;
}

// Passes over the next record below the eye's coordinate; returns false if there is none.
fn pass_below(records: Records, sides: ptr<function, Sides>) -> bool {
    if (*sides).high >= records.count {
        return false;
    }
    (*sides).high_at = (*sides).low_at + distance(step_byte(records.first + (*sides).high));
    if (*sides).high_at >= frame.eye_ceil {
        return false;
    }
    (*sides).low_at = (*sides).high_at;
    (*sides).high++;
    return true;
}

// Writes the voxel that is visited as number `k` from the eye's coordinate on, if there is one. Interleaved: the nearer voxel first; at
// equal distance, the high one. Split: all voxels of the high side first.
fn visit_nearer(records: Records, k: u32, sides: ptr<function, Sides>) {
    if k >= records.count {
        return;
    }
    let low_is_nearer = frame.fast_order == INTERLEAVED && (*sides).low_at + (*sides).high_at > frame.eye_twice;
    let slot = slot_of(records, k, frame.is_back_to_front == 1u);
    if (*sides).low > 0u && ((*sides).high >= records.count || low_is_nearer) {
        (*sides).low--;
        let record = records.first + (*sides).low;
        let step = step_byte(record);
        write_voxel(slot, (*sides).low_at, records.line, record, step);
        (*sides).low_at -= distance(step);
        return;
    }
    let record = records.first + (*sides).high;
    write_voxel(slot, (*sides).high_at, records.line, record, step_byte(record));
    (*sides).high++;
    if (*sides).high < records.count {
        (*sides).high_at += distance(step_byte(record + 1u));
    }
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
        let lower_bits = (1u << (bit & 31u)) - 1u;
        let is_high = bit >= 32u;
        let rank = countOneBits(tile.occupancy & select(lower_bits, 0xffffffffu, is_high))
            + countOneBits(tile.occupancy_high & select(0u, lower_bits, is_high));
        let index = tile.first_line + rank;
        var start = 0u;
        if rank > 0u {
            start = line_end(index - 1u);
        }
        first = tile.first_record + start;
        count = min(line_end(index) - start, frame.longest_line);
        line = vec2<u32>(8u * (tile.tile_uv & 0xffffu) + (bit & 7u), 8u * (tile.tile_uv >> 16u) + (bit >> 3u));
    }
    ends[local] = count;
    workgroupBarrier();
    for (var stride = 1u; stride < LINES; stride = 2u * stride) {
        var previous = 0u;
        if local >= stride {
            previous = ends[local - stride];
        }
        workgroupBarrier();
        ends[local] += previous;
        workgroupBarrier();
    }
    let first_slot = block.first_slot + ends[local] - count;
    if first_slot > block.end_slot || count > block.end_slot - first_slot {
        return;
    }
    // Four records a turn: llvmpipe before version 25 ends the loops of an invocation after 65,535 turns in all, and a line may have
    // as many records.
    let records = Records(first, count, first_slot, line);
    if frame.fast_order <= DESCENDING {
        var at = -1;
        for (var k = 0u; k < count; k += 4u) {
            at = visit(records, k, at);
            at = visit(records, k + 1u, at);
            at = visit(records, k + 2u, at);
            at = visit(records, k + 3u, at);
        }
        return;
    }

    // This visits the line from the eye's coordinate toward both ends.
    var sides = Sides(0u, 0u, -1, -1);
    loop {
        if !pass_below(records, &sides) || !pass_below(records, &sides) || !pass_below(records, &sides) || !pass_below(records, &sides) {
            break;
        }
    }
    sides.low = sides.high;
    for (var k = 0u; k < count; k += 4u) {
        visit_nearer(records, k, &sides);
        visit_nearer(records, k + 1u, &sides);
        visit_nearer(records, k + 2u, &sides);
        visit_nearer(records, k + 3u, &sides);
    }
}
