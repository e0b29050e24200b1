//! `adj brick`: what its steps say of samples and codes, and which volumes and bricks they refuse.
//!
//! Cannot catch: other bytes than one build has (tests/cli/collection.rs does).

use super::harness::{Folder, Runs as _};

/// Plans two slabs of `volume`, scans them, and agrees; returns what agree says.
fn agree(folder: &Folder, volume: &str, dims: &str) -> super::harness::Ran {
    folder.adj(&format!("brick plan {volume} {dims} --range 1.. --slab 4 -o plan.json")).done();
    let mut plan = "plan.json".to_owned();
    loop {
        for brick in 0..2 {
            folder.adj(&format!("brick scan {plan} {brick} {volume} {dims} -o found-{brick}.json")).done();
        }
        let agreed = folder.adj(&format!("brick agree {plan} found-0.json found-1.json -o agreed-{plan}"));
        plan = format!("agreed-{plan}");
        if agreed.code != Some(1) {
            std::fs::rename(folder.file(&plan), folder.file("agreed.json")).expect("it was written");
            return agreed;
        }
    }
}

/// Writes 8 slices of 32x32 samples: in the first four `counts[0]` different values, in the others `counts[1]` more.
fn values_in_bricks(folder: &Folder, counts: [u16; 2]) {
    let samples = (0..8192u16).map(|i| {
        let [first, other] = counts;
        // Squares, as the multiples of a step would be stored exactly.
        let root = 20 + if i < 4096 { i % first } else { first + i % other };
        u32::from(root).pow(2) % 65_521
    });
    let bytes: Vec<u8> = samples.flat_map(|sample| u16::try_from(sample).expect("16 bits").to_le_bytes()).collect();
    folder.write("v.raw", &bytes);
}

#[test]
fn few_values_in_one_brick_are_not_taken_for_labels_of_the_whole() {
    let folder = Folder::new();
    let dims = "--dims 32x32x8 --type u16";
    // A brick with few values beside one with many; few in each, but many in all; few in all.
    for (counts, labels) in [([200, 2000], None), ([180, 180], None), ([40, 60], Some(100))] {
        values_in_bricks(&folder, counts);
        let built = folder.adj(&format!("build v.raw {dims} --range 1.. -o v.adj"));
        let agreed = agree(&folder, "v.raw", dims);
        let want = labels.map(|count| format!("only {count} different values"));
        assert!(want.is_none_or(|want| built.stderr.contains(&want)), "{}", built.stderr);
        assert_eq!(agreed.stderr, built.stderr, "{counts:?}");
        let rounding = built.stdout.lines().find(|line| line.contains("rounded by at most"));
        assert!(rounding.is_some_and(|line| agreed.stdout.contains(line)), "{}", agreed.stdout);
        assert_eq!(agreed.code, Some(0));
    }
}

#[test]
fn a_volume_that_is_not_the_plans_is_refused() {
    let folder = Folder::new();
    let (volume, dims) = ("phantom:gyroid", "--dims 24x20x8");
    agree(&folder, volume, dims).done();
    for (step, plan) in [("scan", "plan.json"), ("build", "agreed.json")] {
        let step = |line: &str| folder.adj(&format!("brick {step} {plan} 1 {line} -o out"));
        step(&format!("{volume} {dims} --spacing 1x1x2")).refused(&["phantom:gyroid", "spacing", "plan"]);
        step(&format!("{volume} {dims} --flip x")).refused(&["phantom:gyroid", "plan"]);
        assert!(!folder.file("out").exists());
    }
    let other = "phantom:shells --dims 24x20x8";
    folder.adj(&format!("brick build agreed.json 1 {other} -o out")).refused(&["brick 1", "visible voxels", "scan"]);
    assert!(!folder.file("out").exists());
    folder.adj(&format!("brick build agreed.json 1 {volume} {dims} -o out")).done();
}

#[test]
fn a_damaged_brick_is_named_when_a_picture_fails() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 32x32x16 --range 60.. -q -o a.adj").done();
    folder.adj("split a.adj -o a.adjs --slab 8").done();
    let brick = "a.adjs/brick-0-00008-00000-00000.adj";
    let sound = std::fs::read(folder.file(brick)).expect("it is there");
    let mut failures = Vec::new();
    for part in 1..40 {
        let mut damaged = sound.clone();
        let start = damaged.len() * part / 40;
        damaged[start..][..16].fill(0xff);
        std::fs::write(folder.file(brick), damaged).expect("it can be written");
        let drawn = folder.adj("render a.adjs -o a.png --size 10x10 --renderer cpu -q");
        if drawn.code != Some(0) {
            assert!(drawn.code == Some(2) && drawn.stdout.is_empty(), "{}", drawn.stderr);
            for part in [&brick[7..], "1 of 2 bricks cannot be used", "--partial"] {
                assert!(drawn.stderr.contains(part), "{part}: {}", drawn.stderr);
            }
            failures.push(drawn.stderr);
        }
    }
    // Of voxels that are lost there are fewer than the joined file's header says, in which no brick is named.
    assert!(failures.iter().any(|failure| failure.contains("steps of lane x")), "{failures:?}");
}
