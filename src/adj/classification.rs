//! The flags that say which values are visible.

use std::path::{Path, PathBuf};

use clap::{ArgGroup, Args};

use super::input::phantom;
use super::print_note;
use super::progress::Progress;
use super::values::{choice, library};
use adjsplat::build::{Histogram, SampleSummary, Suggestion};
use adjsplat::classify::colour::srgb_from_linear;
use adjsplat::classify::{Cap, TransferFunction};
use adjsplat::error::{Error, Result};
use adjsplat::volume::SlabSource;
use adjsplat::volume::phantom::Phantom;

/// The flags that say which values are visible, and what they look like; the user gives one of them.
#[derive(Debug, Args)]
#[command(next_help_heading = "What is visible (one of)")]
#[command(group(ArgGroup::new("visible")))]
#[group(skip)]
pub(super) struct ClassificationArguments {
    /// Transfer function: JSON, a file of it, or a preset: ct-bone, ct-skin, ct-angio (vessels that hold a contrast agent;
    /// without one, edges of bones look like vessels), mr (T1 heads), gyroid (for phantom:gyroid), labels or frog.
    /// ct-bone+1024 shifts the preset's values by 1024. The JSON is described in formats/adj-1.md, section 8.1. A file has
    /// at most 65536 points and 16 MiB
    #[arg(long, group = "visible", value_name = "JSON|FILE|PRESET")]
    pub(super) tf: Option<String>,
    /// Surface where the volume has this value, two voxels thick (Levoy's isovalue contour)
    #[arg(long, group = "visible", value_name = "VALUE", allow_hyphen_values = true, value_parser = library(contour))]
    iso: Option<TransferFunction>,
    /// Close the surface of --iso where the volume's faces cut the body of higher values (below: of lower values).
    /// A build decides this: a file keeps its cap
    #[arg(long, value_name = "SIDE", num_args = 0..=1, require_equals = true, default_missing_value = "above")]
    #[arg(value_parser = choice([("above", Cap::Above, ""), ("below", Cap::Below, "")]))]
    cap: Option<Cap>,
    /// Leave the surface of --iso open at the volume's faces (the default)
    #[arg(long, overrides_with = "cap")]
    no_cap: bool,
    /// Voxels with values from A to B, ends included: 60..200, 60.. or ..200
    #[arg(long, group = "visible", value_name = "A..B", allow_hyphen_values = true, value_parser = library(range))]
    range: Option<TransferFunction>,
    /// Boundaries between materials (Levoy): each material's value and opacity (0 to 1): 0:0,1150:0.2,2000:0.8
    #[arg(long, group = "visible", value_name = "V:O,V:O", allow_hyphen_values = true, value_parser = library(region))]
    levoy: Option<TransferFunction>,
    /// Labels of a segmentation, with this palette: a JSON or .ctbl file (at most 65536 labels), distinct, frog, or file:
    /// the colours in the volume's own file (TIFF with a palette, .seg.nrrd)
    #[arg(long, group = "visible", value_name = "FILE|PALETTE")]
    labels: Option<String>,
}

/// The value of `--labels` for the palette in the volume's own file.
const OWN_PALETTE: &str = "file";

impl ClassificationArguments {
    /// Returns the transfer function of the flag that was given, or else that of the phantom `input`; with its cap.
    pub(super) fn transfer(&self, input: &Path) -> Result<Option<TransferFunction>> {
        match self.uncapped(input)? {
            Some(transfer) => self.capped(transfer).map(Some),
            None if self.cap.is_some() => {
                Err(Error::input("--cap", "closes the surface of --iso VALUE; give that too"))
            }
            None => Ok(None),
        }
    }

    /// Applies `--cap` to the transfer function of the other flags.
    fn capped(&self, transfer: TransferFunction) -> Result<TransferFunction> {
        match self.cap {
            Some(cap) => transfer.with_cap(cap),
            None => Ok(transfer),
        }
    }

