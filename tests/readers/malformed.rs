//! Files that must be refused, each with a line that helps; and damaged ones, which must not panic.

use std::path::{Path, PathBuf};

use adjsplat::error::Error;
use adjsplat::volume::{SampleType, Samples};
use adjsplat_readers::{Endian, OpenOptions, RawOptions, open};

use super::damage::{expect_no_panic_with, rewrite};
use super::nifti::Nifti;
use super::sample::{DIMS, Folder, bytes, expect_known, expect_refused, gzip, known, read, read_with, text, zlib};

fn refused(path: &Path, parts: &[&str]) {
    expect_refused(path, &OpenOptions::default(), parts);
}

fn raw_options(dims: [u64; 3], ty: SampleType) -> OpenOptions {
    OpenOptions::new().raw(RawOptions::new(dims, ty))
}

const NRRD: &str = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n";
const MHA: &str = "NDims = 3\nDimSize = 4 3 2\nElementType = MET_UCHAR\n";
const VTK: &str = "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nSPACING 1 1 1\n\
                   POINT_DATA 24\nSCALARS s unsigned_char\nLOOKUP_TABLE default\n";

#[test]
fn files_that_are_not_there_or_no_files() {
    let folder = Folder::new();
    let missing = folder.path().join("none.nrrd");
    refused(&missing, &["cannot open", "none.nrrd"]);
    assert!(matches!(read(&missing), Err(Error::Io { action: "open", .. })));
    refused(folder.path(), &["is a folder without files"]);
    refused(&folder.write("empty.nii", &[]), &["an empty file"]);
    expect_refused(&folder.write("empty.raw", &[]), &raw_options(DIMS, SampleType::U8), &["an empty file"]);
}

#[test]
fn unknown_formats_are_answered_with_the_known_ones() {
    let folder = Folder::new();
    for (name, content) in
        [("a.raw", &b"abcdef"[..]), ("a", b"x = y\n"), ("a.gz", &gzip(b"hello")), ("b.gz", b"\x1f\x8b")]
    {
        refused(
            &folder.write(name, &[content]),
            &["no format known", ".nhdr", ".mha", ".nii.gz", ".vtk", "`OpenOptions::raw`"],
        );
    }
    // The name alone leads to the reader that says what is wrong.
    refused(&folder.write("a.nrrd", &[b"abc"]), &["NRRD magic", "NRRD0005", "abc"]);
    refused(&folder.write("b.nrrd", &[b"NRRD0009\n"]), &["NRRD0005", "NRRD0009"]);
    refused(&folder.write("a.mhd", &[b"abc"]), &["Key = value"]);
    refused(&folder.write("a.nii", &[b"abcdefgh"]), &["348 or 540"]);
    refused(&folder.write("a.vtk", &[b"abc"]), &["# vtk DataFile Version"]);
    refused(&folder.write("a.img", &[b"abc"]), &["half of a pair", "a.hdr"]);
    let mut analyze = vec![0; 348];
    analyze[..4].copy_from_slice(&348i32.to_le_bytes());
    folder.write("c.img", &[b"abc"]);
    let mut half = Nifti::new(1, Endian::Little, SampleType::U8);
    half.pair();
    refused(&folder.write("half.nii", &[half.bytes()]), &["header of a NIfTI pair", "rename"]);
    refused(&folder.write("half.hdr", &[half.bytes()]), &["half of a pair", "half.img"]);
    refused(&folder.write("c.hdr", &[&analyze]), &["NIfTI magic", "ANALYZE"]);
}

