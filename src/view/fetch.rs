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
/// Where the header of a file says how long the file is.
const LENGTH_AT: usize = 16;

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
    let (head, is_part) = get(address, 0..FirstLane::HEAD).await?;
    let mut fetched = u64::from(head.length());
    let head = head.to_vec();
    if !is_part {
        return Ok((model_of(address, head)?, [fetched, fetched]));
    }
    let length =
        head.get(LENGTH_AT..LENGTH_AT + 8).and_then(|bytes| bytes.try_into().ok()).map_or(0, u64::from_le_bytes);
    let FirstLane { mut bytes, parts } = FirstLane::new(&head, length, PARTS, address)?;
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
async fn fetch(address: &str, part: &Part, head: &[u8], bytes: &mut [u8]) -> Result<u64> {
    let mut answers = Vec::new();
    for (range, at) in &part.ranges {
        // Some of it came with the head.
        let in_head = |place: u64| usize::try_from(place).map_or(head.len(), |place| place.min(head.len()));
        let known = &head[in_head(range.start)..in_head(range.end)];
        bytes[*at..at + known.len()].copy_from_slice(known);
        let rest = range.start + known.len() as u64..range.end;
        if !rest.is_empty() {
            answers.push((rest.end - rest.start, at + known.len(), ask(address, rest)?));
        }
    }
    let mut fetched = 0;
    for (wanted, at, answer) in answers {
        let (got, is_part) = received(address, answer).await?;
        if !is_part || u64::from(got.length()) != wanted {
            return Err(Error::input(address, "was cut or changed while it was fetched; load the page again"));
        }
        got.copy_to(&mut bytes[at..at + got.length() as usize]);
        fetched += wanted;
    }
    Ok(fetched)
}

/// Returns a range of the bytes at an address and true, or all of them and false if the server does not know ranges.
async fn get(address: &str, range: Range<u64>) -> Result<(Uint8Array, bool)> {
    received(address, ask(address, range)?).await
}

/// Begins to ask for a range of the bytes at an address.
fn ask(address: &str, range: Range<u64>) -> Result<Promise> {
    let request = Request::new_with_str_and_init(address, &RequestInit::new()).map_err(failed(address))?;
    let wanted = format!("bytes={}-{}", range.start, range.end - 1);
    request.headers().set("Range", &wanted).map_err(failed(address))?;
    Ok(web_sys::window().expect("a page has a window").fetch_with_request(&request))
}

/// Returns the bytes of an answer, and whether they are the range.
async fn received(address: &str, answer: Promise) -> Result<(Uint8Array, bool)> {
    let response: Response = JsFuture::from(answer).await.map_err(failed(address))?.unchecked_into();
    if !response.ok() {
        let answer = format!("cannot be fetched: the server says {} {}", response.status(), response.status_text());
        return Err(Error::input(address, answer));
    }
    let bytes = JsFuture::from(response.array_buffer().map_err(failed(address))?).await.map_err(failed(address))?;
    Ok((Uint8Array::new(&bytes), response.status() == 206))
}

fn failed(address: &str) -> impl Fn(JsValue) -> Error {
    move |fault| {
        let text = fault.dyn_ref::<js_sys::Error>().map(|fault| String::from(fault.message())).unwrap_or_default();
        Error::input(address, format!("cannot be fetched: {text}; a page reads from its own server only"))
    }
}
