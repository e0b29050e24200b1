//! Writing `.adj` files.
//!
//! In: lanes, or rows of voxels, with their header facts. Out: the bytes that `formats/adj-1.md` specifies, in memory
//! or in a file.

use std::cell::RefCell;
use std::fs::File;
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;
use zerocopy::IntoBytes;
use zerocopy::byteorder::little_endian::{U16, U32, U64};

use super::atomic::{scratch_folder, write_file_atomically};
use super::atomic_temporary::unnamed;
use super::levels::{bounded, levels_in_files, levels_in_memory, most_resident};
use super::map::AdjFile;
use super::sections::SectionFile;
use crate::arena::lane::stored_line_ends;
use crate::arena::layout::{self, Facts, FileHeader, LevelLimits, SectionEntry, SectionKind, TileRecord, aligned};
use crate::arena::pack::{ChannelArrays, TileRun};
use crate::arena::pager::tell;
use crate::arena::{Arena, Channels, Levels, MOST_LEVELS, OwnedLane, Rows};
use crate::build::assemble::{Assembler, LaneTotals};
use crate::build::builder::lanes_of;
use crate::build::progress::{Observer, Phase, report};
use crate::build::{BuildOptions, Classified, Resources};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::splat::level_limits::measure;
use crate::volume::Axis;

/// Returns the bytes of an `.adj` file.
///
/// `description` is a JSON text of at most [`MAX_DESCRIPTION_BYTES`](crate::limits::MAX_DESCRIPTION_BYTES). `lanes` are
/// the lanes to store: along x, or x and y, or x, y and z.
pub fn arena_bytes(facts: &Facts, lanes: &[OwnedLane], description: &str) -> Vec<u8> {
    bytes_with_levels(facts, lanes, description, &[], &[])
}

/// Returns the bytes of an `.adj` file like [`arena_bytes`], with coarser levels, from level 1 on, and their limits.
fn bytes_with_levels(
    facts: &Facts,
    lanes: &[OwnedLane],
    description: &str,
    levels: &[Vec<u8>],
    limits: &[LevelLimits],
) -> Vec<u8> {
    let mut sections = vec![(SectionEntry::empty(SectionKind::Description, None, 1), description.as_bytes())];
    if !limits.is_empty() {
        sections.push((limits_entry(), limits.as_bytes()));
    }
    sections
        .extend((1..=MOST_LEVELS).zip(levels).rev().map(|(level, bytes)| (SectionEntry::of_level(level), &bytes[..])));
    for lane in lanes {
        let OwnedLane { tiles, line_ends, steps, values, normals, magnitudes, coverages, .. } = lane;
        let parts = [tiles.as_bytes(), line_ends, steps, values, normals, magnitudes, coverages];
        let stored = lane_entries(facts, lane.axis).into_iter().zip(parts);
        sections.extend(stored.filter_map(|(entry, bytes)| Some((entry?, bytes))));
    }
    let mut end = (size_of::<FileHeader>() + sections.len() * size_of::<SectionEntry>()) as u64;
    for (entry, bytes) in &mut sections {
        entry.offset = U64::new(aligned(end));
        entry.bytes = U64::new(bytes.len() as u64);
        entry.xxh3 = U64::new(xxh3_64(bytes));
        end = aligned(end) + bytes.len() as u64;
    }
    let table: Vec<SectionEntry> = sections.iter().map(|(entry, _)| *entry).collect();
    let mut file = header_with_checksum(facts, &table, end).as_bytes().to_vec();
    let whole = usize::try_from(aligned(end)).expect("the lanes are in memory");
    file.reserve_exact(whole - file.len());
    file.extend_from_slice(table.as_bytes());
    for (entry, bytes) in &sections {
        file.resize(usize::try_from(entry.offset.get()).expect("below the whole"), 0);
        file.extend_from_slice(bytes);
    }
    file.resize(whole, 0);
    file
}

/// Returns the entry of the section of the levels' limits, without a position.
fn limits_entry() -> SectionEntry {
    SectionEntry::empty(SectionKind::LevelLimits, None, u8::try_from(size_of::<LevelLimits>()).expect("8"))
}

