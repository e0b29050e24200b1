//! Decodes compressed frames: selects the codec, and decodes run lengths, which need no library.
//!
//! In: the bytes of a frame, its fragments joined, and its size. Out: one number per pixel, x fastest.
//!
//! Source: DICOM PS3.5, annex G (RLE) and table A-1 (transfer syntaxes).

use std::path::Path;

use super::elements::Pixels;
use super::image::PixelLayout;
use super::jpeg2000;
use crate::jpeg::{self, PixelFault, pixel_count};
use adjsplat::error::{Error, Result};

/// How the frames of a file are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameCodec {
    /// Pixels are uncompressed.
    Native,
    /// Pixels are run lengths of bytes: one stream for each byte of a pixel.
    Rle,
    /// Pixels are JPEG, baseline or lossless.
    Jpeg,
    /// Pixels are JPEG 2000.
    Jpeg2000,
}

impl FrameCodec {
    /// Returns the codec of the transfer syntax `syntax` (DICOM's identifier of an encoding).
    pub(super) fn of(path: &Path, syntax: &str, pixels: &Pixels) -> Result<FrameCodec> {
        if matches!(pixels, Pixels::Native { .. }) {
            return Ok(FrameCodec::Native);
        }
        let name = match syntax.strip_prefix("1.2.840.10008.1.2.").unwrap_or(syntax) {
            "5" => return Ok(FrameCodec::Rle),
            "4.50" | "4.51" | "4.57" | "4.70" => return Ok(FrameCodec::Jpeg),
            "4.90" | "4.91" => return Ok(FrameCodec::Jpeg2000),
            "4.80" | "4.81" => "JPEG-LS",
            "4.110" | "4.111" | "4.112" => "JPEG XL",
            "4.201" | "4.202" | "4.203" => "High-Throughput JPEG 2000",
            other if other.starts_with("4.10") => "MPEG video",
            _ => "transfer syntax",
        };
        let expected = "uncompressed, RLE, JPEG or JPEG 2000 pixels (convert it with gdcmconv --raw or dcmdjpls)";
        Err(Error::format(path, 0, "DICOM transfer syntax", expected, format!("{name} ({})", syntax.escape_debug())))
    }

    /// Returns the largest number of bytes of memory that decoding a frame of `pixels` pixels takes.
    pub(super) fn working_bytes(self, pixels: u64) -> u64 {
        // Per pixel, JPEG 2000 needs two planes of coefficients of 4 bytes with their states, the wavelet's plane, and
        // our numbers.
        match self {
            FrameCodec::Native => 0,
            FrameCodec::Rle => 4 * pixels,
            FrameCodec::Jpeg => jpeg::BYTES_PER_PIXEL * pixels,
            FrameCodec::Jpeg2000 => 32 * pixels,
        }
    }
}

/// The pixels of one frame, before their layout (stored bits, sign) is applied.
pub(super) struct Unpacked {
    /// The bits of each pixel, as one number per pixel.
    pub(super) bits: Vec<u32>,
    /// Whether the value is in the low bits of each number, whatever high bit the header states.
    pub(super) low: bool,
}

/// Decodes the frame in `bytes`, whose `size` is in pixels along x and y.
///
/// # Errors
/// Returns a fault if the frame is damaged or uses a feature that is not supported.
pub(super) fn decode(
    codec: FrameCodec,
    bytes: &[u8],
    size: [u32; 2],
    layout: PixelLayout,
) -> Result<Unpacked, PixelFault> {
    match codec {
        FrameCodec::Native => Err(["compressed pixels".into(), "plain ones".into()]),
        FrameCodec::Rle => rle(bytes, size, layout).map(|bits| Unpacked { bits, low: false }),
        FrameCodec::Jpeg => jpeg::decode(bytes, size).map(|bits| Unpacked { bits, low: true }).map_err(with_advice),
        FrameCodec::Jpeg2000 => {
            jpeg2000::decode(bytes, size).map(|bits| Unpacked { bits, low: true }).map_err(with_advice)
        }
    }
}

/// Adds to a fault how to convert the file.
fn with_advice([expected, got]: PixelFault) -> PixelFault {
    [format!("{expected} (copy the file again, or convert it with gdcmconv --raw)"), got]
}

/// Decodes run lengths: one segment for each byte of the pixels, the most significant byte first.
fn rle(bytes: &[u8], size: [u32; 2], layout: PixelLayout) -> Result<Vec<u32>, PixelFault> {
    let fault = |got: &str| [format!("intact RLE segments of {} x {} pixels", size[0], size[1]), got.to_string()];
    let word = |index: usize| {
        let at = bytes.get(4 * index..4 * index + 4)?;
        Some(u32::from_le_bytes([at[0], at[1], at[2], at[3]]) as usize)
    };
    let width = layout.sample_type.bytes();
    let count = word(0).ok_or_else(|| fault("no header"))?;
    if count != width {
        return Err(fault(&format!("{count} segments for pixels of {width} bytes")));
    }
    let mut bits = vec![0u32; pixel_count(size)];
    for segment in 0..count {
        let start = word(segment + 1).ok_or_else(|| fault("a header that breaks off"))?;
        let end = if segment + 1 < count { word(segment + 2) } else { Some(bytes.len()) };
        let packed = end.and_then(|end| bytes.get(start..end)).ok_or_else(|| fault("offsets beyond the frame"))?;
        let filled = unpack_runs(packed, &mut bits);
        if filled < bits.len() {
            return Err(fault(&format!("{filled} pixels in segment {segment}")));
        }
    }
    Ok(bits)
}

/// Shifts each pixel's bits up and puts the next unpacked byte below them; returns the number of pixels that got a
/// byte.
fn unpack_runs(packed: &[u8], bits: &mut [u32]) -> usize {
    let (mut at, mut done) = (0, 0);
    while done < bits.len() && at + 1 < packed.len() {
        let code = packed[at];
        at += 1;
        // Codes: 0..=127: copy the next code + 1 bytes; 129..=255: repeat the next byte 257 - code times; 128: do
        // nothing.
        let (run, step) = match code {
            0..=127 => (usize::from(code) + 1, 1),
            128 => continue,
            129..=255 => (257 - usize::from(code), 0),
        };
        for k in 0..run.min(bits.len() - done) {
            let Some(byte) = packed.get(at + k * step) else { return done };
            bits[done] = bits[done] << 8 | u32::from(*byte);
            done += 1;
        }
        at += if step == 1 { run } else { 1 };
    }
    done
}
