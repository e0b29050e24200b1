//! The renderer over a turn: tiles, and quads in each format that the device blends.

use std::time::{Duration, Instant};

use adjsplat::splat::gpu::{Compositor, GpuOptions, GpuRenderer, GpuStats, QuadFormat};
use adjsplat::splat::{Quality, Settings};
use serde::Serialize;

use super::capture::VRAM;
use super::device::Gpu;
use super::report::median;
use super::subject::BenchScene;

/// For how long frames are drawn before the first that counts.
const WARM_UP: Duration = Duration::from_secs(1);

/// Medians over the frames of a turn; times in milliseconds, of stages by the device's clock.
#[derive(Debug, Serialize)]
pub(crate) struct PathRow {
    pub(crate) scene: String,
    pub(crate) size: [u32; 2],
    pub(crate) quality: Quality,
    pub(crate) compositor: &'static str,
    pub(crate) frames: usize,
    pub(crate) splats: f64,
    /// Milliseconds from the call to the picture in the processor's memory.
    pub(crate) frame_ms: f64,
    /// Times by the device's clock; `None` if there is none, or a wrong one.
    pub(crate) stages: Option<StageTimes>,
    pub(crate) read_back_ms: f64,
    pub(crate) frames_a_second: f64,
    /// Drawn splats over the time of the stages; over the time of the frame where that is unknown.
    pub(crate) splats_a_second: f64,
    /// Line lists made over the whole turn, and the processor's time for them.
    pub(crate) line_lists: u64,
    pub(crate) line_lists_ms: f64,
}

/// Milliseconds of the stages.
#[derive(Debug, Serialize)]
pub(crate) struct StageTimes {
    pub(crate) walk_ms: f64,
    pub(crate) project_ms: f64,
    pub(crate) bin_ms: f64,
    pub(crate) composite_ms: f64,
    pub(crate) all_ms: f64,
}

/// Returns the compositors that the device can run.
pub(crate) fn compositors(gpu: &Gpu) -> Vec<(&'static str, Compositor)> {
    let mut found = vec![("tiles", Compositor::Tiles), ("quads, 16 bits", Compositor::Quads(QuadFormat::Float16))];
    if gpu.facts.blends_float32 {
        found.push(("quads, 32 bits", Compositor::Quads(QuadFormat::Float32)));
    }
    found
}

/// Measures a turn of `frames` frames by each compositor.
pub(crate) fn measure(gpu: &Gpu, subject: &BenchScene, settings: &Settings, frames: usize) -> Vec<PathRow> {
    let measure = |(name, compositor)| {
        let options = GpuOptions::default().with_vram(VRAM).with_compositor(compositor);
        let renderer = GpuRenderer::new(gpu.device.clone(), gpu.queue.clone(), subject.scene, options);
        let mut renderer = renderer.expect("a renderer");
        let mut draw = |index| {
            let camera = subject.camera(index, frames, settings.size);
            renderer.render(&camera, settings).expect("a frame").1
        };
        // The first frame compiles pipelines and copies the lane, and cards that were idle run slowly at first. These frames
        // do not count.
        let start = Instant::now();
        while start.elapsed() < WARM_UP {
            draw(0);
        }
        let turn: Vec<GpuStats> = (0..frames).map(draw).collect();
        let middle = |of: fn(&GpuStats) -> f64| median(turn.iter().map(of).collect());
        let (splats, frame_ms) = (middle(|stats| stats.splats_drawn as f64), middle(|stats| stats.frame_ms));
        let stages = StageTimes {
            walk_ms: middle(|stats| stats.walk_ms),
            project_ms: middle(|stats| stats.project_ms),
            bin_ms: middle(|stats| stats.bin_ms),
            composite_ms: middle(|stats| stats.composite_ms),
            all_ms: middle(|stats| stats.walk_ms + stats.project_ms + stats.bin_ms + stats.composite_ms),
        };
        // On software devices the stages take nearly all of a frame. Mesa 22.3's clock does not wait for compute, and
        // counts most of the time as reading back.
        let is_believed = gpu.has_clock() && !(gpu.facts.is_software() && stages.all_ms < 0.5 * frame_ms);
        let busy_ms = if is_believed { stages.all_ms } else { frame_ms };
        PathRow {
            scene: subject.name.clone(),
            size: settings.size,
            quality: settings.quality,
            compositor: name,
            frames,
            splats,
            frame_ms,
            stages: is_believed.then_some(stages),
            read_back_ms: middle(|stats| stats.read_back_ms),
            frames_a_second: 1e3 / frame_ms,
            splats_a_second: 1e3 * splats / busy_ms,
            line_lists: turn.iter().map(|stats| stats.line_lists).sum(),
            line_lists_ms: turn.iter().map(|stats| stats.line_list_ms).sum(),
        }
    };
    compositors(gpu).into_iter().map(measure).collect()
}
