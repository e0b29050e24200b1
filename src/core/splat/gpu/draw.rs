//! Drawing a frame: windows, slabs, chunks, and the stages of each.
//!
//! In: a renderer that has its tables and its line list. Out: a frame. Buffers are kept for the next.

use std::sync::Arc;
use std::time::Instant;

use wgpu::{
    BindGroup, Buffer, Color, CommandEncoder, CommandEncoderDescriptor, ComputePassDescriptor, LoadOp, Operations,
    RenderPassColorAttachment, RenderPassDescriptor, StoreOp,
};

use super::budget::{Plan, mask_words};
use super::chunks::{Chunks, Sight};
use super::context::Context;
use super::layout;
use super::layout::{BATCH, Block, Chunk, FastOrder, Splat, TILE, Voxel};
use super::lines::{LINE_BYTES, LineList, Slab, line_count};
use super::probe::{Look, Probe};
use super::read_back;
use super::read_back::COUNTERS;
use super::residence::Residence;
use super::resolve;
use super::resolve::Canvas;
use super::scratch::Name;
use super::stages::{Blend, Stage, Stages, one_chunk};
use super::timing::Pass;
use super::{Compositor, Renderer, Stats, Target};
use crate::error::Result;
use crate::splat::Settings;
use crate::splat::frame::Frame;
use crate::splat::setup::FrameSetup as Shot;

/// Where a picture goes.
pub(super) enum Output<'o> {
    /// Back to the processor.
    Frame(&'o mut Frame),
    /// Into a texture, without waiting for the device; nothing is timed or counted then.
    Canvas(&'o Canvas<'o>),
}

/// What all windows of a frame share.
struct Job<'j, 'a> {
    shot: &'j Shot<'a>,
    plan: Plan,
    stop: f32,
    blend: Blend,
    compositor: Compositor,
    list: Arc<LineList>,
    stages: Arc<Stages>,
    context: Arc<Context>,
    is_timed: bool,
}

/// Draws into `output`.
///
/// # Errors
/// If the device fails or has too little memory.
pub(super) fn frame<'a>(
    renderer: &mut Renderer<'a>,
    shot: &Shot<'a>,
    settings: &Settings,
    plan: Plan,
    output: Output,
    stats: &mut Stats,
    mut look: Option<Look>,
) -> Result<()> {
    let context = renderer.context.clone();
    let job = Job {
        shot,
        plan,
        stop: settings.termination(),
        blend: Blend::new(settings.mode, settings.sense),
        compositor: renderer.current,
        list: renderer.list.as_ref().expect("prepared before").list.clone(),
        stages: renderer.stages.clone(),
        context: context.clone(),
        is_timed: matches!(output, Output::Frame(_)),
    };
    stats.slabs = job.list.slabs.len();
    job.make_room(renderer);
    let drawn = renderer.scratch.make(&context, Name::Drawn, 4 * COUNTERS)?;
    let mut encoder = context.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("begin") });
    encoder.clear_buffer(&drawn, 0, None);
    context.submit([encoder.finish()])?;

    let [columns, rows] = settings.size.map(u32::cast_signed);
    let step = plan.window_rows.cast_signed();
    let windows =
        (0..rows).step_by(plan.window_rows as usize).map(|y0| [0, y0, columns, rows.min(y0.saturating_add(step))]);
    let mut records = 0;
    match output {
        Output::Frame(frame) => {
            let parts = frame.pixels_mut().chunks_mut(plan.window_rows as usize * 4 * settings.size[0] as usize);
            for (window, out) in windows.zip(parts) {
                records += job.window(renderer, window, stats, &mut look)?;
                read_back::window(renderer, extent(window), out, stats)?;
            }
            stats.splats_drawn = read_back::drawn(&mut renderer.scratch, &context)?;
            stats.splats_skipped = records - stats.splats_drawn.min(records);
        }
        Output::Canvas(canvas) => {
            for window in windows {
                job.window(renderer, window, stats, &mut look)?;
                resolve::window(renderer, window, canvas)?;
            }
        }
    }
    Ok(())
}

/// Columns and rows.
fn extent([x0, y0, x1, y1]: [i32; 4]) -> [u32; 2] {
    [x1 - x0, y1 - y0].map(i32::cast_unsigned)
}

/// What a slab's chunks bind.
struct Bound {
    walk: BindGroup,
    project: BindGroup,
    composite: Composite,
}

/// What the compositor binds.
enum Composite {
    Tiles { bin: BindGroup, tile: BindGroup, masks: Buffer },
    Quads { target: Target, group: BindGroup },
}

