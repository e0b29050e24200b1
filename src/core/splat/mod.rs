//! Splatting: what a walk visits, drawn.
//!
//! In: a [`Scene`] (lanes and what their codes mean), a [`Camera`] and [`Settings`]. Out: a [`Frame`] of linear
//! premultiplied colours and [`Stats`].
//!
//! ```text
//! walk -> project, classify, shade (stage 1) -> footprints into the picture (stage 2) -> frame
//! ```

pub(crate) mod arith;
pub mod camera;
pub mod composite;
pub mod cpu;
pub mod finer;
pub mod frame;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod kernel;
pub mod shade;
pub(crate) mod shot;
pub mod view;

use serde::{Deserialize, Serialize};

use crate::arena::layout::Facts;
use crate::arena::{Lane, LaneSet, Overlay, OwnedLane};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::traverse::{Order, Sense, SplitForm, VoxelBox};
use crate::volume::Axis;

pub use camera::{Camera, Orbit, Projection, Surround, Up};
pub use composite::{Blending, Mode};
pub use frame::Frame;
pub use kernel::{KernelShape, Quality};
pub use shade::Lighting;
pub use view::View;

/// Where a frame's lanes come from.
pub trait Lanes: Sync {
    /// The lane along `axis`, derived if it must be.
    ///
    /// # Errors
    /// If the lane can neither be had nor derived.
    fn lane(&self, axis: Axis) -> Result<Lane<'_>>;
}

impl Lanes for Vec<OwnedLane> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.iter().find(|lane| lane.axis == axis).map(OwnedLane::view).ok_or_else(|| missing(axis))
    }
}

impl Lanes for LaneSet<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane(axis)
    }
}

impl Lanes for Overlay<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane(axis)
    }
}

fn missing(axis: Axis) -> Error {
    Error::input("lane", format!("along {} is not there, but this view walks along it", axis.name()))
}

/// What a frame shows.
#[derive(Clone, Copy)]
pub struct Scene<'a> {
    /// Where the voxels are and what their codes mean.
    pub facts: &'a Facts,
    /// The voxels.
    pub lanes: &'a dyn Lanes,
    /// What values look like.
    pub transfer: &'a TransferFunction,
}

impl std::fmt::Debug for Scene<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scene").field("facts", self.facts).field("transfer", self.transfer).finish_non_exhaustive()
    }
}

/// Which code draws: for tests, benches and studies. All give the same bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Code {
    /// The best that this processor runs.
    #[default]
    Best,
    /// At most AVX2.
    Avx2,
    /// What every processor of this architecture runs.
    Portable,
    /// The plain twin: one thread, one voxel and one pixel after the other.
    Plain,
}

/// How a frame is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Columns and rows, each 1 to 16,384.
    pub size: [u32; 2],
    /// Kernel and termination.
    pub quality: Quality,
    /// How splats are put together.
    pub mode: Mode,
    /// What composited splats take of the light; other than [`Blending::Exponential`] front to back only, and by the
    /// processor's renderer alone.
    pub blending: Blending,
    /// Lighting where the transfer function is shaded and voxels have normals; `None` for none.
    pub lighting: Option<Lighting>,
    /// Only voxels in this box are drawn.
    pub crop: Option<VoxelBox>,
    /// Threads, at least 1.
    pub threads: usize,
    /// The order of the walk. Only front to back ends rays early; the picture is the same up to rounding.
    pub sense: Sense,
    /// How the two sides of the eye follow each other.
    pub form: SplitForm,
    /// Takes the place of the order that the camera asks for: for studies of what order is worth. `sense` still says how
    /// splats are composited.
    pub order: Option<Order>,
    /// Takes the place of the quality's termination: 0 to 1.
    pub termination: Option<f32>,
    /// Takes the place of the quality's kernel.
    pub kernel: Option<KernelShape>,
    /// World distance along the view axis below which voxels are not drawn; `None` for the kernel's reach.
    pub near: Option<f64>,
    /// Factor on the optical depths of [`Mode::Additive`], above 0; `None`: such that a typical ray through the
    /// visible voxels comes out at three quarters of full brightness, the same for every view of a scene.
    pub exposure: Option<f32>,
    /// How many samples are drawn for the picture's pixels; `None` for what suits the quality. A graphics device and the
    /// judge take [`Sampling::Enough`] and [`Sampling::Fewest`] for [`Sampling::Finer`].
    pub sampling: Option<Sampling>,
    /// Which code draws.
    pub code: Code,
}

