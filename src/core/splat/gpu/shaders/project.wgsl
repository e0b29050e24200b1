// Stage: project. In: voxels in visit order, the channels of their slab. Out: as many splats, drawn or not.
// Twin: twin/project.rs
//
// Places, footprints, looks and lights of voxels, one invocation each: the formulas of kernel.rs, shade.rs and
// cpu/project.rs. Centres are whole pixels and a rest, so that a picture of 16,384 pixels is as exact as a small one:
// the whole part of a row's sum is exact in wrapping integers, and single precision holds what it leaves over.

@group(0) @binding(0) var<uniform> shot: Shot;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> voxels: array<Voxel>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> normals: array<u32>;
@group(0) @binding(5) var<storage, read> magnitudes: array<u32>;
// By value code: colour, and optical depth per mean voxel in units of ln 2 (or normalised value).
@group(0) @binding(6) var<storage, read> looks: array<vec4<f32>>;
// By value code and magnitude code: optical depth.
@group(0) @binding(7) var<storage, read> depths: array<f32>;
@group(0) @binding(8) var<storage, read_write> splats: array<Splat>;
// Splats that are drawn, by chunk.
@group(0) @binding(9) var<storage, read_write> drawn: array<atomic<u32>>;

// Smallest sigma of a footprint in pixels.
const LOW_PASS: f32 = 0.6;
// Largest half-width of a footprint in pixels.
const REACH: f32 = 2097152.0;
// Smallest normal number of single precision.
const TINY: f32 = 1.17549435e-38;
// Beyond this a pixel is not told from others so far away.
const FAR: f32 = 5.0e8;
// What a pixel may lie outside a footprint's box.
const NEARLY_HALF: f32 = 0.4999;

var<workgroup> drawn_here: atomic<u32>;

// A pixel coordinate: the nearest pixel and the rest.
struct Place {
    nearest: i32,
    rest: f32,
    is_near: bool,
}

struct Print {
    across: f32,
    along: f32,
    shear: f32,
    half: vec2<f32>,
    // One over the area of the one-sigma ellipse over pi.
    density: f32,
}

fn leftover(row: Row, at: vec3<f32>) -> f32 {
    return row.rest.x * at.x + row.rest.y * at.y + row.rest.z * at.z + row.rest.w;
}

fn whole_sum(row: Row, at: vec3<i32>) -> i32 {
    return row.whole.x * at.x + row.whole.y * at.y + row.whole.z * at.z + row.whole.w;
}

fn place(row: Row, shift: i32, xyz: vec3<u32>) -> Place {
    let at = vec3<f32>(xyz);
    let unit = ldexp(1.0, -shift);
    let sum = whole_sum(row, vec3<i32>(xyz));
    var nearest = sum;
    var rest = 0.0;
    if shift > 0 {
        nearest = (sum + (1 << u32(shift - 1))) >> u32(shift);
        rest = f32(sum - (nearest << u32(shift))) * unit;
    }
    rest += leftover(row, at);
    let more = round(rest);
    return Place(nearest + i32(more), rest - more, abs(rest) < FAR);
}

fn coordinate(row: Row, shift: i32, xyz: vec3<u32>) -> f32 {
    return f32(whole_sum(row, vec3<i32>(xyz))) * ldexp(1.0, -shift) + leftover(row, vec3<f32>(xyz));
}

fn nearest_pixel(at: f32) -> Place {
    let bounded = clamp(at, -FAR, FAR);
    let nearest = round(bounded);
    return Place(i32(nearest), bounded - nearest, true);
}

// kernel.rs, footprint.
fn footprint(x: vec3<f32>, y: vec3<f32>) -> Print {
    let square = shot.sigma * shot.sigma;
    let crossed = cross(x, y);
    var xx = square * dot(x, x);
    let xy = square * dot(x, y);
    var yy = square * dot(y, y);
    var determinant = square * square * dot(crossed, crossed);
    let trace = xx + yy;
    let root = sqrt(max(trace * trace - 4.0 * determinant, 0.0));
    let narrowest = 2.0 * determinant / max(trace + root, TINY);
    let added = max(LOW_PASS * LOW_PASS - narrowest, 0.0);
    xx += added;
    yy += added;
    determinant = max(determinant + added * (trace + added), TINY);
    let half = min(shot.cut_off * sqrt(vec2<f32>(xx, yy)), vec2<f32>(REACH));
    return Print(0.5 * LOG2_E * (yy / determinant), 0.5 * LOG2_E / yy, xy / yy, half, 1.0 / sqrt(determinant));
}

// A signed number of the low `bits` of a word, not below the negative of its largest.
fn signed(word: u32, bits: u32) -> f32 {
    let shift = 32u - bits;
    let largest = f32((1u << (bits - 1u)) - 1u);
    return max(f32(bitcast<i32>(word << shift) >> shift), -largest);
}

// classify/normal.rs, decode8 and decode16; zero for no normal.
fn normal_of(record: u32) -> vec3<f32> {
    let bits = shot.normal_bits;
    var code = 0u;
    var none = 0x80008000u;
    if bits == 8u {
        code = (normals[record >> 1u] >> (16u * (record & 1u))) & 0xffffu;
        none = 0x8080u;
    } else {
        code = normals[record];
    }
    let u = signed(code, bits);
    let v = signed(code >> bits, bits);
    let z = f32((1u << (bits - 1u)) - 1u) - abs(u) - abs(v);
    let fold = max(-z, 0.0);
    let x = u - select(fold, -fold, u < 0.0);
    let y = v - select(fold, -fold, v < 0.0);
    let factor = select(1.0, 0.0, code == none) / sqrt(x * x + y * y + z * z);
    return vec3<f32>(x, y, z) * factor;
}

