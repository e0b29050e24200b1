//! The frozen examples: every byte as it was, every result as `expected.txt` says.

use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Once;

use adjsplat::arena::layout::SectionKind;
use adjsplat::arena::{Arena, LaneRows, Levels};
use adjsplat::build::Unobserved;
use adjsplat::file::{RowsOutput, arena_bytes, write_rows};
use adjsplat::internals::{stored_transfer, transpose};
use adjsplat::volume::Axis;
use sha2::{Digest, Sha256};

use crate::format::assemble::{Parts, listing, pack, voxels_of};
use crate::format::oracle;
use crate::format::refused::{in_level, refused};
use crate::format::scenes::scenes;

pub(crate) fn folder() -> PathBuf {
    adjsplat_tests::repository().join("formats/examples")
}

/// Rewrites the folder, once a run, if that is asked for.
fn bless() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        if std::env::var("ADJ_BLESS").is_ok_and(|value| value == "1") {
            for (name, bytes) in made() {
                std::fs::write(folder().join(name), bytes).unwrap();
            }
            std::fs::write(folder().join("expected.txt"), results()).unwrap();
        }
    });
}

/// The text of `expected.txt`.
fn results() -> String {
    made().iter().fold(HEAD.to_owned(), |text, (name, bytes)| text + &result_of(name, bytes) + "\n")
}

/// Every example by name, made anew.
pub(crate) fn made() -> Vec<(&'static str, Vec<u8>)> {
    let valid = scenes().into_iter().map(|scene| (scene.name, Parts::of_scene(&scene).file()));
    valid.chain(refused()).collect()
}

/// What opening and checking `file` gives, as a line of `expected.txt`.
fn result_of(name: &str, file: &[u8]) -> String {
    let refusal = |by, fault: adjsplat::error::FormatFault| format!("{name} {by} {} {}", fault.rule, fault.at);
    let arena = match Arena::new(file) {
        Ok(arena) => arena,
        Err(fault) => return refusal("open", fault),
    };
    let checked = match arena.check() {
        Ok(checked) => checked,
        Err(fault) => return refusal("check", fault),
    };
    let [x, y, z] = arena.facts().grid.dims;
    let mut line = format!("{name} ok {x}x{y}x{z} visible={} stepping=", checked.visible_voxels);
    for (index, lane) in checked.lanes.iter().enumerate() {
        let comma = if index > 0 { "," } else { "" };
        write!(line, "{comma}{}:{}", lane.axis.name(), lane.stepping_voxels).unwrap();
    }
    write!(line, " content={}", content(&arena)).unwrap();
    for number in 1..=arena.level_count() {
        let level = arena.level(number).unwrap();
        let [x, y, z] = level.facts().grid.dims;
        write!(line, " level{number}={x}x{y}x{z}:{}:{}", level.facts().visible_voxels, content(&level)).unwrap();
    }
    line
}

/// The hash of the voxels of an arena.
fn content(arena: &Arena) -> String {
    let hash = Sha256::digest(listing(&voxels_of(&arena.lane(Axis::X).unwrap()), arena.facts().channels));
    hash[..8].iter().fold(String::new(), |text, byte| text + &format!("{byte:02x}"))
}

const HEAD: &str = "\
# One line a file.
#   NAME ok DIMS visible=VOXELS stepping=LANE:STEPPING_VOXELS,... content=HASH
#       level1=DIMS:VOXELS:HASH ...     on the same line, if there are levels
#   NAME open RULE BYTE     must be refused when it is opened, by that rule, at that byte
#   NAME check RULE BYTE    opens, and must be refused by the check
# RULE is the first broken rule and BYTE the place of the fault, both by section 7.1 of adj-1.md.
# HASH: first 16 digits of SHA-256 over a text of one line a voxel, by z, then y, then x: the decimal numbers
# x, y, z, value code, normal code, magnitude code with a space between and a line feed after; 0 for a channel
# that the file does not have. If the file has coverages, the coverage code follows.
";

