//! The page: the viewer in a browser, and what it asks of the browser.
//!
//! In: the page's address, whose query names a file, a camera and a transfer function. Out: the viewer on the page's
//! canvas; files that are chosen and downloaded.

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use adjsplat::error::{Error, Result};
use eframe::{WebOptions, WebRunner};
use egui::ColorImage;
use futures_channel::oneshot;
use js_sys::{Array, Uint8Array};
use serde_json::json;
use wasm_bindgen::closure::Closure;
use wasm_bindgen::prelude::wasm_bindgen;
use wasm_bindgen::{JsCast as _, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::{
    Blob, DragEvent, Event, File, HtmlAnchorElement, HtmlCanvasElement, HtmlInputElement, Url, UrlSearchParams,
};

use crate::Window;
use crate::app::Viewer;
use crate::document::Document;
use crate::draw::{Completeness, Renderer};
use crate::folder::{self, Folder};
use crate::open::{FilePlace, Wish};
use crate::recent::RecentFiles;

/// Begins to show the viewer on a canvas. Its promise fails with a sentence for the user if that is not possible.
///
/// The page's query: `file` is the address of a file, `view` an eye as [`crate::look::Eye::to_text`] writes it, and
/// `tf` a transfer function as JSON.
#[wasm_bindgen]
pub async fn start(canvas: HtmlCanvasElement) -> std::result::Result<(), JsValue> {
    std::panic::set_hook(Box::new(|panic| stopped(&panic.to_string())));
    let (file, wish) = asked();
    let create: eframe::AppCreator<'static> = Box::new(move |creation| {
        let mut window = Window::new(creation, &[], RecentFiles::default(), Renderer::Device);
        if let Some(address) = file {
            window.0.open_as(&creation.egui_ctx, FilePlace::Address(address), wish);
        }
        Ok(Box::new(window))
    });
    let options = WebOptions { dithering: false, ..WebOptions::default() };
    listen_for_drops(&canvas)?;
    ask_before_leaving()?;
    WebRunner::new().start(canvas, options, create).await
}

/// Notes what is dropped onto the canvas. The list that eframe makes of it has folders as files without content.
fn listen_for_drops(canvas: &HtmlCanvasElement) -> std::result::Result<(), JsValue> {
    let listen = Closure::<dyn Fn(DragEvent)>::new(|event: DragEvent| {
        let places = event.data_transfer().map_or_else(Vec::new, |dropped| folder::dropped(&dropped));
        DROPPED.with_borrow_mut(|dropped| dropped.extend(places));
    });
    canvas.add_event_listener_with_callback("drop", listen.into_js_value().unchecked_ref())
}

/// Lets the browser ask before it leaves the page while a transfer function is not saved.
fn ask_before_leaving() -> std::result::Result<(), JsValue> {
    let listen = Closure::<dyn Fn(Event)>::new(|event: Event| {
        if HAS_UNSAVED.get() {
            event.prevent_default();
        }
    });
    let window = web_sys::window().expect("a page has a window");
    window.add_event_listener_with_callback("beforeunload", listen.into_js_value().unchecked_ref())
}

/// Returns what was dropped since the last call.
pub(crate) fn dropped() -> Vec<FilePlace> {
    DROPPED.take()
}

thread_local! {
    /// What was dropped and is not opened yet.
    static DROPPED: RefCell<Vec<FilePlace>> = const { RefCell::new(Vec::new()) };
    /// Whether a transfer function is not saved.
    static HAS_UNSAVED: Cell<bool> = const { Cell::new(false) };
    /// What is shown, as JSON, and the picture.
    static SHOWN: RefCell<(String, Option<Arc<ColorImage>>)> = const { RefCell::new((String::new(), None)) };
}

/// Makes what the viewer shows known to scripts of the page.
pub(crate) fn publish(viewer: &Viewer) {
    HAS_UNSAVED.set(viewer.has_unsaved());
    let document = viewer.active();
    let shown = document.and_then(|document| document.painter.shown());
    let state = json!({
        "file": document.map(|document| &document.title),
        "files": viewer.documents().len(),
        "fetched": document.and_then(Document::fetched),
        "view": document.map(|document| document.look.eye.to_text()),
        "camera": document.and_then(|document| document.look.eye.camera().ok()),
        "background": document.map(|document| document.look.background),
        "quality": shown.map(|shown| shown.quality.name()),
        "whole": shown.map(|shown| shown.work.completeness == Completeness::Whole),
        "size": shown.map(|shown| shown.size),
        "milliseconds": shown.map(|shown| shown.milliseconds),
        "finished": document.is_some_and(|document| document.painter.is_finished()),
        "fault": document.and_then(|document| document.painter.fault()),
        "message": viewer.message(),
        "picked": document.and_then(|document| document.picked).map(|picked| picked.index),
        "memory": memory(),
    });
    let fault = document.and_then(|document| document.painter.fault()).map(str::to_owned);
    says(&viewer.message().or(fault).unwrap_or_default());
    let picture = document.and_then(|document| document.painter.image());
    SHOWN.set((state.to_string(), picture));
}

