//! Writing arenas.
//!
//! In: lanes and what they mean. Out: the bytes of `formats/adj-1.md`, to memory or, by [`write_atomically`] or
//! [`write_rows`], to a file.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Read, Seek as _, SeekFrom, Write};
use std::path::Path;

use xxhash_rust::xxh3::{Xxh3, xxh3_64};
use zerocopy::IntoBytes;
use zerocopy::byteorder::little_endian::{U16, U32, U64};

use crate::arena::lane::{LineEnds, OwnedLane};
use crate::arena::layout;
use crate::arena::layout::{Facts, FileHeader, SectionEntry, SectionKind, TileRecord, aligned};
use crate::arena::pack::TileRun;
use crate::arena::rows::Rows;
use crate::build::assemble::{Assembler, LaneTotals};
use crate::build::budget::WRITE_BYTES;
use crate::build::builder::{Observer, Phase, go_on};
use crate::error::{Error, Result};
use crate::file::map::AdjFile;
use crate::file::place::{write_atomically, write_file_atomically};
use crate::file::temporary::unnamed;
use crate::limits::Limits;
use crate::volume::Axis;

/// The bytes of an `.adj` file, in memory.
///
/// `description`: a JSON text. `lanes`: along x, then y, then z, as many as there are.
pub fn arena_bytes(facts: &Facts, lanes: &[OwnedLane], description: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_to(&mut bytes, facts, lanes, description).expect("a vector takes every write");
    bytes
}

/// Writes an `.adj` file, see [`arena_bytes`], and says how many bytes it has.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_arena(path: &Path, facts: &Facts, lanes: &[OwnedLane], description: &str) -> Result<u64> {
    write_atomically(path, |out| write_to(out, facts, lanes, description))
}

/// What [`write_rows`] writes.
pub struct RowsOutput<'a> {
    /// The header's part; its count of visible voxels is counted anew.
    pub facts: Facts,
    /// A JSON text.
    pub description: &'a str,
    /// 1: x. 2: x and y. 3: x, y and z.
    pub lane_count: u8,
    /// Bytes of memory that the process may take; `None` for no limit.
    pub memory: Option<u64>,
    /// Threads to work with; 0 counts as 1.
    pub threads: usize,
}

