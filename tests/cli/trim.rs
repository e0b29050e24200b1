//! `adj trim`: what is left, what is said of it, and what is refused; nothing half-written, whatever goes wrong.
//!
//! Cannot catch: a voxel too many or too few in a file that is sound (`tests/core/edits/trim.rs` does).

use adjsplat::arena::layout::SectionKind;
use adjsplat::arena::{Arena, Levels, TrimOptions, trim};
use adjsplat::build::Unobserved;
use adjsplat::file::{RowsOutput, write_rows};
use serde_json::{Value, json};

use super::harness::{Folder, RAW, Runs as _, in_private_mounts};

/// A ramp of 1 to 24, of which those from 5 up are visible, in three lanes.
fn ramp(folder: &Folder, name: &str) {
    folder.write("v.raw", &RAW);
    let build = "build v.raw --dims 4x3x2 --type u8 --spacing 1x2x3 --range 5..";
    folder.adj(&format!("{build} -o {name}")).done();
}

fn bytes(folder: &Folder, name: &str) -> Vec<u8> {
    std::fs::read(folder.file(name)).expect("it is there")
}

/// The sections of the lanes.
fn lanes(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let arena = Arena::new(bytes).expect("opens");
    let lanes = arena.sections().iter().filter(|section| section.lane_axis().is_some());
    lanes
        .map(|section| {
            (format!("{:?}", (section.known_kind(), section.lane_axis())), arena.section_bytes(section).to_vec())
        })
        .collect()
}

fn info(folder: &Folder, name: &str) -> Value {
    folder.adj(&format!("verify {name}")).done();
    folder.adj(&format!("info {name} --json")).json()
}

/// Checks that trimming is refused in one line that has all of `parts`, and leaves nothing new.
fn refused(folder: &Folder, line: &str, parts: &[&str]) {
    let before = folder.names();
    let told = folder.adj(&format!("trim {line}")).refused(parts);
    assert_eq!(folder.names(), before, "{line}: {told}");
}

#[test]
fn a_threshold_leaves_what_is_above_and_says_so() {
    let folder = Folder::new();
    ramp(&folder, "a.adj");
    let told = folder.adj("trim a.adj -o b.adj --range 20.. --json").json();
    assert_eq!((&told["visible_voxels"], &told["visible_voxels_before"]), (&5.into(), &20.into()));
    assert_eq!(told["bytes_total"], bytes(&folder, "b.adj").len());
    assert_eq!(told["bytes_before"], bytes(&folder, "a.adj").len());
    let b = info(&folder, "b.adj");
    assert_eq!(
        (&b["visible_voxels"], &b["dims"], &b["spacing"]),
        (&5.into(), &json!([4, 3, 2]), &json!([1.0, 2.0, 3.0]))
    );
    let description = &b["description"];
    assert_eq!(description["source"]["name"], "v.raw");
    assert_eq!(description["transfer_function"]["low"], 20.0);
    let entry = &description["trimmed"][0];
    assert_eq!((&entry["visible_voxels_before"], &entry["transfer_function_before"]["low"]), (&20.into(), &json!(5.0)));
    let told = folder.adj("trim b.adj -o b.adj --range 24..24").done();
    assert!(told.starts_with("b.adj: 1 of 5 visible voxels are left (20.00 %); "), "{told}");
    let b = info(&folder, "b.adj");
    assert_eq!((&b["visible_voxels"], b["description"]["trimmed"].as_array().map(Vec::len)), (&1.into(), Some(2)));
    // The function it is drawn with is the new one.
    folder.adj("render a.adj -o a.png --size 40x40 --range 24..24").done();
    folder.adj("render b.adj -o b.png --size 40x40").done();
}

/// Whole numbers of -30 to 29 as `i16`, and a file of those from -20 up with values of 16 bits.
fn wide(folder: &Folder) {
    let samples: Vec<u8> = (-30..30i16).flat_map(i16::to_le_bytes).collect();
    folder.write("w.raw", &samples);
    folder.adj("build w.raw --dims 5x4x3 --type i16le --range=-20..29 --value-bits 16 -o w.adj").done();
}

