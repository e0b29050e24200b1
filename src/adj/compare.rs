//! `adj compare`: measures how much two pictures differ.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::progress::{catch_interrupts, interrupted};
use super::values::{Background, background};
use super::{Answer, check_output, print_result};
use adjsplat::error::Result;
use adjsplat::file::write_atomically_unless;
use adjsplat_judge::metrics::{HeatMap, Metrics, compare};
use adjsplat_pictures::read_picture;
use adjsplat_pictures::{Picture, PictureKind, SampleDepth};

/// Measure how much two pictures differ: PSNR, SSIM, FLIP, largest and root mean square error
///
/// Exit code 0: done, or within --max-error; 1: they differ more than that; 2: they cannot be compared.
///
/// The column "linear" compares linear, premultiplied red, green, blue and alpha of the pixels that are not empty: those
/// where one of these samples is not 0 in one of the pictures. Over an opaque background no pixel is empty: draw with
/// --background transparent. The column "display" compares sRGB values of the same pixels over the background. So do
/// ssim (of luma, 0.2126 R + 0.7152 G + 0.0722 B of the sRGB values) and flip (at 67 pixels per degree), of all pixels.
/// energy is the sum of all linear samples of B, divided by that of A, minus 1.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj compare right.exr draft.exr\n  adj compare right.png other.png --max-error 0.01 --diff where.png\n  adj compare right.png other.png --metric psnr --max-error 42 --json -"
)]
pub(super) struct Arguments {
    /// The reference picture: .png or .exr
    #[arg(value_name = "A")]
    right: PathBuf,
    /// The picture to measure, of the same size
    #[arg(value_name = "B")]
    other: PathBuf,
    /// Exit with code 1 if the metric is worse than E: above it; for psnr and ssim, below it
    #[arg(long, value_name = "E", allow_hyphen_values = true, value_parser = bound)]
    max_error: Option<f64>,
    /// The metric that --max-error is for
    #[arg(long, value_name = "M", value_enum, default_value_t = Metric::Max, requires = "max_error")]
    metric: Metric,
    /// Write a picture of the absolute differences: black is none, pale yellow the largest
    #[arg(long, value_name = "FILE.png|FILE.exr")]
    diff: Option<PathBuf>,
    /// Write the numbers as JSON to this file; without a file or with -, to stdout in place of the table.
    /// Infinite numbers (PSNR of equal pictures) are null
    #[arg(long, value_name = "FILE.json", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
    /// Colour behind both pictures for the display column: #rrggbb, black or white
    #[arg(long, value_name = "COLOUR", default_value = "white", value_parser = opaque)]
    background: [f32; 3],
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

/// Parses any number but NaN.
fn bound(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|bound: &f64| !bound.is_nan()).ok_or_else(|| "must be a number".into())
}

/// Parses a colour and refuses transparency.
fn opaque(text: &str) -> Result<[f32; 3], String> {
    match background(text)? {
        Background::Colour(colour) => Ok(colour),
        Background::Transparent => Err("is transparent, which no display shows; give a colour".into()),
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let Arguments { right, other, max_error, metric, diff, json, background } = arguments;
    let to_stdout = json.as_deref() == Some(Path::new("-"));
    let json_file = json.as_ref().filter(|_| !to_stdout);
    if let Some(path) = diff {
        check_output("--diff", path, [right, other])?;
    }
    if let Some(path) = json_file {
        check_output("--json", path, [right, other].into_iter().chain(diff))?;
    }
    let kind = diff.as_ref().map(|path| PictureKind::of(path)).transpose()?;
    let (a, b) = (read_picture(right)?, read_picture(other)?);
    let metrics = compare(&a, &b, *background)?;
    let within = max_error.is_none_or(|bound| metric.is_within(&metrics, bound));
    let document = document(&metrics, max_error.map(|_| within));
    catch_interrupts();
    if let Some(path) = json_file {
        write_atomically_unless(&interrupted, path, |out| writeln!(out, "{document:#}"))?;
    }
    let mut report = if to_stdout { format!("{document:#}") } else { table(&metrics) };
    if let (Some(path), Some(kind)) = (diff, kind) {
        let heat = HeatMap::new(&a, &b)?;
        let picture = Picture::new(&heat.frame, kind, SampleDepth::Eight);
        write_atomically_unless(&interrupted, path, |out| picture.write(out))?;
        if !to_stdout {
            report += &format!(
                "\n{}: absolute differences, the largest of a pixel's four linear samples; black is 0, pale yellow {:.3e}",
                path.display(),
                heat.brightest
            );
        }
    }
    if let Some(bound) = max_error.filter(|_| !to_stdout) {
        let name = metric.to_possible_value().expect("no metric is hidden");
        let verdict = if within { "within" } else { "beyond" };
        report += &format!("\n{} {} is {verdict} {bound}", name.get_name(), shown(metric.of(&metrics)));
    }
    print_result(&report);
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

/// Formats a number with four significant digits.
fn shown(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        format!("{number}")
    } else if (0.001..1000.0).contains(&number.abs()) {
        format!("{number:.4}")
    } else {
        format!("{number:.3e}")
    }
}
