//! The panel beside the view: how the volume is seen, what is visible, and numbers.

use adjsplat::splat::{Mode, Quality, Up};
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::Axis;
use egui::{CollapsingHeader, Id, ScrollArea, Slider, Ui};

use crate::document::Document;
use crate::draw::Completeness;
use crate::editor::ui::{choose, editor, field, goes_on, number};
use crate::look::{Clip, SIDES};
use crate::navigate::Manner;
use crate::theme;

/// What the user asked for that the panel itself cannot do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// To load a transfer function from a file.
    LoadTransfer,
    /// To save the transfer function to a file.
    SaveTransfer,
    /// To show everything again.
    Fit,
}

/// Shows the panel of a document. `size`: the view, in pixels.
pub fn panel(ui: &mut Ui, document: &mut Document, manner: &mut Manner, size: [u32; 2]) -> Option<Request> {
    let mut wish = None;
    ScrollArea::vertical().auto_shrink([false, false]).show(ui, |ui| {
        section(ui, "Transfer function", true, |ui| wish = transfer(ui, document));
        section(ui, "View", true, |ui| {
            if view(ui, document, manner, size) {
                wish = Some(Request::Fit);
            }
        });
        section(ui, "Cut", true, |ui| cut(ui, document));
        section(ui, "Numbers", false, |ui| numbers(ui, document));
        scroll_to_focus(ui, &mut document.focus);
    });
    wish
}

/// Scrolls to the widget of this part of the panel that the keyboard has gone to.
fn scroll_to_focus(ui: &Ui, last: &mut Option<Id>) {
    let focused = ui.memory(|memory| memory.focused());
    let before = std::mem::replace(last, focused);
    let Some(widget) = focused.filter(|_| focused != before).and_then(|id| ui.ctx().read_response(id)) else { return };
    // What is outside the panel is seen, but not within the panel.
    let is_seen_elsewhere = widget.interact_rect.is_positive() && !ui.clip_rect().contains_rect(widget.interact_rect);
    if widget.layer_id == ui.layer_id() && ui.min_rect().contains(widget.rect.center()) && !is_seen_elsewhere {
        ui.scroll_to_rect(widget.rect, None);
    }
}

fn section(ui: &mut Ui, title: &str, is_open: bool, show: impl FnOnce(&mut Ui)) {
    CollapsingHeader::new(egui::RichText::new(title).strong()).default_open(is_open).show_unindented(ui, |ui| {
        ui.add_space(2.0);
        show(ui);
        ui.add_space(8.0);
    });
}

fn transfer(ui: &mut Ui, document: &mut Document) -> Option<Request> {
    let mut wish = None;
    let mut undone = false;
    ui.horizontal_wrapped(|ui| {
        if ui.add_enabled(document.edits.can_undo(), egui::Button::new("Undo")).clicked() {
            document.edits.undo();
            undone = true;
        }
        if ui.add_enabled(document.edits.can_redo(), egui::Button::new("Redo")).clicked() {
            document.edits.redo();
            undone = true;
        }
        if ui.button("Load…").on_hover_text("A JSON file, or a colour table of 3D Slicer").clicked() {
            wish = Some(Request::LoadTransfer);
        }
        if ui.button("Save…").on_hover_text("As the JSON that adj build --tf reads").clicked() {
            wish = Some(Request::SaveTransfer);
        }
    });
    let before = document.edits.now.clone();
    let Document { edits, editor: state, stored, missing, .. } = document;
    editor(ui, &mut edits.now, state, stored, missing);
    let is_changed = edits.now != before;
    edits.follow(before, goes_on(ui.ctx()));
    if is_changed || undone {
        document.apply();
    }
    if let Some(note) = &document.note {
        ui.colored_label(ui.visuals().warn_fg_color, note);
    }
    wish
}

