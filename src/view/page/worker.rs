//! The web worker of the page: builds volumes beside the page, which answers meanwhile. A browser runs it on a thread of its own;
//! the page stops a build by ending the worker.

#[cfg(target_arch = "wasm32")]
pub mod volume;

/// Does nothing: worker.js calls what [`volume`] exports.
fn main() {}
