//! The bytes of an arena: the only place that knows an offset.
//!
//! In: any bytes. Out: [`Arena`], typed views of its sections, after O(header) checks; nothing is copied. Any
//! bytes are safe to open and to walk; whether they hold a sound arena is what [`super::check`] finds out.
//!
//! Normative text: `formats/adj-1.md`, whose rules R1... the faults name. Records are align-1 little-endian
//! types, so that a slice at any address is valid and the same on every machine.
//!
//! ```text
//!    0  header, 256 bytes                      \ one checksum, R3
//!  256  section table, 32 bytes an entry       /
//!       description (JSON)                      sections start at multiples of 256, in table order;
//!       for each lane: tiles, line ends,        the bytes between them are 0
//!       steps, values, normals, magnitudes
//! ```

use std::mem::{offset_of, size_of};

use xxhash_rust::xxh3::xxh3_64;
use zerocopy::byteorder::little_endian::{F64, U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::curve::TileOrder;
use super::lane::{Lane, LineEnds};
use crate::error::FormatFault;
use crate::volume::{Axis, Grid};

/// First eight bytes: "ADJ" between a byte that no text has and line ends that a text transfer would change.
pub const MAGIC: [u8; 8] = *b"\x89ADJ\r\n\x1a\n";
/// Readers refuse another major version: the bytes mean something else.
pub const MAJOR: u16 = 1;
/// A higher minor version only adds sections of optional kinds.
pub const MINOR: u16 = 0;
/// Sections start at multiples of this, so that each binds as a GPU storage buffer.
pub const ALIGNMENT: u64 = 256;
/// Lines along an edge of a tile.
pub const TILE_EDGE: u16 = 8;
/// Section kinds from here on may be skipped by a reader that does not know them.
pub const OPTIONAL_KINDS: u16 = 0x8000;
/// Lines of at most this many grid points have two-byte line ends: 64 such lines cannot exceed 65,535 records.
pub const NARROW_LINE: u32 = 1_023;
/// Most sections a file may have; three full lanes need 19.
pub const MAX_SECTIONS: u32 = 1_024;

/// What the first 256 bytes say.
#[derive(Debug, Clone, Copy, FromBytes, IntoBytes, KnownLayout, Immutable, Unaligned)]
#[repr(C)]
pub struct FileHeader {
    /// [`MAGIC`]. R1.
    pub magic: [u8; 8],
    /// [`MAJOR`]. R2.
    pub major: U16,
    /// [`MINOR`] or later. R2.
    pub minor: U16,
    /// Entries of the section table, at most [`MAX_SECTIONS`]. R5.
    pub section_count: U32,
    /// Length of the file. R4.
    pub file_bytes: U64,
    /// XXH3-64 of the header, with this field 0, followed by the section table. R3.
    pub header_xxh3: U64,
    /// Grid points along x, y, z; each at least 1. R6.
    pub dims: [U16; 3],
    /// 8 or 16. R7.
    pub value_bits: u8,
    /// 0 (no normals), 8 or 16 per component. R7.
    pub normal_bits: u8,
    /// 0 (no magnitudes) or 8. R7.
    pub magnitude_bits: u8,
    /// Order of the tiles: 0 Morton, 1 Hilbert, 2 rows. R7.
    pub tile_order: u8,
    /// 0. R8.
    pub reserved_0: [u8; 6],
    /// Visible voxels, the same in every lane.
    pub visible_voxels: U64,
    /// Distance between grid points along each index axis. R6.
    pub spacing: [F64; 3],
    /// World position of grid point (0, 0, 0). R6.
    pub origin: [F64; 3],
    /// World unit vectors of the index axes, x then y then z. R6.
    pub direction: [[F64; 3]; 3],
    /// Value of code 0, in the sample's own unit. R9.
    pub value_low: F64,
    /// Value per code. R9.
    pub value_step: F64,
    /// Magnitude of code 255, per world length. R9.
    pub magnitude_scale: F64,
    /// 0. R8.
    pub reserved_1: [u8; 56],
}

const _: () = {
    assert!(size_of::<FileHeader>() == 256);
    assert!(offset_of!(FileHeader, dims) == 32);
    assert!(offset_of!(FileHeader, visible_voxels) == 48);
    assert!(offset_of!(FileHeader, direction) == 104);
    assert!(offset_of!(FileHeader, magnitude_scale) == 192);
    assert!(offset_of!(FileHeader, reserved_1) == 200);
};

/// One entry of the section table.
#[derive(Debug, Clone, Copy, FromBytes, IntoBytes, KnownLayout, Immutable, Unaligned)]
#[repr(C)]
pub struct SectionEntry {
    /// A [`SectionKind`] as a number. R10.
    pub kind: U16,
    /// Lane the section belongs to: 0, 1 or 2; 255 for none.
    pub axis: u8,
    /// Bytes of one element. R11.
    pub element_bytes: u8,
    /// 0. R8.
    pub reserved: U32,
    /// First byte, from the start of the file; a multiple of [`ALIGNMENT`]. R5.
    pub offset: U64,
    /// Length; a multiple of `element_bytes`. R5, R11.
    pub bytes: U64,
    /// XXH3-64 of the section's bytes. R12.
    pub xxh3: U64,
}

const _: () = {
    assert!(size_of::<SectionEntry>() == 32);
    assert!(offset_of!(SectionEntry, offset) == 8);
};

/// Eight by eight neighbouring scan lines of a lane, of which at least one holds a voxel.
///
/// The face's axes are u and v: the two axes that are not the lane's, u the lower. Line (u, v) of the tile is bit
/// `(v % 8) * 8 + u % 8` of the mask.
#[derive(Debug, Clone, Copy, PartialEq, Eq, FromBytes, IntoBytes, KnownLayout, Immutable, Unaligned)]
#[repr(C)]
pub struct TileRecord {
    /// The tile's column: lines `u = 8 * tile_u ..`. R13.
    pub tile_u: U16,
    /// The tile's row: lines `v = 8 * tile_v ..`. R13.
    pub tile_v: U16,
    /// Index in the lane's line ends of this tile's first line. R14.
    pub first_line: U32,
    /// Index in the lane's channels of this tile's first record. R14.
    pub first_record: U64,
    /// Which lines hold voxels; never 0. R13.
    pub occupancy: U64,
    /// Lowest coordinate of a voxel on the lane's axis. R15.
    pub low: U16,
    /// Highest coordinate of a voxel on the lane's axis, inclusive. R15.
    pub high: U16,
}

const _: () = {
    assert!(size_of::<TileRecord>() == 28);
    assert!(offset_of!(TileRecord, first_record) == 8);
    assert!(offset_of!(TileRecord, occupancy) == 16);
    assert!(offset_of!(TileRecord, low) == 24);
};

/// What a section holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum SectionKind {
    /// JSON text for people and tools; nothing that a walk needs.
    Description = 1,
    /// [`TileRecord`]s in the tile order.
    Tiles = 2,
    /// For each line, tile after tile and bit after bit: the index after its last record, from the tile's first.
    LineEnds = 3,
    /// For each record: the distance from the previous one on the line; 0 stands for a stepping voxel of 255.
    Steps = 4,
    /// For each record: the sample's code.
    Values = 5,
    /// For each record: an octahedral normal.
    Normals = 6,
    /// For each record: the code of the gradient's magnitude.
    Magnitudes = 7,
}

