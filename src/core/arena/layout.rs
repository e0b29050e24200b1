//! The bytes of an `.adj` file: header, section table and tile records.
//!
//! `formats/adj-1.md` is normative; fields and faults name its rules R1 to R27. tests/core/layout.rs compares its tables
//! with the structs below. Records consist of little-endian types of alignment 1, so a slice at any address is valid,
//! on every machine.
//!
//! ```text
//!    0  header, 256 bytes                      \ one checksum, R3
//!  256  section table, 32 bytes an entry       /
//!       description (JSON)                      sections in table order, each filled up with zeros to a
//!       limits of levels                        multiple of 256 bytes, the last one too: R5, R21
//!       levels, the coarsest first
//!       for each lane: tiles, line ends,
//!       steps, values, normals, magnitudes,
//!       coverages
//! ```

use std::mem::{offset_of, size_of};
use std::ops::Range;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;
use zerocopy::byteorder::little_endian::{F32, F64, U16, U32, U64};
use zerocopy::{FromBytes, FromZeros, Immutable, IntoBytes, KnownLayout, Unaligned};

use super::curve::TileOrder;
use super::levels::MOST_LEVELS;
use crate::classify::value_of_code;
use crate::volume::{Axis, Grid};

/// The first eight bytes of a file: a byte that is not ASCII, "ADJ", then line breaks that a text transfer changes.
pub const MAGIC: [u8; 8] = *b"\x89ADJ\r\n\x1a\n";
/// Major version of the format. Readers refuse any other, because the bytes would have another meaning.
pub const MAJOR: u16 = 1;
/// Minor version of files with levels of detail or coverages, but neither coherences nor limits of levels; files with none of these have 0.
/// A higher minor version only adds what readers may leave alone.
pub const LEVELS_MINOR: u16 = 1;
/// Minor version of files whose voxels have coverages and normals with a coherence.
pub const COHERENT_MINOR: u16 = 2;
/// Minor version of files that say where their levels may be drawn.
pub const LIMITED_MINOR: u16 = 3;
/// Sections start at multiples of this many bytes, so that each can be bound as a GPU storage buffer. The last section
/// is padded too: uploads in words of four bytes may read past a section's end.
pub const ALIGNMENT: u64 = 256;
/// Number of scan lines along each edge of a tile (a square block of neighbouring lines).
pub const TILE_EDGE: u16 = 8;
/// Lowest number of an optional section kind: readers may skip sections of unknown kinds from this number on.
pub const OPTIONAL_KINDS: u16 = 0x8000;
/// Longest scan line, in grid points, whose end is stored in two bytes: 64 such lines have at most 65,472 records.
pub const NARROW_LINE: u32 = 1_023;
/// Largest number of sections in a file; three complete lanes with all levels need 38.
pub const MAX_SECTIONS: u32 = 1_024;

/// The first 256 bytes of a file.
#[derive(Debug, Clone, Copy, FromBytes, IntoBytes, KnownLayout, Immutable, Unaligned)]
#[repr(C)]
pub struct FileHeader {
    /// Always [`MAGIC`]. R1.
    pub magic: [u8; 8],
    /// Always [`MAJOR`]. R2.
    pub major: U16,
    /// 0, [`LEVELS_MINOR`], [`COHERENT_MINOR`], [`LIMITED_MINOR`] or a higher minor version. R2.
    pub minor: U16,
    /// Number of entries in the section table, at most [`MAX_SECTIONS`]. R5.
    pub section_count: U32,
    /// Length of the file in bytes. R4.
    pub file_bytes: U64,
    /// XXH3-64 of the header, with this field set to 0, followed by the section table. R3.
    pub header_xxh3: U64,
    /// Number of grid points along x, y, z; each at least 1. R6.
    pub dims: [U16; 3],
    /// Bits per value: 8 or 16. R7.
    pub value_bits: u8,
    /// Bits per component of a normal: 0 (no normals), 8 or 16. R7.
    pub normal_bits: u8,
    /// Bits per gradient magnitude: 0 (no magnitudes) or 8. R7.
    pub magnitude_bits: u8,
    /// Order of the tiles: 0 Morton, 1 Hilbert, 2 rows. R7.
    pub tile_order: u8,
    /// Reserved; always 0. R8.
    pub reserved_0: [u8; 6],
    /// Number of visible voxels, the same in every lane. R11, R19.
    pub visible_voxels: U64,
    /// Distance between neighbouring grid points along each index axis, in world units. R6.
    pub spacing: [F64; 3],
    /// World position of grid point (0, 0, 0). R6.
    pub origin: [F64; 3],
    /// World directions of the index axes x, y, z, as unit vectors. R6.
    pub direction: [[F64; 3]; 3],
    /// Value of code 0 (a code is the stored number of a value), in the samples' own unit. R9.
    pub value_low: F64,
    /// Difference in value between neighbouring codes. R9.
    pub value_step: F64,
    /// Gradient magnitude of code 255, in value per world unit. R9.
    pub magnitude_scale: F64,
    /// Reserved; always 0. R8.
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

/// One entry of the section table: the kind, position and checksum of a section.
#[derive(Debug, Clone, Copy, FromBytes, IntoBytes, KnownLayout, Immutable, Unaligned)]
#[repr(C)]
pub struct SectionEntry {
    /// The number of the section's [`SectionKind`]. R10.
    pub kind: U16,
    /// The lane that the section belongs to: 0, 1 or 2 for x, y, z; 255 for none. R10.
    pub axis: u8,
    /// Size of one element in bytes. R11.
    pub element_bytes: u8,
    /// Reserved; always 0. R8.
    pub reserved: U32,
    /// Byte offset in the file: the first multiple of [`ALIGNMENT`] after the previous section. R5.
    pub offset: U64,
    /// Length in bytes; a multiple of `element_bytes`. R5, R11.
    pub bytes: U64,
    /// XXH3-64 of the section's bytes. R12.
    pub xxh3: U64,
}

impl SectionEntry {
    /// Returns what the section holds; `None` for an optional kind that this version does not know.
    pub fn known_kind(&self) -> Option<SectionKind> {
        let mut kinds = SectionKind::OF_FILE.into_iter().chain(SectionKind::OF_LANES);
        kinds.find(|&kind| kind as u16 == self.kind.get())
    }

