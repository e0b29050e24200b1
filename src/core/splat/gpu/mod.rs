//! The renderer on graphics processors: the processor walks faces, the device walks voxels.
//!
//! In: a device and its queue, a scene, a camera, settings. Out: a frame and what it took, as from
//! [`cpu::render`](super::cpu::render).
//!
//! ```text
//! lane (as the file has it) ---------------.
//! order -> line list (kept while it lasts) -+-> walk -> voxels -> project -> splats -> bin -> masks -> tile -> pixels
//! camera -> blocks in view -> chunks ------'                                    '----> splat (quads) ----> target
//! ```
//!
//! A frame is drawn chunk by chunk, each of as many records as the buffers hold, in exact visibility order: nothing is
//! sorted. A lane stays on the device as long as there is room; one that is too large passes through in slabs along the
//! slow axis. A picture that is too large is drawn in windows. The pixels do not depend on any of this, bit for bit.

pub mod adapter;
mod budget;
mod chunks;
mod context;
mod draw;
pub mod layout;
mod lines;
mod looks;
pub mod probe;
mod read_back;
mod residence;
mod resolve;
mod scratch;
pub mod stages;
mod timing;

use std::sync::Arc;
use std::time::Instant;

pub use wgpu;
use wgpu::{Device, DeviceType, Features, Queue};

use self::budget::{Plan, Question, in_flight};
use self::context::Context;
use self::draw::Output;
use self::lines::{Key, LineList};
use self::looks::Looks;
use self::probe::Look;
use self::residence::{Residence, Sizes};
pub use self::resolve::Canvas;
use self::resolve::Resolver;
use self::scratch::Scratch;
use self::stages::Stages;
use self::timing::Timer;
use super::composite::Table;
use super::frame::Frame;
use super::setup::FrameSetup as Shot;
use super::view::check_size;
use super::{Blending, Camera, Scene, Settings};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::splat::Sampling;
use crate::splat::supersample::supersampled;
use crate::traverse::VoxelBox;
use crate::volume::Axis;

/// How splats become pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compositor {
    /// In compute: a workgroup for each tile of the picture, accumulating in registers of 32 bits; ends early.
    Tiles,
    /// As quads, which the device blends into a target.
    Quads(Target),
}

/// What quads accumulate in.
///
/// In few bits back to front is the better sense: each splat shrinks the roundings behind it. Measured on lavapipe, which
/// rounds toward 0, opacities of 0.1 and above in 16 bits: 42 dB, and 35 dB front to back (tests/gpu).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Target {
    /// 32-bit float, where the device blends it.
    Float32,
    /// 16-bit float: stagnates where opacities are small.
    Float16,
    /// 8 bits: stagnates sooner.
    Unorm8,
}

/// What a renderer may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Most bytes of video memory, copies on their way included. A picture does not depend on it.
    pub vram: u64,
    /// How splats become pixels; `None` for the faster one on the device at hand.
    pub compositor: Option<Compositor>,
}

impl Default for Options {
    fn default() -> Options {
        Options { vram: 1 << 30, compositor: None }
    }
}

/// What drawing a frame took. Times of stages are 0 where the device has no clock.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stats {
    /// Splats that reached a window of the picture.
    pub splats_drawn: u64,
    /// Records that were visited but not drawn: stepping voxels, transparent or off the picture.
    pub splats_skipped: u64,
    /// Line lists that were made: 0 while the order lasts.
    pub line_lists: u64,
    /// Slabs that the lane was cut into; 1 if it is on the device as a whole.
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
    /// Milliseconds of the whole frame.
    pub frame_ms: f64,
    /// Milliseconds of the processor: making the line list.
    pub line_list_ms: f64,
    /// Milliseconds of the processor: handing lanes, tables and lists to the device.
    pub upload_ms: f64,
    /// Milliseconds of the device's stages.
    pub walk_ms: f64,
    /// Likewise.
    pub project_ms: f64,
    /// Likewise.
    pub bin_ms: f64,
    /// Likewise: tiles or quads.
    pub composite_ms: f64,
    /// Milliseconds from the last work's hand-over until the pixels are back.
    pub read_back_ms: f64,
}

/// Draws frames of a scene on a device.
#[derive(Debug)]
pub struct Renderer<'a> {
    context: Arc<Context>,
    stages: Arc<Stages>,
    timer: Option<Timer>,
    scene: Scene<'a>,
    options: Options,
    /// Whether the device is a processor.
    is_software: bool,
    looks: Option<Looks<'a>>,
    list: Option<Listed>,
    /// Lanes that are on the device as a whole, the last used last.
    residents: Vec<Residence>,
    /// The slab of a larger lane that is on the device.
    passage: Option<Residence>,
    scratch: Scratch,
    /// How the frame at hand is composited.
    current: Compositor,
    resolver: Option<Resolver>,
}

