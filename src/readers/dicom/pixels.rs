//! Reads the pixels of one frame as samples.
//!
//! In: a file and the index of a frame. Out: a slice of samples in this machine's byte order, with only the stored
//! bits. Uncompressed pixels go straight from the file into the slice. For compressed pixels, only the fragments of
//! this frame are read.

use std::io::{self, Read, Seek, SeekFrom};
use std::path::PathBuf;

use super::codec;
use super::elements::Pixels;
use super::image::{ImageFile, PixelLayout};
use crate::files::{File, open_regular};
use crate::slab::Endian;
use adjsplat::error::{Error, Result};
use adjsplat::volume::Samples;

/// Reads frames; it keeps the last file open, because the next frame is often in the same file.
#[derive(Default)]
pub(super) struct PixelReader {
    open: Option<(PathBuf, File)>,
}

impl PixelReader {
    /// Reads frame `index` of `file` into `slice`, whose sample type is that of the file's pixel cells.
    pub(super) fn read(&mut self, file: &ImageFile, index: u32, slice: &mut Samples) -> Result<()> {
        match &file.pixels {
            Pixels::Native { at, endian, .. } => {
                let bytes = slice.bytes_mut();
                let at = at + u64::from(index) * bytes.len() as u64;
                self.read_at(file, at, bytes)?;
                if *endian != Endian::NATIVE {
                    slice.swap_bytes();
                }
                keep_stored_bits(slice, file.layout);
            }
            Pixels::Encapsulated { fragments, .. } => {
                let bytes = self.read_fragments(file, &fragments[file.fragments(index)])?;
                let unpacked =
                    codec::decode(file.codec, &bytes, file.size, file.layout).map_err(|[expected, got]| {
                        let at = fragments[file.fragments(index)].first().map_or(0, |(at, _)| *at);
                        Error::format(&file.path, at, "DICOM compressed pixels", expected, got)
                    })?;
                put(&unpacked.bits, slice);
                let layout = if unpacked.low { PixelLayout { shift: 0, ..file.layout } } else { file.layout };
                keep_stored_bits(slice, layout);
            }
        }
        Ok(())
    }

    fn read_fragments(&mut self, file: &ImageFile, fragments: &[(u64, u32)]) -> Result<Vec<u8>> {
        // Every fragment lies inside the file, so the sum is at most the file's length.
        let need: u64 = fragments.iter().map(|(_, len)| u64::from(*len)).sum();
        let refused = || Error::out_of_memory(format!("a frame of {}", file.path.display()), need);
        let len = usize::try_from(need).map_err(|_| refused())?;
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(len).map_err(|_| refused())?;
        bytes.resize(len, 0);
        let mut done = 0;
        for (at, len) in fragments {
            let part = &mut bytes[done..done + *len as usize];
            done += part.len();
            self.read_at(file, at + 8, part)?;
        }
        Ok(bytes)
    }

    fn read_at(&mut self, file: &ImageFile, at: u64, into: &mut [u8]) -> Result<()> {
        let path = &file.path;
        if self.open.as_ref().is_none_or(|(open, _)| open != path) {
            let (opened, _) = open_regular(path, "open")?;
            self.open = Some((path.clone(), opened));
        }
        let Some((_, reader)) = &mut self.open else { return Ok(()) };
        let read = reader.seek(SeekFrom::Start(at)).and_then(|_| reader.read_exact(into));
        read.map_err(|source| match source.kind() {
            io::ErrorKind::UnexpectedEof => {
                let got = "the end of the file, which was longer when it was opened";
                Error::format(path, at, "DICOM Pixel Data", format!("{} bytes", into.len()), got)
            }
            _ => Error::io("read", path)(source),
        })
    }
}

impl ImageFile {
    /// Returns the indices of the fragments of frame `index`.
    fn fragments(&self, index: u32) -> std::ops::Range<usize> {
        let Pixels::Encapsulated { fragments, .. } = &self.pixels else { return 0..0 };
        let start = |index: usize| self.first_fragments.get(index).map_or(fragments.len(), |first| *first as usize);
        start(index as usize)..start(index as usize + 1)
    }