/// Returns the bytes of an `.adj` file like [`bytes_with_levels`], with these limits; `None` measures them.
fn bytes_with_limits(
    lanes: &[OwnedLane],
    levels: &[Vec<u8>],
    limits: Option<&[LevelLimits]>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<u8>> {
    let bytes = |limits: &[_]| bytes_with_levels(&output.facts, lanes, output.description, levels, limits);
    // In a browser drawing the levels would take minutes.
    let limits = if cfg!(target_arch = "wasm32") { limits.or(Some(&[])) } else { limits };
    let unmeasured = vec![LevelLimits::default(); levels.len()];
    let file = bytes(limits.unwrap_or(&unmeasured));
    if limits.is_some() || levels.is_empty() {
        return Ok(file);
    }
    let arena = Arena::new(&file).map_err(|fault| Error::Format { path: "memory".into(), fault })?;
    let limits = measured(&arena, output, observer)?;
    drop(file);
    Ok(bytes(&limits))
}

/// Returns the limits of the levels of a file that is written but for these.
fn measured(arena: &Arena, output: &RowsOutput, observer: &mut dyn Observer) -> Result<Vec<LevelLimits>> {
    measure(arena, output.memory, output.threads, &mut |done, total| report(observer, Phase::Limits, done, total))
}

/// Returns the entries of a lane's sections, without positions; `None` for a channel that is not stored.
fn lane_entries(facts: &Facts, axis: Axis) -> [Option<SectionEntry>; 7] {
    SectionKind::OF_LANES.map(|kind| {
        let element = kind.element_bytes(facts.channels, facts.grid.dims, axis);
        (element > 0).then(|| SectionEntry::empty(kind, Some(axis), element))
    })
}

/// Tells [`write_rows`] what to write beside the voxels, and which resources it may use.
#[derive(Clone)]
pub struct RowsOutput<'a> {
    /// Contents of the file's header; the number of visible voxels is replaced by a new count.
    pub facts: Facts,
    /// Description of the file for people and tools: a JSON text.
    pub description: &'a str,
    /// Number of stored lanes: 1 for x, 2 for x and y, 3 for x, y and z.
    pub lane_count: u8,
    /// Most bytes of memory that the process may use; `None` for no limit.
    pub memory: Option<u64>,
    /// Number of worker threads; 0 counts as 1.
    pub threads: usize,
    /// The coarser levels of detail to make.
    pub levels: Levels,
}

impl<'a> RowsOutput<'a> {
    /// Returns what to write beside the voxels of `built`, which were classified with these options and resources.
    pub fn of_build(
        built: &Classified,
        description: &'a str,
        options: &BuildOptions,
        resources: &Resources,
    ) -> RowsOutput<'a> {
        let &BuildOptions { lane_count, levels, .. } = options;
        let &Resources { memory, threads, .. } = resources;
        RowsOutput { facts: built.facts.clone(), description, lane_count, memory, threads, levels }
    }
}

/// Levels that are there already.
pub(crate) struct GivenLevels<'a> {
    /// Their voxels, from level 1 on.
    pub(crate) rows: Vec<Box<dyn Rows + 'a>>,
    /// Their limits; `None` measures them, and an empty list leaves them out.
    pub(crate) limits: Option<Vec<LevelLimits>>,
}

