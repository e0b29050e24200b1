//! Splatting: drawing the voxels that a walk visits.
//!
//! In: a [`Scene`] (the voxels and their looks: colour and optical depth of each code), a [`Camera`] and [`Settings`].
//! Out: a [`Frame`] and [`Stats`].
//!
//! ```text
//! walk -> project, classify, shade (stage 1) -> footprints into the picture (stage 2) -> frame
//! ```

pub(crate) mod arith;
pub(crate) mod block_kernel;
pub(crate) mod camera;
pub(crate) mod clip;
pub(crate) mod composite;
pub mod cpu;
pub(crate) mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
pub(crate) mod kernel;
pub(crate) mod level_limits;
pub(crate) mod levels;
pub(crate) mod near;
mod outline;
pub(crate) mod setup;
pub(crate) mod shade;
mod srgb_bytes;
pub(crate) mod supersample;
pub(crate) mod view;

use std::fmt::Display;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde::{Deserialize, Serialize};

use self::block_kernel::Blocks;
use crate::arena::layout::Facts;
use crate::arena::{Detail, Lane, LaneSet, Overlay, OwnedLane};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::traverse::{Order, Sense, SplitForm, VoxelBox};
use crate::volume::Axis;

pub use camera::{Camera, Orbit, Projection, Surround, ToCamera, Up, WorldFrame};
pub use clip::ClipPlane;
pub use composite::{Blending, Mode};
pub use frame::Frame;
pub use kernel::{KernelShape, Quality};
pub use outline::{FILL, Outline};
pub use shade::Lighting;
pub use view::{MAX_SIZE, View};

/// A source of the voxels of a scene, as lanes (a lane is all scan lines along one axis).
pub trait Lanes: Sync {
    /// Returns the lane along `axis`, which may be derived from another lane.
    ///
    /// # Errors
    /// [`Error`] if the lane is missing and cannot be derived.
    fn lane(&self, axis: Axis) -> Result<Lane<'_>>;

    /// Returns the coarser levels of detail, and what they were built with; none by default.
    fn detail(&self) -> Detail<'_> {
        Detail::default()
    }

    /// Returns the lane of `level` along `axis`; level 0 has the voxels themselves.
    ///
    /// # Errors
    /// The errors of [`Lanes::lane`]; [`Error::Input`] if there is no such level.
    fn lane_of(&self, level: usize, axis: Axis) -> Result<Lane<'_>> {
        if level == 0 { self.lane(axis) } else { Err(Error::input("level", format!("{level} is not there"))) }
    }
}

impl Lanes for Vec<OwnedLane> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        let missing = || Error::input("lane", format!("along {} is missing; this view walks along it", axis.name()));
        self.iter().find(|lane| lane.axis == axis).map(OwnedLane::view).ok_or_else(missing)
    }
}

impl Lanes for LaneSet<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane(axis)
    }

    fn detail(&self) -> Detail<'_> {
        self.levels().detail()
    }

    fn lane_of(&self, level: usize, axis: Axis) -> Result<Lane<'_>> {
        self.levels().lane(level, axis, |level| Ok(self.arena().level(level)))
    }
}

impl Lanes for Overlay<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane(axis)
    }
}

/// The voxels that a frame shows, and their looks (colour and optical depth).
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    /// The grid, and the meaning of the voxels' codes.
    pub facts: &'a Facts,
    /// The source of the voxels.
    pub lanes: &'a dyn Lanes,
    /// The transfer function: the colours and opacities of values.
    pub transfer: &'a TransferFunction,
}

impl std::fmt::Debug for Scene<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scene").field("facts", self.facts).field("transfer", self.transfer).finish_non_exhaustive()
    }
}

/// Selects the machine code that draws, for tests, benches and studies. All choices give the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Code {
    /// Uses the best instructions that this processor has.
    #[default]
    Best,
    /// Uses no instructions beyond AVX2.
    Avx2,
    /// Uses instructions that every processor of this architecture has.
    Portable,
    /// The plain renderer: one thread, one voxel and one pixel after the other.
    Plain,
}

