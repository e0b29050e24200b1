//! Limits of the shell (`ulimit`): one line at the end that says what to do, exit code 2, nothing left.
//!
//! Cannot catch: so little memory that the system does not start the program.

use super::harness::{Folder, Ran, Runs as _};

/// Runs `line` in `folder` under a limit.
fn limited(folder: &Folder, limit: &str, line: &str) -> Ran {
    let mut shell = std::process::Command::new("sh");
    shell.args(["-c", &format!("ulimit {limit}; exec \"$0\" {line}"), env!("CARGO_BIN_EXE_adj")]);
    let shell = shell.env("RUST_BACKTRACE", "0").current_dir(folder.path());
    Ran::new(&shell.output().expect("there is a shell"))
}

const ABORTED: &str = "adj: stopped for the reason above; if memory is short, take a smaller picture";

/// The process aborted with exit code 134, and left a temporary file.
#[test]
fn memory_that_is_refused_ends_with_a_line_and_leaves_nothing() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 64x64x64 -q -o a.adj").done();
    folder.adj("render a.adj --renderer cpu -q -o a.png").done();
    let starts = |kib: &u32| limited(&folder, &format!("-v {kib}"), "info a.adj").code == Some(0);
    let least = (4..64).map(|n| n << 13).find(starts).expect("half a gigabyte is enough");
    let mut aborted = 0;
    for line in [
        "build phantom:gyroid --dims 64x64x64 -q -o out.adj",
        "build phantom:gyroid --dims 64x64x64 -q -o out.adj --threads 1024",
        "trim a.adj --levels auto -q -o out.adj",
        "split a.adj --slab 16 -q -o out.adjs",
        "render a.adj --renderer cpu -q -o out.png",
        "compare a.png a.png",
    ] {
        for more in (8..96).step_by(16) {
            let limit = format!("-v {}", least + (more << 10));
            let ran = limited(&folder, &limit, line);
            // Rust's own lines, of several threads, are before it.
            let told = ran.stderr.lines().rfind(|line| line.starts_with("adj: ")).unwrap_or_default();
            match ran.code {
                // A brick that could not be mapped again was not counted.
                Some(0) => {
                    assert!(!line.contains("split") || ran.stdout.contains("4 bricks, 4 with"), "{}", ran.stdout)
                }
                Some(2) => assert!(!told.is_empty(), "{limit}, {line}: {}", ran.stderr),
                code => panic!("{code:?}: {limit}, {line}: {}", ran.stderr),
            }
            aborted += u32::from(told.starts_with(ABORTED));
            assert!(folder.names().iter().all(|name| !name.starts_with('.')), "{limit}, {line}: {:?}", folder.names());
            for name in folder.names().iter().filter(|name| name.starts_with("out")) {
                assert_eq!(ran.code, Some(0), "{limit}, {line}: {name} is there");
                let out = folder.file(name);
                if out.is_dir() { std::fs::remove_dir_all(out) } else { std::fs::remove_file(out) }
                    .expect("it is ours");
            }
        }
    }
    assert!(aborted > 0, "the system refused nothing");
}

/// The process aborted with exit code 134.
#[test]
fn a_small_stack_ends_with_a_line() {
    let folder = Folder::new();
    let ran = limited(&folder, "-s 128", "build phantom:gyroid --dims 16x16x16 -q -o out.adj");
    if ran.code != Some(0) {
        assert_eq!(ran.code, Some(2), "{}", ran.stderr);
        assert!(ran.stderr.lines().last().is_some_and(|line| line.starts_with(ABORTED)), "{}", ran.stderr);
        assert!(folder.names().is_empty(), "{:?}", folder.names());
    }
}