impl SectionKind {
    /// The kinds that each lane has, in file order.
    pub const OF_LANES: [SectionKind; 6] = [
        SectionKind::Tiles,
        SectionKind::LineEnds,
        SectionKind::Steps,
        SectionKind::Values,
        SectionKind::Normals,
        SectionKind::Magnitudes,
    ];

    fn from_number(number: u16) -> Option<SectionKind> {
        Some(match number {
            1 => SectionKind::Description,
            2 => SectionKind::Tiles,
            3 => SectionKind::LineEnds,
            4 => SectionKind::Steps,
            5 => SectionKind::Values,
            6 => SectionKind::Normals,
            7 => SectionKind::Magnitudes,
            _ => return None,
        })
    }

    /// Bytes of an element in a lane along `axis` of a grid with `dims`; 0 if such a lane has none.
    pub fn element_bytes(self, channels: Channels, dims: [u32; 3], axis: Axis) -> u8 {
        match self {
            SectionKind::Description | SectionKind::Steps => 1,
            SectionKind::Tiles => 28,
            SectionKind::LineEnds => line_end_bytes(dims[axis.index()]),
            SectionKind::Values => channels.value_bits / 8,
            SectionKind::Normals => channels.normal_bits / 4,
            SectionKind::Magnitudes => channels.magnitude_bits / 8,
        }
    }

