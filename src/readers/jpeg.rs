//! Decodes JPEG streams, of DICOM frames and of chunks of TIFF pages, with a library.
//!
//! In: a stream, and the size that its file states. Out: one number per pixel, x fastest. The size in the stream is
//! compared with the file's before the decoder runs, so that the decoder allocates no more than the file asks for.
//! Features that the decoder gets wrong without an error are refused.
//!
//! Source: ITU-T T.81, annexes B and H.

use std::panic::{AssertUnwindSafe, catch_unwind};

use jpeg_decoder::{Decoder, PixelFormat};

/// An error in packed pixels: a text that says what was expected, and one that says what was found.
pub(super) type PixelFault = [String; 2];

/// The most bytes of memory that decoding takes for each pixel: lossless JPEG needs differences of 4 bytes, results of
/// 2 bytes twice, and our numbers.
pub(super) const BYTES_PER_PIXEL: u64 = 16;

/// Decodes a JPEG stream of one component: 8-bit, or lossless with up to 16 bits.
pub(super) fn decode(bytes: &[u8], size: [u32; 2]) -> Result<Vec<u32>, PixelFault> {
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
fn check(bytes: &[u8], size: [u32; 2]) -> Result<(), PixelFault> {
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
                    return Err(["JPEG of 8 bits, or lossless".into(), format!("{precision} bits")]);
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
                    return Err(["a lossless JPEG scan in one piece".into(), got.into()]);
                }
                return if sized { Ok(()) } else { Err(broken()) };
            }
            _ => {}
        }
        at += 2 + len;
    }
}

/// Returns `bits` if it has a number for each pixel.
pub(super) fn full(bits: Vec<u32>, size: [u32; 2]) -> Result<Vec<u32>, PixelFault> {
    let need = pixel_count(size);
    if bits.len() == need { Ok(bits) } else { Err([format!("{need} pixels"), bits.len().to_string()]) }
}

/// Returns the number of pixels of an image of `x` by `y`.
pub(super) fn pixel_count([x, y]: [u32; 2]) -> usize {
    x as usize * y as usize
}

/// Calls a decoder, and turns its errors and panics into a fault.
///
/// The libraries have no `unsafe`, but damaged pixels can make them index beyond an array.
pub(super) fn guarded<T>(decode: impl FnOnce() -> Result<T, String>) -> Result<T, PixelFault> {
    let intact = "intact compressed pixels".to_string();
    match catch_unwind(AssertUnwindSafe(decode)) {
        Ok(Ok(decoded)) => Ok(decoded),
        Ok(Err(got)) => Err([intact, got]),
        Err(_) => Err([intact, "one that the decoder breaks off at".into()]),
    }
}
