//! Ctrl-C: the program ends soon and leaves nothing half-written.
#![cfg(unix)]

use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use adjsplat_tests::say;

use super::harness::{Folder, Runs as _, program};

fn start(folder: &Folder, line: &str) -> Child {
    program()
        .current_dir(folder.path())
        .args(line.split_whitespace())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program was built")
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([name, &child.id().to_string()]).status().expect("there is a kill");
    assert!(sent.success());
}

/// Waits for `child` to end; its exit code.
fn ended(child: &mut Child, within: Duration) -> Option<i32> {
    let start = Instant::now();
    loop {
        if let Some(status) = child.try_wait().expect("it is ours") {
            return status.code();
        }
        if start.elapsed() > within {
            let _ = child.kill();
            let _ = child.wait();
            panic!("it went on for {within:?} after the signal");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_long_build_stops_and_leaves_nothing() {
    for name in ["-INT", "-TERM"] {
        let folder = Folder::new();
        folder.small_arena("old.adj");
        let old = std::fs::read(folder.file("old.adj")).expect("it was built");
        let mut child = start(&folder, "build phantom:noise --dims 1024x1024x4096 -o old.adj --quiet");
        std::thread::sleep(Duration::from_millis(400));
        signal(&child, name);
        assert_eq!(ended(&mut child, Duration::from_secs(10)), Some(2));
        assert_eq!(folder.names(), ["old.adj"]);
        assert!(std::fs::read(folder.file("old.adj")).expect("it is there") == old);
    }
}

#[test]
fn a_build_that_is_stopped_while_it_writes_leaves_nothing() {
    let mut stopped = 0;
    for signals in [1, 2, 2] {
        let folder = Folder::new();
        // 2 million voxels in three lanes: 25 MB to write.
        let mut child = start(&folder, "build phantom:constant --dims 128x128x128 -o out.adj --quiet");
        while !folder.names().iter().any(|name| name.starts_with(".adj-"))
            && child.try_wait().expect("it is ours").is_none()
        {
            std::thread::sleep(Duration::from_micros(200));
        }
        for _ in 0..signals {
            // It may have ended meanwhile.
            let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).stderr(Stdio::null()).status();
        }
        match ended(&mut child, Duration::from_secs(10)) {
            Some(0) => {
                assert_eq!(folder.names(), ["out.adj"]);
                folder.adj("verify out.adj").done();
            }
            code => {
                assert!(matches!(code, Some(2 | 130)), "{code:?}");
                assert!(folder.names().iter().all(|name| name == "out.adj"), "{:?}", folder.names());
                stopped += 1;
            }
        }
    }
    if stopped == 0 {
        say("SKIPPED: the disk was faster than the signal; no write was stopped");
    }
}

#[test]
fn a_trim_in_place_that_is_stopped_leaves_a_whole_file() {
    let folder = Folder::new();
    folder.adj("build phantom:constant --dims 96x96x96 -o a.adj").done();
    for wait in [0, 5, 20, 60, 120, 250] {
        let mut child = start(&folder, "trim a.adj -o a.adj --order hilbert --quiet");
        std::thread::sleep(Duration::from_millis(wait));
        // It may have ended meanwhile.
        let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).stderr(Stdio::null()).status();
        let code = ended(&mut child, Duration::from_secs(20));
        // Before it listens the signal ends it, and there is no code.
        assert!(matches!(code, Some(0 | 2) | None), "{code:?} after {wait} ms");
        assert_eq!(folder.names(), ["a.adj"], "after {wait} ms");
        folder.adj("verify a.adj").done();
    }
}

#[test]
fn asked_twice_it_ends_even_where_it_waits() {
    let folder = Folder::new();
    // Nobody reads the pipe, so writing more than it holds waits for ever.
    let mut child = program()
        .current_dir(folder.path())
        .args("build phantom:constant --dims 64x64x64 -o /dev/stdout --quiet".split(' '))
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program was built");
    std::thread::sleep(Duration::from_millis(500));
    signal(&child, "-INT");
    std::thread::sleep(Duration::from_millis(100));
    assert!(child.try_wait().expect("it is ours").is_none(), "it waits");
    signal(&child, "-INT");
    assert_eq!(ended(&mut child, Duration::from_secs(5)), Some(130));
    assert!(folder.names().is_empty());
}

/// They went on to their end.
#[test]
fn checks_and_comparisons_end_at_once() {
    let folder = Folder::new();
    folder.adj("build phantom:noise --dims 96x96x96 -o n.adj --quiet").done();
    folder.adj("render n.adj -o a.png --size 1600x1600 --renderer cpu --quality draft -q").done();
    // Some seconds of work.
    let verify = format!("verify{}", " n.adj".repeat(20_000));
    for line in [verify.as_str(), "compare a.png a.png --diff d.png --json d.json"] {
        let mut child = start(&folder, line);
        std::thread::sleep(Duration::from_millis(200));
        assert!(child.try_wait().expect("it is ours").is_none(), "it works");
        // Shells let background work ignore SIGINT, and what is not caught stays ignored.
        signal(&child, "-TERM");
        // The signal ends it, and there is no code.
        assert_eq!(ended(&mut child, Duration::from_secs(2)), None);
        assert_eq!(folder.names(), ["a.png", "n.adj"]);
    }
}

/// It said that nothing was written.
#[test]
fn a_demo_that_is_stopped_while_it_draws_says_what_is_there() {
    let folder = Folder::new();
    let mut demo = program();
    demo.current_dir(folder.path()).arg("demo").stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = demo.spawn().expect("the program was built");
    while !folder.file("adj-demo.adj").exists() && child.try_wait().expect("it is ours").is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).stderr(Stdio::null()).status();
    let code = ended(&mut child, Duration::from_secs(10));
    let mut said = String::new();
    std::io::Read::read_to_string(&mut child.stderr.take().expect("piped"), &mut said).expect("text");
    match code {
        Some(2) if said.contains("nothing was written") => say("SKIPPED: the demo was stopped before it drew"),
        Some(2) => assert_eq!(said, "adj: stopped; ./adj-demo.adj is there, without a picture\n"),
        code => assert_eq!(code, Some(0), "{said}"),
    }
}

