//! Makes the tables and plots of `adj study cache`.

use super::cache::Measured;
use super::table_of;
use adjsplat_study::Subject;
use adjsplat_study::cache::{CacheFigures, Geometry};
use adjsplat_study::lane_walk::CodesRead;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};
use adjsplat_study::report::{Report, ReportCell};

/// Tables of the sets that were measured so far.
pub(super) struct CacheTables {
    levels: Vec<String>,
    pub(super) report: Report,
    /// How soon cache lines are used again, in each structure's worst order.
    pub(super) reuse: Report,
    sums: Vec<SumOfOrders>,
    curves: Vec<(String, String, Vec<f64>)>,
}

/// Figures of one structure of a set at one cache level; each list has an entry for each order.
struct SumOfOrders {
    set: String,
    layout: String,
    channels: ReportCell,
    level: usize,
    visible: f64,
    compulsory: Vec<f64>,
    misses: Vec<f64>,
    overfetch: Vec<f64>,
    worst_order: String,
}

impl CacheTables {
    pub(super) fn new(geometry: &Geometry) -> CacheTables {
        let level = |index: usize| format!("L{}", index + 1);
        CacheTables {
            levels: (0..geometry.levels.len()).map(level).collect(),
            report: table_of(
                "set method layout channels order level visible_voxels misses misses_per_visible \
                 structure_misses_per_visible compulsory_per_visible times_compulsory overfetch cold capacity \
                 conflict accesses pages_4k pages_2m",
            ),
            reuse: table_of(
                "set layout channels order used_bytes_per_visible lines_per_1k_touches lines_per_64k_touches \
                 lines_in_all l1_cold l1_capacity l1_conflict tlb_misses_per_1k_visible pages_4k pages_2m",
            ),
            sums: Vec::new(),
            curves: Vec::new(),
        }
    }

    pub(super) fn add(
        &mut self,
        subject: &Subject,
        measured: &Measured,
        of_orders: &[(String, CacheFigures)],
        worst: usize,
    ) {
        let visible = subject.voxels.len().max(1) as f64;
        let channels: ReportCell = measured.codes.map(CodesRead::name).into();
        for (index, level) in self.levels.iter().enumerate() {
            let of_level = |of: fn(&CacheFigures, usize) -> f64| -> Vec<f64> {
                of_orders.iter().map(|(_, figures)| of(figures, index)).collect()
            };
            let misses = of_level(|figures, level| figures.levels[level].all as f64);
            let most = (0..misses.len()).max_by(|&a, &b| misses[a].total_cmp(&misses[b])).unwrap_or(0);
            self.sums.push(SumOfOrders {
                set: subject.name.clone(),
                layout: measured.layout.clone(),
                channels: channels.clone(),
                level: index,
                visible,
                compulsory: of_level(|figures, _| figures.compulsory_lines() as f64),
                overfetch: of_level(CacheFigures::overfetch),
                misses,
                worst_order: of_orders[most].0.clone(),
            });
            for (order, figures) in of_orders {
                let CacheFigures { accesses, pages, large_pages, .. } = *figures;
                let level_misses = figures.levels[index];
                let of_kind = |count: u64| figures.reuse.as_ref().map(|_| count);
                let compulsory = figures.compulsory_lines() as f64;
                self.report.push(vec![
                    subject.name.as_str().into(),
                    measured.method.name().into(),
                    measured.layout.as_str().into(),
                    channels.clone(),
                    order.as_str().into(),
                    level.as_str().into(),
                    (subject.voxels.len() as u64).into(),
                    level_misses.all.into(),
                    (level_misses.all as f64 / visible).into(),
                    (level_misses.structure as f64 / visible).into(),
                    (compulsory / visible).into(),
                    (level_misses.all as f64 / compulsory).into(),
                    figures.overfetch(index).into(),
                    of_kind(level_misses.cold).into(),
                    of_kind(level_misses.capacity).into(),
                    of_kind(level_misses.conflict).into(),
                    accesses.into(),
                    pages.into(),
                    large_pages.into(),
                ]);
            }
        }
        let (order, figures) = &of_orders[worst];
        let Some(reuse) = &figures.reuse else { return };
        let first = figures.levels.first().copied().unwrap_or_default();
        self.reuse.push(vec![
            subject.name.as_str().into(),
            measured.layout.as_str().into(),
            channels,
            order.as_str().into(),
            (figures.used_bytes as f64 / visible).into(),
            reuse.working_set(10).into(),
            reuse.working_set(16).into(),
            reuse.distinct.into(),
            first.cold.into(),
            first.capacity.into(),
            first.conflict.into(),
            figures.translation.first().map(|&misses| 1000.0 * misses as f64 / visible).into(),
            figures.pages.into(),
            figures.large_pages.into(),
        ]);
        let name = match measured.codes {
            Some(codes) if codes != CodesRead::ValuesAndNormals => format!("{}, {}", measured.layout, codes.name()),
            _ => measured.layout.clone(),
        };
        self.curves.push((subject.name.clone(), name, reuse.miss_ratios()));
    }

