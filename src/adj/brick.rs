//! `adj brick`: builds a collection brick by brick, each step a process of its own, on any machines.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::build::{PackingArguments, say_rounding, warn_of_samples};
use super::classification::ClassificationArguments;
use super::input::{Input, InputArguments};
use super::progress::{Progress, interrupted};
use super::resources::ResourceArguments;
use super::split::CutArguments;
use super::values::levels;
use super::{Answer, check_name, check_output, print_line};
use adjsplat::arena::Levels;
use adjsplat::build::Resources;
use adjsplat::collection::{Findings, Partition, Plan};
use adjsplat::error::{Error, Result};
use adjsplat::file::write_atomically_unless;
use adjsplat::internals::read_text;
use adjsplat::volume::{Grid, PartSource};

/// Build a collection brick by brick, in steps that jobs on any machines do; the bricks join to the bytes of adj build
///
/// First plan. Then scan as many bricks as the plan says, and agree; repeat these two until agree says that bricks can be built.
/// Then build every brick, and finish. A step that failed is done again. All machines must see the volume, the plan and the
/// collection's folder.
#[derive(Debug, Args)]
#[command(
    after_help = "Example, of a volume with 4 slabs that are scanned once (docs/clusters.md says which need two scans):\n  adj brick plan ct.nhdr --range 300..3000 --slab 128 -o plan.json\n  for n in 0 1 2 3; do adj brick scan plan.json $n ct.nhdr -o found-$n.json; done\n  adj brick agree plan.json found-*.json -o agreed.json\n  for n in 0 1 2 3; do adj brick build agreed.json $n ct.nhdr -o ct.adjs; done\n  adj brick finish agreed.json ct.adjs"
)]
pub(super) struct Arguments {
    #[command(subcommand)]
    step: Step,
}

#[derive(Debug, Subcommand)]
enum Step {
    Plan(Box<PlanArguments>),
    Scan(Box<ScanArguments>),
    Agree(AgreeArguments),
    Build(Box<BuildArguments>),
    Finish(FinishArguments),
}

/// Plan the bricks of a volume: how it is cut, what is visible, how it is stored
#[derive(Debug, Args)]
#[command(after_help = "Example: adj brick plan ct.nhdr --range 300..3000 --slab 128 -o plan.json")]
struct PlanArguments {
    /// The volume, as adj build takes it
    #[arg(value_name = "IN", required = true)]
    input: Vec<PathBuf>,
    /// The plan to write
    #[arg(short, long, value_name = "PLAN.json")]
    output: PathBuf,
    #[command(flatten)]
    cuts: CutArguments,
    #[command(flatten)]
    classification: ClassificationArguments,
    #[command(flatten)]
    packing: PackingArguments,
    /// Coarser levels of detail to store in each brick, each on a grid of half the points: a number of them, none, or auto for
    /// as many as are of use and no brick's border divides: borders at multiples of 2, 4, 8 ... points. Pictures brick by brick
    /// then read the level that they need, and the preview is a level
    #[arg(long, value_name = "N|auto|none", default_value = "none", allow_hyphen_values = true, value_parser = levels, help_heading = "Packing")]
    levels: Levels,
    #[command(flatten)]
    reading: InputArguments,
}

/// A plan, one of its bricks, and the volume.
#[derive(Debug, Args)]
struct BrickOfVolume {
    /// The plan
    #[arg(value_name = "PLAN.json")]
    plan: PathBuf,
    /// The brick's number, from 0
    #[arg(value_name = "NUMBER")]
    number: usize,
    /// The volume, with the same flags as for the plan
    #[arg(value_name = "IN", required = true)]
    input: Vec<PathBuf>,
    /// Show no progress bar
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    reading: InputArguments,
    #[command(flatten)]
    resources: ResourceArguments,
}

/// Scan a brick of the volume: the range of its values, its visible voxels, what codes depend on
#[derive(Debug, Args)]
#[command(after_help = "Example: adj brick scan plan.json 3 ct.nhdr -o found-3.json")]
struct ScanArguments {
    #[command(flatten)]
    brick: BrickOfVolume,
    /// What was found, to write
    #[arg(short, long, value_name = "FOUND.json")]
    output: PathBuf,
}

/// Agree on the codes of all bricks, from what scans of each brick found
///
/// Exit code 0: bricks can be built; 1: scan the same bricks once more, with the new plan.
#[derive(Debug, Args)]
#[command(after_help = "Example: adj brick agree plan.json found-0.json found-1.json -o agreed.json")]
struct AgreeArguments {
    /// The plan that the bricks were scanned with
    #[arg(value_name = "PLAN.json")]
    plan: PathBuf,
    /// What scans found, of each scanned brick once
    #[arg(value_name = "FOUND.json", required = true)]
    found: Vec<PathBuf>,
    /// The new plan to write
    #[arg(short, long, value_name = "AGREED.json")]
    output: PathBuf,
}

