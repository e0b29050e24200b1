//! The known volume in every variant of TIFF, put together here byte by byte, and such files that must be refused.

use std::path::PathBuf;

use adjsplat::error::Error;
use adjsplat::volume::{Header, Sample, SampleType, SlabSource, StatedLabel};
use adjsplat_readers::{Endian, OpenOptions, open};

use super::damage::{expect_no_panic, expect_truncations_refused};
use super::sample::{DIMS, ENDIANS, Folder, bytes, expect_known, expect_refused, known, read, read_with, zlib};

/// Tags with values of their type: 2 text, 3 and 4 whole numbers, 5 fractions.
#[derive(Clone)]
enum Value {
    Text(Vec<u8>),
    Short(Vec<u64>),
    Long(Vec<u64>),
    Fraction(u64, u64),
}

/// How samples of a page are cut into chunks.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Cut {
    Strips(usize),
    Tiles(usize, usize),
}

/// How chunks are packed.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Packing {
    Plain,
    Deflate,
    /// Differences along rows, then deflate.
    DeflatePredicted,
    PackBits,
    Lzw,
    Zstd,
    /// Differences along rows, then zstd.
    ZstdPredicted,
}

/// A file that is put together here.
#[derive(Clone)]
struct Tiff {
    ty: SampleType,
    endian: Endian,
    big: bool,
    cut: Cut,
    packing: Packing,
    /// More tags, or others, of the first page.
    first_tags: Vec<(u16, Value)>,
    /// And of all.
    tags: Vec<(u16, Value)>,
}

impl Tiff {
    fn new(ty: SampleType) -> Tiff {
        let (first_tags, tags) = (Vec::new(), Vec::new());
        Tiff { ty, endian: Endian::Little, big: false, cut: Cut::Strips(3), packing: Packing::Plain, first_tags, tags }
    }

    fn described(ty: SampleType, text: &str) -> Tiff {
        Tiff { first_tags: vec![(270, Value::Text(text.as_bytes().to_vec()))], ..Tiff::new(ty) }
    }

    fn number(&self, width: usize, value: u64) -> Vec<u8> {
        let mut bytes = value.to_le_bytes()[..width].to_vec();
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        bytes
    }

    /// One page of 4 x 3 samples as packed chunks.
    fn chunks(&self, page: &[u8]) -> Vec<Vec<u8>> {
        let width = self.ty.bytes();
        let mut chunks = Vec::new();
        let (across, down, tiled) = match self.cut {
            Cut::Strips(rows) => (4, rows, false),
            Cut::Tiles(across, down) => (across, down, true),
        };
        for top in (0..3).step_by(down) {
            for left in (0..4).step_by(across) {
                let mut chunk = Vec::new();
                for y in top..top + down {
                    let mut row = Vec::new();
                    for x in left..left + across {
                        let at = (y * 4 + x) * width;
                        match page.get(at..at + width).filter(|_| x < 4) {
                            Some(sample) => row.extend_from_slice(sample),
                            // Beyond the page a tile has what it has.
                            None if tiled => row.extend(vec![0xa5; width]),
                            None => {}
                        }
                    }
                    if matches!(self.packing, Packing::DeflatePredicted | Packing::ZstdPredicted) {
                        self.predict(&mut row);
                    }
                    chunk.extend(row);
                }
                chunks.push(self.packed(&chunk));
            }
        }
        chunks
    }

    /// Turns a row into differences: of whole numbers, or of the bytes of floating-point ones, highest bytes first.
    fn predict(&self, row: &mut Vec<u8>) {
        let width = self.ty.bytes();
        if matches!(self.ty, SampleType::F32 | SampleType::F64) {
            let plane = |byte: usize| {
                let place = if self.endian == Endian::Big { byte } else { width - 1 - byte };
                row.chunks(width).map(move |sample| sample[place])
            };
            let planes: Vec<u8> = (0..width).flat_map(plane).collect();
            *row = planes.iter().zip([0].iter().chain(&planes)).map(|(a, b)| a.wrapping_sub(*b)).collect();
            return;
        }
        let value = |sample: &[u8]| {
            let digits: Vec<u8> = match self.endian {
                Endian::Big => sample.to_vec(),
                Endian::Little => sample.iter().rev().copied().collect(),
            };
            digits.iter().fold(0u64, |value, byte| value << 8 | u64::from(*byte))
        };
        let values: Vec<u64> = row.chunks(width).map(value).collect();
        let differences = values.iter().zip([0].iter().chain(&values)).map(|(a, b)| a.wrapping_sub(*b));
        *row = differences.flat_map(|difference| self.number(width, difference)).collect();
    }

    fn packed(&self, plain: &[u8]) -> Vec<u8> {
        let small = |len: usize| u8::try_from(len).expect("chunks here are small");
        match self.packing {
            Packing::Plain => plain.to_vec(),
            Packing::Deflate | Packing::DeflatePredicted => zlib(plain),
            // Runs of literals: a count less one, and the bytes.
            Packing::PackBits => plain.chunks(7).flat_map(|run| [&[small(run.len() - 1)], run].concat()).collect(),
            // Codes of 9 bits, the highest first: 256 starts a table, which is never let grow to 10; 257 ends it.
            Packing::Lzw => {
                let runs = plain.chunks(200).flat_map(|run| [256].into_iter().chain(run.iter().map(|b| u16::from(*b))));
                let bits: String = runs.chain([257]).map(|code| format!("{code:09b}")).collect();
                let byte = |bits: &[u8]| {
                    let digits = std::str::from_utf8(bits).expect("digits");
                    u8::from_str_radix(&format!("{digits:0<8}"), 2).expect("digits")
                };
                bits.as_bytes().chunks(8).map(byte).collect()
            }
            // RFC 8878: magic, one segment with a size of 4 bytes, and one last block of bytes as they are.
            Packing::Zstd | Packing::ZstdPredicted => {
                let size = u32::try_from(plain.len()).expect("chunks here are small");
                let block = size << 3 | 1;
                [&[0x28, 0xb5, 0x2f, 0xfd, 0xa0], &size.to_le_bytes()[..], &block.to_le_bytes()[..3], plain].concat()
            }
        }
    }

