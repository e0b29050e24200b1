//! The structs in the stages' buffers. No other place in Rust knows the layout of those buffers.
//!
//! In: the setup of a frame, and a window of its picture. Out: the same values in the form that the shaders read. Each
//! struct equals the struct of the same name in `shaders/common.wgsl` or, for [`LineBlock`], `shaders/walk.wgsl`, which
//! documents the fields; tests/gpu/layout.rs compares the two by reflection.

#![expect(missing_docs, reason = "documented once, where the shaders read them")]
#![expect(clippy::cast_possible_truncation, reason = "the device computes in single precision")]

use bytemuck::{Pod, Zeroable};

use super::stages::BlendMode;
use crate::arena::layout::line_end_bytes;
use crate::arena::visible::MAX_DEPTH;
use crate::splat::Lighting;
use crate::splat::arith::LOG2_E;
use crate::splat::clip::{ClipRegion, IndexPlane};
use crate::splat::cpu::scatter::maximum::MaximumRays;
use crate::splat::kernel::{KernelShape, footprint};
use crate::splat::near::EyeRays;
use crate::splat::setup::FrameSetup as Shot;
use crate::splat::view::{Affine, PixelMap, View, single};
use crate::traverse::{AxisOrder, Sense, SplitForm};

pub const LINES: u32 = 64; // Most lines of a block, and invocations of a workgroup of the walk.
pub const BATCH: u32 = 256; // Splats of a batch, and invocations of a workgroup of the other stages.
pub const TILE_SIDE: u32 = 16; // Side of a tile of the picture, in pixels.
pub const SUMMARY_WORDS: u32 = 8; // 32-bit words of the summary of a tile's mask.
pub const NO_RECORD: u32 = u32::MAX; // The value of `record` in a slot without a voxel.
pub const NOTHING: u32 = 1; // `columns` and `rows` of a splat without pixels: first pixel 1, last pixel 0.

/// A row of an affine map: from voxel coordinates to one screen coordinate.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct AffineRow {
    pub whole: [i32; 4],
    pub remainder: [f32; 4],
}

/// The uniform that the stages read for a window of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameUniform {
    pub rows: [AffineRow; 3],
    pub shifts: [i32; 4],
    pub steps: [[f32; 4]; 3],
    pub widths: [[f32; 4]; 3],
    pub sample_rays: [[f32; 4]; 3],
    pub eye: [f32; 4],
    pub light: [f32; 4],
    pub light_weights: [f32; 4],
    pub ellipse: [f32; 4],
    pub half_width: [f32; 2],
    pub centre: [f32; 2],
    pub focal: f32,
    pub near: f32,
    pub sigma: f32,
    pub cut_off: f32,
    pub cut_exponent: f32,
    pub termination: f32,
    pub max_depth: f32,
    pub initial_alpha: f32,
    pub window: [i32; 4],
    pub crop_low: [u32; 4],
    pub crop_high: [u32; 4],
    pub clip: [i32; 4],
    pub rays: [[f32; 4]; 3],
    pub eye_voxel: [f32; 4],
    pub eye_rest: [f32; 4],
    pub nesting: [u32; 3],
    pub coverage_bits: u32,
    pub eye_ceil: i32,
    pub eye_twice: i32,
    pub fast_order: u32,
    pub is_back_to_front: u32,
    pub longest_line: u32,
    pub line_end_bytes: u32,
    pub value_bits: u32,
    pub normal_bits: u32,
    pub uses_magnitude: u32,
    pub is_perspective: u32,
    pub shininess: u32,
    pub tile_columns: u32,
    pub mask_words: u32,
    pub picture_rows: u32,
    pub near_sigma: f32,
    pub low_pass: f32,
}

/// A run of consecutive records that fits into the buffers of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Chunk {
    pub first_block: u32,
    pub slot_count: u32,
    pub index: u32,
    pub is_first: u32,
    pub from_slice: u32,
    pub to_slice: u32,
}

/// Up to [`LINES`] consecutive lines of the line list, and the slots of their records.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct LineBlock {
    pub first_line: u32,
    pub line_count: u32,
    pub first_slot: u32,
    pub end_slot: u32,
}

/// A voxel that the walk visited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct VisitedVoxel {
    pub xy: u32,
    pub z_coverage: u32,
    pub record: u32,
    pub padding: u32,
}

