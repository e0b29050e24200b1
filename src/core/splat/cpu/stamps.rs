//! Stamps: what the kernels that reach a tile of the lattice weigh at its pixels, in a parallel view.
//!
//! In: a lattice and a slice. Out: for each place that a voxel may have beside a tile, the weights at the tile's sixteen
//! pixels. All tiles of a slice see the same lattice of voxels, so the weights are computed once for a slice.

use bytemuck::Zeroable;

use super::lattice::{Lattice, Slice};
use super::raster::BLOCK;
use super::tile_buffer::TILE_PIXELS;
use crate::splat::arith::near_absorbed;

/// Number of slices whose stamps are kept.
const SLICES: usize = 8;
/// Slack of rounded bounds, in voxels.
const SLACK: f64 = 1e-3;

/// Longest run of tiles.
pub(super) const RUN: usize = 4;

/// 1 in each of the [`RUN`] parts of a word.
pub(super) const EACH: u64 = 0x0001_0001_0001_0001;

/// Returns 1 in each of the first `tiles` parts of a word, 0 in the others.
#[inline(always)]
pub(super) fn mask(tiles: i32) -> u64 {
    if tiles >= RUN as i32 { EACH } else { EACH & ((1 << (16 * tiles)) - 1) }
}

/// Neighbouring tiles of a row that a voxel reaches.
pub(super) struct Run {
    /// How much lower the index of the first is than that of the last tile that the voxel may reach.
    pub(super) lower: u32,
    /// Which of its tiles the voxel reaches: see [`mask`].
    pub(super) mask: u64,
}

/// Where a block's voxels lie among the tiles.
#[derive(Clone, Copy, Zeroable)]
#[repr(C)]
pub(super) struct Reached {
    /// The column and the row of the last tile that a voxel may reach.
    pub(super) last: [[i32; BLOCK]; 2],
    /// The voxel's row and column among those of a tile: row times number of columns, plus column.
    pub(super) place: [u16; BLOCK],
}

/// What the kernels that reach a tile weigh at its pixels, for several slices of a parallel view.
pub(super) struct Stamps {
    pub(super) voxels: Divisor,
    /// Number of columns and rows of voxels that may reach a tile.
    pub(super) size: [i32; 2],
    /// For each slice: a row of stamps after the other. If all voxels have one depth, a stamp has amounts of light; else
    /// weights.
    pub(super) stamps: Vec<[f32; TILE_PIXELS]>,
    pub(super) depth: Option<f32>,
    /// Number of slices in use.
    pub(super) used: usize,
    /// The first voxel along the fast and the medium axis that reaches the first tile of the plane.
    first: [i32; 2],
    /// Which tiles a voxel of the slice at hand reaches, by its place: its row and column among the voxels of a tile.
    runs: Vec<Run>,
    /// Where in `runs` those of each place begin, and the end of the last ones.
    starts: Vec<u32>,
}

impl Stamps {
    pub(super) fn new(lattice: &Lattice, voxels: i32, depth: Option<f32>) -> Stamps {
        let slice = lattice.slice(0);
        let size = [0, 1].map(|side| (2.0 * lattice.reach(side, [0.0; 2]) + 3.0 * slice.step) as i32 + 2);
        let stamps = vec![[0.0; TILE_PIXELS]; SLICES * (size[0] * size[1]) as usize];
        let starts = vec![0; (voxels * voxels + 1) as usize];
        Stamps { voxels: Divisor::new(voxels), size, stamps, depth, used: 0, first: [0; 2], runs: Vec::new(), starts }
    }

    /// Returns how many tiles around a voxel's last tile its kernel may reach, at most.
    pub(super) fn reach(&self) -> usize {
        (self.size[0].max(self.size[1]) / self.voxels.voxels + 2) as usize + RUN
    }

    /// Returns whether there is no room for the stamps of another slice.
    pub(super) fn is_full(&self) -> bool {
        self.used == SLICES
    }

    /// Drops all stamps but those of the slice at hand.
    pub(super) fn keep_last(&mut self) {
        if self.used > 1 {
            let len = (self.size[0] * self.size[1]) as usize;
            self.stamps.copy_within(len * (self.used - 1)..len * self.used, 0);
            self.used = 1;
        }
    }

