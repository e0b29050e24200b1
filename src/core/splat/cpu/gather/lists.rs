//! Lists: the splats that wait for each tile of a row, in visit order.
//!
//! In: runs of neighbouring voxels, of which each tile takes a part, or single splats. Out: for each tile, the splats that it
//! takes at once, while its pixels are in registers.

use bytemuck::Zeroable;

use super::slab::Run;
use crate::error::Result;
use crate::splat::frame::zeroed;

/// Longest list of a tile.
const LONGEST: usize = 128;
/// Number of splats on a tile's list at which the tile takes them: a bit of all greater numbers below `LONGEST`.
pub(super) const FULL: u32 = 64;
/// How many splats are put on lists before tiles with full lists take theirs.
pub(super) const TOGETHER: usize = LONGEST - FULL as usize;
/// Number of tiles whose lists grow at once when a single splat is put on them.
const TILES: usize = 2;
/// Number of splats of a run that are put on a list at once: a vector.
const VECTOR_WIDTH: usize = 8;

/// The splats that wait for a tile. A list's length lies near its splats and far from other lengths, so that a processor
/// never loads together what it stored one by one.
#[derive(Clone, Copy, Zeroable)]
#[repr(C)]
struct List {
    count: u32,
    /// 1 if the tile is open, else 0.
    grows: u32,
    /// The last few are beyond the end of a full list, where a vector may reach.
    splats: [[u32; VECTOR_WIDTH]; LONGEST / VECTOR_WIDTH + 1],
}

impl List {
    /// Puts a splat on the list if it `reaches` the tile and the list grows; returns the list's length.
    #[inline(always)]
    fn put(&mut self, splat: u32, reaches: bool) -> u32 {
        // What is beyond the list's end does not matter, so nothing branches.
        self.splats.as_flattened_mut()[self.count as usize % LONGEST] = splat;
        self.count += self.grows & u32::from(reaches);
        self.count
    }
}

/// The lists of a row's tiles.
pub(super) struct Lists(Box<[List]>);

impl Lists {
    /// Returns empty lists for this many tiles.
    pub(super) fn new(tiles: usize) -> Result<Lists> {
        Ok(Lists(zeroed((tiles + TILES) as u64)?))
    }

    /// Lets the lists of open tiles grow, and no others.
    #[inline(always)]
    pub(super) fn begin_row(&mut self, tiles: usize, is_open: impl Fn(usize) -> bool) {
        for (tile, list) in self.0.iter_mut().enumerate().take(tiles) {
            list.grows = u32::from(is_open(tile));
        }
    }

    /// Lets a tile's list grow no more.
    #[inline(always)]
    pub(super) fn close(&mut self, tile: usize) {
        self.0[tile].grows = 0;
    }

    /// Puts the splats of a run on the lists that grow, of which none may be full; `span` returns the first and the last voxel along the
    /// fast axis that reach a column of tiles. Returns a number with the bits of these lists' lengths.
    #[inline(always)]
    pub(super) fn put_run(&mut self, run: &Run, span: impl Fn(usize) -> [i32; 2]) -> u32 {
        let [first, end] = run.columns.map(usize::from);
        let Some(lists) = self.0.get_mut(first..end) else { return 0 };
        let mut lengths = 0;
        if let Some(voxel) = run.only_voxel() {
            for (column, list) in (first..).zip(lists) {
                let [low, high] = span(column);
                lengths |= list.put(run.splat, low <= voxel && voxel <= high);
            }
            return lengths;
        }
        for (column, list) in (first..).zip(lists) {
            let [from, to] = run.part(span(column));
            let count = to + 1 - from;
            if count <= 0 || list.grows == 0 {
                continue;
            }
            debug_assert!(list.count < FULL && count as usize <= TOGETHER, "a list is longer than there is room for");
            let (mut end, mut splat) = (list.count as usize, run.splat + from as u32);
            list.count += count as u32;
            lengths |= list.count;
            while end < list.count as usize {
                let room = &mut list.splats.as_flattened_mut()[end % LONGEST..];
                for (splat, place) in (splat..).zip(room[..VECTOR_WIDTH].iter_mut()) {
                    *place = splat;
                }
                (end, splat) = (end + VECTOR_WIDTH, splat + VECTOR_WIDTH as u32);
            }
        }
        lengths
    }

    /// Puts a splat on the lists of `width` tiles from `first` on, if they grow. Returns a number with the bits of all these
    /// lists' lengths.
    #[inline(always)]
    pub(super) fn put(&mut self, mut first: usize, mut width: usize, splat: u32) -> u32 {
        let mut lengths = 0;
        loop {
            let lists: Option<&mut [_; TILES]> = self.0.get_mut(first..).and_then(|lists| lists.first_chunk_mut());
            let Some(lists) = lists else { return lengths };
            for (tile, list) in lists.iter_mut().enumerate() {
                lengths |= list.put(splat, tile < width);
            }
            if width <= TILES {
                return lengths;
            }
            (first, width) = (first + TILES, width - TILES);
        }
    }

    /// Empties a tile's list if it has at least this many splats; returns them.
    #[inline(always)]
    pub(super) fn take(&mut self, tile: usize, least: u32) -> Option<&[u32]> {
        let list = &mut self.0[tile];
        if list.count < least {
            return None;
        }
        let count = std::mem::take(&mut list.count);
        Some(&list.splats.as_flattened()[..(count as usize).min(LONGEST)])
    }
}
