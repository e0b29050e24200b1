//! Draws a frame: all its windows, the slabs of each window, the chunks of each slab, and the stages of each chunk.
//!
//! In: a renderer whose tables and line list are ready. Out: a picture. Buffers are kept for the next frame.

use std::sync::Arc;
use std::time::Instant;

use wgpu::{BindGroup, Buffer, Color, CommandEncoder, ComputePassDescriptor, LoadOp, RenderPass};

use super::budget::{MemoryPlan, mask_words};
use super::buffers::BufferName;
use super::chunks::{Chunks, WindowView};
use super::context::Context;
use super::layout::{BATCH, Chunk, FrameUniform, LineBlock, Splat, TILE, VisitedVoxel};
use super::lines::{LINE_BYTES, LineList, Slab, line_count};
use super::probe::{Probe, ProbeCallback};
use super::read_back::{self, COUNTERS};
use super::resolve::{self, RenderTarget};
use super::slab_buffers::SlabBuffers;
use super::stages::{BlendMode, ComputeStage, Pipelines, render_pass};
use super::timing::Pass;
use super::{Compositor, GpuRenderer, GpuStats, QuadFormat};
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

/// A frame that is being drawn.
struct FrameDraw<'d, 'a, 'p> {
    renderer: &'d mut GpuRenderer<'a>,
    context: Arc<Context>,
    pipelines: Arc<Pipelines>,
    list: Arc<LineList>,
    shot: &'d Shot<'a>,
    plan: MemoryPlan,
    termination: f32,
    blend: BlendMode,
    is_timed: bool,
    stats: &'d mut GpuStats,
    probe: Option<ProbeCallback<'p>>,
}

/// Draws a frame into `output`.
pub(super) fn frame<'a>(
    renderer: &mut GpuRenderer<'a>,
    shot: &Shot<'a>,
    settings: &Settings,
    plan: MemoryPlan,
    output: FrameOutput,
    stats: &mut GpuStats,
) -> Result<()> {
    let context = renderer.context.clone();
    let mut draw = FrameDraw {
        context: context.clone(),
        pipelines: renderer.pipelines.clone(),
        list: renderer.list().list.clone(),
        renderer,
        shot,
        plan,
        termination: settings.termination(),
        blend: BlendMode::new(settings.mode, settings.sense),
        is_timed: matches!(output, FrameOutput::Frame(..)),
        stats,
        probe: None,
    };
    draw.stats.slabs = draw.list.slabs.len();
    draw.make_room();
    let drawn = draw.renderer.buffers.make(&context, BufferName::Drawn, 4 * COUNTERS)?;
    let mut encoder = context.encoder("begin");
    encoder.clear_buffer(&drawn, 0, None);
    context.submit([encoder.finish()])?;

    let [columns, rows] = settings.size.map(u32::cast_signed);
    let (step, height) = (plan.window_rows as usize, plan.window_rows.cast_signed());
    let windows = (0..rows).step_by(step).map(|y0| [0, y0, columns, rows.min(y0.saturating_add(height))]);
    let mut records = 0;
    match output {
        FrameOutput::Frame(frame, probe) => {
            draw.probe = probe;
            let parts = frame.pixels_mut().chunks_mut(step * 4 * settings.size[0] as usize);
            for (window, out) in windows.zip(parts) {
                records += draw.window(window)?;
                read_back::window(draw.renderer, extent(window), out, draw.stats)?;
            }
            let drawn = read_back::drawn(&mut draw.renderer.buffers, &context)?;
            (draw.stats.splats_drawn, draw.stats.splats_skipped) = (drawn, records - drawn.min(records));
        }
        FrameOutput::Texture(target) => {
            for window in windows {
                draw.window(window)?;
                resolve::window(draw.renderer, window, target)?;
            }
        }
    }
    Ok(())
}

/// Returns the columns and rows of a window.
fn extent([x0, y0, x1, y1]: [i32; 4]) -> [u32; 2] {
    [x1 - x0, y1 - y0].map(i32::cast_unsigned)
}

/// The bind groups for the stages that all chunks of a slab use.
struct ChunkBindings {
    walk: BindGroup,
    project: BindGroup,
    compositor: CompositorBindings,
}

enum CompositorBindings {
    Tiles { bin: BindGroup, tile: BindGroup },
    Quads { target: QuadFormat, group: BindGroup },
}

