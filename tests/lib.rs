//! What the test programs share: where files are.

use std::path::PathBuf;

/// Returns the repository's root folder.
pub fn repository() -> PathBuf {
    let tests = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    tests.parent().expect("tests is a folder of the repository").to_path_buf()
}

/// The example of docs/EMBEDDING.md, which must compile.
#[doc = include_str!("../docs/EMBEDDING.md")]
#[cfg(doctest)]
pub struct Embedding;
