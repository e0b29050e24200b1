//! The program: open documents as tabs or side by side, menus, keys, messages.

mod menu;
mod views;
mod windows;

use std::path::{Path, PathBuf};

use adjsplat::TransferFunction;
use adjsplat::error::{Error, Result};
use egui::{CentralPanel, Context, Key, Modifiers, Panel, Popup, Theme, Ui};

use crate::dialog::{Dialog, NoDialog, Purpose};
use crate::document::Document;
use crate::draw::Renderer;
use crate::look::SIDES;
use crate::navigate::Manner;
use crate::open::{FilePlace, Opening, Wish};
use crate::panel::{Request, panel};
use crate::recent::RecentFiles;
use crate::save::{PictureForm, Saving, write};
use crate::theme;

/// The viewer.
pub struct Viewer {
    documents: Vec<Document>,
    active: usize,
    openings: Vec<Opening>,
    savings: Vec<Saving>,
    dialog: Option<Dialog>,
    recent: RecentFiles,
    renderer: Renderer,
    manner: Manner,
    /// Whether all documents are seen from the same place.
    is_linked: bool,
    is_side_by_side: bool,
    has_panel: bool,
    /// The path that is typed and what it is for, while the window for it is open.
    typed_path: Option<(Purpose, String)>,
    /// How the next picture is saved, while the window for it is open.
    form: Option<PictureForm>,
    form_is_open: bool,
    /// What was said since the last click on a view; with each line whether it is an error.
    messages: Vec<(String, bool)>,
    /// The size of the last view, in pixels.
    view_size: [u32; 2],
    was_dark: Option<bool>,
}

impl Viewer {
    /// Creates a viewer that opens these files; `renderer` draws their pictures.
    pub fn new(context: &Context, files: &[PathBuf], recent: RecentFiles, renderer: Renderer) -> Viewer {
        theme::apply(context);
        let mut viewer = Viewer {
            documents: Vec::new(),
            active: 0,
            openings: Vec::new(),
            savings: Vec::new(),
            dialog: None,
            recent,
            renderer,
            manner: Manner { has_inertia: true, flies: false },
            is_linked: false,
            is_side_by_side: false,
            has_panel: true,
            typed_path: None,
            form: None,
            form_is_open: false,
            messages: Vec::new(),
            view_size: [800, 600],
            was_dark: None,
        };
        files.iter().for_each(|file| viewer.open(context, FilePlace::Path(file.clone())));
        viewer
    }

    /// Begins to open a file.
    pub fn open(&mut self, context: &Context, place: FilePlace) {
        self.open_as(context, place, Wish::default());
    }

    /// Begins to open a file that is to be shown as `wish` says.
    pub fn open_as(&mut self, context: &Context, place: FilePlace, wish: Wish) {
        self.openings.push(Opening::begin(place, wish, context));
    }

    /// Returns the open documents, in the order of their tabs.
    pub fn documents(&self) -> &[Document] {
        &self.documents
    }

    /// Returns the document of the tab that is shown.
    pub fn active(&self) -> Option<&Document> {
        self.documents.get(self.active)
    }

