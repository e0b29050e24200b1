//! Draws a frame: all its windows, the slabs of each window, the chunks of each slab, and the stages of each chunk.
//!
//! In: a renderer whose tables and line list are ready. Out: a picture. Buffers are kept for the next frame.

use std::sync::Arc;

use bytemuck::Zeroable;
use web_time::Instant;
use wgpu::{Buffer, Color, CommandEncoder, ComputePassDescriptor, LoadOp, RenderPass};

use super::budget::{BOX_BYTES, MemoryPlan, mask_words};
use super::buffers::BufferName;
use super::chunks::{Chunks, WindowView};
use super::context::Context;
use super::layout::{BATCH, Chunk, FrameUniform, LineBlock, Splat, TILE_SIDE, VisitedVoxel};
use super::lines::{LINE_BYTES, LineList, Slab, line_count};
use super::probe::{Probe, ProbeCallback};
use super::read_back::{self, COUNTERS};
use super::resolve::{self, RenderTarget};
use super::slab_buffers::SlabBuffers;
use super::stages::{BlendMode, Pipelines, bind, render_pass};
use super::timing::Pass;
use super::{Compositor, GpuRenderer, GpuStats, Resident};
use crate::error::Result;
use crate::splat::setup::FrameSetup as Shot;
use crate::splat::{Frame, Settings};

/// Where a picture goes.
pub(super) enum FrameOutput<'o, 'p> {
    /// Back to the processor.
    Frame(&'o mut Frame, Option<ProbeCallback<'p>>),
    /// Into a texture, without waiting for the device; nothing is timed or counted then.
    Texture(&'o RenderTarget<'o>),
}

/// A part of a frame, whose voxels are of one level of detail.
pub(super) struct Part<'s> {
    pub(super) level: usize,
    pub(super) shot: &'s Shot<'s>,
    pub(super) list: Arc<LineList>,
}

impl Part<'_> {
    /// Returns how many bytes the first slab of its lane and all of its lines take on the device.
    fn device_bytes(&self) -> u64 {
        let slab: u64 = self.list.slabs.first().map_or(0, |slab| slab.sizes.iter().sum());
        slab + LINE_BYTES * line_count(&self.shot.lane)
    }
}

/// A frame that is being drawn.
struct FrameDraw<'d, 'a, 'p> {
    renderer: &'d mut GpuRenderer<'a>,
    context: Arc<Context>,
    pipelines: Arc<Pipelines>,
    parts: &'d [Part<'d>], // In the order in which they are composited.
    plan: MemoryPlan,
    settings: &'d Settings,
    blend: BlendMode,
    is_timed: bool,
    stats: &'d mut GpuStats,
    probe: Option<ProbeCallback<'p>>,
}

