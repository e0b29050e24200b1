//! Files over 4 GiB with more than 2^32 records, by sparse files: what is zeros takes no disk.
//!
//! Steps of 0 are stepping voxels, so a file of holes is a file of empty lines, and a few records written far behind
//! 2^32 are voxels there. Judged by a small lane of the same voxels, packed in memory: walks, derived lanes and
//! pictures are the same, and record numbers are those that were written.
//!
//! Such a file opens but is not sound (its lines end with stepping voxels), so the check is not run on it. With
//! `ADJ_HUGE=1` a sound file of 4.4 thousand million voxels is written (4.5 GB of disk), checked and walked whole. That
//! the check counts right without it follows from its types: its line, record and byte numbers are `usize` and `u64`
//! throughout; the only 32-bit number that grows with the file is a tile's `first_line`, of which a face of 65,535 x
//! 65,535 lines has 2^32 - 131,071; a line's own counts stay below 65,535 * 255 < 2^24.
//!
//! A batch has 32 bits a record, counted from its base; a batch whose lines lie farther apart is split, which the
//! walks below provoke: in the order y, z, x one slice has lines of the file's first and of its last records.
#![cfg(all(unix, target_pointer_width = "64"))]

use std::fs::File;
use std::io::{BufWriter, Write};
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::Path;

use adjsplat::arena::Record;
use adjsplat::arena::TileRecord;
use adjsplat::arena::layout;
use adjsplat::arena::layout::{Facts, Scales, SectionEntry, SectionKind, aligned};
use adjsplat::arena::{Lane, OwnedLane, TileOrder};
use adjsplat::classify::TransferFunction;
use adjsplat::file::AdjFile;
use adjsplat::internals::LanePacker;
use adjsplat::internals::transpose;
use adjsplat::splat::{Camera, Frame, Lanes, Orbit, Scene, Settings, Surround, cpu};
use adjsplat::traverse::{Batch, Order, Sense, SplitForm, Viewpoint, walk};
use adjsplat::volume::{Axis, Grid};
use adjsplat_tests::say;
use adjsplat_tests::scenes::PLAIN;
use adjsplat_tests::walks::{parallel_orders, visited};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};
use zerocopy::IntoBytes;
use zerocopy::byteorder::little_endian::{U16, U32, U64};

/// The longest lines, and 33 x 32 full tiles of them: 2^32 + 134,150,144 records.
const DIMS: [u32; 3] = [65_535, 264, 256];
const TILES: [u32; 2] = [33, 32];
const LINE: u64 = 65_535;
const LINES: u64 = 264 * 256;
const RECORDS: u64 = LINES * LINE;

/// Where a file's sections start.
struct Offsets {
    line_ends: u64,
    steps: u64,
    values: u64,
}

fn facts(visible_voxels: u64) -> Facts {
    Facts {
        // Voxels far apart along y and z, so that the face is about as wide as the lines are long.
        grid: Grid::new(DIMS.map(u64::from), [1.0, 200.0, 200.0]).unwrap(),
        channels: PLAIN,
        tile_order: TileOrder::Rows,
        scales: Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 0.0 },
        visible_voxels,
    }
}

