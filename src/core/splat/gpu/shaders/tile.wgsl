// Stage: tile. In: splats in visit order, their boxes, each tile's mask of batches. Out: the window's pixels.
// Twin: tests/gpu/twin/tile.rs
//
// A workgroup draws a tile and an invocation one pixel, which stays in registers from the first splat to the last. A round
// takes the next eight batches of the tile's mask, and each invocation tests eight consecutive boxes. The splats that meet
// the tile are fetched, 256 at a time; each cell of the tile then composites those that meet it. A cell has 32 pixels, as
// many as cards run at a time, so no splat is computed where it cannot show. What keeps a card waiting is how long one splat
// takes after the other, so two are computed side by side. A tile ends early where all of its pixels are below the
// termination threshold.
//
// A pixel of a maximum holds its largest finished sample, then the sums of the samples half a slice before, at and after
// its slice (cpu/scatter/maximum.rs). A chunk leaves all pixels at its own last slice.

@group(0) @binding(0) var<uniform> frame: FrameUniform;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> splats: array<SplatVectors>;
@group(0) @binding(3) var<storage, read> boxes: array<vec4<u32>>; // Two boxes in each.
@group(0) @binding(4) var<storage, read> masks: array<u32>;
@group(0) @binding(5) var<storage, read_write> pixels: array<vec4<f32>>;

// BLEND is the number of a BlendMode of stages.rs.
override BLEND: u32 = 0u;
const FRONT_TO_BACK: u32 = 0u;
const BACK_TO_FRONT: u32 = 1u;
const ADDITIVE: u32 = 2u;
const MAXIMUM: u32 = 3u;

const CELL_SIZE: vec2<u32> = vec2<u32>(8u, 4u); // Columns and rows of pixels of a cell; a row of a tile has two.
const CELLS: u32 = 8u;
const ROUND: u32 = 8u; // Batches of a round. An invocation tests as many boxes of one batch.
const HIT_WORDS: u32 = 64u; // 32-bit words with a bit for each splat of a round.
const FETCHED_WORDS: u32 = 8u; // 32-bit words with a bit for each fetched splat.
const NO_BATCH: u32 = 0xffffffffu;

// A place in the tile's row of masks.
struct MaskPlace {
    batch: u32, // The batch that was found last; NO_BATCH at the end.
    word: u32, // What is left of the current word of the mask.
    index: u32, // Its index in the mask.
    summary: u32, // What is left of the current word of the summary.
    next_summary: u32, // Index of the next one.
}

struct RoundState {
    hits: u32, // How many splats of the round meet the tile.
    open_round: u32, // The last round, counted from 1, before which a pixel was open.
}

// Bits of the splats of a round that meet the tile, and their number in each batch, for two rounds in turn: while one is read,
// the other is cleared.
var<workgroup> hits: array<atomic<u32>, 2u * HIT_WORDS>;
var<workgroup> counts: array<atomic<u32>, 2u * ROUND>;
var<workgroup> state: RoundState;
var<workgroup> slots: array<u32, BATCH>; // Slots of the splats that are fetched.
var<workgroup> fetched: array<SplatVectors, BATCH>;
var<workgroup> cell_hits: array<atomic<u32>, CELLS * FETCHED_WORDS>; // Bits of the fetched splats that meet a cell.
var<private> slice: f32; // In a maximum: the slice of the pixel's sums.
var<private> ray: Ray; // The pixel's, in other modes.

// Returns the pixel after a splat that absorbs, or in an additive mode adds, this amount.
fn blend(pixel: vec4<f32>, colour: vec3<f32>, amount: f32) -> vec4<f32> {
    if BLEND == FRONT_TO_BACK {
        return pixel + pixel.w * amount * vec4<f32>(colour, -1.0);
    }
    if BLEND == BACK_TO_FRONT {
        return pixel + amount * (vec4<f32>(colour, 0.0) - pixel);
    }
    return pixel + amount * vec4<f32>(colour, 1.0);
}