/// Draws the parts of a frame, in this order, into `output`.
pub(super) async fn frame(
    renderer: &mut GpuRenderer<'_>,
    parts: &[Part<'_>],
    settings: &Settings,
    plan: MemoryPlan,
    mut output: FrameOutput<'_, '_>,
    stats: &mut GpuStats,
) -> Result<()> {
    let context = renderer.resident.context.clone();
    let mut draw = FrameDraw {
        context: context.clone(),
        pipelines: renderer.resident.pipelines.clone(),
        renderer,
        parts,
        plan,
        settings,
        blend: BlendMode::new(settings.mode, settings.sense),
        is_timed: matches!(output, FrameOutput::Frame(..)),
        stats,
        probe: if let FrameOutput::Frame(_, probe) = &mut output { probe.take() } else { None },
    };
    draw.stats.parts = parts.len();
    draw.stats.slabs = draw.lanes().map(|part| part.list.slabs.len()).sum();
    draw.make_room();
    let drawn = draw.renderer.resident.buffers.make(&context, BufferName::Drawn, 4 * COUNTERS)?;
    let mut encoder = context.encoder("begin");
    encoder.clear_buffer(&drawn, 0, None);
    context.submit([encoder.finish()])?;

    let [columns, rows] = settings.size.map(u32::cast_signed);
    let (step, height) = (plan.window_rows as usize, plan.window_rows.cast_signed());
    let windows = (0..rows).step_by(step).map(|y0| [0, y0, columns, rows.min(y0.saturating_add(height))]);
    let mut records = 0;
    for window in windows {
        records += draw.window(window)?;
        match &mut output {
            FrameOutput::Frame(frame, _) => {
                let row = 4 * settings.size[0] as usize;
                let [from, to] = [window[1], window[3]].map(|y| row * y.unsigned_abs() as usize);
                let out = &mut frame.pixels_mut()[from..to];
                read_back::window(draw.renderer, extent(window), out, settings.threads, draw.stats).await?;
            }
            FrameOutput::Texture(target) => resolve::window(draw.renderer, window, target)?,
        }
    }
    if draw.is_timed {
        let drawn = read_back::drawn(&mut draw.renderer.resident.buffers, &context).await?;
        (draw.stats.splats_drawn, draw.stats.splats_skipped) = (drawn, records - drawn.min(records));
    }
    Ok(())
}

/// Returns the columns and rows of a window.
fn extent([x0, y0, x1, y1]: [i32; 4]) -> [u32; 2] {
    [x1 - x0, y1 - y0].map(i32::cast_unsigned)
}

impl FrameDraw<'_, '_, '_> {
    /// Draws a window; returns the number of records that were walked.
    fn window(&mut self, window: [i32; 4]) -> Result<u64> {
        let [width, height] = extent(window);
        let tiles = [width.div_ceil(TILE_SIDE), height.div_ceil(TILE_SIDE)];
        let mask_words = mask_words(self.plan.slots.into());

        let (context, buffers) = (&self.context, &mut self.renderer.resident.buffers);
        buffers.make(context, BufferName::Uniform, size_of::<FrameUniform>() as u64)?;
        buffers.make(context, BufferName::Chunk, size_of::<Chunk>() as u64)?;
        let slots = u64::from(self.plan.slots.next_multiple_of(BATCH));
        buffers.make(context, BufferName::Voxels, slots * size_of::<VisitedVoxel>() as u64)?;
        buffers.make(context, BufferName::Splats, slots * size_of::<Splat>() as u64)?;
        match self.renderer.resident.current {
            Compositor::Tiles => {
                let words = tiles.map(u64::from).iter().product::<u64>() * mask_words;
                buffers.make(context, BufferName::Masks, 4 * words)?;
                buffers.make(context, BufferName::Boxes, slots * BOX_BYTES)?;
                buffers.make(context, BufferName::Pixels, 16 * u64::from(width) * u64::from(height))?;
            }
            Compositor::Quads(target) => buffers.make_target(context, [width, height], target.format())?,
        }

        let (mut records, mut is_first, mut slice) = (0, true, 0);
        for part in self.parts {
            let Part { shot, list, .. } = part;
            let uniform = self.uniform(shot, window);
            let uniform_buffer = self.renderer.resident.buffers.get(BufferName::Uniform);
            self.context.write(uniform_buffer, 0, bytemuck::bytes_of(&uniform))?;
            let half_width = uniform.half_width.map(f64::from);
            let slow = shot.order.slow.index();
            let has_near = shot.view.has_near(shot.lane.dims);
            let view = WindowView { view: &shot.view, half_width, window, clip: shot.clip, slow };
            for (index, slab) in list.slabs.iter().enumerate() {
                let mut chunks = Chunks::new(list, slab, &view, self.plan.slots);
                if chunks.chunks.is_empty() {
                    continue;
                }
                for (chunk, _) in &mut chunks.chunks {
                    chunk.index = u32::try_from(self.stats.chunks % COUNTERS).expect("below the number of counters");
                    chunk.is_first = std::mem::take(&mut is_first).into();
                    chunk.from_slice = std::mem::replace(&mut slice, chunk.to_slice);
                    self.stats.chunks += 1;
                    records += u64::from(chunk.slot_count);
                }
                self.upload(part, index, &chunks)?;
                for &(chunk, block_count) in &chunks.chunks {
                    self.chunk(chunk, block_count, tiles, has_near)?;
                    let first = chunk.first_block as usize;
                    let blocks = &chunks.blocks[first..first + block_count as usize];
                    self.call_probe(&uniform, slab, chunk, blocks);
                }
            }
        }
        if is_first {
            // No voxel projects into the window: a chunk without records clears its pixels.
            self.chunk(Chunk { is_first: 1, ..Chunk::zeroed() }, 0, tiles, false)?;
        }
        self.stats.windows += 1;
        Ok(records)
    }

    /// Returns the uniform of a part for a window.
    fn uniform(&self, shot: &Shot, window: [i32; 4]) -> FrameUniform {
        let looks = self.renderer.looks();
        let mut uniform = FrameUniform::new(shot, window, self.blend);
        uniform.termination = self.settings.termination();
        uniform.uses_magnitude = looks.on_device.uses_magnitude.into();
        uniform.mask_words = u32::try_from(mask_words(self.plan.slots.into())).expect("few words");
        uniform.scale_depths(looks.depth_factor(shot.view.mean_voxel));
        uniform
    }

    /// Begins a render pass for quads. It clears the target if the pass is the first of a window (`is_first`).
    fn begin_quads<'e>(&mut self, encoder: &'e mut CommandEncoder, is_first: bool) -> RenderPass<'e> {
        let start = Color { r: 0.0, g: 0.0, b: 0.0, a: self.blend.initial_alpha().into() };
        let load = if is_first { LoadOp::Clear(start) } else { LoadOp::Load };
        let view = self.renderer.resident.buffers.target().create_view(&Default::default());
        let timer = self.renderer.resident.timer.as_mut().filter(|_| self.is_timed);
        render_pass(encoder, &view, load, timer.and_then(|timer| timer.render(Pass::Composite)))
    }

    /// Copies slab `index` of a part, its lines and the blocks of `chunks` to the device.
    fn upload(&mut self, part: &Part, index: usize, chunks: &Chunks) -> Result<()> {
        let start = Instant::now();
        self.upload_slab(part, index)?;
        let slab = &part.list.slabs[index];
        let (context, renderer) = (&self.context, &mut *self.renderer);
        let on_device = renderer.resident.slabs.last_mut().expect("the slab is on the device");
        self.stats.list_bytes += on_device.list_lines(context, part.list.key, &slab.lines)?;
        let block_bytes = size_of::<LineBlock>() * slab.blocks.len();
        let blocks = renderer.resident.buffers.make(context, BufferName::Blocks, block_bytes as u64)?;
        context.write(&blocks, 0, bytemuck::cast_slice(&chunks.blocks))?;
        self.stats.upload_ms += start.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    /// Calls the probe, if there is one, with the buffers on the device after a chunk, which consists of `blocks`.
    fn call_probe(&mut self, uniform: &FrameUniform, slab: &Slab, chunk: Chunk, blocks: &[LineBlock]) {
        let (Some(probe), renderer) = (&mut self.probe, &*self.renderer) else { return };
        let looks = &renderer.looks().on_device;
        let buffer = |name: BufferName| renderer.resident.buffers.get(name);
        let has_tiles = renderer.resident.current == Compositor::Tiles;
        probe(&Probe {
            device: &self.context.device,
            queue: &self.context.queue,
            uniform,
            chunk,
            blocks,
            lines: &slab.lines,
            slab: &renderer.resident.slabs.last().expect("a slab is on the device").buffers,
            looks: [&looks.by_value, &looks.by_pair],
            voxels: buffer(BufferName::Voxels),
            splats: buffer(BufferName::Splats),
            boxes: has_tiles.then(|| buffer(BufferName::Boxes)),
            masks: has_tiles.then(|| buffer(BufferName::Masks)),
            pixels: has_tiles.then(|| buffer(BufferName::Pixels)),
        });
    }

    /// Iterates over the lanes that this frame draws, each as one of the parts that draw it.
    fn lanes(&self) -> impl Iterator<Item = &Part<'_>> {
        let is_first =
            |&(index, part): &(usize, &Part)| self.parts[..index].iter().all(|other| other.level != part.level);
        self.parts.iter().enumerate().filter(is_first).map(|(_, part)| part)
    }

    /// Frees slabs on the device that this frame does not use: parts of lanes, and other lanes for which there is no room
    /// beside those of this frame. If not even those fit together, they take turns: then all are freed.
    fn make_room(&mut self) {
        let room = self.plan.room.bytes;
        let need: u64 = self.lanes().map(Part::device_bytes).sum();
        let takes_turns = need > room || self.parts.iter().any(|part| part.list.slabs.len() > 1);
        let parts = self.parts;
        let is_used = |slab: &SlabBuffers| parts.iter().any(|part| slab.is_lane(part.level, part.shot.lane.axis));
        let slabs = &mut self.renderer.resident.slabs;
        slabs.retain(|slab| slab.is_whole && !takes_turns);
        // The lanes of this frame come last, so they are not removed.
        slabs.sort_by_key(is_used);
        let others =
            |slabs: &[SlabBuffers]| slabs.iter().filter(|slab| !is_used(slab)).map(SlabBuffers::bytes).sum::<u64>();
        while others(slabs) > 0 && others(slabs) + need > room {
            slabs.remove(0);
        }
    }

    /// Copies slab `index` of a part to the device, unless it is a whole lane, and there already. It is then the last slab.
    fn upload_slab(&mut self, part: &Part, index: usize) -> Result<()> {
        let (context, lane, slabs) = (&self.context, &part.shot.lane, &mut self.renderer.resident.slabs);
        let is_whole = part.list.slabs.len() == 1;
        if let Some(place) = slabs.iter().position(|slab| is_whole && slab.is_lane(part.level, lane.axis)) {
            slabs[place..].rotate_left(1);
            return Ok(());
        }
        let have: u64 = slabs.iter().map(SlabBuffers::bytes).sum();
        if !is_whole {
            // What is not in memory cannot be copied again and again.
            lane.at_hand()?;
        }
        if !is_whole || have > 0 && have + part.device_bytes() > self.plan.room.bytes {
            // What was drawn before is freed, and waiting lets the device finish with it, so that there is room.
            slabs.clear();
            context.wait()?;
        }
        let slab = &part.list.slabs[index];
        let buffers = SlabBuffers::new(context, part.level, lane, is_whole, slab.sizes)?;
        self.stats.upload_bytes += buffers.upload(context, lane, &slab.tiles)?;
        slabs.push(buffers);
        Ok(())
    }

    /// Runs all stages for a chunk of the slab on the device; `window_tiles`: columns and rows of tiles; `has_near`: whether
    /// voxels may be near the eye.
    fn chunk(&mut self, chunk: Chunk, block_count: u32, window_tiles: [u32; 2], has_near: bool) -> Result<()> {
        let (context, pipelines, blend) = (self.context.clone(), self.pipelines.clone(), self.blend);
        let device = &context.device;
        let GpuRenderer { resident: Resident { buffers, slabs, timer, current, .. }, looks, .. } = &mut *self.renderer;
        let looks = &looks.as_ref().expect("a frame begins with its tables").on_device;
        let buffer = |name: BufferName| buffers.get(name);
        let [uniform, chunk_buffer] = [BufferName::Uniform, BufferName::Chunk].map(buffer);
        let [voxels, splats] = [BufferName::Voxels, BufferName::Splats].map(buffer);
        context.write(chunk_buffer, 0, bytemuck::bytes_of(&chunk))?;

        // Each stage with its buffers, in the order of its shader, and its number of workgroups.
        let mut stages = Vec::new();
        let batches = chunk.slot_count.div_ceil(BATCH);
        if batches > 0 {
            let slab = slabs.last().expect("a slab is on the device");
            let [tiles, line_ends, steps, values, normals, magnitudes, coverages] = &slab.buffers;
            let [blocks, drawn] = [BufferName::Blocks, BufferName::Drawn].map(buffer);
            let lines = slab.lines();
            let walk = vec![uniform, chunk_buffer, tiles, line_ends, steps, coverages, lines, blocks, voxels];
            let [by_value, by_pair] = [&looks.by_value, &looks.by_pair];
            let project =
                vec![uniform, chunk_buffer, voxels, values, normals, magnitudes, by_value, by_pair, splats, drawn];
            stages.push((Pass::Walk, &pipelines.walk, walk, [block_count, 1]));
            stages.push((Pass::Project, pipelines.project(device, blend, has_near), project, [batches, 1]));
        }
        let mut encoder = context.encoder("chunk");
        if *current == Compositor::Tiles {
            let [boxes, masks, pixels] = [BufferName::Boxes, BufferName::Masks, BufferName::Pixels].map(buffer);
            encoder.clear_buffer(masks, 0, None);
            let tile = vec![uniform, chunk_buffer, splats, boxes, masks, pixels];
            stages.push((Pass::Bin, &pipelines.bin, vec![uniform, splats, boxes, masks], [batches, 1]));
            stages.push((Pass::Composite, pipelines.tile(device, blend, has_near), tile, window_tiles));
        }
        for (pass, pipeline, buffers, [x, y]) in stages {
            let resources = buffers.into_iter().map(Buffer::as_entire_binding);
            let group = bind(device, &pipeline.get_bind_group_layout(0), resources);
            let timestamp_writes = timer.as_mut().filter(|_| self.is_timed).and_then(|timer| timer.compute(pass));
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor { label: None, timestamp_writes });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(x, y, 1);
        }
        if let Compositor::Quads(target) = *current {
            let pipeline = pipelines.splat(device, blend, target, has_near);
            let resources = [uniform, splats].map(Buffer::as_entire_binding);
            let group = bind(device, &pipeline.get_bind_group_layout(0), resources);
            let mut pass = self.begin_quads(&mut encoder, chunk.is_first == 1);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..6 * chunk.slot_count, 0..1);
        }
        context.submit([encoder.finish()])?;
        // A device in software takes seconds for what it is given at once; a card would wait for its next work.
        if self.settings.stop.is_some() && self.renderer.resident.is_software {
            context.wait()?;
        }
        self.settings.check_stop()
    }
}
