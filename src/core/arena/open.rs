//! Opening an arena: typed views of the bytes of an `.adj` file.
//!
//! In: any bytes. Out: lanes that borrow them, after checking rules R1 to R11 of `formats/adj-1.md`. Nothing is copied
//! or allocated.
//!
//! Walks rely on these checks: all channels have the same number of records, and counts bound each other. The content
//! of sections is not read. Any arena that opens is safe to walk; [`Arena::check`] tells whether its content is valid.

use std::mem::{offset_of, size_of};
use std::ops::Range;
use std::path::Path;

use zerocopy::FromBytes;
use zerocopy::byteorder::little_endian::F64;

use super::curve::TileOrder;
use super::lane::{Elsewhere, Lane, LineEnds};
use super::layout::{
    ALIGNMENT, COHERENT_MINOR, Channels, Facts, FileHeader, LevelLimits, MAGIC, MAJOR, MAX_SECTIONS, OPTIONAL_KINDS,
    Scales, SectionEntry, SectionKind, TILE_EDGE, TileRecord, aligned, header_checksum,
};
use super::levels::level_facts;
use super::pager::{Pager, tell};
use crate::error::{Error, FormatFault};
use crate::limits::Limits;
use crate::volume::{Axis, Grid};

/// Gives access to the bytes of an open `.adj` file: header facts, sections and lanes, without copies.
#[derive(Debug, Clone)]
pub struct Arena<'a> {
    bytes: &'a [u8],
    facts: Facts,
    fingerprint: u64,
    sections: &'a [SectionEntry],
    lanes: [Option<Lane<'a>>; 3],
    pub(crate) pager: Option<&'a dyn Pager>,
}

/// Creates the [`FormatFault`] for a file that breaks `rule` at byte `at`.
pub(super) fn fault(
    at: u64,
    rule: &'static str,
    expected: impl Into<String>,
    got: impl std::fmt::Display,
) -> FormatFault {
    FormatFault { at, rule, expected: expected.into(), got: got.to_string() }
}

/// Returns the byte offset in the file of a field of the header, or of a field of entry `index` of the section table.
macro_rules! at {
    (header.$field:ident) => {
        offset_of!(FileHeader, $field) as u64
    };
    (entry[$index:expr].$field:ident) => {
        (size_of::<FileHeader>() + $index * size_of::<SectionEntry>() + offset_of!(SectionEntry, $field)) as u64
    };
}

/// What stands at the beginning of a file.
pub(super) struct Head<'a> {
    pub(super) header: FileHeader,
    pub(super) table: &'a [SectionEntry],
    pub(super) facts: Facts,
    checksum: u64,
}

/// The indices in the section table of a lane's sections, in the order of [`SectionKind::OF_LANES`].
pub(super) type LanePlaces = [Option<usize>; 7];

