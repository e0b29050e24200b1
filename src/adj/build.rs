//! `adj build`: makes an `.adj` file from a volume.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use indicatif::{HumanBytes, HumanCount};
use serde_json::json;

use super::classification::ClassificationArguments;
use super::cull::{CullArguments, Culled, check_cull_memory, cull};
use super::input::{Input, InputArguments, phantom};
use super::progress::{Progress, interrupted};
use super::resources::{ResourceArguments, peak_rss_bytes};
use super::values::{Word, choice, levels};
use super::{Answer, check_output, print_line, print_note, print_result, starts_as_adj};
use adjsplat::arena::layout::Facts;
use adjsplat::arena::{Levels, Rows, TileOrder};
use adjsplat::build::{BuildOptions, Classified, Resources, SampleSummary, classify};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::file::{AdjFile, RowsOutput, descriptor, open_rows, scratch_folder, write_atomically_unless, write_rows};
use adjsplat::internals::Budget;
use adjsplat::internals::description;
use adjsplat::volume::{Header, SlabSource};

/// Build an .adj file, which holds only the visible voxels, from a volume
///
/// Reads raw, NRRD, MetaImage, NIfTI, TIFF, VTK (.vtk, .vti), SLC and DICOM files, slices in TIFF, DICOM or raw files
/// (a folder, or several files), and Zarr and OME-Zarr folders. phantom:NAME is a computed volume: constant, shells,
/// gyroid, marschner-lobb, hydrogen, vessels, noise or corners.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj build engine.nii.gz --range 60.. -o engine.adj\n  adj build ct.raw --dims 512x512x300 --type i16le --spacing 0.7x0.7x1 --tf ct-bone -o ct.adj\n  adj build frog.mhd --labels frog                   (writes frog.adj)\n  adj build dicom-folder --tf ct-bone -o ct.adj\n  adj build slices/*.tif --range 60.. -o stack.adj\n  adj build CThead.* --dims 256x256x113 --type u16be --range 1200.. -o head.adj\n  adj build brain.ome.zarr --level 2 --volume 1 --range 300.. -o brain.adj\n  adj build phantom:gyroid --dims 512x512x512 -o gyroid.adj"
)]
pub(super) struct Arguments {
    /// The volume: a file, a folder of slices, several files of slices ('slices/*.tif', in the order of the numbers in
    /// their names), or phantom:NAME
    #[arg(value_name = "IN", required = true)]
    input: Vec<PathBuf>,
    /// The .adj file to write; by default it lies beside the volume and has its name
    #[arg(short, long, value_name = "OUT.adj")]
    output: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    /// Show no progress bar
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    classification: ClassificationArguments,
    #[command(flatten)]
    packing: PackingArguments,
    /// Coarser levels of detail to store beside the voxels: a number of them, none, or auto. Each has half as many points as
    /// the level below it, along the axes with the smallest spacing. Small pictures are then drawn faster. auto adds levels
    /// as long as the last one has 4096 voxels or more and 63 points or more along its longest axis, and the next one has at
    /// most nine tenths of its voxels
    #[arg(long, value_name = "N|auto|none", default_value = "none", allow_hyphen_values = true, value_parser = levels, help_heading = "Packing")]
    levels: Levels,
    #[command(flatten)]
    culling: CullArguments,
    #[command(flatten)]
    reading: InputArguments,
    #[command(flatten)]
    resources: ResourceArguments,
}

/// The flags for how the visible voxels are stored.
#[derive(Debug, Args)]
#[command(next_help_heading = "Packing")]
pub(super) struct PackingArguments {
    /// Axes along which voxels are sorted. Each adds to the file; a missing one is made when a view needs it
    #[arg(long, value_name = "LANES", default_value = "xyz", value_parser = choice(LANES))]
    lanes: u8,
    /// Order of the tiles (8 x 8 scan lines) in the file; matters for speed only
    #[arg(long, value_name = "ORDER", default_value = "morton", value_parser = choice(TILE_ORDERS))]
    order: TileOrder,
    /// Bits of a value; by default 8; 16 where 8 would turn visible voxels transparent or mix up labels, and in adj render
    /// --max-error. Whole numbers are stored exactly if all are among 256 (or 65536) multiples of one step; else the build
    /// says how far it rounds
    #[arg(long, value_name = "BITS", value_parser = choice([("8", 8u8, ""), ("16", 16u8, "")]))]
    value_bits: Option<u8>,
    /// Bits of each component of a surface normal; by default 8, in adj render --max-error 16. none makes a smaller file
    /// without lighting
    #[arg(long, value_name = "BITS", value_parser = choice([("none", 0u8, ""), ("8", 8u8, ""), ("16", 16u8, "")]))]
    normals: Option<u8>,
}

