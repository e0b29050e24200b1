//! The menu, the tabs and the last line.

use adjsplat::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::splat::Quality;
use egui::{Button, Context, Label, ProgressBar, Theme, Ui};

use super::Viewer;
use crate::dialog::Purpose;
use crate::document::Document;
use crate::editor::Edited;
use crate::editor::ui::{name, number};
use crate::open::{FilePlace, shortened};
use crate::save::{camera_json, command};

/// The most letters of a file's name on a tab.
pub(super) const LONGEST_TAB: usize = 32;

impl Viewer {
    pub(super) fn menu(&mut self, ui: &mut Ui) {
        let context = ui.ctx().clone();
        ui.add_space(3.0);
        ui.horizontal_wrapped(|ui| {
            ui.menu_button("Open", |ui| {
                if ui.button("File…").clicked() {
                    self.ask_for_file(&context, Purpose::OpenFile);
                    ui.close();
                }
                if ui.button("Folder…").on_hover_text("DICOM or TIFF slices, or Zarr").clicked() {
                    self.ask_for_file(&context, Purpose::OpenFolder);
                    ui.close();
                }
                let (title, what) = match cfg!(target_arch = "wasm32") {
                    true => ("Address…", "Type the address of an .adj file or a volume on this page's server"),
                    false => ("Path…", "Type the path of a file or a folder"),
                };
                if ui.button(title).on_hover_text(what).clicked() {
                    self.ask_for_path(Purpose::OpenFile);
                    ui.close();
                }
                ui.separator();
                let paths = self.recent.paths().to_vec();
                for path in paths {
                    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
                    if ui.button(name).on_hover_text(path.display().to_string()).clicked() {
                        self.messages.clear();
                        self.open(&context, FilePlace::Path(path));
                        ui.close();
                    }
                }
            });
            let is_lost = self.active().is_some_and(Document::is_lost);
            ui.add_enabled_ui(!self.documents.is_empty(), |ui| {
                if ui.add_enabled(!is_lost, Button::new("Save picture")).clicked() {
                    self.form_is_open = true;
                    self.form.get_or_insert_default().size = self.view_size;
                }
                ui.menu_button("Copy", |ui| {
                    if !cfg!(target_arch = "wasm32") && ui.button("Command that makes this picture").clicked() {
                        self.copy(&context, true);
                        ui.close();
                    }
                    if ui.button("Camera as JSON").clicked() {
                        self.copy(&context, false);
                        ui.close();
                    }
                    #[cfg(target_arch = "wasm32")]
                    if ui.button("Link to this view").clicked() {
                        self.copy_link(&context);
                        ui.close();
                    }
                });
            });
            ui.separator();
            ui.checkbox(&mut self.has_panel, "Panel");
            if self.documents.len() > 1 {
                ui.checkbox(&mut self.is_side_by_side, "Side by side");
                let link = ui.checkbox(&mut self.is_linked, "Link views");
                if link.on_hover_text("All files are seen from the same place").changed() && self.is_linked {
                    self.show_all_from(self.documents[self.active].look.eye);
                }
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
        let text = match (is_command, document.place.path()) {
            (true, Some(path)) => {
                let size = self.view_size;
                let (look, model, transfer) = (&document.look, &document.model, changed_transfer(document));
                command(path, document.is_built_otherwise(), look, model, size, Quality::High, transfer)
            }
            (true, None) => Err(Error::input("the model", "lies in no file that a command could name")),
            (false, _) => camera_json(&document.look),
        };
        self.put_on_clipboard(context, text);
    }

    fn put_on_clipboard(&mut self, context: &Context, text: Result<String>) {
        match text {
            Ok(text) => {
                context.copy_text(text);
                self.say("Copied to the clipboard");
            }
            Err(fault) => self.fail(&fault),
        }
    }

    /// Copies a link that opens the page with this file, view and transfer function.
    #[cfg(target_arch = "wasm32")]
    fn copy_link(&mut self, context: &Context) {
        let Some(document) = self.documents.get(self.active) else { return };
        let transfer = changed_transfer(document).map(TransferFunction::to_json);
        let link = match &document.place {
            FilePlace::Address(file) => crate::page::link(file, &document.look.eye.to_text(), transfer.as_deref()),
            _ => None,
        };
        let link = link.ok_or_else(|| Error::input(&document.title, "lies on no server that a link could name"));
        self.put_on_clipboard(context, link);
    }

    pub(super) fn tabs(&mut self, ui: &mut Ui) {
        let mut closed = None;
        ui.horizontal_wrapped(|ui| {
            for index in 0..self.documents.len() {
                let title = self.documents[index].title.clone();
                let short = shortened(&title, LONGEST_TAB);
                let mut tab = ui.selectable_label(index == self.active, &short);
                if short != title {
                    name(&tab, title.clone());
                }
                // A page knows no paths.
                let path = self.documents[index].place.path().filter(|_| cfg!(not(target_arch = "wasm32")));
                if path.is_some() || short != title {
                    tab = tab.on_hover_text(path.map_or(title, |path| path.display().to_string()));
                }
                if tab.clicked() {
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

    /// The last line. It has one height, as the views would change their sizes with it: what is too long for it ends in "…".
    pub(super) fn status(&mut self, ui: &mut Ui) {
        ui.add_space(2.0);
        ui.horizontal(|ui| {
            for document in &self.documents {
                if let Some((lane, share)) =
                    document.painter.device_model().remote().and_then(|remote| remote.fetching())
                {
                    let voxels = match lane.level {
                        0 => "the voxels".into(),
                        level => format!("level {level}"),
                    };
                    ui.add(ProgressBar::new(share).desired_width(140.0));
                    let text = format!("Fetching {voxels} of {} along {}.", document.title, lane.axis.name());
                    ui.add(Label::new(text).truncate());
                }
            }
            if let Some(document) = self.documents.get(self.active) {
                ui.add(Label::new(describe(document)).truncate());
            }
        });
        ui.add_space(2.0);
    }
}

/// Returns the transfer function with which a document is drawn, unless the file holds the same.
fn changed_transfer(document: &Document) -> Option<&TransferFunction> {
    let arena = document.model.arena().ok().filter(|_| document.is_adj);
    let stored = arena.and_then(|arena| adjsplat::internals::stored_transfer(&arena));
    Some(document.model.transfer()).filter(|transfer| stored.as_ref() != Some(transfer))
}

/// Returns a line about the picked voxel, or else about the file.
fn describe(document: &Document) -> String {
    let unit = document.unit.as_deref().map_or_else(String::new, |unit| format!(" {unit}"));
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
            format!("Voxel {x}, {y}, {z} at {place}{unit}: value {}{name}", number(picked.value))
        }
        None => {
            let [x, y, z] = document.model.grid().dims;
            format!(
                "{x} x {y} x {z} points, {} visible voxels. {}",
                document.model.visible_voxels(),
                if document.is_lost() { "They could not be fetched." } else { "Click to pick a voxel." }
            )
        }
    }
}
