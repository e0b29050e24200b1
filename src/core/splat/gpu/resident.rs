//! What stays on a device from one scene to the next, and lanes that only the device holds.
//!
//! In: a device; or the channels of a lane whose directory alone is in memory, part after part. Out: a renderer; and back
//! into memory, a few tiles of such a lane, for walks that need no more.

use std::sync::Arc;

use wgpu::{Device, DeviceType, Queue};

use super::budget::in_flight;
use super::buffers::FrameBuffers;
use super::context::Context;
use super::lines::LineList;
use super::looks::LookBuffers;
use super::resolve::ResolvePipeline;
use super::slab_buffers::{SlabBuffers, slab_sizes};
use super::stages::Pipelines;
use super::timing::Timer;
use super::{Compositor, GpuOptions, GpuRenderer, check_blends};
use crate::arena::{Lane, OwnedLane};
use crate::error::{Error, Result};
use crate::splat::Scene;
use crate::traverse::{VoxelBox, tile_bounds};
use crate::volume::Axis;

/// What a renderer keeps on a device from one scene to the next: lanes, pipelines, buffers.
///
/// A [`GpuRenderer`] borrows its scene. A window or a page that changes the transfer function while it owns the model keeps
/// this between pictures.
#[derive(Debug)]
pub struct Resident {
    pub(super) context: Arc<Context>,
    pub(super) pipelines: Arc<Pipelines>,
    pub(super) timer: Option<Timer>,
    pub(super) options: GpuOptions,
    pub(super) is_software: bool,               // Whether the device runs on the processor.
    pub(super) kept_looks: Option<LookBuffers>, // Of the renderer before.
    pub(super) lists: Vec<(usize, Arc<LineList>)>, // The line list of each level that was drawn.
    /// On the device: whole lanes of some levels, the last used last; or a slab of a lane that is too large.
    pub(super) slabs: Vec<SlabBuffers>,
    pub(super) buffers: FrameBuffers,
    pub(super) current: Compositor, // The compositor of the frame that is being drawn.
    pub(super) resolve: Option<ResolvePipeline>,
}

impl Resident {
    /// Prepares a device for renderers; for its features see [`GpuRenderer::new`].
    ///
    /// # Errors
    /// [`Error::Device`] if the device fails, was opened with lower limits than those of WebGPU, or cannot blend the format of
    /// `options`.
    pub async fn new(device: Device, queue: Queue, options: GpuOptions) -> Result<Resident> {
        // A page opens its device by `adapter::open_async`, and each check makes it larger.
        #[cfg(not(target_arch = "wasm32"))]
        super::adapter::check_limits(&device)?;
        check_blends(&device, options.compositor)?;
        #[cfg_attr(target_arch = "wasm32", expect(clippy::arc_with_non_send_sync, reason = "a page has one thread"))]
        let context = Arc::new(Context::new(device, queue, in_flight(options.vram)));
        let is_software = context.device.adapter_info().device_type == DeviceType::Cpu;
        let (pipelines, timer) =
            context.watch(async || Ok((Pipelines::new(&context.device), Timer::new(&context)?))).await?;
        Ok(Resident {
            context,
            pipelines: Arc::new(pipelines),
            timer,
            options,
            is_software,
            kept_looks: None,
            lists: Vec::new(),
            slabs: Vec::new(),
            buffers: FrameBuffers::default(),
            current: Compositor::Tiles,
            resolve: None,
        })
    }