#[test]
fn raw_sizes_that_do_not_match_are_answered_with_those_that_do() {
    let folder = Folder::new();
    let path = folder.write("a.raw", &[&[0; 48]]);
    let ask = |dims, ty, parts: &[&str]| expect_refused(&path, &raw_options(dims, ty), parts);
    ask([4, 3, 2], SampleType::U8, &["24 bytes", "48 bytes", "`type` u16 or i16", "`dims` 4x3x4", "`skip` 24"]);
    ask([4, 3, 4], SampleType::I16, &["96 bytes", "48 bytes", "`type` u8 or i8", "`dims` 4x3x2"]);
    ask([7, 7, 7], SampleType::F64, &["2744 bytes", "got 48 bytes"]);
    let cube = folder.write("cube.raw", &[&[0; 125]]);
    expect_refused(&cube, &raw_options([6, 5, 5], SampleType::U8), &["150 bytes", "`dims` 5x5x5"]);
    let skip = RawOptions::new(DIMS, SampleType::U8).skip(100);
    let skip = OpenOptions::new().raw(skip);
    expect_refused(&path, &skip, &["after 100 skipped", "got 0 bytes"]);
    expect_refused(&path, &raw_options([0, 3, 2], SampleType::U8), &["at least one point", "0 along x"]);
}

#[test]
fn dimensions_beyond_the_limit_are_refused_before_anything_is_allocated() {
    let folder = Folder::new();
    let path = folder.write("a.raw", &[&[0; 48]]);
    for dims in [[65_536, 1, 1], [4_000_000_000, 4_000_000_000, 1], [1, 1, u64::MAX]] {
        expect_refused(&path, &raw_options(dims, SampleType::F64), &["points along", "65535"]);
    }
    let nrrd = NRRD.replace("4 3 2", "4000000000 4000000000 1");
    refused(&folder.write("a.nrrd", &[nrrd.as_bytes(), b"\nabc"]), &["points along x", "4000000000", "65535"]);
    let mha = MHA.replace("4 3 2", "65536 1 1");
    refused(&folder.write("a.mha", &[mha.as_bytes(), b"ElementDataFile = LOCAL\nabc"]), &["65536", "65535"]);
    let vtk = VTK.replace("4 3 2", "99999999999 1 1");
    refused(&folder.write("a.vtk", &[vtk.as_bytes(), b"abc"]), &["99999999999", "65535"]);
    let mut nifti = Nifti::new(2, Endian::Little, SampleType::U8);
    nifti.dim(1, i64::MAX);
    refused(&folder.write("a.nii", &[nifti.bytes(), b"abc"]), &["9223372036854775807", "65535"]);
    // 65,535 cubed is allowed, but not in a file of a few bytes; nor volumes beyond 64 bits.
    expect_refused(&path, &raw_options([65_535; 3], SampleType::F64), &["2251696736043000 bytes", "48 bytes"]);
    let head = "NRRD0004\ntype: uchar\ndimension: 5\nsizes: 65535 65535 65535 4000000000 4000000000\nencoding: raw\n\n";
    refused(&folder.write("b.nrrd", &[head.as_bytes()]), &["all volumes"]);
    let head = head.replace("dimension: 5", "dimension: 6").replace("\nencoding", " 4000000000\nencoding");
    refused(&folder.write("b.nrrd", &[head.as_bytes()]), &["number of volumes"]);
}

#[test]
fn compressed_files_too_small_for_their_volume_are_refused_before_reading() {
    let folder = Folder::new();
    let head = NRRD.replace("raw", "gzip").replace("4 3 2", "65535 65535 65535");
    let path = folder.write("a.nrrd", &[head.as_bytes(), b"\n", &gzip(&[0; 1000])]);
    refused(&path, &["281462092005375 decompressed bytes", "can hold at most"]);
    let mut nifti = Nifti::new(1, Endian::Little, SampleType::F64);
    nifti.dim(1, 30_000);
    nifti.dim(2, 30_000);
    refused(&folder.write("a.nii.gz", &[&gzip(nifti.bytes())]), &["decompressed bytes", "can hold at most"]);
}

