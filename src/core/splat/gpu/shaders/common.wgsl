// Shared by all stages: the structs in the buffers and the arithmetic of a pixel. It precedes each stage's own text.
// Rust's side: layout.rs; tests/gpu/layout.rs compares the two.

// One row of an affine map from voxel coordinates to a screen coordinate. The integer sum is exact even where terms
// wrap; the remainder is small enough for single precision.
struct AffineRow {
    whole: vec4<i32>, // Factors of x, y, z and 1, in units of 2^-shift.
    remainder: vec4<f32>, // What the exact factors of x, y, z and 1 have beyond the whole ones.
}

// The uniform of a window of a frame's picture. Lengths without a unit are in mean voxel spacings.
struct FrameUniform {
    rows: array<AffineRow, 3>, // Parallel: column, row, unused. Perspective: right, up, depth along the view axis.
    shifts: vec4<i32>, // For each row: the number of fraction bits of its whole factors.
    // For a step of one voxel along x, y, z: change of right, up and depth; its length. Parallel: change of column and row.
    steps: array<vec4<f32>, 3>,
    // Widths of kernels along x, y, z, as shares of the widest, by how far a block's visible part is from its centre.
    widths: array<vec4<f32>, 3>,
    // For the slow, medium and fast axis, in a maximum. Perspective: by how much the ray's direction grows with the column
    // and with the row, in voxels per mean spacing along the view axis; the eye, in voxels; the view axis's direction.
    // Parallel, not for the slow axis: by how much the ray's point in a slice moves with the column and with the row, and in
    // half a slice, in voxels.
    sample_rays: array<vec4<f32>, 3>,
    eye: vec4<f32>, // Perspective: the eye. Parallel: the unit vector toward it.
    light: vec4<f32>, // Unit vector toward the light.
    light_weights: vec4<f32>, // Ambient, diffuse and specular light. w: 1 if normals have a coherence, else 0.
    // Parallel: falloff_x, falloff_y, shear of all splats. w: peak of a splat of optical depth 1; if voxels have coverages, of
    // density 1 too. In the perspective view of
    // a maximum: how far the samples of a voxel lie from it, right, up and forward.
    ellipse: vec4<f32>,
    half_width: vec2<f32>, // Parallel: half the width and height of a footprint's box, in pixels.
    centre: vec2<f32>, // Pixel where the view axis meets the picture.
    focal: f32, // Focal length, in pixels.
    // Voxels with a smaller depth along the view axis have no footprint: see near.wgsl. In a maximum: where rays begin.
    near: f32,
    sigma: f32, // Standard deviation of the kernel, in voxels.
    cut_off: f32, // Radius at which the kernel is cut off, in sigmas.
    cut_exponent: f32, // Exponent of the kernel at the cut-off radius, in units of ln 2.
    termination: f32, // Transmittance below which a pixel no longer changes; 0 for never.
    max_depth: f32, // Largest optical depth of a splat, in units of ln 2.
    initial_alpha: f32, // Initial value of a pixel's fourth component.
    window: vec4<i32>, // First column and row, one past the last column and row.
    crop_low: vec4<u32>, // Voxels outside this box are not drawn; both ends are inside.
    crop_high: vec4<u32>,
    clip: vec4<i32>, // Voxels whose product with xyz is below w are not drawn.
    // Perspective: change of a ray's direction in voxel coordinates by tangent to the right, by tangent upward, and its
    // direction forward. w of the last: peak of a near voxel of optical depth 1 for each unit of the ray's stretch.
    rays: array<vec4<f32>, 3>,
    eye_voxel: vec4<f32>, // The eye in voxel coordinates, rounded. w: radius of the kernel, in voxels.
    eye_rest: vec4<f32>, // What the eye has beyond that. w: near voxels with a smaller depth are not drawn.
    nesting: vec3<u32>, // The slow, medium and fast axis: 0, 1 or 2. The lane's is the fast one.
    coverage_bits: u32, // Bits of a coverage code: 8 or 16; 0 if all voxels are wholly visible.
    eye_ceil: i32, // The eye's coordinate on the fast axis, rounded up.
    eye_twice: i32, // Twice that coordinate, rounded down.
    fast_order: u32, // ASCENDING, DESCENDING, SPLIT or INTERLEAVED.
    is_back_to_front: u32, // 1 if voxels far from the eye come first, else 0.
    longest_line: u32, // Most records that a line may have.
    line_end_bytes: u32, // How many bytes store the end offset of a scan line: 2 or 4.
    value_bits: u32, // Bits of a value code: 8 or 16.
    normal_bits: u32, // Bits of each half of a normal code: 8 or 16; 0 for no normals.
    uses_magnitude: u32, // 1 if the optical depth also depends on the gradient magnitude, else 0.
    is_perspective: u32, // 1 in a perspective view, 0 in a parallel view.
    shininess: u32, // Exponent of the highlight; 0 for no lighting.
    tile_columns: u32, // Tiles in a row of the window.
    mask_words: u32, // Number of 32-bit words of a tile's mask and its summary.
    picture_rows: u32, // Rows of the whole picture.
    near_sigma: f32, // Standard deviation of the kernels of voxels near the eye, in voxels.
    low_pass: f32, // Smallest sigma of a footprint, in pixels.
}