    /// Returns the index of the first stamp of the slice at hand.
    #[inline(always)]
    fn base(&self) -> i32 {
        (self.used as i32 - 1) * self.size[0] * self.size[1]
    }

    /// Computes the indices of the stamps of a block's voxels for the first tile of the plane; `stamps` has only those of
    /// tiles that a voxel reaches. That for the next tile of a row or column is lower by the number of voxels of a tile.
    #[inline(always)]
    pub(super) fn place(&self, voxels: [&[u16; BLOCK]; 2], stamps: &mut [i32; BLOCK], reached: &mut Reached) {
        let (by, base, [first_fast, first_medium], columns) = (self.voxels, self.base(), self.first, self.size[0]);
        let [fasts, mediums] = voxels;
        let [last_columns, last_rows] = &mut reached.last;
        for j in 0..BLOCK {
            let (fast, medium) = (i32::from(fasts[j]) - first_fast, i32::from(mediums[j]) - first_medium);
            let (column, row) = (by.divide(fast), by.divide(medium));
            (last_columns[j], last_rows[j]) = (column, row);
            reached.place[j] = ((medium - row * by.voxels) * by.voxels + (fast - column * by.voxels)) as u16;
            stamps[j] = base + medium * columns + fast;
        }
    }

    /// Returns the runs of tiles that a voxel at this place reaches.
    #[inline(always)]
    pub(super) fn runs(&self, place: u16) -> &[Run] {
        let place = usize::from(place);
        &self.runs[self.starts[place] as usize..self.starts[place + 1] as usize]
    }

    /// Computes the stamps of a slice. Rows of tiles are `pitch` tiles long.
    #[inline(always)]
    pub(super) fn add(&mut self, lattice: &Lattice, slice: &Slice, pitch: usize, cut: f32) {
        let rays = lattice.tile([0, 0]);
        self.first = [0, 1].map(|side| {
            let low = slice.origin[side] - lattice.reach(side, [0.0; 2]);
            (low - SLACK).ceil() as i32
        });
        self.used += 1;
        let from = self.base() as usize;
        let [columns, rows] = self.size;
        let voxels = self.voxels.voxels;
        let stamps = &mut self.stamps[from..from + (columns * rows) as usize];
        for (index, stamp) in (0..).zip(&mut *stamps) {
            let voxel = [self.first[0] + index % columns, self.first[1] + index / columns];
            *stamp = rays.weights(&lattice.place(slice, voxel), cut);
        }
        self.runs.clear();
        for (start, place) in self.starts.iter_mut().zip(0..) {
            *start = self.runs.len() as u32;
            let (row, column) = (place / voxels, place % voxels);
            for row in (row..rows).step_by(voxels as usize).take_while(|_| place < voxels * voxels) {
                let reaches =
                    |column: &i32| stamps[(row * columns + column) as usize].iter().any(|weight| *weight > 0.0);
                // The voxel reaches all tiles between the first and the last that it reaches.
                let mut columns = (column..columns).step_by(voxels as usize).filter(reaches);
                if let Some(nearest) = columns.next() {
                    let (nearest, farthest) = (nearest / voxels, columns.next_back().unwrap_or(nearest) / voxels);
                    let lower = row / voxels * pitch as i32 + farthest;
                    let width = farthest - nearest + 1;
                    for from in (0..width).step_by(RUN) {
                        self.runs.push(Run { lower: (lower - from) as u32, mask: mask(width - from) });
                    }
                }
            }
        }
        if let Some(depth) = self.depth {
            for amount in stamps.as_flattened_mut() {
                *amount = near_absorbed(depth * *amount);
            }
        }
    }
}

/// Divides by a number of voxels, 1 to 32, without a division.
#[derive(Clone, Copy)]
pub(super) struct Divisor {
    pub(super) voxels: i32,
    factor: i64,
}

impl Divisor {
    fn new(voxels: i32) -> Divisor {
        Divisor { voxels, factor: (1 << 32) / i64::from(voxels) + 1 }
    }

    /// Returns `number / voxels`, rounded down, for numbers within +-2^20.
    #[inline(always)]
    fn divide(self, number: i32) -> i32 {
        ((i64::from(number) * self.factor) >> 32) as i32
    }
}