#[test]
fn every_example_is_byte_for_byte_what_it_was() {
    bless();
    for (name, bytes) in made() {
        let path = folder().join(name);
        let frozen = std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        if let Some(at) = (0..frozen.len().max(bytes.len())).find(|&i| frozen.get(i) != bytes.get(i)) {
            panic!("{name} differs from byte {at} on; a change of bytes is a new major version and new examples");
        }
    }
}

#[test]
fn every_example_has_the_expected_result() {
    bless();
    let results = results();
    let expected = std::fs::read_to_string(folder().join("expected.txt")).unwrap();
    for (expected, got) in expected.lines().zip(results.lines()) {
        assert_eq!(got, expected);
    }
    assert_eq!(results.lines().count(), expected.lines().count());
    let listed = expected.lines().filter(|line| !line.starts_with('#')).count();
    let files = std::fs::read_dir(folder()).unwrap().count();
    assert_eq!(files, listed + 1, "every file in the folder is listed");
    for line in expected.lines().filter(|line| !line.starts_with('#')) {
        assert_eq!(line.starts_with("x-"), !line.contains(" ok "), "files to refuse start with x-: {line}");
    }
}

#[test]
fn every_rule_has_a_file_that_breaks_it() {
    bless();
    let expected = std::fs::read_to_string(folder().join("expected.txt")).unwrap();
    for rule in 1..=27 {
        let rule = format!("R{rule}");
        let broken = expected.lines().any(|line| line.split(' ').nth(2) == Some(&rule));
        assert!(broken, "no example breaks {rule}");
    }
}

#[test]
fn valid_examples_hold_their_scenes_in_every_lane() {
    for scene in scenes() {
        let file = Parts::of_scene(&scene).file();
        let arena = Arena::new(&file).unwrap();
        assert_eq!(arena.facts(), &scene.facts(), "{}", scene.name);
        assert_eq!(arena.description(), scene.description.as_deref().unwrap_or("").as_bytes());
        assert!(oracle::sound(&arena), "{}", scene.name);
        let mut voxels = scene.voxels.clone();
        voxels.sort_by_key(|&([x, y, z], _)| [z, y, x]);
        let x_lane = arena.lane(Axis::X).unwrap();
        assert_eq!(arena.lanes().count(), scene.lanes);
        for lane in arena.lanes() {
            assert_eq!(voxels_of(&lane), voxels, "{} lane {}", scene.name, lane.axis.name());
        }
        for axis in [Axis::Y, Axis::Z] {
            assert_eq!(transpose(&x_lane, axis, scene.tile_order), pack(&scene, axis), "{}", scene.name);
        }
    }
}

#[test]
fn the_library_writes_the_same_files() {
    let mut compared = 0;
    for scene in scenes().iter().filter(|scene| scene.extra.is_empty() && scene.levels == 0) {
        // A scene without a description is one that the library's writer does not write.
        let Some(description) = &scene.description else { continue };
        let lanes: Vec<_> = Axis::ALL[..scene.lanes].iter().map(|&axis| pack(scene, axis)).collect();
        let written = arena_bytes(&scene.facts(), &lanes, description);
        assert!(written == Parts::of_scene(scene).file(), "{}", scene.name);
        compared += 1;
    }
    assert!(compared >= 10);
}

#[test]
fn the_library_writes_the_same_levels() {
    let folder = tempfile::tempdir().unwrap();
    for scene in scenes().iter().filter(|scene| scene.levels > 0) {
        let lane = pack(scene, Axis::X);
        let rows = LaneRows::new(lane.view(), |_, _, record| Some(record));
        let output = RowsOutput {
            facts: scene.facts(),
            description: scene.description.as_deref().unwrap(),
            lane_count: u8::try_from(scene.lanes).unwrap(),
            memory: None,
            threads: 2,
            levels: Levels::Count(scene.levels),
        };
        let path = folder.path().join(scene.name);
        write_rows(&path, &rows, &output, &mut Unobserved).unwrap();
        let written = std::fs::read(&path).unwrap();
        let arena = Arena::new(&written).unwrap();
        assert_eq!(arena.level_limits().len(), usize::from(scene.levels), "{}", scene.name);
        arena.check().unwrap();
        // Limits are measured.
        let without_limits = |mut parts: Parts| {
            parts.sections.retain(|section| section.kind != SectionKind::LevelLimits as u16);
            parts.header.minor = 0.into();
            parts.file()
        };
        let [written, wanted] = [Parts::of_file(&written), Parts::of_scene(scene)].map(without_limits);
        assert!(written == wanted, "{}", scene.name);
    }
}

