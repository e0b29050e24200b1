//! `adj info`: shows what a file holds.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use super::classification::{flag_of, flag_of_phantom};
use super::flags::one_line;
use super::histogram::{POINTS, chart, plot, short, thresholds};
use super::input::{Input, InputArguments, phantom};
use super::progress::Progress;
use super::study::output::{check_plots, write_plots};
use super::{Answer, check_output, print_result, starts_as_adj};
use adjsplat::arena::Arena;
use adjsplat::arena::layout::{Facts, SectionEntry};
use adjsplat::build::{Histogram, Suggestion};
use adjsplat::collection::Collection;
use adjsplat::error::{Error, Result};
use adjsplat::file::AdjFile;
use adjsplat::volume::{Axis, Grid};
use adjsplat_study::memory::virtual_voxels;

const EXAMPLES: &str =
    "Examples:\n  adj info head.adj --json\n  adj info head.nii.gz        (which values would be worth showing?)";

/// What the numbers mean, and their units.
const NUMBERS: &str = "\
What is shown:
  dims                     grid points along x, y and z
  spacing                  distance between grid points, in the file's unit of length
  origin, direction        the first grid point, and where x, y and z point, in the world
  axes_toward              where x, y and z point in a patient: R, L (right, left), A, P (front,
                           back), S, I (head, feet)
Of an .adj file or a collection:
  visible_voxels           voxels that are stored
  visible_share            the same as a fraction of the grid points, from 0 to 1
  lanes                    the axes along which the voxels are listed, with a record for each voxel
    lines, tiles           scan lines, and squares of 8 x 8 of them, that hold voxels
    records                voxels, and stepping voxels
    stepping_voxels        records that only carry a distance above 255 grid points on
  sections                 the parts of the file: offset and size in bytes
  bytes_total              size of the file; bytes_per_visible_voxel is it, divided by the voxels
  channels                 what a record stores, beside its distance
    value_bits, normal_bits, magnitude_bits, coverage_bits
                           bits of a voxel's value, of each component of its normal, of its gradient
                           magnitude, and of its coverage (how much of a block is visible); 0 where
                           nothing is stored
    value_low, value_step  a code c is the value value_low + c value_step, in the volume's unit
    magnitude_scale        gradient magnitude of the largest code, per unit of length
    record_bytes           bytes of a record in one lane
  value_rounding           by how much stored values differ from the volume's at most
  levels                   coarser levels of detail
    share_of_file          bytes of the level as a fraction of the file, from 0 to 1
    most_pixels_standard, most_pixels_draft
                           the level is drawn while the longest edge of its voxels has at most so
                           many pixels, by --quality
  virtual_voxels           links that the structure of Orchard and Moeller (2001) would need
  paper_b_bytes            size of that structure: 47 bytes for each visible voxel and each link;
                           paper_b_bytes_per_visible_voxel is it, divided by the voxels
Of a volume:
  slope, intercept         a value is the sample in the file, times slope, plus intercept
  lowest, highest, mean    of the values that are finite; not_finite counts the others
  quantiles                the fraction share (0 to 1) of the values is not larger than value
  suggestion               a flag for a first picture
";

/// Show what an .adj file, a collection or a volume holds: sizes and counts; for a volume also its range of values
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{NUMBERS}\n{EXAMPLES}"))]
pub(super) struct Arguments {
    /// An .adj file or a volume: a file, a folder of slices, or several files of slices ('slices/*.tif')
    #[arg(value_name = "FILE", required = true)]
    input: Vec<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    /// Draw the histogram of a volume's values, and the mean gradient by value, which is large at boundaries
    #[arg(long, value_name = "FILE.svg|FILE.png")]
    plot: Vec<PathBuf>,
    #[command(flatten)]
    reading: InputArguments,
}

