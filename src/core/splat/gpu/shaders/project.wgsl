// Stage: project. In: voxels in visit order, channels of their slab. Out: a splat for each, without pixels if it is not
// drawn.
// Twin: tests/gpu/twin/project.rs
//
// One invocation computes the position, footprint, colour and light of one voxel, by the formulas of kernel.rs,
// shade.rs and cpu/project.rs. A centre is a whole pixel and a fraction, so a picture of 16,384 pixels is as exact as a
// small one: integers, which may wrap, sum the whole part exactly, and single precision holds the remainder.

@group(0) @binding(0) var<uniform> frame: FrameUniform;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> voxels: array<vec4<u32>>; // VisitedVoxels.
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> normals: array<u32>;
@group(0) @binding(5) var<storage, read> magnitudes: array<u32>;
// By value code: colour, and optical depth per mean voxel spacing in units of ln 2 (in a maximum, normalised value).
@group(0) @binding(6) var<storage, read> looks: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> depths: array<f32>; // Optical depth by value code and magnitude code.
@group(0) @binding(8) var<storage, read_write> splats: array<SplatVectors>;
@group(0) @binding(9) var<storage, read_write> drawn: array<atomic<u32>>; // Number of drawn splats, by counter.

// What voxels may be. A compiler leaves out the rest; that halves its time in some software (docs/studies/gpu.md).
override IS_MAXIMUM: bool; // Whether splats are values to interpolate; else they are footprints.
override HAS_NEAR: bool; // Whether voxels may be near the eye. In a maximum none is.

const REACH: f32 = 2097152.0; // Largest half-width of a footprint in pixels.
const TINY: f32 = 1.17549435e-38; // Smallest normal number of single precision.
const FAR: f32 = 5.0e8; // Pixel coordinates beyond this cannot be exact.
const NEARLY_HALF: f32 = 0.4999; // How far a pixel may lie outside a footprint's box, in pixels.

var<workgroup> drawn_here: atomic<u32>;

// A screen coordinate: the nearest pixel, and the coordinate minus that pixel, -0.5 to 0.5.
struct PixelPosition {
    nearest: i32,
    fraction: f32,
    is_near: bool, // Whether the coordinate is small enough to be exact.
}

struct Footprint {
    falloff_x: f32,
    falloff_y: f32,
    shear: f32,
    half_width: vec2<f32>,
    density: f32, // pi divided by the area of the one-sigma ellipse, in 1 / square pixels.
    on_rays: f32, // 1 if it is on rays: kernel.rs, in_perspective; else 0.
}

// How much of a voxel is visible: its share, and where that lies from the voxel's grid point, in voxels.
struct Coverage {
    share: f32,
    offset: vec3<f32>,
}

// Returns what a coverage code stands for: arena/coverage.rs, of_code.
fn coverage_of(code: u32) -> Coverage {
    if frame.coverage_bits == 0u {
        return Coverage(1.0, vec3<f32>(0.0));
    }
    if frame.coverage_bits == 8u {
        let points = f32(countOneBits(code));
        let high = vec3<f32>(countOneBits(vec3<u32>(code) & vec3<u32>(0xaau, 0xccu, 0xf0u)));
        // The difference is exact: an axis that is not halved has an offset of 0.
        return Coverage(points / 8.0, (0.5 * high - 0.25 * points) / max(points, 1.0));
    }
    let share = f32(code & 0x7fu) / 127.0;
    let places = min((vec3<u32>(code) >> vec3<u32>(7u, 10u, 13u)) & vec3<u32>(7u), vec3<u32>(6u));
    return Coverage(share * share, (vec3<f32>(places) - 3.0) / 8.0);
}

// Returns the widths along x, y and z of the kernel of a block whose visible part is this far from its centre: block_kernel.rs.
fn widths_of(offset: vec3<f32>) -> vec3<f32> {
    let place = min(vec3<u32>(8.0 * abs(offset) + 0.5), vec3<u32>(2u));
    return vec3<f32>(frame.widths[0][place.x], frame.widths[1][place.y], frame.widths[2][place.z]);
}

// Returns by how much a screen coordinate changes with an offset in voxels.
fn displacement(row: AffineRow, shift: i32, offset: vec3<f32>) -> f32 {
    if frame.coverage_bits == 0u {
        return 0.0;
    }
    return dot(vec3<f32>(row.whole.xyz) * ldexp(1.0, -shift) + row.remainder.xyz, offset);
}