#[test]
fn spacings_that_are_none_are_refused_with_the_way_out() {
    let folder = Folder::new();
    let data = known(SampleType::U8);
    for bad in ["0", "-1", "nan", "inf"] {
        let nrrd = format!("{NRRD}spacings: 1 {bad} 1\n\n");
        refused(
            &folder.write("a.nrrd", &[nrrd.as_bytes(), data.bytes()]),
            &["spacings above 0", "`OpenOptions::spacing`"],
        );
        let mha = format!("{MHA}ElementSpacing = 1 1 {bad}\nElementDataFile = LOCAL\n");
        refused(
            &folder.write("a.mha", &[mha.as_bytes(), data.bytes()]),
            &["spacings above 0", "`OpenOptions::spacing`"],
        );
        let vtk = VTK.replace("SPACING 1", &format!("SPACING {bad}"));
        refused(
            &folder.write("a.vtk", &[vtk.as_bytes(), data.bytes()]),
            &["spacings above 0", "`OpenOptions::spacing`"],
        );
        let mut nifti = Nifti::new(1, Endian::Little, SampleType::U8);
        nifti.pixdim(2, bad.parse().expect("a number"));
        refused(
            &folder.write("a.nii", &[nifti.bytes(), data.bytes()]),
            &["spacings above 0", "`OpenOptions::spacing`"],
        );
        let path = folder.write("a.raw", &[data.bytes()]);
        let given = raw_options(DIMS, SampleType::U8).spacing([1.0, 1.0, bad.parse().expect("a number")]);
        expect_refused(&path, &given, &["spacing: is", "above 0"]);
    }
    let nrrd = format!("{NRRD}space: RAS\nspace directions: (1,0,0) (2,0,0) (0,0,1)\n\n");
    refused(&folder.write("a.nrrd", &[nrrd.as_bytes(), data.bytes()]), &["independent directions"]);
}

#[test]
fn types_that_are_not_supported_are_named_with_those_that_are() {
    let folder = Folder::new();
    let all = "u8, i8, u16, i16, u32, i32, f32, f64";
    let nrrd = NRRD.replace("uchar", "block");
    refused(&folder.write("a.nrrd", &[nrrd.as_bytes(), b"\n"]), &["block", all]);
    let mha = format!("{}ElementDataFile = LOCAL\n", MHA.replace("MET_UCHAR", "MET_LONG_LONG"));
    refused(&folder.write("a.mha", &[mha.as_bytes()]), &["MET_LONG_LONG", all]);
    let vtk = VTK.replace("s unsigned_char", "s vtktypeint64");
    refused(&folder.write("a.vtk", &[vtk.as_bytes()]), &["vtktypeint64", all]);
    for (code, name) in [(128, "RGB24"), (1024, "i64"), (1792, "complex128"), (77, "unknown (code 77)")] {
        let mut nifti = Nifti::new(1, Endian::Big, SampleType::U8);
        nifti.datatype(code);
        refused(&folder.write("a.nii", &[nifti.bytes()]), &[name, all]);
    }
    let rgb = format!("{MHA}ElementNumberOfChannels = 3\nElementDataFile = LOCAL\n");
    refused(&folder.write("a.mha", &[rgb.as_bytes()]), &["ElementNumberOfChannels", "expected 1"]);
    let rgb = NRRD.replace("dimension: 3", "dimension: 4").replace("4 3 2", "3 4 3 2");
    let axes = format!("{rgb}space: RAS\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n\n");
    refused(&folder.write("a.nrrd", &[axes.as_bytes()]), &["none for axis 0 of 3 points"]);
    let kinds = format!("{rgb}kinds: RGB-color domain domain domain\n\n");
    refused(&folder.write("a.nrrd", &[kinds.as_bytes()]), &["NRRD kinds", "RGB-color"]);
}

