//! The maximum modes: the largest interpolated value along the ray of each pixel.
//!
//! In: a drawing task. Out: for each pixel its largest sample. Values are interpolated linearly;
//! where no voxel is visible they are 0. A ray is sampled at each slice that it meets, and half-way between slices:
//!
//! ```text
//! sample s         sum of value * tent(df) tent(dm)                 over the voxels of slice s
//! sample s + 1/2   half of that sum for slices s and s + 1, each at the ray's point at s + 1/2
//! tent(d)          max(0, 1 - |d|); df, dm: from the voxel to the ray's point, along the fast and the medium axis
//! ```
//!
//! Voxels come slice by slice, in ascending order. So a pixel needs its largest finished sample and three sums only: of
//! the samples half a slice before, at and after the slice of the last voxel. When a voxel of another slice comes, finished
//! sums are compared with the largest sample. Adding 0 changes nothing, so a pixel's bits depend on no other pixel.

use super::band;
use crate::error::Result;
use crate::splat::arith::{at_least, keep_if};
use crate::splat::cpu::dispatch;
use crate::splat::cpu::project::{Projector, affine_at, nearest_pixel};
use crate::splat::cpu::task::{BandResult, DrawTask};
use crate::splat::cpu::tile_buffer::{COLUMN, PixelTile, ROW, Rect, TILE_PIXELS, TILE_SHIFT, TileBuffer};
use crate::splat::cpu::voxel_block::{BLOCK, VoxelBlock};
use crate::splat::setup::FrameSetup;
use crate::splat::view::{Affine, PixelMap, apply};
use crate::traverse::Viewpoint;

/// Draws the band `rect`.
pub(super) fn draw(task: &DrawTask, rect: Rect) -> Result<BandResult> {
    let tiles = TileBuffer::new(rect, 0.0)?;
    let (rays, mut slices) = (MaximumRays::new(task.setup), vec![0; tiles.len()]);
    let DrawTask { projector, settings, .. } = task;
    Ok(band::paint(task, tiles, |voxels, tiles| {
        dispatch::draw_maxima(settings.code, projector, &rays, voxels, tiles, &mut slices)
    }))
}

/// Adds the voxels of a block to the sums of a band's pixels; returns how many touched the band.
///
/// `tiles`: for each pixel, its largest finished sample, then the sums half a slice before, at and after the tile's slice; `slices`:
/// for each tile, the slice of the last voxel that was drawn on it.
#[inline(always)]
pub(in super::super) fn add<const IS_PERSPECTIVE: bool>(
    projector: &Projector,
    rays: &MaximumRays,
    voxels: &VoxelBlock,
    tiles: &mut TileBuffer,
    slices: &mut [u16],
) -> u64 {
    let Rect { x0, y0, x1, y1 } = tiles.rect;
    let in_clip = projector.in_clip(voxels);
    let position = |j: usize| voxels.positions.each_ref().map(|coordinates| f64::from(coordinates[j]));
    let mut boxes = [[0; BLOCK]; 4];
    for j in 0..BLOCK {
        let [left, right, top, bottom] = rays.pixels(position(j));
        (boxes[0][j], boxes[1][j], boxes[2][j], boxes[3][j]) =
            (left.max(x0), right.min(x1 - 1), top.max(y0), bottom.min(y1 - 1));
    }
    let mut drawn = 0;
    for j in 0..voxels.count.min(BLOCK) {
        let [left, right, top, bottom] = boxes.each_ref().map(|sides| sides[j]);
        if left > right || top > bottom || !in_clip[j] {
            continue;
        }
        let [_, _, _, value] = projector.whole_look(voxels.records[j]);
        if value <= 0.0 {
            continue;
        }
        drawn += 1;
        let (slice, position) = (voxels.positions[0][j], position(j));
        for row in top >> TILE_SHIFT..=bottom >> TILE_SHIFT {
            for column in left >> TILE_SHIFT..=right >> TILE_SHIFT {
                let Some((index, PixelTile(values))) = tiles.tile(column, row) else { continue };
                let last = &mut slices[index];
                if *last != slice {
                    advance(values, slice.wrapping_sub(*last));
                    *last = slice;
                }
                let near = rays.near(position, [column << TILE_SHIFT, row << TILE_SHIFT]);
                let weights = near.weights::<IS_PERSPECTIVE, TILE_PIXELS>(&COLUMN, &ROW);
                for (sums, weights) in values[1..].iter_mut().zip(&weights) {
                    let mut new = [0.0; TILE_PIXELS];
                    for i in 0..TILE_PIXELS {
                        new[i] = sums[i] + value * weights[i];
                    }
                    *sums = new;
                }
            }
        }
    }
    drawn
}

