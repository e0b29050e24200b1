//! `adj split` and `adj join`, and what other commands say and draw of collections.
//!
//! Cannot catch: a brick with other voxels than its box has (tests/core/collection.rs does).

use super::harness::{Folder, Runs as _};

/// A file of a phantom, and a collection of it in eight bricks.
fn split(folder: &Folder) {
    folder.adj("build phantom:gyroid --dims 24x20x16 -q -o a.adj").done();
    let told = folder.adj("split a.adj -o a.adjs --brick 12x10x8 --json").json();
    assert_eq!((&told["bricks"], &told["files"]), (&8.into(), &8.into()));
}

fn bytes(folder: &Folder, name: &str) -> Vec<u8> {
    std::fs::read(folder.file(name)).expect("it is there")
}

const BRICK: &str = "a.adjs/brick-0-00008-00010-00012.adj";

#[test]
fn a_split_file_joins_to_its_bytes_and_every_command_takes_it() {
    let folder = Folder::new();
    split(&folder);
    folder.adj("join a.adjs -o b.adj").done();
    assert!(bytes(&folder, "a.adj") == bytes(&folder, "b.adj"));
    folder.adj("split a.adj -o slabs.adjs --slab 5").done();
    assert_eq!(folder.adj("join slabs.adjs -o c.adj --memory 64MiB --threads 1 --json").json()["bricks"], 4);
    assert!(bytes(&folder, "a.adj") == bytes(&folder, "c.adj"));
    assert!(folder.adj("verify a.adjs a.adj").done().contains("a.adjs: sound (8 bricks"));
    let [one, other] = ["info a.adj --json", "info a.adjs --json"].map(|line| folder.adj(line).json());
    for name in ["dims", "spacing", "origin", "direction", "visible_voxels", "visible_share", "channels", "description"]
    {
        assert_eq!(one[name], other[name], "{name}");
    }
    assert_eq!(other["bricks"].as_array().map(Vec::len), Some(8));
    assert!(folder.adj("info a.adjs").done().contains("low 12 10 8, size 12 10 8"));
}

#[test]
fn a_picture_of_a_collection_is_that_of_the_file() {
    let folder = Folder::new();
    split(&folder);
    let view = "--size 60x50 --azimuth 30 --elevation 20 --renderer cpu";
    folder.adj(&format!("render a.adj -o a.exr {view}")).done();
    for flags in ["", "--memory 64MiB", "--mode composite --threads 3"] {
        folder.adj(&format!("render a.adjs -o b.exr {view} {flags}")).done();
        assert!(bytes(&folder, "a.exr") == bytes(&folder, "b.exr"), "{flags}");
    }
    folder.adj(&format!("render a.adjs -o bricks.exr --bricks --stats s.json {view}")).done();
    let psnr = folder.adj("compare a.exr bricks.exr --json").json()["psnr"].as_f64().expect("they differ");
    // So small a volume is a sixth border between bricks.
    assert!(psnr > 25.0, "{psnr}");
    folder.adj("render a.adjs -o turn.apng --bricks --size 30x30 --frames 3 --crop 5..20,..,3..").done();
    folder.adj(&format!("render a.adjs -o m.png --bricks {view} --mode maximum")).refused(&["join them first"]);
    folder.adj(&format!("render a.adjs -o m.png --bricks {view} --mode xray")).refused(&["exposure"]);
    folder.adj(&format!("render a.adjs -o m.png --bricks --memory 1GiB {view}")).refused(&["--memory", "--bricks"]);
    folder.adj("render a.adjs -o m.png --bricks --renderer gpu").refused(&["--renderer", "--bricks"]);
    folder.adj("render a.adj -o m.png --bricks").refused(&["--bricks", "collections"]);
    folder.adj("render a.adjs -o m.png --dims 3x3x3").refused(&["--dims"]);
}