#[test]
fn data_cut_short_is_answered_with_both_sizes() {
    let folder = Folder::new();
    let data = known(SampleType::U8);
    let cut = &data.bytes()[..20];
    let nrrd = format!("{NRRD}\n");
    let need = format!("{} bytes (4 x 3 x 2 of u8)", nrrd.len() + 24);
    let got = format!("got {} bytes", nrrd.len() + 20);
    refused(&folder.write("a.nrrd", &[nrrd.as_bytes(), cut]), &[&need, &got]);
    folder.write("body", &[cut]);
    let detached = format!("{NRRD}data file: body\n");
    refused(&folder.write("a.nhdr", &[detached.as_bytes()]), &["body", "expected 24 bytes", "got 20 bytes"]);
    let detached = format!("{NRRD}byte skip: -1\ndata file: body\n");
    refused(&folder.write("a.nhdr", &[detached.as_bytes()]), &["24 bytes", "20 bytes"]);
    // The samples would have to begin inside the header.
    let attached = format!("{NRRD}byte skip: -1\n\n");
    refused(&folder.write("a.nrrd", &[attached.as_bytes(), cut]), &["4 x 3 x 2 of u8"]);
    let mha = format!("{MHA}ElementDataFile = body\n");
    refused(&folder.write("a.mhd", &[mha.as_bytes()]), &["expected 24 bytes", "got 20 bytes"]);
    refused(&folder.write("a.vtk", &[VTK.as_bytes(), cut]), &["4 x 3 x 2 of u8"]);
    let nifti = Nifti::new(1, Endian::Little, SampleType::U8);
    refused(&folder.write("a.nii", &[nifti.bytes(), cut]), &["expected 376 bytes", "got 372 bytes"]);
    // Text: too short to hold the numbers, or long enough and still short of some.
    let head = NRRD.replace("raw", "text");
    refused(&folder.write("a.nrrd", &[head.as_bytes(), b"\n1 2 3"]), &["24 numbers", "too short"]);
    let twenty = "100 ".repeat(20);
    refused(
        &folder.write("a.nrrd", &[head.as_bytes(), b"\n", twenty.as_bytes()]),
        &["another number", "end of the file"],
    );
    // Lines to skip that the file does not have.
    folder.write("body", &[data.bytes()]);
    let lines = format!("{NRRD}line skip: 1\ndata file: body\n");
    refused(&folder.write("a.nhdr", &[lines.as_bytes()]), &["got 24 bytes"]);
}

/// A file whose packed samples are `body`, for NRRD, MetaImage and raw.
fn packed_in_each(folder: &Folder, body: &[u8]) -> Vec<(PathBuf, OpenOptions)> {
    let nrrd = format!("{}\n", NRRD.replace("raw", "gzip"));
    let mha = format!("{MHA}CompressedData = True\nCompressedDataSize = {}\nElementDataFile = LOCAL\n", body.len());
    vec![
        (folder.write("a.nrrd", &[nrrd.as_bytes(), body]), OpenOptions::default()),
        (folder.write("a.mha", &[mha.as_bytes(), body]), OpenOptions::default()),
        (folder.write("a.raw.gz", &[body]), raw_options(DIMS, SampleType::U8)),
    ]
}

#[test]
fn compressed_streams_of_the_wrong_length_or_damaged_are_refused() {
    let folder = Folder::new();
    let data = known(SampleType::U8);
    let whole = gzip(data.bytes());
    for (path, options) in packed_in_each(&folder, &whole) {
        assert_eq!(read_with(&path, &options).unwrap_or_else(|e| panic!("{e}")).samples, data);
    }
    for (path, options) in packed_in_each(&folder, &whole[..whole.len() / 2]) {
        expect_refused(&path, &options, &["got its end after", "bytes of decompressed samples"]);
    }
    // Its checksum is cut off: all samples are there, but nothing vouches for them.
    for (path, options) in packed_in_each(&folder, &whole[..whole.len() - 5]) {
        expect_refused(&path, &options, &["intact compressed stream"]);
    }
    let mut wrong = whole.clone();
    let checksum = wrong.len() - 8;
    wrong[checksum] ^= 1;
    for (path, options) in packed_in_each(&folder, &wrong) {
        expect_refused(&path, &options, &["intact compressed stream", "checksum"]);
    }
    for (path, options) in packed_in_each(&folder, &gzip(&data.bytes()[..20])) {
        expect_refused(&path, &options, &["got its end after", "bytes of decompressed samples"]);
    }
    for (path, options) in packed_in_each(&folder, &gzip(&[data.bytes(), b"more"].concat())) {
        expect_refused(&path, &options, &["nothing after the last sample", "check the dimensions"]);
    }
    for (path, options) in packed_in_each(&folder, &whole[1..]).into_iter().take(2) {
        expect_refused(&path, &options, &["gzip or zlib stream", "other bytes"]);
    }
    let head = format!("{MHA}CompressedData = True\nElementDataFile = LOCAL\n");
    let zipped = zlib(data.bytes());
    refused(&folder.write("b.mha", &[head.as_bytes(), &zipped[..zipped.len() - 2]]), &["intact compressed stream"]);
    let nifti = Nifti::new(1, Endian::Little, SampleType::U8);
    let zipped = gzip(&[nifti.bytes(), data.bytes()].concat());
    refused(&folder.write("a.nii.gz", &[&zipped[..60]]), &["a.nii.gz"]);
}

