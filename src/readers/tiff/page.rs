//! Finds the pages of one TIFF file, checks them, and reads their samples.
//!
//! In: a file. Out: the pages' numbers in the chain of directories, their shapes, and the samples of one page, chunk by
//! chunk. (A directory holds the tags of a page; a chunk is a strip or a tile.) The `tiff` crate reads directories and
//! unpacks most chunks. This module adds checks before any allocation: that the file has the bytes which its
//! directories list, and that the kind of page is supported.

use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use ::tiff::TiffError;
use ::tiff::decoder::ifd::Value;
use ::tiff::decoder::{ChunkType, Decoder, DecodingResult, Limits};
use ::tiff::tags::{ByteOrder, Tag};

use super::jpeg;
use super::palette::{PageFile, Palette};
use super::zstd::RowCoding;
use crate::files::open_regular;
use crate::jpeg::BYTES_PER_PIXEL;
use crate::lines::one_line;
use crate::raw::type_names;
use crate::slab::Endian;
use crate::stream::DEFLATE_RATIO;
use adjsplat::error::{Error, Result};
use adjsplat::volume::{SampleType, Samples};

/// The largest size of a tile in bytes: the `tiff` crate's own limit.
const LARGEST_TILE: u64 = 256 << 20;

/// The bytes of memory per chunk while the lists of the chunks' offsets and lengths are read.
const CHUNK_LISTED: u64 = 80;

/// The value of the tag Compression that means zstd.
const ZSTD: u64 = 50_000;

/// The largest number of samples that one byte of JPEG can expand to: a block of 64 needs a bit or more.
const JPEG_RATIO: u64 = 512;

/// The largest size of the tables that all JPEG chunks of a page share, in bytes; tables of real files have 600.
const LONGEST_TABLES: usize = 1 << 16;

/// The longest description in bytes: the description of an OME-TIFF lists every plane.
const LONGEST_DESCRIPTION: u64 = 64 << 20;

/// The pages of a file, numbered by their positions in the chain of directories, from 0.
pub(super) struct PageList {
    /// The number of all pages.
    pub(super) count: usize,
    /// The numbers of the pages at full resolution; at least one.
    pub(super) full: Vec<usize>,
}

/// The size and the sample type, which all pages of a volume share.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct PageShape {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) sample_type: SampleType,
    /// The number of bits of a stored sample: those of the type, or 1, 2 or 4, which are unpacked to bytes.
    bits: u32,
    /// The colours that the samples are indices of, if they are.
    pub(super) palette: Option<Palette>,
}

impl PageShape {
    /// Returns the number of bytes of the page's samples as they are stored.
    pub(super) fn bytes(&self) -> u64 {
        // Both sizes are 32-bit numbers; only the check of the grid limits them.
        self.stored_bytes(self.width, self.height)
    }

    /// Returns the number of bytes of `height` rows of `width` stored samples; each row begins with a new byte.
    fn stored_bytes(&self, width: u32, height: u32) -> u64 {
        (u64::from(width) * u64::from(self.bits)).div_ceil(8).saturating_mul(height.into())
    }

    fn described(&self) -> String {
        let name = if self.bits < 8 { format!("{} bits", self.bits) } else { self.sample_type.name().into() };
        format!("{} x {} of {name}", self.width, self.height)
    }
}

/// The contents of a page's resolution tags: how many pixels there are per unit of length.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Resolution {
    /// The number of pixels per unit along x and along y; `None` unless it is above 0.
    pub(super) per_unit: [Option<f64>; 2],
    /// The unit: 1 none, 2 inch, 3 centimetre.
    pub(super) unit: u16,
}

impl Resolution {
    /// Returns the size of a pixel along x and y, in units; 1 without the tags.
    pub(super) fn pixel(&self) -> [f64; 2] {
        let [x, y] = self.per_unit;
        [x.or(y), y.or(x)].map(|pixels| 1.0 / pixels.unwrap_or(1.0))
    }

    /// Returns whether there are 72 pixels per inch along x, as writers put that know no resolution.
    pub(super) fn is_default(&self) -> bool {
        self.unit == 2 && (self.pixel()[0] * 72.0 - 1.0).abs() < 1e-6
    }

