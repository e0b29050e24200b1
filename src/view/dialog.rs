//! Choosing files: by the desktop's dialogs, on a thread of their own, or by the browser's.

use std::path::Path;
#[cfg(target_arch = "wasm32")]
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use egui::Context;

use crate::open::FilePlace;
use crate::save::{PictureJob, files};

/// What a file is chosen for.
pub(crate) enum Purpose {
    /// To open it.
    OpenFile,
    /// To open the volume in it, a folder.
    OpenFolder,
    /// To write a picture.
    SavePicture(Box<PictureJob>),
    /// To read a transfer function for the document of this number.
    LoadTransfer(u64),
    /// To write the transfer function of the document of this number.
    SaveTransfer(u64),
}

impl Purpose {
    /// Returns whether the file at a path is replaced.
    pub(crate) fn replaces(&self, path: &Path) -> bool {
        match self {
            Purpose::SavePicture(job) => files(path, job.form.frames) == [path] && path.exists(),
            Purpose::SaveTransfer(_) => path.exists(),
            _ => false,
        }
    }
}

/// That the desktop shows no dialogs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NoDialog;

/// What was chosen: several places only to open them, none if the dialog was cancelled.
type DialogResult = Result<Vec<FilePlace>, NoDialog>;

/// A dialog that is open.
pub(crate) struct Dialog {
    result: Receiver<(Purpose, DialogResult)>,
}

impl Dialog {
    /// Opens a dialog. A browser asks for no place to write to: it has a folder for downloads.
    pub(crate) fn begin(purpose: Purpose, context: &Context) -> Dialog {
        let (sender, result) = channel();
        let context = context.clone();
        crate::background::run(async move || {
            let choice = choose(&purpose).await;
            // Nobody receives if the window was closed.
            let _ = sender.send((purpose, choice));
            context.request_repaint();
        });
        Dialog { result }
    }

    /// Puts into `answers` what was chosen, and what for; returns whether the dialog is still open.
    pub(crate) fn is_open(&self, answers: &mut Vec<(Purpose, DialogResult)>) -> bool {
        match self.result.try_recv() {
            Ok(answer) => {
                answers.push(answer);
                false
            }
            Err(fault) => fault == TryRecvError::Empty,
        }
    }
}

#[cfg(not(target_arch = "wasm32"))]
async fn choose(purpose: &Purpose) -> DialogResult {
    let dialog = rfd::FileDialog::new();
    let paths = failures::noted(|| match purpose {
        Purpose::OpenFile => dialog.set_title("Open files or volumes").pick_files(),
        Purpose::OpenFolder => dialog.set_title("Open a folder").pick_folder().map(|path| vec![path]),
        Purpose::SavePicture(job) => dialog
            .set_title("Save the picture")
            .set_file_name(job.name())
            .add_filter("Pictures", &["png", "apng", "exr"])
            .save_file()
            .map(|path| vec![path]),
        Purpose::LoadTransfer(_) => dialog
            .set_title("Load a transfer function")
            .add_filter("Functions", &["json", "ctbl"])
            .pick_file()
            .map(|path| vec![path]),
        Purpose::SaveTransfer(_) => dialog
            .set_title("Save the transfer function")
            .set_file_name("transfer.json")
            .add_filter("Functions", &["json"])
            .save_file()
            .map(|path| vec![path]),
    })?;
    Ok(FilePlace::together(paths.unwrap_or_default()))
}

/// Whether rfd could show a dialog. It returns the same for a dialog that was cancelled; only its log tells.
#[cfg(not(target_arch = "wasm32"))]
mod failures {
    use std::cell::Cell;

    use super::NoDialog;

    /// Calls `choose`, in which rfd chooses a path.
    pub(super) fn noted<T>(choose: impl FnOnce() -> Option<T>) -> Result<Option<T>, NoDialog> {
        // Fails if it is there already. Where the program has another log, a dialog that cannot be shown stays silent.
        if log::set_logger(&Log).is_ok() {
            log::set_max_level(log::LevelFilter::Error);
        }
        HAS_FAILED.set(false);
        match choose() {
            None if HAS_FAILED.get() => Err(NoDialog),
            chosen => Ok(chosen),
        }
    }

    thread_local! {
        static HAS_FAILED: Cell<bool> = const { Cell::new(false) };
    }

    /// Where the last resort, zenity, fails; before it, the portal failed, which modules below it tell.
    const LAST_RESORT: &str = "rfd::backend::xdg_desktop_portal";

    struct Log;

    impl log::Log for Log {
        fn enabled(&self, record: &log::Metadata<'_>) -> bool {
            record.target() == LAST_RESORT
        }

        fn log(&self, record: &log::Record<'_>) {
            if self.enabled(record.metadata()) {
                HAS_FAILED.set(true);
            }
        }

        fn flush(&self) {}
    }

    #[test]
    fn a_dialog_that_cannot_be_shown_differs_from_one_that_was_cancelled() {
        assert_eq!(noted(|| None::<u8>), Ok(None));
        let fails = |target: &str| log::error!(target: target, "Failed");
        assert_eq!(noted(|| Some(3).inspect(|_| fails("rfd::backend::xdg_desktop_portal::portal"))), Ok(Some(3)));
        let portal_alone = || -> Option<u8> {
            fails("rfd::backend::xdg_desktop_portal::portal");
            None
        };
        assert_eq!(noted(portal_alone), Ok(None));
        let both = || -> Option<u8> {
            fails(LAST_RESORT);
            None
        };
        assert_eq!(noted(both), Err(NoDialog));
        assert_eq!(noted(|| None::<u8>), Ok(None));
    }
}

#[cfg(target_arch = "wasm32")]
async fn choose(purpose: &Purpose) -> DialogResult {
    Ok(match purpose {
        Purpose::OpenFile => FilePlace::together(crate::page::choose("", true).await),
        Purpose::OpenFolder => crate::page::choose_folder().await.map(FilePlace::folder).into_iter().collect(),
        Purpose::LoadTransfer(_) => {
            let mut places = Vec::new();
            for file in crate::page::choose(".json,.ctbl", false).await {
                let bytes = crate::page::read(&file).await;
                places.extend(bytes.map(|bytes| FilePlace::Bytes(file.name(), Arc::new(bytes))));
            }
            places
        }
        Purpose::SavePicture(job) => vec![FilePlace::Path(job.name().into())],
        Purpose::SaveTransfer(_) => vec![FilePlace::Path("transfer.json".into())],
    })
}
