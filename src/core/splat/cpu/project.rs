//! Stage 1: from voxels to splats.
//!
//! In: up to a block of voxels and their records. Out: their footprints, colours and peaks (optical depths at the
//! centres; on rays, for a stretch of 1). Every loop over a block treats each voxel by itself, so that vector instructions
//! can treat many at once:
//!
//! ```text
//! place     centre, ellipse, bounding box             all voxels of the block
//! cull      keeps those that reach open pixels        voxels that are not clipped
//! colour    code -> look; normal -> light             kept voxels only (looks.rs)
//! ```
//!
//! Centres are computed in double precision, so that a picture of 16,384 pixels is as exact as a small one.

use super::splats::{SplatPlaces, Splats};
use super::tile_buffer::{Rect, TileBuffer};
use super::voxel_block::{BLOCK, Coordinates, Displaced, VoxelBlock};
use crate::arena::visible::MAX_DEPTH;
use crate::arena::{Coverage, Lane};
use crate::splat::arith::{LOG2_E, at_most, keep_if};
use crate::splat::block_kernel::{SHAPES, Widths, shape};
use crate::splat::clip::{ClipRegion, IndexPlane};
use crate::splat::composite::Table;
use crate::splat::kernel::{Ellipse, Footprint, footprint, jacobian, widened};
use crate::splat::near::EyeRays;
use crate::splat::setup::FrameSetup;
use crate::splat::shade::Lights;
use crate::splat::view::{Affine, PixelMap, single};

/// Holds all parameters of a frame that turn a voxel into a splat.
#[derive(Debug)]
pub struct Projector<'a> {
    pub(super) lane: Lane<'a>,
    pub(super) table: &'a Table<'a>,
    /// The lighting; `None` if voxels are not lit.
    pub lights: Option<Lights>,
    pub(super) clip: ClipRegion,
    pub(super) sigma: f32,
    /// The radius at which the kernel is cut off, in standard deviations.
    pub(super) cut_off: f32,
    /// The exponent of the kernel at the cut-off radius, in units of ln 2.
    pub(super) cut: f32,
    /// The low-pass of footprints, in pixels.
    pub(super) low_pass: f32,
    /// Transmittance below which a pixel no longer changes; 0 for never.
    pub(super) stop: f32,
    /// Indices of the slow, medium and fast axis.
    pub slow_medium_fast: [usize; 3],
    pub(super) map: PixelMap,
    /// The rays of a perspective's pixels; `None` in parallel views.
    pub(super) rays: Option<EyeRays>,
    /// The footprint that all voxels of a parallel view share; all fields are 0 in perspective.
    pub(super) ellipse: Ellipse,
    /// The same and `strength` for each shape of a kernel, in a parallel view of voxels beside points of the grid.
    pub(super) shapes: Option<Box<[(Ellipse, f32); SHAPES]>>,
    /// The widths of kernels beside points of the grid.
    pub(super) widths: Widths,
    /// The peak of a splat of optical depth 1; in perspective, kernel normalisation times squared focal length.
    pub(super) strength: f32,
    /// The position of the eye along the x, y and z axis, in mean spacings.
    pub(super) eye: [f32; 3],
    /// The distance between neighbouring voxels on each axis, in mean spacings.
    pub(super) steps: [f32; 3],
}

impl<'a> Projector<'a> {
    /// Creates the projector of a frame. `stop`: transmittance below which a pixel no longer changes; 0 for never.
    pub fn new(setup: &FrameSetup<'a>, table: &'a Table<'a>, stop: f32) -> Projector<'a> {
        let FrameSetup { view, order, lane, lights, kernel, widths, low_pass, clip, .. } = setup;
        let (sigma, cut_off, normalisation) = (kernel.sigma, kernel.cut_off(), kernel.normalisation());
        let footprint_of = |rows| footprint(rows, sigma, cut_off, *low_pass);
        let (ellipse, strength, shapes) = match &view.map {
            PixelMap::Parallel { pixel_from_voxel, scale } => {
                let rows = pixel_from_voxel.each_ref().map(single);
                let square = (scale * scale) as f32;
                let of_shape = |shape| {
                    let Footprint { ellipse, density, .. } = footprint_of(widened(rows, widths.of(shape)));
                    (ellipse, normalisation * square * density)
                };
                let has_shapes = lane.channels.coverage_bits > 0;
                let Footprint { ellipse, density, .. } = footprint_of(rows);
                let shapes = has_shapes.then(|| Box::new(std::array::from_fn(of_shape)));
                (ellipse, normalisation * density * square, shapes)
            }
            PixelMap::Perspective { focal, .. } => (Ellipse::default(), normalisation * (focal * focal) as f32, None),
        };
        Projector {
            lane: *lane,
            table,
            lights: *lights,
            clip: *clip,
            sigma,
            cut_off,
            cut: kernel.cut(),
            low_pass: *low_pass,
            stop,
            slow_medium_fast: [order.slow.index(), order.medium.index(), order.fast.index()],
            map: view.map,
            rays: EyeRays::new(view, setup.near_kernel),
            ellipse,
            shapes,
            widths: *widths,
            strength,
            eye: view.eye_scaled.map(|c| c as f32),
            steps: view.steps.map(|c| c as f32),
        }
    }

    /// For studies only: returns a projector for cubes of `edge` voxels per side, each one splat of a kernel `edge` times as wide.
    pub fn of_cubes(&self, edge: u32) -> Projector<'a> {
        let width = edge as f32;
        let sigma = self.sigma * width;
        let mut map = self.map;
        let (ellipse, strength) = match &mut map {
            PixelMap::Parallel { pixel_from_voxel, .. } => {
                let rows = pixel_from_voxel.each_ref().map(single);
                let [one, many] = [self.sigma, sigma].map(|sigma| footprint(rows, sigma, self.cut_off, self.low_pass));
                (many.ellipse, self.strength * (many.density / one.density))
            }
            PixelMap::Perspective { near, .. } => {
                *near *= f64::from(edge);
                (self.ellipse, self.strength)
            }
        };
        let rays = self.rays.as_ref().map(|rays| rays.wider(width));
        Projector { sigma, map, ellipse, strength: strength * width.powi(3), rays, shapes: None, ..*self }
    }

