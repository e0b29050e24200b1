//! The program: open documents as tabs or side by side, menus, keys, messages.

mod menu;
#[cfg(test)]
mod tests;
mod views;
mod windows;

use std::path::{Path, PathBuf};

use adjsplat::TransferFunction;
use adjsplat::error::{Error, Result};
use egui::{CentralPanel, Context, Key, Modifiers, Panel, Popup, Theme, Ui, ViewportCommand};

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

/// What the user closes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Closing {
    /// The document of this number.
    Document(u64),
    /// The program.
    Program,
}

/// The viewer.
pub struct Viewer {
    documents: Vec<Document>,
    active: usize,
    /// The number of files that were to be opened.
    opening_count: u64,
    openings: Vec<Opening>,
    savings: Vec<Saving>,
    dialogs: Vec<Dialog>,
    recent: RecentFiles,
    renderer: Renderer,
    manner: Manner,
    /// Whether all documents are seen from the same place.
    is_linked: bool,
    is_side_by_side: bool,
    has_panel: bool,
    /// The paths that are asked for one after the other, as typed so far, and what they are for.
    typed_paths: Vec<(Purpose, String)>,
    /// How the next picture is saved, while the window for it is open.
    form: Option<PictureForm>,
    form_is_open: bool,
    /// What shall be closed, while the window that asks for unsaved changes is open.
    closing: Option<Closing>,
    /// Whether the user gave unsaved changes up and closes the program.
    gives_up: bool,
    /// What was said since the last click on a view; with each line whether it is an error.
    messages: Vec<(String, bool)>,
    /// The size of the last view, in pixels.
    view_size: [u32; 2],
    was_dark: Option<bool>,
    /// The title of the window.
    title: String,
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
            dialogs: Vec::new(),
            opening_count: 0,
            recent,
            renderer,
            manner: Manner { has_inertia: true, flies: false },
            is_linked: false,
            is_side_by_side: false,
            has_panel: true,
            typed_paths: Vec::new(),
            form: None,
            form_is_open: false,
            closing: None,
            gives_up: false,
            messages: Vec::new(),
            view_size: [800, 600],
            was_dark: None,
            title: String::new(),
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
        self.opening_count += 1;
        self.openings.push(Opening::begin(self.opening_count, place, wish, context));
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
        self.keep_unsaved(&context);
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
        self.name_window(&context);
    }

    /// Puts the name of the file that is shown into the title of the window, or of the page.
    fn name_window(&mut self, context: &Context) {
        let title = self.active().map_or("adjsplat".into(), |document| format!("{} – adjsplat", document.title));
        if title != self.title {
            #[cfg(target_arch = "wasm32")]
            crate::page::set_title(&title);
            context.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
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
                opened.push((opening.number, opening.place.clone(), opening.wish.clone(), result));
                false
            }
        });
        for (number, place, wish, result) in opened {
            match result.and_then(|opened| Document::new(context, opened, background, self.renderer)) {
                Ok(mut document) => {
                    if let Some(path) = document.place.path() {
                        self.recent.add(path);
                    }
                    if let Err(fault) = document.fulfil(&wish) {
                        self.fail(&fault);
                    }
                    document.number = number;
                    self.insert(context, document);
                }
                Err(Error::Interrupted) => self.say(format!("{} was not opened", place.name())),
                Err(fault) => {
                    let (text, name) = (full(&fault), place.name());
                    self.warn(if text.contains(&name) { text } else { format!("{name}: {text}") });
                }
            }
        }
        let mut saved = Vec::new();
        self.savings.retain(|saving| {
            let Some(result) = saving.result() else { return true };
            saved.push((saving.names(), saving.written(), result));
            false
        });
        for (names, written, result) in saved {
            // What was to be closed after it stays open, so that the user sees why it failed.
            if result.is_err() && !self.gives_up {
                self.closing = None;
            }
            match (result, written) {
                (Ok(()), _) => self.say(format!("Saved {names}")),
                (Err(Error::Interrupted), Some(written)) => self.say(written),
                (Err(Error::Interrupted), None) => self.say(format!("Not saved: {names}")),
                (Err(fault), Some(written)) => self.warn(format!("{}; {written}", full(&fault))),
                (Err(fault), None) => self.fail(&fault),
            }
        }
        let mut answers = Vec::new();
        self.dialogs.retain(|dialog| dialog.is_open(&mut answers));
        for (purpose, choice) in answers {
            match choice {
                Ok(places) => self.chosen(context, purpose, places),
                Err(NoDialog) => {
                    self.ask_for_path(purpose);
                    self.warn(NO_DIALOG.into());
                }
            }
        }
        self.documents.iter_mut().for_each(Document::finish_pick);
        let faults: Vec<String> = self.documents.iter_mut().filter_map(Document::take_news).collect();
        faults.into_iter().for_each(|fault| self.warn(fault));
    }

    /// Adds a document, in the order in which files were to be opened. It is shown, unless a later one is, or the user is at work
    /// on the one that is shown.
    fn insert(&mut self, context: &Context, mut document: Document) {
        let before = |other: &Document| other.number < document.number;
        let index = self.documents.partition_point(before);
        let active = self.active().map(|active| (active.look.eye, before(active)));
        if let Some((eye, _)) = active.filter(|_| self.is_linked) {
            (document.look.eye, document.needs_fit) = (eye, false);
        }
        let is_at_work = self.has_window() || context.text_edit_focused();
        let is_shown = active.is_none_or(|(_, is_before)| is_before && !is_at_work);
        self.documents.insert(index, document);
        if is_shown {
            self.active = index;
        } else if index <= self.active {
            self.active += 1;
        }
        #[cfg(not(target_arch = "wasm32"))]
        self.tell_apart();
    }

    /// Puts their folders before the names of files that have the same name.
    #[cfg(not(target_arch = "wasm32"))]
    fn tell_apart(&mut self) {
        let names: Vec<String> = self.documents.iter().map(|document| document.place.name()).collect();
        for (document, name) in self.documents.iter_mut().zip(&names) {
            let folder = document.place.path().and_then(Path::parent).and_then(Path::file_name);
            if let Some(folder) = folder.filter(|_| names.iter().filter(|other| *other == name).count() > 1) {
                document.title = format!("{}/{name}", folder.display());
            }
        }
    }

    /// Returns whether a window asks something.
    fn has_window(&self) -> bool {
        self.form_is_open || self.closing.is_some() || !self.typed_paths.is_empty()
    }

    /// Opens a dialog for a file.
    fn ask_for_file(&mut self, context: &Context, purpose: Purpose) {
        self.dialogs.push(Dialog::begin(purpose, context));
    }

    /// Asks for a path, after those that are asked for already.
    fn ask_for_path(&mut self, purpose: Purpose) {
        self.typed_paths.push((purpose, String::new()));
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
        let result = match purpose {
            Purpose::OpenFile | Purpose::OpenFolder => Ok(()),
            Purpose::SavePicture(job) => {
                self.savings.push(Saving::begin(path, *job, context));
                Ok(())
            }
            Purpose::LoadTransfer(number) => self
                .document_of(number)
                .and_then(|document| transfer_at(&place).map(|transfer| document.set_transfer(&transfer))),
            Purpose::SaveTransfer(number) => self.save_transfer(number, path),
        };
        if let Err(fault) = result {
            self.fail(&fault);
        }
    }

    /// Saves the transfer function of a document.
    fn save_transfer(&mut self, number: u64, path: &Path) -> Result<()> {
        let document = self.document_of(number)?;
        save_transfer(path, &document.transfer()?.to_json())?;
        document.set_saved();
        // A browser shows what it saves.
        if !cfg!(target_arch = "wasm32") {
            self.say(format!("Saved {}", path.display()));
        }
        Ok(())
    }

    /// Returns the document of a number.
    ///
    /// # Errors
    /// [`Error::Input`] if it was closed.
    fn document_of(&mut self, number: u64) -> Result<&mut Document> {
        let document = self.documents.iter_mut().find(|document| document.number == number);
        document
            .ok_or_else(|| Error::input("the volume", "was closed before a file for its transfer function was chosen"))
    }

    fn answer(&mut self, context: &Context, request: Option<Request>) {
        let document = &mut self.documents[self.active];
        match request {
            Some(Request::LoadTransfer) => {
                let purpose = Purpose::LoadTransfer(document.number);
                self.ask_for_file(context, purpose);
            }
            Some(Request::SaveTransfer) => {
                let purpose = Purpose::SaveTransfer(document.number);
                self.ask_for_file(context, purpose);
            }
            Some(Request::Fit) => document.fit(self.view_size),
            None => {}
        }
    }

    fn keys(&mut self, context: &Context) {
        let pressed = |modifiers, key| context.input_mut(|input| input.consume_key(modifiers, key));
        if pressed(Modifiers::COMMAND, Key::O) && self.typed_paths.is_empty() {
            self.form_is_open = false;
            self.ask_for_path(Purpose::OpenFile);
        }
        // A text field uses the other keys itself.
        if context.text_edit_focused() {
            return;
        }
        // Esc is first for what lies over the views.
        let is_covered = self.has_window() || Popup::is_any_open(context);
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

    /// Closes a document; asks first if its transfer function is not saved.
    fn close(&mut self, index: usize) {
        let document = &self.documents[index];
        if document.is_unsaved() {
            self.closing = Some(Closing::Document(document.number));
        } else {
            self.remove(index);
        }
    }

    fn remove(&mut self, index: usize) {
        self.documents.remove(index);
        if index < self.active || self.active == self.documents.len() {
            self.active = self.active.saturating_sub(1);
        }
    }

    /// Asks before the program is closed, if a transfer function is not saved or a picture is being saved.
    fn keep_unsaved(&mut self, context: &Context) {
        let is_asked = !self.gives_up && (self.has_unsaved() || !self.savings.is_empty());
        if is_asked && context.input(|input| input.viewport().close_requested()) {
            context.send_viewport_cmd(ViewportCommand::CancelClose);
            self.closing = Some(Closing::Program);
        }
    }

    /// Returns whether a transfer function was edited and not saved.
    pub fn has_unsaved(&self) -> bool {
        self.documents.iter().any(Document::is_unsaved)
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
const ADVICE: [(&str, &str); 6] = [
    ("describe them with `OpenOptions::raw`", "describe them to adj build by --dims 256x256x128 --type u8 or alike"),
    ("`OpenOptions::level`", "adj build --level"),
    ("`OpenOptions::outside_files`", "adj build --outside-files"),
    ("`OpenOptions::series`", "adj build --series"),
    ("`OpenOptions::spacing`", "adj build --spacing XxYxZ"),
    ("try the range ", "build it by adj build --range "),
];

/// Returns an error with its cause, in one line.
fn full(fault: &Error) -> String {
    ADVICE.iter().fold(fault.with_causes(), |text, (option, flag)| text.replace(option, flag))
}
