//! Footprints: what a voxel that lies beside the points of the grid weighs at the pixels around it, in a parallel view.
//!
//! In: a lattice. Out: for each place within a pixel, rounded to quarters along each side, the weights at the pixels that the
//! kernel reaches. They are computed once for a frame, and serve all slices:
//!
//! ```text
//! strip     the weights of four columns of pixels, row by row: any four rows are a tile's sixteen weights
//! weights   for each place, a strip for each column that a tile may begin with
//! ```

use multiversion::multiversion;

use super::{Lattice, Place, Slice, TileRays, Tiles};
use crate::arena::{Coverage, Lane};
use crate::splat::block_kernel::{SHAPES, shape};
use crate::splat::cpu::project::{Projector, nearest_pixel};
use crate::splat::cpu::tile_buffer::{TILE_PIXELS, TILE_SHIFT, index_in_tile};
use crate::splat::cpu::voxel_block::{BLOCK, VoxelBlock};

/// Number of bits of a place within a pixel, along a side; number of places, and their middle, which is the pixel's centre.
const BITS: i32 = 2;
const PLACES: i32 = 1 << BITS;
const MIDDLE: i32 = PLACES / 2;
/// The most weights that are computed once for a frame: those of kernels that reach five pixels to each side. They take 2 MiB.
const MOST_WEIGHTS: usize = 1 << 19;
/// Slack of a kernel's reach, in pixels: what is rounded must not leave out a weight.
const SLACK: f64 = 0.01;
/// Number of codes of a block's place in a coverage, and of the bits of a 16-bit code below them.
const CODES: usize = 1 << 9;
const SHARE_BITS: u32 = 7;

/// The weights of a frame's kernels, and how codes of coverages move voxels. Pairs are along columns and rows of the plane.
pub(in super::super) struct Footprints {
    /// How many pixels the first column or row of weights is before a voxel's nearest pixel.
    before: [i32; 2],
    /// Number of strips for a place, and of rows of a strip.
    strips: i32,
    rows: i32,
    /// Last column and last row of tiles.
    last: [i32; 2],
    weights: Vec<f32>,
    displacements: Box<[Displacement; CODES]>,
    code_shift: u32,
}

/// How a code of a place in a block displaces a voxel, and its kernel. Lengths are in quarters of a pixel.
#[derive(Debug, Clone, Copy)]
struct Displacement {
    /// How far the voxel is from the block's centre.
    shift: [f32; 2],
    /// How far its kernel reaches.
    reach: [i32; 2],
    /// The number of the first weights of its kernel.
    first: i32,
    /// The optical depth of a voxel of depth 1 at its centre.
    strength: f32,
}

impl Footprints {
    /// Computes the footprints of a frame; `None` if the view is not parallel, voxels lie on points of the grid, or kernels are wide.
    pub(in super::super) fn new(lattice: &Lattice, projector: &Projector) -> Option<Footprints> {
        let channels = projector.lane.channels;
        if projector.is_on_grid() || projector.is_perspective() {
            return None;
        }
        let slice = lattice.slice(0);
        let reach: [[i32; 2]; SHAPES] = std::array::from_fn(|shape| {
            [0, 1].map(|side| {
                let reach = lattice.shape_reach(side, shape) / slice.step[side] + SLACK;
                (reach * f64::from(PLACES)) as i32
            })
        });
        let farthest = [0, 1].map(|side: usize| reach.iter().fold(0, |most, reach| most.max(reach[side])));
        let before = farthest.map(|reach| ((reach + MIDDLE) >> BITS) + 3);
        let (strips, rows) = (2 * before[0] - 2, (2 * before[1] + 4) & !3);
        let of_shape = (PLACES * PLACES * strips * rows) as usize * 4;
        if SHAPES * of_shape > MOST_WEIGHTS {
            return None;
        }
        let mut weights = vec![0.0; SHAPES * of_shape];
        let strip = WeightStrip { before, strips, rows: rows as usize, scale: slice.scale() };
        let kernels = lattice.kernels([0, 0]);
        for (weights, kernel) in weights.chunks_exact_mut(of_shape).zip(kernels) {
            compute(&TileRays::new([0, 0], kernel), &strip, projector.cut, weights.as_chunks_mut().0);
        }
        let code_shift = if channels.coverage_bits == 8 { 0 } else { SHARE_BITS };
        let mut displacements =
            Box::new([Displacement { shift: [0.0; 2], reach: [0; 2], first: 0, strength: 0.0 }; CODES]);
        for (code, displacement) in displacements.iter_mut().enumerate() {
            let Coverage { offset, .. } = Coverage::of_code((code << code_shift) as u16, channels);
            let [slow, medium, fast] = projector.slow_medium_fast.map(|axis| f64::from(offset[axis]));
            let moved = [fast - slow * slice.shift[0], medium - slow * slice.shift[1]];
            let shape = shape(offset);
            *displacement = Displacement {
                shift: [0, 1].map(|side: usize| (moved[side] * f64::from(PLACES) / slice.step[side]) as f32),
                reach: reach[shape],
                first: (shape * of_shape) as i32,
                strength: kernels[shape].strength,
            };
        }
        let last = lattice.size.map(|side| (side >> TILE_SHIFT) as i32 - 1);
        Some(Footprints { before, strips, rows, last, weights, displacements, code_shift })
    }

    /// Returns by how much the voxel of this code of a coverage is displaced.
    #[inline(always)]
    fn displacement(&self, code: u16) -> &Displacement {
        &self.displacements[usize::from(code >> self.code_shift) % CODES]
    }

    /// Returns the optical depth at its centre of a voxel of depth 1 with this code of a coverage.
    #[inline(always)]
    pub(in super::super) fn strength(&self, code: u16) -> f32 {
        self.displacement(code).strength
    }

