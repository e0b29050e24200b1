//! Time against error: writes the table, the rows and the plot.

use super::super::super::resources::processors;
use super::super::super::{Answer, print_result};
use super::super::table_of;
use super::{Arguments, bounds};
use adjsplat::error::{Error, Result};
use adjsplat::splat::Quality;
use adjsplat_study::accuracy::{
    Candidate, Effort, Family, JudgedView, Outcome, candidates, mark_front, measure, views,
};
use adjsplat_study::report::ReportCell;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};

/// The outcomes (time and error of each candidate in each view) of one set.
struct SetOutcomes {
    name: String,
    voxels: u64,
    views: Vec<JudgedView>,
    /// For each candidate's index in `outcomes`, its index among all candidates.
    candidates: Vec<usize>,
    outcomes: Vec<Outcome>,
}

const COLUMNS: &str = "set visible_voxels view pixels_per_voxel family quality settings value_bits normal_bits ms psnr \
                       ssim flip max_abs rmse front";
const SHOWN: [&str; 9] = ["set", "family", "quality", "settings", "ms", "psnr", "ssim", "max_abs", "front"];

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let quick = arguments.sets.quick;
    let families = &arguments.families;
    let mut all = candidates(quick);
    all.retain(|candidate| families.is_empty() || families.contains(&candidate.family));
    let repetitions = arguments.repetitions.unwrap_or(if quick { 1 } else { 5 });
    if repetitions == 0 && arguments.output.has_plot() {
        let why = "measures no times, which the plot shows; leave out --plot, or give 1 or more";
        return Err(Error::input("--repetitions 0", why));
    }
    let effort = Effort { repetitions, threads: processors() };
    let mut found: Vec<SetOutcomes> = Vec::new();
    arguments.each_judged(&arguments.sets, true, |set, go_on| {
        let (low, high) = bounds(set.judge, set.name)?;
        let views = views(set.judge.visible().grid(), low, high, quick)?;
        let drawn: Vec<usize> = (0..all.len()).filter(|&index| set.can_draw(&all[index])).collect();
        let drawable: Vec<Candidate> = drawn.iter().map(|&index| all[index]).collect();
        let outcomes = measure(set, &views, &drawable, effort, go_on)?;
        let voxels = set.judge.visible().voxels().len() as u64;
        found.push(SetOutcomes { name: set.name.to_owned(), voxels, views, candidates: drawn, outcomes });
        Ok(())
    })?;
    let mut report = table_of(COLUMNS);
    let mut shown = table_of(COLUMNS);
    for set in &found {
        for outcome in &set.outcomes {
            let candidate = &all[set.candidates[outcome.candidate]];
            let row = set.row(candidate, outcome);
            if outcome.view.is_none() && (outcome.front || candidate.quality.is_some()) {
                shown.push(row.clone());
            }
            report.push(row);
        }
    }
    let over_sets = over_sets(&found, all.len());
    let name = format!("all {} sets", found.len());
    let together = SetOutcomes {
        name: name.clone(),
        voxels: found.iter().map(|set| set.voxels).sum(),
        views: Vec::new(),
        candidates: (0..all.len()).collect(),
        outcomes: over_sets,
    };
    for outcome in &together.outcomes {
        let row = together.row(&all[outcome.candidate], outcome);
        shown.push(row.clone());
        if found.len() > 1 {
            report.push(row);
        }
    }
    arguments.output.write(&report, &plot(&all, &together.outcomes, &found))?;
    print_result(shown.table(&SHOWN).trim_end());
    Ok(Answer::Yes)
}

impl SetOutcomes {
    fn row(&self, candidate: &Candidate, outcome: &Outcome) -> Vec<ReportCell> {
        let view = outcome.view.map(|view| &self.views[view]);
        vec![
            self.name.as_str().into(),
            self.voxels.into(),
            view.map_or("all", |view| view.name).into(),
            view.map(|view| view.pixels_per_voxel).into(),
            candidate.family.name().into(),
            candidate.quality_name().into(),
            candidate.settings_text().as_str().into(),
            u64::from(candidate.value_bits).into(),
            u64::from(candidate.normal_bits).into(),
            outcome.milliseconds.into(),
            outcome.psnr.into(),
            outcome.ssim.into(),
            outcome.flip.into(),
            outcome.max_abs.into(),
            outcome.rmse.into(),
            outcome.front.into(),
        ]
    }
}

/// Summarises each candidate that was drawn for all sets: the geometric mean of its times, the worst of its errors.
fn over_sets(found: &[SetOutcomes], count: usize) -> Vec<Outcome> {
    let mut all = Vec::new();
    for candidate in 0..count {
        let of_set = |set: &SetOutcomes| {
            let in_all = |outcome: &&Outcome| outcome.view.is_none() && set.candidates[outcome.candidate] == candidate;
            set.outcomes.iter().find(in_all).copied()
        };
        let Some(outcomes) = found.iter().map(of_set).collect::<Option<Vec<Outcome>>>() else { continue };
        let Some((first, further)) = outcomes.split_first() else { continue };
        let logs: Option<f64> = outcomes.iter().map(|outcome| outcome.milliseconds.map(f64::ln)).sum();
        let milliseconds = logs.map(|sum| (sum / outcomes.len() as f64).exp());
        let mut together = Outcome { candidate, milliseconds, ..*first };
        further.iter().for_each(|outcome| together.worsen(outcome));
        all.push(together);
    }
    mark_front(&mut all);
    all
}

/// Plots time against PSNR over all sets; times are multiples of the time of `standard`.
fn plot(all: &[Candidate], outcomes: &[Outcome], found: &[SetOutcomes]) -> Plot {
    let standard = Candidate::preset(Quality::Standard, 8);
    let unit = outcomes.iter().find(|outcome| all[outcome.candidate] == standard).and_then(|o| o.milliseconds);
    let unit = unit.unwrap_or(1.0);
    let point = |outcome: &Outcome| outcome.milliseconds.map(|ms| [ms / unit, outcome.psnr]);
    let mut series: Vec<PlotSeries> = Vec::new();
    let mut front: Vec<[f64; 2]> = outcomes.iter().filter(|outcome| outcome.front).filter_map(point).collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    series.push(PlotSeries::solid("front", front));
    // The presets are drawn last, on top of the others, but come first in the legend.
    for family in Family::ALL.into_iter().chain([Family::Presets]) {
        let members = outcomes.iter().filter(|outcome| all[outcome.candidate].family == family);
        let timed: Vec<(usize, [f64; 2])> = members.filter_map(|o| Some((o.candidate, point(o)?))).collect();
        let label = |&(candidate, _): &(usize, [f64; 2])| {
            let candidate = &all[candidate];
            candidate
                .quality
                .map_or(String::new(), |_| format!("{}, {} bits", candidate.quality_name(), candidate.value_bits))
        };
        let labels = if family == Family::Presets { timed.iter().map(label).collect() } else { Vec::new() };
        let points: Vec<[f64; 2]> = timed.into_iter().map(|(_, point)| point).collect();
        if !points.is_empty() {
            series.push(PlotSeries { labels, ..PlotSeries::points(family.name(), points) });
        }
    }
    let of = match found {
        [only] => only.name.clone(),
        several => format!("{} sets, worst of all views", several.len()),
    };
    Plot {
        title: format!("What speed costs: {of}"),
        x: PlotAxis::logarithmic("time of a frame, as a multiple of standard's"),
        y: PlotAxis::linear("PSNR against the judge, dB"),
        series,
    }
}