/// Values of `--lanes`: each word names the axes, and the number is how many there are.
pub(super) const LANES: [Word<u8>; 3] = [("x", 1, ""), ("xy", 2, ""), ("xyz", 3, "")];

/// Values of the flags for the order in which tiles are stored.
pub(super) const TILE_ORDERS: [Word<TileOrder>; 3] =
    [("morton", TileOrder::Morton, ""), ("hilbert", TileOrder::Hilbert, ""), ("rows", TileOrder::Rows, "")];

impl PackingArguments {
    /// Returns the first flag of this group whose value is not the default; `None` if there is none.
    pub(super) fn given(&self) -> Option<&'static str> {
        let flags = [
            ("--lanes", self.lanes != 3),
            ("--order", self.order != TileOrder::Morton),
            ("--value-bits", self.value_bits.is_some()),
            ("--normals", self.normals.is_some()),
        ];
        flags.iter().find(|(_, given)| *given).map(|(flag, _)| *flag)
    }

    /// Returns the first flag of this group that asks for rounding to 8 bits; `None` if there is none.
    pub(super) fn rounding(&self) -> Option<&'static str> {
        let flags = [("--value-bits 8", self.value_bits), ("--normals 8", self.normals)];
        flags.iter().find(|(_, bits)| *bits == Some(8)).map(|(flag, _)| *flag)
    }

    /// Returns the builder's options that these flags and `transfer` give. `bits` are those of values and normals of which
    /// no flag says them; without, they are the builder's own.
    pub(super) fn options(&self, transfer: TransferFunction, bits: Option<u8>) -> BuildOptions {
        let normal_bits = if transfer.shaded() { self.normals.or(bits).unwrap_or(8) } else { 0 };
        BuildOptions::new(transfer)
            .with_normal_bits(normal_bits)
            .with_lane_count(self.lanes)
            .with_tile_order(self.order)
            .with_value_bits(self.value_bits.or(bits))
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let start = Instant::now();
    let (memory, threads) = (arguments.resources.memory(), arguments.resources.threads());
    let input = Input::find(&arguments.input)?;
    let mut source = arguments.reading.open(&input)?;
    let transfer = arguments.classification.chosen(input.path(), &mut *source, arguments.quiet)?;
    let options = arguments.packing.options(transfer, None).with_levels(arguments.levels);
    let culling = arguments.culling.culling(memory, threads)?;
    let path = &arguments.output(input.path())?;
    check_adj_output(path, input.all_files(&source))?;
    let header = source.header().clone();
    culling.iter().try_for_each(|culling| check_cull_memory(header.grid.dims, culling))?;
    let folder = scratch_folder(path)?;
    let resources = Resources { memory: Some(memory), threads, folder: Some(folder.clone()) };
    let budget = Budget::new(&header, &options, &resources, source.buffer_bytes())?;
    if !arguments.quiet && (arguments.resources.memory_given() || budget.may_spill(header.grid.points())) {
        say_need(&budget, &header);
    }
    let visible = classify_with_warnings(&mut *source, &options, &resources, arguments.quiet)?;
    arguments.classification.warn_of_units(&visible.samples);
    let description = description(&header, &visible)?;
    let output = RowsOutput::of_build(&visible, &description, &options, &resources);
    let (written, culled) = match culling {
        None => (write_adj(path, &visible.rows, &output, arguments.quiet)?, None),
        Some(culling) => {
            let output = RowsOutput { levels: Levels::default(), ..output };
            let whole = open_rows(&folder, &visible.rows, &output, &mut Progress::new(arguments.quiet))?;
            // Their memory is needed for finding hidden voxels.
            drop(visible.rows);
            let culled = cull(&whole, path, &culling, options.levels, arguments.quiet)?;
            (culled.written.clone(), Some(culled))
        }
    };
    report(arguments, path, &header, &visible.samples, written, culled.as_ref(), start.elapsed().as_secs_f64());
    Ok(Answer::Yes)
}