    /// Returns where a voxel of `slice` lies, in quarters of a pixel, from its coordinates on the fast and the medium axis and
    /// the code of its coverage.
    pub(in super::super) fn place(&self, slice: &Slice, voxel: [u16; 2], code: u16) -> [i32; 2] {
        let shift = self.displacement(code).shift;
        [0, 1].map(|side| quarters(slice, side, voxel[side], shift[side]))
    }

    /// Returns the first and the last pixel along columns (`side` 0) or rows (1) that a voxel at a place reaches.
    pub(in super::super) fn pixels(&self, side: usize, at: i32, code: u16) -> [i32; 2] {
        let reach = self.displacement(code).reach[side];
        [(at - reach + PLACES - 1) >> BITS, (at + reach) >> BITS]
    }

    /// Returns the weight of a voxel at a place at one of these pixels.
    pub(in super::super) fn weight(&self, at: [i32; 2], code: u16, [x, y]: [i32; 2]) -> f32 {
        let number = self.number(at, self.displacement(code).first) + self.later([x >> TILE_SHIFT, y >> TILE_SHIFT]);
        self.weights(number)[index_in_tile(x, y)]
    }

    /// Returns the number of the weights of a voxel at the first tile of the plane; `first` is that of its kernel's first weights.
    #[inline(always)]
    fn number(&self, at: [i32; 2], first: i32) -> i32 {
        let [[column, across], [row, down]] = at.map(|at| [(at + MIDDLE) >> BITS, (at + MIDDLE) & (PLACES - 1)]);
        let strip = (down * PLACES + across) * self.strips + self.before[0] - column;
        strip.wrapping_mul(self.rows).wrapping_add(self.before[1] - row).wrapping_mul(4).wrapping_add(first)
    }

    /// Returns by how much the number of a voxel's weights is higher for this tile than for the first one.
    #[inline(always)]
    pub(in super::super) fn later(&self, [column, row]: [i32; 2]) -> i32 {
        TILE_PIXELS as i32 * (column * self.rows + row)
    }

    /// Returns the weights at the pixels of a tile by their number.
    #[inline(always)]
    pub(in super::super) fn weights(&self, number: i32) -> &[f32; TILE_PIXELS] {
        let first = (number as usize).min(self.weights.len() - TILE_PIXELS);
        self.weights[first..].first_chunk().expect("a tile's weights are there")
    }

    /// Computes the numbers of the weights of a block's voxels for the first tile of the plane, and the columns and rows of
    /// tiles that they reach.
    #[inline(always)]
    pub(in super::super) fn place_block(
        &self,
        voxels: &VoxelBlock,
        lane: &Lane,
        slice: &Slice,
        numbers: &mut [i32],
        [columns, rows]: [&mut [Tiles]; 2],
    ) {
        let (mut shifts, mut reaches, mut firsts) = ([[0.0; BLOCK]; 2], [[0; BLOCK]; 2], [0; BLOCK]);
        for (j, &record) in voxels.records[..voxels.count.min(BLOCK)].iter().enumerate() {
            let Displacement { shift, reach, first, .. } = *self.displacement(lane.coverage_code(record));
            ([shifts[0][j], shifts[1][j]], [reaches[0][j], reaches[1][j]], firsts[j]) = (shift, reach, first);
        }
        let [_, mediums, fasts] = voxels.positions;
        let mut at = [[0; BLOCK]; 2];
        for (side, coordinates) in [fasts, mediums].iter().enumerate() {
            for j in 0..BLOCK {
                at[side][j] = quarters(slice, side, coordinates[j], shifts[side][j]);
            }
        }
        for (j, number) in numbers.iter_mut().enumerate().take(BLOCK) {
            *number = self.number([at[0][j], at[1][j]], firsts[j]);
        }
        for (side, tiles) in [columns, rows].into_iter().enumerate() {
            let last = self.last[side];
            for ((tiles, at), reach) in tiles.iter_mut().zip(&at[side]).zip(&reaches[side]) {
                let first = ((at - reach + PLACES - 1) >> (BITS + TILE_SHIFT)).max(0);
                let count = (((at + reach) >> (BITS + TILE_SHIFT)).min(last) + 1 - first).max(0);
                *tiles = Tiles { first: first as u16, count: count as u16 };
            }
        }
    }
}

/// Returns the place of a voxel of `slice` along columns (`side` 0) or rows (1), in quarters of a pixel.
#[inline(always)]
fn quarters(slice: &Slice, side: usize, voxel: u16, shift: f32) -> i32 {
    let per_voxel = f64::from(PLACES) / slice.step[side];
    nearest_pixel((f64::from(voxel) - slice.origin[side]) * per_voxel + f64::from(shift)).0
}

/// The shape of the weights of one place.
struct WeightStrip {
    before: [i32; 2],
    strips: i32,
    rows: usize,
    /// Square of the distance between columns of pixels, in square voxels.
    scale: f32,
}

/// Computes the weights of all places, strip after strip, four rows at a time.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn compute(rays: &TileRays, strip: &WeightStrip, cut: f32, weights: &mut [[f32; TILE_PIXELS]]) {
    for (index, weights) in (0..).zip(weights.chunks_exact_mut(strip.rows / 4)) {
        let (place, column): (i32, i32) = (index / strip.strips, index % strip.strips);
        let offset = [place % PLACES, place / PLACES].map(|place| (place - MIDDLE) as f32 / PLACES as f32);
        for (row, weights) in (0..).step_by(4).zip(weights) {
            let pixel = [strip.before[0] - column, strip.before[1] - row];
            *weights = rays.weights(&Place { pixel, offset, scale: strip.scale }, cut);
        }
    }
}
