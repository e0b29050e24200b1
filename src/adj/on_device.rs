//! Draws on a graphics device for `adj render`.
//!
//! In: the flags. Out: frames; if samples have 16 or 8 bits, also how much the first frame differs from one in 32 bits.

use std::time::Instant;

use serde_json::{Value, json};

use super::print_note;
use super::renderer::{AccumulateBits, CompositorName, FrameStats, Renderer, RendererArguments};
use adjsplat::error::{Error, Result};
use adjsplat::splat::gpu;
use adjsplat::splat::gpu::adapter;
use adjsplat::splat::gpu::adapter::OpenedDevice;
use adjsplat::splat::gpu::{Compositor, GpuOptions, QuadFormat};
use adjsplat::splat::{Camera, Frame, Scene, Settings};
use adjsplat::traverse::Sense;

/// A renderer on a graphics device.
pub(super) struct OnDevice<'a> {
    pub(super) scene: Scene<'a>,
    pub(super) adapter: String,
    /// Whether the processor may draw instead if the device fails.
    pub(super) is_auto: bool,
    renderer: gpu::GpuRenderer<'a>,
    /// Largest and root mean square difference between the first frame and the same frame with 32-bit samples.
    accumulation_error: Option<[f64; 2]>,
}

impl RendererArguments {
    /// Returns a graphics device; or the processor, if there is only software and the user did not ask for a device.
    pub(super) fn device_or_cpu<'a>(&self, scene: Scene<'a>, is_auto: bool) -> Result<Renderer<'a>> {
        let options = self.options()?;
        // A device that the user names is used even if it is software (runs on the processor).
        let is_named = self.adapter.is_some() || std::env::var_os("WGPU_ADAPTER_NAME").is_some();
        let is_free = is_auto && !is_named;
        if is_free && !has_hardware() {
            return Ok(self.processor(scene));
        }
        let opened = match adapter::open(self.adapter.as_deref()) {
            Ok(opened) if is_free && opened.facts.is_software() => return Ok(self.processor(scene)),
            Err(fault) if is_auto && self.adapter.is_none() => return Ok(Renderer::instead(&fault, scene)),
            opened => opened?,
        };
        quiet_about_lost_devices();
        let OpenedDevice { facts, device, queue } = opened;
        match gpu::GpuRenderer::new(device, queue, scene, options) {
            Ok(renderer) => {
                let adapter = facts.name;
                Ok(Renderer::Gpu(Box::new(OnDevice { scene, adapter, is_auto, renderer, accumulation_error: None })))
            }
            Err(fault) if is_auto => Ok(Renderer::instead(&fault, scene)),
            Err(fault) => Err(fault),
        }
    }

    fn options(&self) -> Result<GpuOptions> {
        let target = match self.accumulate {
            Some(AccumulateBits::Float16) => QuadFormat::Float16,
            Some(AccumulateBits::Unorm8) => QuadFormat::Unorm8,
            Some(AccumulateBits::Float32) | None => QuadFormat::Float32,
        };
        let compositor = match self.compositor {
            Some(CompositorName::Tiles) if target != QuadFormat::Float32 => {
                return Err(Error::input("--accumulate", "is for quads; tiles accumulate in 32 bits"));
            }
            Some(CompositorName::Tiles) => Some(Compositor::Tiles),
            None if target == QuadFormat::Float32 => None,
            Some(CompositorName::Quads) | None => Some(Compositor::Quads(target)),
        };
        let options = GpuOptions::default().with_compositor(compositor);
        Ok(options.with_vram(self.vram.unwrap_or(options.vram)))
    }
}

/// Hides the messages of wgpu's panics, which come back as errors with their own line.
fn quiet_about_lost_devices() {
    let tell = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !panic.location().is_some_and(|location| location.file().contains("wgpu")) {
            tell(panic);
        }
    }));
}