    /// Its name in messages and in `adj info`.
    pub const fn name(self) -> &'static str {
        match self {
            SectionKind::Description => "description",
            SectionKind::Tiles => "tiles",
            SectionKind::LineEnds => "line ends",
            SectionKind::Steps => "steps",
            SectionKind::Values => "values",
            SectionKind::Normals => "normals",
            SectionKind::Magnitudes => "magnitudes",
        }
    }
}

/// Bytes of a line end in a lane whose lines have `line_points` grid points: 2 or 4.
pub const fn line_end_bytes(line_points: u32) -> u8 {
    if line_points <= NARROW_LINE { 2 } else { 4 }
}

/// Which channels a record has, and how wide they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Channels {
    /// Bits of a value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each of a normal's two components: 0 for no normals, 8 or 16.
    pub normal_bits: u8,
    /// Bits of a gradient magnitude: 0 for none, or 8.
    pub magnitude_bits: u8,
}

impl Channels {
    /// Bytes of a record in all channels, its step included.
    pub const fn record_bytes(self) -> u64 {
        1 + self.value_bits as u64 / 8 + self.normal_bits as u64 / 4 + self.magnitude_bits as u64 / 8
    }
}

/// How stored codes become values and magnitudes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scales {
    /// Value of code 0.
    pub value_low: f64,
    /// Value per code.
    pub value_step: f64,
    /// Magnitude of code 255, per world length.
    pub magnitude_scale: f64,
}

/// What an arena says of itself, decoded from its header.
#[derive(Debug, Clone, PartialEq)]
pub struct Facts {
    /// Where the voxels sit; `unit` is in the description.
    pub grid: Grid,
    /// The records' channels.
    pub channels: Channels,
    /// The order of the tiles.
    pub tile_order: TileOrder,
    /// What codes mean.
    pub scales: Scales,
    /// Visible voxels.
    pub visible_voxels: u64,
}

/// The bytes of one `.adj` file, opened.
#[derive(Debug, Clone)]
pub struct Arena<'a> {
    bytes: &'a [u8],
    facts: Facts,
    sections: Vec<Section>,
    lanes: [Option<Lane<'a>>; 3],
}

/// Where one section lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Section {
    /// What it holds; `None` for an optional kind that this version does not know.
    pub kind: Option<SectionKind>,
    /// Its lane; `None` for the description.
    pub axis: Option<Axis>,
    /// Bytes of an element.
    pub element_bytes: u8,
    /// First byte in the file.
    pub offset: u64,
    /// Length in bytes.
    pub bytes: u64,
    /// What its checksum must be.
    pub xxh3: u64,
}

/// A fault at byte `at` of the file, by `rule`.
pub(super) fn fault(
    at: usize,
    rule: &'static str,
    expected: impl Into<String>,
    got: impl std::fmt::Display,
) -> FormatFault {
    FormatFault { at: at as u64, rule, expected: expected.into(), got: got.to_string() }
}

