//! The five kinds of transfer function and the knots that define them.

use serde::{Deserialize, Serialize};

use super::colour::Colour;
use super::palette::{Label, UnlistedLabels};

/// Default opacity of a range, per reference length: it looks solid within a few voxels and has soft edges.
pub(super) const RANGE_OPACITY: f64 = 0.8;
/// Default colours of a range: from brown marrow to ivory bone.
const RANGE_COLOURS: [[u8; 3]; 4] = [[0xb8, 0x80, 0x5c], [0xdd, 0xb8, 0x90], [0xf1, 0xe2, 0xc8], [0xff, 0xf9, 0xee]];

/// Returns the default transition width of a contour, in voxels (Levoy's figures use 2).
pub(super) fn contour_width() -> f64 {
    2.0
}

pub(super) fn contour_colour() -> Colour {
    Colour::from_bytes([0xef, 0xe2, 0xcc])
}

pub(super) fn range_colours() -> Vec<Colour> {
    RANGE_COLOURS.map(Colour::from_bytes).to_vec()
}

/// A control point of a piecewise-linear transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Sample value, in the samples' own unit; finite.
    pub value: f64,
    /// Colour at this value.
    pub colour: Colour,
    /// Opacity per reference length, from 0 to 1.
    pub opacity: f64,
}

/// A control point of the ramp that multiplies opacity by a factor that depends on the gradient magnitude.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FactorPoint {
    /// Gradient magnitude in units per world length; finite, 0 or above.
    pub magnitude: f64,
    /// Number by which the opacity is multiplied, from 0 to 1.
    pub factor: f64,
}

/// An iso-value surface with a soft transition.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contour {
    /// The iso-value, in the samples' own unit; finite.
    pub value: f64,
    /// Opacity on the surface per reference length, from 0 to 1.
    pub opacity: f64,
    /// Half the thickness of the transition, in voxels; finite, 0 or above.
    #[serde(default = "contour_width")]
    pub width: f64,
    /// Colour of the surface.
    #[serde(default = "contour_colour")]
    pub colour: Colour,
}

/// The body, of higher or of lower values, whose cut at the volume's faces closes an iso-value surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cap {
    /// The body has values above the iso-value.
    Above,
    /// The body has values below the iso-value, as lungs and airways in CT.
    Below,
}

/// Returns whether an end of a range is left out in JSON.
fn is_open(end: &f64) -> bool {
    end.is_infinite()
}

/// The parameters of a transfer function, by kind; `document.rs` reads them, `validate.rs` checks them.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub(super) enum TransferKind {
    Points {
        points: Vec<Point>,
        #[serde(skip_serializing_if = "Vec::is_empty")]
        gradient: Vec<FactorPoint>,
    },
    Contour {
        contours: Vec<Contour>,
        #[serde(skip_serializing_if = "Option::is_none")]
        voxel_length: Option<f64>,
        #[serde(skip_serializing_if = "Option::is_none")]
        cap: Option<Cap>,
    },
    /// Values from `low` to `high` are visible; an open end is infinite.
    Range {
        #[serde(skip_serializing_if = "is_open")]
        low: f64,
        #[serde(skip_serializing_if = "is_open")]
        high: f64,
        opacity: f64,
        colours: Vec<Colour>,
        #[serde(skip_serializing_if = "Option::is_none")]
        value_range: Option<[f64; 2]>,
    },
    Region {
        knots: Vec<Point>,
        #[serde(skip_serializing_if = "Option::is_none")]
        largest_magnitude: Option<f64>,
    },
    /// A palette; its `labels` are sorted by label.
    Labels { labels: Vec<Label>, others: UnlistedLabels },
}
