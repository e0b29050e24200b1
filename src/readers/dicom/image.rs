//! Finds the size, sample type, position and scaling of the frames in one DICOM file.
//!
//! In: the file's elements. Out: an [`ImageFile`] and its [`DicomFrame`]s. Values are looked up in the frame's
//! functional groups, then in the shared ones, then at the root, so that enhanced and plain objects are read alike.
//!
//! Source: DICOM PS3.3, C.7.6.2 (image plane), C.7.6.3 (image pixel), C.7.6.16 (functional groups), C.8.8.3.2 (offsets of
//! frames), C.11.1 (rescale).

use std::path::{Path, PathBuf};

use super::codec::FrameCodec;
use super::elements::{DicomElements, Pixels, TagValues, text};
use super::tags;
use super::tags::Tag;
use crate::file_list::MAX_FILES;
use crate::frame::{cross, length};
use crate::lines::clip;
use adjsplat::error::{Error, Result};
use adjsplat::volume::{MAX_DIM, SampleType};

/// The bits that hold the value in a pixel's cell (the bytes in which a pixel is stored).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelLayout {
    /// The integer or floating-point type of the cell.
    pub(super) sample_type: SampleType,
    /// The number of bits that hold the value: from 1 to all bits of the cell.
    pub(super) stored: u32,
    /// The number of unused bits below the value.
    pub(super) shift: u32,
}

/// The values that identify and describe a series; each of its files repeats them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SeriesIdentity {
    /// The unique identifier (UID) of the series; empty if the file has none.
    pub(super) uid: String,
    /// The name of the series, as the scanner or its user wrote it.
    pub(super) description: String,
    /// The kind of the scanner: "CT", "MR".
    pub(super) modality: String,
    /// The photometric interpretation (how numbers map to brightness): "MONOCHROME2".
    pub(super) photometric: String,
}

/// One file with grey pixels.
#[derive(Debug, Clone)]
pub(super) struct ImageFile {
    pub(super) path: PathBuf,
    pub(super) series: SeriesIdentity,
    /// The numbers of pixels along x and y.
    pub(super) size: [u32; 2],
    pub(super) layout: PixelLayout,
    pub(super) codec: FrameCodec,
    pub(super) pixels: Pixels,
    /// For compressed pixels: the index of the first fragment of each frame.
    pub(super) first_fragments: Vec<u32>,
    /// Whether the file has a look-up table of values, which is not applied.
    pub(super) has_lut: bool,
}

/// The position and orientation of a frame, in mm, with world axes L, P, S (DICOM's image plane).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ImagePlane {
    /// The position of the centre of the first pixel.
    pub(super) position: [f64; 3],
    /// The unit vectors along a row (towards higher columns) and along a column (towards higher rows).
    pub(super) orientation: [[f64; 3]; 2],
}

/// One frame of a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DicomFrame {
    /// The index of the file in the list of files.
    pub(super) file: usize,
    /// The index of the frame among the frames of its file, from 0.
    pub(super) index: u32,
    pub(super) place: Option<ImagePlane>,
    /// The distances between neighbouring columns (along x) and between neighbouring rows (along y), in mm.
    pub(super) spacing: Option<[f64; 2]>,
    /// The distance to the next slice in mm, as the file states it.
    pub(super) depth: Option<f64>,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    /// The instance number, which counts the images of a series.
    pub(super) number: Option<i64>,
}

/// The kind of content of a DICOM file.
pub(super) enum FileContent {
    /// The file has grey frames.
    Image(ImageFile, Vec<DicomFrame>),
    /// The file has coloured frames, such as a screenshot; the error says so.
    Colour(Error),
    /// The file has no pixels, for example a report.
    Nothing,
}

/// The class of objects with spectra, which have rows and columns but no pixels.
const SPECTRA: &str = "1.2.840.10008.5.1.4.1.1.4.2";

