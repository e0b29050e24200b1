//! The records of the stages' buffers: the only place in Rust that knows how they lie.
//!
//! In: what a frame is made of, and a window of its picture. Out: the same for the device. Each struct is
//! that of `shaders/common.wgsl` (or, where it says so, another shader) with the same name; tests/gpu holds the two
//! equal by reflection. All are little-endian words, as WGSL has them.

#![expect(clippy::cast_possible_truncation, reason = "the device computes in single precision")]

use bytemuck::{Pod, Zeroable};

use crate::arena::layout::line_end_bytes;
use crate::splat::arith::LOG2_E;
use crate::splat::composite::MAX_DEPTH;
use crate::splat::kernel::footprint;
use crate::splat::setup::FrameSetup as HostShot;
use crate::splat::view::{Affine, PixelMap};
use crate::traverse::{AxisOrder, Sense, SplitForm, VoxelBox};

/// Lines of a block, and invocations of a workgroup of the walk.
pub const LINES: u32 = 64;
/// Splats that are looked at together, and invocations of the other workgroups.
pub const BATCH: u32 = 256;
/// Pixels along an edge of a tile of the picture.
pub const TILE: u32 = 16;
/// What a voxel without a record has for one.
pub const NO_RECORD: u32 = u32::MAX;
/// Columns and rows of a splat that has none.
pub const NOTHING: u32 = 1;

/// From voxels to one coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Row {
    /// Factors of x, y, z, 1 in units of 2^-shift.
    pub whole: [i32; 4],
    /// What they leave over.
    pub rest: [f32; 4],
}

/// A frame, as all of its voxels see it; the fields are documented in `common.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
#[expect(missing_docs, reason = "said once, where the shaders read them")]
pub struct Shot {
    pub rows: [Row; 3],
    pub shift: [i32; 4],
    pub steps: [[f32; 4]; 3],
    pub eye: [f32; 4],
    pub light: [f32; 4],
    pub weights: [f32; 4],
    pub ellipse: [f32; 4],
    pub half: [f32; 2],
    pub centre: [f32; 2],
    pub focal: f32,
    pub near: f32,
    pub sigma: f32,
    pub cut_off: f32,
    pub cut: f32,
    pub stop: f32,
    pub most: f32,
    pub fourth: f32,
    pub window: [i32; 4],
    pub crop_low: [u32; 4],
    pub crop_high: [u32; 4],
    pub eye_ceil: i32,
    pub eye_twice: i32,
    pub fast_order: u32,
    pub back_to_front: u32,
    pub fast_axis: u32,
    pub longest: u32,
    pub line_end_bytes: u32,
    pub value_bits: u32,
    pub normal_bits: u32,
    pub by_magnitude: u32,
    pub maximum: u32,
    pub perspective: u32,
    pub shininess: u32,
    pub tile_columns: u32,
    pub mask_words: u32,
    pub picture_rows: u32,
}

/// As many voxels of the walk as the buffers hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Chunk {
    /// Its first block of lines.
    pub first_block: u32,
    /// Its records: places of voxels and splats.
    pub slot_count: u32,
    /// Which counter of drawn splats is its own.
    pub index: u32,
    /// 1 where pixels start anew.
    pub is_first: u32,
}

/// Up to [`LINES`] lines of the list, and where their voxels go; `walk.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Block {
    /// Its first line in the list.
    pub first_line: u32,
    /// Lines: 1 to [`LINES`].
    pub line_count: u32,
    /// Place of its first record in the chunk.
    pub first_slot: u32,
    /// One past the place of its last.
    pub end_slot: u32,
}

/// A visited voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Voxel {
    /// x in the low half, y in the high half.
    pub xy: u32,
    /// z.
    pub z: u32,
    /// Its record in the slab, or [`NO_RECORD`].
    pub record: u32,
}

/// A splat.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Splat {
    /// First column in the low half, last column in the high half, within the picture; [`NOTHING`] for none.
    pub columns: u32,
    /// Likewise.
    pub rows: u32,
    /// From the centre to the first column, in pixels.
    pub corner_x: f32,
    /// From the centre to the first row, in pixels.
    pub corner_y: f32,
    /// Exponent per squared pixel along a row, in units of ln 2.
    pub across: f32,
    /// Exponent per squared pixel from row to row, in units of ln 2.
    pub along: f32,
    /// Columns that the ridge moves per row.
    pub shear: f32,
    /// Optical depth at the centre in units of ln 2, or normalised value.
    pub peak: f32,
    /// Linear colour, lit.
    pub red: f32,
    /// Likewise.
    pub green: f32,
    /// Likewise.
    pub blue: f32,
}

