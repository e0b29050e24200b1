//! What the other crates of this workspace reach into: judges, studies, the program, tests. No part of the API.

pub use crate::text::{open_regular, read_text};

// structure
pub use crate::volume::source::obtainable;