/// Compares the sums that voxels `slices` slices ahead cannot add to with the largest sample. `values`: of `N` pixels, in
/// the order of [`add`].
#[inline(always)]
pub(in super::super) fn advance<const N: usize>(values: &mut [[f32; N]; 4], slices: u16) {
    let [largest, before, at, after] = *values;
    let is_next = slices == 1;
    for i in 0..N {
        let finished = at_least(at_least(largest[i], before[i]), at[i]);
        values[0][i] = if is_next { finished } else { at_least(finished, after[i]) };
        values[1][i] = keep_if(is_next, after[i]);
    }
    (values[2], values[3]) = ([0.0; N], [0.0; N]);
}

/// The rays of a picture's pixels in voxel coordinates, whose axes are in the order slow, medium, fast.
pub(crate) enum MaximumRays {
    /// All rays have one direction.
    Parallel {
        /// The coordinates, medium and fast, of a pixel's ray at slice 0, as maps of the pixel's column and row.
        start: [PixelAffine; 2],
        /// By how much these coordinates grow from a slice to the next.
        slope: [f64; 2],
        /// The maps from voxel coordinates to column and row.
        pixel_from_voxel: [Affine; 2],
        /// How far the samples to which a voxel adds lie from it, at most, in columns and rows.
        reach: [f64; 2],
    },
    /// All rays begin at the eye.
    Perspective {
        eye: [f64; 3],
        /// The direction of a pixel's ray, whose length along the view axis is a mean spacing.
        direction: [PixelAffine; 3],
        camera_from_voxel: [Affine; 3],
        /// How far the samples to which a voxel adds lie from it, at most: right, up and forward, in mean spacings.
        reach: [f64; 3],
        focal: f64,
        centre: [f64; 2],
        /// Distance along the view axis at which rays begin.
        near: f64,
    },
}

/// An affine map from a column and a row to a number: two factors and a constant.
pub(crate) type PixelAffine = [f64; 3];

/// How far the samples to which a voxel adds lie from it along the slow, medium and fast axis, in voxels; slightly more,
/// so that rounding leaves no sample out.
const REACH: [f64; 3] = [0.500_01, 1.000_01, 1.000_01];

