//! DICOM files written here element by element, in the three codings; and compressed ones that GDCM and libjpeg wrote.

use std::path::{Path, PathBuf};

use adjsplat::volume::{SampleType, Samples};
use adjsplat_readers::{OpenOptions, open};

use super::sample::{Folder, Read, bytes, expect_refused, known, read, read_with};

/// How elements are written.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Coding {
    Implicit,
    Explicit,
    BigEndian,
}

const CODINGS: [Coding; 3] = [Coding::Implicit, Coding::Explicit, Coding::BigEndian];

#[derive(Clone)]
enum Value {
    /// Text or bytes, as they are.
    Bytes(Vec<u8>),
    /// The number of bytes of each number, and the numbers, little endian here.
    Numbers(usize, Vec<u8>),
    /// A sequence.
    Items(Vec<Elements>),
    /// Compressed pixels: an offset table and fragments.
    Fragments(Vec<u32>, Vec<Vec<u8>>),
}

/// A data set.
#[derive(Clone, Default)]
pub(crate) struct Elements(std::collections::BTreeMap<(u16, u16), (&'static str, Value)>);

impl Elements {
    pub(crate) fn text(mut self, group: u16, element: u16, vr: &'static str, text: &str) -> Elements {
        let mut bytes = text.as_bytes().to_vec();
        if bytes.len() % 2 == 1 {
            bytes.push(if vr == "UI" { 0 } else { b' ' });
        }
        self.0.insert((group, element), (vr, Value::Bytes(bytes)));
        self
    }

    pub(crate) fn number(mut self, group: u16, element: u16, number: u16) -> Elements {
        self.0.insert((group, element), ("US", Value::Numbers(2, number.to_le_bytes().to_vec())));
        self
    }

    fn items(mut self, group: u16, element: u16, items: Vec<Elements>) -> Elements {
        self.0.insert((group, element), ("SQ", Value::Items(items)));
        self
    }

    fn pixels(mut self, width: usize, bytes: &[u8]) -> Elements {
        let vr = if width == 1 { "OB" } else { "OW" };
        self.0.insert((0x7fe0, 0x10), (vr, Value::Numbers(width, bytes.to_vec())));
        self
    }

    fn without(mut self, group: u16, element: u16) -> Elements {
        self.0.remove(&(group, element));
        self
    }

    /// Its bytes; sequences and items have lengths if `defined`, delimiters if not.
    fn encode(&self, coding: Coding, defined: bool) -> Vec<u8> {
        let mut out = Vec::new();
        let short = |n: u16| if coding == Coding::BigEndian { n.to_be_bytes() } else { n.to_le_bytes() };
        let long = |n: u32| if coding == Coding::BigEndian { n.to_be_bytes() } else { n.to_le_bytes() };
        let tag = |g: u16, e: u16| [short(g), short(e)].concat();
        let header = |g: u16, e: u16, vr: &str, len: Option<usize>| {
            let len = len.map_or(u32::MAX, |len| u32::try_from(len).expect("test files are small"));
            let mut bytes = tag(g, e);
            if coding != Coding::Implicit {
                bytes.extend(vr.as_bytes());
                if ["OB", "OW", "OF", "OD", "SQ", "UN"].contains(&vr) {
                    bytes.extend([0, 0]);
                } else {
                    bytes.extend(short(u16::try_from(len).expect("a short value")));
                    return bytes;
                }
            }
            bytes.extend(long(len));
            bytes
        };
        let item = |len: Option<usize>| {
            let len = len.map_or(u32::MAX, |len| u32::try_from(len).expect("test files are small"));
            [tag(0xfffe, 0xe000), long(len).to_vec()].concat()
        };
        let end = |e: u16| [tag(0xfffe, e), vec![0; 4]].concat();
        for ((g, e), (vr, value)) in &self.0 {
            match value {
                Value::Bytes(bytes) => {
                    out.extend(header(*g, *e, vr, Some(bytes.len())));
                    out.extend(bytes);
                }
                Value::Numbers(width, bytes) => {
                    out.extend(header(*g, *e, vr, Some(bytes.len())));
                    for number in bytes.chunks(*width) {
                        let mut number = number.to_vec();
                        if coding == Coding::BigEndian {
                            number.reverse();
                        }
                        out.extend(number);
                    }
                }
                Value::Items(items) => {
                    let mut inside = Vec::new();
                    for elements in items {
                        let bytes = elements.encode(coding, defined);
                        inside.extend(item(Some(bytes.len()).filter(|_| defined)));
                        inside.extend(bytes);
                        if !defined {
                            inside.extend(end(0xe00d));
                        }
                    }
                    out.extend(header(*g, *e, vr, Some(inside.len()).filter(|_| defined)));
                    out.extend(inside);
                    if !defined {
                        out.extend(end(0xe0dd));
                    }
                }
                Value::Fragments(offsets, fragments) => {
                    out.extend(header(*g, *e, "OB", None));
                    out.extend(item(Some(4 * offsets.len())));
                    out.extend(offsets.iter().flat_map(|offset| offset.to_le_bytes()));
                    for fragment in fragments {
                        out.extend(item(Some(fragment.len())));
                        out.extend(fragment);
                    }
                    out.extend(end(0xe0dd));
                }
            }
        }
        out
    }

    /// The file of this data set under `syntax`.
    fn file_of(&self, syntax: &str, coding: Coding, defined: bool) -> Vec<u8> {
        let meta = Elements::default().text(2, 0x10, "UI", syntax).encode(Coding::Explicit, true);
        let mut length = Elements::default();
        let group = u32::try_from(meta.len()).expect("short").to_le_bytes();
        length.0.insert((2, 0), ("UL", Value::Numbers(4, group.to_vec())));
        let length = length.encode(Coding::Explicit, true);
        [&[0; 128], &b"DICM"[..], &length, &meta, &self.encode(coding, defined)].concat()
    }

    pub(crate) fn file(&self, coding: Coding) -> Vec<u8> {
        let syntax = match coding {
            Coding::Implicit => "1.2.840.10008.1.2",
            Coding::Explicit => "1.2.840.10008.1.2.1",
            Coding::BigEndian => "1.2.840.10008.1.2.2",
        };
        self.file_of(syntax, coding, coding != Coding::Implicit)
    }

    fn write(&self, folder: &Folder, name: &str) -> PathBuf {
        folder.write(name, &[&self.file(Coding::Explicit)])
    }

    fn position(self, x: f64, y: f64, z: f64) -> Elements {
        self.text(0x20, 0x32, "DS", &format!("{x}\\{y}\\{z}"))
    }
}

/// A slice of 4 x 3 samples of `ty`, which are `samples`, at z = `z` of an axial stack.
pub(crate) fn slice(ty: SampleType, samples: &[u8], z: f64) -> Elements {
    let bits = u16::try_from(8 * ty.bytes()).expect("at most 64");
    let signed = ty.integer_range().is_some_and(|(low, _)| low < 0.0);
    Elements::default()
        .text(0x08, 0x60, "CS", "CT")
        .text(0x08, 0x103e, "LO", "thorax")
        .text(0x20, 0x0e, "UI", "1.2.3.4.555")
        .text(0x20, 0x13, "IS", "7")
        .text(0x20, 0x37, "DS", "1\\0\\0\\0\\1\\0")
        .text(0x28, 0x04, "CS", "MONOCHROME2")
        .text(0x28, 0x30, "DS", "0.5\\0.25")
        .number(0x28, 0x02, 1)
        .number(0x28, 0x10, 3)
        .number(0x28, 0x11, 4)
        .number(0x28, 0x100, bits)
        .number(0x28, 0x101, bits)
        .number(0x28, 0x102, bits - 1)
        .number(0x28, 0x103, signed.into())
        .position(10.0, 20.0, z)
        .pixels(ty.bytes(), samples)
}

/// Slice `z` of the known volume.
fn known_slice(ty: SampleType, z: usize) -> Elements {
    let bytes = bytes(&known(ty), adjsplat_readers::Endian::Little);
    let half = bytes.len() / 2;
    slice(ty, &bytes[z * half..(z + 1) * half], 2.0 * z as f64)
}

/// A stack of slices of bytes, all of one value each, at these positions.
fn stack(folder: &Folder, positions: &[f64]) {
    for (value, z) in (1..).zip(positions) {
        slice(SampleType::U8, &[value; 12], *z).write(folder, &format!("s{value}.dcm"));
    }
}

/// The first sample of each slice.
fn firsts(read: &Read) -> Vec<f64> {
    (0..read.header.grid.dims[2] as usize).map(|z| read.samples.get(z * 12)).collect()
}

fn notes(path: &Path, options: &OpenOptions) -> Vec<String> {
    open(path, options).unwrap_or_else(|error| panic!("{error}")).notes().to_vec()
}

fn refused(path: &Path, parts: &[&str]) {
    expect_refused(path, &OpenOptions::default(), parts);
}

fn series(choice: &str) -> OpenOptions {
    OpenOptions::new().series(choice)
}

const INTEGERS: [SampleType; 6] =
    [SampleType::U8, SampleType::I8, SampleType::U16, SampleType::I16, SampleType::U32, SampleType::I32];

#[test]
fn every_integer_type_is_read_in_every_coding() {
    for coding in CODINGS {
        for ty in INTEGERS {
            let folder = Folder::new();
            for z in 0..2 {
                folder.write(&format!("IM{z}"), &[&known_slice(ty, z).file(coding)]);
            }
            let read = read(folder.path()).unwrap_or_else(|error| panic!("{coding:?} {}: {error}", ty.name()));
            assert_eq!(read.samples, known(ty), "{coding:?} {}", ty.name());
            assert_eq!(read.header.format, "DICOM");
        }
    }
}

#[test]
fn floating_point_pixels_are_read() {
    for (ty, element, vr) in [(SampleType::F32, 8, "OF"), (SampleType::F64, 9, "OD")] {
        let folder = Folder::new();
        for z in 0..2 {
            let mut elements = known_slice(ty, z);
            let (_, pixels) = elements.0.remove(&(0x7fe0, 0x10)).expect("it has pixels");
            elements.0.insert((0x7fe0, element), (vr, pixels));
            elements.write(&folder, &format!("{z}"));
        }
        assert_eq!(read(folder.path()).unwrap_or_else(|error| panic!("{error}")).samples, known(ty));
    }
}

#[test]
fn slices_are_sorted_by_position_and_files_are_in_any_order() {
    let folder = Folder::new();
    stack(&folder, &[3.0, -1.5, 0.0, 1.5]);
    let read = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(firsts(&read), [2.0, 3.0, 4.0, 1.0]);
    let grid = &read.header.grid;
    // Between rows comes first in the file: y.
    assert_eq!(grid.spacing, [0.25, 0.5, 1.5]);
    assert_eq!(grid.unit.as_deref(), Some("mm"));
    // L, P, S to R, A, S.
    assert_eq!(grid.direction, [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(grid.origin, [-10.0, -20.0, -1.5]);
    assert_eq!(notes(folder.path(), &OpenOptions::default()), [""; 0]);
}

#[test]
fn a_sagittal_stack_points_where_its_header_says() {
    let folder = Folder::new();
    for z in 0..3 {
        // Rows run from front to back, columns from head to feet, slices from left to right of the patient.
        slice(SampleType::U8, &[z; 12], 0.0)
            .text(0x20, 0x37, "DS", "0\\1\\0\\0\\0\\-1")
            .position(40.0 - 2.0 * f64::from(z), -100.0, 90.0)
            .write(&folder, &format!("{}", 9 - z));
    }
    let read = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(firsts(&read), [0.0, 1.0, 2.0]);
    // In R, A, S: x to the back, y to the feet, z to the right.
    assert_eq!(read.header.grid.direction, [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]);
    assert_eq!(read.header.grid.origin, [-40.0, 100.0, 90.0]);
    assert_eq!(read.header.grid.spacing, [0.25, 0.5, 2.0]);
}

#[test]
fn missing_slices_are_told_with_their_place() {
    let folder = Folder::new();
    stack(&folder, &[0.0, 1.0, 2.0, 5.0, 6.0]);
    let read = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read.header.grid.spacing[2], 1.0);
    let told = notes(folder.path(), &OpenOptions::default());
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(
        told[0].starts_with("warning: 2 slices are missing between slices 2 and 3 (s3.dcm and s4.dcm)"),
        "{told:?}"
    );
}

#[test]
fn uneven_steps_are_told_and_small_ones_are_not() {
    let folder = Folder::new();
    stack(&folder, &[0.0, 1.0, 2.0, 3.3, 4.3, 5.305]);
    let told = notes(folder.path(), &OpenOptions::default());
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(told[0].starts_with("warning: 1 step between slices is not the usual 1 mm, first 1.2"), "{told:?}");
    assert!(told[0].contains("s3.dcm and s4.dcm"), "{told:?}");
}

#[test]
fn slices_at_one_place_are_refused_with_what_differs() {
    let folder = Folder::new();
    stack(&folder, &[0.0, 1.0, 2.0]);
    let echo = |time: &str| slice(SampleType::U8, &[9; 12], 1.0).text(0x18, 0x81, "DS", time);
    echo("4.6").write(&folder, "t.dcm");
    refused(folder.path(), &["s2.dcm and t.dcm are at the same place", "echo time", "keep the files of one"]);
    let copies = Folder::new();
    stack(&copies, &[1.0, 1.0]);
    refused(copies.path(), &["s1.dcm and s2.dcm are at the same place", "copy"]);
}

#[test]
fn a_tilted_gantry_gives_a_sheared_grid() {
    let folder = Folder::new();
    for z in 0..4u8 {
        slice(SampleType::U8, &[z; 12], 0.0)
            .position(0.0, 0.5 * f64::from(z), 2.0 * f64::from(z))
            .write(&folder, &format!("{z}.dcm"));
    }
    let read = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    let grid = &read.header.grid;
    let step = 2f64.hypot(0.5);
    assert!((grid.spacing[2] - step).abs() < 1e-12, "{:?}", grid.spacing);
    assert!((grid.direction[2][1] + 0.5 / step).abs() < 1e-12, "{:?}", grid.direction);
    let told = notes(folder.path(), &OpenOptions::default());
    assert!(told[0].contains("14.0 degrees") && told[0].contains("sheared"), "{told:?}");
}

#[test]
fn a_slice_whose_file_ends_before_its_pixels_is_refused() {
    let folder = Folder::new();
    stack(&folder, &[0.0, 1.0]);
    let cut = slice(SampleType::U8, &[0; 12], 2.0).without(0x7fe0, 0x10);
    cut.write(&folder, "s3.dcm");
    refused(folder.path(), &["s3.dcm", "DICOM Pixel Data: expected pixels", "the end of the file (copy it again)"]);
    // Spectra have none.
    cut.text(0x08, 0x16, "UI", "1.2.840.10008.5.1.4.1.1.4.2").write(&folder, "s3.dcm");
    assert_eq!(notes(folder.path(), &OpenOptions::default()), ["skipped 1 file that has no pixels (s3.dcm)"]);
}

#[test]
fn malformed_numbers_that_positions_make_needless_are_ignored() {
    let folder = Folder::new();
    for (z, name) in [(2u8, "a"), (0, "b"), (1, "c")] {
        let elements = slice(SampleType::U8, &[z; 12], z.into()).text(0x20, 0x13, "IS", "1.0");
        elements.text(0x18, 0x50, "DS", "thick").text(0x18, 0x88, "DS", "1mm").write(&folder, name);
    }
    let read = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((firsts(&read), read.header.grid.spacing[2]), (vec![0.0, 1.0, 2.0], 1.0));
    let path = slice(SampleType::U8, &[0; 12], 0.0).without(0x20, 0x32).text(0x18, 0x50, "DS", "thick");
    refused(&path.write(&folder, "d"), &["DICOM Slice Thickness", "thick"]);
}

#[test]
fn slices_without_positions_are_stacked_by_number_with_a_note() {
    let folder = Folder::new();
    for (name, number, value) in [("a", "3", 3), ("b", "10", 10), ("c", "1", 1)] {
        slice(SampleType::U8, &[value; 12], 0.0)
            .without(0x20, 0x32)
            .text(0x20, 0x13, "IS", number)
            .text(0x18, 0x50, "DS", "2.5")
            .write(&folder, name);
    }
    let read = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(firsts(&read), [1.0, 3.0, 10.0]);
    assert_eq!(read.header.grid.spacing, [0.25, 0.5, 2.5]);
    let told = notes(folder.path(), &OpenOptions::default());
    assert!(told.len() == 1 && told[0].contains("instance numbers"), "{told:?}");
}

#[test]
fn several_series_are_listed_and_one_can_be_chosen() {
    let folder = Folder::new();
    stack(&folder, &[0.0, 1.0, 2.0]);
    let scout = slice(SampleType::U8, &[50; 12], 0.0).text(0x20, 0x37, "DS", "0\\1\\0\\0\\0\\-1");
    scout.write(&folder, "a-scout.dcm");
    let other = slice(SampleType::U8, &[60; 12], 0.0)
        .text(0x20, 0x0e, "UI", "1.2.3.4.666")
        .text(0x08, 0x60, "CS", "MR")
        .text(0x08, 0x103e, "LO", "t1 \u{1b}[31m");
    other.write(&folder, "z.dcm");
    refused(
        folder.path(),
        &[
            "holds 3 series",
            "`OpenOptions::series`",
            "0: CT \"thorax\", 1 slice of 4 x 3 (...1.2.3.4.555)",
            "1: CT \"thorax\", 3 slices of 4 x 3",
            "2: MR \"t1 \\u{1b}[31m\"",
        ],
    );
    let with = |choice: &str| read_with(folder.path(), &series(choice)).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(firsts(&with("1")), [1.0, 2.0, 3.0]);
    assert_eq!(firsts(&with("4.666")), [60.0]);
    assert_eq!(firsts(&with("1.2.3.4.666")), [60.0]);
    expect_refused(folder.path(), &series("3"), &["no series \"3\"", "0: CT"]);
    expect_refused(folder.path(), &series("1.2.3.4.555"), &["more than one series"]);
    expect_refused(folder.path(), &series(""), &["no series"]);
}

#[test]
fn files_that_are_no_images_are_passed_over_and_counted() {
    let folder = Folder::new();
    stack(&folder, &[0.0, 1.0]);
    folder.write("DICOMDIR", &[&Elements::default().text(0x08, 0x60, "CS", "XX").file(Coding::Explicit)]);
    folder.write("readme.txt", &[b"hello"]);
    folder.write("cut", &[&[0; 131]]);
    folder.write("empty", &[]);
    folder.write(".hidden", &[b"hello"]);
    slice(SampleType::U8, &[0; 36], 5.0).text(0x28, 0x04, "CS", "RGB").number(0x28, 0x02, 3).write(&folder, "shot");
    std::fs::create_dir(folder.path().join("more")).expect("the folder can be written");
    assert_eq!(firsts(&read(folder.path()).unwrap_or_else(|error| panic!("{error}"))), [1.0, 2.0]);
    assert_eq!(
        notes(folder.path(), &OpenOptions::default()),
        [
            "warning: skipped 2 files that are shorter than any DICOM file (cut, ...); copy slices that were cut short again",
            "skipped 1 file that is no DICOM (readme.txt)",
            "skipped 1 file that has no pixels (DICOMDIR)",
            "skipped 1 file that is in colour (shot)",
        ]
    );
    refused(&folder.path().join("DICOMDIR"), &["has no pixels", "give the folder"]);
    refused(&folder.path().join("shot"), &["one grey sample", "3 of RGB"]);
    refused(&folder.write("no.dcm", &[&[7; 200]]), &["DICM", "no DICOM file"]);
    refused(&folder.path().join("more"), &["is a folder without files"]);
    let outer = Folder::new();
    std::fs::create_dir(outer.path().join("series1")).expect("the folder can be written");
    refused(outer.path(), &["is a folder", "subfolders, such as series1"]);
}

#[test]
fn one_slope_stays_in_the_header_and_several_make_floats() {
    let folder = Folder::new();
    let at = |z: u8, slope: &str| {
        slice(SampleType::I16, &[z, 0, 0, 0].repeat(6), z.into())
            .text(0x28, 0x1052, "DS", "-1024")
            .text(0x28, 0x1053, "DS", slope)
    };
    at(0, "2").write(&folder, "a");
    at(1, "2").write(&folder, "b");
    let same = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((same.header.sample_type, same.header.slope, same.header.intercept), (SampleType::I16, 2.0, -1024.0));
    at(2, "0.5").write(&folder, "c");
    let differ = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((differ.header.sample_type, differ.header.slope, differ.header.intercept), (SampleType::F32, 1.0, 0.0));
    assert_eq!(firsts(&differ), [-1024.0, -1022.0, -1023.0]);
    assert!(notes(folder.path(), &OpenOptions::default())[0].contains("slope differs"));
    at(3, "0").write(&folder, "d");
    refused(folder.path(), &["Rescale Slope", "not 0"]);
}

#[test]
fn bits_beyond_the_stored_ones_are_masked_and_signs_extended() {
    let folder = Folder::new();
    // Overlay bits above 12 stored ones.
    let cells: Vec<u8> = [0xffff_u16, 0x0800, 0x17ff].iter().cycle().take(12).flat_map(|c| c.to_le_bytes()).collect();
    let stored = |signed| {
        slice(SampleType::U16, &cells, 0.0).number(0x28, 0x101, 12).number(0x28, 0x102, 11).number(0x28, 0x103, signed)
    };
    let path = stored(1).write(&folder, "a.dcm");
    let signed = read(&path).unwrap_or_else(|error| panic!("{error}"));
    let Samples::I16(cells) = signed.samples else { panic!("not i16") };
    assert_eq!(cells[..3], [-1, -2048, 2047]);
    let path = stored(0).text(0x28, 0x04, "CS", "MONOCHROME1").write(&folder, "b.dcm");
    let Samples::U16(cells) = read(&path).unwrap_or_else(|error| panic!("{error}")).samples else { panic!("not u16") };
    assert_eq!(cells[..3], [0xfff, 0x800, 0x7ff]);
    assert!(notes(&path, &OpenOptions::default())[1].contains("MONOCHROME1"));
}

/// Three frames, the last one lowest, with the values that are shared in a group of their own.
fn enhanced() -> Elements {
    let group = |g, e, inside: Elements| Elements::default().items(g, e, vec![inside]);
    let pixels: Vec<u8> = [7, 8, 9].iter().flat_map(|value| [*value; 12]).collect();
    let measures = Elements::default().text(0x28, 0x30, "DS", "0.5\\0.25").text(0x18, 0x50, "DS", "9");
    let orientation = Elements::default().text(0x20, 0x37, "DS", "1\\0\\0\\0\\1\\0");
    let shared = Elements::default().items(0x28, 0x9110, vec![measures]).items(0x20, 0x9116, vec![orientation]);
    let frames = [4.0, 2.0, 0.0].map(|z| group(0x20, 0x9113, Elements::default().position(1.0, 2.0, z)));
    slice(SampleType::U8, &pixels, 0.0)
        .without(0x20, 0x32)
        .without(0x20, 0x37)
        .without(0x28, 0x30)
        .text(0x28, 0x08, "IS", "3")
        .items(0x5200, 0x9229, vec![shared])
        .items(0x5200, 0x9230, frames.into())
}

#[test]
fn an_enhanced_object_is_sorted_by_its_functional_groups() {
    let folder = Folder::new();
    for coding in CODINGS {
        for defined in [false, true] {
            let syntax = match coding {
                Coding::Implicit => "1.2.840.10008.1.2",
                Coding::Explicit => "1.2.840.10008.1.2.1",
                Coding::BigEndian => "1.2.840.10008.1.2.2",
            };
            let path = folder.write("a.dcm", &[&enhanced().file_of(syntax, coding, defined)]);
            let read = read(&path).unwrap_or_else(|error| panic!("{coding:?}, {defined}: {error}"));
            assert_eq!(firsts(&read), [9.0, 8.0, 7.0], "{coding:?}, {defined}");
            assert_eq!(read.header.grid.spacing, [0.25, 0.5, 2.0]);
            assert_eq!(read.header.grid.origin, [-1.0, -2.0, 0.0]);
        }
    }
    let short = enhanced().text(0x28, 0x08, "IS", "4");
    refused(&short.write(&folder, "b.dcm"), &["DICOM Pixel Data", "48 bytes (4 x 3 x 4 of u8)", "got 36 bytes"]);
    let many = enhanced().text(0x28, 0x08, "IS", "2000000000");
    refused(&many.write(&folder, "c.dcm"), &["frames", "2000000000", "65535"]);
    let none = enhanced().text(0x28, 0x08, "IS", "0");
    refused(&none.write(&folder, "d.dcm"), &["Number of Frames", "at least 1"]);
}

/// Three frames of one position, as of a dose.
fn frames_of_one_position(offsets: &str) -> Elements {
    let pixels: Vec<u8> = [7, 8, 9].iter().flat_map(|value| [*value; 12]).collect();
    let frames = slice(SampleType::U8, &pixels, 5.0).text(0x28, 0x08, "IS", "3").text(0x18, 0x50, "DS", "9");
    if offsets.is_empty() { frames } else { frames.text(0x3004, 0x0c, "DS", offsets) }
}

#[test]
fn frames_of_one_position_are_stacked_by_their_offsets() {
    let folder = Folder::new();
    let axial = "1\\0\\0\\0\\1\\0";
    let head_first = "1\\0\\0\\0\\-1\\0";
    let sagittal = "0\\1\\0\\0\\0\\-1";
    for (offsets, orientation, origin, values) in [
        ("0\\2.5\\5", axial, [-10.0, -20.0, 5.0], [7.0, 8.0, 9.0]),
        ("0\\-2.5\\-5", axial, [-10.0, -20.0, 0.0], [9.0, 8.0, 7.0]),
        // They are z coordinates, whatever the normal.
        ("5\\7.5\\10", axial, [-10.0, -20.0, 5.0], [7.0, 8.0, 9.0]),
        ("5\\7.5\\10", head_first, [-10.0, -20.0, 10.0], [9.0, 8.0, 7.0]),
        ("0\\2.5\\5", sagittal, [-10.0, -20.0, 5.0], [7.0, 8.0, 9.0]),
    ] {
        let elements = frames_of_one_position(offsets).text(0x20, 0x37, "DS", orientation);
        let got = read(&elements.write(&folder, "a.dcm")).unwrap_or_else(|error| panic!("{offsets}: {error}"));
        let grid = &got.header.grid;
        assert_eq!((grid.spacing, grid.origin), ([0.25, 0.5, 2.5], origin), "{offsets} {orientation}");
        assert_eq!(firsts(&got), values, "{offsets} {orientation}");
    }
    let dose = frames_of_one_position("0\\2\\4").text(0x3004, 0x0e, "DS", "0.25");
    assert_eq!(read(&dose.write(&folder, "a.dcm")).unwrap_or_else(|error| panic!("{error}")).header.slope, 0.25);
    let spaced = frames_of_one_position("").text(0x18, 0x88, "DS", "4");
    let got = read(&spaced.write(&folder, "a.dcm")).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((got.header.grid.spacing[2], firsts(&got)), (4.0, vec![7.0, 8.0, 9.0]));
    for (offsets, parts) in [
        ("", ["one position for all its frames", "neither a Grid Frame Offset Vector nor a Spacing"]),
        ("0\\1", ["Grid Frame Offset Vector", "3 finite numbers"]),
        ("4\\5\\6", ["Grid Frame Offset Vector: expected 0 at first", "got 4"]),
    ] {
        refused(&frames_of_one_position(offsets).write(&folder, "a.dcm"), &parts);
    }
    let many = (0..1000).map(|frame| format!("{frame}.00000\\")).collect::<String>();
    refused(&frames_of_one_position(&many).write(&folder, "a.dcm"), &["Grid Frame Offset Vector", "3 finite numbers"]);
}

#[test]
fn frames_without_positions_are_stacked_in_their_order() {
    let folder = Folder::new();
    let path = enhanced().without(0x5200, 0x9230).write(&folder, "a.dcm");
    let read = read(&path).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(firsts(&read), [7.0, 8.0, 9.0]);
    assert_eq!(read.header.grid.spacing, [0.25, 0.5, 9.0]);
    assert!(notes(&path, &OpenOptions::default())[0].contains("order of its frames"));
}

#[test]
fn the_pixels_of_an_icon_are_passed_over() {
    let folder = Folder::new();
    let mut icon = Elements::default();
    icon.0.insert((0x7fe0, 0x10), ("OB", Value::Fragments(vec![], vec![vec![1; 8], vec![2; 6]])));
    let mut private = slice(SampleType::U8, &[5; 12], 0.0).items(0x88, 0x200, vec![icon]);
    // Of a kind that the writer did not know: inside, elements are implicit.
    let unknown = Elements::default().items(0x29, 0x1011, vec![Elements::default().text(0x29, 0x1012, "LO", "abcd")]);
    private.0.insert((0x29, 0x1010), ("UN", Value::Bytes(unknown.encode(Coding::Implicit, false))));
    for defined in [false, true] {
        let path = folder.write("a.dcm", &[&private.file_of("1.2.840.10008.1.2.1", Coding::Explicit, defined)]);
        assert_eq!(firsts(&read(&path).unwrap_or_else(|error| panic!("{error}"))), [5.0]);
    }
    // The same with no length, which makes it a sequence.
    let mut bytes = slice(SampleType::U8, &[5; 12], 0.0).without(0x7fe0, 0x10).file(Coding::Explicit);
    bytes.extend([0x29, 0, 0x10, 0x10, b'U', b'N', 0, 0, 255, 255, 255, 255]);
    bytes.extend([0xfe, 0xff, 0x00, 0xe0, 255, 255, 255, 255]);
    bytes.extend(Elements::default().text(0x29, 0x1012, "LO", "abcd").encode(Coding::Implicit, false));
    bytes.extend([0xfe, 0xff, 0x0d, 0xe0, 0, 0, 0, 0, 0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
    bytes.extend(Elements::default().pixels(1, &[5; 12]).encode(Coding::Explicit, false));
    // Its tag is below those of group 28, so the order is wrong, which readers have to live with.
    assert_eq!(firsts(&read(&folder.write("b.dcm", &[&bytes])).unwrap_or_else(|error| panic!("{error}"))), [5.0]);
}

fn compressed(name: &str) -> PathBuf {
    adjsplat_tests::repository().join("tests/readers/compressed").join(name)
}

/// What the writer of the compressed files put in: 13 x 9 or 12 x 10 x 3 samples of `bits` bits.
fn pattern([x, y, z]: [i64; 3], bits: u32, signed: bool) -> Vec<f64> {
    let mut samples = Vec::new();
    for frame in 0..z {
        for row in 0..y {
            for column in 0..x {
                let mut sample = (column * 37 + row * 101 + column * row * 7 + frame * 1000) % (1 << bits);
                if row == 0 && column < 2 {
                    sample = if column == 0 { 0 } else { (1 << bits) - 1 };
                }
                let sample = if signed { sample - (1 << (bits - 1)) } else { sample };
                samples.push(f64::from(i32::try_from(sample).expect("at most 16 bits")));
            }
        }
    }
    samples
}

#[test]
fn lossless_frames_are_read_exactly() {
    for (name, dims, bits, signed) in [
        ("i12-rle.dcm", [13, 9, 1], 12, true),
        ("multi-rle.dcm", [12, 10, 3], 12, false),
        ("i12-jpeg70.dcm", [13, 9, 1], 12, true),
        ("i12-j2k.dcm", [13, 9, 1], 12, true),
        ("u16-j2k.dcm", [13, 9, 1], 16, false),
        ("u8-jpeg70.dcm", [13, 9, 1], 8, false),
        ("multi-jpeg70.dcm", [12, 10, 3], 12, false),
    ] {
        let read = read(&compressed(name)).unwrap_or_else(|error| panic!("{error}"));
        let samples: Vec<f64> = (0..read.samples.len()).map(|i| read.samples.get(i)).collect();
        assert_eq!(samples, pattern(dims, bits, signed), "{name}");
    }
}

#[test]
fn baseline_jpeg_is_read_as_closely_as_it_was_written() {
    let read = read(&compressed("u8-baseline.dcm")).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read.header.grid.dims, [16, 12, 1]);
    for (i, column, row) in (0..192).map(|i| (i, i % 16, i / 16)) {
        let want = (column * 10 + row * 8) as f64;
        // libjpeg's own decoder is 1 off at most; another inverse transform may round the other way.
        assert!((read.samples.get(i) - want).abs() <= 2.0, "{column}, {row}: {}", read.samples.get(i));
    }
}

#[test]
fn codecs_that_are_not_here_are_named() {
    refused(&compressed("i12-jls.dcm"), &["transfer syntax", "gdcmconv --raw", "JPEG-LS"]);
    let folder = Folder::new();
    let odd = slice(SampleType::U8, &[0; 12], 0.0).file_of("1.2.840.10008.1.2.1.99", Coding::Explicit, true);
    refused(&folder.write("a.dcm", &[&odd]), &["Deflated", "gdcmconv --raw"]);
}

/// `jpeg` in a file of 13 x 9 of 12 bits.
fn as_jpeg(folder: &Folder, jpeg: &[u8]) -> PathBuf {
    let mut elements = slice(SampleType::I16, &[], 0.0)
        .number(0x28, 0x10, 9)
        .number(0x28, 0x11, 13)
        .number(0x28, 0x101, 12)
        .number(0x28, 0x102, 11);
    elements.0.insert((0x7fe0, 0x10), ("OB", Value::Fragments(vec![], vec![jpeg.to_vec()])));
    folder.write("a.dcm", &[&elements.file_of("1.2.840.10008.1.2.4.70", Coding::Explicit, true)])
}

#[test]
fn lossless_jpeg_that_the_decoder_gets_wrong_is_refused() {
    let folder = Folder::new();
    let file = std::fs::read(compressed("i12-jpeg70.dcm")).expect("it is there");
    let start = file.windows(3).position(|w| w == [0xff, 0xd8, 0xff]).expect("a JPEG stream");
    let end = file.windows(2).rposition(|w| w == [0xff, 0xd9]).expect("its end");
    let jpeg = &file[start..end + 2];
    assert_eq!(read(&as_jpeg(&folder, jpeg)).map(|read| read.samples.get(1)).ok(), Some(2047.0));
    let restarts = [&jpeg[..2], &[0xff, 0xdd, 0, 4, 0, 13], &jpeg[2..]].concat();
    refused(&as_jpeg(&folder, &restarts), &["restart markers", "gdcmconv --raw"]);
    let scan = jpeg.windows(2).position(|w| w == [0xff, 0xda]).expect("a scan");
    let mut shifted = jpeg.to_vec();
    shifted[scan + 9] |= 4;
    refused(&as_jpeg(&folder, &shifted), &["point transform"]);
    let frame = jpeg.windows(2).position(|w| w == [0xff, 0xc3]).expect("a frame");
    let mut larger = jpeg.to_vec();
    larger[frame + 5] = 0xff;
    refused(&as_jpeg(&folder, &larger), &["JPEG frames of 13 x 9", "got 13 x 65289"]);
    refused(&as_jpeg(&folder, &jpeg[..jpeg.len() / 2]), &["compressed pixels"]);
}

#[test]
fn sizes_and_types_that_cannot_be_are_refused() {
    let folder = Folder::new();
    let a = || slice(SampleType::U8, &[0; 12], 0.0);
    for (elements, parts) in [
        (a().number(0x28, 0x10, 0), ["DICOM Rows", "1 to 65535"]),
        (a().without(0x28, 0x11), ["DICOM Columns", "1 to 65535"]),
        (a().number(0x28, 0x10, 65_535), ["262140 bytes (4 x 65535 x 1 of u8)", "12 bytes"]),
        (a().number(0x28, 0x100, 1), ["Bits Allocated", "8, 16 or 32"]),
        (a().number(0x28, 0x101, 9), ["Bits Stored", "inside the 8 allocated"]),
        (a().number(0x28, 0x102, 8), ["Bits Stored", "high bit 8"]),
        (a().number(0x28, 0x101, 0), ["Bits Stored", "0 with high bit 7"]),
        (a().text(0x28, 0x10, "US", "xyz"), ["DICOM Rows", "two bytes"]),
        (a().text(0x28, 0x30, "DS", "1\\x"), ["Pixel Spacing", "2 finite numbers"]),
        (a().text(0x28, 0x30, "DS", "1\\nan"), ["Pixel Spacing", "2 finite numbers"]),
        (a().text(0x28, 0x30, "DS", "1\\0"), ["spacings above 0", "`OpenOptions::spacing`"]),
        (a().text(0x20, 0x37, "DS", "1\\0\\0\\1\\0\\0"), ["Orientation", "right angles"]),
        (a().text(0x20, 0x37, "DS", "0\\0\\0\\0\\0\\0"), ["Orientation", "right angles"]),
        (a().text(0x20, 0x32, "DS", "1\\2"), ["Position", "3 finite numbers"]),
        (a().without(0x20, 0x32).text(0x20, 0x13, "IS", "1e3"), ["Instance Number", "whole number"]),
        (a().text(0x28, 0x04, "CS", "PALETTE COLOR"), ["one grey sample", "PALETTE COLOR"]),
        (a().text(0x08, 0x103e, "UN", &"x".repeat(5000)), ["at most 4096 bytes", "5000"]),
    ] {
        refused(&elements.write(&folder, "a.dcm"), &parts);
    }
    let second = OpenOptions::new().volume_index(1);
    expect_refused(&a().write(&folder, "a.dcm"), &second, &["volume", "holds 1 volume"]);
}

#[test]
fn element_structure_that_lies_is_refused_before_anything_is_allocated() {
    let folder = Folder::new();
    let head = Elements::default().text(0x08, 0x60, "CS", "CT").file(Coding::Explicit);
    let element = |vr: &[u8; 2], len: u32| [&[0x29, 0, 0x10, 0x10], &vr[..], &[0, 0], &len.to_le_bytes()].concat();
    let item = |len: u32| [&[0xfe, 0xff, 0x00, 0xe0][..], &len.to_le_bytes()].concat();
    for (tail, parts) in [
        (element(b"UN", 0xffff_fff0), ["4294967280 bytes", "0 bytes left"]),
        (element(b"SQ", 0xffff_fff0), ["4294967280 bytes", "0 bytes left"]),
        ([element(b"SQ", 8), item(100), vec![0; 200]].concat(), ["its end at byte", "across its end"]),
        ([element(b"SQ", u32::MAX), element(b"UN", 0)].concat(), ["an item of (0029,1010)", "(0029,1010)"]),
        ([element(b"SQ", u32::MAX), item(u32::MAX)].concat(), ["end of the sequence (0029,1010)", "end of the file"]),
        (vec![0xfe, 0xff, 0x0d, 0xe0, 0, 0, 0, 0], ["an item that is not open", "DICOM item"]),
        (element(b"1x", 0), ["two capital letters", "\"1x\""]),
        ([element(b"SQ", u32::MAX), item(u32::MAX)].concat().repeat(70), ["at most 64 levels", "more"]),
        (vec![0xe0, 0x7f, 0x10, 0, b'O', b'W', 0, 0, 0xf0, 0xff, 0xff, 0xff], ["4294967280 bytes", "left in the file"]),
        (
            [&[0xe0, 0x7f, 0x10, 0, b'O', b'B', 0, 0, 255, 255, 255, 255][..], &item(0x0400_0000)].concat(),
            ["at most 65535 frames", "67108864 bytes"],
        ),
    ] {
        refused(&folder.write("a.dcm", &[&head, &tail]), &parts);
    }
    refused(&folder.write("a.dcm", &[&head[..132]]), &["transfer syntax (0002,0010)", "none"]);
}

#[test]
fn cut_and_damaged_files_never_panic() {
    let folder = Folder::new();
    let mut seeds: Vec<(String, Vec<u8>)> = vec![
        ("implicit".into(), known_slice(SampleType::I16, 0).file(Coding::Implicit)),
        ("enhanced".into(), enhanced().file_of("1.2.840.10008.1.2.1", Coding::Explicit, false)),
    ];
    for entry in std::fs::read_dir(compressed("")).expect("it is there") {
        let path = entry.expect("it is there").path();
        seeds.push((path.display().to_string(), std::fs::read(&path).expect("it can be read")));
    }
    let mut random = 0x2545_f491_4f6c_dd1d_u64;
    let mut next = |below: usize| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        usize::try_from(random >> 33).unwrap_or(0) % below
    };
    let mut taken = 0;
    for (_, whole) in &seeds {
        let mut try_file = |bytes: &[u8]| {
            // Whatever it says, it says it in words: a panic fails the test.
            // Writing over a file makes some systems wait for the disk.
            let _ = std::fs::remove_file(folder.path().join("a.dcm"));
            match read(&folder.write("a.dcm", &[bytes])) {
                Ok(_) => taken += 1,
                Err(error) => assert!(!error.to_string().contains('\n')),
            }
        };
        for cut in (0..whole.len()).step_by(3) {
            try_file(&whole[..cut]);
        }
        for _ in 0..400 {
            let mut bytes = whole.clone();
            for _ in 0..=next(3) {
                // The preamble means nothing, so damage there tests nothing.
                let at = 128 + next(bytes.len() - 128);
                bytes[at] = match next(4) {
                    0 => 0,
                    1 => 0xff,
                    2 => bytes[at] ^ (1 << next(8)),
                    _ => u8::try_from(next(256)).expect("below 256"),
                };
            }
            try_file(&bytes);
        }
    }
    assert!(taken > 100, "only {taken} damaged files were read, so the damage is too coarse to reach the decoders");
}
