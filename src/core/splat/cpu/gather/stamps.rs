//! Stamps: what the kernels that reach a tile of the lattice weigh at its pixels, in a parallel view.
//!
//! In: a lattice and a slice. Out: for each place that a voxel may have beside a tile, the weights at the tile's sixteen
//! pixels. All tiles of a slice see the same lattice of voxels, so the weights are computed once for a slice. If a tile has
//! one voxel and a half, every second one sees the same lattice, and there are stamps of two *kinds*: for even and for odd columns or
//! rows of tiles.

use super::SLACK;
use super::slab::SLICES;
use crate::splat::cpu::blend::Blend;
use crate::splat::cpu::lattice::{Lattice, Period, Place, Slice};
use crate::splat::cpu::tile_buffer::TILE_PIXELS;
use crate::splat::cpu::voxel_block::BLOCK;

/// What the kernels that reach a tile weigh at its pixels, for the slices of a slab.
pub(super) struct Stamps {
    /// After how many columns and rows of tiles the kinds repeat, and after how many voxels.
    periods: [Period; 2],
    /// How many periods of columns a voxel is wide, times 2^32; a little more, so that whole numbers are not rounded down to fewer.
    per_voxel: u64,
    /// Number of columns and rows of voxels that may reach the first tiles.
    size: [i32; 2],
    /// The optical depth of all voxels at their centres, if they have one. A stamp then has amounts of light; else
    /// weights.
    pub(super) depth: Option<f32>,
    /// For each slice: the first voxel along the fast and the medium axis that reaches the first tile of the plane.
    first: [[i32; 2]; SLICES],
    /// For each kind and slice: a row of stamps after the other.
    stamps: Vec<[f32; TILE_PIXELS]>,
    /// For each row of stamps: the first and the last column whose voxels reach the first tile of the kind.
    ends: Vec<[i32; 2]>,
    /// For each slice, and for even and odd columns of tiles: the least first and the greatest last column of its rows.
    widest: [[[i32; 2]; 2]; SLICES],
    /// For each column of stamps: the nearest column of pixels, and the distance from it.
    across: Vec<(i32, f32)>,
}

/// The ends of a row of stamps that reaches no tile.
const NONE: [i32; 2] = [1 << 20, -(1 << 20)];

/// Which voxels of a line reach the tiles of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    /// The first and the last voxel along the fast axis that reach the first tile, and the second.
    ends: [[i32; 2]; 2],
    period: Period,
}

impl Span {
    /// Returns the first and the last voxel that reach a column of tiles.
    #[inline(always)]
    pub(super) fn of_column(&self, column: usize) -> [i32; 2] {
        let Period { shift, voxels } = self.period;
        let before = voxels * (column as i32 >> shift);
        self.ends[column & shift as usize].map(|at| at + before)
    }

    /// Returns the same for any column, if all are of one kind.
    #[inline(always)]
    pub(super) fn all_columns(&self) -> Option<impl Fn(usize) -> [i32; 2] + use<>> {
        let Span { ends: [[low, high], _], period: Period { shift, voxels } } = *self;
        (shift == 0).then_some(move |column| {
            let before = voxels * column as i32;
            [low + before, high + before]
        })
    }
}

impl Stamps {
    pub(super) fn new(lattice: &Lattice, periods: [Period; 2], depth: Option<f32>) -> Stamps {
        let slice = lattice.slice(0);
        let size = [0, 1].map(|side| {
            let more = periods[side].shift * periods[side].voxels;
            (2.0 * lattice.reach(side, [0.0; 2]) + 3.0 * slice.step[side]) as i32 + 2 + more
        });
        let slices = SLICES << (periods[0].shift + periods[1].shift);
        let stamps = vec![[0.0; TILE_PIXELS]; slices * (size[0] * size[1]) as usize];
        let ends = vec![NONE; slices * size[1] as usize];
        let per_voxel = (1 << 32) / periods[0].voxels as u64 + 1;
        Stamps {
            periods,
            per_voxel,
            size,
            depth,
            first: [[0; 2]; SLICES],
            stamps,
            ends,
            widest: [[NONE; 2]; SLICES],
            across: Vec::new(),
        }
    }

