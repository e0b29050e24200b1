//! Volumes in a page: a web worker builds them, on a thread of its own (page/worker.js).
//!
//! In: files of the browser. Out: progress, then an `.adj` file of the browser. Dropping what waits for it ends the worker.

use adjsplat::error::{Error, Result};
use async_channel::unbounded;
use egui::Context;
use js_sys::{Array, Object, Reflect};
use wasm_bindgen::closure::Closure;
use wasm_bindgen::{JsCast as _, JsValue};
use web_sys::{File, MessageEvent, Worker, WorkerOptions, WorkerType};

use crate::open::{Phase, Progress};

/// The worker's script, beside the page.
const SCRIPT: &str = "worker.js";

/// A volume that is to be built.
pub(crate) struct Volume {
    /// Its files, each with its path, and those beside it, which a header may name.
    pub(crate) files: Vec<(String, File)>,
    /// The paths that are opened: of a file, of a folder, or of slices.
    pub(crate) opened: Vec<String>,
}

/// Builds a volume.
///
/// # Errors
/// [`Error::Input`] with the worker's sentence if there is no volume; [`Error::Interrupted`] if the user cancelled.
pub(crate) async fn build(name: &str, volume: Volume, progress: &Progress, context: &Context) -> Result<File> {
    let failed = |_: JsValue| Error::input(name, "cannot be built: the browser begins no worker for it");
    let options = WorkerOptions::new();
    options.set_type(WorkerType::Module);
    let worker = Ended(Worker::new_with_options(SCRIPT, &options).map_err(failed)?);
    let (told, news) = unbounded();
    let failures = told.clone();
    // Nobody receives any more if the user cancelled.
    let listen = Closure::<dyn Fn(MessageEvent)>::new(move |event: MessageEvent| drop(told.try_send(event.data())));
    let fail = Closure::<dyn Fn()>::new(move || drop(failures.try_send(JsValue::NULL)));
    worker.0.set_onmessage(Some(listen.as_ref().unchecked_ref()));
    worker.0.set_onerror(Some(fail.as_ref().unchecked_ref()));
    let task = Object::new();
    let names = |names: Vec<String>| names.iter().map(|name| JsValue::from(name.as_str())).collect::<Array>();
    let (paths, files): (Vec<_>, Vec<_>) = volume.files.into_iter().unzip();
    let files: Array = files.into_iter().collect();
    for (key, value) in [("files", files), ("paths", names(paths)), ("opened", names(volume.opened))] {
        Reflect::set(&task, &key.into(), &value).map_err(failed)?;
    }
    worker.0.post_message(&task).map_err(failed)?;
    loop {
        let news = news.recv().await.map_err(|_| failed(JsValue::NULL))?;
        let part = |key: &str| Reflect::get(&news, &key.into()).map_err(failed);
        if let Ok(file) = part("file")?.dyn_into() {
            return Ok(file);
        }
        if let Some(fault) = part("fault")?.as_string() {
            return Err(Error::input(name, fault.strip_prefix(&format!("{name}: ")).unwrap_or(&fault)));
        }
        let phase = match part("stage")?.as_string().as_deref() {
            Some("survey") => Phase::Looking,
            Some("pack") => Phase::Reading,
            _ => Phase::Building,
        };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of 1000")]
        let done = (1000.0 * part("share")?.as_f64().unwrap_or(0.0)) as u64;
        context.request_repaint();
        progress.set(phase, done, 1000)?;
    }
}

/// A worker that ends when this is dropped.
struct Ended(Worker);

impl Drop for Ended {
    fn drop(&mut self) {
        // What was sent already is not heard any more.
        self.0.set_onmessage(None);
        self.0.set_onerror(None);
        self.0.terminate();
    }
}
