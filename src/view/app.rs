//! The program: open documents as tabs or side by side, menus, keys, messages.

use std::path::{Path, PathBuf};

use adjsplat::TransferFunction;
use adjsplat::error::Error;
use egui::{
    Button, CentralPanel, Color32, Context, DragValue, Image, Key, Modifiers, Panel, ProgressBar, Rect, Sense, Theme,
    Ui, Window, pos2,
};

use crate::dialog::{Dialog, Purpose};
use crate::document::Document;
use crate::editor::Edited;
use crate::editor::ui::{choose, number};
use crate::look::SIDES;
use crate::navigate::{Manner, navigate};
use crate::open::Opening;
use crate::overlay::{self, Projector};
use crate::panel::{QUALITIES, Wish, panel};
use crate::recent::RecentFiles;
use crate::save::{PictureForm, Saving, camera_json, command};
use crate::theme;

/// The viewer.
pub struct Viewer {
    documents: Vec<Document>,
    active: usize,
    openings: Vec<Opening>,
    savings: Vec<Saving>,
    dialog: Option<Dialog>,
    recent: RecentFiles,
    manner: Manner,
    /// Whether all documents are seen from the same place.
    is_linked: bool,
    is_side_by_side: bool,
    has_panel: bool,
    /// The path that is typed, while the window for it is open.
    typed_path: Option<String>,
    /// How the next picture is saved, while the window for it is open.
    form: Option<PictureForm>,
    form_is_open: bool,
    /// The last message, and whether it is an error.
    message: Option<(String, bool)>,
    /// The size of the last view, in pixels.
    view_size: [u32; 2],
    was_dark: Option<bool>,
}

impl Viewer {
    /// Creates a viewer that opens these files.
    pub fn new(context: &Context, files: &[PathBuf], recent: RecentFiles) -> Viewer {
        theme::apply(context);
        let mut viewer = Viewer {
            documents: Vec::new(),
            active: 0,
            openings: Vec::new(),
            savings: Vec::new(),
            dialog: None,
            recent,
            manner: Manner { has_inertia: true, flies: false },
            is_linked: false,
            is_side_by_side: false,
            has_panel: true,
            typed_path: None,
            form: None,
            form_is_open: false,
            message: None,
            view_size: [800, 600],
            was_dark: None,
        };
        files.iter().for_each(|file| viewer.open(context, file));
        viewer
    }

    /// Begins to open a file.
    pub fn open(&mut self, context: &Context, path: &Path) {
        self.openings.push(Opening::begin(path, context));
    }

    /// Returns the open documents, in the order of their tabs.
    pub fn documents(&self) -> &[Document] {
        &self.documents
    }

    /// Returns the last message, such as why a file could not be opened.
    pub fn message(&self) -> Option<&str> {
        self.message.as_ref().map(|(text, _)| text.as_str())
    }

    /// Shows the program and applies the user's input.
    pub fn show(&mut self, ui: &mut Ui) {
        let context = ui.ctx().clone();
        self.follow_theme(&context);
        self.take_dropped(&context);
        self.take_results(&context);
        self.keys(&context);
        Panel::top("menu").show(ui, |ui| self.menu(ui));
        if self.documents.len() > 1 && !self.is_side_by_side {
            Panel::top("tabs").show(ui, |ui| self.tabs(ui));
        }
        Panel::bottom("status").show(ui, |ui| self.status(ui));
        if self.has_panel && !self.documents.is_empty() {
            Panel::right("panel").default_size(330.0).min_size(290.0).max_size(520.0).show(ui, |ui| {
                let wish = panel(ui, &mut self.documents[self.active], &mut self.manner, self.view_size);
                self.fulfil(&context, wish);
            });
        }
        CentralPanel::no_frame().show(ui, |ui| self.views(ui));
        self.windows(&context);
    }

    fn follow_theme(&mut self, context: &Context) {
        let is_dark = context.theme() == Theme::Dark;
        if self.was_dark.is_some_and(|was_dark| was_dark != is_dark) {
            for document in &mut self.documents {
                if document.look.background == theme::background(!is_dark) {
                    document.look.background = theme::background(is_dark);
                }
            }
        }
        self.was_dark = Some(is_dark);
    }