impl MaximumRays {
    /// Returns the rays of a frame.
    pub(crate) fn new(setup: &FrameSetup) -> MaximumRays {
        let nesting = [setup.order.slow, setup.order.medium, setup.order.fast].map(|axis| axis.index());
        let nested = |map: &Affine| [map[nesting[0]], map[nesting[1]], map[nesting[2]], map[3]];
        let reach_of = |map: &Affine| (0..3).map(|a| map[a].abs() * REACH[a]).sum();
        match (&setup.view.map, setup.view.viewpoint) {
            (PixelMap::Perspective { camera_from_voxel, focal, centre, .. }, viewpoint) => {
                let eye = match viewpoint {
                    Viewpoint::Perspective { eye, .. } => nesting.map(|axis| eye[axis]),
                    Viewpoint::Parallel { .. } => [0.0; 3],
                };
                let camera_from_voxel = camera_from_voxel.each_ref().map(nested);
                let [right, up, forward] = inverse_columns(&camera_from_voxel);
                // Right and up grow by 1 / focal with the column and against the row.
                let direction = [0, 1, 2].map(|a| {
                    let (by_column, by_row) = (right[a] / focal, -up[a] / focal);
                    [by_column, by_row, forward[a] - by_column * centre[0] - by_row * centre[1]]
                });
                let reach = camera_from_voxel.each_ref().map(reach_of);
                let (focal, centre, near) = (*focal, *centre, setup.view.ray_start());
                MaximumRays::Perspective { eye, direction, camera_from_voxel, reach, focal, centre, near }
            }
            (PixelMap::Parallel { pixel_from_voxel, .. }, _) => {
                let pixel_from_voxel = pixel_from_voxel.each_ref().map(nested);
                let [[xs, xm, xf, x0], [ys, ym, yf, y0]] = pixel_from_voxel;
                let determinant = xm * yf - xf * ym;
                // The medium and the fast coordinate of a point of slice 0 that is seen at a column and a row.
                let solve = |x: f64, y: f64| [(yf * x - xf * y) / determinant, (xm * y - ym * x) / determinant];
                let (by_column, by_row, at) = (solve(1.0, 0.0), solve(0.0, 1.0), solve(-x0, -y0));
                let start = [0, 1].map(|a| [by_column[a], by_row[a], at[a]]);
                let reach = pixel_from_voxel.each_ref().map(reach_of);
                MaximumRays::Parallel { start, slope: solve(-xs, -ys), pixel_from_voxel, reach }
            }
        }
    }

    /// Returns the first and last column, and the first and last row, of the pixels whose samples a voxel may add to.
    #[inline(always)]
    pub(in super::super) fn pixels(&self, position: [f64; 3]) -> [i32; 4] {
        // A hundredth of a pixel more on either side.
        let span = |low: f64, high: f64| [nearest_pixel(low + 0.49).0, nearest_pixel(high - 0.49).0];
        let [[left, right], [top, bottom]] = match self {
            MaximumRays::Parallel { pixel_from_voxel, reach, .. } => [0, 1].map(|side| {
                let at = affine_at(&pixel_from_voxel[side], position);
                span(at - reach[side], at + reach[side])
            }),
            MaximumRays::Perspective { camera_from_voxel, reach, focal, centre, near, .. } => {
                let [t0, t1, t2] = camera_from_voxel.each_ref().map(|map| affine_at(map, position));
                let nearest = if t2 - reach[2] > *near { t2 - reach[2] } else { *near };
                let farthest = if t2 + reach[2] > nearest { t2 + reach[2] } else { nearest };
                let (nearest, farthest) = (1.0 / nearest, 1.0 / farthest);
                let tangents = |at: f64, reach: f64| {
                    let (low, high) = (at - reach, at + reach);
                    [
                        low * if low < 0.0 { nearest } else { farthest },
                        high * if high > 0.0 { nearest } else { farthest },
                    ]
                };
                let ([left, right], [bottom, top]) = (tangents(t0, reach[0]), tangents(t1, reach[1]));
                let in_front = t2 + reach[2] >= *near;
                let columns = span(centre[0] + focal * left, centre[0] + focal * right);
                let [first, last] = span(centre[1] - focal * top, centre[1] - focal * bottom);
                [columns, if in_front { [first, last] } else { [1, 0] }]
            }
        };
        [left, right, top, bottom]
    }

