//! `adj split` and `adj join`, and what other commands say and draw of collections.
//!
//! Cannot catch: a brick with other voxels than its box has (tests/core/collection.rs does).

use serde_json::Value;

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
    // Every voxel three times, in slabs across z, y and x.
    let told = folder.adj("split a.adj -o three.adjs --slab 10 --partition xyz --json").json();
    assert_eq!(
        (&told["bricks"], &told["visible_voxels"]),
        (&7.into(), &folder.adj("info a.adj --json").json()["visible_voxels"])
    );
    folder.adj("join three.adjs -o c.adj").done();
    assert!(bytes(&folder, "a.adj") == bytes(&folder, "c.adj"));
    folder.adj("split a.adj -o d.adjs --brick 9x9x9 --partition xyz").refused(&["--brick", "--partition"]);
    folder.adj("split a.adj -o d.adj --slab 5").refused(&["--output", "ends in .adj", "end it in .adjs"]);
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

/// Each brick had the colours of its own values: 18.5 dB.
#[test]
fn an_open_range_colours_bricks_as_parts_of_the_whole() {
    let folder = Folder::new();
    let ramp: Vec<u8> = (0..32u8).flat_map(|slice| vec![slice * 6 + 20; 32 * 32]).collect();
    folder.write("v.raw", &ramp);
    folder.adj("build v.raw --dims 32x32x32 --type u8 --range 30.. -q -o a.adj").done();
    folder.adj("split a.adj -o a.adjs --slab 8").done();
    let view = "--size 90x80 --azimuth 20 --elevation 5 --quality reference --renderer cpu --range 10..";
    for command in ["render a.adj -o a.exr", "render a.adjs --bricks -o b.exr"] {
        let run = folder.adj(&format!("{command} {view}"));
        assert!(run.stderr.contains("values 20..30 are visible"), "what the build left out is named: {}", run.stderr);
        run.done();
    }
    let psnr = folder.adj("compare a.exr b.exr --json").json()["psnr"].as_f64();
    // As with the stored function: slabs are seen across their cuts.
    assert!(psnr.is_some_and(|psnr| psnr > 35.0), "{psnr:?}");
}

#[test]
fn a_picture_of_a_collection_takes_no_more_memory_for_pages_of_its_bricks() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 256x256x256 --range 0.. -o a.adj --quiet").done();
    folder.adj("split a.adj -o a.adjs --brick 64x64x64 --quiet").done();
    // The joined file alone takes 64 MiB, and the bricks have 192.
    folder.adj("render a.adjs -o a.png --size 200x200 --memory 80MiB").done();
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
    let ran = folder.adj("join a.adjs -o b.adj");
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""));
    assert!(ran.stderr.contains(&BRICK[7..]) && ran.stderr.contains("1 of 8 bricks cannot be used"), "{}", ran.stderr);
    assert!(folder.adj("verify a.adjs").stdout.contains("1 of 8 bricks"));
    let joined = folder.adj("join a.adjs -o b.adj --partial --json");
    assert!(joined.stderr.contains(&BRICK[7..]), "{}", joined.stderr);
    assert_eq!(joined.json()["bricks_left_out"], 1);
    folder.adj("verify b.adj").done();
}

#[test]
fn what_cannot_be_read_does_not_keep_verify_from_the_other_files() {
    let folder = Folder::new();
    split(&folder);
    let manifest = String::from_utf8(bytes(&folder, "a.adjs/collection.json")).expect("text");
    folder.write("a.adjs/collection.json", manifest.replace("\"lanes\": 3", "\"lanes\": 4").as_bytes());
    let ran = folder.adj("verify gone.adj a.adjs a.adj");
    assert_eq!(ran.code, Some(2));
    assert!(ran.stderr.contains("gone.adj") && ran.stderr.contains("collection.json"), "{}", ran.stderr);
    assert!(ran.stdout.starts_with("a.adj: sound"), "{}", ran.stdout);
    let ran = folder.adj("verify gone.adj a.adjs a.adj --json");
    let sound = |line: &str| serde_json::from_str::<Value>(line).expect("JSON")["sound"].clone();
    assert_eq!(ran.stdout.lines().map(sound).collect::<Vec<_>>(), [Value::Null, Value::Null, Value::Bool(true)]);
}

