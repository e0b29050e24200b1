//! Reads the description that ImageJ writes into a TIFF file: lines of `key=value`.
//!
//! In: the description. Out: the slice, channel and frame of each page, the distances between points, and the slope and
//! intercept of the values. Missing keys have ImageJ's defaults.
//!
//! Source: ImageJ's own reading and writing of these lines (ij.io, public domain).

use std::path::Path;

use super::check_slices;
use super::page::Resolution;
use crate::frame::FileFrame;
use adjsplat::error::{Error, Result};

/// The contents of a description that ImageJ wrote.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ImageJ {
    /// The total number of pages.
    pub(super) images: u64,
    channels: u64,
    frames: u64,
    /// The number of slices; 0 if the text does not state it, which means as many slices as the pages allow.
    slices: u64,
    unit: Option<String>,
    /// The distance between slices.
    spacing: f64,
    /// The slope and the intercept that turn samples into values.
    scaling: (f64, f64),
}

impl ImageJ {
    /// Parses the description `text`; `None` if ImageJ did not write it.
    pub(super) fn parse(text: &str) -> Option<ImageJ> {
        if !text.starts_with("ImageJ=") {
            return None;
        }
        let value = |key: &str| {
            let values = text.lines().filter_map(|line| line.split_once('='));
            values.filter(|(found, _)| *found == key).map(|(_, value)| value.trim()).next_back()
        };
        // Some writers store whole numbers as decimals ("3.0").
        let count = |key| value(key).and_then(|text| text.strip_suffix(".0").unwrap_or(text).parse::<u64>().ok());
        let number = |key| value(key).and_then(|text| text.parse::<f64>().ok()).filter(|number| number.is_finite());
        // Calibration function 0 is a straight line: value = c0 + c1 * sample.
        let scaling = match (count("cf"), number("c0"), number("c1"), value("c2")) {
            (Some(0), Some(intercept), Some(slope), None) if slope != 0.0 => (slope, intercept),
            _ => (1.0, 0.0),
        };
        Some(ImageJ {
            images: count("images").unwrap_or(1).max(1),
            channels: count("channels").unwrap_or(1).max(1),
            frames: count("frames").unwrap_or(1).max(1),
            slices: count("slices").unwrap_or(0),
            unit: value("unit").and_then(unit_name),
            spacing: number("spacing").map(f64::abs).filter(|spacing| *spacing > 0.0).unwrap_or(1.0),
            scaling,
        })
    }

    /// Returns the number of volumes: one for each channel at each time.
    pub(super) fn volumes(&self) -> u64 {
        self.channels.saturating_mul(self.frames)
    }

    /// Returns the pages of volume `volume`, slice by slice; the file at `path` has `count` pages.
    ///
    /// # Errors
    /// [`Error::Format`] if the number of pages is not the product of the numbers of slices, channels and frames.
    pub(super) fn pages(&self, path: &Path, count: u64, volume: u64) -> Result<Vec<u64>> {
        let volumes = self.volumes();
        let slices = if self.slices == 0 { count / volumes } else { self.slices };
        if slices == 0 || slices.checked_mul(volumes) != Some(count) {
            let ImageJ { channels, frames, .. } = self;
            let expected = format!("{slices} slices x {channels} channels x {frames} frames");
            return Err(Error::format(path, 0, "TIFF ImageJ images", expected, format!("{count} pages")));
        }
        check_slices(path, slices)?;
        let (channel, frame) = (volume % self.channels, volume / self.channels);
        Ok((0..slices).map(|slice| (frame * slices + slice) * self.channels + channel).collect())
    }

    /// Returns the position and the spacing of the grid.
    pub(super) fn frame(&self, resolution: &Resolution) -> FileFrame {
        let mut pixel = resolution.pixel();
        if resolution.unit == 3 && self.unit.as_deref() == Some("um") {
            // Some programs write the resolution tags per centimetre, but a description in micrometres.
            pixel = pixel.map(|size| size * 1e4);
        } else if self.unit.is_none() && resolution.is_default() {
            pixel = [1.0, pixel[1] / pixel[0]];
        }
        FileFrame { unit: self.unit.clone(), ..FileFrame::upright([pixel[0], pixel[1], self.spacing]) }
    }

    /// Returns the slope and the intercept that turn samples into values.
    pub(super) fn scaling(&self) -> (f64, f64) {
        self.scaling
    }
}

/// Returns the unit of length that `text` names; `None` if it names none.
fn unit_name(text: &str) -> Option<String> {
    let name = match text {
        "" | "pixel" | "pixels" => return None,
        "micron" | "microns" | "\\u00B5m" | "\\u00b5m" | "\u{b5}m" | "\u{3bc}m" | "micrometer" => "um",
        other => other,
    };
    Some(name.chars().filter(|c| !c.is_control()).take(40).collect())
}