/// The range of the sample type took the place of the data's: all voxels had the darkest colours.
#[test]
fn an_open_range_after_a_closed_one_has_the_colours_of_the_data() {
    let folder = Folder::new();
    wide(&folder);
    folder.adj("trim w.adj -o t.adj --range 0..").done();
    folder.adj("render t.adj -o t.exr --size 40x40").done();
    folder.adj("render w.raw --dims 5x4x3 --type i16le --range 0.. -o w.exr --size 40x40").done();
    assert_eq!(folder.adj("compare t.exr w.exr --json").json()["max_abs"], 0.0);
    // A range of values that is given stays, whatever the data.
    let function = r#"{"kind":"range","low":0,"value_range":[0,1000]}"#;
    folder.write("f.json", function.as_bytes());
    folder.adj("build w.raw --dims 5x4x3 --type i16le --tf f.json -o f.adj").done();
    assert_eq!(info(&folder, "f.adj")["description"]["transfer_function"]["value_range"], json!([0.0, 1000.0]));
}

#[test]
fn narrowed_values_say_by_how_much_they_are_rounded() {
    let folder = Folder::new();
    let samples: Vec<u8> = (0..60u16).flat_map(|n| (17 * n).to_le_bytes()).collect();
    folder.write("w.raw", &samples);
    folder.adj("build w.raw --dims 5x4x3 --type u16le --range 1.. --value-bits 16 -o w.adj").done();
    assert_eq!(info(&folder, "w.adj")["value_rounding"], 0.0);
    let told = folder.adj("trim w.adj -o n.adj --value-bits 8 --json").json();
    let rounding = told["rounding"].as_f64().expect("a number");
    // Steps of (1003 - 17) / 255.
    assert!(rounding > 1.5 && rounding < 1.94, "{rounding}");
    assert_eq!(info(&folder, "n.adj")["value_rounding"], told["rounding"]);
    assert!(folder.adj("trim w.adj -o n.adj --value-bits 8").done().contains("rounded by at most 1."));
}

#[test]
fn a_crop_moves_nothing_in_the_world() {
    let folder = Folder::new();
    ramp(&folder, "a.adj");
    folder.adj("trim a.adj -o b.adj --crop 1..2,2..2,..").done();
    let b = info(&folder, "b.adj");
    assert_eq!((&b["dims"], &b["visible_voxels"]), (&json!([2, 1, 2]), &4.into()));
    let a = info(&folder, "a.adj");
    let origin = |told: &Value, a: usize| told["origin"][a].as_f64().expect("a number");
    assert_eq!([0, 1, 2].map(|axis| origin(&b, axis) - origin(&a, axis)), [1.0, 4.0, 0.0]);
    assert_eq!(b["description"]["trimmed"][0]["crop"], json!([[1, 2], [2, 2], [0, 1]]));
    folder.adj("trim a.adj -o c.adj --crop 1..2,2..2,.. --keep-grid").done();
    let c = info(&folder, "c.adj");
    assert_eq!((&c["dims"], &c["origin"], &c["visible_voxels"]), (&a["dims"], &a["origin"], &4.into()));
}

#[test]
fn without_flags_only_the_description_grows() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 40x30x20 --normals 16 --value-bits 16 -o a.adj").done();
    folder.adj("trim a.adj -o b.adj").done();
    assert!(lanes(&bytes(&folder, "a.adj")) == lanes(&bytes(&folder, "b.adj")));
    let [a, b] = ["a.adj", "b.adj"].map(|name| bytes(&folder, name));
    let [a, b] = [&a, &b].map(|bytes| Arena::new(bytes).expect("opens").facts().clone());
    assert_eq!(a, b);
    // The same again is the same.
    folder.adj("trim a.adj -o c.adj").done();
    assert!(bytes(&folder, "b.adj") == bytes(&folder, "c.adj"));
}

