//! Divides the memory that `--memory` allows for rendering.
//!
//! In: the limit, the file, the picture. Out: the number of threads, how much of the file may be resident, and how
//! large derived lanes may be. The picture depends on none of them.
//!
//! ```text
//! memory = program + frame, bands, tables, lists + pictures + derived lanes + pages in flight + the file's pages
//! ```

use std::fmt::{self, Display, Formatter};

use indicatif::HumanBytes;

use super::resources::resident_bytes;
use adjsplat::arena::{Arena, Detail, Lane, LaneSet};
use adjsplat::error::{Error, Result};
use adjsplat::internals::{LevelPart, PIXEL_BYTES, RAY_BYTES, in_flight, level_settings};
use adjsplat::splat::cpu;
use adjsplat::splat::cpu::Canvas;
use adjsplat::splat::{Blending, Camera, Lanes, Projection, Settings, View};
use adjsplat::traverse::{Order, VoxelBox};
use adjsplat::volume::Axis;
use adjsplat_judge::dial::RUNGS;
use adjsplat_pictures::{PictureKind, SampleDepth};

/// Memory that the program takes before it draws: code, stacks, the allocator's slack. Measured: 7 to 10 MiB.
const BASE: u64 = 14 << 20;
/// Bytes that the program may take beyond its current resident size.
const GROWTH: u64 = 6 << 20;
/// Bytes by which the memory of two runs may differ, as systems map more or less of the code at once.
const BETWEEN_RUNS: u64 = 2 << 20;
/// Fewest bytes of the file's pages that may be resident: with fewer, page faults take longer than drawing.
pub(super) const LEAST_RESIDENT: u64 = 4 << 20;
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
    /// Divides `memory` bytes for pictures with `settings`; if `is_chosen`, for all settings that the dial tries, which
    /// holds one picture more. `views`: each camera, and the parts of levels that it draws.
    ///
    /// # Errors
    /// [`Error::Input`] if not even one thread fits; it says how much memory is enough.
    pub(super) fn divide(
        memory: u64,
        arena: &Arena,
        settings: &Settings,
        is_chosen: bool,
        kind: PictureKind,
        depth: SampleDepth,
        views: &[(Camera, Vec<LevelPart>)],
    ) -> Result<MemoryShares> {
        let frames = u32::try_from(views.len()).expect("frames are counted in 32 bits");
        let draws = |parts: &[LevelPart], level: usize| parts.iter().any(|part| part.level == level);
        let is_drawn = |(level, _): &(usize, Arena)| views.iter().any(|(_, parts)| draws(parts, *level));
        let drawn: Vec<_> = levels(arena).filter(is_drawn).collect();
        let mut samplings =
            if is_chosen { RUNGS.map(|rung| rung.sampling).to_vec() } else { vec![settings.sampling()] };
        samplings.dedup();
        // Each way to draw, with the grid points and the tiles of what is drawn.
        let mut canvases = Vec::new();
        for (number, level) in &drawn {
            let grid = &level.facts().grid;
            let tiles = level.lanes().map(|lane| lane.tiles.len() as u64).max().unwrap_or(0);
            canvases.push((Canvas::Picture, grid.dims, tiles));
            let Some((low, high)) = level.lanes().next().and_then(|lane| lane.bounds()) else { continue };
            for &sampling in &samplings {
                let settings = level_settings(settings, &arena.facts().grid, grid).with_sampling(sampling);
                for (camera, _) in views.iter().filter(|(_, parts)| draws(parts, *number)) {
                    let canvas = cpu::canvas(grid, &VoxelBox { low, high }, camera, &settings)?;
                    canvases.push((canvas, grid.dims, tiles));
                }
            }
        }
        let pixels = u64::from(settings.size[0]) * u64::from(settings.size[1]);
        // A picture of coarser levels is put together from parts, with four bytes a pixel for what those in front hide. A perspective
        // may have several levels, each drawn in bands of finer samples.
        let is_perspective =
            views.iter().any(|(camera, _)| matches!(camera.projection(), Projection::Perspective { .. }));
        let is_mixed = views.iter().any(|(_, parts)| parts.len() > 1);
        let parts = match drawn.iter().any(|(level, _)| *level > 0) {
            true if is_mixed => pixels.max(cpu::MIXED_SAMPLES) * (3 * PIXEL_BYTES + RAY_BYTES + 4),
            true => pixels * (PIXEL_BYTES + 4),
            false => 0,
        };
        let measuring = if is_chosen { pixels * PIXEL_BYTES } else { 0 };
        let base = BASE.max(resident_bytes().unwrap_or(0) + GROWTH);
        let pictures = Pictures { settings, kind, depth, frames, is_perspective };
        let need_of = |threads: usize, canvases: &[(Canvas, [u32; 3], u64)]| {
            let in_flight = in_flight(arena.bytes().len() as u64) * threads as u64;
            base.saturating_add(pictures.need(threads, canvases, parts + measuring)).saturating_add(in_flight)
        };
        let need = |threads: usize| need_of(threads, &canvases);
        let left = |threads: usize| memory.checked_sub(need(threads)).filter(|&left| left >= LEAST_RESIDENT);
        let Some((threads, left)) = (1..=settings.threads).rev().find_map(|n| left(n).map(|left| (n, left))) else {
            let enough = need(1).saturating_add(LEAST_RESIDENT + BETWEEN_RUNS).div_ceil(1 << 20);
            let is_picture = |(canvas, ..): &&(Canvas, [u32; 3], u64)| *canvas == Canvas::Picture;
            let without_grid: Vec<_> = canvases.iter().filter(is_picture).copied().collect();
            let instead = match () {
                () if settings.blending == Blending::Sheets => ", a smaller --size, or --blending exponential",
                () if need_of(1, &without_grid).saturating_add(LEAST_RESIDENT) <= memory => {
                    ", a smaller --size, or --sampling every"
                }
                () => ", or a smaller --size",
            };
            let why = format!(
                "is {}, but {pictures} from this file takes {enough}MiB; give that much{instead}",
                HumanBytes(memory)
            );
            return Err(Error::input("--memory", why));
        };
        let missing = Axis::ALL.iter().filter(|axis| arena.lane(**axis).is_none()).count() as u64;
        let x = drawn.iter().filter_map(|(_, arena)| arena.lane(Axis::X)).map(|lane| lane.bytes()).sum::<u64>();
        let derived = x.saturating_mul(DERIVING).saturating_mul(missing);
        let derived = if derived.saturating_add(LEAST_RESIDENT) <= left { derived } else { 0 };
        Ok(MemoryShares { threads, resident: left - derived, derived })
    }

    /// Returns whether the lanes that `cameras` walk along are stored, or may be derived.
    ///
    /// # Errors
    /// [`Error::Input`] if a camera or `settings` cannot be used.
    pub(super) fn has_lanes(&self, arena: &Arena, settings: &Settings, cameras: &[Camera]) -> Result<bool> {
        let grid = &arena.facts().grid;
        for camera in cameras {
            let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
            let order = Order::new(view.viewpoint, grid.dims, settings.sense, settings.form)?;
            if self.derived == 0 && arena.lane(order.fast).is_none() {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Pictures, before it is known what they show.
pub(super) struct Pictures<'a> {
    pub(super) settings: &'a Settings,
    pub(super) kind: PictureKind,
    pub(super) depth: SampleDepth,
    pub(super) frames: u32,
    pub(super) is_perspective: bool,
}

impl Pictures<'_> {
    /// Returns the bytes to draw and encode a picture on any of `canvases`, each with the grid points and the tiles of what is
    /// drawn, by `threads`. While it is drawn, it takes `more` bytes.
    fn need(&self, threads: usize, canvases: &[(Canvas, [u32; 3], u64)], more: u64) -> u64 {
        let settings = self.settings.clone().with_threads(threads);
        let pixels = u64::from(settings.size[0]) * u64::from(settings.size[1]);
        let need = |&(canvas, dims, tiles): &_| cpu::memory_need(dims, tiles, canvas, self.is_perspective, &settings);
        let drawing = canvases.iter().map(need).max().unwrap_or(0).saturating_add(more);
        // The frame is freed before its picture is encoded.
        let writing = self.kind.memory(self.depth, pixels);
        let kept = self.kind.kept(self.depth, pixels, self.frames);
        drawing.max(writing).saturating_add(kept)
    }

    /// Checks that `memory` bytes could be enough for any picture of this size; called before the voxels are found.
    ///
    /// # Errors
    /// [`Error::Input`] if they are not.
    pub(super) fn check(&self, memory: u64) -> Result<()> {
        let least =
            self.need(1, &[(Canvas::Picture, [1; 3], 0)], 0).saturating_add(BASE + LEAST_RESIDENT + in_flight(0));
        if least <= memory {
            return Ok(());
        }
        let (mib, memory) = (least.div_ceil(1 << 20), HumanBytes(memory));
        let why = format!(
            "is {memory}, but {self} takes more than {mib}MiB, whatever it shows; give more, or a smaller --size"
        );
        Err(Error::input("--memory", why))
    }
}

impl Display for Pictures<'_> {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        let ([columns, rows], frames) = (self.settings.size, self.frames);
        write!(f, "a picture of {columns}x{rows}")?;
        if frames > 1 { write!(f, ", {frames} frames") } else { Ok(()) }
    }
}

