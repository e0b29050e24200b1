//! Footprints: what a voxel that lies beside the points of the grid weighs at the pixels around it, in a parallel view.
//!
//! In: a lattice. Out: for each place within a pixel, rounded to eighths along each side, the weights at the pixels that the
//! kernel reaches. They are computed once for a frame, and serve all slices:
//!
//! ```text
//! strip     the weights of four columns of pixels, row by row: any four rows are a tile's sixteen weights
//! weights   for each place, a strip for each column that a tile may begin with
//! ```

use multiversion::multiversion;

use super::lattice::{Lattice, Place, Slice, TileRays};
use super::project::{Projector, nearest_pixel};
use super::raster::BLOCK;
use super::slab::Tiles;
use super::tile_buffer::{TILE, TILE_PIXELS};
use super::voxel_block::VoxelBlock;
use crate::arena::{Coverage, Lane};

/// Number of bits of a place within a pixel, along a side; number of places, and their middle, which is the pixel's centre.
const BITS: i32 = 3;
const PLACES: i32 = 1 << BITS;
const MIDDLE: i32 = PLACES / 2;
/// Slack of a kernel's reach, in pixels: what is rounded must not leave out a weight.
const SLACK: f64 = 0.01;
/// Number of codes of a block's place in a coverage, and of the bits of a 16-bit code below them.
const CODES: usize = 1 << 9;
const SHARE_BITS: u32 = 7;

/// The weights of a frame's kernels, and how codes of coverages move voxels. Pairs are along columns and rows of the plane.
pub(super) struct Footprints {
    /// How far a kernel reaches, in eighths of a pixel.
    reach: [i32; 2],
    /// How many pixels the first column or row of weights is before a voxel's nearest pixel.
    before: [i32; 2],
    /// Number of strips for a place, and of rows of a strip.
    strips: i32,
    rows: i32,
    /// Last column and last row of tiles.
    last: [i32; 2],
    weights: Vec<f32>,
    /// For each code of a place in a block: how far that is from the block's centre, in eighths of a pixel.
    shifts: Box<[[f32; 2]; CODES]>,
    code_shift: u32,
}

impl Footprints {
    /// Computes the footprints of a frame; `None` if the view is not parallel or voxels lie on points of the grid.
    pub(super) fn new(lattice: &Lattice, projector: &Projector) -> Option<Footprints> {
        let channels = projector.lane.channels;
        if projector.is_on_grid() || !lattice.is_parallel() {
            return None;
        }
        let slice = lattice.slice(0);
        let reach = [0, 1].map(|side| {
            let reach = lattice.kernel_reach(side, [0.0; 2]) / slice.step[side] + SLACK;
            (reach * f64::from(PLACES)) as i32
        });
        let before = reach.map(|reach| ((reach + MIDDLE) >> BITS) + 3);
        let (strips, rows) = (2 * before[0] - 2, (2 * before[1] + 4) & !3);
        let mut weights = vec![0.0; (PLACES * PLACES * strips * rows) as usize * 4];
        let strip = Strip { before, strips, rows: rows as usize, scale: slice.scale() };
        compute(&lattice.tile([0, 0]), &strip, projector.cut, weights.as_chunks_mut().0);
        let code_shift = if channels.coverage_bits == 8 { 0 } else { SHARE_BITS };
        let mut shifts = Box::new([[0.0; 2]; CODES]);
        for (code, shift) in shifts.iter_mut().enumerate() {
            let Coverage { offset, .. } = Coverage::of_code((code << code_shift) as u16, channels);
            let [slow, medium, fast] = projector.nesting.map(|axis| f64::from(offset[axis]));
            let moved = [fast - slow * slice.shift[0], medium - slow * slice.shift[1]];
            *shift = [0, 1].map(|side: usize| (moved[side] * f64::from(PLACES) / slice.step[side]) as f32);
        }
        let last = lattice.size.map(|side| (side >> TILE) as i32 - 1);
        Some(Footprints { reach, before, strips, rows, last, weights, shifts, code_shift })
    }

    /// Returns how far a voxel with this code of a coverage is from its grid point, in eighths of a pixel.
    #[inline(always)]
    fn shift(&self, code: u16) -> [f32; 2] {
        self.shifts[usize::from(code >> self.code_shift) % CODES]
    }

    /// Returns where a voxel of `slice` lies, in eighths of a pixel, from its coordinates on the fast and the medium axis and
    /// the code of its coverage.
    pub(super) fn place(&self, slice: &Slice, voxel: [u16; 2], code: u16) -> [i32; 2] {
        let shift = self.shift(code);
        [0, 1].map(|side| eighths(slice, side, voxel[side], shift[side]))
    }

