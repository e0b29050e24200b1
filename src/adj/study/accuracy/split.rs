//! `--model`: splits the error into three parts: of the model, of the order, of the arithmetic.

use super::super::super::Answer;
use super::super::super::resources::processors;
use super::super::table_of;
use super::{Arguments, bounds};
use adjsplat::error::Result;
use adjsplat::splat::Quality;
use adjsplat_study::accuracy::model::{ErrorPart, measure};
use adjsplat_study::accuracy::{Candidate, views};
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let presets = [(Quality::Draft, 8), (Quality::Standard, 8), (Quality::High, 16), (Quality::Reference, 16)]
        .map(|(quality, bits)| Candidate::preset(quality, bits));
    let threads = processors();
    let sets = arguments.sets.with_edge(if arguments.sets.quick { 24 } else { 40 });
    let mut report = table_of("set view part quality settings psnr ssim flip max_abs rmse");
    let mut series: Vec<PlotSeries> = Vec::new();
    let mut labels = Vec::new();
    arguments.each_judged(&sets, false, |set, go_on| {
        let (low, high) = bounds(set.judge, set.name)?;
        let views = views(set.judge.visible().grid(), low, high, arguments.sets.quick)?;
        let mut last = None;
        for share in measure(set, &views, &presets, threads, go_on)? {
            let view = views[share.view].name;
            if last != Some(share.view) {
                labels.push(format!("{}, {view}", set.name));
                last = Some(share.view);
            }
            let candidate = share.candidate.map(|index| &presets[index]);
            let quality = candidate.map_or("", Candidate::quality_name);
            if share.part != ErrorPart::All && share.metrics.psnr.is_finite() {
                let name = format!("{} {quality}", share.part.name());
                PlotSeries::add_point(&mut series, name.trim_end(), [labels.len() as f64, share.metrics.psnr]);
            }
            let metrics = share.metrics;
            report.push(vec![
                set.name.into(),
                view.into(),
                share.part.name().into(),
                quality.into(),
                candidate.map_or(String::new(), Candidate::settings_text).as_str().into(),
                metrics.psnr.into(),
                metrics.ssim.into(),
                metrics.flip.into(),
                metrics.max_abs.into(),
                metrics.rmse.into(),
            ]);
        }
        Ok(())
    })?;
    let plot = Plot {
        title: "The error in three: model, order, arithmetic of the presets".into(),
        x: PlotAxis::named("", labels),
        y: PlotAxis::linear("PSNR, dB"),
        series,
    };
    arguments.output.finish(&report, &plot, &["set", "view", "part", "quality", "psnr", "ssim", "max_abs"])
}