    /// Returns the files that the flags name.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        [&self.tf, &self.labels].into_iter().flatten().map(PathBuf::from).filter(|path| path.is_file())
    }

    fn uncapped(&self, input: &Path) -> Result<Option<TransferFunction>> {
        if let Some(name) = &self.tf {
            return named(name).map(Some);
        }
        if let Some(transfer) = [&self.iso, &self.range, &self.levoy].into_iter().flatten().next() {
            return Ok(Some(transfer.clone()));
        }
        if let Some(name) = &self.labels {
            if name == OWN_PALETTE {
                let why = "is for volumes; an .adj file shows its own colours without a flag";
                return Err(Error::input("--labels file", why));
            }
            let transfer = named(if name == "distinct" { "labels" } else { name }).map_err(|error| match error {
                Error::Input { what, .. } if what.starts_with("preset") => {
                    Error::input("--labels", format!("{name} is neither a file nor one of distinct, frog and file"))
                }
                other => other,
            })?;
            if !transfer.is_labels() {
                return Err(Error::input("--labels", format!("{name} is no palette; give it with --tf")));
            }
            return Ok(Some(transfer));
        }
        let Some(phantom) = phantom(input)? else { return Ok(None) };
        let (low, high) = phantom.visible_range();
        TransferFunction::range(low, high).map(Some)
    }

    /// Returns what [`Self::transfer`] returns, or else what the file of `source` or its histogram suggests; says which.
    ///
    /// `source` must be at its first slice, and is there again afterwards.
    pub(super) fn chosen(&self, input: &Path, source: &mut dyn SlabSource, quiet: bool) -> Result<TransferFunction> {
        let stated = |source: &dyn SlabSource| {
            let hint =
                |error| Error::input(input.display().to_string(), format!("{error}; try --range or --labels FILE"));
            Suggestion::stated(source).map_err(hint)
        };
        if self.labels.as_deref() == Some(OWN_PALETTE) {
            let Some(Suggestion::StatedLabels(palette)) = stated(source)? else {
                let why = "needs a file with a palette for labels; try --labels distinct";
                return Err(Error::input("--labels file", why));
            };
            return self.capped(palette);
        }
        if let Some(transfer) = self.transfer(input)? {
            return Ok(transfer);
        }
        let (chosen, cause) = match stated(source)? {
            Some(stated) => (stated, "the file says that its values are labels"),
            None => (
                Suggestion::of(&Histogram::of(source, &mut Progress::new(quiet))?)?,
                "what is visible was chosen from the values",
            ),
        };
        print_note(&format!(
            "note: {cause}: {}; adj info shows them, and --range, --iso, --tf, --levoy \
             or --labels choose otherwise",
            flag_of(&chosen)
        ));
        chosen.transfer()
    }

    /// Warns if the preset is in Hounsfield units and `samples` cannot be.
    pub(super) fn warn_of_units(&self, samples: &SampleSummary) {
        let Some(name) = self.tf.as_deref().filter(|name| name.starts_with("ct-")) else { return };
        let shift: f64 = name.split_once('+').and_then(|(_, shift)| shift.parse().ok()).unwrap_or(0.0);
        let (lowest, highest) = (samples.lowest, samples.highest);
        // Every scan holds air or at least fat, and muscle or water.
        if lowest > shift - 50.0 || highest < shift {
            print_note(&format!(
                "warning: {name} is for Hounsfield units{}, but the values run from {lowest} to {highest}; adj info shows \
                 them, and ct-bone+1024 is ct-bone for values that are 1024 higher",
                if shift == 0.0 { String::new() } else { format!(" plus {shift}") }
            ));
        }
    }
}

/// Returns the flag that makes the same choice.
pub(super) fn flag_of(suggestion: &Suggestion) -> String {
    match suggestion {
        Suggestion::Preset(name) => format!("--tf {name}"),
        Suggestion::From(low) => format!("--range {}..", written(*low)),
        Suggestion::StatedLabels(_) => format!("--labels {OWN_PALETTE}"),
        _ => "--labels distinct".to_owned(),
    }
}

/// Returns the flag that shows what a phantom shows without one.
pub(super) fn flag_of_phantom(phantom: &Phantom) -> String {
    let (low, high) = phantom.visible_range();
    format!("--range {}..{}", written(low), written(high))
}

/// Returns a number with an exponent where it would have too many digits.
fn written(number: f64) -> String {
    let text = format!("{number:?}");
    text.strip_suffix(".0").map_or_else(|| text.clone(), str::to_owned)
}

/// Reads the transfer function in the file `name`, or else returns the preset of this name.
fn named(name: &str) -> Result<TransferFunction> {
    if name.trim_start().starts_with('{') {
        return TransferFunction::from_json(name);
    }
    let path = PathBuf::from(name);
    if path.exists() || path.extension().is_some_and(|e| e == "json" || e == "ctbl") {
        return TransferFunction::read(&path);
    }
    TransferFunction::preset(name)
}

fn contour(text: &str) -> Result<TransferFunction> {
    TransferFunction::contour(text.trim().parse().map_err(|_| Error::input("value", "must be a number"))?)
}

/// Parses a range of values, either end of which may be left out: `60..200`, `60..` or `..200`.
fn range(text: &str) -> Result<TransferFunction> {
    let end = |text: &str, open: f64| match text.trim() {
        "" => Some(open),
        number => number.parse().ok().filter(|number: &f64| number.is_finite()),
    };
    let ends = text.split_once("..");
    let ends = ends.and_then(|(low, high)| Some((end(low, f64::NEG_INFINITY)?, end(high, f64::INFINITY)?)));
    let (low, high) = ends.ok_or_else(|| Error::input("range", "must look like 60..200, 60.. or ..200"))?;
    TransferFunction::range(low, high)
}

/// Parses `VALUE:OPACITY,...`; colours run from brown at the lowest value to ivory at the highest.
fn region(text: &str) -> Result<TransferFunction> {
    let knot = |part: &str| {
        let (value, opacity) = part.split_once(':')?;
        let number = |text: &str| text.trim().parse().ok().filter(|number: &f64| number.is_finite());
        Some((number(value)?, number(opacity)?))
    };
    let knots: Option<Vec<(f64, f64)>> = text.split(',').map(knot).collect();
    let knots = knots
        .filter(|knots| knots.len() > 1)
        .ok_or_else(|| Error::input("knots", "must look like 0:0,1150:0.2,2000:0.8"))?;
    let (first, last) = (knots[0].0, knots[knots.len() - 1].0);
    let colours = TransferFunction::range(first.min(last), last.max(first))?;
    let document = |&(value, opacity): &(f64, f64)| {
        let colour = colours.colour(value).map(|colour| srgb_from_linear(colour.into()));
        serde_json::json!({ "value": value, "colour": colour, "opacity": opacity })
    };
    let knots: Vec<_> = knots.iter().map(document).collect();
    TransferFunction::from_json(&serde_json::json!({ "kind": "region", "knots": knots }).to_string())
}
