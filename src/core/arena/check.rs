//! The check: tells whether the content of an open arena follows all rules of the format, in O(bytes).
//!
//! In: an [`Arena`]. Out: counts, or the first broken rule of `formats/adj-1.md` among R12 to R22 and R25 to R27 with its
//! byte. The check allocates nothing that grows with the file, but for one string of the description and, with levels, four
//! bytes a tile. It ends on any bytes: every tile, line and record is read once, because it must start where the previous
//! one ends.
//!
//! ```text
//! for each section in file order: its checksum, the zeros after it, the description's text
//! for each lane: for each tile: its position, mask and first indices
//!                    for each line: its end, its steps, and a hash of each voxel, added to the lane's sum
//! all lanes have the same sum
//! for each level: the same again, and the sum of what the level below gives is the sum of its lanes
//! ```
//!
//! The sums show without sorting that all lanes hold the same voxels: a sum of hashes over (position, value, normal,
//! magnitude, coverage) does not depend on order. The hash is keyed by the file's fingerprint, so that no file can be crafted to
//! fit it. Lanes that differ have equal sums with a probability of about 2^-64.

use std::fmt;
use std::mem::{offset_of, size_of};
use std::ops::Range;

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};
use zerocopy::byteorder::little_endian::F32;

use super::coverage::Coverage;
use super::lane::{Lane, STEPPING};
use super::layout::{
    Channels, Facts, FileHeader, LevelLimits, SectionEntry, SectionKind, TILE_EDGE, TileRecord, line_end_bytes,
};
use super::levels::{CoarserRows, LevelLook, coarser};
use super::open::{Arena, fault, zeros_from};
use super::pager::tell;
use super::rows::{Region, Rows, Voxel};
use crate::error::FormatFault;
use crate::limits::MAX_DESCRIPTION_BYTES;
use crate::volume::Axis;

/// The size and counts of an arena that passed the check.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Checked {
    /// Length of the file in bytes.
    pub bytes: u64,
    /// Number of visible voxels, the same in every lane.
    pub visible_voxels: u64,
    /// The stored lanes, x first.
    pub lanes: Vec<CheckedLane>,
}

/// The size of one lane of an arena that passed the check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct CheckedLane {
    /// The axis along which the lane's lines run.
    pub axis: Axis,
    /// Number of tiles with voxels.
    pub tiles: u64,
    /// Number of lines with voxels.
    pub lines: u64,
    /// Number of records, including stepping voxels.
    pub records: u64,
    /// Number of stepping voxels: records that only bridge a distance.
    pub stepping_voxels: u64,
}

impl Arena<'_> {
    /// Checks everything that [`Arena::new`] did not check: rules R12 to R22 and R25 to R27 of `formats/adj-1.md`.
    ///
    /// In a file that passes, all lanes hold the same voxels, inside the grid, in the only valid way to store them. Any
    /// change of a single byte of such a file makes opening or this check fail. O(bytes): 4 to 7 ns per record, with
    /// all channels and checksums (benches/open.rs).
    ///
    /// # Errors
    /// The first broken rule, with its byte offset in the file.
    pub fn check(&self) -> Result<Checked, FormatFault> {
        let checked = self.check_voxels()?;
        let mut below = self.clone();
        for number in 1..=self.level_count() {
            let section = self.level_section(number).zip(self.level(number));
            let (section, level) = section.expect("the levels were opened with the file");
            let at = section.offset.get();
            level.check_voxels().map_err(|fault| fault.moved(at))?;
            if coverage_sum(&level.rows(), level.fingerprint()) != coarser_sum(&below, level.fingerprint()) {
                let expected = format!("voxels and coverages of level {number} as level {} gives them", number - 1);
                return Err(fault(at, "R26", expected, "another: make the levels again with adj trim"));
            }
            below = level;
        }
        Ok(checked)
    }

    /// Checks all rules but those of levels. Returns the counts.
    fn check_voxels(&self) -> Result<Checked, FormatFault> {
        check_sections(self)?;
        let mut checked = Checked {
            bytes: self.bytes().len() as u64,
            visible_voxels: self.facts().visible_voxels,
            lanes: Vec::with_capacity(3),
        };
        let mut sum_of_x = None;
        for lane in self.lanes() {
            let (counts, sum) = LaneCheck::new(self, lane).run()?;
            let visible = counts.records - counts.stepping_voxels;
            if visible != checked.visible_voxels {
                let expected = format!("{visible} visible voxels, as lane {} has", lane.axis.name());
                let at = offset_of!(FileHeader, visible_voxels) as u64;
                return Err(fault(at, "R19", expected, checked.visible_voxels));
            }
            if sum != *sum_of_x.get_or_insert(sum) {
                let at = section_offset(self, SectionKind::Tiles, lane.axis);
                let got = format!("others in lane {}: rebuild the file", lane.axis.name());
                return Err(fault(at, "R20", "the voxels of lane x", got));
            }
            checked.lanes.push(counts);
        }
        Ok(checked)
    }
}

