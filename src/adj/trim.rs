//! `adj trim`: makes a smaller `.adj` file from an `.adj` file, without the volume.

use std::path::PathBuf;
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde::Serialize;
use serde_json::json;

use super::build::{LANES, TILE_ORDERS, Written, check_adj_output, say_levels, say_rounding, write_adj};
use super::classification::ClassificationArguments;
use super::info::open_adj;
use super::resources::ResourceArguments;
use super::stored::{missing_values, stored_transfer};
use super::values::{Crop, choice, crop, levels};
use super::{Answer, print_line, print_note, print_result};
use adjsplat::arena::layout::Facts;
use adjsplat::arena::{Arena, Levels, Region, TileOrder, Trim, TrimOptions, trim};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::file::RowsOutput;
use adjsplat::internals::{add_change, description_object};
use adjsplat::traverse::VoxelBox;

/// Make a new .adj file from an .adj file: crop it, show fewer voxels, store less of each, or add levels of detail
///
/// The volume is not needed. Voxels that stay are not changed. Levels of detail are made again from them. The output may be the
/// input, which is then replaced once the new file is complete. The input is checked first, as by adj verify. It is mapped: its pages are not counted as
/// memory, because the system can take them back.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  adj trim head.adj -o nose.adj --crop 100..180,150..,..\n  adj trim head.adj -o bone.adj --range 300..\n  adj trim head.adj -o small.adj --lanes x --drop normals\n  adj trim head.adj -o head.adj --order hilbert      (in place)\n  adj trim head.adj -o head.adj --levels auto        (adds coarser levels of detail)"
)]
pub(super) struct Arguments {
    /// The .adj file
    #[arg(value_name = "IN.adj")]
    input: PathBuf,
    /// The .adj file to write; may be the input
    #[arg(short, long, value_name = "OUT.adj")]
    output: PathBuf,
    /// Keep only voxels in this box of indices, ends included: 0..127,..63,10.. The grid shrinks to the box;
    /// voxels keep their place in the world
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = crop)]
    crop: Option<Crop>,
    /// With --crop: keep the grid's size and origin
    #[arg(long, requires = "crop")]
    keep_grid: bool,
    /// Trim even if the transfer function shows values that the file does not store
    #[arg(long)]
    force: bool,
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
    #[command(flatten)]
    packing: PackingArguments,
    /// Coarser levels of detail: a number of them, none, or auto for as many as are of use. They are made again from what
    /// is left; by default as many as the input has
    #[arg(long, value_name = "N|auto|none", allow_hyphen_values = true, value_parser = levels, help_heading = "Packing (as in the input by default)")]
    levels: Option<Levels>,
    #[command(flatten)]
    resources: ResourceArguments,
}

/// The flags for how the voxels that stay are stored; by default as in the input.
#[derive(Debug, Args)]
#[command(next_help_heading = "Packing (as in the input by default)")]
struct PackingArguments {
    /// What to leave out of each voxel, with commas between: normals (lighting), magnitudes (of gradients)
    #[arg(long, value_name = "CHANNELS", value_delimiter = ',')]
    drop: Vec<Channel>,
    /// Reduce values from 16 bits to 8; exact if all that are left are among 256 multiples of one step
    #[arg(long, value_name = "BITS", value_parser = choice([("8", 8u8, "")]))]
    value_bits: Option<u8>,
    /// Reduce each component of a normal from 16 bits to 8
    #[arg(long, value_name = "BITS", value_parser = choice([("8", 8u8, "")]))]
    normals: Option<u8>,
    /// Axes along which voxels are sorted, fewer or more than in the input
    #[arg(long, value_name = "LANES", value_parser = choice(LANES))]
    lanes: Option<u8>,
    /// Order of the tiles (8 x 8 scan lines) in the file; matters for speed only
    #[arg(long, value_name = "ORDER", value_parser = choice(TILE_ORDERS))]
    order: Option<TileOrder>,
}

