//! What the other crates of this workspace reach into: judges, studies, the program, tests. No part of the API.

pub use crate::text::{open_regular, read_text};

// structure
pub use crate::arena::lane::STEPPING;
pub use crate::arena::pack::LanePacker;
pub use crate::arena::pager::IN_FLIGHT;
pub use crate::arena::record_set::{RecordSet, carry};
pub use crate::arena::transpose::transpose;
pub use crate::build::budget::Budget;
pub use crate::volume::source::obtainable;
