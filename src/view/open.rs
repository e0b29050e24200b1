//! Opening in the background: `.adj` files are mapped, fetched or copied, volumes are built.
//!
//! In: a place. Out: progress, and in the end a model; a volume's is in memory. Opening can be cancelled.

#[cfg(target_arch = "wasm32")]
use std::collections::BTreeSet;
use std::future::poll_fn;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Poll, Waker};

use adjsplat::Model;
use adjsplat::error::{Error, Result};
use adjsplat::traverse::VoxelBox;
use egui::Context;
#[cfg(target_arch = "wasm32")]
use send_wrapper::SendWrapper;

use crate::background;
use crate::editor::StoredValues;
#[cfg(target_arch = "wasm32")]
use crate::folder::Folder;
use crate::remote::Remote;

/// Where a file is.
#[derive(Debug, Clone)]
pub enum FilePlace {
    /// On this machine.
    Path(PathBuf),
    /// On a server, at this address. Only a page opens it.
    Address(String),
    /// In memory, under this name.
    Bytes(String, Arc<Vec<u8>>),
    /// On this machine: the slices of one volume.
    #[cfg(not(target_arch = "wasm32"))]
    Slices(Vec<PathBuf>),
    /// Chosen in a browser, or dropped onto a page.
    #[cfg(target_arch = "wasm32")]
    Chosen(Arc<SendWrapper<Chosen>>),
    /// A folder, likewise.
    #[cfg(target_arch = "wasm32")]
    Folder(Arc<SendWrapper<Folder>>),
}

/// Files of a browser.
#[cfg(target_arch = "wasm32")]
#[derive(Debug)]
pub struct Chosen {
    /// The file that is opened, or all slices of a volume; behind them the files beside it, which its header may name.
    pub(crate) files: Vec<web_sys::File>,
    /// The number of files that are opened.
    pub(crate) count: usize,
}

impl FilePlace {
    /// Returns what is to be opened of files and folders of this machine that were dropped or chosen together: each folder by itself.
    #[cfg(not(target_arch = "wasm32"))]
    pub(crate) fn together(paths: Vec<PathBuf>) -> Vec<FilePlace> {
        let place = |mut paths: Vec<PathBuf>| match paths.len() {
            1 => FilePlace::Path(paths.remove(0)),
            _ => FilePlace::Slices(paths),
        };
        let (folders, files): (Vec<_>, Vec<_>) = paths.into_iter().partition(|path| path.is_dir());
        folders.into_iter().map(FilePlace::Path).chain(groups(files, PathBuf::clone).into_iter().map(place)).collect()
    }

    /// Returns what is to be opened of files that were dropped or chosen together in a browser. All lie beside one another, as far
    /// as their names differ.
    #[cfg(target_arch = "wasm32")]
    pub(crate) fn together(files: Vec<web_sys::File>) -> Vec<FilePlace> {
        let files: Vec<_> = files.into_iter().map(|file| (file.name(), file)).collect();
        let place = |opened: Vec<(String, web_sys::File)>| {
            let names: BTreeSet<&str> = opened.iter().map(|(name, _)| name.as_str()).collect();
            let others = files.iter().filter(|(name, _)| !names.contains(name.as_str()));
            let all = opened.iter().chain(others).map(|(_, file)| file.clone()).collect();
            FilePlace::Chosen(Arc::new(SendWrapper::new(Chosen { files: all, count: opened.len() })))
        };
        groups(files.clone(), |(name, _)| name.into()).into_iter().map(place).collect()
    }

    /// Returns the place of a folder that was dropped or chosen in a browser.
    #[cfg(target_arch = "wasm32")]
    pub(crate) fn folder(folder: Folder) -> FilePlace {
        FilePlace::Folder(Arc::new(SendWrapper::new(folder)))
    }

