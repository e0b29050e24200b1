//! Drawing a frame: windows, slabs, chunks, and the stages of each.
//!
//! In: a renderer that has its tables and its line list. Out: a frame. Buffers are kept for the next.

use std::sync::Arc;
use std::time::Instant;

use half::f16;
use wgpu::{
    BindGroup, Buffer, BufferUsages, Color, CommandEncoder, CommandEncoderDescriptor, ComputePassDescriptor, Extent3d,
    LoadOp, Operations, Origin3d, RenderPassColorAttachment, RenderPassDescriptor, StoreOp, TexelCopyBufferInfo,
    TexelCopyBufferLayout, TexelCopyTextureInfo, Texture, TextureAspect, TextureDescriptor, TextureDimension,
    TextureFormat, TextureUsages,
};

use super::budget::{Plan, mask_words};
use super::chunks::{Chunks, Sight};
use super::context::Context;
use super::layout::{self, BATCH, Block, Chunk, FastOrder, Splat, TILE, Voxel};
use super::lines::{LineList, Slab};
use super::probe::{Look, Probe};
use super::residence::{Residence, Sizes};
use super::stages::{Blend, Stage, Stages, one_chunk};
use super::timing::Pass;
use super::{Compositor, Renderer, Stats, Target};
use crate::error::{Error, Result};
use crate::splat::Settings;
use crate::splat::composite::Finish;
use crate::splat::frame::Frame;
use crate::splat::shot::Shot;

/// Counters of drawn splats: chunks beyond them share one.
const COUNTERS: u64 = 4_096;

impl Target {
    fn format(self) -> TextureFormat {
        match self {
            Target::Float32 => TextureFormat::Rgba32Float,
            Target::Float16 => TextureFormat::Rgba16Float,
            Target::Unorm8 => TextureFormat::Rgba8Unorm,
        }
    }

    fn pixel_bytes(self) -> u32 {
        match self {
            Target::Float32 => 16,
            Target::Float16 => 8,
            Target::Unorm8 => 4,
        }
    }

    /// Where it stands among the pipelines.
    fn place(self) -> usize {
        match self {
            Target::Float32 => 0,
            Target::Float16 => 1,
            Target::Unorm8 => 2,
        }
    }

    fn decode(self, bytes: &[u8]) -> [f32; 4] {
        let float = |at: usize| bytes[4 * at..].first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
        let half = |at: usize| bytes[2 * at..].first_chunk().map_or(0.0, |bytes| f16::from_le_bytes(*bytes).to_f32());
        match self {
            Target::Float32 => std::array::from_fn(float),
            Target::Float16 => std::array::from_fn(half),
            Target::Unorm8 => std::array::from_fn(|at| f32::from(bytes[at]) / 255.0),
        }
    }
}

/// Buffers of the stages.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    buffers: [Option<Buffer>; 11],
    target: Option<Texture>,
}

/// Which buffer.
#[derive(Debug, Clone, Copy)]
enum Name {
    Shot,
    Chunks,
    Lines,
    Blocks,
    Voxels,
    Splats,
    Masks,
    Pixels,
    ReadBack,
    Drawn,
    DrawnBack,
}

impl Scratch {
    /// The buffer `name` of at least `bytes` bytes; a new one if the one at hand is too small, or far too large.
    fn buffer(&mut self, context: &Context, name: Name, bytes: u64) -> Result<Buffer> {
        let slot = &mut self.buffers[name as usize];
        if let Some(buffer) = slot.as_ref().filter(|buffer| (bytes..=2 * bytes + 65_536).contains(&buffer.size())) {
            return Ok(buffer.clone());
        }
        let usage = match name {
            Name::Shot | Name::Chunks => BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            Name::ReadBack | Name::DrawnBack => BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            _ => BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
        };
        *slot = None;
        let buffer = context.buffer(&format!("{name:?}"), bytes, usage)?;
        Ok(slot.insert(buffer).clone())
    }

