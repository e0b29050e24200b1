//! `adj study speed`, `walk` and `memory`: what they print and write, in little time.

use std::collections::BTreeSet;

use serde_json::Value;

use super::harness::Folder;

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
fn studies_refuse_what_they_cannot_do() {
    let folder = Folder::new();
    std::fs::write(folder.file("note.txt"), "no volume").unwrap();
    for (line, parts) in [
        ("study speed phantom:shells --methods magic", ["magic", "traditional"]),
        ("study speed phantom:nothing", ["phantom", "gyroid"]),
        ("study walk note.txt", ["note.txt", "adj build"]),
        ("study memory missing.adj", ["missing.adj", "open"]),
        ("study memory --data missing", ["missing", "--data"]),
        ("study speed phantom:shells --edge 4", ["--edge", "8"]),
        ("study speed phantom:shells --frames 0", ["--frames", "1"]),
        ("study walk phantom:shells --repetitions 0", ["--repetitions", "1"]),
        ("study memory phantom:shells --plot memory.txt", ["memory.txt", ".svg"]),
        ("study memory phantom:shells --json missing/m.json", ["missing", "folder"]),
    ] {
        folder.adj(line).refused(&parts);
    }
}