    fn take_dropped(&mut self, context: &Context) {
        let dropped: Vec<PathBuf> =
            context.input(|input| input.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        dropped.iter().for_each(|path| self.open(context, path));
    }

    /// Takes what threads and dialogs have finished.
    fn take_results(&mut self, context: &Context) {
        let background = theme::background(context.theme() == Theme::Dark);
        let mut opened = Vec::new();
        self.openings.retain(|opening| match opening.result() {
            None => true,
            Some(result) => {
                opened.push((opening.path.clone(), result));
                false
            }
        });
        for (path, result) in opened {
            match result.and_then(|opened| Document::new(context, opened, background)) {
                Ok(document) => {
                    self.recent.add(&path);
                    self.documents.push(document);
                    self.active = self.documents.len() - 1;
                    self.message = None;
                }
                Err(Error::Interrupted) => self.message = Some((format!("{} was not opened", path.display()), false)),
                Err(fault) => self.message = Some((full(&fault), true)),
            }
        }
        let mut saved = Vec::new();
        self.savings.retain(|saving| match saving.result() {
            None => true,
            Some(result) => {
                saved.push((saving.path.clone(), result));
                false
            }
        });
        for (path, result) in saved {
            self.message = Some(match result {
                Ok(()) => (format!("Saved {}", path.display()), false),
                Err(Error::Interrupted) => (format!("{} was not saved", path.display()), false),
                Err(fault) => (full(&fault), true),
            });
        }
        if let Some((purpose, path)) = self.dialog.as_ref().and_then(Dialog::result) {
            self.dialog = None;
            if let Some(path) = path {
                self.chosen(context, purpose, &path);
            }
        }
        self.documents.iter_mut().for_each(Document::finish_pick);
    }

    /// Does what a file was chosen for.
    fn chosen(&mut self, context: &Context, purpose: Purpose, path: &Path) {
        if purpose == Purpose::OpenFile {
            return self.open(context, path);
        }
        let Some(document) = self.documents.get_mut(self.active) else { return };
        let result = match purpose {
            Purpose::OpenFile => Ok(()),
            Purpose::SavePicture => {
                if let Some(form) = self.form {
                    self.savings.push(Saving::begin(path, &document.model, &document.look, form, context));
                }
                Ok(())
            }
            Purpose::LoadTransfer => TransferFunction::read(path).map(|transfer| {
                let edited = Edited::of(&transfer, &document.stored);
                let before = std::mem::replace(&mut document.edits.now, edited);
                document.edits.changed_from(before);
                document.apply();
            }),
            Purpose::SaveTransfer => {
                let text = document.model.transfer().to_json();
                adjsplat::file::write_atomically(path, |out| out.write_all(text.as_bytes()))
            }
        };
        if let Err(fault) = result {
            self.message = Some((full(&fault), true));
        }
    }

    fn fulfil(&mut self, context: &Context, wish: Option<Wish>) {
        match wish {
            Some(Wish::LoadTransfer) => self.dialog = Some(Dialog::begin(Purpose::LoadTransfer, context)),
            Some(Wish::SaveTransfer) => self.dialog = Some(Dialog::begin(Purpose::SaveTransfer, context)),
            Some(Wish::Fit) => self.documents[self.active].fit(self.view_size),
            None => {}
        }
    }

    fn keys(&mut self, context: &Context) {
        if context.egui_wants_keyboard_input() {
            return;
        }
        let pressed = |modifiers, key| context.input_mut(|input| input.consume_key(modifiers, key));
        if pressed(Modifiers::COMMAND, Key::O) {
            self.typed_path = Some(String::new());
        }
        if pressed(Modifiers::COMMAND, Key::W) && !self.documents.is_empty() {
            self.close(self.active);
        }
        let size = self.view_size;
        let Some(document) = self.documents.get_mut(self.active) else { return };
        if pressed(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z) || pressed(Modifiers::COMMAND, Key::Y) {
            document.edits.redo();
            document.apply();
        } else if pressed(Modifiers::COMMAND, Key::Z) {
            document.edits.undo();
            document.apply();
        }
        let sides = [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6];
        for (key, side) in sides.into_iter().zip(SIDES) {
            if pressed(Modifiers::NONE, key) {
                (document.look.eye.azimuth, document.look.eye.elevation) = (side.azimuth, side.elevation);
                document.fit(size);
            }
        }
        if pressed(Modifiers::NONE, Key::F) {
            document.fit(size);
        }
        if pressed(Modifiers::NONE, Key::P) {
            document.look.eye.toggle_perspective();
        }
        if pressed(Modifiers::NONE, Key::Escape) {
            document.picked = None;
        }
    }

    fn menu(&mut self, ui: &mut Ui) {
        let context = ui.ctx().clone();
        ui.add_space(3.0);
        ui.horizontal_wrapped(|ui| {
            ui.menu_button("Open", |ui| {
                if ui.button("File…").clicked() {
                    self.dialog = Some(Dialog::begin(Purpose::OpenFile, &context));
                    ui.close();
                }
                if ui.button("Path…").on_hover_text("Type a path; a folder of DICOM slices, for example").clicked() {
                    self.typed_path = Some(String::new());
                    ui.close();
                }
                ui.separator();
                let paths = self.recent.paths().to_vec();
                for path in paths {
                    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
                    if ui.button(name).on_hover_text(path.display().to_string()).clicked() {
                        self.open(&context, &path);
                        ui.close();
                    }
                }
            });
            let is_open = !self.documents.is_empty();
            ui.add_enabled_ui(is_open, |ui| {
                if ui.button("Save picture").clicked() {
                    self.form_is_open = true;
                }
                ui.menu_button("Copy", |ui| {
                    if ui.button("Command that makes this picture").clicked() {
                        self.copy(&context, true);
                        ui.close();
                    }
                    if ui.button("Camera as JSON").clicked() {
                        self.copy(&context, false);
                        ui.close();
                    }
                });
            });
            ui.separator();
            ui.checkbox(&mut self.has_panel, "Panel");
            if self.documents.len() > 1 {
                if ui.checkbox(&mut self.is_side_by_side, "Side by side").changed() {
                    self.documents.iter_mut().for_each(|document| document.needs_fit = true);
                }
                ui.checkbox(&mut self.is_linked, "Link views").on_hover_text("All files are seen from the same place");
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let is_dark = context.theme() == Theme::Dark;
                if ui.button(if is_dark { "Light theme" } else { "Dark theme" }).clicked() {
                    context.set_theme(if is_dark { Theme::Light } else { Theme::Dark });
                }
            });
        });
        ui.add_space(3.0);
    }

