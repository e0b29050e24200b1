// Stage: tile. In: splats in visit order, each tile's mask of batches. Out: the window's pixels.
// Twin: tests/gpu/twin/tile.rs
//
// A workgroup draws a tile and an invocation one pixel, which stays in registers from the first splat to the last. A
// batch is read once: each invocation fetches one splat and notes whether it meets the tile; then all pixels composite
// those splats that do. A tile ends early where all of its pixels are below the termination threshold.
//
// A pixel of a maximum holds its largest finished sample, then the sums of the samples half a slice before, at and after
// its slice (cpu/maximum.rs). A chunk leaves all pixels at its own last slice.

@group(0) @binding(0) var<uniform> frame: FrameUniform;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> splats: array<Splat>;
@group(0) @binding(3) var<storage, read> masks: array<u32>;
@group(0) @binding(4) var<storage, read_write> pixels: array<vec4<f32>>;

// BLEND is the number of a BlendMode of stages.rs.
override BLEND: u32 = 0u;
const FRONT_TO_BACK: u32 = 0u;
const BACK_TO_FRONT: u32 = 1u;
const ADDITIVE: u32 = 2u;
const MAXIMUM: u32 = 3u;

struct TileSplat {
    dx: f32, // From the splat's centre to the tile's first pixel, in pixels; of a voxel near the eye as in Splat.
    dy: f32,
    falloff_x: f32,
    falloff_y: f32,
    shear: f32,
    peak: f32,
}

var<workgroup> batch_splats: array<TileSplat, BATCH>;
var<workgroup> colours: array<vec3<f32>, BATCH>;
var<workgroup> hits: array<atomic<u32>, 8>; // A bit for each splat of the batch that meets the tile.
var<workgroup> any_open: u32;
var<private> slice: f32; // In a maximum: the slice of the pixel's sums.

fn blend(pixel: vec4<f32>, colour: vec3<f32>, depth: f32) -> vec4<f32> {
    if BLEND == FRONT_TO_BACK {
        return pixel + pixel.w * absorbed(depth) * vec4<f32>(colour, -1.0);
    }
    if BLEND == BACK_TO_FRONT {
        return pixel + absorbed(depth) * (vec4<f32>(colour, 0.0) - pixel);
    }
    return pixel + depth * vec4<f32>(colour, 1.0);
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
// `dy` pixels from it.
fn sample_weights(s: TileSplat, closeness: f32, dx: f32, dy: f32) -> vec3<f32> {
    let moved = vec3<f32>(
        frame.sample_rays[0].x * dx + frame.sample_rays[0].y * dy,
        frame.sample_rays[1].x * dx + frame.sample_rays[1].y * dy,
        frame.sample_rays[2].x * dx + frame.sample_rays[2].y * dy,
    );
    var apart = moved.yz;
    var step = vec2<f32>(frame.sample_rays[1].z, frame.sample_rays[2].z);
    var shares = vec3<f32>(0.5, 1.0, 0.5);
    if frame.is_perspective == 1u {
        let from_eye = vec2<f32>(s.falloff_x, s.falloff_y);
        let along = s.shear * closeness + moved.x;
        apart = (moved.yz * s.shear - from_eye * moved.x) / along;
        step = 0.5 * (from_eye * closeness + moved.yz) / along;
        let depths = (vec3<f32>(s.shear) + vec3<f32>(-0.5, 0.0, 0.5)) / along;
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

// Returns the pixel after splat `j` of the batch; `place` is the pixel's position in its tile, `at` in the picture.
fn composite(pixel: vec4<f32>, j: u32, place: vec2<f32>, at: vec2<i32>) -> vec4<f32> {
    let s = batch_splats[j];
    if BLEND == MAXIMUM {
        let colour = colours[j];
        var sums = pixel;
        if colour.x != slice {
            sums = advanced(sums, colour.x - slice);
            slice = colour.x;
        }
        return sums + vec4<f32>(0.0, s.peak * sample_weights(s, colour.y, s.dx + place.x, s.dy + place.y));
    }
    let away = select(place, vec2<f32>(0.0), s.falloff_y < 0.0);
    let depth = splat_depth(s.dx + away.x, s.dy + away.y, s.falloff_x, s.falloff_y, s.shear, s.peak, at);
    if depth > 0.0 && is_open(pixel) {
        return blend(pixel, colours[j], depth);
    }
    return pixel;
}

@compute @workgroup_size(16, 16)
fn tile(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) place: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let corner = frame.window.xy + vec2<i32>(group.xy) * TILE;
    let at = corner + vec2<i32>(place.xy);
    let is_inside = all(at < frame.window.zw);
    let from_corner = vec2<f32>(place.xy);
    let width = u32(frame.window.z - frame.window.x);
    let index = u32(at.y - frame.window.y) * width + u32(at.x - frame.window.x);
    var pixel = vec4<f32>(0.0, 0.0, 0.0, frame.initial_alpha);
    if is_inside && chunk.is_first == 0u {
        pixel = pixels[index];
    }
    slice = f32(chunk.from_slice);
    let words = (chunk.slot_count + 32u * BATCH - 1u) / (32u * BATCH);
    let first_word = (group.y * frame.tile_columns + group.x) * frame.mask_words;
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
                let is_near = BLEND != MAXIMUM && splat.falloff_y < 0.0;
                let away = select(vec2<f32>(corner - low), vec2<f32>(0.0), is_near);
                let dx = splat.corner_x + away.x;
                let dy = splat.corner_y + away.y;
                batch_splats[local] = TileSplat(dx, dy, splat.falloff_x, splat.falloff_y, splat.shear, splat.peak);
                colours[local] = vec3<f32>(splat.red, splat.green, splat.blue);
                atomicOr(&hits[local >> 5u], 1u << (local & 31u));
            }
            is_done = workgroupUniformLoad(&any_open) == 0u;
            for (var h = 0u; h < 8u && !is_done; h++) {
                var hit = atomicLoad(&hits[h]);
                // Four splats per turn: each turn takes time, and one driver ends loops after 65,535 turns (budget.rs).
                while hit != 0u {
                    pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner, at);
                    hit &= hit - 1u;
                    if hit != 0u {
                        pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner, at);
                        hit &= hit - 1u;
                    }
                    if hit != 0u {
                        pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner, at);
                        hit &= hit - 1u;
                    }
                    if hit != 0u {
                        pixel = composite(pixel, 32u * h + firstTrailingBit(hit), from_corner, at);
                        hit &= hit - 1u;
                    }
                }
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
