//! Files on a server, in a page: only the parts that a picture needs, by HTTP range requests.
//!
//! In: an address. Out: a model with the first lane of the file, from which other lanes are derived when a view needs
//! them; of a server that does not know ranges, the whole file.

use std::ops::{Range, RangeInclusive};

use adjsplat::Model;
use adjsplat::arena::{Arena, FirstLane, Part};
use adjsplat::error::{Error, Result};
use adjsplat::traverse::VoxelBox;
use adjsplat::volume::Axis;
use egui::Context;
use js_sys::{Promise, Uint8Array};
use wasm_bindgen::{JsCast as _, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::{Request, RequestInit, Response};
use web_time::Instant;

use crate::open::{Phase, Progress, model_of};

/// Bytes of the first part of the voxels and of the largest one; progress is shown after each.
const PARTS: RangeInclusive<u64> = 256 << 10..=4 << 20;
/// A picture of what has arrived is shown after so many seconds, and again when this time has doubled.
const PATIENCE: f64 = 0.7;

/// Returns a model of the file at an address; the number of bytes that were fetched, and those of the whole file.
///
/// While that takes long, `arrived` gets a model of what has arrived, the box of all visible voxels, and the bytes.
pub(crate) async fn model(
    address: &str,
    progress: &Progress,
    context: &Context,
    arrived: impl Fn(Model, Option<VoxelBox>, [u64; 2]),
) -> Result<(Model, [u64; 2])> {
    progress.set(Phase::Fetching, 0, 1)?;
    let head = received(address, ask(address, 0..FirstLane::HEAD)?).await?;
    let mut fetched = u64::from(head.bytes.length());
    let Some(part) = &head.part else {
        return Ok((model_of(address, head.bytes.to_vec())?, [fetched, fetched]));
    };
    let length = part.whole;
    let FirstLane { mut bytes, parts } = FirstLane::new(&head.bytes.to_vec(), length, PARTS, address)?;
    let total: u64 = parts.iter().map(Part::bytes).sum();
    let (start, mut patience) = (Instant::now(), PATIENCE);
    let mut done = 0;
    for part in parts {
        fetched += fetch(address, &part, &head, &mut bytes).await?;
        done += part.bytes();
        context.request_repaint();
        progress.set(Phase::Fetching, done, total)?;
        if done < total
            && start.elapsed().as_secs_f64() > patience
            && let Some(file) = FirstLane::arrived(&bytes, part.records, address)?
        {
            // All tiles have arrived.
            let bounds = Arena::new(&bytes).ok().and_then(|arena| arena.lane(Axis::X)).and_then(|lane| lane.bounds());
            let extent = bounds.map(|(low, high)| VoxelBox { low, high });
            arrived(model_of(address, file)?, extent, [fetched, length]);
            patience = 2.0 * start.elapsed().as_secs_f64();
        }
    }
    Ok((model_of(address, bytes)?, [fetched, length]))
}

/// Copies a part of the file at an address to where it belongs; returns the number of bytes that were fetched.
async fn fetch(address: &str, part: &Part, head: &Answer, bytes: &mut [u8]) -> Result<u64> {
    let mut answers = Vec::new();
    for (range, at) in &part.ranges {
        // Some of it came with the head.
        let in_head = |place: u64| u32::try_from(place).unwrap_or(u32::MAX).min(head.bytes.length());
        let known = head.bytes.subarray(in_head(range.start), in_head(range.end));
        known.copy_to(&mut bytes[*at..at + known.length() as usize]);
        let rest = range.start + u64::from(known.length())..range.end;
        if !rest.is_empty() {
            answers.push((rest.clone(), at + known.length() as usize, ask(address, rest)?));
        }
    }
    let mut fetched = 0;
    for (wanted, at, answer) in answers {
        let got = received(address, answer).await?;
        let is_same = got.part.as_ref().is_some_and(|part| {
            part.first == wanted.start && head.part.as_ref().is_some_and(|head| head.whole == part.whole)
        });
        if !is_same || got.version != head.version || u64::from(got.bytes.length()) != wanted.end - wanted.start {
            return Err(Error::input(address, "was cut or changed while it was fetched; load the page again"));
        }
        got.bytes.copy_to(&mut bytes[at..at + got.bytes.length() as usize]);
        fetched += wanted.end - wanted.start;
    }
    Ok(fetched)
}

/// What a server answered.
struct Answer {
    bytes: Uint8Array,
    /// What part of the file that is; `None` for the whole, from a server that does not know ranges.
    part: Option<Content>,
    /// What the server calls this version of the file; empty if it does not.
    version: String,
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

/// Begins to ask for a range of the bytes at an address.
fn ask(address: &str, range: Range<u64>) -> Result<Promise> {
    let request = Request::new_with_str_and_init(address, &RequestInit::new()).map_err(failed(address))?;
    let wanted = format!("bytes={}-{}", range.start, range.end - 1);
    request.headers().set("Range", &wanted).map_err(failed(address))?;
    Ok(web_sys::window().expect("a page has a window").fetch_with_request(&request))
}

/// Waits for an answer.
async fn received(address: &str, answer: Promise) -> Result<Answer> {
    let response: Response = JsFuture::from(answer).await.map_err(failed(address))?.unchecked_into();
    if !response.ok() {
        let answer = format!("cannot be fetched: the server says {} {}", response.status(), response.status_text());
        return Err(Error::input(address, answer));
    }
    let header = |name: &str| response.headers().get(name).ok().flatten();
    let part = match response.status() {
        206 => {
            let part = header("content-range").as_deref().and_then(Content::read);
            Some(part.ok_or_else(|| Error::input(address, "came without saying which part of the file it is"))?)
        }
        _ => None,
    };
    let version = header("etag").or_else(|| header("last-modified")).unwrap_or_default();
    let bytes = JsFuture::from(response.array_buffer().map_err(failed(address))?).await.map_err(failed(address))?;
    Ok(Answer { bytes: Uint8Array::new(&bytes), part, version })
}

fn failed(address: &str) -> impl Fn(JsValue) -> Error {
    move |fault| {
        let text = fault.dyn_ref::<js_sys::Error>().map(|fault| String::from(fault.message())).unwrap_or_default();
        Error::input(address, format!("cannot be fetched: {text}; a page reads from its own server only"))
    }
}
