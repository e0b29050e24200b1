//! A file's first lane alone: as good as a file that was built with one lane, and fetched in few parts.

use std::ops::RangeInclusive;

use adjsplat::arena::layout::{FileHeader, SectionEntry, header_checksum};
use adjsplat::arena::{Arena, FirstLane, Part};
use adjsplat::splat::{Orbit, Settings};
use adjsplat::traverse::Viewpoint;
use adjsplat::volume::Axis;
use zerocopy::{FromBytes as _, IntoBytes as _};

use adjsplat::{Build, Model, TransferFunction, Volume, Voxels};

/// An .adj file of a ball with the lanes x, y and z.
fn file() -> Vec<u8> {
    let at = |i: u16| [i % 20, i / 20 % 24, i / 480].map(|c| f32::from(c) - 10.0);
    let value = |i: u16| 200.0 - 18.0 * at(i).iter().map(|c| c * c).sum::<f32>().sqrt();
    let volume = Volume::new([20, 24, 22], (0..20 * 24 * 22).map(value).collect::<Vec<_>>()).unwrap();
    let model = Build::new(TransferFunction::range(60.0, 255.0).unwrap()).run(&volume).unwrap();
    model.arena().unwrap().bytes().to_vec()
}

fn plan(file: &[u8], sizes: RangeInclusive<u64>) -> FirstLane {
    let head = &file[..file.len().min(usize::try_from(FirstLane::HEAD).unwrap())];
    FirstLane::new(head, file.len() as u64, sizes, "ball.adj").unwrap()
}

fn copy(file: &[u8], part: &Part, bytes: &mut [u8]) {
    for (range, at) in &part.ranges {
        let [start, end] = [range.start, range.end].map(|at| usize::try_from(at).unwrap());
        bytes[*at..*at + end - start].copy_from_slice(&file[start..end]);
    }
}

/// The smaller file, as a page would put it together.
fn fetched(file: &[u8], FirstLane { mut bytes, parts }: FirstLane) -> Vec<u8> {
    parts.iter().for_each(|part| copy(file, part, &mut bytes));
    bytes
}

#[test]
fn it_is_a_valid_file_that_draws_the_same_pictures() {
    let whole = file();
    let plan = plan(&whole, u64::MAX..=u64::MAX);
    assert_eq!(plan.parts.iter().map(|part| part.ranges.len()).collect::<Vec<_>>(), [1, 1], "neighbours are joined");
    let wanted: u64 = plan.parts.iter().map(Part::bytes).sum();
    assert!(wanted * 100 < 45 * whole.len() as u64, "{wanted} of {}", whole.len());
    let part = fetched(&whole, plan);
    let arena = Arena::new(&part).unwrap();
    arena.check().unwrap();
    assert_eq!(arena.lanes().count(), 1);
    let (all, one) = (Model::from_bytes(whole).unwrap(), Model::from_bytes(part).unwrap());
    assert_eq!((all.grid(), all.transfer()), (one.grid(), one.transfer()));
    for (azimuth, elevation) in [(0.0, 0.0), (90.0, 10.0), (20.0, 80.0)] {
        let (orbit, settings) = (Orbit { azimuth, elevation, ..Orbit::default() }, Settings::new([60, 50]));
        let picture = |model: &Model| model.render(&orbit, &settings).unwrap();
        assert!(picture(&all).pixels() == picture(&one).pixels(), "{azimuth} {elevation}");
    }
}

#[test]
fn what_has_arrived_is_a_valid_file_with_the_first_tiles() {
    let whole = file();
    let FirstLane { mut bytes, parts } = plan(&whole, 300..=1_000);
    assert!(parts.len() > 8 && parts[1..].iter().all(|part| part.bytes() <= 1_000), "{parts:?}");
    let voxels = |model: &Model| {
        let mut all = Vec::new();
        let viewpoint = Viewpoint::parallel([0.3, 0.5, 0.8]).unwrap();
        let visit = |voxels: &Voxels| all.extend(voxels.iter().map(|voxel| (voxel.position, voxel.value.to_bits())));
        model.walk(&viewpoint, visit).unwrap();
        all
    };
    let all = voxels(&Model::from_bytes(whole.clone()).unwrap());
    let mut tiles = 0;
    for part in &parts {
        copy(&whole, part, &mut bytes);
        let Some(file) = FirstLane::arrived(&bytes, part.records, "ball.adj").unwrap() else { continue };
        Arena::new(&file).unwrap().check().unwrap();
        let some = voxels(&Model::from_bytes(file.clone()).unwrap());
        let count = Arena::new(&file).unwrap().lane(Axis::X).unwrap().sweep_tiles().count();
        assert!(count > 0 && count >= tiles && some.len() as u64 <= part.records);
        tiles = count;
        assert!(some.iter().all(|voxel| all.contains(voxel)));
    }
    assert!(tiles > 4);
    assert!(FirstLane::arrived(&whole[..whole.len() - 1], 9, "ball.adj").unwrap_err().to_string().contains("ball.adj"));
}

#[test]
fn a_file_with_one_lane_stays_as_it_is() {
    let whole = file();
    let one = fetched(&whole, plan(&whole, 1..=1));
    assert!(fetched(&one, plan(&one, 5_000..=9_000)) == one);
}

#[test]
fn channels_of_other_lengths_and_an_absent_lane_are_refused_before_anything_is_planned() {
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
        FirstLane::new(&head, end, 0..=0, "ball.adj").map(|_| ()).unwrap_err().to_string()
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
fn a_wrong_length_and_a_cut_head_are_named() {
    let whole = file();
    let fault = |head: &[u8], len: u64| FirstLane::new(head, len, 0..=0, "ball.adj").unwrap_err().to_string();
    assert!(fault(&whole, whole.len() as u64 + 1).contains("was cut or grew"));
    assert!(fault(&whole[..100], whole.len() as u64).contains("a header of 256 bytes"));
    assert!(fault(&whole[..300], whole.len() as u64).contains("a table of"));
    assert!(fault(b"<!doctype html>", 15).starts_with("ball.adj"));
}
