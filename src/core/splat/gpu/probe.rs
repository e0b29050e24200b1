//! Access to the stages' buffers between chunks, for tests that check each stage and for benches.
//!
//! In: a chunk whose commands were submitted. Out: the device's buffers.

use wgpu::{Buffer, Device, Queue};

use super::layout::{Chunk, FrameUniform, LineBlock};

/// The buffers on the device once the commands of a chunk were submitted. Reading a buffer waits for these commands.
#[derive(Debug)]
pub struct Probe<'p> {
    /// The renderer's device.
    pub device: &'p Device,
    /// The device's queue.
    pub queue: &'p Queue,
    /// The uniform of the window.
    pub uniform: &'p FrameUniform,
    /// The chunk that was drawn.
    pub chunk: Chunk,
    /// The blocks of lines that the chunk walks.
    pub blocks: &'p [LineBlock],
    /// All lines of the slab. The high 26 bits are the index of a tile, the low 6 bits a line of that tile.
    pub lines: &'p [u32],
    /// Tiles, line ends, steps, values, normals, magnitudes and coverages of the slab.
    pub slab: &'p [Buffer; 7],
    /// Two tables: colour and optical depth by value code; optical depth by value code and magnitude code.
    pub looks: [&'p Buffer; 2],
    /// The chunk's [`VisitedVoxel`](super::layout::VisitedVoxel)s.
    pub voxels: &'p Buffer,
    /// The chunk's [`Splat`](super::layout::Splat)s.
    pub splats: &'p Buffer,
    /// Columns and rows of each splat's box; with `Compositor::Tiles` only.
    pub boxes: Option<&'p Buffer>,
    /// For each tile of the picture, a mask of the batches with splats on it, after its summary; with `Compositor::Tiles` only.
    pub masks: Option<&'p Buffer>,
    /// Four values for each pixel; only with [`Compositor::Tiles`](super::Compositor).
    pub pixels: Option<&'p Buffer>,
}

/// A function that is called after each chunk.
pub type ProbeCallback<'l> = &'l mut dyn FnMut(&Probe);