    /// Returns whether the page has resolution tags.
    pub(super) fn is_given(&self) -> bool {
        self.per_unit != [None, None]
    }
}

/// Reads the pages of one file.
pub(super) struct TiffPages {
    path: PathBuf,
    decoder: Decoder<PageFile>,
    file_len: u64,
    /// The number of the current page, whose directory the decoder has read.
    number: usize,
}

impl TiffPages {
    /// Opens the file at `path` at its first page.
    pub(super) fn open(path: &Path) -> Result<TiffPages> {
        let (file, file_len) = open_regular(path, "open")?;
        let decoder = Decoder::new(PageFile::new(file)).map_err(|error| fault(path, 0, "the first page", error))?;
        let mut limits = Limits::default();
        // Chunks are unpacked as a stream into memory that this module allocates and checks itself.
        limits.intermediate_buffer_size = usize::MAX;
        Ok(TiffPages { path: path.to_path_buf(), decoder: decoder.with_limits(limits), file_len, number: 0 })
    }

    /// Reads the chain of directories to its end, and returns the pages.
    pub(super) fn list(&mut self) -> Result<PageList> {
        let (mut count, mut full) = (0, Vec::new());
        loop {
            // Bit 0 means a smaller copy of another page, bit 2 a mask. In the older tag SubfileType, 2 means a smaller
            // copy.
            let new = self.number_tag(Tag::NewSubfileType)?.unwrap_or(0);
            let old = self.number_tag(Tag::SubfileType)?.unwrap_or(1);
            if new & 0b101 == 0 && old != 2 {
                full.push(count);
            }
            count += 1;
            if !self.decoder.more_images() {
                break;
            }
            let at = self.at();
            self.decoder.next_image().map_err(|error| fault(&self.path, at, &format!("page {count}"), error))?;
            self.number = count;
        }
        if full.is_empty() {
            let got = format!("{count} pages that are all thumbnails or masks");
            return Err(self.format_fault("TIFF NewSubfileType", "a page at full resolution", got));
        }
        Ok(PageList { count, full })
    }

    /// Makes page `number` the current one.
    pub(super) fn go_to(&mut self, number: usize) -> Result<()> {
        if number != self.number {
            let at = self.at();
            let found = self.decoder.seek_to_image(number);
            found.map_err(|error| fault(&self.path, at, &format!("page {number}"), error))?;
            self.number = number;
        }
        Ok(())
    }