impl OnDevice<'_> {
    /// Returns whether it draws quads, which end no ray.
    pub(super) fn blends_quads(&self) -> bool {
        matches!(self.renderer.compositor(), Compositor::Quads(_))
    }

    /// Draws a frame. With `fit`, where it does not fit into the video memory, this draws the finest level of detail that fits,
    /// which it sets in `settings`.
    ///
    /// # Errors
    /// Any error of the renderer; with `fit`, that of the coarsest level if none fits.
    pub(super) fn render(
        &mut self,
        camera: &Camera,
        settings: &mut Settings,
        fit: bool,
    ) -> Result<(Frame, FrameStats)> {
        let coarsest = if fit { self.scene.lanes.detail().levels.len() } else { 0 };
        let mut tried = settings.clone();
        loop {
            let level = tried.level.unwrap_or(0);
            match self.render_as_asked(camera, &tried) {
                Err(Error::Limit { .. }) if level < coarsest => tried.level = Some(level + 1),
                drawn => {
                    if drawn.is_ok() {
                        *settings = tried;
                    }
                    return drawn;
                }
            }
        }
    }

    fn render_as_asked(&mut self, camera: &Camera, settings: &Settings) -> Result<(Frame, FrameStats)> {
        // A maximum is drawn in tiles, whatever the user asks for.
        let is_maximum = settings.mode.is_maximum();
        let compositor = if is_maximum { Compositor::Tiles } else { self.renderer.compositor() };
        let has_few_bits = matches!(compositor, Compositor::Quads(QuadFormat::Float16 | QuadFormat::Unorm8));
        // The compositor of quads cannot stop at opaque pixels; and back to front, each splat shrinks the rounding
        // errors behind it.
        let sense = if has_few_bits { Sense::BackToFront } else { settings.sense };
        let settings = &settings.clone().with_sense(sense);
        let start = Instant::now();
        let (frame, stats) = self.renderer.render(camera, settings)?;
        let frame_ms = start.elapsed().as_secs_f64() * 1e3;
        if has_few_bits && self.accumulation_error.is_none() {
            self.renderer.set_compositor(Some(Compositor::Tiles))?;
            let exact = self.renderer.render(camera, &settings.clone().with_termination(0.0));
            // Also where the picture does not fit: --fit goes on with a coarser level.
            self.renderer.set_compositor(Some(compositor))?;
            let (exact, _) = exact?;
            let [largest, rms] = difference(&frame, &exact);
            print_note(&format!(
                "note: accumulating in few bits changed the first picture by up to {largest:.4} of full brightness, {rms:.4} on average (root mean square)"
            ));
            self.accumulation_error = Some([largest, rms]);
        }
        let compositor = match compositor {
            Compositor::Tiles => "tiles",
            Compositor::Quads(QuadFormat::Float32) => "quads, 32 bits",
            Compositor::Quads(QuadFormat::Float16) => "quads, 16 bits",
            Compositor::Quads(QuadFormat::Unorm8) => "quads, 8 bits",
        };
        let mut others: Vec<(&'static str, Value)> = vec![
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
            ("splat_ms", json!(stats.composite_ms)),
            ("read_back_ms", json!(stats.read_back_ms)),
        ];
        if let Some([largest, rms]) = self.accumulation_error {
            others.push(("accumulation_error", json!({ "largest": largest, "rms": rms })));
        }
        let (splats_drawn, splats_skipped) = (stats.splats_drawn, stats.splats_skipped);
        Ok((frame, FrameStats { splats_drawn, splats_skipped, frame_ms, others }))
    }
}

/// Returns whether the system shows any sign of graphics hardware. Where it does not, the program can avoid asking for
/// adapters, which loads every driver that is installed.
fn has_hardware() -> bool {
    const SIGNS: [&str; 5] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg", "/dev/kgsl-3d0", "/dev/mali0"];
    !cfg!(target_os = "linux") || SIGNS.iter().any(|sign| std::path::Path::new(sign).exists())
}

/// Returns the largest and the root mean square difference over all samples of two frames of the same size.
fn difference(a: &Frame, b: &Frame) -> [f64; 2] {
    let differences = a.pixels().iter().zip(b.pixels()).map(|(a, b)| f64::from(a - b).abs());
    let [largest, squares] =
        differences.fold([0.0f64, 0.0], |[largest, squares], d| [largest.max(d), d.mul_add(d, squares)]);
    [largest, (squares / a.pixels().len() as f64).sqrt()]
}
