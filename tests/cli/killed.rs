//! Runs that are killed, and runs that get in each other's way: the output is a whole file, the old or a new one, and
//! what a killed run left is gone after the next.
//!
//! Cannot catch: what a power cut does to writes that the system had not finished.
#![cfg(unix)]

use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use adjsplat_tests::random::Random;
use adjsplat_tests::say;

use super::harness::{Folder, Runs as _, program};

/// Builds of about 6 MB and 4 MB.
const BUILDS: [&str; 2] = ["phantom:constant --dims 80x80x80", "phantom:constant --dims 70x70x70"];
/// Runs that are killed.
const KILLS: u64 = 50;

fn start(folder: &Folder, build: &str) -> Child {
    program()
        .current_dir(folder.path())
        .args(format!("build {build} -o out.adj --quiet").split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program was built")
}

/// What each of [`BUILDS`] writes, and about how long one takes.
fn built_alone(folder: &Folder) -> (Vec<Vec<u8>>, Duration) {
    let mut longest = Duration::ZERO;
    let whole = BUILDS.map(|build| {
        let begin = Instant::now();
        assert!(start(folder, build).wait().expect("it is ours").success());
        longest = longest.max(begin.elapsed());
        folder.adj("verify out.adj").done();
        content(folder)
    });
    (whole.into(), longest)
}

fn content(folder: &Folder) -> Vec<u8> {
    std::fs::read(folder.file("out.adj")).expect("it is there")
}

fn is_temporary(name: &str) -> bool {
    name.starts_with(".adj-") && Path::new(name).extension().is_some_and(|end| end == "tmp")
}

#[test]
fn runs_that_are_killed_leave_the_old_file_or_the_new_one() {
    let folder = Folder::new();
    let (whole, longest) = built_alone(&folder);
    let mut held = 1;
    let (mut replaced, mut left) = (0, 0);
    let mut random = Random(1);
    let mut part = |time: Duration| time.mul_f64(random.number());
    for kill in 0..KILLS {
        let now = usize::from(held == 0);
        let mut child = start(&folder, BUILDS[now]);
        // At any instant of the run; every second time while it writes, which is short.
        if kill % 2 == 0 {
            std::thread::sleep(part(longest));
        } else {
            while !folder.names().iter().any(|name| is_temporary(name)) {
                if child.try_wait().expect("it is ours").is_some() {
                    break;
                }
            }
            std::thread::sleep(part(longest / 4));
        }
        let _ = child.kill();
        child.wait().expect("it is ours");
        let found = content(&folder);
        let Some(index) = whole.iter().position(|bytes| *bytes == found) else {
            panic!("kill {kill} left {} bytes that nobody wrote", found.len());
        };
        assert!(index == held || index == now);
        replaced += u32::from(index == now);
        held = index;
        let temporary = folder.names().iter().filter(|name| is_temporary(name)).count();
        // A run removes what the one before it left, before its own work.
        assert!(temporary <= 1 && folder.names().len() == 1 + temporary, "{:?}", folder.names());
        left += u32::from(temporary > 0);
    }
    folder.adj("verify out.adj").done();
    assert!(start(&folder, BUILDS[0]).wait().expect("it is ours").success());
    assert_eq!(folder.names(), ["out.adj"]);
    assert!(content(&folder) == whole[0]);
    if left == 0 {
        say(&format!("SKIPPED: of {KILLS} runs none was killed while it wrote; {replaced} had ended"));
    }
}

#[test]
fn of_two_builds_to_one_output_one_wins_and_is_whole() {
    let folder = Folder::new();
    let (whole, _) = built_alone(&folder);
    for _ in 0..8 {
        let mut children: Vec<Child> = BUILDS.iter().chain(&BUILDS).map(|build| start(&folder, build)).collect();
        // Whoever looks meanwhile sees a whole file too.
        while children.iter_mut().any(|child| child.try_wait().expect("it is ours").is_none()) {
            assert!(whole.contains(&content(&folder)));
            folder.adj("verify out.adj").done();
        }
        for child in children {
            let output = child.wait_with_output().expect("it is ours");
            assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
        }
        assert!(whole.contains(&content(&folder)));
        assert_eq!(folder.names(), ["out.adj"]);
    }
}
