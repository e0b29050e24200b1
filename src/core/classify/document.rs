//! Transfer functions as JSON documents, and reading them from files.
//!
//! serde refuses wrong syntax, wrong types and unknown fields; its message names line and column. This file refuses
//! fields that belong to another kind of function. [`TransferFunction::checked`] refuses numbers out of range.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::colour::Colour;
use super::kind::{Cap, Contour, FactorPoint, Point, RANGE_OPACITY, TransferKind, range_colours};
use super::palette::{self, Label, UnlistedLabels};
use super::transfer::TransferFunction;
use super::validate::field_error;
use crate::error::{Error, Result};
use crate::limits::{MAX_CONTOURS, MAX_DESCRIPTION_BYTES, MAX_TRANSFER_ENTRIES};
use crate::text::{NO_TEXT, read_text};

impl TransferFunction {
    /// Reads JSON in the format described in [`crate::classify`].
    ///
    /// # Errors
    /// [`Error::Input`] that names line and column, or the field and the numbers that it may hold, or the number of
    /// entries that is too large.
    pub fn from_json(text: &str) -> Result<TransferFunction> {
        let document: TransferDocument =
            serde_json::from_str(text).map_err(|why| Error::input("transfer function", why.to_string()))?;
        document.try_into()
    }

    /// Reads a colour table of 3D Slicer: lines of `index name r g b a`, with components from 0 to 255.
    ///
    /// # Errors
    /// [`Error::Input`] that names the first wrong line.
    pub fn from_ctbl(text: &str) -> Result<TransferFunction> {
        TransferFunction::labels(palette::parse_ctbl(text)?, UnlistedLabels::Transparent)
    }

    /// Reads a file: a colour table if its name ends in `.ctbl`, otherwise JSON.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::Limit`] if it is longer than 16 MiB; [`Error::Input`] that
    /// names the file if its content is wrong.
    pub fn read(path: &std::path::Path) -> Result<TransferFunction> {
        let text = read_text(path, MAX_DESCRIPTION_BYTES).map_err(|error| match error {
            Error::Input { what, why } if why == NO_TEXT => Error::input(
                what,
                format!("{NO_TEXT}, so no transfer function: that is JSON, or a table of labels, NAME.ctbl"),
            ),
            other => other,
        })?;
        TransferFunction::from_text(path, &text)
    }

    /// Reads the contents of such a file.
    ///
    /// # Errors
    /// [`Error::Input`] that names the file if its content is wrong.
    pub fn from_text(path: &std::path::Path, text: &str) -> Result<TransferFunction> {
        let is_table = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ctbl"));
        let parsed = if is_table { TransferFunction::from_ctbl(text) } else { TransferFunction::from_json(text) };
        parsed.map_err(|error| match error {
            Error::Input { what, why } => Error::input(format!("{}: {what}", path.display()), why),
            other => other,
        })
    }

    /// Returns the function of a file with this description, whose grid has this mean spacing; `None` if it has none that can be
    /// read.
    ///
    /// Other members are skipped: as JSON values a long text takes much memory.
    pub(crate) fn of_description(description: &[u8], mean_spacing: f64) -> Option<TransferFunction> {
        #[derive(Deserialize)]
        struct Function {
            transfer_function: TransferFunction,
        }
        let Function { transfer_function } = serde_json::from_slice(description).ok()?;
        // Another writer may have left out the length that is the grid's by default.
        transfer_function.with_voxel_length(mean_spacing).ok()
    }

    /// Returns the function as JSON on several lines; [`TransferFunction::from_json`] restores an equal function.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a checked function holds only finite numbers and strings")
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum KindName {
    Points,
    Contour,
    Range,
    Region,
    Labels,
}

/// The fields of all kinds, as they are read.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with the field \"kind\" and the fields of that kind")]
pub(super) struct TransferDocument {
    kind: KindName,
    #[serde(default, deserialize_with = "entries")]
    points: Option<Vec<Point>>,
    #[serde(default, deserialize_with = "few")]
    gradient: Option<Vec<FactorPoint>>,
    #[serde(default, deserialize_with = "few")]
    contours: Option<Vec<Contour>>,
    voxel_length: Option<f64>,
    cap: Option<Cap>,
    low: Option<f64>,
    high: Option<f64>,
    opacity: Option<f64>,
    #[serde(default, deserialize_with = "entries")]
    colours: Option<Vec<Colour>>,
    value_range: Option<[f64; 2]>,
    #[serde(default, deserialize_with = "entries")]
    knots: Option<Vec<Point>>,
    largest_magnitude: Option<f64>,
    #[serde(default, deserialize_with = "entries")]
    labels: Option<Vec<Label>>,
    others: Option<UnlistedLabels>,
    shaded: Option<bool>,
    reference_length: Option<f64>,
}

fn entries<'de, D: Deserializer<'de>, T: Deserialize<'de>>(source: D) -> Result<Option<Vec<T>>, D::Error> {
    source.deserialize_option(UpTo(MAX_TRANSFER_ENTRIES, PhantomData))
}

