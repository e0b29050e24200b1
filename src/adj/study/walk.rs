//! `adj study walk`: measures nanoseconds per voxel in all orders of parallel views, or in perspective.

use clap::Args;

use super::super::Answer;
use super::super::values::{choice, number};
use super::output::OutputArguments;
use super::sets::SetArguments;
use super::{MethodArguments, each_set, table_of};
use adjsplat::error::Result;
use adjsplat_study::baselines::Method;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};
use adjsplat_study::walks;
use adjsplat_study::walks::{Reading, Views, Walks};

/// Time how long reading all visible voxels takes, in each of the 48 orders of parallel views or in perspective, on one
/// thread
#[derive(Debug, Args)]
#[command(
    after_help = "Times are nanoseconds per visible voxel, the fastest of the repetitions.\n\nExample: adj study walk head.adj --methods adjsplat,bricks,adjacency_b"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    methods: MethodArguments,
    /// Views to walk in
    #[arg(long, value_name = "WHICH", default_value = "parallel", value_parser = choice(VIEWS))]
    views: Views,
    /// Walks of each method in each view, 1 to 1000; the fastest counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = number(1..=1000u32))]
    repetitions: u32,
    /// What to read of each voxel
    #[arg(long, value_name = "WHAT", default_value = "everything", value_parser = choice(READINGS))]
    read: Reading,
    #[command(flatten)]
    sets: SetArguments,
    #[command(flatten)]
    output: OutputArguments,
}

const VIEWS: [(&str, Views, &str); 3] = [
    ("parallel", Views::Parallel, "The 48 orders of parallel views"),
    ("outside", Views::Outside, "36 perspective views of a turn around the volume"),
    ("inside", Views::Inside, "12 perspective views from an eye near the centre"),
];

const READINGS: [(&str, Reading, &str); 2] = [
    ("everything", Reading::Everything, "Coordinates, value and normal"),
    ("coordinates", Reading::Coordinates, "Coordinates alone"),
];

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let methods = arguments.methods.chosen();
    arguments.output.check(arguments.sets.files(), &[])?;
    let mut report = table_of("set method visible_voxels ns_geometric_mean ns_median ns_worst times_ours");
    let mut names = Vec::new();
    let mut series: Vec<PlotSeries> =
        methods.iter().map(|method| PlotSeries::solid(method.name(), Vec::new())).collect();
    let stride = if arguments.sets.quick { 7 } else { 1 };
    each_set(&arguments.sets, arguments.sets.list()?, arguments.output.quiet, |subject, go_on| {
        let Arguments { views, repetitions, read, .. } = *arguments;
        let found = walks::measure(subject, &methods, views, stride, repetitions, read, go_on)?;
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
        title: "Walking: geometric mean over the views".into(),
        x: PlotAxis::named("", names),
        y: PlotAxis::logarithmic("nanoseconds a visible voxel"),
        series,
    };
    arguments.output.finish(&report, &plot, &[])
}