    /// Returns the number of the coarser level that the section holds, 1 to [`MOST_LEVELS`], as an
    /// `.adj` file; `None` for another section.
    pub fn level(&self) -> Option<u8> {
        let number = self.kind.get().checked_sub(OPTIONAL_KINDS)?;
        u8::try_from(number).ok().filter(|number| (1..=MOST_LEVELS).contains(number))
    }

    /// Returns the bytes of the file that the section takes.
    pub(crate) fn place(&self) -> Range<u64> {
        self.offset.get()..self.offset.get().saturating_add(self.bytes.get())
    }

    /// Returns the axis of the lane that the section belongs to; `None` for the description.
    pub fn lane_axis(&self) -> Option<Axis> {
        Axis::from_index(self.axis.into())
    }

    /// Returns the entry of the section of level `level`, like [`SectionEntry::empty`].
    pub(crate) fn of_level(level: u8) -> SectionEntry {
        let kind = U16::new(OPTIONAL_KINDS + u16::from(level));
        SectionEntry { kind, ..SectionEntry::empty(SectionKind::Description, None, 1) }
    }

    /// Returns the entry of a section without a position yet: offset, length and checksum are 0.
    pub(crate) fn empty(kind: SectionKind, axis: Option<Axis>, element_bytes: u8) -> SectionEntry {
        let axis = axis.map_or(255, |axis| axis as u8);
        SectionEntry { kind: U16::new(kind as u16), axis, element_bytes, ..SectionEntry::new_zeroed() }
    }
}

const _: () = {
    assert!(size_of::<SectionEntry>() == 32);
    assert!(offset_of!(SectionEntry, offset) == 8);
};

/// A tile: 8 x 8 neighbouring scan lines of a lane, at least one of which holds a voxel.
///
/// u and v are a line's coordinates on the two axes across the lane; u belongs to the first of these axes (x before y
/// before z). Line (u, v) of the tile is bit `(v % 8) * 8 + u % 8` of the mask `occupancy`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, FromBytes, IntoBytes, KnownLayout, Immutable, Unaligned)]
#[repr(C)]
pub struct TileRecord {
    /// The tile's column: its lines have u from `8 * tile_u` to `8 * tile_u + 7`. R13.
    pub tile_u: U16,
    /// The tile's row: its lines have v from `8 * tile_v` to `8 * tile_v + 7`. R13.
    pub tile_v: U16,
    /// Index of this tile's first line in the lane's line ends: the number of stored lines in all tiles before it. R14.
    pub first_line: U32,
    /// Index of this tile's first record in the lane's channels (the arrays of steps, values, normals and magnitudes):
    /// the number of records in all tiles before it. R14.
    pub first_record: U64,
    /// Mask of the tile's lines that hold voxels; never 0. Lines outside the face (the lane's lines as a 2-D array) are
    /// not in it. R13.
    pub occupancy: U64,
    /// Lowest coordinate of the tile's voxels on the lane's axis. R15.
    pub low: U16,
    /// Highest coordinate of the tile's voxels on the lane's axis, inclusive. R15.
    pub high: U16,
}

impl TileRecord {
    /// Returns the index range of the tile's lines in the lane's line ends; in a damaged file it may exceed the array.
    pub(crate) fn lines(&self) -> std::ops::Range<usize> {
        let first = self.first_line.get() as usize;
        first..first.saturating_add(self.occupancy.get().count_ones() as usize)
    }