// Returns a pixel whose sums that voxels `slices` slices ahead cannot add to are compared with its largest sample.
fn advanced(pixel: vec4<f32>, slices: f32) -> vec4<f32> {
    let finished = max(max(pixel.x, pixel.y), pixel.z);
    if slices == 1.0 {
        return vec4<f32>(finished, pixel.w, 0.0, 0.0);
    }
    return vec4<f32>(max(finished, pixel.w), 0.0, 0.0, 0.0);
}

// Returns the weight of linear interpolation at a distance in voxels; 0 for NaN.
fn tent(distance: f32) -> f32 {
    return select(0.0, 1.0 - abs(distance), abs(distance) < 1.0);
}

// Returns the weights of a voxel in the samples half a slice before it, at it and half a slice after it, at a pixel `dx`,
// `dy` pixels from it; if its closeness is 0, from the picture's centre.
fn sample_weights(shape: vec4<f32>, closeness: f32, dx: f32, dy: f32) -> vec3<f32> {
    let moved = vec3<f32>(
        frame.sample_rays[0].x * dx + frame.sample_rays[0].y * dy,
        frame.sample_rays[1].x * dx + frame.sample_rays[1].y * dy,
        frame.sample_rays[2].x * dx + frame.sample_rays[2].y * dy,
    );
    var apart = moved.yz;
    var step = vec2<f32>(frame.sample_rays[1].z, frame.sample_rays[2].z);
    var shares = vec3<f32>(0.5, 1.0, 0.5);
    if frame.is_perspective == 1u {
        // The ray of the pixel that the others are counted from, and by how much it misses the voxel: the ray of the voxel's own
        // pixel does not.
        var base = shape.zxy * closeness;
        var missed = vec2<f32>(0.0);
        if closeness == 0.0 {
            base = vec3<f32>(frame.sample_rays[0].w, frame.sample_rays[1].w, frame.sample_rays[2].w);
            missed = base.yz * shape.z - shape.xy * base.x;
        }
        let along = base.x + moved.x;
        apart = (missed + (moved.yz * shape.z - shape.xy * moved.x)) / along;
        step = 0.5 * (base.yz + moved.yz) / along;
        let depths = (vec3<f32>(shape.z) + vec3<f32>(-0.5, 0.0, 0.5)) / along;
        shares = select(vec3<f32>(0.0), shares, depths >= vec3<f32>(frame.near));
    }
    return shares * vec3<f32>(
        tent(apart.x - step.x) * tent(apart.y - step.y),
        tent(apart.x) * tent(apart.y),
        tent(apart.x + step.x) * tent(apart.y + step.y),
    );
}

fn is_open(pixel: vec4<f32>) -> bool {
    return BLEND != FRONT_TO_BACK || pixel.w >= frame.termination;
}

// Returns the distance of the pixel `at` from a splat's centre, in pixels; of a voxel near the eye as in Splat.
fn from_centre(s: SplatVectors, at: vec2<i32>) -> vec2<f32> {
    let is_near = HAS_NEAR && BLEND != MAXIMUM && s.shape.y < 0.0;
    let from_first = vec2<f32>(at - vec2<i32>(low_half(s.place.x), low_half(s.place.y)));
    return bitcast<vec2<f32>>(s.place.zw) + select(from_first, vec2<f32>(0.0), is_near);
}

// Returns a splat's optical depth at the pixel `at`.
fn depth_of(s: SplatVectors, at: vec2<i32>) -> f32 {
    return splat_depth(from_centre(s, at), s.shape, s.colour.w, ray);
}

// Returns the pixel of a maximum after a splat.
fn with_samples(pixel: vec4<f32>, s: SplatVectors, at: vec2<i32>) -> vec4<f32> {
    var sums = pixel;
    if s.colour.x != slice {
        sums = advanced(sums, s.colour.x - slice);
        slice = s.colour.x;
    }
    let away = from_centre(s, at);
    return sums + vec4<f32>(0.0, s.shape.w * sample_weights(s.shape, s.colour.y, away.x, away.y));
}

