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
//! slow axis. A picture that is too large is drawn in windows. The pixels do not depend on any of this.

pub mod adapter;
mod budget;
mod chunks;
mod context;
mod draw;
pub mod layout;
mod lines;
mod looks;
pub mod probe;
mod residence;
pub mod stages;
mod timing;
pub mod twin;

use std::sync::Arc;
use std::time::Instant;

use wgpu::{Device, Features, Queue};

use self::budget::{Plan, Question};
use self::context::Context;
use self::draw::Scratch;
use self::lines::{Key, LineList};
use self::looks::Looks;
use self::probe::Look;
use self::residence::{Residence, Sizes};
use self::stages::Stages;
use self::timing::Timer;
use super::composite::Table;
use super::frame::Frame;
use super::shot::Shot;
use super::{Camera, Mode, Scene, Settings};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
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
    /// The tables, and the mode and exposure they are for.
    looks: Option<(Mode, Option<f32>, Table<'a>, Looks)>,
    list: Option<Listed>,
    /// Lanes that are on the device as a whole, the last used last.
    residents: Vec<Residence>,
    /// Where slabs pass through.
    passage: Option<(Sizes, Residence)>,
    scratch: Scratch,
}

/// A line list and what it is for.
#[derive(Debug)]
struct Listed {
    axis: Axis,
    room: lines::Room,
    list: Arc<LineList>,
    /// The slab whose lines are on the device.
    on_device: Option<usize>,
}

impl<'a> Renderer<'a> {
    /// A renderer of `scene` on `device`, which needs the limits of WebGPU and may offer `TIMESTAMP_QUERY` (else stages
    /// are not timed) and `FLOAT32_BLENDABLE` (for [`Target::Float32`]).
    ///
    /// # Errors
    /// [`Error::Device`] if the device fails; [`Error::Input`] if it cannot blend what `options` asks for.
    pub fn new(device: Device, queue: Queue, scene: Scene<'a>, options: Options) -> Result<Renderer<'a>> {
        if options.compositor == Some(Compositor::Quads(Target::Float32))
            && !device.features().contains(Features::FLOAT32_BLENDABLE)
        {
            let why = "cannot blend 32-bit floats; take tiles, or accumulate in 16 bits";
            return Err(Error::device(why));
        }
        let context = Arc::new(Context::new(device, queue));
        let (stages, timer) = context.watch(|| Ok((Stages::new(&context.device), Timer::new(&context)?)))?;
        Ok(Renderer {
            context,
            stages: Arc::new(stages),
            timer,
            scene,
            options,
            looks: None,
            list: None,
            residents: Vec::new(),
            passage: None,
            scratch: Scratch::default(),
        })
    }

    /// Shows the scene with another transfer function from the next frame on; lanes stay on the device.
    pub fn set_transfer(&mut self, transfer: &'a TransferFunction) {
        self.scene.transfer = transfer;
        self.looks = None;
    }

    /// How splats become pixels on this device.
    pub fn compositor(&self) -> Compositor {
        self.options.compositor.unwrap_or(Compositor::Tiles)
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
        self.render_probed(camera, settings, None)
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
        let start = Instant::now();
        let shot = Shot::new(&self.scene, camera, settings)?;
        let context = self.context.clone();
        let (frame, mut stats) = context.watch(|| self.draw(&shot, settings, look))?;
        stats.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok((frame, stats))
    }

    fn draw(&mut self, shot: &Shot<'a>, settings: &Settings, look: Option<Look>) -> Result<(Frame, Stats)> {
        let mut stats = Stats::default();
        self.prepare_looks(shot, settings, &mut stats)?;
        let plan = self.plan(shot, settings)?;
        self.prepare_list(shot, plan, &mut stats)?;
        let frame = draw::frame(self, shot, settings, plan, &mut stats, look)?;
        stats.vram_bytes = self.vram_bytes();
        Ok((frame, stats))
    }

    fn plan(&self, shot: &Shot, settings: &Settings) -> Result<Plan> {
        let channels = shot.lane.channels;
        Plan::new(Question {
            ceiling: self.options.vram,
            most_binding: self.context.most_binding(),
            size: settings.size,
            tables: Looks::need(&shot.lane, self.scene.transfer.uses_gradient() || shot.lane.shown.is_some()),
            widest: [1, channels.value_bits / 8, channels.normal_bits / 4].into_iter().max().unwrap_or(1).into(),
        })
    }

    fn prepare_looks(&mut self, shot: &Shot, settings: &Settings, stats: &mut Stats) -> Result<()> {
        let start = Instant::now();
        let (mode, exposure) = (settings.mode, settings.exposure);
        if self.looks.as_ref().is_none_or(|(m, e, ..)| (*m, *e) != (mode, exposure)) {
            let table = Table::new(&self.scene, &shot.lane, settings, shot.view.mean_voxel)?;
            let looks = Looks::new(&self.context, &table, &shot.lane)?;
            self.looks = Some((mode, exposure, table, looks));
        }
        stats.upload_ms += start.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    fn prepare_list(&mut self, shot: &Shot, plan: Plan, stats: &mut Stats) -> Result<()> {
        let start = Instant::now();
        let (axis, key, room) = (shot.order.fast, Key::new(&shot.order), plan.room);
        let fits = |listed: &Listed| listed.axis == axis && listed.room == room && listed.list.key == key;
        if !self.list.as_ref().is_some_and(fits) {
            let list = Arc::new(LineList::new(&shot.lane, &shot.order, room)?);
            self.list = Some(Listed { axis, room, list, on_device: None });
            stats.line_lists = 1;
            stats.line_list_ms = start.elapsed().as_secs_f64() * 1e3;
        }
        Ok(())
    }

    fn vram_bytes(&self) -> u64 {
        let looks = self.looks.as_ref().map_or(0, |(.., looks)| looks.bytes());
        let passage = self.passage.as_ref().map_or(0, |(_, residence)| residence.bytes());
        looks + passage + self.residents.iter().map(Residence::bytes).sum::<u64>() + self.scratch.bytes()
    }
}
