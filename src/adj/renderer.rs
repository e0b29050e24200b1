//! The renderer that draws: on the processor or on a graphics device, as asked for or as there is one; or the judge.
//!
//! In: `--renderer`, `--adapter`, `--vram` and their like. Out: frames, and one set of numbers for `--stats`.

use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

#[cfg(feature = "gpu")]
use super::on_device::OnDevice;
#[cfg(feature = "gpu")]
use super::print_note;
use adjsplat::error::{Error, Result};
use adjsplat::splat::{Blending, Camera, Frame, Scene, Settings, cpu};
use adjsplat_judge::reference::splat::Judge;

/// What draws.
#[derive(Debug, Args)]
#[command(next_help_heading = "Renderer")]
pub(super) struct RendererArguments {
    /// cpu, gpu, or auto: a graphics device if there is one that is not software. reference: slowly, in double precision,
    /// straight from a volume: what the others should draw at --quality reference.
    #[arg(long, value_name = "R", value_enum, default_value_t = Which::Auto)]
    renderer: Which,
    /// Graphics device whose name or driver contains this (adj devices lists them); the best one unless given.
    #[arg(long, value_name = "NAME")]
    pub(super) adapter: Option<String>,
    /// Most video memory that drawing may take, from 16MiB; 1GiB unless given. The picture does not depend on it.
    #[arg(long, value_name = "SIZE")]
    pub(super) vram: Option<String>,
    /// How a graphics device makes pixels of splats: tiles (in compute; ends early) or quads (blended by the device).
    #[arg(long, value_name = "C", value_parser = ["tiles", "quads"])]
    pub(super) compositor: Option<String>,
    /// Bits in which quads accumulate, 32 unless given: 16 and 8 are faster on some devices, and wrong where opacities
    /// are small; how wrong is measured on the first frame.
    #[arg(long, value_name = "BITS", value_parser = ["32", "16", "8"])]
    pub(super) accumulate: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Which {
    Auto,
    Cpu,
    Gpu,
    Reference,
}

/// What drawing a frame took.
#[derive(Debug)]
pub(super) struct FrameStats {
    pub(super) splats_drawn: u64,
    pub(super) splats_skipped: u64,
    pub(super) frame_ms: f64,
    /// What only one kind of renderer says, by name.
    pub(super) others: Vec<(&'static str, Value)>,
}

/// A renderer of one scene.
pub(super) enum Renderer<'a> {
    Cpu(Scene<'a>),
    #[cfg(feature = "gpu")]
    Gpu(Box<OnDevice<'a>>),
    Reference(Box<Judge>),
}

impl RendererArguments {
    /// Whether the judge is asked for, which draws volumes only.
    pub(super) fn is_reference(&self) -> bool {
        self.renderer == Which::Reference
    }

    /// Flags of graphics devices, with whether they were given.
    fn of_devices(&self) -> [(&'static str, bool); 4] {
        [
            ("--adapter", self.adapter.is_some()),
            ("--vram", self.vram.is_some()),
            ("--compositor", self.compositor.is_some()),
            ("--accumulate", self.accumulate.is_some()),
        ]
    }

    /// The judge as a renderer.
    ///
    /// # Errors
    /// [`Error::Input`] for a flag of graphics devices.
    pub(super) fn reference(&self, judge: Judge) -> Result<Renderer<'static>> {
        match self.of_devices().into_iter().find(|(_, is_given)| *is_given) {
            Some((flag, _)) => Err(Error::input(flag, "is for graphics devices; leave it out")),
            None => Ok(Renderer::Reference(Box::new(judge))),
        }
    }

    /// The renderer asked for.
    ///
    /// `is_bounded`: by `--memory`, which no graphics driver keeps to. No device knows another `blending` than the exponential.
    ///
    /// # Errors
    /// [`Error::Device`] if a graphics device was asked for and cannot be had; [`Error::Input`] for a flag out of place.
    pub(super) fn renderer<'a>(&self, scene: Scene<'a>, is_bounded: bool, blending: Blending) -> Result<Renderer<'a>> {
        let is_for_devices = blending == Blending::Exponential;
        match (self.renderer, self.of_devices().into_iter().find(|(_, is_given)| *is_given)) {
            (Which::Cpu, Some((flag, _))) => Err(Error::input(flag, "is for graphics devices; leave it out")),
            (Which::Cpu, None) => Ok(Renderer::Cpu(scene)),
            (Which::Reference, _) => Err(needs_volume()),
            (Which::Auto, None) if !is_for_devices => Ok(Renderer::Cpu(scene)),
            _ if !is_for_devices => {
                let why = format!("{} is not for graphics devices; take --renderer cpu", blending.name());
                Err(Error::input("--blending", why))
            }
            (Which::Auto, _) if is_bounded && self.adapter.is_none() => Ok(Renderer::Cpu(scene)),
            _ if is_bounded => {
                let why = "cannot be kept by a graphics driver; leave it out (--vram bounds the device), or take --renderer cpu";
                Err(Error::input("--memory", why))
            }
            (which, _) => self.device_or_cpu(scene, which == Which::Auto),
        }
    }