impl<'a> Arena<'a> {
    /// Opens an arena: header, section table and the sections' bounds; O(number of sections).
    ///
    /// What the sections hold is not looked at: walks are safe on any content, and [`Arena::check`] judges it.
    ///
    /// # Errors
    /// The first broken rule of `formats/adj-1.md` among R1 to R11.
    pub fn new(bytes: &'a [u8]) -> Result<Arena<'a>, FormatFault> {
        let magic = bytes.get(..8).unwrap_or(bytes);
        if magic != MAGIC {
            return Err(fault(0, "R1", "the first bytes of an .adj file", format!("{magic:02x?}")));
        }
        let Ok((header, after)) = FileHeader::read_from_prefix(bytes) else {
            return Err(fault(bytes.len(), "R4", "a header of 256 bytes", format!("{} bytes", bytes.len())));
        };
        if header.major.get() != MAJOR {
            let expected = format!("major version {MAJOR}: update adjsplat, or rebuild the file with this version");
            return Err(fault(offset_of!(FileHeader, major), "R2", expected, format!("version {}", header.major)));
        }
        if header.file_bytes.get() != bytes.len() as u64 {
            let expected = format!("{} bytes, as the header says", header.file_bytes);
            let got = format!("{} bytes: the file was cut or grew; rebuild or copy it again", bytes.len());
            return Err(fault(offset_of!(FileHeader, file_bytes), "R4", expected, got));
        }
        let count = header.section_count.get();
        if count > MAX_SECTIONS {
            let at = offset_of!(FileHeader, section_count);
            return Err(fault(at, "R5", format!("at most {MAX_SECTIONS} sections"), count));
        }
        let Ok((table, _)) = <[SectionEntry]>::ref_from_prefix_with_elems(after, count as usize) else {
            return Err(fault(bytes.len(), "R5", format!("a table of {count} sections"), "the end of the file"));
        };
        let sum = header_checksum(&header, table);
        if sum != header.header_xxh3.get() {
            let got = format!("{:#018x}: the header is damaged; rebuild or copy the file again", header.header_xxh3);
            return Err(fault(offset_of!(FileHeader, header_xxh3), "R3", format!("checksum {sum:#018x}"), got));
        }
        let facts = facts_of(&header)?;
        let sections = sections_of(table, bytes.len() as u64, &facts)?;
        let mut arena = Arena { bytes, facts, sections, lanes: [None; 3] };
        for axis in Axis::ALL {
            arena.lanes[axis.index()] = arena.assemble_lane(axis)?;
        }
        if arena.lanes.iter().all(Option::is_none) {
            return Err(fault(size_of::<FileHeader>(), "R10", "at least one lane", "none"));
        }
        Ok(arena)
    }

    /// What the header says.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// The lane along `axis`, if the file stores it.
    pub fn lane(&self, axis: Axis) -> Option<Lane<'a>> {
        self.lanes[axis.index()]
    }

    /// The stored lanes, x first.
    pub fn lanes(&self) -> impl Iterator<Item = Lane<'a>> + '_ {
        self.lanes.iter().flatten().copied()
    }

    /// Every section, in file order.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// The bytes of a section of this arena.
    pub fn section_bytes(&self, section: &Section) -> &'a [u8] {
        // Bounds were checked by `sections_of`; a section of another arena gives nothing.
        let range = usize::try_from(section.offset).ok().zip(usize::try_from(section.offset + section.bytes).ok());
        range.and_then(|(from, to)| self.bytes.get(from..to)).unwrap_or_default()
    }

    /// All bytes.
    pub fn bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The description, a JSON text; empty if there is none.
    pub fn description(&self) -> &'a [u8] {
        let of_text = |s: &&Section| s.kind == Some(SectionKind::Description);
        self.sections.iter().find(of_text).map_or(&[], |s| self.section_bytes(s))
    }

    fn assemble_lane(&self, axis: Axis) -> Result<Option<Lane<'a>>, FormatFault> {
        let find = |kind| self.sections.iter().find(|s| s.kind == Some(kind) && s.axis == Some(axis));
        let Some(tiles) = find(SectionKind::Tiles) else {
            return match self.sections.iter().find(|s| s.axis == Some(axis) && s.kind.is_some()) {
                None => Ok(None),
                Some(s) => Err(fault(to_index(s.offset), "R10", format!("tiles of lane {}", axis.name()), "none")),
            };
        };
        let at = to_index(tiles.offset);
        let mut parts: [&'a [u8]; 6] = [&[]; 6];
        for (part, kind) in parts.iter_mut().zip(SectionKind::OF_LANES) {
            let wanted = kind.element_bytes(self.facts.channels, self.facts.grid.dims, axis) > 0;
            match find(kind) {
                Some(section) if wanted => *part = self.section_bytes(section),
                None if !wanted => {}
                Some(s) => {
                    let expected = format!("no {} in lane {}, as the header says", kind.name(), axis.name());
                    return Err(fault(to_index(s.offset), "R10", expected, "a section of them"));
                }
                None => {
                    return Err(fault(
                        at,
                        "R10",
                        format!("{} in lane {}", kind.name(), axis.name()),
                        "no such section",
                    ));
                }
            }
        }
        let [tiles, line_ends, steps, values, normals, magnitudes] = parts;
        let channels = self.facts.channels;
        let width = |bits: u8, per: u8| usize::from(bits / per);
        let lengths = [
            (values.len(), width(channels.value_bits, 8), "values"),
            (normals.len(), width(channels.normal_bits, 4), "normals"),
            (magnitudes.len(), width(channels.magnitude_bits, 8), "magnitudes"),
        ];
        for (bytes, width, name) in lengths {
            if Some(bytes) != steps.len().checked_mul(width) {
                let expected = format!("{name} for {} records of lane {}", steps.len(), axis.name());
                return Err(fault(at, "R11", expected, format!("{bytes} bytes")));
            }
        }
        let tiles = <[TileRecord]>::ref_from_bytes(tiles).expect("R11 holds: a multiple of a tile's 28 bytes");
        let line_ends = if line_end_bytes(self.facts.grid.dims[axis.index()]) == 2 {
            LineEnds::Narrow(<[U16]>::ref_from_bytes(line_ends).expect("R11 holds: a multiple of 2 bytes"))
        } else {
            LineEnds::Wide(<[U32]>::ref_from_bytes(line_ends).expect("R11 holds: a multiple of 4 bytes"))
        };
        let dims = self.facts.grid.dims;
        Ok(Some(Lane { axis, dims, channels, tiles, line_ends, steps, values, normals, magnitudes }))
    }
}

