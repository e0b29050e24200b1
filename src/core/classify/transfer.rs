//! Transfer functions: the mapping from sample value and gradient magnitude to opacity and colour.
//!
//! This file holds the type and its constructors; `evaluate.rs` computes opacity and colour, `document.rs` reads
//! JSON. The five kinds are described in [`crate::classify`].

use serde::{Deserialize, Serialize};

use super::document::TransferDocument;
use super::kind::{
    Cap, Contour, FactorPoint, Point, RANGE_OPACITY, TransferKind, contour_colour, contour_width, range_colours,
};
use super::palette::{Label, UnlistedLabels};
use super::validate::check_length;
use crate::error::{Error, Result};

const CONTOUR_OPACITY: f64 = 0.9;

/// A transfer function: maps a sample's value and gradient magnitude to opacity and colour.
///
/// Every value of this type is valid, because constructors check all numbers. It is read from and written as JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "TransferDocument")]
pub struct TransferFunction {
    #[serde(flatten)]
    pub(super) kind: TransferKind,
    pub(super) shaded: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) reference_length: Option<f64>,
}

impl TransferFunction {
    fn of(kind: TransferKind) -> Result<TransferFunction> {
        TransferFunction { kind, shaded: true, reference_length: None }.checked()
    }

    pub(super) fn checked(self) -> Result<TransferFunction> {
        self.kind.check()?;
        self.reference_length.map_or(Ok(()), |length| check_length("reference_length", length, false))?;
        Ok(self)
    }

    /// Creates a function that shows exactly the samples with `low <= value <= high`; either end may be infinite.
    ///
    /// The opacity is 0.8; colours run from brown at `low` to ivory at `high`. For an infinite end the colours need the
    /// data's range: [`TransferFunction::with_value_range`].
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if an end is NaN or infinite on the wrong side, or if `low > high`.
    pub fn range(low: f64, high: f64) -> Result<TransferFunction> {
        let colours = range_colours();
        TransferFunction::of(TransferKind::Range { low, high, opacity: RANGE_OPACITY, colours, value_range: None })
    }

    /// Creates a function that shows an ivory surface of value `iso`, with opacity 0.9 and a transition of two voxels.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if `iso` is not finite.
    pub fn contour(iso: f64) -> Result<TransferFunction> {
        let contour =
            Contour { value: iso, opacity: CONTOUR_OPACITY, width: contour_width(), colour: contour_colour() };
        TransferFunction::contours(vec![contour])
    }

    /// Creates a function that shows several iso-value surfaces; `contours` must be sorted by value.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a number is out of range or the values do not ascend.
    pub fn contours(contours: Vec<Contour>) -> Result<TransferFunction> {
        TransferFunction::of(TransferKind::Contour { contours, voxel_length: None, cap: None })
    }

    /// Creates a piecewise-linear function. Unless `gradient` is empty, the opacity is multiplied by that ramp.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a number is out of range or the points do not ascend.
    pub fn points(points: Vec<Point>, gradient: Vec<FactorPoint>) -> Result<TransferFunction> {
        TransferFunction::of(TransferKind::Points { points, gradient })
    }

    /// Creates a function that shows the boundaries of regions of similar value; `knots` must be sorted by value.
    ///
    /// `largest_magnitude` is the gradient magnitude, in units per world length, at which opacity is reached in full.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a number is out of range or the knots do not ascend.
    pub fn region(knots: Vec<Point>, largest_magnitude: f64) -> Result<TransferFunction> {
        TransferFunction::of(TransferKind::Region { knots, largest_magnitude: Some(largest_magnitude) })
    }

    /// Creates the palette of a label map. `labels` may come in any order.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a label occurs twice or an opacity is not from 0 to 1.
    pub fn labels(mut labels: Vec<Label>, others: UnlistedLabels) -> Result<TransferFunction> {
        labels.sort_unstable_by_key(|label| label.label);
        TransferFunction::of(TransferKind::Labels { labels, others })
    }

    /// Returns the function with lighting switched on or off.
    pub fn with_shaded(mut self, shaded: bool) -> TransferFunction {
        self.shaded = shaded;
        self
    }

    /// Sets the reference length that opacities refer to: `length`, a world length.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if `length` is not finite and above 0.
    pub fn with_reference_length(mut self, length: f64) -> Result<TransferFunction> {
        self.reference_length = Some(length);
        self.checked()
    }

    /// Sets the data's `lowest` and `highest` value, where the colours of a range function's open ends stop, unless they are set
    /// already.
    ///
    /// Functions of other kinds, and ranges with two finite ends, look the same as before.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if an end is not finite or `lowest > highest`.
    pub fn with_value_range(mut self, lowest: f64, highest: f64) -> Result<TransferFunction> {
        if let TransferKind::Range { value_range, .. } = &mut self.kind {
            value_range.get_or_insert([lowest, highest]);
        }
        self.checked()
    }