/// A sparse file: header, table and tiles are there, and all else is zeros. `sums`: of line ends, steps, values.
fn sparse(path: &Path, visible_voxels: u64, sums: [u64; 3]) -> (File, Offsets) {
    let mut tiles = Vec::new();
    for index in 0..TILES[0] * TILES[1] {
        tiles.push(TileRecord {
            tile_u: U16::new(u16::try_from(index % TILES[0]).unwrap()),
            tile_v: U16::new(u16::try_from(index / TILES[0]).unwrap()),
            first_line: U32::new(64 * index),
            first_record: U64::new(64 * LINE * u64::from(index)),
            occupancy: U64::new(u64::MAX),
            low: U16::new(0),
            high: U16::new(65_534),
        });
    }
    let mut table = Vec::new();
    let mut end = 256 + 4 * 32;
    let mut offset_of = |kind: SectionKind, element_bytes: u8, bytes: u64, xxh3: u64| {
        let offset = aligned(end);
        end = offset + bytes;
        table.push(SectionEntry {
            kind: U16::new(kind as u16),
            axis: 0,
            element_bytes,
            reserved: U32::ZERO,
            offset: U64::new(offset),
            bytes: U64::new(bytes),
            xxh3: U64::new(xxh3),
        });
        offset
    };
    let at_tiles = offset_of(SectionKind::Tiles, 28, tiles.as_bytes().len() as u64, xxh3_64(tiles.as_bytes()));
    let offsets = Offsets {
        line_ends: offset_of(SectionKind::LineEnds, 4, 4 * LINES, sums[0]),
        steps: offset_of(SectionKind::Steps, 1, RECORDS, sums[1]),
        values: offset_of(SectionKind::Values, 1, RECORDS, sums[2]),
    };
    let mut header = layout::header_of(&facts(visible_voxels));
    header.section_count = U32::new(4);
    header.file_bytes = U64::new(aligned(end));
    header.header_xxh3 = U64::new(layout::header_checksum(&header, &table));
    let file = File::options().read(true).write(true).create_new(true).open(path).unwrap();
    file.set_len(aligned(end)).unwrap();
    file.write_all_at(header.as_bytes(), 0).unwrap();
    file.write_all_at(table.as_bytes(), 256).unwrap();
    file.write_all_at(tiles.as_bytes(), at_tiles).unwrap();
    (file, offsets)
}

/// A voxel: x, y, z, its value's code and its record.
type Voxel = ([u16; 3], u8, u64);

/// Tiles of which two lines have voxels: records below 2^31, above it, across 2^32 (the second line starts at
/// 2^32 - 1), and the last ones. The first and the last lie in one slice of y.
const INHABITED: [u32; 4] = [32, 600, 1024, 1055];

/// Voxels of the inhabited tiles; and their records' steps, in a file of zeros.
fn voxels() -> (Vec<Voxel>, Vec<(u64, u8)>) {
    let (mut voxels, mut steps) = (Vec::new(), Vec::new());
    for (tile, code) in INHABITED.into_iter().zip([10u8, 20, 30, 40]) {
        for line in 0..2u8 {
            let first = 64 * LINE * u64::from(tile) + LINE * u64::from(line);
            let [u, v] = [tile % TILES[0], tile / TILES[0]].map(|tile| u16::try_from(8 * tile).unwrap());
            // 254 stepping voxels lie before the last one.
            for (at, (record, step, x)) in (0..).zip([(0, 7, 6), (1, 9, 15), (256, 40, 15 + 254 * 255 + 40)]) {
                steps.push((first + record, step));
                voxels.push(([x, u + u16::from(line), v], code + 3 * line + at, first + record));
            }
        }
    }
    (voxels, steps)
}

/// A sparse file with the voxels of [`voxels`].
fn sparse_with_voxels(path: &Path) -> Vec<Voxel> {
    let (voxels, steps) = voxels();
    let (file, offsets) = sparse(path, LINES, [0; 3]);
    for tile in INHABITED {
        let ends = [LINE, 2 * LINE].map(|end| U32::new(u32::try_from(end).unwrap()));
        file.write_all_at(ends.as_bytes(), offsets.line_ends + 4 * 64 * u64::from(tile)).unwrap();
    }
    for (record, step) in steps {
        file.write_all_at(&[step], offsets.steps + record).unwrap();
    }
    for (_, code, record) in &voxels {
        file.write_all_at(&[*code], offsets.values + record).unwrap();
    }
    let taken = file.metadata().unwrap().blocks() * 512;
    assert!(taken < 64 << 20, "this disk knows no holes: {taken} bytes");
    voxels
}