    /// Returns what was said since the last click on a view, such as why a file could not be opened; lines of text.
    pub fn message(&self) -> Option<String> {
        let lines: Vec<&str> = self.messages.iter().map(|(text, _)| text.as_str()).collect();
        (!lines.is_empty()).then(|| lines.join("\n"))
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
                let document = &mut self.documents[self.active];
                let before = document.look.eye;
                let request = panel(ui, document, &mut self.manner, self.view_size);
                self.answer(&context, request);
                self.link_views(self.active, before);
            });
        }
        let views = CentralPanel::no_frame().show(ui, |ui| self.views(ui)).response.rect;
        self.windows(&context, views);
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
        let places = dropped(context);
        if !places.is_empty() {
            self.messages.clear();
        }
        places.into_iter().for_each(|place| self.open(context, place));
    }

    /// Says that something is done, below what failed.
    fn say(&mut self, text: impl Into<String>) {
        self.messages.retain(|(_, is_error)| *is_error);
        self.messages.push((text.into(), false));
    }

    /// Says why something failed, below what failed before.
    fn fail(&mut self, fault: &Error) {
        self.warn(full(fault));
    }

    fn warn(&mut self, text: String) {
        let line = (text, true);
        if !self.messages.contains(&line) {
            self.messages.push(line);
        }
    }

    /// Takes what threads and dialogs have finished.
    fn take_results(&mut self, context: &Context) {
        let background = theme::background(context.theme() == Theme::Dark);
        let mut opened = Vec::new();
        self.openings.retain(|opening| match opening.result() {
            None => true,
            Some(result) => {
                opened.push((opening.place.clone(), opening.wish.clone(), result));
                false
            }
        });
        for (place, wish, result) in opened {
            match result.and_then(|opened| Document::new(context, opened, background, self.renderer)) {
                Ok(mut document) => {
                    if let Some(path) = document.place.path() {
                        self.recent.add(path);
                    }
                    if let Err(fault) = document.fulfil(&wish) {
                        self.fail(&fault);
                    }
                    self.documents.push(document);
                    self.active = self.documents.len() - 1;
                }
                Err(Error::Interrupted) => self.say(format!("{} was not opened", place.name())),
                Err(fault) => self.fail(&fault),
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
            match result {
                Ok(()) => self.say(format!("Saved {}", path.display())),
                Err(Error::Interrupted) => self.say(format!("{} was not saved", path.display())),
                Err(fault) => self.fail(&fault),
            }
        }
        if let Some((purpose, choice)) = self.dialog.as_ref().and_then(Dialog::result) {
            self.dialog = None;
            match choice {
                Ok(places) => self.chosen(context, purpose, places),
                Err(NoDialog) => {
                    self.typed_path = Some((purpose, String::new()));
                    self.warn(NO_DIALOG.into());
                }
            }
        }
        self.documents.iter_mut().for_each(Document::finish_pick);
        let faults: Vec<String> = self.documents.iter_mut().filter_map(Document::take_news).collect();
        faults.into_iter().for_each(|fault| self.warn(fault));
    }

    /// Does what a file was chosen for.
    fn chosen(&mut self, context: &Context, purpose: Purpose, mut places: Vec<FilePlace>) {
        if !places.is_empty() {
            self.messages.clear();
        }
        if matches!(purpose, Purpose::OpenFile | Purpose::OpenFolder) {
            return places.into_iter().for_each(|place| self.open(context, place));
        }
        let Some(place) = places.pop() else { return };
        let path = place.path().unwrap_or("".as_ref());
        // A browser asks for no name.
        let is_turn = cfg!(target_arch = "wasm32") && self.form.is_some_and(|form| form.frames > 1);
        let path = if is_turn && purpose == Purpose::SavePicture { "turn.apng".as_ref() } else { path };
        let Some(document) = self.documents.get_mut(self.active) else { return };
        let result = match purpose {
            Purpose::OpenFile | Purpose::OpenFolder => Ok(()),
            Purpose::SavePicture => {
                if let Some(form) = self.form {
                    // On a desktop the processor, whose pictures are those of `adj render` bit for bit.
                    let canvas = cfg!(target_arch = "wasm32").then(|| document.painter.canvas());
                    self.savings.push(Saving::begin(path, &document.model, &document.look, form, canvas, context));
                }
                Ok(())
            }
            Purpose::LoadTransfer => transfer_at(&place).map(|transfer| document.set_transfer(&transfer)),
            Purpose::SaveTransfer => {
                let saved = document.transfer().and_then(|transfer| save_transfer(path, &transfer.to_json()));
                if saved.is_ok() && !cfg!(target_arch = "wasm32") {
                    self.say(format!("Saved {}", path.display()));
                }
                saved
            }
        };
        if let Err(fault) = result {
            self.fail(&fault);
        }
    }

    fn answer(&mut self, context: &Context, request: Option<Request>) {
        match request {
            Some(Request::LoadTransfer) => self.dialog = Some(Dialog::begin(Purpose::LoadTransfer, context)),
            Some(Request::SaveTransfer) => self.dialog = Some(Dialog::begin(Purpose::SaveTransfer, context)),
            Some(Request::Fit) => self.documents[self.active].fit(self.view_size),
            None => {}
        }
    }

    fn keys(&mut self, context: &Context) {
        let pressed = |modifiers, key| context.input_mut(|input| input.consume_key(modifiers, key));
        if pressed(Modifiers::COMMAND, Key::O) && self.typed_path.is_none() {
            self.typed_path = Some((Purpose::OpenFile, String::new()));
        }
        // A text field uses the other keys itself.
        if context.text_edit_focused() {
            return;
        }
        // Esc is first for what lies over the views.
        let is_covered = self.form_is_open || self.typed_path.is_some() || Popup::is_any_open(context);
        // A browser closes the page by Ctrl+W.
        let closes = if cfg!(target_arch = "wasm32") { Modifiers::ALT } else { Modifiers::COMMAND };
        if pressed(closes, Key::W) && !self.documents.is_empty() {
            self.close(self.active);
        }
        let size = self.view_size;
        let Some(document) = self.documents.get_mut(self.active) else { return };
        let before = document.look.eye;
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
        if !is_covered && context.input(|input| input.key_pressed(Key::Escape)) {
            document.picked = None;
        }
        self.link_views(self.active, before);
    }

    fn close(&mut self, index: usize) {
        self.documents.remove(index);
        if index < self.active || self.active == self.documents.len() {
            self.active = self.active.saturating_sub(1);
        }
    }
}

