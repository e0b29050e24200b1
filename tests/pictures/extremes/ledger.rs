//! The table of cases in docs/NUMERICS.md names tests that exist.

use std::collections::HashSet;
use std::path::Path;

/// Functions marked as tests in the files below `folder`, as `tests/path.rs::name`.
fn tests_in(folder: &Path, found: &mut HashSet<String>) {
    let root = adjsplat_tests::repository();
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            tests_in(&entry, found);
        } else if entry.extension().is_some_and(|extension| extension == "rs") {
            let file = entry.strip_prefix(&root).unwrap().to_string_lossy().replace('\\', "/");
            let text = std::fs::read_to_string(&entry).unwrap();
            let mut is_marked = false;
            for line in text.lines().map(str::trim) {
                is_marked |= line == "#[test]";
                if let Some(rest) = line.strip_prefix("fn ")
                    && is_marked
                {
                    let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                    found.insert(format!("{file}::{name}"));
                    is_marked = false;
                }
            }
        }
    }
}

#[test]
fn every_case_names_tests_that_exist() {
    let root = adjsplat_tests::repository();
    let mut known = HashSet::new();
    tests_in(&root.join("tests"), &mut known);
    tests_in(&root.join("src"), &mut known);
    assert!(known.contains("tests/pictures/extremes/ledger.rs::every_case_names_tests_that_exist"), "tests are found");
    let page = std::fs::read_to_string(root.join("docs/NUMERICS.md")).unwrap();
    let table = page.split("<!-- cases -->").nth(1).expect("the page marks its table of cases");
    let mut cases = Vec::new();
    for row in table.lines().filter(|line| line.starts_with("| ")) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        let Some(case) = cells.first().and_then(|cell| cell.parse::<u32>().ok()) else { continue };
        let [_, _, tests] = cells[..] else { panic!("case {case}: number, what must come of it, tests: {row}") };
        let names: Vec<&str> = tests.split('`').skip(1).step_by(2).collect();
        assert!(!names.is_empty(), "case {case} has no test");
        for name in names {
            // `tests/` and `.rs` go without saying.
            let (file, function) = name.split_once("::").unwrap_or_else(|| panic!("case {case}: {name}"));
            let full = if file.starts_with("src/") {
                format!("{file}.rs::{function}")
            } else {
                format!("tests/{file}.rs::{function}")
            };
            assert!(known.contains(&full), "case {case}: there is no test {full}");
        }
        cases.push(case);
    }
    assert!(cases.is_sorted(), "{cases:?}");
    let missing: Vec<u32> = (1..=90).filter(|case| !cases.contains(case)).collect();
    assert!(missing.is_empty(), "cases without a row: {missing:?}");
    // Other places of the page name tests in the same way.
    for name in page.split('`').skip(1).step_by(2).filter(|text| text.contains("::") && !text.contains(' ')) {
        let (file, function) = name.split_once("::").unwrap();
        let full = if file.starts_with("src/") {
            format!("{file}.rs::{function}")
        } else {
            format!("tests/{file}.rs::{function}")
        };
        assert!(known.contains(&full), "there is no test {full}");
    }
}