/// One frame was drawn to its end, for minutes.
#[test]
fn a_picture_that_takes_long_stops_and_leaves_nothing() {
    let folder = Folder::new();
    folder.adj("build phantom:noise --dims 128x128x128 --range 0.. -o n.adj --quiet").done();
    for mode in ["xray --quality reference", "maximum"] {
        let line = format!("render n.adj --mode {mode} --renderer cpu --perspective 50 --size 6000x6000 -o a.png");
        let mut child = start(&folder, &line);
        std::thread::sleep(Duration::from_millis(800));
        assert!(child.try_wait().expect("it is ours").is_none(), "it draws");
        signal(&child, "-INT");
        assert_eq!(ended(&mut child, Duration::from_secs(10)), Some(2));
        assert_eq!(folder.names(), ["n.adj"]);
    }
}

#[test]
fn a_turntable_that_is_stopped_says_which_frames_are_written() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 96x96x96 -o g.adj --quiet").done();
    for kind in ["png", "exr"] {
        let mut child = program()
            .current_dir(folder.path())
            .args(format!("render g.adj -o {kind}.{kind} --frames 2000 --size 300x300 --quiet").split_whitespace())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program was built");
        let start = Instant::now();
        while !folder.file(format!("{kind}-0002.{kind}")).exists() {
            assert!(start.elapsed() < Duration::from_secs(60));
            std::thread::sleep(Duration::from_millis(1));
        }
        signal(&child, "-INT");
        assert_eq!(ended(&mut child, Duration::from_secs(10)), Some(2));
        let mut said = String::new();
        std::io::Read::read_to_string(&mut child.stderr.take().expect("piped"), &mut said).expect("text");
        let frames = folder.names().iter().filter(|name| name.starts_with(kind)).count();
        let last = format!("{kind}-{:04}.{kind}", frames - 1);
        let want = format!("adj: stopped; {frames} of 2000 frames are written: {kind}-0000.{kind} to {last}\n");
        assert_eq!(said, want);
        assert!(folder.names().iter().all(|name| !name.starts_with(".adj-")));
    }
}