    /// Returns the shape of the current page; returns an error if pages of this kind are not supported.
    pub(super) fn shape(&mut self) -> Result<PageShape> {
        let (width, height) = self.decoder.dimensions().map_err(|error| self.page_fault(error))?;
        let samples = self.number_tag(Tag::SamplesPerPixel)?.unwrap_or(1);
        let meaning = self.number_tag(Tag::PhotometricInterpretation)?;
        let colours = match meaning {
            Some(0 | 1 | 3) if samples == 1 => None,
            Some(0 | 1 | 3) => Some(format!("{samples} samples a pixel")),
            Some(2) => Some("RGB colours".into()),
            Some(5) => Some("CMYK colours".into()),
            Some(6) => Some("YCbCr colours".into()),
            Some(other) => Some(format!("photometric interpretation {other}")),
            None => Some("no photometric interpretation".into()),
        };
        if let Some(got) = colours {
            let expected = "grey values, one sample a pixel (split the channels, or convert to grey, and save again)";
            return Err(self.format_fault("TIFF colours", expected, format!("{got} in page {}", self.number)));
        }
        let bits = self.number_tag(Tag::BitsPerSample)?.unwrap_or(1);
        let kind = self.number_tag(Tag::SampleFormat)?.unwrap_or(1);
        let sample_type = match (kind, bits) {
            (1, 1 | 2 | 4 | 8) => SampleType::U8,
            (2, 8) => SampleType::I8,
            (1, 16) => SampleType::U16,
            (2, 16) => SampleType::I16,
            (1, 32) => SampleType::U32,
            (2, 32) => SampleType::I32,
            (3, 32) => SampleType::F32,
            (3, 64) => SampleType::F64,
            _ => {
                let name = match kind {
                    1 => "unsigned whole numbers",
                    2 => "signed whole numbers",
                    3 => "floating-point numbers",
                    _ => "samples of an unknown kind",
                };
                let got = format!("{name} of {bits} bits in page {}", self.number);
                let expected = format!("one of {}, or unsigned whole numbers of 1, 2 or 4 bits", type_names());
                return Err(self.format_fault("TIFF sample type", expected, got));
            }
        };
        let bits = u32::try_from(bits).expect("one of those above");
        let (predictor, compression) = (self.number_tag(Tag::Predictor)?.unwrap_or(1), self.compression()?);
        // JPEG ignores the tag, as libtiff does.
        if compression != jpeg::METHOD && self.number_tag(Tag::FillOrder)?.unwrap_or(1) != 1 {
            let got = format!("2, the lowest bit first, in page {}", self.number);
            return Err(self.format_fault("TIFF FillOrder", "1, the highest bit first (save it again with that)", got));
        }
        if bits < 8 && (predictor != 1 || compression == jpeg::METHOD) {
            let expected = "samples of at least 8 bits under a predictor or JPEG";
            return Err(self.format_fault(
                "TIFF sample type",
                expected,
                format!("{bits} bits in page {}", self.number),
            ));
        }
        // Programs disagree: libtiff ignores such a predictor, the `tiff` crate and others apply it.
        if predictor != 1 && matches!(compression, 1 | 32_773) {
            let expected = "1 for samples that are not compressed, or by PackBits (save it again without a predictor)";
            return Err(self.format_fault("TIFF predictor", expected, format!("{predictor} in page {}", self.number)));
        }
        let across = self.decoder.chunk_dimensions().0;
        if across < width && !(u64::from(across) * u64::from(bits)).is_multiple_of(8) {
            let got = format!("tiles of {across} samples of {bits} bits in page {}", self.number);
            return Err(self.format_fault("TIFF TileWidth", "rows of tiles that fill whole bytes", got));
        }
        if self.is_white_zero()? && !matches!(sample_type, SampleType::U8 | SampleType::U16 | SampleType::U32) {
            let expected = "0 shown as black, or unsigned samples (invert the lookup table, and save again)";
            let got = format!("0 shown as white and samples of {} in page {}", sample_type.name(), self.number);
            return Err(self.format_fault("TIFF MinIsWhite", expected, got));
        }
        let palette = if meaning == Some(3) { Some(self.palette(sample_type, bits)?) } else { None };
        Ok(PageShape { width, height, sample_type, bits, palette })
    }

    /// Returns the page's palette.
    fn palette(&mut self, sample_type: SampleType, bits: u32) -> Result<Palette> {
        if !matches!(sample_type, SampleType::U8 | SampleType::U16) {
            let got = format!("{} in page {}", sample_type.name(), self.number);
            return Err(self.format_fault("TIFF palette", "indices of u8 or u16", got));
        }
        let need = 3usize << bits;
        let found = self.decoder.find_tag_unsigned_vec::<u16>(Tag::ColorMap);
        let colours = found.map_err(|error| self.page_fault(error))?.unwrap_or_default();
        if colours.len() != need {
            let got = format!("{} in page {}", colours.len(), self.number);
            return Err(self.format_fault("TIFF palette", format!("{need} numbers in its ColorMap"), got));
        }
        Ok(Palette::new(colours))
    }

