//! Files on a server, in a page: only the parts that a picture needs, by HTTP range requests.
//!
//! In: an address. Out: a model with the first lane of the file, from which other lanes are derived when a view needs
//! them; of a server that does not know ranges, the whole file.

use std::ops::Range;

use adjsplat::Model;
use adjsplat::arena::FirstLane;
use adjsplat::error::{Error, Result};
use egui::Context;
use js_sys::Uint8Array;
use wasm_bindgen::{JsCast as _, JsValue};
use wasm_bindgen_futures::JsFuture;
use web_sys::{Request, RequestInit, Response};

use crate::open::{Phase, Progress, model_of};

/// Bytes of a request: progress is shown after each.
const PART: usize = 4 << 20;
/// Where the header of a file says how long the file is.
const LENGTH_AT: usize = 16;

/// Returns a model of the file at an address; the number of bytes that were fetched, and those of the whole file.
pub(crate) async fn model(address: &str, progress: &Progress, context: &Context) -> Result<(Model, [u64; 2])> {
    progress.set(Phase::Fetching, 0, 1)?;
    let (head, is_part) = get(address, 0..FirstLane::HEAD).await?;
    let mut fetched = u64::from(head.length());
    let head = head.to_vec();
    if !is_part {
        return Ok((model_of(address, head)?, [fetched, fetched]));
    }
    let length =
        head.get(LENGTH_AT..LENGTH_AT + 8).and_then(|bytes| bytes.try_into().ok()).map_or(0, u64::from_le_bytes);
    let FirstLane { mut bytes, parts } = FirstLane::new(&head, length, address)?;
    let total: u64 = parts.iter().map(|(range, _)| range.end - range.start).sum();
    let mut done = 0;
    for (range, at) in parts {
        // Some of it came with the head.
        let in_head = |place: u64| usize::try_from(place).map_or(head.len(), |place| place.min(head.len()));
        let known = &head[in_head(range.start)..in_head(range.end)];
        bytes[at..at + known.len()].copy_from_slice(known);
        done += known.len() as u64;
        for first in (range.start + known.len() as u64..range.end).step_by(PART) {
            let wanted = first..range.end.min(first + PART as u64);
            let (part, is_part) = get(address, wanted.clone()).await?;
            if !is_part || u64::from(part.length()) != wanted.end - wanted.start {
                return Err(Error::input(address, "was cut or changed while it was fetched; load the page again"));
            }
            let to = at + usize::try_from(first - range.start).expect("within the bytes");
            part.copy_to(&mut bytes[to..to + part.length() as usize]);
            fetched += u64::from(part.length());
            done += u64::from(part.length());
            context.request_repaint();
            progress.set(Phase::Fetching, done, total)?;
        }
    }
    Ok((model_of(address, bytes)?, [fetched, length]))
}

/// Returns a range of the bytes at an address and true, or all of them and false if the server does not know ranges.
async fn get(address: &str, range: Range<u64>) -> Result<(Uint8Array, bool)> {
    let failed = |fault: JsValue| {
        let text = fault.dyn_ref::<js_sys::Error>().map(|fault| String::from(fault.message())).unwrap_or_default();
        Error::input(address, format!("cannot be fetched: {text}; a page reads from its own server only"))
    };
    let request = Request::new_with_str_and_init(address, &RequestInit::new()).map_err(failed)?;
    request.headers().set("Range", &format!("bytes={}-{}", range.start, range.end - 1)).map_err(failed)?;
    let window = web_sys::window().expect("a page has a window");
    let response: Response =
        JsFuture::from(window.fetch_with_request(&request)).await.map_err(failed)?.unchecked_into();
    if !response.ok() {
        let answer = format!("cannot be fetched: the server says {} {}", response.status(), response.status_text());
        return Err(Error::input(address, answer));
    }
    let bytes = JsFuture::from(response.array_buffer().map_err(failed)?).await.map_err(failed)?;
    Ok((Uint8Array::new(&bytes), response.status() == 206))
}