#[test]
fn a_manifest_whose_description_no_file_may_have_is_refused() {
    let folder = Folder::new();
    split(&folder);
    let manifest = String::from_utf8(bytes(&folder, "a.adjs/collection.json")).expect("text");
    let (before, _) = manifest.split_once("\"description\": ").expect("it is the last member");
    for description in ["[1, 2]", "5", "null", "\"x\"", "{\"a\": 1e999}"] {
        folder.write("a.adjs/collection.json", format!("{before}\"description\": {description}}}").as_bytes());
        for line in ["join a.adjs -o b.adj", "verify a.adjs", "info a.adjs"] {
            folder.adj(line).refused(&["collection.json", "description", "expected a JSON object"]);
        }
        assert!(!folder.file("b.adj").exists(), "{description}");
    }
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

#[test]
fn steps_in_processes_of_their_own_give_the_bytes_of_one_build() {
    let folder = Folder::new();
    let volume = "phantom:gyroid --dims 24x20x16 --type f32";
    let chosen = "--range 90..";
    folder.adj(&format!("build {volume} {chosen} -q -o whole.adj")).done();
    let told =
        folder.adj(&format!("brick plan {volume} {chosen} --slab 5 --partition xyz --preview 2 -o plan.json")).done();
    assert!(told.contains("4 bricks to scan, 13 to build"), "{told}");
    let mut plan = "plan.json".to_owned();
    for round in 1.. {
        for brick in 0..4 {
            folder.adj(&format!("brick scan {plan} {brick} {volume} -o found-{brick}.json")).done();
        }
        let next = format!("plan-{round}.json");
        let found: Vec<String> = (0..4).map(|brick| format!("found-{brick}.json")).collect();
        let agreed = folder.adj(&format!("brick agree {plan} {} -o {next}", found.join(" ")));
        plan = next;
        if agreed.code == Some(0) {
            break;
        }
        assert!(
            agreed.code == Some(1) && agreed.stdout.contains("scan the same bricks once more"),
            "{}",
            agreed.stderr
        );
        assert!(round < 3, "scans come to an end");
    }
    for brick in (0..13).rev() {
        folder.adj(&format!("brick build {plan} {brick} {volume} -o a.adjs")).done();
    }
    folder.adj("info a.adjs").refused(&["a.adjs", "has no collection.json"]);
    assert!(folder.adj(&format!("brick finish {plan} a.adjs")).done().contains("13 bricks"));
    folder.adj(&format!("brick finish {plan} a.adjs")).done();
    folder.adj("verify a.adjs").done();
    folder.adj("join a.adjs -o joined.adj").done();
    assert!(bytes(&folder, "whole.adj") == bytes(&folder, "joined.adj"));
    assert_eq!(folder.adj("info a.adjs --json").json()["preview"]["every"], 2);
    assert_eq!(folder.adj("info a.adjs/preview.adj --json").json()["dims"], serde_json::json!([12, 10, 8]));
    folder.adj("render a.adjs --preview -o a.png --size 30x30 --renderer cpu").done();

    // A brick that is lost is built again, alone.
    std::fs::remove_file(folder.file("a.adjs/brick-1-00000-00005-00000.adj")).expect("it is there");
    let lost = folder.adj("join a.adjs -o again.adj");
    assert!(lost.code == Some(2) && lost.stderr.contains("1 of 13 bricks cannot be used"), "{}", lost.stderr);
    folder.adj(&format!("brick build {plan} 5 {volume} -o a.adjs")).done();
    folder.adj("verify a.adjs").done();
}

#[test]
fn a_step_with_wrong_input_is_refused_and_writes_nothing() {
    let folder = Folder::new();
    let volume = "phantom:gyroid --dims 24x20x16";
    folder.adj(&format!("brick plan {volume} --slab 8 -o plan.json")).done();
    folder.adj(&format!("brick scan plan.json 0 {volume} -o found-0.json")).done();
    folder.adj(&format!("brick scan plan.json 2 {volume} -o f.json")).refused(&["2 does not exist; there are 2"]);
    folder
        .adj("brick scan plan.json 1 phantom:gyroid --dims 24x20x9 -o f.json")
        .refused(&["[24, 20, 9]", "[24, 20, 16]"]);
    folder.adj(&format!("brick scan plan.json 1 {volume} --type u16 -o f.json")).refused(&["another type or scale"]);
    folder
        .adj(&format!("brick scan plan.json 1 {volume} -o plan.json"))
        .refused(&["--output", "which this call reads or writes"]);
    folder.adj(&format!("brick scan found-0.json 1 {volume} -o f.json")).refused(&[
        "found-0.json",
        "is the result of a scan, not a plan",
        "adj brick plan makes",
    ]);
    folder.write("other.json", b"{\"grid\": 1}");
    folder.adj(&format!("brick scan other.json 1 {volume} -o f.json")).refused(&[
        "other.json",
        "is no plan",
        "adj brick plan",
    ]);
    folder.adj(&format!("brick build plan.json 1 {volume} -o a.adjs")).refused(&["not agreed yet"]);
    folder.adj("brick agree plan.json found-0.json -o f.json").refused(&["scan brick 1 too"]);
    folder.adj("brick agree plan.json found-0.json found-0.json -o f.json").refused(&["are there twice"]);
    folder.adj("brick agree plan.json plan.json -o f.json").refused(&[
        "plan.json",
        "adj brick scan makes",
        "missing field",
    ]);
    folder.adj("brick finish plan.json a.adjs").refused(&["not agreed yet"]);
    folder.adj(&format!("brick scan plan.json 1 {volume} -o found-1.json")).done();
    folder.adj("brick agree plan.json found-0.json found-1.json -o agreed.json").done();
    folder.adj("brick finish agreed.json a.adjs").refused(&["a.adjs"]);
    folder
        .adj(&format!("brick build agreed.json 1 {volume} -o no/a.adjs"))
        .refused(&["cannot create the folder no/a.adjs"]);
    folder
        .adj(&format!("brick build agreed.json 1 {volume} -o plan.json"))
        .refused(&["cannot create the folder plan.json"]);
    folder.adj("brick plan no.nrrd --range 3.. --slab 4 -o p.json").refused(&["no.nrrd"]);
    let names = folder.names();
    assert_eq!(names, ["agreed.json", "found-0.json", "found-1.json", "other.json", "plan.json"]);
    folder.adj(&format!("brick build agreed.json 1 {volume} -o a.adjs")).done();
    folder.adj("brick finish agreed.json a.adjs").refused(&["visible voxels are there", "have any of: 0"]);
    folder.adj(&format!("brick build agreed.json 0 {volume} -o a.adjs")).done();
    // A brick of other cuts has the name of ours.
    let first = "a.adjs/brick-0-00000-00000-00000.adj";
    folder.adj(&format!("build {volume} -q -o other.adj")).done();
    std::fs::copy(folder.file("other.adj"), folder.file(first)).expect("it can be written");
    folder.adj("brick finish agreed.json a.adjs").refused(&[first, "is of another plan; build this brick again"]);
    folder.adj(&format!("brick build agreed.json 0 {volume} -o a.adjs")).done();
    folder.adj("brick finish agreed.json a.adjs").done();
}

#[test]
fn parts_that_are_missing_doubled_or_of_another_picture_are_not_put_together() {
    let folder = Folder::new();
    split(&folder);
    let draw = |part: &str, name: &str, more: &str| {
        folder.adj(&format!("render a.adjs --bricks --part {part} -o {name}.exr --size 40x30 {more}")).done();
    };
    (1..=3).for_each(|part| draw(&format!("{part}/3"), &part.to_string(), "--threads 2"));
    draw("2/3", "turned", "--azimuth 1");
    draw("2/3", "faint", "--quality draft");
    draw("2/3", "again", "--threads 1");
    draw("2/4", "fourth", "");
    folder.adj("render a.adjs -o whole.exr --size 40x30").done();
    let composite = |names: &str, more: &str| {
        let pictures: Vec<String> = names.split(' ').map(|name| format!("{name}.exr")).collect();
        folder.adj(&format!("composite {} -o out.exr {more}", pictures.join(" ")))
    };
    composite("1 again 3", "").done();
    composite("1 3", "").refused(&["part 2 of 3 is missing", "--part 2/3", "--partial"]);
    composite("1 2", "").refused(&["part 3 of 3 is missing"]);
    composite("2 3", "").refused(&["part 1 of 3 is missing"]);
    composite("1 2 2 3", "").refused(&["2.exr", "is part 2 of 3, as 2.exr is", "once"]);
    composite("1 2 again 3", "--partial").refused(&["again.exr", "once"]);
    composite("2 1 3", "--partial").refused(&["1.exr", "give it before 2.exr"]);
    composite("3 2 1", "").refused(&["3.exr", "part 1 comes after it", "1.exr 2.exr 3.exr"]);
    composite("2 3 1", "").refused(&["2.exr", "part 1 comes after it", "1.exr 2.exr 3.exr"]);
    composite("1 3 2", "").refused(&["3.exr", "part 2 comes after it", "1.exr 2.exr 3.exr"]);
    for other in ["turned", "faint", "fourth"] {
        composite(&format!("1 {other} 3"), "--partial").refused(&[other, "another picture than 1.exr"]);
    }
    composite("1 2 3", "--mode xray").refused(&["1.exr", "--mode composite"]);
    composite("1 2 3 whole", "").refused(&["whole.exr", "does not say", "--partial"]);
    composite("whole 1 2 3", "").refused(&["1.exr", "others do not", "--partial"]);
    composite("1 3", "--partial").done();
    composite("whole 2", "--partial").done();
    composite("whole whole", "").done();
}

#[test]
fn parts_of_a_picture_composite_to_the_whole() {
    let folder = Folder::new();
    split(&folder);
    let view = "--size 60x50 --azimuth 30 --elevation 20 --perspective 40";
    for (mode, more) in [("composite", ""), ("xray", "--exposure 0.7")] {
        let view = format!("{view} --mode {mode} {more}");
        folder.adj(&format!("render a.adjs --bricks -o whole.exr {view} --background transparent")).done();
        for part in 1..=3 {
            folder.adj(&format!("render a.adjs --bricks --part {part}/3 -o {part}.exr {view}")).done();
        }
        folder.adj(&format!("composite 1.exr 2.exr 3.exr --mode {mode} -o parts.exr")).done();
        // The same sums in another order.
        let compared = folder.adj("compare whole.exr parts.exr --json").json();
        assert!(compared["max_abs"].as_f64().is_some_and(|most| most < 1e-5), "{compared}");
    }
    folder.adj("composite 1.exr 2.exr -o over.png --mode xray --partial --background white").done();
    folder.adj("render a.adjs -o small.exr --size 20x20").done();
    folder
        .adj("composite small.exr whole.exr -o b.exr")
        .refused(&["whole.exr", "is 60x50, but the first picture is 20x20"]);
    folder.adj("composite 1.exr 2.exr -o 2.exr").refused(&["--output", "which this call reads or writes"]);
    folder.adj("composite 1.exr no.exr -o b.exr").refused(&["no.exr"]);
    folder.adj("composite 1.exr 2.exr -o b.txt").refused(&["b.txt"]);
    folder.adj("render a.adjs --bricks --part 3/2 -o b.exr").refused(&["--part", "2/4"]);
    folder.adj("render a.adjs --part 1/2 -o b.exr").refused(&["--bricks"]);
    folder
        .adj("render a.adjs --bricks --part 1/2 -o b.exr --background white")
        .refused(&["--background", "adj composite"]);
    folder.adj("render a.adjs --preview -o b.exr").refused(&["has no preview"]);
    folder.adj("render a.adj --preview -o b.exr").refused(&["--preview", "collections"]);
    assert!(!folder.names().iter().any(|name| name.starts_with("b.")));
}

#[test]
fn of_64_bricks_one_missing_one_cut_and_one_of_other_codes_are_named() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 32x32x32 -q -o a.adj").done();
    assert_eq!(folder.adj("split a.adj -o a.adjs --brick 8x8x8 --preview 2 --json").json()["files"], 64);
    folder.adj("build phantom:gyroid --dims 8x8x8 --range 90..200 -q -o other.adj").done();
    let [missing, cut, other] = ["00000-00008-00016", "00008-00008-00008", "00024-00024-00024"]
        .map(|place| format!("a.adjs/brick-0-{place}.adj"));
    std::fs::remove_file(folder.file(&missing)).expect("it is there");
    std::fs::write(folder.file(&cut), &bytes(&folder, &cut)[..900]).expect("it can be written");
    std::fs::copy(folder.file("other.adj"), folder.file(&other)).expect("it can be written");
    let faults = [(&missing, "is missing"), (&cut, "900"), (&other, "other codes")];
    let names = |text: &str| {
        for (file, part) in faults {
            assert!(text.lines().any(|line| line.contains(file.as_str()) && line.contains(part)), "{file}: {text}");
        }
    };
    let checked = folder.adj("verify a.adjs");
    assert_eq!(checked.code, Some(1));
    names(&checked.stdout);
    assert!(checked.stdout.contains("not sound: 3 of 64 bricks and a preview"), "{}", checked.stdout);
    for line in ["join a.adjs -o b.adj", "render a.adjs -o b.png", "render a.adjs -o b.png --bricks"] {
        let ran = folder.adj(line);
        assert!(ran.code == Some(2) && ran.stderr.lines().count() == 4, "{line}: {}", ran.stderr);
        names(&ran.stderr);
    }
    for line in ["join a.adjs -o b.adj --partial", "render a.adjs -o b.png --bricks --partial --size 20x20"] {
        let ran = folder.adj(line);
        assert!(ran.code == Some(0) && ran.stderr.contains("3 of 64 bricks are left out"), "{line}: {}", ran.stderr);
        names(&ran.stderr);
    }
    assert_eq!(folder.adj("info a.adjs --json").json()["faults"].as_array().map(Vec::len), Some(3));
    folder.adj("render a.adjs -o preview.png --preview --size 20x20").done();
}