/// Converts the `elements` of a file to a description of the file and its frames; `file` is the file's index.
///
/// # Errors
/// [`Error::Format`] for values that contradict each other or are not supported; [`Error::Limit`] if a size is too
/// large.
pub(super) fn read(elements: DicomElements, file: usize) -> Result<FileContent> {
    let root = Attributes { path: &elements.path, sources: vec![&elements.root] };
    let Some(pixels) = elements.pixels.clone() else {
        let is_image = [tags::ROWS, tags::COLUMNS].iter().all(|tag| elements.root.contains_key(tag));
        if is_image && root.text(tags::SOP_CLASS) != SPECTRA {
            let expected = "pixels, as it has Rows and Columns";
            return Err(root.fault("DICOM Pixel Data", expected, "the end of the file (copy it again)"));
        }
        return Ok(FileContent::Nothing);
    };
    let size = [root.size(tags::COLUMNS, "DICOM Columns")?, root.size(tags::ROWS, "DICOM Rows")?];
    let frame_count = match root.whole(tags::FRAME_COUNT, "DICOM Number of Frames")? {
        None => 1,
        Some(count) => u32::try_from(count)
            .ok()
            .filter(|count| *count > 0)
            .ok_or_else(|| root.fault("DICOM Number of Frames", "at least 1", count.to_string()))?,
    };
    if u64::from(frame_count) > MAX_FILES {
        let what = format!("{}: frames", elements.path.display());
        return Err(Error::Limit { what, need: frame_count.into(), have: MAX_FILES });
    }
    let photometric = root.text(tags::PHOTOMETRIC);
    let samples = root.number(tags::SAMPLES_PER_PIXEL, "DICOM Samples per Pixel")?.unwrap_or(1);
    if samples != 1 || !["", "MONOCHROME1", "MONOCHROME2"].contains(&photometric.as_str()) {
        let expected = "one grey sample a pixel, MONOCHROME1 or MONOCHROME2 (extract one channel with another tool)";
        let fault = root.fault(
            "DICOM Photometric Interpretation",
            expected,
            format!("{samples} of {}", photometric.escape_debug()),
        );
        return Ok(FileContent::Colour(fault));
    }
    let series = SeriesIdentity {
        uid: root.text(tags::SERIES_UID),
        description: root.text(tags::SERIES_DESCRIPTION),
        modality: root.text(tags::MODALITY),
        photometric,
    };
    let layout = root.layout(&pixels)?;
    let codec = FrameCodec::of(&elements.path, &elements.syntax, &pixels)?;
    let first_fragments = check_pixels(&elements.path, &pixels, size, frame_count, layout)?;
    let mut frames = Vec::new();
    let none = TagValues::new();
    for index in 0..frame_count {
        let frame_values = elements.per_frame.get(index as usize).unwrap_or(&none);
        let attributes =
            Attributes { path: &elements.path, sources: vec![frame_values, &elements.shared, &elements.root] };
        frames.push(attributes.frame(file, index)?);
    }
    let has_own = |values: &TagValues| values.contains_key(&tags::POSITION);
    if frame_count > 1 && !has_own(&elements.shared) && !elements.per_frame.iter().any(has_own) {
        root.step_frames(&mut frames)?;
    }
    let has_lut = elements.root.contains_key(&tags::MODALITY_LUT);
    let path = elements.path;
    Ok(FileContent::Image(ImageFile { path, series, size, layout, codec, pixels, first_fragments, has_lut }, frames))
}