    fn copy(&mut self, context: &Context, is_command: bool) {
        let Some(document) = self.documents.get(self.active) else { return };
        let stored = adjsplat_stored(document);
        let text = match (is_command, &document.path) {
            (true, Some(path)) => {
                let transfer = document.model.transfer();
                let other = Some(transfer).filter(|transfer| stored.as_ref() != Some(transfer));
                command(path, &document.look, &document.model, self.view_size, adjsplat::splat::Quality::High, other)
            }
            (true, None) => Err(Error::input("the model", "lies in no file that a command could name")),
            (false, _) => camera_json(&document.look),
        };
        self.message = Some(match text {
            Ok(text) => {
                context.copy_text(text);
                ("Copied to the clipboard".into(), false)
            }
            Err(fault) => (full(&fault), true),
        });
    }

    fn tabs(&mut self, ui: &mut Ui) {
        let mut closed = None;
        ui.horizontal_wrapped(|ui| {
            for index in 0..self.documents.len() {
                let title = self.documents[index].title.clone();
                if ui.selectable_label(index == self.active, &title).clicked() {
                    if self.is_linked {
                        self.documents[index].look.eye = self.documents[self.active].look.eye;
                    }
                    self.active = index;
                }
                if ui.small_button("×").on_hover_text("Close this file").clicked() {
                    closed = Some(index);
                }
                ui.add_space(6.0);
            }
        });
        if let Some(index) = closed {
            self.close(index);
        }
    }

    fn close(&mut self, index: usize) {
        self.documents.remove(index);
        self.active = self.active.min(self.documents.len().saturating_sub(1));
    }

    fn status(&mut self, ui: &mut Ui) {
        ui.add_space(2.0);
        ui.horizontal_wrapped(|ui| {
            for opening in &self.openings {
                let (phase, share) = opening.progress();
                let name = opening.path.file_name().unwrap_or_default().to_string_lossy();
                ui.label(format!("{phase}: {name}"));
                ui.add(ProgressBar::new(share).desired_width(140.0));
                if ui.button("Cancel").clicked() {
                    opening.cancel();
                }
            }
            for saving in &self.savings {
                ui.label(format!("Drawing {} of {}", saving.done() + 1, saving.frames));
                if ui.button("Cancel").clicked() {
                    saving.cancel();
                }
            }
            if let Some((text, is_error)) = &self.message {
                let colour = if *is_error { ui.visuals().error_fg_color } else { ui.visuals().text_color() };
                ui.colored_label(colour, text);
            } else if let Some(document) = self.documents.get(self.active) {
                ui.label(describe(document));
            }
        });
        ui.add_space(2.0);
    }

