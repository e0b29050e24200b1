//! Classification: which samples are visible, and what colour and opacity they have.
//!
//! In: samples in their own units, gradient magnitudes in units per world length. Out: opacities, linear colours,
//! and the codes that a record stores: value, normal, magnitude. The builder asks what is visible and quantises it;
//! a renderer asks for colour and opacity per stored code.
//!
//! # Transfer functions as JSON
//!
//! One object. `kind` says which of five; every other field belongs to some kinds only, and a field that is
//! unknown or belongs to another kind is refused. Numbers are finite. A colour is sRGB, `"#rrggbb"` or
//! `[r, g, b]` from 0 to 1. Opacities are 0 to 1, per reference length.
//!
//! ```
//! let text = r##"{
//!   "kind": "points",
//!   "points": [
//!     { "value": 150, "colour": "#8a5a3c", "opacity": 0 },
//!     { "value": 300, "colour": "#e8d3b0", "opacity": 0.4 },
//!     { "value": 900, "colour": [1.0, 0.98, 0.94], "opacity": 0.9 }
//!   ],
//!   "gradient": [
//!     { "magnitude": 10, "factor": 0.1 },
//!     { "magnitude": 80, "factor": 1 }
//!   ],
//!   "reference_length": 1.0,
//!   "shaded": true
//! }"##;
//! let function = adjsplat::classify::TransferFunction::from_json(text)?;
//! assert_eq!(function.opacity(225.0, 100.0), 0.2);
//! assert!(function.uses_gradient());
//! # Ok::<(), adjsplat::Error>(())
//! ```
//!
//! | kind | its fields |
//! | --- | --- |
//! | `points` | `points`: at least one of `value`, `colour`, `opacity`, by rising value; linear in between, constant beyond the ends. Two points of the same value are a step: at that value the more opaque of the two holds. `gradient` (optional): `magnitude`, `factor`, by rising magnitude, a second such ramp that multiplies the opacity. |
//! | `contour` | `contours`: `value`, `opacity`, `colour` (optional), `width` (optional, 2 voxels), by rising value: iso-value surfaces of Levoy 1988. `voxel_length` (optional): the world length that widths count as a voxel, the geometric mean of the spacings unless given. |
//! | `range` | `low`, `high` (inclusive; absent or null is open), `opacity` (optional, 0.8), `colours` (optional, at least one): spread evenly from low to high; `value_range` (optional): where the colours of an open end stop. |
//! | `region` | `knots`: at least two of `value`, `colour`, `opacity`, by strictly rising value: the region boundary surfaces of Levoy 1988. `largest_magnitude` (optional, 1): the gradient magnitude at which an opacity is reached in full. |
//! | `labels` | `labels`: `label`, `name`, `colour`, `opacity` (optional, 1). `others` (optional): `"transparent"`, the default, or `"distinct"`: what a label above 0 that is not listed is. |
//!
//! Every kind may have `shaded` (true unless given) and `reference_length` (the geometric mean of the spacings
//! unless given).
//!
//! A colour table of 3D Slicer, lines of `index name r g b a`, will do for labels: [`TransferFunction::from_ctbl`].
//!
//! Source: M. Levoy, "Display of Surfaces from Volume Data", IEEE CG&A 8(3), 1988, sections 3 and 4.

pub mod colour;
mod document;
pub mod gradient;
pub mod magnitude;
mod missing;
pub mod normal;
pub mod palette;
mod preset;
pub mod quantise;
pub mod smooth;
mod transfer;

pub use colour::Colour;
pub use gradient::Neighbourhood;
pub use magnitude::MagnitudeCodec;
pub use palette::{Label, Others};
pub use preset::PRESETS;
pub use quantise::Quantiser;
pub use smooth::Smoother;
pub use transfer::{Contour, FactorPoint, Point, TransferFunction};
