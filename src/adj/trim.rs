//! `adj trim`: from an `.adj` file to a smaller one, without the volume.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde_json::{Value, json};

use super::build::check_replaceable;
use super::classification::ClassificationArguments;
use super::info::is_adj;
use super::progress::Progress;
use super::render::parse_crop;
use super::resources::ResourceArguments;
use super::stored::{missing_values, stored_transfer};
use super::{Answer, print_note, print_result};
use adjsplat::arena::layout::Facts;
use adjsplat::arena::{Arena, Region, TileOrder, Trim, TrimOptions, trim};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::file::{AdjFile, RowsOutput, write_rows};
use adjsplat::traverse::VoxelBox;

/// Make a smaller .adj file from an .adj file, without the volume: crop it, raise the threshold, drop channels or lanes.
///
/// Voxels that stay keep their codes, so nothing is lost in them. The output may be the input, which is then replaced
/// by the whole new file. The input is checked first, as adj verify does. It is read in place: its pages, which the
/// system takes back at need, are not counted as memory.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj trim head.adj -o nose.adj --crop 100..180,150..,..\n  adj trim head.adj -o bone.adj --range 300..\n  adj trim head.adj -o small.adj --lanes x --drop normals\n  adj trim head.adj -o head.adj --order hilbert      (in place)"
)]
pub(super) struct Arguments {
    /// The .adj file.
    #[arg(value_name = "IN.adj")]
    input: PathBuf,
    /// The .adj file to write; may be the same.
    #[arg(short, long, value_name = "OUT.adj")]
    output: PathBuf,
    /// Only voxels in this box, by index, inclusive: 0..127,0..63,10..20; an end may be left out. The grid shrinks to
    /// the box; what stays does not move in the world.
    #[arg(long, value_name = "X,Y,Z")]
    crop: Option<String>,
    /// Crop without changing the grid's size and origin.
    #[arg(long, requires = "crop")]
    keep_grid: bool,
    /// Trim even where the transfer function would show values that the file does not store.
    #[arg(long)]
    force: bool,
    /// Do not check the input first: faster, but what is damaged in it may be damaged in the output.
    #[arg(long)]
    no_verify: bool,
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
    resources: ResourceArguments,
}

/// How the voxels that stay are stored; as they are unless told otherwise.
#[derive(Debug, Args)]
#[command(next_help_heading = "Packing (as it is unless given)")]
struct PackingArguments {
    /// Channels to leave out, with commas between: normals, magnitudes.
    #[arg(long, value_name = "CHANNELS", value_delimiter = ',', value_parser = ["normals", "magnitudes"])]
    drop: Vec<String>,
    /// Bits of a value: makes 16 to 8, exactly if the values left have no more than 256 codes.
    #[arg(long, value_name = "BITS", value_parser = ["8"])]
    value_bits: Option<String>,
    /// Bits of each component of a normal: makes 16 to 8.
    #[arg(long, value_name = "BITS", value_parser = ["8"])]
    normals: Option<String>,
    /// Lanes to store: fewer than there are, or more.
    #[arg(long, value_name = "LANES", value_parser = ["x", "xy", "xyz"])]
    lanes: Option<String>,
    /// Order of the tiles in memory.
    #[arg(long, value_name = "ORDER", value_parser = ["morton", "hilbert", "rows"])]
    order: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let start = Instant::now();
    let (memory, threads) = (arguments.resources.memory()?, arguments.resources.threads()?);
    if arguments.input.is_file() && !is_adj(&arguments.input)? {
        let why = "is no .adj file; build one from it first: adj build";
        return Err(Error::input(arguments.input.display().to_string(), why));
    }
    let file = AdjFile::open(&arguments.input)?;
    check_replaceable(&arguments.output)?;
    let arena = file.arena()?;
    let old = arena.facts().clone();
    let crop = arguments.crop.as_deref().map(|text| parse_crop(text, old.grid.dims)).transpose()?;
    if !arguments.no_verify {
        arena.check().map_err(|fault| Error::Format { path: arguments.input.clone(), fault })?;
    }
    let stored = stored_transfer(&arena, &arguments.input).ok();
    let transfer = arguments.classification.transfer(&arguments.input)?;
    let options = arguments.options(crop, transfer);
    let left = trim(&arena, stored.as_ref(), &options)?;
    if let (Some(new), false) = (&left.transfer, arguments.force)
        && let Some(values) = missing_values(&arena, new)?
    {
        let why = format!(
            "shows values {values}, which the file does not store; build it again with this function, or give --force"
        );
        return Err(Error::input("transfer function", why));
    }
    warn(&arena, &options, &left);
    let description = description(&arena, arguments, crop, left.transfer.as_ref());
    let facts = match &arguments.packing.order {
        Some(order) => Facts { tile_order: TileOrder::from_name(order)?, ..left.facts },
        None => left.facts,
    };
    let output = RowsOutput {
        facts,
        description: &description,
        lane_count: match &arguments.packing.lanes {
            Some(lanes) => u8::try_from(lanes.len()).map_err(|_| Error::input("--lanes", "must be x, xy or xyz"))?,
            None => u8::try_from(arena.lanes().count()).expect("there are three axes"),
        },
        memory: Some(memory),
        threads,
    };
    let (facts, bytes) = write_rows(&arguments.output, &left.rows, &output, &mut Progress::new(arguments.quiet))?;
    report(arguments, &arena, &facts, bytes, start.elapsed().as_secs_f64());
    Ok(Answer::Yes)
}

