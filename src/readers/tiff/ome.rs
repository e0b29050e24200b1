//! Reads the first image of the OME-XML in a TIFF file's description.
//!
//! In: the XML. Out: the slice, channel and time of each page, and the distances between points. Planes (2-D images of
//! one slice, channel and time) are numbered in the image's order of dimensions. Each `TiffData` names the page at
//! which a run of planes starts.
//!
//! Source: OME-TIFF specification and OME schema, `Pixels` and `TiffData` (docs.openmicroscopy.org).

use std::path::Path;

use quick_xml::Reader;
use quick_xml::escape::unescape;
use quick_xml::events::{BytesStart, Event};

use super::check_slices;
use crate::frame::FileFrame;
use crate::lines::{clip, one_line};
use crate::units::common_unit;
use adjsplat::error::{Error, Result};

const RULE: &str = "OME-XML";

/// A run of planes that follow each other in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
struct PlaneRun {
    /// The number of the first plane.
    plane: u64,
    /// The number of the page that holds the first plane.
    page: u64,
    /// The number of planes; `None` means all planes that follow.
    count: Option<u64>,
}

/// The pages and the spacing of one image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ome {
    /// The numbers of slices, channels and times.
    sizes: [u64; 3],
    /// The difference of plane numbers between neighbouring slices, channels and times.
    strides: [u64; 3],
    /// The runs, sorted by their first planes.
    runs: Vec<PlaneRun>,
    spacing: [f64; 3],
    unit: Option<String>,
    /// What the user should know about the spacing.
    note: Option<String>,
}

/// Returns whether `text` is OME-XML.
pub(super) fn is_ome(text: &str) -> bool {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    text.starts_with('<') && (text.contains("<OME") || text.contains(":OME"))
}

impl Ome {
    /// Reads the XML in the description of the file at `path`.
    ///
    /// # Errors
    /// [`Error::Format`] if it is not well formed, is incomplete, or refers to other files.
    pub(super) fn parse(path: &Path, text: &str) -> Result<Ome> {
        let fault = |expected: &str, got: String| Error::format(path, 0, RULE, expected, got);
        let mut reader = Reader::from_str(text);
        let (mut ome, mut files): (Option<Ome>, Option<String>) = (None, None);
        loop {
            let event = reader.read_event().map_err(|error| fault("XML that is well formed", one_line(&error)))?;
            match &event {
                Event::Start(tag) | Event::Empty(tag) => match (tag.local_name().as_ref(), &mut ome) {
                    (b"Pixels", None) => ome = Some(Ome::pixels(path, tag)?),
                    (b"TiffData", Some(ome)) => {
                        let run = ome.run(path, tag)?;
                        ome.runs.push(run);
                    }
                    (b"UUID", Some(_)) => {
                        let name = attribute(tag, "FileName");
                        if let (Some(one), Some(other)) = (&files, &name)
                            && one != other
                        {
                            let got = format!("{} and {}; join them in one file", clip(one), clip(other));
                            return Err(fault("all planes in one file", got));
                        }
                        files = files.or(name);
                    }
                    _ => {}
                },
                // Further images have their own pages, which are not read.
                Event::End(tag) if tag.local_name().as_ref() == b"Pixels" => break,
                Event::Eof => break,
                _ => {}
            }
        }
        let mut ome = ome.ok_or_else(|| fault("an image with Pixels", "none; they may be in another file".into()))?;
        if ome.runs.is_empty() {
            ome.runs.push(PlaneRun { plane: 0, page: 0, count: None });
        }
        ome.runs.sort_by_key(|run| run.plane);
        Ok(ome)
    }

    /// Reads the attributes of `Pixels`.
    fn pixels(path: &Path, tag: &BytesStart<'_>) -> Result<Ome> {
        let mut sizes = [0; 3];
        for (size, name) in sizes.iter_mut().zip(["SizeZ", "SizeC", "SizeT"]) {
            let text = attribute(tag, name).unwrap_or_default();
            let parsed = text.trim().parse::<u64>().ok().filter(|size| *size > 0);
            *size =
                parsed.ok_or_else(|| Error::format(path, 0, RULE, format!("{name}, a number above 0"), clip(&text)))?;
        }
        let order = attribute(tag, "DimensionOrder").unwrap_or_default();
        let (mut strides, mut stride) = ([0; 3], 1u64);
        for letter in order.strip_prefix("XY").unwrap_or_default().chars() {
            if let Some(axis) = "ZCT".find(letter).filter(|axis| strides[*axis] == 0) {
                strides[axis] = stride;
                let next = stride.checked_mul(sizes[axis]);
                stride = next.ok_or_else(|| {
                    let what = format!("{}: planes of its image", path.display());
                    Error::Limit { what, need: u64::MAX, have: u64::MAX - 1 }
                })?;
            }
        }
        if strides.contains(&0) {
            let expected = "DimensionOrder, XY and then Z, C and T in any order";
            return Err(Error::format(path, 0, RULE, expected, clip(&order)));
        }
        let (spacing, unit, note) = spacing(tag);
        Ok(Ome { sizes, strides, runs: Vec::new(), spacing, unit, note })
    }