    /// The tags of page `page`, of which the chunks start at `offsets`.
    fn entries(&self, page: usize, offsets: &[u64], counts: &[u64]) -> Vec<(u16, Value)> {
        let kind = match self.ty {
            SampleType::U8 | SampleType::U16 | SampleType::U32 => 1,
            SampleType::I8 | SampleType::I16 | SampleType::I32 => 2,
            SampleType::F32 | SampleType::F64 => 3,
        };
        let (method, predictor) = match self.packing {
            Packing::Plain => (1, 1),
            Packing::Deflate => (8, 1),
            Packing::DeflatePredicted => (8, if kind == 3 { 3 } else { 2 }),
            Packing::PackBits => (32_773, 1),
            Packing::Lzw => (5, 1),
            Packing::Zstd => (50_000, 1),
            Packing::ZstdPredicted => (50_000, if kind == 3 { 3 } else { 2 }),
        };
        let short = |value: usize| Value::Short(vec![value as u64]);
        let mut entries = vec![
            (256, short(4)),
            (257, short(3)),
            (258, short(8 * self.ty.bytes())),
            (259, short(method)),
            (262, short(1)),
            (277, short(1)),
            (317, short(predictor)),
            (339, short(kind)),
        ];
        let places = [Value::Long(offsets.to_vec()), Value::Long(counts.to_vec())];
        let [offsets, counts] = places;
        match self.cut {
            Cut::Strips(rows) => entries.extend([(273, offsets), (278, short(rows)), (279, counts)]),
            Cut::Tiles(across, down) => {
                entries.extend([(322, short(across)), (323, short(down)), (324, offsets), (325, counts)]);
            }
        }
        for (tag, value) in self.tags.iter().chain(self.first_tags.iter().filter(|_| page == 0)) {
            entries.retain(|(found, _)| found != tag);
            entries.push((*tag, value.clone()));
        }
        entries.sort_by_key(|(tag, _)| *tag);
        entries
    }

    /// A file of these pages, each 4 x 3 samples.
    fn file(&self, pages: &[Vec<u8>]) -> Vec<u8> {
        let (word, order) = (if self.big { 8 } else { 4 }, if self.endian == Endian::Big { b"MM" } else { b"II" });
        let mut file = order.to_vec();
        if self.big {
            file.extend([self.number(2, 43), self.number(2, 8), self.number(2, 0)].concat());
        } else {
            file.extend(self.number(2, 42));
        }
        // Where the place of the next directory is to be written.
        let mut link = file.len();
        file.extend(vec![0; word]);
        for (page, samples) in pages.iter().enumerate() {
            let (mut offsets, mut counts) = (Vec::new(), Vec::new());
            for chunk in self.chunks(samples) {
                offsets.push(file.len() as u64);
                counts.push(chunk.len() as u64);
                file.extend(chunk);
            }
            let entries = self.entries(page, &offsets, &counts);
            let mut directory = self.number(if self.big { 8 } else { 2 }, entries.len() as u64);
            for (tag, value) in entries {
                let (kind, count, bytes) = match value {
                    Value::Text(text) => (2, text.len() + 1, [&text[..], &[0]].concat()),
                    Value::Short(values) => (3, values.len(), values.iter().flat_map(|v| self.number(2, *v)).collect()),
                    Value::Long(values) => (4, values.len(), values.iter().flat_map(|v| self.number(4, *v)).collect()),
                    Value::Fraction(above, below) => (5, 1, [self.number(4, above), self.number(4, below)].concat()),
                };
                directory.extend([self.number(2, u64::from(tag)), self.number(2, kind)].concat());
                directory.extend(self.number(word, count as u64));
                if bytes.len() <= word {
                    directory.extend([&bytes[..], &vec![0; word - bytes.len()]].concat());
                } else {
                    directory.extend(self.number(word, file.len() as u64));
                    file.extend(bytes);
                }
            }
            let at = self.number(word, file.len() as u64);
            file[link..link + word].copy_from_slice(&at);
            file.extend(directory);
            link = file.len();
            file.extend(vec![0; word]);
        }
        file
    }

    /// The known volume's slices.
    fn slices(&self) -> Vec<Vec<u8>> {
        bytes(&known(self.ty), self.endian).chunks(12 * self.ty.bytes()).map(<[u8]>::to_vec).collect()
    }

    fn known_file(&self) -> Vec<u8> {
        self.file(&self.slices())
    }
}

const CUTS: [Cut; 5] = [Cut::Strips(3), Cut::Strips(2), Cut::Strips(99), Cut::Tiles(16, 16), Cut::Tiles(3, 2)];
const PACKINGS: [Packing; 7] = [
    Packing::Plain,
    Packing::Deflate,
    Packing::DeflatePredicted,
    Packing::PackBits,
    Packing::Lzw,
    Packing::Zstd,
    Packing::ZstdPredicted,
];

fn refused(path: &std::path::Path, parts: &[&str]) {
    expect_refused(path, &OpenOptions::default(), parts);
}

#[test]
fn every_type_order_cut_and_packing_is_read() {
    let folder = Folder::new();
    for ty in SampleType::ALL {
        for endian in ENDIANS {
            for big in [false, true] {
                for cut in CUTS {
                    for packing in PACKINGS {
                        let tiff = Tiff { endian, big, cut, packing, ..Tiff::new(ty) };
                        let header = expect_known(&folder.write("a.tif", &[&tiff.known_file()]), ty);
                        assert_eq!((header.format, header.grid.spacing), ("TIFF", [1.0; 3]));
                    }
                }
            }
        }
    }
}

#[test]
fn tiles_in_lzw_that_reach_beyond_the_page_are_read_to_their_end() {
    let folder = Folder::new();
    for ty in SampleType::ALL {
        for cut in [Cut::Tiles(16, 16), Cut::Tiles(5, 3), Cut::Tiles(3, 2), Cut::Tiles(64, 1)] {
            let tiff = Tiff { cut, packing: Packing::Lzw, ..Tiff::new(ty) };
            expect_known(&folder.write("a.tif", &[&tiff.known_file()]), ty);
        }
    }
}

#[test]
fn files_of_another_writer_are_read() {
    use ::tiff::encoder::{Compression, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard, colortype};
    fn written<K: TiffKind>(mut encoder: TiffEncoder<std::fs::File, K>, compression: Compression) {
        encoder = encoder.with_compression(compression).with_predictor(::tiff::tags::Predictor::None);
        let adjsplat::volume::Samples::U16(samples) = known(SampleType::U16) else { unreachable!("asked for u16") };
        for slice in samples.chunks(12) {
            encoder.write_image::<colortype::Gray16>(4, 3, slice).expect("can be written");
        }
    }
    let folder = Folder::new();
    let path = folder.path().join("a.tif");
    for compression in [Compression::Uncompressed, Compression::Lzw, Compression::Packbits] {
        let file = || std::fs::File::create(&path).expect("can be written");
        written(TiffEncoder::<_, TiffKindStandard>::new(file()).expect("a header"), compression);
        expect_known(&path, SampleType::U16);
        written(TiffEncoder::<_, TiffKindBig>::new_generic(file()).expect("a header"), compression);
        expect_known(&path, SampleType::U16);
    }
}