    /// Returns how far the widest kernel reaches forward from its centre in a perspective, in mean spacings.
    #[inline(always)]
    pub(super) fn reach_forward(&self, rays: &EyeRays) -> f32 {
        self.sigma * self.cut_off * rays.steepness
    }

    /// Returns whether the view is a perspective.
    #[inline(always)]
    pub fn is_perspective(&self) -> bool {
        self.rays.is_some()
    }

    /// Returns half the width and height of a footprint's box in a parallel view, in pixels; 0 in perspective.
    pub(super) fn half_widths(&self) -> [f64; 2] {
        [self.ellipse.half_x.into(), self.ellipse.half_y.into()]
    }

    /// Runs all of stage 1 for a block: `place`, `cull` and `colour`.
    #[inline(always)]
    pub fn project_block(&self, voxels: &VoxelBlock, out: &mut Splats, tiles: &TileBuffer) {
        // The copy tells the compiler that positions and results do not overlap.
        let positions = voxels.positions;
        if self.is_on_grid() {
            self.place(&positions, out);
            self.place_near(voxels.count, &positions, out);
        } else {
            let displaced = self.displaced(voxels);
            self.place(&displaced, out);
            self.place_near(voxels.count, &displaced, out);
        }
        self.cull(voxels.count, self.in_clip(voxels), out, tiles);
        let Splats { count, kept, looks, .. } = out;
        self.colour(voxels, &kept[..*count], looks);
        out.apply_strengths();
    }

    /// Returns whether voxels lie on points of the grid, and not at the mean of what is visible of a block.
    #[inline(always)]
    pub(super) fn is_on_grid(&self) -> bool {
        self.lane.channels.coverage_bits == 0
    }

    /// Returns how far the voxel of a record lies from its grid point, in voxels, along the slow, medium and fast axis; and the
    /// shape of its kernel.
    #[inline(always)]
    pub(super) fn offset(&self, record: usize) -> ([f32; 3], usize) {
        let Coverage { offset, .. } = self.lane.coverage(record);
        (self.slow_medium_fast.map(|axis| offset[axis]), shape(offset))
    }

