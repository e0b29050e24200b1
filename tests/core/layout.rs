//! One layout, spelled twice: the tables of `formats/adj-1.md` against the structs of `arena::layout`.
//!
//! Fields by name, offset and length; the kinds of sections; the worked example's hex against the example file.
//! Cannot catch: a meaning that only the prose gives.

use std::mem::{offset_of, size_of};
use std::path::PathBuf;

use adjsplat::arena::TileRecord;
use adjsplat::arena::layout::{
    ALIGNMENT, FileHeader, MAGIC, MAX_SECTIONS, NARROW_LINE, OPTIONAL_KINDS, SectionEntry, SectionKind,
};
use adjsplat::arena::{Channels, Coverage, TileOrder};
use adjsplat::volume::Axis;

fn formats() -> PathBuf {
    adjsplat_tests::repository().join("formats")
}

fn specification() -> String {
    std::fs::read_to_string(formats().join("adj-1.md")).unwrap()
}

/// The rows of the table under `heading` whose first columns are called `column`, cell by cell.
fn table(text: &str, heading: &str, column: &str) -> Vec<Vec<String>> {
    let after = text.split_once(heading).unwrap_or_else(|| panic!("no heading {heading}")).1;
    let section = after.split("\n## ").next().unwrap();
    let cells = |line: &str| line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect();
    let first = format!("| {column} |");
    let rows = section.lines().skip_while(|line| !line.starts_with(&first));
    rows.take_while(|line| line.starts_with('|')).skip(2).map(cells).collect()
}

/// Name, offset, bytes of each field in the specification.
fn specified(text: &str, heading: &str) -> Vec<(String, usize, usize)> {
    let number = |cell: &str| cell.parse().unwrap_or_else(|_| panic!("not a number in {heading}: {cell}"));
    let field = |row: Vec<String>| (row[0].clone(), number(&row[1]), number(&row[2]));
    table(text, heading, "field").into_iter().map(field).collect()
}

/// Name, offset, bytes of each field of a Rust struct: a field ends where the next one starts.
macro_rules! fields {
    ($record:ty: $($field:ident)*) => {{
        let starts = [$((stringify!($field), offset_of!($record, $field))),*];
        let ends = starts.iter().skip(1).map(|&(_, at)| at).chain([size_of::<$record>()]);
        starts.iter().zip(ends).map(|(&(name, at), end)| (name.to_owned(), at, end - at)).collect::<Vec<_>>()
    }};
}

#[test]
fn the_specification_and_the_structs_agree_on_every_field() {
    let text = specification();
    let header = fields!(FileHeader: magic major minor section_count file_bytes header_xxh3 dims value_bits normal_bits
        magnitude_bits tile_order reserved_0 visible_voxels spacing origin direction value_low value_step
        magnitude_scale reserved_1);
    assert_eq!(specified(&text, "## 3. Header"), header);
    let entry = fields!(SectionEntry: kind axis element_bytes reserved offset bytes xxh3);
    assert_eq!(specified(&text, "## 4. Section table"), entry);
    let tile = fields!(TileRecord: tile_u tile_v first_line first_record occupancy low high);
    assert_eq!(specified(&text, "### 5.1 Tiles"), tile);
}

#[test]
fn types_have_the_lengths_that_the_tables_give() {
    let text = specification();
    for heading in ["## 3. Header", "## 4. Section table", "### 5.1 Tiles"] {
        for row in table(&text, heading, "field") {
            let (count, unit) = row[3].split_once(' ').unwrap_or(("1", &row[3]));
            let width: usize = match unit {
                "bytes" => continue,
                "u8" => 1,
                "u16" => 2,
                "u32" => 4,
                "u64" | "f64" => 8,
                other => panic!("{other} is no type of this format"),
            };
            let bytes: usize = row[2].parse().unwrap();
            assert_eq!(count.parse::<usize>().unwrap() * width, bytes, "{heading}: {}", row[0]);
        }
    }
}

#[test]
fn the_specification_and_the_library_agree_on_the_kinds_of_sections() {
    let text = specification();
    let kinds = table(&text, "## 4. Section table", "kind | name");
    let [description, limits] = SectionKind::OF_FILE;
    let all = [description].into_iter().chain(SectionKind::OF_LANES).chain([limits]);
    assert_eq!(kinds.len(), all.clone().count());
    let channels = Channels { value_bits: 16, normal_bits: 16, magnitude_bits: 8, coverage_bits: 8, coherence: false };
    for (row, kind) in kinds.iter().zip(all) {
        assert_eq!((&row[0], &row[1]), (&(kind as u16).to_string(), &kind.name().to_owned()));
        let on_no_lane = SectionKind::OF_FILE.contains(&kind);
        assert_eq!(row[2], if on_no_lane { "255" } else { "lane" });
        let width = |line_points| kind.element_bytes(channels, [line_points, 1, 1], Axis::X).to_string();
        let specified = match row[3].as_str() {
            "value_bits / 8" => "2".to_owned(),
            "normal_bits / 4" => "4".to_owned(),
            "magnitude_bits / 8" => "1".to_owned(),
            "2 if the lane's lines have at most 1,023 points, else 4" => {
                assert_eq!((NARROW_LINE, width(1_024)), (1_023, "4".to_owned()));
                "2".to_owned()
            }
            "1 for masks, 2 for words" => {
                let words = Channels { coverage_bits: 16, ..channels };
                assert_eq!(kind.element_bytes(words, [1; 3], Axis::X), 2);
                "1".to_owned()
            }
            number => number.to_owned(),
        };
        assert_eq!(width(NARROW_LINE), specified, "{}", kind.name());
    }
}

#[test]
fn numbers_in_the_prose_are_those_of_the_library() {
    let text = specification();
    let magic = MAGIC.map(|byte| format!("{byte:02x}")).join(" ");
    for said in [
        format!("{magic}. R1"),
        format!("`major` is {}.", adjsplat::arena::layout::MAJOR),
        format!("multiples of {ALIGNMENT} so that"),
        format!("Kinds from {OPTIONAL_KINDS:#x} on are *optional*"),
        format!("0, *Morton*: bit i of `tile_u` is bit {}i", TileOrder::Morton.key(2, 0) / 2),
        format!("Word {:#x} (s 127,", Coverage::WHOLE.code()),
        format!("2, *rows*: `{} tile_v + tile_u`", TileOrder::Rows.key(0, 1)),
        format!("0x{:x}", xxhash_rust::xxh3::xxh3_64(b"")),
    ] {
        assert!(text.contains(&said), "the specification does not say: {said}");
    }
    assert_eq!(MAX_SECTIONS, 1_024);
    assert!(text.contains("at most 1,024 sections"));
    for rule in 1..=26 {
        assert_eq!(text.matches(&format!("* **R{rule}** ")).count(), 1, "rule R{rule} stands once");
    }
}

#[test]
fn the_worked_example_is_the_example_file() {
    let text = specification();
    let dump = text.split_once("```hex\n").unwrap().1.split_once("```").unwrap().0;
    let file = std::fs::read(formats().join("examples/worked.adj")).unwrap();
    let mut bytes = vec![0; file.len()];
    for line in dump.lines() {
        let (at, row) = line.split_once("  ").unwrap();
        let at = usize::from_str_radix(at, 16).unwrap();
        for (byte, digits) in bytes[at..].iter_mut().zip(row.split_whitespace()) {
            *byte = u8::from_str_radix(digits, 16).unwrap();
        }
    }
    assert!(bytes == file, "regenerate the dump in formats/adj-1.md");
}
