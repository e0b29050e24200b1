//! The memory budget: how a build divides the memory that it may use.
//!
//! In: a volume's header, the options, the memory limit. Out: [`Budget`], or an error that names a sufficient limit.
//! The sums are upper bounds of the bytes that each stage holds at once; tests/core/build/memory.rs compares them with
//! the process's peak.

use super::assemble::LaneFace;
use super::options::{BuildOptions, GradientSource, Resources};
use super::spill::VoxelWidths;
use super::sweep::{SweepSchedule, block_rows};
use crate::arena::layout::Channels;
use crate::error::{Error, Result};
use crate::parallel::MOST_THREADS;
use crate::volume::{Axis, Header};

/// Bytes in use before anything is read: code, tables, stacks, allocator overhead. Measured: 7 to 10 MiB for the
/// smallest builds.
const BASE: u64 = 14 << 20;
/// Number of samples in a batch of slices that are processed together; larger batches are not faster.
const BATCH_SAMPLES: u64 = 1 << 21;
/// Bytes that are collected for each section of a lane before they are written to the file.
pub(crate) const WRITE_BYTES: u64 = 1 << 18;
const SECTIONS: u64 = 7;
/// Bytes per record while a lane is built: 16 for the unsorted record, 4 for its index, up to 8 for the packed record
/// in each of two results that may wait. The remainder is allocator overhead, as measured.
pub(super) const RECORD_BYTES: u64 = 64;
/// Bytes per tile of a lane's face while the lane is built: 4 for its record count, 12 for its slot in the tile order.
const TILE_BYTES: u64 = 4 + 12;
/// Number of records in a run (consecutive tiles of a lane that one thread packs); larger runs are not faster.
pub(super) const RUN_RECORDS: u64 = 1 << 19;

/// Tells how a build divides its memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Most bytes of memory that the build uses.
    pub need: u64,
    /// Bytes per visible voxel in the temporary store.
    pub spill_bytes_per_voxel: u64,
    /// Bytes of visible voxels that are kept in memory before they move to a temporary file.
    pub(super) spill_memory: u64,
    pub(super) schedule: SweepSchedule,
}

impl Budget {
    /// Divides the memory of `resources` for a build. The volume's source holds `buffer_bytes` beside its slices.
    ///
    /// # Errors
    /// [`Error::Limit`] if the memory does not suffice for one slice with its neighbours, or for one tile.
    pub fn new(header: &Header, options: &BuildOptions, resources: &Resources, buffer_bytes: u64) -> Result<Budget> {
        let [width, height, depth] = header.grid.dims.map(u64::from);
        let threads = resources.threads.clamp(1, MOST_THREADS);
        let workers = threads as u64;
        let widths = VoxelWidths::new(header.sample_type, options.channels());
        let slice = header.grid.slice_len() * header.sample_type.bytes() as u64;
        let field = 4 * header.grid.slice_len();
        let (reach, per_slice) = match options.gradient_source() {
            GradientSource::None => (0, slice),
            GradientSource::Values => (2 * slice, slice),
            // Samples wait two slices for their smoothed field. Fields: six in the smoother, one to fill it, two that
            // gradients need, one for the next slice.
            GradientSource::Visibility => (2 * slice + 10 * field, slice + field),
        };
        let block_samples = width * u64::from(block_rows(header.grid.dims[0])).min(height);
        // A growing block may reserve twice its bytes. Each worker has up to two, in progress or waiting; two to spare.
        let blocks = (2 * workers + 2) * 2 * block_samples * widths.voxel() as u64;
        let sweep = |slices: u64| BASE + buffer_bytes + reach + slices * per_slice + blocks;

        let lanes = Axis::ALL.into_iter().take(options.lane_count.into());
        let faces = lanes.map(|axis| LaneFace::new(header.grid.dims, axis).tiles()).max().unwrap_or(0);
        let points = |axis: Axis| u64::from(header.grid.dims[axis.index()]);
        let lines = |axis: Axis| axis.others().map(|across| points(across).min(8)).iter().product::<u64>();
        let fullest = Axis::ALL.map(|axis| lines(axis) * points(axis)).into_iter().max().unwrap_or(0);
        let fullest = large_tile_bytes(fullest, options.channels());
        let assemble = BASE + TILE_BYTES * faces + SECTIONS * WRITE_BYTES + fullest;

        let least = sweep(1).max(assemble);
        let memory = resources.memory.unwrap_or(u64::MAX);
        if memory < least {
            let what = format!(
                "memory in bytes to build {width} x {height} x {depth} samples with {threads} threads (a limit of {}MiB would do)",
                least.div_ceil(1 << 20)
            );
            return Err(Error::Limit { what, need: least, have: memory });
        }
        let wanted = BATCH_SAMPLES.div_ceil(header.grid.slice_len()).clamp(1, depth);
        // The free memory, in slices. With reading ahead, two batches share it.
        let free = (memory - sweep(0)) / per_slice.max(1);
        let read_ahead = threads > 1 && free >= 2;
        let batch = if read_ahead { free / 2 } else { free }.clamp(1, wanted);
        let sweeps = sweep(if read_ahead { 2 * batch } else { batch });
        // The stored visible voxels (the spill) stay through both stages; in the second, runs need memory beside them.
        let runs = RECORD_BYTES * RUN_RECORDS * workers;
        let assembles = BASE + TILE_BYTES * faces + SECTIONS * WRITE_BYTES + runs.max(fullest);
        let remaining = memory.saturating_sub(sweeps.max(assembles));
        // A growing store may briefly hold twice its bytes.
        let spill_memory = if resources.memory.is_none() { u64::MAX } else { remaining / 2 };
        let voxels = header.grid.points();
        let spilled = spill_memory.min(voxels.saturating_mul(widths.voxel() as u64)).saturating_mul(2);
        Ok(Budget {
            need: sweeps.max(assembles.min(memory)).saturating_add(spilled),
            spill_bytes_per_voxel: widths.voxel() as u64,
            spill_memory,
            schedule: SweepSchedule { batch: u32::try_from(batch).expect("at most the depth"), read_ahead, threads },
        })
    }

    /// Returns whether a build with `voxels` visible voxels might need the temporary file.
    pub fn may_spill(&self, voxels: u64) -> bool {
        voxels.saturating_mul(self.spill_bytes_per_voxel) > self.spill_memory
    }
}

/// Returns how many bytes are free for packing runs if `held` bytes of `memory` are in use and the face has `tiles`
/// tiles.
pub(super) fn free_for_runs(memory: Option<u64>, held: u64, tiles: u64) -> u64 {
    memory.map_or(u64::MAX, |memory| memory.saturating_sub(BASE + held + TILE_BYTES * tiles + SECTIONS * WRITE_BYTES))
}

/// Returns how many bytes it takes to pack a tile of `records` records that is too large for one run: all its packed
/// records, and an eighth of them unpacked.
pub(super) fn large_tile_bytes(records: u64, channels: Channels) -> u64 {
    records * channels.record_bytes() + records.div_ceil(8) * 20
}
