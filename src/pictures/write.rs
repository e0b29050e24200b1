//! Pictures: writes frames to files.
//!
//! In: frames of linear premultiplied light. Out: PNG (sRGB, 8 or 16 bits, not premultiplied), animated PNG, or
//! OpenEXR (linear, premultiplied, 32-bit float).

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use adjsplat::error::{Error, Result};
use adjsplat::splat::Frame;

use crate::PicturePart;

/// Format of a picture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureKind {
    /// PNG: sRGB, not premultiplied.
    Png,
    /// Animated PNG, which repeats for ever.
    Apng,
    /// OpenEXR: linear, premultiplied, 32-bit float.
    Exr,
}

impl PictureKind {
    /// Returns the format that the ending of the file's name stands for.
    ///
    /// # Errors
    /// [`Error::Input`] if the name ends in none of .png, .apng and .exr.
    pub fn of(path: &Path) -> Result<PictureKind> {
        match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("png") => Ok(PictureKind::Png),
            Some("apng") => Ok(PictureKind::Apng),
            Some("exr") => Ok(PictureKind::Exr),
            _ => Err(Error::input(path.display().to_string(), "must end in .png, .apng or .exr")),
        }
    }

    /// Returns the most bytes that encoding a picture takes: the picture, its compressed form, and the encoder's
    /// buffers.
    ///
    /// An animation is encoded at its end, one frame at a time.
    pub fn memory(self, depth: SampleDepth, pixels: u64) -> u64 {
        let picture = pixels.saturating_mul(self.pixel_bytes(depth));
        // While a picture with 16-bit samples is made from a frame, memory holds the frame and the samples twice.
        let converting = pixels.saturating_mul(16).saturating_add(picture.saturating_mul(2));
        picture.saturating_mul(4).max(converting)
    }

    /// Returns the bytes of finished pictures that are kept until all are drawn, as an animation needs.
    pub fn kept(self, depth: SampleDepth, pixels: u64, frames: u32) -> u64 {
        match self {
            PictureKind::Apng => pixels.saturating_mul(self.pixel_bytes(depth)).saturating_mul(frames.into()),
            _ => 0,
        }
    }

    fn pixel_bytes(self, depth: SampleDepth) -> u64 {
        match (self, depth) {
            (PictureKind::Exr, _) => 16,
            (_, SampleDepth::Sixteen) => 8,
            (_, SampleDepth::Eight) => 4,
        }
    }
}

/// Returns the files of a turn of so many pictures, one for each: `out-000.png`, `out-001.png` ... for `out.png`.
pub fn numbered(path: &Path, pictures: u32) -> Vec<PathBuf> {
    let width = pictures.saturating_sub(1).to_string().len().max(3);
    let file = |picture| {
        let mut name = path.file_stem().unwrap_or_default().to_owned();
        name.push(format!("-{picture:0width$}."));
        name.push(path.extension().unwrap_or_default());
        path.with_file_name(name)
    };
    (0..pictures).map(file).collect()
}

/// Bits of each sample of a PNG.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleDepth {
    /// 8 bits.
    Eight,
    /// 16 bits.
    Sixteen,
}

/// The attribute of an OpenEXR file that says which part of a larger picture it is.
#[cfg(not(target_arch = "wasm32"))]
pub(crate) const PART: &str = "adjsplatPart";

/// Frames per second of an animation.
const RATE: u16 = 12;

/// One picture, as samples in the file's order.
pub struct Picture {
    size: [u32; 2],
    kind: PictureKind,
    depth: SampleDepth,
    /// Samples as the file stores them: PNG's are big endian, OpenEXR's little.
    bytes: Vec<u8>,
    #[cfg_attr(target_arch = "wasm32", expect(dead_code, reason = "a page saves no OpenEXR"))]
    part: Option<PicturePart>,
}

