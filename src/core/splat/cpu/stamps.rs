//! Stamps: what the kernels that reach a tile of the lattice weigh at its pixels, in a parallel view.
//!
//! In: a lattice and a slice. Out: for each place that a voxel may have beside a tile, the weights at the tile's sixteen
//! pixels. All tiles of a slice see the same lattice of voxels, so the weights are computed once for a slice.

use super::blend::Blend;
use super::lattice::{Lattice, Slice};
use super::raster::BLOCK;
use super::slab::{SLICES, Tiles};
use super::tile_buffer::TILE_PIXELS;

/// Slack of rounded bounds, in voxels.
const SLACK: f64 = 1e-3;

/// What the kernels that reach a tile weigh at its pixels, for the slices of a slab.
pub(super) struct Stamps {
    /// Number of voxels to a tile.
    voxels: i32,
    /// Number of columns and rows of voxels that may reach a tile.
    size: [i32; 2],
    /// The optical depth of all voxels at their centres, if they have one. A stamp then has amounts of light; else
    /// weights.
    pub(super) depth: Option<f32>,
    /// For each slice: the first voxel along the fast and the medium axis that reaches the first tile of the plane.
    first: [[i32; 2]; SLICES],
    /// For each slice: a row of stamps after the other.
    stamps: Vec<[f32; TILE_PIXELS]>,
    /// For each row of stamps: the tiles that a voxel at each place among the voxels of a tile reaches.
    reaches: Vec<Reach>,
}

/// Which tiles of a row a voxel reaches.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Reach {
    /// How far the first is before the column that the voxel has in the slab.
    pub(super) before: u16,
    /// Number of tiles.
    pub(super) width: u16,
}

impl Stamps {
    pub(super) fn new(lattice: &Lattice, voxels: i32, depth: Option<f32>) -> Stamps {
        let slice = lattice.slice(0);
        let size = [0, 1].map(|side| (2.0 * lattice.reach(side, [0.0; 2]) + 3.0 * slice.step) as i32 + 2);
        let stamps = vec![[0.0; TILE_PIXELS]; SLICES * (size[0] * size[1]) as usize];
        let reaches = vec![Reach::default(); SLICES * (size[1] * voxels) as usize];
        Stamps { voxels, size, depth, first: [[0; 2]; SLICES], stamps, reaches }
    }

    /// Returns how many tiles before its column a voxel may reach.
    pub(super) fn before(&self) -> usize {
        (self.size[0] / self.voxels) as usize + 1
    }

    /// Computes the numbers of the stamps of a block's voxels for the first tile of the plane, and where the voxels lie
    /// among the tiles. The voxels are in the slab's slice `index`.
    #[inline(always)]
    pub(super) fn place(
        &self,
        index: usize,
        [fasts, mediums]: [&[u16; BLOCK]; 2],
        stamps: &mut [i32],
        tiles: &mut [Tiles],
    ) {
        let ([columns, rows], [first, top], voxels) = (self.size, self.first[index], self.voxels);
        let base = (index as i32 * rows - top) * columns - first;
        // Divides numbers below 2^20 by 1 to 32, rounded down.
        let factor = (1 << 32) / i64::from(voxels) + 1;
        for (((stamp, tiles), fast), medium) in stamps.iter_mut().zip(tiles).zip(fasts).zip(mediums) {
            let fast = i32::from(*fast);
            *stamp = base + i32::from(*medium) * columns + fast;
            let column = ((i64::from(fast - first) * factor) >> 32) as i32;
            *tiles = Tiles { column: column as u16, place: (fast - first - column * voxels) as u16 };
        }
    }

    /// Returns what voxels of the line at `medium` reach of a row of tiles, by their places.
    #[inline(always)]
    pub(super) fn reaches(&self, index: usize, medium: i32, row_of_tiles: i32) -> &[Reach] {
        let row = medium - self.first[index][1] - self.voxels * row_of_tiles;
        if !(0..self.size[1]).contains(&row) {
            return &[];
        }
        let len = self.voxels as usize;
        &self.reaches[len * (index * self.size[1] as usize + row as usize)..][..len]
    }

    /// Returns by how much the number of a voxel's stamp is lower for this tile than for the first one.
    #[inline(always)]
    pub(super) fn lower(&self, [column, row]: [i32; 2]) -> i32 {
        self.voxels * (row * self.size[0] + column)
    }

    /// Returns a stamp by its number.
    #[inline(always)]
    pub(super) fn stamp(&self, number: i32) -> &[f32; TILE_PIXELS] {
        &self.stamps[(number as usize).min(self.stamps.len() - 1)]
    }

    /// Computes the stamps of `slice`, which is the slab's slice `index`.
    #[inline(always)]
    pub(super) fn set<B: Blend>(&mut self, index: usize, lattice: &Lattice, slice: &Slice, cut: f32) {
        let rays = lattice.tile([0, 0]);
        let first = [0, 1].map(|side| (slice.origin[side] - lattice.reach(side, [0.0; 2]) - SLACK).ceil() as i32);
        self.first[index] = first;
        let [columns, rows] = self.size.map(|side| side as usize);
        let voxels = self.voxels as usize;
        let stamps = self.stamps[index * columns * rows..(index + 1) * columns * rows].chunks_exact_mut(columns);
        let reaches = self.reaches[index * rows * voxels..(index + 1) * rows * voxels].chunks_exact_mut(voxels);
        for ((row, stamps), reaches) in (first[1]..).zip(stamps).zip(reaches) {
            let (mut nearest, mut farthest) = (columns, 0);
            for (column, stamp) in stamps.iter_mut().enumerate() {
                *stamp = rays.weights(&lattice.place(slice, [first[0] + column as i32, row]), cut);
                if stamp.iter().fold(0, |all, weight| all | weight.to_bits()) != 0 {
                    (nearest, farthest) = (nearest.min(column), column);
                }
            }
            for (place, reach) in reaches.iter_mut().enumerate() {
                // A tile `before` the column has the voxel's stamp `place + before * voxels` of the row.
                let least = nearest.saturating_sub(place).div_ceil(voxels);
                let before = farthest.saturating_sub(place) / voxels;
                let reaches_any = nearest <= farthest && place <= farthest && least <= before;
                let width = if reaches_any { before - least + 1 } else { 0 };
                *reach = Reach { before: before as u16, width: width as u16 };
            }
            if let Some(depth) = self.depth {
                for amount in stamps.as_flattened_mut() {
                    *amount = B::near_amount(depth * *amount);
                }
            }
        }
    }
}
