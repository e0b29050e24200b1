//! A look at the stages' buffers between chunks: for tests that judge each stage, and for studies.

use wgpu::{Buffer, Device, Queue};

use super::layout::{Block, Chunk, Shot};

/// What is on the device once the work of a chunk was handed over. Reading a buffer waits for it.
#[derive(Debug)]
pub struct Probe<'p> {
    /// The device.
    pub device: &'p Device,
    /// Its queue.
    pub queue: &'p Queue,
    /// The uniform of all stages.
    pub shot: &'p Shot,
    /// The chunk.
    pub chunk: Chunk,
    /// Its blocks: what of the slab's lines it walks.
    pub blocks: &'p [Block],
    /// Words of all the blocks' lines: tile of the slab and line of the tile; the whole list of the slab.
    pub lines: &'p [u32],
    /// Tiles, line ends, steps, values, normals and magnitudes of the slab.
    pub slab: &'p [Buffer; 6],
    /// Looks by value code, depths by pair of codes.
    pub looks: [&'p Buffer; 2],
    /// [`Voxel`](super::layout::Voxel)s.
    pub voxels: &'p Buffer,
    /// [`Splat`](super::layout::Splat)s.
    pub splats: &'p Buffer,
    /// A mask for each tile; with tiles only.
    pub masks: Option<&'p Buffer>,
    /// Four values a pixel; with tiles only.
    pub pixels: Option<&'p Buffer>,
}

/// Called after each chunk.
pub type Look<'l> = &'l mut dyn FnMut(&Probe);
