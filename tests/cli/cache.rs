//! `adj study cache` and `adj study layouts`: what they print and write.

use super::harness::{Folder, Runs as _};

#[test]
fn every_structure_order_and_level_has_a_row() {
    let folder = Folder::new();
    let line = "study cache phantom:shells --quick --edge 24 --quiet --json rows.json --csv rows.csv --plot m.svg --curves c.svg";
    let table = folder.adj(line).done();
    for part in ["times compulsory worst", "adjacency_b", "lines per 1k touches", "hardware counters: "] {
        assert!(table.contains(part), "{part} is not in\n{table}");
    }
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.file("rows.json")).unwrap()).unwrap();
    let rows = json["rows"].as_array().unwrap();
    let layouts: std::collections::BTreeSet<&str> = rows.iter().map(|row| row["layout"].as_str().unwrap()).collect();
    assert!(layouts.contains("adjsplat") && layouts.contains("traditional"));
    assert_eq!(rows.len(), layouts.len() * 7 * 3, "seven orders, three levels");
    for row in rows {
        let number = |name: &str| row[name].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
        // First touches miss at every level, and no walk fetches fewer lines than its bytes fill.
        assert!(number("misses_per_visible") >= number("compulsory_per_visible"), "{row}");
        assert!(number("overfetch") >= 1.0, "{row}");
        assert!(row["set"] == "shells 24^3" && row["order"].as_str().unwrap().len() == 6, "{row}");
    }
    // Caches of the default sizes hold all of so small a set but the first.
    let at = |level: &str, name: &str| {
        let found = rows.iter().find(|row| row["layout"] == "adjsplat" && row["level"] == level).unwrap();
        found[name].as_f64().unwrap()
    };
    assert!(at("L1", "misses") >= at("L2", "misses") && at("L2", "misses") == at("L3", "misses"));
    assert_eq!(std::fs::read_to_string(folder.file("rows.csv")).unwrap().lines().count(), rows.len() + 1);
    for plot in ["m.svg", "c.svg"] {
        assert!(std::fs::read_to_string(folder.file(plot)).unwrap().starts_with("<svg"), "{plot}");
    }
}

#[test]
fn forms_of_ours_stand_side_by_side() {
    let folder = Folder::new();
    let line = "study cache phantom:vessels --edge 32 --quiet --methods adjsplat --orders +z+y+x,-y-x+z \
                --tile-order morton,hilbert,rows --channels steps,value+normal --l2 none --l3 none --l1 4KiB/full \
                --line 32 --tlb 4/2 --json rows.json";
    folder.adj(line).done();
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.file("rows.json")).unwrap()).unwrap();
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 3 * 2 * 2);
    let misses = |layout: &str, channels: &str| {
        let wanted = rows.iter().filter(|row| row["layout"] == layout && row["channels"] == channels);
        wanted.map(|row| row["misses"].as_u64().unwrap()).sum::<u64>()
    };
    for layout in ["adjsplat", "adjsplat-hilbert", "adjsplat-rows"] {
        assert!(misses(layout, "steps") > 0 && misses(layout, "steps") < misses(layout, "value+normal"), "{layout}");
    }
}

#[test]
fn one_walk_goes_to_a_file_or_past_counters() {
    let folder = Folder::new();
    let one = "study cache phantom:shells --edge 24 --quiet --methods adjsplat --orders +z+y+x";
    folder.adj(&format!("{one} --trace walk.trace --counters")).done();
    let bytes = std::fs::read(folder.file("walk.trace")).unwrap();
    assert!(bytes.starts_with(b"adjtrace\x01\x00") && bytes.len().is_multiple_of(8) && bytes.len() > 10_000);
    let visited = |walks: u32| folder.adj(&format!("{one} --walks {walks}")).done();
    assert_eq!(visited(0).trim(), "0 voxels visited");
    let count = |text: String| text.split(' ').next().unwrap().parse::<u64>().unwrap();
    assert_eq!(count(visited(3)), 3 * count(visited(1)));
    folder
        .adj("study cache phantom:shells --edge 24 --trace t.trace")
        .refused(&["--trace", "one method and one order"]);
    assert_eq!(folder.names(), ["walk.trace"]);
}

#[test]
fn wrong_words_are_refused_with_the_right_ones() {
    let folder = Folder::new();
    let refused = |flags: &str, parts: &[&str]| {
        folder.adj(&format!("study cache phantom:shells --edge 24 {flags}")).refused(parts);
    };
    refused("--l1 32KiB/7", &["32KiB/7", "32KiB/8"]);
    refused("--line 63", &["line", "power of two"]);
    refused("--orders sideways", &["--orders", "+z-y+x"]);
    refused("--channels all", &["--channels", "value+normal"]);
    refused("--tile-order snake", &["--tile-order", "hilbert"]);
    refused("--methods ours", &["adjsplat"]);
    refused("--curves c.gif", &["c.gif", ".svg or .png"]);
    refused("--methods adjsplat --orders +z+y+x --trace gone/t", &["gone"]);
}

#[test]
fn layouts_are_held_against_the_shipped_one() {
    let folder = Folder::new();
    let line = "study layouts phantom:vessels --edge 24 --quick --repetitions 1 --quiet --json rows.json --plot l.svg";
    folder.adj(line).done();
    let json: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.file("rows.json")).unwrap()).unwrap();
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(rows[0]["layout"], "8-morton-arrays-end2-own-xyz");
    for name in ["times_bytes", "times_l1", "times_l2", "times_ns"] {
        assert_eq!(rows[0][name], 1.0, "the shipped layout against itself: {name}");
    }
    let of = |layout: &str, name: &str| {
        let found = rows.iter().find(|row| row["layout"] == layout).unwrap_or_else(|| panic!("no {layout}"));
        found[name].as_f64().unwrap()
    };
    let third =
        of("8-morton-arrays-end2-own-x", "bytes_per_visible") / of("8-morton-arrays-end2-own-xyz", "bytes_per_visible");
    // Lanes differ by their directories alone, which are a few percent.
    assert!((third - 1.0 / 3.0).abs() < 0.03, "{third}");
    assert!(of("8-morton-arrays-end2-own-x", "exact_orders") < of("8-morton-arrays-end2-own-xy", "exact_orders"));
}
