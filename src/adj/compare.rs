//! `adj compare`: how far two pictures are apart.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::picture::{Depth, Picture, PictureKind};
use super::progress::interrupted;
use super::read_picture::read_picture;
use super::render::parse_background;
use super::{Answer, is_same_file, print_result};
use adjsplat::error::{Error, Result};
use adjsplat::file::{check_writable, write_atomically_unless};
use adjsplat_judge::metrics::{HeatMap, Metrics, compare};

/// Say how far a picture is from another: PSNR, SSIM, FLIP, largest and root mean square error.
///
/// Exit code 0: done, or within --max-error; 1: farther apart than that; 2: they cannot be compared.
///
/// psnr, rmse and max_abs are of linear premultiplied red, green, blue and alpha, over the pixels where a picture is not
/// empty; the display ones of sRGB values over the background. ssim and flip are of what a display shows, too; flip
/// at 67 pixels a degree.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj compare right.exr draft.exr\n  adj compare right.png other.png --max-error 0.01 --diff where.png\n  adj compare right.png other.png --metric psnr --max-error 42 --json -"
)]
pub(super) struct Arguments {
    /// The picture that is right: .png or .exr.
    #[arg(value_name = "A")]
    right: PathBuf,
    /// The one that is judged, of the same size.
    #[arg(value_name = "B")]
    other: PathBuf,
    /// Answer no, with exit code 1, if the metric is beyond this: above it, for psnr and ssim below it.
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    max_error: Option<f64>,
    /// What --max-error bounds.
    #[arg(long, value_name = "M", value_enum, default_value_t = Metric::Max)]
    metric: Metric,
    /// Write a picture of absolute differences: black for none, pale yellow for the largest.
    #[arg(long, value_name = "FILE.png|FILE.exr")]
    diff: Option<PathBuf>,
    /// Write the numbers as JSON to this file, or to stdout instead of the table if it is - or left out. Infinite
    /// ones, as the PSNR of equal pictures, are null.
    #[arg(long, value_name = "FILE.json", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
    /// Colour behind both for what a display shows: #rrggbb, black or white.
    #[arg(long, value_name = "COLOUR", default_value = "white")]
    background: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Metric {
    Max,
    Rmse,
    Psnr,
    Ssim,
    Flip,
}

impl Metric {
    fn of(self, metrics: &Metrics) -> f64 {
        match self {
            Metric::Max => metrics.max_abs,
            Metric::Rmse => metrics.rmse,
            Metric::Psnr => metrics.psnr,
            Metric::Ssim => metrics.ssim,
            Metric::Flip => metrics.flip,
        }
    }

    fn is_within(self, metrics: &Metrics, bound: f64) -> bool {
        match self {
            Metric::Max | Metric::Rmse | Metric::Flip => self.of(metrics) <= bound,
            Metric::Psnr | Metric::Ssim => self.of(metrics) >= bound,
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let Arguments { right, other, max_error, metric, diff, json, background } = arguments;
    if let Some(bound) = max_error.filter(|bound| bound.is_nan()) {
        return Err(Error::input("--max-error", format!("is {bound}, but must be a number")));
    }
    let background = parse_background(background)?
        .ok_or_else(|| Error::input("--background", "is transparent, which no display shows; give a colour"))?;
    let to_stdout = json.as_deref() == Some(Path::new("-"));
    let json_file = json.as_ref().filter(|_| !to_stdout);
    for (flag, path) in [("--diff", diff.as_ref()), ("--json", json_file)] {
        let Some(path) = path else { continue };
        if is_same_file(path, right) || is_same_file(path, other) {
            return Err(Error::input(flag, "is one of the pictures, which it would replace; give another name"));
        }
        check_writable(path)?;
    }
    let kind = diff.as_ref().map(|path| PictureKind::of(path)).transpose()?;
    let (a, b) = (read_picture(right)?, read_picture(other)?);
    let metrics = compare(&a, &b, background)?;
    let within = max_error.is_none_or(|bound| metric.is_within(&metrics, bound));
    let document = document(&metrics, max_error.map(|_| within));
    if let Some(path) = json_file {
        write_atomically_unless(&interrupted, path, |out| writeln!(out, "{document:#}"))?;
    }
    let mut told = if to_stdout { format!("{document:#}") } else { table(&metrics) };
    if let (Some(path), Some(kind)) = (diff, kind) {
        let heat = HeatMap::new(&a, &b)?;
        let picture = Picture::new(&heat.frame, kind, Depth::Eight);
        write_atomically_unless(&interrupted, path, |out| picture.write(out))?;
        if !to_stdout {
            told += &format!(
                "\n{}: absolute differences, the largest of a pixel's four linear samples; black is 0, pale yellow {:.3e}",
                path.display(),
                heat.brightest
            );
        }
    }
    if let Some(bound) = max_error.filter(|_| !to_stdout) {
        let name = metric.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
        let verdict = if within { "within" } else { "beyond" };
        told += &format!("\n{name} {} is {verdict} {bound}", shown(metric.of(&metrics)));
    }
    print_result(&told);
    Ok(if within { Answer::Yes } else { Answer::No })
}

fn document(metrics: &Metrics, within: Option<bool>) -> Value {
    let Metrics { psnr, ssim, flip, max_abs, max_at, rmse, energy, display } = metrics;
    let mut document = json!({
        "psnr": psnr, "ssim": ssim, "flip": flip, "max_abs": max_abs, "rmse": rmse,
        "max_at": max_at, "energy": energy,
        "display": { "psnr": display.psnr, "max_abs": display.max_abs, "rmse": display.rmse },
    });
    if let Some(within) = within {
        document["within"] = json!(within);
    }
    document
}

fn table(metrics: &Metrics) -> String {
    let Metrics { psnr, ssim, flip, max_abs, max_at, rmse, energy, display } = metrics;
    let line =
        |name: &str, linear: f64, shown_as: f64| format!("{name:<8} {:>12} {:>12}", shown(linear), shown(shown_as));
    [
        format!("{:<8} {:>12} {:>12}", "", "linear", "display"),
        line("psnr", *psnr, display.psnr),
        line("rmse", *rmse, display.rmse),
        line("max_abs", *max_abs, display.max_abs) + &format!("   linear at column {}, row {}", max_at[0], max_at[1]),
        format!("{:<8} {:>12}", "energy", format!("{:+.4} %", 100.0 * energy)),
        format!("{:<8} {:>12} {:>12}", "ssim", "", format!("{ssim:.6}")),
        format!("{:<8} {:>12} {:>12}", "flip", "", format!("{flip:.6}")),
    ]
    .join("\n")
}

/// Decibels and small numbers alike: four digits that count.
fn shown(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        format!("{number}")
    } else if (0.001..1000.0).contains(&number.abs()) {
        format!("{number:.4}")
    } else {
        format!("{number:.3e}")
    }
}
