//! `adj build`: from a volume to an `.adj` file.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use indicatif::HumanBytes;
use serde_json::json;

use super::classification::ClassificationArguments;
use super::cull::{CullArguments, Culled, cull};
use super::input::InputArguments;
use super::progress::Progress;
use super::resources::{ResourceArguments, peak_rss_bytes};
use super::{Answer, is_same_file, print_note, print_result, starts_as_adj};
use adjsplat::arena::TileOrder;
use adjsplat::arena::layout::Facts;
use adjsplat::build::budget::Budget;
use adjsplat::build::builder::{BuildOptions, Classified, Findings, Resources, classify};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::file::{RowsOutput, Scratch, check_writable, scratch_folder, write_rows};
use adjsplat::internals::description;
use adjsplat::volume::{Header, SlabSource};

/// Build an .adj file from a volume: only the visible voxels, in lanes.
///
/// Reads raw, NRRD, MetaImage, NIfTI, TIFF, VTK (.vtk, .vti) and DICOM files, folders of TIFF or DICOM slices, Zarr
/// and OME-Zarr folders, or phantom:NAME (constant, shells, gyroid, marschner-lobb, hydrogen, vessels, noise, corners).
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj build engine.nii.gz --range 60.. -o engine.adj\n  adj build ct.raw --dims 512x512x300 --type i16le --spacing 0.7x0.7x1 --tf ct-bone -o ct.adj\n  adj build frog.mhd --labels frog -o frog.adj\n  adj build dicom-folder --tf ct-bone -o ct.adj\n  adj build brain.ome.zarr --level 2 --volume 1 --range 300.. -o brain.adj\n  adj build phantom:gyroid --dims 512x512x512 -o gyroid.adj"
)]
pub(super) struct Arguments {
    /// The volume: a file, or a folder of slices.
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The .adj file to write.
    #[arg(short, long, value_name = "OUT.adj")]
    output: PathBuf,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    /// No progress bar.
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    classification: ClassificationArguments,
    #[command(flatten)]
    packing: PackingArguments,
    #[command(flatten)]
    culling: CullArguments,
    #[command(flatten)]
    reading: InputArguments,
    #[command(flatten)]
    resources: ResourceArguments,
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
    /// A flag that was given another value than its default, if any was.
    pub(super) fn given(&self) -> Option<&'static str> {
        let flags = [
            ("--lanes", self.lanes != "xyz"),
            ("--order", self.order != "morton"),
            ("--value-bits", self.value_bits != "8"),
            ("--normals", self.normals != "8"),
        ];
        flags.iter().find(|(_, given)| *given).map(|(flag, _)| *flag)
    }

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
    let (memory, threads) = (arguments.resources.memory()?, arguments.resources.threads()?);
    let mut source = arguments.reading.open(&arguments.input)?;
    let transfer = arguments.classification.required(&arguments.input)?;
    let options = arguments.packing.options(transfer)?;
    let culling = arguments.culling.culling(memory, threads)?;
    check_output(&arguments.output, &arguments.input)?;
    let header = source.header().clone();
    let folder = Some(scratch_folder(&arguments.output)?);
    let resources = Resources { memory: Some(memory), threads, folder };
    let budget = Budget::new(&header, &options, &resources, source.buffer_bytes())?;
    if !arguments.quiet && (arguments.resources.memory_given() || budget.may_spill(header.grid.len())) {
        say_need(&budget, &header);
    }
    let visible = classify_with_warnings(&mut *source, &options, &resources, arguments.quiet)?;
    let description = description(&header, &visible);
    let output = RowsOutput {
        facts: visible.facts.clone(),
        description: &description,
        lane_count: options.lane_count,
        memory: Some(memory),
        threads,
    };
    let mut scratch = culling.map(|_| Scratch::beside(&arguments.output)).transpose()?;
    let path = scratch.as_ref().map_or(arguments.output.as_path(), Scratch::path);
    let mut progress = Progress::new(arguments.quiet);
    let (facts, bytes) = write_rows(path, &visible.rows, &output, &mut progress)?;
    drop(progress);
    let written = Written { facts, bytes, culled: None };
    let (header, findings) = (header, visible.findings);
    drop(visible.rows);
    let written = match (culling, &mut scratch) {
        (Some(culling), Some(scratch)) => {
            scratch.hold()?;
            let culled = cull(scratch.path(), &arguments.output, &culling, arguments.quiet)?;
            Written { facts: culled.facts.clone(), bytes: culled.bytes, culled: Some(culled) }
        }
        _ => written,
    };
    report(arguments, &header, &findings, &written, start.elapsed().as_secs_f64());
    Ok(Answer::Yes)
}