fn remainder_sum(row: AffineRow, at: vec3<f32>) -> f32 {
    return row.remainder.x * at.x + row.remainder.y * at.y + row.remainder.z * at.z + row.remainder.w;
}

fn whole_sum(row: AffineRow, at: vec3<i32>) -> i32 {
    return row.whole.x * at.x + row.whole.y * at.y + row.whole.z * at.z + row.whole.w;
}

fn pixel_position(row: AffineRow, shift: i32, xyz: vec3<u32>, offset: vec3<f32>) -> PixelPosition {
    let at = vec3<f32>(xyz);
    let unit = ldexp(1.0, -shift);
    let sum = whole_sum(row, vec3<i32>(xyz));
    var nearest = sum;
    var fraction = 0.0;
    if shift > 0 {
        nearest = (sum + (1 << u32(shift - 1))) >> u32(shift);
        fraction = f32(sum - (nearest << u32(shift))) * unit;
    }
    fraction += remainder_sum(row, at) + displacement(row, shift, offset);
    let more = round(fraction);
    return PixelPosition(nearest + i32(more), fraction - more, abs(fraction) < FAR);
}

fn coordinate(row: AffineRow, shift: i32, xyz: vec3<u32>, offset: vec3<f32>) -> f32 {
    let rest = remainder_sum(row, vec3<f32>(xyz)) + displacement(row, shift, offset);
    return f32(whole_sum(row, vec3<i32>(xyz))) * ldexp(1.0, -shift) + rest;
}

fn nearest_pixel(at: f32) -> PixelPosition {
    let bounded = clamp(at, -FAR, FAR);
    let nearest = round(bounded);
    return PixelPosition(i32(nearest), bounded - nearest, true);
}

// Returns a kernel's footprint; `x` and `y`: pixels that it moves per voxel along each axis. kernel.rs, footprint.
fn footprint(x: vec3<f32>, y: vec3<f32>) -> Footprint {
    let variance = frame.sigma * frame.sigma;
    let crossed = cross(x, y);
    var xx = variance * dot(x, x);
    let xy = variance * dot(x, y);
    var yy = variance * dot(y, y);
    var determinant = variance * variance * dot(crossed, crossed);
    let trace = xx + yy;
    let root = sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy);
    let narrowest = 2.0 * determinant / max(trace + root, TINY);
    let added = max(frame.low_pass * frame.low_pass - narrowest, 0.0);
    xx += added;
    yy += added;
    determinant = max(determinant + added * (trace + added), TINY);
    let half_width = min(frame.cut_off * sqrt(vec2<f32>(xx, yy)), vec2<f32>(REACH));
    return Footprint(
        0.5 * LOG2_E * (yy / determinant), 0.5 * LOG2_E / yy, xy / yy, half_width, 1.0 / sqrt(determinant),
        select(0.0, 1.0, added == 0.0),
    );
}

// Returns this footprint as a perspective needs it: kernel.rs, in_perspective.
fn in_perspective(ellipse: Footprint, square: f32, slant: f32, closeness: f32) -> Footprint {
    if ellipse.on_rays == 0.0 {
        return Footprint(
            ellipse.falloff_x, ellipse.falloff_y, ellipse.shear, ellipse.half_width, ellipse.density * slant, 0.0,
        );
    }
    let half_width = min(ellipse.half_width / (1.0 - closeness), vec2<f32>(REACH));
    return Footprint(
        ellipse.falloff_x * square, ellipse.falloff_y * square, ellipse.shear, half_width, ellipse.density * sqrt(square), 1.0,
    );
}

// Returns the low `bits` of a word as a signed number, from -largest to largest.
fn signed(word: u32, bits: u32) -> f32 {
    let shift = 32u - bits;
    let largest = f32((1u << (bits - 1u)) - 1u);
    return max(f32(bitcast<i32>(word << shift) >> shift), -largest);
}

// Returns the code of a record's normal.
fn normal_code(record: u32) -> u32 {
    if frame.normal_bits == 8u {
        return (normals[record >> 1u] >> (16u * (record & 1u))) & 0xffffu;
    }
    return normals[record];
}