    /// Returns the name of the file, without folders.
    pub fn name(&self) -> String {
        match self {
            FilePlace::Path(path) => file_name(path),
            FilePlace::Address(address) => {
                let path = address.split(['?', '#']).next().unwrap_or_default();
                shortened(&decoded(path.rsplit('/').next().unwrap_or_default()), 80)
            }
            FilePlace::Bytes(name, _) => name.clone(),
            #[cfg(not(target_arch = "wasm32"))]
            FilePlace::Slices(paths) => {
                several(paths.first().map_or_else(String::new, |path| file_name(path)), paths.len())
            }
            #[cfg(target_arch = "wasm32")]
            FilePlace::Chosen(chosen) => several(chosen.files[0].name(), chosen.count),
            #[cfg(target_arch = "wasm32")]
            FilePlace::Folder(folder) => folder.name().to_owned(),
        }
    }

    /// Returns the path, if the file is on this machine.
    pub fn path(&self) -> Option<&std::path::Path> {
        if let FilePlace::Path(path) = self { Some(path) } else { None }
    }
}

/// Returns the name of some files, of which the `first` is known.
fn several(first: String, count: usize) -> String {
    if count > 1 { format!("{first} and {} more", count - 1) } else { first }
}

/// Returns the last part of a path.
fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// Returns what is to be opened of files that were dropped or chosen together, in groups by their names. If all but notes are slices
/// of one ending, they are one volume, and the notes are left out. Else each file is by itself, without samples that belong to a
/// header beside them.
pub(crate) fn groups<T>(files: Vec<T>, name: impl Fn(&T) -> PathBuf) -> Vec<Vec<T>> {
    let ending = |file: &T| name(file).extension().unwrap_or_default().to_ascii_lowercase();
    let has = |file: &T, endings: &[&str]| endings.iter().any(|known| ending(file) == *known);
    let is_samples = |file: &T| has(file, &SAMPLES);
    let is_note = |file: &T| has(file, &NOTES) || is_name_of_note(&name(file));
    let volumes = || files.iter().filter(|file| !is_note(file));
    let first = volumes().next().map(ending);
    if files.len() > 1 && first.is_some() && volumes().all(|file| has(file, &SLICES) && Some(ending(file)) == first) {
        return vec![files.into_iter().filter(|file| !is_note(file)).collect()];
    }
    let has_header = volumes().any(|file| !is_samples(file));
    files.into_iter().filter(|file| !(has_header && is_samples(file))).map(|file| vec![file]).collect()
}

/// Returns whether the name of a file without an ending is that of a note, or the file is hidden.
fn is_name_of_note(path: &Path) -> bool {
    let name = file_name(path).to_ascii_lowercase();
    name.starts_with('.') || !name.contains('.') && NOTE_NAMES.iter().any(|known| name.starts_with(known))
}

/// The endings of files that are slices. Many DICOM files have none.
const SLICES: [&str; 6] = ["", "dcm", "dicom", "ima", "tif", "tiff"];
/// The endings of notes that lie beside slices, and how names of notes without an ending begin.
const NOTES: [&str; 6] = ["csv", "html", "json", "md", "pdf", "txt"];
const NOTE_NAMES: [&str; 7] = ["authors", "copying", "dicomdir", "licence", "license", "notice", "readme"];
/// The endings of files that hold samples alone, which a header beside them describes.
const SAMPLES: [&str; 4] = ["raw", "zraw", "img", "bin"];

/// Returns a part of an address with its bytes in place of their codes, such as `%20`; unchanged if they are no
/// text of one line.
fn decoded(part: &str) -> String {
    let (mut bytes, mut rest) = (Vec::with_capacity(part.len()), part.as_bytes());
    while let [first, after @ ..] = rest {
        let code = after.get(..2).filter(|code| *first == b'%' && code.iter().all(u8::is_ascii_hexdigit));
        let byte = code.and_then(|code| u8::from_str_radix(std::str::from_utf8(code).ok()?, 16).ok());
        bytes.push(byte.unwrap_or(*first));
        rest = if byte.is_some() { &after[2..] } else { after };
    }
    let text = String::from_utf8(bytes).ok().filter(|text| !text.contains(char::is_control));
    text.unwrap_or_else(|| part.to_owned())
}