impl FrameDraw<'_, '_, '_> {
    /// Draws a window; returns the number of records that were walked.
    fn window(&mut self, window: [i32; 4]) -> Result<u64> {
        let [width, height] = extent(window);
        let tiles = [width.div_ceil(TILE), height.div_ceil(TILE)];
        let mut uniform = FrameUniform::new(self.shot, window);
        uniform.termination = self.termination;
        uniform.initial_alpha = self.blend.initial_alpha();
        uniform.uses_magnitude = self.renderer.looks().uses_magnitude.into();
        uniform.mask_words = u32::try_from(mask_words(self.plan.slots.into())).expect("few words");

        let (context, buffers) = (&self.context, &mut self.renderer.buffers);
        let uniform_buffer = buffers.make(context, BufferName::Uniform, size_of::<FrameUniform>() as u64)?;
        context.write(&uniform_buffer, 0, bytemuck::bytes_of(&uniform))?;
        let slots = u64::from(self.plan.slots.next_multiple_of(BATCH));
        buffers.make(context, BufferName::Voxels, slots * size_of::<VisitedVoxel>() as u64)?;
        buffers.make(context, BufferName::Splats, slots * size_of::<Splat>() as u64)?;
        match self.renderer.current {
            Compositor::Tiles => {
                let words = tiles.map(u64::from).iter().product::<u64>() * u64::from(uniform.mask_words);
                buffers.make(context, BufferName::Masks, 4 * words)?;
                buffers.make(context, BufferName::Pixels, 16 * u64::from(width) * u64::from(height))?;
            }
            Compositor::Quads(target) => buffers.make_target(context, [width, height], target.format())?,
        }

        let half_width = uniform.half_width.map(f64::from);
        let view = WindowView { view: &self.shot.view, half_width, window, crop: self.shot.crop };
        let list = self.list.clone();
        let (mut records, mut is_first) = (0, true);
        for (index, slab) in list.slabs.iter().enumerate() {
            let mut chunks = Chunks::new(&list, slab, &view, self.plan.slots);
            if chunks.chunks.is_empty() {
                continue;
            }
            for (chunk, _) in &mut chunks.chunks {
                chunk.index = u32::try_from(self.stats.chunks % COUNTERS).expect("below the number of counters");
                chunk.is_first = std::mem::take(&mut is_first).into();
                self.stats.chunks += 1;
                records += u64::from(chunk.slot_count);
            }
            let bindings = self.bind(index, &chunks)?;
            for index in 0..chunks.chunks.len() {
                self.chunk(&bindings, &chunks, index, tiles)?;
                self.call_probe(&uniform, slab, &chunks, index);
            }
        }
        if is_first {
            self.clear([width, height])?;
        }
        self.stats.windows += 1;
        Ok(records)
    }

    /// Clears the pixels of a window into which no voxel projects.
    fn clear(&mut self, [width, height]: [u32; 2]) -> Result<()> {
        if self.renderer.current == Compositor::Tiles {
            let row = vec![[0.0, 0.0, 0.0, self.blend.initial_alpha()]; width as usize];
            let bytes: &[u8] = bytemuck::cast_slice(&row);
            let pixels = self.renderer.buffers.get(BufferName::Pixels);
            return (0..height.into()).try_for_each(|y: u64| self.context.write(pixels, y * bytes.len() as u64, bytes));
        }
        let mut encoder = self.context.encoder("clear");
        drop(self.begin_quads(&mut encoder, true));
        self.context.submit([encoder.finish()])
    }

    /// Begins a render pass for quads. It clears the target if the pass is the first of a window (`is_first`).
    fn begin_quads<'e>(&mut self, encoder: &'e mut CommandEncoder, is_first: bool) -> RenderPass<'e> {
        let start = Color { r: 0.0, g: 0.0, b: 0.0, a: self.blend.initial_alpha().into() };
        let load = if is_first { LoadOp::Clear(start) } else { LoadOp::Load };
        let view = self.renderer.buffers.target().create_view(&Default::default());
        let timer = self.renderer.timer.as_mut().filter(|_| self.is_timed);
        render_pass(encoder, &view, load, timer.and_then(|timer| timer.render(Pass::Composite)))
    }

    /// Copies slab `index` and the blocks of `chunks` to the device, and binds them for all stages.
    fn bind(&mut self, index: usize, chunks: &Chunks) -> Result<ChunkBindings> {
        let start = Instant::now();
        let [tiles, line_ends, steps, values, normals, magnitudes] = self.upload_slab(index)?.buffers.clone();
        let slab = &self.list.slabs[index];
        let (context, buffers) = (&self.context, &mut self.renderer.buffers);
        let lines = buffers.make(context, BufferName::Lines, 4 * slab.lines.len() as u64)?;
        let cached = self.renderer.list.as_mut().expect("prepared before");
        if cached.on_device != Some(index) {
            context.fill(&lines, bytemuck::cast_slice(&slab.lines))?;
            self.stats.list_bytes += 4 * slab.lines.len() as u64;
            cached.on_device = Some(index);
        }
        let blocks = buffers.make(context, BufferName::Blocks, (size_of::<LineBlock>() * slab.blocks.len()) as u64)?;
        context.write(&blocks, 0, bytemuck::cast_slice(&chunks.blocks))?;
        let stride = self.chunk_stride();
        let mut bytes = vec![0u8; stride * chunks.chunks.len()];
        for ((chunk, _), bytes) in chunks.chunks.iter().zip(bytes.chunks_exact_mut(stride)) {
            bytes[..size_of::<Chunk>()].copy_from_slice(bytemuck::bytes_of(chunk));
        }
        let chunk_buffer = self.renderer.buffers.make(context, BufferName::Chunks, bytes.len() as u64)?;
        context.write(&chunk_buffer, 0, &bytes)?;
        self.stats.upload_ms += start.elapsed().as_secs_f64() * 1e3;

        let (device, looks, pipelines) = (&context.device, self.renderer.looks(), &self.pipelines);
        let buffer = |name: BufferName| self.renderer.buffers.get(name);
        let [uniform, voxels, splats] = [BufferName::Uniform, BufferName::Voxels, BufferName::Splats].map(buffer);
        let bind = |stage: &ComputeStage, buffers: &[&Buffer]| stage.bind(device, uniform, &chunk_buffer, buffers);
        let (by_value, by_pair, drawn) = (&looks.by_value, &looks.by_pair, buffer(BufferName::Drawn));
        let walk = bind(&pipelines.walk, &[&tiles, &line_ends, &steps, &lines, &blocks, voxels]);
        let project = [voxels, &values, &normals, &magnitudes, by_value, by_pair, splats, drawn];
        let project = bind(&pipelines.project, &project);
        let compositor = match self.renderer.current {
            Compositor::Tiles => {
                let [masks, pixels] = [BufferName::Masks, BufferName::Pixels].map(buffer);
                let bin = bind(&pipelines.bin, &[splats, masks]);
                let tile = bind(pipelines.tile(device, self.blend), &[splats, masks, pixels]);
                CompositorBindings::Tiles { bin, tile }
            }
            Compositor::Quads(target) => {
                let pipeline = pipelines.splat(device, self.blend, target);
                CompositorBindings::Quads { target, group: Pipelines::bind_splat(device, pipeline, [uniform, splats]) }
            }
        };
        Ok(ChunkBindings { walk, project, compositor })
    }

    /// Calls the probe, if there is one, with the buffers on the device after chunk `index` of a slab.
    fn call_probe(&mut self, uniform: &FrameUniform, slab: &Slab, chunks: &Chunks, index: usize) {
        let (Some(probe), renderer) = (&mut self.probe, &*self.renderer) else { return };
        let (chunk, count) = chunks.chunks[index];
        let first = chunk.first_block as usize;
        let looks = renderer.looks();
        let slab_buffers = renderer.residents.last().or(renderer.streamed.as_ref());
        let buffer = |name: BufferName| renderer.buffers.get(name);
        let has_tiles = renderer.current == Compositor::Tiles;
        probe(&Probe {
            device: &self.context.device,
            queue: &self.context.queue,
            uniform,
            chunk,
            blocks: &chunks.blocks[first..first + count as usize],
            lines: &slab.lines,
            slab: &slab_buffers.expect("a slab is on the device").buffers,
            looks: [&looks.by_value, &looks.by_pair],
            voxels: buffer(BufferName::Voxels),
            splats: buffer(BufferName::Splats),
            masks: has_tiles.then(|| buffer(BufferName::Masks)),
            pixels: has_tiles.then(|| buffer(BufferName::Pixels)),
        });
    }

    /// Frees lanes of other axes on the device if they leave no room for the lane of this frame.
    fn make_room(&mut self) {
        let (axis, room) = (self.shot.lane.axis, self.plan.room.bytes);
        let slab = self.renderer.list().sizes.first().map_or(0, |sizes| sizes.iter().sum());
        let need: u64 = slab + LINE_BYTES * line_count(&self.shot.lane);
        let residents = &mut self.renderer.residents;
        self.renderer.streamed = None;
        if self.list.slabs.len() > 1 {
            residents.clear();
        }
        // The lane of this frame comes last, so it is not removed.
        residents.sort_by_key(|lane| lane.axis == axis);
        let other_lanes = |residents: &[SlabBuffers]| -> u64 {
            residents.iter().filter(|lane| lane.axis != axis).map(SlabBuffers::bytes).sum()
        };
        while other_lanes(residents) > 0 && other_lanes(residents) + need > room {
            residents.remove(0);
        }
    }

    /// Returns the buffers of slab `index`: those on the device if it is the whole lane, else newly made ones.
    fn upload_slab(&mut self, index: usize) -> Result<&SlabBuffers> {
        let (context, lane, renderer) = (&self.context, &self.shot.lane, &mut *self.renderer);
        let is_whole = self.list.slabs.len() == 1;
        if is_whole && renderer.residents.last().is_some_and(|last| last.axis == lane.axis) {
            return Ok(renderer.residents.last().expect("it is there"));
        }
        if !is_whole {
            // The previous slab is freed, and waiting lets the device finish with it, so that only one exists.
            renderer.streamed = None;
            context.wait()?;
        }
        let buffers = SlabBuffers::new(context, lane.axis, renderer.list().sizes[index])?;
        self.stats.upload_bytes += buffers.upload(context, lane, &self.list.slabs[index].tiles)?;
        if !is_whole {
            return Ok(renderer.streamed.insert(buffers));
        }
        renderer.residents.push(buffers);
        Ok(renderer.residents.last().expect("it was just put there"))
    }

    /// Returns how many bytes the chunks in the chunk buffer are apart.
    fn chunk_stride(&self) -> usize {
        let alignment = self.context.limits.min_uniform_buffer_offset_alignment as usize;
        size_of::<Chunk>().next_multiple_of(alignment.max(1))
    }

    /// Runs all stages for chunk `index` of a slab; `tiles`: columns and rows of the window's tiles.
    fn chunk(&mut self, bindings: &ChunkBindings, chunks: &Chunks, index: usize, tiles: [u32; 2]) -> Result<()> {
        let (context, pipelines, blend) = (self.context.clone(), self.pipelines.clone(), self.blend);
        let (chunk, blocks) = chunks.chunks[index];
        let offset = u32::try_from(index * self.chunk_stride()).expect("within a binding");
        let batches = chunk.slot_count.div_ceil(BATCH);
        let mut encoder = context.encoder("chunk");
        let mut run =
            |encoder: &mut CommandEncoder, pass, stage: &ComputeStage, group: &BindGroup, [x, y]: [u32; 2]| {
                let timer = self.renderer.timer.as_mut().filter(|_| self.is_timed);
                let timestamp_writes = timer.and_then(|timer| timer.compute(pass));
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor { label: None, timestamp_writes });
                pass.set_pipeline(&stage.pipeline);
                pass.set_bind_group(0, group, &[offset]);
                pass.dispatch_workgroups(x, y, 1);
            };
        run(&mut encoder, Pass::Walk, &pipelines.walk, &bindings.walk, [blocks, 1]);
        run(&mut encoder, Pass::Project, &pipelines.project, &bindings.project, [batches, 1]);
        match &bindings.compositor {
            CompositorBindings::Tiles { bin, tile } => {
                encoder.clear_buffer(self.renderer.buffers.get(BufferName::Masks), 0, None);
                run(&mut encoder, Pass::Bin, &pipelines.bin, bin, [batches, 1]);
                run(&mut encoder, Pass::Composite, pipelines.tile(&context.device, blend), tile, tiles);
            }
            CompositorBindings::Quads { target, group } => {
                let mut pass = self.begin_quads(&mut encoder, chunk.is_first == 1);
                pass.set_pipeline(pipelines.splat(&context.device, blend, *target));
                pass.set_bind_group(0, group, &[]);
                pass.draw(0..4, 0..chunk.slot_count);
            }
        }
        context.submit([encoder.finish()])
    }
}