impl<'a> Head<'a> {
    /// Reads and checks the beginning, `bytes`, of a file of `len` bytes. R1 to R11.
    pub(super) fn new(bytes: &'a [u8], len: u64) -> Result<Head<'a>, FormatFault> {
        let magic = bytes.get(..MAGIC.len()).unwrap_or(bytes);
        if magic != MAGIC {
            return Err(fault(0, "R1", "the first bytes of an .adj file", format!("{magic:02x?}")));
        }
        let Ok((header, after)) = FileHeader::read_from_prefix(bytes) else {
            let got = format!("{} bytes: the file was cut; rebuild or copy it again", bytes.len());
            return Err(fault(bytes.len() as u64, "R4", "a header of 256 bytes", got));
        };
        if header.major.get() != MAJOR {
            let expected = format!("major version {MAJOR}: update adjsplat, or rebuild the file with this version");
            return Err(fault(at!(header.major), "R2", expected, format!("version {}", header.major)));
        }
        if header.file_bytes.get() != len {
            let expected = format!("{} bytes, as the header says", header.file_bytes);
            let got = format!("{len} bytes: the file was cut or grew; rebuild or copy it again");
            return Err(fault(at!(header.file_bytes), "R4", expected, got));
        }
        let count = header.section_count.get();
        if count > MAX_SECTIONS {
            return Err(fault(at!(header.section_count), "R5", format!("at most {MAX_SECTIONS} sections"), count));
        }
        let Ok((table, _)) = <[SectionEntry]>::ref_from_prefix_with_elems(after, count as usize) else {
            let expected = format!("a table of {count} sections");
            return Err(fault(at!(header.section_count), "R5", expected, "the end of the file"));
        };
        let checksum = header_checksum(&header, table);
        if checksum != header.header_xxh3.get() {
            let got = format!("{:#018x}: the header is damaged; rebuild or copy the file again", header.header_xxh3);
            return Err(fault(at!(header.header_xxh3), "R3", format!("checksum {checksum:#018x}"), got));
        }
        let mut facts = facts_of(&header)?;
        if let Some(entry) = table.iter().find(|entry| entry.known_kind() == Some(SectionKind::Coverage)) {
            facts.channels.coverage_bits = if entry.element_bytes == 2 { 16 } else { 8 };
            facts.channels.coherence = header.minor.get() >= COHERENT_MINOR && facts.channels.normal_bits > 0;
        }
        check_table(table, len, &facts)?;
        let head = Head { header, table, facts, checksum };
        for axis in Axis::ALL {
            head.lane(axis)?;
        }
        let stored = head.stored();
        if !stored.is_sorted_by_key(|&stored| !stored) || !stored[0] {
            let names = Axis::ALL.into_iter().filter(|axis| stored[axis.index()]).map(Axis::name);
            let got = format!("lanes '{}'", names.collect::<String>());
            return Err(fault(size_of::<FileHeader>() as u64, "R10", "lanes x, xy or xyz", got));
        }
        Ok(head)
    }

    /// Returns for each axis whether the lane along it is stored.
    pub(super) fn stored(&self) -> [bool; 3] {
        Axis::ALL.map(|axis| self.lane(axis).ok().flatten().is_some())
    }

    /// Returns the places of the sections of the lane along `axis`, or `None` if it is not stored. Checks R10 and R11.
    pub(super) fn lane(&self, axis: Axis) -> Result<Option<LanePlaces>, FormatFault> {
        let (channels, dims) = (self.facts.channels, self.facts.grid.dims);
        let is_of = |kind: SectionKind| {
            move |entry: &SectionEntry| entry.kind.get() == kind as u16 && entry.lane_axis() == Some(axis)
        };
        let places = SectionKind::OF_LANES.map(|kind| self.table.iter().position(is_of(kind)));
        if places.iter().all(Option::is_none) {
            return Ok(None);
        }
        let is_needed = |kind: SectionKind| kind.element_bytes(channels, dims, axis) > 0;
        let mut named = SectionKind::OF_LANES.into_iter().zip(places);
        if let Some((kind, _)) = named.find(|(kind, place)| place.is_none() && is_needed(*kind)) {
            let expected = format!("{} in lane {}", kind.name(), axis.name());
            return Err(fault(size_of::<FileHeader>() as u64, "R10", expected, "no such section"));
        }
        let elements = |place: Option<usize>| {
            place.map_or(0, |index| self.table[index].bytes.get() / u64::from(self.table[index].element_bytes))
        };
        let [tile_count, line_count, records, ..] = places.map(elements);
        let [u, v] = axis.others().map(|other| u64::from(dims[other.index()]));
        let edge = u64::from(TILE_EDGE);
        let most_lines = (u * v).min(tile_count.saturating_mul(edge * edge));
        let most_records = line_count.saturating_mul(dims[axis.index()].into());
        let counts = [
            (0, u.div_ceil(edge) * v.div_ceil(edge)),
            (tile_count, most_lines),
            (line_count.max(self.facts.visible_voxels), most_records),
            (records, records),
            (records, records),
            (records, records),
            (records, records),
        ];
        for ((kind, place), (least, most)) in SectionKind::OF_LANES.into_iter().zip(places).zip(counts) {
            let (Some(index), count) = (place, elements(place)) else { continue };
            if count < least || count > most {
                let expected = format!("{least} to {most} {} in lane {}", kind.name(), axis.name());
                return Err(fault(at!(entry[index].bytes), "R11", expected, count));
            }
        }
        if self.facts.visible_voxels < line_count {
            let expected = format!("at least one on each of the {line_count} lines of lane {}", axis.name());
            let got = format!("{} visible voxels", self.facts.visible_voxels);
            return Err(fault(at!(header.visible_voxels), "R11", expected, got));
        }
        Ok(Some(places))
    }
}

impl<'a> Arena<'a> {
    /// Opens an arena: checks header, section table and the bounds of sections, in O(number of sections).
    ///
    /// The content of sections is not checked, but for the headers of levels. Walks are safe on any content;
    /// [`Arena::check`] tells if it is valid.
    ///
    /// # Errors
    /// The first broken rule of `formats/adj-1.md` among R1 to R11, R23, R24 and R27.
    pub fn new(bytes: &'a [u8]) -> Result<Arena<'a>, FormatFault> {
        let head = Head::new(bytes, bytes.len() as u64)?;
        check_levels(bytes, &head)?;
        let lanes = Axis::ALL.map(|axis| head.lane(axis).ok().flatten().map(|places| (axis, places)));
        let Head { table, facts, checksum, .. } = head;
        let mut arena = Arena { bytes, facts, fingerprint: checksum, sections: table, lanes: [None; 3], pager: None };
        for (axis, places) in lanes.into_iter().flatten() {
            arena.lanes[axis.index()] = Some(arena.lane_of(axis, places));
        }
        Ok(arena)
    }

    /// Returns the arena of a file without its channels, of which `elsewhere` tells lane by lane.
    pub(super) fn of_directory(
        bytes: &'a [u8],
        facts: Facts,
        sections: &'a [SectionEntry],
        fingerprint: u64,
        elsewhere: [Option<Elsewhere<'a>>; 3],
    ) -> Arena<'a> {
        let mut arena = Arena { bytes, facts, fingerprint, sections, lanes: [None; 3], pager: None };
        for (axis, elsewhere) in Axis::ALL.into_iter().zip(elsewhere).filter(|(_, lane)| lane.is_some()) {
            let places = SectionKind::OF_LANES.map(|kind| arena.place(kind, Some(axis)));
            arena.lanes[axis.index()] = Some(Lane { elsewhere, ..arena.lane_of(axis, places) });
        }
        arena
    }

    /// Refuses an arena that exceeds `limits`; `path` is used in the message.
    ///
    /// # Errors
    /// [`Error::Limit`] that names the file and the size that is too large.
    pub fn within(&self, path: &Path, limits: &Limits) -> Result<(), Error> {
        sections_within(&self.facts, self.sections, self.bytes.len() as u64, path, limits)?;
        (1..=self.level_count()).filter_map(|level| self.level(level)).try_for_each(|level| level.within(path, limits))
    }

    /// Returns the number of coarser levels of detail that the file holds.
    ///
    /// Of a file whose [`Directory`](super::Directory) alone is there it is 0.
    pub fn level_count(&self) -> u8 {
        self.sections.iter().filter_map(SectionEntry::level).max().unwrap_or(0)
    }

    /// Returns level `level` of the file: 0 is the arena itself, 1 to [`Arena::level_count`] are coarser and coarser. `None` if
    /// the file does not hold it.
    ///
    /// Levels are of the voxels that the file stores. An [`Overlay`](super::Overlay) does not change them: while there are
    /// edits, they show what was there before.
    pub fn level(&self, level: u8) -> Option<Arena<'a>> {
        if level == 0 {
            return Some(self.clone());
        }
        let arena = Arena::new(self.section_bytes(self.level_section(level)?)).ok()?;
        Some(match self.pager {
            Some(pager) => arena.with_pager(pager),
            None => arena,
        })
    }