/// Checks the checksums, the zeros between sections, the description and the limits of levels. R12, R21, R22, R27.
fn check_sections(arena: &Arena) -> Result<(), FormatFault> {
    let bytes = arena.bytes();
    let index = |offset: u64| usize::try_from(offset).unwrap_or(usize::MAX);
    let zeros = |from: u64, to: u64| {
        let between = bytes.get(index(from)..index(to)).unwrap_or_default();
        tell(arena.pager, || between);
        zeros_from(from, "R21", between)
    };
    let mut end = (size_of::<FileHeader>() + size_of_val(arena.sections())) as u64;
    for section in arena.sections() {
        let offset = section.offset.get();
        zeros(end, offset)?;
        let content = arena.section_bytes(section);
        let sum = checksum(arena, content);
        if sum != section.xxh3.get() {
            let got = format!("{sum:#018x} in {}: the file is damaged; rebuild or copy it again", name_of(section));
            return Err(fault(offset, "R12", format!("checksum {:#018x}", section.xxh3), got));
        }
        match section.known_kind() {
            Some(SectionKind::Description) => check_description(offset, arena.description())?,
            Some(SectionKind::LevelLimits) => check_limits(offset, arena.level_limits())?,
            _ => {}
        }
        end = offset + section.bytes.get();
    }
    zeros(end, bytes.len() as u64)
}

/// Returns the XXH3-64 of a section. Reads it in parts if a pager limits resident pages.
fn checksum(arena: &Arena, content: &[u8]) -> u64 {
    let Some(pager) = arena.pager else { return xxh3_64(content) };
    let mut sum = Xxh3::new();
    for piece in content.chunks(1 << 20) {
        pager.about_to_read(piece);
        sum.update(piece);
    }
    sum.digest()
}

fn name_of(section: &SectionEntry) -> String {
    match (section.known_kind(), section.lane_axis()) {
        (Some(kind), Some(axis)) => format!("{} of lane {}", kind.name(), axis.name()),
        (Some(kind), None) => kind.name().to_owned(),
        (None, _) if section.level().is_some() => format!("level {}", section.level().unwrap_or(0)),
        (None, _) => "a section of an optional kind".to_owned(),
    }
}

/// Checks that all limits of levels are sizes in pixels. R27.
fn check_limits(at: u64, limits: &[LevelLimits]) -> Result<(), FormatFault> {
    let all = limits.iter().flat_map(|limits| [limits.standard, limits.draft]);
    for (index, pixels) in (0..).zip(all.map(F32::get)) {
        if !(pixels.is_finite() && pixels >= 0.0) {
            return Err(fault(at + 4 * index, "R27", "a number of pixels, 0 or above", pixels));
        }
    }
    Ok(())
}

/// Checks that the description is a JSON object, not too long, whose numbers and strings can be read. R22.
pub(crate) fn check_description(at: u64, content: &[u8]) -> Result<(), FormatFault> {
    let expected = "a JSON object in UTF-8, at most 127 levels deep";
    if content.len() as u64 > MAX_DESCRIPTION_BYTES {
        return Err(fault(at, "R22", format!("at most {MAX_DESCRIPTION_BYTES} bytes"), content.len()));
    }
    let text =
        std::str::from_utf8(content).map_err(|error| fault(at + error.valid_up_to() as u64, "R22", expected, error))?;
    serde_json::from_str::<SoundJson>(text).map_err(|error| fault(at, "R22", expected, error))?;
    // White space that JSON allows, then the object.
    match text.trim_start_matches([' ', '\t', '\n', '\r']).starts_with('{') {
        true => Ok(()),
        false => Err(fault(at, "R22", expected, "another JSON value")),
    }
}

/// Any JSON value, which is parsed and dropped. Unlike `IgnoredAny` it makes serde_json refuse numbers beyond a double,
/// halves of surrogate pairs, and values more than 127 levels deep.
struct SoundJson;

