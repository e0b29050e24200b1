// Stage: tile. In: splats in visit order, the batches on each tile. Out: the window's pixels.
// Twin: twin/tile.rs
//
// One workgroup owns a tile, one invocation a pixel, whose values stay in registers from the first splat to the last.
// A batch is read once: each invocation fetches one splat and notes whether it meets the tile; then all pixels go
// through those that do. A tile ends where all of its pixels are below the stopping threshold.

@group(0) @binding(0) var<uniform> shot: Shot;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> masks: array<u32>;
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4<f32>>;

// cpu/blend.rs
override BLEND: u32 = 0u;
const FRONT_TO_BACK: u32 = 0u;
const BACK_TO_FRONT: u32 = 1u;
const ADDITIVE: u32 = 2u;
const WHOLE_CELL: f32 = 2.718281828459045;

struct Near {
    // From the splat's centre to the tile's first pixel.
    dx: f32,
    dy: f32,
    across: f32,
    along: f32,
    shear: f32,
    peak: f32,
}

var<workgroup> near: array<Near, BATCH>;
var<workgroup> inks: array<vec3<f32>, BATCH>;
var<workgroup> hits: array<atomic<u32>, 8>;
var<workgroup> any_open: u32;

fn blend(pixel: vec4<f32>, ink: vec3<f32>, depth: f32) -> vec4<f32> {
    if BLEND == FRONT_TO_BACK {
        return pixel + pixel.w * absorbed(depth) * vec4<f32>(ink, -1.0);
    }
    if BLEND == BACK_TO_FRONT {
        return pixel + absorbed(depth) * (vec4<f32>(ink, 0.0) - pixel);
    }
    if BLEND == ADDITIVE {
        return pixel + depth * vec4<f32>(ink, 1.0);
    }
    return max(pixel, min(vec4<f32>(depth * WHOLE_CELL), vec4<f32>(ink, 1.0)));
}

fn is_open(pixel: vec4<f32>) -> bool {
    return BLEND != FRONT_TO_BACK || pixel.w >= shot.stop;
}

// The pixel after splat `j` of the batch; `place`: the pixel in its tile.
fn composite(pixel: vec4<f32>, j: u32, place: vec2<f32>) -> vec4<f32> {
    let n = near[j];
    let depth = depth_at(n.dx + place.x, n.dy + place.y, n.across, n.along, n.shear, n.peak, shot.cut);
    if depth > 0.0 && is_open(pixel) {
        return blend(pixel, inks[j], depth);
    }
    return pixel;
}

@compute @workgroup_size(16, 16)
fn tile(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) place: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let corner = shot.window.xy + vec2<i32>(group.xy) * TILE;
    let at = corner + vec2<i32>(place.xy);
    let is_inside = all(at < shot.window.zw);
    let from_corner = vec2<f32>(place.xy);
    let width = u32(shot.window.z - shot.window.x);
    let index = u32(at.y - shot.window.y) * width + u32(at.x - shot.window.x);
    var pixel = vec4<f32>(0.0, 0.0, 0.0, shot.fourth);
    if is_inside && chunk.is_first == 0u {
        pixel = pixels[index];
    }
    let batches = (chunk.slot_count + BATCH - 1u) / BATCH;
    let words = (batches + 31u) / 32u;
    let first_word = (group.y * shot.tile_columns + group.x) * shot.mask_words;
    var is_done = false;
    for (var w = 0u; w < words && !is_done; w++) {
        var word = masks[first_word + w];
        while word != 0u && !is_done {
            let batch = 32u * w + firstTrailingBit(word);
            word &= word - 1u;
            workgroupBarrier();
            if local < 8u {
                atomicStore(&hits[local], 0u);
            }
            if local == 0u {
                any_open = 0u;
            }
            workgroupBarrier();
            if is_inside && is_open(pixel) {
                any_open = 1u;
            }
            let splat = splats[batch * BATCH + local];
            let low = vec2<i32>(low_half(splat.columns), low_half(splat.rows));
            let high = vec2<i32>(high_half(splat.columns), high_half(splat.rows));
            if all(low <= high) && all(high >= corner) && all(low < corner + TILE) {
                let dx = splat.corner_x + f32(corner.x - low.x);
                let dy = splat.corner_y + f32(corner.y - low.y);
                near[local] = Near(dx, dy, splat.across, splat.along, splat.shear, splat.peak);
                inks[local] = vec3<f32>(splat.red, splat.green, splat.blue);
                atomicOr(&hits[local >> 5u], 1u << (local & 31u));
            }
            is_done = workgroupUniformLoad(&any_open) == 0u;
            for (var h = 0u; h < 8u && !is_done; h++) {
                var hit = atomicLoad(&hits[h]);
                // Four at a time: a turn of the loop costs, and one driver ends loops after 65,535 of them (budget.rs).
                while hit != 0u {
                    pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner);
                    hit &= hit - 1u;
                    if hit != 0u {
                        pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner);
                        hit &= hit - 1u;
                    }
                    if hit != 0u {
                        pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner);
                        hit &= hit - 1u;
                    }
                    if hit != 0u {
                        pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner);
                        hit &= hit - 1u;
                    }
                }
            }
        }
    }
    if is_inside {
        pixels[index] = pixel;
    }
}