/// Checks that there are enough pixels, and returns the first fragment of each frame.
fn check_pixels(
    path: &Path,
    pixels: &Pixels,
    size: [u32; 2],
    frame_count: u32,
    layout: PixelLayout,
) -> Result<Vec<u32>> {
    let [x, y] = size;
    let described = format!("{x} x {y} x {frame_count} of {}", layout.sample_type.name());
    match pixels {
        Pixels::Native { at, len, .. } => {
            // Both sizes are below 2^16, and a sample has at most 8 bytes: the product does not overflow.
            let need = u64::from(x) * u64::from(y) * u64::from(frame_count) * layout.sample_type.bytes() as u64;
            if *len < need {
                let got = format!("{len} bytes");
                return Err(Error::format(path, *at, "DICOM Pixel Data", format!("{need} bytes ({described})"), got));
            }
            Ok(Vec::new())
        }
        Pixels::Encapsulated { offsets, fragments } => {
            let at = fragments.first().map_or(0, |(at, _)| *at);
            let fault = |expected: &str| {
                let got = format!("{} fragments and {} offsets ({described})", fragments.len(), offsets.len());
                Error::format(path, at, "DICOM Pixel Data", expected, got)
            };
            if fragments.is_empty() {
                return Err(fault("at least one fragment"));
            }
            if frame_count == 1 {
                return Ok(vec![0]);
            }
            if fragments.len() == frame_count as usize {
                return Ok((0..frame_count).collect());
            }
            if offsets.len() != frame_count as usize {
                return Err(fault("one fragment a frame, or an offset for each frame"));
            }
            let first = |offset: &u32| {
                let wanted = at + u64::from(*offset);
                let found = fragments.binary_search_by_key(&wanted, |(at, _)| *at).ok();
                found.and_then(|index| u32::try_from(index).ok())
            };
            let starts: Option<Vec<u32>> = offsets.iter().map(first).collect();
            let starts = starts.filter(|starts| starts.is_sorted_by(|a, b| a < b) && starts[0] == 0);
            starts.ok_or_else(|| fault("offsets that lead to the fragments, in order"))
        }
    }
}

/// The values that apply to one frame or file; the most specific source is searched first.
struct Attributes<'a> {
    path: &'a Path,
    sources: Vec<&'a TagValues>,
}