/// The same voxels in a lane that is as small as they are.
fn small_lane(voxels: &[Voxel]) -> OwnedLane {
    let mut packer = LanePacker::new(Axis::X, DIMS, PLAIN, TileOrder::Rows);
    let mut voxels = voxels.to_vec();
    voxels.sort_by_key(|&([x, y, z], ..)| (z, y, x));
    for line in voxels.chunk_by(|a, b| a.0[1..] == b.0[1..]) {
        let record = |code: u8| Record { value: code.into(), ..Record::default() };
        packer.line(line[0].0[1], line[0].0[2], line.iter().map(|&([x, ..], code, _)| (x, record(code))));
    }
    packer.finish()
}

/// What a walk visits: place, value's code, record.
fn visits(lane: &Lane, order: &Order) -> Vec<Voxel> {
    visited(lane, order, |at, record| {
        let at = at.map(|c| u16::try_from(c).unwrap());
        (at, u8::try_from(lane.value_code(record)).unwrap(), record as u64)
    })
}

fn orders() -> Vec<Order> {
    let inside = [[0.5, 1.0, 2.0], [0.5, 2.0, 1.0]].into_iter().flat_map(|toward| {
        [(Sense::BackToFront, SplitForm::Split), (Sense::FrontToBack, SplitForm::Interleaved)].map(|(sense, form)| {
            let eye = [3_000.0, 260.0, 120.0];
            Order::new(Viewpoint::Perspective { eye, toward }, DIMS, sense, form).unwrap()
        })
    });
    parallel_orders().chain(inside).filter(|order| order.fast == Axis::X).collect()
}

#[test]
fn records_beyond_2_to_the_32_are_walked_derived_and_drawn() {
    const { assert!(RECORDS > 1 << 32) };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sparse.adj");
    let voxels = sparse_with_voxels(&path);
    assert!(voxels.iter().any(|&(_, _, record)| record == (1 << 32) - 1), "the last below 2^32");
    assert!(voxels.iter().any(|&(_, _, record)| record == 1 << 32), "the first from 2^32 on");
    let opened = AdjFile::open(&path).unwrap();
    let arena = opened.arena().unwrap();
    let lane = arena.lane(Axis::X).unwrap();
    assert_eq!((lane.record_count(), arena.bytes().len() as u64 > 8 << 30), (RECORDS, true));
    let small = small_lane(&voxels);

    // The plain reading of the directory.
    let lines: Vec<_> =
        INHABITED.iter().flat_map(|&tile| lane.tile_lines(&lane.tiles[tile as usize], u64::MAX).take(2)).collect();
    let read: Vec<Voxel> = lines
        .iter()
        .flat_map(|line| {
            let at = [line.u, line.v].map(|at| u16::try_from(at).unwrap());
            let voxels = lane.line_voxels(line.records.clone());
            voxels.map(move |(x, record)| ([u16::try_from(x).unwrap(), at[0], at[1]], record))
        })
        .map(|(at, record)| (at, u8::try_from(lane.value_code(record)).unwrap(), record as u64))
        .collect();
    assert_eq!(read, voxels);

    let orders = orders();
    assert!(orders.len() > 16);
    for order in &orders {
        let seen = visits(&lane, order);
        let expected = visits(&small.view(), order);
        let but_records = |visits: &[Voxel]| visits.iter().map(|&(at, code, _)| (at, code)).collect::<Vec<_>>();
        assert_eq!(but_records(&seen), but_records(&expected), "{order:?}");
        assert!(seen.iter().all(|visit| voxels.contains(visit)), "{order:?}: {seen:?}");
    }
    for axis in [Axis::Y, Axis::Z] {
        assert!(transpose(&lane, axis, TileOrder::Rows) == transpose(&small.view(), axis, TileOrder::Rows));
    }

    let facts = arena.facts();
    let transfer = TransferFunction::range(1.0, 60.0).unwrap();
    for fov in [None, Some(50.0)] {
        // Almost across x: among voxels so much farther apart along y and z, even so it is the fast axis.
        let orbit = Orbit { azimuth: 0.05, elevation: 70.0, fov, ..Orbit::default() };
        let camera = Camera::orbiting(orbit, Surround::of_grid(&facts.grid), [96, 64]).unwrap();
        let settings = Settings::every_pixel([96, 64]).with_threads(2);
        let draw = |lanes: &dyn Lanes| -> Frame {
            let (frame, stats) = cpu::render(&Scene { facts, lanes, transfer: &transfer }, &camera, &settings).unwrap();
            assert!(stats.splats_drawn >= voxels.len() as u64 / 2, "{stats:?}");
            frame
        };
        let frame = draw(&OneLane(lane));
        assert!(frame.pixels() == draw(&vec![small.clone()]).pixels(), "{fov:?}");
        assert!(frame.pixels().iter().any(|&component| component > 0.0));
    }
}

