//! Pagers: limit the resident pages of a mapped file while it is read.
//!
//! Readers of a [`Lane`](super::Lane) tell its pager which bytes they are about to read: once per tile, group of lines
//! or part of a sweep, never per voxel. Lanes in memory have no pager; testing for it costs one branch.

use std::fmt::Debug;

/// Fewest bytes of a mapped file that become resident at once. Linux maps the pages around a fault in aligned blocks of this
/// size (`fault_around_bytes`).
const LEAST_BLOCK_BYTES: u64 = 1 << 16;
/// Most bytes that a system maps at once: the largest page that it keeps of a file.
pub(crate) const MOST_BLOCK_BYTES: u64 = 2 << 20;
/// Largest number of blocks of a file, up to files of 32 GiB. Linux keeps an area of addresses for each. It takes about 200
/// bytes for an area, and by default allows a process 65,530.
const MOST_BLOCKS: u64 = 1 << 14;
/// Largest number of blocks, over all channels, that one reader announces before it reads them: one group of lines of a walk
/// (tests/memory/lowmem.rs).
const BLOCKS_IN_FLIGHT: u64 = 32;

/// Returns how many bytes of a file of `file_bytes` become resident at once: a power of two from 64 KiB (files of up to
/// 1 GiB) to 2 MiB.
pub(crate) fn block_bytes(file_bytes: u64) -> u64 {
    file_bytes.div_ceil(MOST_BLOCKS).clamp(LEAST_BLOCK_BYTES, MOST_BLOCK_BYTES).next_power_of_two()
}

/// Returns the most bytes of a file of `file_bytes` that one reader announces before it reads them: 2 MiB for files of up
/// to 1 GiB.
pub fn in_flight(file_bytes: u64) -> u64 {
    BLOCKS_IN_FLIGHT * block_bytes(file_bytes)
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_grow_with_the_file_so_that_few_areas_of_addresses_hold_it() {
        let kib = |file_bytes| block_bytes(file_bytes) >> 10;
        assert_eq!([0, 1, 1 << 30].map(kib), [64; 3]);
        assert_eq!([(1 << 30) + 1, 4 << 30, (16 << 30) + 1, u64::MAX].map(kib), [128, 256, 2048, 2048]);
        assert_eq!(in_flight(1 << 30), 2 << 20);
    }
}