    /// Returns a renderer of `scene`, which must have the same voxels as the scene before; its transfer function may be
    /// another one. For other voxels, call [`Resident::forget_scene`] first.
    pub fn renderer(self, scene: Scene<'_>) -> GpuRenderer<'_> {
        GpuRenderer { scene, looks: None, resident: self }
    }

    /// Takes records of a lane of `level` whose channels are not in memory: the steps, values, normals, magnitudes and coverages of
    /// those from `first`, a multiple of 4, on. Level 0 has the voxels themselves. Voxels that have not arrived are not drawn.
    ///
    /// # Errors
    /// [`Error::Limit`] if the lane is too large for the device; [`Error::Input`] if its tiles are damaged or the records are
    /// not its own; [`Error::Device`].
    pub async fn receive(&mut self, level: usize, lane: &Lane<'_>, first: u64, channels: [&[u8]; 5]) -> Result<()> {
        let context = self.context.clone();
        context.watch(async || self.take(level, lane, first, channels)).await
    }

    fn take(&mut self, level: usize, lane: &Lane, first: u64, channels: [&[u8]; 5]) -> Result<()> {
        let records = lane.elsewhere.map_or(0, |elsewhere| elsewhere.records);
        let count = channels[0].len() as u64;
        let widths = lane.channels.widths();
        let is_own = first.is_multiple_of(4)
            && first
                .checked_add(count)
                .is_some_and(|end| end <= records && (count.is_multiple_of(4) || end == records))
            && channels.iter().zip(widths).all(|(bytes, width)| bytes.len() as u64 == count * width as u64);
        if !is_own {
            return Err(Error::input("records", "are not those of a lane whose channels are not in memory"));
        }
        let place = match self.slabs.iter().position(|slab| slab.is_lane(level, lane.axis)) {
            Some(place) => place,
            None => {
                self.add_lane(level, lane)?;
                self.slabs.len() - 1
            }
        };
        // Tables of the modes that show the largest value or the mean depend on what has arrived.
        self.kept_looks = None;
        let slab = &mut self.slabs[place];
        for ((buffer, bytes), width) in slab.buffers[2..].iter().zip(channels).zip(widths) {
            let (words, rest) = bytes.split_at(bytes.len() / 4 * 4);
            let at = first * width as u64;
            self.context.write(buffer, at, words)?;
            if !rest.is_empty() {
                let mut last = [0; 4];
                last[..rest.len()].copy_from_slice(rest);
                self.context.write(buffer, at + words.len() as u64, &last)?;
            }
        }
        slab.missing -= count.min(slab.missing);
        Ok(())
    }

    /// Puts the tiles and line ends of a lane on the device, and room for its channels; if need be in place of other lanes.
    fn add_lane(&mut self, level: usize, lane: &Lane) -> Result<()> {
        let mut next = 0;
        for tile in lane.tiles {
            if tile.first_record.get() != next {
                return Err(Error::input("lane", "has tiles out of order; the file is damaged: run adj verify on it"));
            }
            next += lane.tile_records(tile);
        }
        if next != lane.record_count() {
            return Err(Error::input("lane", "has records in no tile; the file is damaged: run adj verify on it"));
        }
        let tiles: Vec<u32> = (0..u32::try_from(lane.tiles.len()).expect("a face has at most 2^26 tiles")).collect();
        let sizes = slab_sizes(lane, &tiles)?;
        let (need, have) = (sizes.iter().sum::<u64>(), self.options.lane_bytes());
        if need > have {
            let what = "bytes of video memory for a lane that is not in memory".into();
            return Err(Error::Limit { what, need, have });
        }
        while !self.slabs.is_empty() && need + self.slabs.iter().map(SlabBuffers::bytes).sum::<u64>() > have {
            self.slabs.remove(0);
        }
        let slab = SlabBuffers::new(&self.context, level, lane, true, sizes)?;
        slab.upload(&self.context, lane, &tiles)?;
        self.slabs.push(slab);
        Ok(())
    }

    /// Returns whether all records of the lane of `level` along `axis` are on the device.
    pub fn has_lane(&self, level: usize, axis: Axis) -> bool {
        self.slabs.iter().any(|slab| slab.is_lane(level, axis) && slab.missing == 0)
    }

    /// Frees the lane of `level` along `axis`, if it is on the device, with the level's line list and the tables.
    pub fn forget_lane(&mut self, level: usize, axis: Axis) {
        self.slabs.retain(|slab| (slab.level, slab.axis) != (level, axis));
        self.lists.retain(|(listed, _)| *listed != level);
        self.kept_looks = None;
    }

    /// Frees all that belongs to the scene: lanes, line lists and tables. The next scene may then have other voxels.
    pub fn forget_scene(&mut self) {
        self.kept_looks = None;
        self.lists.clear();
        self.slabs.clear();
    }

    /// Reads those tiles of a lane of level 0 back into memory whose voxels may lie in a box that `wants` accepts. The lane's channels
    /// are on the device, as far as they have arrived.
    ///
    /// # Errors
    /// [`Error::Limit`] if the tiles are too large to be read at once; [`Error::Device`].
    pub async fn tiles_back(&mut self, lane: &Lane<'_>, wants: impl Fn(&VoxelBox) -> bool) -> Result<OwnedLane> {
        let mut back = OwnedLane::new(lane.axis, lane.dims, lane.channels);
        let Some(slab) = self.slabs.iter().find(|slab| slab.is_lane(0, lane.axis)) else {
            return Ok(back);
        };
        let mut runs = Vec::new();
        let (mut lines, mut records) = (0u32, 0u64);
        for tile in lane.tiles.iter().filter(|tile| wants(&tile_bounds(lane, tile))) {
            let (first, count) = (tile.first_record.get(), lane.tile_records(tile));
            let mut moved = *tile;
            (moved.first_line, moved.first_record) = (lines.into(), records.into());
            back.tiles.push(moved);
            back.line_ends.extend_from_slice(lane.line_ends.bytes_of(tile.lines()));
            lines += tile.occupancy.get().count_ones();
            records += count;
            runs.push(first..first + count);
        }
        let widths = lane.channels.widths();
        // Copies are of whole words.
        let aligned = |width: usize, run: &std::ops::Range<u64>| {
            let [start, end] = [run.start, run.end].map(|record| record * width as u64);
            (start / 4 * 4, end.next_multiple_of(4), start % 4, end - start)
        };
        let copies = || widths.iter().enumerate().flat_map(|(at, width)| runs.iter().map(move |run| (at, *width, run)));
        let bytes = copies().map(|(_, width, run)| aligned(width, run)).map(|(start, end, ..)| end - start).sum();
        let context = self.context.clone();
        let channels = context
            .watch(async || {
                let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
                let buffer = context.buffer("tiles back", bytes, usage)?;
                let mut encoder = context.encoder("tiles back");
                let mut to = 0;
                for (channel, width, run) in copies().filter(|(_, width, run)| *width > 0 && !run.is_empty()) {
                    let (start, end, ..) = aligned(width, run);
                    let from = &slab.buffers[2 + channel];
                    encoder.copy_buffer_to_buffer(from, start, &buffer, to, Some(end - start));
                    to += end - start;
                }
                context.submit([encoder.finish()])?;
                let split = |read: &[u8]| {
                    let (mut channels, mut at) = ([const { Vec::new() }; 5], 0);
                    for (channel, width, run) in copies().filter(|(_, width, run)| *width > 0 && !run.is_empty()) {
                        let (start, end, skipped, wanted) = aligned(width, run);
                        let [from, count] = [at + skipped, wanted].map(|n| usize::try_from(n).expect("it was mapped"));
                        Vec::extend_from_slice(&mut channels[channel], &read[from..from + count]);
                        at += end - start;
                    }
                    channels
                };
                context.read(&buffer, bytes.max(4), split).await
            })
            .await?;
        let [steps, values, normals, magnitudes, coverages] = channels;
        Ok(OwnedLane { steps, values, normals, magnitudes, coverages, ..back })
    }
}