/// Files of 20 x 10 x 2 samples that tifffile 2026.3.3 and libzstd packed: v = 7 x^2 + 31 y + 1000 z.
#[test]
fn files_that_libzstd_packed_are_read() {
    let values = |z: i32| (0..200).map(move |at| 7 * (at % 20) * (at % 20) + 31 * (at / 20) + 1000 * z);
    let compressed = adjsplat_tests::repository().join("tests/readers/compressed");
    for (name, ty, factor) in [
        ("u16-zstd-strips.tif", SampleType::U16, 1.0),
        ("f32-zstd-tiles.tif", SampleType::F32, 0.125),
        ("i32-zstd-tiles.tif", SampleType::I32, -1.0),
    ] {
        let got = read(&compressed.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!((got.header.grid.dims, got.header.sample_type), ([20, 10, 2], ty), "{name}");
        let samples: Vec<f64> = adjsplat::with_samples!(&got.samples, v => v.iter().map(|s| s.to_f64()).collect());
        assert!(samples.into_iter().eq((0..2).flat_map(values).map(|v| f64::from(v) * factor)), "{name}");
    }
}

#[test]
fn thumbnails_and_masks_are_passed_over() {
    let folder = Folder::new();
    let tiff = Tiff::new(SampleType::I16);
    let slices = tiff.slices();
    for (tag, kind) in [(254, 1), (254, 4), (254, 5), (255, 2)] {
        let small = Tiff { first_tags: vec![(tag, Value::Long(vec![kind]))], ..tiff.clone() };
        let file = small.file(&[slices[1].clone(), slices[0].clone(), slices[1].clone()]);
        expect_known(&folder.write("a.tif", &[&file]), SampleType::I16);
    }
    let pages = Tiff { tags: vec![(254, Value::Long(vec![2]))], ..tiff.clone() };
    expect_known(&folder.write("a.tif", &[&pages.known_file()]), SampleType::I16);
    let none = Tiff { tags: vec![(254, Value::Long(vec![1]))], ..tiff };
    refused(&folder.write("a.tif", &[&none.known_file()]), &["a page at full resolution", "2 pages", "thumbnails"]);
}

#[test]
fn samples_are_taken_as_stored_also_where_zero_is_white() {
    let folder = Folder::new();
    let white = |ty| Tiff { tags: vec![(262, Value::Short(vec![0]))], ..Tiff::new(ty) };
    for ty in [SampleType::U8, SampleType::U16, SampleType::U32] {
        for cut in CUTS {
            expect_known(&folder.write("a.tif", &[&Tiff { cut, ..white(ty) }.known_file()]), ty);
        }
    }
    let path = folder.write("a.tif", &[&white(SampleType::F32).known_file()]);
    refused(&path, &["0 shown as white", "f32", "invert"]);
}

#[test]
fn files_that_libjpeg_packed_are_read() {
    // Strips of 8 and 4 rows, with their tables in a tag.
    let file = adjsplat_tests::repository().join("tests/readers/compressed/u8-jpeg-strips.tif");
    let got = read(&file).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((got.header.grid.dims, got.header.sample_type), ([16, 12, 1], SampleType::U8));
    for (i, column, row) in (0..192).map(|i| (i, i % 16, i / 16)) {
        let want = (column * 10 + row * 8) as f64;
        // libjpeg's own decoder is 1 off at most; another inverse transform may round the other way.
        assert!((got.samples.get(i) - want).abs() <= 2.0, "{column}, {row}: {}", got.samples.get(i));
    }
    let folder = Folder::new();
    let content = std::fs::read(&file).expect("it is there");
    let path = folder.write("a.tif", &[&content]);
    expect_no_panic(&path, 1000);
    // The frame of the first strip says that it has 65,288 rows.
    let frame = content.windows(2).position(|pair| pair == [0xff, 0xc0]).expect("a frame");
    let mut larger = content;
    larger[frame + 5] = 0xff;
    refused(&folder.write("b.tif", &[&larger]), &["JPEG frames of 16 x 8", "16 x 65288"]);
}

/// Numbers of the tag ColorMap for indices of 8 bits.
fn palette(colour: impl Fn(u64) -> [u64; 3]) -> Vec<(u16, Value)> {
    palette_of(256, colour)
}

fn palette_of(count: u64, colour: impl Fn(u64) -> [u64; 3]) -> Vec<(u16, Value)> {
    let part = |part: usize| (0..count).map(|index| colour(index)[part]).collect::<Vec<u64>>();
    vec![(262, Value::Short(vec![3])), (320, Value::Short([part(0), part(1), part(2)].concat()))]
}

#[test]
fn palettes_of_greys_are_read_through_and_indices_into_colours_are_kept_with_a_note() {
    let folder = Folder::new();
    let indices = known(SampleType::U8);
    let notes = |path: &std::path::Path| open(path, &OpenOptions::new()).expect("read before").notes().to_vec();
    for endian in ENDIANS {
        for (big, cut, packing) in [
            (false, Cut::Strips(3), Packing::Plain),
            (true, Cut::Strips(2), Packing::Deflate),
            (false, Cut::Tiles(16, 16), Packing::Lzw),
            (false, Cut::Strips(1), Packing::Zstd),
        ] {
            let tiff = Tiff { endian, big, cut, packing, ..Tiff::new(SampleType::U8) };
            let mut inverted = indices.clone();
            inverted.bytes_mut().iter_mut().for_each(|sample| *sample = 255 - *sample);
            type Colour = fn(u64) -> [u64; 3];
            for (colour, want) in [
                ((|i| [257 * i; 3]) as Colour, &indices),
                (|i| [256 * i; 3], &indices),
                (|i| [i; 3], &indices),
                (|i| [65_535 - 257 * i; 3], &inverted),
            ] {
                let path = folder.write("grey.tif", &[&Tiff { tags: palette(colour), ..tiff.clone() }.known_file()]);
                assert_eq!(&read(&path).unwrap_or_else(|error| panic!("{error}")).samples, want);
                assert_eq!(notes(&path), Vec::<String>::new());
            }
            let coloured = Tiff { tags: palette(|i| [257 * i, 0, 300]), ..tiff };
            let path = folder.write("coloured.tif", &[&coloured.known_file()]);
            expect_known(&path, SampleType::U8);
            assert!(notes(&path)[0].starts_with("warning: samples of coloured.tif are indices"), "{:?}", notes(&path));
        }
    }
    let mut differ = Tiff { tags: palette(|i| [i; 3]), ..Tiff::new(SampleType::U8) };
    differ.first_tags = palette(|i| [i, i, 0]);
    refused(&folder.write("a.tif", &[&differ.known_file()]), &["the palette of page 0", "another one in page 1"]);
    differ.first_tags = vec![(320, Value::Short(vec![0; 30]))];
    refused(&folder.write("a.tif", &[&differ.known_file()]), &["768 numbers in its ColorMap", "30 in page 0"]);
}

#[test]
fn colours_of_a_palette_are_those_of_its_labels() {
    let folder = Folder::new();
    let labels = |name: &str, tiff: &Tiff| {
        let source = open(folder.write(name, &[&tiff.known_file()]), &OpenOptions::new()).expect("a TIFF file");
        assert_eq!(source.notes().is_empty(), source.labels().is_some(), "{:?}", source.notes());
        source.labels().map(<[StatedLabel]>::to_vec)
    };
    // Bytes in the high byte of a number, in both, and in the low one.
    for scale in [256, 257, 1] {
        let tiff =
            Tiff { tags: palette(|i| [97 * i % 256, 31 * i % 256, i].map(|c| c * scale)), ..Tiff::new(SampleType::U8) };
        let found = labels("labels.tif", &tiff).expect("labels");
        assert_eq!(found.len(), 255, "index 0 is the background");
        assert_eq!(found[4], StatedLabel { value: 5, name: "5".into(), colour: [229, 155, 5] });
    }
    // Most palettes of few labels are black behind them.
    let few = palette(|i| {
        [[0; 3], [65_535, 0, 0], [0, 65_535, 0]].get(usize::try_from(i).unwrap()).copied().unwrap_or_default()
    });
    assert_eq!(
        labels("few.tif", &Tiff { tags: few, ..Tiff::new(SampleType::U8) }).expect("labels")[1].colour,
        [0, 255, 0]
    );
    // A colour scale shows measured values, as of a microscope's channel or a line from samples to values.
    for scale in [|i| [0, 257 * i, 0], |i| [257 * i, 257 * (255 - i), 128], |i| [514 * (i % 128), 0, 257 * i]] {
        assert_eq!(labels("scale.tif", &Tiff { tags: palette(scale), ..Tiff::new(SampleType::U8) }), None);
    }
    let mut calibrated = Tiff::described(SampleType::U8, "ImageJ=1.53\nimages=2\nslices=2\ncf=0\nc0=5\nc1=0.5\n");
    calibrated.tags = palette(|i| [97 * i % 256, 31 * i % 256, i]);
    assert_eq!(labels("calibrated.tif", &calibrated), None);
}

#[test]
fn samples_smaller_than_a_byte_are_unpacked() {
    let folder = Folder::new();
    let short = |value: u64| Value::Short(vec![value]);
    for bits in [1, 2, 4u64] {
        let per_byte = 8 / bits;
        for endian in ENDIANS {
            for cut in CUTS {
                for packing in [Packing::Plain, Packing::Deflate, Packing::PackBits, Packing::Lzw, Packing::Zstd] {
                    for (meaning, missing) in [(1, 0), (0, 0), (3, 1)] {
                        // A row of the known volume has four bytes; the last sample may be left out.
                        let width = 4 * per_byte - missing;
                        let mut tiff = Tiff { endian, cut, packing, ..Tiff::new(SampleType::U8) };
                        tiff.tags = vec![(256, short(width)), (258, short(bits)), (262, short(meaning))];
                        if let Cut::Tiles(across, _) = cut {
                            tiff.tags.push((322, short(across as u64 * per_byte)));
                        }
                        if meaning == 3 {
                            tiff.tags.extend(palette_of(1 << bits, |i| [65_535 * (i % 2), 9_000 * (i % 3), 0]));
                        }
                        let path = folder.write("a.tif", &[&tiff.known_file()]);
                        let read = read(&path).unwrap_or_else(|error| panic!("{error}"));
                        assert_eq!(read.header.grid.dims, [u32::try_from(width).unwrap(), 3, 2]);
                        let unpacked = |byte: &u8| {
                            let byte = *byte;
                            (0..per_byte).map(move |i| byte >> (8 - bits * (i + 1)) & ((1 << bits) - 1))
                        };
                        let rows = tiff.slices().concat();
                        let rows = rows.chunks(4).flat_map(|row| {
                            row.iter().flat_map(unpacked).take(usize::try_from(width).unwrap()).collect::<Vec<u8>>()
                        });
                        assert_eq!(read.samples.bytes(), rows.collect::<Vec<u8>>(), "{bits} {cut:?} {packing:?}");
                    }
                }
            }
        }
    }
    let four =
        |more: (u16, Value)| Tiff { tags: vec![(258, short(4)), more], ..Tiff::new(SampleType::U8) }.known_file();
    refused(
        &folder.write("a.tif", &[&four((317, short(2)))]),
        &["at least 8 bits under a predictor", "4 bits in page 0"],
    );
    refused(&folder.write("a.tif", &[&four((259, short(7)))]), &["at least 8 bits under a predictor or JPEG"]);
    let tiled = Tiff { cut: Cut::Tiles(3, 2), tags: vec![(258, short(4))], ..Tiff::new(SampleType::U8) };
    refused(
        &folder.write("a.tif", &[&tiled.known_file()]),
        &["tiles that fill whole bytes", "tiles of 3 samples of 4 bits"],
    );
}

/// The header of the known volume with these resolution tags and description.
fn header_of(folder: &Folder, description: &str, resolution: Option<([u64; 2], [u64; 2], u64)>) -> Header {
    let mut tiff = Tiff::new(SampleType::U16);
    if !description.is_empty() {
        tiff.first_tags.push((270, Value::Text(description.as_bytes().to_vec())));
    }
    if let Some(([x, per_x], [y, per_y], unit)) = resolution {
        tiff.first_tags.extend([
            (282, Value::Fraction(x, per_x)),
            (283, Value::Fraction(y, per_y)),
            (296, Value::Short(vec![unit])),
        ]);
    }
    expect_known(&folder.write("a.tif", &[&tiff.known_file()]), SampleType::U16)
}

fn near(got: [f64; 3], want: [f64; 3]) -> bool {
    got.iter().zip(want).all(|(got, want)| (got / want - 1.0).abs() < 1e-12)
}

#[test]
fn spacing_comes_from_resolution_tags() {
    let folder = Folder::new();
    for (resolution, spacing, unit) in [
        (([100, 1], [50, 1], 3), [0.1, 0.2, 0.1], Some("mm")),
        (([254, 1], [254, 1], 2), [0.1, 0.1, 0.1], Some("mm")),
        // No unit: the ratio is all that is known.
        (([2, 1], [4, 1], 1), [0.5, 0.25, 0.5], None),
        // What writers put that know none.
        (([72, 1], [72, 1], 2), [1.0, 1.0, 1.0], None),
        (([0, 1], [1, 0], 3), [1.0, 1.0, 1.0], None),
        (([0, 0], [100, 1], 3), [0.1, 0.1, 0.1], Some("mm")),
    ] {
        let grid = header_of(&folder, "made by hand", Some(resolution)).grid;
        assert!(near(grid.spacing, spacing), "{resolution:?}: {:?}", grid.spacing);
        assert_eq!(grid.unit.as_deref(), unit, "{resolution:?}");
    }
}

#[test]
fn imagej_says_spacing_unit_and_the_line_from_samples_to_values() {
    let folder = Folder::new();
    let lines = |more: &str| format!("ImageJ=1.54f\nimages=2\nslices=2\n{more}loop=false\n");
    let resolution = Some(([5, 1], [4, 1], 1));
    for (more, spacing, unit) in [
        ("unit=micron\nspacing=2.5\n", [0.2, 0.25, 2.5], Some("um")),
        ("unit=\\u00B5m\nspacing=-3\n", [0.2, 0.25, 3.0], Some("um")),
        ("unit=\u{b5}m\n", [0.2, 0.25, 1.0], Some("um")),
        ("unit=mm\nspacing=abc\n", [0.2, 0.25, 1.0], Some("mm")),
        ("unit=pixel\n", [0.2, 0.25, 1.0], None),
    ] {
        let header = header_of(&folder, &lines(more), resolution);
        assert!(near(header.grid.spacing, spacing), "{more}: {:?}", header.grid.spacing);
        assert_eq!((header.grid.unit.as_deref(), header.format), (unit, "ImageJ TIFF"), "{more}");
        assert_eq!((header.slope, header.intercept), (1.0, 0.0));
    }
    // Resolution per centimetre, description in micrometres.
    let grid = header_of(&folder, &lines("unit=um\n"), Some(([20_000, 1], [20_000, 1], 3))).grid;
    assert!(near(grid.spacing, [0.5, 0.5, 1.0]), "{:?}", grid.spacing);
    // A micro sign as a single byte, as old versions wrote it.
    let latin = b"ImageJ=1.40g\nimages=2\nslices=2\nunit=\xb5m\n".to_vec();
    let tiff = Tiff { first_tags: vec![(270, Value::Text(latin))], ..Tiff::new(SampleType::U8) };
    let header = expect_known(&folder.write("a.tif", &[&tiff.known_file()]), SampleType::U8);
    assert_eq!(header.grid.unit.as_deref(), Some("um"));
    let header = header_of(&folder, &lines("cf=0\nc0=-32768.0\nc1=1.5\nvunit=HU\n"), None);
    assert_eq!((header.slope, header.intercept), (1.5, -32768.0));
    // 72 per inch, without a unit and with one.
    let inch = Some(([72, 1], [36, 1], 2));
    assert_eq!(header_of(&folder, &lines(""), inch).grid.spacing, [1.0, 2.0, 1.0]);
    assert!(near(header_of(&folder, &lines("unit=inch\n"), inch).grid.spacing, [1.0 / 72.0, 1.0 / 36.0, 1.0]));
    // A curve is no line: samples stay what they are.
    let header = header_of(&folder, &lines("cf=3\nc0=1\nc1=2\n"), None);
    assert_eq!((header.slope, header.intercept), (1.0, 0.0));
}

/// Six pages, of which page `p` has samples `100 * p` and up.
fn numbered(tiff: &Tiff) -> Vec<Vec<u8>> {
    (0..6u64).map(|page| (0..12).flat_map(|i| tiff.number(2, 100 * page + i)).collect()).collect()
}

/// First samples of the slices of each volume of the file at `path`, and the refusal of the one after the last.
fn volumes_of(path: &std::path::Path, count: u32) -> Vec<Vec<f64>> {
    let options = |volume_index| OpenOptions::new().volume_index(volume_index);
    expect_refused(path, &options(count), &["volume", &format!("is {count}, but the file holds {count} volume")]);
    let first = |volume| {
        let got = read_with(path, &options(volume)).unwrap_or_else(|error| panic!("{error}"));
        let slices = got.header.grid.dims[2] as usize;
        (0..slices).map(|slice| got.samples.get(slice * 12)).collect()
    };
    (0..count).map(first).collect()
}

#[test]
fn imagej_channels_and_frames_are_volumes() {
    let folder = Folder::new();
    for endian in ENDIANS {
        for (sizes, volumes) in [
            ("slices=6\n", vec![vec![0.0, 100.0, 200.0, 300.0, 400.0, 500.0]]),
            ("", vec![vec![0.0, 100.0, 200.0, 300.0, 400.0, 500.0]]),
            ("channels=2\nslices=3\nhyperstack=true\n", vec![vec![0.0, 200.0, 400.0], vec![100.0, 300.0, 500.0]]),
            ("slices=3\nframes=2\n", vec![vec![0.0, 100.0, 200.0], vec![300.0, 400.0, 500.0]]),
            ("channels=3\nframes=2\n", (0..6).map(|page| vec![f64::from(100 * page)]).collect()),
            ("channels=2.0\n", vec![vec![0.0, 200.0, 400.0], vec![100.0, 300.0, 500.0]]),
        ] {
            let text = format!("ImageJ=1.54f\nimages=6\n{sizes}");
            let tiff = Tiff { endian, ..Tiff::described(SampleType::U16, &text) };
            let pages = numbered(&tiff);
            let path = folder.write("a.tif", &[&tiff.file(&pages)]);
            let count = u32::try_from(volumes.len()).expect("few");
            assert_eq!(volumes_of(&path, count), volumes, "{sizes}");
            // The same with one directory, as ImageJ writes above 4 GB: the others' samples follow the first's.
            for big in [false, true] {
                let single = contiguous(&Tiff { big, ..tiff.clone() }, &pages);
                let path = folder.write("b.tif", &[&single]);
                assert_eq!(volumes_of(&path, count), volumes, "one directory: {sizes}");
            }
        }
    }
}

/// A file of one directory, and behind it the samples of all pages.
fn contiguous(tiff: &Tiff, pages: &[Vec<u8>]) -> Vec<u8> {
    let offset =
        |at: u64| Tiff { first_tags: [&tiff.first_tags[..], &[(273, Value::Long(vec![at]))]].concat(), ..tiff.clone() };
    let len = offset(0).file(&pages[..1]).len();
    [&offset(len as u64).file(&pages[..1])[..], &pages.concat()].concat()
}

#[test]
fn imagej_stacks_of_one_directory_have_all_their_samples() {
    let folder = Folder::new();
    let tiff = Tiff::described(SampleType::U16, "ImageJ=1.54f\nimages=6\nslices=6\n");
    let good = contiguous(&tiff, &numbered(&tiff));
    refused(&folder.write("a.tif", &[&good[..good.len() - 1]]), &["6 images", "4 x 3 of u16", "a file of"]);
    for text in ["ImageJ=1\nimages=99999999999999\n", "ImageJ=1\nimages=18446744073709551615\n"] {
        let many = Tiff::described(SampleType::U16, text);
        refused(&folder.write("a.tif", &[&contiguous(&many, &numbered(&many))]), &["images of 4 x 3", "a file of"]);
    }
    for tiff in [Tiff { packing: Packing::Deflate, ..tiff.clone() }, Tiff { cut: Cut::Tiles(16, 16), ..tiff.clone() }] {
        let file = tiff.file(&numbered(&tiff)[..1]);
        refused(&folder.write("a.tif", &[&file]), &["a directory for each of its 6 images", "one directory"]);
    }
    for (sizes, want) in [("slices=4\n", "4 slices x 1 channels"), ("channels=4\n", "1 slices x 4 channels x 1 frames")]
    {
        let tiff = Tiff::described(SampleType::U16, &format!("ImageJ=1.54f\nimages=6\n{sizes}"));
        refused(&folder.write("a.tif", &[&tiff.file(&numbered(&tiff))]), &[want, "6 pages"]);
        refused(&folder.write("a.tif", &[&contiguous(&tiff, &numbered(&tiff))]), &[want, "6 pages"]);
    }
}

#[test]
fn imagej_stacks_of_one_directory_are_no_slices_of_a_folder() {
    let tiff = Tiff::described(SampleType::U16, "ImageJ=1.54f\nimages=6\nslices=6\n");
    let folder = Folder::new();
    for name in ["a.tif", "b.tif"] {
        folder.write(name, &[&contiguous(&tiff, &numbered(&tiff))]);
    }
    refused(folder.path(), &["a.tif", "holds 6 pages, but files of a stack have one each"]);
    // A slice that was taken out of a stack may keep the description.
    let tiff = Tiff::described(SampleType::U16, "ImageJ=1.54f\nimages=600\nslices=600\n");
    for name in ["a.tif", "b.tif"] {
        folder.write(name, &[&tiff.file(&numbered(&tiff)[..1])]);
    }
    assert_eq!(volumes_of(folder.path(), 1), [[0.0, 0.0]]);
}

fn ome(pixels: &str, inside: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\">\
         <Image ID=\"Image:0\"><Pixels ID=\"Pixels:0\" {pixels} SizeX=\"4\" SizeY=\"3\" Type=\"uint16\">{inside}\
         </Pixels></Image><Image ID=\"Image:1\"><Pixels SizeZ=\"9\" SizeC=\"9\" SizeT=\"9\"/></Image></OME>"
    )
}