/// Writes an `.adj` file of the voxels that `rows` gives, in bounded memory; its facts and how many bytes it has.
///
/// The bytes are the same for any memory and any number of threads.
///
/// # Errors
/// As [`write_atomically`]; [`Error::Input`] if there are no voxels; [`Error::Interrupted`] if the observer says
/// so; and what reading the rows gives.
pub fn write_rows(
    path: &Path,
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<(Facts, u64)> {
    write_file_atomically(path, |file| {
        let written = write_rows_to(file, path, rows, output, observer)?;
        // Flushing takes long enough for somebody to change their mind.
        file.sync_all().map_err(Error::io("write", path))?;
        go_on(observer, Phase::Flush, 1, 1)?;
        Ok(written)
    })
}

/// As [`write_rows`], to a file without a name in `folder`, which is opened and goes when it is closed.
///
/// # Errors
/// Likewise.
pub fn open_rows(folder: &Path, rows: &dyn Rows, output: &RowsOutput, observer: &mut dyn Observer) -> Result<AdjFile> {
    let file = unnamed(folder)?;
    write_rows_to(&file, folder, rows, output, observer)?;
    AdjFile::of(&file, folder, &Limits::default())
}

/// Writes what [`write_rows`] says to `file`; `path` is for messages.
fn write_rows_to(
    file: &File,
    path: &Path,
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<(Facts, u64)> {
    let mut place = Placed { file, path, end: 0 };
    let lane_count = usize::from(output.lane_count);
    let lanes = [Axis::X, Axis::Y, Axis::Z].into_iter().take(lane_count);
    let facts = &output.facts;
    let kinds = |axis| {
        SectionKind::OF_LANES.into_iter().filter_map(move |kind| {
            let element = kind.element_bytes(facts.channels, facts.grid.dims, axis);
            (element > 0).then_some((kind, element))
        })
    };
    let section_count = 1 + lanes.clone().map(|axis| kinds(axis).count()).sum::<usize>();
    place.end = (size_of::<FileHeader>() + section_count * size_of::<SectionEntry>()) as u64;

    let mut description = place.section(SectionKind::Description, 255, 1, output.description.len() as u64);
    description.write(output.description.as_bytes())?;
    let mut table = vec![description.finish()?];
    let assembler = Assembler::new(rows, facts.tile_order, output.memory, output.threads);
    let mut visible_voxels = 0;
    for axis in lanes {
        let sections = RefCell::new(Vec::new());
        let mut begin = |totals: &LaneTotals| {
            if totals.voxels == 0 {
                return Err(Error::input("nothing is visible", "no voxel is left to write"));
            }
            visible_voxels = totals.voxels;
            let number = u8::try_from(axis.index()).expect("0, 1 or 2");
            for (kind, element) in kinds(axis) {
                let elements = match kind {
                    SectionKind::Tiles => totals.tiles,
                    SectionKind::LineEnds => totals.lines,
                    _ => totals.records,
                };
                let bytes = elements * u64::from(element);
                sections.borrow_mut().push((kind, place.section(kind, number, element, bytes)));
            }
            Ok(())
        };
        let (mut lines, mut records) = (0u32, 0u64);
        let mut take = |run: TileRun| {
            let tiles: Vec<TileRecord> = run.tiles.iter().map(|tile| tile.moved(lines, records)).collect();
            for (kind, section) in sections.borrow_mut().iter_mut() {
                match kind {
                    SectionKind::Tiles => section.write(tiles.as_bytes())?,
                    SectionKind::LineEnds if section.element_bytes() == 2 => {
                        let narrow = |&end: &u32| U16::new(u16::try_from(end).expect("R14: narrow lines fit"));
                        section.write(run.line_ends.iter().map(narrow).collect::<Vec<_>>().as_bytes())?;
                    }
                    SectionKind::LineEnds => {
                        section.write(run.line_ends.iter().map(|&end| U32::new(end)).collect::<Vec<_>>().as_bytes())?;
                    }
                    SectionKind::Steps => section.write(&run.arrays.steps)?,
                    SectionKind::Values => section.write(&run.arrays.values)?,
                    SectionKind::Normals => section.write(&run.arrays.normals)?,
                    SectionKind::Magnitudes => section.write(&run.arrays.magnitudes)?,
                    SectionKind::Description => {}
                }
            }
            lines += u32::try_from(run.line_ends.len()).expect("a face has fewer than 2^32 lines");
            records += run.arrays.steps.len() as u64;
            Ok(())
        };
        assembler.lane(axis, observer, &mut begin, &mut take)?;
        for (_, section) in sections.into_inner() {
            table.push(section.finish()?);
        }
    }
    let facts = Facts { visible_voxels, ..facts.clone() };
    let bytes = place.finish(&facts, &table)?;
    Ok((facts, bytes))
}

/// A file whose sections are placed one after the other.
struct Placed<'a> {
    file: &'a File,
    path: &'a Path,
    /// Where the last section ends.
    end: u64,
}

impl<'a> Placed<'a> {
    /// The next section, of `bytes` bytes.
    fn section(&mut self, kind: SectionKind, axis: u8, element_bytes: u8, bytes: u64) -> SectionWriter<'a> {
        let offset = aligned(self.end);
        self.end = offset + bytes;
        SectionWriter {
            file: self.file,
            path: self.path,
            entry: SectionEntry {
                kind: U16::new(kind as u16),
                axis,
                element_bytes,
                reserved: U32::ZERO,
                offset: U64::new(offset),
                bytes: U64::new(bytes),
                xxh3: U64::ZERO,
            },
            at: offset,
            gathered: Vec::new(),
            checksum: Xxh3::new(),
        }
    }

    /// Writes the header and the table; says how many bytes the file has. What lies between sections is zeros.
    fn finish(&self, facts: &Facts, table: &[SectionEntry]) -> Result<u64> {
        let header = header_with_checksum(facts, table, self.end);
        let mut file = self.file;
        let mut write = || {
            file.set_len(aligned(self.end))?;
            file.seek(SeekFrom::Start(0))?;
            file.write_all(header.as_bytes())?;
            file.write_all(table.as_bytes())
        };
        write().map_err(Error::io("write", self.path))?;
        Ok(aligned(self.end))
    }
}

