//! A file's directory: all but the channels, fetched in few parts, and checks of what was fetched.

use std::sync::Arc;

use adjsplat::arena::layout::{FileHeader, LIMITED_MINOR, SectionEntry, SectionKind, header_checksum};
use adjsplat::arena::{Arena, CodeCounts, Directory, Levels};
use adjsplat::error::{Error, Result};
use adjsplat::limits::Limits;
use adjsplat::splat::{Lanes as _, Orbit, Settings};
use adjsplat::traverse::Viewpoint;
use adjsplat::volume::Axis;
use adjsplat::{Build, Model, TransferFunction, Volume};
use zerocopy::byteorder::little_endian::U16;
use zerocopy::{FromBytes as _, IntoBytes as _};

use crate::format::assemble::{Part, Parts};

/// An .adj file of a ball with the lanes x, y and z.
fn file() -> Vec<u8> {
    built(Levels::default())
}

fn built(levels: Levels) -> Vec<u8> {
    let at = |i: u16| [i % 20, i / 20 % 24, i / 480].map(|c| f32::from(c) - 10.0);
    let value = |i: u16| 200.0 - 18.0 * at(i).iter().map(|c| c * c).sum::<f32>().sqrt();
    let volume = Volume::new([20, 24, 22], (0..20 * 24 * 22).map(value).collect::<Vec<_>>()).unwrap();
    let build = Build::new(TransferFunction::range(60.0, 255.0).unwrap()).with_levels(levels);
    let model = build.run(&volume).unwrap();
    model.arena().unwrap().bytes().to_vec()
}

/// The bytes with which reading begins: a file may be shorter than [`Directory::HEAD`].
fn head_of(file: &[u8]) -> &[u8] {
    &file[..file.len().min(usize::try_from(Directory::HEAD).unwrap())]
}

fn begun(file: &[u8]) -> Directory {
    Directory::new(head_of(file), file.len() as u64, &Limits::default(), "ball.adj").unwrap()
}

/// The directory of a file that need not be sound, with levels.
pub(crate) fn opened_from_afar(file: &[u8]) -> Result<Directory> {
    let limits = Limits::default();
    let mut directory = Directory::new(head_of(file), file.len() as u64, &limits, "ball.adj")?;
    let heads: Vec<_> = directory.level_heads().iter().map(|range| bytes_of(file, range)).collect();
    directory.add_levels(&heads, &limits, "ball.adj")?;
    Ok(directory)
}

fn bytes_of(file: &[u8], range: &std::ops::Range<u64>) -> Vec<u8> {
    file[usize::try_from(range.start).unwrap()..usize::try_from(range.end).unwrap()].to_vec()
}

/// The directory, and how many requests it took beside those of the heads.
fn fetched(file: &[u8], most: u64) -> (Directory, usize) {
    let (mut directory, mut requests) = (opened_from_afar(file).unwrap(), 0);
    loop {
        let ranges = directory.wanted(most);
        if ranges.is_empty() {
            return (directory, requests);
        }
        assert!(ranges.iter().map(|range| range.end - range.start).sum::<u64>() <= most);
        ranges.iter().for_each(|range| directory.append(&bytes_of(file, range)).unwrap());
        requests += ranges.len();
    }
}

#[test]
fn it_has_the_files_header_description_tiles_and_line_ends() {
    let whole = file();
    let arena = Arena::new(&whole).unwrap();
    let (directory, requests) = fetched(&whole, u64::MAX);
    assert_eq!(requests, 3, "the lanes' directories, and what is beside the first");
    directory.check("ball.adj").unwrap();
    for most in [1, 100, 1_000] {
        assert_eq!(fetched(&whole, most).0.progress(), directory.progress(), "{most}");
        fetched(&whole, most).0.check("ball.adj").unwrap();
    }
    let model = Model::from_directory(Arc::new(directory), Vec::new(), "ball.adj").unwrap();
    let part = model.arena().unwrap();
    assert!(part.bytes().len() * 10 < whole.len() * 3, "{} of {}", part.bytes().len(), whole.len());
    assert_eq!(part.facts(), arena.facts());
    assert_eq!(part.description(), arena.description());
    for axis in Axis::ALL {
        let [want, got] = [&arena, &part].map(|arena| arena.lane(axis).unwrap());
        assert_eq!(want.tiles, got.tiles);
        assert_eq!(want.line_ends.as_bytes(), got.line_ends.as_bytes());
        assert_eq!((want.record_count(), want.bytes(), want.bounds()), (got.record_count(), got.bytes(), got.bounds()));
        assert!(got.steps.is_empty());
    }
}