/// XXH3-64 of the header, its own field 0, followed by the section table.
pub fn header_checksum(header: &FileHeader, table: &[SectionEntry]) -> u64 {
    let mut blank = *header;
    blank.header_xxh3 = U64::ZERO;
    xxh3_64(&[blank.as_bytes(), table.as_bytes()].concat())
}

/// The header's bytes for `facts`, but for the counts and checksum that [`super::super::file::write`] fills in.
pub fn header_of(facts: &Facts) -> FileHeader {
    let triple = |v: [f64; 3]| v.map(F64::new);
    FileHeader {
        magic: MAGIC,
        major: U16::new(MAJOR),
        minor: U16::new(MINOR),
        section_count: U32::ZERO,
        file_bytes: U64::ZERO,
        header_xxh3: U64::ZERO,
        dims: facts.grid.dims.map(|d| U16::new(u16::try_from(d).expect("a grid's dimensions are at most 65,535"))),
        value_bits: facts.channels.value_bits,
        normal_bits: facts.channels.normal_bits,
        magnitude_bits: facts.channels.magnitude_bits,
        tile_order: facts.tile_order.code(),
        reserved_0: [0; 6],
        visible_voxels: U64::new(facts.visible_voxels),
        spacing: triple(facts.grid.spacing),
        origin: triple(facts.grid.origin),
        direction: facts.grid.direction.map(triple),
        value_low: F64::new(facts.scales.value_low),
        value_step: F64::new(facts.scales.value_step),
        magnitude_scale: F64::new(facts.scales.magnitude_scale),
        reserved_1: [0; 56],
    }
}

