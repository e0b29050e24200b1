//! Mutants with repaired checksums: files that are wrong only where a checksum cannot see it.
//!
//! Each is opened, walked, transposed and checked. Nothing may panic or take long, no walk may visit more records
//! than there are, and the check must say exactly what the oracle says.

use std::time::{Duration, Instant};

use adjsplat::arena::Arena;
use adjsplat::arena::transpose::transpose;
use adjsplat::traverse::walk::{Batch, walk};
use adjsplat::traverse::{Order, Sense, SplitForm, Viewpoint};
use adjsplat::volume::Axis;

use crate::assemble::{Part, Parts, Random};
use crate::oracle;
use crate::scenes::scenes;

/// Mutants of a test run; `ADJ_MUTANTS=1000000` makes a long one.
const MUTANTS: u64 = 6_000;

/// Changes one thing of `parts`.
fn mutate(parts: &mut Parts, random: &mut Random) {
    match random.below(10) {
        0 => mutate_header(parts, random),
        1 => {
            let (a, b) = (random.index(parts.sections.len()), random.index(parts.sections.len()));
            let bytes = parts.sections[a].bytes.clone();
            parts.sections[b].bytes = bytes;
        }
        2 => {
            // A record of a lane goes, in all channels: lengths stay in agreement.
            let axis = parts.sections[random.index(parts.sections.len())].axis;
            let records = parts.sections.iter().find(|s| s.kind == 4 && s.axis == axis).map_or(0, |s| s.bytes.len());
            if records > 0 {
                let record = random.index(records);
                for part in parts.sections.iter_mut().filter(|s| s.axis == axis && s.kind >= 4) {
                    remove_element(part, record);
                }
            }
        }
        _ => {
            let index = random.index(parts.sections.len());
            mutate_section(&mut parts.sections[index], random);
        }
    }
}

fn mutate_header(parts: &mut Parts, random: &mut Random) {
    let header = &mut parts.header;
    match random.below(6) {
        0 => {
            let axis = random.index(3);
            let dim = header.dims[axis].get();
            let wild = [1, 8, 9, 65_535][random.index(4)];
            header.dims[axis].set([dim.saturating_sub(1), dim.saturating_add(1), wild][random.index(3)]);
        }
        1 => header.visible_voxels.set(header.visible_voxels.get().wrapping_add(random.below(3)).wrapping_sub(1)),
        2 => header.tile_order = u8::try_from(random.below(3)).unwrap(),
        3 => header.value_bits = 24 - header.value_bits,
        4 => header.dims.swap(0, 1),
        _ => header.normal_bits = [0, 8, 16][random.index(3)],
    }
}

/// Another change may have taken the element already.
fn remove_element(part: &mut Part, index: usize) {
    let width = usize::from(part.element_bytes);
    if (index + 1) * width <= part.bytes.len() {
        part.bytes.drain(index * width..(index + 1) * width);
    }
}

fn mutate_section(part: &mut Part, random: &mut Random) {
    let width = usize::from(part.element_bytes);
    let elements = part.bytes.len() / width;
    if elements == 0 {
        return;
    }
    let (a, b) = (random.index(elements), random.index(elements));
    let byte = random.index(part.bytes.len());
    match random.below(8) {
        0 => part.bytes[byte] ^= 1 << random.below(8),
        1 => part.bytes[byte] = random.byte(),
        2 => part.bytes[byte] = [0, 1, 254, 255][random.index(4)],
        3 => {
            // One field of a few bytes at its end: an index or length far away.
            let len = [2, 4, 8][random.index(3)].min(part.bytes.len() - byte);
            part.bytes[byte..byte + len].fill(0xff);
        }
        4 => {
            for i in 0..width {
                part.bytes.swap(a * width + i, b * width + i);
            }
        }
        5 => remove_element(part, a),
        6 => {
            let element = part.bytes[a * width..(a + 1) * width].to_vec();
            part.bytes.splice(b * width..b * width, element);
        }
        _ => part.bytes[byte] = part.bytes[byte].wrapping_add([1, 255][random.index(2)]),
    }
}

/// Walks all lanes, also from inside, and derives the others.
fn use_up(arena: &Arena, random: &mut Random) {
    let dims = arena.facts().grid.dims;
    let eye = dims.map(|dim| f64::from(dim) * 0.37);
    for lane in arena.lanes() {
        let form = [SplitForm::Split, SplitForm::Interleaved][random.index(2)];
        let sense = [Sense::BackToFront, Sense::FrontToBack][random.index(2)];
        let mut toward = [2.0, 3.0, 4.0];
        toward[lane.axis.index()] = -1.0;
        let inside = Order::new(Viewpoint::Perspective { eye, toward }, dims, sense, form).unwrap();
        let parallel = (0..6).map(|nesting| Order::parallel(nesting, random.byte() % 8));
        for order in parallel.filter(|order| order.fast == lane.axis).chain([inside]) {
            let mut visited = 0;
            walk(&lane, &order, &mut |batch: &Batch| {
                visited += batch.len() as u64;
                for voxel in 0..batch.len() {
                    assert!(batch.record_index(voxel) < lane.steps.len());
                }
            });
            assert!(visited <= lane.record_count(), "{visited} voxels of {} records", lane.record_count());
        }
        let plain: usize = lane.lines().map(|line| line.records.len()).sum();
        assert!(plain <= 64 * lane.tiles.len() * lane.steps.len());
    }
    let x_lane = arena.lane(Axis::X).unwrap();
    let axis = [Axis::Y, Axis::Z][random.index(2)];
    let derived = transpose(&x_lane, axis, arena.facts().tile_order);
    assert!(derived.steps.iter().filter(|&&step| step != 0).count() <= x_lane.steps.len());
}

#[test]
fn mutants_harm_nothing_and_the_check_agrees_with_the_oracle() {
    let bases: Vec<Parts> = scenes().iter().map(Parts::of_scene).collect();
    let mutants = std::env::var("ADJ_MUTANTS").map_or(MUTANTS, |count| count.parse().expect("ADJ_MUTANTS is a number"));
    let (mut opened, mut sound, mut slowest) = (0, 0, Duration::ZERO);
    for seed in 0..mutants {
        let mut random = Random(seed);
        let mut parts = bases[random.index(bases.len())].clone();
        for _ in 0..=random.below(3) {
            mutate(&mut parts, &mut random);
        }
        let file: Box<[u8]> = parts.file().into();
        let start = Instant::now();
        let Ok(arena) = Arena::new(&file) else { continue };
        opened += 1;
        // The oracle does not read the description, which some mutants damage.
        let verdict = arena.check().map_err(|fault| fault.rule);
        let expected = oracle::sound(&arena);
        assert!(verdict.is_ok() == expected || verdict == Err("R22"), "seed {seed}: {verdict:?}, oracle {expected}");
        sound += u32::from(expected);
        use_up(&arena, &mut random);
        slowest = slowest.max(start.elapsed());
    }
    assert!(opened > mutants / 3, "only {opened} mutants open, so they test little");
    assert!(sound > 100 && u64::from(sound) < opened / 2, "{sound} of {opened} are sound");
    assert!(slowest < Duration::from_secs(2), "the slowest took {slowest:?}");
}
