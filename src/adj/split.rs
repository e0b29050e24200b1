//! `adj split`: makes a collection of bricks from an `.adj` file.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::info::open_adj;
use super::progress::Progress;
use super::resources::ResourceArguments;
use super::values::{Word, choice, number};
use super::{Answer, check_name, print_line, print_note};
use adjsplat::collection::{Partition, split};
use adjsplat::error::{Error, Result};

/// Split an .adj file into a collection: a folder of bricks, each an .adj file of its own
///
/// Bricks keep the coarser levels of detail whose blocks no border divides: with borders at multiples of 8 points, three of them or
/// more. Others are left out. If none is, adj join makes the same file again, byte for byte. The volume is not needed.
/// The file is mapped: its pages are not counted as memory, because the system can take them back.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj split head.adj -o head.adjs --slab 64\n  adj split head.adj -o head.adjs --brick 128x128x128"
)]
pub(super) struct Arguments {
    /// The .adj file
    #[arg(value_name = "IN.adj")]
    input: PathBuf,
    /// The folder to write, which must not exist yet
    #[arg(short, long, value_name = "OUT.adjs")]
    output: PathBuf,
    #[command(flatten)]
    cuts: CutArguments,
    /// Do not check the input first: faster, but damage may pass into the output
    #[arg(long)]
    no_verify: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    /// Show neither progress nor notes
    #[arg(long, short)]
    quiet: bool,
    #[command(flatten)]
    resources: ResourceArguments,
}

/// The flags for how a volume is cut.
#[derive(Debug, Args)]
pub(super) struct CutArguments {
    #[command(flatten)]
    bricks: BrickArguments,
    /// Axes across which slabs are cut. With xyz every voxel is stored three times, and pictures brick by brick are exact
    /// from every side, if voxels are not smaller than pixels
    #[arg(long, value_name = "AXES", default_value = "z", conflicts_with = "brick", value_parser = choice(PARTITIONS))]
    partition: PartitionChoice,
    /// Points along an axis that a voxel of the preview stands for; 1 makes no preview. By default the preview has at most
    /// 16 million voxels, and there is none if the whole has no more
    #[arg(long, value_name = "N", value_parser = number(1..=65_535u32))]
    pub(super) preview: Option<u32>,
}

/// Values of `--partition`.
const PARTITIONS: [Word<PartitionChoice>; 2] = [("z", PartitionChoice::Z, ""), ("xyz", PartitionChoice::AllAxes, "")];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PartitionChoice {
    Z,
    AllAxes,
}

impl CutArguments {
    /// Returns for each partition the most points of a brick along x, y, z; 0 where an axis is not cut.
    pub(super) fn sizes(&self) -> Vec<[u32; 3]> {
        match (self.bricks.brick, self.bricks.slab.unwrap_or(0)) {
            (Some(size), _) => vec![size],
            (None, slab) if self.partition == PartitionChoice::AllAxes => {
                vec![[0, 0, slab], [0, slab, 0], [slab, 0, 0]]
            }
            (None, slab) => vec![[0, 0, slab]],
        }
    }
}

/// The flags for how large bricks are.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct BrickArguments {
    /// Slices of a brick along z, 1 to 65535; x and y are not cut
    #[arg(long, value_name = "SLICES", value_parser = number(1..=65_535u32))]
    slab: Option<u32>,
    /// Voxels of a brick along x, y and z: 128x128x64; 0 does not cut an axis
    #[arg(long, value_name = "XxYxZ", allow_hyphen_values = true, value_parser = brick)]
    brick: Option<[u32; 3]>,
}

fn brick(text: &str) -> Result<[u32; 3], String> {
    let sides: Option<Vec<u32>> = text.split(['x', 'X']).map(|side| side.trim().parse().ok()).collect();
    sides.and_then(|sides| sides.try_into().ok()).ok_or_else(|| "must be three whole numbers: 128x128x64".into())
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let start = Instant::now();
    check_name("--output", &arguments.output)?;
    if arguments.output.extension().is_some_and(|ending| ending == "adj") {
        return Err(Error::input("--output", "ends in .adj, but a collection is a folder; end it in .adjs"));
    }
    let file = open_adj(&arguments.input)?;
    let arena = file.arena()?;
    if !arguments.no_verify {
        file.check()?;
    }
    let boxes = |size| Partition::into_boxes(arena.facts().grid.dims, size);
    let partitions = arguments.cuts.sizes().into_iter().map(boxes).collect::<Result<Vec<_>>>()?;
    let (memory, threads) = (Some(arguments.resources.memory()), arguments.resources.threads());
    let mut progress = Progress::new(arguments.quiet);
    let collection =
        split(&arena, &partitions, arguments.cuts.preview, &arguments.output, memory, threads, &mut progress)?;
    drop(progress);
    let kept = collection.manifest().levels;
    if kept < arena.level_count() && !arguments.quiet {
        let number = if kept == 0 { "none".to_owned() } else { format!("{kept}") };
        print_note(&format!(
            "note: of {} levels of detail, bricks keep {number}: borders divide blocks of the others, or a brick has one block \
             along an axis; borders at multiples of {} points, with a last brick of more than half as many, keep all",
            arena.level_count(),
            1u32 << arena.level_count()
        ));
    }
    let (path, bricks) = (arguments.output.display(), collection.bricks());
    // What was written: a brick that cannot be opened again, as where memory is short, has voxels all the same.
    let files = bricks.iter().filter(|brick| brick.entry.file.is_some()).count();
    let (visible, seconds) = (collection.manifest().visible_voxels, start.elapsed().as_secs_f64());
    print_line(&if arguments.json {
        json!({
            "output": path.to_string(),
            "bricks": bricks.len(),
            "files": files,
            "visible_voxels": visible,
            "levels": kept,
            "seconds": seconds,
        })
        .to_string()
    } else {
        format!("{path}: {} bricks, {files} with visible voxels, {visible} voxels in all, {seconds:.2} s", bricks.len())
    });
    Ok(Answer::Yes)
}