impl Row {
    /// The row of `map` over a grid of `dims` points, and its shift.
    ///
    /// Whole numbers of 2^-shift are as fine as the sum's magnitude over the grid allows in 31 bits; what they leave over
    /// is small, so that single precision is enough for it.
    fn new(map: &Affine, dims: [u32; 3]) -> (Row, i32) {
        let reach: f64 = (0..3).map(|a| map[a].abs() * f64::from(dims[a] - 1)).sum::<f64>() + map[3].abs();
        if reach > f64::from(1 << 29) {
            // So large that a voxel is large too: single precision errs by less than a hundredth of one.
            return (Row { whole: [0; 4], rest: map.map(|factor| factor as f32) }, 0);
        }
        // A sum of 0 needs no bits.
        let shift = (29.0 - reach.max(1e-6).log2().ceil()).clamp(0.0, 30.0);
        let unit = (-shift).exp2();
        let whole = map.map(|factor| (factor / unit).round());
        let rest = std::array::from_fn(|i| (map[i] - whole[i] * unit) as f32);
        // Along an axis of one point a factor may be anything: it is multiplied by 0.
        (Row { whole: whole.map(|factor| factor.clamp(-9e15, 9e15) as i64 as i32), rest }, shift as i32)
    }
}

impl Shot {
    /// `host`, for the pixels of `window` (first column and row, one past the last).
    pub(crate) fn new(host: &HostShot, window: [i32; 4], order: FastOrder) -> Shot {
        let HostShot { view, kernel, .. } = host;
        let (dims, channels) = (host.lane.dims, host.lane.channels);
        let [sigma, cut_off] = [kernel.sigma, kernel.cut_off()];
        let mut shot = Shot::zeroed();
        let four = |v: [f32; 3]| [v[0], v[1], v[2], 0.0];
        match &view.map {
            PixelMap::Parallel { pixel_from_voxel, scale } => {
                let single = pixel_from_voxel.map(|m| [m[0] as f32, m[1] as f32, m[2] as f32]);
                let print = footprint(single, sigma, cut_off);
                for (r, map) in pixel_from_voxel.iter().enumerate() {
                    (shot.rows[r], shot.shift[r]) = Row::new(map, dims);
                }
                let strength = kernel.normalisation() * print.density * (scale * scale) as f32;
                shot.ellipse = [print.ellipse.u_factor, print.ellipse.y_factor, print.ellipse.shear, strength];
                shot.half = [print.ellipse.half_x, print.ellipse.half_y];
                shot.eye = four(host.lights.map_or([0.0; 3], |lights| lights.eye));
            }
            PixelMap::Perspective { camera_from_voxel, focal, centre, near } => {
                for (r, map) in camera_from_voxel.iter().enumerate() {
                    (shot.rows[r], shot.shift[r]) = Row::new(map, dims);
                }
                for a in 0..3 {
                    let [right, up, along] = camera_from_voxel.map(|map| map[a] as f32);
                    shot.steps[a] = [right, up, along, view.steps[a] as f32];
                }
                shot.ellipse[3] = kernel.normalisation() * (focal * focal) as f32;
                shot.eye = four(view.eye_scaled.map(|c| c as f32));
                shot.centre = centre.map(|c| c as f32);
                shot.focal = *focal as f32;
                shot.near = *near as f32;
                shot.perspective = 1;
            }
        }
        if let Some(lights) = &host.lights {
            shot.light = four(lights.light);
            shot.weights = [lights.ambient, lights.diffuse, lights.specular, 0.0];
            shot.shininess = lights.shininess.into();
        }
        (shot.sigma, shot.cut_off, shot.cut) = (sigma, cut_off, kernel.cut());
        shot.most = MAX_DEPTH as f32 * LOG2_E;
        shot.window = window;
        let crop = host.crop.unwrap_or(VoxelBox { low: [0; 3], high: [u16::MAX; 3] });
        let four = |v: [u16; 3]| [v[0].into(), v[1].into(), v[2].into(), 0];
        (shot.crop_low, shot.crop_high) = (four(crop.low), four(crop.high));
        FastOrder { ceil: shot.eye_ceil, twice: shot.eye_twice, kind: shot.fast_order, reversed: shot.back_to_front } =
            order;
        let fast = host.order.fast;
        shot.fast_axis = fast.index() as u32;
        shot.longest = dims[fast.index()];
        shot.line_end_bytes = line_end_bytes(shot.longest).into();
        shot.value_bits = channels.value_bits.into();
        shot.normal_bits = channels.normal_bits.into();
        shot.maximum = host.maximum.into();
        shot.picture_rows = view.size[1];
        shot.tile_columns = ((window[2] - window[0]).cast_unsigned()).div_ceil(TILE);
        shot
    }
}

/// An axis' order in whole numbers, which say the same as the eye's coordinate: coordinates are whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct FastOrder {
    /// The eye's coordinate, rounded up: where its far side begins.
    ceil: i32,
    /// Twice the eye's coordinate, rounded down: a low coordinate is nearer than a high one where their sum is above.
    twice: i32,
    kind: u32,
    reversed: u32,
}

impl FastOrder {
    /// As `order`.
    pub(crate) fn new(order: AxisOrder) -> FastOrder {
        match order {
            AxisOrder::Ascending => FastOrder { ceil: 0, twice: 0, kind: 0, reversed: 0 },
            AxisOrder::Descending => FastOrder { ceil: 0, twice: 0, kind: 1, reversed: 0 },
            AxisOrder::TwoSided { eye, form, sense } => FastOrder {
                ceil: eye.ceil() as i32,
                twice: (2.0 * eye).floor() as i32,
                kind: if form == SplitForm::Split { 2 } else { 3 },
                reversed: (sense == Sense::BackToFront).into(),
            },
        }
    }
}
