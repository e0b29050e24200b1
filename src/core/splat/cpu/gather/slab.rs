//! The slab: voxels of a few slices that wait for the tiles that they reach.
//!
//! In: the voxels of a walk that an open tile may show, line by line, with colours. Out: for each row of tiles, the lines
//! that reach it, in visit order, and their runs of neighbouring voxels; for each voxel, what a tile needs to take it.

use std::ops::Range;

use super::lists::TOGETHER;
use crate::error::Result;
use crate::splat::cpu::lattice::{Place, Tiles};
use crate::splat::cpu::voxel_block::{BLOCK, VoxelBlock};
use crate::splat::frame::zeroed;

/// Most slices of a slab.
pub(super) const SLICES: usize = 16;
/// Numbers of splats between which a slab takes no more slices. Tiles take many splats at once from a large slab; but
/// tiles that close late let more hidden voxels be shaded.
const ENOUGH: [usize; 2] = [1024, 8192];

/// A line that waits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    /// The number of its slice in the slab.
    pub(super) slice: usize,
    /// Its coordinate on the medium axis.
    pub(super) medium: i32,
    /// Its first splat, and the one after its last.
    pub(super) splats: [u32; 2],
    /// Its first run, and the one after its last, if voxels lie on points of the grid.
    pub(super) runs: [u32; 2],
}

/// Voxels of a line of which each is beside the one before it: at most [`TOGETHER`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    /// The splat of the first.
    pub(super) splat: u32,
    /// The coordinates of the first and the last on the fast axis. The first may be the greater one.
    fasts: [i32; 2],
    /// The first column of tiles that they may reach, and the one after the last.
    pub(super) columns: [u16; 2],
}

impl Run {
    /// Returns the coordinate of the run's voxel if there is only one.
    #[inline(always)]
    pub(super) fn only_voxel(&self) -> Option<i32> {
        (self.fasts[0] == self.fasts[1]).then_some(self.fasts[0])
    }

    /// Returns the numbers, in the run, of the first and the last voxel between two places along the fast axis; the first number is
    /// greater if there is none.
    #[inline(always)]
    pub(super) fn part(&self, [low, high]: [i32; 2]) -> [i32; 2] {
        let [first, last] = self.fasts;
        let (from, to) = if first <= last { (low - first, high - first) } else { (first - high, first - low) };
        [from.max(0), to.min((last - first).abs())]
    }
}

/// Voxels of a few slices. Arrays have one element for each voxel.
pub(super) struct Slab {
    /// Number of slices.
    slices: usize,
    lines: Vec<Line>,
    /// For each row of tiles of the band: the lines that reach it.
    of_row: Vec<Vec<u32>>,
    /// Number of splats at which the slab is full.
    enough: usize,
    /// Number of splats.
    pub(super) count: usize,
    runs: Vec<Run>,
    /// Where voxels lie on points of the grid: the coordinate on the fast axis.
    pub(super) fasts: Box<[u16]>,
    /// Where they lie beside them: the columns and the rows of tiles that the voxel reaches.
    pub(super) columns: Box<[Tiles]>,
    pub(super) rows: Box<[Tiles]>,
    /// Red, green, blue, and the optical depth in units of ln 2: at the splat's centre if all tiles have one strength, else for a tile
    /// of strength 1.
    looks: Box<[[f32; 4]]>,
    /// Where the voxel's weights come from. With stamps, the number of its stamp, and with footprints, that of its weights: each for the
    /// first tile of the plane. With neither, of displaced voxels: the shape of its kernel.
    pub(super) weight_keys: Box<[i32]>,
    /// In a perspective: where the voxel is on the plane.
    pub(super) places: Box<[Place]>,
}

impl Slab {
    /// Returns an empty slab for a band of this many rows of tiles and lines of at most `len` voxels.
    pub(super) fn new(rows: usize, len: usize) -> Result<Slab> {
        let room = (ENOUGH[1] + len + 2 * BLOCK) as u64;
        Ok(Slab {
            slices: 0,
            lines: Vec::new(),
            of_row: vec![Vec::new(); rows],
            enough: ENOUGH[0],
            count: 0,
            runs: Vec::new(),
            fasts: zeroed(room)?,
            columns: zeroed(room)?,
            rows: zeroed(room)?,
            looks: zeroed(room)?,
            weight_keys: zeroed(room)?,
            places: zeroed(room)?,
        })
    }

    /// Adds a slice; returns its number.
    #[inline(always)]
    pub(super) fn begin_slice(&mut self) -> usize {
        self.slices += 1;
        self.slices - 1
    }