    /// Sets the world length that counts as one voxel in the widths of a contour function, unless it is set already.
    ///
    /// A build passes [`Grid::mean_spacing`](crate::volume::Grid::mean_spacing). The default is 1. Other kinds stay as they are.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if `length` is not finite and above 0.
    pub fn with_voxel_length(mut self, length: f64) -> Result<TransferFunction> {
        if let TransferKind::Contour { voxel_length, .. } = &mut self.kind {
            voxel_length.get_or_insert(length);
        }
        self.checked()
    }

    /// Closes a contour function's surface at the volume's faces: a build then stores the cut of the body on this side.
    ///
    /// Files that are built already keep the faces that they have: drawing them with another function does not close or
    /// open them.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if this is no function of one contour with a width above 0.
    pub fn with_cap(mut self, side: Cap) -> Result<TransferFunction> {
        let TransferKind::Contour { cap, .. } = &mut self.kind else {
            let why = "closes the surface of an iso-value, which this function does not show; other functions show the cut \
                       of bodies by themselves";
            return Err(Error::input("cap", why));
        };
        *cap = Some(side);
        self.checked()
    }

    /// Returns the side set by [`TransferFunction::with_cap`].
    pub fn cap(&self) -> Option<Cap> {
        match self.kind {
            TransferKind::Contour { cap, .. } => cap,
            _ => None,
        }
    }

    /// Sets the gradient magnitude at which a region function reaches full opacity, unless it is set already.
    ///
    /// A build passes an upper bound of the data's gradient magnitudes. The default is 1. Other kinds stay as they are.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if `magnitude` is not finite and above 0.
    pub fn with_largest_magnitude(mut self, magnitude: f64) -> Result<TransferFunction> {
        if let TransferKind::Region { largest_magnitude, .. } = &mut self.kind {
            largest_magnitude.get_or_insert(magnitude);
        }
        self.checked()
    }

    /// Shifts the function to samples whose values are all higher by `offset`; labels stay as they are.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a value is no longer finite or two knots coincide.
    pub fn with_offset(mut self, offset: f64) -> Result<TransferFunction> {
        match &mut self.kind {
            TransferKind::Points { points: knots, .. } | TransferKind::Region { knots, .. } => {
                knots.iter_mut().for_each(|knot| knot.value += offset);
            }
            TransferKind::Contour { contours, .. } => contours.iter_mut().for_each(|contour| contour.value += offset),
            TransferKind::Range { low, high, value_range, .. } => {
                [low, high].into_iter().chain(value_range.iter_mut().flatten()).for_each(|end| *end += offset);
            }
            TransferKind::Labels { .. } => {}
        }
        self.checked()
    }

    /// Returns whether opacity depends on the gradient magnitude.
    pub fn uses_gradient(&self) -> bool {
        match &self.kind {
            TransferKind::Points { gradient, .. } => gradient.iter().any(|point| point.factor != 1.0),
            TransferKind::Contour { contours, .. } => contours.iter().any(|contour| contour.width > 0.0),
            TransferKind::Region { .. } => true,
            TransferKind::Range { .. } | TransferKind::Labels { .. } => false,
        }
    }

    /// Returns whether this is a range function with an open end, and without a [`TransferFunction::value_range`].
    pub(crate) fn lacks_value_range(&self) -> bool {
        matches!(self.kind, TransferKind::Range { low, high, value_range: None, .. } if low.is_infinite() || high.is_infinite())
    }

    /// Returns the data's lowest and highest value, if this is a range function and they were set by
    /// [`TransferFunction::with_value_range`].
    pub fn value_range(&self) -> Option<[f64; 2]> {
        match self.kind {
            TransferKind::Range { value_range, .. } => value_range,
            _ => None,
        }
    }

    /// Returns whether this is the palette of a label map.
    pub fn is_labels(&self) -> bool {
        matches!(self.kind, TransferKind::Labels { .. })
    }

    /// Returns whether some of what is visible lets most light through: an opacity above 0 and below 0.5 is given for a
    /// value, a material or a label.
    pub fn is_translucent(&self) -> bool {
        let faint = |opacity: f64| opacity > 0.0 && opacity < 0.5;
        match &self.kind {
            TransferKind::Points { points, .. } | TransferKind::Region { knots: points, .. } => {
                points.iter().any(|point| faint(point.opacity))
            }
            TransferKind::Range { opacity, .. } => faint(*opacity),
            TransferKind::Labels { labels, .. } => labels.iter().any(|label| faint(label.opacity)),
            TransferKind::Contour { .. } => false,
        }
    }

    /// Returns whether surfaces are lit; every visible voxel then needs a normal.
    pub fn shaded(&self) -> bool {
        self.shaded
    }

    /// Returns the world length that opacities refer to; `None` stands for
    /// [`Grid::mean_spacing`](crate::volume::Grid::mean_spacing).
    pub fn reference_length(&self) -> Option<f64> {
        self.reference_length
    }
}
