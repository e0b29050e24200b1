//! Damage without repair: cuts and flipped bits of every valid example. None may pass unseen, and none may make a
//! reader panic or read outside an exact allocation.

use adjsplat::arena::Arena;
use adjsplat::arena::layout::SectionEntry;
use adjsplat::internals::transpose;
use adjsplat::traverse::Order;
use adjsplat::traverse::{Batch, walk};
use adjsplat::volume::Axis;

use crate::format::assemble::{Parts, repair_header};
use crate::format::scenes::scenes;

/// Walks every lane of an arena in one order each way.
fn walk_lanes(arena: &Arena) {
    for lane in arena.lanes() {
        for order in (0u8..6).map(|nesting| Order::parallel(nesting.into(), nesting)).filter(|o| o.fast == lane.axis) {
            let mut visited = 0;
            walk(&lane, &order, &mut |batch: &Batch| visited += batch.len() as u64);
            assert!(visited <= lane.record_count());
        }
    }
}

#[test]
fn no_file_that_was_cut_or_grew_opens() {
    for scene in scenes() {
        let file = Parts::of_scene(&scene).file();
        for len in 0..file.len() {
            let cut: Box<[u8]> = file[..len].into();
            assert!(Arena::new(&cut).is_err(), "{} opens with {len} bytes", scene.name);
        }
        for more in [1, 16, 255, 256, 512] {
            let grown: Box<[u8]> = [&file[..], &vec![0; more]].concat().into();
            assert!(Arena::new(&grown).is_err(), "{} opens with {more} bytes more", scene.name);
        }
    }
}

#[test]
fn every_cut_with_a_repaired_length_is_found() {
    for scene in scenes() {
        let file = Parts::of_scene(&scene).file();
        for len in (256..file.len()).filter(|len| len % 16 == 0) {
            let mut cut: Box<[u8]> = file[..len].into();
            cut[16..24].copy_from_slice(&(len as u64).to_le_bytes());
            repair_header(&mut cut);
            assert!(Arena::new(&cut).is_err(), "{} opens with {len} bytes", scene.name);
        }
    }
}

#[test]
fn every_flipped_bit_is_found_and_harms_nothing() {
    for scene in scenes() {
        let mut file: Box<[u8]> = Parts::of_scene(&scene).file().into();
        for byte in 0..file.len() {
            for bit in 0..8 {
                file[byte] ^= 1 << bit;
                if let Ok(arena) = Arena::new(&file) {
                    assert!(arena.check().is_err(), "{}: bit {bit} of byte {byte}", scene.name);
                    // Filling is read by no walk, and a long line's buffers are costly to set up.
                    let is_in = |s: &SectionEntry| (byte as u64).wrapping_sub(s.offset.get()) < s.bytes.get();
                    let read = arena.sections().iter().any(is_in);
                    if read && scene.dims[0] < 10_000 {
                        walk_lanes(&arena);
                        transpose(&arena.lane(Axis::X).unwrap(), Axis::Y, scene.tile_order);
                    }
                }
                file[byte] ^= 1 << bit;
            }
        }
    }
}

#[test]
fn lying_tables_are_refused_without_allocating() {
    let scenes = scenes();
    let file = Parts::of_scene(&scenes[0]).file();
    let sections = Parts::of_scene(&scenes[0]).sections.len();
    for lie in [u64::MAX, u64::MAX - 255, 1 << 63, u64::from(u32::MAX), 0xffff_ff00, 1 << 40, 0, 256] {
        for entry in 0..sections {
            for field in [8, 16] {
                let mut lying = file.clone();
                let at = 256 + 32 * entry + field;
                if lying[at..at + 8] == lie.to_le_bytes() {
                    continue;
                }
                lying[at..at + 8].copy_from_slice(&lie.to_le_bytes());
                repair_header(&mut lying);
                // A length may lie within its own filling: then it is the checksum that says so.
                let verdict = Arena::new(&lying).and_then(|arena| arena.check());
                assert!(verdict.is_err(), "entry {entry}, byte {field} = {lie:#x}");
            }
        }
    }
    for lie in [0u32, 1, 4, 6, 32, 1_024, 1_025, u32::MAX] {
        let mut lying = file.clone();
        lying[12..16].copy_from_slice(&lie.to_le_bytes());
        repair_header(&mut lying);
        assert!(Arena::new(&lying).is_err(), "{lie} sections");
    }
    for fill in [0x00, 0xff] {
        assert!(Arena::new(&vec![fill; 4_096]).is_err());
        let mut filled = vec![fill; 4_096];
        filled[..32].copy_from_slice(&file[..32]);
        filled[16..24].copy_from_slice(&4_096u64.to_le_bytes());
        repair_header(&mut filled);
        assert!(Arena::new(&filled).is_err());
    }
}

#[test]
fn a_description_nested_without_end_is_refused() {
    let mut parts = Parts::of_scene(&scenes()[0]);
    parts.sections[0].bytes = b"{\"a\":".iter().copied().cycle().take(5 * 200_000).collect();
    let file = parts.file();
    assert_eq!(Arena::new(&file).unwrap().check().unwrap_err().rule, "R22");
}

#[test]
fn a_description_longer_than_the_format_allows_is_refused_when_the_file_is_opened_and_checked() {
    use adjsplat::limits::{Limits, MAX_DESCRIPTION_BYTES};
    let mut parts = Parts::of_scene(&scenes()[0]);
    let spaces = usize::try_from(MAX_DESCRIPTION_BYTES).unwrap() - 2;
    parts.sections[0].bytes = format!("{{{}}}", " ".repeat(spaces)).into_bytes();
    let file = parts.file();
    assert!(Arena::new(&file).unwrap().check().is_ok());
    parts.sections[0].bytes.push(b' ');
    let file = parts.file();
    let arena = Arena::new(&file).unwrap();
    assert_eq!(arena.check().unwrap_err().rule, "R22");
    let told = arena.within("long.adj".as_ref(), &Limits::default()).unwrap_err().to_string();
    assert_eq!(told, "long.adj: bytes of description: needs 16777217, but the limit is 16777216");
}
