//! Built-in transfer functions.
//!
//! CT presets are in Hounsfield units (air -1000, water 0). Many files store values about 1024 higher, with skin from
//! about 500 and bone from about 1150: use `ct-bone+1024`. `mr` fits T1 images of heads in which tissue has the values
//! 100 to 250. `ct-angio` is for scans with a contrast agent in the vessels; without one, it shows the edges of bones as
//! vessels, because there values pass through those of vessels. We chose the values and colours.

use super::colour::Colour;
use super::kind::{Contour, FactorPoint, Point};
use super::palette::{FROG, Label, UnlistedLabels};
use super::transfer::TransferFunction;
use crate::error::{Error, Result};

/// The names that [`TransferFunction::preset`] accepts, each with a description.
pub const PRESETS: [(&str, &str); 7] = [
    ("ct-bone", "bone, in Hounsfield units"),
    ("ct-skin", "skin over bone, in Hounsfield units"),
    ("ct-angio", "vessels that hold a contrast agent, red, and bone, ivory, in Hounsfield units"),
    ("mr", "T1 heads with tissue at 100 to 250"),
    ("labels", "any label map, a distinct colour for each label above 0"),
    ("frog", "the tissues of the whole frog's segmentation"),
    ("gyroid", "both sides of the gyroid phantom"),
];

type Knots = &'static [(f64, [u8; 3], f64)];

const CT_BONE: Knots = &[
    (126.0, [0x7d, 0x3f, 0x2c], 0.0),
    (200.0, [0xb4, 0x78, 0x54], 0.25),
    (400.0, [0xe3, 0xc0, 0x94], 0.65),
    (900.0, [0xf5, 0xe8, 0xd0], 0.9),
    (2000.0, [0xff, 0xfc, 0xf5], 0.95),
];

/// Value, sRGB colour, opacity. Skin is the rise from air to fat; soft tissue down to bone is almost transparent.
const CT_SKIN: Knots = &[
    (-560.0, [0xc9, 0x8a, 0x6b], 0.0),
    (-420.0, [0xe0, 0xa8, 0x88], 0.35),
    (-150.0, [0xeb, 0xb8, 0x98], 0.45),
    (-60.0, [0xd9, 0x96, 0x76], 0.08),
    (80.0, [0xb5, 0x5f, 0x4c], 0.08),
    (300.0, [0xe9, 0xd0, 0xac], 0.7),
    (1200.0, [0xff, 0xf8, 0xea], 0.95),
];

/// Vessels are almost opaque only from 320 up, so that the inside of thin bones shows through their edges.
const CT_ANGIO: Knots = &[
    (120.0, [0x7a, 0x10, 0x18], 0.0),
    (180.0, [0xb8, 0x1f, 0x26], 0.12),
    (320.0, [0xd8, 0x40, 0x2f], 0.7),
    (440.0, [0xee, 0xb8, 0x90], 0.75),
    (620.0, [0xf4, 0xe4, 0xc8], 0.9),
    (2000.0, [0xff, 0xfb, 0xf2], 0.95),
];

const MR: Knots = &[
    (55.0, [0x54, 0x3a, 0x3a], 0.0),
    (100.0, [0x9c, 0x6a, 0x5e], 0.06),
    (150.0, [0xcf, 0x9e, 0x88], 0.3),
    (220.0, [0xee, 0xd8, 0xc2], 0.65),
    (400.0, [0xff, 0xf7, 0xea], 0.9),
];

/// A ramp that makes homogeneous tissue fainter, so that boundaries stand out.
const MR_GRADIENT: [FactorPoint; 2] =
    [FactorPoint { magnitude: 4.0, factor: 0.25 }, FactorPoint { magnitude: 40.0, factor: 1.0 }];

impl TransferFunction {
    /// Returns the built-in function called `name`, one of [`PRESETS`].
    ///
    /// A suffix shifts the values: `"ct-bone+1024"` is `ct-bone` for samples stored 1024 above Hounsfield units.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown name; the message lists all names.
    pub fn preset(name: &str) -> Result<TransferFunction> {
        if let Some(function) = unshifted(name) {
            return function;
        }
        let refused = || {
            let names: Vec<&str> = PRESETS.iter().map(|(name, _)| *name).collect();
            Error::input(format!("preset \"{name}\""), format!("is not one of {}", names.join(", ")))
        };
        let (base, offset) = name.split_at(name.rfind(['+', '-']).ok_or_else(refused)?);
        let offset: f64 = offset.parse().map_err(|_| refused())?;
        unshifted(base).ok_or_else(refused)??.with_offset(offset)
    }
}

fn unshifted(name: &str) -> Option<Result<TransferFunction>> {
    let linear = |knots: Knots, gradient: &[FactorPoint]| {
        let point =
            |&(value, rgb, opacity): &(f64, [u8; 3], f64)| Point { value, colour: Colour::from_bytes(rgb), opacity };
        TransferFunction::points(knots.iter().map(point).collect(), gradient.to_vec())
    };
    Some(match name {
        "ct-bone" => linear(CT_BONE, &[]),
        "ct-skin" => linear(CT_SKIN, &[]),
        "ct-angio" => linear(CT_ANGIO, &[]),
        "mr" => linear(MR, &MR_GRADIENT),
        "labels" => TransferFunction::labels(Vec::new(), UnlistedLabels::Distinct),
        "frog" => {
            let labels = FROG.map(|(label, name, rgb)| Label {
                label,
                name: name.to_owned(),
                colour: Colour::from_bytes(rgb),
                opacity: 1.0,
            });
            TransferFunction::labels(labels.into(), UnlistedLabels::Transparent)
        }
        "gyroid" => {
            let side = |value, rgb| Contour { value, opacity: 0.95, width: 1.5, colour: Colour::from_bytes(rgb) };
            TransferFunction::contours(vec![side(104.0, [0x2f, 0x7f, 0x9e]), side(152.0, [0xef, 0xc2, 0x7b])])
        }
        _ => return None,
    })
}