/// A line list and what it is for.
#[derive(Debug)]
struct Listed {
    axis: Axis,
    room: lines::Room,
    list: Arc<LineList>,
    /// Of each slab.
    sizes: Vec<Sizes>,
    /// The slab whose lines are on the device.
    on_device: Option<usize>,
}

impl<'a> Renderer<'a> {
    /// A renderer of `scene` on `device`, which needs the limits of WebGPU and may offer `TIMESTAMP_QUERY` (else stages
    /// are not timed) and `FLOAT32_BLENDABLE` (for [`Target::Float32`]).
    ///
    /// # Errors
    /// [`Error::Device`] if the device fails, or cannot blend what `options` asks for.
    pub fn new(device: Device, queue: Queue, scene: Scene<'a>, options: Options) -> Result<Renderer<'a>> {
        check_blends(&device, options.compositor)?;
        let context = Arc::new(Context::new(device, queue, in_flight(options.vram)));
        let is_software = context.device.adapter_info().device_type == DeviceType::Cpu;
        let (stages, timer) = context.watch(|| Ok((Stages::new(&context.device), Timer::new(&context)?)))?;
        Ok(Renderer {
            context,
            stages: Arc::new(stages),
            timer,
            scene,
            options,
            is_software,
            looks: None,
            list: None,
            residents: Vec::new(),
            passage: None,
            scratch: Scratch::default(),
            current: Compositor::Tiles,
            resolver: None,
        })
    }

    /// Shows the scene with another transfer function from the next frame on; lanes stay on the device.
    pub fn set_transfer(&mut self, transfer: &'a TransferFunction) {
        self.scene.transfer = transfer;
        self.looks = None;
    }

    /// How splats become pixels: as asked for; else by tiles, or by quads where the device is a processor, which spends
    /// as long on one of a tile's barriers as on a hundred pixels (docs/studies/gpu.md).
    pub fn compositor(&self) -> Compositor {
        let can_blend = self.context.device.features().contains(Features::FLOAT32_BLENDABLE);
        self.options.compositor.unwrap_or(match self.is_software && can_blend {
            true => Compositor::Quads(Target::Float32),
            false => Compositor::Tiles,
        })
    }

    /// Makes pixels of splats in another way from the next frame on; `None` for the best one.
    ///
    /// # Errors
    /// [`Error::Device`] if the device cannot blend it.
    pub fn set_compositor(&mut self, compositor: Option<Compositor>) -> Result<()> {
        check_blends(&self.context.device, compositor)?;
        self.options.compositor = compositor;
        // All buffers go, so that the other compositor's do not count towards the budget; the list's lines with them.
        self.scratch = Scratch::default();
        self.resolver = None;
        if let Some(listed) = &mut self.list {
            listed.on_device = None;
        }
        Ok(())
    }

    /// Draws a frame.
    ///
    /// `settings.threads` and `settings.code` do not matter. The frame is that of [`cpu::render`](super::cpu::render)
    /// but for rounding, for early termination (quads have none), and for what the target rounds.
    ///
    /// # Errors
    /// As [`cpu::render`](super::cpu::render); [`Error::Device`] if the device fails; [`Error::Limit`] if the video
    /// memory of [`Options::vram`] is too little.
    pub fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<(Frame, Stats)> {
        // A look at all tiles: not for pictures that keep their pixels.
        let bounds = if settings.keeps_pixels() { None } else { self.scene.lanes.lane(Axis::X)?.bounds() };
        let bounds = bounds.map(|(low, high)| VoxelBox { low, high });
        let grid = &self.scene.facts.grid;
        supersampled(grid, bounds, camera, settings, |settings| self.render_probed(camera, settings, None))
    }

    /// As [`Renderer::render`], with a look at the stages' buffers after each chunk.
    ///
    /// # Errors
    /// Likewise.
    pub fn render_probed(
        &mut self,
        camera: &Camera,
        settings: &Settings,
        look: Option<Look>,
    ) -> Result<(Frame, Stats)> {
        check_size(settings.size)?;
        let mut frame = Frame::transparent(settings.size)?;
        let stats = self.draw(camera, settings, Output::Frame(&mut frame), look)?;
        Ok((frame, stats))
    }

    /// Draws a frame into a texture, and does not wait for it: the work is handed to the queue that the renderer has.
    /// Only copies to the device may have to wait for earlier ones.
    ///
    /// `settings.size` is the texture's. Splats are not counted and stages not timed.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn render_to(&mut self, camera: &Camera, settings: &Settings, canvas: &Canvas) -> Result<Stats> {
        if settings.sampling.is_some_and(|sampling| sampling != Sampling::EveryPixel) {
            return Err(Error::input("sampling", "of a texture is of every pixel; supersample by a larger texture"));
        }
        self.draw(camera, settings, Output::Canvas(canvas), None)
    }

