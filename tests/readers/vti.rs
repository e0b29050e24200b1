//! The known volume in every variant of VTK XML images, and such files that must be refused.

use adjsplat::volume::{SampleType, SlabSource};
use adjsplat_readers::{Endian, open};

use super::damage::{expect_no_panic, expect_truncations_refused};
use super::sample::{ENDIANS, Folder, bytes, expect_known, expect_refused, known, read, text, zlib};

const TYPES: [&str; 8] = ["UInt8", "Int8", "UInt16", "Int16", "UInt32", "Int32", "Float32", "Float64"];
const EXTENT: &str = "0 3 0 2 0 1";

/// How an array's values stand in the file.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Form {
    Ascii,
    Binary,
    AppendedRaw,
    AppendedBase64,
}

/// A file that is put together here.
#[derive(Clone)]
struct Vti {
    ty: SampleType,
    endian: Endian,
    form: Form,
    compressor: Option<&'static str>,
    wide: bool,
    /// Bytes of a compressed block.
    block: usize,
}

impl Vti {
    fn new(ty: SampleType, form: Form) -> Vti {
        Vti { ty, endian: Endian::Little, form, compressor: None, wide: false, block: 16 }
    }

    fn number(&self, value: usize) -> Vec<u8> {
        let mut bytes = (value as u64).to_le_bytes()[..if self.wide { 8 } else { 4 }].to_vec();
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        bytes
    }

    /// An array's bytes as they stand in the file.
    fn packed(&self, plain: &[u8]) -> Vec<u8> {
        let encode = |bytes: &[u8]| match self.form {
            Form::AppendedRaw => bytes.to_vec(),
            _ => base64(bytes),
        };
        let Some(compressor) = self.compressor else {
            return encode(&[&self.number(plain.len()), plain].concat());
        };
        let blocks: Vec<Vec<u8>> = plain
            .chunks(self.block)
            .map(|block| match compressor {
                "vtkZLibDataCompressor" => zlib(block),
                _ => lz4_flex::block::compress(block),
            })
            .collect();
        let mut header = [self.number(blocks.len()), self.number(self.block)].concat();
        header.extend(self.number(plain.len() % self.block));
        header.extend(blocks.iter().flat_map(|block| self.number(block.len())));
        [encode(&header), encode(&blocks.concat())].concat()
    }

    fn head(&self) -> String {
        let order = if self.endian == Endian::Big { "BigEndian" } else { "LittleEndian" };
        let compressor = self.compressor.map_or(String::new(), |name| format!(" compressor=\"{name}\""));
        let wide = if self.wide { " header_type=\"UInt64\"" } else { "" };
        format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"0.1\" byte_order=\"{order}\"{wide}{compressor}>\n"
        )
    }

    /// The known volume, behind another array.
    fn file(&self) -> Vec<u8> {
        self.with(&format!("WholeExtent=\"{EXTENT}\" Origin=\"7 8 9\" Spacing=\"1 2 0.5\""), EXTENT, "PointData")
    }

    fn with(&self, image: &str, extent: &str, section: &str) -> Vec<u8> {
        let name = TYPES[SampleType::ALL.iter().position(|ty| *ty == self.ty).expect("one of them")];
        let values = known(self.ty);
        let first = self.packed(&[7; 72]);
        let second = self.packed(&bytes(&values, self.endian));
        let tags = |format: &str, attributes: [String; 2], inline: [Vec<u8>; 2]| {
            let open = |type_name: &str, array: &str, components: u32, more: &str| {
                format!(
                    "<DataArray type=\"{type_name}\" Name=\"{array}\" NumberOfComponents=\"{components}\" \
                     format=\"{format}\"{more}>\n"
                )
            };
            [
                format!("<{section} Scalars=\"values\">\n").as_bytes(),
                open("UInt8", "colours", 3, &attributes[0]).as_bytes(),
                &inline[0],
                b"\n</DataArray>\n",
                open(name, "values", 1, &attributes[1]).as_bytes(),
                &inline[1],
                b"\n<InformationKey name=\"k\" location=\"l\"><Value index=\"0\">3</Value></InformationKey></DataArray>\n",
                format!("</{section}>\n").as_bytes(),
            ]
            .concat()
        };
        let none = || [String::new(), String::new()];
        let arrays = match self.form {
            Form::Ascii => tags("ascii", none(), ["7 ".repeat(72).into(), text(&values).into()]),
            Form::Binary => tags("binary", none(), [first.clone(), second.clone()]),
            _ => tags(
                "appended",
                [" offset=\"0\"".into(), format!(" offset=\"{}\"", first.len())],
                [Vec::new(), Vec::new()],
            ),
        };
        let appended = match self.form {
            Form::AppendedRaw => [b"<AppendedData encoding=\"raw\">\n _", &first[..], &second[..]].concat(),
            Form::AppendedBase64 => [b"<AppendedData encoding=\"base64\">\n_", &first[..], &second[..]].concat(),
            _ => Vec::new(),
        };
        let close: &[u8] = if appended.is_empty() { b"" } else { b"\n</AppendedData>\n" };
        [
            self.head().as_bytes(),
            format!("<ImageData {image}>\n<FieldData><DataArray type=\"Int32\" Name=\"t\" format=\"ascii\">1</DataArray></FieldData>\n")
                .as_bytes(),
            format!("<Piece Extent=\"{extent}\">\n").as_bytes(),
            &arrays,
            b"</Piece></ImageData>\n",
            &appended,
            close,
            b"</VTKFile>\n",
        ]
        .concat()
    }
}