/// Returns a name, without its middle if it has more letters than `most`, which is 8 or more.
pub(crate) fn shortened(name: &str, most: usize) -> String {
    let letters: Vec<char> = name.chars().collect();
    if letters.len() <= most {
        return name.to_owned();
    }
    let (first, last) = (most * 5 / 8, letters.len() + 1 + most * 5 / 8 - most);
    letters[..first].iter().chain(&['…']).chain(&letters[last..]).collect()
}

/// How a file is to be shown first.
#[derive(Debug, Clone, Default)]
pub struct Wish {
    /// The eye, as [`Eye::to_text`](crate::look::Eye::to_text) writes it.
    pub view: Option<String>,
    /// The transfer function, as JSON.
    pub transfer: Option<String>,
}

/// A model that was opened.
pub struct Opened {
    pub(crate) place: FilePlace,
    pub(crate) is_adj: bool,
    pub(crate) model: Model,
    pub(crate) stored: StoredValues,
    /// Of a file on a server: the bytes that were fetched, and those of the whole file.
    pub(crate) fetched: Option<[u64; 2]>,
    /// The box of the visible voxels.
    pub(crate) extent: Option<VoxelBox>,
    /// The unit of lengths, if the file states it.
    pub(crate) unit: Option<String>,
    /// The file, if its voxels are not in memory.
    pub(crate) remote: Option<Arc<Remote>>,
}

impl Opened {
    pub(crate) fn new(place: &FilePlace, model: Model, is_adj: bool, fetched: Option<[u64; 2]>) -> Result<Opened> {
        let stored = StoredValues::of(&model)?;
        let (extent, unit) = (model.bounds()?, unit_of(&model));
        Ok(Opened { place: place.clone(), is_adj, model, stored, fetched, extent, unit, remote: None })
    }
}

/// Returns the unit of lengths that a file states, if it is short enough for a line.
fn unit_of(model: &Model) -> Option<String> {
    let unit = shortened(model.unit()?.trim(), 80);
    Some(unit).filter(|unit| !unit.is_empty() && !unit.contains(char::is_control))
}

/// A file that is being opened.
pub struct Opening {
    /// How many files were to be opened until this one.
    pub(crate) number: u64,
    /// The file.
    pub place: FilePlace,
    /// How it is to be shown.
    pub wish: Wish,
    progress: Arc<Progress>,
    result: Receiver<Result<Opened>>,
}

/// How far opening is, shared with the thread that works.
#[derive(Debug, Default)]
pub(crate) struct Progress {
    phase: AtomicU64,
    /// Thousandths of the phase.
    done: AtomicU64,
    is_cancelled: AtomicBool,
    /// Wakes the task that opens.
    waker: Mutex<Option<Waker>>,
}

impl Progress {
    /// Says that `done` of `total` of a phase are over.
    ///
    /// # Errors
    /// [`Error::Interrupted`] if the user cancelled.
    pub(crate) fn set(&self, phase: Phase, done: u64, total: u64) -> Result<()> {
        self.phase.store(phase as u64, Ordering::Relaxed);
        self.done.store(1000 * done / total.max(1), Ordering::Relaxed);
        if self.is_cancelled.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// Waits for a task. If the user cancels, drops it wherever it waits: requests stop, and workers end.
    ///
    /// # Errors
    /// Those of the task; [`Error::Interrupted`] if the user cancelled.
    async fn unless_cancelled<T>(&self, task: impl Future<Output = Result<T>>) -> Result<T> {
        let mut task = pin!(task);
        poll_fn(|context| {
            *self.waker.lock().unwrap_or_else(PoisonError::into_inner) = Some(context.waker().clone());
            match self.is_cancelled.load(Ordering::Relaxed) {
                true => Poll::Ready(Err(Error::Interrupted)),
                false => task.as_mut().poll(context),
            }
        })
        .await
    }

    fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
        if let Some(waker) = self.waker.lock().unwrap_or_else(PoisonError::into_inner).take() {
            waker.wake();
        }
    }
}

