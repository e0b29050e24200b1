//! Items for the other crates of this workspace only: comparison tools, studies, the program, tests. Not public API.

pub use crate::model::{drawable, missing_values, stored_transfer};
pub use crate::parallel::in_order;
pub use crate::splat::cpu::memory::{PIXEL_BYTES, RAY_BYTES};
pub use crate::splat::kernel::{LOW_PASS, REACH, SPLAT_LOW_PASS, narrowest_sigma};
pub use crate::splat::levels::{LevelPart, drawn_levels, level_order, level_parts, level_settings};
pub use crate::splat::setup::FrameSetup;
pub use crate::splat::supersample::supersampled;
pub use crate::splat::view::{Affine, PixelMap};
pub use crate::text::{open_regular, read_text, text_of};

/// The two stages of the processor's renderer, for studies that feed them with voxels from other data structures.
pub mod scatter {
    pub use crate::splat::composite::{Look, Table};
    pub use crate::splat::cpu::blend::{Blend, FrontToBack};
    pub use crate::splat::cpu::dispatch::{draw_block, project_block};
    pub use crate::splat::cpu::project::Projector;
    pub use crate::splat::cpu::splats::Splats;
    pub use crate::splat::cpu::task::{BandResult, BandStats, assemble};
    pub use crate::splat::cpu::tile_buffer::{Rect, TileBuffer};
    pub use crate::splat::cpu::voxel_block::{BLOCK, Coordinates, GROUP, VoxelBlock};
}

// Parts of the arena, of a build and of the volume's sources.
pub use crate::arena::{
    lane::STEPPING, pack::LanePacker, pager::in_flight, record_set::RecordSet, transpose::transpose, visible::MAX_DEPTH,
};
pub use crate::build::description::{add_change, description_object};
pub use crate::build::{budget::Budget, description};
pub use crate::volume::{phantom::fields::next_random, source::obtainable};

/// The stages of the renderer on graphics devices: their record types, their shaders, and access to their buffers.
#[cfg(feature = "gpu")]
pub mod gpu_stages {
    pub use crate::splat::gpu::layout::{
        AffineRow, BATCH, Chunk, FrameUniform, LINES, LineBlock, NO_RECORD, NOTHING, SUMMARY_WORDS,
    };
    pub use crate::splat::gpu::layout::{Splat, TILE_SIDE, VisitedVoxel};
    pub use crate::splat::gpu::probe::{Probe, ProbeCallback};
    pub use crate::splat::gpu::stages::{BlendMode, SHADERS};
}