#[test]
fn ome_says_which_page_is_which_slice() {
    let folder = Folder::new();
    let czt = "DimensionOrder=\"XYCZT\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\"";
    let zct = "DimensionOrder=\"XYZCT\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\"";
    let tzc = "DimensionOrder=\"XYTZC\" SizeZ=\"3\" SizeC=\"1\" SizeT=\"2\"";
    let (even, odd) = (vec![0.0, 200.0, 400.0], vec![100.0, 300.0, 500.0]);
    let (low, high) = (vec![0.0, 100.0, 200.0], vec![300.0, 400.0, 500.0]);
    let one_by_one = "<TiffData FirstC=\"0\" FirstZ=\"2\" IFD=\"0\"/><TiffData IFD=\"1\" FirstZ=\"1\" PlaneCount=\"1\"/>\
                      <TiffData IFD=\"5\" FirstZ=\"0\"/><TiffData IFD=\"2\" FirstC=\"1\" PlaneCount=\"3\"/>";
    let named = "<TiffData IFD=\"0\" PlaneCount=\"6\"><UUID FileName=\"old name.tif\">urn:uuid:1</UUID></TiffData>";
    for (pixels, inside, volumes) in [
        (czt, "", vec![even.clone(), odd.clone()]),
        (czt, "<TiffData/>", vec![even.clone(), odd.clone()]),
        (zct, "<TiffData IFD=\"0\" PlaneCount=\"6\"/>", vec![low.clone(), high.clone()]),
        (tzc, named, vec![even, odd]),
        (zct, one_by_one, vec![vec![500.0, 100.0, 0.0], vec![200.0, 300.0, 400.0]]),
    ] {
        let tiff = Tiff::described(SampleType::U16, &ome(pixels, inside));
        let path = folder.write("a.ome.tif", &[&tiff.file(&numbered(&tiff))]);
        assert_eq!(volumes_of(&path, u32::try_from(volumes.len()).expect("few")), volumes, "{pixels} {inside}");
    }
    // Pages of another image may have any shape.
    let small = "DimensionOrder=\"XYZCT\" SizeZ=\"2\" SizeC=\"1\" SizeT=\"1\"";
    let tiff = Tiff::described(SampleType::U16, &ome(small, "<TiffData IFD=\"0\" PlaneCount=\"2\"/>"));
    let path = folder.write("a.ome.tif", &[&tiff.file(&numbered(&tiff))]);
    assert_eq!(volumes_of(&path, 1), [[0.0, 100.0]]);
}

