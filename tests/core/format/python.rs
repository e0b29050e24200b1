//! The reader in another language: `formats/read_adj.py`, written from adj-1.md, must see the same voxels.

use std::process::{Command, Output};

use adjsplat::arena::{Arena, Coverage};
use adjsplat::classify::MagnitudeCodec;
use adjsplat::classify::normal::{self, Coherence};
use adjsplat::volume::Axis;
use adjsplat_tests::skipped;

use crate::format::assemble::{Parts, listing, voxels_of};
use crate::format::examples::folder;
use crate::format::refused::described;
use crate::format::scenes::scenes;

/// Runs the reader; `None`, said aloud, where there is no Python with numpy.
fn read_adj(arguments: &[&str]) -> Option<Output> {
    let python = Command::new("python3").args(["-c", "import numpy"]).output();
    let reason = match python {
        Ok(output) if output.status.success() => {
            let script = folder().with_file_name("read_adj.py");
            let output = Command::new("python3").arg(script).args(arguments).current_dir(folder()).output();
            return Some(output.expect("python3 ran a moment ago"));
        }
        Ok(output) => String::from_utf8_lossy(&output.stderr).lines().last().unwrap_or_default().to_owned(),
        Err(error) => format!("python3: {error}"),
    };
    skipped("ADJ_PYTHON", &format!("formats/read_adj.py was not compared: {reason}"));
    None
}

#[test]
fn the_python_reader_sees_every_voxel_as_the_library_does() {
    let mut expected = String::new();
    let scenes = scenes();
    for scene in &scenes {
        let file = Parts::of_scene(scene).file();
        let arena = Arena::new(&file).unwrap();
        for lane in arena.lanes() {
            expected += &format!("# {} lane {}\n", scene.name, lane.axis.name());
            expected += &listing(&voxels_of(&lane), scene.channels);
        }
    }
    let names = scenes.iter().map(|scene| scene.name);
    let Some(output) = read_adj(&["--list"].into_iter().chain(names).collect::<Vec<_>>()) else { return };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let got = String::from_utf8(output.stdout).unwrap();
    for (line, (got, expected)) in got.lines().zip(expected.lines()).enumerate() {
        assert_eq!(got, expected, "line {}", line + 1);
    }
    assert_eq!(got.lines().count(), expected.lines().count());
}

#[test]
fn the_python_reader_sees_every_level_as_the_library_does() {
    for scene in scenes().iter().filter(|scene| scene.levels > 0) {
        for (number, level) in (1..).zip(scene.of_levels()) {
            let Some(output) = read_adj(&["--list", "--lane", "x", "--level", &format!("{number}"), scene.name]) else {
                return;
            };
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            let file = Parts::of_scene(&level).file();
            let lane = Arena::new(&file).unwrap().lane(Axis::X).unwrap();
            let expected = format!("# {} lane x\n{}", scene.name, listing(&voxels_of(&lane), level.channels));
            assert_eq!(String::from_utf8(output.stdout).unwrap(), expected, "{} level {number}", scene.name);
        }
    }
}

#[test]
fn the_python_reader_decodes_codes_as_the_library_does() {
    let names = [
        "all-channels.adj",
        "bytes-and-normals.adj",
        "magnitudes-only.adj",
        "coverage.adj",
        "coverage-words.adj",
        "coherence.adj",
    ];
    let Some(output) = read_adj(&[&["--decoded", "--lane", "x"], &names[..]].concat()) else { return };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let got = String::from_utf8(output.stdout).unwrap();
    let mut rows = got.lines().filter(|line| !line.starts_with('#'));
    for scene in scenes().iter().filter(|scene| names.contains(&scene.name)) {
        let facts = scene.facts();
        let magnitudes = MagnitudeCodec::new(facts.scales.magnitude_scale).unwrap();
        let mut voxels = scene.voxels.clone();
        voxels.sort_by_key(|&([x, y, z], _)| [z, y, x]);
        for (at, record) in voxels {
            let normal = normal::decode(record.normal, scene.channels.normal_bits);
            let value = facts.scales.value_low + f64::from(record.value) * facts.scales.value_step;
            let expected = at.map(f64::from).into_iter().chain([value]).chain(normal.map(f64::from));
            let magnitude = magnitudes.decode(record.magnitude);
            let numbers = rows.next().expect("a row a voxel").split(' ').map(|number| number.parse::<f64>().unwrap());
            let Coverage { share, offset } = Coverage::of_code(record.coverage, scene.channels);
            let coverage = [[share, offset[0], offset[1], offset[2]]].into_iter().flatten().map(f64::from);
            let has_coverages = scene.channels.coverage_bits > 0;
            let Coherence { alike, bare } = Coherence::of_code(record.normal, scene.channels.normal_bits);
            let coherence = [alike, bare].into_iter().map(f64::from).filter(|_| scene.channels.coherence);
            let expected = expected.chain([magnitude]).chain(coverage.filter(|_| has_coverages)).chain(coherence);
            let expected: Vec<f64> = expected.collect();
            let numbers: Vec<f64> = numbers.collect();
            assert_eq!(numbers.len(), expected.len());
            for (got, expected) in numbers.into_iter().zip(expected) {
                // The library decodes to single precision.
                assert!((got - expected).abs() <= 2e-7 * expected.abs().max(1.0), "{}: {got} {expected}", scene.name);
            }
        }
    }
    assert_eq!(rows.next(), None);
}

