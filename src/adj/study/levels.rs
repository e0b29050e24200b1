//! `adj study levels`: measures what levels of detail save and cost, and how much pictures jump where they begin.

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;

use super::super::progress::{Progress, interrupted};
use super::super::resources::{processor_seconds, processors};
use super::super::values::number;
use super::super::{Answer, print_result};
use super::output::OutputArguments;
use super::table_of;
use adjsplat::Model;
use adjsplat::error::{Error, Result};
use adjsplat::splat::Quality;
use adjsplat_study::levels::{DIRECTIONS, DrawnLevel, LevelOptions, LevelPictures, LevelSize, PIXELS};
use adjsplat_study::levels::{geometric_mean, measure, sizes};
use adjsplat_study::report::ReportCell;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};
use adjsplat_study::zoom;
use adjsplat_study::zoom::ZoomFrame;

/// Measure what levels of detail save in time, voxels and bytes, what they cost in accuracy, and what they add to files
#[derive(Debug, Args)]
#[command(
    after_help = "Pictures are parallel views at 1, 0.5, 0.25, 0.125 and 0.0625 pixels a voxel, from six directions, on one thread; times are those of the processor. \"db\": of the worst view, over the pixels that are not empty, from a picture of level 0 with --quality high. \"times faster\": than level 0 at --quality standard, the geometric mean of the views; \"least\": of the slowest view. \"lane bytes\": the whole lanes that the walk follows, of the levels that are drawn.\nThe last rows are over all files: times faster are geometric means, db and least are the worst.\n--zoom draws 60 frames from 0.1 to 4 pixels a voxel instead. \"change\": root mean square difference from the frame before, over the pixels that are not empty; \"judged change\": the same of level 0 with --quality high, over the same pixels; \"popping\": how much larger the change is; \"allowed\": the error that the quality may have, 38 dB at standard, 30 dB at draft. The table has the frame that pops most, of those where other levels begin to be drawn and of all; the files have all frames.\n\nExample: adj study levels engine.adj frog.adj --json levels.json --plot levels.svg"
)]
pub(super) struct Arguments {
    /// .adj files with levels of detail (adj build --levels auto)
    #[arg(value_name = "FILE.adj", required = true)]
    files: Vec<PathBuf>,
    /// Times that each picture is drawn, 1 to 1000, of which the fastest counts; by default 3, with --quick 1
    #[arg(long, value_name = "N", value_parser = number(1..=1000u32))]
    repetitions: Option<u32>,
    /// Two directions in place of six, to see that everything works
    #[arg(long)]
    quick: bool,
    /// Zoom in on each file, and measure how much pictures jump where other levels begin to be drawn
    #[arg(long, conflicts_with_all = ["repetitions", "quick"])]
    zoom: bool,
    #[command(flatten)]
    output: OutputArguments,
}

const COLUMNS: &str =
    "set pixels_a_voxel drawn levels ms times_faster least voxels_walked lane_bytes db times_fewer added_percent";

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    arguments.output.check(&arguments.files, &[])?;
    if arguments.zoom {
        return run_zoom(arguments);
    }
    let views = if arguments.quick { 2 } else { DIRECTIONS.len() };
    let repetitions = arguments.repetitions.unwrap_or(if arguments.quick { 1 } else { 3 });
    let options = LevelOptions { views, repetitions };
    let opened: Vec<(String, Model)> = arguments.files.iter().map(open).collect::<Result<_>>()?;
    let mut report = table_of(COLUMNS);
    let mut stored = table_of("set level dims voxels times_fewer added_percent");
    let mut progress = Progress::new(arguments.output.quiet);
    let mut all = Vec::new();
    for (index, (name, model)) in opened.iter().enumerate() {
        if interrupted() {
            return Err(Error::Interrupted);
        }
        let what = format!("{}/{} {name}", index + 1, opened.len());
        let found = measure(model, options, &processor_seconds, &mut |done, total| progress.show(&what, done, total))?;
        let sizes = sizes(model)?;
        for size in &sizes {
            stored.push(vec![
                name.as_str().into(),
                (size.level as u64).into(),
                size.dims.map(|points| points.to_string()).join(" x ").as_str().into(),
                size.voxels.into(),
                size.times_fewer.into(),
                size.added_percent.into(),
            ]);
        }
        found.iter().for_each(|pictures| report.push(row(name, pictures, &sizes)));
        all.push(found);
    }
    let together = over_files(&all);
    together.iter().for_each(|pictures| report.push(pictures.row()));
    drop(progress);
    arguments.output.write(&report, &plot(&together))?;
    print_result(&format!("{}\n{}", stored.table(&[]), report.table(&[]).trim_end()));
    Ok(Answer::Yes)
}

