//! The budget: how a build divides the memory that it may take.
//!
//! In: a volume's header, what to build, the ceiling. Out: [`Budget`], or what would do. The sums are upper bounds of
//! what the stages hold at once; tests/build/memory.rs holds them against the process's peak.

use super::builder::{BuildOptions, Resources};
use super::spill::Widths;
use super::sweep::{Field, Pace, piece_rows};
use crate::arena::layout::{Channels, TILE_EDGE};
use crate::error::{Error, Result};
use crate::volume::{Axis, Header};

/// What the program takes before it has read anything: code and tables that it wrote to, stacks, the allocator's
/// slack. Measured: 7 to 10 MiB for the smallest builds.
const BASE: u64 = 14 << 20;
/// Samples of a batch, beyond which more slices at once make nothing faster.
const BATCH_SAMPLES: u64 = 1 << 21;
/// Bytes of a lane's output that are gathered before they are written.
pub(crate) const WRITE_BYTES: u64 = 1 << 18;
/// Sections of a lane.
const SECTIONS: u64 = 6;
/// Bytes of a record on its way into a lane: 16 unordered, 4 for its place, up to 8 packed in each of two results that
/// may wait; the rest is what the allocator wastes, as measured.
pub(super) const RECORD_BYTES: u64 = 64;
/// Bytes that a tile of a face takes while its lane is assembled: its count, and its place among those of the curve.
const TILE_BYTES: u64 = 4 + 12;
/// Records of a lane to assemble at once, beyond which more make nothing faster.
pub(super) const RUN_RECORDS: u64 = 1 << 19;

/// Who may have how much memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    /// Bytes that the build takes at most.
    pub need: u64,
    /// Bytes of a visible voxel that go to a temporary file, if they do not fit in memory.
    pub spill_bytes_per_voxel: u64,
    /// Bytes of visible voxels to hold in memory before they go to a temporary file.
    pub(super) spill_memory: u64,
    pub(super) batch: u32,
    pub(super) read_ahead: bool,
    pub(super) threads: usize,
}

impl Budget {
    /// Divides `resources` for a build.
    ///
    /// `buffer_bytes`: what the source holds beside slices.
    ///
    /// # Errors
    /// [`Error::Limit`] if the memory is not enough for one slice with its neighbours and one tile; `need` would do.
    pub fn new(header: &Header, options: &BuildOptions, resources: &Resources, buffer_bytes: u64) -> Result<Budget> {
        let [width, height, depth] = header.grid.dims.map(u64::from);
        let threads = resources.threads.max(1);
        let workers = threads as u64;
        let widths = Widths::new(header.sample_type, options.channels());
        let field = options.field();
        let slice = header.grid.slice_len() * header.sample_type.bytes() as u64;
        let reach = match field {
            Field::None => 0,
            Field::Values => 2 * slice,
            // Samples wait two slices for their smoothed field; fields: six in the smoother, one to fill it, two
            // that gradients reach, one to come.
            Field::Visibility => 2 * slice + 10 * 4 * header.grid.slice_len(),
        };
        let per_slice = if field == Field::Visibility { slice + 4 * header.grid.slice_len() } else { slice };
        let piece_samples = width * u64::from(piece_rows(header.grid.dims[0])).min(height);
        // A piece that grows holds up to twice its bytes; a worker has one at hand, and two may wait.
        let pieces = (2 * workers + 2) * 2 * piece_samples * widths.voxel() as u64;
        let sweep = |slices: u64| BASE + buffer_bytes + reach + slices * per_slice + pieces;

        let face =
            |axis: Axis| axis.others().map(|a| u64::from(header.grid.dims[a.index()].div_ceil(TILE_EDGE.into())));
        let lanes = [Axis::X, Axis::Y, Axis::Z].into_iter().take(options.lane_count.into());
        let faces = lanes.map(|axis| face(axis).iter().product::<u64>()).max().unwrap_or(0);
        let lines =
            |axis: Axis| axis.others().map(|a| u64::from(header.grid.dims[a.index()]).min(8)).iter().product::<u64>();
        let tile = |axis: Axis| lines(axis) * u64::from(header.grid.dims[axis.index()]);
        let fullest = [Axis::X, Axis::Y, Axis::Z].into_iter().map(tile).max().unwrap_or(0);
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
        // Half of what is free at most: the other half is for the spill.
        let free = (memory - sweep(0)) / per_slice.max(1);
        let read_ahead = threads > 1 && free >= 2;
        let batch = if read_ahead { free / 2 } else { free }.clamp(1, wanted);
        let sweeps = sweep(if read_ahead { 2 * batch } else { batch });
        // The spill stays through both stages; in the second it shares with the runs at hand.
        let runs = RECORD_BYTES * RUN_RECORDS * workers;
        let assembles = BASE + TILE_BYTES * faces + SECTIONS * WRITE_BYTES + runs.max(fullest);
        let rest = memory.saturating_sub(sweeps.max(assembles));
        // A store that grows may hold twice its bytes for a moment.
        let spill_memory = if resources.memory.is_none() { u64::MAX } else { rest / 2 };
        let voxels = header.grid.len();
        let spilled = spill_memory.min(voxels.saturating_mul(widths.voxel() as u64)).saturating_mul(2);
        Ok(Budget {
            need: sweeps.max(assembles.min(memory)).saturating_add(spilled),
            spill_bytes_per_voxel: widths.voxel() as u64,
            spill_memory,
            batch: u32::try_from(batch).expect("at most the depth"),
            read_ahead,
            threads,
        })
    }

    /// Whether `voxels` visible ones would not all fit in memory.
    pub fn may_spill(&self, voxels: u64) -> bool {
        voxels.saturating_mul(self.spill_bytes_per_voxel) > self.spill_memory
    }

    pub(super) fn pace(&self) -> Pace {
        Pace { batch: self.batch, read_ahead: self.read_ahead, threads: self.threads }
    }
}

/// Bytes that are free for runs when `held` bytes of `memory` are taken already. `tiles`: of the face.
pub(super) fn free_for_runs(memory: Option<u64>, held: u64, tiles: u64) -> u64 {
    memory.map_or(u64::MAX, |memory| memory.saturating_sub(BASE + held + TILE_BYTES * tiles + SECTIONS * WRITE_BYTES))
}

/// Bytes that a tile of `records` takes if it is too large for a run of its own: its packed records, and an eighth of it
/// unpacked.
pub(super) fn large_tile_bytes(records: u64, channels: Channels) -> u64 {
    let packed = 1 + u64::from(channels.value_bits / 8 + channels.normal_bits / 4 + channels.magnitude_bits / 8);
    records * packed + records.div_ceil(8) * 20
}
