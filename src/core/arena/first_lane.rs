//! The first lane of a file, read on its own: what a page loads of a file on a server.
//!
//! In: the beginning of an `.adj` file. Out: which bytes of the file make up a smaller one that has the lane along x only,
//! from which the other lanes can be derived.

use std::mem::size_of;
use std::ops::Range;

use zerocopy::IntoBytes as _;
use zerocopy::byteorder::little_endian::{U32, U64};

use super::layout::{FileHeader, MAX_SECTIONS, SectionEntry, aligned, header_checksum};
use super::open::Head;
use crate::error::{Error, FormatFault, Result};
use crate::volume::Axis;

/// An `.adj` file with the first lane of another one, whose parts have still to be copied.
#[derive(Debug)]
pub struct FirstLane {
    /// The smaller file: its header and section table, and zeros where `parts` belong.
    pub bytes: Vec<u8>,
    /// The parts: a range of bytes of the large file, and where it goes in `bytes`.
    pub parts: Vec<(Range<u64>, usize)>,
}

impl FirstLane {
    /// This many bytes from the beginning of a file, or all of a shorter file, are enough for [`FirstLane::new`].
    pub const HEAD: u64 = (size_of::<FileHeader>() + MAX_SECTIONS as usize * size_of::<SectionEntry>()) as u64;

    /// Reads `head`, the first [`FirstLane::HEAD`] bytes of a file of `file_bytes` bytes, and plans the smaller file.
    ///
    /// # Errors
    /// [`Error::Format`], which names the file as `name`; [`Error::OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(head: &[u8], file_bytes: u64, name: &str) -> Result<FirstLane> {
        let wrong = |fault: FormatFault| Error::Format { path: name.into(), fault };
        let Head { mut header, table, .. } = Head::new(head, file_bytes).map_err(wrong)?;
        let is_other_lane = |entry: &SectionEntry| entry.lane_axis().is_some_and(|axis| axis != Axis::X);
        let mut kept: Vec<SectionEntry> = table.iter().filter(|entry| !is_other_lane(entry)).copied().collect();
        let mut end = aligned((size_of::<FileHeader>() + size_of_val(&kept[..])) as u64);
        let mut parts: Vec<(Range<u64>, u64)> = Vec::new();
        for entry in &mut kept {
            let range = entry.offset.get()..aligned(entry.offset.get() + entry.bytes.get());
            match parts.last_mut() {
                Some((last, _)) if last.end == range.start => last.end = range.end,
                _ => parts.push((range, end)),
            }
            entry.offset = U64::new(end);
            end = aligned(end + entry.bytes.get());
        }
        header.section_count = U32::new(u32::try_from(kept.len()).expect("at most as many as there were"));
        header.file_bytes = U64::new(end);
        header.header_xxh3 = U64::new(header_checksum(&header, &kept));
        let refused = || Error::out_of_memory("a file's first lane", end);
        let len = usize::try_from(end).map_err(|_| refused())?;
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(len).map_err(|_| refused())?;
        bytes.resize(len, 0);
        let start = [header.as_bytes(), kept.as_bytes()].concat();
        bytes[..start.len()].copy_from_slice(&start);
        let place = |at: u64| usize::try_from(at).expect("it lies within the bytes");
        Ok(FirstLane { bytes, parts: parts.into_iter().map(|(range, at)| (range, place(at))).collect() })
    }
}
