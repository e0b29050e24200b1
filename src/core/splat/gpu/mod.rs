//! The renderer on graphics devices (Vulkan, Metal, DX12).
//!
//! In: a device and its queue, a scene, a camera, settings. Out: a [`Frame`], or a picture in the caller's texture.
//!
//! ```text
//! lane (bytes of the file) ------------------.
//! order -> line list (kept while it lasts) --+-> walk -> voxels -> project -> splats -> bin -> boxes, masks -> tile -> pixels
//! camera -> blocks in view -> chunks --------'                                     '----> splat (quads) -----------> target
//! ```
//!
//! The device walks the lane (all scan lines along one axis) in exact visibility order, so nothing is sorted. A frame
//! is drawn in *chunks* of as many records as the buffers hold. A lane stays on the device while there is room; a
//! larger one passes through in *slabs* along the slow axis; a larger picture is drawn in *windows*. The pixels do not
//! depend on any of this, bit for bit.
//!
//! Where coarser levels of detail are enough, a frame consists of *parts*, each of one level (`levels.rs`). They are drawn
//! into the same samples one after the other, which are then filtered once. Only levels in use go to the device.

pub mod adapter;
mod budget;
mod buffers;
mod chunks;
mod context;
mod draw;
pub(crate) mod layout;
mod lines;
mod looks;
pub(crate) mod probe;
mod read_back;
mod resident;
mod resolve;
mod slab_buffers;
pub(crate) mod stages;
mod timing;

use std::sync::Arc;

use web_time::Instant;
pub use wgpu;
use wgpu::{Device, Features, Queue};

use self::budget::MemoryPlan;
use self::buffers::FrameBuffers;
use self::context::MAX_BINDING;
use self::draw::{FrameOutput, Part};
use self::lines::{LaneSize, LineList, list_key};
use self::looks::{DeviceLooks, LookBuffers};
use self::probe::ProbeCallback;
pub use self::resident::Resident;
pub use self::resolve::RenderTarget;
use self::slab_buffers::SlabBuffers;
use super::kernel::LOW_PASS;
use super::levels::{LevelPart, LevelScene, facts_of, level_parts};
use super::setup::FrameSetup as Shot;
use super::supersample::Supersampling;
use super::view::{View, check_size};
use super::{Blending, Camera, Frame, Mode, Sampling, Scene, Settings};
use crate::arena::Lane;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::traverse::{Sense, VoxelBox};
use crate::volume::Axis;

/// How splats become pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compositor {
    /// In a compute shader: a workgroup per tile of the picture accumulates in 32-bit registers, and can end early.
    Tiles,
    /// As quads, one for each splat, which the device blends into a target of this format. The maximum modes, which
    /// interpolate between voxels, are drawn in tiles all the same.
    Quads(QuadFormat),
}

/// The format of the target in which quads accumulate.
///
/// With 16 or 8 bits, composite back to front: each splat then shrinks the rounding errors behind it. Measured on
/// lavapipe, which rounds toward 0, with opacities of 0.1 and above in 16 bits: 42 dB back to front, but 35 dB front to
/// back (tests/gpu).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum QuadFormat {
    /// 32-bit float, if the device can blend it.
    Float32,
    /// 16-bit float; small opacities are lost.
    Float16,
    /// 8 bits; larger opacities are lost.
    Unorm8,
}

/// Options of a renderer on a graphics device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct GpuOptions {
    /// Most bytes of video memory, including copies on their way to the device. The picture does not depend on it.
    pub vram: u64,
    /// How splats become pixels; `None` for the way that is faster on the device.
    pub compositor: Option<Compositor>,
}

impl Default for GpuOptions {
    fn default() -> GpuOptions {
        GpuOptions { vram: 1 << 30, compositor: None }
    }
}

impl GpuOptions {
    /// Returns whether a device can hold all of a lane beside another one, so that their channels need not be in memory.
    pub fn holds(&self, lane: &Lane) -> bool {
        let widest = lane.channels.widths().into_iter().max().unwrap_or(1) as u64;
        LaneSize::of_lane(lane).bytes <= self.lane_bytes() / 2
            && lane.record_count().saturating_mul(widest) <= MAX_BINDING
    }

    /// Most bytes that such lanes take together; frames need the rest.
    fn lane_bytes(&self) -> u64 {
        self.vram / 2
    }

    /// Sets the most bytes of video memory.
    pub fn with_vram(self, vram: u64) -> GpuOptions {
        GpuOptions { vram, ..self }
    }

    /// Sets how splats become pixels.
    pub fn with_compositor(self, compositor: impl Into<Option<Compositor>>) -> GpuOptions {
        GpuOptions { compositor: compositor.into(), ..self }
    }
}

