//! The renderer that draws: on the processor or on a graphics device, as asked for or as there is one.
//!
//! In: `--renderer`, `--adapter`, `--vram` and their like. Out: frames, and one set of numbers for `--stats`.

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::print_note;
use crate::error::{Error, Result};
use crate::splat::{Camera, Frame, Scene, Settings, cpu};

/// What draws.
#[derive(Debug, Args)]
#[command(next_help_heading = "Renderer")]
pub(super) struct RendererArguments {
    /// cpu, gpu, or auto: a graphics device if there is one that is not software.
    #[arg(long, value_name = "R", value_enum, default_value_t = Which::Auto)]
    renderer: Which,
    /// Graphics device whose name or driver contains this (adj devices lists them); the best one unless given.
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Most video memory that drawing may take, from 16MiB. The picture does not depend on it.
    #[arg(long, value_name = "SIZE", default_value = "1GiB")]
    vram: String,
    /// How a graphics device makes pixels of splats: tiles (in compute; ends early) or quads (blended by the device).
    #[arg(long, value_name = "C", value_parser = ["tiles", "quads"])]
    compositor: Option<String>,
    /// Bits in which quads are accumulated: 16 and 8 are faster on some devices, and wrong where opacities are small.
    #[arg(long, value_name = "BITS", default_value = "32", value_parser = ["32", "16", "8"])]
    accumulate: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Which {
    Auto,
    Cpu,
    Gpu,
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
    Gpu(Box<device::OnDevice<'a>>),
}

impl RendererArguments {
    /// The renderer asked for.
    ///
    /// # Errors
    /// [`Error::Device`] if a graphics device was asked for and cannot be had; [`Error::Input`] for a flag out of place.
    pub(super) fn renderer<'a>(&self, scene: Scene<'a>) -> Result<Renderer<'a>> {
        match self.renderer {
            Which::Cpu => Ok(Renderer::Cpu(scene)),
            which => self.device_or_cpu(scene, which == Which::Auto),
        }
    }

    #[cfg(not(feature = "gpu"))]
    fn device_or_cpu<'a>(&self, scene: Scene<'a>, is_auto: bool) -> Result<Renderer<'a>> {
        if is_auto { Ok(Renderer::Cpu(scene)) } else { Err(Error::device("support was left out of this program")) }
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
                    print_note(&format!("note: {fault}; the processor draws instead"));
                    *self = Renderer::Cpu(on_device.scene);
                }
                result => return result,
            }
        }
        let scene = match self {
            Renderer::Cpu(scene) => scene,
            #[cfg(feature = "gpu")]
            Renderer::Gpu(on_device) => &on_device.scene,
        };
        let (frame, stats) = cpu::render(scene, camera, settings)?;
        let others = vec![("walk_ms", json!(stats.walk_ms)), ("draw_ms", json!(stats.draw_ms))];
        let (splats_drawn, splats_skipped) = (stats.splats_drawn, stats.splats_skipped);
        Ok((frame, FrameStats { splats_drawn, splats_skipped, frame_ms: stats.frame_ms, others }))
    }

    /// `cpu` or `gpu`.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Renderer::Cpu(_) => "cpu",
            #[cfg(feature = "gpu")]
            Renderer::Gpu(_) => "gpu",
        }
    }

    /// The graphics device's name.
    pub(super) fn adapter(&self) -> Option<&str> {
        match self {
            Renderer::Cpu(_) => None,
            #[cfg(feature = "gpu")]
            Renderer::Gpu(on_device) => Some(&on_device.adapter),
        }
    }
}

#[cfg(feature = "gpu")]
mod device {
    use serde_json::json;

    use super::{FrameStats, Renderer, RendererArguments};
    use crate::cli::print_note;
    use crate::cli::size::parse_memory;
    use crate::error::{Error, Result};
    use crate::splat::gpu::adapter::{self, Opened};
    use crate::splat::gpu::{self, Compositor, Options, Target};
    use crate::splat::{Camera, Frame, Scene, Settings};

    /// A renderer on a graphics device.
    pub(in crate::cli) struct OnDevice<'a> {
        pub(super) scene: Scene<'a>,
        pub(super) renderer: gpu::Renderer<'a>,
        pub(super) adapter: String,
        /// Whether the processor may draw instead.
        pub(super) is_auto: bool,
    }

    impl RendererArguments {
        pub(super) fn device_or_cpu<'a>(&self, scene: Scene<'a>, is_auto: bool) -> Result<Renderer<'a>> {
            let options = self.options()?;
            let opened = match adapter::open(self.adapter.as_deref()) {
                Ok(opened) if is_auto && self.adapter.is_none() && opened.facts.is_software() => {
                    return Ok(Renderer::Cpu(scene));
                }
                Err(_) if is_auto && self.adapter.is_none() => return Ok(Renderer::Cpu(scene)),
                opened => opened?,
            };
            let Opened { facts, device, queue } = opened;
            match gpu::Renderer::new(device, queue, scene, options) {
                Ok(renderer) => Ok(Renderer::Gpu(Box::new(OnDevice { scene, renderer, adapter: facts.name, is_auto }))),
                Err(fault) if is_auto => {
                    print_note(&format!("note: {fault}; the processor draws instead"));
                    Ok(Renderer::Cpu(scene))
                }
                Err(fault) => Err(fault),
            }
        }

        fn options(&self) -> Result<Options> {
            let target = match self.accumulate.as_str() {
                "16" => Target::Float16,
                "8" => Target::Unorm8,
                _ => Target::Float32,
            };
            let compositor = match self.compositor.as_deref() {
                Some("quads") => Some(Compositor::Quads(target)),
                Some("tiles") if target != Target::Float32 => {
                    return Err(Error::input("--accumulate", "is for quads; tiles accumulate in 32 bits"));
                }
                Some(_) => Some(Compositor::Tiles),
                None if target != Target::Float32 => Some(Compositor::Quads(target)),
                None => None,
            };
            Ok(Options { vram: parse_memory(&self.vram)?, compositor })
        }
    }

    impl OnDevice<'_> {
        pub(super) fn render(&mut self, camera: &Camera, settings: &Settings) -> Result<(Frame, FrameStats)> {
            let (frame, stats) = self.renderer.render(camera, settings)?;
            let compositor = match self.renderer.compositor() {
                Compositor::Tiles => "tiles",
                Compositor::Quads(Target::Float32) => "quads, 32 bits",
                Compositor::Quads(Target::Float16) => "quads, 16 bits",
                Compositor::Quads(Target::Unorm8) => "quads, 8 bits",
            };
            let others = vec![
                ("compositor", json!(compositor)),
                ("line_lists", json!(stats.line_lists)),
                ("slabs", json!(stats.slabs)),
                ("windows", json!(stats.windows)),
                ("chunks", json!(stats.chunks)),
                ("upload_bytes", json!(stats.upload_bytes)),
                ("list_bytes", json!(stats.list_bytes)),
                ("vram_bytes", json!(stats.vram_bytes)),
                ("line_list_ms", json!(stats.line_list_ms)),
                ("upload_ms", json!(stats.upload_ms)),
                ("walk_ms", json!(stats.walk_ms)),
                ("project_ms", json!(stats.project_ms)),
                ("bin_ms", json!(stats.bin_ms)),
                ("composite_ms", json!(stats.composite_ms)),
                ("read_back_ms", json!(stats.read_back_ms)),
            ];
            let (splats_drawn, splats_skipped) = (stats.splats_drawn, stats.splats_skipped);
            Ok((frame, FrameStats { splats_drawn, splats_skipped, frame_ms: stats.frame_ms, others }))
        }
    }
}