/// What opening does.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Phase {
    Opening,
    Looking,
    Reading,
    Building,
    #[cfg_attr(not(target_arch = "wasm32"), expect(dead_code, reason = "pages fetch"))]
    Fetching,
    #[cfg_attr(not(target_arch = "wasm32"), expect(dead_code, reason = "pages list folders before they open them"))]
    Listing,
    Counting,
}

/// The names of the phases.
const PHASES: [&str; 7] =
    ["Opening", "Looking at the values", "Reading", "Building", "Fetching", "Listing files", "Counting values"];

impl Opening {
    /// Begins to open a file that is to be shown as `wish` says.
    pub fn begin(number: u64, place: FilePlace, wish: Wish, context: &Context) -> Opening {
        let (sender, result) = channel();
        let progress = Arc::new(Progress::default());
        let (own_place, own_progress, context) = (place.clone(), progress.clone(), context.clone());
        background::run(async move || {
            // Nobody receives if the window was closed.
            let _ = sender.send(own_progress.unless_cancelled(open(&own_place, &own_progress, &context)).await);
            context.request_repaint();
        });
        Opening { number, place, wish, progress, result }
    }

    /// Returns what is done now, and the share of it that is over.
    pub fn progress(&self) -> (&'static str, f32) {
        let phase = usize::try_from(self.progress.phase.load(Ordering::Relaxed)).unwrap_or(0);
        let done = self.progress.done.load(Ordering::Relaxed);
        (PHASES[phase.min(PHASES.len() - 1)], done as f32 / 1000.0)
    }

    /// Asks the work to stop.
    pub fn cancel(&self) {
        self.progress.cancel();
    }

    /// Returns the result once it is there; that it was cancelled, at once.
    pub fn result(&self) -> Option<Result<Opened>> {
        if self.progress.is_cancelled.load(Ordering::Relaxed) {
            return Some(Err(Error::Interrupted));
        }
        self.result.try_recv().ok()
    }
}

/// Opens a file.
async fn open(place: &FilePlace, progress: &Progress, context: &Context) -> Result<Opened> {
    progress.set(Phase::Opening, 0, 1)?;
    let (model, is_adj) = match place {
        #[cfg(not(target_arch = "wasm32"))]
        FilePlace::Path(path) => crate::local::open(path, progress, context)?,
        #[cfg(target_arch = "wasm32")]
        FilePlace::Path(path) => return Err(Error::input(path.display().to_string(), "is no address on a server")),
        #[cfg(target_arch = "wasm32")]
        FilePlace::Address(address) => return crate::fetch::open_address(place, address, progress, context).await,
        #[cfg(not(target_arch = "wasm32"))]
        FilePlace::Address(address) => return Err(Error::input(address, "is opened by the page, not by the desktop")),
        FilePlace::Bytes(name, bytes) => (model_of(name, bytes.to_vec())?, true),
        #[cfg(not(target_arch = "wasm32"))]
        FilePlace::Slices(paths) => (crate::local::build(paths, progress, context)?, false),
        #[cfg(target_arch = "wasm32")]
        FilePlace::Chosen(chosen) => return crate::fetch::open_chosen(place, chosen, progress, context).await,
        #[cfg(target_arch = "wasm32")]
        FilePlace::Folder(folder) => return crate::fetch::open_folder(place, folder, progress, context).await,
    };
    progress.set(Phase::Counting, 0, 1)?;
    Opened::new(place, model, is_adj, None)
}

