//! Chunks: selects the blocks (groups of lines) of a slab that a frame draws, and gives each of their voxels a slot.
//!
//! In: a slab's blocks, a view and a window of its picture. Out: the blocks that may have a voxel in the window, in
//! visit order, cut into runs (chunks) that fit the buffers. O(blocks) for each frame; lines are not looked at.

use bytemuck::Zeroable;

use super::layout::{Chunk, LineBlock};
use super::lines::{LineList, ListBlock, Slab};
use crate::splat::View;
use crate::splat::clip::ClipRegion;
use crate::traverse::VoxelBox;

/// A window of a picture and the voxels that may show there.
#[derive(Debug)]
pub(crate) struct WindowView<'a> {
    pub(crate) view: &'a View,
    pub(crate) half_width: [f64; 2], // Half-widths of a parallel view's footprints, in pixels.
    pub(crate) window: [i32; 4],     // First column and row, one past the last column and row.
    pub(crate) clip: ClipRegion,
    pub(crate) slow: usize, // The slow axis.
}

impl WindowView<'_> {
    /// Returns whether any voxel of `bounds` may show, and whether all of them lie inside the window.
    fn meets(&self, bounds: &VoxelBox) -> (bool, bool) {
        let pixels = self.view.pixel_bounds(bounds, self.half_width);
        let Some([left, right, top, bottom]) = pixels else { return (false, false) };
        let [x0, y0, x1, y1] = self.window.map(f64::from);
        let meets = right >= x0 && left <= x1 - 1.0 && bottom >= y0 && top <= y1 - 1.0;
        let is_inside = left >= x0 && right <= x1 - 1.0 && top >= y0 && bottom <= y1 - 1.0;
        (meets && self.clip.meets(bounds), is_inside && self.clip.covers(bounds))
    }
}

/// The blocks of a slab that are drawn, and the chunks that they form.
#[derive(Debug, Default)]
pub(crate) struct Chunks {
    pub(crate) blocks: Vec<LineBlock>,
    pub(crate) chunks: Vec<(Chunk, u32)>, // The chunks, each with the number of its blocks.
}

impl Chunks {
    /// Cuts the blocks of `slab` that may show in `window` into chunks of at most `slots` records.
    pub(crate) fn new(list: &LineList, slab: &Slab, window: &WindowView, slots: u32) -> Chunks {
        let (meets, all_inside) = window.meets(&list.bounds);
        let mut chunks = Chunks::default();
        if meets {
            for block in slab.blocks.iter().filter(|block| all_inside || window.meets(&block.bounds).0) {
                chunks.push(block, slots, window.slow);
            }
        }
        chunks
    }

    fn push(&mut self, block: &ListBlock, slots: u32, slow: usize) {
        let first_block = u32::try_from(self.blocks.len()).expect("fewer blocks than lines, which are below 2^32");
        if self.chunks.last().is_none_or(|(chunk, _)| chunk.slot_count + block.records > slots) {
            self.chunks.push((Chunk { first_block, ..Chunk::zeroed() }, 0));
        }
        let (chunk, count) = self.chunks.last_mut().expect("one was put there");
        let first_slot = chunk.slot_count;
        chunk.slot_count += block.records;
        *count += 1;
        chunk.to_slice = block.bounds.high[slow].into();
        let ListBlock { first_line, line_count, .. } = *block;
        self.blocks.push(LineBlock { first_line, line_count, first_slot, end_slot: chunk.slot_count });
    }
}