    fn target(&mut self, context: &Context, size: [u32; 2], format: TextureFormat) -> Result<Texture> {
        let [width, height] = size;
        let have = context.limits.max_texture_dimension_2d;
        if width.max(height) > have {
            let what = "a side of the picture in pixels for --compositor quads (take tiles)".into();
            return Err(Error::Limit { what, need: width.max(height).into(), have: have.into() });
        }
        if let Some(target) = &self.target
            && (target.width(), target.height(), target.format()) == (width, height, format)
        {
            return Ok(target.clone());
        }
        let target = context.device.create_texture(&TextureDescriptor {
            label: Some("target"),
            size: Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        Ok(self.target.insert(target).clone())
    }

    /// Bytes of all of them.
    pub(super) fn bytes(&self) -> u64 {
        let target = self.target.as_ref().map_or(0, |target| {
            let pixel = u64::from(target.format().block_copy_size(None).unwrap_or(16));
            u64::from(target.width()) * u64::from(target.height()) * pixel
        });
        target + self.buffers.iter().flatten().map(Buffer::size).sum::<u64>()
    }
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
}

/// Draws.
///
/// # Errors
/// If the device fails or has too little memory.
pub(super) fn frame<'a>(
    renderer: &mut Renderer<'a>,
    shot: &Shot<'a>,
    settings: &Settings,
    plan: Plan,
    stats: &mut Stats,
    mut look: Option<Look>,
) -> Result<Frame> {
    let context = renderer.context.clone();
    let job = Job {
        shot,
        plan,
        stop: settings.termination(),
        blend: Blend::new(settings.mode, settings.sense),
        compositor: renderer.compositor(),
        list: renderer.list.as_ref().expect("prepared before").list.clone(),
        stages: renderer.stages.clone(),
        context: context.clone(),
    };
    stats.slabs = job.list.slabs.len();
    let drawn = renderer.scratch.buffer(&context, Name::Drawn, 4 * COUNTERS)?;
    let mut encoder = context.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("begin") });
    encoder.clear_buffer(&drawn, 0, None);
    context.submit([encoder.finish()])?;

    let mut frame = Frame::transparent(settings.size)?;
    let [columns, rows] = settings.size.map(u32::cast_signed);
    let row_len = 4 * settings.size[0] as usize;
    let mut records = 0;
    let step = plan.window_rows as usize;
    for (y0, out) in (0..rows).step_by(step).zip(frame.pixels_mut().chunks_mut(step * row_len)) {
        let window = [0, y0, columns, rows.min(y0.saturating_add(plan.window_rows.cast_signed()))];
        records += job.window(renderer, window, out, stats, &mut look)?;
        stats.windows += 1;
    }
    stats.splats_drawn = read_drawn(&mut renderer.scratch, &context)?;
    stats.splats_skipped = records - stats.splats_drawn.min(records);
    Ok(frame)
}

fn read_drawn(scratch: &mut Scratch, context: &Context) -> Result<u64> {
    let drawn = scratch.buffer(context, Name::Drawn, 4 * COUNTERS)?;
    let back = scratch.buffer(context, Name::DrawnBack, 4 * COUNTERS)?;
    let mut encoder = context.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("end") });
    encoder.copy_buffer_to_buffer(&drawn, 0, &back, 0, Some(4 * COUNTERS));
    context.submit([encoder.finish()])?;
    let sum = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|count| u64::from(u32::from_le_bytes(*count))).sum();
    context.read(&back, 4 * COUNTERS, sum)
}

/// What a slab's chunks bind.
struct Bound {
    walk: BindGroup,
    project: BindGroup,
    bin: Option<BindGroup>,
    composite: BindGroup,
}

