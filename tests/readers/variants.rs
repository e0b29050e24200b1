//! The known volume in every variant of raw, NRRD, MetaImage and VTK.

use std::io::{Seek, SeekFrom, Write};

use adjsplat::volume::{SampleType, StatedLabel};
use adjsplat_readers::{Endian, OpenOptions, RawOptions, open};

use super::damage::{expect_no_panic, expect_truncations_refused};
use super::sample::{
    DIMS, ENDIANS, Folder, bytes, expect_known, expect_refused, gzip, known, read, read_with, text, zlib,
};

fn endian_name(endian: Endian) -> &'static str {
    if endian == Endian::Big { "big" } else { "little" }
}

const NRRD_TYPES: [&str; 8] = ["uint8", "signed char", "ushort", "int16_t", "unsigned int", "int", "float", "double"];
const MET_TYPES: [&str; 8] =
    ["MET_UCHAR", "MET_CHAR", "MET_USHORT", "MET_SHORT", "MET_UINT", "MET_INT", "MET_FLOAT", "MET_DOUBLE"];
const VTK_TYPES: [&str; 8] =
    ["unsigned_char", "char", "unsigned_short", "short", "unsigned_int", "int", "float", "double"];

#[test]
fn raw_is_read_in_every_type_and_order() {
    let folder = Folder::new();
    for ty in SampleType::ALL {
        for endian in ENDIANS {
            let packed = bytes(&known(ty), endian);
            let plain = folder.write("a.raw", &[b"head", &packed]);
            let zipped = folder.write("a.raw.gz", &[&gzip(&[b"head", &packed[..]].concat())]);
            let raw = RawOptions::new(DIMS, ty).endian(endian).skip(4);
            for path in [plain, zipped] {
                let options = OpenOptions::new().raw(raw.clone()).spacing([1.0, 2.0, 3.0]);
                let got = read_with(&path, &options).unwrap_or_else(|error| panic!("{error}"));
                assert_eq!(got.samples, known(ty), "{} {}", ty.name(), endian_name(endian));
                assert_eq!(got.header.grid.spacing, [1.0, 2.0, 3.0]);
            }
        }
    }
}

#[test]
fn nrrd_is_read_in_every_type_order_and_encoding() {
    let folder = Folder::new();
    for (ty, name) in SampleType::ALL.into_iter().zip(NRRD_TYPES) {
        for endian in ENDIANS {
            let packed = bytes(&known(ty), endian);
            let order = endian_name(endian);
            for (encoding, body) in [
                ("raw", packed.clone()),
                ("gzip", gzip(&packed)),
                ("gz", gzip(&packed)),
                ("ascii", text(&known(ty)).into()),
            ] {
                let head = format!(
                    "NRRD0005\n# a comment\ntype: {name}\ndimension: 3\nsizes: 4 3 2\nencoding: {encoding}\n\
                     endian: {order}\nkey:=value: any\nspacings: 1 2 0.5\n"
                );
                let attached = folder.write("a.nrrd", &[head.as_bytes(), b"\n", &body]);
                assert_eq!(expect_known(&attached, ty).grid.spacing, [1.0, 2.0, 0.5]);
                folder.write("body", &[&body]);
                let detached = folder.write("a.nhdr", &[head.as_bytes(), b"data file: body\n"]);
                expect_known(&detached, ty);
            }
        }
    }
}