#[test]
fn meta_image_headers_that_contradict_their_data_are_refused() {
    let folder = Folder::new();
    let data = known(SampleType::U8);
    for kind in ["Tube", "Scene"] {
        let path = folder.write("a.mha", &[format!("ObjectType = {kind}\n{MHA}ElementDataFile = LOCAL\n").as_bytes()]);
        refused(&path, &["MetaImage ObjectType", "expected Image", kind]);
    }
    // Of samples that do not shrink, the gzip file is longer than they are.
    folder.write("d.raw.gz", &[&gzip(data.bytes())]);
    for line in ["", "CompressedData = False\n"] {
        let head = format!("{MHA}{line}ElementDataFile = d.raw.gz\n");
        let parts = ["MetaImage CompressedData", "expected True", "d.raw.gz is a gzip file"];
        refused(&folder.write("a.mhd", &[head.as_bytes()]), &parts);
    }
    let head = format!("{MHA}CompressedData = True\nElementDataFile = d.raw.gz\n");
    expect_known(&folder.write("a.mhd", &[head.as_bytes()]), SampleType::U8);
    // The name alone does not make a gzip file.
    folder.write("d.raw.gz", &[data.bytes()]);
    let head = format!("{MHA}ElementDataFile = d.raw.gz\n");
    expect_known(&folder.write("a.mhd", &[head.as_bytes()]), SampleType::U8);
}

#[test]
fn members_of_file_lists_must_all_be_there() {
    let folder = Folder::new();
    folder.write("s1", &[&[0; 12]]);
    let nrrd = format!("{NRRD}data file: s%d 1 2 1\n");
    let path = folder.write("a.nhdr", &[nrrd.as_bytes()]);
    refused(&path, &["cannot open data file", "s2"]);
    folder.write("s2", &[&[0; 11]]);
    refused(&path, &["s2", "expected 12 bytes", "in 2 files", "got 11 bytes"]);
    for (tail, parts) in [
        ("data file: s%d 1 3 1\n", ["expected 2 data files", "got 3"]),
        ("data file: LIST\ns1\n", ["expected 2 data files", "got 1"]),
        ("data file: s%d 1 99999999 1\n", ["data files", "65535"]),
        ("data file: s%d 1 9223372036854775807 1\n", ["data files", "65535"]),
        ("data file: s%d 1 2 0\n", ["a step that leads", "by 0"]),
        ("data file: LIST 9\n", ["1 to 3 dimensions", "LIST 9"]),
        ("data file: .\n", ["not a regular file", "data"]),
        ("data file: \n", ["a file name", "NRRD data file"]),
        ("", ["a blank line and the samples", "end of the file"]),
    ] {
        refused(&folder.write("a.nhdr", &[NRRD.as_bytes(), tail.as_bytes()]), &parts);
    }
    let many = format!("data file: LIST\n{}", "s\n".repeat(70_000));
    refused(&folder.write("a.nhdr", &[NRRD.as_bytes(), many.as_bytes()]), &["data files", "65535"]);
    let long = format!("data file: {}%d 1 2 1\n", "s".repeat(5000));
    refused(&folder.write("a.nhdr", &[NRRD.as_bytes(), long.as_bytes()]), &["cannot open data file"]);
    for (tail, parts) in [
        ("ElementDataFile = s%d 1 3 1\n", ["expected 2 data files", "got 3"]),
        ("ElementDataFile = LIST\ns1\n", ["expected 2 data files", "got 1"]),
        ("ElementDataFile = LIST 7D\n", ["LIST 2D", "7D"]),
        ("ElementDataFile = none.raw\n", ["cannot open data file", "none.raw"]),
        ("ElementDataFile =\n", ["LOCAL, LIST or a file name", "nothing"]),
        ("", ["ElementDataFile", "end of the file"]),
        ("HeaderSize = x\nElementDataFile = s1\n", ["HeaderSize", "or -1"]),
        ("HeaderSize = 18446744073709551615\nElementDataFile = s1\n", ["a number of bytes", "1844"]),
        ("CompressedData = True\nHeaderSize = -1\nElementDataFile = s1\n", ["HeaderSize", "uncompressed"]),
    ] {
        refused(&folder.write("a.mhd", &[MHA.as_bytes(), tail.as_bytes()]), &parts);
    }
}