    fn draw(&mut self, camera: &Camera, settings: &Settings, output: Output, look: Option<Look>) -> Result<Stats> {
        let start = Instant::now();
        let shot = Shot::new(&self.scene, camera, settings)?;
        if settings.blending != Blending::Exponential {
            let why =
                format!("{} is not for graphics devices; take the processor's renderer", settings.blending.name());
            return Err(Error::input("blending", why));
        }
        let context = self.context.clone();
        let mut stats = Stats::default();
        self.current = self.compositor_for(settings.size);
        let drawn = context.watch(|| {
            let plan = self.plan(&shot, settings)?;
            self.prepare_looks(&shot, settings, &mut stats)?;
            let records = self.prepare_list(&shot, plan, &mut stats)?;
            draw::frame(self, &shot, settings, plan.for_records(records), output, &mut stats, look)
        });
        if let Err(fault) = drawn {
            // Some of what is on the device may not be what it should be.
            self.let_go();
            return Err(fault);
        }
        stats.vram_bytes = self.vram_bytes();
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(stats)
    }

    fn let_go(&mut self) {
        (self.looks, self.list, self.passage, self.resolver) = (None, None, None, None);
        self.residents.clear();
        self.scratch = Scratch::default();
        if let Some(timer) = &mut self.timer {
            timer.clear();
        }
    }

    /// As [`Renderer::compositor`], but that what was not asked for must be able to draw a picture of this size.
    fn compositor_for(&self, size: [u32; 2]) -> Compositor {
        let fits = size.into_iter().all(|side| side <= self.context.limits.max_texture_dimension_2d);
        if fits || self.options.compositor.is_some() { self.compositor() } else { Compositor::Tiles }
    }

    /// The looks of the frame at hand.
    fn table(&self) -> &Table<'a> {
        &self.looks.as_ref().expect("a frame begins with its looks").table
    }

    fn plan(&self, shot: &Shot, settings: &Settings) -> Result<Plan> {
        let channels = shot.lane.channels;
        Plan::new(Question {
            ceiling: self.options.vram,
            most_binding: self.context.most_binding(),
            size: settings.size,
            tables: Looks::need(&shot.lane, self.scene.transfer.uses_gradient() || shot.lane.shown.is_some()),
            widest: [1, channels.value_bits / 8, channels.normal_bits / 4].into_iter().max().unwrap_or(1).into(),
            is_software: self.is_software,
        })
    }

    fn prepare_looks(&mut self, shot: &Shot, settings: &Settings, stats: &mut Stats) -> Result<()> {
        let start = Instant::now();
        let wanted = (settings.mode, settings.exposure);
        if self.looks.as_ref().is_none_or(|looks| (looks.mode, looks.exposure) != wanted) {
            // The old tables go first: the budget counts one set.
            self.looks = None;
            self.looks = Some(Looks::new(&self.context, &self.scene, shot, settings)?);
        }
        stats.upload_ms += start.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    /// Gives the list's records.
    fn prepare_list(&mut self, shot: &Shot, plan: Plan, stats: &mut Stats) -> Result<u64> {
        let start = Instant::now();
        let (axis, key, room) = (shot.order.fast, Key::new(&shot.order), plan.room);
        let fits = |listed: &Listed| listed.axis == axis && listed.room == room && listed.list.key == key;
        if !self.list.as_ref().is_some_and(fits) {
            let list = Arc::new(LineList::new(&shot.lane, &shot.order, room)?);
            let sizes = list.slabs.iter().map(|slab| Sizes::of(&shot.lane, &slab.tiles)).collect::<Result<_>>()?;
            self.list = Some(Listed { axis, room, list, sizes, on_device: None });
            stats.line_lists = 1;
            stats.line_list_ms = start.elapsed().as_secs_f64() * 1e3;
        }
        Ok(self.list.as_ref().map_or(0, |listed| listed.list.records))
    }

    fn vram_bytes(&self) -> u64 {
        let looks = self.looks.as_ref().map_or(0, Looks::bytes);
        let passage = self.passage.as_ref().map_or(0, Residence::bytes);
        looks + passage + self.residents.iter().map(Residence::bytes).sum::<u64>() + self.scratch.bytes()
    }
}

/// # Errors
/// [`Error::Device`] if `device` cannot blend what `compositor` asks for.
fn check_blends(device: &Device, compositor: Option<Compositor>) -> Result<()> {
    if compositor == Some(Compositor::Quads(Target::Float32))
        && !device.features().contains(Features::FLOAT32_BLENDABLE)
    {
        return Err(Error::device("cannot blend 32-bit floats; take tiles, or accumulate in 16 bits"));
    }
    Ok(())
}
