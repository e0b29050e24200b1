//! Any bytes as an `.adj` file: opened, checked, walked in every order of its lanes, transposed and drawn; its levels too. Its
//! directory is fetched as from a server.
//!
//! Checksums stop most of what a fuzzer does, so they are put right first unless the first bit of the input's last
//! byte says not to; that byte is then dropped.
#![no_main]

use std::ops::Range;

use adjsplat::internals::transpose;
use adjsplat::arena::{Arena, Directory, Lane, LaneSet};
use adjsplat::classify::TransferFunction;
use adjsplat::error::Result;
use adjsplat::limits::Limits;
use adjsplat::splat::{Camera, Orbit, Scene, Settings, Surround, cpu};
use adjsplat::traverse::{Batch, Order, Sense, SplitForm, Viewpoint, walk};
use adjsplat::volume::Axis;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Some((choice, bytes)) = input.split_last() else { return };
    let mut file: Box<[u8]> = bytes.into();
    if choice & 1 == 0 {
        repair::checksums(&mut file);
    }
    let opened = Arena::new(&file);
    let begun = begin(&file);
    assert_eq!(opened.is_ok(), begun.is_ok(), "a file on a server is refused where a whole one is");
    let Ok(arena) = opened else { return };
    let sound = arena.check().is_ok();
    for level in 0..=arena.level_count() {
        use_up(&arena.level(level).expect("levels opened with the file"), sound, *choice);
    }
});

/// Fetches the directory of a file, with those of its levels, as from a server.
fn begin(file: &[u8]) -> Result<Directory> {
    let bytes = |range: &Range<u64>| file[range.start as usize..range.end as usize].to_vec();
    let (len, limits) = (file.len() as u64, Limits::default());
    let mut directory = Directory::new(&bytes(&(0..len.min(Directory::HEAD))), len, &limits, "fuzz")?;
    let heads: Vec<_> = directory.level_heads().iter().map(bytes).collect();
    directory.add_levels(&heads, &limits, "fuzz")?;
    while let [range, ..] = &directory.wanted(1 << 20)[..] {
        directory.append(&bytes(range))?;
    }
    for level in (0..=directory.level_count()).filter_map(|level| directory.level(level)) {
        for axis in Axis::ALL {
            let ends = level.parts(axis, 64..=1 << 10).into_iter().flat_map(|part| part.ranges).map(|range| range.end);
            assert!(ends.max().unwrap_or(0) <= len, "parts lie in the file");
        }
    }
    // Damage of the content is told, or is not there.
    let _ = directory.check("fuzz");
    Ok(directory)
}

fn use_up(arena: &Arena, sound: bool, choice: u8) {
    let dims = arena.facts().grid.dims;
    for lane in arena.lanes() {
        for nesting in 0..6 {
            let order = Order::parallel(nesting, choice >> 1 & 7);
            if order.fast == lane.axis {
                visit(&lane, &order, sound);
            }
        }
        let eye = dims.map(|dim| f64::from(dim) * 0.4);
        let mut toward = [2.0, 3.0, 4.0];
        toward[lane.axis.index()] = 1.0;
        let inside = Viewpoint::Perspective { eye, toward };
        let order = Order::new(inside, dims, Sense::BackToFront, SplitForm::Interleaved).expect("a sound viewpoint");
        visit(&lane, &order, sound);
    }
    let x_lane = arena.lane(Axis::X).expect("every arena that opens has it");
    transpose(&x_lane, if choice & 16 == 0 { Axis::Y } else { Axis::Z }, arena.facts().tile_order);
    draw(arena, choice);
}

/// Walks a lane; a sound one gives each voxel once and inside the grid.
fn visit(lane: &Lane, order: &Order, sound: bool) {
    let mut visited = 0u64;
    walk(lane, order, &mut |batch: &Batch| {
        for voxel in 0..batch.len() {
            assert!(batch.record_index(voxel) < lane.steps.len(), "a record outside the lane");
        }
        if sound {
            let inside = |axis: Axis, at: u16| u32::from(at) < lane.dims[axis.index()];
            assert!(inside(order.slow, batch.slow));
            assert!(batch.medium.iter().all(|&at| inside(order.medium, at)));
            assert!(batch.fast.iter().all(|&at| inside(order.fast, at)));
        }
        visited += batch.len() as u64;
    });
    assert!(visited <= lane.record_count(), "more voxels than records");
    assert!(!sound || visited == lane.record_count() - lane.stepping_voxels(), "a sound lane gives every voxel once");
}

fn draw(arena: &Arena, choice: u8) {
    let transfer = match choice >> 5 & 1 {
        0 => TransferFunction::range(0.0, 1e9),
        _ => TransferFunction::contour(100.0),
    }
    .expect("a sound transfer function");
    let fov = (choice & 64 != 0).then_some(60.0);
    let around = Surround::of_grid(&arena.facts().grid);
    let Ok(camera) = Camera::orbiting(Orbit { azimuth: 30.0, fov, ..Orbit::default() }, around, [9, 7]) else { return };
    let lanes = LaneSet::new(arena.clone(), Some(1 << 26));
    let scene = Scene { facts: arena.facts(), lanes: &lanes, transfer: &transfer };
    let _ = cpu::render(&scene, &camera, &Settings::new([9, 7]));
}

mod repair {
    //! The checksums of `formats/adj-1.md`, put right in place.

    use xxhash_rust::xxh3::xxh3_64;

    const HEADER: usize = 256;
    const ENTRY: usize = 32;

    /// Those of a file, and of its levels of detail, which are files too.
    pub fn checksums(file: &mut [u8]) {
        repair(file, true);
    }

    fn repair(file: &mut [u8], has_levels: bool) {
        let Some(count) = file.get(12..16) else { return };
        let count = u32::from_le_bytes(count.try_into().expect("four bytes")) as usize;
        let Some(table_end) = count.checked_mul(ENTRY).map(|bytes| HEADER + bytes).filter(|&end| end <= file.len())
        else {
            return;
        };
        let len = file.len() as u64;
        file[16..24].copy_from_slice(&len.to_le_bytes());
        for entry in (HEADER..table_end).step_by(ENTRY) {
            let number = |at: usize| u64::from_le_bytes(file[entry + at..][..8].try_into().expect("eight bytes"));
            let (from, len) = (number(8), number(16));
            let to = from.checked_add(len).and_then(|to| usize::try_from(to).ok());
            let is_level = matches!(u16::from_le_bytes([file[entry], file[entry + 1]]), 0x8001..=0x800f);
            if let Some(section) = usize::try_from(from).ok().zip(to).and_then(|(from, to)| file.get_mut(from..to)) {
                if is_level && has_levels {
                    repair(section, false);
                }
                let sum = xxh3_64(section);
                file[entry + 24..][..8].copy_from_slice(&sum.to_le_bytes());
            }
        }
        file[24..32].fill(0);
        let sum = xxh3_64(&file[..table_end]);
        file[24..32].copy_from_slice(&sum.to_le_bytes());
    }
}
