//! Twin of `shaders/project.wgsl`: from voxels and their channels to splats.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the device's conversions: single precision, and the nearest number that there is"
)]

use super::{EMPTY, REACH, element};
use adjsplat::internals::gpu_stages::{AffineRow, FrameUniform, NO_RECORD, NOTHING, Splat, VisitedVoxel};

/// Coordinates beyond this are too large for exact pixels.
const FAR: f32 = 5.0e8;
/// `falloff_y` of a voxel near the eye.
const NEAR_SPLAT: f32 = -1.0;
/// How far a pixel may lie outside a footprint's box, in pixels.
const NEARLY_HALF: f32 = 0.4999;

/// The words of a slab's channels, and the tables of the scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Channels<'a> {
    /// Value codes.
    pub(crate) values: &'a [u32],
    /// Normal codes.
    pub(crate) normals: &'a [u32],
    /// Magnitude codes.
    pub(crate) magnitudes: &'a [u32],
    /// Colour, and optical depth or normalised value, by value code.
    pub(crate) looks: &'a [[f32; 4]],
    /// Optical depth by value code and magnitude code.
    pub(crate) depths: &'a [f32],
}

#[derive(Clone, Copy)]
struct PixelPosition {
    nearest: i32,
    fraction: f32,
    is_near: bool,
}

struct Footprint {
    falloff_x: f32,
    falloff_y: f32,
    shear: f32,
    half_width: [f32; 2],
    density: f32,
    is_on_rays: bool,
}