/// They were ignored: the spacing was 1.
#[test]
fn nrrd_without_spacings_lies_between_its_axis_mins_and_maxs() {
    let folder = Folder::new();
    let frame = |fields: &str| {
        let header = format!("NRRD0005\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n{fields}\n");
        let path = folder.write("a.nrrd", &[header.as_bytes(), known(SampleType::U8).bytes()]);
        let grid = read(&path).unwrap_or_else(|error| panic!("{fields}: {error}")).header.grid;
        (grid.spacing, grid.origin)
    };
    let extents = "axis mins: 0 1 -4\naxis maxs: 6 4 NaN\n";
    assert_eq!(frame(&format!("{extents}centers: node cell node\n")), ([2.0, 1.0, 1.0], [0.0, 1.5, 0.0]));
    assert_eq!(frame(extents), ([1.5, 1.0, 1.0], [0.75, 1.5, 0.0]));
    assert_eq!(frame(&format!("{extents}spacings: 3 3 3\n")).0, [3.0; 3]);
    // With spacings, the mins are enough.
    let mins = "axis mins: 10 20 30\nspacings: 2 3 4\n";
    assert_eq!(frame(mins), ([2.0, 3.0, 4.0], [11.0, 21.5, 32.0]));
    assert_eq!(frame(&format!("{mins}centers: node cell node\n")).1, [10.0, 21.5, 30.0]);
    let turned = "axis mins: 6 1 0\naxis maxs: 0 4 2\n";
    assert_eq!(frame(&format!("{turned}spacings: 1 1 1\n")).0, [1.0; 3]);
    let header = format!("NRRD0005\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n{turned}\n");
    let path = folder.write("a.nrrd", &[header.as_bytes(), known(SampleType::U8).bytes()]);
    expect_refused(&path, &OpenOptions::new(), &["NRRD grid", "three spacings above 0", "got -1.5, 1, 1"]);
    let short = "NRRD0005\ntype: uint8\ndimension: 3\nsizes: 4 3 2\nencoding: raw\naxis mins: 0 1\n\n";
    let path = folder.write("a.nrrd", &[short.as_bytes(), known(SampleType::U8).bytes()]);
    expect_refused(&path, &OpenOptions::new(), &["NRRD axis mins", "3 numbers"]);
}

#[test]
fn nrrd_skips_lines_and_bytes_before_and_behind() {
    let folder = Folder::new();
    let packed = bytes(&known(SampleType::I16), Endian::Little);
    let head = "NRRD0004\r\ntype: short\r\ndimension: 3\r\nsizes: 4 3 2\r\nendian: little\r\n";
    let write = |name: &str, fields: &str, parts: &[&[u8]]| {
        folder.write("body", parts);
        folder.write(name, &[head.as_bytes(), fields.as_bytes(), b"datafile: body\r\n"])
    };
    let path = write("lines.nhdr", "encoding: raw\nline skip: 2\nbyteskip: 3\n", &[b"one\ntwo\nxyz", &packed]);
    expect_known(&path, SampleType::I16);
    let path = write("end.nhdr", "encoding: raw\nline skip: 1\nbyte skip: -1\n", &[b"no line at all", &packed]);
    expect_known(&path, SampleType::I16);
    let path = write("near_end.nhdr", "encoding: raw\nbyte skip: -4\n", &[b"any", &packed, b"xyz"]);
    expect_known(&path, SampleType::I16);
    // Lines are skipped before decompression, bytes after it.
    let inner = gzip(&[b"xyz", &packed[..]].concat());
    let path = write("gzip.nhdr", "encoding: gzip\nlineskip: 1\nbyteskip: 3\n", &[b"a line\n", &inner]);
    expect_known(&path, SampleType::I16);
    let numbers = text(&known(SampleType::I16)).replace(' ', ", ");
    let path = write("text.nhdr", "encoding: txt\nlineskip: 1\nbyteskip: 2\n", &[b"title\n//", numbers.as_bytes()]);
    expect_known(&path, SampleType::I16);
    // Attached, with a line end of two bytes and one more volume behind the first.
    let path = folder.write("attached.nrrd", &[head.as_bytes(), b"encoding: raw\r\n\r\n", &packed, &packed]);
    expect_known(&path, SampleType::I16);
}