/// What a build left.
struct Written {
    facts: Facts,
    bytes: u64,
    culled: Option<Culled>,
}

/// Says what the build will take, before it does.
fn say_need(budget: &Budget, header: &Header) {
    let memory = HumanBytes(budget.need);
    let voxels = header.grid.len();
    let most = HumanBytes(voxels.saturating_mul(budget.spill_bytes_per_voxel));
    let disk = if budget.may_spill(voxels) {
        let each = budget.spill_bytes_per_voxel;
        format!("; beside the output for a while {each} bytes of disk a visible voxel, at most {most}")
    } else {
        String::new()
    };
    print_note(&format!("takes at most {memory} of memory{disk}"));
}

/// Reads a volume with a progress bar, and says on stderr what a user should know of the samples.
pub(super) fn classify_with_warnings(
    source: &mut dyn SlabSource,
    options: &BuildOptions,
    resources: &Resources,
    quiet: bool,
) -> Result<Classified> {
    if options.needs_survey() && !quiet {
        print_note("reading the samples twice, as what is visible depends on their largest gradient");
    }
    let built = classify(source, options, resources, &mut Progress::new(quiet))?;
    if built.findings.blurred_away > 0 {
        let count = built.findings.blurred_away;
        let better =
            if options.value_bits == 8 { "use --value-bits 16" } else { "narrow the range of what is visible" };
        print_note(&format!(
            "warning: {count} visible voxels turn transparent, as their values share codes with transparent ones; {better}"
        ));
    }
    match built.findings.not_finite {
        0 => {}
        1 => print_note("warning: 1 sample is NaN or infinite; it is transparent"),
        count => print_note(&format!("warning: {count} samples are NaN or infinite; they are transparent")),
    }
    Ok(built)
}

/// Finds out now, not after a long build, that the output cannot be written, or that it would cost the user a file.
fn check_output(output: &Path, input: &Path) -> Result<()> {
    if is_same_file(output, input) {
        return Err(Error::input("--output", "is the volume itself, which it would replace; give another name"));
    }
    check_replaceable(output)
}

/// Finds out that the output can be written, and that no file but an old .adj file would be lost to it.
pub(super) fn check_replaceable(output: &Path) -> Result<()> {
    // A header may name other files that hold the samples: those must not be lost to a slip either.
    let named = output.extension().is_some_and(|extension| extension == "adj");
    let old = std::fs::metadata(output).is_ok_and(|found| found.is_file() && found.len() > 0);
    if old && !named && !starts_as_adj(output)? {
        let why = "is there already and is no .adj file; remove it first, or give a name that ends in .adj";
        return Err(Error::input(output.display().to_string(), why));
    }
    check_writable(output)
}

fn report(arguments: &Arguments, header: &Header, findings: &Findings, written: &Written, seconds: f64) {
    let path = &arguments.output;
    let Written { facts, bytes, culled } = written;
    let (visible, bytes) = (facts.visible_voxels, *bytes);
    let samples = header.grid.len();
    let per_voxel = bytes as f64 / visible as f64;
    if arguments.json {
        let mut result = json!({
            "output": path.display().to_string(),
            "visible_voxels": visible,
            "samples": samples,
            "bytes_total": bytes,
            "bytes_per_visible_voxel": per_voxel,
            "lowest": findings.lowest,
            "highest": findings.highest,
            "not_finite": findings.not_finite,
            "peak_rss_bytes": peak_rss_bytes(),
            "seconds": seconds,
        });
        if let Some(culled) = culled {
            result["hidden_voxels"] = culled.report.clone();
        }
        print_result(&result.to_string());
        return;
    }
    let share = 100.0 * visible as f64 / samples as f64;
    let are = if visible == 1 { "voxel is" } else { "voxels are" };
    print_result(&format!(
        "{}: {visible} {are} visible of {samples} ({share:.2} %); {}, {per_voxel:.2} bytes a visible voxel, {seconds:.2} s",
        path.display(),
        HumanBytes(bytes),
    ));
    if let Some(culled) = culled {
        print_result(&culled.line());
    }
}
