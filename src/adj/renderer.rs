//! Chooses the renderer: the processor, a graphics device, or the reference.
//!
//! In: `--renderer`, `--adapter`, `--vram`, `--compositor`, `--accumulate`. Out: frames, and numbers for `--stats`.

use std::collections::BTreeSet;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::composite::mode_name;
#[cfg(feature = "gpu")]
use super::on_device::OnDevice;
use super::print_note;
use super::size::video_memory;
use adjsplat::classify::TransferFunction;
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};
use adjsplat::internals::level_parts;
use adjsplat::splat::{Blending, Camera, Frame, Sampling, Scene, Settings, cpu};
use adjsplat_judge::reference::Judge;
use adjsplat_pictures::PicturePart;

/// The flags that choose a renderer.
#[derive(Debug, Args)]
#[command(next_help_heading = "Renderer")]
pub(super) struct RendererArguments {
    /// What draws the picture
    #[arg(long, value_name = "R", value_enum, default_value_t = RendererName::Auto)]
    renderer: RendererName,
    /// Graphics device to use: a part of its name or driver, as adj devices prints them; the best one by default
    #[arg(long, value_name = "NAME")]
    pub(super) adapter: Option<String>,
    /// Most video memory to take, from 16MiB: 500MB, 2GiB; 1GiB by default. The picture is the same
    #[arg(long, value_name = "SIZE", value_parser = video_memory)]
    pub(super) vram: Option<u64>,
    /// How a graphics device draws splats; tiles by default (quads if the device is software), and always in the modes maximum and
    /// maximum-grey
    #[arg(long, value_name = "C")]
    pub(super) compositor: Option<CompositorName>,
    /// Bits of each sample while a graphics device blends quads; 32 by default. 16 and 8 may be faster, but are wrong
    /// for faint voxels; adj prints by how much
    #[arg(long, value_name = "BITS")]
    pub(super) accumulate: Option<AccumulateBits>,
}

/// Values of `--renderer`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RendererName {
    /// A graphics device that is not software, if there is one; else the processor
    Auto,
    /// The processor
    Cpu,
    /// A graphics device
    Gpu,
    /// Double precision, slow, from a volume only: the picture that the others approach at --quality reference
    Reference,
}

/// Values of `--compositor`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum CompositorName {
    /// Compute shaders, which stop at opaque pixels
    Tiles,
    /// Rectangles that the device blends
    Quads,
}

/// Values of `--accumulate`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum AccumulateBits {
    #[value(name = "32")]
    Float32,
    #[value(name = "16")]
    Float16,
    #[value(name = "8")]
    Unorm8,
}