    fn views(&mut self, ui: &mut Ui) {
        if self.documents.is_empty() {
            let text = match self.openings.is_empty() {
                true => {
                    "Drop a file here, or choose Open: an .adj file, or a volume (DICOM, NIfTI, NRRD, TIFF, Zarr …)"
                }
                false => "Opening …",
            };
            let rect = ui.available_rect_before_wrap();
            overlay::message(ui.painter(), rect, text, ui.visuals().weak_text_color());
            return;
        }
        if !self.is_side_by_side {
            return self.view(ui, self.active);
        }
        let count = self.documents.len();
        let all = ui.available_rect_before_wrap();
        let columns = if count > 3 { count.div_ceil(2) } else { count };
        let rows = count.div_ceil(columns);
        let cell = egui::vec2(all.width() / columns as f32, all.height() / rows as f32);
        for index in 0..count {
            let corner = egui::vec2((index % columns) as f32 * cell.x, (index / columns) as f32 * cell.y);
            let rect = Rect::from_min_size(all.min + corner, cell).shrink(1.0);
            ui.scope_builder(egui::UiBuilder::new().max_rect(rect).id_salt(index), |ui| self.view(ui, index));
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of a screen")]
    fn view(&mut self, ui: &mut Ui, index: usize) {
        let rect = ui.available_rect_before_wrap();
        let response = ui.interact(rect, ui.scope_id().with(("view", index)), Sense::click_and_drag());
        let label = format!("View of {}", self.documents[index].title);
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &label));
        let scale = ui.ctx().pixels_per_point();
        let size = [rect.width(), rect.height()].map(|side| ((side * scale) as u32).clamp(1, 16_384));
        self.view_size = size;
        if response.drag_started() || response.clicked() {
            self.active = index;
            self.message = None;
        }
        let document = &mut self.documents[index];
        if std::mem::take(&mut document.needs_fit) {
            document.fit(size);
        }
        let before = document.look.eye;
        let projector = Projector::new(&document.look.eye, rect);
        let holds = match &mut document.look.crop {
            Some(crop) => {
                // Drawn again over the picture below; this is for the pointer.
                overlay::crop_box(ui, &response, &projector, document.model.grid(), crop, &mut document.held_face)
            }
            None => false,
        };
        if !holds {
            navigate(ui, &response, &mut document.look.eye, &mut document.motion, self.manner);
        }
        let time = ui.input(|input| input.time);
        let (model, version) = (document.model.clone(), document.version());
        let [r, g, b] = document.look.background;
        let painter = ui.painter_at(rect);
        painter.rect_filled(rect, 0.0, Color32::from_rgb(r, g, b));
        if let Some(texture) = document.painter.paint(&model, version, &document.look, size, time) {
            Image::new(texture).paint_at(ui, rect);
        } else {
            overlay::message(&painter, rect, "Drawing the first picture …", contrast([r, g, b]));
        }
        self.over_picture(ui, &response, rect, index);
        let eye = self.documents[index].look.eye;
        if self.is_linked && eye != before {
            self.documents.iter_mut().for_each(|other| other.look.eye = eye);
        }
    }

    /// Draws what lies over a picture, and picks the voxel that was clicked.
    fn over_picture(&mut self, ui: &Ui, response: &egui::Response, rect: Rect, index: usize) {
        let is_side_by_side = self.is_side_by_side;
        let document = &mut self.documents[index];
        let eye = document.look.eye;
        let projector = Projector::new(&eye, rect);
        let painter = ui.painter_at(rect);
        let colour = contrast(document.look.background);
        if let Some(mut crop) = document.look.crop {
            overlay::crop_box(ui, response, &projector, document.model.grid(), &mut crop, &mut None);
        }
        overlay::axis_cross(&painter, &eye, rect);
        overlay::scale_bar(&painter, &eye, rect, document.model.grid().unit.as_deref(), colour);
        if let Some(at) = response.interact_pointer_pos().filter(|_| response.clicked()) {
            let (origin, direction) = projector.ray(at);
            document.begin_pick(ui.ctx(), origin, direction);
        }
        if let Some(at) = document.picked.and_then(|picked| projector.place(picked.world)) {
            overlay::mark(&painter, at, colour);
        }
        if let Some(fault) = document.painter.fault() {
            overlay::message(&painter, rect, fault, ui.visuals().error_fg_color);
        }
        if is_side_by_side {
            let at = pos2(rect.left() + 10.0, rect.top() + 8.0);
            let font = egui::FontId::proportional(14.0);
            painter.text(at, egui::Align2::LEFT_TOP, &document.title, font, colour);
        }
    }