    /// Returns the places of a block's voxels in a lane with coverages.
    #[inline(always)]
    pub(super) fn displaced<'v>(&self, voxels: &'v VoxelBlock) -> Displaced<'v> {
        let (mut offsets, mut shapes) = ([[0.0; BLOCK]; 3], [0; BLOCK]);
        for j in 0..voxels.count.min(BLOCK) {
            let shape;
            ([offsets[0][j], offsets[1][j], offsets[2][j]], shape) = self.offset(voxels.records[j]);
            shapes[j] = shape as u8;
        }
        Displaced { positions: &voxels.positions, offsets, shapes }
    }

    /// Returns, for each voxel of a block, whether neither the crop nor the clip plane leaves it out.
    #[inline(always)]
    pub(super) fn in_clip(&self, voxels: &VoxelBlock) -> [bool; BLOCK] {
        let ClipRegion { crop, plane } = self.clip;
        let (low, high) =
            (self.slow_medium_fast.map(|axis| crop.low[axis]), self.slow_medium_fast.map(|axis| crop.high[axis]));
        let [slow, medium, fast] = &voxels.positions;
        let mut in_clip = [false; BLOCK];
        for j in 0..BLOCK {
            in_clip[j] = (slow[j] >= low[0])
                & (slow[j] <= high[0])
                & (medium[j] >= low[1])
                & (medium[j] <= high[1])
                & (fast[j] >= low[2])
                & (fast[j] <= high[2]);
        }
        if let Some(plane) = plane {
            let plane = IndexPlane { normal: self.slow_medium_fast.map(|axis| plane.normal[axis]), ..plane };
            for j in 0..BLOCK {
                in_clip[j] &= plane.shows([slow[j], medium[j], fast[j]]);
            }
        }
        in_clip
    }

    /// Computes the centre, ellipse, bounding box and strength of each voxel of a block.
    #[inline(always)]
    pub fn place<C: Coordinates>(&self, positions: &C, out: &mut Splats) {
        let (camera_from_voxel, focal, [centre_x, centre_y], near) = match self.map {
            PixelMap::Parallel { pixel_from_voxel, .. } => {
                return self.place_parallel(pixel_from_voxel, positions, out);
            }
            PixelMap::Perspective { camera_from_voxel, focal, centre, near } => {
                (camera_from_voxel, focal, centre, near)
            }
        };
        let Some(rays) = &self.rays else { return };
        let steps = camera_from_voxel.each_ref().map(single);
        let [right, up, forward] = camera_from_voxel.map(|map| self.nested(&map));
        let reach = self.reach_forward(rays);
        let (focal_single, sigma, cut_off, strength) = (focal as f32, self.sigma, self.cut_off, self.strength);
        for from in (0..BLOCK).step_by(VECTOR_WIDTH) {
            let mut part = SplatPlaces::new();
            for j in 0..VECTOR_WIDTH {
                let position = positions.at(from + j);
                let [t0, t1, t2] =
                    [affine_at(&right, position), affine_at(&up, position), affine_at(&forward, position)];
                let in_front = t2 >= near;
                let inverse_depth = 1.0 / if in_front { t2 } else { near };
                let (tan_right, tan_up) = (t0 * inverse_depth, t1 * inverse_depth);
                let (tan_x, tan_y, nearness) = (tan_right as f32, tan_up as f32, inverse_depth as f32);
                let rows = jacobian(&steps, tan_x, tan_y, focal_single * nearness);
                let rows = match positions.shapes() {
                    None => rows,
                    Some(shapes) => widened(rows, self.widths.of(shapes[from + j].into())),
                };
                let square = rays.square(tan_x, tan_y);
                let Footprint { ellipse, density, is_widened } = footprint(rows, sigma, cut_off, self.low_pass)
                    .in_perspective(square, slant(tan_x, tan_y), reach * nearness);
                let strength = keep_if(in_front, strength * density * (nearness * nearness));
                part.on_rays[j] = !is_widened;
                part.set(j, [centre_x + focal * tan_right, centre_y - focal * tan_up], &ellipse, strength);
            }
            part.copy_to(from, &mut out.places);
        }
    }

    /// Does the work of [`Projector::place`] in a parallel view.
    #[inline(always)]
    fn place_parallel<C: Coordinates>(&self, pixel_from_voxel: [Affine; 2], positions: &C, out: &mut Splats) {
        let [column, row] = pixel_from_voxel.map(|map| self.nested(&map));
        let alike = (self.ellipse, self.strength);
        for from in (0..BLOCK).step_by(VECTOR_WIDTH) {
            let mut part = SplatPlaces::new();
            for j in 0..VECTOR_WIDTH {
                let position = positions.at(from + j);
                let (ellipse, strength) = match (positions.shapes(), &self.shapes) {
                    (Some(shapes), Some(of_shapes)) => of_shapes[usize::from(shapes[from + j]) % SHAPES],
                    _ => alike,
                };
                part.set(j, [affine_at(&column, position), affine_at(&row, position)], &ellipse, strength);
            }
            part.copy_to(from, &mut out.places);
        }
    }

    /// Finds the boxes of those of the first `count` voxels that are near the eye.
    #[inline(always)]
    pub fn place_near<C: Coordinates>(&self, count: usize, positions: &C, out: &mut Splats) {
        let Splats { places, near, .. } = out;
        near.clear();
        let (Some(rays), PixelMap::Perspective { camera_from_voxel: [_, _, forward], near: far, .. }) =
            (&self.rays, &self.map)
        else {
            return;
        };
        // `place` has left out what is nearer than `far`.
        let count = count.min(BLOCK);
        if places.strength[..count].iter().fold(true, |all, strength| all & (*strength > 0.0)) {
            return;
        }
        let forward = self.nested(forward);
        for j in 0..count {
            let position = positions.at(j);
            let depth = affine_at(&forward, position);
            // The comparison is false for NaN.
            let is_far = depth >= *far;
            if is_far {
                continue;
            }
            if let Some(kernel) = rays.kernel(self.unnested(position), depth) {
                for (extents, [low, high]) in [(&mut places.x, kernel.columns), (&mut places.y, kernel.rows)] {
                    (extents.nearest[j], extents.low[j], extents.high[j]) = (low, low, high);
                }
                (places.strength[j], places.on_rays[j]) = (1.0, false);
                near.push((j as u8, kernel));
            }
        }
    }

    /// Returns `map` with its factors for the axes in the order slow, medium, fast.
    #[inline(always)]
    pub(super) fn nested(&self, map: &Affine) -> Affine {
        let [s, m, f] = self.slow_medium_fast;
        [map[s], map[m], map[f], map[3]]
    }

    /// Returns the coordinates x, y, z of a voxel from those along the slow, medium and fast axis.
    #[inline(always)]
    pub(super) fn unnested<T: Copy + Default>(&self, nested: [T; 3]) -> [T; 3] {
        let mut voxel = [T::default(); 3];
        for (axis, coordinate) in self.slow_medium_fast.into_iter().zip(nested) {
            voxel[axis] = coordinate;
        }
        voxel
    }

    /// Lists, in `out.kept`, those of the first `count` splats that are `wanted` and can change a pixel of the band.
    #[inline(always)]
    pub fn cull(&self, count: usize, wanted: [bool; BLOCK], out: &mut Splats, tiles: &TileBuffer) {
        let rect = tiles.rect;
        let mut reaching = [false; BLOCK];
        let SplatPlaces { x, y, strength, .. } = &out.places;
        for j in 0..BLOCK {
            let reaches = (x.high[j] >= rect.x0)
                & (x.low[j] < rect.x1)
                & (y.high[j] >= rect.y0)
                & (y.low[j] < rect.y1)
                & (x.low[j] <= x.high[j])
                & (y.low[j] <= y.high[j]);
            reaching[j] = reaches & wanted[j] & (strength[j] > 0.0);
        }
        let mut kept = 0;
        for j in 0..count {
            out.kept[kept] = j as u8;
            kept += usize::from(reaching[j]);
        }
        if self.stop > 0.0 {
            let mut open = 0;
            for k in 0..kept {
                let j = usize::from(out.kept[k]) % BLOCK;
                let ([x0, x1], [y0, y1]) = out.clipped(j, rect);
                out.kept[open] = out.kept[k];
                open += usize::from(!tiles.is_frozen(Rect { x0, y0, x1: x1 + 1, y1: y1 + 1 }));
            }
            kept = open;
        }
        out.count = kept;
    }
}