/// The work and the times of drawing a frame. Times of stages are 0 if the device has no clock.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct GpuStats {
    /// Splats that reached a window of the picture.
    pub splats_drawn: u64,
    /// Records visited but not drawn: stepping records (which hold no voxel), transparent or outside the picture.
    pub splats_skipped: u64,
    /// Parts that the volume was drawn in, each from one level of detail; 1 if all of it is of one level.
    pub parts: usize,
    /// Line lists that were made: one for each level, but none where the order is that of the last frame, so that its list
    /// was used again.
    pub line_lists: u64,
    /// Slabs that lanes were cut into; 1 for each level if all of its lane is on the device.
    pub slabs: usize,
    /// Windows that the picture was cut into.
    pub windows: usize,
    /// Chunks of records, over all windows and slabs.
    pub chunks: u64,
    /// Bytes of tiles, line ends and channels that were copied to the device.
    pub upload_bytes: u64,
    /// Bytes of the line list that were copied to the device.
    pub list_bytes: u64,
    /// Bytes of all buffers and targets on the device.
    pub vram_bytes: u64,
    /// Of these, bytes of lanes and their line lists, also of lanes that earlier frames drew.
    pub lane_bytes: u64,
    /// Levels of detail that have a lane on the device: bit 0 for level 0, and so on.
    pub levels_on_device: u16,
    /// Milliseconds of the whole frame.
    pub frame_ms: f64,
    /// Milliseconds that the processor took for making the line list.
    pub line_list_ms: f64,
    /// Milliseconds that the processor took for handing lanes, tables and lists to the device.
    pub upload_ms: f64,
    /// Milliseconds that the device took for the stage `walk`.
    pub walk_ms: f64,
    /// Milliseconds that the device took for the stage `project`.
    pub project_ms: f64,
    /// Milliseconds that the device took for the stage `bin`.
    pub bin_ms: f64,
    /// Milliseconds that the device took for compositing tiles or drawing quads.
    pub composite_ms: f64,
    /// Milliseconds from the last submission until the pixels are back.
    pub read_back_ms: f64,
}

/// Draws frames of a scene on a device.
#[derive(Debug)]
pub struct GpuRenderer<'a> {
    scene: Scene<'a>,
    looks: Option<DeviceLooks<'a>>,
    resident: Resident,
}