impl Job<'_, '_> {
    /// Draws a window; gives the records that were walked.
    fn window(
        &self,
        renderer: &mut Renderer,
        window: [i32; 4],
        stats: &mut Stats,
        look: &mut Option<Look>,
    ) -> Result<u64> {
        let Job { context, plan, shot, .. } = self;
        let [width, height] = extent(window);
        let looks = &renderer.looks.as_ref().expect("prepared before");
        let fast = FastOrder::new(shot.order.along[shot.order.fast.index()]);
        let mut uniform = layout::Shot::new(shot, window, fast);
        uniform.stop = self.stop;
        uniform.fourth = self.blend.fourth();
        uniform.by_magnitude = looks.by_magnitude.into();
        let words = u32::try_from(mask_words(plan.slots.into())).expect("few words");
        uniform.mask_words = words;
        let tiles = [width.div_ceil(TILE), height.div_ceil(TILE)];
        let half = uniform.half.map(f64::from);
        let sight = Sight { view: &shot.view, half, window, crop: shot.crop };

        let scratch = &mut renderer.scratch;
        let shot_buffer = scratch.make(context, Name::Shot, size_of::<layout::Shot>() as u64)?;
        context.write(&shot_buffer, 0, bytemuck::bytes_of(&uniform))?;
        let slots = u64::from(plan.slots.next_multiple_of(BATCH));
        scratch.make(context, Name::Voxels, slots * size_of::<Voxel>() as u64)?;
        scratch.make(context, Name::Splats, slots * size_of::<Splat>() as u64)?;
        match self.compositor {
            Compositor::Tiles => {
                let tiles = u64::from(tiles[0]) * u64::from(tiles[1]);
                scratch.make(context, Name::Masks, 4 * tiles * u64::from(words))?;
                scratch.make(context, Name::Pixels, 16 * u64::from(width) * u64::from(height))?;
            }
            Compositor::Quads(target) => {
                scratch.make_target(context, [width, height], target.format())?;
            }
        }

        let (mut records, mut is_first) = (0, true);
        for (index, slab) in self.list.slabs.iter().enumerate() {
            let mut chunks = Chunks::new(&self.list, slab, &sight, plan.slots);
            if chunks.chunks.is_empty() {
                continue;
            }
            for (chunk, _) in &mut chunks.chunks {
                let counter = u32::try_from(stats.chunks % COUNTERS).expect("below the number of counters");
                (chunk.index, chunk.is_first) = (counter, u32::from(std::mem::take(&mut is_first)));
                stats.chunks += 1;
                records += u64::from(chunk.slot_count);
            }
            let bound = self.bind(renderer, index, &chunks, stats)?;
            for (place, &(chunk, blocks)) in (0u32..).zip(&chunks.chunks) {
                let mut encoder =
                    context.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("chunk") });
                self.encode(renderer, &mut encoder, &bound, place, chunk, blocks, tiles);
                context.submit([encoder.finish()])?;
                if let Some(look) = look {
                    look(&self.probe(renderer, &uniform, slab, &chunks, place as usize));
                }
            }
        }
        if is_first {
            self.clear(renderer, [width, height])?;
        }
        stats.windows += 1;
        Ok(records)
    }

    /// Starts the pixels of a window that no voxel meets.
    fn clear(&self, renderer: &mut Renderer, [width, height]: [u32; 2]) -> Result<()> {
        let mut encoder =
            self.context.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("clear") });
        match self.compositor {
            Compositor::Tiles => {
                let row = vec![[0.0, 0.0, 0.0, self.blend.fourth()]; width as usize];
                let bytes: &[u8] = bytemuck::cast_slice(&row);
                for y in 0..u64::from(height) {
                    self.context.write(renderer.scratch.get(Name::Pixels), y * bytes.len() as u64, bytes)?;
                }
            }
            Compositor::Quads(_) => drop(self.begin_quads(renderer, &mut encoder, true)),
        }
        self.context.submit([encoder.finish()])
    }

    /// Begins a pass of quads.
    fn begin_quads<'e>(
        &self,
        renderer: &mut Renderer,
        encoder: &'e mut CommandEncoder,
        is_first: bool,
    ) -> wgpu::RenderPass<'e> {
        let start = Color { r: 0.0, g: 0.0, b: 0.0, a: self.blend.fourth().into() };
        let load = if is_first { LoadOp::Clear(start) } else { LoadOp::Load };
        let view = renderer.scratch.target().create_view(&Default::default());
        let timer = renderer.timer.as_mut().filter(|_| self.is_timed);
        encoder.begin_render_pass(&RenderPassDescriptor {
            label: Some("splat"),
            color_attachments: &[Some(RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: Operations { load, store: StoreOp::Store },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: timer.and_then(|timer| timer.render(Pass::Composite)),
            occlusion_query_set: None,
            multiview_mask: None,
        })
    }

    /// Brings a slab and its blocks to the device.
    fn bind(&self, renderer: &mut Renderer, index: usize, chunks: &Chunks, stats: &mut Stats) -> Result<Bound> {
        let Job { context, stages, .. } = self;
        let start = Instant::now();
        let slab = &self.list.slabs[index];
        let residence = self.reside(renderer, index, stats)?;
        let [tiles, line_ends, steps, values, normals, magnitudes] = residence.buffers.clone();
        let scratch = &mut renderer.scratch;
        let lines = scratch.make(context, Name::Lines, 4 * slab.lines.len() as u64)?;
        let listed = renderer.list.as_mut().expect("prepared before");
        if listed.on_device != Some(index) {
            for (piece, lines_of) in (0u64..).zip(slab.lines.chunks(1 << 18)) {
                context.write(&lines, piece << 20, bytemuck::cast_slice(lines_of))?;
            }
            stats.list_bytes += 4 * slab.lines.len() as u64;
            listed.on_device = Some(index);
        }
        let blocks = scratch.make(context, Name::Blocks, (size_of::<Block>() * slab.blocks.len()) as u64)?;
        context.write(&blocks, 0, bytemuck::cast_slice(&chunks.blocks))?;
        let stride = self.chunk_stride();
        let mut uniforms = vec![0u8; stride * chunks.chunks.len()];
        for ((chunk, _), bytes) in chunks.chunks.iter().zip(uniforms.chunks_exact_mut(stride)) {
            bytes[..size_of::<Chunk>()].copy_from_slice(bytemuck::bytes_of(chunk));
        }
        let chunk_buffer = scratch.make(context, Name::Chunks, uniforms.len() as u64)?;
        context.write(&chunk_buffer, 0, &uniforms)?;
        stats.upload_ms += start.elapsed().as_secs_f64() * 1e3;

        let buffer = |name: Name| scratch.get(name).as_entire_binding();
        let [shot, voxels, splats, drawn] = [Name::Shot, Name::Voxels, Name::Splats, Name::Drawn].map(buffer);
        let looks = &renderer.looks.as_ref().expect("prepared before");
        let chunk = one_chunk(&chunk_buffer);
        let device = &context.device;
        let walk = [&tiles, &line_ends, &steps, &lines, &blocks].map(|buffer| buffer.as_entire_binding());
        let [by_value, by_pair] = [&looks.by_value, &looks.by_pair].map(|buffer| buffer.as_entire_binding());
        let head = [shot.clone(), chunk.clone()];
        let walk = stages.walk.bind(device, &[&head[..], &walk, std::slice::from_ref(&voxels)].concat());
        let [values, normals, magnitudes] = [&values, &normals, &magnitudes].map(|buffer| buffer.as_entire_binding());
        let channels = [voxels, values, normals, magnitudes, by_value, by_pair];
        let project = stages.project.bind(device, &[&head[..], &channels, &[splats.clone(), drawn]].concat());
        let composite = match self.compositor {
            Compositor::Tiles => {
                let [masks, pixels] = [Name::Masks, Name::Pixels].map(buffer);
                let bin = stages.bin.bind(device, &[&head[..], &[splats.clone(), masks.clone()]].concat());
                let tile =
                    stages.tile(device, self.blend).bind(device, &[&head[..], &[splats, masks, pixels]].concat());
                Composite::Tiles { bin, tile, masks: scratch.get(Name::Masks).clone() }
            }
            Compositor::Quads(target) => Composite::Quads { target, group: stages.bind_splat(device, &[shot, splats]) },
        };
        Ok(Bound { walk, project, composite })
    }

    /// What is on the device after chunk `place` of a slab.
    fn probe<'p>(
        &'p self,
        renderer: &'p Renderer,
        shot: &'p layout::Shot,
        slab: &'p Slab,
        chunks: &'p Chunks,
        place: usize,
    ) -> Probe<'p> {
        let (chunk, count) = chunks.chunks[place];
        let first = chunk.first_block as usize;
        let looks = &renderer.looks.as_ref().expect("prepared before");
        let resident = renderer.residents.last().or(renderer.passage.as_ref());
        let buffer = |name: Name| renderer.scratch.get(name);
        let has_tiles = self.compositor == Compositor::Tiles;
        Probe {
            device: &self.context.device,
            queue: &self.context.queue,
            shot,
            chunk,
            blocks: &chunks.blocks[first..first + count as usize],
            lines: &slab.lines,
            slab: &resident.expect("a slab is on the device").buffers,
            looks: [&looks.by_value, &looks.by_pair],
            voxels: buffer(Name::Voxels),
            splats: buffer(Name::Splats),
            masks: has_tiles.then(|| buffer(Name::Masks)),
            pixels: has_tiles.then(|| buffer(Name::Pixels)),
        }
    }

    /// Lets lanes go that the frame has no room for beside its own.
    fn make_room(&self, renderer: &mut Renderer) {
        renderer.passage = None;
        let axis = self.shot.lane.axis;
        if self.list.slabs.len() > 1 {
            renderer.residents.clear();
        }
        // The frame's own lane is the last to go.
        renderer.residents.sort_by_key(|residence| residence.axis == axis);
        let listed = renderer.list.as_ref().expect("prepared before");
        let need = listed.sizes.first().map_or(0, |sizes| sizes.total()) + LINE_BYTES * line_count(&self.shot.lane);
        let others = |residents: &[Residence]| -> u64 {
            residents.iter().filter(|residence| residence.axis != axis).map(Residence::bytes).sum()
        };
        while others(&renderer.residents) > 0 && others(&renderer.residents) + need > self.plan.room.bytes {
            renderer.residents.remove(0);
        }
    }

    /// The buffers of slab `index`: kept if it is the whole lane, else filled anew.
    fn reside<'r>(&self, renderer: &'r mut Renderer, index: usize, stats: &mut Stats) -> Result<&'r Residence> {
        let Job { context, shot, .. } = self;
        let (lane, tiles) = (&shot.lane, &self.list.slabs[index].tiles);
        let sizes = renderer.list.as_ref().expect("prepared before").sizes[index];
        if self.list.slabs.len() == 1 {
            if renderer.residents.last().is_none_or(|last| last.axis != lane.axis) {
                let residence = Residence::new(context, lane.axis, sizes)?;
                stats.upload_bytes += residence.upload(context, lane, tiles)?;
                renderer.residents.push(residence);
            }
            return Ok(renderer.residents.last().expect("it is there"));
        }
        // The slab before goes once the device is done with it, so that there is never more than one.
        renderer.passage = None;
        context.wait()?;
        let residence = renderer.passage.insert(Residence::new(context, lane.axis, sizes)?);
        stats.upload_bytes += residence.upload(context, lane, tiles)?;
        Ok(residence)
    }

    fn chunk_stride(&self) -> usize {
        let alignment = self.context.limits.min_uniform_buffer_offset_alignment as usize;
        size_of::<Chunk>().next_multiple_of(alignment.max(1))
    }

    #[expect(clippy::too_many_arguments, reason = "one caller")]
    fn encode(
        &self,
        renderer: &mut Renderer,
        encoder: &mut CommandEncoder,
        bound: &Bound,
        place: u32,
        chunk: Chunk,
        blocks: u32,
        tiles: [u32; 2],
    ) {
        let (stages, device) = (&self.stages, &self.context.device);
        let offset = place * u32::try_from(self.chunk_stride()).expect("a small number");
        let batches = chunk.slot_count.div_ceil(BATCH);
        let mut run = |pass: Pass, stage: &Stage, group: &BindGroup, [x, y]: [u32; 2], encoder: &mut CommandEncoder| {
            let timer = renderer.timer.as_mut().filter(|_| self.is_timed);
            let timestamp_writes = timer.and_then(|timer| timer.compute(pass));
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor { label: None, timestamp_writes });
            pass.set_pipeline(&stage.pipeline);
            pass.set_bind_group(0, group, &[offset]);
            pass.dispatch_workgroups(x, y, 1);
        };
        run(Pass::Walk, &stages.walk, &bound.walk, [blocks, 1], encoder);
        run(Pass::Project, &stages.project, &bound.project, [batches, 1], encoder);
        match &bound.composite {
            Composite::Tiles { bin, tile, masks } => {
                encoder.clear_buffer(masks, 0, None);
                run(Pass::Bin, &stages.bin, bin, [batches, 1], encoder);
                run(Pass::Composite, stages.tile(device, self.blend), tile, tiles, encoder);
            }
            Composite::Quads { target, group } => {
                let mut pass = self.begin_quads(renderer, encoder, chunk.is_first == 1);
                pass.set_pipeline(stages.splat(device, self.blend, *target));
                pass.set_bind_group(0, group, &[]);
                pass.draw(0..4, 0..chunk.slot_count);
            }
        }
    }
}