// Returns the unit normal of a code, or zero if it stands for none: classify/normal.rs, decode8 and decode16.
fn normal_of(code: u32) -> vec3<f32> {
    let bits = frame.normal_bits;
    let none = select(0x80008000u, 0x8080u, bits == 8u);
    let u = signed(code, bits);
    let v = signed(code >> bits, bits);
    let z = f32((1u << (bits - 1u)) - 1u) - abs(u) - abs(v);
    let fold = max(-z, 0.0);
    let x = u - select(fold, -fold, u < 0.0);
    let y = v - select(fold, -fold, v < 0.0);
    let factor = select(1.0, 0.0, code == none) / sqrt(x * x + y * y + z * z);
    return vec3<f32>(x, y, z) * factor;
}

// Returns the factor on the colour, and the highlight that is added to it: shade.rs, shade.
fn shade(normal: vec3<f32>, eye: vec3<f32>) -> vec2<f32> {
    if dot(normal, normal) <= 0.5 {
        return vec2<f32>(1.0, 0.0);
    }
    let between = frame.light.xyz + eye;
    let lit = abs(dot(normal, frame.light.xyz));
    let glance = abs(dot(normal, between) / sqrt(max(dot(between, between), 1.0e-12)));
    var power = 1.0;
    var square = glance;
    for (var bits = frame.shininess; bits != 0u; bits = bits >> 1u) {
        if (bits & 1u) == 1u {
            power *= square;
        }
        square *= square;
    }
    return vec2<f32>(frame.light_weights.x + frame.light_weights.y * lit, frame.light_weights.z * power);
}

// Returns the light of a voxel that stands for several normals from that of their mean, whose code is given: shade.rs,
// scatter; classify/normal.rs, Coherence.
fn scatter(light: vec2<f32>, code: u32) -> vec2<f32> {
    let v = code >> frame.normal_bits;
    let alike = vec4<f32>(1.0, 0.85, 0.6, 0.25)[(code & 1u) | ((v & 1u) << 1u)];
    let bare = select(0.0, 0.2, (v & 2u) != 0u);
    let scattered = vec2<f32>(
        frame.light_weights.x + 0.5 * frame.light_weights.y,
        frame.light_weights.z / (f32(frame.shininess) + 1.0),
    );
    return mix(mix(scattered, light, alike), vec2<f32>(1.0, 0.0), bare);
}

fn value_of(record: u32) -> u32 {
    if frame.value_bits == 8u {
        return (values[record >> 2u] >> (8u * (record & 3u))) & 0xffu;
    }
    return (values[record >> 1u] >> (16u * (record & 1u))) & 0xffffu;
}

// Returns the colour and the optical depth (in a maximum, the normalised value) of a record's voxel, of which a share is
// visible; that does not change a maximum.
fn look_of(record: u32, share: f32) -> vec4<f32> {
    let value = value_of(record);
    var look = looks[value];
    if frame.uses_magnitude == 1u {
        let magnitude = (magnitudes[record >> 2u] >> (8u * (record & 3u))) & 0xffu;
        look.w = depths[(value << 8u) | magnitude];
    }
    look.w *= share;
    return look;
}

// Returns the first and the last pixel at most `half_width` pixels from `centre`, clipped to `low ..= high`.
fn span(centre: PixelPosition, half_width: f32, low: i32, high: i32) -> vec2<i32> {
    let first = centre.nearest + i32(round(centre.fraction - half_width + NEARLY_HALF));
    let last = centre.nearest + i32(round(centre.fraction + half_width - NEARLY_HALF));
    return vec2<i32>(max(first, low), min(last, high));
}

