//! `--popping`: how much pictures jump where the order of voxels switches.

use super::super::super::Answer;
use super::super::super::resources::processors;
use super::super::table_of;
use super::Arguments;
use adjsplat::error::Result;
use adjsplat::splat::Quality;
use adjsplat_study::accuracy::Candidate;
use adjsplat_study::accuracy::popping::{STEPS, measure};
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let presets = [Candidate::preset(Quality::Standard, 8), Candidate::preset(Quality::High, 16)];
    let threads = processors();
    let mut report = table_of(
        "set azimuth across step_degrees drawer max_abs rms sorted_max_abs sorted_rms popping_max_abs popping_rms",
    );
    let mut series: Vec<PlotSeries> = Vec::new();
    let mut names = Vec::new();
    arguments.each_judged(&arguments.sets, false, |set, go_on| {
        names.push(set.name.to_owned());
        for found in measure(set, &presets, threads, go_on)? {
            let excess = found.found.largest - found.sorted.largest;
            if found.across && found.step == STEPS[STEPS.len() - 1] {
                PlotSeries::add_point(&mut series, &found.drawer, [names.len() as f64, excess.max(0.0)]);
            }
            report.push(vec![
                set.name.into(),
                found.azimuth.into(),
                found.across.into(),
                found.step.into(),
                found.drawer.as_str().into(),
                found.found.largest.into(),
                found.found.rms.into(),
                found.sorted.largest.into(),
                found.sorted.rms.into(),
                excess.into(),
                (found.found.rms - found.sorted.rms).into(),
            ]);
        }
        Ok(())
    })?;
    let plot = Plot {
        title: "Popping: largest change as the slow axis switches, less that of sorted splats".into(),
        x: PlotAxis::named("", names),
        y: PlotAxis::linear("of full scale"),
        series,
    };
    arguments.output.finish(&report, &plot, &[])
}