#[test]
fn segments_of_a_nrrd_file_are_its_labels() {
    let folder = Folder::new();
    let labels = |dimensions: &str, keys: &str| {
        let header = format!("NRRD0004\ntype: uint8\n{dimensions}\nencoding: raw\n{keys}\n");
        let path = folder.write("a.seg.nrrd", &[header.as_bytes(), known(SampleType::U8).bytes()]);
        open(&path, &OpenOptions::new()).unwrap().labels().map(<[StatedLabel]>::to_vec)
    };
    const FLAT: &str = "dimension: 3\nsizes: 4 3 2";
    let label = |value, name: &str, colour| StatedLabel { value, name: name.into(), colour };
    let keys = "Segment0_ID:=Segment_1\nSegment0_Name:=left rib: first\nSegment0_LabelValue:=7\n\
        Segment0_Color:=0.2 1 0\nSegment0_Tags:=Segmentation.Status:inprogress|\nSegment0_Layer:=0\n\
        Segment10_LabelValue:=2\nSegment10_Color:=0 0.5 7\nSegment10_Name:=lung\n";
    let both = vec![label(2, "lung", [0, 128, 255]), label(7, "left rib: first", [51, 255, 0])];
    assert_eq!(labels(FLAT, keys), Some(both.clone()));
    // The background, a label without a colour and a repeated one are left out.
    let more = "Segment1_LabelValue:=0\nSegment1_Color:=1 1 1\nSegment2_LabelValue:=3\nSegment3_LabelValue:=7\n\
        Segment3_Color:=0 0 0\nSegment4_LabelValue:=x\nSegment4_Color:=0 0 0\n";
    assert_eq!(labels(FLAT, &[keys, more].concat()), Some(both));
    assert_eq!(labels(FLAT, "Segment0_LabelValue:=1\n"), Some(Vec::new()));
    assert_eq!(labels(FLAT, "Segmentation_ContainedRepresentationNames:=Binary labelmap|\n"), None);
    assert_eq!(labels(FLAT, ""), None);
    assert_eq!(labels("dimension: 4\nsizes: 4 3 2 1", keys), None);
    let layers = format!(
        "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 2 2 3 2\nkinds: list domain domain domain\n\
         space directions: none (1,0,0) (0,1,0) (0,0,1)\nspace: LPS\nencoding: raw\n{keys}\n"
    );
    let path = folder.write("layers.seg.nrrd", &[layers.as_bytes(), known(SampleType::U8).bytes()]);
    expect_refused(&path, &OpenOptions::new(), &["a segmentation in one layer", "export it as a labelmap"]);
}

#[test]
fn nrrd_that_bzip2_packed_is_read() {
    // Two streams, as parallel packers write them; packed by libbzip2.
    let file = adjsplat_tests::repository().join("tests/readers/compressed/u16-bzip2.nrrd");
    expect_known(&file, SampleType::U16);
    let folder = Folder::new();
    let content = std::fs::read(&file).expect("it is there");
    let path = folder.write("a.nrrd", &[&content]);
    expect_truncations_refused(&path, content.len(), SampleType::U16);
    expect_no_panic(&path, 500);
    let end = content.windows(2).position(|pair| pair == b"\n\n").expect("a blank line");
    let other = folder.write("b.nrrd", &[&content[..end + 2], b"no bzip2 at all, but some longer text"]);
    expect_refused(&other, &OpenOptions::new(), &["an intact compressed stream"]);
    let huge = String::from_utf8_lossy(&content[..end + 2]).replace("4 3 2", "60000 60000 60000");
    let huge = folder.write("c.nrrd", &[huge.as_bytes(), &content[end + 2..]]);
    expect_refused(&huge, &OpenOptions::new(), &["decompressed bytes", "can hold at most"]);
}