/// The quantiles of a volume's values that are shown, as fractions from 0 to 1.
const QUANTILES: [f64; 8] = [0.01, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 0.999];

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let input = Input::find(&arguments.input)?;
    arguments.plot.iter().try_for_each(|plot| check_output("--plot", plot, input.files()))?;
    check_plots(&arguments.plot)?;
    let is_collection = Collection::is_at(input.path());
    if is_collection || is_adj(input.path())? {
        let plot = (!arguments.plot.is_empty()).then_some("--plot");
        if let Some(flag) = arguments.reading.given().chain(arguments.reading.level_given()).chain(plot).next() {
            return Err(Error::input(flag, "is for volumes, but the input is no volume; leave it out"));
        }
    }
    if is_collection {
        let answer = of_collection(&Collection::open(input.path())?);
        print_result(&if arguments.json { answer.to_string() } else { as_text(&answer) });
        return Ok(Answer::Yes);
    }
    if is_adj(input.path())? {
        let answer = of_arena(input.path())?;
        print_result(&if arguments.json { answer.to_string() } else { as_text(&answer) });
        return Ok(Answer::Yes);
    }
    let (mut answer, histogram) = of_volume(arguments, &input)?;
    print_result(&if arguments.json {
        answer.to_string()
    } else {
        let guide = guide(&answer, &histogram);
        let members = answer.as_object_mut().expect("of members");
        members.retain(|name, _| name != "histogram" && name != "suggestion");
        as_text(&answer) + &guide
    });
    Ok(Answer::Yes)
}

/// Returns whether `path` is an `.adj` file, by its first bytes or its name.
pub(super) fn is_adj(path: &Path) -> Result<bool> {
    let named = path.extension().is_some_and(|extension| extension == "adj");
    // Only regular files are read here; the reader refuses other kinds.
    if named || !std::fs::metadata(path).is_ok_and(|m| m.is_file()) {
        return Ok(named);
    }
    starts_as_adj(path)
}

/// Opens an `.adj` file.
///
/// # Errors
/// [`Error::Input`] if `path` is another file; the errors of [`AdjFile::open`].
pub(super) fn open_adj(path: &Path) -> Result<AdjFile> {
    if path.is_file() && !is_adj(path)? {
        let why = "is no .adj file; build one from it first: adj build";
        return Err(Error::input(path.display().to_string(), why));
    }
    AdjFile::open(path)
}

fn of_collection(collection: &Collection) -> Value {
    let manifest = collection.manifest();
    let facts = manifest.facts();
    let bricks: Vec<Value> = collection
        .bricks()
        .iter()
        .map(|brick| {
            let state = match (&brick.entry.file, &brick.file) {
                (None, _) => "empty",
                (Some(_), Some(_)) => "there",
                (Some(_), None) => "not usable",
            };
            json!({
                "file": brick.entry.file,
                "low": brick.entry.low,
                "size": brick.entry.size,
                "visible_voxels": brick.entry.visible_voxels,
                "state": state,
            })
        })
        .collect();
    json!({
        "file": collection.path().display().to_string(),
        "dims": facts.grid.dims,
        "spacing": facts.grid.spacing,
        "origin": facts.grid.origin,
        "direction": facts.grid.direction,
        "visible_voxels": facts.visible_voxels,
        "visible_share": facts.visible_voxels as f64 / facts.grid.points() as f64,
        "lanes": manifest.lanes,
        "levels": levels_of_collection(collection),
        "partitions": manifest.partitions.len(),
        "channels": channels(&facts),
        "tile_order": facts.tile_order.name(),
        "bricks": bricks,
        "preview": manifest.preview,
        "faults": collection.faults().iter().chain(collection.preview_fault()).map(one_line).collect::<Vec<_>>(),
        "description": serde_json::from_str::<Value>(manifest.description()).unwrap_or(Value::Null),
    })
}

