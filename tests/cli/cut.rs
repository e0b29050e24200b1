//! Files that are cut while they are read: one line that names the file, exit code 2, nothing left.
//!
//! Cannot catch: disks that fail, which raise the same signal.

use std::fs::File;
use std::process::Stdio;
use std::time::{Duration, Instant};

use super::harness::{Folder, Ran, Runs as _, program};

/// Runs `line` in `folder` and cuts `big.adj` to its first page when `begun`, which gets the process's number, says so.
fn cut_during(folder: &Folder, line: &str, begun: impl Fn(u32) -> bool) -> Ran {
    let mut child = program()
        .current_dir(folder.path())
        .args(line.split_whitespace())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program was built");
    let start = Instant::now();
    while !begun(child.id()) {
        assert!(child.try_wait().expect("it is ours").is_none(), "{line}: it ended before the cut");
        assert!(start.elapsed() < Duration::from_secs(60), "{line}: it never began");
        std::thread::sleep(Duration::from_micros(200));
    }
    File::options().write(true).open(folder.file("big.adj")).expect("it was built").set_len(4096).expect("is cut");
    Ran::new(&child.wait_with_output().expect("it is ours"))
}

fn folder() -> Folder {
    let folder = Folder::new();
    folder.adj("build phantom:constant --dims 160x160x160 -o big.adj --quiet").done();
    folder
}

const CUT: &[&str] = &["big.adj: the file was cut while it was read"];

#[test]
fn a_file_cut_while_frames_are_drawn_is_named_and_no_temporary_stays() {
    let folder = folder();
    let first = folder.file("t-000.png");
    let line = "render big.adj -o t.png --frames 400 --size 64x64 --quiet";
    let told = cut_during(&folder, line, |_| first.exists()).refused(CUT);
    // It did not say what is written.
    let written = folder.names().len() - 1;
    let name = folder.names().into_iter().filter(|name| name.ends_with(".png")).max().expect("the first is");
    assert!(told.contains(&format!("; {written} of 400 frames ")) && told.ends_with(&name), "{told}");
    assert!(folder.names().iter().all(|name| !name.starts_with(".adj-")), "{:?}", folder.names());
}

#[test]
fn a_file_cut_while_it_is_trimmed_is_named_and_no_temporary_stays() {
    let folder = folder();
    let temporary = |_| folder.names().iter().any(|name| name.starts_with(".adj-"));
    cut_during(&folder, "trim big.adj -o part.adj --order hilbert --quiet", temporary).refused(CUT);
    assert_eq!(folder.names(), ["big.adj"]);
}

#[test]
fn a_file_cut_while_it_is_checked_is_named() {
    // The files before it take long enough: it is mapped only when its turn comes, so it is cut when it is open.
    let line = format!("verify {}", "big.adj ".repeat(200));
    let is_mapped =
        |id: u32| std::fs::read_to_string(format!("/proc/{id}/maps")).is_ok_and(|maps| maps.contains("big.adj"));
    let cut = || {
        let start = Instant::now();
        let folder = folder();
        cut_during(&folder, &line, |id| start.elapsed() > Duration::from_millis(300) && is_mapped(id))
    };
    // A file that is opened after the cut is no longer whole, which the check says by itself: then the cut came between two files.
    let ran = (0..20).map(|_| cut()).find(|ran| ran.code != Some(1)).expect("some cut comes while a file is read");
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    assert!(ran.stderr.contains("cut while it was read"), "{}", ran.stderr);
}
