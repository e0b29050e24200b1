//! Unpacks strips and tiles that are packed by JPEG.
//!
//! In: a chunk's bytes, and the tables that all chunks of the page share. Out: its samples. The `tiff` crate would use
//! another decoder, which allocates what a damaged chunk asks for.
//!
//! Source: TIFF Technical Note 2 (Draft TIFF 6.0 supplement, 1995).

use std::io;

use crate::jpeg;
use adjsplat::volume::Samples;

/// The value of the tag Compression that means JPEG, as Technical Note 2 defines it.
pub(super) const METHOD: u64 = 7;

/// The number of bytes of the markers that start and end a JPEG stream.
const MARKER: usize = 2;

/// Returns the samples of `chunk`, whose size in pixels is `size`, in a buffer of the type of `like`.
///
/// `tables` is empty, or a stream of tables without pixels.
///
/// # Errors
/// If the stream is damaged or of another size, or if a sample does not fit the type.
pub(super) fn unpack(tables: &[u8], chunk: &[u8], size: [u32; 2], like: &Samples) -> io::Result<Samples> {
    let fault = |text: String| io::Error::new(io::ErrorKind::InvalidData, text);
    let stream = match (tables.len().checked_sub(MARKER), chunk.get(MARKER..)) {
        (Some(end), Some(pixels)) => [&tables[..end], pixels].concat(),
        _ => chunk.to_vec(),
    };
    let bits = jpeg::decode(&stream, size).map_err(|[want, got]| fault(format!("JPEG: needs {want}, has {got}")))?;
    let mut samples = Samples::zeros(like.sample_type(), bits.len());
    let fits = match &mut samples {
        Samples::U8(samples) => store(&bits, samples),
        Samples::U16(samples) => store(&bits, samples),
        _ => false,
    };
    if fits { Ok(samples) } else { Err(fault(format!("JPEG samples that do not fit {}", like.sample_type().name()))) }
}

/// Stores `bits` in `samples`; returns whether all fit.
fn store<T: TryFrom<u32>>(bits: &[u32], samples: &mut [T]) -> bool {
    samples.iter_mut().zip(bits).all(|(sample, bits)| T::try_from(*bits).map(|bits| *sample = bits).is_ok())
}