impl Arguments {
    /// Returns the file to write: `brain.adj` for `brain.nii.gz`, `brain.ome.zarr`, a folder `brain` or slices `brain1`,
    /// `brain2`.
    fn output(&self, input: &Path) -> Result<PathBuf> {
        if let Some(output) = &self.output {
            return Ok(output.clone());
        }
        let mut input = phantom(input)?.map_or(input.to_path_buf(), |phantom| phantom.name().into());
        let ends_in = |path: &Path, endings: &[&str]| {
            path.extension().is_some_and(|found| endings.iter().any(|ending| found.eq_ignore_ascii_case(ending)))
        };
        if input.is_file() || ends_in(&input, &["zarr"]) {
            input.set_extension("");
            if ends_in(&input, &["nii", "ome"]) {
                input.set_extension("");
            }
        }
        let mut name =
            input.file_name().ok_or_else(|| Error::input("--output", "must be given for this input"))?.to_owned();
        name.push(".adj");
        Ok(input.with_file_name(name))
    }
}

/// An .adj file that was written.
#[derive(Debug, Clone)]
pub(super) struct Written {
    pub(super) facts: Facts,
    pub(super) bytes: u64,
    /// The number of coarser levels of detail, and their bytes; `None` if none were wanted.
    pub(super) levels: Option<(u8, u64)>,
}

/// Writes an .adj file like [`write_rows`], with a progress bar unless `quiet`.
pub(super) fn write_adj(path: &Path, rows: &dyn Rows, output: &RowsOutput, quiet: bool) -> Result<Written> {
    let progress = &mut Progress::new(quiet);
    let levels_of = |file: &AdjFile| -> Result<(u8, u64)> {
        let arena = file.arena()?;
        let levels = (1..=arena.level_count()).filter_map(|level| arena.level(level));
        Ok((arena.level_count(), levels.map(|level| level.bytes().len() as u64).sum()))
    };
    let is_device = std::fs::metadata(path).is_ok_and(|found| !found.is_file());
    if output.levels.is_none() || !is_device && descriptor(path).is_none() {
        let (facts, bytes) = write_rows(path, rows, output, progress)?;
        let levels = (!output.levels.is_none()).then(|| levels_of(&AdjFile::open(path)?)).transpose()?;
        return Ok(Written { facts, bytes, levels });
    }
    // A pipe cannot be read again, and an open file may hold more.
    let file = open_rows(&scratch_folder(path)?, rows, output, progress)?;
    let arena = file.arena()?;
    write_atomically_unless(&interrupted, path, |out| out.write_all(arena.bytes()))?;
    let bytes = arena.bytes().len() as u64;
    Ok(Written { facts: arena.facts().clone(), bytes, levels: Some(levels_of(&file)?) })
}

/// Prints how many levels of detail were made, if any were wanted.
pub(super) fn say_levels(levels: Option<(u8, u64)>) {
    match levels {
        None => {}
        Some((0, _)) => print_result("coarser levels of detail are of no use to these voxels: there are none"),
        Some((1, bytes)) => print_result(&format!("1 coarser level of detail takes {} of it", HumanBytes(bytes))),
        Some((n, bytes)) => print_result(&format!("{n} coarser levels of detail take {} of it", HumanBytes(bytes))),
    }
}

/// Prints by how much stored values are rounded, if they are.
pub(super) fn say_rounding(bits: u8, rounding: f64) {
    if rounding > 0.0 {
        let by = if (0.001..1e6).contains(&rounding) { format!("{rounding:.3}") } else { format!("{rounding:.3e}") };
        print_result(&format!("values are stored in {bits} bits, rounded by at most {by}"));
    }
}

/// Prints what memory and disk the build will take, before it starts.
fn say_need(budget: &Budget, header: &Header) {
    let memory = HumanBytes(budget.need);
    let voxels = header.grid.points();
    let most = HumanBytes(voxels.saturating_mul(budget.spill_bytes_per_voxel));
    let disk = if budget.may_spill(voxels) {
        let per_voxel = budget.spill_bytes_per_voxel;
        format!("; beside the output for a while {per_voxel} bytes of disk a visible voxel, at most {most}")
    } else {
        String::new()
    };
    print_note(&format!("takes at most {memory} of memory{disk}"));
}