/// How many pixels are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sampling {
    /// One sample for every pixel.
    #[serde(rename = "every")]
    EveryPixel,
    /// Supersamples where voxels are smaller than pixels, then filters with a Gaussian. At most 2^24 samples, so that
    /// pictures above 2,048 x 2,048 pixels have one sample a pixel. Composited pictures only.
    Finer,
    /// As many samples as the footprints need, interpolated between. In a parallel view of small voxels that is one for
    /// each scan line, on the plane of the slices (shear-warp; Lacroute and Levoy 1994); elsewhere work falls with the
    /// square of the magnification. Supersamples as [`Sampling::Finer`] where voxels are smaller than pixels. Its error
    /// is in docs/studies/sampling.md.
    Enough,
    /// Fewer samples, for a moving camera: enough for 32 dB.
    Fewest,
}

impl Sampling {
    /// All of them.
    pub const ALL: [Sampling; 4] = [Sampling::Fewest, Sampling::Enough, Sampling::EveryPixel, Sampling::Finer];

    /// Its name in commands and tables.
    pub fn name(self) -> &'static str {
        match self {
            Sampling::EveryPixel => "every",
            Sampling::Finer => "finer",
            Sampling::Enough => "enough",
            Sampling::Fewest => "fewest",
        }
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
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            sense: Sense::FrontToBack,
            form: SplitForm::default(),
            order: None,
            termination: None,
            kernel: None,
            near: None,
            exposure: None,
            sampling: None,
            code: Code::default(),
        }
    }

    /// Returns settings under which every pixel is computed by itself, by one thread, at exposure 1: for comparing renderers.
    pub fn every_pixel(size: [u32; 2]) -> Settings {
        let sampling = Some(Sampling::EveryPixel);
        Settings { threads: 1, exposure: Some(1.0), sampling, ..Settings::new(size) }
    }

    /// Returns the sampling in force.
    pub fn sampling(&self) -> Sampling {
        self.sampling.unwrap_or_else(|| self.quality.sampling())
    }

    /// The kernel in force.
    pub fn kernel(&self) -> KernelShape {
        self.kernel.unwrap_or_else(|| self.quality.kernel())
    }

    /// The termination in force.
    pub fn termination(&self) -> f32 {
        self.termination.unwrap_or_else(|| self.quality.termination())
    }

    /// Whether a picture's own pixels are drawn, whatever the view.
    pub fn keeps_pixels(&self) -> bool {
        self.mode != Mode::Composite || self.sampling() == Sampling::EveryPixel
    }

    /// Checks what is not checked by type; [`View::new`] checks size and near distance.
    ///
    /// # Errors
    /// [`Error::Input`] that names the setting.
    pub fn check(&self) -> Result<()> {
        self.kernel().check()?;
        if !(0.0..=1.0).contains(&self.termination()) {
            let why = format!("is {}, but must be 0 to 1", self.termination());
            return Err(Error::input("termination", why));
        }
        if let Some(exposure) = self.exposure.filter(|exposure| !(exposure.is_finite() && *exposure > 0.0)) {
            return Err(Error::input("exposure", format!("is {exposure}, but must be finite and above 0")));
        }
        let is_composited = self.mode == Mode::Composite && self.sense == Sense::FrontToBack;
        if self.blending != Blending::Exponential && !is_composited {
            let why = format!(
                "is {}, but that is for composited pictures, front to back; leave it out",
                self.blending.name()
            );
            return Err(Error::input("blending", why));
        }
        if self.threads == 0 {
            return Err(Error::input("threads", "are 0, but must be at least 1"));
        }
        if let Some(lighting) = &self.lighting {
            lighting.check()?;
        }
        match self.crop {
            Some(crop) if (0..3).any(|a| crop.low[a] > crop.high[a]) => {
                Err(Error::input("crop", "has a low end above its high end"))
            }
            _ => Ok(()),
        }
    }
}

/// What drawing a frame took.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stats {
    /// Splats that reached the picture. One on the border of two threads' bands, or of two strips of finer pixels, counts twice.
    pub splats_drawn: u64,
    /// Voxels that were visited but not drawn: transparent, off the picture, or behind what is opaque.
    pub splats_skipped: u64,
    /// Bands of what is drawn at a time, one per thread.
    pub bands: usize,
    /// Milliseconds of the whole frame.
    pub frame_ms: f64,
    /// Milliseconds of walking, summed over threads.
    pub walk_ms: f64,
    /// Milliseconds of projecting and drawing, summed over threads.
    pub draw_ms: f64,
}