    /// Returns whether it must take no more slices.
    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.slices == SLICES || self.count >= self.enough
    }

    /// Returns whether there is room for this many voxels and a block.
    #[inline(always)]
    pub(super) fn has_room(&self, voxels: usize) -> bool {
        self.count + voxels + BLOCK <= self.looks.len()
    }

    /// Adds a line of the last slice, of these splats; it reaches the rows of tiles from `low` to `high`.
    #[inline(always)]
    pub(super) fn add_line(&mut self, medium: u16, splats: [usize; 2], [low, high]: [usize; 2]) {
        let number = self.lines.len() as u32;
        self.of_row[low..=high].iter_mut().for_each(|lines| lines.push(number));
        let splats = splats.map(|splat| splat as u32);
        self.lines.push(Line { slice: self.last_slice(), medium: medium.into(), splats, runs: [0; 2] });
    }

    /// Returns the number of the last slice.
    #[inline(always)]
    pub(super) fn last_slice(&self) -> usize {
        self.slices.max(1) - 1
    }

    /// Returns the places of the next block's voxels in the arrays.
    #[inline(always)]
    pub(super) fn block(&self) -> Range<usize> {
        self.count..self.count + BLOCK
    }

    /// Adds the splats of a block's voxels; returns where their looks are to be put. All else of them is in the arrays.
    #[inline(always)]
    pub(super) fn add(&mut self, voxels: &VoxelBlock) -> &mut [[f32; 4]] {
        let first = self.count;
        self.count += voxels.count.min(BLOCK);
        &mut self.looks[first..self.count]
    }

    /// Returns the number of lines that reach a row of tiles.
    #[inline(always)]
    pub(super) fn lines_of(&self, row: usize) -> usize {
        self.of_row[row].len()
    }

    /// Returns one of these lines.
    #[inline(always)]
    pub(super) fn line(&self, row: usize, index: usize) -> &Line {
        &self.lines[self.of_row[row][index] as usize]
    }

    /// Finds the runs of all lines; `columns` returns the first column of tiles that voxels of a slice between two places along
    /// the fast axis may reach, and the one after the last.
    #[inline(always)]
    pub(super) fn find_runs(&mut self, columns: impl Fn(usize, [i32; 2]) -> [u16; 2]) {
        for line in &mut self.lines {
            line.runs[0] = self.runs.len() as u32;
            let [mut splat, end] = line.splats;
            let mut fasts = self.fasts[splat as usize..end as usize].iter().copied().peekable();
            while let Some(first) = fasts.next() {
                // Coordinates are below 65,535, so 0 is never taken to follow the greatest.
                let step = fasts.peek().map_or(0, |next| next.wrapping_sub(first));
                let (mut last, mut len) = (first, 1);
                if step == 1 || step == u16::MAX {
                    while len < TOGETHER as u32 && fasts.next_if_eq(&last.wrapping_add(step)).is_some() {
                        (last, len) = (last.wrapping_add(step), len + 1);
                    }
                }
                let ends = [first, last].map(i32::from);
                let columns = columns(line.slice, [ends[0].min(ends[1]), ends[0].max(ends[1])]);
                if columns[0] < columns[1] {
                    self.runs.push(Run { splat, fasts: ends, columns });
                }
                splat += len;
            }
            line.runs[1] = self.runs.len() as u32;
        }
    }

    #[inline(always)]
    pub(super) fn run(&self, run: u32) -> Option<Run> {
        self.runs.get(run as usize).copied()
    }

    /// Returns which columns and rows of tiles the voxels of a line reach, if they lie beside points of the grid.
    #[inline(always)]
    pub(super) fn tiles(&self, line: &Line) -> (&[Tiles], &[Tiles]) {
        let range = line.splats[0] as usize..line.splats[1] as usize;
        (&self.columns[range.clone()], &self.rows[range])
    }

    /// Returns a splat's look. `None` never occurs, as for the two below: it costs less than an index that may panic.
    #[inline(always)]
    pub(super) fn look(&self, splat: u32) -> Option<&[f32; 4]> {
        self.looks.get(splat as usize)
    }

    #[inline(always)]
    pub(super) fn weight_key(&self, splat: u32) -> Option<i32> {
        self.weight_keys.get(splat as usize).copied()
    }

    #[inline(always)]
    pub(super) fn place(&self, splat: u32) -> Option<&Place> {
        self.places.get(splat as usize)
    }

    /// Removes all voxels and slices. Tiles took `taken` splats in `visits` visits; if that is few a visit, the next
    /// slab is larger.
    pub(super) fn clear(&mut self, taken: u64, visits: u64) {
        /// Splats a visit: below the first number, loading and storing a tile's pixels takes too long.
        const FEW: u64 = 20;
        const MANY: u64 = 40;
        if taken < FEW * visits {
            self.enough = (2 * self.enough).min(ENOUGH[1]);
        } else if taken > MANY * visits {
            self.enough = (self.enough / 2).max(ENOUGH[0]);
        }
        self.of_row.iter_mut().for_each(Vec::clear);
        self.lines.clear();
        self.runs.clear();
        (self.slices, self.count) = (0, 0);
    }
}