impl<'de> Deserialize<'de> for SoundJson {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<SoundJson, D::Error> {
        deserializer.deserialize_any(SoundJson)
    }
}

impl<'de> Visitor<'de> for SoundJson {
    type Value = SoundJson;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<SoundJson, E> {
        Ok(self)
    }

    fn visit_bool<E>(self, _: bool) -> Result<SoundJson, E> {
        Ok(self)
    }

    fn visit_u64<E>(self, _: u64) -> Result<SoundJson, E> {
        Ok(self)
    }

    fn visit_i64<E>(self, _: i64) -> Result<SoundJson, E> {
        Ok(self)
    }

    fn visit_f64<E>(self, _: f64) -> Result<SoundJson, E> {
        Ok(self)
    }

    fn visit_str<E>(self, _: &str) -> Result<SoundJson, E> {
        Ok(self)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<SoundJson, A::Error> {
        while let Some(SoundJson) = items.next_element()? {}
        Ok(self)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<SoundJson, A::Error> {
        while let Some((SoundJson, SoundJson)) = members.next_entry()? {}
        Ok(self)
    }
}

fn section_offset(arena: &Arena, kind: SectionKind, axis: Axis) -> u64 {
    arena.section(kind, Some(axis)).map_or(0, |section| section.offset.get())
}

/// Returns the sum of hashes, keyed by `key`, of the places and coverages of the level above `below`, which is sound.
fn coarser_sum(below: &Arena, key: u64) -> u64 {
    let grid = &below.facts().grid;
    let factors = coarser(grid).map(|(_, factors)| factors);
    let factors = factors.unwrap_or_else(|| unreachable!("R24 holds: the level below has a coarser grid"));
    let (rows, look) = (below.rows(), LevelLook::default());
    coverage_sum(&CoarserRows::new(&rows, grid.spacing, factors, &look, 1), key)
}

/// Returns the sum of hashes, keyed by `key`, of the places and coverages of some voxels.
fn coverage_sum(rows: &dyn Rows, key: u64) -> u64 {
    let hash = VoxelHash::new(key);
    let mut sum = 0u64;
    let add = &mut |y: u16, z: u16, voxels: &[Voxel]| {
        for Voxel { x, record } in voxels {
            let place = [(*x, 0), (y, 16), (z, 32)].map(|(part, shift)| u64::from(part) << shift);
            sum = sum.wrapping_add(hash.of(place.into_iter().sum(), record.coverage.into()));
        }
    };
    rows.read(Region::of_grid(rows.dims()), add).expect("a lane in memory is read without errors");
    sum
}

struct LaneCheck<'a> {
    lane: Lane<'a>,
    facts: &'a Facts,
    hash: VoxelHash,
    /// Byte offsets of the lane's sections in the file, in the order of [`SectionKind::OF_LANES`].
    offsets: [u64; 7],
    follow_line: FollowLine,
    stepping_voxels: u64,
    sum: u64,
}

/// A version of [`follow_line`].
type FollowLine = fn(&Lane, Range<usize>, u64, VoxelHash) -> LineOutcome;

struct LineOutcome {
    /// Highest coordinate of the line's voxels, plus 1.
    end: u32,
    stepping_voxels: u32,
    /// Bitwise OR of all codes of stepping voxels; must be 0, because they hold no voxel.
    stray: u64,
    /// Whether a voxel has a coverage that no voxel has.
    is_uncovered: bool,
    sum: u64,
}

impl<'a> LaneCheck<'a> {
    fn new(arena: &'a Arena, lane: Lane<'a>) -> LaneCheck<'a> {
        LaneCheck {
            lane,
            facts: arena.facts(),
            hash: VoxelHash::new(arena.fingerprint()),
            offsets: SectionKind::OF_LANES.map(|kind| section_offset(arena, kind, lane.axis)),
            follow_line: follow_line_by_width(lane.channels),
            stepping_voxels: 0,
            sum: 0,
        }
    }