// Returns the pixel after two of the fetched splats, or only the first if there is no second.
fn composite(pixel: vec4<f32>, first: u32, second: u32, has_second: bool, at: vec2<i32>) -> vec4<f32> {
    let a = fetched[first];
    let b = fetched[second];
    if BLEND == MAXIMUM {
        let sums = with_samples(pixel, a, at);
        if has_second {
            return with_samples(sums, b, at);
        }
        return sums;
    }
    let depths = vec2<f32>(depth_of(a, at), select(0.0, depth_of(b, at), has_second));
    var amounts = depths;
    if BLEND != ADDITIVE {
        amounts = vec2<f32>(absorbed(depths.x), absorbed(depths.y));
    }
    let after = blend(pixel, a.colour.xyz, amounts.x);
    if !is_open(after) {
        return after;
    }
    return blend(after, b.colour.xyz, amounts.y);
}

// Returns the place of the next batch in the tile's row of masks, which begins at `row` and has `summaries` words of
// summary in use.
fn next_batch(before: MaskPlace, row: u32, summaries: u32) -> MaskPlace {
    var place = before;
    while place.word == 0u {
        while place.summary == 0u {
            if place.next_summary == summaries {
                place.batch = NO_BATCH;
                return place;
            }
            place.summary = masks[row + place.next_summary];
            place.next_summary++;
        }
        place.index = 32u * (place.next_summary - 1u) + firstTrailingBit(place.summary);
        place.summary &= place.summary - 1u;
        place.word = masks[row + SUMMARY_WORDS + place.index];
    }
    place.batch = 32u * place.index + firstTrailingBit(place.word);
    place.word &= place.word - 1u;
    return place;
}

fn meets(columns: u32, rows: u32, corner: vec2<i32>) -> bool {
    let low = vec2<i32>(low_half(columns), low_half(rows));
    let high = vec2<i32>(high_half(columns), high_half(rows));
    // A splat without pixels begins after its end.
    return all(high >= max(low, corner)) && all(low < corner + TILE_SIDE);
}

// Notes which cells of the tile at `corner` the fetched splat `k` meets.
fn note_cells(k: u32, corner: vec2<i32>) {
    let columns = fetched[k].place.x;
    let rows = fetched[k].place.y;
    let low = max(vec2<i32>(low_half(columns), low_half(rows)) - corner, vec2<i32>(0));
    let high = min(vec2<i32>(high_half(columns), high_half(rows)) - corner, vec2<i32>(TILE_SIDE - 1));
    let first_cell = vec2<u32>(low) / CELL_SIZE;
    let last_cell = vec2<u32>(high) / CELL_SIZE;
    for (var row = first_cell.y; row <= last_cell.y; row++) {
        for (var column = first_cell.x; column <= last_cell.x; column++) {
            atomicOr(&cell_hits[(2u * row + column) * FETCHED_WORDS + (k >> 5u)], 1u << (k & 31u));
        }
    }
}

// Writes to `slots` the slots of an invocation's hits, the first of which is the hit `rank` of those that are fetched next.
fn list_slots(hits_here: u32, first_slot: u32, rank: u32) {
    var bits = hits_here;
    for (var place = rank; bits != 0u; place++) {
        // Hits that are not fetched now have other places; those before have wrapped.
        if place < BATCH {
            slots[place] = first_slot + firstTrailingBit(bits);
        }
        bits &= bits - 1u;
    }
}