impl Job<'_, '_> {
    /// Draws a window into its rows of the frame; gives the records that were walked.
    fn window(
        &self,
        renderer: &mut Renderer,
        window: [i32; 4],
        out: &mut [f32],
        stats: &mut Stats,
        look: &mut Option<Look>,
    ) -> Result<u64> {
        let Job { context, plan, shot, .. } = self;
        let [width, height] = [window[2] - window[0], window[3] - window[1]].map(i32::cast_unsigned);
        let looks = &renderer.looks.as_ref().expect("prepared before").3;
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
        let shot_buffer = scratch.buffer(context, Name::Shot, size_of::<layout::Shot>() as u64)?;
        context.write(&shot_buffer, 0, bytemuck::bytes_of(&uniform))?;
        let slots = u64::from(plan.slots.next_multiple_of(BATCH));
        scratch.buffer(context, Name::Voxels, slots * size_of::<Voxel>() as u64)?;
        scratch.buffer(context, Name::Splats, slots * size_of::<Splat>() as u64)?;
        match self.compositor {
            Compositor::Tiles => {
                let tiles = u64::from(tiles[0]) * u64::from(tiles[1]);
                scratch.buffer(context, Name::Masks, 4 * tiles * u64::from(words))?;
                scratch.buffer(context, Name::Pixels, 16 * u64::from(width) * u64::from(height))?;
            }
            Compositor::Quads(target) => {
                scratch.target(context, [width, height], target.format())?;
            }
        }

        let (mut records, mut is_first) = (0, true);
        for (index, slab) in self.list.slabs.iter().enumerate() {
            let mut chunks = Chunks::new(&self.list, slab, &sight, plan.slots);
            if chunks.chunks.is_empty() {
                continue;
            }
            for (chunk, _) in &mut chunks.chunks {
                let counter = (stats.chunks % COUNTERS) as u32;
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
        self.read_back(renderer, [width, height], is_first, out, stats)?;
        Ok(records)
    }

    /// Brings a slab and its blocks to the device.
    fn bind(&self, renderer: &mut Renderer, index: usize, chunks: &Chunks, stats: &mut Stats) -> Result<Bound> {
        let Job { context, stages, .. } = self;
        let start = Instant::now();
        let slab = &self.list.slabs[index];
        let residence = self.reside(renderer, slab, stats)?;
        let [tiles, line_ends, steps, values, normals, magnitudes] = residence.buffers.clone();
        let most = |count: fn(&Slab) -> usize| self.list.slabs.iter().map(count).max().unwrap_or(0) as u64;
        let scratch = &mut renderer.scratch;
        let lines = scratch.buffer(context, Name::Lines, 4 * most(|slab| slab.lines.len()))?;
        let listed = renderer.list.as_mut().expect("prepared before");
        if listed.on_device != Some(index) {
            for (piece, lines_of) in (0u64..).zip(slab.lines.chunks(1 << 18)) {
                context.write(&lines, piece << 20, bytemuck::cast_slice(lines_of))?;
            }
            stats.list_bytes += 4 * slab.lines.len() as u64;
            listed.on_device = Some(index);
        }
        let blocks =
            scratch.buffer(context, Name::Blocks, size_of::<Block>() as u64 * most(|slab| slab.blocks.len()))?;
        context.write(&blocks, 0, bytemuck::cast_slice(&chunks.blocks))?;
        let stride = self.chunk_stride();
        let mut uniforms = vec![0u8; stride * chunks.chunks.len()];
        for ((chunk, _), bytes) in chunks.chunks.iter().zip(uniforms.chunks_exact_mut(stride)) {
            bytes[..size_of::<Chunk>()].copy_from_slice(bytemuck::bytes_of(chunk));
        }
        let chunk_buffer = scratch.buffer(context, Name::Chunks, uniforms.len() as u64)?;
        context.write(&chunk_buffer, 0, &uniforms)?;
        stats.upload_ms += start.elapsed().as_secs_f64() * 1e3;

        let buffer = |name: Name| scratch.buffers[name as usize].as_ref().expect("made before").as_entire_binding();
        let [shot, voxels, splats, drawn] = [Name::Shot, Name::Voxels, Name::Splats, Name::Drawn].map(buffer);
        let looks = &renderer.looks.as_ref().expect("prepared before").3;
        let chunk = one_chunk(&chunk_buffer);
        let device = &context.device;
        let walk = [&tiles, &line_ends, &steps, &lines, &blocks].map(|buffer| buffer.as_entire_binding());
        let [by_value, by_pair] = [&looks.by_value, &looks.by_pair].map(|buffer| buffer.as_entire_binding());
        let head = [shot.clone(), chunk.clone()];
        let walk = stages.walk.bind(device, &[&head[..], &walk, std::slice::from_ref(&voxels)].concat());
        let [values, normals, magnitudes] = [&values, &normals, &magnitudes].map(|buffer| buffer.as_entire_binding());
        let channels = [voxels, values, normals, magnitudes, by_value, by_pair];
        let project = stages.project.bind(device, &[&head[..], &channels, &[splats.clone(), drawn]].concat());
        let (bin, composite) = match self.compositor {
            Compositor::Tiles => {
                let [masks, pixels] = [Name::Masks, Name::Pixels].map(buffer);
                let bin = stages.bin.bind(device, &[&head[..], &[splats.clone(), masks.clone()]].concat());
                let tile = stages.tile(device, self.blend);
                (Some(bin), tile.bind(device, &[&head[..], &[splats, masks, pixels]].concat()))
            }
            Compositor::Quads(_) => (None, stages.bind_splat(device, &[shot, splats])),
        };
        Ok(Bound { walk, project, bin, composite })
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
        let looks = &renderer.looks.as_ref().expect("prepared before").3;
        let resident = renderer.residents.last().or(renderer.passage.as_ref().map(|(_, passage)| passage));
        let buffer = |name: Name| renderer.scratch.buffers[name as usize].as_ref();
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
            voxels: buffer(Name::Voxels).expect("made before"),
            splats: buffer(Name::Splats).expect("made before"),
            masks: buffer(Name::Masks).filter(|_| has_tiles),
            pixels: buffer(Name::Pixels).filter(|_| has_tiles),
        }
    }

    /// The slab's buffers: kept if it is the whole lane, else filled anew.
    fn reside<'r>(&self, renderer: &'r mut Renderer, slab: &Slab, stats: &mut Stats) -> Result<&'r Residence> {
        let Job { context, shot, .. } = self;
        let lane = &shot.lane;
        if self.list.slabs.len() == 1 {
            let place = renderer.residents.iter().position(|residence| residence.axis == lane.axis);
            let residence = match place {
                Some(place) => renderer.residents.remove(place),
                None => {
                    renderer.passage = None;
                    let sizes = Sizes::of(lane, &slab.tiles)?;
                    let used = |residents: &[Residence]| residents.iter().map(Residence::bytes).sum::<u64>();
                    while used(&renderer.residents) + sizes.total() > self.plan.room.bytes
                        && !renderer.residents.is_empty()
                    {
                        renderer.residents.remove(0);
                    }
                    let residence = Residence::new(context, lane.axis, sizes)?;
                    stats.upload_bytes += residence.upload(context, lane, &slab.tiles)?;
                    residence
                }
            };
            renderer.residents.push(residence);
            return Ok(renderer.residents.last().expect("it was just put there"));
        }
        renderer.residents.clear();
        let sizes =
            self.list.slabs.iter().try_fold(Sizes::default(), |most, slab| {
                Sizes::of(lane, &slab.tiles).map(|sizes| most.at_least(sizes))
            })?;
        if renderer.passage.as_ref().is_none_or(|(have, _)| *have != sizes) {
            renderer.passage = None;
            renderer.passage = Some((sizes, Residence::new(context, lane.axis, sizes)?));
        }
        let residence = &renderer.passage.as_ref().expect("it was just made").1;
        stats.upload_bytes += residence.upload(context, lane, &slab.tiles)?;
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
        let stages = &self.stages;
        let offset = place * u32::try_from(self.chunk_stride()).expect("a small number");
        let batches = chunk.slot_count.div_ceil(BATCH);
        let scratch = &renderer.scratch;
        let timer = &mut renderer.timer;
        let mut run = |pass: Pass, stage: &Stage, group: &BindGroup, [x, y]: [u32; 2], encoder: &mut CommandEncoder| {
            let timestamp_writes = timer.as_mut().and_then(|timer| timer.compute(pass));
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor { label: None, timestamp_writes });
            pass.set_pipeline(&stage.pipeline);
            pass.set_bind_group(0, group, &[offset]);
            pass.dispatch_workgroups(x, y, 1);
        };
        run(Pass::Walk, &stages.walk, &bound.walk, [blocks, 1], encoder);
        run(Pass::Project, &stages.project, &bound.project, [batches, 1], encoder);
        match (self.compositor, &bound.bin) {
            (Compositor::Quads(target), _) => {
                let texture = scratch.target.as_ref().expect("made before");
                let pipeline = stages.splat(&self.context.device, self.blend, target.format(), target.place());
                let start = Color { r: 0.0, g: 0.0, b: 0.0, a: self.blend.fourth().into() };
                let load = if chunk.is_first == 1 { LoadOp::Clear(start) } else { LoadOp::Load };
                let view = texture.create_view(&Default::default());
                let timestamp_writes = timer.as_mut().and_then(|timer| timer.render(Pass::Composite));
                let mut pass = encoder.begin_render_pass(&RenderPassDescriptor {
                    label: Some("splat"),
                    color_attachments: &[Some(RenderPassColorAttachment {
                        view: &view,
                        depth_slice: None,
                        resolve_target: None,
                        ops: Operations { load, store: StoreOp::Store },
                    })],
                    depth_stencil_attachment: None,
                    timestamp_writes,
                    occlusion_query_set: None,
                    multiview_mask: None,
                });
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &bound.composite, &[]);
                pass.draw(0..4, 0..chunk.slot_count);
            }
            (Compositor::Tiles, Some(bin)) => {
                let masks = scratch.buffers[Name::Masks as usize].as_ref().expect("made before");
                encoder.clear_buffer(masks, 0, None);
                run(Pass::Bin, &stages.bin, bin, [batches, 1], encoder);
                run(Pass::Composite, stages.tile(&self.context.device, self.blend), &bound.composite, tiles, encoder);
            }
            (Compositor::Tiles, None) => unreachable!("tiles are bound with their bins"),
        }
    }

    /// Brings a window's pixels back.
    fn read_back(
        &self,
        renderer: &mut Renderer,
        [width, height]: [u32; 2],
        is_empty: bool,
        out: &mut [f32],
        stats: &mut Stats,
    ) -> Result<()> {
        let context = &self.context;
        let start = Instant::now();
        let table = &renderer.looks.as_ref().expect("prepared before").2;
        let finish = Finish::new(table);
        let out = out.as_chunks_mut::<4>().0;
        if is_empty {
            out.fill(finish.pixel([0.0, 0.0, 0.0, self.blend.fourth()]));
            return Ok(());
        }
        let scratch = &mut renderer.scratch;
        let mut encoder = context.device.create_command_encoder(&CommandEncoderDescriptor { label: Some("read back") });
        let (target, pitch) = match self.compositor {
            Compositor::Tiles => (Target::Float32, 16 * width),
            // Rows of copies from textures start at multiples of 256 bytes.
            Compositor::Quads(target) => (target, (target.pixel_bytes() * width).next_multiple_of(256)),
        };
        let bytes = u64::from(pitch) * u64::from(height);
        let back = scratch.buffer(context, Name::ReadBack, bytes)?;
        match self.compositor {
            Compositor::Tiles => {
                let pixels = scratch.buffers[Name::Pixels as usize].as_ref().expect("made before");
                encoder.copy_buffer_to_buffer(pixels, 0, &back, 0, Some(bytes));
            }
            Compositor::Quads(_) => {
                let texture = scratch.target.as_ref().expect("made before");
                let source =
                    TexelCopyTextureInfo { texture, mip_level: 0, origin: Origin3d::ZERO, aspect: TextureAspect::All };
                let layout =
                    TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: Some(height) };
                let size = Extent3d { width, height, depth_or_array_layers: 1 };
                encoder.copy_texture_to_buffer(source, TexelCopyBufferInfo { buffer: &back, layout }, size);
            }
        }
        if let Some(timer) = &renderer.timer {
            timer.resolve(&mut encoder);
        }
        context.submit([encoder.finish()])?;
        context.read(&back, bytes, |bytes| {
            let pixel_bytes = target.pixel_bytes() as usize;
            for (row, from) in out.chunks_exact_mut(width as usize).zip(bytes.chunks_exact(pitch as usize)) {
                for (pixel, from) in row.iter_mut().zip(from.chunks_exact(pixel_bytes)) {
                    *pixel = finish.pixel(target.decode(from));
                }
            }
        })?;
        if let Some(timer) = &mut renderer.timer {
            let [walk, project, bin, composite] = timer.read(context)?;
            stats.walk_ms += walk;
            stats.project_ms += project;
            stats.bin_ms += bin;
            stats.composite_ms += composite;
        }
        stats.read_back_ms += start.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }
}