/// A part of a voxel's record that can be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum Channel {
    Normals,
    Magnitudes,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let start = Instant::now();
    let (memory, threads) = (arguments.resources.memory(), arguments.resources.threads());
    let file = open_adj(&arguments.input)?;
    check_adj_output(&arguments.output, [])?;
    let arena = file.arena()?;
    let crop = arguments.crop.map(|crop| crop.in_grid(arena.facts().grid.dims)).transpose()?;
    if !arguments.no_verify {
        file.check()?;
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
    let description = description(&arena, arguments, crop, &left);
    let tile_order = arguments.packing.order.unwrap_or(left.facts.tile_order);
    let stored_lanes = u8::try_from(arena.lanes().count()).expect("there are three axes");
    let levels = arguments.levels.unwrap_or(Levels::Count(arena.level_count()));
    let rounding = left.rounding;
    let output = RowsOutput {
        facts: Facts { tile_order, ..left.facts },
        description: &description,
        lane_count: arguments.packing.lanes.unwrap_or(stored_lanes),
        memory: Some(memory),
        threads,
        levels,
    };
    let written = write_adj(&arguments.output, &*left.rows, &output, arguments.quiet)?;
    report(arguments, &arena, &written, rounding, start.elapsed().as_secs_f64());
    Ok(Answer::Yes)
}

impl Arguments {
    fn options(&self, crop: Option<VoxelBox>, transfer: Option<TransferFunction>) -> TrimOptions {
        let range = |crop: &VoxelBox, a: usize| u32::from(crop.low[a])..u32::from(crop.high[a]) + 1;
        TrimOptions::default()
            .with_crop(crop.map(|crop| Region { xs: range(&crop, 0), ys: range(&crop, 1), zs: range(&crop, 2) }))
            .with_keep_grid(self.keep_grid)
            .with_transfer(transfer)
            .with_narrow_values(self.packing.value_bits.is_some())
            .with_narrow_normals(self.packing.normals.is_some())
            .with_drop_normals(self.packing.drop.contains(&Channel::Normals))
            .with_drop_magnitudes(self.packing.drop.contains(&Channel::Magnitudes))
    }
}

/// Warns, before the file is written, of voxels that become transparent and of gaps that a crop may show.
fn warn(arena: &Arena, options: &TrimOptions, left: &Trim) {
    if left.blurred_away > 0 {
        print_note(&format!(
            "warning: {} visible voxels turn transparent, as their values share codes with transparent ones; leave out \
             --value-bits 8",
            left.blurred_away
        ));
    }
    let hidden = description_object(arena.description())["hidden_voxels"].is_object();
    if hidden && (options.crop.is_some() || options.transfer.is_some()) {
        print_note("warning: the file was built without hidden voxels; what is cut open may show where they were");
    }
}

/// Returns the file's description with an entry for this trim.
fn description(arena: &Arena, arguments: &Arguments, crop: Option<VoxelBox>, left: &Trim) -> String {
    let mut description = description_object(arena.description());
    let mut entry = json!({});
    if let Some(VoxelBox { low, high }) = crop {
        entry["crop"] = json!([0, 1, 2].map(|a| [low[a], high[a]]));
        entry["dims_before"] = json!(arena.facts().grid.dims);
        entry["keep_grid"] = json!(arguments.keep_grid);
    }
    if let Some(transfer) = &left.transfer {
        let transfer = serde_json::to_value(transfer).expect("a transfer function is plain JSON");
        entry["transfer_function_before"] = std::mem::replace(&mut description["transfer_function"], transfer);
    }
    let packing = &arguments.packing;
    if !packing.drop.is_empty() {
        entry["dropped"] = json!(packing.drop);
    }
    if packing.value_bits.is_some() {
        entry["value_bits_before"] = json!(arena.facts().channels.value_bits);
        // Both roundings may go the same way.
        if let Some(before) = description["values"]["rounding"].as_f64() {
            description["values"]["rounding"] = json!(before + left.rounding);
        }
    }
    if packing.normals.is_some() {
        entry["normal_bits_before"] = json!(arena.facts().channels.normal_bits);
    }
    add_change(&mut description, "trimmed", arena.facts().visible_voxels, entry);
    description.to_string()
}

fn report(arguments: &Arguments, arena: &Arena, written: &Written, rounding: f64, seconds: f64) {
    let Written { facts, bytes, levels } = written;
    let bytes = *bytes;
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
                "rounding": rounding,
                "levels": levels.map_or(0, |(count, _)| count),
                "seconds": seconds,
            })
            .to_string(),
        );
        return;
    }
    let share = 100.0 * visible as f64 / before as f64;
    let are = if before == 1 { "voxel is" } else { "voxels are" };
    print_line(&format!(
        "{path}: {visible} of {before} visible {are} left ({share:.2} %); {}, were {}; {per_voxel:.2} bytes a visible \
         voxel, {seconds:.2} s",
        indicatif::HumanBytes(bytes),
        indicatif::HumanBytes(bytes_before),
    ));
    say_rounding(facts.channels.value_bits, rounding);
    say_levels(*levels);
}