/// Finds the visible voxels of a volume, with a progress bar and warnings about its samples.
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
    warn_of_samples(options, built.facts.channels.value_bits, &built.samples);
    Ok(built)
}

/// Warns of what is wrong with the samples, and of what their codes of `value_bits` lose.
pub(super) fn warn_of_samples(options: &BuildOptions, value_bits: u8, samples: &SampleSummary) {
    if samples.blurred_away > 0 {
        let count = samples.blurred_away;
        let better =
            if options.value_bits == Some(8) { "use --value-bits 16" } else { "narrow the range of what is visible" };
        print_note(&format!(
            "warning: {count} visible voxels turn transparent, as their values share codes with transparent ones; {better}"
        ));
    }
    let SampleSummary { lowest, highest, rounding, .. } = *samples;
    // If codes were spread over the samples alone, values would be rounded by at most half of this.
    let codes = 2.0f64.powi(value_bits.into());
    if rounding > (highest - lowest) / (codes - 1.0) {
        print_note(&format!(
            "warning: the range of what is visible reaches far beyond the samples, which run from {lowest} to {highest}, so values \
             are stored coarsely; end it there, or leave that end open"
        ));
    }
    if samples.unnamed.voxels > 0 {
        let unnamed = samples.unnamed;
        let mut labels: Vec<String> = unnamed.lowest.iter().flatten().map(i64::to_string).collect();
        if labels.len() == unnamed.lowest.len() {
            *labels.last_mut().expect("one at least") = "...".into();
        }
        print_note(&format!(
            "warning: {} voxels have labels that the palette does not name ({}) and are not drawn; add them to the palette (--labels distinct draws all labels above 0)",
            HumanCount(unnamed.voxels),
            labels.join(", "),
        ));
    }
    if let Some(count) = samples.rounded_labels {
        let exact = if value_bits == 8 { ", or store all exactly with --value-bits 16" } else { "" };
        print_note(&format!(
            "warning: the visible samples have only {count} different values, which are stored rounded; if they are labels, take --labels{exact}"
        ));
    }
    if options.value_bits.is_none() && value_bits == 16 {
        let cause = if options.transfer.is_labels() { "do not hold all labels" } else { "would hide visible voxels" };
        print_note(&format!("note: values are stored in 16 bits, as 8 bits {cause}"));
    }
    match samples.not_finite {
        0 => {}
        1 => print_note("warning: 1 sample is NaN or infinite; it is transparent"),
        count => print_note(&format!("warning: {count} samples are NaN or infinite; they are transparent")),
    }
}

/// Checks, before any work, that the output can be written and would replace nothing but an old .adj file; none of the `others`.
pub(super) fn check_adj_output(output: &Path, others: impl IntoIterator<Item = PathBuf>) -> Result<()> {
    check_output("--output", output, others)?;
    // A header file may name other files that hold its samples, so those are kept too.
    let named = output.extension().is_some_and(|extension| extension == "adj");
    // An open file such as /dev/stdout is not replaced.
    let old = std::fs::metadata(output).is_ok_and(|found| found.is_file() && found.len() > 0);
    if old && descriptor(output).is_none() && !named && !starts_as_adj(output)? {
        let why = "is there already and is no .adj file; remove it first, or give a name that ends in .adj";
        return Err(Error::input(output.display().to_string(), why));
    }
    Ok(())
}

fn report(
    arguments: &Arguments,
    path: &Path,
    header: &Header,
    findings: &SampleSummary,
    Written { facts, bytes, levels }: Written,
    culled: Option<&Culled>,
    seconds: f64,
) {
    let visible = facts.visible_voxels;
    let samples = header.grid.points();
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
            "value_bits": facts.channels.value_bits,
            "rounding": findings.rounding,
            "levels": levels.map_or(0, |(count, _)| count),
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
    print_line(&format!(
        "{}: {visible} {are} visible of {samples} ({share:.2} %); {}, {per_voxel:.2} bytes a visible voxel, {seconds:.2} s",
        path.display(),
        HumanBytes(bytes),
    ));
    say_rounding(facts.channels.value_bits, findings.rounding);
    if let Some(culled) = culled {
        print_result(&culled.line());
    }
    say_levels(levels);
}
