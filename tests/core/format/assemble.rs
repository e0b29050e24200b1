//! Files from their parts, written by hand: what the library's own writer is compared with, and what the mutants
//! and the files that must be refused are made of.

use adjsplat::arena::layout::{FileHeader, SectionEntry, SectionKind, header_checksum};
use adjsplat::arena::{Arena, Lane, OwnedLane};
use adjsplat::arena::{Channels, Record};
use adjsplat::internals::LanePacker;
use adjsplat::volume::Axis;
use xxhash_rust::xxh3::xxh3_64;
use zerocopy::byteorder::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes as _, IntoBytes};

use crate::format::scenes::Scene;

/// One voxel: x, y, z and what is stored of it.
pub(crate) type Voxel = ([u16; 3], Record);

/// A section and what its table entry says of it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Part {
    pub(crate) kind: u16,
    pub(crate) axis: u8,
    pub(crate) element_bytes: u8,
    pub(crate) bytes: Vec<u8>,
}

/// A file in parts; offsets, lengths and checksums come with [`Parts::file`].
#[derive(Debug, Clone)]
pub(crate) struct Parts {
    pub(crate) header: FileHeader,
    pub(crate) sections: Vec<Part>,
}

impl Parts {
    /// The parts of a scene's file.
    pub(crate) fn of_scene(scene: &Scene) -> Parts {
        let mut sections = Vec::new();
        if let Some(text) = &scene.description {
            let kind = SectionKind::Description as u16;
            sections.push(Part { kind, axis: 255, element_bytes: 1, bytes: text.as_bytes().to_vec() });
        }
        for (number, level) in (1u16..).zip(scene.of_levels()).collect::<Vec<_>>().into_iter().rev() {
            let bytes = Parts::of_scene(&level).file();
            sections.push(Part { kind: 0x8000 + number, axis: 255, element_bytes: 1, bytes });
        }
        for &axis in &Axis::ALL[..scene.lanes] {
            sections.extend(lane_parts(&pack(scene, axis).view()));
        }
        sections.extend(scene.extra.clone());
        let mut header = adjsplat::arena::layout::header_of(&scene.facts());
        header.minor = U16::new(scene.minor);
        Parts { header, sections }
    }

    /// The parts of a sound file.
    pub(crate) fn of_file(file: &[u8]) -> Parts {
        let arena = Arena::new(file).expect("it is sound");
        let (header, _) = FileHeader::read_from_prefix(file).expect("it has a header");
        let part = |entry: &SectionEntry| Part {
            kind: entry.kind.get(),
            axis: entry.axis,
            element_bytes: entry.element_bytes,
            bytes: arena.section_bytes(entry).to_vec(),
        };
        Parts { header, sections: arena.sections().iter().map(part).collect() }
    }

    /// The section of the level of this number.
    pub(crate) fn level(&mut self, number: u16) -> &mut Part {
        self.sections.iter_mut().find(|s| s.kind == 0x8000 + number).expect("the file has it")
    }

    /// The section of `kind` in the lane along `axis`.
    pub(crate) fn section(&mut self, kind: SectionKind, axis: Axis) -> &mut Part {
        let axis = u8::try_from(axis.index()).unwrap();
        self.sections.iter_mut().find(|s| s.kind == kind as u16 && s.axis == axis).expect("the file has it")
    }

