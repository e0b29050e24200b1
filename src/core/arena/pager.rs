//! Pagers: limit the resident pages of a mapped file while it is read.
//!
//! Readers of a [`Lane`](super::Lane) tell its pager which bytes they are about to read: once per tile, group of lines
//! or part of a sweep, never per voxel. Lanes in memory have no pager; testing for it costs one branch.

use std::fmt::Debug;

/// Most bytes, over all channels, that one reader announces before it reads them: one group of lines of a walk
/// (tests/memory/lowmem.rs). Counted in whole blocks of 64 KiB, which the system maps at once.
pub const IN_FLIGHT: u64 = 2 << 20;

/// Is told which mapped bytes are about to be read, and may release the pages of bytes that were read earlier.
pub trait Pager: Debug + Send + Sync {
    /// Tells the pager that this thread is about to read `bytes`. Bytes announced earlier may then be released.
    fn about_to_read(&self, bytes: &[u8]);
}

/// Tells `pager`, if there is one, that `bytes` are about to be read.
#[inline(always)]
pub(crate) fn tell<'a>(pager: Option<&dyn Pager>, bytes: impl FnOnce() -> &'a [u8]) {
    if let Some(pager) = pager {
        pager.about_to_read(bytes());
    }
}
