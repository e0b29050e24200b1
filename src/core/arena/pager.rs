//! The pager: who keeps the mapped pages of a file within bounds while they are read.
//!
//! Readers of a [`Lane`](super::Lane) tell its pager what they are about to read. Lanes in memory have none, and then
//! telling costs one branch: a tile's directory entry, a group of lines and a piece of a sweep are each told of once,
//! a voxel never.

use std::fmt::Debug;

/// Most bytes that a reader leaves unread between two tellings, in all channels, counted in whole pieces that the
/// system may map at once (64 KiB): one group of lines of a walk (tests/lowmem.rs).
pub const IN_FLIGHT: u64 = 2 << 20;

/// Told what is about to be read, it may release what was read before. Whatever it does, the bytes stay the same.
pub trait Pager: Debug + Send + Sync {
    /// `bytes` are about to be read, by this thread; what it told of before may have been.
    fn about_to_read(&self, bytes: &[u8]);
}

/// Tells `pager`, if there is one, of `bytes`.
#[inline(always)]
pub(crate) fn tell<'a>(pager: Option<&dyn Pager>, bytes: impl FnOnce() -> &'a [u8]) {
    if let Some(pager) = pager {
        pager.about_to_read(bytes());
    }
}
