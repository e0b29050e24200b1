//! The first lane of a file, read on its own: what a page loads of a file on a server.
//!
//! In: the beginning of an `.adj` file. Out: which bytes of the file make up a smaller one that has the lane along x only,
//! from which the other lanes can be derived; and, while its records arrive, still smaller ones with the first tiles only.

use std::mem::size_of;
use std::ops::{Range, RangeInclusive};

use xxhash_rust::xxh3::xxh3_64;
use zerocopy::byteorder::little_endian::{U32, U64};
use zerocopy::{FromBytes as _, IntoBytes as _};

use super::layout::{FileHeader, MAX_SECTIONS, SectionEntry, SectionKind, aligned, header_checksum};
use super::open::{Arena, Head};
use crate::error::{Error, FormatFault, Result};
use crate::volume::Axis;

/// An `.adj` file with the first lane of another one, whose parts have still to be copied.
#[derive(Debug)]
pub struct FirstLane {
    /// The smaller file: its header and section table, and zeros where `parts` belong.
    pub bytes: Vec<u8>,
    /// The parts, in the order in which they are of use: the first has all but the records.
    pub parts: Vec<Part>,
}

/// A part of a file: ranges of its bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Ranges of bytes of the large file, and where each goes in [`FirstLane::bytes`].
    pub ranges: Vec<(Range<u64>, usize)>,
    /// With this part and those before it, the lane's first records are there: so many.
    pub records: u64,
}

impl Part {
    /// Returns the number of bytes.
    pub fn bytes(&self) -> u64 {
        self.ranges.iter().map(|(range, _)| range.end - range.start).sum()
    }
}

impl FirstLane {
    /// This many bytes from the beginning of a file, or all of a shorter file, are enough for [`FirstLane::new`].
    pub const HEAD: u64 = (size_of::<FileHeader>() + MAX_SECTIONS as usize * size_of::<SectionEntry>()) as u64;

    /// Reads `head`, the first [`FirstLane::HEAD`] bytes of a file of `file_bytes` bytes, and plans the smaller file. The
    /// first part with records has about `sizes.start()` bytes, each other one twice as many as the one before, up to
    /// `sizes.end()`; at least one record's.
    ///
    /// # Errors
    /// [`Error::Format`], which names the file as `name`; [`Error::OutOfMemory`](crate::Error::OutOfMemory).
    pub fn new(head: &[u8], file_bytes: u64, sizes: RangeInclusive<u64>, name: &str) -> Result<FirstLane> {
        let wrong = |fault: FormatFault| Error::Format { path: name.into(), fault };
        let Head { header, table, .. } = Head::new(head, file_bytes).map_err(wrong)?;
        // Sections of kinds that this version does not know are left out, as nothing reads them.
        let is_wanted =
            |entry: &SectionEntry| entry.known_kind().is_some() && entry.lane_axis().is_none_or(|axis| axis == Axis::X);
        let old: Vec<SectionEntry> = table.iter().filter(|entry| is_wanted(entry)).copied().collect();
        let (bytes, new) = file_of(header, old.clone())?;
        // The lane is there, and its channels have the same number of records.
        Arena::new(&bytes).map_err(wrong)?;

        let place = |at: u64| usize::try_from(at).expect("it lies within the bytes");
        let is_channel = |entry: &SectionEntry| entry.known_kind().is_some_and(SectionKind::is_channel);
        // Elements `from..to` of a section.
        let range = |(old, new): (&SectionEntry, &SectionEntry), from: u64, to: u64| {
            let [from, to] = [from, to].map(|element| element * u64::from(old.element_bytes));
            (old.offset.get() + from..old.offset.get() + to, place(new.offset.get() + from))
        };
        let (channels, others): (Vec<_>, Vec<_>) = old.iter().zip(&new).partition(|(old, _)| is_channel(old));
        let elements = |entry: &SectionEntry| entry.bytes.get() / u64::from(entry.element_bytes.max(1));
        let first = others
            .iter()
            .map(|&(old, new)| (old.offset.get()..old.offset.get() + old.bytes.get(), place(new.offset.get())));
        let mut parts = vec![Part { ranges: joined(first), records: 0 }];
        let records = channels.first().map_or(0, |(old, _)| elements(old));
        let record_bytes: u64 = channels.iter().map(|(old, _)| u64::from(old.element_bytes)).sum();
        let (mut from, mut size) = (0, *sizes.start());
        while from < records {
            let to = records.min(from.saturating_add((size / record_bytes.max(1)).max(1)));
            parts.push(Part { ranges: joined(channels.iter().map(|&pair| range(pair, from, to))), records: to });
            (from, size) = (to, size.saturating_mul(2).min(*sizes.end()));
        }
        Ok(FirstLane { bytes, parts })
    }