/// Returns the bytes of an `.adj` file with the voxels of `rows`, which are `output.facts.visible_voxels`. `None` makes its levels.
///
/// # Errors
/// Any error of reading the rows; [`Error::Interrupted`] if the observer cancels.
pub(crate) fn bytes_of_rows(
    rows: &dyn Rows,
    given: Option<&GivenLevels>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<Vec<u8>> {
    let levels = levels_in_memory(rows, given, output, observer)?;
    let lanes = lanes_of(rows, &output.facts, output.lane_count, output.threads, observer)?;
    bytes_with_limits(&lanes, &levels, given.and_then(|given| given.limits.as_deref()), output, observer)
}

/// Writes the voxels of `rows` to an `.adj` file, with bounded memory. Returns its header facts and length in bytes.
///
/// The bytes of the file do not depend on memory or threads.
///
/// # Errors
/// The same as [`write_atomically`](super::write_atomically); [`Error::Input`] if there are no voxels; [`Error::Limit`] if
/// the description is longer than the format allows; [`Error::Interrupted`] if the observer cancels; any error of reading
/// the rows.
pub fn write_rows(
    path: &Path,
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<(Facts, u64)> {
    write_rows_and_levels(path, rows, None, output, observer)
}

/// Writes an `.adj` file like [`write_rows`] with these levels; `None` makes them.
///
/// # Errors
/// The same as [`write_rows`].
pub(crate) fn write_rows_and_levels(
    path: &Path,
    rows: &dyn Rows,
    given: Option<&GivenLevels>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<(Facts, u64)> {
    write_file(path, observer, |file, observer| {
        write_rows_to(file, path, &scratch_folder(path)?, rows, given, output, observer)
    })
}

fn write_file(
    path: &Path,
    observer: &mut dyn Observer,
    write: impl FnOnce(&File, &mut dyn Observer) -> Result<(Facts, u64)>,
) -> Result<(Facts, u64)> {
    let flushed = |(written, observer)| report(observer, Phase::Flush, 1, 1).map(|()| written);
    write_file_atomically(path, |file| Ok((write(file, observer)?, observer)), flushed)
}

/// Writes the voxels of `rows` like [`write_rows`], but to a file without a name in `folder`, and opens that file.
///
/// The file disappears when it is closed.
///
/// # Errors
/// The same as [`write_rows`].
pub fn open_rows(folder: &Path, rows: &dyn Rows, output: &RowsOutput, observer: &mut dyn Observer) -> Result<AdjFile> {
    open_rows_and_levels(folder, rows, None, output, observer)
}

/// Writes an `.adj` file like [`open_rows`] with these levels; `None` makes them.
///
/// # Errors
/// The same as [`write_rows`].
pub(crate) fn open_rows_and_levels(
    folder: &Path,
    rows: &dyn Rows,
    given: Option<&GivenLevels>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<AdjFile> {
    let file = unnamed(folder)?;
    let of_unnamed = |fault| match fault {
        Error::Io { action: "write", path, source } => Error::io("write a temporary file in", &path)(source),
        other => other,
    };
    write_rows_to(&file, folder, folder, rows, given, output, observer).map_err(of_unnamed)?;
    AdjFile::of(&file, folder, &Limits::default())
}

/// Writes the voxels of `rows`, and levels, to `file`; `path` is used in messages. `None` makes the levels. They are held in `folder`.
fn write_rows_to(
    file: &File,
    path: &Path,
    folder: &Path,
    rows: &dyn Rows,
    given: Option<&GivenLevels>,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<(Facts, u64)> {
    Limits::check_description(output.description)?;
    let levels = levels_in_files(folder, rows, given, output, observer)?;
    write_sections(file, path, (levels, given.and_then(|given| given.limits.as_deref())), rows, output, observer)
}

/// Returns the facts with which rows are written: normals have a coherence if those of the rows have. Levels that an older version
/// made have none.
pub(super) fn facts_of_rows(facts: &Facts, rows: &dyn Rows) -> Facts {
    let coherence = rows.channels().coherence && facts.channels.normal_bits > 0;
    Facts { channels: Channels { coherence, ..facts.channels }, ..facts.clone() }
}

/// Writes the voxels of `rows`, and `levels` with their limits, to `file`; `path` is used in messages. `None` measures them.
fn write_sections(
    file: &File,
    path: &Path,
    (levels, limits): (Vec<AdjFile>, Option<&[LevelLimits]>),
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<(Facts, u64)> {
    let mut out = SectionFile { file, path, end: 0 };
    let lanes = Axis::ALL.into_iter().take(output.lane_count.into());
    let facts = &facts_of_rows(&output.facts, rows);
    facts.grid.check()?;
    let entries = |axis| lane_entries(facts, axis);
    let unmeasured = vec![LevelLimits::default(); levels.len()];
    let first_limits = limits.unwrap_or(&unmeasured);
    let section_count =
        1 + usize::from(!first_limits.is_empty()) + levels.len() + lanes.clone().flat_map(entries).flatten().count();
    out.end = (size_of::<FileHeader>() + section_count * size_of::<SectionEntry>()) as u64;

    let text = output.description.as_bytes();
    let mut description = out.section(SectionEntry::empty(SectionKind::Description, None, 1), text.len() as u64);
    description.write(text)?;
    let mut table = vec![description.finish()?];
    if !first_limits.is_empty() {
        let mut section = out.section(limits_entry(), size_of_val(first_limits) as u64);
        section.write(first_limits.as_bytes())?;
        table.push(section.finish()?);
    }
    for (number, level) in (1..=MOST_LEVELS).zip(levels).rev() {
        let arena = level.arena()?;
        let mut section = out.section(SectionEntry::of_level(number), arena.bytes().len() as u64);
        for part in arena.bytes().chunks(1 << 20) {
            tell(arena.pager, || part);
            section.write(part)?;
        }
        table.push(section.finish()?);
    }
    let assembler = Assembler::new(rows, facts.tile_order, output.memory, output.threads);
    let mut visible_voxels = 0;
    for axis in lanes {
        let sections = RefCell::new(Vec::new());
        let mut begin = |totals: &LaneTotals| {
            if totals.voxels == 0 {
                return Err(Error::input("nothing is visible", "no voxel is left to write"));
            }
            visible_voxels = totals.voxels;
            let LaneTotals { tiles, lines, records, .. } = *totals;
            let counts = [tiles, lines, records, records, records, records, records];
            for (entry, count) in entries(axis).into_iter().zip(counts) {
                let section = entry.map(|entry| out.section(entry, count * u64::from(entry.element_bytes)));
                sections.borrow_mut().push(section);
            }
            Ok(())
        };
        let (mut lines, mut records) = (0u32, 0u64);
        let mut take = |run: TileRun| {
            let tiles: Vec<TileRecord> = run.tiles.iter().map(|tile| tile.moved(lines, records)).collect();
            let line_ends = stored_line_ends(&run.line_ends, facts.grid.dims[axis.index()]);
            let ChannelArrays { steps, values, normals, magnitudes, coverages } = &run.arrays;
            let parts = [tiles.as_bytes(), &line_ends, steps, values, normals, magnitudes, coverages];
            for (section, bytes) in sections.borrow_mut().iter_mut().zip(parts) {
                section.as_mut().map_or(Ok(()), |section| section.write(bytes))?;
            }
            lines += u32::try_from(run.line_ends.len()).expect("a face has fewer than 2^32 lines");
            records += steps.len() as u64;
            Ok(())
        };
        assembler.lane(axis, observer, &mut begin, &mut take)?;
        for section in sections.into_inner().into_iter().flatten() {
            table.push(section.finish()?);
        }
    }
    let facts = Facts { visible_voxels, ..facts.clone() };
    let bytes = out.finish(&facts, &table)?;
    if limits.is_none() && !unmeasured.is_empty() {
        let written = bounded(AdjFile::of(file, path, &Limits::default())?, most_resident(output))?;
        let limits = measured(&written.arena()?, output, observer)?;
        drop(written);
        let mut section = out.again(table[1]);
        section.write(limits.as_bytes())?;
        table[1] = section.finish()?;
        out.finish(&facts, &table)?;
    }
    Ok((facts, bytes))
}

/// Returns the header for a file whose last section ends at byte `end`.
pub(super) fn header_with_checksum(facts: &Facts, table: &[SectionEntry], end: u64) -> FileHeader {
    let mut header = layout::header_of(facts);
    let has = |kind: SectionKind| table.iter().any(|entry| entry.known_kind() == Some(kind));
    header.minor = U16::new(match (has(SectionKind::Coverage), has(SectionKind::LevelLimits)) {
        // In a higher version the normals of coverages would have a coherence.
        (true, _) if !facts.channels.coherence => layout::LEVELS_MINOR,
        (_, true) => layout::LIMITED_MINOR,
        (true, _) => layout::COHERENT_MINOR,
        _ if table.iter().any(|entry| entry.level().is_some()) => layout::LEVELS_MINOR,
        _ => 0,
    });
    header.section_count = U32::new(u32::try_from(table.len()).expect("at most 1,024 sections"));
    header.file_bytes = U64::new(aligned(end));
    header.header_xxh3 = U64::new(layout::header_checksum(&header, table));
    header
}
