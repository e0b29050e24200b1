//! The lattice: a plane parallel to the slices, on whose pixels a view is drawn before it is warped to the picture.
//!
//! In: a view of voxels that lie on one side of the eye along the slow axis, and the order of its walk. Out: how the
//! voxels of each slice and the pixels of the picture map to the plane. In every slice the pixels are a lattice of
//! points, only shifted and scaled from slice to slice:
//!
//! ```text
//! parallel       point = origin(slice) + pixel * K / 4                K voxels to a tile's width or height, 4 pixels
//! perspective    point = eye + distance(slice) * slope                slope = first + pixel * step
//! ```
//!
//! A ray of slope t = (t_f, t_m), in voxels along the fast and the medium axis per slice, meets a voxel's kernel at the
//! distance d, in voxels of the slice. The kernel's integral along the ray, for a Gaussian of covariance sigma^2 I, is
//!
//! ```text
//! depth(d) = extinction |S (1, t)| / |(1, t)| / (2 pi sigma^2) * exp(-d^T (I + t t^T)^-1 d / (2 sigma^2))
//! ```
//!
//! where S has the voxels' steps as columns. Slopes are those of a tile's centre for all of its pixels.
//!
//! Source: Lacroute and Levoy, "Fast volume rendering using a shear-warp factorization", 1994, for the plane.

mod choose;
mod footprints;
mod low_pass;
mod parallel;
mod perspective;
mod resolution;
mod tile_rays;

use bytemuck::Zeroable;
use glam::{DMat3, DVec3};

pub(super) use self::footprints::Footprints;
pub(super) use self::low_pass::LowPass;
pub(super) use self::tile_rays::{TileRays, near_weight};
use super::front::Front;
use super::project::nearest_pixel;
use super::tile_buffer::TILE_SHIFT;
use super::voxel_block::{BLOCK, Coordinates, Displaced};
use crate::splat::block_kernel::SHAPES;
use crate::splat::kernel::KernelShape;

/// The plane of a view, and how voxels, plane and picture map to each other.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    /// Columns and rows of the plane's pixels: whole tiles.
    pub(super) size: [u32; 2],
    /// Columns and rows of the picture.
    pub(super) picture: [u32; 2],
    /// The homography from the picture's pixels to the plane's: three rows of factors of x, of y, and constants. The
    /// third row is the divisor, positive where a ray meets the plane.
    pub(super) plane_from_pixel: [[f64; 3]; 3],
    pub(super) low_pass: LowPass,
    rays: PlaneRays,
    kernel: KernelShape,
    /// How far voxels may lie from points of the grid, along an axis, in voxels.
    spread: f64,
    /// The squares of kernels' widths along the slow, fast and medium axis, by their shape.
    squares: [[f32; SHAPES]; 3],
}

/// The tiles of a row, or of a column, that a voxel reaches.
#[derive(Debug, Clone, Copy, Default, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Tiles {
    pub(super) first: u16,
    pub(super) count: u16,
}

/// How the plane's pixels are rays through the slices. Pairs are along the fast and the medium axis, in voxels.
#[derive(Debug, Clone)]
enum PlaneRays {
    Parallel {
        /// Number of voxels to a tile's width and height; whole, or one and a half, if voxels lie on points of the grid.
        voxels: [f64; 2],
        /// How far a ray moves per slice.
        slope: [f64; 2],
        /// The point of pixel 0 in slice 0.
        origin: [f64; 2],
        strength: f32,
    },
    Perspective {
        /// The eye, along the slow, fast and medium axis.
        eye: [f64; 3],
        /// Slope of pixel 0: voxels per slice of distance from the eye.
        first: [f64; 2],
        /// How much the slope grows per pixel.
        step: [f64; 2],
        /// The voxels' steps along the slow (away from the eye), fast and medium axis, in mean spacings.
        steps: [DVec3; 3],
        /// The optical depth of a voxel of depth 1 on a ray whose voxels are as long as the mean spacing.
        strength: f64,
    },
}