/// The settings of a frame: size, quality, compositing mode, light, crop, clip plane and sampling.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Settings {
    /// Columns and rows of the picture, each 1 to 16,384.
    pub size: [u32; 2],
    /// How exact the picture is: sets kernel, termination and sampling, unless the fields below set them.
    pub quality: Quality,
    /// How the splats on a ray are combined to a pixel.
    pub mode: Mode,
    /// How much light a composited splat absorbs. Blendings other than [`Blending::Exponential`] work only on the processor
    /// (not on a graphics device) and front to back.
    pub blending: Blending,
    /// The light, used if the transfer function is shaded and the voxels have normals; `None` turns it off.
    pub lighting: Option<Lighting>,
    /// The box of voxels to draw; `None` draws all voxels.
    pub crop: Option<VoxelBox>,
    /// A plane; voxels whose centres lie behind it are not drawn. `None` draws both sides.
    pub clip: Option<ClipPlane>,
    /// Number of threads, at least 1.
    pub threads: usize,
    /// The direction of compositing. Only front to back ends rays early; the picture is the same up to rounding.
    pub sense: Sense,
    /// How a walk alternates between the voxels on the two sides of the eye.
    pub form: SplitForm,
    /// The order of the walk, for studies; `None` derives it from the camera, as the maximum modes always do. Compositing
    /// still follows `sense`.
    pub order: Option<Order>,
    /// Transmittance below which a ray ends, 0 to 1; `None` uses that of `quality`.
    pub termination: Option<f32>,
    /// The reconstruction kernel; `None` uses that of `quality`.
    pub kernel: Option<KernelShape>,
    /// In perspective: world distance along the view axis below which voxels are not drawn, above 0. `None` draws all
    /// that lies in front of the eye, also parts of kernels.
    pub near: Option<f64>,
    /// Factor on the optical depths of [`Mode::Additive`], above 0. With `None`, a typical ray has three quarters of
    /// full brightness; the factor is the same for every view of a scene.
    pub exposure: Option<f32>,
    /// How many samples are drawn; `None` uses the sampling of `quality`. A graphics device and the judge (a second
    /// renderer, for tests) draw [`Sampling::Finer`] for [`Sampling::Enough`] and [`Sampling::Fewest`].
    pub sampling: Option<Sampling>,
    /// The level of detail to draw, 0 for the voxels themselves; `None` draws the coarsest levels that keep the accuracy of
    /// `quality`, place by place.
    pub level: Option<usize>,
    /// How many points of level 0 a voxel of the scene stands for.
    pub(crate) blocks: Blocks,
    /// Number of samples that are drawn at once where there are several a pixel.
    pub(crate) strip_samples: u32,
    /// The low-pass of splats: the smallest standard deviation of a footprint, in samples. The processor's renderer finds its own.
    pub(crate) low_pass: f32,
    /// The machine code that draws.
    pub code: Code,
    /// Asks the renderer to stop, on the processor or on a graphics device; `None` for never.
    pub stop: Option<StopRequest>,
}

/// A request to stop drawing, from any thread; clones share it.
#[derive(Debug, Clone, Default)]
pub struct StopRequest(Arc<AtomicBool>);