impl Attributes<'_> {
    fn fault(&self, rule: &'static str, expected: impl Into<String>, got: impl Into<String>) -> Error {
        Error::format(self.path, 0, rule, expected, got)
    }

    /// Returns the value of `tag`; `None` if it is missing, or has only zero bytes and spaces.
    fn value(&self, tag: Tag) -> Option<&[u8]> {
        let values = self.sources.iter().filter_map(|source| source.get(&tag));
        values.map(Vec::as_slice).find(|value| value.iter().any(|b| !matches!(b, 0 | b' ')))
    }

    fn text(&self, tag: Tag) -> String {
        self.value(tag).map(text).unwrap_or_default()
    }

    /// Returns the 16-bit binary number of `tag`, if it is there.
    fn number(&self, tag: Tag, rule: &'static str) -> Result<Option<u16>> {
        // `value` would treat the number 0 as a missing value.
        let Some(value) = self.sources.iter().find_map(|source| source.get(&tag)) else { return Ok(None) };
        match value.as_slice() {
            [] => Ok(None),
            [a, b] => Ok(Some(u16::from_le_bytes([*a, *b]))),
            other => Err(self.fault(rule, "a number of two bytes", format!("{} bytes", other.len()))),
        }
    }

    /// Returns the whole number of `tag`, which is written as text.
    fn whole(&self, tag: Tag, rule: &'static str) -> Result<Option<i64>> {
        let Some(value) = self.value(tag) else { return Ok(None) };
        let text = text(value);
        match text.parse() {
            Ok(number) => Ok(Some(number)),
            Err(_) => Err(self.fault(rule, "a whole number", format!("\"{}\"", text.escape_debug()))),
        }
    }

    /// Returns the `N` numbers of `tag`, which are written as text.
    fn decimals<const N: usize>(&self, tag: Tag, rule: &'static str) -> Result<Option<[f64; N]>> {
        let numbers = self.list(tag, rule, N)?;
        Ok(numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok()))
    }

    /// Returns the `count` numbers of `tag`, which are written as text.
    fn list(&self, tag: Tag, rule: &'static str, count: usize) -> Result<Option<Vec<f64>>> {
        let Some(value) = self.value(tag) else { return Ok(None) };
        let text = text(value);
        let numbers: Option<Vec<f64>> = text.split('\\').map(|word| word.trim().parse().ok()).collect();
        match numbers.filter(|all| all.len() == count && all.iter().all(|number| number.is_finite())) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.fault(rule, format!("{count} finite numbers"), clip(&text))),
        }
    }

    /// Moves `frames`, which all have the position of their file, along their normal: by the Grid Frame Offset Vector, else by
    /// the Spacing Between Slices. Without either they stay at one place.
    fn step_frames(&self, frames: &mut [DicomFrame]) -> Result<()> {
        const RULE: &str = "DICOM Grid Frame Offset Vector";
        let Some(ImagePlane { position, orientation: [row, column] }) = frames[0].place else { return Ok(()) };
        let normal = cross(row, column);
        let offsets = match self.list(tags::FRAME_OFFSETS, RULE, frames.len())? {
            Some(offsets) if offsets[0] == 0.0 => offsets,
            // They are z coordinates, if slices are axial.
            Some(offsets) if offsets[0] == position[2] && normal[2].abs() > 0.999 => {
                offsets.iter().map(|z| (z - position[2]) / normal[2]).collect()
            }
            Some(offsets) => {
                let expected = "0 at first, or, of axial slices, the z of Image Position (Patient)";
                return Err(self.fault(RULE, expected, offsets[0].to_string()));
            }
            None => {
                let step = self.length(tags::SLICE_SPACING, "DICOM Spacing Between Slices")?.unwrap_or(0.0);
                (0..frames.len()).map(|index| index as f64 * step).collect()
            }
        };
        for (frame, offset) in frames.iter_mut().zip(offsets) {
            if let Some(place) = &mut frame.place {
                place.position = [0, 1, 2].map(|c| position[c] + offset * normal[c]);
            }
        }
        Ok(())
    }

    /// Returns the length of `tag` in mm; `None` also for 0 and below, which mean that it is unknown.
    fn length(&self, tag: Tag, rule: &'static str) -> Result<Option<f64>> {
        Ok(self.decimals::<1>(tag, rule)?.map(|[length]| length).filter(|length| *length > 0.0))
    }

    fn size(&self, tag: Tag, rule: &'static str) -> Result<u32> {
        let size = self.number(tag, rule)?.unwrap_or(0);
        if size == 0 {
            return Err(self.fault(rule, format!("1 to {MAX_DIM}"), "none"));
        }
        Ok(size.into())
    }

    fn layout(&self, pixels: &Pixels) -> Result<PixelLayout> {
        let whole = |sample_type: SampleType| PixelLayout { sample_type, stored: sample_type.bits(), shift: 0 };
        match pixels {
            Pixels::Native { tag: tags::FLOAT_PIXELS, .. } => return Ok(whole(SampleType::F32)),
            Pixels::Native { tag: tags::DOUBLE_PIXELS, .. } => return Ok(whole(SampleType::F64)),
            _ => {}
        }
        let rule = "DICOM Bits Allocated";
        let allocated: u32 = self.number(tags::BITS_ALLOCATED, rule)?.unwrap_or(0).into();
        let signed = self.number(tags::PIXEL_REPRESENTATION, "DICOM Pixel Representation")?.unwrap_or(0) == 1;
        let sample_type = match (allocated, signed) {
            (8, false) => SampleType::U8,
            (8, true) => SampleType::I8,
            (16, false) => SampleType::U16,
            (16, true) => SampleType::I16,
            (32, false) => SampleType::U32,
            (32, true) => SampleType::I32,
            _ => return Err(self.fault(rule, "8, 16 or 32", allocated.to_string())),
        };
        let stored = self.number(tags::BITS_STORED, "DICOM Bits Stored")?.map_or(allocated, u32::from);
        let high = self.number(tags::HIGH_BIT, "DICOM High Bit")?.map_or(stored.saturating_sub(1), u32::from);
        if stored == 0 || high >= allocated || high + 1 < stored {
            let got = format!("{stored} with high bit {high}");
            return Err(self.fault("DICOM Bits Stored", format!("bits inside the {allocated} allocated"), got));
        }
        Ok(PixelLayout { sample_type, stored, shift: high + 1 - stored })
    }

    fn frame(&self, file: usize, index: u32) -> Result<DicomFrame> {
        let position = self.decimals::<3>(tags::POSITION, "DICOM Image Position (Patient)")?;
        let orientation = self.decimals::<6>(tags::ORIENTATION, "DICOM Image Orientation (Patient)")?;
        let place = match (position, orientation) {
            (Some(position), Some([a, b, c, d, e, f])) => {
                let orientation = [unit([a, b, c]), unit([d, e, f])];
                let normal = cross(orientation[0], orientation[1]);
                // Text rounded by the writer keeps right angles within a thousandth, so a larger error means a damaged
                // file.
                if length(normal).is_nan() || length(normal) < 0.99 {
                    let rule = "DICOM Image Orientation (Patient)";
                    return Err(self.fault(rule, "two directions at right angles", format!("{orientation:?}")));
                }
                Some(ImagePlane { position, orientation })
            }
            _ => None,
        };
        // The file gives the distance between rows first, then that between columns.
        let spacing = match self.decimals::<2>(tags::PIXEL_SPACING, "DICOM Pixel Spacing")? {
            Some(spacing) => Some(spacing),
            None => self.decimals::<2>(tags::IMAGER_SPACING, "DICOM Imager Pixel Spacing")?,
        };
        let depth = match unless_placed(place, self.length(tags::SLICE_SPACING, "DICOM Spacing Between Slices"))? {
            Some(depth) => Some(depth),
            None => unless_placed(place, self.length(tags::SLICE_THICKNESS, "DICOM Slice Thickness"))?,
        };
        let mut slope = 1.0;
        for (tag, rule) in [(tags::SLOPE, "DICOM Rescale Slope"), (tags::DOSE_SCALING, "DICOM Dose Grid Scaling")] {
            slope *= self.decimals::<1>(tag, rule)?.map_or(1.0, |[slope]| slope);
            if slope == 0.0 {
                return Err(self.fault(rule, "a slope that is not 0", "0"));
            }
        }
        Ok(DicomFrame {
            file,
            index,
            place,
            spacing: spacing.map(|[rows, columns]| [columns, rows]),
            depth,
            slope,
            intercept: self.decimals::<1>(tags::INTERCEPT, "DICOM Rescale Intercept")?.map_or(0.0, |[value]| value),
            number: unless_placed(place, self.whole(tags::INSTANCE_NUMBER, "DICOM Instance Number"))?,
        })
    }
}

