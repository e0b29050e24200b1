//! Unpacks strips and tiles that are packed by zstd; the `tiff` crate would need a C library for them.
//!
//! In: a packed chunk as a stream, and how its rows are encoded. Out: rows of samples in this machine's byte order.
//!
//! Source: TIFF 6.0, section 14 (differences of whole numbers); Adobe Photoshop TIFF Technical Note 3 (differences of
//! the bytes of floating-point numbers); RFC 8878 (zstd).

use std::io::{self, Read};

use ruzstd::decoding::StreamingDecoder;

use crate::slab::Endian;

/// How the samples of a row are encoded before the chunk is packed.
#[derive(Debug, Clone, Copy)]
pub(super) struct RowCoding {
    /// The number of bytes of a sample.
    pub(super) width: usize,
    /// The order of the bytes of a sample.
    pub(super) endian: Endian,
    /// Tag 317: 1 samples as they are, 2 differences of samples, 3 differences of bytes, the most significant bytes
    /// first.
    pub(super) predictor: u64,
}

impl RowCoding {
    /// Unpacks the chunk in `packed`, whose rows have `line` bytes. Each of `rows` receives the first bytes of its row.
    ///
    /// # Errors
    /// If the zstd frame is damaged, or has fewer rows than `rows`.
    pub(super) fn unpack<'r>(
        self,
        packed: impl Read,
        line: usize,
        rows: impl Iterator<Item = &'r mut [u8]>,
    ) -> io::Result<()> {
        let damaged = |error| io::Error::new(io::ErrorKind::InvalidData, error);
        let mut frame = StreamingDecoder::new(packed).map_err(damaged)?;
        let mut whole = vec![0; line];
        for row in rows {
            frame.read_exact(&mut whole)?;
            match self.predictor {
                3 => self.undo_byte_differences(&mut whole),
                2 => self.undo_differences(&mut whole),
                _ if self.endian != Endian::NATIVE => whole.chunks_exact_mut(self.width).for_each(<[u8]>::reverse),
                _ => {}
            }
            row.copy_from_slice(&whole[..row.len()]);
        }
        Ok(())
    }

    fn undo_differences(self, row: &mut [u8]) {
        let mut sum = 0u64;
        for sample in row.chunks_exact_mut(self.width) {
            let mut difference = [0; 8];
            difference[..self.width].copy_from_slice(sample);
            if self.endian == Endian::Big {
                difference[..self.width].reverse();
            }
            sum = sum.wrapping_add(u64::from_le_bytes(difference));
            sample.copy_from_slice(&sum.to_le_bytes()[..self.width]);
            if Endian::NATIVE == Endian::Big {
                sample.reverse();
            }
        }
    }

    fn undo_byte_differences(self, row: &mut [u8]) {
        for at in 1..row.len() {
            row[at] = row[at].wrapping_add(row[at - 1]);
        }
        let planes = row.to_vec();
        let count = row.len() / self.width;
        for (index, sample) in row.chunks_exact_mut(self.width).enumerate() {
            for (plane, byte) in sample.iter_mut().enumerate() {
                *byte = planes[plane * count + index];
            }
            if Endian::NATIVE == Endian::Little {
                sample.reverse();
            }
        }
    }
}
