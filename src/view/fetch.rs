//! Files in a page: of those on a server only the parts that a picture needs, by HTTP range requests; of those that were
//! chosen or dropped likewise. Volumes are read whole, and become such files.
//!
//! In: an address or files. Out: a file whose directory, with those of its levels of detail, alone is in memory, and which reads
//! more when it is asked to. A file that the device could not hold, or that stores fewer than three lanes, has its first lane in
//! memory, from which the other lanes are derived; of a server that does not know ranges, all of the file is.

use std::ops::Range;
use std::sync::Arc;

use adjsplat::Model;
use adjsplat::arena::Directory;
use adjsplat::arena::layout::MAGIC;
use adjsplat::collection::MANIFEST;
use adjsplat::error::{Error, Result};
use adjsplat::limits::Limits;
use adjsplat::splat::Lanes as _;
use adjsplat::splat::gpu::GpuOptions;
use adjsplat::volume::Axis;
use egui::Context;
use js_sys::{Array, Function, Reflect, Uint8Array};
use send_wrapper::SendWrapper;
use wasm_bindgen::{JsCast as _, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::{AbortController, ReadableStreamDefaultReader, Request, RequestInit, Response};

use crate::builder::{self, Volume};
use crate::folder::Folder;
use crate::open::{Chosen, FilePlace, Opened, Phase, Progress, model_of};
use crate::remote::{PARTS, Reading, Remote, Source};

/// How long a server may send nothing, in milliseconds.
const PATIENCE: i32 = 60_000;

/// Opens the file at an address.
pub(crate) async fn open_address(
    place: &FilePlace,
    address: &str,
    progress: &Progress,
    context: &Context,
) -> Result<Opened> {
    let name = place.name();
    let name = if name.is_empty() { "the address".into() } else { name };
    progress.set(Phase::Fetching, 0, 1)?;
    let asked = Asked::begin(&name, address, 0..Directory::HEAD)?;
    let arrived = &|done, total| {
        context.request_repaint();
        progress.set(Phase::Fetching, done, total)
    };
    let mut got = asked.answer(&name, arrived).await?;
    let whole = got.part.as_ref().map(|part| part.whole);
    if !is_adj(&name, &got.start()) {
        if let Some(whole) = whole.filter(|whole| *whole > got.len) {
            let all = Asked::begin(&name, address, 0..whole)?.answer(&name, arrived).await?;
            all.check(&name, &(0..whole), whole, &got.version)?;
            got = all;
        }
        let volume = Volume { files: vec![(name.clone(), got.file(&name)?)], opened: vec![name] };
        return build(place, volume, progress, context).await;
    }
    let head = got.bytes()?;
    let Some(whole) = whole else {
        let whole = head.len() as u64;
        return Opened::new(place, model_of(&name, head)?, true, Some([whole; 2]));
    };
    let server = Server { address: address.to_owned(), name: name.clone(), whole, version: got.version };
    open(place, File { name: &name, head, whole, is_adj: true }, server, progress, context).await
}

/// Opens files that were chosen or dropped.
pub(crate) async fn open_chosen(
    place: &FilePlace,
    chosen: &Chosen,
    progress: &Progress,
    context: &Context,
) -> Result<Opened> {
    if chosen.count == 1 {
        let file = OnDisk::new(place, chosen.files[0].clone());
        let head = file.head().await?;
        if is_adj(&file.name, &head) {
            let (name, whole) = (file.name.clone(), file.whole());
            return open(place, File { name: &name, head, whole, is_adj: true }, file, progress, context).await;
        }
    }
    let files: Vec<_> = chosen.files.iter().map(|file| (file.name(), file.clone())).collect();
    let opened = files.iter().take(chosen.count).map(|(path, _)| path.clone()).collect();
    build(place, Volume { files, opened }, progress, context).await
}

/// Opens a folder that was chosen or dropped.
pub(crate) async fn open_folder(
    place: &FilePlace,
    folder: &Folder,
    progress: &Progress,
    context: &Context,
) -> Result<Opened> {
    progress.set(Phase::Listing, 0, 1)?;
    let files = folder.files(progress, context).await?;
    progress.set(Phase::Opening, 0, 1)?;
    let name = folder.name();
    let manifest = format!("{name}/{MANIFEST}");
    if files.iter().any(|(path, _)| *path == manifest) {
        let why = "is a collection of bricks; make one file of it by adj join, or use adj view";
        return Err(Error::input(name, why));
    }
    build(place, Volume { files, opened: vec![name.to_owned()] }, progress, context).await
}

/// Builds a volume, and opens what was built.
async fn build(place: &FilePlace, volume: Volume, progress: &Progress, context: &Context) -> Result<Opened> {
    let name = place.name();
    let built = OnDisk::new(place, builder::build(&name, volume, progress, context).await?);
    let (head, whole) = (built.head().await?, built.whole());
    open(place, File { name: &name, head, whole, is_adj: false }, built, progress, context).await
}

/// A file of which the first bytes have been read.
struct File<'a> {
    /// The name that messages call it by.
    name: &'a str,
    head: Vec<u8>,
    /// The length in bytes.
    whole: u64,
    /// Whether the user opened it, and not a volume.
    is_adj: bool,
}