#[test]
fn the_commands_of_the_page_on_clusters_run() {
    let folder = Folder::new();
    let page = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/clusters.md");
    let text = std::fs::read_to_string(page).expect("the page is there");
    let blocks: Vec<&str> = text.split("```sh\n").skip(1).filter_map(|block| block.split("```").next()).collect();
    assert_eq!(blocks.len(), 3);
    let programs = std::path::Path::new(env!("CARGO_BIN_EXE_adj")).parent().expect("a folder").to_path_buf();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let paths = std::env::join_paths(std::iter::once(programs).chain(std::env::split_paths(&path))).expect("paths");
    for block in blocks {
        let mut shell = std::process::Command::new("sh");
        shell.args(["-e", "-c", block]).current_dir(folder.file(".")).env("PATH", &paths);
        let ran = shell.output().expect("there is a shell");
        assert!(ran.status.success(), "{block}\n{}", String::from_utf8_lossy(&ran.stderr));
    }
    assert!(bytes(&folder, "gyroid.adj") == bytes(&folder, "again.adj"));
    assert!(bytes(&folder, "levels.adj") == bytes(&folder, "levels-again.adj"));
    folder.adj("join steps.adjs -o steps.adj").done();
    assert!(bytes(&folder, "gyroid.adj") == bytes(&folder, "steps.adj"));
    assert!(bytes(&folder, "gyroid.adjs/preview.adj") == bytes(&folder, "steps.adjs/preview.adj"));
    assert!(folder.names().contains(&"steps.png".into()));
}