#[test]
fn nrrd_is_read_from_lists_and_patterns() {
    let folder = Folder::new();
    let packed = bytes(&known(SampleType::U16), Endian::Big);
    let head = "NRRD0004\ntype: ushort\ndimension: 3\nsizes: 4 3 2\nendian: big\nencoding: raw\n";
    for (names, tail, share) in [
        (vec!["s01.raw", "s02.raw"], "data file: s%02d.raw 1 2 1\n", 24),
        (vec!["b.raw", "a.raw"], "data file: LIST\nb.raw\na.raw\n", 24),
        (vec!["c7", "c5"], "data file: c%d 7 5 -2 2\n", 24),
        (vec!["r0", "r10", "r20", "r30", "r40", "r50"], "data file: r%d 0 59 10 1\n", 8),
        (vec!["whole a", "whole b"], "data file: LIST 3\nwhole a\nwhole b\n", 24),
        (vec!["one file"], "data file: one file\n", 48),
        (vec!["slab7"], "data file: slab%d 7 7 1 3\n", 48),
    ] {
        for (name, part) in names.iter().zip(packed.chunks(share)) {
            folder.write(name, &[part]);
        }
        let path = folder.write("a.nhdr", &[head.as_bytes(), tail.as_bytes()]);
        expect_known(&path, SampleType::U16);
    }
    // The same in gzip, a stream for each file.
    for (name, part) in ["z1", "z2"].iter().zip(packed.chunks(24)) {
        folder.write(name, &[&gzip(part)]);
    }
    let path = folder.write("z.nhdr", &[head.replace("raw", "gzip").as_bytes(), b"data file: z%d 1 2 1\n"]);
    expect_known(&path, SampleType::U16);
}