/// Their lowest bits say nothing of coherence.
#[test]
fn normals_of_levels_of_version_1_1_have_directions_only() {
    let scenes = scenes();
    let scene = scenes.iter().find(|scene| scene.name == "levels.adj").unwrap();
    let mut parts = Parts::of_scene(scene);
    for (number, minor) in [(1, 1), (2, 2)] {
        let level = parts.level(number);
        let mut of_level = Parts::of_file(&level.bytes);
        of_level.header.minor = minor.into();
        level.bytes = of_level.file();
    }
    let file = parts.file();
    let arena = Arena::new(&file).unwrap();
    let coherence = |level| arena.level(level).unwrap().facts().channels.coherence;
    assert_eq!([coherence(1), coherence(2)], [false, true]);
    assert!(arena.check().is_ok());
}

#[test]
fn levels_hold_their_scenes_in_every_lane() {
    for scene in scenes() {
        let file = Parts::of_scene(&scene).file();
        let arena = Arena::new(&file).unwrap();
        assert_eq!(arena.level_count(), scene.levels);
        for (number, level) in (1..).zip(scene.of_levels()) {
            let found = arena.level(number).unwrap();
            assert_eq!(found.facts(), &level.facts(), "{} level {number}", scene.name);
            let mut voxels = level.voxels.clone();
            voxels.sort_by_key(|&([x, y, z], _)| [z, y, x]);
            for lane in found.lanes() {
                assert_eq!(voxels_of(&lane), voxels, "{} level {number}", scene.name);
            }
        }
    }
}

/// How codes are averaged is the writer's choice: other values and normals are no fault, other coverages are.
#[test]
fn a_level_may_have_other_means() {
    for kind in [SectionKind::Values, SectionKind::Normals] {
        let file = in_level(2, |level| {
            let codes = &mut level.section(kind, Axis::X).bytes;
            codes[0] ^= 1;
        });
        let arena = Arena::new(&file).unwrap();
        assert!(arena.check().is_ok() && oracle::sound(&arena), "{}", kind.name());
    }
}

#[test]
fn a_file_reads_the_same_at_any_address() {
    for scene in scenes() {
        let file = Parts::of_scene(&scene).file();
        let mut shifted = vec![0; file.len() + 3];
        let here = Arena::new(&file).unwrap().check();
        for by in 1..=3 {
            shifted[by..by + file.len()].copy_from_slice(&file);
            assert_eq!(Arena::new(&shifted[by..by + file.len()]).unwrap().check(), here);
        }
    }
}

/// Writers must name the length; where one did not, readers take that of the grid (section 8.1).
#[test]
fn a_stored_contour_without_a_voxel_length_is_as_wide_as_the_grids_voxels() {
    let mut parts = Parts::of_scene(&scenes()[0]);
    parts.header.spacing = [2.0.into(), 4.0.into(), 8.0.into()];
    let function = r#"{"kind":"contour","contours":[{"value":100,"opacity":0.8,"width":2}]}"#;
    parts.sections[0].bytes = format!(r#"{{"transfer_function":{function}}}"#).into_bytes();
    let file = parts.file();
    let stored = stored_transfer(&Arena::new(&file).unwrap()).unwrap();
    // Four is the mean spacing: the width of two voxels is 8, times a gradient of 1.
    assert!((stored.opacity(104.0, 1.0) - 0.4).abs() < 1e-12, "{}", stored.opacity(104.0, 1.0));
}