/// Its bytes were never wanted, and so the directory never complete.
#[test]
fn an_empty_section_at_the_end_needs_no_bytes() {
    let mut parts = Parts::of_file(&file());
    parts.header.minor = U16::new(LIMITED_MINOR);
    parts.sections.push(Part { kind: SectionKind::LevelLimits as u16, axis: 255, element_bytes: 8, bytes: Vec::new() });
    let whole = parts.file();
    Arena::new(&whole).unwrap().check().unwrap();
    let (directory, requests) = fetched(&whole, u64::MAX);
    assert_eq!(requests, fetched(&file(), u64::MAX).1);
    directory.check("ball.adj").unwrap();
}

#[test]
fn parts_are_the_channels_of_a_lane() {
    let whole = file();
    let arena = Arena::new(&whole).unwrap();
    let (directory, _) = fetched(&whole, u64::MAX);
    for axis in Axis::ALL {
        let lane = arena.lane(axis).unwrap();
        let parts = directory.parts(axis, 300..=1_000);
        assert!(parts.len() > 8, "{parts:?}");
        let (mut channels, mut counts) = ([const { Vec::new() }; 5], CodeCounts::default());
        let mut check = directory.channel_check(axis);
        for part in &parts {
            let bytes = part.ranges.each_ref().map(|range| bytes_of(&whole, range));
            assert_eq!(part.first, channels[0].len() as u64);
            assert!(part.first.is_multiple_of(4) && bytes.iter().map(Vec::len).sum::<usize>() <= 1_016);
            let slices = bytes.each_ref().map(|bytes| &bytes[..]);
            check.add(slices);
            counts.add(lane.channels, slices);
            channels.iter_mut().zip(slices).for_each(|(all, bytes)| all.extend_from_slice(bytes));
        }
        check.finish("ball.adj").unwrap();
        assert_eq!(
            channels.each_ref().map(|bytes| &bytes[..]),
            [lane.steps, lane.values, lane.normals, lane.magnitudes, lane.coverages]
        );
        assert_eq!(counts, CodeCounts::of(&lane));
        assert_eq!(counts.largest(), lane.largest_value_code());
        assert_eq!(counts.by_value().iter().sum::<u64>(), arena.facts().visible_voxels);
    }
}

#[test]
fn the_first_lane_alone_is_a_valid_file_that_draws_the_same_pictures() {
    let whole = file();
    let mut lane = Directory::first_lane(head_of(&whole), whole.len() as u64, &Limits::default(), "ball.adj").unwrap();
    while let [range, ..] = &lane.wanted(5_000)[..] {
        lane.append(&bytes_of(&whole, range)).unwrap();
    }
    lane.check("ball.adj").unwrap();
    let part = lane.into_bytes();
    assert!(part.len() * 100 < 45 * whole.len(), "{} of {}", part.len(), whole.len());
    Arena::new(&part).unwrap().check().unwrap();
    let (all, one) = (Model::from_bytes(whole).unwrap(), Model::from_bytes(part).unwrap());
    assert_eq!((all.grid(), all.transfer()), (one.grid(), one.transfer()));
    for (azimuth, elevation) in [(0.0, 0.0), (90.0, 10.0), (20.0, 80.0)] {
        let (orbit, settings) = (Orbit { azimuth, elevation, ..Orbit::default() }, Settings::new([60, 50]));
        let picture = |model: &Model| model.render(&orbit, &settings).unwrap();
        assert!(picture(&all).pixels() == picture(&one).pixels(), "{azimuth} {elevation}");
    }
}