/// Counts and times of one frame.
#[derive(Debug)]
pub(super) struct FrameStats {
    pub(super) splats_drawn: u64,
    pub(super) splats_skipped: u64,
    pub(super) frame_ms: f64,
    /// Names and values of numbers that only one kind of renderer has.
    pub(super) others: Vec<(&'static str, Value)>,
}

/// A renderer, with the scene that it draws.
pub(super) enum Renderer<'a> {
    Cpu(Scene<'a>),
    #[cfg(feature = "gpu")]
    Gpu(Box<OnDevice<'a>>),
    Reference(Box<Judge>),
    /// A collection, brick by brick, with the transfer function of the whole; and which part of how many to draw, from 1.
    Bricks(&'a Collection, TransferFunction, [usize; 2]),
}

impl RendererArguments {
    /// Returns whether the user asks for the reference, which draws volumes only.
    pub(super) fn is_reference(&self) -> bool {
        self.renderer == RendererName::Reference
    }

    /// Returns whether the video memory of a graphics device is bounded.
    pub(super) fn bounds_device(&self) -> bool {
        self.vram.is_some()
    }

    /// Returns whether quads are blended in so few bits that it changes pictures.
    pub(super) fn has_few_bits(&self) -> bool {
        matches!(self.accumulate, Some(AccumulateBits::Float16 | AccumulateBits::Unorm8))
    }

    /// Returns the flags for graphics devices, and whether each is on the command line.
    fn of_devices(&self) -> [(&'static str, bool); 4] {
        [
            ("--adapter", self.adapter.is_some()),
            ("--vram", self.vram.is_some()),
            ("--compositor", self.compositor.is_some()),
            ("--accumulate", self.accumulate.is_some()),
        ]
    }

    /// Returns the reference as a renderer.
    ///
    /// # Errors
    /// [`Error::Input`] if a flag for graphics devices is given.
    pub(super) fn reference(&self, judge: Judge) -> Result<Renderer<'static>> {
        match self.of_devices().into_iter().find(|(_, is_given)| *is_given) {
            Some((flag, _)) => Err(Error::input(flag, "is for graphics devices; leave it out")),
            None => Ok(Renderer::Reference(Box::new(judge))),
        }
    }

    /// Refuses flags for renderers that do not draw brick by brick.
    pub(super) fn require_processor(&self) -> Result<()> {
        let given = self.of_devices().into_iter().find(|(_, is_given)| *is_given).map(|(flag, _)| flag);
        match given.or((!matches!(self.renderer, RendererName::Auto | RendererName::Cpu)).then_some("--renderer")) {
            Some(flag) => Err(Error::input(flag, "is not for --bricks, which the processor draws; leave it out")),
            None => Ok(()),
        }
    }

    /// Returns the renderer that the flags ask for.
    ///
    /// `is_bounded` says that `--memory` is given, which no graphics driver obeys. Devices know exponential `blending`
    /// only.
    ///
    /// # Errors
    /// [`Error::Device`] if a graphics device was asked for and cannot be had; [`Error::Input`] for a flag out of
    /// place.
    pub(super) fn renderer<'a>(&self, scene: Scene<'a>, is_bounded: bool, blending: Blending) -> Result<Renderer<'a>> {
        let is_for_devices = blending == Blending::Exponential;
        match (self.renderer, self.of_devices().into_iter().find(|(_, is_given)| *is_given)) {
            (RendererName::Cpu, Some((flag, _))) => Err(Error::input(flag, "is for graphics devices; leave it out")),
            (RendererName::Cpu, None) => Ok(Renderer::Cpu(scene)),
            (RendererName::Reference, _) => Err(needs_volume()),
            (RendererName::Auto, None) if !is_for_devices => Ok(Renderer::Cpu(scene)),
            _ if !is_for_devices => {
                let why = format!("{} is not for graphics devices; take --renderer cpu", blending.name());
                Err(Error::input("--blending", why))
            }
            (RendererName::Auto, _) if is_bounded && self.adapter.is_none() => Ok(self.processor(scene)),
            _ if is_bounded => {
                let why = "cannot be kept by a graphics driver; leave it out (--vram bounds the device), or take --renderer cpu";
                Err(Error::input("--memory", why))
            }
            (which, _) => self.device_or_cpu(scene, which == RendererName::Auto),
        }
    }

    /// Returns the processor's renderer where the user may have thought of a device, and says so.
    pub(super) fn processor<'a>(&self, scene: Scene<'a>) -> Renderer<'a> {
        if let Some((flag, _)) = self.of_devices().into_iter().find(|(_, is_given)| *is_given) {
            print_note(&format!("note: {flag} is for graphics devices, but the processor draws"));
        }
        Renderer::Cpu(scene)
    }

    #[cfg(not(feature = "gpu"))]
    fn device_or_cpu<'a>(&self, scene: Scene<'a>, is_auto: bool) -> Result<Renderer<'a>> {
        match is_auto && self.adapter.is_none() {
            true => Ok(self.processor(scene)),
            false => Err(Error::device("support was left out of this program; take --renderer cpu")),
        }
    }
}

impl<'a> Renderer<'a> {
    /// Draws a frame. With `fit`, where it does not fit into the video memory, this draws the finest level of detail that fits,
    /// which it sets in `settings`.
    ///
    /// # Errors
    /// Any error of the renderer. If a device fails that the user did not choose, the processor draws instead, with a
    /// note.
    pub(super) fn render(
        &mut self,
        camera: &Camera,
        settings: &mut Settings,
        #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only devices have a bound of their own"))]
        fit: bool,
    ) -> Result<(Frame, FrameStats)> {
        #[cfg(feature = "gpu")]
        if let Renderer::Gpu(on_device) = self {
            match on_device.render(camera, settings, fit) {
                Err(fault @ (Error::Device { .. } | Error::Limit { .. })) if on_device.is_auto => {
                    *self = Renderer::instead(&fault, on_device.scene);
                }
                result => return result,
            }
        }
        if let Renderer::Reference(judge) = self {
            return judged(judge, camera, settings);
        }
        let (frame, stats) = match self {
            Renderer::Bricks(collection, transfer, [part, parts]) => {
                let order = collection.front_to_back(camera, settings)?;
                let end = |part: usize| order.len() as u128 * part as u128 / *parts as u128;
                let [first, last] =
                    [end(*part - 1), end(*part)].map(|at| usize::try_from(at).expect("within the list"));
                collection.render_bricks(&order[first..last], transfer, camera, settings)?
            }
            _ => cpu::render(self.scene()?, camera, settings)?,
        };
        let others = vec![("walk_ms", json!(stats.walk_ms)), ("draw_ms", json!(stats.draw_ms))];
        let (splats_drawn, splats_skipped) = (stats.splats_drawn, stats.splats_skipped);
        Ok((frame, FrameStats { splats_drawn, splats_skipped, frame_ms: stats.frame_ms, others }))
    }