    /// Checks that the page has the shape `shape` of the page `whose`, and that the file has the bytes of its samples.
    pub(super) fn check(&mut self, shape: &PageShape, whose: &str) -> Result<()> {
        let page_shape = self.shape()?;
        if page_shape.described() == shape.described() && page_shape.palette != shape.palette {
            let expected = format!("the palette of {whose}; all slices must be alike");
            return Err(self.format_fault("TIFF page", expected, format!("another one in page {}", self.number)));
        }
        if page_shape != *shape {
            let expected = format!("{} as in {whose}; all slices must be alike", shape.described());
            let got = format!("{} in page {}", page_shape.described(), self.number);
            return Err(self.format_fault("TIFF page", expected, got));
        }
        let need = self.tile_bytes(shape);
        if need > LARGEST_TILE {
            let what = format!("{}: bytes of one tile", self.path.display());
            return Err(Error::Limit { what, need, have: LARGEST_TILE });
        }
        let ratio = self.ratio()?;
        let (chunk_width, chunk_height) = self.decoder.chunk_dimensions();
        let (offsets, counts) = self.chunks()?;
        for (index, (offset, count)) in (0..).zip(offsets.iter().zip(&counts)) {
            let (width, height) = match self.decoder.get_chunk_type() {
                ChunkType::Strip => self.decoder.chunk_data_dimensions(index),
                // Tiles are stored whole, even if they reach beyond the page.
                ChunkType::Tile => (chunk_width, chunk_height),
            };
            let bytes = shape.stored_bytes(width, height);
            let packed = if ratio == Some(1) { bytes } else { *count };
            if offset.checked_add(packed).is_none_or(|end| end > self.file_len) {
                let expected = format!("{packed} bytes at byte {offset}, for a chunk of page {}", self.number);
                let got = format!("a file of {} bytes (copy or download it again)", self.file_len);
                return Err(self.format_fault("TIFF chunk", expected, got));
            }
            if packed == 0 || ratio.is_some_and(|ratio| packed.saturating_mul(ratio) < bytes) {
                let expected = format!("a chunk of {bytes} bytes in page {}", self.number);
                return Err(self.format_fault("TIFF chunk", expected, format!("{packed} bytes, too few for them")));
            }
        }
        Ok(())
    }

    /// Returns the byte offset of `images` pages that are stored one after the other without directories of their own.
    pub(super) fn contiguous(&mut self, shape: &PageShape, images: u64) -> Result<u64> {
        let plain = self.ratio()? == Some(1) && self.decoder.get_chunk_type() == ChunkType::Strip && shape.bits >= 8;
        let (offsets, counts) = self.chunks()?;
        let follow = offsets.windows(2).zip(&counts).all(|(pair, count)| pair[0].checked_add(*count) == Some(pair[1]));
        if !plain || !follow {
            let expected = format!("a directory for each of its {images} images, or all of them plain and in one run");
            return Err(self.format_fault("TIFF ImageJ images", expected, "one directory"));
        }
        let start = offsets.first().copied().unwrap_or(0);
        let bytes = shape.bytes().checked_mul(images).and_then(|bytes| bytes.checked_add(start));
        if bytes.is_none_or(|end| end > self.file_len) {
            let expected = format!("{images} images of {} from byte {start} on", shape.described());
            let got = format!("a file of {} bytes (copy or download it again)", self.file_len);
            return Err(self.format_fault("TIFF ImageJ images", expected, got));
        }
        Ok(start)
    }

    /// Returns the page's description; `None` if it has none.
    pub(super) fn description(&mut self) -> Result<Option<String>> {
        let mut tags = self.decoder.image_ifd();
        let Some(entry) = tags.find_entry(Tag::ImageDescription) else { return Ok(None) };
        let need = entry.count();
        let what = || format!("{}: bytes of its description", self.path.display());
        let have = LONGEST_DESCRIPTION.min(self.file_len);
        if need > have {
            return Err(Error::Limit { what: what(), need, have });
        }
        let mut bytes = vec![0; usize::try_from(need).unwrap_or(0)];
        let read = tags.find_tag_bytes(Tag::ImageDescription, &mut bytes, 0).map_err(|error| self.page_fault(error))?;
        bytes.truncate(read.unwrap_or(0));
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
        bytes.truncate(end);
        // Text that is not UTF-8 is read as Latin-1: old writers store a micro sign in it.
        Ok(Some(
            String::from_utf8(bytes).unwrap_or_else(|error| error.as_bytes().iter().copied().map(char::from).collect()),
        ))
    }

    /// Returns the contents of the page's resolution tags.
    pub(super) fn resolution(&mut self) -> Result<Resolution> {
        let mut pixels = |tag| match self.decoder.find_tag(tag) {
            Ok(Some(Value::Rational(above, below))) if above > 0 && below > 0 => {
                Ok(Some(f64::from(above) / f64::from(below)))
            }
            Ok(_) => Ok(None),
            Err(error) => Err(error),
        };
        let found = pixels(Tag::XResolution).and_then(|x| Ok([x, pixels(Tag::YResolution)?]));
        let per_unit = found.map_err(|error| self.page_fault(error))?;
        // If the tag is missing, the format's default is inches.
        let unit = self.number_tag(Tag::ResolutionUnit)?.and_then(|unit| u16::try_from(unit).ok()).unwrap_or(2);
        Ok(Resolution { per_unit, unit })
    }

