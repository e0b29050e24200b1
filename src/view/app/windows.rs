//! What lies over the views: windows for a typed path and for saving a picture, progress, and the last message.

use std::path::Path;

use adjsplat::splat::Quality;
use egui::{Area, Button, Context, Frame, Key, Label, ProgressBar, Rect, Window, vec2};

use super::Viewer;
use crate::dialog::{Dialog, Purpose};
use crate::editor::ui::{choose, field};
use crate::open::FilePlace;
use crate::panel::QUALITIES;
use crate::save::PictureForm;

impl Viewer {
    /// Shows them; `views` is where the views are.
    pub(super) fn windows(&mut self, context: &Context, views: Rect) {
        self.notices(context, views);
        self.path_window(context);
        self.picture_window(context);
    }

    /// Files that are being opened and pictures that are being saved, and the last message, in a corner of the views.
    fn notices(&self, context: &Context, views: Rect) {
        if self.openings.is_empty() && self.savings.is_empty() && self.messages.is_empty() {
            return;
        }
        let style = context.global_style();
        let frame = Frame::window(&style).shadow(egui::Shadow::NONE).inner_margin(8.0);
        Area::new(egui::Id::unique("notices")).fixed_pos(views.min + vec2(10.0, 10.0)).show(context, |ui| {
            frame.show(ui, |ui| {
                ui.set_max_width((views.width() - 40.0).max(0.0));
                for opening in &self.openings {
                    let (phase, share) = opening.progress();
                    ui.horizontal(|ui| {
                        if ui.button("Cancel").clicked() {
                            opening.cancel();
                        }
                        ui.add(ProgressBar::new(share).desired_width(140.0));
                        ui.add(Label::new(format!("{phase}: {}", opening.place.name())).truncate());
                    });
                }
                for saving in &self.savings {
                    ui.horizontal(|ui| {
                        if ui.button("Cancel").clicked() {
                            saving.cancel();
                        }
                        ui.label(format!("Drawing {} of {}", saving.done() + 1, saving.frames));
                    });
                }
                for (text, is_error) in &self.messages {
                    let colour = if *is_error { ui.visuals().error_fg_color } else { ui.visuals().text_color() };
                    ui.add(Label::new(egui::RichText::new(text).color(colour)).wrap());
                }
            });
        });
    }

    fn path_window(&mut self, context: &Context) {
        let Some((purpose, text)) = &mut self.typed_path else { return };
        let purpose = *purpose;
        let mut is_open = true;
        let mut chosen = false;
        let is_page = cfg!(target_arch = "wasm32");
        let (title, example, verb) = match purpose {
            Purpose::OpenFile | Purpose::OpenFolder if is_page => ("Open an address", "head.adj", "Open"),
            Purpose::OpenFile | Purpose::OpenFolder => ("Open a path", "/data/head.adj", "Open"),
            Purpose::SavePicture => ("Save the picture to a path", "/data/picture.png", "Save"),
            Purpose::LoadTransfer => ("Load a transfer function from a path", "/data/transfer.json", "Load"),
            Purpose::SaveTransfer => ("Save the transfer function to a path", "/data/transfer.json", "Save"),
        };
        Window::new(title)
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_TOP, [0.0, 140.0])
            .show(context, |ui| {
                let field = ui.add(
                    egui::TextEdit::singleline(text)
                        .desired_width((context.content_rect().width() - 60.0).clamp(0.0, 420.0))
                        .hint_text(example),
                );
                let replaces = purpose.saves() && Path::new(text.trim()).exists();
                let is_empty = text.trim().is_empty();
                let is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
                chosen = is_entered && !replaces && !is_empty;
                if !chosen && ui.memory(|memory| memory.focused().is_none()) {
                    field.request_focus();
                }
                let button = Button::new(if replaces { "Replace the file" } else { verb });
                chosen |= ui.add_enabled(!is_empty, button).clicked();
            });
        let text = text.trim().to_owned();
        if chosen {
            let place = if is_page { FilePlace::Address(text) } else { FilePlace::Path(text.into()) };
            self.chosen(context, purpose, vec![place]);
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
            quality: Quality::High,
            frames: 1,
        };
        let form = self.form.get_or_insert(first);
        let (mut is_open, mut saves) = (true, false);
        Window::new("Save picture")
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_TOP, [0.0, 140.0])
            .show(context, |ui| {
                ui.horizontal(|ui| {
                    ui.add(field(&mut form.size[0], 1..=16_384));
                    ui.label("x");
                    ui.add(field(&mut form.size[1], 1..=16_384));
                    ui.label("pixels");
                });
                choose(ui, "quality", &mut form.quality, &QUALITIES);
                ui.checkbox(&mut form.is_transparent, "Transparent background");
                ui.checkbox(&mut form.is_deep, "16 bits a sample");
                ui.add(field(&mut form.frames, 1..=3600).prefix("pictures of a full turn: "));
                let endings = if form.frames > 1 {
                    "The name ends in .apng for one file, in .png or .exr (linear, 32-bit float) for numbered files."
                } else {
                    "The name ends in .png or .exr (linear, 32-bit float)."
                };
                ui.small(endings);
                saves = ui.add(Button::new("Choose a file…")).clicked();
            });
        if saves {
            self.dialog = Some(Dialog::begin(Purpose::SavePicture, context));
        }
        self.form_is_open = is_open && !saves && !context.input(|input| input.key_pressed(Key::Escape));
    }
}