    /// Returns the size of the file's largest compressed frame, in bytes.
    pub(super) fn largest_frame(&self) -> u64 {
        let Pixels::Encapsulated { fragments, .. } = &self.pixels else { return 0 };
        let frames = (0..u32::try_from(self.first_fragments.len()).unwrap_or(0))
            .map(|index| fragments[self.fragments(index)].iter().map(|(_, len)| u64::from(*len)).sum());
        frames.max().unwrap_or(0)
    }

    /// Returns how many bytes of memory this value and its tables take.
    pub(super) fn table_bytes(&self) -> u64 {
        let fragments = match &self.pixels {
            Pixels::Native { .. } => 0,
            Pixels::Encapsulated { fragments, offsets } => 16 * fragments.len() + 4 * offsets.len(),
        };
        (size_of::<ImageFile>() + fragments + 4 * self.first_fragments.len()) as u64
    }
}

/// Writes the low bits of each number in `bits` into the cells of `slice`.
#[expect(clippy::cast_possible_truncation, reason = "the low bits are what a cell holds")]
fn put(bits: &[u32], slice: &mut Samples) {
    macro_rules! cells {
        ($($variant:ident $bits:ty),*) => {
            match slice {
                $(Samples::$variant(cells) => {
                    let cells: &mut [$bits] = bytemuck::cast_slice_mut(cells);
                    for (cell, bits) in cells.iter_mut().zip(bits) {
                        *cell = *bits as $bits;
                    }
                })*
                // Floating-point pixels are never compressed.
                Samples::F32(_) | Samples::F64(_) => {}
            }
        };
    }
    cells!(U8 u8, I8 u8, U16 u16, I16 u16, U32 u32, I32 u32);
}

/// Moves the stored bits to the low end of each cell; the bits above them become copies of the sign, or 0.
fn keep_stored_bits(slice: &mut Samples, layout: PixelLayout) {
    let spare = layout.sample_type.bits() - layout.stored;
    macro_rules! cells {
        ($($variant:ident),*) => {
            match slice {
                _ if spare == 0 => {}
                // A shift right of a signed number copies its sign.
                $(Samples::$variant(cells) => for cell in cells {
                    *cell = *cell >> layout.shift << spare >> spare;
                })*
                Samples::F32(_) | Samples::F64(_) => {}
            }
        };
    }
    cells!(U8, I8, U16, I16, U32, I32);
}

#[cfg(test)]
mod tests {
    use super::*;
    use adjsplat::volume::SampleType;

    #[test]
    fn stored_bits_are_kept_and_their_sign_is_extended() {
        let layout = |sample_type, stored, shift| PixelLayout { sample_type, stored, shift };
        let mut unsigned = Samples::U16(vec![0xffff, 0xf801, 0x0fff]);
        keep_stored_bits(&mut unsigned, layout(SampleType::U16, 12, 0));
        assert_eq!(unsigned, Samples::U16(vec![0x0fff, 0x0801, 0x0fff]));
        let mut signed = Samples::I16(vec![0x0fff, 0x0800, 0x07ff, 0x7001]);
        keep_stored_bits(&mut signed, layout(SampleType::I16, 12, 0));
        assert_eq!(signed, Samples::I16(vec![-1, -2048, 2047, 1]));
        let mut shifted = Samples::U16(vec![0xabcd]);
        keep_stored_bits(&mut shifted, layout(SampleType::U16, 8, 4));
        assert_eq!(shifted, Samples::U16(vec![0xbc]));
        let mut whole = Samples::I32(vec![i32::MIN]);
        keep_stored_bits(&mut whole, layout(SampleType::I32, 32, 0));
        assert_eq!(whole, Samples::I32(vec![i32::MIN]));
    }
}