    /// Reads the samples of the current page, which has the shape `shape`, into `slice`; indices as they are.
    pub(super) fn read(&mut self, shape: &PageShape, slice: &mut Samples) -> Result<()> {
        if shape.palette.is_none() {
            return self.read_chunks(shape, slice);
        }
        let directory = self.at();
        self.show_grey(Some(directory))?;
        self.read_chunks(shape, slice)?;
        self.show_grey(None)
    }

    /// Reads the current page's tags again, from a file in which the page with this directory seems to be grey.
    fn show_grey(&mut self, directory: Option<u64>) -> Result<()> {
        let endian = self.endian();
        let shown = self.decoder.inner().show_grey(directory, endian).map_err(TiffError::IoError);
        shown.and_then(|()| self.decoder.seek_to_image(self.number)).map_err(|error| self.page_fault(error))
    }

    fn read_chunks(&mut self, shape: &PageShape, slice: &mut Samples) -> Result<()> {
        // Samples smaller than a byte are read as they are stored, and unpacked in place when the slice is whole.
        let stored = |samples: u32| usize::try_from(shape.stored_bytes(samples, 1)).unwrap_or(usize::MAX);
        let row = stored(shape.width);
        let (across, down) = self.decoder.chunk_dimensions();
        let line = stored(across);
        let columns = shape.width.div_ceil(across.max(1));
        let tiled = self.decoder.get_chunk_type() == ChunkType::Tile;
        let chunks = columns.saturating_mul(shape.height.div_ceil(down.max(1)));
        let zstd = if self.compression()? == ZSTD { Some((self.row_coding(shape)?, self.chunks()?)) } else { None };
        let tables =
            if self.compression()? == jpeg::METHOD { Some((self.jpeg_tables()?, self.chunks()?)) } else { None };
        let mut tile = DecodingResult::U8(Vec::new());
        for index in 0..chunks {
            let (chunk_width, chunk_height) = self.decoder.chunk_data_dimensions(index);
            let (left, used) = ((index % columns) as usize * line, stored(chunk_width));
            let top = (index / columns) as usize * down as usize * row;
            if let Some((tables, (offsets, counts))) = &tables {
                let [offset, count] = [offsets, counts].map(|list| list.get(index as usize).copied().unwrap_or(0));
                let mut packed = Vec::new();
                let file = self.decoder.inner();
                let read = file.seek(SeekFrom::Start(offset)).and_then(|_| file.take(count).read_to_end(&mut packed));
                // Tiles are stored whole, even if they reach beyond the page.
                let size = if tiled { [across, down] } else { [chunk_width, chunk_height] };
                let samples = read.and_then(|_| jpeg::unpack(tables, &packed, size, slice));
                let samples = samples.map_err(|error| self.page_fault(TiffError::IoError(error)))?;
                let rows = slice.bytes_mut()[top..][..chunk_height as usize * row].chunks_exact_mut(row);
                for (into, from) in rows.zip(samples.bytes().chunks_exact(stored(size[0]))) {
                    into[left..left + used].copy_from_slice(&from[..used]);
                }
                continue;
            }
            let rows = &mut slice.bytes_mut()[top..][..chunk_height as usize * row];
            if let Some((coding, (offsets, counts))) = &zstd {
                let [offset, count] = [offsets, counts].map(|list| list.get(index as usize).copied().unwrap_or(0));
                let file = self.decoder.inner();
                let rows = rows.chunks_exact_mut(row).map(|row| &mut row[left..left + used]);
                let read = file.seek(SeekFrom::Start(offset)).and_then(|_| coding.unpack(file.take(count), line, rows));
                read.map_err(|error| self.page_fault(TiffError::IoError(error)))?;
            } else if tiled {
                // If a tile is read at its full width, it is unpacked in one read. In tiff 0.11.3, tiles packed by LZW
                // that reach beyond the page cannot be read row by row: the crate misses the end of the codes.
                let unpacked = self.decoder.read_chunk_to_buffer(&mut tile, index, line);
                unpacked.map_err(|error| self.page_fault(error))?;
                for (into, from) in rows.chunks_exact_mut(row).zip(tile.as_buffer(0).as_bytes().chunks_exact(line)) {
                    into[left..left + used].copy_from_slice(&from[..used]);
                }
            } else {
                self.decoder.read_chunk_bytes(index, rows).map_err(|error| self.page_fault(error))?;
            }
        }
        if zstd.is_none() && tables.is_none() && self.is_white_zero()? {
            // The crate inverted the samples so that 0 is black; this restores the stored samples.
            slice.bytes_mut().iter_mut().for_each(|byte| *byte = !*byte);
        }
        if shape.bits < 8 {
            unpack_bits(slice.bytes_mut(), shape.width as usize, shape.bits as usize);
        }
        Ok(())
    }

