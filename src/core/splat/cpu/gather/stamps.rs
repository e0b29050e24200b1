//! Stamps: what the kernels that reach a tile of the lattice weigh at its pixels, in a parallel view.
//!
//! In: a lattice and a slice. Out: for each place that a voxel may have beside a tile, the weights at the tile's sixteen
//! pixels. All tiles of a slice see the same lattice of voxels, so the weights are computed once for a slice.

use super::SLACK;
use super::slab::SLICES;
use crate::splat::cpu::blend::Blend;
use crate::splat::cpu::lattice::{Lattice, Place, Slice};
use crate::splat::cpu::tile_buffer::TILE_PIXELS;
use crate::splat::cpu::voxel_block::BLOCK;

/// What the kernels that reach a tile weigh at its pixels, for the slices of a slab.
pub(super) struct Stamps {
    /// Number of voxels to a tile's width and height.
    voxels: [i32; 2],
    /// How many tiles a voxel is wide, times 2^32; a little more, so that whole numbers of tiles are not rounded down to fewer.
    per_voxel: u64,
    /// Number of columns and rows of voxels that may reach a tile.
    size: [i32; 2],
    /// The optical depth of all voxels at their centres, if they have one. A stamp then has amounts of light; else
    /// weights.
    pub(super) depth: Option<f32>,
    /// For each slice: the first voxel along the fast and the medium axis that reaches the first tile of the plane.
    first: [[i32; 2]; SLICES],
    /// For each slice: a row of stamps after the other.
    stamps: Vec<[f32; TILE_PIXELS]>,
    /// For each row of stamps: the first and the last column whose voxels reach the first tile.
    ends: Vec<[i32; 2]>,
    /// For each slice: the least first and the greatest last column of its rows.
    widest: [[i32; 2]; SLICES],
    /// For each column of stamps: the nearest column of pixels, and the distance from it.
    across: Vec<(i32, f32)>,
}

/// The ends of a row of stamps that reaches no tile.
const NONE: [i32; 2] = [1 << 20, -(1 << 20)];

/// Which voxels of a line reach the tiles of a row: `low` to `high` along the fast axis reach the first tile; for each next tile both
/// are `voxels` more.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    low: i32,
    high: i32,
    voxels: i32,
}

impl Span {
    /// Returns the first and the last voxel that reach a column of tiles.
    #[inline(always)]
    pub(super) fn of_column(&self, column: usize) -> [i32; 2] {
        [self.low, self.high].map(|at| at + self.voxels * column as i32)
    }
}

impl Stamps {
    pub(super) fn new(lattice: &Lattice, voxels: [i32; 2], depth: Option<f32>) -> Stamps {
        let slice = lattice.slice(0);
        let size = [0, 1].map(|side| (2.0 * lattice.reach(side, [0.0; 2]) + 3.0 * slice.step[side]) as i32 + 2);
        let stamps = vec![[0.0; TILE_PIXELS]; SLICES * (size[0] * size[1]) as usize];
        let ends = vec![NONE; SLICES * size[1] as usize];
        let per_voxel = (1 << 32) / voxels[0] as u64 + 1;
        Stamps {
            voxels,
            per_voxel,
            size,
            depth,
            first: [[0; 2]; SLICES],
            stamps,
            ends,
            widest: [NONE; SLICES],
            across: Vec::new(),
        }
    }

    /// Computes the numbers of the stamps of a block's voxels for the first tile of the plane. The voxels are in the slab's slice
    /// `index`.
    #[inline(always)]
    pub(super) fn number(&self, index: usize, [fasts, mediums]: [&[u16; BLOCK]; 2], stamps: &mut [i32]) {
        let ([columns, rows], [first, top]) = (self.size, self.first[index]);
        let base = (index as i32 * rows - top) * columns - first;
        for ((stamp, fast), medium) in stamps.iter_mut().zip(fasts).zip(mediums) {
            *stamp = base + i32::from(*medium) * columns + i32::from(*fast);
        }
    }

    /// Returns which voxels of the line at `medium` reach a row of tiles; `None` if none does.
    #[inline(always)]
    pub(super) fn span(&self, index: usize, medium: i32, row_of_tiles: i32) -> Option<Span> {
        let [first, top] = self.first[index];
        let row = medium - top - self.voxels[1] * row_of_tiles;
        if !(0..self.size[1]).contains(&row) {
            return None;
        }
        let [low, high] = self.ends[index * self.size[1] as usize + row as usize];
        (low <= high).then(|| Span { low: first + low, high: first + high, voxels: self.voxels[0] })
    }

    /// Returns the first column of tiles that voxels between two places along the fast axis may reach, and the one after the last;
    /// `tiles` is the number of columns.
    #[inline(always)]
    pub(super) fn columns(&self, index: usize, [low, high]: [i32; 2], tiles: usize) -> [u16; 2] {
        let ([nearest, farthest], first) = (self.widest[index], self.first[index][0]);
        // The width of some voxels in tiles, rounded down; exact for numbers below 2^20.
        let tile = |voxels: i32| ((u64::from(voxels.max(0) as u32) * self.per_voxel) >> 32) as u16;
        let from = tile(low - first - farthest + self.voxels[0] - 1);
        let end = tile(high - first - nearest + self.voxels[0]);
        [from, end.min(tiles as u16)]
    }

    /// Returns by how much the number of a voxel's stamp is lower for this tile than for the first one.
    #[inline(always)]
    pub(super) fn lower(&self, [column, row]: [i32; 2]) -> i32 {
        self.voxels[1] * row * self.size[0] + self.voxels[0] * column
    }

    /// Returns a stamp by its number.
    #[inline(always)]
    pub(super) fn stamp(&self, number: i32) -> Option<&[f32; TILE_PIXELS]> {
        self.stamps.get(number as u32 as usize)
    }

    /// Computes the stamps of `slice`, which is the slab's slice `index`.
    #[inline(always)]
    pub(super) fn set<B: Blend>(&mut self, index: usize, lattice: &Lattice, slice: &Slice, cut: f32) {
        let rays = lattice.tile([0, 0]);
        let first = [0, 1].map(|side| (slice.origin[side] - lattice.reach(side, [0.0; 2]) - SLACK).ceil() as i32);
        self.first[index] = first;
        let [columns, rows] = self.size.map(|side| side as usize);
        let stamps = self.stamps[index * columns * rows..(index + 1) * columns * rows].chunks_exact_mut(columns);
        self.across.clear();
        self.across.extend((first[0]..).take(columns).map(|voxel| lattice.place_along(slice, 0, voxel)));
        let mut widest = NONE;
        for ((medium, stamps), ends) in (first[1]..).zip(stamps).zip(&mut self.ends[index * rows..]) {
            *ends = NONE;
            let (row, down) = lattice.place_along(slice, 1, medium);
            for ((&(column, right), stamp), number) in self.across.iter().zip(stamps.iter_mut()).zip(0..) {
                *stamp =
                    rays.weights(&Place { pixel: [column, row], offset: [right, down], scale: slice.scale() }, cut);
                if stamp.iter().fold(0, |all, weight| all | weight.to_bits()) != 0 {
                    *ends = [ends[0].min(number), ends[1].max(number)];
                }
            }
            widest = [widest[0].min(ends[0]), widest[1].max(ends[1])];
            if let Some(depth) = self.depth {
                for amount in stamps.as_flattened_mut() {
                    *amount = B::near_amount(depth * *amount);
                }
            }
        }
        self.widest[index] = widest;
    }
}