/// One or two tiles that are a whole number of voxels wide.
#[derive(Debug, Clone, Copy)]
pub(super) struct Period {
    /// Base-2 logarithm of the number of tiles.
    pub(super) shift: i32,
    /// Number of voxels.
    pub(super) voxels: i32,
}

/// The lattice of a slice. Pairs are along the fast and the medium axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slice {
    /// Its place on the slow axis.
    slow: f64,
    /// The point of pixel 0, in voxels.
    pub(super) origin: [f64; 2],
    /// The distance between pixels, in voxels.
    pub(super) step: [f64; 2],
    /// By how much `origin` and `step` grow per slice.
    pub(super) shift: [f64; 2],
    growth: [f64; 2],
}

impl Slice {
    /// Returns the scale of the places of voxels on points of the grid.
    #[inline(always)]
    pub(super) fn scale(&self) -> f32 {
        (self.step[0] * self.step[0]) as f32
    }
}

/// A voxel on the plane: the nearest pixel and the distance from it, along columns and rows.
#[derive(Debug, Clone, Copy, Zeroable)]
#[repr(C)]
pub(super) struct Place {
    pub(super) pixel: [i32; 2],
    pub(super) offset: [f32; 2],
    /// Square of the distance between columns of pixels, in square voxels.
    pub(super) scale: f32,
}

impl Lattice {
    /// Returns the columns and rows of what is kept of the plane for the warp. If it is to be halved, that is done when a band has
    /// been drawn.
    pub(super) fn kept(&self) -> [u32; 2] {
        [0, 1].map(|side| self.size[side] >> u32::from(self.halves()[side]))
    }

    /// Returns the most pixels that the warp has in a second frame, halved again, beside what is kept.
    pub(super) fn copied(&self) -> u64 {
        let is_again = self.low_pass.halvings.map(|halvings| halvings > 1);
        let halved = [0, 1].map(|side: usize| u64::from(self.kept()[side].div_ceil(1 + u32::from(is_again[side]))));
        if is_again == [false; 2] { 0 } else { halved[0] * halved[1] }
    }

    /// Returns whether it is halved along columns, and along rows.
    pub(super) fn halves(&self) -> [bool; 2] {
        self.low_pass.halvings.map(|halvings| halvings > 0)
    }

    /// Returns the lattice of the slice at `slow` on the slow axis.
    #[inline(always)]
    pub(super) fn slice(&self, slow: u16) -> Slice {
        let slow = f64::from(slow);
        match &self.rays {
            PlaneRays::Parallel { voxels, slope, origin, .. } => {
                let origin = [0, 1].map(|side| origin[side] + slope[side] * slow);
                Slice { slow, origin, step: voxels.map(|voxels| voxels / 4.0), shift: *slope, growth: [0.0; 2] }
            }
            PlaneRays::Perspective { eye, first, step, .. } => {
                let distance = (slow - eye[0]).abs();
                let away = (slow - eye[0]).signum();
                let origin = [0, 1].map(|side| eye[1 + side] + distance * first[side]);
                let shift = first.map(|slope| away * slope);
                Slice {
                    slow,
                    origin,
                    step: step.map(|step| distance * step),
                    shift,
                    growth: step.map(|step| away * step),
                }
            }
        }
    }

    /// Returns where the voxel with these coordinates on the fast and the medium axis of `slice` lies on the plane.
    #[inline(always)]
    pub(super) fn place(&self, slice: &Slice, voxel: [i32; 2]) -> Place {
        let [(column, right), (row, down)] = [0, 1].map(|side: usize| self.place_along(slice, side, voxel[side]));
        Place { pixel: [column, row], offset: [right, down], scale: slice.scale() }
    }

