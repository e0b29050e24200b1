//! The directory of a file on a server: all of it but the channels, which a graphics device can hold alone.
//!
//! In: the beginning of an `.adj` file, and those of its levels of detail, then the bytes that the directory asks for. Out: an
//! arena with header, description, tiles and line ends, and one for each level; which bytes of the file are the channels of a
//! lane, in parts; and checks of what was fetched.

use std::mem::size_of;
use std::ops::{Range, RangeInclusive};

use xxhash_rust::xxh3::{Xxh3, xxh3_64};
use zerocopy::byteorder::little_endian::{U32, U64};
use zerocopy::{FromBytes as _, IntoBytes as _};

use super::codes::CodeCounts;
use super::lane::Elsewhere;
use super::layout::{Facts, FileHeader, MAX_SECTIONS, SectionEntry, SectionKind, aligned, header_checksum};
use super::open::{Arena, Head, level_head, sections_within};
use crate::error::{Error, FormatFault, Result};
use crate::limits::Limits;
use crate::volume::Axis;

/// What a file holds beside the channels of its lanes, and where these lie in the file.
#[derive(Debug, Clone)]
pub struct Directory {
    /// An `.adj` file without channels, as far as it has arrived.
    bytes: Vec<u8>,
    whole: u64,
    runs: Vec<SectionRun>,
    facts: Facts,
    channels: [Option<[Channel; 5]>; 3],
    /// Where the levels lie in the file, level 1 first.
    level_places: Vec<Range<u64>>,
    /// The directories of the levels, level 1 first; they have no levels themselves.
    levels: Vec<Directory>,
}

/// Neighbouring sections: where they lie in the file, and from where on in the directory.
#[derive(Debug, Clone)]
struct SectionRun {
    range: Range<u64>,
    at: u64,
}

/// Where a channel lies in the file; the length is 0 if it is not stored.
#[derive(Debug, Clone, Copy, Default)]
struct Channel {
    offset: u64,
    bytes: u64,
    width: u64,
    xxh3: u64,
}

/// Some neighbouring records of a lane.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LanePart {
    /// The index of the first record: a multiple of 4.
    pub first: u64,
    /// The bytes of the file with their steps, values, normals, magnitudes and coverages; empty for channels that are not stored.
    pub ranges: [Range<u64>; 5],
}

impl Directory {
    /// This many bytes from the beginning of a file, or all of a shorter file, are enough for [`Directory::new`].
    pub const HEAD: u64 = (size_of::<FileHeader>() + MAX_SECTIONS as usize * size_of::<SectionEntry>()) as u64;

    /// Reads `head`, the first [`Directory::HEAD`] bytes of a file of `file_bytes` bytes. Allocates no more than they take.
    ///
    /// # Errors
    /// [`Error::Format`] and [`Error::Limit`], which name the file as `name`.
    pub fn new(head: &[u8], file_bytes: u64, limits: &Limits, name: &str) -> Result<Directory> {
        Directory::with(head, file_bytes, limits, name, is_of_directory)
    }

    /// The same for a directory of the lane along x alone, together with its channels: once it has arrived it is a file from
    /// which the other lanes can be derived, [`Directory::into_bytes`].
    ///
    /// # Errors
    /// The errors of [`Directory::new`].
    pub fn first_lane(head: &[u8], file_bytes: u64, limits: &Limits, name: &str) -> Result<Directory> {
        let is_of_lane = |entry: &SectionEntry| entry.lane_axis().is_none_or(|axis| axis == Axis::X);
        // Limits are those of levels, which such a file has not.
        let is_kept = |entry: &SectionEntry| {
            entry.known_kind().is_some_and(|kind| kind != SectionKind::LevelLimits) && is_of_lane(entry)
        };
        Directory::with(head, file_bytes, limits, name, is_kept)
    }

    fn with(
        head: &[u8],
        file_bytes: u64,
        limits: &Limits,
        name: &str,
        is_kept: impl Fn(&SectionEntry) -> bool,
    ) -> Result<Directory> {
        let wrong = |fault: FormatFault| Error::Format { path: name.into(), fault };
        let head = Head::new(head, file_bytes).map_err(wrong)?;
        sections_within(&head.facts, head.table, file_bytes, name.as_ref(), limits)?;
        Ok(Directory::of(&head, 0, is_kept))
    }