    /// Checks R13 to R18. Returns the lane's counts and the sum of its voxels' hashes.
    fn run(mut self) -> Result<(CheckedLane, u64), FormatFault> {
        let (lane, mut next_line, mut next_record, mut last_key) = (self.lane, 0usize, 0usize, None);
        for (index, tile) in lane.sweep_tiles().enumerate() {
            tell(lane.pager, || lane.line_ends.bytes_of(tile.lines()));
            let at = self.offsets[0] + (index * size_of::<TileRecord>()) as u64;
            self.check_place(tile, at, &mut last_key)?;
            if tile.first_line.get() as usize != next_line {
                let at = at + offset_of!(TileRecord, first_line) as u64;
                return Err(fault(at, "R14", format!("first line {next_line}"), tile.first_line));
            }
            if tile.first_record.get() != next_record as u64 {
                let at = at + offset_of!(TileRecord, first_record) as u64;
                return Err(fault(at, "R14", format!("first record {next_record}"), tile.first_record));
            }
            let (first_record, mut low, mut high) = (next_record, u32::MAX, 0);
            let mut occupancy = tile.occupancy.get();
            while occupancy != 0 {
                let bit = occupancy.trailing_zeros();
                occupancy &= occupancy - 1;
                let end = self.check_line_end(next_line, first_record, next_record)?;
                let outcome = self.check_line(tile, bit, next_record..end)?;
                low = low.min(self.first_coordinate(next_record));
                high = high.max(outcome.end - 1);
                (next_line, next_record) = (next_line + 1, end);
            }
            if (u32::from(tile.low.get()), u32::from(tile.high.get())) != (low, high) {
                let at = at + offset_of!(TileRecord, low) as u64;
                let got = format!("{} to {}", tile.low, tile.high);
                return Err(fault(at, "R15", format!("coordinates {low} to {high}"), got));
            }
        }
        if next_line != lane.line_ends.len() {
            let at = self.line_end_offset(next_line);
            return Err(fault(at, "R16", format!("{next_line} line ends, as the masks have"), lane.line_ends.len()));
        }
        if next_record != lane.steps.len() {
            let at = self.offsets[2] + next_record as u64;
            return Err(fault(at, "R16", format!("{next_record} records, as the line ends say"), lane.steps.len()));
        }
        let counts = CheckedLane {
            axis: lane.axis,
            tiles: lane.tiles.len() as u64,
            lines: next_line as u64,
            records: next_record as u64,
            stepping_voxels: self.stepping_voxels,
        };
        Ok((counts, self.sum))
    }

    /// Checks that the tile and its lines lie inside the face (the lane's lines as a 2-D array), and that the tile
    /// follows the previous one in tile order. R13.
    fn check_place(&self, tile: &TileRecord, at: u64, last_key: &mut Option<u32>) -> Result<(), FormatFault> {
        let edge = u32::from(TILE_EDGE);
        let dims = self.lane.axis.others().map(|axis| self.lane.dims[axis.index()]);
        let place = [u32::from(tile.tile_u.get()), u32::from(tile.tile_v.get())];
        let tiles = dims.map(|dim| dim.div_ceil(edge));
        if place[0] >= tiles[0] || place[1] >= tiles[1] {
            return Err(fault(at, "R13", format!("a tile of the {} x {}", tiles[0], tiles[1]), format!("{place:?}")));
        }
        let key = tile.key(self.facts.tile_order);
        if last_key.is_some_and(|last| last >= key) {
            let expected = format!("a tile later in {} order", self.facts.tile_order.name());
            return Err(fault(at, "R13", expected, format!("{place:?}")));
        }
        *last_key = Some(key);
        // Where the face ends inside the tile, only `dim - 8 * place` of its lines exist.
        let [across, up] = [0, 1].map(|i| (dims[i] - edge * place[i]).min(edge));
        let inside = (u64::MAX >> (64 - edge * up)) & (0x0101_0101_0101_0101 * (0xff >> (8 - across)));
        let occupancy = tile.occupancy.get();
        if occupancy == 0 || occupancy & !inside != 0 {
            let at = at + offset_of!(TileRecord, occupancy) as u64;
            let expected = format!("at least one of the lines {inside:#018x} and no other");
            return Err(fault(at, "R13", expected, format!("{occupancy:#018x}")));
        }
        Ok(())
    }

    /// Checks the end of a line whose first record is `start`; returns the index after its last record. R16.
    #[inline(always)]
    fn check_line_end(&self, line: usize, first_record: usize, start: usize) -> Result<usize, FormatFault> {
        let (at, records) = (self.line_end_offset(line), self.lane.steps.len());
        let Some(offset) = self.lane.line_ends.get(line) else {
            return Err(fault(at, "R16", "a line end for each line of the masks", "none"));
        };
        // On machines with 32-bit addresses the sum may overflow; then it is out of range too.
        let end = first_record.saturating_add(offset as usize);
        if end <= start || end > records {
            let expected = format!("a line end from {} to {}", start + 1 - first_record, records - first_record);
            return Err(fault(at, "R16", expected, offset));
        }
        Ok(end)
    }