#[test]
fn ome_says_how_far_apart_points_are() {
    let folder = Folder::new();
    let sizes = "DimensionOrder=\"XYZCT\" SizeZ=\"2\" SizeC=\"1\" SizeT=\"1\"";
    for (lengths, spacing, unit) in [
        ("PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.25\" PhysicalSizeZ=\"2\"", [0.5, 0.25, 2.0], Some("um")),
        (
            "PhysicalSizeX=\"0.5\" PhysicalSizeXUnit=\"\u{b5}m\" PhysicalSizeY=\"500\" PhysicalSizeYUnit=\"nm\" \
             PhysicalSizeZ=\"0.002\" PhysicalSizeZUnit=\"mm\"",
            [0.5, 0.5, 2.0],
            Some("um"),
        ),
        ("PhysicalSizeX=\"3\" PhysicalSizeXUnit=\"mm\"", [3.0, 3.0, 3.0], Some("mm")),
        ("PhysicalSizeX=\"3\" PhysicalSizeXUnit=\"&#xb5;m\" PhysicalSizeZ=\"7\"", [3.0, 3.0, 7.0], Some("um")),
        ("PhysicalSizeX=\"3\" PhysicalSizeXUnit=\"&#181;m\"", [3.0, 3.0, 3.0], Some("um")),
        (
            "PhysicalSizeX=\"30\" PhysicalSizeXUnit=\"m\" PhysicalSizeZ=\"7\" PhysicalSizeZUnit=\"km\"",
            [30.0, 30.0, 7000.0],
            Some("m"),
        ),
        ("PhysicalSizeX=\"3\" PhysicalSizeXUnit=\"pixel\" PhysicalSizeZ=\"7\"", [3.0, 3.0, 3.0], None),
        ("PhysicalSizeX=\"nan\" PhysicalSizeZ=\"7\"", [7.0, 7.0, 7.0], Some("um")),
        ("", [1.0; 3], None),
    ] {
        let header = header_of(&folder, &ome(&format!("{sizes} {lengths}"), ""), Some(([72, 1], [72, 1], 2)));
        assert!(near(header.grid.spacing, spacing), "{lengths}: {:?}", header.grid.spacing);
        assert_eq!((header.grid.unit.as_deref(), header.format), (unit, "OME-TIFF"), "{lengths}");
    }
    let lengths = "PhysicalSizeX=\"3\" PhysicalSizeZ=\"7\" PhysicalSizeZUnit=\"pixel\"";
    let tiff = Tiff::described(SampleType::U16, &ome(&format!("{sizes} {lengths}"), ""));
    let source = open(folder.write("a.tif", &[&tiff.known_file()]), &OpenOptions::new()).expect("a TIFF file");
    let note = "warning: a distance in \"pixel\" is replaced by that along x, which is in \"um\"";
    assert_eq!((source.notes(), source.header().grid.spacing), (&[note.to_owned()][..], [3.0; 3]));
}