async fn open(
    place: &FilePlace,
    file: File<'_>,
    source: impl Source + 'static,
    progress: &Progress,
    context: &Context,
) -> Result<Opened> {
    let (File { name, head, whole, is_adj }, limits) = (file, Limits::default());
    // Of a volume nothing was fetched for this.
    let so_far = |fetched| is_adj.then_some([fetched, whole]);
    let mut directory = Directory::new(&head, whole, &limits, name)?;
    let places = directory.level_heads();
    let heads = source.read(&places).await?;
    let mut fetched = std::iter::once(&head).chain(&heads).map(|bytes| bytes.len() as u64).sum();
    directory.add_levels(&heads, &limits, name)?;
    let known: Vec<_> = places.iter().map(|place| place.start).zip(heads).chain([(0, head)]).collect();
    fetched += complete(&mut directory, &known, &source, progress, context).await?;
    directory.check(name)?;
    let directory = Arc::new(directory);
    let model = Model::from_directory(directory.clone(), Vec::new(), name)?;
    let options = GpuOptions::default();
    let is_held = |axis: Axis| model.lane(axis).is_ok_and(|lane| options.holds(&lane));
    if Axis::ALL.into_iter().all(|axis| directory.has_lane(axis) && is_held(axis)) {
        let remote = Remote::new(name, directory, source, fetched, context);
        return Ok(Opened { remote: Some(Arc::new(remote)), ..Opened::new(place, model, is_adj, so_far(fetched))? });
    }
    let head = known.last().map_or(&[][..], |(_, head)| head);
    let mut lane = Directory::first_lane(head, whole, &limits, name)?;
    fetched += complete(&mut lane, &known, &source, progress, context).await?;
    lane.check(name)?;
    Opened::new(place, model_of(name, lane.into_bytes())?, is_adj, so_far(fetched))
}

/// Returns whether a file that begins with `head` is an `.adj` file, not a volume.
fn is_adj(name: &str, head: &[u8]) -> bool {
    let is_named = std::path::Path::new(name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("adj"));
    is_named || head.starts_with(&MAGIC)
}

/// Fetches what a directory lacks beside the bytes that are `known`, each with their place in the file; returns the number of bytes.
async fn complete(
    directory: &mut Directory,
    known: &[(u64, Vec<u8>)],
    source: &impl Source,
    progress: &Progress,
    context: &Context,
) -> Result<u64> {
    let mut fetched = 0;
    // Returns the bytes of a range that are known, from its first on.
    let of_known = |range: &Range<u64>| {
        let within = |(start, bytes): &'_ &(u64, Vec<u8>)| (*start..start + bytes.len() as u64).contains(&range.start);
        let (start, bytes) = known.iter().find(within)?;
        let place = |at: u64| usize::try_from(at - start).unwrap_or(usize::MAX).min(bytes.len());
        Some(&bytes[place(range.start)..place(range.end)])
    };
    loop {
        let wanted = directory.wanted(*PARTS.end());
        let Some(first) = wanted.first() else { return Ok(fetched) };
        if let Some(bytes) = of_known(first) {
            directory.append(bytes)?;
            continue;
        }
        let unknown: Vec<_> = wanted.into_iter().take_while(|range| of_known(range).is_none()).collect();
        for bytes in source.read(&unknown).await? {
            fetched += bytes.len() as u64;
            directory.append(&bytes)?;
        }
        let [done, total] = directory.progress();
        context.request_repaint();
        progress.set(Phase::Fetching, done, total)?;
    }
}

/// A file on a server that knows ranges.
struct Server {
    address: String,
    /// The name that messages call the file by.
    name: String,
    /// The length of the file.
    whole: u64,
    /// What the server calls the version of the file; empty if it does not.
    version: String,
}