    /// Reads samples that start at byte `at` of the file into `slice`.
    pub(super) fn read_bytes(&mut self, at: u64, slice: &mut Samples) -> Result<()> {
        let file = self.decoder.inner();
        let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(slice.bytes_mut()));
        read.map_err(|error| fault(&self.path, at, "its samples", TiffError::IoError(error)))?;
        if self.endian() != Endian::NATIVE {
            slice.swap_bytes();
        }
        Ok(())
    }

    /// Returns the tables that the page's JPEG chunks share; nothing if each has its own.
    fn jpeg_tables(&mut self) -> Result<Vec<u8>> {
        let mut tags = self.decoder.image_ifd();
        let Some(entry) = tags.find_entry(Tag::JPEGTables) else { return Ok(Vec::new()) };
        let need = entry.count();
        let mut tables = vec![0; usize::try_from(need).unwrap_or(usize::MAX).min(LONGEST_TABLES)];
        if need > tables.len() as u64 {
            let what = format!("{}: bytes of its JPEG tables", self.path.display());
            return Err(Error::Limit { what, need, have: LONGEST_TABLES as u64 });
        }
        let read = tags.find_tag_bytes(Tag::JPEGTables, &mut tables, 0).map_err(|error| self.page_fault(error))?;
        tables.truncate(read.unwrap_or(0));
        Ok(tables)
    }

    /// Returns how the rows in the page's zstd chunks are written.
    fn row_coding(&mut self, shape: &PageShape) -> Result<RowCoding> {
        let predictor = self.number_tag(Tag::Predictor)?.unwrap_or(1);
        if predictor == 3 && !matches!(shape.sample_type, SampleType::F32 | SampleType::F64) {
            let got = format!("3 in page {}", self.number);
            return Err(self.format_fault("TIFF predictor", "1 or 2 for whole numbers", got));
        }
        Ok(RowCoding { width: shape.sample_type.bytes(), endian: self.endian(), predictor })
    }

    fn endian(&self) -> Endian {
        if self.decoder.byte_order() == ByteOrder::BigEndian { Endian::Big } else { Endian::Little }
    }

    fn compression(&mut self) -> Result<u64> {
        Ok(self.number_tag(Tag::Compression)?.unwrap_or(1))
    }

    /// Returns how many bytes of memory reading a page takes: for a tile, and for the list of chunks.
    pub(super) fn buffer_bytes(&mut self, shape: &PageShape) -> Result<u64> {
        let (width, height) = self.decoder.chunk_dimensions();
        let pixels = u64::from(width) * u64::from(height.min(shape.height));
        let jpeg = if self.compression()? == jpeg::METHOD { pixels.saturating_mul(BYTES_PER_PIXEL) } else { 0 };
        let down = u64::from(shape.height.div_ceil(height.max(1)));
        let chunks = u64::from(shape.width.div_ceil(width.max(1))).saturating_mul(down);
        Ok(self.tile_bytes(shape).saturating_add(chunks.saturating_mul(CHUNK_LISTED)).saturating_add(jpeg))
    }

    /// Returns the size in bytes of one tile without its rows below the page; 0 for strips, which are unpacked in
    /// place.
    fn tile_bytes(&self, shape: &PageShape) -> u64 {
        if self.decoder.get_chunk_type() == ChunkType::Strip {
            return 0;
        }
        let (width, height) = self.decoder.chunk_dimensions();
        shape.stored_bytes(width, height.min(shape.height))
    }

    /// Returns the byte offsets of the page's chunks, and their packed lengths in bytes.
    fn chunks(&mut self) -> Result<(Vec<u64>, Vec<u64>)> {
        let tags = match self.decoder.get_chunk_type() {
            ChunkType::Strip => [Tag::StripOffsets, Tag::StripByteCounts],
            ChunkType::Tile => [Tag::TileOffsets, Tag::TileByteCounts],
        };
        let mut numbers = |tag| self.decoder.find_tag_unsigned_vec::<u64>(tag).map(Option::unwrap_or_default);
        let found = numbers(tags[0]).and_then(|offsets| Ok((offsets, numbers(tags[1])?)));
        found.map_err(|error| self.page_fault(error))
    }

    /// Returns the largest number of bytes that one packed byte can expand to; `None` if there is no bound.
    fn ratio(&mut self) -> Result<Option<u64>> {
        let method = match self.compression()? {
            1 => return Ok(Some(1)),
            // LZW: a code has at least 9 bits, and the string that it stands for has at most 4,096 bytes.
            5 => return Ok(Some(4096)),
            8 | 32_946 => return Ok(Some(DEFLATE_RATIO)),
            // PackBits: two bytes can expand to 128.
            32_773 => return Ok(Some(64)),
            ZSTD => return Ok(None),
            2 => "CCITT, method 2".into(),
            3 | 4 => "fax".into(),
            // Samples have 1 or 2 bytes.
            jpeg::METHOD => return Ok(Some(2 * JPEG_RATIO)),
            6 => "JPEG as in TIFF 6.0, which Technical Note 2 replaced".into(),
            33_003 | 33_005 | 34_712 => "JPEG 2000".into(),
            34_887 => "LERC".into(),
            other => format!("method {other}"),
        };
        let expected = "none, LZW, deflate, PackBits, zstd or JPEG (save it again with one of these)";
        Err(self.format_fault("TIFF compression", expected, method))
    }

    fn is_white_zero(&mut self) -> Result<bool> {
        Ok(self.number_tag(Tag::PhotometricInterpretation)? == Some(0))
    }

    /// Returns the first number of `tag`, if the page has this tag.
    fn number_tag(&mut self, tag: Tag) -> Result<Option<u64>> {
        let found = self.decoder.find_tag_unsigned_vec::<u64>(tag);
        found.map(|numbers| numbers?.first().copied()).map_err(|error| self.page_fault(error))
    }

    /// Returns the byte offset of the current page's directory.
    fn at(&mut self) -> u64 {
        self.decoder.ifd_pointer().map_or(0, |pointer| pointer.0)
    }

    fn page_fault(&mut self, error: TiffError) -> Error {
        let at = self.at();
        fault(&self.path, at, &format!("page {}", self.number), error)
    }

    fn format_fault(&mut self, rule: &'static str, expected: impl Into<String>, got: impl Into<String>) -> Error {
        let at = self.at();
        Error::format(&self.path, at, rule, expected, got)
    }
}