#[test]
fn ome_that_cannot_be_followed_is_refused() {
    let folder = Folder::new();
    let good = "DimensionOrder=\"XYZCT\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\"";
    let uuid = |name: &str| format!("<TiffData IFD=\"0\"><UUID FileName=\"{name}\">u</UUID></TiffData>");
    for (pixels, inside, parts) in [
        (good.replace("\"3\"", "\"4\"").as_str(), "", ["slice 2 of volume 1", "page 6 of 6"]),
        (good.replace("\"3\"", "\"0\"").as_str(), "", ["SizeZ", "above 0"]),
        (good.replace("\"3\"", "\"70000\"").as_str(), "", ["points along z", "70000"]),
        (good.replace("\"3\"", "\"18446744073709551615\"").as_str(), "", ["planes of its image", "needs"]),
        (good.replace("XYZCT", "XYZZT").as_str(), "", ["DimensionOrder", "XYZZT"]),
        (good, "<TiffData FirstZ=\"3\"/>", ["FirstZ below 3", "got 3"]),
        (good, "<TiffData IFD=\"x\"/>", ["IFD, a number", "\"x\""]),
        (good, "<TiffData IFD=\"0\" PlaneCount=\"5\"/>", ["slice 2 of volume 1", "none"]),
        (
            good,
            "<TiffData IFD=\"18446744073709551615\" PlaneCount=\"6\"/>",
            ["slice 0 of volume 1", "a page of the file"],
        ),
        (good, &[uuid("a"), uuid("b")].concat(), ["all planes in one file", "\"b\"; join"]),
        (good, "</Wrong>", ["OME-XML", "well formed"]),
    ] {
        let tiff = Tiff::described(SampleType::U16, &ome(pixels, inside));
        let path = folder.write("a.tif", &[&tiff.file(&numbered(&tiff))]);
        expect_refused(&path, &OpenOptions::new().volume_index(1), &parts);
    }
    let binary_only = Tiff::described(SampleType::U16, "<OME><BinaryOnly MetadataFile=\"m\"/></OME>");
    refused(&folder.write("a.tif", &[&binary_only.known_file()]), &["an image with Pixels", "another file"]);
}

