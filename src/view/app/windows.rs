//! What lies over the views: windows for a typed path and for saving a picture, progress, and the last message.

use egui::{Area, Button, Context, Frame, Key, Label, ProgressBar, Rect, ViewportCommand, Window, vec2};

use super::menu::LONGEST_TAB;
use super::{Closing, Viewer};
use crate::dialog::Purpose;
use crate::document::Document;
use crate::editor::ui::{choose, field};
use crate::open::{FilePlace, shortened};
use crate::panel::QUALITIES;
use crate::save::{PictureJob, Saving};

impl Viewer {
    /// Shows them; `views` is where the views are.
    pub(super) fn windows(&mut self, context: &Context, views: Rect) {
        self.notices(context, views);
        self.closing_window(context);
        self.path_window(context);
        self.picture_window(context);
    }

    /// Files that are being opened and pictures that are being saved, and the last message, in a corner of the views.
    fn notices(&mut self, context: &Context, views: Rect) {
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
                        ui.add(Label::new(saving.progress()).truncate());
                    });
                }
                for (text, is_error) in &self.messages {
                    let colour = if *is_error { ui.visuals().error_fg_color } else { ui.visuals().text_color() };
                    ui.add(Label::new(egui::RichText::new(text).color(colour)).wrap());
                }
                if self.messages.iter().any(|(_, is_error)| *is_error) && ui.small_button("Close").clicked() {
                    self.messages.clear();
                }
            });
        });
    }

    fn path_window(&mut self, context: &Context) {
        let Some((purpose, text)) = self.typed_paths.first_mut() else { return };
        let mut is_open = true;
        let mut chosen = false;
        let is_page = cfg!(target_arch = "wasm32");
        let (title, example, verb) = match purpose {
            Purpose::OpenFile | Purpose::OpenFolder if is_page => ("Open an address", "head.adj", "Open"),
            Purpose::OpenFile | Purpose::OpenFolder => ("Open a path", "/data/head.adj", "Open"),
            Purpose::SavePicture(_) => ("Save the picture to a path", "/data/picture.png", "Save"),
            Purpose::LoadTransfer(_) => ("Load a function from a path", "/data/transfer.json", "Load"),
            Purpose::SaveTransfer(_) => ("Save the function to a path", "/data/transfer.json", "Save"),
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
                let replaces = purpose.replaces(text.trim().as_ref());
                let is_empty = text.trim().is_empty();
                let is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
                chosen = is_entered && !replaces && !is_empty;
                if !chosen && ui.memory(|memory| memory.focused().is_none()) {
                    field.request_focus();
                }
                let button = Button::new(if replaces { "Replace the file" } else { verb });
                chosen |= ui.add_enabled(!is_empty, button).clicked();
            });
        if !is_open || chosen || context.input(|input| input.key_pressed(Key::Escape)) {
            let (purpose, text) = self.typed_paths.remove(0);
            let text = text.trim().to_owned();
            let place = if is_page { FilePlace::Address(text) } else { FilePlace::Path(text.into()) };
            if chosen {
                self.chosen(context, purpose, vec![place]);
            }
        }
    }

    /// Asks what shall become of transfer functions that are not saved and of pictures that are being saved, before something is
    /// closed.
    fn closing_window(&mut self, context: &Context) {
        let Some(closing) = self.closing else { return };
        let closes = |document: &Document| closing == Closing::Program || closing == Closing::Document(document.number);
        let unsaved = self.documents.iter().filter(|document| closes(document) && document.is_unsaved());
        let unsaved: Vec<(u64, &str)> = unsaved.map(|document| (document.number, &*document.title)).collect();
        // A browser closes a page without asking it.
        let waits = cfg!(not(target_arch = "wasm32")) && closing == Closing::Program;
        let savings: &[Saving] = if waits { &self.savings } else { &[] };
        let (mut is_open, mut saves, mut gives_up) = (true, None, unsaved.is_empty() && savings.is_empty());
        // While a file for one is chosen, the question waits.
        if !self.dialogs.is_empty() || !self.typed_paths.is_empty() {
            return;
        }
        if !gives_up {
            Window::new("Unsaved changes")
                .collapsible(false)
                .resizable(false)
                .anchor(egui::Align2::CENTER_TOP, [0.0, 140.0])
                .show(context, |ui| {
                    for (_, title) in &unsaved {
                        ui.label(format!("The transfer function of {title} was changed and is not saved."));
                    }
                    for saving in savings {
                        ui.label(format!("{} is being saved. Then the window closes.", saving.names()));
                    }
                    ui.horizontal(|ui| {
                        if let Some((first, _)) = unsaved.first() {
                            let save = ui.button("Save…");
                            if ui.memory(|memory| memory.focused().is_none()) {
                                save.request_focus();
                            }
                            saves = save.clicked().then_some(*first);
                        }
                        gives_up = ui.button("Close without saving").clicked();
                        is_open = !ui.button("Cancel").clicked() && !ui.input(|input| input.key_pressed(Key::Escape));
                    });
                });
        }
        if let Some(number) = saves {
            self.ask_for_file(context, Purpose::SaveTransfer(number));
        }
        if gives_up {
            match closing {
                Closing::Program => {
                    self.savings.iter().for_each(Saving::cancel);
                    self.gives_up = true;
                    context.send_viewport_cmd(ViewportCommand::Close);
                }
                Closing::Document(number) => {
                    let index = self.documents.iter().position(|document| document.number == number);
                    index.into_iter().for_each(|index| self.remove(index));
                }
            }
        }
        if gives_up || !is_open {
            self.closing = None;
        }
    }

    fn picture_window(&mut self, context: &Context) {
        let Some(document) = self.documents.get(self.active).filter(|_| self.form_is_open) else {
            self.form_is_open = false;
            return;
        };
        let form = self.form.get_or_insert_default();
        let (mut is_open, mut saves) = (true, false);
        Window::new(format!("Save picture of {}", shortened(&document.title, LONGEST_TAB)))
            .id(egui::Id::unique("picture"))
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
                let is_page = cfg!(target_arch = "wasm32");
                let endings = if is_page {
                    "The browser saves it as PNG."
                } else if form.frames > 1 {
                    "The name ends in .apng for one file, in .png or .exr (linear, 32-bit float) for numbered files."
                } else {
                    "The name ends in .png or .exr (linear, 32-bit float)."
                };
                ui.small(endings);
                saves = ui.button(if is_page { "Save" } else { "Choose a file…" }).clicked();
            });
        if saves {
            // On a desktop the processor draws, whose pictures are those of `adj render` bit for bit.
            let device_model = cfg!(target_arch = "wasm32").then(|| document.painter.device_model().clone());
            let job =
                PictureJob { model: document.model.clone(), look: document.look.clone(), form: *form, device_model };
            self.ask_for_file(context, Purpose::SavePicture(Box::new(job)));
        }
        self.form_is_open = is_open && !saves && !context.input(|input| input.key_pressed(Key::Escape));
    }
}
