//! Levels of detail in pictures: which are drawn, what is said of them, and what is refused.

use serde_json::{Value, json};

use super::harness::{Folder, Runs as _, written_json};

/// A folder with `plain.adj`, and with `a.adj`, which has two levels beside it.
fn waves() -> Folder {
    let folder = Folder::new();
    folder.adj("build phantom:marschner-lobb --dims 96x96x96 -o plain.adj").done();
    folder.adj("trim plain.adj -o a.adj --levels 2").done();
    folder
}

/// Draws a picture; what is printed, and the statistics.
fn drawn(folder: &Folder, line: &str) -> (String, Value) {
    let told = folder.adj(&format!("render {line} --renderer cpu -o p.png --stats s.json")).done();
    (told, written_json(&folder.file("s.json")))
}

#[test]
fn a_level_is_drawn_and_named() {
    let folder = waves();
    let (told, plain) = drawn(&folder, "plain.adj --size 200x200");
    assert!(!told.contains("level"), "{told}");
    assert_eq!(plain["levels"], json!([0]));
    let (told, voxels) = drawn(&folder, "a.adj --size 200x200 --level 0");
    assert!(!told.contains("level"), "{told}");
    assert_eq!((&voxels["levels"], &voxels["image_sha256"]), (&json!([0]), &plain["image_sha256"]));
    let mut fewest = voxels["splats_drawn"].as_u64().expect("a number");
    for level in [1, 2] {
        let (told, stats) = drawn(&folder, &format!("a.adj --size 200x200 --level {level}"));
        assert!(told.contains(&format!(" splats of level {level}, ")), "{told}");
        assert_eq!(stats["levels"], json!([level]));
        let splats = stats["splats_drawn"].as_u64().expect("a number");
        assert!(splats > 0 && 2 * splats < fewest, "level {level}: {splats} after {fewest}");
        fewest = splats;
    }
}

#[test]
fn the_view_and_the_quality_choose_the_level() {
    let folder = waves();
    let levels = |line: &str| drawn(&folder, &format!("a.adj {line}")).1["levels"].clone();
    assert_eq!(levels("--size 200x200"), json!([0]));
    assert_eq!(levels("--size 12x12"), levels("--size 12x12 --level auto"));
    assert_eq!(levels("--size 12x12"), json!([1]));
    assert_eq!(levels("--size 12x12 --quality draft"), json!([2]));
    assert_eq!(levels("--size 12x12 --quality high"), json!([0]));
    assert_eq!(levels("--size 12x12 --mode maximum"), json!([0]));
    // Levels fit the opacities of the build.
    assert_eq!(levels("--size 12x12 --range 200.."), json!([0]));
    folder.adj("split a.adj -o parts.adjs --slab 32").done();
    let (_, parts) = drawn(&folder, "parts.adjs --bricks --size 12x12 --range 200..");
    assert_eq!(parts["levels"], json!([0]));
    // Shells are thin: a level has one colour of the two sides of a wall, which is enough for a draft.
    folder.adj("build phantom:shells --dims 96x96x96 --levels 2 -o thin.adj").done();
    for (quality, level) in [("standard", 0), ("draft", 2)] {
        let (_, thin) = drawn(&folder, &format!("thin.adj --size 12x12 --quality {quality}"));
        assert_eq!(thin["levels"], json!([level]), "{quality}");
    }
    let (told, stats) = drawn(&folder, "a.adj --size 60x60 --perspective 100 --quality draft");
    assert_eq!(stats["levels"], json!([0, 1]));
    assert!(told.contains(" splats of levels 0 and 1, "), "{told}");
}

#[test]
fn levels_that_are_not_there_are_refused_with_those_that_are() {
    let folder = waves();
    let refused = |line: &str, parts: &[&str]| {
        folder.adj(&format!("render {line} -o p.png")).refused(parts);
        assert!(!folder.file("p.png").exists(), "{line}");
    };
    refused("a.adj --level 3", &["--level", "is 3", "a.adj has levels 0 to 2"]);
    refused("plain.adj --level 1", &["--level", "is 1", "level 0 alone", "adj trim --levels"]);
    refused("a.adj --level=-1", &["--level"]);
    refused("a.adj --level coarse", &["--level", "auto"]);
    refused("a.adj --level 1 --max-error 0.1", &["--level", "--max-error"]);
    refused("a.adj --level 1 --renderer reference", &["reference needs the volume"]);
    folder.adj("split plain.adj -o b.adjs --brick 48x96x96").done();
    refused("b.adjs --bricks --level 1", &["--level", "level 0 alone"]);
    refused("b.adjs --level 1", &["--level", "level 0 alone"]);
    folder.adj("render a.adj -o p.png --size 40x40 --level 0 --max-error 0.5").done();
}