/// Returns the bytes of the program's memory, which never shrinks.
pub(crate) fn memory() -> u64 {
    core::arch::wasm32::memory_size(0) as u64 * 65_536
}

/// Returns what is shown, as JSON: file, number of open files, view, background, quality and size of the picture, messages, the
/// picked voxel, and the bytes of the program's memory.
#[wasm_bindgen]
pub fn state() -> String {
    SHOWN.with_borrow(|shown| shown.0.clone())
}

/// Returns the picture that is shown: red, green, blue and alpha in bytes, row by row.
#[wasm_bindgen]
pub fn pixels() -> Vec<u8> {
    SHOWN.with_borrow(|(_, picture)| picture.as_ref().map(|picture| picture.as_raw().to_vec()).unwrap_or_default())
}

/// Returns the file that the page's query names, and how it is to be shown.
fn asked() -> (Option<String>, Wish) {
    let query = web_sys::window().and_then(|window| window.location().search().ok()).unwrap_or_default();
    let query = UrlSearchParams::new_with_str(&query).ok();
    let get = |name: &str| query.as_ref().and_then(|query| query.get(name));
    (get("file").filter(|file| !file.is_empty()), Wish { view: get("view"), transfer: get("tf") })
}

/// Returns a link to this page that opens a file with a view and, if it is not the file's, a transfer function.
pub(crate) fn link(file: &str, view: &str, transfer: Option<&str>) -> Option<String> {
    let query = UrlSearchParams::new().ok()?;
    query.set("file", file);
    query.set("view", view);
    if let Some(transfer) = transfer {
        query.set("tf", transfer);
    }
    let location = web_sys::window()?.location();
    Some(format!("{}{}?{}", location.origin().ok()?, location.pathname().ok()?, String::from(query.to_string())))
}

#[wasm_bindgen]
extern "C" {
    /// Of page.js: says that the viewer has stopped, and why.
    #[wasm_bindgen(js_name = adjsplatStopped)]
    fn stopped(why: &str);
    /// Of page.js: lets screen readers say what the viewer draws as text.
    #[wasm_bindgen(js_name = adjsplatSays)]
    fn says(text: &str);
}

/// Sets the title of the page.
pub(crate) fn set_title(title: &str) {
    document().set_title(title);
}

fn document() -> web_sys::Document {
    web_sys::window().and_then(|window| window.document()).expect("a page has a document")
}

/// Lets the user choose a file with this ending (of any kind without one), or several; none if the choice was cancelled.
pub(crate) async fn choose(ending: &str, several: bool) -> Vec<File> {
    let prepare = |input: &HtmlInputElement| {
        input.set_accept(ending);
        input.set_multiple(several);
    };
    chosen(prepare).await.unwrap_or_default()
}

/// Lets the user choose a folder; `None` if the choice was cancelled, or the folder holds no file.
pub(crate) async fn choose_folder() -> Option<Folder> {
    Folder::chosen(chosen(|input| input.set_webkitdirectory(true)).await?)
}

async fn chosen(prepare: impl FnOnce(&HtmlInputElement)) -> Option<Vec<File>> {
    let input: HtmlInputElement = document().create_element("input").ok()?.dyn_into().ok()?;
    input.set_type("file");
    prepare(&input);
    let (sender, chosen) = oneshot::channel();
    let sender = std::cell::RefCell::new(Some(sender));
    let done = Closure::<dyn Fn()>::new(move || {
        if let Some(sender) = sender.borrow_mut().take() {
            // Nobody receives if the dialog was given up.
            let _ = sender.send(());
        }
    });
    input.add_event_listener_with_callback("change", done.as_ref().unchecked_ref()).ok()?;
    input.add_event_listener_with_callback("cancel", done.as_ref().unchecked_ref()).ok()?;
    input.click();
    chosen.await.ok()?;
    let files = input.files()?;
    Some((0..files.length()).filter_map(|index| files.get(index)).collect())
}

/// Returns the bytes of a file that was chosen; `None` if it cannot be read.
pub(crate) async fn read(file: &File) -> Option<Vec<u8>> {
    let bytes = JsFuture::from(file.array_buffer()).await.ok()?;
    Some(Uint8Array::new(&bytes).to_vec())
}

/// Lets the browser save a file.
pub(crate) fn download(name: &str, bytes: &[u8]) -> Result<()> {
    let refused = |_: JsValue| Error::input(name, "was refused by the browser");
    let part = Uint8Array::from(bytes);
    let blob = Blob::new_with_u8_array_sequence(&Array::of1(&part)).map_err(refused)?;
    let address = Url::create_object_url_with_blob(&blob).map_err(refused)?;
    let anchor: HtmlAnchorElement = document().create_element("a").map_err(refused)?.unchecked_into();
    anchor.set_href(&address);
    anchor.set_download(name);
    anchor.click();
    Url::revoke_object_url(&address).map_err(refused)
}
