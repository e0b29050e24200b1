//! Unpacks the bytes of a chunk.
//!
//! In: packed bytes, and the unpacked length that is allowed. Out: the unpacked bytes. Every decoder in this module
//! writes into a bounded buffer, so a chunk that states a wrong length takes no more memory than an intact one.
//!
//! Source: the Zarr codecs' specifications (zarr-specs.readthedocs.io, codecs) and numcodecs for what version 2 calls
//! compressors.

use std::io::Read;

use flate2::read::{MultiGzDecoder, ZlibDecoder};

use super::blosc;

/// A text that says what was found instead of an intact chunk.
pub(super) type ChunkFault = String;

/// One step by which the bytes of a chunk are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// A gzip or zlib stream.
    Deflate,
    /// A Blosc frame.
    Blosc,
    /// A Zstandard stream.
    Zstd,
    /// An LZ4 block that follows its length, as numcodecs writes it.
    Lz4,
    /// Plain bytes, followed by a checksum of four bytes.
    Crc32c,
}

/// The largest number of bytes by which one packing step may lengthen its input if another step follows.
const SLACK: usize = 1 << 16;

/// Undoes the steps `packings`, the last step first; the result must have `len` bytes.
///
/// # Errors
/// Returns a text that says what is wrong with the chunk.
pub(super) fn unpack(packings: &[Packing], packed: Vec<u8>, len: usize) -> Result<Vec<u8>, ChunkFault> {
    let mut bytes = packed;
    for (step, packing) in packings.iter().enumerate().rev() {
        let inner = &packings[..step];
        let checksums = 4 * inner.iter().filter(|inner| **inner == Packing::Crc32c).count();
        let exact = inner.len() * 4 == checksums;
        let most = if exact { len + checksums } else { len + len / 8 + SLACK };
        bytes = match packing {
            Packing::Deflate => inflate(&bytes, most)?,
            Packing::Zstd => zstd(&bytes, most)?,
            Packing::Blosc => {
                let stated = bytes.get(4..8).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
                match stated {
                    Some(stated) if stated <= most => blosc::unpack(&bytes, stated)?,
                    _ => blosc::unpack(&bytes, most)?,
                }
            }
            Packing::Lz4 => match bytes.split_at_checked(4) {
                Some((_, block)) => lz4(block, most)?,
                None => return Err("an LZ4 chunk without its length".into()),
            },
            Packing::Crc32c => strip_checksum(bytes)?,
        };
    }
    if bytes.len() == len { Ok(bytes) } else { Err(format!("{} bytes", bytes.len())) }
}

/// Unpacks a gzip or zlib stream of at most `most` bytes.
pub(super) fn inflate(packed: &[u8], most: usize) -> Result<Vec<u8>, ChunkFault> {
    let is_gzip = packed.starts_with(&[0x1f, 0x8b]);
    if is_gzip { at_most(MultiGzDecoder::new(packed), most) } else { at_most(ZlibDecoder::new(packed), most) }
}

/// Unpacks a Zstandard stream of at most `most` bytes.
pub(super) fn zstd(packed: &[u8], most: usize) -> Result<Vec<u8>, ChunkFault> {
    let decoder = ruzstd::decoding::StreamingDecoder::new(packed).map_err(|error| error.to_string())?;
    at_most(decoder, most)
}

/// Unpacks a block of LZ4 of at most `most` bytes.
pub(super) fn lz4(packed: &[u8], most: usize) -> Result<Vec<u8>, ChunkFault> {
    let mut out = vec![0; most];
    let len = lz4_flex::block::decompress_into(packed, &mut out).map_err(|error| error.to_string())?;
    out.truncate(len);
    Ok(out)
}

fn at_most(decoder: impl Read, most: usize) -> Result<Vec<u8>, ChunkFault> {
    let mut out = Vec::new();
    decoder.take(most as u64 + 1).read_to_end(&mut out).map_err(|error| error.to_string())?;
    if out.len() <= most { Ok(out) } else { Err(format!("more than {most} bytes")) }
}

fn strip_checksum(mut bytes: Vec<u8>) -> Result<Vec<u8>, ChunkFault> {
    let len = bytes.len().checked_sub(4).ok_or("a chunk without its checksum")?;
    let stated = bytes[len..].to_vec();
    bytes.truncate(len);
    if crc32c(&bytes).to_le_bytes() == stated[..] {
        Ok(bytes)
    } else {
        Err("another checksum than its bytes have".into())
    }
}

/// Returns the cyclic redundancy check of `bytes` with Castagnoli's polynomial (RFC 3720, appendix B.4).
pub(super) fn crc32c(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut index = 0;
        let mut byte = 0u32;
        while index < 256 {
            let mut value = byte;
            let mut bit = 0;
            while bit < 8 {
                value = if value & 1 == 1 { value >> 1 ^ 0x82f6_3b78 } else { value >> 1 };
                bit += 1;
            }
            table[index] = value;
            index += 1;
            byte += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |sum, byte| sum >> 8 ^ TABLE[((sum ^ u32::from(*byte)) & 0xff) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_of_the_standard() {
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
    }
}
