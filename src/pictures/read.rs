//! Reads pictures from files: PNG and OpenEXR as frames of linear premultiplied light.
//!
//! In: a path. Out: a [`Frame`]. PNG samples of up to 16 bits are taken for sRGB and not premultiplied, grey and
//! palettes for colours; of an animation the first frame counts. OpenEXR samples are taken as they are: linear and
//! premultiplied; a layer without alpha is opaque.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use exr::meta::MetaData;
use exr::meta::attribute::ChannelList;
use exr::prelude::{AttributeValue, ReadChannels as _, ReadLayers as _};

use crate::write::PART;
use crate::{PictureKind, PicturePart};
use adjsplat::error::{Error, Result};
use adjsplat::splat::Frame;
use adjsplat::splat::MAX_SIZE;

/// Reads the picture at `path`; the ending of its name says the format.
///
/// # Errors
/// [`Error::Io`] if it cannot be opened; [`Error::Input`] if it is no picture of that format; [`Error::Limit`] if a
/// side is above [`MAX_SIZE`] or the memory cannot be had.
pub fn read_picture(path: &Path) -> Result<Frame> {
    match PictureKind::of(path)? {
        PictureKind::Png | PictureKind::Apng => read_png(path),
        PictureKind::Exr => read_exr(path),
    }
}

/// Returns which part of a larger picture the file at `path` says that it holds; `None` if it says nothing.
///
/// # Errors
/// [`Error::Io`] if it cannot be opened; [`Error::Input`] if it is no picture of the format that its name says, or no part.
pub fn read_part(path: &Path) -> Result<Option<PicturePart>> {
    if PictureKind::of(path)? != PictureKind::Exr {
        return Ok(None);
    }
    let described = exr_headers(path)?;
    let attributes = described.headers.iter().flat_map(|header| &header.own_attributes.other);
    let mut texts = attributes.filter(|(name, _)| **name == *PART);
    let Some((_, text)) = texts.next() else { return Ok(None) };
    let part = match text {
        AttributeValue::Text(text) => text.to_string().parse().ok(),
        _ => None,
    };
    part.map(Some).ok_or_else(|| broken(path, format!("its attribute {PART} says no part; draw it again")))
}

/// Reads the headers of an OpenEXR file, and checks its sizes.
fn exr_headers(path: &Path) -> Result<MetaData> {
    // The decoder's error would not say that a file is missing, so the file is opened first.
    File::open(path).map_err(Error::io("open", path))?;
    // The decoder takes memory for a block of pixels as large as the header says, so headers are checked before.
    let described = MetaData::read_from_file(path, false).map_err(|fault| broken(path, fault))?;
    for header in &described.headers {
        check_size(path, [header.layer_size.x(), header.layer_size.y()].map(side))?;
    }
    Ok(described)
}

fn side(side: usize) -> u32 {
    u32::try_from(side).unwrap_or(u32::MAX)
}

fn broken(path: &Path, fault: impl std::fmt::Display) -> Error {
    let fault = fault.to_string();
    Error::input(path.display().to_string(), format!("cannot be read as a picture: {}", fault.trim_end_matches('.')))
}

/// Refuses a picture of too large a `size` (columns and rows); `path` names it in errors.
fn check_size(path: &Path, size: [u32; 2]) -> Result<()> {
    let Some(&side) = size.iter().find(|&&side| side > MAX_SIZE) else { return Ok(()) };
    let what = format!("{}: pixels a side", path.display());
    Err(Error::Limit { what, need: side.into(), have: MAX_SIZE.into() })
}

/// Returns an empty frame of `size` (columns and rows); `path` names the picture in errors.
fn frame(path: &Path, size: [u32; 2]) -> Result<Frame> {
    check_size(path, size)?;
    Frame::transparent(size)
}

fn read_png(path: &Path) -> Result<Frame> {
    let file = File::open(path).map_err(Error::io("open", path))?;
    let mut decoder = png::Decoder::new(BufReader::new(file));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(|fault| broken(path, fault))?;
    if let Some(frames) = reader.info().animation_control().map(|control| control.num_frames).filter(|count| *count > 1)
    {
        return Err(Error::input(
            path.display().to_string(),
            format!("is an animation of {frames} frames; give one picture"),
        ));
    }
    let mut frame = frame(path, [reader.info().width, reader.info().height])?;
    let (colour, depth) = reader.output_color_type();
    let bytes = reader.output_buffer_size().ok_or_else(|| broken(path, "it is too large"))?;
    let mut samples = Vec::new();
    let refused = |_| Error::out_of_memory("a picture", bytes as u64);
    samples.try_reserve_exact(bytes).map_err(refused)?;
    samples.resize(bytes, 0);
    reader.next_frame(&mut samples).map_err(|fault| broken(path, fault))?;
    let channels = colour.samples();
    let wide = depth == png::BitDepth::Sixteen;
    let linear = linear_samples(wide);
    let sample = |at: usize| {
        if wide { u16::from_be_bytes([samples[2 * at], samples[2 * at + 1]]) } else { samples[at].into() }
    };
    let most = if wide { 65_535.0 } else { 255.0 };
    for (at, pixel) in frame.pixels_mut().as_chunks_mut::<4>().0.iter_mut().enumerate() {
        let of = |channel: usize| sample(at * channels + channel);
        let light = |channel: usize| linear[usize::from(of(channel))];
        let ([r, g, b], alpha) = match channels {
            1 => ([light(0); 3], most),
            2 => ([light(0); 3], of(1).into()),
            3 => ([0, 1, 2].map(light), most),
            _ => ([0, 1, 2].map(light), of(3).into()),
        };
        let alpha: f32 = alpha / most;
        *pixel = [r * alpha, g * alpha, b * alpha, alpha];
    }
    Ok(frame)
}

/// Returns the linear light of every sRGB sample of 16 bits if `wide`, else of 8 bits (IEC 61966-2-1).
fn linear_samples(wide: bool) -> Vec<f32> {
    let last = if wide { u16::MAX } else { 255 };
    let linear = |encoded: f64| {
        if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    };
    #[expect(clippy::cast_possible_truncation, reason = "single precision is a frame's")]
    (0..=last).map(|sample| linear(f64::from(sample) / f64::from(last)) as f32).collect()
}

/// The pixels of an OpenEXR file while it is read.
struct ExrPixels {
    columns: usize,
    frame: Result<Frame>,
}

fn read_exr(path: &Path) -> Result<Frame> {
    let headers = exr_headers(path)?.headers;
    let has = |channels: &ChannelList, name: &str| channels.list.iter().any(|channel| channel.name == *name);
    if !headers.iter().any(|header| ["R", "G", "B"].iter().all(|name| has(&header.channels, name))) {
        return Err(Error::input(path.display().to_string(), "has no layer with the channels R, G and B"));
    }
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, _| ExrPixels { columns: size.x(), frame: frame(path, [side(size.x()), side(size.y())]) },
            |pixels: &mut ExrPixels, at, (r, g, b, a): (f32, f32, f32, f32)| {
                if let Ok(frame) = &mut pixels.frame {
                    let first = 4 * (at.y() * pixels.columns + at.x());
                    frame.pixels_mut()[first..first + 4].copy_from_slice(&[r, g, b, a]);
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|fault| broken(path, fault))?;
    image.layer_data.channel_data.pixels.frame
}