const ASCENDING: u32 = 0u;
const DESCENDING: u32 = 1u;
const SPLIT: u32 = 2u;
const INTERLEAVED: u32 = 3u;

// A run of consecutive records that fits into the buffers of a frame.
struct Chunk {
    first_block: u32, // Index of the chunk's first block of lines in `blocks`.
    slot_count: u32, // Number of the chunk's records; each has a slot in `voxels` and `splats`.
    index: u32, // Index of the chunk's counter of drawn splats.
    is_first: u32, // 1 for the first chunk of a window, which clears the pixels.
    from_slice: u32, // The last slice of the chunk before, on the slow axis; 0 for the first chunk.
    to_slice: u32, // The last slice of the chunk.
}

// A voxel that the walk visited.
struct VisitedVoxel {
    xy: u32, // x in the low half, y in the high half.
    z_coverage: u32, // z in the low half, the coverage code in the high half.
    record: u32, // Index of the voxel's record in the slab; NO_RECORD for a slot without a voxel.
    padding: u32, // The struct is a whole vector, which a card moves at once.
}

const NO_RECORD: u32 = 0xffffffffu;

// A splat: the footprint of a voxel in the picture. In a maximum it is the voxel's value and place: `peak` is the normalised
// value, `red` the slice, `green` one over the depth along the view axis; `falloff_x`, `falloff_y` and `shear` are, in
// perspective, the voxel minus the eye along the medium, fast and slow axis.
struct Splat {
    // First column in the low half, last column in the high half; NOTHING for a splat without pixels. Columns count
    // from the left of the whole picture, so that a splat is the same in every window.
    columns: u32,
    rows: u32, // First row in the low half, last row in the high half.
    // The footprint. A voxel near the eye has none: then `falloff_y` is NEAR_SPLAT, `corner_x`, `corner_y` and
    // `falloff_x` are the voxel minus the eye in voxel coordinates, and `shear` is the kernel at the eye over its peak.
    corner_x: f32, // From the centre to the first column, in pixels.
    corner_y: f32, // From the centre to the first row, in pixels.
    falloff_x: f32, // Exponent per squared pixel of distance from the ridge along a row, in units of ln 2.
    falloff_y: f32, // Exponent per squared pixel from row to row, in units of ln 2.
    shear: f32, // By how many columns the ellipse's ridge moves per row.
    // Optical depth at the centre in units of ln 2; on rays, that divided by the ray's stretch. Of a voxel near the eye: that of the voxel.
    peak: f32,
    red: f32, // Linear colour, lit.
    green: f32,
    blue: f32,
    on_rays: f32, // 1 if the footprint is on rays, so that it is for rays of length and stretch 1; else 0.
}

// A Splat in a buffer: as vectors, each of which a card moves at once.
struct SplatVectors {
    place: vec4<u32>, // `columns`, `rows`, `corner_x` and `corner_y`.
    shape: vec4<f32>, // `falloff_x`, `falloff_y`, `shear` and `peak`.
    colour: vec4<f32>, // `red`, `green`, `blue` and `on_rays`.
}

const BATCH: u32 = 256u; // Number of splats of a batch, and of invocations of a workgroup.
const TILE_SIDE: i32 = 16; // Side of a tile of the picture, in pixels.
const SUMMARY_WORDS: u32 = 8u; // 32-bit words of the summary of a tile's mask.
const NEAR_SPLAT: f32 = -1.0; // `falloff_y` of a voxel near the eye.
const NOTHING: u32 = 1u; // `columns` and `rows` of a splat without pixels: first pixel 1, last pixel 0.

const LN_2: f32 = 0.6931471805599453;
const LOG2_E: f32 = 1.4426950408889634;

fn low_half(word: u32) -> i32 {
    return i32(word & 0xffffu);
}

fn high_half(word: u32) -> i32 {
    return i32(word >> 16u);
}

// Returns 1 - 2^-x for x of 0 to 125; relative error below 3e-7 however small x is. Polynomial: arith.rs.
fn absorbed(x: f32) -> f32 {
    let whole = round(x);
    let f = x - whole;
    let square = f * f;
    let low = LN_2 + -2.402265e-1 * f;
    let middle = 5.5503574e-2 + -9.618237e-3 * f;
    let high = 1.3390735e-3 + -1.5403513e-4 * f;
    let series = low + square * (middle + square * high);
    let scale = bitcast<f32>(0x3f800000u - (u32(whole) << 23u));
    return (1.0 - scale) + scale * (f * series);
}