    /// Returns the number of the first row of stamps of a kind, for tiles in such columns and rows, in the slab's slice `index`.
    #[inline(always)]
    fn first_row(&self, [column, row]: [i32; 2], index: usize) -> i32 {
        let [across, down] = self.periods.map(|period| period.shift);
        let kind = ((row & down) << across) | (column & across);
        (kind * SLICES as i32 + index as i32) * self.size[1]
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
        let ([first, top], [across, down]) = (self.first[index], self.periods);
        let row = medium - top - down.voxels * (row_of_tiles >> down.shift);
        if !(0..self.size[1]).contains(&row) {
            return None;
        }
        let ends_of = |column: i32| self.ends[(self.first_row([column, row_of_tiles], index) + row) as usize];
        let ends = [ends_of(0), ends_of(1)];
        let is_reached = ends.iter().any(|[low, high]| low <= high);
        is_reached.then(|| Span { ends: ends.map(|ends| ends.map(|end| first + end)), period: across })
    }

    /// Returns the first column of tiles that voxels between two places along the fast axis may reach, and the one after the last;
    /// `tiles` is the number of columns.
    #[inline(always)]
    pub(super) fn columns(&self, index: usize, [low, high]: [i32; 2], tiles: usize) -> [u16; 2] {
        let (first, Period { shift, voxels }) = (self.first[index][0], self.periods[0]);
        // The width of some voxels in periods, rounded down; exact for numbers below 2^20.
        let periods = |voxels: i32| ((u64::from(voxels.max(0) as u32) * self.per_voxel) >> 32) as i32;
        let columns_of = |column: i32| {
            let [nearest, farthest] = self.widest[index][column as usize];
            let from = periods(low - first - farthest + voxels - 1);
            let after = periods(high - first - nearest + voxels);
            [(from << shift) + column, if after > 0 { ((after - 1) << shift) + column + 1 } else { 0 }]
        };
        let mut ends = columns_of(0);
        if shift > 0 {
            let odd = columns_of(1);
            ends = [ends[0].min(odd[0]), ends[1].max(odd[1])];
        }
        [ends[0].min(tiles as i32) as u16, ends[1].min(tiles as i32) as u16]
    }

    /// Returns by how much the number of a voxel's stamp is lower for this tile than for the first one.
    #[inline(always)]
    pub(super) fn lower(&self, [column, row]: [i32; 2]) -> i32 {
        let [across, down] = self.periods;
        let rows = down.voxels * (row >> down.shift) - self.first_row([column, row], 0);
        rows * self.size[0] + across.voxels * (column >> across.shift)
    }

    /// Returns a stamp by its number.
    #[inline(always)]
    pub(super) fn stamp(&self, number: i32) -> Option<&[f32; TILE_PIXELS]> {
        self.stamps.get(number as u32 as usize)
    }

    /// Computes the stamps of `slice`, which is the slab's slice `index`.
    #[inline(always)]
    pub(super) fn set<B: Blend>(&mut self, index: usize, lattice: &Lattice, slice: &Slice, cut: f32) {
        let first = [0, 1].map(|side| (slice.origin[side] - lattice.reach(side, [0.0; 2]) - SLACK).ceil() as i32);
        self.first[index] = first;
        let [columns, rows] = self.size.map(|side| side as usize);
        self.across.clear();
        self.across.extend((first[0]..).take(columns).map(|voxel| lattice.place_along(slice, 0, voxel)));
        self.widest[index] = [NONE; 2];
        let [across, down] = self.periods.map(|period| 0..=period.shift);
        for tile in down.flat_map(|row| across.clone().map(move |column| [column, row])) {
            let rays = lattice.tile(tile);
            let first_row = self.first_row(tile, index) as usize;
            let stamps = self.stamps[first_row * columns..(first_row + rows) * columns].chunks_exact_mut(columns);
            let widest = &mut self.widest[index][tile[0] as usize];
            for ((medium, stamps), ends) in (first[1]..).zip(stamps).zip(&mut self.ends[first_row..]) {
                *ends = NONE;
                let (row, down) = lattice.place_along(slice, 1, medium);
                for ((&(column, right), stamp), number) in self.across.iter().zip(stamps.iter_mut()).zip(0..) {
                    let place = Place { pixel: [column, row], offset: [right, down], scale: slice.scale() };
                    *stamp = rays.weights(&place, cut);
                    if stamp.iter().fold(0, |all, weight| all | weight.to_bits()) != 0 {
                        *ends = [ends[0].min(number), ends[1].max(number)];
                    }
                }
                *widest = [widest[0].min(ends[0]), widest[1].max(ends[1])];
                if let Some(depth) = self.depth {
                    for amount in stamps.as_flattened_mut() {
                        *amount = B::near_amount(depth * *amount);
                    }
                }
            }
        }
    }
}
