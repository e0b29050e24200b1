//! `adj build`: from a volume to an `.adj` file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::classification::ClassificationArguments;
use super::input::InputArguments;
use super::progress::Progress;
use super::{Answer, print_result};
use crate::arena::TileOrder;
use crate::arena::builder::{BuildOptions, Built, build};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::file::write_arena;
use crate::volume::{Header, SlabSource};

/// Build an .adj file from a volume: only the visible voxels, in lanes.
///
/// Reads raw, NRRD, MetaImage, NIfTI and VTK legacy files, or phantom:NAME (constant, shells, gyroid,
/// marschner-lobb, hydrogen, vessels, noise, corners).
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj build engine.nii.gz --range 60.. -o engine.adj\n  adj build ct.raw --dims 512x512x300 --type i16le --spacing 0.7x0.7x1 --tf ct-bone -o ct.adj\n  adj build frog.mhd --labels frog -o frog.adj\n  adj build phantom:gyroid --dims 512x512x512 -o gyroid.adj"
)]
pub(super) struct Arguments {
    /// The volume.
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The .adj file to write.
    #[arg(short, long, value_name = "OUT.adj")]
    output: PathBuf,
    #[command(flatten)]
    packing: PackingArguments,
    #[command(flatten)]
    classification: ClassificationArguments,
    #[command(flatten)]
    reading: InputArguments,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    /// No progress bar.
    #[arg(long, short)]
    quiet: bool,
}

/// How the visible voxels are stored.
#[derive(Debug, Args)]
#[command(next_help_heading = "Packing")]
pub(super) struct PackingArguments {
    /// Lanes to store: x is smallest; xyz needs no time on first view.
    #[arg(long, value_name = "LANES", default_value = "xyz", value_parser = ["x", "xy", "xyz"])]
    pub(super) lanes: String,
    /// Order of the tiles in memory.
    #[arg(long, value_name = "ORDER", default_value = "morton", value_parser = ["morton", "hilbert", "rows"])]
    pub(super) order: String,
    /// Bits of a value. Samples are exact if the visible ones have no more values than that.
    #[arg(long, value_name = "BITS", default_value = "8", value_parser = ["8", "16"])]
    pub(super) value_bits: String,
    /// Bits of each component of a normal; none is smallest, and unlit.
    #[arg(long, value_name = "BITS", default_value = "8", value_parser = ["none", "8", "16"])]
    pub(super) normals: String,
}

impl PackingArguments {
    /// The builder's options.
    pub(super) fn options(&self, transfer: TransferFunction) -> Result<BuildOptions> {
        let normal_bits = match self.normals.as_str() {
            "none" => 0,
            "8" => 8,
            _ => 16,
        };
        Ok(BuildOptions {
            normal_bits: if transfer.shaded() { normal_bits } else { 0 },
            transfer,
            lane_count: u8::try_from(self.lanes.len()).map_err(|_| Error::input("--lanes", "must be x, xy or xyz"))?,
            tile_order: TileOrder::from_name(&self.order)?,
            value_bits: if self.value_bits == "16" { 16 } else { 8 },
        })
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let start = Instant::now();
    check_output(&arguments.output)?;
    let transfer = arguments.classification.required(&arguments.input)?;
    let options = arguments.packing.options(transfer)?;
    let mut source = arguments.reading.open(&arguments.input)?;
    let header = source.header().clone();
    let built = build_with_warnings(&mut *source, &options, arguments.quiet)?;
    write_arena(&arguments.output, &built.facts, &built.lanes, &description(&header, &built))?;
    report(arguments, &header, &built, start.elapsed().as_secs_f64())?;
    Ok(Answer::Yes)
}

/// Builds with a progress bar, and says on stderr what a user should know of the samples.
pub(super) fn build_with_warnings(source: &mut dyn SlabSource, options: &BuildOptions, quiet: bool) -> Result<Built> {
    if options.needs_survey(source.header().sample_type) && !quiet {
        eprintln!("adj: reading the samples twice: their range is needed first (a closed --range A..B avoids it)");
    }
    let built = build(source, options, &mut Progress::new(quiet))?;
    if built.findings.not_finite > 0 {
        eprintln!("adj: warning: {} samples are NaN or infinite: they are transparent", built.findings.not_finite);
    }
    Ok(built)
}

/// Finds out now, not after a long build, that the output cannot be written.
pub(super) fn check_output(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if path.is_dir() {
        return Err(Error::input(path.display().to_string(), "is a folder; give a file name"));
    }
    if !folder.is_dir() {
        return Err(Error::input(folder.display().to_string(), "is no folder; create it first"));
    }
    // Only creating a file tells whether one can be created.
    tempfile::tempfile_in(folder).map(drop).map_err(Error::io("create a file in", folder))
}

/// What the file says of itself to people and tools.
pub(super) fn description(header: &Header, built: &Built) -> String {
    let source = json!({
        "name": header.name,
        "format": header.format,
        "sample_type": header.sample_type.name(),
    });
    let mut description = json!({
        "generator": concat!("adjsplat ", env!("CARGO_PKG_VERSION")),
        "source": source,
        "transfer_function": serde_json::to_value(&built.transfer).expect("a transfer function is plain JSON"),
        "counts": { "nan": built.findings.not_finite },
    });
    if let Some(unit) = &header.grid.unit {
        description["unit"] = json!(unit);
    }
    description.to_string()
}

fn report(arguments: &Arguments, header: &Header, built: &Built, seconds: f64) -> Result<()> {
    let path = &arguments.output;
    let bytes = std::fs::metadata(path).map_err(Error::io("read", path))?.len();
    let visible = built.facts.visible_voxels;
    let samples = header.grid.len();
    let per_voxel = bytes as f64 / visible as f64;
    if arguments.json {
        print_result(
            &json!({
                "output": path.display().to_string(),
                "visible_voxels": visible,
                "samples": samples,
                "bytes_total": bytes,
                "bytes_per_visible_voxel": per_voxel,
                "lowest": built.findings.lowest,
                "highest": built.findings.highest,
                "not_finite": built.findings.not_finite,
                "seconds": seconds,
            })
            .to_string(),
        );
        return Ok(());
    }
    let share = 100.0 * visible as f64 / samples as f64;
    print_result(&format!(
        "{}: {visible} of {samples} voxels visible ({share:.2} %), {}, {per_voxel:.2} bytes a visible voxel, {seconds:.2} s",
        path.display(),
        indicatif::HumanBytes(bytes),
    ));
    Ok(())
}
