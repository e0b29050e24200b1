//! SLC files of VolVis, put together here.

use adjsplat::volume::SampleType;
use adjsplat_readers::OpenOptions;

use super::damage::expect_no_panic;
use super::sample::{Folder, expect_known, expect_refused, known, read};

/// The header of the known volume: packing 0 or 1, then a picture of 2 x 1 in three planes.
fn header(packing: u8) -> Vec<u8> {
    [format!("11111\n4 3 2 8\n0.5 0.5 1.25\n1 2 0 {packing}\n2 1 X").as_bytes(), b"123456"].concat()
}

/// A slice as runs: every other run stored, so that both kinds occur, and the 0 at the end.
fn runs(slice: &[u8]) -> Vec<u8> {
    let mut packed = vec![0x80 | 5];
    packed.extend(&slice[..5]);
    for sample in &slice[5..] {
        packed.extend([1, *sample]);
    }
    packed.push(0);
    [format!("{} X", packed.len()).as_bytes(), &packed].concat()
}

#[test]
fn volvis_files_are_read_plain_and_in_run_lengths() {
    let folder = Folder::new();
    let samples = known(SampleType::U8);
    let plain = folder.write("plain.slc", &[&header(0), samples.bytes()]);
    let packed: Vec<u8> = samples.bytes().chunks(12).flat_map(runs).collect();
    // The bytes decide, not the name; white space may follow a slice.
    let packed = folder.write("packed", &[&header(1), &packed, b"\n"]);
    for path in [&plain, &packed] {
        let header = expect_known(path, SampleType::U8);
        assert_eq!((header.format, header.grid.spacing), ("SLC", [0.5, 0.5, 1.25]));
        assert_eq!(header.grid.unit.as_deref(), Some("mm"));
        expect_no_panic(path, 500);
    }
    // Runs longer than a row.
    let long = [&header(1)[..], b"3 X", &[12, 7, 0], b"\n4 X", &[11, 9, 1, 8, 0]].concat();
    let wrong = folder.write("short.slc", &[&long]);
    expect_refused(&wrong, &OpenOptions::new(), &["SLC sizes", "run lengths"]);
    let long = [&header(1)[..], b"3 X", &[12, 7, 0], b"\n5 X", &[11, 9, 1, 8, 0]].concat();
    let read = read(&folder.write("long.slc", &[&long])).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read.samples.bytes(), [[7; 12], [9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 9, 8]].concat());
}

#[test]
fn slc_files_that_lie_are_refused() {
    let folder = Folder::new();
    let refused = |text: &str, parts: &[&str]| {
        expect_refused(&folder.write("a.slc", &[text.as_bytes()]), &OpenOptions::new(), parts);
    };
    refused("11111 4 3 2 16 1 1 1 0 0 0 0 0 0 X", &["SLC header", "8 bits", "got 16"]);
    refused("11111 4 3 2 8 1 1 1 0 0 0 2 0 0 X", &["packing 0 or 1", "got 2"]);
    refused("11111 4 3 2 8 1 1 1 0 0 0 0 0 0 ", &["\"X\"", "the end"]);
    refused("11111 4 3 2 8 1 a 1 0 0 0 0 0 0 X", &["the number dy", "got \"a\""]);
    refused("11111 4 -3 2 8", &["the number ny", "-3"]);
    refused("11111 4 3 2 8 1 0 1 0 0 0 0 0 0 X", &["spacings above 0"]);
    refused("11111 4 3 2 8 1 1 1 0 0 0 0 99999999999 99999999999 X", &["SLC sizes"]);
    refused("11111 4 3 2 8 1 1 1 0 0 0 0 0 0 X123", &["expected 57 bytes", "got 36"]);
    refused("11111 70000 3 2 8 1 1 1 0 0 0 0 0 0 X", &["points along x", "65535"]);
    refused("11111 60000 60000 2 8 1 1 1 0 0 0 1 0 0 X3 X", &["SLC sizes", "can hold at most"]);
    let packed = |text: &str| format!("11111 4 3 2 8 1 1 1 0 0 0 1 0 0 X{text}");
    refused(&packed("3 X\u{c}a\0junk"), &["intact", "\"bytes X\""]);
    refused(&packed("9 X\u{c}a\0"), &["its end after 12 bytes"]);
    refused(&packed("9999999999999999999999 X\u{c}a"), &["intact", "no number of bytes"]);
    refused(&packed("3 X\rabc"), &["a run of 13 where a slice has 12"]);
    refused(&packed("3 X\u{b}a\0"), &["a run of 0 where a slice has 1"]);
    refused(&packed("2 X\u{c}a2 X\u{c}a2 X\u{c}a"), &["nothing after the last sample"]);
}
