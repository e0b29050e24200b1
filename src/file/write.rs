//! Writing arenas.
//!
//! In: lanes and what they mean. Out: the bytes of `formats/adj-1.md`, to memory or, by [`write_atomically_unless`],
//! to a file.

use std::io::{self, Read, Write};
use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;
use zerocopy::IntoBytes;
use zerocopy::byteorder::little_endian::{U16, U32, U64};

use crate::arena::builder::{Observer, Phase, go_on};
use crate::arena::lane::{LineEnds, OwnedLane};
use crate::arena::layout::Facts;
use crate::arena::layout::{self, FileHeader, SectionEntry, SectionKind, aligned};
use crate::arena::pack::LanePacker;
use crate::arena::transpose::transpose;
use crate::arena::{Region, Rows};
use crate::error::{Error, Result};
use crate::file::place::write_atomically_unless;
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
/// As [`write_atomically_unless`].
pub fn write_arena(path: &Path, facts: &Facts, lanes: &[OwnedLane], description: &str) -> Result<u64> {
    write_arena_unless(&|| false, path, facts, lanes, description)
}

/// As [`write_arena`], unless `stop` says yes before the file is in its place.
///
/// # Errors
/// As [`write_atomically_unless`].
pub fn write_arena_unless(
    stop: &dyn Fn() -> bool,
    path: &Path,
    facts: &Facts,
    lanes: &[OwnedLane],
    description: &str,
) -> Result<u64> {
    write_atomically_unless(stop, path, |out| write_to(out, facts, lanes, description))
}

/// What [`write_rows`] writes.
pub struct RowsOutput<'a> {
    /// The header's part; its count of visible voxels is counted anew.
    pub facts: Facts,
    /// A JSON text.
    pub description: &'a str,
    /// 1: x. 2: x and y. 3: x, y and z.
    pub lane_count: u8,
    /// Bytes of memory that may be taken.
    pub memory: u64,
    /// Threads to work with, at least 1.
    pub threads: usize,
}

/// Writes an `.adj` file of the voxels that `rows` gives; its facts and how many bytes it has.
///
/// # Errors
/// As [`write_atomically_unless`]; [`crate::error::Error::Input`] if there are no voxels; and what reading the rows
/// gives.
pub fn write_rows(
    path: &Path,
    rows: &dyn Rows,
    output: &RowsOutput,
    observer: &mut dyn Observer,
) -> Result<(Facts, u64)> {
    let dims = rows.dims();
    let mut packer = LanePacker::new(Axis::X, dims, rows.channels(), output.facts.tile_order);
    for z in 0..dims[2] {
        go_on(observer, Phase::Pack, z.into(), dims[2].into())?;
        let region = Region { xs: 0..dims[0], ys: 0..dims[1], zs: z..z + 1 };
        rows.read(region, &mut |y, z, voxels| packer.line(y, z, voxels.iter().map(|v| (v.x, v.record))))?;
    }
    let facts = Facts { visible_voxels: packer.visible(), ..output.facts.clone() };
    if facts.visible_voxels == 0 {
        return Err(Error::input("nothing is visible", "no voxel is left to write"));
    }
    let mut lanes = vec![packer.finish()];
    for axis in [Axis::Y, Axis::Z].into_iter().take(usize::from(output.lane_count) - 1) {
        lanes.push(transpose(&lanes[0].view(), axis, facts.tile_order));
    }
    let bytes = write_arena(path, &facts, &lanes, output.description)?;
    Ok((facts, bytes))
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
    let mut header = layout::header_of(facts);
    header.section_count = U32::new(u32::try_from(table.len()).expect("at most 19 sections"));
    header.file_bytes = U64::new(aligned(end));
    header.header_xxh3 = U64::new(layout::header_checksum(&header, &table));

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