fn base64(bytes: &[u8]) -> Vec<u8> {
    const SIGNS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = Vec::new();
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0u32, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for place in 0..4 {
            let sign = SIGNS[(bits >> (18 - 6 * place)) as usize & 63];
            text.push(if place <= group.len() { sign } else { b'=' });
        }
    }
    text
}

/// Every form, with every compressor that it may have.
fn forms() -> Vec<(Form, Option<&'static str>)> {
    let mut forms = vec![(Form::Ascii, None)];
    for form in [Form::Binary, Form::AppendedRaw, Form::AppendedBase64] {
        for compressor in [None, Some("vtkZLibDataCompressor"), Some("vtkLZ4DataCompressor")] {
            forms.push((form, compressor));
        }
    }
    forms
}

#[test]
fn every_type_order_form_and_compressor_is_read() {
    let folder = Folder::new();
    for ty in SampleType::ALL {
        for (form, compressor) in forms() {
            for endian in ENDIANS {
                for (wide, block) in [(false, 16), (true, 1 << 20), (true, 24)] {
                    let vti = Vti { endian, compressor, wide, block, ..Vti::new(ty, form) };
                    let header = expect_known(&folder.write("a.vti", &[&vti.file()]), ty);
                    assert_eq!((header.grid.spacing, header.grid.origin), ([1.0, 2.0, 0.5], [7.0, 8.0, 9.0]));
                    assert_eq!(header.format, "VTK XML image");
                }
            }
        }
    }
}

#[test]
fn numbers_may_stand_right_before_the_tag_that_ends_them() {
    let folder = Folder::new();
    for form in [Form::Ascii, Form::Binary] {
        let file = String::from_utf8(Vti::new(SampleType::I32, form).file()).expect("text");
        expect_known(&folder.write("a.vti", &[file.replace("\n<Inf", "<Inf").as_bytes()]), SampleType::I32);
    }
    // The name does not matter, nor does what stands before the first tag.
    let file = Vti::new(SampleType::U8, Form::Ascii).file();
    expect_known(&folder.write("a.vtk", &["\u{feff}  ".as_bytes(), &file[22..]]), SampleType::U8);
}