/// A folder with a file for each of `pages`, under these names.
fn stack(names: &[&str], tiff: &Tiff, pages: &[Vec<u8>]) -> Folder {
    let folder = Folder::new();
    for (name, page) in names.iter().zip(pages) {
        folder.write(name, &[&tiff.file(std::slice::from_ref(page))]);
    }
    folder
}

#[test]
fn a_folder_of_files_is_a_stack_in_natural_order() {
    let tiff = Tiff { packing: Packing::Deflate, ..Tiff::described(SampleType::U16, "ImageJ=1.54f\nunit=mm\n") };
    let names = ["slice2.tif", "Slice10.TIF", "slice11", "slice100.tif", "slice1000.dat", "t.tif"];
    let folder = stack(&names, &tiff, &numbered(&tiff));
    folder.write("Thumbs.db", &[b"not a slice"]);
    folder.write("slice3.txt", &[b"nor this"]);
    folder.write(".slice4.tif", &[b"II*\0"]);
    std::fs::create_dir(folder.path().join("slice5")).expect("new");
    assert_eq!(volumes_of(folder.path(), 1), [[0.0, 100.0, 200.0, 300.0, 400.0, 500.0]]);
    let got = read(folder.path()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(got.header.grid.unit.as_deref(), Some("mm"));
    assert_eq!(got.header.name, folder.path().file_name().expect("a name").to_string_lossy());
    // One file is what it is alone.
    let folder = Folder::new();
    folder.write("only.tif", &[&Tiff::new(SampleType::I8).known_file()]);
    expect_known(folder.path(), SampleType::I8);
}

#[test]
fn folders_that_are_no_stack_are_refused_by_the_file_at_fault() {
    let tiff = Tiff::new(SampleType::U16);
    let pages = numbered(&tiff);
    let names = ["s1.tif", "s2.tif", "s3.tif"];
    let folder = Folder::new();
    folder.write("a.txt", &[b"hello"]);
    refused(folder.path(), &["is a folder without TIFF or DICOM files", "open a file in it"]);
    let raw = adjsplat_readers::RawOptions::new(DIMS, SampleType::U8);
    expect_refused(folder.path(), &OpenOptions::new().raw(raw), &["has 0 files of 12 bytes", "name it"]);
    let folder = stack(&names, &tiff, &pages);
    folder.write("s2.tif", &[&Tiff::new(SampleType::I16).file(&pages[..1])]);
    refused(folder.path(), &["s2.tif", "4 x 3 of u16 as in s1.tif", "4 x 3 of i16 in page 0"]);
    let narrow = Tiff { tags: vec![(256, Value::Short(vec![2]))], ..Tiff::new(SampleType::U16) };
    folder.write("s2.tif", &[&narrow.file(&pages[..1])]);
    refused(folder.path(), &["s2.tif", "2 x 3 of u16"]);
    folder.write("s2.tif", &[&tiff.file(&pages[..2])]);
    refused(folder.path(), &["s2.tif", "holds 2 pages", "name the file itself"]);
    folder.write("s2.tif", &[b"II*\0"]);
    refused(folder.path(), &["s2.tif", "its end before"]);
    let many = "DimensionOrder=\"XYZCT\" SizeZ=\"1\" SizeC=\"3\" SizeT=\"1\"";
    let folder = stack(&names, &Tiff::described(SampleType::U16, &ome(many, "")), &pages);
    refused(folder.path(), &["s1.tif", "3 channels and times", "join them"]);
    // A file is lost while the stack is open.
    let folder = stack(&names, &tiff, &pages);
    let mut source = open(folder.path(), &OpenOptions::default()).expect("a good stack");
    std::fs::remove_file(folder.path().join("s2.tif")).expect("it is there");
    let mut slice = source.header().new_slice().expect("24 bytes");
    source.read_slice(&mut slice).expect("the first is there");
    assert!(matches!(source.read_slice(&mut slice), Err(Error::Io { .. })));
    assert!(source.read_slice(&mut slice).is_err_and(|error| error.to_string().contains("rewind first")));
}

#[test]
fn pages_that_cannot_be_read_are_named_with_what_would_do() {
    let folder = Folder::new();
    let with =
        |tag: u16, value: u64| Tiff { tags: vec![(tag, Value::Short(vec![value]))], ..Tiff::new(SampleType::U16) };
    for (tag, value, parts) in [
        (262, 2, ["grey values", "RGB colours in page 0"]),
        (262, 3, ["TIFF palette", "196608 numbers in its ColorMap"]),
        (262, 6, ["grey values", "YCbCr"]),
        (277, 3, ["one sample a pixel", "3 samples a pixel"]),
        (258, 12, ["one of u8", "unsigned whole numbers of 12 bits"]),
        (258, 64, ["one of u8", "64 bits"]),
        (339, 3, ["one of u8", "floating-point numbers of 16 bits"]),
        (339, 6, ["one of u8", "unknown kind"]),
        (266, 2, ["TIFF FillOrder", "the lowest bit first"]),
        (317, 2, ["TIFF predictor", "1 for samples that are not compressed"]),
        (259, 6, ["LZW, deflate", "Technical Note 2"]),
        (259, 7, ["intact compressed stream", "JPEG"]),
        (259, 34_887, ["LZW, deflate", "LERC"]),
        (259, 4, ["LZW, deflate", "fax"]),
        (256, 0, ["page", "can be read"]),
        (256, 60_000, ["TIFF chunk", "a file of"]),
        (278, 0, ["page", "can be read"]),
        (257, 65_535, ["page", "can be read"]),
        (279, 0, ["page", "can be read"]),
    ] {
        // Without counts the file has no chunks; the rest is refused for what it says.
        let tiff = if tag == 279 {
            Tiff { tags: vec![(279, Value::Long(vec![]))], ..Tiff::new(SampleType::U16) }
        } else {
            with(tag, value)
        };
        refused(&folder.write("a.tif", &[&tiff.known_file()]), &parts);
    }
    let grid =
        Tiff { tags: vec![(256, Value::Long(vec![70_000])), (273, Value::Long(vec![0]))], ..Tiff::new(SampleType::U8) };
    let long = [grid.file(&[vec![0; 12]]), vec![0; 300_000]].concat();
    refused(&folder.write("a.tif", &[&long]), &["points along x", "70000", "65535"]);
    // Pages that differ.
    let mut pages = Tiff::new(SampleType::U16);
    pages.first_tags.push((257, Value::Short(vec![2])));
    refused(&folder.write("a.tif", &[&pages.known_file()]), &["4 x 2 of u16 as in page 0", "4 x 3 of u16 in page 1"]);
    for content in [&b"II*\0"[..], b"II*\0\x08\0\0\0", b"MM\0+\0\x08\0\0", b"II*\0\xff\xff\xff\xff"] {
        refused(&folder.write("a.tif", &[content]), &["TIFF page", "its end before"]);
    }
    refused(&folder.write("b.tif", &[b"abc"]), &["TIFF page", "the first page"]);
    // Directories in a circle.
    let tiff = Tiff::new(SampleType::U8);
    let mut circle = tiff.known_file();
    let first = circle[4..8].to_vec();
    let last = circle.len() - 4;
    circle[last..].copy_from_slice(&first);
    refused(&folder.write("c.tif", &[&circle]), &["TIFF page", "cycle"]);
}

#[test]
fn packed_chunks_that_are_damaged_or_too_short_are_refused() {
    let folder = Folder::new();
    for packing in [Packing::Deflate, Packing::Zstd, Packing::ZstdPredicted, Packing::Lzw, Packing::PackBits] {
        let tiff = Tiff { packing, ..Tiff::new(SampleType::U16) };
        let (good, chunk) = (tiff.known_file(), tiff.chunks(&tiff.slices()[1])[0].clone());
        let at = good.windows(chunk.len()).position(|found| found == chunk).expect("it is there");
        let mut bad = good.clone();
        bad[at..at + chunk.len()].fill(0xff);
        let path = folder.write("a.tif", &[&bad]);
        match packing {
            Packing::PackBits => assert_ne!(read(&path).map(|got| got.samples).ok(), Some(known(SampleType::U16))),
            _ => refused(&path, &["page 1", "copy or download"]),
        }
        let lying = Tiff { tags: vec![(279, Value::Long(vec![0]))], ..tiff };
        refused(&folder.write("a.tif", &[&lying.known_file()]), &["a chunk of 24 bytes", "0 bytes, too few"]);
    }
    // 2^31 rows in a deflate stream of a few bytes.
    let tall = Tiff {
        packing: Packing::Deflate,
        tags: vec![
            (257, Value::Long(vec![65_535])),
            (256, Value::Long(vec![65_535])),
            (278, Value::Long(vec![65_535])),
        ],
        ..Tiff::new(SampleType::F64)
    };
    refused(&folder.write("a.tif", &[&tall.known_file()]), &["a chunk of 34358689800 bytes", "too few"]);
}

#[test]
fn descriptions_that_lie_about_their_length_are_refused() {
    let folder = Folder::new();
    let mut file = Tiff::described(SampleType::U8, "a description of some length").known_file();
    // Tag 270 of type 2: its count follows.
    let at = file.windows(4).position(|found| found == [14, 1, 2, 0]).expect("it is there") + 4;
    file[at..at + 4].copy_from_slice(&0x7fff_ffffu32.to_le_bytes());
    refused(&folder.write("a.tif", &[&file]), &["bytes of its description", "2147483647"]);
}

#[test]
fn one_tile_and_the_list_of_chunks_are_what_is_held() {
    let folder = Folder::new();
    let held = |cut| {
        let path: PathBuf = folder.write("a.tif", &[&Tiff { cut, ..Tiff::new(SampleType::U16) }.known_file()]);
        let source: Box<dyn SlabSource> = open(&path, &OpenOptions::default()).expect("good");
        source.buffer_bytes()
    };
    assert_eq!((held(Cut::Strips(2)), held(Cut::Tiles(16, 2)), held(Cut::Tiles(16, 16))), (160, 64 + 160, 96 + 80));
    let wide =
        Tiff { cut: Cut::Tiles(16, 3), tags: vec![(322, Value::Long(vec![1 << 28]))], ..Tiff::new(SampleType::U16) };
    refused(&folder.write("a.tif", &[&wide.known_file()]), &["bytes of one tile", "1610612736"]);
}

#[test]
fn damage_is_refused_and_never_panics() {
    let folder = Folder::new();
    for cut in [Cut::Strips(2), Cut::Tiles(3, 2)] {
        for packing in PACKINGS {
            for (endian, big) in [(Endian::Little, false), (Endian::Big, true)] {
                let tiff = Tiff { cut, packing, endian, big, ..Tiff::new(SampleType::I16) };
                let path = folder.write("a.tif", &[&tiff.known_file()]);
                expect_no_panic(&path, 100);
                if matches!(packing, Packing::Plain | Packing::Deflate) {
                    expect_truncations_refused(&path, tiff.known_file().len(), SampleType::I16);
                }
            }
        }
    }
    let xml =
        ome("DimensionOrder=\"XYZCT\" SizeZ=\"2\" SizeC=\"1\" SizeT=\"1\"", "<TiffData IFD=\"0\" PlaneCount=\"2\"/>");
    for text in [xml.as_str(), "ImageJ=1.54f\nimages=2\nslices=2\nunit=mm\nspacing=2\n"] {
        let path = folder.write("a.tif", &[&Tiff::described(SampleType::I16, text).known_file()]);
        expect_no_panic(&path, 500);
    }
    let indexed = Tiff { tags: palette(|i| [i; 3]), ..Tiff::new(SampleType::U8) };
    expect_no_panic(&folder.write("a.tif", &[&indexed.known_file()]), 300);
    let mut small =
        Tiff { cut: Cut::Tiles(2, 2), tags: palette_of(16, |i| [5 * i, 9 * i, 0]), ..Tiff::new(SampleType::U8) };
    small.tags.extend([(256, 8), (258, 4), (322, 4)].map(|(tag, value)| (tag, Value::Short(vec![value]))));
    expect_no_panic(&folder.write("a.tif", &[&small.known_file()]), 500);
    let tiff = Tiff::described(SampleType::I16, "ImageJ=1.54f\nimages=2\n");
    let path = folder.write("a.tif", &[&contiguous(&tiff, &tiff.slices())]);
    expect_known(&path, SampleType::I16);
    expect_no_panic(&path, 300);
}