    /// Returns the first and the last pixel along columns (`side` 0) or rows (1) that a voxel at a place reaches.
    pub(super) fn pixels(&self, side: usize, at: i32) -> [i32; 2] {
        [(at - self.reach[side] + PLACES - 1) >> BITS, (at + self.reach[side]) >> BITS]
    }

    /// Returns the weight of a voxel at a place at one of these pixels.
    pub(super) fn weight(&self, at: [i32; 2], [x, y]: [i32; 2]) -> f32 {
        self.weights(self.number(at) + self.later([x >> TILE, y >> TILE]))[((y & 3) << TILE | (x & 3)) as usize]
    }

    /// Returns the number of the weights of a voxel at the first tile of the plane.
    #[inline(always)]
    fn number(&self, at: [i32; 2]) -> i32 {
        let [[column, across], [row, down]] = at.map(|at| [(at + MIDDLE) >> BITS, (at + MIDDLE) & (PLACES - 1)]);
        let strip = (down * PLACES + across) * self.strips + self.before[0] - column;
        strip.wrapping_mul(self.rows).wrapping_add(self.before[1] - row).wrapping_mul(4)
    }

    /// Returns by how much the number of a voxel's weights is higher for this tile than for the first one.
    #[inline(always)]
    pub(super) fn later(&self, [column, row]: [i32; 2]) -> i32 {
        TILE_PIXELS as i32 * (column * self.rows + row)
    }

    /// Returns the weights at the pixels of a tile by their number.
    #[inline(always)]
    pub(super) fn weights(&self, number: i32) -> &[f32; TILE_PIXELS] {
        let first = (number as usize).min(self.weights.len() - TILE_PIXELS);
        self.weights[first..].first_chunk().expect("a tile's weights are there")
    }

    /// Computes the numbers of the weights of a block's voxels for the first tile of the plane, and the columns and rows of
    /// tiles that they reach.
    #[inline(always)]
    pub(super) fn place_block(
        &self,
        voxels: &VoxelBlock,
        lane: &Lane,
        slice: &Slice,
        numbers: &mut [i32],
        [columns, rows]: [&mut [Tiles]; 2],
    ) {
        let mut shifts = [[0.0; BLOCK]; 2];
        for (j, &record) in voxels.records[..voxels.count.min(BLOCK)].iter().enumerate() {
            [shifts[0][j], shifts[1][j]] = self.shift(lane.coverage_code(record));
        }
        let [_, mediums, fasts] = voxels.positions;
        let mut at = [[0; BLOCK]; 2];
        for (side, coordinates) in [fasts, mediums].iter().enumerate() {
            for j in 0..BLOCK {
                at[side][j] = eighths(slice, side, coordinates[j], shifts[side][j]);
            }
        }
        for (j, number) in numbers.iter_mut().enumerate().take(BLOCK) {
            *number = self.number([at[0][j], at[1][j]]);
        }
        for (side, tiles) in [columns, rows].into_iter().enumerate() {
            let (reach, last) = (self.reach[side], self.last[side]);
            for (tiles, at) in tiles.iter_mut().zip(&at[side]) {
                let first = ((at - reach + PLACES - 1) >> (BITS + TILE)).max(0);
                let count = (((at + reach) >> (BITS + TILE)).min(last) + 1 - first).max(0);
                *tiles = Tiles { first: first as u16, count: count as u16 };
            }
        }
    }
}

/// Returns the place of a voxel of `slice` along columns (`side` 0) or rows (1), in eighths of a pixel.
#[inline(always)]
fn eighths(slice: &Slice, side: usize, voxel: u16, shift: f32) -> i32 {
    let per_voxel = f64::from(PLACES) / slice.step[side];
    nearest_pixel((f64::from(voxel) - slice.origin[side]) * per_voxel + f64::from(shift)).0
}

/// The shape of the weights of one place.
struct Strip {
    before: [i32; 2],
    strips: i32,
    rows: usize,
    /// Square of the distance between columns of pixels, in square voxels.
    scale: f32,
}

/// Computes the weights of all places, strip after strip, four rows at a time.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn compute(rays: &TileRays, strip: &Strip, cut: f32, weights: &mut [[f32; TILE_PIXELS]]) {
    for (index, weights) in (0..).zip(weights.chunks_exact_mut(strip.rows / 4)) {
        let (place, column): (i32, i32) = (index / strip.strips, index % strip.strips);
        let offset = [place % PLACES, place / PLACES].map(|place| (place - MIDDLE) as f32 / PLACES as f32);
        for (row, weights) in (0..).step_by(4).zip(weights) {
            let pixel = [strip.before[0] - column, strip.before[1] - row];
            *weights = rays.weights(&Place { pixel, offset, scale: strip.scale }, cut);
        }
    }
}