#[test]
fn the_dial_draws_a_level_where_the_bound_allows() {
    let folder = waves();
    let (told, chosen) = drawn(&folder, "a.adj --size 12x12 --max-error 0.9");
    assert_eq!(chosen["levels"], json!([2]), "{told}");
    let ran = folder.adj("render a.adj --size 12x12 --max-error 0.9 --renderer cpu -o p.png");
    assert!(ran.stderr.contains(" --level 2"), "{}", ran.stderr);
    // A tight bound, and a picture that is drawn in bounded memory, are for the voxels.
    for line in ["--max-error 0.001", "--max-error 0.9 --level 0", "--max-error 0.9 --memory 256MiB"] {
        assert_eq!(drawn(&folder, &format!("a.adj --size 12x12 {line}")).1["levels"], json!([0]), "{line}");
    }
}

#[test]
fn a_picture_that_does_not_fit_into_the_memory_is_drawn_from_a_level_that_does() {
    let folder = Folder::new();
    // Lanes that are missing have to be made, of 4 million voxels.
    folder.adj("build phantom:constant --dims 160x160x160 --range 1.. --lanes x --levels 2 -o a.adj").done();
    let line =
        |more: &str| format!("render a.adj -o p.png --size 64x64 --azimuth 90 --memory 64MiB --renderer cpu {more}");
    folder.adj(&line("")).refused(&["--memory", "lane along"]);
    let ran = folder.adj(&line("--fit --stats s.json"));
    assert_eq!(ran.stderr, "adj: note: level 1 is drawn, the finest that fits into 64.00 MiB\n");
    assert!(ran.done().contains("of level 1, "));
    let fitted = std::fs::read(folder.file("p.png")).expect("it was drawn");
    folder.adj("render a.adj -o q.png --size 64x64 --azimuth 90 --level 1 --renderer cpu").done();
    assert!(std::fs::read(folder.file("q.png")).expect("it was drawn") == fitted);
    let stats = written_json(&folder.file("s.json"));
    if let Some(peak) = stats["peak_rss_bytes"].as_u64() {
        assert!(peak < 64 << 20, "it took {peak} bytes");
    }
    // What fits is drawn as without the flag; where nothing fits, the error is that without the flag.
    let ran = folder.adj("render a.adj -o p.png --size 64x64 --memory 1GiB --renderer cpu --level 0 --fit");
    assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""));
    let huge = "render a.adj -o p.png --size 8000x8000 --memory 64MiB --renderer cpu";
    let told = |line: &str| -> (String, u64) {
        let line = folder.adj(line).refused(&["--memory", "8000x8000"]);
        let enough = line.split(' ').find_map(|word| word.strip_suffix("MiB;")).expect("how much is enough");
        (line.replace(enough, ""), enough.parse().expect("a whole number"))
    };
    let (with, without) = (told(&format!("{huge} --fit")), told(huge));
    assert_eq!(with.0, without.0);
    // How much is enough depends on what a process took before, which differs between runs.
    assert!(with.1.abs_diff(without.1) <= 2, "{} and {} MiB", with.1, without.1);
    folder.adj("render a.adj -o p.png --fit").refused(&["--fit", "--memory", "--vram"]);
    folder.adj("render a.adj -o p.png --fit --memory 64MiB --max-error 0.1").refused(&["--fit", "--max-error"]);
}

/// What parts of several levels take was asked for, though one level was drawn.
#[test]
fn levels_in_a_file_make_no_picture_need_more_memory() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 96x96x96 --range 100.. --levels 2 -o a.adj").done();
    for view in ["--size 800x800", "--size 600x600 --perspective 30 --quality high", "--size 200x200 --perspective 60"]
    {
        folder.adj(&format!("render a.adj -o p.png {view} --memory 64MiB --renderer cpu")).done();
    }
}