#[test]
fn what_is_not_in_memory_is_neither_walked_nor_drawn_nor_saved() {
    let (directory, _) = fetched(&file(), u64::MAX);
    let model = Model::from_directory(Arc::new(directory), Vec::new(), "ball.adj").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.adj");
    let faults = [
        model.walk(&Viewpoint::parallel([0.3, 0.5, 0.8]).unwrap(), |_| ()).unwrap_err(),
        model.render(&Orbit::default(), &Settings::new([40, 40])).unwrap_err(),
        model.save(&path).unwrap_err(),
    ];
    for fault in faults {
        assert!(fault.to_string().contains("only a graphics device has them"), "{fault}");
    }
    assert!(!path.exists());
}

#[test]
fn a_file_that_changed_is_noticed() {
    let whole = file();
    let (directory, _) = fetched(&whole, u64::MAX);
    let arena = Arena::new(&whole).unwrap();
    let place = |bytes: &[u8]| bytes.as_ptr() as usize - whole.as_ptr() as usize;
    let lane = arena.lane(Axis::Y).unwrap();
    let changed = |at: usize| {
        let mut changed = whole.clone();
        changed[at + 3] ^= 1;
        changed
    };
    for at in [place(lane.tiles.as_bytes()), place(lane.line_ends.as_bytes()), place(arena.description())] {
        let fault = fetched(&changed(at), u64::MAX).0.check("ball.adj").unwrap_err().to_string();
        assert!(fault.starts_with("ball.adj: ") && fault.contains("changed while it was fetched"), "{fault}");
    }
    for channel in [lane.steps, lane.values, lane.normals] {
        let changed = changed(place(channel));
        let mut check = directory.channel_check(Axis::Y);
        for part in directory.parts(Axis::Y, 999..=999) {
            let bytes = part.ranges.each_ref().map(|range| bytes_of(&changed, range));
            check.add(bytes.each_ref().map(|bytes| &bytes[..]));
        }
        assert!(check.finish("ball.adj").unwrap_err().to_string().contains("changed while"));
    }
}

#[test]
fn channels_of_other_lengths_and_an_absent_lane_are_refused_before_anything_is_fetched() {
    let whole = file();
    let entries = |kept: &dyn Fn(usize) -> bool, cut: Option<usize>| {
        let (mut header, after) = FileHeader::read_from_prefix(&whole).unwrap();
        let count = header.section_count.get() as usize;
        let (table, _) = <[SectionEntry]>::ref_from_prefix_with_elems(after, count).unwrap();
        let mut table: Vec<SectionEntry> = (0..count).filter(|&index| kept(index)).map(|index| table[index]).collect();
        let mut end = whole.len() as u64;
        if let Some(cut) = cut {
            let entry = &mut table[cut];
            entry.bytes.set(entry.bytes.get() - u64::from(entry.element_bytes));
        } else {
            end = 256 + 32 * table.len() as u64;
            for entry in &mut table {
                entry.offset.set(end.next_multiple_of(256));
                end = entry.offset.get() + entry.bytes.get();
            }
            end = end.next_multiple_of(256);
        }
        header.section_count.set(u32::try_from(table.len()).unwrap());
        header.file_bytes.set(end);
        header.header_xxh3.set(header_checksum(&header, &table));
        let head = [header.as_bytes(), table.as_bytes()].concat();
        Directory::new(&head, end, &Limits::default(), "ball.adj").map(|_| ()).unwrap_err().to_string()
    };
    // Sections: the description, then tiles, line ends, steps, values and normals of lane x.
    for (cut, rule) in [(3, "R11"), (4, "R11"), (5, "R11")] {
        let fault = entries(&|_| true, Some(cut));
        assert!(fault.starts_with("ball.adj") && fault.contains(rule), "{cut}: {fault}");
    }
    for fault in [entries(&|index| index == 0, None), entries(&|index| index != 1, None)] {
        assert!(fault.starts_with("ball.adj"), "{fault}");
    }
}