#[test]
fn grids_start_where_their_extent_does() {
    let folder = Folder::new();
    let vti = Vti::new(SampleType::U8, Form::Binary);
    let grid_of = |image: &str, extent: &str| {
        let file = vti.with(image, extent, "PointData");
        expect_known(&folder.write("a.vti", &[&file]), SampleType::U8).grid
    };
    let extent = "10 13 -3 -1 5 6";
    let grid = grid_of(&format!("WholeExtent=\"{extent}\" Origin=\"100 0 0\" Spacing=\"1 2 3\""), extent);
    assert_eq!(grid.origin, [110.0, -6.0, 15.0]);
    // Rows of the matrix: x' = y, y' = -x; its first column is where x points.
    let turned = "Direction=\"0 1 0 -1 0 0 0 0 1\" Origin=\"0 0 0\" Spacing=\"1 2 3\"";
    let grid = grid_of(&format!("WholeExtent=\"{extent}\" {turned}"), extent);
    assert_eq!(grid.direction, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(grid.origin, [-6.0, -10.0, 15.0]);
    assert_eq!(grid_of(&format!("WholeExtent=\"{EXTENT}\""), EXTENT).spacing, [1.0; 3]);
}

#[test]
fn cells_are_a_grid_of_their_own_where_points_have_no_array() {
    let folder = Folder::new();
    let vti = Vti::new(SampleType::I16, Form::AppendedRaw);
    let file = vti.with("WholeExtent=\"0 4 0 3 0 2\" Spacing=\"1 2 4\"", "0 4 0 3 0 2", "CellData");
    let grid = expect_known(&folder.write("a.vti", &[&file]), SampleType::I16).grid;
    assert_eq!((grid.spacing, grid.origin), ([1.0, 2.0, 4.0], [0.5, 1.0, 2.0]));
    // A flat image has one layer of flat cells.
    let ascii = |extent: &str, section: &str, count: usize| {
        format!(
            "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"{extent}\"><Piece Extent=\"{extent}\"><{section}>\
             <DataArray type=\"UInt8\" Name=\"a\" format=\"ascii\">{}</DataArray>",
            "5 ".repeat(count)
        )
    };
    let path = folder.write("flat.vti", &[ascii("0 4 0 3 7 7", "CellData", 12).as_bytes()]);
    let got = read(&path).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((got.header.grid.dims, got.header.grid.origin), ([4, 3, 1], [0.5, 0.5, 7.0]));
    // Points come first, whatever the file's order.
    let cells = ascii("0 4 0 3 0 2", "CellData", 24);
    let both = format!(
        "{cells}</CellData><PointData><DataArray type=\"Int8\" format=\"ascii\">{}</DataArray></PointData>",
        "6 ".repeat(60)
    );
    let got = read(&folder.write("both.vti", &[both.as_bytes()])).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((got.header.grid.dims, got.samples.get(0)), ([5, 4, 3], 6.0));
}

#[test]
fn the_scalars_are_read_else_the_first_array_of_one_component() {
    let folder = Folder::new();
    let array = |name: &str, components: u32, value: u32| {
        let count = 24 * components as usize;
        let values = format!("{value} ").repeat(count);
        format!(
            "<DataArray type=\"UInt8\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\">{values}\
             </DataArray>"
        )
    };
    let arrays = [array("v", 3, 1), array("a", 1, 2), array("b", 1, 3)].concat();
    for (active, value) in [("Scalars=\"b\"", 3.0), ("Scalars=\"v\"", 2.0), ("", 2.0), ("Vectors=\"v\"", 2.0)] {
        let file = format!(
            "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"{EXTENT}\"><Piece><PointData {active}>{arrays}"
        );
        let got = read(&folder.write("a.vti", &[file.as_bytes()])).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(got.samples.get(5), value, "{active}");
    }
}

#[test]
fn what_cannot_be_read_is_named() {
    let folder = Folder::new();
    let whole = String::from_utf8(
        Vti { compressor: Some("vtkZLibDataCompressor"), ..Vti::new(SampleType::I16, Form::Binary) }.file(),
    )
    .expect("text");
    for (from, to, parts) in [
        ("\"ImageData\"", "\"UnstructuredGrid\"", ["ImageData", "\"UnstructuredGrid\""]),
        ("\"ImageData\"", "\"PImageData\"", ["ImageData", "\"PImageData\""]),
        ("vtkZLib", "vtkLZMA", ["vtkZLibDataCompressor", "\"vtkLZMADataCompressor\""]),
        ("LittleEndian", "MiddleEndian", ["BigEndian", "MiddleEndian"]),
        (" compressor", " header_type=\"UInt16\" compressor", ["UInt32 or UInt64", "UInt16"]),
        ("<Piece Extent=\"0 3 0 2 0 1\"", "<Piece Extent=\"0 3 0 2 0 0\"", ["one piece", "0 3 0 2 0 0"]),
        ("</Piece>", "</Piece><Piece Extent=\"0 3 0 2 0 1\"/>", ["one piece", "one more"]),
        ("WholeExtent=\"0 3 0 2 0 1\"", "WholeExtent=\"0 3 0 2 0\"", ["six whole numbers", "0 3 0 2 0"]),
        ("WholeExtent=\"0 3 0 2 0 1\"", "WholeExtent=\"0 -3 0 2 0 1\"", ["six whole numbers", "0 -3"]),
        ("WholeExtent=\"0 3 0 2 0 1\"", "", ["WholeExtent", "no such attribute"]),
        ("Spacing=\"1 2 0.5\"", "Spacing=\"1 0 1\"", ["`OpenOptions::spacing`", "1, 0, 1"]),
        ("Spacing=\"1 2 0.5\"", "Spacing=\"1 0\"", ["3 numbers", "1 0"]),
        ("\"Int16\"", "\"Int64\"", ["i16", "Int64"]),
        ("\"Int16\"", "\"Int32\"", ["96 bytes in all", "blocks of 16 bytes"]),
        ("\"Int16\"", "\"Int8\"", ["24 bytes in all", "blocks of 16 bytes"]),
        ("Components=\"1\"", "Components=\"2\"", ["array of one component", "\"values\" of 2 components"]),
        ("PointData", "Verts", ["array of one component", "no array"]),
        ("format=\"binary\"", "format=\"hex\"", ["ascii, binary or appended", "hex"]),
        ("format=\"binary\"", "format=\"appended\"", ["offset into AppendedData", "no AppendedData"]),
        ("VTKFile", "VTXFile", ["VTKFile", "no VTKFile"]),
        ("</ImageData>", "</ImagData>", ["well formed", "ImagData"]),
        ("<Piece", "<Piece \"", ["XML", "well formed"]),
        ("Piece", "Peace", ["one Piece", "none"]),
    ] {
        assert!(whole.contains(from), "{from}");
        // What has a twin, a closing tag or another array, is changed in both.
        let twice = ["Comp", "Piece", "PointData", "VTKFile", "format"].iter().any(|start| from.starts_with(start));
        let file = whole.replacen(from, to, if twice { 2 } else { 1 });
        expect_refused(&folder.write("a.vti", &[file.as_bytes()]), &Default::default(), &parts);
    }
    expect_refused(&folder.write("b.vti", &[b"abc"]), &Default::default(), &["VTKFile"]);
}

#[test]
fn headers_that_lie_are_refused_before_anything_is_allocated() {
    let folder = Folder::new();
    for (form, compressor) in forms().into_iter().filter(|(form, _)| *form != Form::Ascii) {
        let vti = Vti { compressor, wide: true, ..Vti::new(SampleType::F64, form) };
        // The largest grid there is: 2 PB.
        let huge = "0 65534 0 65534 0 65534";
        let file = vti.with(&format!("WholeExtent=\"{huge}\""), huge, "PointData");
        expect_refused(&folder.write("a.vti", &[&file]), &Default::default(), &["2251696736043000 decompressed"]);
        let beyond = "0 65535 0 1 0 1";
        let file = vti.with(&format!("WholeExtent=\"{beyond}\""), beyond, "PointData");
        expect_refused(&folder.write("a.vti", &[&file]), &Default::default(), &["points along x", "65536", "65535"]);
    }
    // Counts in the array's own header: 24 samples of u8 in two blocks of 16.
    let vti = Vti { compressor: Some("vtkZLibDataCompressor"), ..Vti::new(SampleType::U8, Form::AppendedRaw) };
    let good = vti.file();
    let start = good.len() - vti.packed(known(SampleType::U8).bytes()).len() - b"\n</AppendedData>\n</VTKFile>\n".len();
    for (place, value, part) in [
        (0, u32::MAX, "24 bytes in all"),
        (0, 0, "24 bytes in all"),
        (1, u32::MAX, "24 bytes in all"),
        (1, 0, "24 bytes in all"),
        (2, 17, "24 bytes in all"),
        (3, u32::MAX, "fit the file"),
        (3, 0, "fit the file"),
        (4, 1 << 20, "fit the file"),
    ] {
        let mut bad = good.clone();
        bad[start + 4 * place..][..4].copy_from_slice(&value.to_le_bytes());
        expect_refused(&folder.write("a.vti", &[&bad]), &Default::default(), &[part]);
    }
    // A block's last byte is of its checksum.
    let mut bad = good.clone();
    let first_block = u32::from_le_bytes(bad[start + 12..][..4].try_into().expect("four bytes")) as usize;
    bad[start + 20 + first_block - 1] ^= 1;
    expect_refused(&folder.write("a.vti", &[&bad]), &Default::default(), &["intact compressed stream"]);
    let plain = Vti::new(SampleType::U8, Form::Binary).file();
    let plain = String::from_utf8(plain).expect("text").replace("GAAAA", "GQAAA");
    expect_refused(&folder.write("a.vti", &[plain.as_bytes()]), &Default::default(), &["24 bytes", "25 bytes"]);
}

#[test]
fn tags_without_end_do_not_fill_the_memory() {
    let folder = Folder::new();
    let long = vec![b'x'; 5 << 20];
    for start in ["<VTKFile ", "<?xml version=\"1.0\"?><VTKFile type=\"ImageData\">", "<VTKFile a=\""] {
        let path = folder.write("a.vti", &[start.as_bytes(), &long]);
        expect_refused(&path, &Default::default(), &["XML tags", "4194304"]);
    }
    // Values are no tags: as many of them as there are points are read, and passed over.
    let values = "1 ".repeat(3 << 20);
    let extent = "0 1023 0 1023 0 2";
    let array = |name: &str| format!("<DataArray type=\"UInt8\" Name=\"{name}\" format=\"ascii\">{values}</DataArray>");
    let file = format!(
        "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"{extent}\"><Piece><PointData Scalars=\"b\">{}{}",
        array("a"),
        array("b")
    );
    assert_eq!(read(&folder.write("b.vti", &[file.as_bytes()])).expect("a good file").header.grid.dims[2], 3);
}

#[test]
fn one_block_is_what_is_held() {
    let folder = Folder::new();
    let vti =
        Vti { compressor: Some("vtkLZ4DataCompressor"), block: 1 << 20, ..Vti::new(SampleType::F64, Form::Binary) };
    let held = |vti: &Vti| {
        let source: Box<dyn SlabSource> =
            open(folder.write("a.vti", &[&vti.file()]), &Default::default()).expect("good");
        source.buffer_bytes()
    };
    // No more than there is: 24 samples of 8 bytes, and their packed bytes.
    assert!((192..1000).contains(&held(&vti)), "{}", held(&vti));
    assert_eq!(held(&Vti::new(SampleType::F64, Form::Binary)), 0);
}

#[test]
fn damage_is_refused_and_never_panics() {
    let folder = Folder::new();
    for (form, compressor) in forms() {
        let vti = Vti { compressor, ..Vti::new(SampleType::I16, form) };
        let path = folder.write("a.vti", &[&vti.file()]);
        expect_no_panic(&path, 150);
        let file = vti.file();
        // Behind the array is nothing that is needed.
        let needed = match form {
            Form::AppendedRaw | Form::AppendedBase64 => file.len() - b"\n</AppendedData>\n</VTKFile>\n".len(),
            _ => String::from_utf8_lossy(&file).find("\n<InformationKey").expect("it is there"),
        };
        expect_truncations_refused(&path, needed, SampleType::I16);
    }
}