    fn windows(&mut self, context: &Context) {
        self.path_window(context);
        self.picture_window(context);
    }

    fn path_window(&mut self, context: &Context) {
        let Some(text) = &mut self.typed_path else { return };
        let mut is_open = true;
        let mut chosen = false;
        Window::new("Open a path")
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_TOP, [0.0, 90.0])
            .show(context, |ui| {
                let field = ui.add(egui::TextEdit::singleline(text).desired_width(420.0).hint_text("/data/head.adj"));
                chosen = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
                if !chosen && ui.memory(|memory| memory.focused().is_none()) {
                    field.request_focus();
                }
                chosen |= ui.button("Open").clicked();
            });
        let text = text.trim().to_owned();
        if chosen && !text.is_empty() {
            self.open(context, Path::new(&text));
        }
        if !is_open || chosen || context.input(|input| input.key_pressed(Key::Escape)) {
            self.typed_path = None;
        }
    }

    fn picture_window(&mut self, context: &Context) {
        if !self.form_is_open {
            return;
        }
        let first = PictureForm {
            size: self.view_size,
            is_transparent: false,
            is_deep: false,
            quality: adjsplat::splat::Quality::High,
            frames: 1,
        };
        let form = self.form.get_or_insert(first);
        let (mut is_open, mut saves) = (true, false);
        Window::new("Save picture")
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_TOP, [0.0, 90.0])
            .show(context, |ui| {
                ui.horizontal(|ui| {
                    ui.add(DragValue::new(&mut form.size[0]).range(1..=16_384));
                    ui.label("x");
                    ui.add(DragValue::new(&mut form.size[1]).range(1..=16_384));
                    ui.label("pixels");
                });
                choose(ui, "quality", &mut form.quality, &QUALITIES);
                ui.checkbox(&mut form.is_transparent, "Transparent background");
                ui.checkbox(&mut form.is_deep, "16 bits a sample");
                ui.add(DragValue::new(&mut form.frames).range(1..=3600).prefix("pictures of a full turn: "));
                let ending = if form.frames > 1 { ".apng" } else { ".png or .exr (linear, 32-bit float)" };
                ui.small(format!("The name must end in {ending}."));
                saves = ui.add(Button::new("Choose a file…")).clicked();
            });
        if saves {
            self.dialog = Some(Dialog::begin(Purpose::SavePicture, context));
        }
        self.form_is_open = is_open && !saves;
    }
}

/// Returns the transfer function that the file of a document holds.
fn adjsplat_stored(document: &Document) -> Option<TransferFunction> {
    if !document.is_adj {
        return None;
    }
    document.model.arena().ok().and_then(|arena| adjsplat::internals::stored_transfer(&arena))
}

/// Returns an error with its cause, in one line.
fn full(fault: &Error) -> String {
    let mut text = fault.to_string();
    let mut cause = std::error::Error::source(fault);
    while let Some(inner) = cause {
        text = format!("{text}: {inner}");
        cause = inner.source();
    }
    text
}

/// Returns a line about the picked voxel, or else about the file.
fn describe(document: &Document) -> String {
    let unit = document.model.grid().unit.clone().unwrap_or_default();
    match document.picked {
        Some(picked) => {
            let [x, y, z] = picked.index;
            let place = picked.world.to_array().map(number).join(", ");
            let name = match &document.edits.now {
                Edited::Labels(table) => {
                    table.rows.iter().find(|row| row.label as f64 == picked.value).map(|row| row.name.clone())
                }
                _ => None,
            };
            let name = name.map_or_else(String::new, |name| format!(" ({name})"));
            format!("Voxel {x}, {y}, {z} at {place} {unit}: value {}{name}", number(picked.value))
        }
        None => {
            let [x, y, z] = document.model.grid().dims;
            format!(
                "{x} x {y} x {z} points, {} visible voxels. Click to pick a voxel.",
                document.model.visible_voxels()
            )
        }
    }
}

/// Returns a colour that is seen on a background.
fn contrast([r, g, b]: [u8; 3]) -> Color32 {
    let brightness = 0.3 * f32::from(r) + 0.59 * f32::from(g) + 0.11 * f32::from(b);
    if brightness > 140.0 { Color32::from_gray(40) } else { Color32::from_gray(225) }
}