#[test]
fn samples_outside_the_folder_of_their_header_are_read_only_if_allowed() {
    let folder = Folder::new();
    let secret = folder.write("secret.raw", &[known(SampleType::U8).bytes()]);
    std::fs::create_dir(folder.path().join("volume")).expect("new");
    let absolute = secret.to_str().expect("a text").to_owned();
    for name in ["../secret.raw", &absolute] {
        for (file, text) in [
            ("one.nhdr", format!("{NRRD}data file: {name}\n")),
            ("list.nhdr", format!("{NRRD}data file: LIST 3\n{name}\n")),
            ("numbered.nhdr", format!("{NRRD}data file: {} 1 1 1 3\n", name.replace(".raw", ".raw%d"))),
            ("one.mhd", format!("{MHA}ElementDataFile = {name}\n")),
            ("list.mhd", format!("{MHA}ElementDataFile = LIST 3D\n{name}\n")),
        ] {
            let path = folder.write(&format!("volume/{file}"), &[text.as_bytes()]);
            refused(&path, &[file, "outside its folder", name, "`OpenOptions::outside_files`"]);
            if file != "numbered.nhdr" {
                let read = read_with(&path, &OpenOptions::new().outside_files(true));
                assert_eq!(read.unwrap_or_else(|error| panic!("{error}")).samples, known(SampleType::U8), "{file}");
            }
        }
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&secret, folder.path().join("volume/link.raw")).expect("new");
        let text = format!("{NRRD}data file: link.raw\n");
        expect_known(&folder.write("volume/link.nhdr", &[text.as_bytes()]), SampleType::U8);
    }
}