/// A lane for views whose fast axis is its own.
struct OneLane<'a>(Lane<'a>);

impl Lanes for OneLane<'_> {
    fn lane(&self, axis: Axis) -> adjsplat::Result<Lane<'_>> {
        assert_eq!(axis, self.0.axis, "the views of this test walk along x");
        Ok(self.0)
    }
}

#[test]
fn a_sound_file_of_more_than_2_to_the_32_voxels_passes_the_check() {
    if std::env::var_os("ADJ_HUGE").is_none() {
        say("SKIPPED: ADJ_HUGE=1 writes 4.5 GB to check them");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("full.adj");
    // Every voxel there is, each a step of 1 from the one before, all with code 0: the values are a hole.
    let ends: Vec<U32> =
        (1..=LINES).map(|line| U32::new(u32::try_from(LINE * ((line - 1) % 64 + 1)).unwrap())).collect();
    let block = vec![1u8; 1 << 20];
    let zeros = vec![0u8; 1 << 20];
    let blocks = |block: &[u8], each: &mut dyn FnMut(&[u8])| {
        let mut left = usize::try_from(RECORDS).unwrap();
        while left > 0 {
            each(&block[..left.min(block.len())]);
            left -= left.min(block.len());
        }
    };
    let sum_of = |block: &[u8]| {
        let mut sum = Xxh3::new();
        blocks(block, &mut |block| sum.update(block));
        sum.digest()
    };
    let (file, offsets) = sparse(&path, RECORDS, [xxh3_64(ends.as_bytes()), sum_of(&block), sum_of(&zeros)]);
    file.write_all_at(ends.as_bytes(), offsets.line_ends).unwrap();
    let mut out = BufWriter::new(&file);
    std::io::Seek::seek(&mut out, std::io::SeekFrom::Start(offsets.steps)).unwrap();
    blocks(&block, &mut |block| out.write_all(block).unwrap());
    out.flush().unwrap();
    let opened = AdjFile::open(&path).unwrap();
    let arena = opened.arena().unwrap();
    let checked = arena.check().unwrap();
    assert_eq!((checked.visible_voxels, checked.lanes[0].records), (RECORDS, RECORDS));
    let lane = arena.lane(Axis::X).unwrap();
    // Slow y: each slice takes lines from all over the file.
    let order = (0..6).map(|nesting| Order::parallel(nesting, 5)).find(|o| (o.slow, o.fast) == (Axis::Y, Axis::X));
    let (mut visited, mut sum) = (0u64, 0u128);
    walk(&lane, &order.unwrap(), &mut |batch: &Batch| {
        visited += batch.len() as u64;
        sum += batch.record.iter().map(|&record| u128::from(record)).sum::<u128>();
        sum += u128::from(batch.base) * batch.len() as u128;
    });
    let all = u128::from(RECORDS);
    assert_eq!((visited, sum), (RECORDS, all * (all - 1) / 2));
}