fn nothing() -> Splat {
    return Splat(NOTHING, NOTHING, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
}

// Returns the lit colour of a voxel.
fn colour_of(voxel: VisitedVoxel, xyz: vec3<u32>, colour: vec3<f32>) -> vec3<f32> {
    if frame.shininess == 0u {
        return colour;
    }
    var toward = frame.eye.xyz;
    if frame.is_perspective == 1u {
        let at = vec3<f32>(xyz) * vec3<f32>(frame.steps[0].w, frame.steps[1].w, frame.steps[2].w);
        let sight = frame.eye.xyz - at;
        toward = sight / sqrt(max(dot(sight, sight), TINY));
    }
    let code = normal_code(voxel.record);
    var light = shade(normal_of(code), toward);
    if frame.light_weights.w == 1.0 {
        light = scatter(light, code);
    }
    return colour * light.x + light.y;
}

// Returns how the distance to the right (0), up (1) or forward (2) changes with a step of one voxel along each axis.
fn gradient(side: u32) -> vec3<f32> {
    return vec3<f32>(frame.steps[0][side], frame.steps[1][side], frame.steps[2][side]);
}

// Returns the smallest and the largest tangent of points in front of the eye that lie in a ball, in voxel coordinates:
// near.rs, tangents. The first is larger if there are none.
fn tangents(along: vec3<f32>, centre: vec3<f32>, radius: f32) -> vec2<f32> {
    let forward = gradient(2u);
    let aside = dot(along, centre);
    let depth = dot(forward, centre);
    let square = radius * radius;
    let a = depth * depth - square * dot(forward, forward);
    var b = aside * depth - square * dot(along, forward);
    let c = aside * aside - square * dot(along, along);
    let root = sqrt(max(b * b - a * c, 0.0));
    // Single precision has lost a where it is smaller than this.
    if a > 1.0e-3 * depth * depth {
        return select(vec2<f32>(1.0, -1.0), vec2<f32>(b - root, b + root) / a, depth > 0.0);
    }
    if c <= 1.0e-3 * aside * aside {
        return vec2<f32>(-FAR, FAR);
    }
    b *= sign(aside);
    var least = 0.0;
    if b > 0.0 {
        least = c / (b + root);
    } else if a < 0.0 {
        least = (b - root) / a;
    }
    return select(vec2<f32>(-FAR, -least), vec2<f32>(least, FAR), aside > 0.0);
}

// Returns the first and the last pixel between two tangents, and some more for rounding, clipped to `low ..= high`.
fn pixels_between(centre: f32, first: f32, last: f32, low: i32, high: i32) -> vec2<i32> {
    let ends = frame.focal * vec2<f32>(first, last);
    let more = 1.0 + 1.0e-3 * abs(ends);
    let pixels = clamp(centre + ends + vec2<f32>(-more.x, more.y), vec2<f32>(-FAR), vec2<f32>(FAR));
    return vec2<i32>(max(i32(floor(pixels.x)), low), min(i32(ceil(pixels.y)), high));
}

// Returns the splat of a voxel near the eye.
fn near_splat(voxel: VisitedVoxel, xyz: vec3<u32>, cover: Coverage, depth: f32) -> Splat {
    if !(depth >= frame.eye_rest.w) {
        return nothing();
    }
    let offset = (vec3<f32>(xyz) - frame.eye_voxel.xyz) - frame.eye_rest.xyz + cover.offset;
    let radius = frame.eye_voxel.w;
    let square = dot(offset, offset);
    var columns = vec2<i32>(frame.window.x, frame.window.z - 1);
    var rows = vec2<i32>(0, i32(frame.picture_rows) - 1);
    var at_eye = 0.0;
    if square <= radius * radius {
        at_eye = exp2(-0.5 * LOG2_E / (frame.near_sigma * frame.near_sigma) * square);
    } else {
        let x = tangents(gradient(0u), offset, radius);
        let y = tangents(gradient(1u), offset, radius);
        if x.x > x.y || y.x > y.y {
            return nothing();
        }
        columns = pixels_between(frame.centre.x, x.x, x.y, columns.x, columns.y);
        rows = pixels_between(frame.centre.y, -y.y, -y.x, rows.x, rows.y);
    }
    let is_in_window = rows.x < frame.window.w && rows.y >= frame.window.y;
    let look = look_of(voxel.record, cover.share);
    if columns.x > columns.y || rows.x > rows.y || !is_in_window || !(look.w > 0.0) {
        return nothing();
    }
    let colour = colour_of(voxel, xyz, look.xyz);
    return Splat(
        u32(columns.x) | (u32(columns.y) << 16u), u32(rows.x) | (u32(rows.y) << 16u),
        offset.x, offset.y, offset.z, NEAR_SPLAT, at_eye, look.w, colour.x, colour.y, colour.z, 0.0,
    );
}

// Returns the first and the last pixel of an interval, clipped to `low ..= high`; a hundredth of a pixel more on each side.
fn between(first: f32, last: f32, low: i32, high: i32) -> vec2<i32> {
    return vec2<i32>(max(nearest_pixel(first + 0.49).nearest, low), min(nearest_pixel(last - 0.49).nearest, high));
}

// Returns the voxel of a maximum, which lies at its grid point: cpu/scatter/maximum.rs, MaximumRays::pixels. Its pixels
// are counted from its own. A voxel beside or behind the eye may have none: its closeness is 0, and its pixels are counted
// from the picture's centre.
fn value_splat(voxel: VisitedVoxel, xyz: vec3<u32>) -> Splat {
    let value = look_of(voxel.record, 1.0).w;
    let offset = vec3<f32>(0.0);
    let last_column = frame.window.z - 1;
    let last_row = i32(frame.picture_rows) - 1;
    var x: PixelPosition;
    var y: PixelPosition;
    var columns: vec2<i32>;
    var rows: vec2<i32>;
    var from_eye = vec3<f32>(0.0);
    var closeness = 0.0;
    if frame.is_perspective == 0u {
        x = pixel_position(frame.rows[0], frame.shifts.x, xyz, offset);
        y = pixel_position(frame.rows[1], frame.shifts.y, xyz, offset);
        columns = span(x, frame.half_width.x, frame.window.x, last_column);
        rows = span(y, frame.half_width.y, 0, last_row);
    } else {
        let depth = coordinate(frame.rows[2], frame.shifts.z, xyz, offset);
        let reach = frame.ellipse.xyz;
        if !(depth + reach.z >= frame.near) {
            return nothing();
        }
        closeness = select(0.0, 1.0 / depth, depth > reach.z);
        let right = coordinate(frame.rows[0], frame.shifts.x, xyz, offset);
        let up = coordinate(frame.rows[1], frame.shifts.y, xyz, offset);
        x = nearest_pixel(frame.centre.x + frame.focal * (right * closeness));
        y = nearest_pixel(frame.centre.y - frame.focal * (up * closeness));
        let nearest = max(depth - reach.z, frame.near);
        let farthest = max(depth + reach.z, nearest);
        let low = vec2<f32>(right, up) - reach.xy;
        let high = vec2<f32>(right, up) + reach.xy;
        let first = low / select(vec2<f32>(farthest), vec2<f32>(nearest), low < vec2<f32>(0.0));
        let last = high / select(vec2<f32>(farthest), vec2<f32>(nearest), high > vec2<f32>(0.0));
        columns = between(
            frame.centre.x + frame.focal * first.x, frame.centre.x + frame.focal * last.x, frame.window.x, last_column,
        );
        rows = between(frame.centre.y - frame.focal * last.y, frame.centre.y - frame.focal * first.y, 0, last_row);
        let at = vec3<f32>(vec3<u32>(xyz[frame.nesting.x], xyz[frame.nesting.y], xyz[frame.nesting.z]));
        from_eye = at - vec3<f32>(frame.sample_rays[0].z, frame.sample_rays[1].z, frame.sample_rays[2].z);
    }
    let is_in_window = rows.x < frame.window.w && rows.y >= frame.window.y;
    if !x.is_near || !y.is_near || columns.x > columns.y || rows.x > rows.y || !is_in_window || !(value > 0.0) {
        return nothing();
    }
    return Splat(
        u32(columns.x) | (u32(columns.y) << 16u), u32(rows.x) | (u32(rows.y) << 16u),
        f32(columns.x - x.nearest) - x.fraction, f32(rows.x - y.nearest) - y.fraction,
        from_eye.y, from_eye.z, from_eye.x, value, f32(xyz[frame.nesting.x]), closeness, 0.0, 0.0,
    );
}

fn splat_of(voxel: VisitedVoxel) -> Splat {
    let xyz = vec3<u32>(voxel.xy & 0xffffu, voxel.xy >> 16u, voxel.z_coverage & 0xffffu);
    if any(xyz < frame.crop_low.xyz) || any(xyz > frame.crop_high.xyz) {
        return nothing();
    }
    let clipped = vec3<i32>(xyz) * frame.clip.xyz;
    if clipped.x + clipped.y + clipped.z < frame.clip.w {
        return nothing();
    }
    let cover = coverage_of(voxel.z_coverage >> 16u);
    if IS_MAXIMUM {
        return value_splat(voxel, xyz);
    }
    var x: PixelPosition;
    var y: PixelPosition;
    var ellipse: Footprint;
    var strength = frame.ellipse.w;
    if frame.is_perspective == 0u {
        x = pixel_position(frame.rows[0], frame.shifts.x, xyz, cover.offset);
        y = pixel_position(frame.rows[1], frame.shifts.y, xyz, cover.offset);
        ellipse = Footprint(frame.ellipse.x, frame.ellipse.y, frame.ellipse.z, frame.half_width, 1.0, 0.0);
        if frame.coverage_bits != 0u {
            let widths = widths_of(cover.offset);
            ellipse = footprint(widths * gradient(0u), widths * gradient(1u));
            ellipse.on_rays = 0.0;
            strength *= ellipse.density;
        }
    } else {
        let depth = coordinate(frame.rows[2], frame.shifts.z, xyz, cover.offset);
        if !(depth >= frame.near) {
            if HAS_NEAR {
                return near_splat(voxel, xyz, cover, depth);
            }
            // A damaged file may have such voxels outside its grid.
            return nothing();
        }
        let closeness = 1.0 / depth;
        let tx = coordinate(frame.rows[0], frame.shifts.x, xyz, cover.offset) * closeness;
        let ty = coordinate(frame.rows[1], frame.shifts.y, xyz, cover.offset) * closeness;
        x = nearest_pixel(frame.centre.x + frame.focal * tx);
        y = nearest_pixel(frame.centre.y - frame.focal * ty);
        let scale = frame.focal * closeness;
        let forward = gradient(2u);
        var widths = vec3<f32>(scale);
        if frame.coverage_bits != 0u {
            widths *= widths_of(cover.offset);
        }
        ellipse = footprint(widths * (gradient(0u) - tx * forward), widths * (ty * forward - gradient(1u)));
        let along = frame.rays[2].xyz + frame.rays[0].xyz * tx + frame.rays[1].xyz * ty;
        let square = dot(along, along);
        let reach = frame.sigma * frame.cut_off * length(forward);
        ellipse = in_perspective(ellipse, square, sqrt(1.0 + tx * tx + ty * ty), reach * closeness);
        strength *= ellipse.density * (closeness * closeness);
    }
    let columns = span(x, ellipse.half_width.x, frame.window.x, frame.window.z - 1);
    let rows = span(y, ellipse.half_width.y, 0, i32(frame.picture_rows) - 1);
    let is_in_window = rows.x < frame.window.w && rows.y >= frame.window.y;
    if !x.is_near || !y.is_near || columns.x > columns.y || rows.x > rows.y || !is_in_window || !(strength > 0.0) {
        return nothing();
    }
    let look = look_of(voxel.record, cover.share);
    // On rays, it is limited on each ray: near.wgsl, splat_depth.
    let peak = select(min(look.w * strength, frame.max_depth), look.w * strength, ellipse.on_rays == 1.0);
    if !(peak > 0.0) {
        return nothing();
    }
    let colour = colour_of(voxel, xyz, look.xyz);
    return Splat(
        u32(columns.x) | (u32(columns.y) << 16u), u32(rows.x) | (u32(rows.y) << 16u),
        f32(columns.x - x.nearest) - x.fraction, f32(rows.x - y.nearest) - y.fraction,
        ellipse.falloff_x, ellipse.falloff_y, ellipse.shear, peak, colour.x, colour.y, colour.z, ellipse.on_rays,
    );
}

@compute @workgroup_size(256)
fn project(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let slot = group.x * BATCH + local;
    var splat = nothing();
    if slot < chunk.slot_count {
        let stored = voxels[slot];
        let voxel = VisitedVoxel(stored.x, stored.y, stored.z, stored.w);
        if voxel.record != NO_RECORD {
            splat = splat_of(voxel);
        }
    }
    splats[slot] = SplatVectors(
        vec4<u32>(splat.columns, splat.rows, bitcast<u32>(splat.corner_x), bitcast<u32>(splat.corner_y)),
        vec4<f32>(splat.falloff_x, splat.falloff_y, splat.shear, splat.peak),
        vec4<f32>(splat.red, splat.green, splat.blue, splat.on_rays),
    );
    if splat.columns != NOTHING {
        atomicAdd(&drawn_here, 1u);
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&drawn[chunk.index], atomicLoad(&drawn_here));
    }
}