fn of_arena(path: &Path) -> Result<Value> {
    let file = AdjFile::open(path)?;
    let arena = file.arena()?;
    let facts = arena.facts();
    let virtual_voxels = virtual_voxels(&arena)?;
    let bytes_total = arena.bytes().len() as u64;
    let visible = facts.visible_voxels;
    let lanes: Vec<Value> = arena
        .lanes()
        .map(|lane| {
            json!({
                "axis": lane.axis.name(),
                "lines": lane.line_ends.len(),
                "tiles": lane.tiles.len(),
                "records": lane.record_count(),
                "stepping_voxels": lane.stepping_voxels(),
                "bytes": lane.bytes(),
            })
        })
        .collect();
    let sections: Vec<Value> = arena
        .sections()
        .iter()
        .map(|section| {
            json!({
                "kind": kind_of(section),
                "axis": section.lane_axis().map(Axis::name),
                "offset": section.offset.get(),
                "bytes": section.bytes.get(),
            })
        })
        .collect();
    let levels = levels(&arena);
    // The description is for people: a file whose description cannot be read is still valid.
    let description: Value = serde_json::from_slice(arena.description()).unwrap_or(Value::Null);
    Ok(json!({
        "file": path.display().to_string(),
        "dims": facts.grid.dims,
        "spacing": facts.grid.spacing,
        "origin": facts.grid.origin,
        "direction": facts.grid.direction,
        "axes_toward": description["source"]["format"].as_str().and_then(|format| toward(&facts.grid, format)),
        "visible_voxels": visible,
        "visible_share": visible as f64 / facts.grid.points() as f64,
        "stepping_voxels": arena.lanes().map(|lane| lane.stepping_voxels()).sum::<u64>(),
        "lanes": lanes,
        "sections": sections,
        "levels": levels,
        "channels": channels(facts),
        "value_rounding": description["values"]["rounding"],
        "tile_order": facts.tile_order.name(),
        "bytes_total": bytes_total,
        "bytes_per_visible_voxel": bytes_total as f64 / visible as f64,
        "virtual_voxels": virtual_voxels,
        "paper_b_bytes": 47 * (visible + virtual_voxels),
        "paper_b_bytes_per_visible_voxel": 47.0 * (visible + virtual_voxels) as f64 / visible as f64,
        "description": description,
    }))
}

/// Returns what a section holds.
fn kind_of(section: &SectionEntry) -> String {
    match (section.known_kind(), section.level()) {
        (Some(kind), _) => kind.name().to_owned(),
        (None, Some(level)) => format!("level {level}"),
        (None, None) => "unknown".to_owned(),
    }
}

/// Returns the coarser levels of detail, with their part of the file.
fn levels(arena: &Arena) -> Vec<Value> {
    let levels = (1..=arena.level_count()).filter_map(|number| Some((number, arena.level(number)?)));
    levels
        .map(|(number, level)| {
            let limits = arena.level_limits().get(usize::from(number) - 1);
            json!({
                "level": number,
                "dims": level.facts().grid.dims,
                "visible_voxels": level.facts().visible_voxels,
                "bytes": level.bytes().len(),
                "share_of_file": level.bytes().len() as f64 / arena.bytes().len() as f64,
                "most_pixels_standard": limits.map(|limits| limits.standard.get()),
                "most_pixels_draft": limits.map(|limits| limits.draft.get()),
            })
        })
        .collect()
}

/// Returns the coarser levels of detail that the bricks of a collection hold.
fn levels_of_collection(collection: &Collection) -> Vec<Value> {
    let levels = (1..).zip(collection.levels());
    levels
        .map(|(number, facts): (u8, &Facts)| {
            json!({ "level": number, "dims": facts.grid.dims, "visible_voxels": facts.visible_voxels })
        })
        .collect()
}

fn channels(facts: &Facts) -> Value {
    json!({
        "value_bits": facts.channels.value_bits,
        "value_low": facts.scales.value_low,
        "value_step": facts.scales.value_step,
        "normal_bits": facts.channels.normal_bits,
        "magnitude_bits": facts.channels.magnitude_bits,
        "coverage_bits": facts.channels.coverage_bits,
        "magnitude_scale": facts.scales.magnitude_scale,
        "record_bytes": facts.channels.record_bytes(),
    })
}

/// Returns what helps to choose what to show: the histogram, and how much some thresholds would show.
fn guide(answer: &Value, histogram: &Histogram) -> String {
    if histogram.counts.is_empty() {
        return String::new();
    }
    let mut text = format!("\nhistogram (voxels on a logarithmic scale):\n{}\n", chart(histogram));
    for (value, share) in thresholds(histogram) {
        text.push_str(&format!("--range {value}.. shows {:.2} % of the voxels\n", 100.0 * share));
    }
    if let Some(flag) = answer["suggestion"].as_str() {
        text.push_str(&format!("a first picture: {flag}"));
    }
    text.trim_end().to_owned()
}