#[test]
fn the_python_reader_refuses_what_it_cannot_read() {
    // One file for each rule that the reader checks; it reads no checksum.
    let refused = [
        ("R1", "x-magic.adj"),
        ("R2", "x-future-major.adj"),
        ("R4", "x-truncated.adj"),
        ("R5", "x-overlap.adj"),
        ("R6", "x-no-grid-points.adj"),
        ("R6", "x-spacing.adj"),
        ("R6", "x-direction.adj"),
        ("R6", "x-direction-length.adj"),
        ("R7", "x-value-bits.adj"),
        ("R10", "x-unknown-kind.adj"),
        ("R11", "x-channel-lengths.adj"),
        ("R13", "x-tile-order-differs.adj"),
        ("R16", "x-mask-without-line-end.adj"),
        ("R22", "x-description-utf8.adj"),
        ("R22", "x-description-json.adj"),
        ("R22", "x-description-array.adj"),
        ("R22", "x-description-deep.adj"),
        ("R22", "x-description-number.adj"),
        ("R22", "x-description-surrogate.adj"),
        ("R22", "x-description-bom.adj"),
        ("R10", "x-coverage-lacking.adj"),
        ("R10", "x-level-axis.adj"),
        ("R11", "x-level-elements.adj"),
        ("R23", "x-levels-rising.adj"),
        ("R23", "x-level-twice.adj"),
        ("R23", "x-level-1-lacking.adj"),
        ("R23", "x-level-after-lane.adj"),
        ("R4", "x-level-cut.adj"),
        ("R24", "x-level-in-level.adj"),
        ("R24", "x-level-dims.adj"),
        ("R24", "x-level-origin.adj"),
        ("R24", "x-level-scale.adj"),
        ("R24", "x-level-uncovered.adj"),
        ("R24", "x-level-1-words.adj"),
        ("R24", "x-level-2-masks.adj"),
        ("R11", "x-coverage-wide.adj"),
        ("R11", "x-coverage-two-widths.adj"),
        ("R11", "x-coverage-half-a-word.adj"),
        ("R11", "x-coverage-too-few.adj"),
        ("R24", "x-level-description.adj"),
        ("R10", "x-limits-axis.adj"),
        ("R11", "x-limits-elements.adj"),
        ("R27", "x-limits-lacking.adj"),
        ("R27", "x-limits-nan.adj"),
        ("R27", "x-limits-negative.adj"),
        ("R10", "x-limits-twice.adj"),
    ];
    let Some(output) = read_adj(&refused.map(|(_, name)| name)) else { return };
    let messages = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), messages.lines().count()), (Some(2), refused.len()), "{messages}");
    for ((rule, name), message) in refused.iter().zip(messages.lines()) {
        assert!(message.starts_with(&format!("read_adj: {name}: {rule}: ")), "{message}");
    }
}

#[test]
fn the_python_reader_says_in_one_line_that_a_description_is_nested_too_deep() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("deep.adj");
    std::fs::write(&path, described(&format!("{{\"a\":{}", "[".repeat(100_000)))).unwrap();
    let Some(output) = read_adj(&[path.to_str().unwrap()]) else { return };
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), message.lines().count()), (Some(2), 1), "{message}");
    assert!(message.contains("R22: a description more than 127 levels deep"), "{message}");
}
