//! What the other crates of this workspace reach into: judges, studies, the program, tests. No part of the API.

pub use crate::build::description;
pub use crate::model::{drawable, missing_values, stored_transfer};
pub use crate::parallel::in_order;
pub use crate::splat::arith::LOG2_E;
pub use crate::splat::cpu::blend::WHOLE_CELL;
pub use crate::splat::finer::supersampled;
pub use crate::splat::kernel::{LOW_PASS, REACH};
pub use crate::splat::shot::Shot;
pub use crate::text::{open_regular, read_text};

/// The renderer's two stages, for studies that feed them from other structures.
pub mod scatter {
    pub use crate::splat::composite::{Finish, Look, Table};
    pub use crate::splat::cpu::blend::{Blend, FrontToBack};
    pub use crate::splat::cpu::dispatch::{Bench, block, draw};
    pub use crate::splat::cpu::planes::{Planes, Rect};
    pub use crate::splat::cpu::project::{Coordinates, GROUP, Projector, Voxels, weigh};
    pub use crate::splat::cpu::raster::{BLOCK, EllipseEach, Limits, Splats};
    pub use crate::splat::cpu::{Drawn, Work, assemble};
}

/// The stages of the renderer on graphics devices: their records, their shaders, and access to their buffers.
#[cfg(feature = "gpu")]
pub mod gpu_stages {
    pub use crate::splat::gpu::layout::{AffineRow, BATCH, Chunk, FrameUniform, LINES, LineBlock, NO_RECORD, NOTHING};
    pub use crate::splat::gpu::layout::{Splat, TILE, VisitedVoxel};
    pub use crate::splat::gpu::probe::{Probe, ProbeCallback};
    pub use crate::splat::gpu::stages::{BlendMode, SHADERS};
}