/// Shows how the volume is seen; returns whether everything shall be shown again.
fn view(ui: &mut Ui, document: &mut Document, manner: &mut Manner, size: [u32; 2]) -> bool {
    let mut fits = false;
    ui.horizontal_wrapped(|ui| {
        for side in SIDES {
            if ui.button(side.name).clicked() {
                (document.look.eye.azimuth, document.look.eye.elevation) = (side.azimuth, side.elevation);
                document.fit(size);
            }
        }
        fits = ui.button("Fit").on_hover_text("Show everything (F)").clicked();
    });
    let look = &mut document.look;
    let modes = [
        ("Shaded surfaces", Mode::Composite),
        ("Maximum", Mode::Maximum),
        ("Maximum, grey", Mode::MaximumGrey),
        ("X-ray", Mode::Additive),
    ];
    let mut mode = look.mode;
    if choose(ui, "mode", &mut mode, &modes) {
        look.background = theme::background_in(mode, look.mode, look.background, ui.visuals().dark_mode);
        look.mode = mode;
    }
    let axes = [("x", Axis::X), ("y", Axis::Y), ("z", Axis::Z)];
    let ups: Vec<(String, Up)> = axes
        .iter()
        .flat_map(|(name, axis)| [(format!("+{name}"), Up::Plus(*axis)), (format!("-{name}"), Up::Minus(*axis))])
        .collect();
    let ups: Vec<(&str, Up)> = ups.iter().map(|(name, up)| (name.as_str(), *up)).collect();
    let mut turned = look.eye.up;
    if choose(ui, "axis that points up", &mut turned, &ups) {
        look.eye.up = turned;
    }
    ui.horizontal(|ui| {
        let mut is_perspective = look.eye.fov.is_some();
        if ui.checkbox(&mut is_perspective, "Perspective").changed() {
            look.eye.toggle_perspective();
        }
        if let Some(fov) = &mut look.eye.fov {
            ui.add(field(fov, 5.0..=120.0).speed(0.3).suffix("°")).on_hover_text("Vertical angle of view");
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut look.is_lit, "Light");
        ui.checkbox(&mut manner.has_inertia, "Inertia").on_hover_text("The volume turns on after it was let go");
        ui.checkbox(&mut manner.flies, "Fly")
            .on_hover_text("Drag to look around; W A S D Q E move the eye. In a parallel view W and S magnify");
    });
    ui.add(Slider::new(&mut look.sharpness, 0.0..=1.0).text("sharpness"));
    ui.horizontal(|ui| {
        ui.color_edit_button_srgb(&mut look.background);
        ui.label("background");
    });
    fits
}

fn cut(ui: &mut Ui, document: &mut Document) {
    let dims = document.model.grid().dims;
    let whole = || VoxelBox { low: [0; 3], high: dims.map(|points| u16::try_from(points - 1).unwrap_or(u16::MAX)) };
    let mut is_cropped = document.look.crop.is_some();
    if ui.checkbox(&mut is_cropped, "Crop box").on_hover_text("Drag the handles in the view").changed() {
        document.look.crop = is_cropped.then(|| document.model.bounds().ok().flatten().unwrap_or_else(whole));
    }
    if let Some(crop) = &mut document.look.crop {
        egui::Grid::new("crop").num_columns(3).show(ui, |ui| {
            for (a, name) in ["x", "y", "z"].into_iter().enumerate() {
                let last = whole().high[a];
                ui.label(name);
                let (low, high) = (crop.low[a], crop.high[a]);
                ui.add(field(&mut crop.low[a], 0..=high).speed(0.3));
                ui.add(field(&mut crop.high[a], low..=last).speed(0.3));
                ui.end_row();
            }
        });
    }
    let look = &mut document.look;
    let mut is_clipped = look.clip.is_some();
    let cross = ui.checkbox(&mut is_clipped, "Clip plane").on_hover_text("Across the direction of this view");
    if cross.changed() {
        look.clip = is_clipped.then(|| Clip { normal: look.eye.axes()[2], depth: 0.35 });
    }
    if let Some(clip) = &mut look.clip {
        ui.add(Slider::new(&mut clip.depth, 0.0..=1.0).text("depth"));
        ui.horizontal(|ui| {
            if ui.button("Face the view").clicked() {
                clip.normal = look.eye.axes()[2];
            }
            if ui.button("Other side").clicked() {
                (clip.normal, clip.depth) = (-clip.normal, 1.0 - clip.depth);
            }
        });
    }
}