impl StopRequest {
    /// Makes the request. It cannot be taken back.
    pub fn make(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns whether the request was made.
    pub fn is_made(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Whether they are one request.
impl PartialEq for StopRequest {
    fn eq(&self, other: &StopRequest) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// How many samples a renderer draws for the pixels of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sampling {
    /// One sample for every pixel.
    #[serde(rename = "every")]
    EveryPixel,
    /// Supersamples where voxels are smaller than pixels, then filters with a Gaussian. At most 2^24 samples, so that
    /// pictures above 2,048 x 2,048 pixels have one sample per pixel. Composited pictures only.
    Finer,
    /// As many samples as the footprints need, on a plane parallel to the slices, which is then warped to the picture
    /// (shear-warp; Lacroute and Levoy 1994). Where the plane cannot be used (docs/NUMERICS.md lists the cases), the same
    /// as [`Sampling::Finer`]. The error is in docs/studies/sampling.md.
    Enough,
    /// Fewer samples than [`Sampling::Enough`], for a moving camera. The worst scenes measured are in docs/OPTICS.md, section 11.
    Fewest,
}

impl Sampling {
    /// All samplings, from fast to exact.
    pub const ALL: [Sampling; 4] = [Sampling::Fewest, Sampling::Enough, Sampling::EveryPixel, Sampling::Finer];

    /// Returns the name that commands and tables use.
    pub fn name(self) -> &'static str {
        match self {
            Sampling::EveryPixel => "every",
            Sampling::Finer => "finer",
            Sampling::Enough => "enough",
            Sampling::Fewest => "fewest",
        }
    }

    /// Returns one of two numbers: that of [`Sampling::Enough`] and all others, then that of [`Sampling::Fewest`].
    pub(crate) fn pick(self, [enough, fewest]: [f64; 2]) -> f64 {
        if self == Sampling::Fewest { fewest } else { enough }
    }
}

impl Settings {
    /// Returns settings of standard quality: composited front to back, lit, on all processors.
    ///
    /// `size`: columns and rows, each 1 to 16,384.
    pub fn new(size: [u32; 2]) -> Settings {
        Settings {
            size,
            quality: Quality::default(),
            mode: Mode::default(),
            blending: Blending::default(),
            lighting: Some(Lighting::default()),
            crop: None,
            clip: None,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            sense: Sense::FrontToBack,
            form: SplitForm::default(),
            order: None,
            termination: None,
            kernel: None,
            near: None,
            exposure: None,
            sampling: None,
            level: None,
            blocks: Blocks::NONE,
            strip_samples: supersample::STRIP_SAMPLES,
            low_pass: kernel::LOW_PASS,
            code: Code::default(),
            stop: None,
        }
    }

    /// Returns settings for comparing renderers: one sample for every pixel, one thread, exposure 1.
    pub fn every_pixel(size: [u32; 2]) -> Settings {
        let sampling = Some(Sampling::EveryPixel);
        Settings { threads: 1, exposure: Some(1.0), sampling, ..Settings::new(size) }
    }

    /// Sets the columns and rows of the picture, each 1 to 16,384.
    pub fn with_size(self, size: [u32; 2]) -> Settings {
        Settings { size, ..self }
    }

    /// Sets how exact the picture is.
    pub fn with_quality(self, quality: Quality) -> Settings {
        Settings { quality, ..self }
    }

    /// Sets how the splats on a ray are combined.
    pub fn with_mode(self, mode: Mode) -> Settings {
        Settings { mode, ..self }
    }

    /// Sets how much light a composited splat absorbs.
    pub fn with_blending(self, blending: Blending) -> Settings {
        Settings { blending, ..self }
    }

    /// Sets the light; `None` turns it off.
    pub fn with_lighting(self, lighting: impl Into<Option<Lighting>>) -> Settings {
        Settings { lighting: lighting.into(), ..self }
    }

    /// Draws only the voxels in this box.
    pub fn with_crop(self, crop: impl Into<Option<VoxelBox>>) -> Settings {
        Settings { crop: crop.into(), ..self }
    }

    /// Draws only the voxels in front of this plane.
    pub fn with_clip(self, clip: impl Into<Option<ClipPlane>>) -> Settings {
        Settings { clip: clip.into(), ..self }
    }

    /// Sets the number of threads, at least 1.
    pub fn with_threads(self, threads: usize) -> Settings {
        Settings { threads, ..self }
    }

    /// Sets the direction of compositing.
    pub fn with_sense(self, sense: Sense) -> Settings {
        Settings { sense, ..self }
    }

    /// Sets how a walk alternates between the two sides of the eye.
    pub fn with_form(self, form: SplitForm) -> Settings {
        Settings { form, ..self }
    }

    /// Sets the order of the walk, for studies.
    pub fn with_order(self, order: impl Into<Option<Order>>) -> Settings {
        Settings { order: order.into(), ..self }
    }

    /// Sets the transmittance below which a ray ends, 0 to 1.
    pub fn with_termination(self, termination: impl Into<Option<f32>>) -> Settings {
        Settings { termination: termination.into(), ..self }
    }

    /// Sets the reconstruction kernel.
    pub fn with_kernel(self, kernel: impl Into<Option<KernelShape>>) -> Settings {
        Settings { kernel: kernel.into(), ..self }
    }

    /// Sets the distance from the eye, along the view axis, below which voxels are not drawn.
    pub fn with_near(self, near: impl Into<Option<f64>>) -> Settings {
        Settings { near: near.into(), ..self }
    }

    /// Sets the brightness of [`Mode::Additive`]: a factor above 0.
    pub fn with_exposure(self, exposure: impl Into<Option<f32>>) -> Settings {
        Settings { exposure: exposure.into(), ..self }
    }

    /// Sets how many samples are drawn.
    pub fn with_sampling(self, sampling: impl Into<Option<Sampling>>) -> Settings {
        Settings { sampling: sampling.into(), ..self }
    }

    /// Sets the level of detail to draw; `None` leaves the choice to the view and the quality.
    pub fn with_level(self, level: impl Into<Option<usize>>) -> Settings {
        Settings { level: level.into(), ..self }
    }

    /// Stops drawing with [`Error::Interrupted`] once the request is made: within milliseconds on the processor, and on a graphics
    /// device before its next chunk of voxels.
    pub fn with_stop(self, stop: impl Into<Option<StopRequest>>) -> Settings {
        Settings { stop: stop.into(), ..self }
    }

    /// Returns [`Error::Interrupted`] if the settings' stop is requested: a walk then left out voxels.
    pub(crate) fn check_stop(&self) -> Result<()> {
        if self.stop.as_ref().is_some_and(StopRequest::is_made) { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// Selects the machine code that draws, for tests and studies.
    pub fn with_code(self, code: Code) -> Settings {
        Settings { code, ..self }
    }

    /// Returns the sampling to use: the one that is set, or else that of the quality.
    pub fn sampling(&self) -> Sampling {
        self.sampling.unwrap_or_else(|| self.quality.sampling())
    }

    /// Returns the kernel to use: the one that is set, or else that of the quality.
    pub fn kernel(&self) -> KernelShape {
        self.blocks.widest(self.fine_kernel())
    }

    /// Returns the kernel to use for voxels of at most this optical depth, along a ray as long as the mean spacing. Where few samples
    /// are drawn, kernels of faint voxels are cut off earlier.
    pub(crate) fn kernel_of_depth(&self, deepest: f64, view: &View) -> KernelShape {
        match self.sampling() {
            Sampling::EveryPixel | Sampling::Finer => self.kernel(),
            Sampling::Enough | Sampling::Fewest => {
                self.kernel().of_depth(deepest * view.steps.into_iter().fold(0.0, f64::max))
            }
        }
    }

    /// Returns the kernel of level 0.
    pub(crate) fn fine_kernel(&self) -> KernelShape {
        self.kernel.unwrap_or_else(|| self.quality.kernel())
    }

    /// Returns the transmittance below which a ray ends.
    pub fn termination(&self) -> f32 {
        self.termination.unwrap_or_else(|| self.quality.termination())
    }

    /// Returns whether every pixel gets exactly one sample, whatever the view.
    pub fn keeps_pixels(&self) -> bool {
        match (self.mode, self.sampling()) {
            (Mode::Maximum | Mode::MaximumGrey, _) | (_, Sampling::EveryPixel) | (Mode::Additive, Sampling::Finer) => {
                true
            }
            (Mode::Composite | Mode::Additive, _) => false,
        }
    }

    /// Checks all settings except size and near distance, which [`View::new`] checks.
    ///
    /// # Errors
    /// [`Error::Input`] that names the setting.
    pub fn check(&self) -> Result<()> {
        self.kernel().check()?;
        let termination = self.termination();
        require(
            (0.0..=1.0).contains(&termination),
            "termination",
            format_args!("is {termination}, but must be 0 to 1"),
        )?;
        if let Some(exposure) = self.exposure {
            require_positive(exposure, "exposure")?;
        }
        let is_composited = self.mode == Mode::Composite && self.sense == Sense::FrontToBack;
        let why = format_args!("is {}, but only front-to-back composites have that", self.blending.name());
        require(self.blending == Blending::Exponential || is_composited, "blending", why)?;
        require(self.threads > 0, "threads", "are 0, but must be at least 1")?;
        self.lighting.map_or(Ok(()), |lighting| lighting.check())?;
        require(self.crop.is_none_or(|crop| crop.is_ordered()), "crop", "has a low end above its high end")?;
        self.clip.map_or(Ok(()), |plane| plane.check())
    }
}

/// Returns an input error that names `what` and says `why`, unless `holds`.
fn require(holds: bool, what: &str, why: impl Display) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::input(what, why.to_string())) }
}

/// Returns an input error that names `what`, unless the number is finite and above 0.
fn require_positive<T: Into<f64> + Display + Copy>(number: T, what: &str) -> Result<()> {
    let is_positive = number.into().is_finite() && number.into() > 0.0;
    require(is_positive, what, format_args!("is {number}, but must be finite and above 0"))
}

/// Returns an input error if a picture has no columns or rows.
fn require_pixels(size: [u32; 2]) -> Result<()> {
    require(!size.contains(&0), "picture size", "is 0, but must be at least 1 in both directions")
}

/// Counts and times of drawing a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct Stats {
    /// Number of splats that reached the picture. A splat on the border between two threads' parts counts twice.
    pub splats_drawn: u64,
    /// Number of voxels that were visited but not drawn: outside the picture, or occluded. Transparent voxels may be left out of
    /// this count.
    pub splats_skipped: u64,
    /// Number of bands (parts of the picture, one per thread) that were drawn at a time.
    pub bands: usize,
    /// Time of the whole frame, in milliseconds.
    pub frame_ms: f64,
    /// Time of walking over the voxels, summed over threads, in milliseconds.
    pub walk_ms: f64,
    /// Time of projecting and drawing the voxels, summed over threads, in milliseconds.
    pub draw_ms: f64,
}

impl Stats {
    /// Adds the counts and times of another part of the frame, which was drawn after this one.
    pub(crate) fn add(&mut self, part: &Stats) {
        self.splats_drawn += part.splats_drawn;
        self.splats_skipped += part.splats_skipped;
        self.bands = self.bands.max(part.bands);
        self.frame_ms += part.frame_ms;
        self.walk_ms += part.walk_ms;
        self.draw_ms += part.draw_ms;
    }
}