#[test]
fn lanes_channels_and_orders_change_and_come_back() {
    let folder = Folder::new();
    folder.adj("build phantom:vessels --dims 40x30x50 --normals 16 --value-bits 16 -o a.adj").done();
    let all = lanes(&bytes(&folder, "a.adj"));
    folder.adj("trim a.adj -o x.adj --lanes x").done();
    assert!(lanes(&bytes(&folder, "x.adj"))[..] == all[..5]);
    folder.adj("trim x.adj -o xyz.adj --lanes xyz").done();
    assert!(lanes(&bytes(&folder, "xyz.adj")) == all);
    folder.adj("trim a.adj -o h.adj --order hilbert").done();
    assert_eq!(info(&folder, "h.adj")["tile_order"], "hilbert");
    folder.adj("trim h.adj -o h.adj --order morton").done();
    assert!(lanes(&bytes(&folder, "h.adj")) == all);
    folder.adj("trim a.adj -o small.adj --value-bits 8 --normals 8").done();
    let small = info(&folder, "small.adj");
    assert_eq!((&small["channels"]["value_bits"], &small["channels"]["normal_bits"]), (&8.into(), &8.into()));
    folder.adj("trim small.adj -o smaller.adj --drop normals,magnitudes --value-bits 8").done();
    let smaller = info(&folder, "smaller.adj");
    assert_eq!((&smaller["channels"]["record_bytes"], smaller["lanes"].as_array().map(Vec::len)), (&2.into(), Some(3)));
    folder.adj("render smaller.adj -o a.png --size 40x40").done();
}

#[test]
fn what_cannot_be_done_is_refused() {
    let folder = Folder::new();
    ramp(&folder, "a.adj");
    refused(&folder, "a.adj -o b.adj --range 2..", &["values 2..5", "does not store", "--force"]);
    refused(&folder, "a.adj -o b.adj --range ..9", &["values 1..5"]);
    refused(&folder, "a.adj -o b.adj --iso 9", &["gradient magnitudes"]);
    refused(&folder, "a.adj -o b.adj --range 99..", &["nothing is left", "20 visible voxels"]);
    refused(&folder, "a.adj -o b.adj --crop 0..0,0..0,0..0", &["nothing is left"]);
    refused(&folder, "a.adj -o b.adj --crop 4..,..,..", &["--crop", "of the 4 x 3 x 2 grid"]);
    refused(&folder, "a.adj -o b.adj --crop 2..1,..,..", &["--crop"]);
    refused(&folder, "a.adj -o b.adj --keep-grid", &["--crop", "see adj trim --help"]);
    refused(&folder, "a.adj -o b.adj --drop values", &["'values'", "normals, magnitudes"]);
    refused(&folder, "a.adj -o b.adj --value-bits 16", &["'16'", "8"]);
    refused(&folder, "a.adj -o b.adj --lanes z", &["x, xy, xyz"]);
    refused(&folder, "a.adj", &["--output <OUT.adj>"]);
    refused(&folder, "gone.adj -o b.adj", &["cannot open gone.adj"]);
    refused(&folder, "v.raw -o b.adj", &["is no .adj file", "adj build"]);
    refused(&folder, "a.adj -o gone/b.adj", &["gone", "create it first"]);
    refused(&folder, "a.adj -o v.raw", &["v.raw", "is no .adj file"]);
    refused(&folder, ". -o b.adj", &["is a folder"]);
    folder.adj("trim a.adj -o b.adj --range 2.. --force").done();
    assert_eq!(info(&folder, "b.adj")["visible_voxels"], 20);
}

#[test]
fn a_function_as_wide_as_the_data_is_no_trouble() {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    // Bytes end at 255, so nothing is missing above.
    folder.adj("build v.raw --dims 4x3x2 --type u8 --range 5..255 -o a.adj").done();
    folder.adj("trim a.adj -o b.adj --range 20..").done();
    assert_eq!(info(&folder, "b.adj")["visible_voxels"], 5);
}