/// What is said where there is no dialog for files.
const NO_DIALOG: &str = "this desktop has no dialogs for files (neither a portal, xdg-desktop-portal, nor zenity); type a path. Files \
    to open can also be dragged into the window, or named after adj view";

/// Returns where files and folders are that were dropped.
#[cfg(not(target_arch = "wasm32"))]
fn dropped(context: &Context) -> Vec<FilePlace> {
    let dropped = context.input(|input| input.raw.dropped_files.clone());
    FilePlace::together(dropped.iter().map(|file| file.path().to_path_buf()).collect())
}

/// Returns where files and folders are that were dropped.
#[cfg(target_arch = "wasm32")]
fn dropped(_: &Context) -> Vec<FilePlace> {
    crate::page::dropped()
}

/// Reads the transfer function at a place.
fn transfer_at(place: &FilePlace) -> Result<TransferFunction> {
    match place {
        FilePlace::Bytes(name, bytes) => {
            let text = std::str::from_utf8(bytes).map_err(|_| Error::input(name, "is no text"))?;
            TransferFunction::from_text(name.as_ref(), text)
        }
        _ => TransferFunction::read(place.path().unwrap_or("".as_ref())),
    }
}

/// Writes a transfer function as JSON; never over a file of another kind.
fn save_transfer(path: &Path, text: &str) -> Result<()> {
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json")) {
        return Err(Error::input(path.display().to_string(), "is no name for a transfer function; end it in .json"));
    }
    write(path, |out| out.write_all(text.as_bytes()))
}

/// Options of readers in messages, each with the option of `adj build` that replaces it: the viewer has none.
const ADVICE: [(&str, &str); 5] = [
    ("describe them with `OpenOptions::raw`", "describe them to adj build by --dims 256x256x128 --type u8 or alike"),
    ("`OpenOptions::level`", "adj build --level"),
    ("`OpenOptions::outside_files`", "adj build --outside-files"),
    ("`OpenOptions::series`", "adj build --series"),
    ("`OpenOptions::spacing`", "adj build --spacing XxYxZ"),
];

/// Returns an error with its cause, in one line.
fn full(fault: &Error) -> String {
    ADVICE.iter().fold(fault.with_causes(), |text, (option, flag)| text.replace(option, flag))
}
