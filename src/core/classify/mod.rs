//! Classification: which samples are visible, and their colour and opacity.
//!
//! In: samples in their own unit, gradient magnitudes in units per world length. Out: opacities, colours in linear
//! light, and the codes that a file stores for value, normal and magnitude.
//!
//! # Transfer functions as JSON
//!
//! A transfer function is one JSON object. `kind` selects one of five kinds; fields that are unknown or belong to
//! another kind are refused. Numbers are finite. A colour is sRGB: `"#rrggbb"` or `[r, g, b]` from 0 to 1. Opacities
//! are from 0 to 1, per reference length.
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
//! | `points` | `points`: one or more of `value`, `colour`, `opacity`, ascending; linear in between, constant beyond the ends. Two points of the same value make a step; at that value the more opaque point counts. `gradient` (optional): `magnitude`, `factor`, ascending: a ramp that multiplies the opacity. |
//! | `contour` | `contours`: `value`, `opacity`, `colour` (optional), `width` (optional, 2 voxels), ascending: iso-value surfaces of Levoy 1988. `voxel_length` (optional): the world length of one voxel of width; by default the edge of a cube with the volume of one cell. `cap` (optional, for one contour): `"above"` or `"below"`, the side of the body whose cut at the volume's faces is drawn; by default the surface ends open there. |
//! | `range` | `low`, `high` (inclusive; absent or null for an open end), `opacity` (optional, 0.8), `colours` (optional, at least one): spread evenly from low to high; `value_range` (optional): the value at which the colours of an open end stop. |
//! | `region` | `knots`: at least two of `value`, `colour`, `opacity`, strictly ascending: the region boundary surfaces of Levoy 1988. `largest_magnitude` (optional, 1): the gradient magnitude at which opacity is reached in full. |
//! | `labels` | `labels`: `label`, `name`, `colour`, `opacity` (optional, 1). `others` (optional): how labels above 0 that are not listed look: `"transparent"` (default) or `"distinct"`. |
//!
//! Every kind may have `shaded` (default true) and `reference_length` (default: the edge of a cube with the
//! volume of one cell, [`Grid::mean_spacing`](crate::volume::Grid::mean_spacing): the geometric mean of the spacings, unless
//! the grid is sheared). docs/OPTICS.md defines how opacity and colour follow.
//!
//! A function has at most 65,536 points, knots, colours or labels, at most 64 contours or points of a ramp, and a file of
//! at most 16 MiB: [`crate::limits`].
//!
//! Labels can also be read from a colour table of 3D Slicer: [`TransferFunction::from_ctbl`].
//!
//! Source: M. Levoy, "Display of Surfaces from Volume Data", IEEE CG&A 8(3), 1988, sections 3 and 4.

pub mod colour;
mod document;
mod evaluate;
pub mod gradient;
mod kind;
mod magnitude;
mod missing;
pub mod normal;
mod palette;
mod preset;
mod quantise;
mod smooth;
mod transfer;
mod validate;

pub use colour::Colour;
pub use gradient::Neighbourhood;
pub use kind::{Cap, Contour, FactorPoint, Point};
pub use magnitude::MagnitudeCodec;
pub use palette::{Label, UnlistedLabels};
pub use preset::PRESETS;
pub(crate) use quantise::value_of_code;
pub use quantise::{Quantiser, WholeNumbers};
pub use smooth::Smoother;
pub use transfer::TransferFunction;