    /// Returns the limits of the levels, level 1 first; none if the file does not say them.
    pub fn level_limits(&self) -> &'a [LevelLimits] {
        let limits = self.section(SectionKind::LevelLimits, None).map_or(&[][..], |s| self.section_bytes(s));
        tell(self.pager, || limits);
        <[LevelLimits]>::ref_from_bytes(limits).unwrap_or_default()
    }

    /// Returns the section of a level above 0.
    pub(super) fn level_section(&self, level: u8) -> Option<&'a SectionEntry> {
        self.sections.iter().find(|section| section.level() == Some(level))
    }

    /// Returns the arena with a `pager`, which is told which parts of the arena are about to be read.
    pub fn with_pager(mut self, pager: &'a dyn Pager) -> Arena<'a> {
        self.pager = Some(pager);
        self.lanes.iter_mut().flatten().for_each(|lane| lane.pager = Some(pager));
        self
    }

    /// Returns the contents of the header: grid, channels, tile order, scales and voxel count.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Returns the XXH3-64 of header and section table, which includes the sections' checksums.
    ///
    /// Files that pass [`Arena::check`] and differ in content have different fingerprints.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// Returns the lane along `axis`, if the file stores it.
    pub fn lane(&self, axis: Axis) -> Option<Lane<'a>> {
        self.lanes[axis.index()]
    }

    /// Returns the lane along x, which every arena that opens has.
    pub fn x_lane(&self) -> Lane<'a> {
        self.lane(Axis::X).expect("rule R10 of the format was checked")
    }

    /// Iterates over the stored lanes, x first.
    pub fn lanes(&self) -> impl Iterator<Item = Lane<'a>> + '_ {
        self.lanes.iter().flatten().copied()
    }

    /// Returns all sections, in file order.
    pub fn sections(&self) -> &'a [SectionEntry] {
        self.sections
    }

    /// Returns the section of `kind` that belongs to the lane along `axis`, or to no lane; `None` if it is missing.
    pub fn section(&self, kind: SectionKind, axis: Option<Axis>) -> Option<&'a SectionEntry> {
        self.place(kind, axis).map(|index| &self.sections[index])
    }

    /// Returns the index of a section in the section table.
    fn place(&self, kind: SectionKind, axis: Option<Axis>) -> Option<usize> {
        self.sections.iter().position(|entry| entry.kind.get() == kind as u16 && entry.lane_axis() == axis)
    }

    /// Returns the bytes of one of this arena's sections.
    pub fn section_bytes(&self, section: &SectionEntry) -> &'a [u8] {
        // Bounds were checked by `check_table`; a section of another arena may yield nothing.
        let offset = section.offset.get();
        let to = offset.checked_add(section.bytes.get());
        let range = usize::try_from(offset).ok().zip(to.and_then(|to| usize::try_from(to).ok()));
        range.and_then(|(from, to)| self.bytes.get(from..to)).unwrap_or_default()
    }

    /// Returns all bytes of the file.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// Returns the description, a JSON text; empty if there is none.
    pub fn description(&self) -> &'a [u8] {
        let description = self.section(SectionKind::Description, None).map_or(&[][..], |s| self.section_bytes(s));
        tell(self.pager, || description);
        description
    }

    /// Returns the lane along `axis`, whose sections are at `places`, as views of them.
    fn lane_of(&self, axis: Axis, places: LanePlaces) -> Lane<'a> {
        let (channels, dims) = (self.facts.channels, self.facts.grid.dims);
        let [tiles, line_ends, steps, values, normals, magnitudes, coverages] =
            places.map(|place| place.map_or(&[][..], |index| self.section_bytes(&self.sections[index])));
        let tiles = <[TileRecord]>::ref_from_bytes(tiles).expect("R11 holds: a multiple of a tile's 28 bytes");
        let line_ends = LineEnds::new(line_ends, dims[axis.index()]);
        let (elsewhere, patch, shown, omitted, pager) = (None, None, None, None, None);
        Lane {
            axis,
            dims,
            channels,
            tiles,
            line_ends,
            steps,
            values,
            normals,
            magnitudes,
            coverages,
            elsewhere,
            patch,
            shown,
            omitted,
            pager,
        }
    }
}

