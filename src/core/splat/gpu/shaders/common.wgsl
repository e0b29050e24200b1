// What the stages share: the buffers' records and the arithmetic of a pixel. It stands before each stage's own text.
// Rust's side: layout.rs; tests/gpu holds the two equal.

// From voxels to one coordinate: a sum of whole numbers of 2^-shift, exact while it wraps, and what they leave over.
struct Row {
    whole: vec4<i32>,
    rest: vec4<f32>,
}

// A frame, as all of its voxels see it.
struct Shot {
    // Parallel: column, row, none. Perspective: right, up, along the view. Times (x, y, z, 1).
    rows: array<Row, 3>,
    // Bits below the point of each row's whole numbers.
    shift: vec4<i32>,
    // For x, y, z: right, up, along the view per voxel; the distance between voxels; in mean voxels.
    steps: array<vec4<f32>, 3>,
    // Perspective: the eye in mean voxels. Parallel: the unit vector toward it.
    eye: vec4<f32>,
    // Unit vector toward the light.
    light: vec4<f32>,
    // Weights of ambient, diffuse and specular light.
    weights: vec4<f32>,
    // Parallel: across, along, shear, peak of a unit of optical depth. Perspective: the last alone.
    ellipse: vec4<f32>,
    // Parallel: half of a footprint's box.
    half: vec2<f32>,
    // Pixel that the view axis meets.
    centre: vec2<f32>,
    focal: f32,
    near: f32,
    sigma: f32,
    // Where the kernel is cut off, in sigmas.
    cut_off: f32,
    // Exponent there, in units of ln 2.
    cut: f32,
    // Transmittance below which a pixel no longer changes; 0 for never.
    stop: f32,
    // Largest optical depth of a splat, in units of ln 2.
    most: f32,
    // What a pixel's fourth value starts as.
    fourth: f32,
    // The pixels at hand: first column and row, one past the last.
    window: vec4<i32>,
    // Voxels that are drawn, inclusive.
    crop_low: vec4<u32>,
    crop_high: vec4<u32>,
    // The eye's coordinate on the fast axis, rounded up; twice it, rounded down.
    eye_ceil: i32,
    eye_twice: i32,
    // One of the constants below.
    fast_order: u32,
    // 1 where the far end of a line comes first.
    back_to_front: u32,
    // The lane's axis: 0, 1 or 2.
    fast_axis: u32,
    // Most records that a line may have.
    longest: u32,
    // 2 or 4.
    line_end_bytes: u32,
    // 8 or 16.
    value_bits: u32,
    // 0, 8 or 16.
    normal_bits: u32,
    // 1 where the optical depth depends on the gradient's magnitude too.
    by_magnitude: u32,
    // 1 where a peak is a normalised value.
    maximum: u32,
    perspective: u32,
    // Exponent of the highlight; 0 for no lighting.
    shininess: u32,
    // Tiles of the window from one row of them to the next.
    tile_columns: u32,
    // Words of a tile's mask.
    mask_words: u32,
    // Rows of the whole picture, of which the window has some.
    picture_rows: u32,
}

const ASCENDING: u32 = 0u;
const DESCENDING: u32 = 1u;
const SPLIT: u32 = 2u;
const INTERLEAVED: u32 = 3u;

// As many voxels of the walk as the buffers hold.
struct Chunk {
    first_block: u32,
    slot_count: u32,
    // Which counter of drawn splats is its own.
    index: u32,
    // 1 where pixels start anew.
    is_first: u32,
}

// A visited voxel.
struct Voxel {
    // x in the low half, y in the high half.
    xy: u32,
    z: u32,
    // Its record; NO_RECORD for what is no voxel.
    record: u32,
}

const NO_RECORD: u32 = 0xffffffffu;

// A splat: what a voxel does to the pixels of its box.
struct Splat {
    // First column in the low half, last column in the high half; of nothing if they are the wrong way around. Within
    // the picture, so that a splat is the same for every window that it meets.
    columns: u32,
    rows: u32,
    // From the centre to the first column and row, in pixels.
    corner_x: f32,
    corner_y: f32,
    // Exponent per squared pixel along a row and from row to row; columns that the ridge moves per row.
    across: f32,
    along: f32,
    shear: f32,
    // Optical depth at the centre in units of ln 2, or normalised value.
    peak: f32,
    red: f32,
    green: f32,
    blue: f32,
}

// Voxels of a workgroup, and splats that are looked at together.
const BATCH: u32 = 256u;
// Pixels along an edge of a tile.
const TILE: i32 = 16;

// Columns and rows of a splat that has none.
const NOTHING: u32 = 1u;

const LN_2: f32 = 0.6931471805599453;
const LOG2_E: f32 = 1.4426950408889634;

fn low_half(word: u32) -> i32 {
    return i32(word & 0xffffu);
}

fn high_half(word: u32) -> i32 {
    return i32(word >> 16u);
}

// 1 - 2^-x for x of 0 to 125, relative error below 3e-7 however small x is: arith.rs.
fn absorbed(x: f32) -> f32 {
    let whole = round(x);
    let f = x - whole;
    let square = f * f;
    let low = LN_2 + -2.402265e-1 * f;
    let middle = 5.5503574e-2 + -9.618237e-3 * f;
    let high = 1.3390735e-3 + -1.5403513e-4 * f;
    let rest = low + square * (middle + square * high);
    let scale = bitcast<f32>(0x3f800000u - (u32(whole) << 23u));
    return (1.0 - scale) + scale * (f * rest);
}

// Optical depth of a splat at a pixel in units of ln 2, 0 outside its ellipse; `dx`, `dy` from its centre.
fn depth_at(dx: f32, dy: f32, across: f32, along: f32, shear: f32, peak: f32, cut: f32) -> f32 {
    let u = dx - shear * dy;
    let q = across * (u * u) + along * (dy * dy);
    return select(0.0, peak * exp2(-q), q <= cut);
}