/// Opens a file that has levels; its name in tables is that of the file.
fn open(path: &PathBuf) -> Result<(String, Model)> {
    let model = Model::open(path)?;
    if model.arena()?.level_count() == 0 {
        let why = "has no levels of detail; add them with adj trim --levels auto";
        return Err(Error::input(path.display().to_string(), why));
    }
    Ok((path.file_stem().unwrap_or_default().to_string_lossy().into_owned(), model))
}

fn row(name: &str, pictures: &LevelPictures, sizes: &[LevelSize]) -> Vec<ReportCell> {
    let size = match pictures.choice {
        DrawnLevel::Level(level) => sizes.iter().find(|size| size.level == level),
        DrawnLevel::Auto(_) => None,
    };
    vec![
        name.into(),
        pictures.pixels.into(),
        pictures.choice.name().as_str().into(),
        names_of(&pictures.levels).as_str().into(),
        (1e3 * pictures.seconds).into(),
        pictures.times_faster.into(),
        pictures.least_times_faster.into(),
        pictures.voxels_walked.into(),
        pictures.lane_bytes.into(),
        pictures.psnr.into(),
        size.map(|size| size.times_fewer).into(),
        size.map(|size| size.added_percent).into(),
    ]
}

/// What was measured of one choice over all files that have it.
struct OverFiles {
    pixels: f64,
    choice: DrawnLevel,
    times_faster: f64,
    least: f64,
    psnr: f64,
}

impl OverFiles {
    fn row(&self) -> Vec<ReportCell> {
        let mut row = vec!["all".into(), self.pixels.into(), self.choice.name().as_str().into(), ReportCell::None];
        row.extend([ReportCell::None, self.times_faster.into(), self.least.into()]);
        row.extend([ReportCell::None, ReportCell::None, self.psnr.into(), ReportCell::None, ReportCell::None]);
        row
    }
}

/// Summarises each choice at each size.
fn over_files(all: &[Vec<LevelPictures>]) -> Vec<OverFiles> {
    let most = all.iter().map(|found| found.len() / PIXELS.len()).max().unwrap_or(0);
    let choices = DrawnLevel::all(most.saturating_sub(3));
    let mut together = Vec::new();
    for pixels in PIXELS {
        for &choice in &choices {
            let is_it = |found: &&LevelPictures| found.choice == choice && (found.pixels - pixels).abs() < 1e-9;
            let found: Vec<&LevelPictures> = all.iter().flatten().filter(is_it).collect();
            let faster: Vec<f64> = found.iter().map(|found| found.times_faster).collect();
            let lowest =
                |of: fn(&LevelPictures) -> f64| found.iter().map(|found| of(found)).fold(f64::INFINITY, f64::min);
            together.push(OverFiles {
                pixels,
                choice,
                times_faster: geometric_mean(&faster),
                least: lowest(|found| found.least_times_faster),
                psnr: lowest(|found| found.psnr),
            });
        }
    }
    together
}

