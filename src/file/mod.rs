//! Files: arenas on disk, written whole or not at all and read through a memory map.

pub mod map;
pub mod place;
pub mod write;

pub use map::AdjFile;
pub use place::{Scratch, abandon_writes, check_writable, write_atomically, write_atomically_unless};
pub use write::{RowsOutput, arena_bytes, write_arena, write_arena_unless, write_rows};
