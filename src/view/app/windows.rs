//! The windows for a typed path and for saving a picture.

use adjsplat::splat::Quality;
use egui::{Button, Context, Key, Window};

use super::Viewer;
use crate::dialog::{Dialog, Purpose};
use crate::editor::ui::{choose, field};
use crate::open::Place;
use crate::panel::QUALITIES;
use crate::save::PictureForm;

impl Viewer {
    pub(super) fn windows(&mut self, context: &Context) {
        self.path_window(context);
        self.picture_window(context);
    }

    fn path_window(&mut self, context: &Context) {
        let Some(text) = &mut self.typed_path else { return };
        let mut is_open = true;
        let mut chosen = false;
        let (title, example) = match cfg!(target_arch = "wasm32") {
            true => ("Open an address", "head.adj"),
            false => ("Open a path", "/data/head.adj"),
        };
        Window::new(title)
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_TOP, [0.0, 90.0])
            .show(context, |ui| {
                let field = ui.add(egui::TextEdit::singleline(text).desired_width(420.0).hint_text(example));
                chosen = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
                if !chosen && ui.memory(|memory| memory.focused().is_none()) {
                    field.request_focus();
                }
                chosen |= ui.button("Open").clicked();
            });
        let text = text.trim().to_owned();
        if chosen && !text.is_empty() {
            self.open(
                context,
                if cfg!(target_arch = "wasm32") { Place::Address(text) } else { Place::Path(text.into()) },
            );
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
            .anchor(egui::Align2::CENTER_TOP, [0.0, 90.0])
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