impl Source for Server {
    fn read<'a>(&'a self, ranges: &'a [Range<u64>]) -> Reading<'a> {
        Box::pin(async move {
            // All are asked for before the first is waited for.
            let ask = |range: &Range<u64>| match range.is_empty() {
                true => Ok((range.clone(), None)),
                false => {
                    Asked::begin(&self.name, &self.address, range.clone()).map(|asked| (range.clone(), Some(asked)))
                }
            };
            let asked = ranges.iter().map(ask).collect::<Result<Vec<_>>>()?;
            let mut parts = Vec::with_capacity(asked.len());
            for (range, asked) in asked {
                parts.push(match asked {
                    Some(asked) => {
                        let got = asked.answer(&self.name, |_, _| Ok(())).await?;
                        got.check(&self.name, &range, self.whole, &self.version)?;
                        got.bytes()?
                    }
                    None => Vec::new(),
                });
            }
            Ok(parts)
        })
    }
}

/// A file that was chosen or dropped, or was built: the browser holds it.
struct OnDisk {
    file: SendWrapper<web_sys::File>,
    name: String,
}

impl OnDisk {
    fn new(place: &FilePlace, file: web_sys::File) -> OnDisk {
        OnDisk { file: SendWrapper::new(file), name: place.name() }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the length of a file")]
    fn whole(&self) -> u64 {
        self.file.size() as u64
    }

    async fn head(&self) -> Result<Vec<u8>> {
        let head = 0..Directory::HEAD.min(self.whole());
        Ok(self.read(std::slice::from_ref(&head)).await?.remove(0))
    }
}

impl Source for OnDisk {
    fn is_local(&self) -> bool {
        true
    }

    fn read<'a>(&'a self, ranges: &'a [Range<u64>]) -> Reading<'a> {
        Box::pin(async move {
            let failed = |_: JsValue| Error::input(&self.name, "cannot be read, or changed since it was chosen");
            let mut parts = Vec::with_capacity(ranges.len());
            for range in ranges {
                let [start, end] = [range.start, range.end].map(|place| place as f64);
                let slice = self.file.slice_with_f64_and_f64(start, end).map_err(failed)?;
                let bytes = JsFuture::from(slice.array_buffer()).await.map_err(failed)?;
                let part = Uint8Array::new(&bytes).to_vec();
                if part.len() as u64 != range.end - range.start {
                    return Err(failed(JsValue::NULL));
                }
                parts.push(part);
            }
            Ok(parts)
        })
    }
}

/// What a server answered.
struct Answer {
    /// The bytes, in pieces that the program's memory does not hold.
    pieces: Vec<Uint8Array>,
    len: u64,
    /// What part of the file that is; `None` for the whole, from a server that does not know ranges.
    part: Option<Content>,
    /// What the server calls this version of the file; empty if it does not.
    version: String,
}

impl Answer {
    /// Returns an error if these are not the bytes `wanted` of a file of `whole` bytes in this version.
    fn check(&self, name: &str, wanted: &Range<u64>, whole: u64, version: &str) -> Result<()> {
        let is_same = self.part.as_ref().is_some_and(|part| part.first == wanted.start && part.whole == whole);
        if is_same && self.version == version && self.len == wanted.end - wanted.start {
            return Ok(());
        }
        Err(Error::input(name, "was cut or changed while it was fetched; load the page again"))
    }

    /// Returns the first bytes, which tell what the file is.
    fn start(&self) -> Vec<u8> {
        self.pieces.iter().flat_map(|piece| piece.subarray(0, 16).to_vec()).take(16).collect()
    }

    fn bytes(&self) -> Result<Vec<u8>> {
        let refused = |_| Error::out_of_memory("a file from a server", self.len);
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(usize::try_from(self.len).unwrap_or(usize::MAX)).map_err(refused)?;
        for piece in &self.pieces {
            let have = bytes.len();
            bytes.resize(have + piece.length() as usize, 0);
            piece.copy_to(&mut bytes[have..]);
        }
        Ok(bytes)
    }