impl Picture {
    /// Converts a frame to the samples of a file; `depth` counts for PNG alone.
    pub fn new(frame: &Frame, kind: PictureKind, depth: SampleDepth) -> Picture {
        let bytes = match (kind, depth) {
            (PictureKind::Exr, _) => frame.pixels().iter().flat_map(|sample| sample.to_le_bytes()).collect(),
            (_, SampleDepth::Eight) => frame.to_srgb8(),
            (_, SampleDepth::Sixteen) => frame.to_srgb16().iter().flat_map(|sample| sample.to_be_bytes()).collect(),
        };
        Picture { size: frame.size(), kind, depth, bytes, part: None }
    }

    /// Says which part of a larger picture it is, if it is written as OpenEXR.
    #[must_use]
    pub fn with_part(self, part: Option<PicturePart>) -> Picture {
        Picture { part, ..self }
    }

    /// Returns red, green, blue and alpha of each pixel, for a checksum.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Writes the picture as a file of its format.
    ///
    /// # Errors
    /// If `out` fails.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        match self.kind {
            PictureKind::Exr => self.write_exr(out),
            _ => write_png(out, std::slice::from_ref(self)),
        }
    }

    /// A page has no encoder of OpenEXR, which would make it larger.
    #[cfg(target_arch = "wasm32")]
    fn write_exr(&self, _: &mut dyn Write) -> io::Result<()> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "a page saves .png and .apng only"))
    }

    #[cfg(not(target_arch = "wasm32"))]
    fn write_exr(&self, out: &mut dyn Write) -> io::Result<()> {
        use exr::prelude::{
            AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes,
            WritableImage as _,
        };
        let channel = |(name, from): (&str, usize)| {
            let sample = |pixel: &[u8; 16]| f32::from_le_bytes(pixel[from..from + 4].try_into().expect("four bytes"));
            AnyChannel::new(name, FlatSamples::F32(self.bytes.as_chunks().0.iter().map(sample).collect()))
        };
        let channels = AnyChannels::sort([("R", 0), ("G", 4), ("B", 8), ("A", 12)].map(channel).into_iter().collect());
        let size = self.size.map(|side| side as usize);
        let mut attributes = LayerAttributes::named("adjsplat");
        if let Some(part) = &self.part {
            attributes.other.insert(PART.into(), AttributeValue::Text(part.to_string().as_str().into()));
        }
        let layer = Layer::new((size[0], size[1]), attributes, Encoding::SMALL_LOSSLESS, channels);
        // The encoder seeks back to fill in its tables, so it writes to memory first.
        let mut file = io::Cursor::new(Vec::new());
        let written = Image::from_layer(layer).write().to_buffered(&mut file);
        written.map_err(|fault| io::Error::other(fault.to_string()))?;
        out.write_all(file.get_ref())
    }
}

/// Writes a PNG; several pictures make an animation that repeats for ever.
///
/// # Errors
/// If `out` fails, or the pictures differ in size.
pub fn write_png(out: &mut dyn Write, pictures: &[Picture]) -> io::Result<()> {
    let Some(first) = pictures.first() else { return Ok(()) };
    let mut encoder = png::Encoder::new(out, first.size[0], first.size[1]);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(if first.depth == SampleDepth::Eight { png::BitDepth::Eight } else { png::BitDepth::Sixteen });
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    if pictures.len() > 1 {
        let count = u32::try_from(pictures.len()).map_err(io::Error::other)?;
        encoder.set_animated(count, 0)?;
        encoder.set_frame_delay(1, RATE)?;
    }
    let mut writer = encoder.write_header()?;
    for picture in pictures {
        writer.write_image_data(&picture.bytes)?;
    }
    writer.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_files_count_in_three_digits_or_more() {
        let names = numbered(Path::new("a/out.png"), 2);
        assert_eq!(names, [Path::new("a/out-000.png"), Path::new("a/out-001.png")]);
        assert_eq!(numbered(Path::new("turn.b.exr"), 1_001)[7], Path::new("turn.b-0007.exr"));
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_not_utf_8_are_kept_in_numbered_files() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt as _;
        let path = |name: &'static [u8]| Path::new(OsStr::from_bytes(name));
        assert_eq!(numbered(path(b"\xff.png"), 1), [path(b"\xff-000.png")]);
    }
}
