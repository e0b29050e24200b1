//! Budgets of memory: kept by a build, refused where they cannot do, and without influence on what is built.

use adjsplat_tests::at_full;

use super::harness::{Folder, Runs as _};

/// A volume whose visible voxels, 60 MB of them, are near a budget of 64 MiB, and in memory with what is made of them far
/// beyond it.
const WIDE: &str = "build phantom:noise --dims 1024x1024x300 --range 60.. --value-bits 16 --normals 16 --type u16";

#[test]
fn a_build_stays_within_its_budget_and_gives_the_same_bytes_as_without() {
    let folder = Folder::new();
    let free = folder.adj(&format!("{WIDE} -o free.adj --memory 2GiB --threads 3 --json")).json();
    let expected = std::fs::read(folder.file("free.adj")).expect("it was built");
    for &threads in at_full(&[1, 2, 5][..], &[2]) {
        let line = format!("{WIDE} -o small.adj --memory 64MiB --threads {threads} --json");
        let small = folder.adj(&line).json();
        assert!(std::fs::read(folder.file("small.adj")).expect("it was built") == expected, "{threads} threads");
        assert_eq!(small["visible_voxels"], free["visible_voxels"]);
        if let Some(peak) = small["peak_rss_bytes"].as_u64() {
            // With the program's own pages, which the system may drop.
            assert!(peak < 64 << 20, "{threads} threads took {peak} bytes");
        }
    }
}

#[test]
fn a_budget_that_cannot_do_says_what_would() {
    let folder = Folder::new();
    let build = "build phantom:constant --dims 8000x8000x2 --range 1.. -o wide.adj --threads 2 --memory";
    let line = folder.adj(&format!("{build} 64MiB")).refused(&["8000 x 8000 x 2 samples", "--memory", "would do"]);
    assert!(!folder.file("wide.adj").exists());
    let enough = line.split("--memory ").nth(1).and_then(|rest| rest.split(' ').next()).expect("a size");
    let built = folder.adj(&format!("{build} {enough} --lanes x --json")).json();
    assert_eq!(built["visible_voxels"], 128_000_000);
    if let Some(peak) = built["peak_rss_bytes"].as_u64() {
        let mebibytes: u64 = enough.trim_end_matches("MiB").parse().expect("whole mebibytes");
        assert!(peak <= mebibytes << 20, "{peak} bytes, with {enough}");
    }
}

#[test]
fn sizes_that_are_none() {
    let folder = Folder::new();
    let build = "build phantom:gyroid --dims 16x16x16 --tf gyroid -o g.adj";
    folder.adj(&format!("{build} --memory 12")).refused(&["--memory", "at least 64MiB"]);
    folder.adj(&format!("{build} --memory lots")).refused(&["--memory", "64MiB"]);
    folder.adj(&format!("{build} --threads 0")).refused(&["--threads", "1 to 1024"]);
}

#[test]
fn the_need_is_said_before_work_starts() {
    let folder = Folder::new();
    let ran = folder.adj("build phantom:gyroid --dims 64x64x64 --tf gyroid -o g.adj --memory 64MiB");
    assert!(ran.stderr.contains("of memory"), "{}", ran.stderr);
    ran.done();
}
