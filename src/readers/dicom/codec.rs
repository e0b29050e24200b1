//! Decodes compressed frames: finds the codec, and undoes run lengths, which need no library.
//!
//! In: a frame's fragments in one piece, and its size. Out: one number per pixel, x fastest.
//!
//! Source: DICOM PS3.5, annex G (RLE) and table A-1 (transfer syntaxes).

use std::path::Path;

use super::elements::Pixels;
use super::image::PixelLayout;
use super::jpeg;
use adjsplat::error::{Error, Result};

/// What is wrong with a frame: what was expected, and what it has.
pub(super) type FrameFault = [String; 2];

/// How a file's frames are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameCodec {
    /// Uncompressed.
    Native,
    /// Run lengths of each byte of the pixels.
    Rle,
    /// JPEG, baseline or lossless.
    Jpeg,
    /// JPEG 2000.
    Jpeg2000,
}

impl FrameCodec {
    /// Returns the codec of transfer syntax `syntax`.
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

    /// Bytes of memory that decoding a frame of `pixels` pixels takes, at most.
    pub(super) fn working_bytes(self, pixels: u64) -> u64 {
        // Lossless JPEG: differences of 4 bytes, results of 2 twice, and our numbers. JPEG 2000: two planes of
        // coefficients of 4 and their states, the wavelet's plane, and our numbers.
        match self {
            FrameCodec::Native => 0,
            FrameCodec::Rle => 4 * pixels,
            FrameCodec::Jpeg => 16 * pixels,
            FrameCodec::Jpeg2000 => 32 * pixels,
        }
    }
}

/// The pixels of one frame, before their layout (stored bits, sign) is applied.
pub(super) struct Unpacked {
    /// The bits of one number per pixel.
    pub(super) bits: Vec<u32>,
    /// Whether the numbers are at the low end of their cells, whatever the header's high bit.
    pub(super) low: bool,
}

/// Decodes the frame in `bytes`, of `size` pixels along x and y.
///
/// # Errors
/// The fault, if the frame is damaged or uses something that is not supported.
pub(super) fn decode(
    codec: FrameCodec,
    bytes: &[u8],
    size: [u32; 2],
    layout: PixelLayout,
) -> Result<Unpacked, FrameFault> {
    match codec {
        FrameCodec::Native => Err(["compressed pixels".into(), "plain ones".into()]),
        FrameCodec::Rle => rle(bytes, size, layout).map(|bits| Unpacked { bits, low: false }),
        FrameCodec::Jpeg => jpeg::decode(bytes, size).map(|bits| Unpacked { bits, low: true }),
        FrameCodec::Jpeg2000 => jpeg::decode_2000(bytes, size).map(|bits| Unpacked { bits, low: true }),
    }
}

pub(super) fn pixel_count([x, y]: [u32; 2]) -> usize {
    x as usize * y as usize
}

/// Decodes run lengths: one segment for each byte of the pixels, highest byte first.
fn rle(bytes: &[u8], size: [u32; 2], layout: PixelLayout) -> Result<Vec<u32>, FrameFault> {
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

/// Shifts each pixel's bits up and adds the next byte from the runs below; returns how many pixels got one.
fn unpack_runs(packed: &[u8], bits: &mut [u32]) -> usize {
    let (mut at, mut done) = (0, 0);
    while done < bits.len() && at + 1 < packed.len() {
        let code = packed[at];
        at += 1;
        // 0..=127: so many bytes and one as they are; 129..=255: the next byte, 257 less so many times; 128: nothing.
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