    /// Returns a file with the tiles of `bytes`, a file with one lane of which the first `records` records have arrived, that
    /// have all their records; `None` if there is none yet.
    ///
    /// # Errors
    /// [`Error::Format`], which names the file as `name`; [`Error::OutOfMemory`](crate::Error::OutOfMemory).
    pub fn arrived(bytes: &[u8], records: u64, name: &str) -> Result<Option<Vec<u8>>> {
        let arena = Arena::new(bytes).map_err(|fault| Error::Format { path: name.into(), fault })?;
        let lane = arena.lane(Axis::X).expect("by R10 every arena that opens has the lane along x");
        let tiles = lane.tiles;
        // A tile ends where the next one begins.
        let whole = tiles.get(1..).unwrap_or_default().partition_point(|next| next.first_record.get() <= records);
        let Some(next) = tiles.get(whole).filter(|_| whole > 0) else { return Ok(None) };
        let [lines, records] = [u64::from(next.first_line.get()), next.first_record.get()];
        let kept = |entry: &SectionEntry| match entry.known_kind() {
            Some(SectionKind::Tiles) => whole as u64,
            Some(SectionKind::LineEnds) => lines,
            Some(kind) if kind.is_channel() => records,
            _ => u64::MAX,
        };
        let parts: Vec<&[u8]> = arena
            .sections()
            .iter()
            .map(|entry| {
                let all = arena.section_bytes(entry);
                let wanted = kept(entry).saturating_mul(entry.element_bytes.into());
                &all[..usize::try_from(wanted).map_or(all.len(), |wanted| wanted.min(all.len()))]
            })
            .collect();
        let entry = |(entry, part): (&SectionEntry, &&[u8])| SectionEntry {
            bytes: U64::new(part.len() as u64),
            xxh3: U64::new(xxh3_64(part)),
            ..*entry
        };
        let mut sections = arena.sections().iter().zip(&parts);
        let steps = sections.find(|(entry, _)| entry.known_kind() == Some(SectionKind::Steps));
        let visible = steps.map_or(0, |(_, steps)| steps.iter().filter(|&&step| step != 0).count());
        let (mut header, _) = FileHeader::read_from_prefix(bytes).expect("it was opened");
        header.visible_voxels = U64::new(visible as u64);
        let (mut file, table) = file_of(header, arena.sections().iter().zip(&parts).map(entry).collect())?;
        for (entry, part) in table.iter().zip(&parts) {
            let at = usize::try_from(entry.offset.get()).expect("it lies within the bytes");
            file[at..at + part.len()].copy_from_slice(part);
        }
        Ok(Some(file))
    }
}

/// Returns a file with these sections, whose offsets are given here and whose bytes are zeros, and its section table.
fn file_of(mut header: FileHeader, mut table: Vec<SectionEntry>) -> Result<(Vec<u8>, Vec<SectionEntry>)> {
    let mut end = aligned((size_of::<FileHeader>() + size_of_val(&table[..])) as u64);
    for entry in &mut table {
        entry.offset = U64::new(end);
        end = aligned(end + entry.bytes.get());
    }
    header.section_count = U32::new(u32::try_from(table.len()).expect("at most as many as there were"));
    header.file_bytes = U64::new(end);
    header.header_xxh3 = U64::new(header_checksum(&header, &table));
    let refused = || Error::out_of_memory("a file's first lane", end);
    let len = usize::try_from(end).map_err(|_| refused())?;
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(len).map_err(|_| refused())?;
    bytes.resize(len, 0);
    let start = [header.as_bytes(), table.as_bytes()].concat();
    bytes[..start.len()].copy_from_slice(&start);
    Ok((bytes, table))
}

/// Joins ranges that follow one another, with only padding between them, at both places.
fn joined(ranges: impl Iterator<Item = (Range<u64>, usize)>) -> Vec<(Range<u64>, usize)> {
    let mut joined: Vec<(Range<u64>, usize)> = Vec::new();
    for (range, at) in ranges {
        match joined.last_mut() {
            Some((last, to)) if aligned(last.end) == range.start && (at - *to) as u64 == range.start - last.start => {
                last.end = range.end;
            }
            _ => joined.push((range, at)),
        }
    }
    joined
}
