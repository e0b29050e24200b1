//! The rays of a tile: what the kernels of voxels weigh at its pixels.
//!
//! In: a lattice, a tile, a kernel's shape. Out: weights at the tile's sixteen pixels. The formula is in mod.rs.

use glam::DVec3;

use super::{Lattice, Place, PlaneRays};
use crate::splat::arith::{LOG2_E, keep_if, near_exp2_neg};
use crate::splat::block_kernel::SHAPES;
use crate::splat::cpu::tile_buffer::{COLUMN, ROW, TILE_PIXELS, TILE_SHIFT};

/// What a kernel is on the rays of a tile.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct RayKernel {
    /// Factors of a pixel's distance from a voxel, in pixels along columns and rows: the exponent, in units of ln 2, is
    /// the sum of the squares of (column * x + shear * y) and (row * y), times the scale of the place. That scale is of columns, so
    /// `shear` and `row` contain how many times as far apart rows are.
    column: f32,
    shear: f32,
    row: f32,
    /// The optical depth of a voxel of depth 1 at its centre.
    pub(in super::super) strength: f32,
}

/// The rays of a tile through kernels of one shape.
#[derive(Debug, Clone, Copy)]
pub(in super::super) struct TileRays {
    /// The tile's first pixel.
    first: [i32; 2],
    kernel: RayKernel,
    /// For each pixel of the tile: the first and the second sum, counted from the first pixel.
    u: [f32; TILE_PIXELS],
    v: [f32; TILE_PIXELS],
}

impl TileRays {
    /// Returns the rays of a tile, given as a column and a row, through kernels of one shape.
    #[inline(always)]
    pub(in super::super) fn new([column, row]: [i32; 2], kernel: RayKernel) -> TileRays {
        let (mut u, mut v) = ([0.0; TILE_PIXELS], [0.0; TILE_PIXELS]);
        for i in 0..TILE_PIXELS {
            u[i] = kernel.column * COLUMN[i] + kernel.shear * ROW[i];
            v[i] = kernel.row * ROW[i];
        }
        TileRays { first: [column << TILE_SHIFT, row << TILE_SHIFT], kernel, u, v }
    }

    /// Returns the optical depth of a voxel of depth 1 at its centre.
    #[inline(always)]
    pub(in super::super) fn strength(&self) -> f32 {
        self.kernel.strength
    }

    /// Returns the weight of a voxel's kernel at the pixels of the tile, 0 to 1; 0 where the exponent is above `cut`.
    #[inline(always)]
    pub(in super::super) fn weights(&self, place: &Place, cut: f32) -> [f32; TILE_PIXELS] {
        let mut values = self.exponents(place);
        for value in &mut values {
            *value = near_weight(*value, cut);
        }
        values
    }

    /// Returns the exponents of a voxel's kernel at the pixels of the tile, in units of ln 2.
    #[inline(always)]
    pub(in super::super) fn exponents(&self, place: &Place) -> [f32; TILE_PIXELS] {
        let TileRays { first, kernel: RayKernel { column, shear, row, .. }, u, v } = self;
        let x = (first[0] - place.pixel[0]) as f32 - place.offset[0];
        let y = (first[1] - place.pixel[1]) as f32 - place.offset[1];
        let (across, down) = (column * x + shear * y, row * y);
        let mut exponents = [0.0; TILE_PIXELS];
        for i in 0..TILE_PIXELS {
            let (across, down) = (across + u[i], down + v[i]);
            exponents[i] = (across * across + down * down) * place.scale;
        }
        exponents
    }
}

/// Returns the weight of a kernel from its exponent; 0 where that is above `cut`.
#[inline(always)]
pub(in super::super) fn near_weight(exponent: f32, cut: f32) -> f32 {
    // Beyond the cut-off the exponential may be meaningless, and `keep_if` replaces it by 0.
    keep_if(exponent <= cut, near_exp2_neg(exponent))
}