    /// Returns the directory of a file, or of a level that begins at byte `start` of the file, with the sections that are kept.
    fn of(head: &Head, start: u64, is_kept: impl Fn(&SectionEntry) -> bool) -> Directory {
        let channels = Axis::ALL.map(|axis| {
            let places = head.lane(axis).ok().flatten()?;
            let channel = |place: Option<usize>| {
                place.map_or(Channel::default(), |index| {
                    let SectionEntry { offset, bytes, element_bytes, xxh3, .. } = head.table[index];
                    let offset = start + offset.get();
                    Channel { offset, bytes: bytes.get(), width: element_bytes.into(), xxh3: xxh3.get() }
                })
            };
            let [_, _, channels @ ..] = places.map(channel);
            Some(channels)
        });
        let old: Vec<SectionEntry> = head.table.iter().filter(|entry| is_kept(entry)).copied().collect();
        let mut table = old.clone();
        let mut whole = aligned((size_of::<FileHeader>() + size_of_val(&table[..])) as u64);
        for entry in &mut table {
            entry.offset = U64::new(whole);
            whole = aligned(whole + entry.bytes.get());
        }
        let mut header = head.header;
        header.section_count = U32::new(u32::try_from(table.len()).expect("at most as many as there were"));
        header.file_bytes = U64::new(whole);
        header.header_xxh3 = U64::new(header_checksum(&header, &table));
        let runs = joined(old.iter().zip(&table).map(|(old, new)| {
            let place = old.place();
            SectionRun { range: start + place.start..start + place.end, at: new.offset.get() }
        }));
        let levels = head.table.iter().rev().filter(|entry| entry.level().is_some());
        let mut directory = Directory {
            bytes: [header.as_bytes(), table.as_bytes()].concat(),
            whole,
            runs,
            facts: head.facts.clone(),
            channels,
            level_places: levels.map(SectionEntry::place).collect(),
            levels: Vec::new(),
        };
        directory.pad();
        directory
    }

    /// Returns where the beginnings of the file's levels of detail lie, level 1 first.
    pub fn level_heads(&self) -> Vec<Range<u64>> {
        let head = |place: &Range<u64>| place.start..place.end.min(place.start.saturating_add(Directory::HEAD));
        self.level_places.iter().map(head).collect()
    }

    /// Takes the bytes at [`Directory::level_heads`]; until then the directory has no levels. Allocates no more than these bytes.
    ///
    /// # Errors
    /// [`Error::Format`] and [`Error::Limit`], which name the file as `name`. Then the directory has no levels.
    pub fn add_levels(&mut self, heads: &[Vec<u8>], limits: &Limits, name: &str) -> Result<()> {
        let wrong = |fault: FormatFault| Error::Format { path: name.into(), fault };
        let lanes = self.channels.map(|lane| lane.is_some());
        let (mut below, mut levels) = (self.facts.clone(), Vec::new());
        for (index, place) in self.level_places.iter().enumerate() {
            let bytes = heads.get(index).map_or(&[][..], |head| head);
            let head = level_head(bytes, place, &below, lanes).map_err(wrong)?;
            sections_within(&head.facts, head.table, place.end - place.start, name.as_ref(), limits)?;
            levels.push(Directory::of(&head, place.start, is_of_directory));
            below = head.facts;
        }
        self.levels = levels;
        Ok(())
    }

    /// Returns the number of coarser levels of detail that the directory has.
    pub fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// Returns the directory of a level; that of level 0 is the file's own. `None` if it has no such level.
    pub fn level(&self, level: usize) -> Option<&Directory> {
        level.checked_sub(1).map_or(Some(self), |below| self.levels.get(below))
    }

    /// Iterates over this directory and those of the levels, coarsest first.
    fn all(&self) -> impl Iterator<Item = &Directory> {
        self.levels.iter().rev().chain([self])
    }