fn of_volume(arguments: &Arguments, input: &Input) -> Result<(Value, Histogram)> {
    let mut source = arguments.reading.open(input)?;
    let header = source.header().clone();
    let mut progress = Progress::new(arguments.json);
    let histogram = Histogram::of(&mut *source, &mut progress)?;
    if !arguments.plot.is_empty() {
        if histogram.counts.is_empty() {
            return Err(Error::input("--plot", "has nothing to show: no sample is a finite number; leave it out"));
        }
        let gradients = histogram.gradients(&mut *source, POINTS, &mut progress)?;
        let name = input.path().file_name().unwrap_or_default().to_string_lossy();
        write_plots(&arguments.plot, &plot(&name, &histogram, &gradients))?;
    }
    drop(progress);
    let suggestion = match phantom(input.path())? {
        Some(phantom) => Some(flag_of_phantom(&phantom)),
        None => {
            let stated = Suggestion::stated(&*source).ok().flatten();
            stated.or_else(|| Suggestion::of(&histogram).ok()).as_ref().map(flag_of)
        }
    };
    let quantiles: Vec<Value> =
        QUANTILES.iter().map(|&share| json!({ "share": share, "value": histogram.quantile(share) })).collect();
    let answer = json!({
        "file": input.path().display().to_string(),
        "format": header.format,
        "dims": header.grid.dims,
        "spacing": header.grid.spacing,
        "origin": header.grid.origin,
        "direction": header.grid.direction,
        "axes_toward": toward(&header.grid, header.format),
        "unit": header.grid.unit,
        "sample_type": header.sample_type.name(),
        "slope": header.slope,
        "intercept": header.intercept,
        "lowest": histogram.lowest,
        "highest": histogram.highest,
        "mean": histogram.mean,
        "not_finite": histogram.not_finite,
        "quantiles": quantiles,
        "histogram": histogram.rebinned(histogram.counts.len().min(POINTS)),
        "suggestion": suggestion,
    });
    Ok((answer, histogram))
}

/// Returns where each axis of the grid points, nearly: R or L (right, left), A or P (front, back), S or I (head, feet).
///
/// `None` for formats that do not always say where the patient is.
fn toward(grid: &Grid, format: &str) -> Option<[&'static str; 3]> {
    ["NIfTI", "DICOM"].iter().any(|name| format.contains(name)).then(|| {
        grid.direction.map(|along| {
            let steepest = (0..3).max_by(|&a, &b| along[a].abs().total_cmp(&along[b].abs())).unwrap_or(0);
            let letters = [["L", "R"], ["P", "A"], ["I", "S"]][steepest];
            letters[usize::from(along[steepest] > 0.0)]
        })
    })
}

/// Formats JSON with one member per line; a list of objects gets one line per object.
fn as_text(answer: &Value) -> String {
    let mut text = String::new();
    let members = answer.as_object().into_iter().flatten();
    for (name, value) in members {
        match value {
            Value::Array(entries) if entries.iter().any(Value::is_object) => {
                text.push_str(&format!("{name}:\n"));
                for entry in entries {
                    let parts = entry.as_object().into_iter().flatten();
                    let parts: Vec<String> = parts.map(|(name, value)| format!("{name} {}", plain(value))).collect();
                    text.push_str(&format!("  {}\n", parts.join(", ")));
                }
            }
            Value::Object(_) => text.push_str(&format!("{name}: {value}\n")),
            _ => text.push_str(&format!("{name}: {}\n", plain(value))),
        }
    }
    text.trim_end().to_string()
}

fn plain(value: &Value) -> String {
    match value {
        Value::Number(number) if number.is_f64() => number.as_f64().map_or_else(String::new, short),
        Value::String(text) => text.clone(),
        Value::Array(entries) => entries.iter().map(plain).collect::<Vec<_>>().join(" "),
        Value::Null => "-".into(),
        _ => value.to_string(),
    }
}