/// A splat: the footprint of a voxel in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Splat {
    pub columns: u32,
    pub rows: u32,
    pub corner_x: f32,
    pub corner_y: f32,
    pub falloff_x: f32,
    pub falloff_y: f32,
    pub shear: f32,
    pub peak: f32,
    pub red: f32,
    pub green: f32,
    pub blue: f32,
    pub on_rays: f32,
}

impl AffineRow {
    /// Returns `map`, for voxels of a grid of `dims` points, as a row; and its shift (the number of fraction bits).
    ///
    /// Whole factors are in units of 2^-shift, as fine as their sum at any voxel fits 31 bits. The remainders of the
    /// factors are then small enough for single precision.
    fn new(map: &Affine, dims: [u32; 3]) -> (AffineRow, i32) {
        let reach: f64 = (0..3).map(|a| map[a].abs() * f64::from(dims[a] - 1)).sum::<f64>() + map[3].abs();
        if reach > f64::from(1 << 29) {
            // Then a voxel is large too, in pixels: the error of single precision is below 0.01 voxels.
            return (AffineRow { whole: [0; 4], remainder: map.map(|factor| factor as f32) }, 0);
        }
        // The limit 1e-6 avoids the logarithm of 0.
        let shift = (29.0 - reach.max(1e-6).log2().ceil()).clamp(0.0, 30.0);
        let unit = (-shift).exp2();
        let whole = map.map(|factor| (factor / unit).round());
        let remainder = std::array::from_fn(|i| (map[i] - whole[i] * unit) as f32);
        // Along an axis of one point a factor may be anything: it is multiplied by 0.
        (AffineRow { whole: whole.map(|factor| factor.clamp(-9e15, 9e15) as i64 as i32), remainder }, shift as i32)
    }
}

impl FrameUniform {
    /// Returns the uniform of `shot` for `window` (first column and row, one past the last column and row).
    ///
    /// The caller fills in `termination`, `uses_magnitude` and `mask_words`.
    pub(crate) fn new(shot: &Shot, window: [i32; 4], blend: BlendMode) -> FrameUniform {
        let Shot { view, kernel, widths, .. } = shot;
        let (dims, channels) = (shot.lane.dims, shot.lane.channels);
        let [sigma, cut_off] = [kernel.sigma, kernel.cut_off()];
        let mut uniform = FrameUniform { initial_alpha: blend.initial_alpha(), ..FrameUniform::zeroed() };
        let padded = |v: [f32; 3]| [v[0], v[1], v[2], 0.0];
        let maps: &[Affine] = match &view.map {
            PixelMap::Parallel { pixel_from_voxel, scale } => {
                let footprint = footprint(pixel_from_voxel.each_ref().map(single), sigma, cut_off, shot.low_pass);
                let strength = kernel.normalisation() * footprint.density * (scale * scale) as f32;
                let ellipse = footprint.ellipse;
                uniform.ellipse = [ellipse.u_factor, ellipse.y_factor, ellipse.shear, strength];
                uniform.half_width = [ellipse.half_x, ellipse.half_y];
                for a in 0..3 {
                    let [column, row] = pixel_from_voxel.map(|map| map[a] as f32);
                    uniform.steps[a] = [column, row, 0.0, 0.0];
                }
                if channels.coverage_bits > 0 {
                    uniform.ellipse[3] = kernel.normalisation() * (scale * scale) as f32;
                }
                uniform.eye = padded(shot.lights.map_or([0.0; 3], |lights| lights.eye));
                pixel_from_voxel
            }
            PixelMap::Perspective { camera_from_voxel, focal, centre, near } => {
                for a in 0..3 {
                    let [right, up, depth] = camera_from_voxel.map(|map| map[a] as f32);
                    uniform.steps[a] = [right, up, depth, view.steps[a] as f32];
                }
                uniform.ellipse[3] = kernel.normalisation() * (focal * focal) as f32;
                uniform.eye = padded(view.eye_scaled.map(|c| c as f32));
                uniform.centre = centre.map(|c| c as f32);
                uniform.focal = *focal as f32;
                uniform.near = *near as f32;
                uniform.set_near(view, shot.near_kernel);
                uniform.is_perspective = 1;
                camera_from_voxel
            }
        };
        if blend == BlendMode::Maximum {
            uniform.set_rays(&MaximumRays::new(shot));
        }
        for (r, map) in maps.iter().enumerate() {
            (uniform.rows[r], uniform.shifts[r]) = AffineRow::new(map, dims);
        }
        if let Some(lights) = &shot.lights {
            uniform.light = padded(lights.light);
            let Lighting { ambient, diffuse, specular, shininess, .. } = lights.lighting;
            uniform.light_weights = [ambient, diffuse, specular, f32::from(channels.coherence)];
            uniform.shininess = shininess.into();
        }
        (uniform.sigma, uniform.cut_off, uniform.cut_exponent) = (sigma, cut_off, kernel.cut());
        uniform.near_sigma = shot.near_kernel.sigma;
        uniform.low_pass = shot.low_pass;
        uniform.max_depth = MAX_DEPTH as f32 * LOG2_E;
        uniform.window = window;
        let ClipRegion { crop, plane } = shot.clip;
        let padded = |v: [u16; 3]| [v[0].into(), v[1].into(), v[2].into(), 0];
        (uniform.crop_low, uniform.crop_high) = (padded(crop.low), padded(crop.high));
        uniform.clip = plane.map_or([0; 4], |IndexPlane { normal: [x, y, z], least }| [x, y, z, least]);
        let fast = shot.order.fast;
        // Voxel coordinates are integers, so integers can replace the eye's coordinate: voxels at `eye_ceil` or above lie
        // on the eye's high side. Of two voxels, the low one is nearer if their sum is above `eye_twice`.
        match shot.order.along[fast.index()] {
            AxisOrder::Ascending => {}
            AxisOrder::Descending => uniform.fast_order = 1,
            AxisOrder::TwoSided { eye, form, sense } => {
                uniform.eye_ceil = eye.ceil() as i32;
                uniform.eye_twice = (2.0 * eye).floor() as i32;
                uniform.fast_order = if form == SplitForm::Split { 2 } else { 3 };
                uniform.is_back_to_front = (sense == Sense::BackToFront).into();
            }
        }
        uniform.nesting = [shot.order.slow, shot.order.medium, fast].map(|axis| axis.index() as u32);
        uniform.longest_line = dims[fast.index()];
        uniform.line_end_bytes = line_end_bytes(uniform.longest_line).into();
        uniform.value_bits = channels.value_bits.into();
        uniform.normal_bits = channels.normal_bits.into();
        uniform.coverage_bits = channels.coverage_bits.into();
        uniform.widths = widths.0.map(|[near, middle, far]| [near, middle, far, 0.0]);
        uniform.picture_rows = view.size[1];
        uniform.tile_columns = ((window[2] - window[0]).cast_unsigned()).div_ceil(TILE_SIDE);
        uniform
    }