/// How many voxels are computed at once, in local arrays, which the compiler knows not to overlap with other arrays.
pub(super) const VECTOR_WIDTH: usize = 16;

/// Applies an affine map to a voxel. Its factors and the coordinates are in the order slow, medium, fast.
#[inline(always)]
pub(super) fn affine_at(map: &Affine, [slow, medium, fast]: [f64; 3]) -> f64 {
    (map[3] + map[0] * slow) + map[1] * medium + map[2] * fast
}

/// Returns the optical depth at a splat's centre, for a voxel of this depth and a splat of this strength.
#[inline(always)]
pub(super) fn limited(depth: f32, strength: f32) -> f32 {
    at_most(depth * strength, MAX_DEPTH as f32 * LOG2_E)
}

/// Returns the length of a ray divided by its length along the view axis. In the world, the area of a pixel
/// perpendicular to its ray is `depth^2 / (slant * focal^2)`.
#[inline(always)]
pub(super) fn slant(tan_x: f32, tan_y: f32) -> f32 {
    (1.0 + tan_x * tan_x + tan_y * tan_y).sqrt()
}

/// Returns the pixel nearest to a coordinate, limited to +-1e9 pixels, and the coordinate minus that pixel.
#[inline(always)]
pub(super) fn nearest_pixel(at: f64) -> (i32, f32) {
    // Adding `ROUND` leaves the nearest integer in the low bits of the sum.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    const FAR: f64 = 1e9;
    let at = if at < FAR { at } else { FAR };
    let at = if at > -FAR { at } else { -FAR };
    let rounded = at + ROUND;
    (rounded.to_bits() as u32 as i32, (at - (rounded - ROUND)) as f32)
}

/// Returns the first and last pixel within `half_width` pixels of a centre; may include one slightly farther away.
#[inline(always)]
pub(super) fn pixel_span((nearest, offset): (i32, f32), half_width: f32) -> (i32, i32) {
    const ROUND: f32 = 12_582_912.0;
    const NEARLY_HALF: f32 = 0.499_9;
    let integer = |value: f32| ((value + ROUND).to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32);
    let low = nearest.wrapping_add(integer(offset - half_width + NEARLY_HALF));
    let high = nearest.wrapping_add(integer(offset + half_width - NEARLY_HALF));
    (low, high)
}