/// Build a brick of an agreed plan, with the samples around it that its gradients need
#[derive(Debug, Args)]
#[command(after_help = "Example: adj brick build agreed.json 3 ct.nhdr -o ct.adjs")]
struct BuildArguments {
    #[command(flatten)]
    brick: BrickOfVolume,
    /// The collection's folder; it is made if it is not there
    #[arg(short, long, value_name = "OUT.adjs")]
    output: PathBuf,
}

/// Finish a collection whose bricks are built: write its preview and its manifest
#[derive(Debug, Args)]
#[command(after_help = "Example: adj brick finish agreed.json ct.adjs")]
struct FinishArguments {
    /// The agreed plan
    #[arg(value_name = "PLAN.json")]
    plan: PathBuf,
    /// The collection's folder
    #[arg(value_name = "OUT.adjs")]
    folder: PathBuf,
    /// Show no progress bar
    #[arg(long, short)]
    quiet: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    match &arguments.step {
        Step::Plan(arguments) => plan(arguments),
        Step::Scan(arguments) => scan(arguments),
        Step::Agree(arguments) => agree(arguments),
        Step::Build(arguments) => build(arguments),
        Step::Finish(arguments) => finish(arguments),
    }
}

fn plan(arguments: &PlanArguments) -> Result<Answer> {
    let input = Input::find(&arguments.input)?;
    let source = arguments.reading.open(&input)?;
    let Some(transfer) = arguments.classification.transfer(input.path())? else {
        return Err(Error::input(
            "--range, --iso, --tf, --levoy or --labels",
            "must say what is visible; all bricks need the same",
        ));
    };
    let texts = arguments.classification.files();
    check_output("--output", &arguments.output, input.all_files(&source).chain(texts))?;
    let options = arguments.packing.options(transfer, None).with_levels(arguments.levels);
    let mut plan = Plan::new(source.header(), options, &arguments.cuts.sizes())?;
    if let Some(every) = arguments.cuts.preview {
        plan = plan.with_preview(every);
    }
    write(&arguments.output, &plan.to_json())?;
    let counts: Vec<usize> = plan.partitions()?.iter().map(Partition::len).collect();
    let (scans, all) = (counts[0], counts.iter().sum::<usize>());
    let levels = match (plan.level_count(), arguments.levels) {
        (0, Levels::Auto) => ", without levels of detail: none is of use, or bricks would divide its blocks".to_owned(),
        (0, _) => String::new(),
        (1, _) => ", with 1 level of detail".to_owned(),
        (count, _) => format!(", with {count} levels of detail"),
    };
    print_line(&format!("{}: {scans} bricks to scan, {all} to build{levels}", arguments.output.display()));
    Ok(Answer::Yes)
}

fn scan(arguments: &ScanArguments) -> Result<Answer> {
    let ScanArguments { brick, output } = arguments;
    let input = Input::find(&brick.input)?;
    let (plan, mut source) = brick.open(&input)?;
    check_output("--output", output, input.all_files(&source).chain([brick.plan.clone()]))?;
    let resources = brick.resources(std::env::temp_dir());
    let found = plan.scan(brick.number, &mut source, &resources, &mut Progress::new(brick.quiet))?;
    write(output, &serde_json::to_string(&found).expect("numbers are plain JSON"))?;
    print_line(&format!("{}: brick {}", output.display(), brick.number));
    Ok(Answer::Yes)
}

fn agree(arguments: &AgreeArguments) -> Result<Answer> {
    let AgreeArguments { plan, found, output } = arguments;
    check_output("--output", output, found.iter().chain([plan]))?;
    let findings = found.iter().map(|path| read_findings(path)).collect::<Result<Vec<_>>>()?;
    let plan = read_plan(plan)?.agree(&findings)?;
    let is_agreed = plan.is_agreed()?;
    write(output, &plan.to_json())?;
    let next = if is_agreed { "agreed: build the bricks" } else { "scan the same bricks once more, with this plan" };
    print_line(&format!("{}: {next}", output.display()));
    if !is_agreed {
        return Ok(Answer::No);
    }
    let (samples, value_bits) = (plan.samples()?, plan.value_bits()?);
    warn_of_samples(plan.options(), value_bits, &samples);
    say_rounding(value_bits, samples.rounding);
    Ok(Answer::Yes)
}