#[test]
fn a_damaged_file_is_found_before_it_is_trimmed() {
    let folder = Folder::new();
    let good = std::fs::read(folder.small_arena("a.adj")).expect("it was built");
    for at in (0..good.len()).step_by(211) {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        folder.write("b.adj", &bytes);
        refused(&folder, "b.adj -o c.adj", &["b.adj", "at byte"]);
        // Not checked it may be trimmed, wrongly or not, but there is nothing between a sound file and one line.
        let ran = folder.adj("trim b.adj -o c.adj --no-verify");
        if ran.code == Some(0) {
            folder.adj("verify c.adj").done();
            std::fs::remove_file(folder.file("c.adj")).expect("it was written");
        } else {
            ran.refused(&[]);
        }
    }
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_leaves_the_old_file() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("disk")).expect("new");
    folder.adj("build phantom:gyroid --dims 64x64x64 -o a.adj").done();
    let old = "\"$0\" build phantom:corners --dims 9x9x9 -o disk/out.adj >/dev/null";
    for levels in ["", "--levels 2"] {
        let trim = format!("\"$0\" trim a.adj -o disk/out.adj {levels}");
        let script = format!(
            "mount -t tmpfs -o size=64k tmpfs disk; {old}; {trim}; echo $?; ls -A disk; \"$0\" verify disk/out.adj"
        );
        let Some(ran) = in_private_mounts(&script, folder.path()) else { return };
        assert!(ran.stdout.starts_with("2\nout.adj\ndisk/out.adj: sound"), "{levels}: {} {}", ran.stdout, ran.stderr);
        assert!(ran.stderr.contains("No space left") && ran.stderr.lines().count() == 1, "{levels}: {}", ran.stderr);
    }
}

#[test]
fn cutting_open_a_file_without_hidden_voxels_is_told() {
    let folder = Folder::new();
    ramp(&folder, "a.adj");
    let bytes = bytes(&folder, "a.adj");
    let arena = Arena::new(&bytes).expect("opens");
    let left = trim(&arena, None, &TrimOptions::default()).expect("all is left");
    let mut description: Value =
        serde_json::from_slice(arena.section_bytes(arena.section(SectionKind::Description, None).expect("there")))
            .expect("JSON");
    description["hidden_voxels"] = json!({ "algorithm": "sampled", "removed": 9 });
    let output = RowsOutput {
        facts: left.facts.clone(),
        description: &description.to_string(),
        lane_count: 1,
        memory: None,
        threads: 1,
        levels: Levels::default(),
    };
    write_rows(&folder.file("h.adj"), &*left.rows, &output, &mut Unobserved).expect("writes");
    let ran = folder.adj("trim h.adj -o b.adj --crop ..,1..,..");
    assert!(ran.code == Some(0) && ran.stderr.contains("hidden voxels"), "{}", ran.stderr);
    let ran = folder.adj("trim h.adj -o b.adj --lanes x");
    assert!(ran.code == Some(0) && ran.stderr.is_empty(), "{}", ran.stderr);
    assert_eq!(info(&folder, "b.adj")["description"]["hidden_voxels"]["removed"], 9);
}

/// A solid of 48 x 40 x 44 voxels.
fn solid(folder: &Folder, name: &str, flags: &str) {
    folder.write("solid.raw", &[200; 48 * 40 * 44]);
    folder.adj(&format!("build solid.raw --dims 48x40x44 --type u8 --range 100.. {flags} -o {name}")).done();
}

#[test]
fn levels_are_added_replaced_and_dropped_without_the_volume() {
    let folder = Folder::new();
    solid(&folder, "plain.adj", "");
    solid(&folder, "built.adj", "--levels 3");
    assert_eq!(info(&folder, "plain.adj")["levels"], json!([]));
    folder.adj("trim plain.adj -o added.adj --levels 3").done();
    // Apart from what is said of the trim, it is the file that is built so.
    assert_eq!(lanes(&bytes(&folder, "added.adj")), lanes(&bytes(&folder, "built.adj")));
    let levels = |name: &str| -> Vec<Vec<u8>> {
        let bytes = bytes(&folder, name);
        let arena = Arena::new(&bytes).expect("opens");
        (1..=arena.level_count()).map(|level| arena.level(level).expect("it is there").bytes().to_vec()).collect()
    };
    assert_eq!(levels("added.adj"), levels("built.adj"));
    let told = info(&folder, "added.adj");
    assert_eq!(told["levels"][1]["dims"], json!([12, 10, 11]));
    assert_eq!(told["levels"][1]["visible_voxels"], 12 * 10 * 11);
    let bytes_of = told["levels"][2]["bytes"].as_u64().expect("a number");
    assert_eq!(told["levels"][2]["share_of_file"], bytes_of as f64 / told["bytes_total"].as_f64().expect("a number"));
    assert_eq!([&told["sections"][1]["kind"], &told["sections"][2]["kind"]], ["limits of levels", "level 3"]);
    let text = folder.adj("info added.adj").done();
    assert!(text.contains("levels:\n  bytes ") || text.contains("levels:\n  level 1, dims 24 20 22, "), "{text}");
    // As many as before by default; another number, or none.
    let told = folder.adj("trim added.adj -o crop.adj --crop 0..20,..,.. --json").json();
    assert_eq!(told["levels"], 3);
    assert_eq!(info(&folder, "crop.adj")["levels"][0]["dims"], json!([11, 20, 22]));
    folder.adj("trim added.adj -o one.adj --levels 1").done();
    assert_eq!(levels("one.adj"), levels("built.adj")[..1]);
    let told = folder.adj("trim added.adj -o auto.adj --levels auto").done();
    assert!(told.contains("coarser levels of detail are of no use"), "{told}");
    folder.adj("trim added.adj -o none.adj --levels none").done();
    assert!(levels("none.adj").is_empty() && levels("auto.adj").is_empty());
    assert_eq!(lanes(&bytes(&folder, "none.adj")), lanes(&bytes(&folder, "plain.adj")));
    for wrong in ["16", "-1", "all"] {
        refused(&folder, &format!("plain.adj -o x.adj --levels={wrong}"), &["--levels", "auto, none, or 0 to 15"]);
    }
}

