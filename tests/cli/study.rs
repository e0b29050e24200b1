//! `adj study speed`, `walk`, `memory`, `accuracy` and `levels`: what they print and write, in little time.

use std::collections::BTreeSet;

use serde_json::Value;

use super::harness::{Folder, Runs as _};

fn rows(folder: &Folder, name: &str) -> Vec<Value> {
    let json: Value = serde_json::from_slice(&std::fs::read(folder.file(name)).unwrap()).unwrap();
    json["rows"].as_array().unwrap().clone()
}

fn names(rows: &[Value], column: &str) -> BTreeSet<String> {
    rows.iter().map(|row| row[column].as_str().unwrap_or_else(|| panic!("{column} of {row}")).to_owned()).collect()
}

const METHODS: [&str; 9] =
    ["adjsplat", "traditional", "unordered", "octree", "adjacency_a", "adjacency_b", "shell", "sorted", "bricks"];

#[test]
fn results_replace_neither_the_set_nor_each_other() {
    let folder = Folder::new();
    folder.adj("build phantom:shells --dims 16x16x16 -o a.adj").done();
    let old = std::fs::read(folder.file("a.adj")).unwrap();
    let refused = |line: &str, flag: &str| {
        folder.adj(&format!("study {line}")).refused(&[flag, "which this call reads or writes"]);
    };
    for study in ["memory", "walk", "speed", "cache", "layouts", "levels"] {
        refused(&format!("{study} a.adj --json ./a.adj"), "--json");
        refused(&format!("{study} a.adj --csv r.txt --json r.txt"), "--csv");
    }
    refused("cache a.adj --methods adjsplat --orders +z+y+x --trace a.adj", "--trace");
    assert!(std::fs::read(folder.file("a.adj")).unwrap() == old && folder.names() == ["a.adj"]);
}