#[test]
fn bricks_that_cannot_be_used_are_named_and_left_out_on_demand() {
    let folder = Folder::new();
    split(&folder);
    let whole = bytes(&folder, BRICK);
    std::fs::remove_file(folder.file(BRICK)).expect("it is there");
    let cut = "a.adjs/brick-0-00000-00010-00000.adj";
    std::fs::write(folder.file(cut), &bytes(&folder, cut)[..300]).expect("it can be written");
    for line in ["join a.adjs -o b.adj", "render a.adjs -o a.png", "render a.adjs -o a.png --bricks"] {
        let ran = folder.adj(line);
        assert_eq!(ran.code, Some(2), "{line}");
        assert!(ran.stderr.lines().count() == 3 && ran.stdout.is_empty(), "{}", ran.stderr);
        for part in [&BRICK[7..], "is missing", &cut[7..], "2 of 8 bricks cannot be used", "--partial"] {
            assert!(ran.stderr.contains(part), "{part}: {}", ran.stderr);
        }
    }
    assert!(!folder.names().iter().any(|name| name == "b.adj" || name == "a.png"));
    let drawn = folder.adj("render a.adjs -o a.png --size 40x40 --partial --renderer cpu");
    assert!(drawn.code == Some(0) && drawn.stderr.contains("2 of 8 bricks are left out"), "{}", drawn.stderr);
    assert_eq!(folder.adj("join a.adjs -o b.adj --partial --json").json()["bricks_left_out"], 2);
    let checked = folder.adj("verify a.adjs");
    assert_eq!(checked.code, Some(1));
    assert!(checked.stdout.contains("is missing") && checked.stdout.contains("2 of 8"), "{}", checked.stdout);
    assert_eq!(folder.adj("verify a.adjs --json").code, Some(1));
    assert_eq!(folder.adj("info a.adjs --json").json()["faults"].as_array().map(Vec::len), Some(2));

    // A flipped bit is found by the check that comes before a join.
    let folder = Folder::new();
    split(&folder);
    let mut flipped = whole;
    let at = flipped.len() - 300;
    flipped[at] ^= 1;
    std::fs::write(folder.file(BRICK), flipped).expect("it can be written");
    folder.adj("join a.adjs -o b.adj").refused(&[&BRICK[7..], "R"]);
    assert!(folder.adj("verify a.adjs").stdout.contains("1 of 8 bricks"));
}

#[test]
fn what_is_no_collection_is_refused_and_nothing_is_replaced() {
    let folder = Folder::new();
    split(&folder);
    folder.adj("split a.adj -o a.adjs --slab 4").refused(&["a.adjs"]);
    folder.adj("split a.adj -o b.adjs --slab 0").refused(&["--slab"]);
    folder.adj("split a.adj -o b.adjs --brick 3x3").refused(&["--brick", "three whole numbers"]);
    folder.adj("split a.adj -o b.adjs").refused(&["--slab"]);
    folder.adj("split a.adjs -o b.adjs --slab 4").refused(&["is a folder"]);
    folder.adj("split no.adj -o b.adjs --slab 4").refused(&["cannot open"]);
    folder.adj("join a.adj -o b.adj").refused(&["is a file"]);
    folder.adj("join no.adjs -o b.adj").refused(&["cannot open"]);
    folder.write("text", b"hello");
    folder.adj("join a.adjs -o text").refused(&["is no .adj file"]);
    folder.adj("trim a.adjs -o b.adj --range 3..").refused(&["adj join"]);
    folder.adj("export a.adjs -o b.nrrd").refused(&["adj join"]);
    std::fs::create_dir(folder.file("empty.adjs")).expect("it can be made");
    folder.adj("join empty.adjs -o b.adj").refused(&["collection.json"]);
    std::fs::write(folder.file("empty.adjs/collection.json"), "{\"adjs\": 1}").expect("it can be written");
    for line in ["join empty.adjs -o b.adj", "info empty.adjs", "verify empty.adjs", "render empty.adjs -o a.png"] {
        folder.adj(line).refused(&["collection.json", "missing field"]);
    }
    assert_eq!(folder.names(), ["a.adj", "a.adjs", "empty.adjs", "text"]);
}