// shade.rs, shade: factor on the colour, highlight.
fn shade(normal: vec3<f32>, eye: vec3<f32>) -> vec2<f32> {
    if dot(normal, normal) <= 0.5 {
        return vec2<f32>(1.0, 0.0);
    }
    let between = shot.light.xyz + eye;
    let lit = abs(dot(normal, shot.light.xyz));
    let glance = abs(dot(normal, between) / sqrt(max(dot(between, between), 1.0e-12)));
    var power = 1.0;
    var square = glance;
    for (var bits = shot.shininess; bits != 0u; bits = bits >> 1u) {
        if (bits & 1u) == 1u {
            power *= square;
        }
        square *= square;
    }
    return vec2<f32>(shot.weights.x + shot.weights.y * lit, shot.weights.z * power);
}

fn value_of(record: u32) -> u32 {
    if shot.value_bits == 8u {
        return (values[record >> 2u] >> (8u * (record & 3u))) & 0xffu;
    }
    return (values[record >> 1u] >> (16u * (record & 1u))) & 0xffffu;
}

// Colour and optical depth, or normalised value.
fn look_of(record: u32) -> vec4<f32> {
    let value = value_of(record);
    var look = looks[value];
    if shot.by_magnitude == 1u {
        let magnitude = (magnitudes[record >> 2u] >> (8u * (record & 3u))) & 0xffu;
        look.w = depths[(value << 8u) | magnitude];
    }
    return look;
}

// First and last pixel within `half` of a place, of those in `low ..= high`.
fn span(at: Place, half: f32, low: i32, high: i32) -> vec2<i32> {
    let first = at.nearest + i32(round(at.rest - half + NEARLY_HALF));
    let last = at.nearest + i32(round(at.rest + half - NEARLY_HALF));
    return vec2<i32>(max(first, low), min(last, high));
}

fn nothing() -> Splat {
    return Splat(NOTHING, NOTHING, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
}

fn splat_of(voxel: Voxel) -> Splat {
    let xyz = vec3<u32>(voxel.xy & 0xffffu, voxel.xy >> 16u, voxel.z);
    if any(xyz < shot.crop_low.xyz) || any(xyz > shot.crop_high.xyz) {
        return nothing();
    }
    var x: Place;
    var y: Place;
    var print: Print;
    var strength = shot.ellipse.w;
    if shot.perspective == 0u {
        x = place(shot.rows[0], shot.shift.x, xyz);
        y = place(shot.rows[1], shot.shift.y, xyz);
        print = Print(shot.ellipse.x, shot.ellipse.y, shot.ellipse.z, shot.half, 1.0);
    } else {
        let along = coordinate(shot.rows[2], shot.shift.z, xyz);
        if !(along >= shot.near) {
            return nothing();
        }
        let closeness = 1.0 / along;
        let tx = coordinate(shot.rows[0], shot.shift.x, xyz) * closeness;
        let ty = coordinate(shot.rows[1], shot.shift.y, xyz) * closeness;
        x = nearest_pixel(shot.centre.x + shot.focal * tx);
        y = nearest_pixel(shot.centre.y - shot.focal * ty);
        let scale = shot.focal * closeness;
        let right = vec3<f32>(shot.steps[0].x, shot.steps[1].x, shot.steps[2].x);
        let up = vec3<f32>(shot.steps[0].y, shot.steps[1].y, shot.steps[2].y);
        let forward = vec3<f32>(shot.steps[0].z, shot.steps[1].z, shot.steps[2].z);
        print = footprint(scale * (right - tx * forward), scale * (ty * forward - up));
        strength *= print.density * sqrt(1.0 + tx * tx + ty * ty) * (closeness * closeness);
    }
    let columns = span(x, print.half.x, shot.window.x, shot.window.z - 1);
    let rows = span(y, print.half.y, 0, i32(shot.picture_rows) - 1);
    let is_in_window = rows.x < shot.window.w && rows.y >= shot.window.y;
    if !x.is_near || !y.is_near || columns.x > columns.y || rows.x > rows.y || !is_in_window || !(strength > 0.0) {
        return nothing();
    }
    let look = look_of(voxel.record);
    let peak = select(min(look.w * strength, shot.most), look.w, shot.maximum == 1u);
    if !(peak > 0.0) {
        return nothing();
    }
    var ink = look.xyz;
    if shot.shininess > 0u {
        var toward = shot.eye.xyz;
        if shot.perspective == 1u {
            let at = vec3<f32>(xyz) * vec3<f32>(shot.steps[0].w, shot.steps[1].w, shot.steps[2].w);
            let sight = shot.eye.xyz - at;
            toward = sight / sqrt(max(dot(sight, sight), TINY));
        }
        let light = shade(normal_of(voxel.record), toward);
        ink = ink * light.x + light.y;
    }
    return Splat(
        u32(columns.x) | (u32(columns.y) << 16u),
        u32(rows.x) | (u32(rows.y) << 16u),
        f32(columns.x - x.nearest) - x.rest,
        f32(rows.x - y.nearest) - y.rest,
        print.across,
        print.along,
        print.shear,
        peak,
        ink.x,
        ink.y,
        ink.z,
    );
}

@compute @workgroup_size(256)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let slot = group.x * BATCH + local;
    var splat = nothing();
    if slot < chunk.slot_count {
        let voxel = voxels[slot];
        if voxel.record != NO_RECORD {
            splat = splat_of(voxel);
        }
    }
    splats[slot] = splat;
    if splat.columns != NOTHING {
        atomicAdd(&drawn_here, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&drawn[chunk.index], atomicLoad(&drawn_here));
    }
}
