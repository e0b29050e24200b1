//! The desktop's dialogs for files, on a thread of their own.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};

use egui::Context;

/// What a file is chosen for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    /// To open it.
    OpenFile,
    /// To write a picture.
    SavePicture,
    /// To read a transfer function.
    LoadTransfer,
    /// To write the transfer function.
    SaveTransfer,
}

/// A dialog that is open.
pub(crate) struct Dialog {
    purpose: Purpose,
    result: Receiver<Option<PathBuf>>,
}

impl Dialog {
    /// Opens a dialog.
    pub(crate) fn begin(purpose: Purpose, context: &Context) -> Dialog {
        let (sender, result) = channel();
        let context = context.clone();
        std::thread::spawn(move || {
            let dialog = rfd::FileDialog::new();
            let path = match purpose {
                Purpose::OpenFile => dialog.set_title("Open a file or a volume").pick_file(),
                Purpose::SavePicture => dialog
                    .set_title("Save the picture")
                    .set_file_name("picture.png")
                    .add_filter("Pictures", &["png", "apng", "exr"])
                    .save_file(),
                Purpose::LoadTransfer => {
                    dialog.set_title("Load a transfer function").add_filter("Functions", &["json", "ctbl"]).pick_file()
                }
                Purpose::SaveTransfer => {
                    dialog.set_title("Save the transfer function").set_file_name("transfer.json").save_file()
                }
            };
            // Nobody receives if the window was closed.
            let _ = sender.send(path);
            context.request_repaint();
        });
        Dialog { purpose, result }
    }

    /// Returns what was chosen once the dialog is closed; `None` inside if it was cancelled.
    pub(crate) fn result(&self) -> Option<(Purpose, Option<PathBuf>)> {
        match self.result.try_recv() {
            Ok(path) => Some((self.purpose, path)),
            Err(std::sync::mpsc::TryRecvError::Empty) => None,
            Err(std::sync::mpsc::TryRecvError::Disconnected) => Some((self.purpose, None)),
        }
    }
}