    /// Returns the column (`side` 0) or row (1) of pixels nearest to a voxel of `slice`, and the distance from it.
    #[inline(always)]
    pub(super) fn place_along(&self, slice: &Slice, side: usize, voxel: i32) -> (i32, f32) {
        let pixel = |voxel: i32| nearest_pixel((f64::from(voxel) - slice.origin[side]) * (1.0 / slice.step[side]));
        let Some(periods) = self.periods() else { return pixel(voxel) };
        // Voxels that are a period apart have the same offset, bit for bit.
        let Period { shift, voxels } = periods[side];
        let (count, rest) = (voxel.div_euclid(voxels), voxel.rem_euclid(voxels));
        let (pixel, offset) = pixel(rest);
        (pixel.wrapping_add(count << (TILE_SHIFT + shift)), offset)
    }

    /// Returns the place on the plane of a voxel of `slice` that may be displaced, from its coordinates on the slow, medium and fast
    /// axis.
    #[inline(always)]
    pub(super) fn place_displaced(slice: &Slice, [slow, medium, fast]: [f64; 3]) -> Place {
        let along = slow - slice.slow;
        let step = [0, 1].map(|side: usize| slice.step[side] + slice.growth[side] * along);
        let at = |side: usize, voxel: f64| {
            nearest_pixel((voxel - (slice.origin[side] + slice.shift[side] * along)) * (1.0 / step[side]))
        };
        let ((column, right), (row, down)) = (at(0, fast), at(1, medium));
        Place { pixel: [column, row], offset: [right, down], scale: (step[0] * step[0]) as f32 }
    }

    /// Computes the places of voxels of a slice in a perspective, from their coordinates on the fast and the medium axis.
    #[inline(always)]
    pub(super) fn set_places(&self, slice: &Slice, voxels: [&[u16; BLOCK]; 2], places: &mut [Place]) {
        let (mut pixel, mut offset) = ([[0; BLOCK]; 2], [[0.0; BLOCK]; 2]);
        for side in 0..2 {
            let (origin, per_pixel) = (slice.origin[side], 1.0 / slice.step[side]);
            for j in 0..BLOCK {
                (pixel[side][j], offset[side][j]) = nearest_pixel((f64::from(voxels[side][j]) - origin) * per_pixel);
            }
        }
        let scale = slice.scale();
        for (j, place) in places.iter_mut().enumerate().take(BLOCK) {
            *place = Place { pixel: [pixel[0][j], pixel[1][j]], offset: [offset[0][j], offset[1][j]], scale };
        }
    }