/// Refuses a file of `file_bytes` bytes that exceeds `limits`; `path` is used in the message.
pub(super) fn sections_within(
    facts: &Facts,
    sections: &[SectionEntry],
    file_bytes: u64,
    path: &Path,
    limits: &Limits,
) -> Result<(), Error> {
    limits.check(path, "file bytes", file_bytes, limits.file_bytes)?;
    limits.check_grid(path, &facts.grid.dims.map(u64::from))?;
    limits.check(path, "sections", sections.len() as u64, limits.sections.into())?;
    for section in sections {
        limits.check(path, "bytes in a section", section.bytes.get(), limits.section_bytes)?;
    }
    let is_description = |section: &&SectionEntry| section.known_kind() == Some(SectionKind::Description);
    let description = sections.iter().find(is_description).map_or(0, |section| section.bytes.get());
    limits.check(path, "bytes of description", description, limits.description_bytes)
}

/// Reads and checks the header's fields. R6 to R9.
fn facts_of(header: &FileHeader) -> Result<Facts, FormatFault> {
    let triple = |v: [F64; 3]| v.map(F64::get);
    let grid = Grid {
        dims: header.dims.map(|d| u32::from(d.get())),
        spacing: triple(header.spacing),
        origin: triple(header.origin),
        direction: header.direction.map(triple),
        unit: None,
    };
    grid.check().map_err(|error| fault(at!(header.dims), "R6", "a sound grid", error))?;
    let channels = Channels {
        value_bits: header.value_bits,
        normal_bits: header.normal_bits,
        magnitude_bits: header.magnitude_bits,
        coverage_bits: 0,
        coherence: false,
    };
    let allowed: [(u8, &[u8], u64); 3] = [
        (channels.value_bits, &[8, 16], at!(header.value_bits)),
        (channels.normal_bits, &[0, 8, 16], at!(header.normal_bits)),
        (channels.magnitude_bits, &[0, 8], at!(header.magnitude_bits)),
    ];
    for (bits, choices, at) in allowed {
        if !choices.contains(&bits) {
            return Err(fault(at, "R7", format!("one of {choices:?} bits"), bits));
        }
    }
    let Some(tile_order) = TileOrder::from_code(header.tile_order) else {
        return Err(fault(at!(header.tile_order), "R7", "tile order 0, 1 or 2", header.tile_order));
    };
    zeros_from(at!(header.reserved_0), "R8", &header.reserved_0)?;
    zeros_from(at!(header.reserved_1), "R8", &header.reserved_1)?;
    let scales = Scales {
        value_low: header.value_low.get(),
        value_step: header.value_step.get(),
        magnitude_scale: header.magnitude_scale.get(),
    };
    let of_scales = [
        (scales.value_low, f64::MIN, at!(header.value_low)),
        (scales.value_step, 0.0, at!(header.value_step)),
        (scales.magnitude_scale, 0.0, at!(header.magnitude_scale)),
    ];
    for (number, least, at) in of_scales {
        if !(number.is_finite() && number >= least) {
            return Err(fault(at, "R9", "a finite number, 0 or above for a step or scale", number));
        }
    }
    Ok(Facts { grid, channels, tile_order, scales, visible_voxels: header.visible_voxels.get() })
}

