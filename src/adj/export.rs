//! `adj export`: writes the voxels of an `.adj` file for other tools.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::classification::ClassificationArguments;
use super::info::open_adj;
use super::progress::Progress;
use super::stored::missing_values;
use super::{Answer, check_apart, print_line, print_note, print_result};
use adjsplat::error::Result;
use adjsplat::internals::drawable;
use adjsplat_export::{ExportFormat, ExportOptions, ExportReport, export};

/// Write the voxels of an .adj file for other tools: a dense volume, a table, a sparse grid, or 3-D Gaussians
///
/// The ending of the output chooses the format. All formats lose the voxels that the build left out. Memory holds about
/// one slice of the grid. The input is checked first, as by adj verify.
#[derive(Debug, Args)]
#[command(after_help = FORMATS)]
pub(super) struct Arguments {
    /// The .adj file
    #[arg(value_name = "IN.adj")]
    input: PathBuf,
    /// The file to write, or the folder for .zarr, which must not exist yet
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// Sample of the points that are not visible, in dense formats. By default the first of these that no exported voxel
    /// has and that is not visible: 0, the lowest sample of the volume, the lowest and the highest number of the type
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    fill: Option<f64>,
    /// Do not check the input first: faster, but damage may pass into the output
    #[arg(long)]
    no_verify: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    /// Show no progress bar
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    classification: ClassificationArguments,
}

/// What each format keeps and loses.
const FORMATS: &str = "\
Formats:
  ending        what it holds                          what it loses
  .nrrd         dense volume, gzip                     normals, which points are visible
  .nii .nii.gz  dense volume, NIfTI-1 or -2            the same; place in f32 (NIfTI-1)
  .mha          dense volume, not packed               the same as .nrrd
  .vti          dense volume, not packed               the same; the unit of lengths
  .raw          samples only                           the same; size, type and place
  .npz          NumPy: values (z, y, x), spacing,      the same as .nrrd; the unit of lengths
                origin, direction
  .zarr         dense volume, OME-Zarr 0.4, chunks     the same as .nrrd; directions are only in
                                                       its nifti-zarr header
  .csv          a line a voxel: indices, place,        the grid, the transfer function
                value, normal, gradient
  .vdb          OpenVDB, sparse, single precision      normals; whole numbers above 2^24
  .ply          3-D Gaussians with harmonics of        values; shading is a straight line of the
                degree 1 (light at the eye)            cosine, highlights are left out
  .spz          the same in 8 bits a number            the same; sizes to 3 %; at most 10 million

In dense formats samples have the source's type where that is exact, also of label maps; else they are rounded to f32.
World axes are R, A, S, or L, P, S in .mha. Details: docs/export.md

Examples:
  adj export head.adj -o head.nii.gz
  adj export ct.adj -o bone.mha --range 300.. --fill -1000
  adj export frog.adj -o frog.ply";

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let start = Instant::now();
    let (input, output) = (&arguments.input, &arguments.output);
    ExportFormat::of(output)?;
    let file = open_adj(input)?;
    check_apart("--output", output, [input.clone()].into_iter().chain(arguments.classification.files()))?;
    let arena = file.arena()?;
    if !arguments.no_verify {
        file.check()?;
    }
    let transfer = arguments.classification.transfer(input)?;
    if let Some(transfer) = &transfer
        && let Some(values) = missing_values(&arena, &drawable(&arena, transfer.clone())?)?
    {
        print_note(&format!(
            "note: values {values} are visible under this transfer function, but the file does not store all of them; \
             build it again with this function"
        ));
    }
    let options = ExportOptions::default().with_transfer(transfer).with_fill(arguments.fill);
    let mut progress = Progress::new(arguments.quiet);
    let report = export(&arena, output, &options, &mut |done, total| progress.show("export", done, total))?;
    drop(progress);
    report.notes.iter().for_each(|note| print_note(note));
    print_report(arguments, &report, start.elapsed().as_secs_f64());
    Ok(Answer::Yes)
}

fn print_report(arguments: &Arguments, report: &ExportReport, seconds: f64) {
    let path = arguments.output.display();
    let ExportReport { voxels, bytes, sample_type, fill, rounding, .. } = *report;
    let type_name = sample_type.map(|sample_type| sample_type.name());
    // JSON has no NaN.
    let fill_text = fill.map(|fill| fill.to_string());
    if arguments.json {
        let fill = fill.and_then(serde_json::Number::from_f64).map_or(json!(fill_text), |fill| json!(fill));
        let answer = json!({
            "output": path.to_string(),
            "voxels": voxels,
            "bytes_total": bytes,
            "sample_type": type_name,
            "fill": fill,
            "rounding": rounding,
            "seconds": seconds,
        });
        print_result(&answer.to_string());
        return;
    }
    let count = if voxels == 1 { "1 voxel".to_owned() } else { format!("{voxels} voxels") };
    let samples = type_name.map_or(String::new(), |name| {
        let exact = if rounding == 0.0 { "exact".to_owned() } else { format!("rounded by up to {rounding:.1e}") };
        format!(" of {name} ({exact})")
    });
    let elsewhere = fill_text.map_or(String::new(), |fill| format!(", {fill} elsewhere"));
    let bytes = indicatif::HumanBytes(bytes);
    print_line(&format!("{path}: {count}{samples}{elsewhere}; {bytes}, {seconds:.2} s"));
}
