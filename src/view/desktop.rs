//! The window of a desktop.

use std::path::PathBuf;
use std::time::Duration;

use adjsplat::error::{Error, Result};
use adjsplat::splat::gpu::adapter;

use crate::draw::Renderer;
use crate::recent::RecentFiles;
use crate::{Window, background};

/// Opens a window that shows these files; returns when it is closed.
///
/// # Errors
/// [`Error::Input`] if there is no display; [`Error::Device`] if there is nothing that can draw a window.
pub fn run(files: Vec<PathBuf>) -> Result<()> {
    if !has_display() {
        return Err(Error::input(
            "display",
            "is missing, so that no window can open; draw pictures with adj render, or show files in a browser with adj serve",
        ));
    }
    let size = egui::vec2(1280.0, 800.0);
    let viewport = egui::ViewportBuilder::default()
        .with_title("adjsplat")
        .with_inner_size(size)
        .with_min_inner_size(egui::vec2(480.0, 320.0))
        .with_app_id("adjsplat");
    // The interface has nothing to dither, and each picture of it shall be of the newest input: where the processor paints
    // the window, both take most of the time from input to picture.
    let mut options = eframe::NativeOptions { viewport, dithering: false, ..Default::default() };
    options.wgpu_options.surface = eframe::egui_wgpu::SurfaceConfig::LOW_LATENCY;
    let create: eframe::AppCreator<'_> =
        Box::new(move |creation| Ok(Box::new(Window::new(creation, &files, RecentFiles::of_user(), renderer()))));
    let shown = eframe::run_native("adjsplat", options, create);
    background::wait(MOST_WAIT);
    shown.map_err(|fault| {
        // Errors of winit begin with a place in its source.
        let fault = fault.to_string();
        let fault = fault.rsplit_once(".rs:").map_or(&*fault, |(_, cause)| {
            cause.trim_start_matches(|c: char| c.is_ascii_digit() || c == ':' || c == ' ')
        });
        let why = format!("cannot be opened: {fault}; draw pictures with adj render, or show files with adj serve");
        Error::input("window", why)
    })
}

/// How long a closed window waits for the picture that a graphics device still draws.
const MOST_WAIT: Duration = Duration::from_secs(5);

/// Returns what draws pictures: a graphics device, unless all of them are software, which is slower than the processor.
fn renderer() -> Renderer {
    if adapter::adapters().iter().any(|facts| !facts.is_software()) { Renderer::Device } else { Renderer::Processor }
}

/// Returns whether windows can be opened; on other systems than Linux they always can.
fn has_display() -> bool {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(target_os = "linux") || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}
