//! Stamps: what the kernels that reach a tile of the lattice weigh at its pixels, in a parallel view.
//!
//! In: a lattice and a slice. Out: for each place that a voxel may have beside a tile, the weights at the tile's sixteen
//! pixels. All tiles of a slice see the same lattice of voxels, so the weights are computed once for a slice.

use super::lattice::{Lattice, Slice};
use super::tile_buffer::TILE_PIXELS;
use crate::splat::arith::near_absorbed;

/// Number of slices whose stamps are kept.
const SLICES: usize = 8;
/// Slack of rounded bounds, in voxels.
const SLACK: f64 = 1e-3;

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
    pub(super) first: [i32; 2],
    /// Which tiles a voxel of the slice at hand reaches, by its row and column among the voxels of a tile: how much lower
    /// their indices are than that of the last tile that it may reach.
    pub(super) reached: Vec<u32>,
    /// Where in `reached` the tiles of each row and column begin, and the end of the last ones.
    pub(super) starts: Vec<u32>,
}

impl Stamps {
    pub(super) fn new(lattice: &Lattice, voxels: i32, depth: Option<f32>) -> Stamps {
        let slice = lattice.slice(0);
        let size = [0, 1].map(|side| (2.0 * lattice.reach(side, [0.0; 2]) + 3.0 * slice.step) as i32 + 2);
        let stamps = vec![[0.0; TILE_PIXELS]; SLICES * (size[0] * size[1]) as usize];
        let starts = vec![0; (voxels * voxels + 1) as usize];
        Stamps {
            voxels: Divisor::new(voxels),
            size,
            stamps,
            depth,
            used: 0,
            first: [0; 2],
            reached: Vec::new(),
            starts,
        }
    }

    /// Returns how many tiles around a voxel's last tile its kernel may reach, at most.
    pub(super) fn reach(&self) -> usize {
        (self.size[0].max(self.size[1]) / self.voxels.voxels + 2) as usize
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
    pub(super) fn base(&self) -> i32 {
        (self.used as i32 - 1) * self.size[0] * self.size[1]
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
        self.reached.clear();
        for (start, place) in self.starts.iter_mut().zip(0..) {
            *start = self.reached.len() as u32;
            let (row, column) = (place / voxels, place % voxels);
            for row in (row..rows).step_by(voxels as usize).take_while(|_| place < voxels * voxels) {
                for column in (column..columns).step_by(voxels as usize) {
                    if stamps[(row * columns + column) as usize].iter().any(|weight| *weight > 0.0) {
                        self.reached.push((row / voxels * pitch as i32 + column / voxels) as u32);
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
    pub(super) fn new(voxels: i32) -> Divisor {
        Divisor { voxels, factor: (1 << 32) / i64::from(voxels) + 1 }
    }

    /// Returns `number / voxels`, rounded down, for numbers within +-2^20.
    #[inline(always)]
    pub(super) fn divide(self, number: i32) -> i32 {
        ((i64::from(number) * self.factor) >> 32) as i32
    }
}
