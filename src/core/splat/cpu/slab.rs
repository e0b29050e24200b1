//! The slab: voxels of a few slices that wait for the tiles that they reach.
//!
//! In: the voxels of a walk that an open tile may show, line by line, with colours. Out: for each row of tiles, the lines
//! that reach it, in visit order; for each voxel, what a tile needs to take it.

use super::footprints::Footprints;
use super::lattice::{Lattice, Place, Slice};
use super::project::{Coordinates, VoxelBlock};
use super::raster::BLOCK;
use super::stamps::Stamps;
use crate::arena::Lane;
use crate::error::Result;
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
}

/// Which tiles of a row a voxel reaches.
#[derive(Debug, Clone, Copy, Default, bytemuck::Zeroable)]
#[repr(C)]
pub(super) struct Tiles {
    /// With stamps: the last tile that a voxel at its place may reach; without: the first that it reaches.
    pub(super) column: u16,
    /// With stamps: its place among the voxels of a tile; without: the number of tiles.
    pub(super) place: u16,
}

/// Voxels of a few slices. What is for a voxel is in arrays with one element each.
pub(super) struct Slab {
    /// Number of slices.
    slices: usize,
    lines: Vec<Line>,
    /// For each row of tiles of the band: the lines that reach it.
    of_row: Vec<Vec<u32>>,
    /// Number of splats at which the slab is full.
    enough: usize,
    count: usize,
    tiles: Box<[Tiles]>,
    /// Without stamps: the rows of tiles that the voxel reaches.
    rows: Box<[Tiles]>,
    /// Red, green, blue, and the optical depth in units of ln 2, for a tile of strength 1.
    looks: Box<[[f32; 4]]>,
    /// With stamps or footprints: the number of the weights for the first tile of the plane.
    stamps: Box<[i32]>,
    /// In a perspective: where the voxel is on the plane.
    places: Box<[Place]>,
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
            tiles: zeroed(room)?,
            rows: zeroed(room)?,
            looks: zeroed(room)?,
            stamps: zeroed(room)?,
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

    /// Returns the number of splats.
    #[inline(always)]
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Adds a line of the last slice, of these splats; it reaches the rows of tiles from `low` to `high`.
    #[inline(always)]
    pub(super) fn add_line(&mut self, medium: u16, splats: [usize; 2], [low, high]: [usize; 2]) {
        let number = self.lines.len() as u32;
        self.of_row[low..=high].iter_mut().for_each(|lines| lines.push(number));
        let splats = splats.map(|splat| splat as u32);
        self.lines.push(Line { slice: self.slices.max(1) - 1, medium: medium.into(), splats });
    }

    /// Adds the splats of a block's voxels, of the last slice, whose weights are stamps; returns where their looks are to be
    /// put.
    #[inline(always)]
    pub(super) fn add_stamped(&mut self, voxels: &VoxelBlock, stamps: &Stamps) -> &mut [[f32; 4]] {
        let range = self.count..self.count + BLOCK;
        let [_, mediums, fasts] = voxels.positions();
        let slice = self.slices.max(1) - 1;
        stamps.place(slice, [fasts, mediums], &mut self.stamps[range.clone()], &mut self.tiles[range]);
        self.looks_of(voxels)
    }

    /// Adds the splats of a block's voxels, of the last slice, whose weights are footprints; returns where their looks are to
    /// be put.
    #[inline(always)]
    pub(super) fn add_footprints(
        &mut self,
        voxels: &VoxelBlock,
        lane: &Lane,
        slice: &Slice,
        footprints: &Footprints,
    ) -> &mut [[f32; 4]] {
        let range = self.count..self.count + BLOCK;
        let tiles = [&mut self.tiles[range.clone()], &mut self.rows[range.clone()]];
        footprints.place_block(voxels, lane, slice, &mut self.stamps[range], tiles);
        self.looks_of(voxels)
    }

    /// Adds the splats of a block's voxels, of the last slice, which are at `positions`; returns where their looks are to be
    /// put.
    #[inline(always)]
    pub(super) fn add_placed<C: Coordinates>(
        &mut self,
        voxels: &VoxelBlock,
        positions: &C,
        lattice: &Lattice,
        slice: &Slice,
    ) -> &mut [[f32; 4]] {
        let range = self.count..self.count + BLOCK;
        let tiles = [&mut self.tiles[range.clone()], &mut self.rows[range.clone()]];
        lattice.set_places(slice, positions, &mut self.places[range], tiles);
        self.looks_of(voxels)
    }

    #[inline(always)]
    fn looks_of(&mut self, voxels: &VoxelBlock) -> &mut [[f32; 4]] {
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

    /// Returns which tiles the voxels of a line reach.
    #[inline(always)]
    pub(super) fn tiles(&self, line: &Line) -> &[Tiles] {
        &self.tiles[line.splats[0] as usize..line.splats[1] as usize]
    }

    /// Returns which rows of tiles they reach, without stamps.
    #[inline(always)]
    pub(super) fn rows(&self, line: &Line) -> &[Tiles] {
        &self.rows[line.splats[0] as usize..line.splats[1] as usize]
    }

    #[inline(always)]
    pub(super) fn look(&self, splat: u32) -> &[f32; 4] {
        &self.looks[(splat as usize).min(self.looks.len() - 1)]
    }

    #[inline(always)]
    pub(super) fn stamp(&self, splat: u32) -> i32 {
        self.stamps[(splat as usize).min(self.stamps.len() - 1)]
    }

    #[inline(always)]
    pub(super) fn place(&self, splat: u32) -> &Place {
        &self.places[(splat as usize).min(self.places.len() - 1)]
    }

    /// Removes all voxels and slices. Tiles took this many splats, in so many visits: the next slab is larger if these
    /// were few a visit.
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
        (self.slices, self.count) = (0, 0);
    }
}
