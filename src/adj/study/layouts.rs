//! `adj study layouts`: compares other memory layouts of lanes (all scan lines along one axis) with ours.

use std::hint::black_box;
use std::time::Instant;

use clap::Args;

use super::super::Answer;
use super::super::values::{choice, library, number};
use super::orders::Orders;
use super::output::OutputArguments;
use super::sets::SetArguments;
use super::{CODES, each_set, orders, table_of};
use adjsplat::error::Result;
use adjsplat::traverse::Order;
use adjsplat_study::baselines::{Structure, Viewing, Walker as _};
use adjsplat_study::cache::{Geometry, measure};
use adjsplat_study::lane_walk::CodesRead;
use adjsplat_study::layouts::{LaneLayout, LayoutWalk};
use adjsplat_study::report::ReportCell;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};
use adjsplat_study::{GoOn, Subject, report_step};

/// Compare other layouts of the file with ours: bytes, cache misses, time of a walk
#[derive(Debug, Args)]
#[command(
    after_help = "A layout's name: tile edge, tile order, arrays or interleaved records, bytes of a line record, payload in each lane (own) or once (shared), lanes. The first is ours. Times are of a plain walk, alike for all, and not of the walk that pictures are made with.\n\nExample: adj study layouts head.adj --orders 12"
)]
pub(super) struct Arguments {
    /// Orders in which parallel views visit voxels: a number of the 48, all, or names with commas between;
    /// +z-y+x is z ascending (slowest), y descending, x ascending (fastest)
    #[arg(long, value_name = "all|N|NAMES", default_value = "7", allow_hyphen_values = true, value_parser = library(orders::parse))]
    orders: Orders,
    /// What a walk reads of each voxel
    #[arg(long, value_name = "CHANNELS", default_value = "value+normal", value_parser = choice(CODES))]
    channels: CodesRead,
    /// Walks of each layout in each order, 1 to 1000; the fastest counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = number(1..=1000u32))]
    repetitions: u32,
    #[command(flatten)]
    sets: SetArguments,
    #[command(flatten)]
    output: OutputArguments,
}

/// Measurements of one layout.
#[derive(Default)]
struct LayoutFigures {
    bytes: u64,
    /// For each order, the misses of three cache levels and of the first translation buffer (TLB).
    misses: Vec<[u64; 4]>,
    /// For each order, the nanoseconds of a walk.
    ns: Vec<f64>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let Orders(orders) = &arguments.orders;
    arguments.output.check(arguments.sets.files(), &[])?;
    let mut report = table_of(
        "set layout bytes_per_visible exact_orders l1_mean l1_worst l2_mean l2_worst l3_mean tlb_mean ns_mean \
         ns_worst times_bytes times_l1 times_l2 times_ns",
    );
    let mut series: Vec<PlotSeries> = Vec::new();
    each_set(&arguments.sets, arguments.sets.list()?, arguments.output.quiet, |subject, go_on| {
        let layouts = LaneLayout::studied(subject.dims());
        let found = measure_all(subject, &layouts, arguments.channels, orders, arguments.repetitions, go_on)?;
        for (layout, one) in layouts.iter().zip(&found) {
            report.push(row(subject, layout, one, &found[0], orders));
        }
        let visible = subject.voxels.len() as f64;
        let points = found.iter().map(|one| [one.bytes as f64 / visible, mean(one, 1) / visible]).collect();
        series.push(PlotSeries::solid(subject.name.clone(), points));
        Ok(())
    })?;
    let plot = Plot {
        title: "Layouts of lanes".into(),
        x: PlotAxis::linear("bytes a visible voxel"),
        y: PlotAxis::linear("misses of the second level a visible voxel"),
        series,
    };
    arguments.output.finish(&report, &plot, &[])
}

/// Returns the mean, over the orders, of the misses at `level`.
fn mean(found: &LayoutFigures, level: usize) -> f64 {
    found.misses.iter().map(|misses| misses[level] as f64).sum::<f64>() / found.misses.len().max(1) as f64
}

fn row(
    subject: &Subject,
    layout: &LaneLayout,
    found: &LayoutFigures,
    ours: &LayoutFigures,
    orders: &[Order],
) -> Vec<ReportCell> {
    let visible = subject.voxels.len() as f64;
    let worst = |level: usize| found.misses.iter().map(|misses| misses[level]).max().unwrap_or(0) as f64;
    let time = |found: &LayoutFigures| found.ns.iter().sum::<f64>() / found.ns.len().max(1) as f64;
    let exact = orders.iter().filter(|order| layout.nested(order) == **order).count() as u64;
    vec![
        subject.name.as_str().into(),
        layout.name().as_str().into(),
        (found.bytes as f64 / visible).into(),
        exact.into(),
        (mean(found, 0) / visible).into(),
        (worst(0) / visible).into(),
        (mean(found, 1) / visible).into(),
        (worst(1) / visible).into(),
        (mean(found, 2) / visible).into(),
        (mean(found, 3) / visible).into(),
        (time(found) / visible).into(),
        (found.ns.iter().copied().fold(0.0, f64::max) / visible).into(),
        (found.bytes as f64 / ours.bytes as f64).into(),
        (mean(found, 0) / mean(ours, 0)).into(),
        (mean(found, 1) / mean(ours, 1)).into(),
        (time(found) / time(ours)).into(),
    ]
}

/// Measures misses of each layout, then times; in each order the layouts take turns.
fn measure_all(
    subject: &Subject,
    layouts: &[LaneLayout],
    codes: CodesRead,
    orders: &[Order],
    repetitions: u32,
    go_on: GoOn,
) -> Result<Vec<LayoutFigures>> {
    let geometry = Geometry::default();
    let mut walks: Vec<Structure> = Vec::new();
    for &layout in layouts {
        walks.push(Structure::Layout(LayoutWalk::new(subject, layout, codes)?));
    }
    let mut found: Vec<LayoutFigures> =
        walks.iter().map(|walk| LayoutFigures { bytes: walk.bytes(), ..LayoutFigures::default() }).collect();
    for (index, order) in orders.iter().enumerate() {
        let viewing = Viewing::along(*order);
        for (walk, found) in walks.iter_mut().zip(&mut found) {
            let (figures, _) = measure(walk, &viewing, &geometry, false);
            let [first, second, third] = [0, 1, 2].map(|level| figures.levels[level].all);
            found.misses.push([first, second, third, figures.translation[0]]);
        }
        let mut fastest = vec![f64::INFINITY; walks.len()];
        for _ in 0..repetitions {
            for (walk, fastest) in walks.iter_mut().zip(&mut fastest) {
                let start = Instant::now();
                black_box(walk.summed(&viewing));
                *fastest = fastest.min(start.elapsed().as_secs_f64() * 1e9);
            }
        }
        for (found, ns) in found.iter_mut().zip(fastest) {
            found.ns.push(ns);
        }
        report_step(go_on, index as u64 + 1, orders.len() as u64)?;
    }
    Ok(found)
}