fn few<'de, D: Deserializer<'de>, T: Deserialize<'de>>(source: D) -> Result<Option<Vec<T>>, D::Error> {
    source.deserialize_option(UpTo(MAX_CONTOURS, PhantomData))
}

/// Reads null or a list of at most this number of items; a longer one is refused before it takes more memory.
struct UpTo<T>(usize, PhantomData<T>);

impl<'de, T: Deserialize<'de>> Visitor<'de> for UpTo<T> {
    type Value = Option<Vec<T>>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of at most {}", self.0)
    }

    fn visit_unit<E: de::Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_none<E: de::Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_some<D: Deserializer<'de>>(self, source: D) -> Result<Self::Value, D::Error> {
        source.deserialize_seq(self)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut source: A) -> Result<Self::Value, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = source.next_element()? {
            if items.len() == self.0 {
                return Err(de::Error::custom(format_args!("the list has more than {} items; leave some out", self.0)));
            }
            items.push(item);
        }
        Ok(Some(items))
    }
}

impl TransferDocument {
    fn refuse_foreign_fields(&self) -> Result<()> {
        use KindName::{Contour, Labels, Points, Range, Region};
        let fields = [
            ("points", self.points.is_some(), Points),
            ("gradient", self.gradient.is_some(), Points),
            ("contours", self.contours.is_some(), Contour),
            ("voxel_length", self.voxel_length.is_some(), Contour),
            ("cap", self.cap.is_some(), Contour),
            ("low", self.low.is_some(), Range),
            ("high", self.high.is_some(), Range),
            ("opacity", self.opacity.is_some(), Range),
            ("colours", self.colours.is_some(), Range),
            ("value_range", self.value_range.is_some(), Range),
            ("knots", self.knots.is_some(), Region),
            ("largest_magnitude", self.largest_magnitude.is_some(), Region),
            ("labels", self.labels.is_some(), Labels),
            ("others", self.others.is_some(), Labels),
        ];
        match fields.iter().find(|(_, present, owner)| *present && *owner != self.kind) {
            None => Ok(()),
            Some((name, _, owner)) => {
                let [owner, kind] = [*owner, self.kind].map(quoted_name);
                Err(field_error(name, format!("belongs to the kind {owner}, not {kind}; take it out")))
            }
        }
    }
}

/// Returns the kind's name in JSON, with quotes.
fn quoted_name(kind: KindName) -> String {
    serde_json::to_string(&kind).expect("a name is plain JSON")
}

impl TryFrom<TransferDocument> for TransferFunction {
    type Error = Error;

    fn try_from(document: TransferDocument) -> Result<TransferFunction> {
        document.refuse_foreign_fields()?;
        let missing = |field: &str| {
            let why = format!("the kind {} needs the field \"{field}\"", quoted_name(document.kind));
            Error::input("transfer function", why)
        };
        let kind = match document.kind {
            KindName::Points => TransferKind::Points {
                points: document.points.ok_or_else(|| missing("points"))?,
                gradient: document.gradient.unwrap_or_default(),
            },
            KindName::Contour => TransferKind::Contour {
                contours: document.contours.ok_or_else(|| missing("contours"))?,
                voxel_length: document.voxel_length,
                cap: document.cap,
            },
            KindName::Range => TransferKind::Range {
                low: document.low.unwrap_or(f64::NEG_INFINITY),
                high: document.high.unwrap_or(f64::INFINITY),
                opacity: document.opacity.unwrap_or(RANGE_OPACITY),
                colours: document.colours.unwrap_or_else(range_colours),
                value_range: document.value_range,
            },
            KindName::Region => TransferKind::Region {
                knots: document.knots.ok_or_else(|| missing("knots"))?,
                largest_magnitude: document.largest_magnitude,
            },
            KindName::Labels => {
                let mut labels = document.labels.ok_or_else(|| missing("labels"))?;
                labels.sort_unstable_by_key(|label| label.label);
                TransferKind::Labels { labels, others: document.others.unwrap_or_default() }
            }
        };
        let shaded = document.shaded.unwrap_or(true);
        TransferFunction { kind, shaded, reference_length: document.reference_length }.checked()
    }
}
