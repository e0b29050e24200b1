//! Files: arenas on disk, written whole or not at all and read through a memory map.

mod ledger;
pub mod map;
pub mod place;
pub mod temporary;
pub mod write;

pub use map::AdjFile;
pub use place::{Scratch, check_writable, scratch_folder, write_atomically, write_atomically_unless};
pub use temporary::abandon_writes;
pub use write::{RowsOutput, arena_bytes, open_rows, write_arena, write_rows};