    /// Checks the records of the line at `bit` of the tile's mask. R17, R18, R25.
    #[inline(always)]
    fn check_line(&mut self, tile: &TileRecord, bit: u32, records: Range<usize>) -> Result<LineOutcome, FormatFault> {
        let lane = &self.lane;
        let steps = self.offsets[2];
        let points = lane.dims[lane.axis.index()] as usize;
        lane.about_to_read(records.clone());
        if records.len() > points {
            let at = steps + records.start as u64;
            return Err(fault(at, "R17", format!("at most {points} records on a line"), records.len()));
        }
        if lane.steps[records.end - 1] == 0 {
            return Err(fault(steps + records.end as u64 - 1, "R17", "a voxel at the line's end", "a stepping voxel"));
        }
        let outcome = (self.follow_line)(lane, records.clone(), self.place(tile, bit), self.hash);
        if outcome.end as usize > points {
            let (coordinate, record) = lane
                .line_voxels(records)
                .find(|&(coordinate, _)| coordinate as usize >= points)
                .expect("the line's last record is a voxel, and outside");
            let expected = format!("coordinates below {points}");
            return Err(fault(steps + record as u64, "R17", expected, format!("coordinate {coordinate}")));
        }
        if outcome.stray != 0 {
            return Err(self.stray_fault(records));
        }
        if outcome.is_uncovered {
            let is_wrong = |&record: &usize| {
                lane.steps[record] != 0 && !Coverage::is_code(lane.coverage_code(record), lane.channels)
            };
            let record = records.clone().find(is_wrong).expect("one was found");
            let at = self.offsets[6] + (record * usize::from(lane.channels.coverage_bits / 8)) as u64;
            return Err(fault(at, "R25", "a coverage of some of a block", lane.coverage_code(record)));
        }
        self.stepping_voxels += u64::from(outcome.stepping_voxels);
        self.sum = self.sum.wrapping_add(outcome.sum);
        Ok(outcome)
    }

    /// Returns the line's two coordinates, packed for the voxel hash.
    #[inline(always)]
    fn place(&self, tile: &TileRecord, bit: u32) -> u64 {
        let [u, v] = self.lane.axis.others();
        let line = |tile: u16, within: u32| u64::from(tile) * u64::from(TILE_EDGE) + u64::from(within);
        line(tile.tile_u.get(), bit % 8) << shift(u) | line(tile.tile_v.get(), bit / 8) << shift(v)
    }

    /// Returns the coordinate of the first voxel of a line that passed R17.
    #[inline(always)]
    fn first_coordinate(&self, first: usize) -> u32 {
        let mut steps = (0u32..).zip(&self.lane.steps[first..]);
        let voxel = steps.find(|&(_, &step)| step != 0);
        voxel.map_or(0, |(stepping_voxels, &step)| stepping_voxels * STEPPING + u32::from(step) - 1)
    }

    /// Returns the fault for the first stepping voxel of a line with a code that is not 0. R18.
    fn stray_fault(&self, records: Range<usize>) -> FormatFault {
        let lane = &self.lane;
        let channels = [lane.values, lane.normals, lane.magnitudes, lane.coverages].into_iter();
        let [_, widths @ ..] = lane.channels.widths();
        for record in records.clone().filter(|&record| lane.steps[record] == 0) {
            for ((channel, width), offset) in channels.clone().zip(widths).zip(&self.offsets[3..]) {
                let from = record * width;
                let bytes = channel.get(from..from + width).unwrap_or_default();
                if let Err(fault) = zeros_from(offset + from as u64, "R18", bytes) {
                    return fault;
                }
            }
        }
        fault(self.offsets[2] + records.start as u64, "R18", "stepping voxels that carry nothing", "others")
    }

    fn line_end_offset(&self, line: usize) -> u64 {
        let width = line_end_bytes(self.lane.dims[self.lane.axis.index()]);
        self.offsets[1] + line as u64 * u64::from(width)
    }
}

/// Returns the bit at which a coordinate on `axis` starts in a position packed for the voxel hash.
const fn shift(axis: Axis) -> u32 {
    16 * axis as u32
}

/// A keyed hash of voxels: two folded multiplications.
#[derive(Debug, Clone, Copy)]
struct VoxelHash {
    key: [u64; 2],
}