    /// Returns a file of the browser with the bytes.
    fn file(&self, name: &str) -> Result<web_sys::File> {
        let pieces: Array = self.pieces.iter().collect();
        web_sys::File::new_with_u8_array_sequence(&pieces, name)
            .map_err(|_| Error::input(name, "was refused by the browser, perhaps for lack of memory"))
    }
}

/// A part of a file: its first byte, and the length of the whole file.
struct Content {
    first: u64,
    whole: u64,
}

impl Content {
    /// Reads a header such as `bytes 16-23/4096`.
    fn read(header: &str) -> Option<Content> {
        let (range, whole) = header.strip_prefix("bytes ")?.split_once('/')?;
        let (first, _) = range.split_once('-')?;
        Some(Content { first: first.parse().ok()?, whole: whole.parse().ok()? })
    }
}

/// A request for a range of a file. Dropping it stops the request.
struct Asked {
    response: JsFuture,
    stop: AbortController,
    wanted: Range<u64>,
}

impl Drop for Asked {
    fn drop(&mut self) {
        self.stop.abort();
    }
}

impl Asked {
    /// Asks for a range of the bytes at an address; `name` is the file's.
    fn begin(name: &str, address: &str, wanted: Range<u64>) -> Result<Asked> {
        let stop = AbortController::new().map_err(failed(name))?;
        let how = RequestInit::new();
        how.set_signal(Some(&stop.signal()));
        let request = Request::new_with_str_and_init(address, &how).map_err(failed(name))?;
        let range = format!("bytes={}-{}", wanted.start, wanted.end - 1);
        request.headers().set("Range", &range).map_err(failed(name))?;
        let response = window().fetch_with_request(&request).into();
        Ok(Asked { response, stop, wanted })
    }

    /// Waits for the answer. After each piece it calls `arrived` with the bytes that are there and those that the server
    /// announced, and stops where that fails.
    async fn answer(mut self, name: &str, arrived: impl Fn(u64, u64) -> Result<()>) -> Result<Answer> {
        let response: Response = patient(&self.stop, &mut self.response).await.map_err(failed(name))?.unchecked_into();
        if response.status() == 416 && self.wanted.start == 0 {
            return Err(Error::input(name, "is an empty file"));
        }
        if !response.ok() {
            let answer = format!("cannot be fetched: the server says {} {}", response.status(), response.status_text());
            return Err(Error::input(name, answer));
        }
        let header = |header: &str| response.headers().get(header).ok().flatten();
        let part = match response.status() {
            206 => {
                let part = header("content-range").as_deref().and_then(Content::read);
                Some(part.ok_or_else(|| Error::input(name, "came without saying which part of the file it is"))?)
            }
            _ => None,
        };
        let version = header("etag").or_else(|| header("last-modified")).unwrap_or_default();
        let announced = header("content-length").and_then(|bytes| bytes.parse().ok()).unwrap_or(0);
        let (mut pieces, mut len) = (Vec::new(), 0);
        let stream = response.body().map(|body| body.get_reader().unchecked_into::<ReadableStreamDefaultReader>());
        while let Some(stream) = &stream {
            let piece = patient(&self.stop, &mut stream.read().into()).await.map_err(failed(name))?;
            // There is none at the end.
            let piece = Reflect::get(&piece, &"value".into()).map_err(failed(name))?;
            let Ok(piece) = piece.dyn_into::<Uint8Array>() else { break };
            len += u64::from(piece.length());
            if part.is_some() && len > self.wanted.end - self.wanted.start {
                return Err(Error::input(name, "cannot be fetched: the server sends more than it was asked for"));
            }
            pieces.push(piece);
            arrived(len, announced.max(len))?;
        }
        Ok(Answer { pieces, len, part, version })
    }
}

/// Waits for a promise of a request; stops the request when [`PATIENCE`] is over.
async fn patient(request: &AbortController, promise: &mut JsFuture) -> std::result::Result<JsValue, JsValue> {
    let stop: Function = Reflect::get(request, &"abort".into())?.dyn_into()?;
    let timer = window().set_timeout_with_callback_and_timeout_and_arguments_0(&stop.bind0(request), PATIENCE)?;
    let got = promise.await;
    window().clear_timeout_with_handle(timer);
    got
}

fn window() -> web_sys::Window {
    web_sys::window().expect("a page has a window")
}

fn failed(name: &str) -> impl Fn(JsValue) -> Error {
    move |fault| {
        let fault = fault.dyn_ref::<js_sys::Error>();
        let why = if fault.is_some_and(|fault| fault.name() == "AbortError") {
            format!("the server sent nothing for {} s; load the page again", PATIENCE / 1_000)
        } else {
            let text = fault.map(|fault| String::from(fault.message())).unwrap_or_default();
            format!("{text}; the connection broke, or the address is not on the page's own server")
        };
        Error::input(name, format!("cannot be fetched: {why}"))
    }
}