    /// The file's bytes, with every offset, length and checksum right.
    pub(crate) fn file(&self) -> Vec<u8> {
        let mut header = self.header;
        let mut table = Vec::new();
        let mut end = 256 + 32 * self.sections.len();
        for part in &self.sections {
            let offset = end.next_multiple_of(256);
            table.push(SectionEntry {
                kind: U16::new(part.kind),
                axis: part.axis,
                element_bytes: part.element_bytes,
                reserved: U32::ZERO,
                offset: U64::new(offset as u64),
                bytes: U64::new(part.bytes.len() as u64),
                xxh3: U64::new(xxh3_64(&part.bytes)),
            });
            end = offset + part.bytes.len();
        }
        let mut file = vec![0; end.next_multiple_of(256)];
        header.section_count = U32::new(u32::try_from(table.len()).unwrap());
        header.file_bytes = U64::new(file.len() as u64);
        header.header_xxh3 = U64::new(header_checksum(&header, &table));
        file[..256].copy_from_slice(header.as_bytes());
        file[256..][..32 * table.len()].copy_from_slice(table.as_bytes());
        for (entry, part) in table.iter().zip(&self.sections) {
            file[usize::try_from(entry.offset.get()).unwrap()..][..part.bytes.len()].copy_from_slice(&part.bytes);
        }
        file
    }
}

/// Makes the header's checksum right again in a file that was changed in place; one whose table reaches past its
/// end has no right one.
pub(crate) fn repair_header(file: &mut [u8]) {
    let count = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    if 256 + 32 * count <= file.len() {
        file[24..32].fill(0);
        let sum = xxh3_64(&file[..256 + 32 * count]);
        file[24..32].copy_from_slice(&sum.to_le_bytes());
    }
}

fn lane_parts(lane: &Lane) -> Vec<Part> {
    let bytes = [
        lane.tiles.as_bytes().to_vec(),
        lane.line_ends.as_bytes().to_vec(),
        lane.steps.to_vec(),
        lane.values.to_vec(),
        lane.normals.to_vec(),
        lane.magnitudes.to_vec(),
        lane.coverages.to_vec(),
    ];
    let part = |(kind, bytes): (SectionKind, Vec<u8>)| Part {
        kind: kind as u16,
        axis: u8::try_from(lane.axis.index()).unwrap(),
        element_bytes: kind.element_bytes(lane.channels, lane.dims, lane.axis),
        bytes,
    };
    let parts = SectionKind::OF_LANES.into_iter().zip(bytes).map(part);
    parts.filter(|part| part.element_bytes > 0).collect()
}

/// The scene's voxels, packed along `axis`.
pub(crate) fn pack(scene: &Scene, axis: Axis) -> OwnedLane {
    let [u, v] = axis.others().map(Axis::index);
    let along = axis.index();
    let mut voxels = scene.voxels.clone();
    voxels.sort_by_key(|(at, _)| (at[v], at[u], at[along]));
    let mut packer = LanePacker::new(axis, scene.dims, scene.channels, scene.tile_order);
    for line in voxels.chunk_by(|a, b| (a.0[u], a.0[v]) == (b.0[u], b.0[v])) {
        packer.line(line[0].0[u], line[0].0[v], line.iter().map(|(at, record)| (at[along], *record)));
    }
    packer.finish()
}

/// The voxels of a lane in the order of z, y, x: the plain reading.
pub(crate) fn voxels_of(lane: &Lane) -> Vec<Voxel> {
    let [u, v] = lane.axis.others().map(Axis::index);
    let mut voxels = Vec::new();
    for line in lane.lines() {
        for (coordinate, index) in lane.line_voxels(line.records) {
            let mut at = [0; 3];
            at[u] = u16::try_from(line.u).unwrap();
            at[v] = u16::try_from(line.v).unwrap();
            at[lane.axis.index()] = u16::try_from(coordinate).unwrap();
            voxels.push((at, lane.record(index)));
        }
    }
    voxels.sort_by_key(|&([x, y, z], _)| [z, y, x]);
    voxels
}

/// A line of text a voxel: `x y z value normal magnitude`, and the coverage if there are any.
pub(crate) fn listing(voxels: &[Voxel], channels: Channels) -> String {
    let line = |&([x, y, z], r): &Voxel| {
        let coverage = if channels.coverage_bits == 0 { String::new() } else { format!(" {}", r.coverage) };
        format!("{x} {y} {z} {} {} {}{coverage}\n", r.value, r.normal, r.magnitude)
    };
    voxels.iter().map(line).collect()
}