#[test]
fn bricks_are_built_with_levels_and_drawn_from_them() {
    let folder = Folder::new();
    let volume = "phantom:shells --dims 96x96x96";
    folder.adj(&format!("build {volume} --range 100.. --levels 2 -o a.adj")).done();
    let plan = |cuts: &str| format!("brick plan {volume} --range 100.. {cuts} -o plan.json");
    folder.adj(&plan("--slab 30 --levels 2")).refused(&[
        "levels of detail",
        "are 2",
        "can hold 1",
        "multiple of 4x4x4",
    ]);
    folder.adj(&plan("--slab 2 --levels 16")).refused(&["--levels", "15"]);
    assert!(!folder.file("plan.json").exists());
    let told = folder.adj(&plan("--slab 25 --levels auto")).done();
    assert!(told.contains("without levels of detail: none is of use, or bricks would divide its blocks"), "{told}");
    let told = folder.adj(&plan("--slab 24 --levels 2 --preview 4")).done();
    assert!(told.contains("4 bricks to scan, 4 to build, with 2 levels of detail"), "{told}");
    for brick in 0..4 {
        folder.adj(&format!("brick scan plan.json {brick} {volume} -o found-{brick}.json")).done();
    }
    folder.adj("brick agree plan.json found-0.json found-1.json found-2.json found-3.json -o agreed.json").done();
    for brick in 0..4 {
        folder.adj(&format!("brick build agreed.json {brick} {volume} -o a.adjs")).done();
    }
    folder.adj("brick finish agreed.json a.adjs").done();
    folder.adj("verify a.adjs").done();
    folder.adj("join a.adjs -o joined.adj").done();
    let bytes = |name: &str| std::fs::read(folder.file(name)).expect("it was written");
    assert!(bytes("joined.adj") == bytes("a.adj"), "levels of bricks are those of one build");

    let info = folder.adj("info a.adjs --json").json();
    let of_file = folder.adj("info a.adj --json").json();
    for level in 0..2 {
        for member in ["level", "dims", "visible_voxels"] {
            assert_eq!(info["levels"][level][member], of_file["levels"][level][member]);
        }
    }
    assert_eq!(info["preview"]["level"], 2);
    let preview = folder.adj("info a.adjs/preview.adj --json").json();
    assert_eq!((&preview["dims"], &preview["channels"]["coverage_bits"]), (&json!([24, 24, 24]), &json!(16)));
    folder.adj("verify a.adjs/preview.adj").done();

    // Joined, a collection is drawn as the file is; brick by brick, from the same level. Of limits it knows those of its bricks, which
    // are lower for drafts here.
    for (view, is_same) in
        [("--size 12x12", true), ("--size 20x20 --quality draft", false), ("--size 200x200 --level 1", true)]
    {
        let (_, whole) = drawn(&folder, &format!("a.adj {view}"));
        let (_, bricks) = drawn(&folder, &format!("a.adjs --bricks {view}"));
        assert_eq!(bricks["levels"] == whole["levels"], is_same, "{view}");
        for how in ["", "--memory 128MiB"] {
            let (_, stats) = drawn(&folder, &format!("a.adjs {how} {view}"));
            assert_eq!(stats["levels"], bricks["levels"], "{view} {how}");
            assert_eq!(stats["image_sha256"] == whole["image_sha256"], is_same, "{view} {how}");
        }
    }
    // Without a brick too: levels are those of the bricks, and not made again without the brick's neighbours.
    let missing =
        std::fs::read_dir(folder.file("a.adjs")).expect("a folder").map(|entry| entry.expect("a file").path());
    let missing = missing.filter(|path| path.to_string_lossy().contains("brick-")).min().expect("a brick");
    std::fs::rename(&missing, folder.file("away.adj")).expect("it is ours");
    for view in ["--size 24x24 --quality draft", "--size 200x200 --level 1", "--size 60x60 --perspective 100"] {
        let (_, joined) = drawn(&folder, &format!("a.adjs --partial {view}"));
        let (_, within) = drawn(&folder, &format!("a.adjs --partial --memory 128MiB {view}"));
        assert_eq!(joined["levels"], within["levels"], "{view}");
        assert!(joined["image_sha256"] == within["image_sha256"], "{view}");
    }
    std::fs::rename(folder.file("away.adj"), &missing).expect("it is ours");
    let (told, stats) = drawn(&folder, "a.adjs --bricks --size 60x60 --perspective 100 --quality draft");
    assert_eq!(stats["levels"], json!([0, 1]), "{told}");
    folder.adj("render a.adjs --bricks --level 3 -o p.png").refused(&["--level", "is 3", "levels 0 to 2"]);
    folder.adj("split joined.adj -o odd.adjs --slab 31").done();
    folder.adj("render odd.adjs --bricks --level 1 -o p.png").refused(&["--level", "level 0 alone", "adj brick plan"]);
}
