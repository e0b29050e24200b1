//! Palettes of label maps: a colour, an opacity and a name per label.
//!
//! A value that is not a whole number is no label and therefore transparent.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

use super::colour::Colour;
use crate::error::{Error, Result};
use crate::limits::MAX_TRANSFER_ENTRIES;

/// The appearance of one label of a segmentation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Label {
    /// The label's value in the volume.
    pub label: i64,
    /// Name of the structure.
    pub name: String,
    /// Colour of the structure.
    pub colour: Colour,
    /// Opacity per reference length, from 0 to 1; 1 by default.
    #[serde(default = "opaque")]
    pub opacity: f64,
}

fn opaque() -> f64 {
    1.0
}

/// How to draw labels that a palette does not list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UnlistedLabels {
    /// Unlisted labels are transparent.
    #[default]
    Transparent,
    /// Unlisted labels above 0 are opaque, each in its own colour: [`Colour::distinct`].
    Distinct,
}

/// Label, name and sRGB colour of the tissues in the segmentation of the Lawrence Berkeley laboratory's whole frog.
/// A few stray voxels have labels of 16 and above; they stay transparent. We chose the colours.
pub(super) const FROG: [(i64, &str, [u8; 3]); 15] = [
    (1, "blood", [0xb3, 0x1b, 0x2c]),
    (2, "brain", [0xf2, 0xb8, 0xc0]),
    (3, "duodenum", [0xe0, 0x8e, 0x45]),
    (4, "eye retina", [0x3a, 0x2a, 0x4d]),
    (5, "eye white", [0xf4, 0xf4, 0xee]),
    (6, "heart", [0xd0, 0x2f, 0x3f]),
    (7, "ileum", [0xeb, 0xb1, 0x6c]),
    (8, "kidney", [0x8c, 0x4a, 0x33]),
    (9, "large intestine", [0xc9, 0xa0, 0x5a]),
    (10, "liver", [0x7a, 0x2e, 0x26]),
    (11, "lung", [0xf0, 0x9a, 0xa6]),
    (12, "nerve", [0xf7, 0xe1, 0x5c]),
    (13, "skeleton", [0xee, 0xe3, 0xc8]),
    (14, "spleen", [0x6b, 0x2a, 0x52]),
    (15, "stomach", [0xd9, 0x7f, 0x74]),
];

fn find(labels: &[Label], label: i64) -> Option<&Label> {
    labels.binary_search_by_key(&label, |entry| entry.label).ok().map(|index| &labels[index])
}

/// Returns `value` as a label; `None` if it is not a whole number of at most 2^53.
fn label_of(value: f64) -> Option<i64> {
    #[expect(clippy::cast_possible_truncation, reason = "bounded: whole numbers below 2^53")]
    (value.fract() == 0.0 && value.abs() <= 9_007_199_254_740_992.0).then_some(value as i64)
}

pub(super) fn opacity(labels: &[Label], others: UnlistedLabels, value: f64) -> f64 {
    let Some(label) = label_of(value) else { return 0.0 };
    match find(labels, label) {
        Some(entry) => entry.opacity,
        None => f64::from(others == UnlistedLabels::Distinct && label > 0),
    }
}

/// Returns `value` as a label that the palette does not name, and that is not 0, the background.
pub(super) fn unnamed(labels: &[Label], others: UnlistedLabels, value: f64) -> Option<i64> {
    let is_unnamed = |label: &i64| *label != 0 && find(labels, *label).is_none();
    label_of(value).filter(|label| is_unnamed(label) && opacity(labels, others, *label as f64) == 0.0)
}

/// A value between labels, as a maximum interpolates it, has the colour of the nearest label: of the nearest one that the palette
/// names, if others are transparent.
pub(super) fn colour(labels: &[Label], others: UnlistedLabels, value: f64) -> [f32; 3] {
    // The background, 0, has no colour.
    let value = if others == UnlistedLabels::Distinct { value.max(1.0) } else { value };
    let Some(label) = label_of(value.round()) else { return [0.0; 3] };
    match (others, u64::try_from(label)) {
        (UnlistedLabels::Distinct, Ok(index)) if find(labels, label).is_none() => Colour::distinct(index).linear(),
        _ => nearest(labels, value).map_or([0.0; 3], |entry| entry.colour.linear()),
    }
}

/// Returns the entry whose label is nearest to a value, of two the higher; `None` if there are no entries.
fn nearest(labels: &[Label], value: f64) -> Option<&Label> {
    let above = labels.partition_point(|entry| (entry.label as f64) < value);
    let around = labels.get(above.saturating_sub(1)..labels.len().min(above + 1))?;
    let distance = |entry: &&Label| (entry.label as f64 - value).abs();
    around.iter().rev().min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

pub(super) fn domain(labels: &[Label], others: UnlistedLabels) -> (f64, f64) {
    let visible = labels.iter().filter(|entry| entry.opacity > 0.0).map(|entry| entry.label as f64);
    let (low, high) = visible.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
    match others {
        UnlistedLabels::Transparent => (low, high),
        UnlistedLabels::Distinct => {
            // The lowest label above 0 that is not listed as transparent.
            let hidden = |label: &i64| find(labels, *label).is_some_and(|entry| entry.opacity == 0.0);
            let unlisted = (1..).find(|label| !hidden(label)).expect("a palette is finite");
            (low.min(unlisted as f64), f64::INFINITY)
        }
    }
}

/// Parses a colour table of 3D Slicer: lines of `index name r g b a`, components from 0 to 255; `#` starts a comment.
pub(super) fn parse_ctbl(text: &str) -> Result<Vec<Label>> {
    let (mut labels, mut known) = (Vec::new(), HashSet::new());
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let refused = |why: &str| Error::input(format!("colour table: line {}", index + 1), why);
        let words: Vec<&str> = line.split_whitespace().collect();
        let (label, name, [r, g, b, a]) = match words[..] {
            [label, ref name @ .., r, g, b, a] if !name.is_empty() => (label, name, [r, g, b, a]),
            _ => return Err(refused("has fewer than the six columns \"index name r g b a\"")),
        };
        let label = label.parse().map_err(|_| refused("does not start with a whole number, the label"))?;
        let component =
            |word: &str| word.parse().map_err(|_| refused("must end in r g b a, whole numbers from 0 to 255"));
        let colour = Colour::from_bytes([component(r)?, component(g)?, component(b)?]);
        let opacity = f64::from(component(a)?) / 255.0;
        if !known.insert(label) {
            return Err(refused("repeats a label; keep one"));
        }
        if labels.len() == MAX_TRANSFER_ENTRIES {
            return Err(refused(&format!("is one label too many; a palette has at most {MAX_TRANSFER_ENTRIES}")));
        }
        labels.push(Label { label, name: name.join(" ").replace('_', " "), colour, opacity });
    }
    if labels.is_empty() {
        return Err(Error::input("colour table", "has no labels; each line is \"index name r g b a\""));
    }
    Ok(labels)
}