    /// Returns a table of the mean and the worst number of cache misses over all orders of the walk.
    pub(super) fn summary(&self) -> Report {
        let mut report = table_of(
            "set layout channels level compulsory_per_visible misses_mean misses_worst worst_order \
             times_compulsory_mean times_compulsory_worst overfetch_worst",
        );
        let worst = |numbers: &[f64]| numbers.iter().copied().fold(0.0, f64::max);
        for sum in &self.sums {
            let times: Vec<f64> =
                sum.misses.iter().zip(&sum.compulsory).map(|(misses, least)| misses / least).collect();
            report.push(vec![
                sum.set.as_str().into(),
                sum.layout.as_str().into(),
                sum.channels.clone(),
                self.levels[sum.level].as_str().into(),
                (mean(&sum.compulsory) / sum.visible).into(),
                (mean(&sum.misses) / sum.visible).into(),
                (worst(&sum.misses) / sum.visible).into(),
                sum.worst_order.as_str().into(),
                mean(&times).into(),
                worst(&times).into(),
                worst(&sum.overfetch).into(),
            ]);
        }
        report
    }

    /// Plots misses per visible voxel of each structure: geometric means over sets of means over orders.
    pub(super) fn plot(&self) -> Plot {
        let mut names: Vec<&str> = Vec::new();
        for sum in &self.sums {
            if !names.contains(&sum.layout.as_str()) {
                names.push(&sum.layout);
            }
        }
        let by_layout = |of: &dyn Fn(&SumOfOrders) -> f64, level: usize| -> Vec<[f64; 2]> {
            let of_layout = |name: &str| {
                let logarithms: Vec<f64> =
                    self.sums.iter().filter(|s| s.layout == name && s.level == level).map(|s| of(s).ln()).collect();
                (logarithms.iter().sum::<f64>() / logarithms.len().max(1) as f64).exp()
            };
            names.iter().enumerate().map(|(index, name)| [index as f64 + 1.0, of_layout(name)]).collect()
        };
        let misses = |sum: &SumOfOrders| mean(&sum.misses) / sum.visible;
        let least = |sum: &SumOfOrders| mean(&sum.compulsory) / sum.visible;
        let mut series: Vec<PlotSeries> = (0..self.levels.len())
            .map(|level| PlotSeries::solid(self.levels[level].clone(), by_layout(&misses, level)))
            .collect();
        series.push(PlotSeries::dashed("compulsory", by_layout(&least, 0)));
        Plot {
            title: "Cache misses: mean over orders".into(),
            x: PlotAxis::named("", names.into_iter().map(str::to_owned).collect()),
            y: PlotAxis::logarithmic("misses a visible voxel"),
            series,
        }
    }

    /// Plots miss ratios by cache size, in each structure's worst order.
    pub(super) fn curves(&self) -> Plot {
        let several = self.curves.iter().any(|(set, ..)| *set != self.curves[0].0);
        let series = self.curves.iter().map(|(set, name, ratios)| {
            let name = if several { format!("{name}, {set}") } else { name.clone() };
            let points = ratios.iter().enumerate().map(|(power, &ratio)| [(1u64 << power) as f64, ratio]);
            PlotSeries::solid(name, points.collect())
        });
        Plot {
            title: "Miss ratio of fully associative caches".into(),
            x: PlotAxis::logarithmic("lines"),
            y: PlotAxis::logarithmic("misses a touch"),
            series: series.collect(),
        }
    }
}

fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len().max(1) as f64
}