/// Returns all levels of a file.
fn levels<'a>(arena: &Arena<'a>) -> impl Iterator<Item = (usize, Arena<'a>)> {
    let coarser = (1..=arena.level_count()).filter_map(|number| Some((usize::from(number), arena.level(number)?)));
    std::iter::once((0, arena.clone())).chain(coarser)
}

/// Returns how many bytes of `memory` the pages of a file of `file_bytes` may take while one thread only reads the file.
pub(super) fn memory_of_pages(memory: u64, file_bytes: u64) -> u64 {
    let base = BASE.max(resident_bytes().unwrap_or(0)) + GROWTH;
    memory.saturating_sub(base + in_flight(file_bytes)).max(LEAST_RESIDENT)
}

/// The lanes (all scan lines along one axis each) of a file and of its levels; missing ones are derived if memory allows.
pub(super) struct BoundedLanes<'a> {
    lanes: LaneSet<'a>,
    /// The limit of `--memory` in bytes, if the flag is given.
    memory: Option<u64>,
}

impl<'a> BoundedLanes<'a> {
    /// Wraps `arena`, whose derived lanes may take `derived` bytes in all: no more than [`MemoryShares`] says, or without
    /// limit.
    pub(super) fn new(arena: Arena<'a>, memory: Option<u64>, derived: Option<u64>) -> BoundedLanes<'a> {
        BoundedLanes { lanes: LaneSet::with_levels(arena, derived), memory }
    }

    /// Returns the file's arena.
    pub(super) fn arena(&self) -> &Arena<'a> {
        self.lanes.arena()
    }
}

impl Lanes for BoundedLanes<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane_of(0, axis)
    }

    fn detail(&self) -> Detail<'_> {
        self.lanes.detail()
    }

    fn lane_of(&self, level: usize, axis: Axis) -> Result<Lane<'_>> {
        self.lanes.lane_of(level, axis).map_err(|error| match (error, self.memory) {
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
