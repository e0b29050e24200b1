//! Decodes JPEG and JPEG 2000 frames with two libraries.
//!
//! The size that a frame states is compared with the DICOM header before the decoder runs, so a decoder allocates no
//! more than the header asks for. Features that the decoders get wrong without an error are refused.
//!
//! Source: ITU-T T.81, annexes B and H (JPEG); ITU-T T.800, annex A.5 (JPEG 2000).

use std::panic::{AssertUnwindSafe, catch_unwind};

use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};
use jpeg_decoder::{Decoder, PixelFormat};

use super::codec::{FrameFault, pixel_count};

/// Decodes a JPEG frame of one component: 8-bit, or lossless with up to 16 bits.
pub(super) fn decode(bytes: &[u8], size: [u32; 2]) -> Result<Vec<u32>, FrameFault> {
    check(bytes, size)?;
    let mut decoder = Decoder::new(bytes);
    decoder.set_max_decoding_buffer_size(16 * pixel_count(size) + (1 << 20));
    let decoded = guarded(|| decoder.decode().map_err(|error| error.to_string()))?;
    let format = decoder.info().map(|info| info.pixel_format);
    let bits: Vec<u32> = match format {
        Some(PixelFormat::L8) => decoded.iter().map(|b| (*b).into()).collect(),
        Some(PixelFormat::L16) => decoded.chunks_exact(2).map(|b| u16::from_ne_bytes([b[0], b[1]]).into()).collect(),
        _ => return Err(["one grey component".into(), format!("{format:?}")]),
    };
    full(bits, size)
}

/// Checks the markers before the first scan: the size, and features that the decoder gets wrong.
fn check(bytes: &[u8], size: [u32; 2]) -> Result<(), FrameFault> {
    let broken = || ["a JPEG frame".to_string(), "markers that break off".to_string()];
    let mut at = 2;
    let (mut lossless, mut restarts, mut sized) = (false, false, false);
    loop {
        let [0xff, marker] = *bytes.get(at..at + 2).ok_or_else(broken)? else { return Err(broken()) };
        if marker == 0xff {
            at += 1;
            continue;
        }
        let head = bytes.get(at + 2..at + 4).ok_or_else(broken)?;
        let len = usize::from(u16::from_be_bytes([head[0], head[1]]));
        let segment = bytes.get(at + 4..at + 2 + len).ok_or_else(broken)?;
        match (marker, segment) {
            (0xc0..=0xc3, [precision, y0, y1, x0, x1, components, ..]) => {
                lossless = marker == 0xc3;
                let there = [[*x0, *x1], [*y0, *y1]].map(|pair| u32::from(u16::from_be_bytes(pair)));
                if there != size || *components != 1 {
                    let got = format!("{} x {} of {components}", there[0], there[1]);
                    return Err([format!("JPEG frames of {} x {} of 1 component", size[0], size[1]), got]);
                }
                if !lossless && *precision != 8 {
                    return Err(["JPEG of 8 bits, or lossless (gdcmconv --raw)".into(), format!("{precision} bits")]);
                }
                sized = true;
            }
            (0xdd, [high, low, ..]) => restarts = *high != 0 || *low != 0,
            (0xda, _) => {
                // The low four bits of the scan's last byte are the point transform.
                let transform = segment.last().map_or(0, |last| last & 15);
                // jpeg-decoder 0.3 gives wrong pixels without an error for these two features (its issue 286).
                if lossless && (restarts || transform != 0) {
                    let got = "one with restart markers or a point transform";
                    return Err(["a lossless JPEG scan in one piece (gdcmconv --raw)".into(), got.into()]);
                }
                return if sized { Ok(()) } else { Err(broken()) };
            }
            _ => {}
        }
        at += 2 + len;
    }
}

/// Decodes a JPEG 2000 codestream of one component of up to 16 bits.
pub(super) fn decode_2000(bytes: &[u8], size: [u32; 2]) -> Result<Vec<u32>, FrameFault> {
    let (precision, signed) = check_2000(bytes, size)?;
    let settings = DecodeSettings { resolve_palette_indices: false, strict: false, target_resolution: None };
    let numbers: Vec<f32> = guarded(|| {
        let image = Image::new(bytes, &settings).map_err(|error| error.to_string())?;
        let mut context = DecoderContext::default();
        let decoded = image.decode(&mut context).map_err(|error| error.to_string())?;
        Ok(decoded.components().first().map(|component| component.samples().to_vec()).unwrap_or_default())
    })?;
    // The decoder shifts signed samples up as if they were unsigned (its comment on Ssiz says so).
    let half_range = 2f32.powi(i32::from(precision) - 1);
    let (shift, low, high) =
        if signed { (half_range, -half_range, half_range - 1.0) } else { (0.0, 0.0, 2.0 * half_range - 1.0) };
    #[expect(clippy::cast_possible_truncation, reason = "clamped to a range of at most 17 bits; NaN is 0")]
    let bits = |number: f32| ((number - shift).round().clamp(low, high) as i32).cast_unsigned();
    full(numbers.into_iter().map(bits).collect(), size)
}

/// Checks the size segment, which must come first; returns the bits per sample and whether samples are signed.
fn check_2000(bytes: &[u8], size: [u32; 2]) -> Result<(u8, bool), FrameFault> {
    let broken = || ["a JPEG 2000 codestream".to_string(), "other bytes".to_string()];
    if !bytes.starts_with(&[0xff, 0x4f, 0xff, 0x51]) || bytes.len() < 45 {
        return Err(broken());
    }
    let word = |at: usize| u32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let there = [word(8), word(12)];
    let (offsets, tile) = ([word(16), word(20), word(32), word(36)], [word(24), word(28)]);
    let components = u16::from_be_bytes([bytes[40], bytes[41]]);
    let [depth, dx, dy] = [bytes[42], bytes[43], bytes[44]];
    if there != size || components != 1 || offsets != [0; 4] || [dx, dy] != [1, 1] || tile.contains(&0) {
        let got = format!("{} x {} of {components}, from {}, {}", there[0], there[1], offsets[0], offsets[1]);
        return Err([format!("JPEG 2000 frames of {} x {} of 1 component", size[0], size[1]), got]);
    }
    let tiles = u64::from(size[0].div_ceil(tile[0])) * u64::from(size[1].div_ceil(tile[1]));
    if tiles > 65_535 {
        return Err(["at most 65535 JPEG 2000 tiles".into(), tiles.to_string()]);
    }
    let precision = (depth & 0x7f) + 1;
    if precision > 16 {
        return Err(["JPEG 2000 samples of at most 16 bits".into(), format!("{precision} bits")]);
    }
    Ok((precision, depth & 0x80 != 0))
}

fn full(bits: Vec<u32>, size: [u32; 2]) -> Result<Vec<u32>, FrameFault> {
    if bits.len() == pixel_count(size) {
        return Ok(bits);
    }
    Err([format!("{} pixels in a frame", pixel_count(size)), bits.len().to_string()])
}

/// Calls a decoder, and turns its errors and panics into a fault.
///
/// The libraries have no `unsafe`, but a damaged frame can make them index beyond an array.
fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, FrameFault> {
    let intact = "an intact compressed frame (copy the file again, or convert it with gdcmconv --raw)".to_string();
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(Ok(decoded)) => Ok(decoded),
        Ok(Err(got)) => Err([intact, got]),
        Err(_) => Err([intact, "one that the decoder breaks off at".into()]),
    }
}