fn numbers(ui: &mut Ui, document: &Document) {
    let grid = document.model.grid();
    let mut rows: Vec<(&str, String)> = Vec::new();
    let join = |parts: [String; 3]| parts.join(" x ");
    rows.push(("points", join(grid.dims.map(|points| points.to_string()))));
    let unit = document.unit.as_deref().unwrap_or_default();
    rows.push(("spacing", format!("{} {unit}", join(grid.spacing.map(number))).trim_end().to_owned()));
    rows.push(("visible voxels", document.model.visible_voxels().to_string()));
    if let Ok(arena) = document.model.arena() {
        let bytes = document.fetched().map_or(arena.bytes().len() as u64, |[_, whole]| whole);
        rows.push(("file", megabytes(bytes)));
        let lanes: Vec<&str> = arena.lanes().map(|lane| lane.axis.name()).collect();
        rows.push(("stored lanes", lanes.join(", ")));
    }
    if let Some([fetched, whole]) = document.fetched() {
        rows.push(("fetched", format!("{} of {}", megabytes(fetched), megabytes(whole))));
    }
    if let Some(resident) = resident_bytes() {
        rows.push(("memory of the program", megabytes(resident)));
    }
    if let Some(shown) = document.painter.shown() {
        let [columns, lines] = shown.size;
        let stand_in = if shown.work.completeness == Completeness::Whole { "" } else { ", not all voxels arrived" };
        rows.push(("picture", format!("{}, {columns} x {lines}{stand_in}", shown.quality.name())));
        let rate = 1000.0 / shown.milliseconds.max(1e-3);
        rows.push(("drawn in", format!("{:.1} ms, {rate:.0} a second", shown.milliseconds)));
        rows.push(("splats drawn", shown.work.splats.to_string()));
        rows.push(("voxels walked", shown.work.walked.to_string()));
    }
    rows.push(("order of the walk", order(document)));
    let device = document.painter.shown().and_then(|shown| shown.work.device.clone());
    match device {
        Some((name, bytes)) => {
            rows.push(("renderer", name));
            rows.push(("memory of the device", megabytes(bytes)));
        }
        None => rows.push(("renderer", "processor".into())),
    }
    egui::Grid::new("numbers").num_columns(2).striped(true).show(ui, |ui| {
        for (name, text) in rows {
            ui.label(name);
            ui.monospace(text);
            ui.end_row();
        }
    });
}

/// Returns the axes from the outermost loop of the walk to the innermost, with their directions.
fn order(document: &Document) -> String {
    let forward = document.look.eye.axes()[2];
    let frame = adjsplat::splat::WorldFrame::of(document.model.grid());
    let along = frame.voxel_from_world_vector(forward);
    let mut axes = [0, 1, 2];
    axes.sort_by(|&a, &b| along[b].abs().total_cmp(&along[a].abs()));
    axes.map(|a| format!("{}{}", if along[a] < 0.0 { "-" } else { "+" }, ["x", "y", "z"][a])).join(" ")
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

/// Returns the bytes of the program's memory.
#[cfg(target_arch = "wasm32")]
fn resident_bytes() -> Option<u64> {
    Some(crate::page::memory())
}

/// Returns the bytes of this process that are in memory, where the system tells.
#[cfg(not(target_arch = "wasm32"))]
fn resident_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok().map(|kibibytes| kibibytes << 10)
}

/// Qualities to choose from where a picture is saved.
pub const QUALITIES: [(&str, Quality); 4] = [
    ("draft", Quality::Draft),
    ("standard", Quality::Standard),
    ("high", Quality::High),
    ("reference", Quality::Reference),
];
