//! What the test programs share: files, scenes, orders of walks, random numbers, comparisons of pictures.

#[path = "shared/files.rs"]
pub mod files;
#[path = "shared/pictures.rs"]
pub mod pictures;
#[path = "shared/random.rs"]
pub mod random;
#[path = "shared/scenes.rs"]
pub mod scenes;
#[path = "shared/walks.rs"]
pub mod walks;

pub use files::{at_full, is_full, real_volume, repository, required, runs_once, say, skipped};

/// The example of docs/EMBEDDING.md, which must compile.
#[doc = include_str!("../docs/EMBEDDING.md")]
#[cfg(doctest)]
pub struct Embedding;