/// Plots how many times faster each choice is, by the pixels a voxel.
fn plot(together: &[OverFiles]) -> Plot {
    let mut series: Vec<PlotSeries> = Vec::new();
    for found in together.iter().filter(|found| found.choice != DrawnLevel::Level(0)) {
        let (name, point) = (found.choice.name(), [found.pixels, found.times_faster]);
        match series.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None if matches!(found.choice, DrawnLevel::Auto(_)) => series.push(PlotSeries::solid(name, vec![point])),
            None => series.push(PlotSeries::dashed(name, vec![point])),
        }
    }
    Plot {
        title: "Levels of detail: times as fast as level 0, geometric means over files".into(),
        x: PlotAxis::logarithmic("pixels a voxel"),
        y: PlotAxis::logarithmic("times as fast as level 0"),
        series,
    }
}

/// The qualities that draw coarser levels by themselves.
const ZOOMED: [Quality; 2] = [Quality::Standard, Quality::Draft];

fn run_zoom(arguments: &Arguments) -> Result<Answer> {
    let opened: Vec<(String, Model)> = arguments.files.iter().map(open).collect::<Result<_>>()?;
    let mut report = table_of("set quality pixels_a_voxel levels db change judged_change popping allowed");
    let mut worst = table_of("set quality frames pixels_a_voxel levels change judged_change popping allowed");
    let mut series: Vec<PlotSeries> = Vec::new();
    let mut progress = Progress::new(arguments.output.quiet);
    for (index, (name, model)) in opened.iter().enumerate() {
        let what = format!("{}/{} {name}", index + 1, opened.len());
        let zooms = zoom::measure(model, &ZOOMED, processors(), &mut |done, total| progress.show(&what, done, total))?;
        for (quality, frames) in ZOOMED.into_iter().zip(&zooms) {
            let series_name = format!("{name}, {}", quality.name());
            let points = frames.iter().map(|frame| [frame.pixels, frame.popping()]).collect();
            series.push(PlotSeries::solid(series_name, points));
            frames.iter().for_each(|frame| report.push(zoom_row(name, quality, frame)));
            let switches = |before: &ZoomFrame, frame: &ZoomFrame| before.levels != frame.levels;
            let of_switches = worst_row(name, quality, frames, "switch", switches);
            let of_all = worst_row(name, quality, frames, "any", |_, _| true);
            of_switches.into_iter().chain(of_all).for_each(|row| worst.push(row));
        }
    }
    drop(progress);
    let plot = Plot {
        title: "Zooming: change from frame to frame, less that of the voxels themselves".into(),
        x: PlotAxis::logarithmic("pixels a voxel"),
        y: PlotAxis::linear("root mean square, of full scale"),
        series,
    };
    arguments.output.write(&report, &plot)?;
    print_result(worst.table(&[]).trim_end());
    Ok(Answer::Yes)
}

fn names_of(levels: &BTreeSet<usize>) -> String {
    levels.iter().map(usize::to_string).collect::<Vec<_>>().join(" ")
}

fn zoom_row(name: &str, quality: Quality, frame: &ZoomFrame) -> Vec<ReportCell> {
    vec![
        name.into(),
        quality.name().into(),
        frame.pixels.into(),
        names_of(&frame.levels).as_str().into(),
        frame.psnr.into(),
        frame.change.into(),
        frame.judged_change.into(),
        frame.popping().into(),
        zoom::allowed(quality).into(),
    ]
}

/// Returns the row of the frame that pops most among those that are `picked`; `None` if there is none.
fn worst_row(
    name: &str,
    quality: Quality,
    frames: &[ZoomFrame],
    what: &str,
    picked: impl Fn(&ZoomFrame, &ZoomFrame) -> bool,
) -> Option<Vec<ReportCell>> {
    let at = (1..frames.len())
        .filter(|&at| picked(&frames[at - 1], &frames[at]))
        .max_by(|&a, &b| frames[a].popping().total_cmp(&frames[b].popping()))?;
    let (before, frame) = (&frames[at - 1], &frames[at]);
    Some(vec![
        name.into(),
        quality.name().into(),
        what.into(),
        frame.pixels.into(),
        format!("{} to {}", names_of(&before.levels), names_of(&frame.levels)).as_str().into(),
        frame.change.into(),
        frame.judged_change.into(),
        frame.popping().into(),
        zoom::allowed(quality).into(),
    ])
}