#[test]
fn an_output_does_not_replace_a_file_of_the_collection_that_is_read() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 24x20x16 --range 90.. -q -o a.adj").done();
    folder.adj("split a.adj -o slabs.adjs --slab 8 --preview 2").done();
    let brick = "slabs.adjs/brick-0-00000-00000-00000.adj";
    for own in [brick, "slabs.adjs/preview.adj", "slabs.adjs/collection.json"] {
        folder.adj(&format!("join slabs.adjs -o {own}")).refused(&["--output", "which this call reads or writes"]);
        for flags in ["", "--bricks", "--preview"] {
            folder
                .adj(&format!("render slabs.adjs {flags} --size 8x8 -o o.png --stats {own}"))
                .refused(&["--stats", "which this call reads or writes"]);
        }
    }
    folder.adj("verify slabs.adjs").done();
    assert_eq!(folder.names(), ["a.adj", "slabs.adjs"]);
    folder.adj("join slabs.adjs -o slabs.adjs/whole.adj").done();
}

#[test]
fn finishing_again_makes_a_whole_preview_though_its_parts_are_gone() {
    let folder = Folder::new();
    let volume = "phantom:gyroid --dims 24x20x16";
    folder.adj(&format!("brick plan {volume} --range 90.. --slab 4 --preview 2 -o plan.json")).done();
    for brick in 0..4 {
        folder.adj(&format!("brick scan plan.json {brick} {volume} -o found-{brick}.json")).done();
    }
    folder.adj("brick agree plan.json found-0.json found-1.json found-2.json found-3.json -o agreed.json").done();
    folder
        .adj("brick agree plan.json found-0.json -o plan.json")
        .refused(&["--output", "which this call reads or writes"]);
    for brick in 0..4 {
        folder.adj(&format!("brick build agreed.json {brick} {volume} -o a.adjs")).done();
    }
    folder.adj("brick finish agreed.json no.adjs").refused(&["no.adjs", "is no folder"]);
    folder.adj("brick finish agreed.json a.adjs").done();
    let preview = bytes(&folder, "a.adjs/preview.adj");
    // The preview is lost.
    std::fs::remove_file(folder.file("a.adjs/preview.adj")).expect("it is there");
    folder.adj("brick finish agreed.json a.adjs").done();
    assert!(bytes(&folder, "a.adjs/preview.adj") == preview, "the lost preview is made again");
    folder.adj("verify a.adjs").done();
    // One brick is built again with another description, so only its part of the preview is there.
    let agreed = std::fs::read_to_string(folder.file("agreed.json")).expect("it is there");
    folder.write("other.json", agreed.replace("\"name\":\"gyroid\"", "\"name\":\"again\"").as_bytes());
    folder.adj(&format!("brick build other.json 1 {volume} -o a.adjs")).done();
    folder.adj("brick finish agreed.json a.adjs").done();
    assert!(bytes(&folder, "a.adjs/preview.adj") == preview, "the parts of the other bricks are in the preview");
    // Another step: no brick has a part of it.
    folder.write("third.json", agreed.replace("\"preview\":2", "\"preview\":3").as_bytes());
    folder.adj("brick finish third.json a.adjs").done();
    assert_eq!(folder.adj("info a.adjs --json").json()["preview"]["every"], 3);
    folder.adj("verify a.adjs").done();
    let left = std::fs::read_dir(folder.file("a.adjs")).expect("it is there").count();
    assert_eq!(left, 6, "four bricks, the preview, the manifest");
}

