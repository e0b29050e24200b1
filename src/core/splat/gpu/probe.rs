//! Access to the stages' buffers between chunks, for tests that judge each stage and for benches.

use wgpu::{Buffer, Device, Queue};

use super::layout::{Chunk, FrameUniform, LineBlock};

/// What is on the device once the commands of a chunk were submitted. Reading a buffer waits for them.
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
    /// All lines of the slab: index of the tile in the high 26 bits, line of the tile in the low 6.
    pub lines: &'p [u32],
    /// Tiles, line ends, steps, values, normals and magnitudes of the slab.
    pub slab: &'p [Buffer; 6],
    /// Colours and depths by value code; depths by value and magnitude code.
    pub looks: [&'p Buffer; 2],
    /// The chunk's [`VisitedVoxel`](super::layout::VisitedVoxel)s.
    pub voxels: &'p Buffer,
    /// The chunk's [`Splat`](super::layout::Splat)s.
    pub splats: &'p Buffer,
    /// A mask of batches for each tile of the picture; with tiles only.
    pub masks: Option<&'p Buffer>,
    /// Four values for each pixel; with tiles only.
    pub pixels: Option<&'p Buffer>,
}

/// A function that is called after each chunk.
pub type ProbeCallback<'l> = &'l mut dyn FnMut(&Probe);