    /// Computes the places of voxels of a slice that may be displaced, the shapes of their kernels, and which columns and rows of
    /// tiles they reach.
    #[inline(always)]
    pub(super) fn set_places_displaced(
        &self,
        slice: &Slice,
        positions: &Displaced,
        (places, shapes): (&mut [Place], &mut [i32]),
        tiles: [&mut [Tiles]; 2],
    ) {
        let (mut pixel, mut offset) = ([[0; BLOCK]; 2], [[0.0; BLOCK]; 2]);
        let (mut scale, mut radius) = ([0.0; BLOCK], [0.0; BLOCK]);
        let mut at = [[0.0; BLOCK]; 3];
        for j in 0..BLOCK {
            [at[0][j], at[1][j], at[2][j]] = positions.at(j);
        }
        for j in 0..BLOCK {
            let place = Lattice::place_displaced(slice, [at[0][j], at[1][j], at[2][j]]);
            ([pixel[0][j], pixel[1][j]], [offset[0][j], offset[1][j]]) = (place.pixel, place.offset);
            (scale[j], radius[j]) = (place.scale, self.kernel.radius / place.scale.sqrt());
        }
        // A radius is in columns of pixels.
        let per_column = [1.0, (slice.step[0] / slice.step[1]) as f32];
        for (side, tiles) in tiles.into_iter().enumerate() {
            let (first, step) = match &self.rays {
                PlaneRays::Parallel { slope, .. } => (slope[side] as f32, 0.0),
                PlaneRays::Perspective { first, step, .. } => (first[side] as f32, step[side] as f32),
            };
            // The slopes of the tiles that a kernel reaches are at most this much steeper.
            let more = step * self.farthest(slice, side) as f32;
            let last = (self.size[side] >> TILE_SHIFT) as i32 - 1;
            let (mut from, mut count) = ([0; BLOCK], [0; BLOCK]);
            for j in 0..BLOCK {
                let (pixel, offset) = (pixel[side][j], offset[side][j]);
                let slope = (first + step * pixel as f32).abs() + more;
                let shape = usize::from(positions.shapes[j]) % SHAPES;
                let square = self.squares[1 + side][shape] + self.squares[0][shape] * (slope * slope);
                let reach = radius[j] * per_column[side] * square.sqrt() + 0.01;
                let low = ((pixel + (offset - reach).ceil() as i32) >> TILE_SHIFT).max(0);
                let high = ((pixel + (offset + reach).floor() as i32) >> TILE_SHIFT).min(last);
                (from[j], count[j]) = (low as u16, (high + 1 - low).max(0) as u16);
            }
            for (j, tiles) in tiles.iter_mut().enumerate().take(BLOCK) {
                *tiles = Tiles { first: from[j], count: count[j] };
            }
        }
        for (j, place) in places.iter_mut().enumerate().take(BLOCK) {
            *place = Place { pixel: [pixel[0][j], pixel[1][j]], offset: [offset[0][j], offset[1][j]], scale: scale[j] };
        }
        for (to, shape) in shapes.iter_mut().zip(&positions.shapes) {
            *to = (*shape).into();
        }
    }

    /// Returns the peak of a splat of optical depth 1 in a parallel view; `None` in perspective, where it varies.
    #[inline(always)]
    pub(super) fn strength(&self) -> Option<f32> {
        match self.rays {
            PlaneRays::Parallel { strength, .. } => Some(strength),
            PlaneRays::Perspective { .. } => None,
        }
    }

    /// Returns the largest peak that a splat of optical depth 1 of any shape has in a parallel view; `None` in perspective.
    pub(super) fn strongest(&self) -> Option<f32> {
        self.strength()?;
        Some(self.kernels([0; 2]).iter().fold(0.0, |most: f32, kernel| most.max(kernel.strength)))
    }

    /// Returns after how many tiles a slice's voxels lie alike beside them, along the fast and the medium axis, in a parallel view of
    /// voxels on points of the grid; `None` in other views.
    #[inline(always)]
    pub(super) fn periods(&self) -> Option<[Period; 2]> {
        match self.rays {
            PlaneRays::Parallel { voxels, .. } if self.spread == 0.0 => Some(voxels.map(|voxels| {
                let shift = i32::from(voxels.fract() > 0.0);
                Period { shift, voxels: (voxels * f64::from(1 << shift)) as i32 }
            })),
            _ => None,
        }
    }

    /// Returns how far a kernel of a shape reaches along the fast (`side` 0) or medium axis (1) from its centre, in voxels, in a
    /// parallel view.
    pub(super) fn shape_reach(&self, side: usize, shape: usize) -> f64 {
        let steepest = self.steepest(side, [0.0; 2]);
        let [across, along] = [1 + side, 0].map(|axis| f64::from(self.squares[axis][shape]));
        f64::from(self.kernel.radius) * (across + along * (steepest * steepest)).sqrt()
    }

    /// Returns how far a kernel reaches along the fast (`side` 0) or medium axis (1) from its centre, in voxels, on rays
    /// that meet the plane between two pixels.
    #[inline(always)]
    pub(super) fn kernel_reach(&self, side: usize, ends: [f64; 2]) -> f64 {
        let steepest = self.steepest(side, ends);
        f64::from(self.kernel.radius) * (1.0 + steepest * steepest).sqrt()
    }