#[test]
fn a_wrong_length_a_cut_head_and_what_exceeds_the_limits_are_named() {
    let whole = file();
    let fault = |head: &[u8], len: u64, limits: &Limits| {
        Directory::new(head, len, limits, "ball.adj").map(|_| ()).unwrap_err().to_string()
    };
    let (len, any) = (whole.len() as u64, Limits::default());
    assert!(fault(&whole, len + 1, &any).contains("was cut or grew"));
    assert!(fault(&whole[..100], len, &any).contains("a header of 256 bytes"));
    assert!(fault(&whole[..300], len, &any).contains("a table of"));
    assert!(fault(b"<!doctype html>", 15, &any).starts_with("ball.adj"));
    let small = fault(&whole, len, &Limits::default().with_file_bytes(len - 1));
    assert!(small.starts_with("ball.adj") && small.contains("file bytes"), "{small}");
}

/// A length near 2^64 overflowed where the next section's place was computed.
#[test]
fn a_file_that_claims_almost_2_to_the_64_bytes_is_refused() {
    let whole = file();
    let (mut header, after) = FileHeader::read_from_prefix(&whole).unwrap();
    let count = header.section_count.get() as usize;
    let (table, _) = <[SectionEntry]>::ref_from_prefix_with_elems(after, count).unwrap();
    let mut table = table.to_vec();
    let last = table.last_mut().unwrap();
    last.bytes.set(u64::MAX - 10 - last.offset.get());
    header.file_bytes.set(u64::MAX);
    header.header_xxh3.set(header_checksum(&header, &table));
    let head = [header.as_bytes(), table.as_bytes()].concat();
    let fault = Directory::new(&head, u64::MAX, &Limits::default(), "ball.adj").map(|_| ()).unwrap_err().to_string();
    assert!(fault.starts_with("ball.adj") && fault.contains("R5"), "{fault}");
}

/// An .adj file of a ball with three lanes and two levels.
fn file_with_levels() -> Vec<u8> {
    built(Levels::Count(2))
}

#[test]
fn levels_are_those_of_the_file_and_their_directories_come_first() {
    let whole = file_with_levels();
    let arena = Arena::new(&whole).unwrap();
    assert_eq!((arena.level_count(), begun(&whole).level_count()), (2, 0), "their beginnings have to be fetched");
    let mut directory = opened_from_afar(&whole).unwrap();
    let coarsest = arena.sections().iter().find(|section| section.level() == Some(2)).unwrap();
    let first = directory.wanted(u64::MAX)[0].start;
    assert!((coarsest.offset.get()..coarsest.offset.get() + coarsest.bytes.get()).contains(&first), "{first}");
    assert!(directory.check("ball.adj").is_err(), "it is not complete");
    while let [range, ..] = &directory.wanted(700)[..] {
        directory.append(&bytes_of(&whole, range)).unwrap();
    }
    directory.check("ball.adj").unwrap();
    let directory = Arc::new(directory);
    let model = Model::from_directory(directory.clone(), Vec::new(), "ball.adj").unwrap();
    let in_memory = Model::from_bytes(whole.clone()).unwrap();
    assert_eq!(model.scene().lanes.detail().levels, in_memory.scene().lanes.detail().levels);
    for level in 0..=2 {
        let part = directory.level(level).unwrap();
        for axis in Axis::ALL {
            let want = in_memory.lane_of(level, axis).unwrap();
            let got = model.lane_of(level, axis).unwrap();
            assert_eq!((want.tiles, want.line_ends.as_bytes()), (got.tiles, got.line_ends.as_bytes()));
            assert_eq!((want.record_count(), got.steps), (got.record_count(), &[][..]));
            let stored = [want.steps, want.values, want.normals, want.magnitudes, want.coverages];
            assert_eq!(part.channel_bytes(axis), stored.iter().map(|bytes| bytes.len() as u64).sum::<u64>());
            let mut check = part.channel_check(axis);
            let mut channels = [const { Vec::new() }; 5];
            for part in part.parts(axis, 300..=1_000) {
                let bytes = part.ranges.each_ref().map(|range| bytes_of(&whole, range));
                check.add(bytes.each_ref().map(|bytes| &bytes[..]));
                channels.iter_mut().zip(bytes).for_each(|(all, bytes)| all.extend(bytes));
            }
            check.finish("ball.adj").unwrap();
            assert_eq!(channels.each_ref().map(|bytes| &bytes[..]), stored);
        }
    }
    assert!(directory.level(3).is_none());
}