    /// Returns the tile's position in `order`; unique for each tile of a lane.
    pub(crate) fn key(&self, order: TileOrder) -> u32 {
        order.key(self.tile_u.get(), self.tile_v.get())
    }

    /// Returns the tile with its first line increased by `lines`, and its first record by `records`.
    pub(crate) fn moved(mut self, lines: u32, records: u64) -> TileRecord {
        self.first_line = U32::new(self.first_line.get() + lines);
        self.first_record = U64::new(self.first_record.get() + records);
        self
    }
}

const _: () = {
    assert!(size_of::<TileRecord>() == 28);
    assert!(offset_of!(TileRecord, first_record) == 8);
    assert!(offset_of!(TileRecord, occupancy) == 16);
    assert!(offset_of!(TileRecord, low) == 24);
};

/// Up to which size a level is as good as the voxels that it stands for: the most pixels that the longest edge of its voxels may
/// have in a picture; 0 for never.
#[derive(Debug, Clone, Copy, PartialEq, Default, FromBytes, IntoBytes, KnownLayout, Immutable, Unaligned)]
#[repr(C)]
pub struct LevelLimits {
    /// The most pixels at standard quality. R27.
    pub standard: F32,
    /// The most pixels at draft quality. R27.
    pub draft: F32,
}

/// The kinds of sections, by what they hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum SectionKind {
    /// JSON text for people and tools; a walk does not need it.
    Description = 1,
    /// [`TileRecord`]s in tile order.
    Tiles = 2,
    /// For each line that holds voxels, tile by tile, in the order of the mask's bits: the index after its last record,
    /// counted from the tile's first record.
    LineEnds = 3,
    /// For each record: the distance from the previous one on its line, in grid points. 0 marks a stepping voxel, which
    /// only bridges 255 points.
    Steps = 4,
    /// For each record: the code (stored number) of the value.
    Values = 5,
    /// For each record: the code of the normal, in octahedral encoding.
    Normals = 6,
    /// For each record: the code of the gradient magnitude.
    Magnitudes = 7,
    /// For each record: the code of the voxel's coverage. Optional: a file without it has voxels that are wholly visible.
    Coverage = 0x8010,
    /// [`LevelLimits`] of each level, level 1 first. Optional: a file without it says nothing of how good its levels are.
    LevelLimits = 0x8011,
}

impl SectionKind {
    /// The kinds of sections that belong to no lane, but for levels.
    pub const OF_FILE: [SectionKind; 2] = [SectionKind::Description, SectionKind::LevelLimits];

    /// The kinds of a lane's sections, in file order.
    pub const OF_LANES: [SectionKind; 7] = [
        SectionKind::Tiles,
        SectionKind::LineEnds,
        SectionKind::Steps,
        SectionKind::Values,
        SectionKind::Normals,
        SectionKind::Magnitudes,
        SectionKind::Coverage,
    ];

    /// Returns whether the section is a channel: it has an element for each record.
    pub const fn is_channel(self) -> bool {
        self as u16 >= SectionKind::Steps as u16 && !matches!(self, SectionKind::LevelLimits)
    }

    /// Returns the size in bytes of one element of this kind in the lane along `axis`; 0 if there is no such section.
    pub fn element_bytes(self, channels: Channels, dims: [u32; 3], axis: Axis) -> u8 {
        match self {
            SectionKind::Description | SectionKind::Steps => 1,
            SectionKind::Tiles => 28,
            SectionKind::LineEnds => line_end_bytes(dims[axis.index()]),
            SectionKind::Values => channels.value_bits / 8,
            SectionKind::Normals => channels.normal_bits / 4,
            SectionKind::Magnitudes => channels.magnitude_bits / 8,
            SectionKind::Coverage => channels.coverage_bits / 8,
            SectionKind::LevelLimits => 8,
        }
    }

    /// Returns the kind's name, for use in messages.
    pub const fn name(self) -> &'static str {
        match self {
            SectionKind::Description => "description",
            SectionKind::Tiles => "tiles",
            SectionKind::LineEnds => "line ends",
            SectionKind::Steps => "steps",
            SectionKind::Values => "values",
            SectionKind::Normals => "normals",
            SectionKind::Magnitudes => "magnitudes",
            SectionKind::Coverage => "coverages",
            SectionKind::LevelLimits => "limits of levels",
        }
    }
}

