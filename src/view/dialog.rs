//! Choosing files: by the desktop's dialogs, on a thread of their own, or by the browser's.

use std::sync::mpsc::{Receiver, channel};

use egui::Context;
#[cfg(target_arch = "wasm32")]
use {send_wrapper::SendWrapper, std::sync::Arc};

use crate::open::Place;

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
    result: Receiver<Option<Place>>,
}

impl Dialog {
    /// Opens a dialog. A browser asks for no place to write to: it has a folder for downloads.
    pub(crate) fn begin(purpose: Purpose, context: &Context) -> Dialog {
        let (sender, result) = channel();
        let context = context.clone();
        crate::background::run(async move || {
            let place = choose(purpose).await;
            // Nobody receives if the window was closed.
            let _ = sender.send(place);
            context.request_repaint();
        });
        Dialog { purpose, result }
    }

    /// Returns what was chosen once the dialog is closed; `None` inside if it was cancelled.
    pub(crate) fn result(&self) -> Option<(Purpose, Option<Place>)> {
        match self.result.try_recv() {
            Ok(place) => Some((self.purpose, place)),
            Err(std::sync::mpsc::TryRecvError::Empty) => None,
            Err(std::sync::mpsc::TryRecvError::Disconnected) => Some((self.purpose, None)),
        }
    }
}

#[cfg(not(target_arch = "wasm32"))]
async fn choose(purpose: Purpose) -> Option<Place> {
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
    path.map(Place::Path)
}

#[cfg(target_arch = "wasm32")]
async fn choose(purpose: Purpose) -> Option<Place> {
    match purpose {
        Purpose::OpenFile => {
            let file = crate::page::choose(".adj").await?;
            Some(Place::Chosen(Arc::new(SendWrapper::new(file))))
        }
        Purpose::LoadTransfer => {
            let file = crate::page::choose(".json").await?;
            Some(Place::Bytes(file.name(), Arc::new(crate::page::read(&file).await?)))
        }
        Purpose::SavePicture => Some(Place::Path("picture.png".into())),
        Purpose::SaveTransfer => Some(Place::Path("transfer.json".into())),
    }
}
