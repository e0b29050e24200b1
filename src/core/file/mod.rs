//! Files: arenas on disk, which are written atomically and read through a memory map.

mod atomic;
mod atomic_folder;
mod atomic_temporary;
mod levels;
mod map;
mod resident;
mod sections;
mod write;

pub use atomic::{check_writable, descriptor, scratch_folder, write_atomically, write_atomically_unless};
pub use atomic_folder::write_folder_atomically;
pub use atomic_temporary::abandon_writes;
pub(crate) use levels::levels_in_files;
pub use map::AdjFile;
pub(crate) use write::{GivenLevels, bytes_of_rows, open_rows_and_levels, write_rows_and_levels};
pub use write::{RowsOutput, arena_bytes, open_rows, write_rows};