/// Returns the names and values that can differ between two frames at one position, the most likely first.
pub(super) fn circumstances(elements: &DicomElements, frame: u32) -> Vec<(&'static str, Vec<u8>)> {
    let none = TagValues::new();
    let frame_values = elements.per_frame.get(frame as usize).unwrap_or(&none);
    let attributes = Attributes { path: &elements.path, sources: vec![frame_values, &elements.shared, &elements.root] };
    [
        ("echo time", tags::ECHO_TIME),
        ("temporal position", tags::TEMPORAL_POSITION),
        ("temporal position", tags::TEMPORAL_INDEX),
        ("trigger time", tags::TRIGGER_TIME),
        ("diffusion b-value", tags::B_VALUE),
        ("stack", tags::STACK),
        ("image type", tags::IMAGE_TYPE),
        ("acquisition number", tags::ACQUISITION_NUMBER),
        ("acquisition time", tags::ACQUISITION_TIME),
    ]
    .map(|(name, tag)| (name, attributes.value(tag).map(<[u8]>::to_vec).unwrap_or_default()))
    .into()
}

/// Returns `found`, but nothing instead of an error if the position of the slice makes it needless.
fn unless_placed<T>(place: Option<ImagePlane>, found: Result<Option<T>>) -> Result<Option<T>> {
    if place.is_some() { Ok(found.unwrap_or_default()) } else { found }
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = length(v);
    v.map(|c| c / length)
}
