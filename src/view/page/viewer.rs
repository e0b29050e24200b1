//! The viewer of the page.

#[cfg(target_arch = "wasm32")]
use adjsplat_view as _;

/// Does nothing: page.js calls what `adjsplat_view::page` exports.
fn main() {}