/// Returns how long a ray of these slopes is from slice to slice in the world, over its length in voxels: |S (1, t)| / |(1, t)|.
#[inline(always)]
pub(super) fn stretch(steps: &[DVec3; 3], [fast, medium]: [f64; 2]) -> f64 {
    (steps[0] + steps[1] * fast + steps[2] * medium).length() / (1.0 + fast * fast + medium * medium).sqrt()
}

impl Lattice {
    /// Returns the rays of a tile, given as a column and a row, through kernels that are as wide along all axes.
    #[inline(always)]
    pub(in super::super) fn tile(&self, tile: [i32; 2]) -> TileRays {
        let (slopes, strength) = self.slopes(tile);
        TileRays::new(tile, self.kernel_on(slopes, strength, [1.0; 3]))
    }

    /// Returns the kernels of each shape on the rays of a tile.
    #[inline(always)]
    pub(in super::super) fn kernels(&self, tile: [i32; 2]) -> [RayKernel; SHAPES] {
        let (slopes, strength) = self.slopes(tile);
        let mut kernels = [RayKernel { column: 0.0, shear: 0.0, row: 0.0, strength: 0.0 }; SHAPES];
        for (shape, kernel) in kernels.iter_mut().enumerate() {
            *kernel = self.kernel_on(slopes, strength, self.squares.map(|squares| squares[shape]));
        }
        kernels
    }

    /// Returns the kernel of one shape on the rays of a tile.
    #[inline(always)]
    pub(in super::super) fn kernel(&self, tile: [i32; 2], shape: usize) -> RayKernel {
        let (slopes, strength) = self.slopes(tile);
        self.kernel_on(slopes, strength, self.squares.map(|squares| squares[shape]))
    }

    /// Returns the slopes of a tile's rays along the fast and the medium axis, and the optical depth of a voxel of depth 1 at its
    /// centre, if its kernel is as wide along all axes.
    #[inline(always)]
    fn slopes(&self, [column, row]: [i32; 2]) -> ([f32; 2], f32) {
        let first = [column << TILE_SHIFT, row << TILE_SHIFT];
        let [fast, medium] = match &self.rays {
            PlaneRays::Parallel { slope, .. } => *slope,
            PlaneRays::Perspective { first: slope, step, .. } => {
                [0, 1].map(|side| slope[side] + step[side] * (f64::from(first[side]) + 1.5))
            }
        };
        let strength = match &self.rays {
            PlaneRays::Parallel { strength, .. } => *strength,
            PlaneRays::Perspective { steps, strength, .. } => (strength * stretch(steps, [fast, medium])) as f32,
        };
        ([fast as f32, medium as f32], strength)
    }

    /// Returns a kernel on rays of these slopes; `squares` are those of its widths along the slow, fast and medium axis.
    #[inline(always)]
    fn kernel_on(&self, [fast, medium]: [f32; 2], strength: f32, [s, f, m]: [f32; 3]) -> RayKernel {
        let row_per_column = match &self.rays {
            PlaneRays::Parallel { voxels: [across, down], .. }
            | PlaneRays::Perspective { step: [across, down], .. } => down / across,
        } as f32;
        let scale = 0.5 * LOG2_E / (self.kernel.sigma * self.kernel.sigma);
        // The covariance on the slice is (f + s fast^2, s fast medium; s fast medium, m + s medium^2).
        let medium_variance = m + s * (medium * medium);
        let determinant = f * medium_variance + s * m * (fast * fast);
        let round = 1.0 + medium * medium + fast * fast;
        let column = (scale * medium_variance / determinant).sqrt();
        RayKernel {
            column,
            shear: 0.0 - column * (s * fast * medium / medium_variance) * row_per_column,
            row: (scale / medium_variance).sqrt() * row_per_column,
            strength: strength * (round / determinant).sqrt(),
        }
    }
}