/// Writes one section while others are written too.
struct SectionWriter<'a> {
    file: &'a File,
    path: &'a Path,
    entry: SectionEntry,
    /// Where the gathered bytes go.
    at: u64,
    gathered: Vec<u8>,
    checksum: Xxh3,
}

impl SectionWriter<'_> {
    fn element_bytes(&self) -> u8 {
        self.entry.element_bytes
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.checksum.update(bytes);
        if (self.gathered.len() + bytes.len()) as u64 <= WRITE_BYTES {
            self.gathered.extend_from_slice(bytes);
            return Ok(());
        }
        self.flush()?;
        if bytes.len() as u64 > WRITE_BYTES {
            self.put(bytes)
        } else {
            self.gathered.extend_from_slice(bytes);
            Ok(())
        }
    }

    fn flush(&mut self) -> Result<()> {
        let gathered = std::mem::take(&mut self.gathered);
        self.put(&gathered)?;
        self.gathered = gathered;
        self.gathered.clear();
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let mut file = self.file;
        let written = file.seek(SeekFrom::Start(self.at)).and_then(|_| file.write_all(bytes));
        written.map_err(Error::io("write", self.path))?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// The section's entry, when all of it was written.
    fn finish(mut self) -> Result<SectionEntry> {
        self.flush()?;
        assert_eq!(self.at, self.entry.offset.get() + self.entry.bytes.get(), "a section has the length announced");
        self.entry.xxh3 = U64::new(self.checksum.digest());
        Ok(self.entry)
    }
}

fn header_with_checksum(facts: &Facts, table: &[SectionEntry], end: u64) -> FileHeader {
    let mut header = layout::header_of(facts);
    header.section_count = U32::new(u32::try_from(table.len()).expect("at most 19 sections"));
    header.file_bytes = U64::new(aligned(end));
    header.header_xxh3 = U64::new(layout::header_checksum(&header, table));
    header
}

fn write_to(out: &mut dyn Write, facts: &Facts, lanes: &[OwnedLane], description: &str) -> io::Result<u64> {
    let mut sections: Vec<(SectionEntry, &[u8])> = Vec::new();
    let entry = |kind: SectionKind, axis: u8, element_bytes: u8| SectionEntry {
        kind: U16::new(kind as u16),
        axis,
        element_bytes,
        reserved: U32::ZERO,
        offset: U64::ZERO,
        bytes: U64::ZERO,
        xxh3: U64::ZERO,
    };
    sections.push((entry(SectionKind::Description, 255, 1), description.as_bytes()));
    for lane in lanes {
        let view = lane.view();
        let line_ends = match view.line_ends {
            LineEnds::Narrow(ends) => ends.as_bytes(),
            LineEnds::Wide(ends) => ends.as_bytes(),
        };
        let parts = [view.tiles.as_bytes(), line_ends, view.steps, view.values, view.normals, view.magnitudes];
        for (kind, bytes) in SectionKind::OF_LANES.into_iter().zip(parts) {
            let element = kind.element_bytes(facts.channels, facts.grid.dims, view.axis);
            if element > 0 {
                let axis = u8::try_from(view.axis.index()).expect("0, 1 or 2");
                sections.push((entry(kind, axis, element), bytes));
            }
        }
    }
    let mut end = (size_of::<FileHeader>() + sections.len() * size_of::<SectionEntry>()) as u64;
    for (entry, bytes) in &mut sections {
        let offset = aligned(end);
        end = offset + bytes.len() as u64;
        entry.offset = U64::new(offset);
        entry.bytes = U64::new(bytes.len() as u64);
        entry.xxh3 = U64::new(xxh3_64(bytes));
    }
    let table: Vec<SectionEntry> = sections.iter().map(|(entry, _)| *entry).collect();
    let header = header_with_checksum(facts, &table, end);
    out.write_all(header.as_bytes())?;
    out.write_all(table.as_bytes())?;
    fill_up(out, (size_of::<FileHeader>() + size_of_val(table.as_slice())) as u64)?;
    for (_, bytes) in &sections {
        out.write_all(bytes)?;
        fill_up(out, bytes.len() as u64)?;
    }
    Ok(aligned(end))
}

/// Zeros after `bytes` bytes, up to where a section may start.
fn fill_up(out: &mut dyn Write, bytes: u64) -> io::Result<()> {
    io::copy(&mut io::repeat(0).take(aligned(bytes) - bytes), out).map(|_| ())
}
