//! `adj study walk`: nanoseconds a voxel in all orders.

use clap::Args;

use super::super::{Answer, print_result};
use super::output::OutputArguments;
use super::sets::SetArguments;
use super::{choose, each_set};
use adjsplat::error::{Error, Result};
use adjsplat_study::baselines::Method;
use adjsplat_study::report::Report;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};
use adjsplat_study::walks;
use adjsplat_study::walks::{Reading, Walks};

/// Time the walks alone, in each of the 48 orders of parallel views, on one thread.
#[derive(Debug, Args)]
#[command(
    after_help = "Each figure is nanoseconds a visible voxel, the fastest of the repetitions.\n\nExample: adj study walk head.adj --methods adjsplat,bricks,adjacency_b"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    sets: SetArguments,
    /// Methods, with commas between; all unless given.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    methods: Vec<String>,
    /// Walks of each method in each order, of which the fastest counts.
    #[arg(long, value_name = "N", default_value_t = 3)]
    repetitions: u32,
    /// What is read of each voxel and added up: everything is its coordinates, value and normal.
    #[arg(long, value_name = "WHAT", value_parser = ["everything", "coordinates"], default_value = "everything")]
    read: String,
    #[command(flatten)]
    output: OutputArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let methods = choose(&arguments.methods)?;
    if !(1..=1000).contains(&arguments.repetitions) {
        return Err(Error::input("--repetitions", format!("are {}, but must be 1 to 1000", arguments.repetitions)));
    }
    arguments.output.check()?;
    let mut report =
        Report::new(&["set", "method", "visible_voxels", "ns_geometric_mean", "ns_median", "ns_worst", "times_ours"]);
    let mut names = Vec::new();
    let mut series: Vec<PlotSeries> =
        methods.iter().map(|method| PlotSeries::solid(method.name(), Vec::new())).collect();
    let reading = if arguments.read == "coordinates" { Reading::Coordinates } else { Reading::Everything };
    let stride = if arguments.sets.quick { 7 } else { 1 };
    each_set(&arguments.sets, arguments.output.quiet, |subject, go_on| {
        let found = walks::measure(subject, &methods, stride, arguments.repetitions, reading, go_on)?;
        let ours = found.iter().find(|walks| walks.method == Method::Adjsplat).map(Walks::geometric_mean);
        names.push(subject.name.clone());
        for (walks, series) in found.iter().zip(&mut series) {
            series.points.push([names.len() as f64, walks.geometric_mean()]);
            report.push(vec![
                subject.name.as_str().into(),
                walks.method.name().into(),
                (subject.voxels.len() as u64).into(),
                walks.geometric_mean().into(),
                walks.median().into(),
                walks.worst().into(),
                ours.map(|ours| walks.geometric_mean() / ours).into(),
            ]);
        }
        Ok(())
    })?;
    let plot = Plot {
        title: "Walking: geometric mean over the orders".into(),
        x: PlotAxis::named("", names),
        y: PlotAxis::logarithmic("nanoseconds a visible voxel"),
        series,
    };
    arguments.output.write(&report, &plot)?;
    print_result(report.table(&[]).trim_end());
    Ok(Answer::Yes)
}