fn facts_of(header: &FileHeader) -> Result<Facts, FormatFault> {
    let triple = |v: [F64; 3]| v.map(F64::get);
    let grid = Grid {
        dims: header.dims.map(|d| u32::from(d.get())),
        spacing: triple(header.spacing),
        origin: triple(header.origin),
        direction: header.direction.map(triple),
        unit: None,
    };
    if let Err(error) = grid.check() {
        return Err(fault(offset_of!(FileHeader, dims), "R6", "a sound grid", error));
    }
    let channels = Channels {
        value_bits: header.value_bits,
        normal_bits: header.normal_bits,
        magnitude_bits: header.magnitude_bits,
    };
    let allowed: [(u8, &[u8], usize); 3] = [
        (channels.value_bits, &[8, 16], offset_of!(FileHeader, value_bits)),
        (channels.normal_bits, &[0, 8, 16], offset_of!(FileHeader, normal_bits)),
        (channels.magnitude_bits, &[0, 8], offset_of!(FileHeader, magnitude_bits)),
    ];
    for (bits, choices, at) in allowed {
        if !choices.contains(&bits) {
            return Err(fault(at, "R7", format!("one of {choices:?} bits"), bits));
        }
    }
    let Some(tile_order) = TileOrder::from_code(header.tile_order) else {
        return Err(fault(offset_of!(FileHeader, tile_order), "R7", "tile order 0, 1 or 2", header.tile_order));
    };
    if header.reserved_0 != [0; 6] || header.reserved_1 != [0; 56] {
        return Err(fault(offset_of!(FileHeader, reserved_0), "R8", "zeros", "other bytes"));
    }
    let scales = Scales {
        value_low: header.value_low.get(),
        value_step: header.value_step.get(),
        magnitude_scale: header.magnitude_scale.get(),
    };
    let sound = |v: f64| v.is_finite() && v >= 0.0;
    if !(scales.value_low.is_finite() && sound(scales.value_step) && sound(scales.magnitude_scale)) {
        return Err(fault(offset_of!(FileHeader, value_low), "R9", "finite scales", format!("{scales:?}")));
    }
    Ok(Facts { grid, channels, tile_order, scales, visible_voxels: header.visible_voxels.get() })
}

fn sections_of(table: &[SectionEntry], file_bytes: u64, facts: &Facts) -> Result<Vec<Section>, FormatFault> {
    let mut sections: Vec<Section> = Vec::with_capacity(table.len());
    let mut free_from = (size_of::<FileHeader>() + size_of_val(table)) as u64;
    for (index, entry) in table.iter().enumerate() {
        let at = size_of::<FileHeader>() + index * size_of::<SectionEntry>();
        let kind = SectionKind::from_number(entry.kind.get());
        if kind.is_none() && entry.kind.get() < OPTIONAL_KINDS {
            return Err(fault(at, "R10", "a known section kind: update adjsplat", entry.kind.get()));
        }
        if entry.reserved.get() != 0 {
            return Err(fault(at, "R8", "zeros", entry.reserved.get()));
        }
        let axis = Axis::from_index(entry.axis.into());
        if kind.is_some_and(|k| (k == SectionKind::Description) != (entry.axis == 255))
            || (axis.is_none() && entry.axis != 255)
        {
            return Err(fault(at, "R10", "axis 0, 1 or 2 for a lane's section, 255 for another", entry.axis));
        }
        let (offset, bytes) = (entry.offset.get(), entry.bytes.get());
        let end = offset.checked_add(bytes).filter(|&end| end <= file_bytes);
        let Some(end) = end.filter(|_| offset % ALIGNMENT == 0 && offset >= free_from) else {
            let expected = format!("a section from a multiple of {ALIGNMENT} at {free_from} or later to {file_bytes}");
            return Err(fault(at, "R5", expected, format!("offset {offset}, length {bytes}")));
        };
        free_from = end;
        let lane_axis = axis.unwrap_or(Axis::X);
        let element = kind.map_or(entry.element_bytes, |k| k.element_bytes(facts.channels, facts.grid.dims, lane_axis));
        let absent = kind.is_some() && element == 0;
        if !absent && (entry.element_bytes != element || element == 0 || bytes % u64::from(element) != 0) {
            let expected = format!("a multiple of elements of {element} bytes");
            return Err(fault(at, "R11", expected, format!("{bytes} bytes of elements of {}", entry.element_bytes)));
        }
        if kind.is_some() && sections.iter().any(|s| s.kind == kind && s.axis == axis) {
            return Err(fault(at, "R10", "each kind once a lane", "it again"));
        }
        sections.push(Section {
            kind,
            axis,
            element_bytes: entry.element_bytes,
            offset,
            bytes,
            xxh3: entry.xxh3.get(),
        });
    }
    Ok(sections)
}

/// An offset that `sections_of` found inside the bytes.
fn to_index(offset: u64) -> usize {
    usize::try_from(offset).unwrap_or(usize::MAX)
}