fn build(arguments: &BuildArguments) -> Result<Answer> {
    let BuildArguments { brick, output } = arguments;
    check_name("--output", output)?;
    let input = Input::find(&brick.input)?;
    let (plan, mut source) = brick.open(&input)?;
    let is_new = match std::fs::create_dir(output) {
        Err(fault) if fault.kind() == std::io::ErrorKind::AlreadyExists && output.is_dir() => false,
        made => made.map(|()| true).map_err(Error::io("create the folder", output))?,
    };
    let resources = brick.resources(output.clone());
    let built = plan.build(brick.number, &mut source, output, &resources, &mut Progress::new(brick.quiet));
    if built.is_err() && is_new {
        // Another process may have put a brick there meanwhile: only an empty folder goes.
        let _ = std::fs::remove_dir(output);
    }
    let voxels = built?;
    print_line(&format!("{}: brick {}, {voxels} visible voxels", output.display(), brick.number));
    Ok(Answer::Yes)
}

fn finish(arguments: &FinishArguments) -> Result<Answer> {
    let plan = read_plan(&arguments.plan)?;
    let collection = plan.finish(&arguments.folder, &mut Progress::new(arguments.quiet))?;
    let (bricks, voxels) = (collection.bricks().len(), collection.manifest().visible_voxels);
    print_line(&format!("{}: {bricks} bricks, {voxels} visible voxels", arguments.folder.display()));
    Ok(Answer::Yes)
}

impl BrickOfVolume {
    /// Opens the plan, and the samples that its brick needs.
    fn open(&self, input: &Input) -> Result<(Plan, impl adjsplat::volume::SlabSource)> {
        let plan = read_plan(&self.plan)?;
        let region = plan.samples_of(self.number)?;
        let volume = self.reading.open(input)?;
        check_grid(&volume.header().grid, plan.grid())
            .map_err(|why| Error::input(self.input[0].display().to_string(), why))?;
        Ok((plan, PartSource::new(volume, region.low(), region.size())?))
    }

    fn resources(&self, folder: PathBuf) -> Resources {
        Resources { memory: Some(self.resources.memory()), threads: self.resources.threads(), folder: Some(folder) }
    }
}

/// Returns what is another in the grid of a volume than in the plan's. The same file and flags give the same numbers, bit for
/// bit, and a plan keeps them.
fn check_grid(grid: &Grid, plan: &Grid) -> Result<(), String> {
    let but = "but the plan is of a volume";
    let flags = "give the volume and the flags of the plan";
    if grid.dims != plan.dims {
        return Err(format!("has {:?} points, {but} of {:?}; {flags}", grid.dims, plan.dims));
    }
    let places = [("spacing", grid.spacing, plan.spacing), ("origin", grid.origin, plan.origin)];
    let axes = ["x", "y", "z"].map(|axis| format!("direction of {axis}"));
    let directions = (0..3).map(|a| (axes[a].as_str(), grid.direction[a], plan.direction[a]));
    match places.into_iter().chain(directions).find(|(_, given, planned)| given != planned) {
        Some((name, given, planned)) => Err(format!("has the {name} {given:?}, {but} with {planned:?}; {flags}")),
        None if grid.unit != plan.unit => Err(format!("has another unit of length than the plan's volume; {flags}")),
        None => Ok(()),
    }
}

/// Most bytes of a plan or of findings: transfer functions may be long.
const MOST_BYTES: u64 = 256 << 20;

fn read_findings(path: &Path) -> Result<Findings> {
    let text = read_text(path, MOST_BYTES)?;
    serde_json::from_str(&text).map_err(|error| {
        let why = format!("is no result of a scan ({}); adj brick scan makes one", without_backticks(&error));
        Error::input(path.display().to_string(), why)
    })
}

/// Returns the message of a parser. Quotation marks of another kind would read as names of flags.
fn without_backticks(error: &serde_json::Error) -> String {
    error.to_string().replace('`', "\"")
}

fn read_plan(path: &Path) -> Result<Plan> {
    let text = read_text(path, MOST_BYTES)?;
    Plan::from_json(&text).map_err(|error| {
        let name = path.display().to_string();
        match (error, serde_json::from_str::<Plan>(&text)) {
            (_, Err(_)) if serde_json::from_str::<Findings>(&text).is_ok() => {
                Error::input(name, "is the result of a scan, not a plan; give the plan, which adj brick plan makes")
            }
            (_, Err(fault)) => {
                let why = format!("is no plan ({}); adj brick plan makes one", without_backticks(&fault));
                Error::input(name, why)
            }
            (Error::Input { what, why }, Ok(_)) if what == "plan" => Error::input(name, why),
            (other, Ok(_)) => other,
        }
    })
}

fn write(path: &Path, text: &str) -> Result<()> {
    write_atomically_unless(&interrupted, path, |out| writeln!(out, "{text}"))
}