    /// Multiplies all optical depths by `factor`.
    pub(crate) fn scale_depths(&mut self, factor: f32) {
        self.ellipse[3] *= factor;
        self.rays[2][3] *= factor;
    }

    /// Sets the rays of a perspective's pixels, and what voxels near the eye need.
    fn set_near(&mut self, view: &View, kernel: KernelShape) {
        // Farther eyes have no voxels near them; the limit keeps squares finite.
        const FAR: f64 = 1e9;
        let Some(near) = EyeRays::new(view, kernel) else { return };
        let eye = near.eye.to_array().map(|c| c.clamp(-FAR, FAR));
        let [right, up, forward] = [near.right, near.up, near.forward];
        let extended = |[x, y, z]: [f32; 3], w: f32| [x, y, z, w];
        self.rays = [extended(right, 0.0), extended(up, 0.0), extended(forward, near.strength)];
        self.eye_voxel = extended(eye.map(|c| c.round() as f32), kernel.radius);
        self.eye_rest = extended(eye.map(|c| (c - c.round()) as f32), near.least_depth as f32);
    }

    /// Fills in the rays of a maximum, and how far a voxel's samples lie from it.
    fn set_rays(&mut self, rays: &MaximumRays) {
        match rays {
            MaximumRays::Parallel { start, slope, reach, .. } => {
                for a in 0..2 {
                    self.sample_rays[a + 1] = [start[a][0] as f32, start[a][1] as f32, (slope[a] / 2.0) as f32, 0.0];
                }
                self.half_width = reach.map(|reach| reach as f32 + 0.01);
            }
            MaximumRays::Perspective { eye, direction, reach, near, centre, .. } => {
                self.near = *near as f32;
                for a in 0..3 {
                    let [by_column, by_row, first] = direction[a];
                    let ahead = first + by_column * centre[0] + by_row * centre[1];
                    self.sample_rays[a] = [by_column, by_row, eye[a], ahead].map(|number| number as f32);
                    self.ellipse[a] = reach[a] as f32;
                }
            }
        }
    }
}