@compute @workgroup_size(256)
fn tile(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let corner = frame.window.xy + vec2<i32>(group.xy) * TILE_SIDE;
    let cell = local >> 5u; // The invocation's cell; also which of the round's batches it tests.
    let in_cell = local & 31u;
    let place = CELL_SIZE * vec2<u32>(cell & 1u, cell >> 1u) + vec2<u32>(in_cell & 7u, in_cell >> 3u);
    let at = corner + vec2<i32>(place);
    let is_inside = all(at < frame.window.zw);
    let width = u32(frame.window.z - frame.window.x);
    let index = u32(at.y - frame.window.y) * width + u32(at.x - frame.window.x);
    var pixel = vec4<f32>(0.0, 0.0, 0.0, frame.initial_alpha);
    if is_inside && chunk.is_first == 0u {
        pixel = pixels[index];
    }
    slice = f32(chunk.from_slice);
    if BLEND != MAXIMUM {
        ray = ray_at(at);
    }
    let row = (group.y * frame.tile_columns + group.x) * frame.mask_words;
    let summaries = (chunk.slot_count + 1024u * BATCH - 1u) / (1024u * BATCH);
    var mask_place = MaskPlace(NO_BATCH, 0u, 0u, 0u, 0u);
    for (var number = 1u;; number++) {
        mask_place = next_batch(mask_place, row, summaries);
        if mask_place.batch == NO_BATCH {
            break;
        }
        var batch = mask_place.batch;
        for (var k = 1u; k < ROUND; k++) {
            mask_place = next_batch(mask_place, row, summaries);
            if k <= cell {
                batch = mask_place.batch;
            }
        }
        let first_slot = batch * BATCH + ROUND * in_cell;
        var hit_bits = 0u; // A bit for each of the invocation's splats that meets the tile.
        if batch != NO_BATCH {
            for (var k = 0u; k < ROUND; k += 2u) {
                let box_pair = boxes[(first_slot + k) / 2u];
                hit_bits |= select(0u, 1u, meets(box_pair.x, box_pair.y, corner)) << k;
                hit_bits |= select(0u, 2u, meets(box_pair.z, box_pair.w, corner)) << k;
            }
        }
        let turn = number & 1u;
        let word = turn * HIT_WORDS + local / 4u; // Four invocations share a word of `hits`.
        let shift = 8u * (local & 3u);
        if hit_bits != 0u {
            atomicOr(&hits[word], hit_bits << shift);
            atomicAdd(&counts[turn * ROUND + cell], countOneBits(hit_bits));
        }
        workgroupBarrier();
        // In visit order, the invocation's hits come after those of the invocations before it.
        var rank = countOneBits(atomicLoad(&hits[word]) & ((1u << shift) - 1u));
        for (var k = word & ~7u; k < word; k++) {
            rank += countOneBits(atomicLoad(&hits[k]));
        }
        var count = 0u;
        for (var k = 0u; k < ROUND; k++) {
            let batch_hits = atomicLoad(&counts[turn * ROUND + k]);
            rank += select(0u, batch_hits, k < cell);
            count += batch_hits;
        }
        if local == 0u {
            state.hits = count;
        }
        // All that store here store the same number.
        if is_inside && is_open(pixel) {
            state.open_round = number;
        }
        if local < HIT_WORDS {
            atomicStore(&hits[(1u - turn) * HIT_WORDS + local], 0u);
        }
        if local < ROUND {
            atomicStore(&counts[(1u - turn) * ROUND + local], 0u);
        }
        list_slots(hit_bits, first_slot, rank);
        let round_state = workgroupUniformLoad(&state);
        if round_state.open_round != number {
            break;
        }
        for (var done = 0u; done < round_state.hits; done += BATCH) {
            if done > 0u {
                list_slots(hit_bits, first_slot, rank - done);
                workgroupBarrier();
            }
            if local < round_state.hits - done {
                fetched[local] = splats[slots[local]];
                note_cells(local, corner);
            }
            workgroupBarrier();
            for (var w = 0u; w < FETCHED_WORDS; w++) {
                var hit = atomicLoad(&cell_hits[cell * FETCHED_WORDS + w]);
                while hit != 0u && is_open(pixel) {
                    let first = firstTrailingBit(hit);
                    hit &= hit - 1u;
                    let has_second = hit != 0u;
                    let second = select(first, firstTrailingBit(hit), has_second);
                    hit &= hit - u32(has_second);
                    pixel = composite(pixel, 32u * w + first, 32u * w + second, has_second, at);
                }
            }
            workgroupBarrier();
            if local < CELLS * FETCHED_WORDS {
                atomicStore(&cell_hits[local], 0u);
            }
        }
    }
    if BLEND == MAXIMUM && slice != f32(chunk.to_slice) {
        pixel = advanced(pixel, f32(chunk.to_slice) - slice);
    }
    if is_inside {
        pixels[index] = pixel;
    }
}
