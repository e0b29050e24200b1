//! The flags that say what is visible.

use std::path::{Path, PathBuf};

use clap::Args;

use super::input::phantom;
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};

/// What is visible, and what it looks like; one of these.
#[derive(Debug, Args)]
#[command(next_help_heading = "What is visible (one of)")]
#[group(multiple = false)]
pub(super) struct ClassificationArguments {
    /// Transfer function: a JSON file, or a preset: ct-bone, ct-skin, ct-angio, mr (ct-bone+1024 shifts it).
    #[arg(long, value_name = "FILE|PRESET")]
    pub(super) tf: Option<String>,
    /// Surface of this value (Levoy's contour, two voxels wide).
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true)]
    iso: Option<f64>,
    /// Exactly the samples from A to B: 60..200, 60.. or ..200.
    #[arg(long, value_name = "A..B", allow_hyphen_values = true)]
    range: Option<String>,
    /// Region boundaries (Levoy) between values, each with its opacity: 0:0,1150:0.2,2000:0.8.
    #[arg(long, value_name = "V:O,V:O", allow_hyphen_values = true)]
    levoy: Option<String>,
    /// A label map with this palette: a JSON or .ctbl file, or: distinct, frog.
    #[arg(long, value_name = "FILE|PALETTE")]
    labels: Option<String>,
}

impl ClassificationArguments {
    /// The transfer function that the flags name; that of a phantom if they name none; `None` if there is neither.
    ///
    /// # Errors
    /// [`Error::Input`] for a value that cannot be used; what reading its file gives.
    pub(super) fn transfer(&self, input: &Path) -> Result<Option<TransferFunction>> {
        if let Some(name) = &self.tf {
            return named(name).map(Some);
        }
        if let Some(iso) = self.iso {
            return TransferFunction::contour(iso).map(Some);
        }
        if let Some(range) = &self.range {
            let (low, high) = parse_range(range)?;
            return TransferFunction::range(low, high).map(Some);
        }
        if let Some(knots) = &self.levoy {
            return region(knots).map(Some);
        }
        if let Some(name) = &self.labels {
            let name = if name == "distinct" { "labels" } else { name };
            let transfer = named(name)?;
            if !transfer.is_labels() {
                return Err(Error::input("--labels", format!("{name} is no palette; give it with --tf")));
            }
            return Ok(Some(transfer));
        }
        let Some(phantom) = phantom(input)? else { return Ok(None) };
        let (low, high) = phantom.visible_range();
        TransferFunction::range(low, high).map(Some)
    }

    /// As [`Self::transfer`], where there must be one.
    ///
    /// # Errors
    /// Likewise; and [`Error::Input`] if no flag is given.
    pub(super) fn required(&self, input: &Path) -> Result<TransferFunction> {
        self.transfer(input)?.ok_or_else(|| {
            let why = "say it with --range, --iso, --tf, --levoy or --labels; adj info shows the values of a volume";
            Error::input("what is visible", why)
        })
    }
}

/// A file, if there is one of that name; else a preset.
fn named(name: &str) -> Result<TransferFunction> {
    let path = PathBuf::from(name);
    if path.exists() || path.extension().is_some_and(|e| e == "json" || e == "ctbl") {
        return TransferFunction::read(&path);
    }
    TransferFunction::preset(name)
}

/// `60..200`, `60..`, `..200`.
fn parse_range(text: &str) -> Result<(f64, f64)> {
    let why = || Error::input("--range", format!("is \"{text}\", but must look like 60..200, 60.. or ..200"));
    let (low, high) = text.split_once("..").ok_or_else(why)?;
    let end = |part: &str, open: f64| match part.trim() {
        "" => Ok(open),
        number => number.parse::<f64>().ok().filter(|n| n.is_finite()).ok_or_else(why),
    };
    Ok((end(low, f64::NEG_INFINITY)?, end(high, f64::INFINITY)?))
}

/// Knots with the colours of a range: brown at the lowest, ivory at the highest.
fn region(text: &str) -> Result<TransferFunction> {
    let why = || Error::input("--levoy", format!("is \"{text}\", but must look like 0:0,1150:0.2,2000:0.8"));
    let mut knots = Vec::new();
    for part in text.split(',') {
        let (value, opacity) = part.split_once(':').ok_or_else(why)?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| why());
        knots.push((number(value)?, number(opacity)?));
    }
    let (Some(first), Some(last)) = (knots.first(), knots.last()) else { return Err(why()) };
    let colours = TransferFunction::range(first.0.min(last.0), last.0.max(first.0))?;
    let knots: Vec<serde_json::Value> = knots
        .iter()
        .map(|&(value, opacity)| {
            let colour = colours.colour(value).map(|c| adjsplat::classify::colour::srgb_from_linear(c.into()));
            serde_json::json!({ "value": value, "colour": colour, "opacity": opacity })
        })
        .collect();
    TransferFunction::from_json(&serde_json::json!({ "kind": "region", "knots": knots }).to_string())
}
