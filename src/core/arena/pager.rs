//! Pagers: limit the resident pages of a mapped file while it is read.
//!
//! Readers of a [`Lane`](super::Lane) inform its pager of what they are about to read: once per tile, group of lines or
//! part of a sweep, never per voxel. Lanes in memory have no pager, which costs one branch.

use std::fmt::Debug;

/// Most bytes that a reader announces and then reads, in all channels, counted in the 64 KiB blocks that a system maps
/// at once: one group of lines of a walk (tests/memory/lowmem.rs).
pub const IN_FLIGHT: u64 = 2 << 20;

/// Is informed before mapped bytes are read, and may release the pages of bytes that were read earlier.
pub trait Pager: Debug + Send + Sync {
    /// Announces that this thread is about to read `bytes`. Bytes announced earlier may have been released.
    fn about_to_read(&self, bytes: &[u8]);
}

/// Informs `pager`, if there is one, that `bytes` are about to be read.
#[inline(always)]
pub(crate) fn tell<'a>(pager: Option<&dyn Pager>, bytes: impl FnOnce() -> &'a [u8]) {
    if let Some(pager) = pager {
        pager.about_to_read(bytes());
    }
}
