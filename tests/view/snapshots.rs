//! What the viewer looks like: pictures of its window beside those in snapshots/, which were looked at.
//!
//! UPDATE_SNAPSHOTS=1 draws them anew; look at each before it is kept. Needs a Vulkan driver; software is enough.

use adjsplat::classify::{Colour, Label, UnlistedLabels};
use adjsplat::{Build, TransferFunction};
use adjsplat_tests::files::skipped;
use adjsplat_view::app::Viewer;
use adjsplat_view::draw::{Renderer, install};
use adjsplat_view::recent::RecentFiles;
use eframe::egui_wgpu::RendererOptions;
use egui::Theme;
use egui_kittest::SnapshotOptions;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};

use super::{Driven, ball, builder, wait};

/// Draws the window with a ball that `transfer` shows, and compares it with the snapshot of this name.
fn compare(name: &str, theme: Theme, transfer: TransferFunction) {
    if pollster::block_on(adjsplat::splat::gpu::adapter::open_async(None)).is_err() {
        return skipped("ADJ_GPU", "a picture of the viewer's window");
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ball.adj");
    Build::new(transfer).write(&ball(), &file).unwrap();
    let show = move |ui: &mut egui::Ui, viewer: &mut Option<Viewer>| {
        // A window is cleared with this colour.
        ui.ctx().layer_painter(egui::LayerId::background()).rect_filled(
            egui::Rect::EVERYTHING,
            0.0,
            ui.visuals().window_fill,
        );
        let files = [file.clone()];
        let new = || Viewer::new(ui.ctx(), &files, RecentFiles::default(), Renderer::Processor);
        viewer.get_or_insert_with(new).show(ui);
    };
    let window = create_render_state(default_wgpu_setup(), RendererOptions::PREDICTABLE);
    install(&window);
    let renderer = WgpuTestRenderer::from_render_state(window);
    let mut driven: Driven = builder().with_theme(theme).renderer(renderer).build_ui_state(show, None);
    wait(&mut driven, "opening", |viewer| viewer.documents().len() == 1);
    wait(&mut driven, "drawing", |viewer| viewer.documents()[0].painter.is_finished());
    driven.step();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/view/snapshots");
    // Some machines round light and the edges of letters in another way.
    let options = SnapshotOptions::new().output_path(folder).max_failed_pixels(50);
    driven.snapshot_options(name, &options);
}

#[test]
fn points_in_the_dark() {
    compare("points", Theme::Dark, TransferFunction::range(60.0, f64::INFINITY).unwrap());
}

#[test]
fn labels_in_the_light() {
    let labels = [(120, "skin", "#d0a080"), (150, "liver", "#803020"), (200, "bone", "#f0f0e0")];
    let labels = labels.map(|(label, name, colour)| Label {
        label,
        name: name.into(),
        colour: Colour::from_hex(colour).unwrap(),
        opacity: 0.5,
    });
    compare("labels", Theme::Light, TransferFunction::labels(labels.to_vec(), UnlistedLabels::Transparent).unwrap());
}

#[test]
fn surfaces_in_the_dark() {
    compare("surfaces", Theme::Dark, TransferFunction::contour(120.0).unwrap());
}