#[test]
fn finishing_without_thousands_of_bricks_names_some_of_them() {
    let folder = Folder::new();
    let volume = "phantom:gyroid --dims 24x20x16";
    folder.adj(&format!("brick plan {volume} --slab 16 -o plan.json")).done();
    folder.adj(&format!("brick scan plan.json 0 {volume} -o found.json")).done();
    folder.adj("brick agree plan.json found.json -o agreed.json").done();
    let agreed = std::fs::read_to_string(folder.file("agreed.json")).expect("it is there");
    folder.write("small.json", agreed.replace("\"bricks\":[[0,0,16]]", "\"bricks\":[[1,1,1]]").as_bytes());
    std::fs::create_dir(folder.file("a.adjs")).expect("it can be made");
    let ran = folder.adj("brick finish small.json a.adjs");
    assert!(ran.stderr.len() < 1000, "{}", ran.stderr);
    ran.refused(&["have any of: 0, 1, 2", "99 and 7580 more"]);
}

#[test]
fn a_picture_that_says_it_has_a_thousand_million_columns_is_refused() {
    let folder = Folder::new();
    split(&folder);
    folder.adj("render a.adjs --bricks --part 1/1 -o 1.exr --size 20x20").done();
    let mut lying = bytes(&folder, "1.exr");
    let name = b"dataWindow\0box2i\0";
    let at = lying.windows(name.len()).position(|part| part == name).expect("every file has it");
    // The length, and the lowest x and y, come first.
    let columns = at + name.len() + 12;
    lying[columns..columns + 4].copy_from_slice(&1_000_000_000i32.to_le_bytes());
    folder.write("lying.exr", &lying);
    folder.adj("composite 1.exr lying.exr -o o.png").refused(&["lying.exr", "1000000001", "16384"]);
    folder.adj("compare 1.exr lying.exr").refused(&["lying.exr", "16384"]);
}