/// Returns where the section after byte `end` starts: at the next multiple of [`ALIGNMENT`]. `end` is below 2^63.
pub const fn aligned(end: u64) -> u64 {
    end.next_multiple_of(ALIGNMENT)
}

/// Returns how many bytes store the end offset of a scan line of `line_points` grid points: 2 or 4.
pub const fn line_end_bytes(line_points: u32) -> u8 {
    if line_points <= NARROW_LINE { 2 } else { 4 }
}

/// The channels (arrays with one code per record) of a lane, with their widths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channels {
    /// Bits per value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each of a normal's two components: 8 or 16, or 0 for no normals.
    pub normal_bits: u8,
    /// Bits per gradient magnitude: 8, or 0 for no magnitudes.
    pub magnitude_bits: u8,
    /// Bits per coverage: 8 in level 1, 16 in coarser levels, 0 if all voxels are wholly visible. Not in the header: the
    /// section table tells.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub coverage_bits: u8,
    /// Whether the lowest bits of normals are their coherence: how alike the normals are that a voxel of a level stands for. Not in
    /// the header: true in files with coverages and normals from [`COHERENT_MINOR`] on.
    #[serde(default, skip_serializing_if = "is_false")]
    pub coherence: bool,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(bits: &u8) -> bool {
    *bits == 0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(flag: &bool) -> bool {
    !flag
}

impl Channels {
    /// Returns how many bytes a step, a value, a normal, a magnitude and a coverage take.
    pub const fn widths(self) -> [usize; 5] {
        let Channels { value_bits, normal_bits, magnitude_bits, coverage_bits, .. } = self;
        [1, value_bits as usize / 8, normal_bits as usize / 4, magnitude_bits as usize / 8, coverage_bits as usize / 8]
    }

    /// Returns the largest value code.
    pub const fn last_value_code(self) -> u16 {
        if self.value_bits == 8 { 0xff } else { u16::MAX }
    }

    /// Returns how many bytes one record takes in all channels together, including its step.
    pub const fn record_bytes(self) -> u64 {
        let [step, value, normal, magnitude, coverage] = self.widths();
        (step + value + normal + magnitude + coverage) as u64
    }
}

/// The scales that convert stored codes to values and gradient magnitudes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scales {
    /// Value of code 0.
    pub value_low: f64,
    /// Difference in value between neighbouring codes.
    pub value_step: f64,
    /// Gradient magnitude of code 255, in value per world unit.
    pub magnitude_scale: f64,
}

impl Scales {
    /// Returns the value of `code`, which may be fractional; finite if the lowest and highest codes have finite values.
    #[inline]
    pub fn value(&self, code: f64) -> f64 {
        value_of_code(self.value_low, self.value_step, code)
    }
}

/// The contents of an arena's header.
#[derive(Debug, Clone, PartialEq)]
pub struct Facts {
    /// The grid of the voxels. Its `unit` is not in the header: the file's JSON description holds it.
    pub grid: Grid,
    /// Channels of the records.
    pub channels: Channels,
    /// Order of the tiles in memory.
    pub tile_order: TileOrder,
    /// The scales that convert stored codes to values.
    pub scales: Scales,
    /// Number of visible voxels.
    pub visible_voxels: u64,
}

/// Returns the XXH3-64 of the header, with its checksum field set to 0, followed by the section table.
pub fn header_checksum(header: &FileHeader, table: &[SectionEntry]) -> u64 {
    let mut blank = *header;
    blank.header_xxh3 = U64::ZERO;
    xxh3_64(&[blank.as_bytes(), table.as_bytes()].concat())
}

/// Returns the header for `facts`, without section count, file length and checksum, which the writer adds.
pub fn header_of(facts: &Facts) -> FileHeader {
    let triple = |v: [f64; 3]| v.map(F64::new);
    FileHeader {
        magic: MAGIC,
        major: U16::new(MAJOR),
        dims: facts.grid.dims.map(|d| U16::new(u16::try_from(d).expect("a grid's dimensions are at most 65,535"))),
        value_bits: facts.channels.value_bits,
        normal_bits: facts.channels.normal_bits,
        magnitude_bits: facts.channels.magnitude_bits,
        tile_order: facts.tile_order.code(),
        visible_voxels: U64::new(facts.visible_voxels),
        spacing: triple(facts.grid.spacing),
        origin: triple(facts.grid.origin),
        direction: facts.grid.direction.map(triple),
        value_low: F64::new(facts.scales.value_low),
        value_step: F64::new(facts.scales.value_step),
        magnitude_scale: F64::new(facts.scales.magnitude_scale),
        ..FileHeader::new_zeroed()
    }
}