#[test]
fn levels_go_with_every_way_to_build() {
    let folder = Folder::new();
    let told = folder.adj("build phantom:shells --dims 96x96x96 --levels auto -o a.adj").done();
    assert!(
        told.contains("coarser level of detail takes ") || told.contains("coarser levels of detail take "),
        "{told}"
    );
    let levels = info(&folder, "a.adj")["levels"].as_array().map(Vec::len);
    assert_eq!(levels, Some(1));
    folder.adj("build phantom:shells --dims 96x96x96 --levels 2 --threads 1 -o b.adj").done();
    folder.adj("build phantom:shells --dims 96x96x96 --levels 2 --threads 3 --memory 64MiB -o c.adj").done();
    assert!(bytes(&folder, "b.adj") == bytes(&folder, "c.adj"));
    let told = folder.adj("build phantom:shells --dims 96x96x96 --levels 2 --cull-hidden -o d.adj --json").json();
    assert_eq!((&told["levels"], info(&folder, "d.adj")["levels"].as_array().map(Vec::len)), (&2.into(), Some(2)));
}

#[test]
fn damage_in_a_level_is_found_with_its_byte() {
    let folder = Folder::new();
    solid(&folder, "a.adj", "--levels 2");
    let mut damaged = bytes(&folder, "a.adj");
    let offset = {
        let arena = Arena::new(&damaged).expect("opens");
        let section = arena.sections().iter().find(|section| section.level() == Some(2)).expect("it is there");
        usize::try_from(section.offset.get()).expect("small")
    };
    damaged[offset + 1_000] ^= 1;
    folder.write("b.adj", &damaged);
    let ran = folder.adj("verify b.adj");
    assert_eq!(ran.code, Some(1), "{}", ran.stderr);
    assert!(ran.stdout.contains(&format!("byte {offset}")) && ran.stdout.contains("level 2"), "{}", ran.stdout);
    refused(&folder, "b.adj -o c.adj", &["b.adj", "level 2"]);
}

#[test]
fn bricks_keep_the_levels_that_no_border_divides_and_name_the_others() {
    let folder = Folder::new();
    solid(&folder, "plain.adj", "");
    solid(&folder, "a.adj", "--levels 2");
    let ran = folder.adj("split a.adj -o a.adjs --slab 16");
    assert!(ran.code == Some(0) && ran.stderr.is_empty(), "{}", ran.stderr);
    folder.adj("join a.adjs -o b.adj").done();
    assert!(bytes(&folder, "b.adj") == bytes(&folder, "a.adj"));
    let ran = folder.adj("split a.adj -o odd.adjs --slab 9");
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    let told = "of 2 levels of detail, bricks keep none: borders divide blocks of the others";
    assert!(ran.stderr.contains(told), "{}", ran.stderr);
    folder.adj("join odd.adjs -o c.adj").done();
    assert!(bytes(&folder, "c.adj") == bytes(&folder, "plain.adj"));
}
