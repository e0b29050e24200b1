//! The examples that must be refused: each is a valid file with one thing wrong, and all its checksums right unless
//! a checksum is what is wrong.

use adjsplat::arena::layout::SectionKind;
use adjsplat::volume::Axis;

use crate::format::assemble::{Part, Parts, repair_header};
use crate::format::scenes::{Scene, scenes};

/// Bytes of a field of the header or of the first entries of the table, by their offset in adj-1.md.
const FIRST_ENTRY: usize = 256;
const ENTRY: usize = 32;

fn parts(name: &str) -> Parts {
    let all: Vec<Scene> = scenes();
    Parts::of_scene(all.iter().find(|scene| scene.name == name).expect("a scene of that name"))
}

/// `base`'s file with its parts changed, offsets and checksums right.
fn rebuilt(base: &str, change: impl FnOnce(&mut Parts)) -> Vec<u8> {
    let mut parts = parts(base);
    change(&mut parts);
    parts.file()
}

/// `base`'s file with bytes changed in place, the header's checksum right.
fn patched(base: &str, change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut file = parts(base).file();
    change(&mut file);
    repair_header(&mut file);
    file
}

/// The file of a level of `base`.
fn level_of(base: &str, number: u16) -> Vec<u8> {
    parts(base).level(number).bytes.clone()
}

/// The example of levels with one of them changed, offsets and checksums right.
pub(crate) fn in_level(number: u16, change: impl FnOnce(&mut Parts)) -> Vec<u8> {
    rebuilt("levels.adj", |parts| {
        let level = parts.level(number);
        let mut inner = Parts::of_file(&level.bytes);
        change(&mut inner);
        level.bytes = inner.file();
    })
}

/// Gives a lane coverages of another width, all of them sound.
fn recover(parts: &mut Parts, element_bytes: u8) {
    let records = parts.section(SectionKind::Steps, Axis::X).bytes.clone();
    let coverages = parts.section(SectionKind::Coverage, Axis::X);
    let code = if element_bytes == 1 { &[0xff][..] } else { &[0xff, 0x6d][..] };
    coverages.element_bytes = element_bytes;
    coverages.bytes =
        records.iter().flat_map(|&step| code.iter().map(move |&byte| if step == 0 { 0 } else { byte })).collect();
}

/// The worked example with another description.
pub(crate) fn described(text: &str) -> Vec<u8> {
    rebuilt("worked.adj", |p| p.sections[0].bytes = text.as_bytes().to_vec())
}

/// The example with limits of levels, whose section of limits is its last one, changed.
fn in_limits(change: impl FnOnce(&mut Part)) -> Vec<u8> {
    rebuilt("limits.adj", |p| change(p.sections.last_mut().expect("the limits")))
}

