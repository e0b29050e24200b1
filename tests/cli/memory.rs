//! Rendering and verifying within `--memory`: the same pictures, less memory, and what cannot be done is said.

use adjsplat_tests::{at_full, say};

use super::harness::{Folder, Runs as _, program};

const LEAST: u64 = 64 << 20;

/// Nearly transparent, so that every voxel of it is drawn.
const THIN: &str = r##"{"kind":"points","points":[{"value":0,"colour":"#804020","opacity":0},
    {"value":100,"colour":"#804020","opacity":0.001},{"value":255,"colour":"#ffeedd","opacity":0.004}]}"##;

/// Peak memory and checksum of the picture, by the program's own statistics.
fn rendered(folder: &Folder, line: &str) -> (Option<u64>, String) {
    folder.adj(&format!("render {line} -o out.png --quality draft --size 200x200 --stats stats.json")).done();
    let stats = std::fs::read(folder.file("stats.json")).expect("it was written");
    let stats: serde_json::Value = serde_json::from_slice(&stats).expect("JSON");
    (stats["peak_rss_bytes"].as_u64(), stats["image_sha256"].as_str().expect("a checksum").to_owned())
}

#[test]
fn a_file_larger_than_the_memory_gives_the_same_picture_within_it() {
    let folder = Folder::new();
    folder.write("thin.json", THIN.as_bytes());
    folder.adj("build phantom:gyroid --dims 304x304x304 --tf thin.json -o big.adj --quiet").done();
    let bytes = std::fs::metadata(folder.file("big.adj")).expect("it was built").len();
    assert!(bytes > 3 * LEAST, "{bytes} bytes: a lane would fit");
    for (index, view) in ["--azimuth 80", "--perspective 50 --azimuth 200"].into_iter().enumerate() {
        let (free, want) = rendered(&folder, &format!("big.adj {view}"));
        for &threads in at_full(&[1, 2][..], &[1 + index][..]) {
            let (peak, got) = rendered(&folder, &format!("big.adj {view} --memory 64MiB --threads {threads}"));
            assert_eq!(got, want, "{view}, {threads} threads");
            match (free, peak) {
                (Some(free), Some(peak)) => {
                    assert!(free > LEAST, "{view}: it would fit anyway, {free} bytes");
                    assert!(peak <= LEAST, "{view}, {threads} threads: {peak} bytes");
                }
                _ => say("SKIPPED: this system does not say how much memory a process took"),
            }
        }
    }
    assert!(folder.adj("verify big.adj --memory 64MiB").done().contains("sound"));
    // The bricks of a collection were read without a bound.
    folder.adj("split big.adj -o big.adjs --slab 152 -q").done();
    let mut verify = program();
    let mut child = verify
        .current_dir(folder.path())
        .args(["verify", "big.adjs", "--memory", "64MiB"])
        .spawn()
        .expect("it was built");
    let mut peak = None;
    while child.try_wait().expect("it is ours").is_none() {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
        peak = kilobytes.and_then(|number| number.parse::<u64>().ok()).or(peak);
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(child.wait().expect("it ended").success());
    match peak {
        Some(peak) => assert!(peak << 10 <= LEAST, "{peak} KiB"),
        None => say("SKIPPED: this system does not say how much memory a process took"),
    }
}

#[test]
fn a_volume_is_rendered_within_the_memory_too_and_leaves_nothing_beside_the_picture() {
    let folder = Folder::new();
    let line = "phantom:shells --dims 96x96x96 --quiet";
    let (_, want) = rendered(&folder, line);
    let (peak, got) = rendered(&folder, &format!("{line} --memory 64MiB --threads 2"));
    assert_eq!(got, want);
    assert!(peak.is_none_or(|peak| peak <= LEAST), "{peak:?}");
    assert_eq!(folder.names(), ["out.png", "stats.json"]);
}

#[test]
fn memory_that_is_not_enough_says_what_would_be() {
    let folder = Folder::new();
    folder.small_arena("f.adj");
    let refused = |line: &str, parts: &[&str]| folder.adj(&format!("render f.adj -o out.png {line}")).refused(parts);
    refused("--memory 63MiB", &["--memory", "64MiB"]);
    refused("--memory plenty", &["--memory", "plenty", "64MiB"]);
    let line = refused("--memory 64MiB --size 3000x3000 --threads 1", &["--memory", "3000x3000", "--size"]);
    let enough = line.split("takes ").nth(1).and_then(|rest| rest.split(' ').next()).expect("it names a size");
    let enough = enough.trim_end_matches(';');
    let told = folder.adj(&format!("render f.adj -o out.png --size 3000x3000 --threads 1 --memory {enough}"));
    told.done();
    // Threads are as many as fit; the picture is the same.
    let (_, one) = rendered(&folder, "f.adj --threads 1");
    let (_, many) = rendered(&folder, "f.adj --threads 64 --memory 64MiB");
    assert_eq!(one, many);
}

/// It was refused after the build, which takes minutes.
#[test]
fn a_picture_that_can_never_fit_is_refused_before_a_volume_is_read() {
    let folder = Folder::new();
    // So much work that a test would run into its limit.
    let line = "render phantom:noise --dims 16000x16000x16000 -o out.png --memory 100MiB --size 3000x3000";
    let told = folder.adj(line).refused(&["--memory", "a picture of 3000x3000", "smaller --size"]);
    assert!(told.contains("100.00 MiB"), "{told}");
}

#[test]
fn a_lane_that_is_not_there_is_made_only_where_there_is_room() {
    let folder = Folder::new();
    folder.write("thin.json", THIN.as_bytes());
    folder.adj("build phantom:gyroid --dims 192x192x192 --tf thin.json --lanes x -o x.adj --quiet").done();
    let along_x = rendered(&folder, "x.adj --azimuth 5 --elevation 5");
    let within = rendered(&folder, "x.adj --azimuth 5 --elevation 5 --memory 1GiB");
    assert_eq!(within.1, along_x.1);
    let mut refused = 0;
    for view in ["--azimuth 80", "--azimuth 5 --elevation 5", "--elevation 85"] {
        let ran = folder.adj(&format!("render x.adj -o out.png --memory 80MiB {view}"));
        if ran.code == Some(2) {
            ran.refused(&["--memory", "lane along", "--lanes xyz"]);
            refused += 1;
        } else {
            ran.done();
        }
    }
    assert!((1..3).contains(&refused), "{refused}: one lane serves some views and not others");
}
