//! Spans: which voxels of a slice reach a column or a row of tiles, in a perspective.
//!
//! In: a lattice and a slice, whose voxels lie on points of the grid. Out: for each column and row of tiles of a band, the first and
//! the last coordinate, along the fast or the medium axis, of the voxels that reach it. They are computed once for a slice.

use super::SLACK;
use super::slab::SLICES;
use crate::splat::cpu::lattice::{Lattice, Slice};
use crate::splat::cpu::tile_buffer::TILE_SHIFT;

/// The spans of the slices of a slab: of columns along the fast axis, of rows along the medium axis.
pub(super) struct Spans {
    /// Number of columns and rows.
    size: [usize; 2],
    /// For each slice: one span for each column or row.
    spans: [Vec<[i32; 2]>; 2],
    /// For each slice: how many columns of tiles a voxel is wide, and the first and the last column that voxel 0 may reach.
    columns: [[f64; 3]; SLICES],
}

impl Spans {
    pub(super) fn new(size: [usize; 2]) -> Spans {
        Spans { size, spans: size.map(|tiles| vec![[0; 2]; SLICES * tiles]), columns: [[0.0; 3]; SLICES] }
    }

    /// Computes the spans of `slice`, which is the slab's slice `index`; the band begins with the row of tiles `first_row`.
    #[inline(always)]
    pub(super) fn set(&mut self, index: usize, lattice: &Lattice, slice: &Slice, first_row: i32) {
        let per_voxel = 0.25 / slice.step[0];
        let reach = lattice.kernel_reach(0, [0.0, f64::from((self.size[0] as u32) << TILE_SHIFT)]) + SLACK;
        let last = reach - slice.origin[0];
        self.columns[index] = [per_voxel, (-reach - slice.origin[0]) * per_voxel - 0.75, last * per_voxel];
        for (side, first) in [0, first_row].into_iter().enumerate() {
            let tiles = self.size[side];
            for (tile, span) in (first..).zip(&mut self.spans[side][index * tiles..(index + 1) * tiles]) {
                let pixels = [tile << TILE_SHIFT, (tile << TILE_SHIFT) + 3].map(f64::from);
                let reach = lattice.kernel_reach(side, pixels) + SLACK;
                let [low, high] = pixels.map(|pixel| slice.origin[side] + slice.step[side] * pixel);
                *span = [(low - reach).ceil() as i32, (high + reach).floor() as i32];
            }
        }
    }

    /// Returns the first column of tiles that voxels of the slab's slice `index` between two places along the fast axis may reach,
    /// and the one after the last.
    #[inline(always)]
    pub(super) fn columns(&self, index: usize, [low, high]: [i32; 2]) -> [u16; 2] {
        let [per_voxel, first, last] = self.columns[index];
        // Positive numbers round down when they become integers.
        let from = (f64::from(low) * per_voxel + first + 1.0).max(0.0) as u16;
        let end = (f64::from(high) * per_voxel + last + 1.0).clamp(0.0, self.size[0] as f64) as u16;
        [from, end]
    }

    /// Returns the voxels of the slab's slice `index` that reach a column of tiles.
    #[inline(always)]
    pub(super) fn of_column(&self, index: usize, column: usize) -> [i32; 2] {
        self.spans[0][index * self.size[0] + column]
    }

    /// Returns whether voxels of the line at `medium` reach a row of tiles, counted from the band's first.
    #[inline(always)]
    pub(super) fn reach_row(&self, index: usize, medium: i32, row: usize) -> bool {
        let [low, high] = self.spans[1][index * self.size[1] + row];
        (low..=high).contains(&medium)
    }
}