/// Every file that must be refused.
pub(crate) fn refused() -> Vec<(&'static str, Vec<u8>)> {
    use SectionKind::{Coverage, LineEnds, Steps, Tiles, Values};
    let x = Axis::X;
    // The worked example's table: description, tiles, line ends, steps, values.
    let worked = "worked.adj";
    // Its table: description, levels 4 to 1, tiles ...
    let levels = "levels.adj";
    let put = |file: &mut Vec<u8>, at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    vec![
        ("x-magic.adj", rebuilt(worked, |p| p.header.magic[4] = b'\n')),
        ("x-future-major.adj", rebuilt(worked, |p| p.header.major.set(2))),
        ("x-header-checksum.adj", {
            let mut file = parts(worked).file();
            file[24] ^= 1;
            file
        }),
        ("x-empty.adj", Vec::new()),
        ("x-header-cut.adj", parts(worked).file()[..200].to_vec()),
        ("x-truncated.adj", {
            let file = parts(worked).file();
            file[..file.len() - 1].to_vec()
        }),
        ("x-longer.adj", {
            let mut file = parts(worked).file();
            file.push(0);
            file
        }),
        ("x-huge-count.adj", patched(worked, |f| put(f, 12, &1_025u32.to_le_bytes()))),
        ("x-table-past-end.adj", patched(worked, |f| put(f, 12, &1_000u32.to_le_bytes()))),
        ("x-unaligned.adj", patched(worked, |f| f[FIRST_ENTRY + 8] += 4)),
        (
            "x-overlap.adj",
            patched(worked, |f| {
                let before: [u8; 8] = f[FIRST_ENTRY + ENTRY + 8..][..8].try_into().unwrap();
                put(f, FIRST_ENTRY + 2 * ENTRY + 8, &before);
            }),
        ),
        (
            "x-hole.adj",
            patched(worked, |f| {
                f[FIRST_ENTRY + 4 * ENTRY + 9] += 1;
                let len = f.len() as u64 + 256;
                f.resize(f.len() + 256, 0);
                put(f, 16, &len.to_le_bytes());
            }),
        ),
        ("x-section-past-end.adj", patched(worked, |f| put(f, FIRST_ENTRY + 16, &u64::MAX.to_le_bytes()))),
        (
            "x-not-filled-up.adj",
            patched(worked, |f| {
                f.truncate(f.len() - 16);
                let len = f.len() as u64;
                put(f, 16, &len.to_le_bytes());
            }),
        ),
        ("x-no-grid-points.adj", rebuilt(worked, |p| p.header.dims[1].set(0))),
        ("x-spacing.adj", rebuilt(worked, |p| p.header.spacing[2].set(f64::NAN))),
        ("x-direction.adj", rebuilt(worked, |p| p.header.direction[2] = p.header.direction[1])),
        ("x-direction-length.adj", rebuilt(worked, |p| p.header.direction[0][0].set(1e30))),
        ("x-direction-not-unit.adj", rebuilt(worked, |p| p.header.direction[0][0].set(1.002))),
        ("x-value-bits.adj", rebuilt(worked, |p| p.header.value_bits = 32)),
        ("x-tile-order.adj", rebuilt(worked, |p| p.header.tile_order = 3)),
        ("x-reserved.adj", rebuilt(worked, |p| p.header.reserved_1[55] = 1)),
        ("x-scale.adj", rebuilt(worked, |p| p.header.value_step.set(-0.5))),
        ("x-unknown-kind.adj", rebuilt(worked, |p| p.sections[0].kind = 8)),
        ("x-section-axis.adj", rebuilt(worked, |p| p.sections[2].axis = 3)),
        ("x-kind-twice.adj", rebuilt(worked, |p| p.sections.insert(1, p.sections[0].clone()))),
        ("x-no-steps.adj", rebuilt(worked, |p| p.sections.retain(|s| s.kind != Steps as u16))),
        ("x-channel-unnamed.adj", rebuilt("bytes-and-normals.adj", |p| p.header.normal_bits = 0)),
        ("x-no-lanes.adj", rebuilt(worked, |p| p.sections.truncate(1))),
        ("x-lanes-xz.adj", rebuilt("gaps.adj", |p| p.sections.retain(|s| s.axis != 1))),
        ("x-element-bytes.adj", rebuilt(worked, |p| p.sections[2].element_bytes = 4)),
        ("x-half-an-element.adj", rebuilt(worked, |p| p.sections[1].bytes.truncate(27))),
        ("x-channel-lengths.adj", rebuilt(worked, |p| p.section(Values, x).bytes.push(0))),
        ("x-more-tiles-than-face.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes.extend([0; 28]))),
        ("x-visible-huge.adj", rebuilt(worked, |p| p.header.visible_voxels.set(u64::MAX))),
        ("x-section-checksum.adj", {
            let mut file = parts(worked).file();
            let last = file.len() - 256;
            file[last] ^= 0x80;
            file
        }),
        ("x-tile-outside.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes[0] = 1)),
        (
            "x-tile-sequence.adj",
            rebuilt("hilbert.adj", |p| {
                let tiles = &mut p.section(Tiles, x).bytes;
                let (a, b) = tiles.split_at_mut(28);
                a[..4].swap_with_slice(&mut b[..4]);
            }),
        ),
        ("x-tile-order-differs.adj", rebuilt("hilbert.adj", |p| p.header.tile_order = 2)),
        ("x-occupancy-empty.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes[16..24].fill(0))),
        ("x-occupancy-outside.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes[16] = 0b101)),
        ("x-first-line.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes[4] = 1)),
        ("x-first-record.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes[15] = 0xff)),
        ("x-low.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes[24] = 0)),
        ("x-high.adj", rebuilt(worked, |p| p.section(Tiles, x).bytes[26] -= 1)),
        ("x-line-end-repeated.adj", rebuilt(worked, |p| p.section(LineEnds, x).bytes[2] = 2)),
        ("x-line-end-past-end.adj", rebuilt(worked, |p| p.section(LineEnds, x).bytes[2] = 5)),
        (
            "x-records-left-over.adj",
            rebuilt(worked, |p| {
                p.section(Steps, x).bytes.push(1);
                p.section(Values, x).bytes.push(1);
            }),
        ),
        (
            "x-mask-without-line-end.adj",
            rebuilt("rows.adj", |p| {
                let mask = &mut p.section(Tiles, x).bytes[16..24];
                let byte = mask.iter_mut().find(|byte| **byte != 0xff).unwrap();
                *byte |= 1 << byte.trailing_ones();
            }),
        ),
        ("x-step-past-end.adj", rebuilt(worked, |p| p.section(Steps, x).bytes[3] = 46)),
        ("x-trailing-stepping.adj", rebuilt(worked, |p| p.section(Steps, x).bytes[1] = 0)),
        ("x-stepping-with-value.adj", rebuilt(worked, |p| p.section(Values, x).bytes[2] = 7)),
        ("x-visible-count.adj", rebuilt(worked, |p| p.header.visible_voxels.set(4))),
        ("x-lanes-value.adj", rebuilt("magnitudes-only.adj", |p| p.section(Values, Axis::Y).bytes[1] ^= 1)),
        (
            "x-lanes-swapped.adj",
            rebuilt("magnitudes-only.adj", |p| {
                // Two voxels of a lane exchange their magnitudes: every count and every sum of codes stays.
                let magnitudes = &mut p.section(SectionKind::Magnitudes, Axis::Y).bytes;
                let other = (1..magnitudes.len()).find(|&i| magnitudes[i] != magnitudes[0]).unwrap();
                magnitudes.swap(0, other);
            }),
        ),
        ("x-filling.adj", patched(worked, |f| *f.last_mut().unwrap() = 1)),
        ("x-table-filling.adj", patched(worked, |f| f[FIRST_ENTRY + 5 * ENTRY] = 1)),
        ("x-description-utf8.adj", rebuilt(worked, |p| p.sections[0].bytes[2] = 0xff)),
        ("x-description-json.adj", rebuilt(worked, |p| p.sections[0].bytes.truncate(9))),
        ("x-description-array.adj", rebuilt(worked, |p| p.sections[0].bytes = b"[]".to_vec())),
        ("x-description-deep.adj", described(&format!("{{\"a\":{}{}}}", "[".repeat(127), "]".repeat(127)))),
        ("x-description-number.adj", described("{\"a\":1e999}")),
        ("x-description-surrogate.adj", described("{\"a\":\"\\ud800\"}")),
        ("x-description-bom.adj", described("\u{feff}{}")),
        ("x-coverage-lacking.adj", rebuilt("coverage.adj", |p| p.sections.retain(|s| s.kind != 0x8010 || s.axis == 0))),
        ("x-coverage-wide.adj", rebuilt("coverage.adj", |p| p.section(Coverage, x).element_bytes = 4)),
        ("x-coverage-zero-wide.adj", rebuilt("coverage.adj", |p| p.section(Coverage, x).element_bytes = 0)),
        ("x-coverage-two-widths.adj", rebuilt("coverage.adj", |p| recover(p, 2))),
        ("x-coverage-half-a-word.adj", rebuilt("coverage-words.adj", |p| _ = p.section(Coverage, x).bytes.pop())),
        ("x-coverage-too-few.adj", {
            rebuilt("coverage-words.adj", |p| {
                p.sections.iter_mut().filter(|s| s.kind == 0x8010).for_each(|s| s.element_bytes = 1)
            })
        }),
        ("x-coverage-none.adj", rebuilt("coverage.adj", |p| p.section(Coverage, x).bytes[3] = 0)),
        ("x-coverage-word-none.adj", rebuilt("coverage-words.adj", |p| p.section(Coverage, x).bytes[6] &= 0x80)),
        (
            "x-coverage-offset-x.adj",
            rebuilt("coverage-words.adj", |p| {
                let bytes = &mut p.section(Coverage, x).bytes;
                (bytes[6], bytes[7]) = (bytes[6] | 0x80, bytes[7] | 0x03);
            }),
        ),
        ("x-coverage-offset-y.adj", rebuilt("coverage-words.adj", |p| p.section(Coverage, x).bytes[7] |= 0x1c)),
        ("x-coverage-offset-z.adj", rebuilt("coverage-words.adj", |p| p.section(Coverage, x).bytes[7] |= 0xe0)),
        ("x-coverage-differs.adj", rebuilt("coverage.adj", |p| p.section(Coverage, Axis::Y).bytes[3] ^= 1)),
        ("x-level-axis.adj", rebuilt(levels, |p| p.level(2).axis = 0)),
        ("x-level-elements.adj", rebuilt(levels, |p| p.level(2).element_bytes = 2)),
        ("x-levels-rising.adj", rebuilt(levels, |p| p.sections.swap(3, 4))),
        ("x-level-twice.adj", rebuilt(levels, |p| p.sections.insert(3, p.sections[3].clone()))),
        ("x-level-1-lacking.adj", rebuilt(levels, |p| p.sections.retain(|s| s.kind != 0x8001))),
        ("x-level-3-lacking.adj", rebuilt(levels, |p| p.sections.retain(|s| s.kind != 0x8003))),
        ("x-level-after-lane.adj", {
            rebuilt(levels, |p| {
                let level = p.sections.remove(4);
                p.sections.push(level);
            })
        }),
        ("x-level-cut.adj", rebuilt(levels, |p| p.level(2).bytes.truncate(400))),
        ("x-level-no-file.adj", rebuilt(levels, |p| p.level(2).bytes.clear())),
        (
            "x-level-in-level.adj",
            in_level(2, |p| {
                p.sections.insert(1, Part { kind: 0x8001, axis: 255, element_bytes: 1, bytes: level_of(levels, 3) })
            }),
        ),
        ("x-level-dims.adj", in_level(1, |p| p.header.dims[0].set(8))),
        ("x-level-spacing.adj", in_level(1, |p| p.header.spacing[2].set(2.5))),
        ("x-level-origin.adj", in_level(1, |p| p.header.origin[0].set(-1.0))),
        ("x-level-direction.adj", in_level(1, |p| p.header.direction[0][0].set(-1.0))),
        ("x-level-order.adj", in_level(4, |p| p.header.tile_order = 2)),
        ("x-level-scale.adj", in_level(1, |p| p.header.value_low.set(101.0))),
        ("x-level-uncovered.adj", in_level(1, |p| p.sections.retain(|s| s.kind != 0x8010))),
        ("x-level-no-normals.adj", {
            in_level(1, |p| {
                p.header.normal_bits = 0;
                p.sections.retain(|s| s.kind != SectionKind::Normals as u16);
            })
        }),
        ("x-level-fewer-lanes.adj", {
            rebuilt("levels-lanes.adj", |p| {
                let level = p.level(2);
                let mut parts = Parts::of_file(&level.bytes);
                parts.sections.retain(|s| s.axis != 2);
                level.bytes = parts.file();
            })
        }),
        ("x-level-description.adj", in_level(2, |p| p.sections[0].bytes = b"{ }".to_vec())),
        ("x-level-no-object.adj", in_level(2, |p| p.sections[0].bytes = b"[]".to_vec())),
        ("x-level-checksum.adj", {
            rebuilt(levels, |p| {
                let bytes = &mut p.level(3).bytes;
                let last = bytes.len() - 256;
                bytes[last] ^= 1;
            })
        }),
        ("x-level-step.adj", in_level(3, |p| p.section(Steps, x).bytes[0] = 200)),
        ("x-level-1-words.adj", in_level(1, |p| recover(p, 2))),
        ("x-level-2-masks.adj", in_level(2, |p| recover(p, 1))),
        ("x-level-coverage-none.adj", in_level(1, |p| p.section(Coverage, x).bytes[0] = 0)),
        ("x-level-coverage-offset.adj", in_level(3, |p| p.section(Coverage, x).bytes[1] |= 0xe0)),
        // Codes that voxels may have, but not these.
        ("x-level-coverage.adj", in_level(1, |p| p.section(Coverage, x).bytes[0] ^= 0xff)),
        ("x-level-share.adj", in_level(2, |p| p.section(Coverage, x).bytes[0] ^= 1)),
        (
            "x-level-offset.adj",
            in_level(2, |p| {
                // One place farther along z.
                let high = &mut p.section(Coverage, x).bytes[1];
                *high = if *high < 0xc0 { *high + 0x20 } else { *high - 0x20 };
            }),
        ),
        (
            "x-level-coverages-swapped.adj",
            in_level(1, |p| {
                let bytes = &mut p.section(Coverage, x).bytes;
                let other = (1..bytes.len()).find(|&i| bytes[i] != 0 && bytes[i] != bytes[0]).unwrap();
                bytes.swap(0, other);
            }),
        ),
        ("x-limits-axis.adj", in_limits(|limits| limits.axis = 0)),
        ("x-limits-elements.adj", in_limits(|limits| limits.element_bytes = 4)),
        ("x-limits-lacking.adj", in_limits(|limits| limits.bytes.truncate(8))),
        ("x-limits-nan.adj", in_limits(|limits| limits.bytes[..4].copy_from_slice(&f32::NAN.to_le_bytes()))),
        ("x-limits-negative.adj", in_limits(|limits| limits.bytes[15] |= 0x80)),
        (
            "x-limits-twice.adj",
            rebuilt("limits.adj", |p| {
                let limits = p.sections.last().cloned();
                p.sections.extend(limits);
            }),
        ),
    ]
}