    /// Reads the attributes of a `TiffData` element.
    fn run(&self, path: &Path, tag: &BytesStart<'_>) -> Result<PlaneRun> {
        let number = |name: &str| match attribute(tag, name) {
            None => Ok(None),
            Some(text) => match text.trim().parse::<u64>() {
                Ok(number) => Ok(Some(number)),
                Err(_) => Err(Error::format(path, 0, RULE, format!("{name}, a number"), clip(&text))),
            },
        };
        let mut plane = 0;
        for (axis, name) in ["FirstZ", "FirstC", "FirstT"].into_iter().enumerate() {
            let first = number(name)?.unwrap_or(0);
            if first >= self.sizes[axis] {
                let expected = format!("{name} below {}", self.sizes[axis]);
                return Err(Error::format(path, 0, RULE, expected, first.to_string()));
            }
            plane += first * self.strides[axis];
        }
        let page = number("IFD")?;
        let count = number("PlaneCount")?.or(page.map(|_| 1));
        Ok(PlaneRun { plane, page: page.unwrap_or(0), count })
    }

    /// Returns the number of volumes: one for each channel at each time.
    pub(super) fn volumes(&self) -> u64 {
        self.sizes[1] * self.sizes[2]
    }

    /// Returns the pages of volume `volume`, slice by slice; the file at `path` has `count` pages.
    ///
    /// # Errors
    /// [`Error::Format`] if the XML gives no page for a slice, or one that is not there;
    /// [`Error::Limit`] if there are too many slices.
    pub(super) fn pages(&self, path: &Path, count: usize, volume: u64) -> Result<Vec<usize>> {
        let [slices, channels, _] = self.sizes;
        check_slices(path, slices)?;
        let base = (volume % channels) * self.strides[1] + (volume / channels) * self.strides[2];
        let page_of = |plane: u64| {
            let after = self.runs.partition_point(|run| run.plane <= plane);
            let run = self.runs[..after].last()?;
            let place = plane - run.plane;
            if run.count.is_some_and(|count| place >= count) {
                return None;
            }
            usize::try_from(run.page.checked_add(place)?).ok()
        };
        let mut pages = Vec::new();
        for slice in 0..slices {
            let page = page_of(base + slice * self.strides[0]);
            pages.push(page.filter(|page| *page < count).ok_or_else(|| {
                let expected = format!("a page of the file for slice {slice} of volume {volume}");
                let got = page.map_or("none".to_string(), |page| format!("page {page} of {count}"));
                Error::format(path, 0, RULE, expected, got)
            })?);
        }
        Ok(pages)
    }

    /// Returns what the user should know about the spacing.
    pub(super) fn note(&self) -> Option<String> {
        self.note.clone()
    }

    /// Returns the position and the spacing of the grid.
    pub(super) fn frame(&self) -> FileFrame {
        FileFrame { unit: self.unit.clone(), ..FileFrame::upright(self.spacing) }
    }
}

fn attribute(tag: &BytesStart<'_>, name: &str) -> Option<String> {
    let found = tag.attributes().with_checks(false).flatten().find(|a| a.key.as_ref() == name.as_bytes())?;
    let text = String::from_utf8_lossy(&found.value);
    Some(unescape(&text).map_or_else(|_| text.to_string(), |text| text.to_string()))
}

/// Returns the distances between points along x, y, z, their unit, which is that of the first one in the XML, and a note for the
/// user. Missing distances equal the first.
fn spacing(tag: &BytesStart<'_>) -> ([f64; 3], Option<String>, Option<String>) {
    let lengths = ["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"].map(|name| length(tag, name));
    let Some((first, unit)) = lengths.iter().flatten().next() else { return ([1.0; 3], None, None) };
    let mut note = None;
    let spacing = lengths.each_ref().map(|length| match length {
        Some((size, own)) if own == unit => *size,
        Some((size, own)) => match common_unit(&[Some(unit), Some(own)]) {
            Some((factors, _)) => size * factors[1],
            None => {
                let (unit, own) = (clip(unit), clip(own));
                note = Some(format!("warning: a distance in {own} is replaced by that along x, which is in {unit}"));
                *first
            }
        },
        None => *first,
    });
    (spacing, common_unit(&[Some(unit)]).map(|(_, unit)| unit), note)
}

/// Returns the length in attribute `name` and its unit; `None` if it is missing or not above 0.
fn length(tag: &BytesStart<'_>, name: &str) -> Option<(f64, String)> {
    let size = attribute(tag, name)?.trim().parse::<f64>().ok()?;
    let unit = attribute(tag, &format!("{name}Unit")).unwrap_or_else(|| "um".into());
    (size.is_finite() && size > 0.0).then_some((size, unit))
}
