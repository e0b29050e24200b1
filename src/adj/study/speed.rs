//! `adj study speed`: measures the paper's Table 1 and Figure 5.

use std::path::PathBuf;

use clap::Args;

use super::super::values::{number, picture_size};
use super::super::{Answer, print_result};
use super::output::{OutputArguments, check_plots, write_plots};
use super::sets::SetArguments;
use super::{MethodArguments, each_set, table_of};
use adjsplat::error::Result;
use adjsplat_study::baselines::Method;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries, Stroke};
use adjsplat_study::speed;
use adjsplat_study::speed::{Speed, SpeedOptions};

/// Measure frames per second of all methods over a full turn (the paper's Table 1 and Figure 5)
#[derive(Debug, Args)]
#[command(
    after_help = "Displaying: the whole frame. Not displaying: all but the drawing of splats. The walk alone: see also adj study walk.\nOne thread; all methods feed one splatter, but ours feeds the renderer, which skips what is occluded.\n\nExample: adj study speed head.adj --plot speed.svg"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    methods: MethodArguments,
    /// Frames of a turn, 1 to 3600; by default 36, with --quick 2
    #[arg(long, value_name = "N", value_parser = number(1..=3600u32))]
    frames: Option<u32>,
    /// Columns and rows of the picture, 1 to 16384 each
    #[arg(long, value_name = "WxH", default_value = "300x300", value_parser = picture_size)]
    size: [u32; 2],
    /// Draw time against splats into this file, as in the paper's Figure 5; --plot draws time by set
    #[arg(long, value_name = "FILE.svg|FILE.png")]
    figure5: Vec<PathBuf>,
    #[command(flatten)]
    sets: SetArguments,
    #[command(flatten)]
    output: OutputArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let methods = arguments.methods.chosen();
    let frames = arguments.frames.unwrap_or(if arguments.sets.quick { 2 } else { 36 });
    let options = SpeedOptions { size: arguments.size, frames, elevation: 20.0, fov: 30.0, methods: methods.clone() };
    arguments.output.check(arguments.sets.files(), &[("--figure5", &arguments.figure5)])?;
    check_plots(&arguments.figure5)?;
    let mut report = table_of(
        "set method projection displaying visible_voxels splats fps ms ns_per_visible walk_ns_per_visible build_ms \
         pictures_xxh3",
    );
    let mut names = Vec::new();
    let mut all: Vec<(f64, Vec<Speed>)> = Vec::new();
    each_set(&arguments.sets, arguments.sets.list()?, arguments.output.quiet, |subject, go_on| {
        let found = speed::measure(subject, &options, go_on)?;
        let visible = subject.voxels.len() as f64;
        for speed in &found {
            for (displaying, seconds) in [(true, speed.displaying), (false, speed.non_displaying)] {
                let pictures = displaying.then(|| format!("{:016x}", speed.pictures));
                report.push(vec![
                    subject.name.as_str().into(),
                    speed.method.name().into(),
                    if speed.perspective { "perspective" } else { "parallel" }.into(),
                    displaying.into(),
                    (subject.voxels.len() as u64).into(),
                    speed.splats.into(),
                    (1.0 / seconds).into(),
                    (1e3 * seconds).into(),
                    (1e9 * seconds / visible).into(),
                    (1e9 * speed.walk / visible).into(),
                    (1e3 * speed.build).into(),
                    pictures.as_deref().into(),
                ]);
            }
        }
        names.push(subject.name.clone());
        all.push((visible, found));
        Ok(())
    })?;
    let shown = table(&names, &all);
    arguments.output.write(&report, &by_set(&methods, names, &all))?;
    write_plots(&arguments.figure5, &figure5(&methods, all))?;
    print_result(&shown);
    Ok(Answer::Yes)
}

/// Returns a table with a row for each set and method; methods with equal pictures have the same letter.
fn table(names: &[String], all: &[(f64, Vec<Speed>)]) -> String {
    let mut report = table_of(
        "set method splats fps fps_not_displaying walk_ns perspective_fps not_displaying perspective_walk_ns picture",
    );
    for (name, (visible, found)) in names.iter().zip(all) {
        let mut pictures: Vec<u64> = Vec::new();
        for pair in found.chunks_exact(2) {
            let [parallel, perspective] = [&pair[0], &pair[1]];
            // The hash combines both turns: methods agree only if all their pictures do.
            let both = parallel.pictures ^ perspective.pictures.rotate_left(32);
            let kind = pictures.iter().position(|picture| *picture == both).unwrap_or_else(|| {
                pictures.push(both);
                pictures.len() - 1
            });
            let letter = char::from(b'A' + u8::try_from(kind).unwrap_or(25).min(25));
            let mut row = vec![name.as_str().into(), parallel.method.name().into(), parallel.splats.into()];
            for speed in [parallel, perspective] {
                row.push((1.0 / speed.displaying).into());
                row.push((1.0 / speed.non_displaying).into());
                row.push((1e9 * speed.walk / visible).into());
            }
            row.push(letter.to_string().as_str().into());
            report.push(row);
        }
    }
    format!("{}\nPictures of one set with the same letter are equal, bit for bit, in all frames.", report.table(&[]))
}

/// Plots the time per voxel of every method's frames without drawing, in parallel views: the cost of the structure
/// alone.
fn by_set(methods: &[Method], names: Vec<String>, all: &[(f64, Vec<Speed>)]) -> Plot {
    let series = methods.iter().map(|&method| {
        let points = (1u32..).zip(all).filter_map(|(position, (visible, found))| {
            let speed = found.iter().find(|speed| speed.method == method && !speed.perspective)?;
            Some([f64::from(position), 1e9 * speed.non_displaying / visible])
        });
        PlotSeries::solid(method.name(), points.collect())
    });
    Plot {
        title: "Not displaying: everything but the drawing of splats, parallel views".into(),
        x: PlotAxis::named("", names),
        y: PlotAxis::logarithmic("nanoseconds a visible voxel"),
        series: series.collect(),
    }
}

/// The methods of Figure 5: the paper's and ours.
const FIGURE_5: [Method; 6] =
    [Method::Adjsplat, Method::Traditional, Method::Unordered, Method::Octree, Method::AdjacencyA, Method::AdjacencyB];

/// Plots the time of a frame against its number of splats, displaying (solid) and not displaying (dashed), for parallel
/// views.
fn figure5(methods: &[Method], mut all: Vec<(f64, Vec<Speed>)>) -> Plot {
    all.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let mut series = Vec::new();
    for (stroke, seconds) in [
        (Stroke::Solid, (|speed| speed.displaying) as fn(&Speed) -> f64),
        (Stroke::Dashed, |speed| speed.non_displaying),
    ] {
        for &method in methods.iter().filter(|method| FIGURE_5.contains(method)) {
            let points = all.iter().filter_map(|(visible, found)| {
                let speed = found.iter().find(|speed| speed.method == method && !speed.perspective)?;
                Some([*visible, seconds(speed)])
            });
            series.push(PlotSeries { stroke, ..PlotSeries::solid(method.name(), points.collect()) });
        }
    }
    Plot {
        title: "Seconds a frame by splats: displaying (solid), not displaying (dashed)".into(),
        x: PlotAxis::logarithmic("visible voxels"),
        y: PlotAxis::logarithmic("seconds a frame"),
        series,
    }
}