/// Unpacks a page in place: from samples of `bits` bits (1, 2 or 4) at the start of `bytes` to a sample a byte.
///
/// Each row of `width` samples begins with a new byte, whose highest bits are the first sample.
fn unpack_bits(bytes: &mut [u8], width: usize, bits: usize) {
    let row = (width * bits).div_ceil(8);
    // From the end, as no sample moves to a byte before its own.
    for index in (0..bytes.len()).rev() {
        let (y, bit) = (index / width, index % width * bits);
        bytes[index] = bytes[y * row + bit / 8] >> (8 - bits - bit % 8) & ((1 << bits) - 1);
    }
}

/// Converts an error of the `tiff` crate to ours; `at` is the byte offset of the page's directory.
fn fault(path: &Path, at: u64, what: &str, error: TiffError) -> Error {
    let again = "(copy or download the file again)";
    match error {
        TiffError::IoError(source) => match source.kind() {
            io::ErrorKind::UnexpectedEof => {
                Error::format(path, at, "TIFF page", format!("all of {what}"), format!("its end before that {again}"))
            }
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput | io::ErrorKind::Other => {
                let expected = format!("an intact compressed stream in {what} {again}");
                Error::format(path, at, "TIFF page", expected, one_line(&source))
            }
            _ => Error::io("read", path)(source),
        },
        other => Error::format(path, at, "TIFF page", format!("{what} to be one that can be read"), one_line(&other)),
    }
}