/// The level's tiles are covered by the level's own checksums, not by the file's.
#[test]
fn a_level_whose_tiles_changed_is_noticed() {
    let whole = file_with_levels();
    let arena = Arena::new(&whole).unwrap();
    for level in [1, 2] {
        let level = arena.level(level).unwrap();
        let tiles = level.lane(Axis::Z).unwrap().tiles.as_bytes();
        let mut changed = whole.clone();
        changed[tiles.as_ptr() as usize - whole.as_ptr() as usize + 5] ^= 1;
        let fault = fetched(&changed, u64::MAX).0.check("ball.adj").unwrap_err().to_string();
        assert!(fault.starts_with("ball.adj: ") && fault.contains("changed while it was fetched"), "{fault}");
    }
}

/// What opening a whole file refuses, the directory refuses by the same rule at the same byte, before it fetches more.
#[test]
fn lying_levels_and_files_are_refused_as_whole_files_are() {
    let folder = adjsplat_tests::repository().join("formats/examples");
    let (mut refused, mut of_levels, mut opened) = (0, 0, 0);
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|ending| ending != "adj") {
            continue;
        }
        let whole = std::fs::read(&path).unwrap();
        match (Arena::new(&whole), opened_from_afar(&whole)) {
            (Ok(_), Ok(_)) => opened += 1,
            (Err(want), Err(Error::Format { fault, .. })) => {
                assert_eq!(fault.to_string(), want.to_string(), "{}", path.display());
                refused += 1;
                of_levels += usize::from(path.to_string_lossy().contains("x-level"));
            }
            (whole, begun) => panic!("{}: {:?}, but {begun:?}", path.display(), whole.map(|_| ())),
        }
    }
    assert!(refused > 40 && of_levels > 15 && opened > 20, "{refused} {of_levels} {opened}");
}

#[test]
fn levels_that_end_early_or_exceed_the_limits_are_named_and_leave_the_directory_without() {
    let whole = file_with_levels();
    let fault = |heads: &[Vec<u8>], limits: &Limits| {
        let mut directory = begun(&whole);
        let fault = directory.add_levels(heads, limits, "ball.adj").unwrap_err().to_string();
        assert_eq!(directory.level_count(), 0);
        assert!(fault.starts_with("ball.adj") && !fault.contains('\n'), "{fault}");
        fault
    };
    let heads: Vec<_> = begun(&whole).level_heads().iter().map(|range| bytes_of(&whole, range)).collect();
    assert_eq!(heads.len(), 2);
    assert!(fault(&[], &Limits::default()).contains("R1"));
    assert!(fault(&heads[..1], &Limits::default()).contains("R1"));
    assert!(fault(&[heads[0][..100].to_vec(), heads[1].clone()], &Limits::default()).contains("a header of 256 bytes"));
    assert!(fault(&[heads[0].clone(), heads[1][..300].to_vec()], &Limits::default()).contains("a table of"));
    assert!(fault(&[heads[1].clone(), heads[0].clone()], &Limits::default()).contains("R4"), "exchanged");
    assert!(fault(&heads, &Limits::default().with_file_bytes(2_000)).contains("file bytes"));
}

/// A section of a level whose length is near 2^64 must not overflow, nor be fetched.
#[test]
fn a_level_that_claims_almost_2_to_the_64_bytes_is_refused() {
    let whole = file_with_levels();
    let mut directory = begun(&whole);
    let mut heads: Vec<_> = directory.level_heads().iter().map(|range| bytes_of(&whole, range)).collect();
    let (mut header, after) = FileHeader::read_from_prefix(&heads[0]).unwrap();
    let count = header.section_count.get() as usize;
    let (table, _) = <[SectionEntry]>::ref_from_prefix_with_elems(after, count).unwrap();
    let mut table = table.to_vec();
    let last = table.last_mut().unwrap();
    last.bytes.set(u64::MAX - 10 - last.offset.get());
    header.header_xxh3.set(header_checksum(&header, &table));
    heads[0] = [header.as_bytes(), table.as_bytes()].concat();
    let fault = directory.add_levels(&heads, &Limits::default(), "ball.adj").unwrap_err().to_string();
    assert!(fault.starts_with("ball.adj") && fault.contains("R5"), "{fault}");
}