/// Checks the section table. R5, R8, R10, R11.
fn check_table(table: &[SectionEntry], file_bytes: u64, facts: &Facts) -> Result<(), FormatFault> {
    let mut next = aligned((size_of::<FileHeader>() + size_of_val(table)) as u64);
    let mut last_level = None;
    for (index, entry) in table.iter().enumerate() {
        let (kind, axis) = (entry.known_kind(), entry.lane_axis());
        if kind.is_none() && entry.kind.get() < OPTIONAL_KINDS {
            return Err(fault(at!(entry[index].kind), "R10", "a known section kind: update adjsplat", entry.kind));
        }
        let fits = match kind {
            Some(kind) if SectionKind::OF_FILE.contains(&kind) => entry.axis == 255,
            Some(_) => axis.is_some(),
            None if entry.level().is_some() => entry.axis == 255,
            None => axis.is_some() || entry.axis == 255,
        };
        if !fits {
            let expected = "axis 0, 1 or 2 for a lane's section, 255 for another";
            return Err(fault(at!(entry[index].axis), "R10", expected, entry.axis));
        }
        let is_same = |earlier: &SectionEntry| earlier.kind == entry.kind && earlier.axis == entry.axis;
        if let Some(kind) = kind.filter(|_| table[..index].iter().any(is_same)) {
            let owner = axis.map_or("the file".to_owned(), |axis| format!("lane {}", axis.name()));
            let expected = format!("one section of {} in {owner}", kind.name());
            return Err(fault(at!(entry[index].kind), "R10", expected, "a second one"));
        }
        if let Some(level) = entry.level() {
            if last_level.is_some_and(|(last, _)| level != last - 1) {
                let expected = "levels by falling number, one after the other";
                return Err(fault(at!(entry[index].kind), "R23", expected, format!("level {level}")));
            }
            if table[..index].iter().any(|earlier| earlier.lane_axis().is_some()) {
                return Err(fault(at!(entry[index].kind), "R23", "levels before lanes", format!("level {level}")));
            }
            last_level = Some((level, index));
        }
        zeros_from(at!(entry[index].reserved), "R8", &entry.reserved.get().to_le_bytes())?;
        let (offset, bytes) = (entry.offset.get(), entry.bytes.get());
        if offset != next {
            let expected = format!("a section at {next}, the first multiple of 256 after what lies before");
            return Err(fault(at!(entry[index].offset), "R5", expected, offset));
        }
        let end = offset.checked_add(bytes).filter(|&end| end <= file_bytes.min(u64::MAX - ALIGNMENT));
        let Some(end) = end else {
            let expected = format!("a section of at most {} bytes", file_bytes.saturating_sub(offset));
            return Err(fault(at!(entry[index].bytes), "R5", expected, bytes));
        };
        next = aligned(end);
        let element = match (kind, axis) {
            (None, _) if entry.level().is_some() => 1,
            (None, _) => entry.element_bytes.max(1),
            (Some(kind), axis) => kind.element_bytes(facts.channels, facts.grid.dims, axis.unwrap_or(Axis::X)),
        };
        if element == 0 {
            let got = format!("a section of {}", kind.map_or("", SectionKind::name));
            return Err(fault(at!(entry[index].kind), "R10", "only channels that the header names", got));
        }
        if entry.element_bytes != element {
            let expected = format!("elements of {element} bytes");
            return Err(fault(at!(entry[index].element_bytes), "R11", expected, entry.element_bytes));
        }
        if bytes % u64::from(element) != 0 {
            let expected = format!("a multiple of {element} bytes");
            return Err(fault(at!(entry[index].bytes), "R11", expected, bytes));
        }
    }
    if let Some((last, index)) = last_level.filter(|(last, _)| *last > 1) {
        return Err(fault(at!(entry[index].kind), "R23", "level 1 after it", format!("level {last} as the last one")));
    }
    let levels = table.iter().filter(|entry| entry.level().is_some()).count() as u64;
    let limits = table.iter().position(|entry| entry.known_kind() == Some(SectionKind::LevelLimits));
    if let Some(index) = limits.filter(|&index| table[index].bytes.get() != levels * size_of::<LevelLimits>() as u64) {
        let expected = format!("limits of {levels} levels, as many as there are");
        return Err(fault(at!(entry[index].bytes), "R27", expected, format!("{} bytes", table[index].bytes)));
    }
    if next != file_bytes {
        let expected = format!("the last section filled up to byte {next}, and the file's end there");
        return Err(fault(at!(header.file_bytes), "R5", expected, file_bytes));
    }
    Ok(())
}