    /// Returns the processor's renderer in place of a device that failed, and prints a note.
    #[cfg(feature = "gpu")]
    pub(super) fn instead(fault: &Error, scene: Scene<'a>) -> Renderer<'a> {
        print_note(&format!("note: {fault}; the processor draws instead"));
        Renderer::Cpu(scene)
    }

    /// Returns the levels of detail that a picture shows, finest first.
    ///
    /// # Errors
    /// Any error of the camera or of the settings.
    pub(super) fn levels(&self, camera: &Camera, settings: &Settings) -> Result<BTreeSet<usize>> {
        match self {
            Renderer::Reference(_) => Ok(BTreeSet::from([0])),
            Renderer::Bricks(collection, transfer, _) => collection.levels_drawn(transfer, camera, settings),
            _ => Ok(level_parts(self.scene()?, camera, settings)?.into_iter().map(|part| part.level).collect()),
        }
    }

    /// Returns which part of a picture it draws; `None` if it draws the whole.
    pub(super) fn part(&self, camera: &Camera, settings: &Settings) -> Option<PicturePart> {
        let Renderer::Bricks(collection, transfer, place) = self else { return None };
        if place[1] == 1 {
            return None;
        }
        // Machines may differ in their threads.
        let mut drawn = settings.clone();
        (drawn.threads, drawn.stop) = (1, None);
        let all = format!("{} {:?}", env!("CARGO_PKG_VERSION"), (collection.manifest(), transfer, camera, drawn));
        let digest = Sha256::digest(all);
        let whole = digest[..16].iter().map(|byte| format!("{byte:02x}")).collect();
        Some(PicturePart { place: *place, mode: mode_name(settings.mode).into(), whole })
    }

    fn scene(&self) -> Result<&Scene<'a>> {
        match self {
            Renderer::Cpu(scene) => Ok(scene),
            #[cfg(feature = "gpu")]
            Renderer::Gpu(on_device) => Ok(&on_device.scene),
            Renderer::Reference(_) | Renderer::Bricks(..) => Err(needs_volume()),
        }
    }

    /// Returns the renderer's name: `cpu`, `gpu` or `reference`.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Renderer::Cpu(_) | Renderer::Bricks(..) => "cpu",
            #[cfg(feature = "gpu")]
            Renderer::Gpu(_) => "gpu",
            Renderer::Reference(_) => "reference",
        }
    }

    /// Returns the sampling that a graphics device draws, whatever the settings say; `None` for other renderers.
    pub(super) fn only_sampling(&self) -> Option<Sampling> {
        self.adapter().map(|_| Sampling::Finer)
    }

    /// Returns the termination with which the renderer draws, whatever the settings say; `None` if it does as they say.
    pub(super) fn only_termination(&self) -> Option<f32> {
        match self {
            Renderer::Cpu(_) | Renderer::Reference(_) | Renderer::Bricks(..) => None,
            #[cfg(feature = "gpu")]
            Renderer::Gpu(on_device) => on_device.blends_quads().then_some(0.0),
        }
    }

    /// Returns the graphics device's name; `None` for other renderers.
    pub(super) fn adapter(&self) -> Option<&str> {
        match self {
            Renderer::Cpu(_) | Renderer::Reference(_) | Renderer::Bricks(..) => None,
            #[cfg(feature = "gpu")]
            Renderer::Gpu(on_device) => Some(&on_device.adapter),
        }
    }
}

/// Returns the error for a reference picture of an .adj file: the reference needs a volume.
pub(super) fn needs_volume() -> Error {
    let why = "reference needs the volume, and this file holds codes; give the volume that it was built from";
    Error::input("--renderer", why)
}

/// Draws a frame with the reference renderer.
fn judged(judge: &Judge, camera: &Camera, settings: &Settings) -> Result<(Frame, FrameStats)> {
    let start = Instant::now();
    let frame = judge.render(camera, settings)?;
    let stats = FrameStats {
        splats_drawn: judge.visible().voxels().len() as u64,
        splats_skipped: 0,
        frame_ms: start.elapsed().as_secs_f64() * 1e3,
        others: Vec::new(),
    };
    Ok((frame, stats))
}