/// Computes the splat of each voxel, in a maximum its value and place; returns how many are drawn.
///
/// # Panics
/// If a value has no look.
pub(crate) fn project(
    frame: &FrameUniform,
    is_maximum: bool,
    voxels: &[VisitedVoxel],
    channels: &Channels,
    splats: &mut [Splat],
) -> u32 {
    let mut drawn = 0;
    for (voxel, splat) in voxels.iter().zip(splats) {
        *splat = if voxel.record == NO_RECORD { EMPTY } else { splat_of(frame, is_maximum, voxel, channels) };
        drawn += u32::from(splat.columns != NOTHING);
    }
    drawn
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn remainder_sum(row: &AffineRow, at: [f32; 3]) -> f32 {
    row.remainder[0] * at[0] + row.remainder[1] * at[1] + row.remainder[2] * at[2] + row.remainder[3]
}

fn whole_sum(row: &AffineRow, at: [i32; 3]) -> i32 {
    let product = |a: usize| row.whole[a].wrapping_mul(at[a]);
    product(0).wrapping_add(product(1)).wrapping_add(product(2)).wrapping_add(row.whole[3])
}

fn unit(shift: i32) -> f32 {
    (-shift as f32).exp2()
}

/// How much of a voxel is visible, and where that lies from the voxel's grid point.
#[derive(Clone, Copy)]
struct Coverage {
    share: f32,
    offset: [f32; 3],
}

fn coverage_of(frame: &FrameUniform, code: u32) -> Coverage {
    match frame.coverage_bits {
        0 => Coverage { share: 1.0, offset: [0.0; 3] },
        8 => {
            let points = code.count_ones() as f32;
            let high = [0xaa, 0xcc, 0xf0].map(|end| (code & end).count_ones() as f32);
            Coverage { share: points / 8.0, offset: high.map(|high| (0.5 * high - 0.25 * points) / points.max(1.0)) }
        }
        _ => {
            let share = (code & 0x7f) as f32 / 127.0;
            Coverage {
                share: share * share,
                offset: [7, 10, 13].map(|at| ((code >> at & 7).min(6) as f32 - 3.0) / 8.0),
            }
        }
    }
}

/// Returns the Jacobian of a voxel whose kernel is wider along some axes than along others.
fn widened(frame: &FrameUniform, offset: [f32; 3], rows: [[f32; 3]; 2]) -> [[f32; 3]; 2] {
    if frame.coverage_bits == 0 {
        return rows;
    }
    let width = |a: usize| frame.widths[a][((8.0 * offset[a].abs() + 0.5) as usize).min(2)];
    rows.map(|row| [0, 1, 2].map(|a| width(a) * row[a]))
}

/// Returns by how much a screen coordinate changes with an offset in voxels.
fn displacement(row: &AffineRow, shift: i32, offset: [f32; 3]) -> f32 {
    dot([0, 1, 2].map(|a| row.whole[a] as f32 * unit(shift) + row.remainder[a]), offset)
}

fn pixel_position(row: &AffineRow, shift: i32, xyz: [u32; 3], offset: [f32; 3]) -> PixelPosition {
    let at = xyz.map(|c| c as f32);
    let sum = whole_sum(row, xyz.map(u32::cast_signed));
    let (mut nearest, mut fraction) = (sum, 0.0);
    if shift > 0 {
        nearest = sum.wrapping_add(1 << (shift - 1)) >> shift;
        fraction = sum.wrapping_sub(nearest << shift) as f32 * unit(shift);
    }
    fraction += remainder_sum(row, at) + displacement(row, shift, offset);
    let more = fraction.round_ties_even();
    PixelPosition {
        nearest: nearest.wrapping_add(more as i32),
        fraction: fraction - more,
        is_near: fraction.abs() < FAR,
    }
}

fn coordinate(row: &AffineRow, shift: i32, xyz: [u32; 3], offset: [f32; 3]) -> f32 {
    let rest = remainder_sum(row, xyz.map(|c| c as f32)) + displacement(row, shift, offset);
    whole_sum(row, xyz.map(u32::cast_signed)) as f32 * unit(shift) + rest
}

fn nearest_pixel(at: f32) -> PixelPosition {
    let bounded = at.clamp(-FAR, FAR);
    let nearest = bounded.round_ties_even();
    PixelPosition { nearest: nearest as i32, fraction: bounded - nearest, is_near: true }
}

fn footprint(frame: &FrameUniform, x: [f32; 3], y: [f32; 3]) -> Footprint {
    let log2_e = std::f32::consts::LOG2_E;
    let square = frame.sigma * frame.sigma;
    let crossed = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let (mut xx, xy, mut yy) = (square * dot(x, x), square * dot(x, y), square * dot(y, y));
    let mut determinant = square * square * dot(crossed, crossed);
    let trace = xx + yy;
    let root = ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt();
    let narrowest = 2.0 * determinant / (trace + root).max(f32::MIN_POSITIVE);
    let added = (frame.low_pass * frame.low_pass - narrowest).max(0.0);
    xx += added;
    yy += added;
    determinant = (determinant + added * (trace + added)).max(f32::MIN_POSITIVE);
    Footprint {
        falloff_x: 0.5 * log2_e * (yy / determinant),
        falloff_y: 0.5 * log2_e / yy,
        shear: xy / yy,
        half_width: [xx, yy].map(|variance| (frame.cut_off * variance.sqrt()).min(REACH)),
        density: 1.0 / determinant.sqrt(),
        is_on_rays: added == 0.0,
    }
}

/// Returns the footprint of a perspective.
fn in_perspective(ellipse: Footprint, square: f32, slant: f32, closeness: f32) -> Footprint {
    if !ellipse.is_on_rays {
        return Footprint { density: ellipse.density * slant, ..ellipse };
    }
    Footprint {
        falloff_x: ellipse.falloff_x * square,
        falloff_y: ellipse.falloff_y * square,
        half_width: ellipse.half_width.map(|half| (half / (1.0 - closeness)).min(REACH)),
        density: ellipse.density * square.sqrt(),
        ..ellipse
    }
}

fn signed(word: u32, bits: u32) -> f32 {
    let shift = 32 - bits;
    let largest = ((1u32 << (bits - 1)) - 1) as f32;
    ((((word << shift).cast_signed()) >> shift) as f32).max(-largest)
}

fn normal_code(frame: &FrameUniform, channels: &Channels, record: u32) -> u32 {
    element(channels.normals, record, 2 * frame.normal_bits)
}

fn normal_of(frame: &FrameUniform, code: u32) -> [f32; 3] {
    let bits = frame.normal_bits;
    let none = if bits == 8 { 0x8080 } else { 0x8000_8000 };
    let (u, v) = (signed(code, bits), signed(code >> bits, bits));
    let z = ((1u32 << (bits - 1)) - 1) as f32 - u.abs() - v.abs();
    let fold = (-z).max(0.0);
    let x = u - if u < 0.0 { -fold } else { fold };
    let y = v - if v < 0.0 { -fold } else { fold };
    let factor = if code == none { 0.0 } else { 1.0 } / (x * x + y * y + z * z).sqrt();
    [x * factor, y * factor, z * factor]
}

/// Returns the factor on the colour, and the highlight.
fn shade(frame: &FrameUniform, normal: [f32; 3], eye: [f32; 3]) -> [f32; 2] {
    if dot(normal, normal) <= 0.5 {
        return [1.0, 0.0];
    }
    let light = [frame.light[0], frame.light[1], frame.light[2]];
    let between = [light[0] + eye[0], light[1] + eye[1], light[2] + eye[2]];
    let lit = dot(normal, light).abs();
    let glance = (dot(normal, between) / dot(between, between).max(1.0e-12).sqrt()).abs();
    let (mut power, mut square, mut bits) = (1.0, glance, frame.shininess);
    while bits != 0 {
        if bits & 1 == 1 {
            power *= square;
        }
        square *= square;
        bits >>= 1;
    }
    [frame.light_weights[0] + frame.light_weights[1] * lit, frame.light_weights[2] * power]
}

/// Returns the light of a voxel that stands for several normals, from that of their mean.
fn scatter(frame: &FrameUniform, light: [f32; 2], code: u32) -> [f32; 2] {
    let v = code >> frame.normal_bits;
    let alike = match (code & 1, v & 1) {
        (0, 0) => 1.0,
        (1, 0) => 0.85,
        (0, _) => 0.6,
        _ => 0.25,
    };
    let bare = if v & 2 == 0 { 0.0 } else { 0.2 };
    let [ambient, diffuse, specular, _] = frame.light_weights;
    let scattered = [ambient + 0.5 * diffuse, specular / (frame.shininess as f32 + 1.0)];
    let mix = |a: f32, b: f32, share: f32| a * (1.0 - share) + b * share;
    [0, 1].map(|k| mix(mix(scattered[k], light[k], alike), [1.0, 0.0][k], bare))
}

fn look_of(frame: &FrameUniform, channels: &Channels, record: u32, share: f32) -> [f32; 4] {
    let value = element(channels.values, record, frame.value_bits);
    let mut look = channels.looks[value as usize];
    if frame.uses_magnitude == 1 {
        let magnitude = element(channels.magnitudes, record, 8);
        look[3] = channels.depths[(value << 8 | magnitude) as usize];
    }
    look[3] *= share;
    look
}

/// Returns the first and the last pixel within `half_width` of `centre`, within `low ..= high`.
fn span(centre: PixelPosition, half_width: f32, low: i32, high: i32) -> [i32; 2] {
    let first = centre.nearest.wrapping_add((centre.fraction - half_width + NEARLY_HALF).round_ties_even() as i32);
    let last = centre.nearest.wrapping_add((centre.fraction + half_width - NEARLY_HALF).round_ties_even() as i32);
    [first.max(low), last.min(high)]
}

fn colour_of(
    frame: &FrameUniform,
    voxel: &VisitedVoxel,
    xyz: [u32; 3],
    channels: &Channels,
    colour: [f32; 3],
) -> [f32; 3] {
    if frame.shininess == 0 {
        return colour;
    }
    let mut toward = [frame.eye[0], frame.eye[1], frame.eye[2]];
    if frame.is_perspective == 1 {
        let sight: [f32; 3] = std::array::from_fn(|a| frame.eye[a] - xyz[a] as f32 * frame.steps[a][3]);
        let length = dot(sight, sight).max(f32::MIN_POSITIVE).sqrt();
        toward = sight.map(|c| c / length);
    }
    let code = normal_code(frame, channels, voxel.record);
    let light = shade(frame, normal_of(frame, code), toward);
    let [factor, highlight] = if frame.light_weights[3] == 1.0 { scatter(frame, light, code) } else { light };
    colour.map(|c| c * factor + highlight)
}

fn gradient(frame: &FrameUniform, side: usize) -> [f32; 3] {
    frame.steps.map(|step| step[side])
}

/// Returns the smallest and the largest tangent of a ball's points in front of the eye; the first is larger if there are
/// none.
fn tangents(frame: &FrameUniform, along: [f32; 3], centre: [f32; 3], radius: f32) -> [f32; 2] {
    let forward = gradient(frame, 2);
    let (aside, depth) = (dot(along, centre), dot(forward, centre));
    let square = radius * radius;
    let a = depth * depth - square * dot(forward, forward);
    let mut b = aside * depth - square * dot(along, forward);
    let c = aside * aside - square * dot(along, along);
    let root = (b * b - a * c).max(0.0).sqrt();
    if a > 1.0e-3 * depth * depth {
        return if depth > 0.0 { [(b - root) / a, (b + root) / a] } else { [1.0, -1.0] };
    }
    if c <= 1.0e-3 * aside * aside {
        return [-FAR, FAR];
    }
    b *= aside.signum();
    let least = match b > 0.0 {
        true => c / (b + root),
        false if a < 0.0 => (b - root) / a,
        false => 0.0,
    };
    if aside > 0.0 { [least, FAR] } else { [-FAR, -least] }
}

/// Returns the first and the last pixel between two tangents, and some more, within `low ..= high`.
fn pixels_between(focal: f32, centre: f32, [first, last]: [f32; 2], low: i32, high: i32) -> [i32; 2] {
    let ends = [first, last].map(|tangent| focal * tangent);
    let more = ends.map(|end| 1.0 + 1.0e-3 * end.abs());
    let pixels = [centre + ends[0] - more[0], centre + ends[1] + more[1]].map(|at| at.clamp(-FAR, FAR));
    [(pixels[0].floor() as i32).max(low), (pixels[1].ceil() as i32).min(high)]
}

fn near_splat(
    frame: &FrameUniform,
    voxel: &VisitedVoxel,
    xyz: [u32; 3],
    cover: Coverage,
    depth: f32,
    channels: &Channels,
) -> Splat {
    if depth < frame.eye_rest[3] || depth.is_nan() {
        return EMPTY;
    }
    let offset = [0, 1, 2].map(|a| (xyz[a] as f32 - frame.eye_voxel[a]) - frame.eye_rest[a] + cover.offset[a]);
    let radius = frame.eye_voxel[3];
    let square = dot(offset, offset);
    let [x0, y0, x1, y1] = frame.window;
    let (mut columns, mut rows) = ([x0, x1 - 1], [0, frame.picture_rows.cast_signed() - 1]);
    let mut at_eye = 0.0;
    if square <= radius * radius {
        at_eye = (-0.5 * std::f32::consts::LOG2_E / (frame.near_sigma * frame.near_sigma) * square).exp2();
    } else {
        let x = tangents(frame, gradient(frame, 0), offset, radius);
        let y = tangents(frame, gradient(frame, 1), offset, radius);
        if x[0] > x[1] || y[0] > y[1] {
            return EMPTY;
        }
        columns = pixels_between(frame.focal, frame.centre[0], x, columns[0], columns[1]);
        rows = pixels_between(frame.focal, frame.centre[1], [-y[1], -y[0]], rows[0], rows[1]);
    }
    let is_in_window = rows[0] < y1 && rows[1] >= y0;
    let [red, green, blue, peak] = look_of(frame, channels, voxel.record, cover.share);
    if columns[0] > columns[1] || rows[0] > rows[1] || !is_in_window || peak <= 0.0 || peak.is_nan() {
        return EMPTY;
    }
    let [red, green, blue] = colour_of(frame, voxel, xyz, channels, [red, green, blue]);
    Splat {
        columns: columns[0] as u32 | (columns[1] as u32) << 16,
        rows: rows[0] as u32 | (rows[1] as u32) << 16,
        corner_x: offset[0],
        corner_y: offset[1],
        falloff_x: offset[2],
        falloff_y: NEAR_SPLAT,
        shear: at_eye,
        peak,
        red,
        green,
        blue,
        on_rays: 0.0,
    }
}

/// Returns the first and the last pixel of an interval, clipped to `low ..= high`.
fn between(first: f32, last: f32, low: i32, high: i32) -> [i32; 2] {
    [nearest_pixel(first + 0.49).nearest.max(low), nearest_pixel(last - 0.49).nearest.min(high)]
}

fn value_splat(frame: &FrameUniform, voxel: &VisitedVoxel, xyz: [u32; 3], channels: &Channels) -> Splat {
    let [_, _, _, value] = look_of(frame, channels, voxel.record, 1.0);
    let offset = [0.0; 3];
    let [x0, y0, x1, y1] = frame.window;
    let last_row = frame.picture_rows.cast_signed() - 1;
    let (x, y, columns, rows);
    let (mut from_eye, mut closeness) = ([0.0; 3], 0.0);
    let place = [0, 1, 2].map(|a| xyz[frame.nesting[a] as usize] as f32);
    if frame.is_perspective == 0 {
        x = pixel_position(&frame.rows[0], frame.shifts[0], xyz, offset);
        y = pixel_position(&frame.rows[1], frame.shifts[1], xyz, offset);
        columns = span(x, frame.half_width[0], x0, x1 - 1);
        rows = span(y, frame.half_width[1], 0, last_row);
    } else {
        let [right, up, depth] = [0, 1, 2].map(|r| coordinate(&frame.rows[r], frame.shifts[r], xyz, offset));
        let reach = frame.ellipse;
        if depth + reach[2] < frame.near {
            return EMPTY;
        }
        closeness = if depth > reach[2] { 1.0 / depth } else { 0.0 };
        x = nearest_pixel(frame.centre[0] + frame.focal * (right * closeness));
        y = nearest_pixel(frame.centre[1] - frame.focal * (up * closeness));
        let nearest = (depth - reach[2]).max(frame.near);
        let farthest = (depth + reach[2]).max(nearest);
        let ends = |at: f32, reach: f32| {
            let (low, high) = (at - reach, at + reach);
            let pick = |is_outward: bool| if is_outward { nearest } else { farthest };
            [low / pick(low < 0.0), high / pick(high > 0.0)].map(|tangent| frame.focal * tangent)
        };
        let ([left, end], [bottom, top]) = (ends(right, reach[0]), ends(up, reach[1]));
        columns = between(frame.centre[0] + left, frame.centre[0] + end, x0, x1 - 1);
        rows = between(frame.centre[1] - top, frame.centre[1] - bottom, 0, last_row);
        from_eye = [0, 1, 2].map(|a| place[a] - frame.sample_rays[a][2]);
    }
    let is_off = !x.is_near || !y.is_near || columns[0] > columns[1] || rows[0] > rows[1];
    let is_in_window = rows[0] < y1 && rows[1] >= y0;
    if is_off || !is_in_window || value <= 0.0 || value.is_nan() {
        return EMPTY;
    }
    Splat {
        columns: columns[0] as u32 | (columns[1] as u32) << 16,
        rows: rows[0] as u32 | (rows[1] as u32) << 16,
        corner_x: (columns[0] - x.nearest) as f32 - x.fraction,
        corner_y: (rows[0] - y.nearest) as f32 - y.fraction,
        falloff_x: from_eye[1],
        falloff_y: from_eye[2],
        shear: from_eye[0],
        peak: value,
        red: place[0],
        green: closeness,
        blue: 0.0,
        on_rays: 0.0,
    }
}

fn splat_of(frame: &FrameUniform, is_maximum: bool, voxel: &VisitedVoxel, channels: &Channels) -> Splat {
    let xyz = [voxel.xy & 0xffff, voxel.xy >> 16, voxel.z_coverage & 0xffff];
    if (0..3).any(|a| xyz[a] < frame.crop_low[a] || xyz[a] > frame.crop_high[a]) {
        return EMPTY;
    }
    let products = (0..3).map(|a| (xyz[a] as i32).wrapping_mul(frame.clip[a]));
    if products.fold(0, i32::wrapping_add) < frame.clip[3] {
        return EMPTY;
    }
    let cover = coverage_of(frame, voxel.z_coverage >> 16);
    if is_maximum {
        return value_splat(frame, voxel, xyz, channels);
    }
    let mut strength = frame.ellipse[3];
    let (x, y, ellipse);
    if frame.is_perspective == 0 {
        x = pixel_position(&frame.rows[0], frame.shifts[0], xyz, cover.offset);
        y = pixel_position(&frame.rows[1], frame.shifts[1], xyz, cover.offset);
        let [falloff_x, falloff_y, shear, _] = frame.ellipse;
        ellipse = if frame.coverage_bits == 0 {
            Footprint { falloff_x, falloff_y, shear, half_width: frame.half_width, density: 1.0, is_on_rays: false }
        } else {
            let [x, y] = widened(frame, cover.offset, [gradient(frame, 0), gradient(frame, 1)]);
            Footprint { is_on_rays: false, ..footprint(frame, x, y) }
        };
        strength *= ellipse.density;
    } else {
        let distance = coordinate(&frame.rows[2], frame.shifts[2], xyz, cover.offset);
        if distance < frame.near || distance.is_nan() {
            return near_splat(frame, voxel, xyz, cover, distance, channels);
        }
        let closeness = 1.0 / distance;
        let tx = coordinate(&frame.rows[0], frame.shifts[0], xyz, cover.offset) * closeness;
        let ty = coordinate(&frame.rows[1], frame.shifts[1], xyz, cover.offset) * closeness;
        x = nearest_pixel(frame.centre[0] + frame.focal * tx);
        y = nearest_pixel(frame.centre[1] - frame.focal * ty);
        let scale = frame.focal * closeness;
        let across = frame.steps.map(|step| scale * (step[0] - tx * step[2]));
        let down = frame.steps.map(|step| scale * (ty * step[2] - step[1]));
        let [across, down] = widened(frame, cover.offset, [across, down]);
        let along = [0, 1, 2].map(|a| frame.rays[2][a] + frame.rays[0][a] * tx + frame.rays[1][a] * ty);
        let square = dot(along, along);
        let forward = gradient(frame, 2);
        let reach = frame.sigma * frame.cut_off * dot(forward, forward).sqrt();
        let slant = (1.0 + tx * tx + ty * ty).sqrt();
        ellipse = in_perspective(footprint(frame, across, down), square, slant, reach * closeness);
        strength *= ellipse.density * (closeness * closeness);
    }
    let [x0, y0, x1, y1] = frame.window;
    let columns = span(x, ellipse.half_width[0], x0, x1 - 1);
    let rows = span(y, ellipse.half_width[1], 0, frame.picture_rows.cast_signed() - 1);
    let is_off = !x.is_near || !y.is_near || columns[0] > columns[1] || rows[0] > rows[1];
    let is_in_window = rows[0] < y1 && rows[1] >= y0;
    if is_off || !is_in_window || strength <= 0.0 || strength.is_nan() {
        return EMPTY;
    }
    let [red, green, blue, depth] = look_of(frame, channels, voxel.record, cover.share);
    let peak = depth * strength;
    let peak = if ellipse.is_on_rays { peak } else { peak.min(frame.max_depth) };
    if peak <= 0.0 || peak.is_nan() {
        return EMPTY;
    }
    let colour = colour_of(frame, voxel, xyz, channels, [red, green, blue]);
    Splat {
        columns: columns[0] as u32 | (columns[1] as u32) << 16,
        rows: rows[0] as u32 | (rows[1] as u32) << 16,
        corner_x: (columns[0] - x.nearest) as f32 - x.fraction,
        corner_y: (rows[0] - y.nearest) as f32 - y.fraction,
        falloff_x: ellipse.falloff_x,
        falloff_y: ellipse.falloff_y,
        shear: ellipse.shear,
        peak,
        red: colour[0],
        green: colour[1],
        blue: colour[2],
        on_rays: f32::from(ellipse.is_on_rays),
    }
}