#[test]
fn speed_has_a_row_for_every_method_projection_and_kind_of_run() {
    let folder = Folder::new();
    let line = "study speed phantom:shells --quick --edge 24 --size 80x60 --quiet --json s.json --csv s.csv --plot s.svg --plot s.png --figure5 f.svg";
    let table = folder.adj(line).done();
    assert!(table.contains("fps not displaying") && table.contains("equal, bit for bit"), "{table}");
    let rows = rows(&folder, "s.json");
    let methods = names(&rows, "method");
    assert!(METHODS.iter().all(|method| methods.contains(*method)), "{methods:?}");
    assert_eq!(rows.len(), methods.len() * 4, "two projections, displaying and not");
    assert_eq!(names(&rows, "projection"), BTreeSet::from(["parallel".to_owned(), "perspective".to_owned()]));
    let mut pictures = BTreeSet::new();
    for row in &rows {
        let number = |name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
        assert!(number("fps") > 0.0 && number("walk_ns_per_visible") > 0.0, "{row}");
        let nanoseconds = number("ns_per_visible") * number("visible_voxels");
        assert!((nanoseconds * number("fps") / 1e9 - 1.0).abs() < 1e-6, "{row}");
        let exact = ["adjsplat", "traditional", "adjacency_a", "adjacency_b", "bricks"];
        if row["displaying"] == true && exact.contains(&row["method"].as_str().unwrap()) {
            pictures.insert((row["projection"].to_string(), row["pictures_xxh3"].to_string()));
        }
    }
    assert_eq!(pictures.len(), 2, "one picture for each projection: {pictures:?}");
    assert_eq!(std::fs::read_to_string(folder.file("s.csv")).unwrap().lines().count(), rows.len() + 1);
    for plot in ["s.svg", "f.svg"] {
        let text = std::fs::read_to_string(folder.file(plot)).unwrap();
        assert!(text.starts_with("<svg") && text.contains("adjacency_b"), "{plot}");
    }
    assert!(std::fs::read(folder.file("s.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn walks_are_timed_in_all_orders() {
    let folder = Folder::new();
    let line =
        "study walk phantom:vessels --quick --edge 24 --repetitions 1 --quiet --methods adjsplat,bricks --json w.json";
    let table = folder.adj(line).done();
    assert!(table.contains("ns geometric mean"), "{table}");
    let rows = rows(&folder, "w.json");
    assert_eq!(names(&rows, "method"), BTreeSet::from(["adjsplat".to_owned(), "bricks".to_owned()]));
    for row in &rows {
        let number = |name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
        assert!(number("ns_worst") >= number("ns_median") && number("ns_geometric_mean") > 0.0, "{row}");
    }
}

#[test]
fn walks_are_timed_in_perspective() {
    let folder = Folder::new();
    for views in ["outside", "inside"] {
        let line = format!(
            "study walk phantom:vessels --quick --edge 24 --repetitions 1 --quiet --methods adjsplat --views {views} --json \
             w.json"
        );
        folder.adj(&line).done();
        for row in &rows(&folder, "w.json") {
            assert!(row["ns_median"].as_f64().is_some_and(|ns| ns > 0.0), "{views}: {row}");
        }
    }
}

#[test]
fn memory_is_what_the_papers_formulas_say() {
    let folder = Folder::new();
    let table = folder.adj("study memory phantom:shells --quick --edge 24 --quiet --json m.json --plot m.svg").done();
    // The paper's 28.22 MB of Jeff under B follow from 47 bytes a record; its break-even follows from 59.
    for part in ["28.22", "35.42", "26.3 %", "16.1 %"] {
        assert!(table.contains(part), "{part} is not in\n{table}");
    }
    let rows = rows(&folder, "m.json");
    let of = |method: &str| rows.iter().find(|row| row["method"] == method).unwrap_or_else(|| panic!("{method}"));
    for method in ["traditional", "adjacency_a", "adjacency_b"] {
        assert_eq!(of(method)["bytes"], of(method)["formula_bytes"], "{method}");
    }
    assert_eq!(of("traditional")["bytes"], 17 * 24 * 24 * 24);
    let [one, three] = ["adjsplat_one_lane", "adjsplat"].map(|method| of(method)["bytes"].as_u64().unwrap());
    assert!(one < three && three < of("adjacency_b")["bytes"].as_u64().unwrap());
}

#[test]
fn accuracy_has_a_row_for_every_view_and_candidate_and_marks_the_front() {
    let folder = Folder::new();
    let line = "study accuracy phantom:gyroid phantom:shells --quick --edge 24 --quiet --json a.json --csv a.csv --plot a.svg --plot a.png";
    let table = folder.adj(line).done();
    assert!(table.contains("reference") && table.contains("all 2 sets"), "{table}");
    let rows = rows(&folder, "a.json");
    assert_eq!(
        names(&rows, "quality"),
        BTreeSet::from(["", "draft", "high", "reference", "standard"].map(str::to_owned))
    );
    let of = |set: &str, view: &str| -> Vec<&Value> {
        rows.iter().filter(|row| row["set"] == set && row["view"] == view).collect()
    };
    let number = |row: &Value, name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
    for set in ["gyroid 24^3", "shells 24^3"] {
        let all = of(set, "all");
        let settings: BTreeSet<&str> = all.iter().map(|row| row["settings"].as_str().unwrap()).collect();
        assert!(all.len() > 20 && settings.len() == all.len(), "{set}: {} of {}", settings.len(), all.len());
        assert_eq!(of(set, "oblique").len(), all.len(), "quick studies have one view");
        let preset = |quality: &str, bits: u64| {
            let found = all.iter().find(|row| row["quality"] == quality && row["value_bits"] == bits);
            *found.unwrap_or_else(|| panic!("{set}: no {quality} of {bits} bits"))
        };
        // Each quality is nearer to the truth than the one before; codes of 16 bits do not let go of it.
        let decibels = ["draft", "standard", "high", "reference"].map(|quality| number(preset(quality, 16), "psnr"));
        assert!(decibels.is_sorted() && decibels[0] > 25.0 && decibels[3] > 75.0, "{set}: {decibels:?}");
        let timed: Vec<&&Value> = all.iter().filter(|row| !row["ms"].is_null()).collect();
        assert_eq!(timed.len(), all.len());
        // The classic form is another picture; sheets change no more than what is in front in a slice.
        let blended = |name: &str| {
            let found = all.iter().find(|row| row["settings"].as_str().unwrap().ends_with(name));
            number(found.unwrap_or_else(|| panic!("{set}: no {name}")), "psnr")
        };
        let (linear, sheets) = (blended("blending=linear"), blended("blending=sheets"));
        assert!(linear < sheets && (30.0..decibels[2]).contains(&sheets), "{set}: {linear} {sheets} {decibels:?}");
        for row in &timed {
            let beats = |other: &&&Value| {
                let (faster, nearer) =
                    (number(other, "ms") - number(row, "ms"), number(other, "psnr") - number(row, "psnr"));
                faster <= 0.0 && nearer >= 0.0 && (faster, nearer) != (0.0, 0.0)
            };
            assert_eq!(row["front"].as_bool().unwrap(), !timed.iter().any(beats), "{row}");
            assert!((0.0..=1.0).contains(&number(row, "flip")) && number(row, "ssim") <= 1.0, "{row}");
            assert!(number(row, "rmse") <= number(row, "max_abs"), "{row}");
        }
    }
    assert_eq!(std::fs::read_to_string(folder.file("a.csv")).unwrap().lines().count(), rows.len() + 1);
    let plot = std::fs::read_to_string(folder.file("a.svg")).unwrap();
    assert!(["front", "kernel", "standard, 8 bits"].iter().all(|part| plot.contains(part)));
    assert!(std::fs::read(folder.file("a.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn the_order_pops_where_it_switches_and_the_error_falls_in_three() {
    let folder = Folder::new();
    folder.adj("study accuracy phantom:shells --popping --edge 24 --quiet --json p.json").done();
    let popping = rows(&folder, "p.json");
    // Two places, two steps, three who draw.
    assert_eq!(popping.len(), 12);
    for row in &popping {
        let number = |name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
        assert!((number("max_abs") - number("sorted_max_abs") - number("popping_max_abs")).abs() < 1e-12, "{row}");
        // A grid of equal sides seen from ten degrees above changes its slow axis at 45 degrees.
        assert_eq!(row["across"] == true, (number("azimuth") - 45.0).abs() < 1e-3, "{row}");
    }
    folder.adj("study accuracy phantom:noise --model --quick --edge 24 --quiet --json m.json --plot m.svg").done();
    let parts = rows(&folder, "m.json");
    let decibels = |part: &str, quality: &str| {
        let row = parts.iter().find(|row| row["part"] == part && row["quality"] == quality);
        row.unwrap_or_else(|| panic!("no {part} of {quality}"))["psnr"].as_f64().unwrap()
    };
    // At `reference` the model is what is left; at `draft` the arithmetic is.
    assert!(decibels("arithmetic", "reference") > decibels("model", "") + 10.0);
    assert!(decibels("arithmetic", "draft") < decibels("model", ""));
    assert!((decibels("all", "reference") - decibels("model", "")).abs() < 6.0);
}

#[test]
fn levels_have_a_row_for_every_size_and_choice() {
    let folder = Folder::new();
    folder.adj("build phantom:hydrogen --dims 64x64x64 --levels 2 -o a.adj").done();
    folder.adj("build phantom:noise --dims 40x40x40 --range 1.. --levels 1 -o b.adj").done();
    let table = folder.adj("study levels a.adj b.adj --quick --quiet --json l.json --csv l.csv --plot l.svg").done();
    assert!(table.contains("32 x 32 x 32") && table.contains("times fewer"), "{table}");
    let rows = rows(&folder, "l.json");
    // Level 0, auto at standard and at draft, and each level, at five sizes; then both files together.
    assert_eq!(rows.len(), 5 * (5 + 4 + 5));
    let number = |row: &Value, column: &str| row[column].as_f64().unwrap_or_else(|| panic!("{column}: {row}"));
    for row in rows.iter().filter(|row| row["set"] == "a") {
        let level = row["levels"].as_str().expect("a text");
        match row["drawn"].as_str().expect("a text") {
            "auto, standard" | "auto, draft" if row["pixels_a_voxel"] == 0.125 => assert_eq!(level, "2"),
            "auto, standard" | "auto, draft" => {}
            drawn => assert_eq!(drawn, format!("level {level}")),
        }
        assert!(number(row, "ms") > 0.0 && number(row, "db") > 10.0, "{row}");
        assert!(number(row, "least") <= number(row, "times_faster") * 1.000_001, "{row}");
        if row["drawn"] == "level 1" {
            let fewer = number(row, "times_fewer");
            assert!(fewer > 2.0 && fewer < 9.0, "{row}");
            assert!(
                number(row, "voxels_walked") < number(&rows[0], "voxels_walked") && number(row, "added_percent") > 0.0
            );
            assert!(2.0 * number(row, "lane_bytes") < number(&rows[0], "lane_bytes"), "{row}");
        }
    }
    assert!(
        std::fs::read_to_string(folder.file("l.csv")).unwrap().lines().count() == rows.len() + 1
            && folder.file("l.svg").exists()
    );
}

#[test]
fn a_zoom_shows_how_much_pictures_jump() {
    let folder = Folder::new();
    folder.adj("build phantom:hydrogen --dims 64x64x64 --levels 2 -o a.adj").done();
    let table = folder.adj("study levels a.adj --zoom --quiet --json z.json --plot z.svg").done();
    assert!(table.contains("switch") && table.contains("1 to 0") && folder.file("z.svg").exists(), "{table}");
    let rows = rows(&folder, "z.json");
    assert_eq!(rows.len(), 2 * 60);
    for row in &rows {
        let number = |column: &str| row[column].as_f64().unwrap_or_else(|| panic!("{column}: {row}"));
        assert!((number("change") - number("judged_change") - number("popping")).abs() < 1e-9, "{row}");
        // Between directions and sizes that limits were measured for.
        let least = if row["quality"] == "draft" { 29.5 } else { 37.5 };
        assert!(number("db") > least && number("popping") < number("allowed"), "{row}");
    }
    // Zoomed in until no level is drawn, and the pictures change by more than the walk's rounding.
    assert!(rows[0]["levels"] != "0" && rows[59]["levels"] == "0" && rows[30]["judged_change"].as_f64() > Some(1e-3));
}

#[test]
fn studies_refuse_what_they_cannot_do() {
    let folder = Folder::new();
    std::fs::write(folder.file("note.txt"), "no volume").unwrap();
    folder.small_arena("small.adj");
    for (line, parts) in [
        ("study speed phantom:shells --methods magic", ["magic", "traditional"]),
        ("study speed phantom:nothing", ["phantom", "gyroid"]),
        ("study walk note.txt", ["note.txt", "adj build"]),
        ("study memory missing.adj", ["missing.adj", "open"]),
        ("study memory --data missing", ["missing", "--data"]),
        ("study speed phantom:shells --edge 4", ["--edge", "8"]),
        ("study speed phantom:shells --frames 0", ["--frames", "1"]),
        ("study walk phantom:shells --repetitions 0", ["--repetitions", "1"]),
        ("study walk phantom:shells --views above", ["--views", "outside"]),
        ("study memory phantom:shells --plot memory.txt", ["memory.txt", ".svg"]),
        ("study memory phantom:shells --json missing/m.json", ["missing", "folder"]),
        ("study levels small.adj", ["small.adj", "adj trim --levels auto"]),
        ("study levels missing.adj", ["missing.adj", "open"]),
        ("study levels small.adj --repetitions 0", ["--repetitions", "1"]),
        ("study levels small.adj --zoom --quick", ["--zoom", "--quick"]),
        ("study accuracy small.adj", ["small.adj", "samples"]),
        ("study accuracy missing.nii", ["missing.nii", "cannot open"]),
        ("study accuracy phantom:shells --repetitions 0 --plot q.svg", ["--repetitions 0", "--plot"]),
        ("study accuracy note.txt", ["what is visible", "--range"]),
        ("study accuracy --all", ["--data <FOLDER>", "required"]),
        ("study accuracy --popping --model", ["--popping", "--model"]),
        ("study accuracy phantom:shells --model --edge 65", ["shells", "--edge"]),
        ("study accuracy phantom:shells --families magic", ["magic", "termination"]),
        ("study accuracy phantom:shells --repetitions 1001", ["--repetitions", "1000"]),
    ] {
        folder.adj(line).refused(&parts);
    }
}

#[test]
fn an_axis_that_layouts_cannot_hold_is_named_with_its_points() {
    let folder = Folder::new();
    folder.write("v.raw", &[9; 9_000]);
    folder.adj("build v.raw --dims 1x9000x1 --type u8 --range 1.. -q -o line.adj").done();
    folder.adj("study layouts line.adj -q").refused(&["axis y", "9000", "8192"]);
}