    /// Returns the next bytes of the file that the directory lacks, those of coarse levels first: ranges with at most `most` bytes
    /// together. Empty once it is complete.
    pub fn wanted(&self, most: u64) -> Vec<Range<u64>> {
        let (mut left, mut wanted) = (most, Vec::new());
        for range in self.all().flat_map(Directory::lacking) {
            if left == 0 {
                break;
            }
            let end = range.end.min(range.start.saturating_add(left));
            left -= end - range.start;
            wanted.push(range.start..end);
        }
        wanted
    }

    /// Iterates over the bytes of the file that this directory lacks, without those of levels.
    fn lacking(&self) -> impl Iterator<Item = Range<u64>> {
        let have = self.bytes.len() as u64;
        let lacking = move |SectionRun { range, at }: &SectionRun| range.start + have.saturating_sub(*at)..range.end;
        self.runs.iter().map(lacking).filter(|range| range.start < range.end)
    }

    /// Returns the bytes that have arrived and those that the directory has in the end.
    pub fn progress(&self) -> [u64; 2] {
        self.all()
            .fold([0; 2], |[done, whole], directory| [done + directory.bytes.len() as u64, whole + directory.whole])
    }

    fn next_run(&self) -> Option<&SectionRun> {
        let have = self.bytes.len() as u64;
        self.runs.iter().find(|run| have < run.at + (run.range.end - run.range.start))
    }

    /// Takes the bytes of the first range that is [wanted](Directory::wanted), or the first of them.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        match self.levels.iter_mut().rev().find(|level| level.next_run().is_some()) {
            Some(level) => level.take(bytes),
            None => self.take(bytes),
        }
    }

    fn take(&mut self, bytes: &[u8]) -> Result<()> {
        let at = self.next_run().map_or(0, |run| run.at);
        let start = usize::try_from(at).unwrap_or(usize::MAX).max(self.bytes.len());
        let need = (start - self.bytes.len()).saturating_add(bytes.len());
        let refused = |_| Error::out_of_memory("a file's directory", need as u64);
        self.bytes.try_reserve(need).map_err(refused)?;
        self.bytes.resize(start, 0);
        self.bytes.extend_from_slice(bytes);
        self.pad();
        Ok(())
    }

    /// Adds what follows the last run, if all runs have arrived: padding, in which empty sections may lie.
    fn pad(&mut self) {
        if self.next_run().is_none() {
            self.bytes.resize(usize::try_from(self.whole).unwrap_or(usize::MAX).max(self.bytes.len()), 0);
        }
    }

    /// Checks that every section has the content that the header says.
    ///
    /// # Errors
    /// [`Error::Input`], which names the file as `name`.
    pub fn check(&self, name: &str) -> Result<()> {
        let codes = CodeCounts::default();
        let is_sound = |directory: &Directory| {
            let arena = directory.arena(&codes);
            let is_sound = |entry: &SectionEntry| xxh3_64(arena.section_bytes(entry)) == entry.xxh3.get();
            directory.next_run().is_none() && arena.sections().iter().all(is_sound)
        };
        if self.all().all(is_sound) { Ok(()) } else { Err(changed(name)) }
    }

    /// Returns the bytes of an `.adj` file without levels, once they have arrived: of its first lane if the directory has that, else one
    /// without channels.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Returns whether the file stores the lane along `axis`.
    pub fn has_lane(&self, axis: Axis) -> bool {
        self.channels[axis.index()].is_some()
    }

    /// Returns the number of records in the lane along `axis`; 0 if the file does not store it.
    pub fn records(&self, axis: Axis) -> u64 {
        self.channels[axis.index()].map_or(0, |[steps, ..]| steps.bytes)
    }

    /// Returns the number of bytes of the channels of the lane along `axis`.
    pub fn channel_bytes(&self, axis: Axis) -> u64 {
        self.channels[axis.index()].map_or(0, |channels| channels.iter().map(|channel| channel.bytes).sum())
    }

    /// Cuts the channels of the lane along `axis` into parts. The first has about `sizes.start()` bytes, each other one twice
    /// as many as the one before, up to `sizes.end()`; at least those of four records.
    pub fn parts(&self, axis: Axis, sizes: RangeInclusive<u64>) -> Vec<LanePart> {
        let channels = self.channels[axis.index()].unwrap_or_default();
        let record_bytes: u64 = channels.iter().map(|channel| channel.width).sum();
        let (mut parts, mut first, mut size) = (Vec::new(), 0, *sizes.start());
        while first < self.records(axis) {
            let count = (size / record_bytes).next_multiple_of(4).max(4);
            let end = self.records(axis).min(first.saturating_add(count));
            let range = |channel: Channel| {
                let at = |record: u64| channel.offset + record * channel.width;
                if channel.width == 0 { 0..0 } else { at(first)..at(end) }
            };
            parts.push(LanePart { first, ranges: channels.map(range) });
            (first, size) = (end, size.saturating_mul(2).min(*sizes.end()));
        }
        parts
    }

    /// Returns a check of the channels of the lane along `axis`, which arrive in parts.
    pub fn channel_check(&self, axis: Axis) -> ChannelCheck {
        let stored = self.channels[axis.index()].unwrap_or_default();
        let wanted = stored.map(|channel| (channel.width > 0).then_some(channel.xxh3));
        ChannelCheck { hashes: [const { Xxh3::new() }; 5], wanted }
    }

    /// Returns the arena, without levels: its lanes have tiles and line ends, but no channels; `codes` counts what these hold.
    pub(crate) fn arena<'a>(&'a self, codes: &'a CodeCounts) -> Arena<'a> {
        let (header, after) = FileHeader::ref_from_prefix(&self.bytes).expect("it was written by `new`");
        let count = header.section_count.get() as usize;
        let (table, _) = <[SectionEntry]>::ref_from_prefix_with_elems(after, count).expect("it was written by `new`");
        let elsewhere = self.channels.map(|lane| lane.map(|[steps, ..]| Elsewhere { records: steps.bytes, codes }));
        Arena::of_directory(&self.bytes, self.facts.clone(), table, header.header_xxh3.get(), elsewhere)
    }
}