#[test]
fn header_lines_that_break_their_format_are_shown() {
    let folder = Folder::new();
    for (from, to, part) in [
        ("type:", "tpye:", "check its spelling"),
        ("type: uchar\n", "", "a line \"type: \""),
        ("type: uchar\n", "type: uchar\ntype: uchar\n", "each field once"),
        ("dimension: 3", "dimension: 99", "2 to 16"),
        ("sizes: 4 3 2", "sizes: 4 3", "3 whole numbers"),
        ("sizes: 4 3 2", "sizes: 4 -3 2", "3 whole numbers"),
        ("encoding: raw", "encoding: hex", "raw, gzip, bzip2 or text"),
        ("type: uchar", "type: short", "little or big"),
        ("encoding: raw", "encoding: raw\nspace: flat", "a space of three dimensions"),
        ("encoding: raw", "encoding: raw\nspacings: 1 1", "3 numbers"),
        ("encoding: raw", "encoding: raw\nspace directions: (1,0,0)", "3 vectors"),
        ("encoding: raw", "encoding: raw\nbyte skip: x", "NRRD byte skip"),
        ("encoding: raw", "encoding: raw\nline skip: -1", "0 or more"),
        ("encoding: raw", "encoding", "field: value"),
    ] {
        refused(&folder.write("a.nrrd", &[NRRD.replacen(from, to, 1).as_bytes(), b"\n", &[0; 24]]), &[part]);
    }
    for (from, to, part) in [
        ("BINARY", "binarily", "ASCII or BINARY"),
        ("STRUCTURED_POINTS", "RECTILINEAR_GRID", "STRUCTURED_POINTS"),
        ("DIMENSIONS 4 3 2\n", "", "DIMENSIONS"),
        ("DIMENSIONS 4 3 2", "DIMENSIONS 4 3", "three numbers"),
        ("POINT_DATA 24", "POINT_DATA 23", "24 points"),
        ("POINT_DATA 24", "CELL_DATA 6", "under POINT_DATA"),
        ("SCALARS s", "POINTS 3", "a keyword of structured points"),
        ("SCALARS s unsigned_char", "FIELD f 99\nx 1 1 string", "a type of fixed size"),
        ("SCALARS s unsigned_char", "VECTORS s double", "bytes left in the file"),
        ("SCALARS s unsigned_char", "FIELD f 1\nx 18446744073709551615 9 double", "bytes left in the file"),
        ("s unsigned_char", "s unsigned_char 3", "array \"s\" of 3 components"),
    ] {
        refused(&folder.write("a.vtk", &[VTK.replacen(from, to, 1).as_bytes(), &[b'\n'; 72]]), &[part]);
    }
    let text = NRRD.replace("raw", "text");
    for bad in ["256", "-1", "1.5", "x", "nan", "1e3", "\u{e9}"] {
        let numbers = format!("\n{bad} {}", "1 ".repeat(23));
        refused(&folder.write("a.nrrd", &[text.as_bytes(), numbers.as_bytes()]), &["a number that u8 can hold", bad]);
    }
    let numbers = format!("\n{} {}", "1".repeat(5000), "1 ".repeat(23));
    refused(&folder.write("a.nrrd", &[text.as_bytes(), numbers.as_bytes()]), &["characters without a space"]);
    refused(&folder.write("a.nrrd", &[text.as_bytes(), b"\n", "1 ".repeat(25).as_bytes()]), &["nothing after"]);
    let mut nifti = Nifti::new(1, Endian::Little, SampleType::U8);
    nifti.dim(0, 8);
    refused(&folder.write("a.nii", &[nifti.bytes()]), &["1 to 7 dimensions", "8 dimensions"]);
    nifti.dim(0, 3);
    nifti.dim(2, -4);
    refused(&folder.write("a.nii", &[nifti.bytes()]), &["-4 points along dimension 2"]);
    nifti.dim(2, 3);
    nifti.vox_offset(100);
    refused(&folder.write("a.nii", &[nifti.bytes()]), &["vox_offset", "behind the header"]);
    nifti.vox_offset(-8);
    refused(&folder.write("a.nii", &[nifti.bytes()]), &["vox_offset", "-8"]);
}

#[test]
fn header_text_without_end_does_not_fill_the_memory() {
    let folder = Folder::new();
    let long = vec![b'x'; 5 << 20];
    for (name, head) in [("a.nrrd", "NRRD0004\n# "), ("a.mhd", "Comment = "), ("a.vtk", "# vtk DataFile Version 3.0\n")]
    {
        refused(&folder.write(name, &[head.as_bytes(), &long]), &["header text", "4194304"]);
    }
    let lines = "a = b\n".repeat(2000);
    refused(&folder.write("b.mhd", &[lines.as_bytes()]), &["header lines", "1024"]);
    let lines = "# comment\n".repeat(500_000);
    refused(&folder.write("b.nrrd", &[b"NRRD0004\n", lines.as_bytes()]), &["header text", "4194304"]);
}

