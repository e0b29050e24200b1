//! `adj study memory`: measures the memory of every method, as in the paper's Table 3.

use clap::Args;

use super::super::{Answer, print_result};
use super::output::OutputArguments;
use super::sets::{SetArguments, SetChoice};
use super::{MethodArguments, each_set, table_of};
use adjsplat::error::Result;
use adjsplat_study::baselines::Method;
use adjsplat_study::memory;
use adjsplat_study::memory::{Crossing, TABLE_3, break_even, crossover, formula};
use adjsplat_study::report::Report;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};

/// Measure the memory of every method (the paper's Table 3), and where the paper's two structures take the same
#[derive(Debug, Args)]
#[command(
    after_help = "Bytes are what is allocated between frames. The paper's own formulas stand beside those of its methods.\n\nExample: adj study memory head.adj --json memory.json --plot memory.svg"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    methods: MethodArguments,
    #[command(flatten)]
    sets: SetArguments,
    #[command(flatten)]
    output: OutputArguments,
}

/// Fractions of visible voxels in the noise volumes, around the fraction at which A and B take the same memory.
const SHARES: [f64; 8] = [0.02, 0.06, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3];

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let methods = arguments.methods.chosen();
    arguments.output.check(arguments.sets.files(), &[])?;
    let mut report =
        table_of("set method visible_voxels bytes bytes_per_visible scratch_bytes formula_bytes times_ours");
    each_set(&arguments.sets, arguments.sets.list()?, arguments.output.quiet, |subject, go_on| {
        let found = memory::measure(subject, &methods)?;
        let visible = subject.voxels.len() as u64;
        let ours = found.iter().find(|memory| memory.name == Method::Adjsplat.name()).map(|memory| memory.bytes);
        for memory in &found {
            report.push(vec![
                subject.name.as_str().into(),
                memory.name.into(),
                visible.into(),
                memory.bytes.into(),
                (memory.bytes as f64 / visible as f64).into(),
                memory.scratch.into(),
                memory.formula.into(),
                ours.map(|ours| memory.bytes as f64 / ours as f64).into(),
            ]);
        }
        let _ = go_on(1, 1);
        Ok(())
    })?;
    let edge = if arguments.sets.quick { 24 } else { 128 };
    let noise: Vec<SetChoice> = SHARES.map(|share| SetChoice::Noise { share, edge }).to_vec();
    let mut crossings = Vec::new();
    let mut ours = Vec::new();
    each_set(&arguments.sets, noise, arguments.output.quiet, |subject, _| {
        let found = memory::crossing(subject)?;
        let lanes = memory::measure(subject, &[Method::Adjsplat])?;
        ours.push([found.share, lanes[0].bytes as f64 / subject.facts.grid.points() as f64]);
        crossings.push((found, subject.facts.grid.points() as f64));
        Ok(())
    })?;
    arguments.output.write(&report, &plot(&crossings, ours))?;
    let met = crossover(&crossings.iter().map(|(crossing, _)| *crossing).collect::<Vec<_>>());
    let met = met.map_or("do not meet in these".to_owned(), |share| format!("meet at {:.1} %", 100.0 * share));
    print_result(&format!(
        "{}\nThe paper's Table 3, from its own formulas and counts (2^20 bytes):\n\n{}\n\
         A and B, as built of noise of {edge}^3, {met} of the cells in the structure.\n\
         By the paper's text (47 bytes a record) that is {:.1} %; by its Table 2 (59) {:.1} %, which is what it states.",
        report.table(&[]).trim_end(),
        table_3().table(&[]),
        100.0 * break_even(47.0),
        100.0 * break_even(59.0),
    ));
    Ok(Answer::Yes)
}

/// Returns the figures of the paper's Table 3 beside the results of its formulas.
fn table_3() -> Report {
    let mut report = Report::new(&["set", "share_percent", "method", "paper", "formula", "formula_with_59"]);
    let methods = [Method::Traditional, Method::AdjacencyA, Method::AdjacencyB];
    for set in &TABLE_3 {
        let cells: f64 = set.dims.iter().map(|&points| f64::from(points) + 2.0).product();
        for (method, paper) in methods.into_iter().zip(set.megabytes) {
            let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
            let with_59 = (method == Method::AdjacencyB).then(|| mebibytes(59 * set.structure));
            report.push(vec![
                set.name.into(),
                (100.0 * set.structure as f64 / cells).into(),
                method.name().into(),
                paper.into(),
                formula(method, set.dims, set.structure).map(mebibytes).into(),
                with_59.into(),
            ]);
        }
    }
    report
}

/// Plots bytes per grid point against the share of cells that hold a visible or virtual voxel.
fn plot(crossings: &[(Crossing, f64)], ours: Vec<[f64; 2]>) -> Plot {
    let line = |name: &str, bytes: fn(&Crossing) -> u64| {
        PlotSeries::solid(name, crossings.iter().map(|(c, points)| [c.share, bytes(c) as f64 / points]).collect())
    };
    let traditional = crossings.iter().map(|(c, _)| [c.share, 17.0]).collect();
    Plot {
        title: "Memory of noise, as allocated".into(),
        x: PlotAxis::linear("share of cells in the structure, visible and virtual"),
        y: PlotAxis::linear("bytes a grid point"),
        series: vec![
            PlotSeries::solid("adjsplat, three lanes", ours),
            PlotSeries::solid("traditional", traditional),
            line("adjacency A", |c| c.a),
            line("adjacency B", |c| c.b),
        ],
    }
}
