//! Folders in a page: which files they hold. The web worker reads the files, as far as the volume needs them.
//!
//! In: a folder that was dropped or chosen. Out: all files in it and below it, each with its path. Browsers list a folder in
//! parts, so that the page answers meanwhile.

use adjsplat::error::{Error, Result};
use egui::Context;
use js_sys::{Array, Function, Promise, Reflect};
use wasm_bindgen::{JsCast as _, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::{DataTransfer, File, FileSystemDirectoryEntry, FileSystemEntry, FileSystemFileEntry};

use crate::open::{FilePlace, Phase, Progress};

/// The largest number of files that a folder may hold: more take a browser minutes.
const MOST_FILES: usize = 100_000;

/// The number of files that are asked for at a time.
const ASKED: usize = 100;

/// A folder of a browser.
#[derive(Debug)]
pub struct Folder {
    name: String,
    files: Files,
}

/// The files of a folder.
#[derive(Debug)]
enum Files {
    /// Those that the browser listed, each with its path.
    Listed(Vec<(String, File)>),
    /// Those that are still to be listed.
    In(FileSystemDirectoryEntry),
}

impl Folder {
    /// Returns the folder that was chosen, whose files these are; `None` without files.
    pub(crate) fn chosen(files: Vec<File>) -> Option<Folder> {
        let path = |file: &File| Reflect::get(file, &"webkitRelativePath".into()).ok()?.as_string();
        let files: Vec<_> = files.into_iter().filter_map(|file| Some((path(&file)?, file))).collect();
        let (name, _) = files.first()?.0.split_once('/')?;
        Some(Folder { name: name.to_owned(), files: Files::Listed(files) })
    }

    /// Returns the name, without the folders around it.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Returns all files, each with its path, which begins with the folder's name.
    ///
    /// # Errors
    /// [`Error::Input`] if there is no file, if there are too many, or if one cannot be opened; [`Error::Interrupted`] if the
    /// user cancelled.
    pub(crate) async fn files(&self, progress: &Progress, context: &Context) -> Result<Vec<(String, File)>> {
        let files = match &self.files {
            Files::Listed(files) => files.clone(),
            Files::In(folder) => self.list(folder, progress, context).await?,
        };
        self.check(&files)?;
        match files.is_empty() {
            true => Err(Error::input(&self.name, "is a folder without files")),
            false => Ok(files),
        }
    }

    async fn list(
        &self,
        folder: &FileSystemDirectoryEntry,
        progress: &Progress,
        context: &Context,
    ) -> Result<Vec<(String, File)>> {
        let mut files = Vec::new();
        let mut folders = vec![(self.name.clone(), folder.clone())];
        while let Some((path, folder)) = folders.pop() {
            let reader = folder.create_reader();
            loop {
                let list = |done: &Function, failed: &Function| {
                    reader.read_entries_with_callback_and_callback(done, failed).map(drop)
                };
                let part: Array = answer(list).await.map_err(failed(&path))?.unchecked_into();
                if part.length() == 0 {
                    break;
                }
                // Some files are asked for before the first of them is waited for. Many at once would keep the page from answering.
                for some in part.to_vec().chunks(ASKED) {
                    let mut asked = Vec::new();
                    for entry in some {
                        let entry: &FileSystemEntry = entry.unchecked_ref();
                        let path = format!("{path}/{}", entry.name());
                        if entry.is_directory() {
                            folders.push((path, entry.clone().unchecked_into()));
                        } else {
                            let ask = |done: &Function, failed: &Function| {
                                let entry: &FileSystemFileEntry = entry.unchecked_ref();
                                entry.file_with_callback_and_callback(done, failed);
                                Ok(())
                            };
                            asked.push((path, answer(ask)));
                        }
                    }
                    for (path, file) in asked {
                        let file = file.await.map_err(failed(&path))?.unchecked_into();
                        files.push((path, file));
                    }
                    self.check(&files)?;
                    progress.set(Phase::Listing, 0, 1)?;
                    context.request_repaint();
                }
            }
        }
        Ok(files)
    }

    /// Returns an error if there are too many files.
    fn check(&self, files: &[(String, File)]) -> Result<()> {
        match files.len() {
            0..=MOST_FILES => Ok(()),
            _ => Err(Error::input(
                &self.name,
                format!(
                    "is a folder of more than {MOST_FILES} files, too many for a page; open it by adj view or adj build"
                ),
            )),
        }
    }
}

/// Returns what is to be opened of files and folders that were dropped together: each folder by itself.
pub(crate) fn dropped(dropped: &DataTransfer) -> Vec<FilePlace> {
    let items = dropped.items();
    let (mut folders, mut files) = (Vec::new(), Vec::new());
    for item in (0..items.length()).filter_map(|index| items.get(index)).filter(|item| item.kind() == "file") {
        match item.webkit_get_as_entry() {
            Ok(Some(entry)) if entry.is_directory() => {
                folders.push(Folder { name: entry.name(), files: Files::In(entry.unchecked_into()) });
            }
            _ => files.extend(item.get_as_file().ok().flatten()),
        }
    }
    folders.into_iter().map(FilePlace::folder).chain(FilePlace::together(files)).collect()
}

/// Returns what a function of the browser answers, which calls the first function with its result, or the second with a fault.
fn answer(ask: impl FnOnce(&Function, &Function) -> std::result::Result<(), JsValue>) -> JsFuture {
    let mut ask = Some(ask);
    Promise::new(&mut |done, failed| {
        let asked = ask.take().map_or(Ok(()), |ask| ask(&done, &failed));
        if let Err(fault) = asked {
            // A promise takes any reason.
            let _ = failed.call1(&JsValue::NULL, &fault);
        }
    })
    .into()
}

fn failed(path: &str) -> impl Fn(JsValue) -> Error {
    move |_| Error::input(path, "cannot be read, or changed since it was dropped")
}
