//! The viewer of adjsplat: volumes are turned, cut and coloured in a window, or on a page in a browser.
//!
//! ```text
//! open -> document (model, look, edits) -> draw (threads) -> app (view, overlay, panel, editor) -> save
//! ```
//!
//! The interface never waits: files are opened, pictures drawn, voxels picked and pictures saved on threads, or in a browser
//! by tasks that give way.

pub mod app;
pub mod background;
#[cfg(target_arch = "wasm32")]
mod builder;
#[cfg(not(target_arch = "wasm32"))]
mod desktop;
mod dialog;
pub mod document;
pub mod draw;
pub mod editor;
#[cfg(target_arch = "wasm32")]
mod fetch;
#[cfg(target_arch = "wasm32")]
mod folder;
#[cfg(not(target_arch = "wasm32"))]
mod local;
pub mod look;
pub mod navigate;
pub mod open;
pub mod overlay;
#[cfg(target_arch = "wasm32")]
pub mod page;
pub mod panel;
pub mod pick;
pub mod recent;
pub mod remote;
pub mod save;
pub mod theme;

#[cfg(not(target_arch = "wasm32"))]
pub use desktop::run;

use std::path::PathBuf;

use app::Viewer;
use draw::{Renderer, install};
use recent::RecentFiles;

struct Window(Viewer);

impl Window {
    fn new(creation: &eframe::CreationContext, files: &[PathBuf], recent: RecentFiles, renderer: Renderer) -> Window {
        install(creation.wgpu_render_state.as_ref().expect("wgpu paints the window"));
        Window(Viewer::new(&creation.egui_ctx, files, recent, renderer))
    }
}

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        self.0.show(ui);
        #[cfg(target_arch = "wasm32")]
        page::publish(&self.0);
    }

    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.window_fill.to_normalized_gamma_f32()
    }
}