    #[cfg(not(feature = "gpu"))]
    fn device_or_cpu<'a>(&self, scene: Scene<'a>, is_auto: bool) -> Result<Renderer<'a>> {
        match is_auto && self.adapter.is_none() {
            true => Ok(Renderer::Cpu(scene)),
            false => Err(Error::device("support was left out of this program; take --renderer cpu")),
        }
    }
}

impl<'a> Renderer<'a> {
    /// Draws a frame.
    ///
    /// # Errors
    /// As the renderers. One that was chosen by itself and fails is replaced by the processor, and it is said so.
    pub(super) fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<(Frame, FrameStats)> {
        #[cfg(feature = "gpu")]
        if let Renderer::Gpu(on_device) = self {
            match on_device.render(camera, settings) {
                Err(fault @ (Error::Device { .. } | Error::Limit { .. })) if on_device.is_auto => {
                    *self = Renderer::instead(&fault, on_device.scene);
                }
                result => return result,
            }
        }
        if let Renderer::Reference(judge) = self {
            return judged(judge, camera, settings);
        }
        let (frame, stats) = cpu::render(self.scene()?, camera, settings)?;
        let others = vec![("walk_ms", json!(stats.walk_ms)), ("draw_ms", json!(stats.draw_ms))];
        let (splats_drawn, splats_skipped) = (stats.splats_drawn, stats.splats_skipped);
        Ok((frame, FrameStats { splats_drawn, splats_skipped, frame_ms: stats.frame_ms, others }))
    }

    /// The processor's, said so, after a device that was not asked for by name failed.
    #[cfg(feature = "gpu")]
    pub(super) fn instead(fault: &Error, scene: Scene<'a>) -> Renderer<'a> {
        print_note(&format!("note: {fault}; the processor draws instead"));
        Renderer::Cpu(scene)
    }

    fn scene(&self) -> Result<&Scene<'a>> {
        match self {
            Renderer::Cpu(scene) => Ok(scene),
            #[cfg(feature = "gpu")]
            Renderer::Gpu(on_device) => Ok(&on_device.scene),
            Renderer::Reference(_) => Err(needs_volume()),
        }
    }

    /// `cpu`, `gpu` or `reference`.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Renderer::Cpu(_) => "cpu",
            #[cfg(feature = "gpu")]
            Renderer::Gpu(_) => "gpu",
            Renderer::Reference(_) => "reference",
        }
    }

    /// The graphics device's name.
    pub(super) fn adapter(&self) -> Option<&str> {
        match self {
            Renderer::Cpu(_) | Renderer::Reference(_) => None,
            #[cfg(feature = "gpu")]
            Renderer::Gpu(on_device) => Some(&on_device.adapter),
        }
    }
}

/// Why an .adj file has no reference picture.
pub(super) fn needs_volume() -> Error {
    let why = "reference needs the volume, and this file holds codes; give the volume that it was built from";
    Error::input("--renderer", why)
}

/// Draws a frame with the judge.
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
