//! The known volume as NIfTI-1 and -2, written field by field from the standard's offsets.

use adjsplat::volume::SampleType;
use adjsplat_readers::{Endian, OpenOptions, open};

use super::sample::{ENDIANS, Folder, bytes, expect_known, expect_refused, gzip, known, read, read_with};

/// A header under construction; numbers go in by the given order.
#[derive(Clone)]
pub(crate) struct Nifti {
    version: u8,
    endian: Endian,
    bytes: Vec<u8>,
}

impl Nifti {
    /// Of the known volume of `ty`, in one file.
    pub(crate) fn new(version: u8, endian: Endian, ty: SampleType) -> Nifti {
        let code = match ty {
            SampleType::U8 => 2,
            SampleType::I16 => 4,
            SampleType::I32 => 8,
            SampleType::F32 => 16,
            SampleType::F64 => 64,
            SampleType::I8 => 256,
            SampleType::U16 => 512,
            SampleType::U32 => 768,
        };
        let len = if version == 1 { 348 } else { 540 };
        let mut nifti = Nifti { version, endian, bytes: vec![0; len + 4] };
        nifti.put(0, &i32::try_from(len).expect("small").to_le_bytes());
        if version == 1 {
            nifti.bytes[344..348].copy_from_slice(b"n+1\0");
        } else {
            nifti.bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n");
        }
        for (i, size) in [3, 4, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
            nifti.dim(i, size);
        }
        nifti.datatype(code);
        for i in 0..8 {
            nifti.pixdim(i, 1.0);
        }
        nifti.vox_offset(if version == 1 { 352 } else { 544 });
        nifti
    }

    fn put(&mut self, at: usize, little: &[u8]) {
        let mut field = little.to_vec();
        if self.endian == Endian::Big {
            field.reverse();
        }
        self.bytes[at..at + field.len()].copy_from_slice(&field);
    }

    #[expect(clippy::cast_possible_truncation, reason = "test values are short")]
    fn real(&mut self, at_1: usize, at_2: usize, value: f64) {
        match self.version {
            1 => self.put(at_1, &(value as f32).to_le_bytes()),
            _ => self.put(at_2, &value.to_le_bytes()),
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "test values are short")]
    fn code(&mut self, at_1: usize, at_2: usize, value: i32) {
        match self.version {
            1 => self.put(at_1, &(value as i16).to_le_bytes()),
            _ => self.put(at_2, &value.to_le_bytes()),
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "test values are short")]
    pub(crate) fn dim(&mut self, i: usize, size: i64) {
        match self.version {
            1 => self.put(40 + 2 * i, &(size as i16).to_le_bytes()),
            _ => self.put(16 + 8 * i, &size.to_le_bytes()),
        }
    }

    pub(crate) fn datatype(&mut self, code: i16) {
        self.put(if self.version == 1 { 70 } else { 12 }, &code.to_le_bytes());
    }

    pub(crate) fn pixdim(&mut self, i: usize, value: f64) {
        self.real(76 + 4 * i, 104 + 8 * i, value);
    }

    #[expect(clippy::cast_precision_loss, reason = "test values are short")]
    pub(crate) fn vox_offset(&mut self, offset: i64) {
        match self.version {
            1 => self.real(108, 0, offset as f64),
            _ => self.put(168, &offset.to_le_bytes()),
        }
    }

    fn scaling(&mut self, slope: f64, intercept: f64) {
        self.real(112, 176, slope);
        self.real(116, 184, intercept);
    }

    fn quatern(&mut self, code: i32, bcd: [f64; 3], offset: [f64; 3]) {
        self.code(252, 344, code);
        for i in 0..3 {
            self.real(256 + 4 * i, 352 + 8 * i, bcd[i]);
            self.real(268 + 4 * i, 376 + 8 * i, offset[i]);
        }
    }

    fn sform(&mut self, code: i32, rows: [[f64; 4]; 3]) {
        self.code(254, 348, code);
        for (r, row) in rows.into_iter().enumerate() {
            for (c, value) in row.into_iter().enumerate() {
                self.real(280 + 16 * r + 4 * c, 400 + 32 * r + 8 * c, value);
            }
        }
    }

    fn intent(&mut self, code: i32) {
        self.code(68, 504, code);
    }

    fn units(&mut self, code: u8) {
        match self.version {
            1 => self.bytes[123] = code,
            _ => self.put(500, &i32::from(code).to_le_bytes()),
        }
    }

