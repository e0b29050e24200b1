//! Picture files: frames of linear premultiplied light to PNG, animated PNG and OpenEXR, and back.
//!
//! [`Picture`] is a frame as a file stores it; [`read_picture`] returns the frame that a file holds. [`PicturePart`] says which part of
//! a larger picture it is.

mod part;
#[cfg(not(target_arch = "wasm32"))]
mod read;
mod write;

pub use part::PicturePart;
#[cfg(not(target_arch = "wasm32"))]
pub use read::{read_part, read_picture};
pub use write::{Picture, PictureKind, SampleDepth, numbered, write_png};