/// Checks the header and the section table of each level, and that they fit those of the level below. R1 to R11, R24.
fn check_levels(bytes: &[u8], head: &Head) -> Result<(), FormatFault> {
    let mut below = head.facts.clone();
    for section in head.table.iter().rev().filter(|section| section.level().is_some()) {
        let place = section.place();
        // `check_table` found the section inside the file.
        let at = |at: u64| usize::try_from(at).unwrap_or(usize::MAX);
        let file = bytes.get(at(place.start)..at(place.end)).unwrap_or_default();
        below = level_head(file, &place, &below, head.stored())?.facts;
    }
    Ok(())
}

/// Reads and checks the beginning, `bytes`, of a level at a place in the file. R1 to R11, R24. `below`: the facts of the level
/// below; `lanes`: which lanes the file stores.
pub(super) fn level_head<'a>(
    bytes: &'a [u8],
    place: &Range<u64>,
    below: &Facts,
    lanes: [bool; 3],
) -> Result<Head<'a>, FormatFault> {
    let offset = place.start;
    let level = Head::new(bytes, place.end - offset).map_err(|fault| fault.moved(offset))?;
    let wrong = |at: u64, expected: String, got: String| Err(fault(at, "R24", expected, got).moved(offset));
    let Some((expected, _)) = level_facts(below) else {
        return wrong(at!(header.dims), "no level of a grid that has no coarser one".into(), "a level".into());
    };
    let (grid, found) = (&expected.grid, &level.facts.grid);
    let same = |a: &[f64], b: &[f64]| a.iter().map(|a| a.to_bits()).eq(b.iter().map(|b| b.to_bits()));
    let scales = |scales: &Scales| [scales.value_low, scales.value_step, scales.magnitude_scale];
    let (channels, has) = (expected.channels, level.facts.channels);
    let tests = [
        ("dimensions", grid.dims == found.dims, at!(header.dims)),
        ("value bits", channels.value_bits == has.value_bits, at!(header.value_bits)),
        ("normal bits", channels.normal_bits == has.normal_bits, at!(header.normal_bits)),
        ("magnitude bits", channels.magnitude_bits == has.magnitude_bits, at!(header.magnitude_bits)),
        ("tile order", expected.tile_order == level.facts.tile_order, at!(header.tile_order)),
        ("spacing", same(&grid.spacing, &found.spacing), at!(header.spacing)),
        ("origin", same(&grid.origin, &found.origin), at!(header.origin)),
        ("direction", same(grid.direction.as_flattened(), found.direction.as_flattened()), at!(header.direction)),
        ("scales", same(&scales(&expected.scales), &scales(&level.facts.scales)), at!(header.value_low)),
        ("coverages", has.coverage_bits == channels.coverage_bits, at!(entry[0].kind)),
        ("lanes", level.stored() == lanes, at!(entry[0].kind)),
    ];
    if let Some((what, _, at)) = tests.into_iter().find(|(_, is_right, _)| !is_right) {
        return wrong(at, format!("the {what} that the level below gives"), "others".into());
    }
    for (index, entry) in level.table.iter().enumerate() {
        if let Some(number) = entry.level() {
            return wrong(at!(entry[index].kind), "no levels in a level".into(), format!("level {number}"));
        }
    }
    let is_description = |entry: &SectionEntry| entry.known_kind() == Some(SectionKind::Description);
    let description = level.table.iter().find(|entry| is_description(entry)).map_or(0, |entry| entry.bytes.get());
    if description != 2 {
        return wrong(at!(entry[0].bytes), "a description of 2 bytes, {}".into(), format!("{description} bytes"));
    }
    Ok(level)
}

/// Checks that `bytes`, which start at byte `from` of the file, are all 0; the fault names the first byte that is not.
pub(super) fn zeros_from(from: u64, rule: &'static str, bytes: &[u8]) -> Result<(), FormatFault> {
    match bytes.iter().position(|&byte| byte != 0) {
        Some(index) => Err(fault(from + index as u64, rule, "0", bytes[index])),
        None => Ok(()),
    }
}