#[test]
fn slices_are_read_in_order_into_buffers_that_fit() {
    let folder = Folder::new();
    let path = folder.write("a.raw", &[known(SampleType::U8).bytes()]);
    let mut source = open(&path, &raw_options(DIMS, SampleType::U8)).expect("a good file");
    let refusal = |result: adjsplat::Result<()>| result.expect_err("must be refused").to_string();
    assert!(refusal(source.read_slice(&mut Samples::zeros(SampleType::U8, 11))).contains("slice has 12 of u8"));
    assert!(refusal(source.read_slice(&mut Samples::zeros(SampleType::I8, 12))).contains("slice has 12 of u8"));
    let mut slice = source.header().new_slice().expect("12 bytes");
    source.read_slice(&mut slice).expect("first");
    source.read_slice(&mut slice).expect("last");
    assert!(refusal(source.read_slice(&mut slice)).contains("comes after the last"));
    // The file shrinks while it is open.
    std::fs::write(&path, [1; 13]).expect("can be written");
    source.rewind().expect("the first slice is still there");
    source.read_slice(&mut slice).expect("first");
    assert!(refusal(source.read_slice(&mut slice)).contains("got its end after 13 bytes"));
    assert!(refusal(source.read_slice(&mut slice)).contains("comes after one that failed"));
    std::fs::remove_file(&path).expect("can be removed");
    assert!(refusal(source.rewind()).contains("cannot open"));
}

/// A small good file of each format and packing.
fn good_files(folder: &Folder) -> Vec<(PathBuf, OpenOptions)> {
    let (data, plain) = (known(SampleType::I16), OpenOptions::default());
    let (little, big) = (bytes(&data, Endian::Little), bytes(&data, Endian::Big));
    let nrrd = NRRD.replace("uchar", "short") + "endian: big\nspace: LPS\nspace origin: (1,2,3)\n";
    let mha = MHA.replace("UCHAR", "SHORT");
    let vtk = VTK.replace("unsigned_char", "short");
    let nifti = |version| Nifti::new(version, Endian::Little, SampleType::I16).bytes().to_vec();
    let zip = |version| gzip(&[nifti(version), little.clone()].concat());
    let mut files = vec![
        (folder.write("a.nrrd", &[nrrd.as_bytes(), b"\n", &big]), plain.clone()),
        (folder.write("b.nrrd", &[nrrd.replace("raw", "gzip").as_bytes(), b"\n", &gzip(&big)]), plain.clone()),
        (
            folder.write("c.nrrd", &[nrrd.replace("raw", "text").as_bytes(), b"\n", text(&data).as_bytes()]),
            plain.clone(),
        ),
        (folder.write("a.mha", &[mha.as_bytes(), b"ElementDataFile = LOCAL\n", &little]), plain.clone()),
        (
            folder
                .write("b.mha", &[mha.as_bytes(), b"CompressedData = True\nElementDataFile = LOCAL\n", &zlib(&little)]),
            plain.clone(),
        ),
        (folder.write("a.vtk", &[vtk.as_bytes(), &big]), plain.clone()),
        (folder.write("b.vtk", &[vtk.replace("BINARY", "ASCII").as_bytes(), text(&data).as_bytes()]), plain.clone()),
    ];
    for version in [1, 2] {
        files.push((folder.write(&format!("{version}.nii"), &[&nifti(version), &little]), plain.clone()));
        files.push((folder.write(&format!("{version}.nii.gz"), &[&zip(version)]), plain.clone()));
    }
    for (path, _) in &files {
        expect_known(path, SampleType::I16);
    }
    files.push((folder.write("a.raw", &[&little]), raw_options(DIMS, SampleType::I16)));
    files.push((folder.write("a.raw.gz", &[&gzip(&little)]), raw_options(DIMS, SampleType::I16)));
    files
}

#[test]
fn every_truncation_is_refused_or_still_right() {
    let folder = Folder::new();
    for (path, options) in good_files(&folder) {
        let whole = std::fs::read(&path).expect("just written");
        for len in 0..whole.len() {
            rewrite(&path, &whole[..len]);
            // A text file may lose its last line end, or a digit of its last number; nothing else may be lost.
            if let Ok(got) = read_with(&path, &options) {
                let is_text = matches!(path.extension().and_then(|e| e.to_str()), Some("nrrd" | "vtk"));
                assert!(is_text && len + 6 >= whole.len(), "{}: {len} of {} bytes", path.display(), whole.len());
                assert_eq!(got.samples.get(0), known(SampleType::I16).get(0));
            }
        }
    }
}

#[test]
fn damaged_bytes_never_panic() {
    let folder = Folder::new();
    for (path, options) in good_files(&folder) {
        expect_no_panic_with(&path, &options, 600);
    }
}