/// Returns whether a directory holds the bytes of a section. Those of kinds that this version does not know are left out, as
/// nothing reads them.
fn is_of_directory(entry: &SectionEntry) -> bool {
    entry.known_kind().is_some_and(|kind| !kind.is_channel())
}

/// Checks channels whose bytes arrive in parts.
pub struct ChannelCheck {
    hashes: [Xxh3; 5],
    /// Of the channels that are stored.
    wanted: [Option<u64>; 5],
}

impl ChannelCheck {
    /// Takes the steps, values, normals, magnitudes and coverages of the next part.
    pub fn add(&mut self, channels: [&[u8]; 5]) {
        self.hashes.iter_mut().zip(channels).for_each(|(hash, bytes)| hash.update(bytes));
    }

    /// Checks that all channels have the content that the header says.
    ///
    /// # Errors
    /// [`Error::Input`], which names the file as `name`.
    pub fn finish(&self, name: &str) -> Result<()> {
        let is_sound = |(hash, wanted): (&Xxh3, &Option<u64>)| wanted.is_none_or(|wanted| hash.digest() == wanted);
        if self.hashes.iter().zip(&self.wanted).all(is_sound) { Ok(()) } else { Err(changed(name)) }
    }
}

fn changed(name: &str) -> Error {
    Error::input(name, "is damaged, or changed while it was fetched; load it again, or run adj verify on the file")
}

/// Joins runs that follow one another, with only padding between them, at both places. Leaves out empty ones.
fn joined(runs: impl Iterator<Item = SectionRun>) -> Vec<SectionRun> {
    let mut joined: Vec<SectionRun> = Vec::new();
    for run in runs.filter(|run| !run.range.is_empty()) {
        match joined.last_mut() {
            Some(last)
                if aligned(last.range.end) == run.range.start
                    && run.at - last.at == run.range.start - last.range.start =>
            {
                last.range.end = run.range.end;
            }
            _ => joined.push(run),
        }
    }
    joined
}
