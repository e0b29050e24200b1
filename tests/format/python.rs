//! The reader in another language: `formats/read_adj.py`, written from adj-1.md, must see the same voxels.

use std::process::{Command, Output};

use adjsplat::arena::Arena;

use crate::assemble::{Parts, listing, voxels_of};
use crate::examples::{folder, made};
use crate::scenes::scenes;

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
    assert!(!std::env::var("ADJ_PYTHON").is_ok_and(|value| value == "require"), "no Python reader: {reason}");
    eprintln!("SKIPPED: formats/read_adj.py was not compared ({reason}); ADJ_PYTHON=require makes this a failure");
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
            expected += &listing(&voxels_of(&lane));
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
fn the_python_reader_refuses_what_does_not_open() {
    // One file suffices for each rule that the reader checks; it reads no checksum.
    for (rule, name) in [
        ("R1", "x-magic.adj"),
        ("R2", "x-future-major.adj"),
        ("R4", "x-truncated.adj"),
        ("R5", "x-overlap.adj"),
        ("R10", "x-unknown-kind.adj"),
        ("R11", "x-channel-lengths.adj"),
    ] {
        assert!(made().iter().any(|(made, _)| *made == name));
        let Some(output) = read_adj(&[name]) else { return };
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{name}: {message}");
        assert!(message.contains(rule) && message.lines().count() == 1, "{name}: {message}");
    }
}