    /// Returns the rays of a tile whose first pixel is `first`, as seen from a voxel.
    #[inline(always)]
    pub(in super::super) fn near(&self, [slow, medium, fast]: [f64; 3], first: [i32; 2]) -> NearRays {
        let [column, row] = first.map(f64::from);
        let at_first = |map: &PixelAffine| apply(&[map[0], map[1], 0.0, map[2]], [column, row, 0.0]);
        match self {
            MaximumRays::Parallel { start, slope, .. } => {
                let apart = |a: usize, voxel: f64| {
                    single([start[a][0], start[a][1], at_first(&start[a]) + slope[a] * slow - voxel])
                };
                NearRays {
                    apart: [apart(0, medium), apart(1, fast)],
                    half_step: slope.map(|slope| single([0.0, 0.0, slope / 2.0])),
                    ..NearRays::default()
                }
            }
            MaximumRays::Perspective { eye, direction, near, .. } => {
                let [along, medium_part, fast_part] = direction.each_ref().map(|map| [map[0], map[1], at_first(map)]);
                let depth = slow - eye[0];
                let apart =
                    |part: PixelAffine, distance: f64| single([0, 1, 2].map(|c| part[c] * depth - along[c] * distance));
                NearRays {
                    apart: [apart(medium_part, medium - eye[1]), apart(fast_part, fast - eye[2])],
                    half_step: [medium_part, fast_part].map(|part| single(part.map(|c| c / 2.0))),
                    along: single(along),
                    slices: depth as f32,
                    near: *near as f32,
                }
            }
        }
    }
}

/// Returns the columns of the inverse of a 3 x 3 matrix, whose rows are the factors of `maps`.
fn inverse_columns(maps: &[Affine; 3]) -> [[f64; 3]; 3] {
    let rows = maps.each_ref().map(|map| glam::DVec3::new(map[0], map[1], map[2]));
    let matrix = glam::DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
    matrix.inverse().to_cols_array_2d()
}

/// The rays of a tile as seen from a voxel. Numbers are affine in a pixel's column and row in the tile.
///
/// At a sample k half slices after the voxel, the ray's point is `(apart + k half_step) / along` from the voxel.
#[derive(Debug, Clone, Copy, Default)]
pub(in super::super) struct NearRays {
    /// Along the medium and the fast axis, in voxels; times `along`.
    apart: [[f32; 3]; 2],
    half_step: [[f32; 3]; 2],
    /// The part of the ray's direction along the slow axis; not used in a parallel view.
    along: [f32; 3],
    /// The slice of the voxel minus the eye's coordinate.
    slices: f32,
    /// Distance along the view axis at which rays begin.
    near: f32,
}

impl NearRays {
    /// Returns the weights of the voxel in the samples half a slice before it, at it and half a slice after it, at `N`
    /// pixels with these columns and rows in the tile.
    #[inline(always)]
    pub(in super::super) fn weights<const IS_PERSPECTIVE: bool, const N: usize>(
        &self,
        columns: &[f32; N],
        rows: &[f32; N],
    ) -> [[f32; N]; 3] {
        let mut weights = [[0.0; N]; 3];
        for i in 0..N {
            let at = |[by_column, by_row, first]: [f32; 3]| first + (by_column * columns[i] + by_row * rows[i]);
            let per_slice = if IS_PERSPECTIVE { 1.0 / at(self.along) } else { 1.0 };
            let [medium, fast] = self.apart.map(|apart| at(apart) * per_slice);
            let [medium_step, fast_step] =
                self.half_step.map(|step| if IS_PERSPECTIVE { at(step) * per_slice } else { step[2] });
            let weight = |half_slices: f32, share: f32| {
                let weight = share * tent(medium + half_slices * medium_step) * tent(fast + half_slices * fast_step);
                let depth = (self.slices + 0.5 * half_slices) * per_slice;
                if IS_PERSPECTIVE { keep_if(depth >= self.near, weight) } else { weight }
            };
            (weights[0][i], weights[1][i], weights[2][i]) = (weight(-1.0, 0.5), weight(0.0, 1.0), weight(1.0, 0.5));
        }
        weights
    }
}

/// Returns the weight of linear interpolation at a distance in voxels; 0 for NaN.
#[inline(always)]
fn tent(distance: f32) -> f32 {
    at_least(1.0 - distance.abs(), 0.0)
}

/// Returns the factors and the constant in single precision.
#[inline(always)]
fn single(map: PixelAffine) -> [f32; 3] {
    map.map(|c| c as f32)
}