    /// Returns the same from the voxel's point of the grid, beside which it may lie.
    #[inline(always)]
    pub(super) fn reach(&self, side: usize, ends: [f64; 2]) -> f64 {
        self.kernel_reach(side, ends) + self.spread * (1.0 + self.steepest(side, ends))
    }

    #[inline(always)]
    fn steepest(&self, side: usize, [low, high]: [f64; 2]) -> f64 {
        match &self.rays {
            PlaneRays::Parallel { slope, .. } => slope[side].abs(),
            PlaneRays::Perspective { first, step, .. } => {
                (first[side] + step[side] * low).abs().max((first[side] + step[side] * high).abs())
            }
        }
    }

    /// Returns how many pixels away from its voxel's point of the grid a kernel of `slice` reaches at most.
    #[inline(always)]
    pub(super) fn farthest(&self, slice: &Slice, side: usize) -> f64 {
        self.reach(side, [0.0, f64::from(self.size[side])]) / slice.step[side] + 6.0
    }

    /// Returns, for each tile, row by row, whether the picture may show it, with `front` before it.
    pub(super) fn shown(&self, front: Option<&Front>) -> Vec<bool> {
        /// How far beyond the picture's edge tiles are drawn, in tiles: those farther away weigh below 0.268^8 in the
        /// interpolation.
        const BEYOND: usize = 2;
        let around = self.low_pass.halvings.map(|halvings| BEYOND << halvings);
        let [columns, rows] = self.size.map(|side| side as usize >> TILE_SHIFT);
        let to_picture = DMat3::from_cols_array_2d(&self.plane_from_pixel).transpose().inverse();
        let (first, ends) =
            (-0.5 - self.low_pass.deviation, self.picture.map(|side| f64::from(side) - 0.5 + self.low_pass.deviation));
        // For each corner of a tile, with those around the plane: a bit for each edge of the picture that it is beyond.
        let corners = columns + 2 * around[0] + 1;
        let corner = |side: usize, tile: usize| 4.0 * (tile as f64 - around[side] as f64) - 0.5;
        let beyond = |row: usize| {
            let start = to_picture * DVec3::new(0.0, corner(1, row), 1.0);
            (0..corners).map(move |column| {
                let [x, y, w] = (start + to_picture.x_axis * corner(0, column)).to_array();
                // Where the divisor is not positive, the corner is behind the eye: the tile is large, and shown.
                let is_beyond = [x < first * w, x > ends[0] * w, y < first * w, y > ends[1] * w];
                if w > 0.0 { (0..4).map(|edge| u8::from(is_beyond[edge]) << edge).sum() } else { 0u8 }
            })
        };
        let beyond: Vec<u8> = (0..rows + 2 * around[1] + 1).flat_map(beyond).collect();
        let is_shown = |row: usize, column: usize| {
            let (across, down) = (2 * around[0] + 1, (2 * around[1] + 1) * corners);
            let first = row * corners + column;
            [first, first + across, first + down, first + down + across].iter().fold(0xff, |all, at| all & beyond[*at])
                == 0
        };
        // Whether all pixels of the picture to which the tile contributes are opaque.
        let is_hidden = |row: usize, column: usize| {
            let Some(front) = front else { return false };
            let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
            let [right, below] = around.map(|around| 2 * around + 1);
            for [c, r] in [[0, 0], [right, 0], [0, below], [right, below]] {
                let [x, y, w] = (to_picture * DVec3::new(corner(0, column + c), corner(1, row + r), 1.0)).to_array();
                if w <= 0.0 {
                    return false;
                }
                for (side, at) in [x / w, y / w].into_iter().enumerate() {
                    (low[side], high[side]) = (low[side].min(at), high[side].max(at));
                }
            }
            let beyond = 2.0 + 3.0 * self.low_pass.deviation;
            let side = |side: usize| [low[side] - beyond, high[side] + beyond];
            front.hides(side(0), side(1))
        };
        let tiles = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        tiles.map(|(row, column)| is_shown(row, column) && !is_hidden(row, column)).collect()
    }
}
