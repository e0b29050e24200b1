//! Flags and files that say what is visible.

use super::harness::{Folder, RAW};

fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("v.raw", &RAW);
    folder
}

const BUILD: &str = "v.raw --dims 4x3x2 --type u8 -o out.adj";

fn point(value: &str, opacity: &str) -> String {
    format!("{{\"value\":{value},\"colour\":\"#ffffff\",\"opacity\":{opacity}}}")
}

fn points(points: &[String]) -> String {
    format!("{{\"kind\":\"points\",\"points\":[{}]}}", points.join(","))
}

#[test]
fn one_of_the_flags_is_needed_and_only_one() {
    let folder = folder();
    folder.build_refused(BUILD, &["what is visible", "--range", "--iso", "--tf", "adj info"]);
    folder.build_refused(&format!("{BUILD} --range 1.. --iso 5"), &["--range", "--iso", "adj build --help"]);
    folder.adj(&format!("build {BUILD} --range 1..")).done();
    // A phantom says itself what is to be seen of it.
    folder.adj("build phantom:shells --dims 20x20x20 -o out.adj").done();
}

#[test]
fn files_with_numbers_that_are_none() {
    let folder = folder();
    for bad in ["NaN", "null", "1e999", "\"5\"", "-Infinity"] {
        folder.write("t.json", points(&[point("1", "0"), point(bad, "1")]).as_bytes());
        let line = folder.build_refused(&format!("{BUILD} --tf t.json"), &["t.json"]);
        assert!(line.contains("line 1 column") || line.contains("points[1].value"), "{line}");
        folder.write("t.json", points(&[point("1", bad), point("9", "1")]).as_bytes());
        folder.build_refused(&format!("{BUILD} --tf t.json"), &["t.json"]);
    }
    for bad in ["-0.1", "1.5"] {
        folder.write("t.json", points(&[point("1", bad), point("9", "1")]).as_bytes());
        folder.build_refused(&format!("{BUILD} --tf t.json"), &["points[0].opacity", bad]);
    }
}

#[test]
fn files_that_are_wrong_in_other_ways() {
    let folder = folder();
    let refused = |text: &str, parts: &[&str]| {
        folder.write("t.json", text.as_bytes());
        folder.build_refused(&format!("{BUILD} --tf t.json"), &[&["t.json"], parts].concat());
    };
    refused(&points(&[point("9", "0"), point("1", "1")]), &["points"]);
    refused(&points(&[]), &["points"]);
    refused("", &["line 1"]);
    refused("{", &["line 1"]);
    refused("[1, 2]", &[]);
    refused("{\"kind\":\"pints\"}", &["pints", "points"]);
    refused("{\"kind\":\"points\"}", &["points"]);
    refused("{\"kind\":\"range\",\"low\":1,\"points\":[]}", &["points", "take it out"]);
    refused("{\"kind\":\"range\",\"low\":5,\"high\":1}", &[]);
    refused("{\"kind\":\"range\",\"colour\":5}", &["colour"]);
    folder.write("t.json", &[0xff, 0xfe, 0x00]);
    folder.build_refused(&format!("{BUILD} --tf t.json"), &["t.json", "UTF-8"]);
    folder.build_refused(&format!("{BUILD} --tf gone.json"), &["gone.json", "No such file"]);
    folder.build_refused(&format!("{BUILD} --tf ct-bones"), &["ct-bones", "ct-bone", "ct-skin"]);
    folder.build_refused(&format!("{BUILD} --labels ct-bone"), &["--labels", "--tf"]);
}

#[test]
fn numbers_on_the_command_line() {
    let folder = folder();
    for bad in ["5", "a..b", "5..nan", "5..inf", "1..2..3", "5-9", "9..5"] {
        folder.build_refused(&format!("{BUILD} --range {bad}"), &["range"]);
    }
    for bad in ["nan", "inf", "five", "-"] {
        folder.build_refused(&format!("{BUILD} --iso {bad}"), &[]);
    }
    for bad in ["5", "5:1", "5:1,3:1", "5:2,9:1", "a:b", "5:nan,6:1"] {
        folder.build_refused(&format!("{BUILD} --levoy {bad}"), &[]);
    }
    for (good, visible) in [("--range 5..9", 5), ("--range ..9", 9), ("--range -5..9", 9), ("--range ..", 24)] {
        let told = folder.adj(&format!("build {BUILD} --json {good}")).json();
        assert_eq!(told["visible_voxels"], visible, "{good}");
    }
    folder.adj(&format!("build {BUILD} --iso 12")).done();
    folder.adj(&format!("build {BUILD} --levoy 0:0,12:0.2,24:0.8")).done();
}

#[test]
fn a_palette_and_a_colour_table() {
    let folder = folder();
    folder.write("t.ctbl", b"# a table\n3 some_organ 200 100 50 255\n7 none 0 0 0 0\n9 other 1 2 3 128\n");
    let told = folder.adj(&format!("build {BUILD} --json --labels t.ctbl")).json();
    assert_eq!(told["visible_voxels"], 2);
    let told = folder.adj(&format!("build {BUILD} --json --labels distinct")).json();
    assert_eq!(told["visible_voxels"], 24);
    folder.write("t.ctbl", b"3 organ 200 100\n");
    folder.build_refused(&format!("{BUILD} --labels t.ctbl"), &["t.ctbl", "line 1"]);
}