impl<'a> GpuRenderer<'a> {
    /// Creates a renderer of `scene` on `device`, which needs the limits of WebGPU. `TIMESTAMP_QUERY` is optional (else
    /// stages are not timed), as is `FLOAT32_BLENDABLE` (for [`QuadFormat::Float32`]).
    ///
    /// # Errors
    /// [`Error::Device`] if the device fails, or cannot blend the format of `options`.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn new(device: Device, queue: Queue, scene: Scene<'a>, options: GpuOptions) -> Result<GpuRenderer<'a>> {
        pollster::block_on(GpuRenderer::new_async(device, queue, scene, options))
    }

    /// The same as [`GpuRenderer::new`] where nothing may block, as in a browser.
    ///
    /// # Errors
    /// [`Error::Device`] if the device fails, or cannot blend the format of `options`.
    pub async fn new_async(
        device: Device,
        queue: Queue,
        scene: Scene<'a>,
        options: GpuOptions,
    ) -> Result<GpuRenderer<'a>> {
        Ok(Resident::new(device, queue, options).await?.renderer(scene))
    }

    /// Lets go of the scene; what is on the device stays there for [`Resident::renderer`].
    pub fn into_resident(self) -> Resident {
        let kept_looks = self.looks.map(|looks| looks.on_device).or(self.resident.kept_looks);
        Resident { kept_looks, ..self.resident }
    }

    /// Changes the transfer function from the next frame on; lanes stay on the device.
    pub fn set_transfer(&mut self, transfer: &'a TransferFunction) {
        self.scene.transfer = transfer;
        self.looks = None;
    }

    /// Returns the compositor in use: that of the options, if there is one. Else it is tiles, or quads if the device is
    /// a processor, which draws most pictures faster so (docs/studies/gpu.md).
    pub fn compositor(&self) -> Compositor {
        let can_blend = self.resident.context.device.features().contains(Features::FLOAT32_BLENDABLE);
        let prefers_quads = self.resident.is_software && can_blend;
        let default = if prefers_quads { Compositor::Quads(QuadFormat::Float32) } else { Compositor::Tiles };
        self.resident.options.compositor.unwrap_or(default)
    }

    /// Changes the compositor from the next frame on; `None` for the one that is faster on the device.
    ///
    /// # Errors
    /// [`Error::Device`] if the device cannot blend its format.
    pub fn set_compositor(&mut self, compositor: Option<Compositor>) -> Result<()> {
        check_blends(&self.resident.context.device, compositor)?;
        self.resident.options.compositor = compositor;
        // All buffers are freed, so that the old compositor's do not count towards the budget.
        self.resident.buffers = FrameBuffers::default();
        self.resident.resolve = None;
        Ok(())
    }

    /// Draws a frame and waits for it; ignores `settings.code`. The processor lists the lines of a lane that fits the video
    /// memory, and finishes pixels, on up to `settings.threads` threads.
    ///
    /// The frame is that of [`cpu::render`](super::cpu::render) with [`Sampling::Finer`], except for rounding, also that of the target, and for
    /// early termination, which quads do not have.
    ///
    /// # Errors
    /// Returns the errors of [`cpu::render`](super::cpu::render); [`Error::Input`] for a [`Blending`] other than
    /// exponential; [`Error::Device`] if the device fails; [`Error::Limit`] if [`GpuOptions::vram`] is too little.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<(Frame, GpuStats)> {
        pollster::block_on(self.render_async(camera, settings))
    }

    /// The same as [`GpuRenderer::render`] where nothing may block: gives way while the device draws.
    ///
    /// # Errors
    /// The errors of [`GpuRenderer::render`].
    pub async fn render_async(&mut self, camera: &Camera, settings: &Settings) -> Result<(Frame, GpuStats)> {
        let parts = self.parts(camera, settings)?;
        let (supersampling, low_pass) = self.supersampling(&parts, camera, settings)?;
        let settings = &Settings { low_pass, ..settings.clone() };
        let Some(supersampling) = supersampling else {
            return self.one_sample(&parts, camera, settings, None).await;
        };
        let (camera, of_samples) = supersampling.of_samples(camera, settings);
        let (samples, stats) = self.one_sample(&parts, &camera, &of_samples, None).await?;
        Ok((supersampling.picture(&samples, settings.threads)?, stats))
    }

    /// Returns the parts of the picture that `settings` ask for, nearest first; at least one.
    fn parts(&self, camera: &Camera, settings: &Settings) -> Result<Vec<LevelPart>> {
        let mut parts = level_parts(&self.scene, camera, settings)?;
        if parts.is_empty() {
            // No grid has a voxel there.
            let nothing = VoxelBox { low: [u16::MAX; 3], high: [u16::MAX; 3] };
            parts.push(LevelPart { level: settings.level.unwrap_or(0), crop: Some(nothing) });
        }
        Ok(parts)
    }

    /// Returns the scene of a part's level; `None` for level 0, which is drawn as it is.
    fn coarser(&self, part: &LevelPart) -> Result<Option<LevelScene<'a>>> {
        if part.level == 0 { Ok(None) } else { part.scene(&self.scene).map(Some) }
    }

    /// Returns the finest supersampling and the widest low-pass of splats that any part asks for, as all are drawn into the same samples.
    fn supersampling(
        &self,
        parts: &[LevelPart],
        camera: &Camera,
        settings: &Settings,
    ) -> Result<(Option<Supersampling>, f32)> {
        let (mut finest, mut widest) = (None, 0.0f32);
        // Computing the bounds takes a pass over all tiles; pictures with one sample per pixel do not need them.
        for part in if settings.keeps_pixels() { &[] } else { parts } {
            let level = self.coarser(part)?;
            let scene = level.as_ref().map_or(self.scene, LevelScene::scene);
            let bounds = scene.lanes.lane(Axis::X)?.bounds().map(|(low, high)| VoxelBox { low, high });
            let bounds = bounds.filter(|bounds| part.crop.is_none_or(|crop| crop.meets(bounds)));
            let settings = part.settings(&self.scene, settings);
            let (asked, low_pass) = Supersampling::of(&scene.facts.grid, bounds, camera, &settings)?;
            finest = Supersampling::finer(finest, asked);
            widest = if bounds.is_some() { widest.max(low_pass) } else { widest };
        }
        Ok((finest, if widest > 0.0 { widest } else { LOW_PASS }))
    }

    /// Draws a frame with one sample a pixel, and calls `probe` after each chunk.
    ///
    /// # Errors
    /// Returns the errors of [`GpuRenderer::render`].
    #[doc(hidden)]
    #[cfg(not(target_arch = "wasm32"))]
    pub fn render_probed(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        probe: Option<ProbeCallback>,
    ) -> Result<(Frame, GpuStats)> {
        let parts = self.parts(camera, settings)?;
        pollster::block_on(self.one_sample(&parts, camera, settings, probe))
    }

    async fn one_sample(
        &mut self,
        parts: &[LevelPart],
        camera: &Camera,
        settings: &Settings,
        probe: Option<ProbeCallback<'_>>,
    ) -> Result<(Frame, GpuStats)> {
        check_size(settings.size)?;
        let mut frame = Frame::transparent(settings.size)?;
        let stats = self.draw(parts, camera, settings, FrameOutput::Frame(&mut frame, probe)).await?;
        Ok((frame, stats))
    }

    /// Draws a frame into a texture without waiting for it; the work is submitted to the renderer's queue. Only copies
    /// to the device may have to wait for earlier copies.
    ///
    /// `settings.size` is the texture's. Splats are not counted and stages not timed.
    ///
    /// # Errors
    /// Returns the errors of [`GpuRenderer::render`]; [`Error::Input`] if `settings.sampling` is another than [`Sampling::EveryPixel`],
    /// or the texture is smaller than `settings.size`.
    #[cfg(not(target_arch = "wasm32"))]
    pub fn render_to(&mut self, camera: &Camera, settings: &Settings, target: &RenderTarget) -> Result<GpuStats> {
        pollster::block_on(self.render_to_async(camera, settings, target))
    }

    /// The same as [`GpuRenderer::render_to`] where nothing may block: gives way until the device has checked its commands.
    ///
    /// # Errors
    /// The errors of [`GpuRenderer::render_to`].
    pub async fn render_to_async(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        target: &RenderTarget<'_>,
    ) -> Result<GpuStats> {
        if settings.sampling.is_some_and(|sampling| sampling != Sampling::EveryPixel) {
            return Err(Error::input("sampling", "of a texture is of every pixel; supersample by a larger texture"));
        }
        let ([columns, rows], texture) = (settings.size, target.view.texture());
        if columns > texture.width() || rows > texture.height() {
            let why =
                format!("is {columns}x{rows}, but the texture has {}x{} pixels", texture.width(), texture.height());
            return Err(Error::input("size", why));
        }
        let parts = self.parts(camera, settings)?;
        self.draw(&parts, camera, settings, FrameOutput::Texture(target)).await
    }

    /// Draws `parts`, nearest first.
    async fn draw(
        &mut self,
        parts: &[LevelPart],
        camera: &Camera,
        settings: &Settings,
        output: FrameOutput<'_, '_>,
    ) -> Result<GpuStats> {
        let start = Instant::now();
        let scene = self.scene;
        let levels: Vec<Option<LevelScene>> = parts.iter().map(|part| self.coarser(part)).collect::<Result<_>>()?;
        let mut shots: Vec<(usize, Shot)> = Vec::with_capacity(parts.len());
        for (part, level) in parts.iter().zip(&levels) {
            let scene = level.as_ref().map_or(scene, LevelScene::scene);
            shots.push((part.level, Shot::new(&scene, camera, &part.settings(&self.scene, settings))?));
        }
        if settings.sense == Sense::BackToFront {
            shots.reverse();
        }
        if settings.blending != Blending::Exponential {
            let name = settings.blending.name();
            let why = format!("{name} is not for graphics devices; take the processor's renderer");
            return Err(Error::input("blending", why));
        }
        let context = self.resident.context.clone();
        let mut stats = GpuStats::default();
        // Tiles also draw pictures that are too large for the default's target.
        let fits = settings.size.into_iter().all(|side| side <= context.limits.max_texture_dimension_2d);
        let has_choice = self.resident.options.compositor.is_none();
        self.resident.current =
            if has_choice && !fits || settings.mode.is_maximum() { Compositor::Tiles } else { self.compositor() };
        let work = async || {
            let (_, first) = &shots[0];
            let plan = self.plan(&first.lane, settings)?;
            self.prepare_looks(&shots[0], camera, settings, &mut stats)?;
            let mut parts = Vec::with_capacity(shots.len());
            for (level, shot) in &shots {
                let list = self.prepare_list(*level, shot, plan.room, settings.threads, &mut stats)?;
                parts.push(Part { level: *level, shot, list });
            }
            let records = parts.iter().map(|part| part.list.records).max().unwrap_or(0);
            draw::frame(self, &parts, settings, plan.for_records(records), output, &mut stats).await
        };
        let drawn = context.watch(work).await;
        if let Err(fault) = drawn {
            self.forget_device();
            return Err(fault);
        }
        let Resident { slabs, lists, .. } = &mut self.resident;
        lists.retain(|(level, _)| {
            shots.iter().any(|(drawn, _)| drawn == level) || slabs.iter().any(|slab| slab.level == *level)
        });
        stats.lane_bytes = slabs.iter().map(SlabBuffers::bytes).sum();
        stats.levels_on_device = slabs.iter().fold(0, |levels, slab| levels | 1 << slab.level);
        stats.vram_bytes = self.looks().bytes() + stats.lane_bytes + self.resident.buffers.bytes();
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }

    /// Forgets everything on the device, since some of it may be wrong after an error.
    fn forget_device(&mut self) {
        self.looks = None;
        self.resident.forget_scene();
        self.resident.resolve = None;
        self.resident.buffers = FrameBuffers::default();
        if let Some(timer) = &mut self.resident.timer {
            timer.passes.clear();
        }
    }

    /// Returns the tables of the frame that is being drawn.
    fn looks(&self) -> &DeviceLooks<'a> {
        self.looks.as_ref().expect("a frame begins with its tables")
    }

    fn plan(&self, lane: &Lane, settings: &Settings) -> Result<MemoryPlan> {
        let uses_gradient = self.scene.transfer.uses_gradient() || lane.shown.is_some();
        let table_bytes = DeviceLooks::max_bytes(lane, uses_gradient);
        let (ceiling, max_binding) = (self.resident.options.vram, self.resident.context.max_binding());
        // That of all levels, so that lists last while views change between levels.
        let all_facts = std::iter::once(self.scene.facts).chain(self.scene.lanes.detail().levels);
        let widest = all_facts.flat_map(|facts| facts.channels.widths()).max().unwrap_or(1) as u64;
        let (is_software, has_tiles) = (self.resident.is_software, self.resident.current == Compositor::Tiles);
        MemoryPlan::new(ceiling, max_binding, settings.size, table_bytes, widest, is_software, has_tiles)
    }

    /// Prepares the tables for all parts of a frame. Composites have those of level 0, whatever they draw. Frames in other
    /// modes have one part; its tables depend on what voxels there are. Depths are for the spacing of level 0: those of a
    /// level differ by [`DeviceLooks::depth_factor`].
    fn prepare_looks(
        &mut self,
        (level, shot): &(usize, Shot),
        camera: &Camera,
        settings: &Settings,
        stats: &mut GpuStats,
    ) -> Result<()> {
        let start = Instant::now();
        let level = if settings.mode == Mode::Composite { 0 } else { *level };
        let scene = Scene { facts: facts_of(&self.scene, level), ..self.scene };
        let hold = |looks: &LookBuffers| looks.hold_for(level, self.scene.transfer, settings);
        if !self.looks.as_ref().is_some_and(|looks| hold(&looks.on_device)) {
            // The old tables are freed first: the budget counts one set of tables.
            self.looks = None;
            let there = self.resident.kept_looks.take().filter(hold);
            let view = View::new(camera, &self.scene.facts.grid, settings.size, settings.kernel(), settings.near)?;
            let (context, mean_voxel) = (&self.resident.context, view.mean_voxel);
            self.looks = Some(DeviceLooks::new(context, (level, &scene), &shot.lane, mean_voxel, settings, there)?);
        }
        stats.upload_ms += start.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    fn prepare_list(
        &mut self,
        level: usize,
        shot: &Shot,
        room: LaneSize,
        threads: usize,
        stats: &mut GpuStats,
    ) -> Result<Arc<LineList>> {
        let start = Instant::now();
        let key = list_key(&shot.order);
        let lists = &mut self.resident.lists;
        let of_level = lists.iter().find(|(listed, _)| *listed == level);
        if let Some((_, list)) = of_level.filter(|(_, list)| (list.room, list.key) == (room, key)) {
            return Ok(list.clone());
        }
        // The old list is freed first.
        lists.retain(|(listed, _)| *listed != level);
        let list = Arc::new(LineList::new(&shot.lane, &shot.order, room, threads)?);
        lists.push((level, list.clone()));
        stats.line_lists += 1;
        stats.line_list_ms += start.elapsed().as_secs_f64() * 1e3;
        Ok(list)
    }
}

/// Checks that `device` can blend the format of `compositor`; [`Error::Device`] if not.
fn check_blends(device: &Device, compositor: Option<Compositor>) -> Result<()> {
    let needs_float32 = compositor == Some(Compositor::Quads(QuadFormat::Float32));
    if needs_float32 && !device.features().contains(Features::FLOAT32_BLENDABLE) {
        return Err(Error::device("cannot blend 32-bit floats; take tiles, or accumulate in 16 bits"));
    }
    Ok(())
}