    /// Makes it the header of a pair.
    pub(crate) fn pair(&mut self) {
        let at = if self.version == 1 { 345 } else { 5 };
        self.bytes[at] = b'i';
        self.vox_offset(0);
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

#[test]
fn both_versions_are_read_in_every_type_and_order() {
    let folder = Folder::new();
    for ty in SampleType::ALL {
        for (version, endian) in [(1, ENDIANS[0]), (1, ENDIANS[1]), (2, ENDIANS[0]), (2, ENDIANS[1])] {
            let mut nifti = Nifti::new(version, endian, ty);
            let packed = bytes(&known(ty), endian);
            let path = folder.write("a.nii", &[nifti.bytes(), &packed]);
            let header = expect_known(&path, ty);
            assert_eq!(header.format, if version == 1 { "NIfTI-1" } else { "NIfTI-2" });
            let zipped = gzip(&[nifti.bytes(), &packed].concat());
            expect_known(&folder.write("a.nii.gz", &[&zipped]), ty);
            // Gzip is known by its first bytes, and extensions lie between header and samples.
            expect_known(&folder.write("misnamed.nii", &[&zipped]), ty);
            nifti.vox_offset(560);
            let gap = vec![9; 560 - nifti.bytes().len()];
            expect_known(&folder.write("b.nii", &[nifti.bytes(), &gap, &packed]), ty);
            nifti.vox_offset(0);
            expect_known(&folder.write("c.nii", &[nifti.bytes(), &packed]), ty);
            nifti.pair();
            let pair = folder.write("p.hdr", &[nifti.bytes()]);
            let image = folder.write("p.img", &[&packed]);
            expect_known(&pair, ty);
            expect_known(&image, ty);
            let single = Nifti::new(version, endian, ty);
            expect_known(&folder.write("alone.hdr", &[single.bytes(), &packed]), ty);
            let zipped_pair = folder.write("q.hdr.gz", &[&gzip(nifti.bytes())]);
            let zipped_image = folder.write("q.img.gz", &[&gzip(&packed)]);
            expect_known(&zipped_pair, ty);
            expect_known(&zipped_image, ty);
        }
    }
}

#[test]
fn scaling_units_and_transforms_are_taken() {
    let folder = Folder::new();
    for version in [1, 2] {
        let read = |nifti: &Nifti| {
            let path = folder.write("a.nii", &[nifti.bytes(), known(SampleType::U8).bytes()]);
            expect_known(&path, SampleType::U8)
        };
        let mut nifti = Nifti::new(version, Endian::Little, SampleType::U8);
        nifti.scaling(0.0, 5.0);
        assert_eq!((read(&nifti).slope, read(&nifti).intercept), (1.0, 0.0), "slope 0 is no scaling");
        nifti.scaling(0.5, -3.0);
        assert_eq!((read(&nifti).slope, read(&nifti).intercept), (0.5, -3.0));
        for (code, unit) in [(0, None), (1, Some("m")), (10, Some("mm")), (3, Some("um"))] {
            nifti.units(code);
            assert_eq!(read(&nifti).grid.unit.as_deref(), unit);
        }
        // No transform: spacing alone.
        for (i, step) in [2.0, 3.0, 0.5].into_iter().enumerate() {
            nifti.pixdim(i + 1, step);
        }
        let grid = read(&nifti).grid;
        assert_eq!((grid.spacing, grid.direction[0]), ([2.0, 3.0, 0.5], [1.0, 0.0, 0.0]));
        // A half turn about z, and the third axis the other way round.
        nifti.quatern(1, [0.0, 0.0, 1.0], [1.0, 2.0, 3.0]);
        nifti.pixdim(0, -1.0);
        let grid = read(&nifti).grid;
        assert_eq!(grid.origin, [1.0, 2.0, 3.0]);
        assert_eq!(grid.direction, [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]);
        // A quarter turn about x takes y to z.
        let half = f64::sqrt(0.5);
        nifti.quatern(1, [half, 0.0, 0.0], [0.0; 3]);
        nifti.pixdim(0, 1.0);
        let y = read(&nifti).grid.direction[1];
        assert!(y[1].abs() < 1e-6 && (y[2] - 1.0).abs() < 1e-6, "{y:?}");
        // A quaternion that is longer than one is a half turn about where it points.
        nifti.quatern(1, [0.0, 30.0, 40.0], [0.0; 3]);
        let y = read(&nifti).grid.direction[1];
        let want = [0.0, 0.36 - 0.64, 0.96];
        assert!((0..3).all(|c| (y[c] - want[c]).abs() < 1e-6), "{y:?}");
        // A transform of code 0 is passed over, any other has the word.
        nifti.sform(0, [[0.0; 4]; 3]);
        assert_eq!(read(&nifti).grid.spacing, [2.0, 3.0, 0.5]);
        nifti.sform(1, [[0.0, 4.0, 0.0, 10.0], [5.0, 0.0, 0.0, 20.0], [0.0, 0.0, -6.0, 30.0]]);
        let grid = read(&nifti).grid;
        assert_eq!((grid.spacing, grid.origin), ([5.0, 4.0, 6.0], [10.0, 20.0, 30.0]));
        assert_eq!(grid.direction, [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
    }
}

#[test]
fn a_singular_or_infinite_transform_is_refused() {
    let folder = Folder::new();
    let (spacing, directions) = ("three spacings above 0", "three independent directions");
    let row = [1.0, 0.0, 0.0, 0.0];
    for version in [1, 2] {
        for (rows, part) in [
            ([[0.0; 4]; 3], spacing),
            ([row, [0.0, f64::NAN, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]], spacing),
            ([row, [0.0, 1.0, f64::INFINITY, 0.0], [0.0, 0.0, 1.0, 0.0]], spacing),
            ([row, [0.0, 1.0, 1.0, 0.0], [0.0, 1.0, 1.0, 0.0]], directions),
            ([[1.0, 0.0, 0.0, f64::NAN], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]], directions),
        ] {
            let mut nifti = Nifti::new(version, Endian::Little, SampleType::U8);
            nifti.quatern(1, [0.0, 0.0, 1.0], [0.0; 3]);
            nifti.sform(1, rows);
            let path = folder.write("a.nii", &[nifti.bytes(), known(SampleType::U8).bytes()]);
            expect_refused(&path, &OpenOptions::new(), &["NIfTI grid", part]);
            // Other spacings do not help, so none are asked for.
            let other = OpenOptions::new().spacing([1.0; 3]);
            expect_refused(&path, &other, &["NIfTI grid", directions]);
            let error = open(&path, &OpenOptions::new()).map(drop).unwrap_err().to_string();
            assert!(!error.contains("OpenOptions::spacing"), "{error}");
        }
    }
}

#[test]
fn the_axes_that_a_file_lacks_need_no_direction() {
    let folder = Folder::new();
    let mut nifti = Nifti::new(1, Endian::Little, SampleType::U8);
    nifti.sform(1, [[0.0, 2.0, 0.0, 7.0], [3.0, 0.0, 0.0, 0.0], [0.0; 4]]);
    for (used, want) in [
        (2, [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
        (1, [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
    ] {
        nifti.dim(0, used);
        let path = folder.write("a.nii", &[nifti.bytes(), known(SampleType::U8).bytes()]);
        let grid = open(&path, &OpenOptions::new()).unwrap_or_else(|error| panic!("{error}")).header().grid.clone();
        assert_eq!((grid.direction, grid.origin), (want, [7.0, 0.0, 0.0]));
    }
}

#[test]
fn a_magic_that_was_transferred_as_text_is_refused() {
    let folder = Folder::new();
    for magic in [b"n+2\0\n\x1a\n\0", b"n+2\0\0\0\0\0", b"n-2\0\r\n\x1a\n"] {
        let mut nifti = Nifti::new(2, Endian::Little, SampleType::U8);
        nifti.bytes[4..12].copy_from_slice(magic);
        let path = folder.write("a.nii", &[nifti.bytes(), known(SampleType::U8).bytes()]);
        expect_refused(&path, &OpenOptions::new(), &["NIfTI magic", "n+2\\x00\\r\\n\\x1a\\n"]);
    }
}

#[test]
fn the_intent_code_says_that_values_are_labels() {
    let folder = Folder::new();
    let known = known(SampleType::I16);
    for version in [1, 2] {
        for endian in ENDIANS {
            for (code, want) in [(1002, Some(0)), (0, None), (1001, None)] {
                let mut nifti = Nifti::new(version, endian, SampleType::I16);
                nifti.intent(code);
                let path = folder.write("labels.nii", &[nifti.bytes(), &bytes(&known, endian)]);
                expect_known(&path, SampleType::I16);
                let source = open(&path, &OpenOptions::new()).unwrap();
                assert_eq!(source.labels().map(<[_]>::len), want, "{version} {endian:?} {code}");
            }
        }
    }
}

/// A program that writes beside the image must not write over its header.
#[test]
fn the_files_of_a_pair_are_its_image_and_its_header() {
    let folder = Folder::new();
    let mut nifti = Nifti::new(1, Endian::Little, SampleType::U8);
    nifti.pair();
    let header = folder.write("a.hdr", &[nifti.bytes()]);
    let image = folder.write("a.img", &[known(SampleType::U8).bytes()]);
    for path in [&header, &image] {
        let source = open(path, &OpenOptions::new()).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(source.data_files(), [image.clone(), header.clone()]);
    }
    let text = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\ndata file: a.img\n";
    let header = folder.write("a.nhdr", &[text.as_bytes()]);
    let source = open(&header, &OpenOptions::new()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(source.data_files(), [image, header]);
}

#[test]
fn volumes_of_a_series_are_chosen_by_index() {
    let folder = Folder::new();
    let packed = bytes(&known(SampleType::U16), Endian::Big);
    let other = vec![1; packed.len()];
    let mut nifti = Nifti::new(1, Endian::Big, SampleType::U16);
    nifti.dim(0, 5);
    nifti.dim(5, 2);
    let whole = [nifti.bytes(), &other, &packed].concat();
    for path in [folder.write("a.nii", &[&whole]), folder.write("a.nii.gz", &[&gzip(&whole)])] {
        let second = OpenOptions::new().volume_index(1);
        let got = read_with(&path, &second).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(got.samples, known(SampleType::U16));
        assert_ne!(read(&path).expect("the first").samples, known(SampleType::U16));
        let third = OpenOptions::new().volume_index(2);
        expect_refused(&path, &third, &["volume: is 2", "holds 2 volumes"]);
    }
}