impl VoxelHash {
    fn new(key: u64) -> VoxelHash {
        VoxelHash { key: [xxh3_64(&key.to_le_bytes()), key] }
    }

    /// Hashes x, y, z and value (`place`, 16 bits each), normal, magnitude and coverage (`shading`, 32, 8 and 16 bits).
    #[inline(always)]
    fn of(self, place: u64, shading: u64) -> u64 {
        let folded = fold(place ^ self.key[0], 0x9e37_79b9_7f4a_7c15);
        fold(folded ^ shading ^ self.key[1], 0xd6e8_feb8_6659_fd93 ^ shading.rotate_left(17))
    }
}

/// Multiplies `a` by `b`, and combines the halves of the 128-bit product by exclusive or.
#[inline(always)]
fn fold(a: u64, b: u64) -> u64 {
    let product = u128::from(a) * u128::from(b);
    #[allow(clippy::cast_possible_truncation, reason = "the halves are wanted")]
    let halves = (product as u64, (product >> 64) as u64);
    halves.0 ^ halves.1
}

/// Adds up the steps of a line and hashes its voxels; `V`, `N`, `M` and `C` are the bytes of a value, normal, magnitude
/// and coverage.
///
/// `records` must lie inside the channels and number at most 65,535. `place` holds the line's two coordinates.
#[inline(always)]
fn follow_line<const V: usize, const N: usize, const M: usize, const C: usize>(
    lane: &Lane,
    records: Range<usize>,
    place: u64,
    hash: VoxelHash,
) -> LineOutcome {
    let (from, count) = (records.start, records.len());
    let steps = &lane.steps[from..][..count];
    let values = &lane.values[V * from..][..V * count];
    let normals = &lane.normals[N * from..][..N * count];
    let magnitudes = &lane.magnitudes[M * from..][..M * count];
    let coverages = &lane.coverages[C * from..][..C * count];
    let shift = shift(lane.axis);
    let mut outcome = LineOutcome { end: 0, stepping_voxels: 0, stray: 0, is_uncovered: false, sum: 0 };
    for (record, &step) in steps.iter().enumerate() {
        let value = number::<V>(values, record);
        let coverage = number::<C>(coverages, record);
        let shading = number::<N>(normals, record) | number::<M>(magnitudes, record) << 32 | coverage << 40;
        if step == 0 {
            outcome.end += STEPPING;
            outcome.stepping_voxels += 1;
            outcome.stray |= value | shading;
        } else {
            outcome.end += u32::from(step);
            outcome.is_uncovered |= C > 0 && !Coverage::is_code_of(coverage, C == 1);
            let place = place | u64::from(outcome.end - 1) << shift | value << 48;
            outcome.sum = outcome.sum.wrapping_add(hash.of(place, shading));
        }
    }
    outcome
}

/// Returns the version of [`follow_line`] that is compiled for these widths.
fn follow_line_by_width(channels: Channels) -> FollowLine {
    match channels.coverage_bits {
        0 => follow_line_of::<0>(channels),
        8 => follow_line_of::<1>(channels),
        _ => follow_line_of::<2>(channels),
    }
}

fn follow_line_of<const C: usize>(channels: Channels) -> FollowLine {
    match (channels.value_bits, channels.normal_bits, channels.magnitude_bits) {
        (8, 0, 0) => follow_line::<1, 0, 0, C>,
        (8, 0, _) => follow_line::<1, 0, 1, C>,
        (8, 8, 0) => follow_line::<1, 2, 0, C>,
        (8, 8, _) => follow_line::<1, 2, 1, C>,
        (8, _, 0) => follow_line::<1, 4, 0, C>,
        (8, _, _) => follow_line::<1, 4, 1, C>,
        (_, 0, 0) => follow_line::<2, 0, 0, C>,
        (_, 0, _) => follow_line::<2, 0, 1, C>,
        (_, 8, 0) => follow_line::<2, 2, 0, C>,
        (_, 8, _) => follow_line::<2, 2, 1, C>,
        (_, _, 0) => follow_line::<2, 4, 0, C>,
        (_, _, _) => follow_line::<2, 4, 1, C>,
    }
}

/// Returns element `index` of a little-endian channel with `W` bytes (0 to 4) per element.
#[inline(always)]
fn number<const W: usize>(channel: &[u8], index: usize) -> u64 {
    let mut bytes = [0; 8];
    bytes[..W].copy_from_slice(&channel[W * index..W * index + W]);
    u64::from_le_bytes(bytes)
}
