//! Divides the memory that `--memory` allows for rendering.
//!
//! In: the limit, the file, the picture. Out: the number of threads, how much of the file may be resident, and how
//! large derived lanes may be. The picture depends on none of them.
//!
//! ```text
//! memory = program + frame, bands, tables, lists + pictures + derived lanes + pages in flight + the file's pages
//! ```

use indicatif::HumanBytes;

use super::resources::resident_bytes;
use adjsplat::arena::{Arena, Lane, LaneSet};
use adjsplat::error::{Error, Result};
use adjsplat::internals::IN_FLIGHT;
use adjsplat::splat::cpu;
use adjsplat::splat::cpu::Canvas;
use adjsplat::splat::{Blending, Camera, Lanes, Sampling, Settings};
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::Axis;
use adjsplat_pictures::{PictureKind, SampleDepth};

/// Memory that the program takes before it draws: code, stacks, the allocator's slack. Measured: 7 to 10 MiB.
const BASE: u64 = 14 << 20;
/// Bytes that the program may take beyond its current resident size.
const GROWTH: u64 = 6 << 20;
/// Bytes by which the memory of two runs may differ, as systems map more or less of the code at once.
const BETWEEN_RUNS: u64 = 2 << 20;
/// Fewest bytes of the file's pages that may be resident: with fewer, page faults take longer than drawing.
const LEAST_RESIDENT: u64 = 4 << 20;
/// Bytes needed to derive a lane, per byte of the lane along x: the lane, its copy while it grows, and a strip.
const DERIVING: u64 = 3;

/// How the memory is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MemoryShares {
    pub(super) threads: usize,
    /// Bytes of the file that may be in memory at once.
    pub(super) resident: u64,
    /// Bytes that derived lanes (made from a stored one) may take.
    pub(super) derived: u64,
}

impl MemoryShares {
    /// Divides `memory` bytes for pictures with `settings`, for the largest need among `samplings`.
    ///
    /// # Errors
    /// [`Error::Input`] if not even one thread fits; it says how much memory is enough.
    pub(super) fn divide(
        memory: u64,
        arena: &Arena,
        settings: &Settings,
        samplings: &[Sampling],
        kind: PictureKind,
        depth: SampleDepth,
        cameras: &[Camera],
    ) -> Result<MemoryShares> {
        let frames = u32::try_from(cameras.len()).expect("frames are counted in 32 bits");
        let dims = arena.facts().grid.dims;
        let grid = &arena.facts().grid;
        let mut canvases = vec![Canvas::Picture];
        if let Some((low, high)) = arena.lanes().next().and_then(|lane| lane.bounds()) {
            for &sampling in samplings {
                let settings = settings.clone().with_sampling(sampling);
                for camera in cameras {
                    canvases.push(cpu::canvas(grid, &VoxelBox { low, high }, camera, &settings)?);
                }
            }
        }
        let tiles = arena.lanes().map(|lane| lane.tiles.len() as u64).max().unwrap_or(0);
        let pixels = u64::from(settings.size[0]) * u64::from(settings.size[1]);
        let base = BASE.max(resident_bytes().unwrap_or(0) + GROWTH);
        let need = |threads: usize| {
            let settings = settings.clone().with_threads(threads);
            let drawing = canvases.iter().map(|&canvas| cpu::memory_need(dims, tiles, canvas, &settings)).max();
            let drawing = drawing.unwrap_or(0);
            // The frame is freed before its picture is encoded.
            let writing = kind.memory(depth, pixels);
            let in_flight = IN_FLIGHT * threads as u64;
            base.saturating_add(drawing.max(writing)).saturating_add(kind.kept(depth, pixels, frames)) + in_flight
        };
        let left = |threads: usize| memory.checked_sub(need(threads)).filter(|&left| left >= LEAST_RESIDENT);
        let Some((threads, left)) = (1..=settings.threads).rev().find_map(|n| left(n).map(|left| (n, left))) else {
            let enough = need(1).saturating_add(LEAST_RESIDENT + BETWEEN_RUNS).div_ceil(1 << 20);
            let [columns, rows] = settings.size;
            let frames = if frames > 1 { format!(", {frames} frames") } else { String::new() };
            let instead = match () {
                () if settings.blending == Blending::Sheets => ", a smaller --size, or --blending exponential",
                () if canvases.iter().any(|canvas| *canvas != Canvas::Picture) => {
                    ", a smaller --size, or --sampling every"
                }
                () => ", or a smaller --size",
            };
            let why = format!(
                "is {}, but a picture of {columns}x{rows}{frames} from this file takes {enough}MiB; give that much{instead}",
                HumanBytes(memory)
            );
            return Err(Error::input("--memory", why));
        };
        let missing = Axis::ALL.iter().filter(|axis| arena.lane(**axis).is_none()).count() as u64;
        let x = arena.lane(Axis::X).map_or(0, |lane| lane.bytes());
        let derived = x.saturating_mul(DERIVING).saturating_mul(missing);
        let derived = if derived.saturating_add(LEAST_RESIDENT) <= left { derived } else { 0 };
        Ok(MemoryShares { threads, resident: left - derived, derived })
    }
}

/// Returns how many bytes of `memory` the file's pages may take while one thread only reads the file.
pub(super) fn memory_of_pages(memory: u64) -> u64 {
    memory.saturating_sub(BASE.max(resident_bytes().unwrap_or(0)) + GROWTH + IN_FLIGHT).max(LEAST_RESIDENT)
}

/// The lanes (all scan lines along one axis each) of a file; missing ones are derived if memory allows.
pub(super) struct BoundedLanes<'a> {
    pub(super) lanes: LaneSet<'a>,
    /// The limit of `--memory` in bytes, if the flag is given.
    pub(super) memory: Option<u64>,
}

impl Lanes for BoundedLanes<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lanes.lane(axis).map_err(|error| match (error, self.memory) {
            (Error::Limit { need, .. }, Some(memory)) => {
                let why = format!(
                    "is {}, but this view needs the lane along {}, which the file does not store and which takes about {} to make; build the file with --lanes xyz, or give more",
                    HumanBytes(memory),
                    axis.name(),
                    HumanBytes(need),
                );
                Error::input("--memory", why)
            }
            (error, _) => error,
        })
    }
}