impl Arguments {
    fn options(&self, crop: Option<VoxelBox>, transfer: Option<TransferFunction>) -> TrimOptions {
        let drops = |channel: &str| self.packing.drop.iter().any(|dropped| dropped == channel);
        let part = |crop: &VoxelBox, a: usize| u32::from(crop.low[a])..u32::from(crop.high[a]) + 1;
        TrimOptions {
            crop: crop.map(|crop| Region { xs: part(&crop, 0), ys: part(&crop, 1), zs: part(&crop, 2) }),
            keep_grid: self.keep_grid,
            transfer,
            narrow_values: self.packing.value_bits.is_some(),
            narrow_normals: self.packing.normals.is_some(),
            drop_normals: drops("normals"),
            drop_magnitudes: drops("magnitudes"),
        }
    }
}

/// Says what a user should know before it is written.
fn warn<R>(arena: &Arena, options: &TrimOptions, left: &Trim<R>) {
    if left.blurred_away > 0 {
        print_note(&format!(
            "warning: {} visible voxels turn transparent, as their values share codes with transparent ones; leave out \
             --value-bits 8",
            left.blurred_away
        ));
    }
    let hidden = description_of(arena)["hidden_voxels"].is_object();
    if hidden && (options.crop.is_some() || options.transfer.is_some()) {
        print_note("warning: the file was built without hidden voxels; what is cut open may show where they were");
    }
}

/// What the file says of itself; an empty object if it says nothing that can be read.
fn description_of(arena: &Arena) -> Value {
    let description = serde_json::from_slice(arena.description()).unwrap_or(Value::Null);
    if description.is_object() { description } else { json!({}) }
}

/// The file's description with what was done to it.
fn description(
    arena: &Arena,
    arguments: &Arguments,
    crop: Option<VoxelBox>,
    transfer: Option<&TransferFunction>,
) -> String {
    let mut description = description_of(arena);
    let mut entry = json!({
        "generator": concat!("adjsplat ", env!("CARGO_PKG_VERSION")),
        "visible_voxels_before": arena.facts().visible_voxels,
    });
    if let Some(VoxelBox { low, high }) = crop {
        entry["crop"] = json!([0, 1, 2].map(|a| [low[a], high[a]]));
        entry["dims_before"] = json!(arena.facts().grid.dims);
        entry["keep_grid"] = json!(arguments.keep_grid);
    }
    if let Some(transfer) = transfer {
        let transfer = serde_json::to_value(transfer).expect("a transfer function is plain JSON");
        entry["transfer_function_before"] = std::mem::replace(&mut description["transfer_function"], transfer);
    }
    let packing = &arguments.packing;
    if !packing.drop.is_empty() {
        entry["dropped"] = json!(packing.drop);
    }
    if packing.value_bits.is_some() {
        entry["value_bits_before"] = json!(arena.facts().channels.value_bits);
    }
    if packing.normals.is_some() {
        entry["normal_bits_before"] = json!(arena.facts().channels.normal_bits);
    }
    match description["trimmed"].as_array_mut() {
        Some(history) => history.push(entry),
        None => description["trimmed"] = json!([entry]),
    }
    description.to_string()
}

fn report(arguments: &Arguments, arena: &Arena, facts: &Facts, bytes: u64, seconds: f64) {
    let path = arguments.output.display();
    let (visible, before) = (facts.visible_voxels, arena.facts().visible_voxels);
    let bytes_before = arena.bytes().len() as u64;
    let per_voxel = bytes as f64 / visible as f64;
    if arguments.json {
        print_result(
            &json!({
                "output": path.to_string(),
                "dims": facts.grid.dims,
                "visible_voxels": visible,
                "visible_voxels_before": before,
                "bytes_total": bytes,
                "bytes_before": bytes_before,
                "bytes_per_visible_voxel": per_voxel,
                "seconds": seconds,
            })
            .to_string(),
        );
        return;
    }
    let share = 100.0 * visible as f64 / before as f64;
    let are = if before == 1 { "voxel is" } else { "voxels are" };
    print_result(&format!(
        "{path}: {visible} of {before} visible {are} left ({share:.2} %); {}, were {}; {per_voxel:.2} bytes a visible \
         voxel, {seconds:.2} s",
        indicatif::HumanBytes(bytes),
        indicatif::HumanBytes(bytes_before),
    ));
}