/// Returns the model of the bytes of an `.adj` file; faults name the file.
pub(crate) fn model_of(name: &str, bytes: Vec<u8>) -> Result<Model> {
    Model::from_bytes(bytes).map_err(|fault| match fault {
        Error::Format { fault, .. } => Error::Format { path: name.into(), fault },
        Error::Input { why, .. } => Error::input(name, why),
        other => other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_that_waits_for_ever_is_dropped_when_the_user_cancels() {
        struct Held<'a>(&'a AtomicBool);
        impl Drop for Held<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Relaxed);
            }
        }
        let (progress, was_dropped) = (Progress::default(), AtomicBool::new(false));
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| {
                let held = Held(&was_dropped);
                let task = async move {
                    let _held = held;
                    std::future::pending::<Result<()>>().await
                };
                pollster::block_on(progress.unless_cancelled(task))
            });
            while progress.waker.lock().unwrap().is_none() {
                std::thread::yield_now();
            }
            assert!(!was_dropped.load(Ordering::Relaxed));
            progress.cancel();
            assert!(matches!(waits.join().unwrap(), Err(Error::Interrupted)));
        });
        assert!(was_dropped.load(Ordering::Relaxed));
    }

    #[test]
    fn files_that_are_dropped_together_are_slices_or_each_a_volume_without_its_samples() {
        let grouped =
            |names: &[&str]| groups(names.to_vec(), |name| name.into()).iter().map(Vec::len).collect::<Vec<_>>();
        for slices in [&["1.dcm", "2.DCM", "3.dcm"][..], &["IM0001", "IM0002"], &["a.tif", "b.tif"]] {
            assert_eq!(grouped(slices), [slices.len()], "{slices:?}");
        }
        assert_eq!(grouped(&["a.adj", "b.adj", "c.nii.gz"]), [1, 1, 1]);
        assert_eq!(grouped(&["1.dcm", "a.tif"]), [1, 1]);
        let series = ["1.dcm", "LICENSE", "2.dcm", "README.md", "3.dcm", ".DS_Store"];
        assert_eq!(groups(series.to_vec(), |name| name.into()), [["1.dcm", "2.dcm", "3.dcm"]]);
        for cd in [["IM0001", "DICOMDIR"], ["IM0001", "dicomdir"], ["IM0001", "LICENSE-MIT"], ["IM0001", "Licence"]] {
            assert_eq!(groups(cd.to_vec(), |name| name.into()), [["IM0001"]], "{cd:?}");
        }
        // Volumes, not slices.
        assert_eq!(grouped(&["a.tif", "b.tif", "c.nrrd"]), [1, 1, 1]);
        assert_eq!(grouped(&["brain.raw", "README.md"]), [1, 1]);
        assert_eq!(grouped(&["LICENSE"]), [1]);
        assert_eq!(groups(vec!["brain.raw", "brain.mhd"], |name| name.into()), [["brain.mhd"]]);
        assert_eq!(grouped(&["brain.raw"]), [1]);
        assert_eq!(grouped(&[]), [0; 0]);
    }

    #[test]
    fn folders_that_are_dropped_together_are_opened_each_by_itself() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["t1", "t2"] {
            std::fs::create_dir(path(name)).unwrap();
        }
        let places = FilePlace::together(["t1", "1.dcm", "t2", "2.dcm"].map(path).into());
        let names: Vec<_> = places.iter().map(FilePlace::name).collect();
        assert_eq!(names, ["t1", "t2", "1.dcm and 1 more"]);
    }

    #[test]
    fn a_file_at_an_address_is_called_by_its_name_without_codes_folders_and_query() {
        let name = |address: &str| FilePlace::Address(address.into()).name();
        assert_eq!(name("../files/ball%20%26%20shell.adj?version=2#x"), "ball & shell.adj");
        assert_eq!(name("files/t%C3%AAte.adj"), "tête.adj");
        assert_eq!(name("files/100%.adj"), "100%.adj");
        for other in ["%zz%ff.adj", "two%0Alines.adj"] {
            assert_eq!(name(&format!("files/{other}")), other);
        }
        let long = name(&format!("files/{}.adj", "a".repeat(500)));
        assert!(long.chars().count() == 80 && long.contains('…') && long.ends_with(".adj"), "{long}");
    }
}