#[test]
fn nrrd_worlds_become_right_handed() {
    let folder = Folder::new();
    let grid_of = |fields: &str| {
        let head = format!("NRRD0005\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n{fields}\n");
        expect_known(&folder.write("a.nrrd", &[head.as_bytes(), known(SampleType::U8).bytes()]), SampleType::U8).grid
    };
    let axes =
        "space directions: (0,2,0) (3,0,0) (0,0,0.5)\nspace origin: (1,-2,3)\nspace units: \"mm\" \"mm\" \"mm\"\n";
    let ras = grid_of(&format!("space: right-anterior-superior\n{axes}"));
    assert_eq!((ras.spacing, ras.origin), ([2.0, 3.0, 0.5], [1.0, -2.0, 3.0]));
    assert_eq!(ras.direction, [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(ras.unit.as_deref(), Some("mm"));
    let lps = grid_of(&format!("space: LPS\n{axes}"));
    assert_eq!(lps.direction, [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(lps.origin, [-1.0, 2.0, 3.0]);
    for left in ["3D-left-handed", "left-anterior-superior"] {
        let grid = grid_of(&format!("space: {left}\n{axes}"));
        assert_eq!(grid.direction, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "{left}");
        assert_eq!(grid.origin, [-1.0, -2.0, 3.0], "{left}");
    }
    assert_eq!(grid_of("space: 3D-right-handed\n").direction, grid_of("").direction);
}

#[test]
fn fourth_dimension_is_chosen_by_index() {
    let folder = Folder::new();
    let packed = bytes(&known(SampleType::I32), Endian::Little);
    let other = vec![7; packed.len()];
    let mut files = vec![];
    let nrrd = "NRRD0004\ntype: int\ndimension: 4\nsizes: 4 3 2 2\nendian: little\nspacings: 1 1 1 nan\nencoding: ";
    let both = [&other[..], &packed].concat();
    files.push(folder.write("raw.nrrd", &[nrrd.as_bytes(), b"raw\n\n", &both]));
    files.push(folder.write("gzip.nrrd", &[nrrd.as_bytes(), b"gzip\n\n", &gzip(&both)]));
    let words = format!("{}{}", "1 ".repeat(24), text(&known(SampleType::I32)));
    files.push(folder.write("text.nrrd", &[nrrd.as_bytes(), b"text\n\n", words.as_bytes()]));
    for (i, part) in both.chunks(48).enumerate() {
        folder.write(&format!("part{i}"), &[part]);
    }
    files.push(folder.write("files.nhdr", &[nrrd.as_bytes(), b"raw\ndata file: part%d 0 3 1 3\n"]));
    // Four files that share out the last axis do not divide it; two halves of each volume do by their samples.
    let bad = files.pop().expect("just pushed");
    assert!(read(&bad).is_err());
    files.push(folder.write("files.nhdr", &[nrrd.as_bytes(), b"raw\ndata file: part%d 0 3 1 2\n"]));
    let mhd = "NDims = 4\nDimSize = 4 3 2 2\nElementType = MET_INT\nElementDataFile = LOCAL\n";
    files.push(folder.write("a.mha", &[mhd.as_bytes(), &both]));
    for path in files {
        let options = OpenOptions::new().volume_index(1);
        let got = read_with(&path, &options).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(got.samples, known(SampleType::I32), "{}", path.display());
        assert_ne!(read(&path).expect("the first volume").samples, known(SampleType::I32));
    }
}

#[test]
fn samples_beyond_four_gigabytes_are_reached_without_reading_those_before() {
    let folder = Folder::new();
    let head = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 4 3 2 250000000\nencoding: raw\n\n";
    let path = folder.write("sparse.nrrd", &[head.as_bytes()]);
    let mut file = std::fs::OpenOptions::new().write(true).open(&path).expect("just written");
    // All but the last volume is a hole that takes no room on the disk.
    file.seek(SeekFrom::Start(head.len() as u64 + 249_999_999 * 24)).expect("a place in a file");
    file.write_all(known(SampleType::U8).bytes()).expect("room for 24 bytes");
    let options = OpenOptions::new().volume_index(249_999_999);
    let got = read_with(&path, &options).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(got.samples, known(SampleType::U8));
    assert_eq!(read(&path).expect("the first volume").samples.bytes(), [0; 24]);
}

#[test]
fn meta_image_is_read_in_every_type_order_and_packing() {
    let folder = Folder::new();
    for (ty, name) in SampleType::ALL.into_iter().zip(MET_TYPES) {
        for endian in ENDIANS {
            let packed = bytes(&known(ty), endian);
            let order = if endian == Endian::Big { "True" } else { "False" };
            for (fields, body) in [
                ("BinaryData = True\n", packed.clone()),
                ("CompressedData = True\nCompressedDataSize = 1\n", zlib(&packed)),
                ("CompressedData = True\nCompressedDataSize = 999999\n", zlib(&packed)),
                ("CompressedData = True\n", gzip(&packed)),
                ("BinaryData = False\n", text(&known(ty)).into()),
            ] {
                let head = format!(
                    "ObjectType = Image\nNDims = 3\n{fields}BinaryDataByteOrderMSB = {order}\nDimSize = 4 3 2\n\
                     ElementSpacing = 1 2 0.5\nElementNumberOfChannels = 1\nElementType = {name}\nElementDataFile = "
                );
                let local = folder.write("a.mha", &[head.as_bytes(), b"LOCAL\n", &body]);
                assert_eq!(expect_known(&local, ty).grid.spacing, [1.0, 2.0, 0.5]);
                folder.write("the body.raw", &[&body]);
                let detached = folder.write("a.mhd", &[head.as_bytes(), b"the body.raw\n"]);
                expect_known(&detached, ty);
            }
        }
    }
}

#[test]
fn meta_image_longs_have_four_bytes() {
    let folder = Folder::new();
    for (ty, name) in [(SampleType::I32, "LONG"), (SampleType::U32, "ULONG")] {
        let head = format!("NDims = 3\nDimSize = 4 3 2\nElementType = MET_{name}\nElementDataFile = LOCAL\n");
        expect_known(&folder.write("a.mha", &[head.as_bytes(), &bytes(&known(ty), Endian::Little)]), ty);
    }
}

#[test]
fn data_files_whose_names_begin_with_list_are_no_lists() {
    let folder = Folder::new();
    folder.write("LISTing.raw", &[known(SampleType::U8).bytes()]);
    for (name, head) in [
        ("a.mhd", "NDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\nElementDataFile = LISTing.raw\n"),
        ("a.nhdr", "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\ndata file: LISTing.raw\n"),
    ] {
        expect_known(&folder.write(name, &[head.as_bytes()]), SampleType::U8);
    }
}

#[test]
fn meta_image_is_read_from_lists_patterns_and_behind_headers() {
    let folder = Folder::new();
    let packed = bytes(&known(SampleType::I16), Endian::Big);
    let head = "NDims = 3\nDimSize = 4 3 2\nElementByteOrderMSB = True\nElementSize = 2 2 2\nElementType = MET_SHORT\n";
    for (names, tail, share) in [
        (vec!["s001.raw", "s002.raw"], "ElementDataFile = s%03d.raw 1 2 1\n", 24),
        (vec!["t1", "t2"], "ElementDataFile = t%d\n", 24),
        (vec!["u4", "u5"], "ElementDataFile = u%d 4\n", 24),
        (vec!["b.raw", "a.raw"], "ElementDataFile = LIST\nb.raw\n\na.raw\n", 24),
        (vec!["r1", "r2", "r3", "r4", "r5", "r6"], "ElementDataFile = LIST 1D\nr1\nr2\nr3\nr4\nr5\nr6\n", 8),
        (vec!["whole"], "ElementDataFile = LIST 3D\nwhole\n", 48),
    ] {
        for (name, part) in names.iter().zip(packed.chunks(share)) {
            folder.write(name, &[part]);
        }
        let path = folder.write("a.mhd", &[head.as_bytes(), tail.as_bytes()]);
        assert_eq!(expect_known(&path, SampleType::I16).grid.spacing, [2.0; 3]);
    }
    folder.write("headed", &[b"12345", &packed]);
    for size in ["5", "-1"] {
        let tail = format!("HeaderSize = {size}\nElementDataFile = headed\n");
        expect_known(&folder.write("a.mhd", &[head.as_bytes(), tail.as_bytes()]), SampleType::I16);
    }
}

#[test]
fn meta_image_worlds_become_right_handed() {
    let folder = Folder::new();
    let grid_of = |fields: &str| {
        let head = format!(
            "NDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\n{fields}\nDistanceUnits = mm\nElementDataFile = LOCAL\n"
        );
        expect_known(&folder.write("a.mha", &[head.as_bytes(), known(SampleType::U8).bytes()]), SampleType::U8).grid
    };
    let half_turn = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]];
    for identity in
        ["", "TransformMatrix = 1 0 0 0 1 0 0 0 1", "AnatomicalOrientation = RAI", "Rotation = 1 0 0 0 1 0 0 0 1"]
    {
        let grid = grid_of(&format!("{identity}\nOffset = 1 2 3"));
        assert_eq!((grid.direction, grid.origin), (half_turn, [-1.0, -2.0, 3.0]), "{identity}");
        assert_eq!(grid.unit.as_deref(), Some("mm"));
    }
    // From left, posterior, inferior: to the right, the front, the head.
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert_eq!(grid_of("AnatomicalOrientation = LPI").direction, upright);
    // The matrix has the word where both are there.
    assert_eq!(grid_of("AnatomicalOrientation = LPI\nOrientation = 1 0 0 0 1 0 0 0 1").direction, half_turn);
    assert_eq!(grid_of("TransformMatrix = 0 1 0 0 0 1 1 0 0").direction[0], [0.0, -1.0, 0.0]);
}

#[test]
fn vtk_is_read_in_every_type_as_bytes_and_text() {
    let folder = Folder::new();
    for (ty, name) in SampleType::ALL.into_iter().zip(VTK_TYPES) {
        let (packed, numbers) = (bytes(&known(ty), Endian::Big), text(&known(ty)));
        for (coding, body) in [("BINARY", packed.as_slice()), ("ASCII", numbers.as_bytes())] {
            for table in ["LOOKUP_TABLE default\n", ""] {
                let head = format!(
                    "# vtk DataFile Version 5.1\ntitle\n{coding}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\n\
                     SPACING 1 2 0.5\nORIGIN 7 8 9\nPOINT_DATA 24\nSCALARS s {name} 1\n{table}"
                );
                let grid = expect_known(&folder.write("a.vtk", &[head.as_bytes(), body, b"\nrest"]), ty).grid;
                assert_eq!((grid.spacing, grid.origin), ([1.0, 2.0, 0.5], [7.0, 8.0, 9.0]));
            }
        }
    }
}

#[test]
fn vtk_arrays_before_the_scalars_are_skipped() {
    let folder = Folder::new();
    let packed = bytes(&known(SampleType::F32), Endian::Big);
    // Line ends and keywords inside the skipped bytes must not be taken for text.
    let junk = |bytes: usize| b"\nSCALARS x float\n".iter().copied().cycle().take(bytes).collect::<Vec<u8>>();
    let parts: Vec<Vec<u8>> = vec![
        b"# vtk datafile Version 1.0\n\n\n\nbinary\n\ndataset structured_points\nFIELD FieldData 2\n".to_vec(),
        b"TimeValue 1 1 double\n".to_vec(),
        junk(8),
        b"\nMETADATA\nINFORMATION 1\nNAME a LOCATION b\nDATA 1 2\n\nbits 3 3 bit\n".to_vec(),
        junk(2),
        b"\naspect_ratio 1 1 3\ndimensions 4 3 2\ncell_data 6\nSCALARS cells int\nLOOKUP_TABLE default\n".to_vec(),
        junk(24),
        b"\npoint_data 24\nCOLOR_SCALARS c 4\n".to_vec(),
        junk(96),
        b"\nVECTORS v float\n".to_vec(),
        junk(288),
        b"\nSCALARS pairs short 2\nLOOKUP_TABLE table\n".to_vec(),
        junk(96),
        b"\nLOOKUP_TABLE table 3\n".to_vec(),
        junk(12),
        b"\nTEXTURE_COORDINATES t 2 double\n".to_vec(),
        junk(384),
        b"\nTENSORS t unsigned_char\n".to_vec(),
        junk(216),
        b"\n\nscalars s Float\nlookup_table default\n".to_vec(),
        packed,
    ];
    let parts: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    let grid = expect_known(&folder.write("a.vtk", &parts), SampleType::F32).grid;
    assert_eq!(grid.spacing, [1.0, 1.0, 3.0]);

    let head = "# vtk DataFile Version 2.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nFIELD f 1\n\
                n 2 2 int\n1 2\n3 4\nPOINT_DATA 24\nNORMALS n float\n";
    let skipped = "0 0 1\n".repeat(24);
    let tail = format!("SCALARS s float\n\nLOOKUP_TABLE default\n{}", text(&known(SampleType::F32)));
    let path = folder.write("b.vtk", &[head.as_bytes(), skipped.as_bytes(), tail.as_bytes()]);
    expect_known(&path, SampleType::F32);
}

/// VTK writes scalars of u8 in no other way; as text they are shares of 255.
#[test]
fn vtk_colour_scalars_of_one_component_are_read_as_u8() {
    let folder = Folder::new();
    let packed = known(SampleType::U8);
    let head = |coding: &str, array: &str| {
        format!(
            "# vtk DataFile Version 5.1\nt\n{coding}\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nPOINT_DATA 24\n{array}\n"
        )
    };
    expect_known(
        &folder.write("a.vtk", &[head("BINARY", "COLOR_SCALARS s 1").as_bytes(), packed.bytes()]),
        SampleType::U8,
    );
    // As many digits as VTK writes.
    let shares: String = packed.bytes().iter().map(|byte| format!("{:.6} ", f32::from(*byte) / 255.0)).collect();
    let ascii = head("ASCII", "color_scalars s 1");
    expect_known(&folder.write("b.vtk", &[ascii.as_bytes(), shares.as_bytes(), b"\nVECTORS v int"]), SampleType::U8);
    let beyond = folder.write("c.vtk", &[ascii.as_bytes(), shares.replace("1.0", "1.1").as_bytes()]);
    expect_refused(&beyond, &OpenOptions::new(), &["a number from 0 to 1", "1.1"]);
    let others = "COLOR_SCALARS c 3\n".to_string() + &"1 ".repeat(72) + "\nFIELD f 1\nd 1 24 int\n" + &"5 ".repeat(24);
    let path = folder.write("d.vtk", &[head("ASCII", &others).as_bytes()]);
    let named = ["point array \"c\" of 3 components", "point FIELD array \"d\" of 1 component"];
    expect_refused(&path, &OpenOptions::new(), &named);
}

#[test]
fn numbers_beyond_the_dimensions_of_vtk_text_are_refused() {
    let folder = Folder::new();
    let numbers = text(&known(SampleType::I16));
    let head = "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nPOINT_DATA 24\n\
                SCALARS s short\nLOOKUP_TABLE default\n";
    let vti = "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 3 0 2 0 1\"><Piece><PointData>\
               <DataArray type=\"Int16\" format=\"ascii\">";
    for (name, head, rest) in
        [("a.vtk", head, "SCALARS t int\nLOOKUP_TABLE default\n1 2 3"), ("a.vti", vti, "</DataArray>")]
    {
        let write =
            |more: &str| folder.write(name, &[head.as_bytes(), numbers.as_bytes(), more.as_bytes(), rest.as_bytes()]);
        expect_known(&write(" \n"), SampleType::I16);
        for more in ["7 ", "\n-7\n", " .5 8 9\n"] {
            expect_refused(
                &write(more),
                &OpenOptions::new(),
                &["nothing after the last sample", "check the dimensions"],
            );
        }
    }
}

#[test]
fn flat_images_are_one_slice() {
    let folder = Folder::new();
    let packed = known(SampleType::U8);
    let nrrd = "NRRD0001\ntype: uchar\ndimension: 2\nsizes: 6 4\nencoding: raw\nspace: LPS\n\
                space directions: (2,0,0) (0,2,0)\n\n";
    let mha = "NDims = 2\nDimSize = 6 4\nElementType = MET_UCHAR\nTransformMatrix = 0 1 1 0\nElementDataFile = LOCAL\n";
    for (name, head) in [("a.nrrd", nrrd), ("a.mha", mha)] {
        let got = read(&folder.write(name, &[head.as_bytes(), packed.bytes()])).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(got.header.grid.dims, [6, 4, 1]);
        assert_eq!(got.samples, packed, "{name}");
    }
}

#[test]
fn format_is_found_from_the_content_whatever_the_name() {
    let folder = Folder::new();
    let packed = known(SampleType::U8);
    for (head, format) in [
        ("NRRD0001\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n\n", "NRRD"),
        ("Comment = x\nNDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n", "MetaImage"),
        (
            "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nPOINT_DATA 24\n\
             SCALARS s unsigned_char\nLOOKUP_TABLE default\n",
            "VTK legacy",
        ),
    ] {
        let path = folder.write("volume.nii", &[head.as_bytes(), packed.bytes()]);
        assert_eq!(expect_known(&path, SampleType::U8).format, format);
    }
}

#[test]
fn spacing_is_replaced_where_the_caller_knows_better() {
    let folder = Folder::new();
    let head = "NRRD0001\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\nspacings: 0 nan -1\n\n";
    let path = folder.write("a.nrrd", &[head.as_bytes(), known(SampleType::U8).bytes()]);
    let options = OpenOptions::new().spacing([1.0, 2.0, 3.0]);
    let got = read_with(&path, &options).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(got.header.grid.spacing, [1.0, 2.0, 3.0]);
}
