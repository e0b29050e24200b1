//! `adj study cache`: what walks ask of a memory hierarchy.

use std::hint::black_box;
use std::io::BufWriter;
use std::path::PathBuf;

use clap::Args;

use super::super::progress::interrupted;
use super::super::{Answer, print_result};
use super::output::{OutputArguments, check_plots, write_plots};
use super::sets::SetArguments;
use super::{GoOn, choose, each_set, for_flag, orders};
use adjsplat::arena::{OwnedLane, TileOrder};
use adjsplat::error::{Error, Result};
use adjsplat::file::{check_writable, write_atomically_unless};
use adjsplat::traverse::Order;
use adjsplat_study::Subject;
use adjsplat_study::baselines::{BuiltMethod, Method, Receiver, Viewing, Walker};
use adjsplat_study::cache::counters;
use adjsplat_study::cache::{CacheFigures, Geometry, TraceWriter, measure};
use adjsplat_study::lane_walk::{CodesRead, OwnWalk, repacked};
use adjsplat_study::receive::VoxelSum;
use adjsplat_study::report::plot::{Plot, PlotAxis, PlotSeries};
use adjsplat_study::report::{Report, ReportCell};
use adjsplat_study::speed::summed;
use adjsplat_study::trace::{Trace, WalkerArray};

/// Count cache misses of every walk in a model that is the same on every machine.
#[derive(Debug, Args)]
#[command(
    after_help = "Misses are lines that come into a level, by visible voxel; \"compulsory\" are the lines that the bytes which the walk uses would fill. Each walk starts with empty caches. The table sums up the orders; --json and --csv have every one.\n\nExamples:\n  adj study cache head.adj --methods adjsplat,bricks,adjacency_b --plot misses.svg\n  adj study cache head.adj --methods adjsplat --orders +z+y+x --trace walk.trace"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    sets: SetArguments,
    /// Methods, with commas between; all unless given.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    methods: Vec<String>,
    /// Orders of parallel views: how many of the 48 (7 have every nesting), all, or names such as +z-y+x (slow z up, medium y down, fast x up).
    #[arg(long, value_name = "all|N|NAMES", default_value = "7", allow_hyphen_values = true)]
    orders: String,
    /// What our walk reads of a voxel beside its steps: steps, value or value+normal, with commas between.
    #[arg(long, value_name = "CHANNELS", value_delimiter = ',', default_value = "value+normal")]
    channels: Vec<String>,
    /// Tile orders of our lanes: morton, hilbert, rows, with commas between.
    #[arg(long, value_name = "ORDERS", value_delimiter = ',', default_value = "morton")]
    tile_order: Vec<String>,
    /// Size and ways of the first level.
    #[arg(long, value_name = "SIZE/WAYS", default_value = "32KiB/8", help_heading = "Caches")]
    l1: String,
    /// Of the second; none to leave out.
    #[arg(long, value_name = "SIZE/WAYS", default_value = "1MiB/16", help_heading = "Caches")]
    l2: String,
    /// Of the third; none to leave out.
    #[arg(long, value_name = "SIZE/WAYS", default_value = "8MiB/16", help_heading = "Caches")]
    l3: String,
    /// Bytes of a line.
    #[arg(long, value_name = "BYTES", default_value_t = 64, help_heading = "Caches")]
    line: u64,
    /// Translations of 4 KiB pages, nearest first, with commas between.
    #[arg(
        long,
        value_name = "PAGES/WAYS",
        value_delimiter = ',',
        default_value = "64/full,1536/12",
        help_heading = "Caches"
    )]
    tlb: Vec<String>,
    /// Draw the miss ratios of fully associative caches of every size, of each method's worst order.
    #[arg(long, value_name = "FILE.svg|FILE.png", help_heading = "Results")]
    curves: Vec<PathBuf>,
    /// Write the accesses of the walk to this file (formats/adj-trace-1.md); for one set, method and order.
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Count the walk with the machine's own counters too, through perf; for one set, method and order.
    #[arg(long)]
    counters: bool,
    /// Walk this often, measure nothing, and say how many voxels were visited: for counters and cachegrind.
    #[arg(long, value_name = "N", hide = true)]
    walks: Option<u32>,
    #[command(flatten)]
    output: OutputArguments,
}

/// Walks that counters count at once.
const COUNTED_WALKS: u32 = 16;

/// A structure that is measured, and what tables call it.
struct Measured<'a> {
    layout: String,
    codes: Option<CodesRead>,
    walker: Structure<'a>,
}

enum Structure<'a> {
    Own(OwnWalk<'a>),
    Other(BuiltMethod<'a>),
}

impl Walker for Structure<'_> {
    fn method(&self) -> &'static str {
        match self {
            Structure::Own(walker) => walker.method(),
            Structure::Other(walker) => walker.method(),
        }
    }

    fn arrays(&self) -> Vec<WalkerArray> {
        match self {
            Structure::Own(walker) => walker.arrays(),
            Structure::Other(walker) => walker.arrays(),
        }
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        match self {
            Structure::Own(walker) => walker.walk(viewing, receiver, trace),
            Structure::Other(walker) => walker.walk(viewing, receiver, trace),
        }
    }
}

/// What was asked for.
struct Wanted {
    methods: Vec<Method>,
    orders: Vec<Order>,
    codes: Vec<CodesRead>,
    tile_orders: Vec<TileOrder>,
    geometry: Geometry,
}

impl Arguments {
    fn wanted(&self) -> Result<Wanted> {
        let levels: Vec<String> =
            [&self.l1, &self.l2, &self.l3].into_iter().filter(|level| *level != "none").cloned().collect();
        Ok(Wanted {
            methods: choose(&self.methods)?,
            orders: orders::parse(&self.orders)?,
            codes: for_flag("--channels", self.channels.iter().map(|name| CodesRead::named(name)).collect())?,
            tile_orders: self.tile_order.iter().map(|name| TileOrder::from_name(name)).collect::<Result<_>>()?,
            geometry: Geometry::parse(self.line, &levels, &self.tlb)?,
        })
    }

    /// The one method and order that some flags are for.
    fn only(&self, wanted: &Wanted) -> Result<(Method, Viewing)> {
        match (&wanted.methods[..], &wanted.orders[..], self.sets.list()?.len(), wanted.codes.len()) {
            (&[method], &[order], 1, 1) if wanted.tile_orders.len() == 1 => Ok((method, Viewing::along(order))),
            _ => {
                let why = "need one set, one method and one order: phantom:gyroid --methods adjsplat --orders +z+y+x";
                Err(Error::input("--trace, --counters and --walks", why))
            }
        }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let wanted = arguments.wanted()?;
    if let Some(times) = arguments.walks {
        return only_walk(arguments, &wanted, times);
    }
    if arguments.trace.is_some() || arguments.counters {
        arguments.only(&wanted)?;
    }
    arguments.output.check()?;
    check_plots(&arguments.curves)?;
    arguments.trace.as_deref().map_or(Ok(()), check_writable)?;

    let mut found = Found::new(&wanted.geometry);
    each_set(&arguments.sets, arguments.output.quiet, |subject, go_on| {
        sound(subject)?;
        let repacked: Vec<[OwnedLane; 3]> = lanes_to_repack(subject, &wanted);
        let count = measured_count(&wanted);
        let mut done = 0;
        for index in 0..count {
            let mut measured = structure(subject, &wanted, &repacked, index)?;
            study(subject, &wanted, &mut measured, &mut found, &mut |more, of| {
                done = index as u64 * of + more;
                go_on(done, count as u64 * of)
            })?;
            if let Some(path) = &arguments.trace {
                let viewing = Viewing::along(wanted.orders[0]);
                write_atomically_unless(&interrupted, path, |out| {
                    let mut out = BufWriter::new(out);
                    let mut writer = TraceWriter::new(&mut out, &measured.walker.arrays())?;
                    measured.walker.walk(&viewing, &mut VoxelSum::default(), &mut writer);
                    writer.finish()?;
                    std::io::Write::flush(&mut out)
                })?;
            }
        }
        Ok(())
    })?;
    let summary = found.summary();
    arguments.output.write(&found.report, &found.plot())?;
    write_plots(&arguments.curves, &found.curves())?;
    print_result(&format!("{}\n{}\n{}", summary.table(&[]), found.reuse.table(&[]), counters_line(arguments)));
    Ok(Answer::Yes)
}

/// Ours repacked, for each tile order but the subject's own, which needs nothing.
fn lanes_to_repack(subject: &Subject, wanted: &Wanted) -> Vec<[OwnedLane; 3]> {
    if !wanted.methods.contains(&Method::Adjsplat) {
        return Vec::new();
    }
    wanted.tile_orders.iter().map(|&tile_order| repacked(subject, tile_order)).collect()
}

/// Structures that are measured of each set.
fn measured_count(wanted: &Wanted) -> usize {
    let own = wanted.methods.iter().filter(|method| **method == Method::Adjsplat).count();
    own * wanted.tile_orders.len() * wanted.codes.len() + wanted.methods.len() - own
}

/// Structure number `index` of `subject`: each method in turn, ours in every form.
fn structure<'a>(
    subject: &'a Subject<'a>,
    wanted: &Wanted,
    lanes: &'a [[OwnedLane; 3]],
    index: usize,
) -> Result<Measured<'a>> {
    let forms = wanted.tile_orders.len() * wanted.codes.len();
    let mut left = index;
    for &method in &wanted.methods {
        if method != Method::Adjsplat {
            if left == 0 {
                let layout = method.name().to_owned();
                return Ok(Measured { layout, codes: None, walker: Structure::Other(method.build(subject)?) });
            }
            left -= 1;
        } else if left < forms {
            let (tile_order, codes) = (left / wanted.codes.len(), wanted.codes[left % wanted.codes.len()]);
            let layout = match wanted.tile_orders[tile_order] {
                TileOrder::Morton => method.name().to_owned(),
                other => format!("{}-{}", method.name(), other.name()),
            };
            let views = lanes[tile_order].each_ref().map(OwnedLane::view);
            return Ok(Measured { layout, codes: Some(codes), walker: Structure::Own(OwnWalk::new(views, codes)) });
        } else {
            left -= forms;
        }
    }
    unreachable!("there are {} structures", measured_count(wanted))
}

/// Measures one structure in every order; the worst once more, with distances.
fn study(subject: &Subject, wanted: &Wanted, measured: &mut Measured, found: &mut Found, go_on: GoOn) -> Result<()> {
    let total = wanted.orders.len() as u64 + 1;
    let mut of_orders = Vec::new();
    for (index, order) in wanted.orders.iter().enumerate() {
        let (figures, visited) = measure(&mut measured.walker, &Viewing::along(*order), &wanted.geometry, false);
        debug_assert_eq!(visited, subject.voxels.len() as u64, "{} visits each voxel once", measured.layout);
        of_orders.push((orders::name(order), figures));
        if go_on(index as u64 + 1, total).is_break() {
            return Err(Error::Interrupted);
        }
    }
    let first_misses = |figures: &CacheFigures| figures.levels.first().map_or(figures.touches, |level| level.all);
    let worst = (0..of_orders.len()).max_by_key(|&index| first_misses(&of_orders[index].1)).unwrap_or(0);
    let (with_reuse, _) = measure(&mut measured.walker, &Viewing::along(wanted.orders[worst]), &wanted.geometry, true);
    of_orders[worst].1 = with_reuse;
    found.add(subject, measured, &of_orders, worst);
    Ok(())
}

/// Refuses lanes that are not sound: their walk would not be the walk.
fn sound(subject: &Subject) -> Result<()> {
    let fault = |fault| Error::Format { path: PathBuf::from(&subject.name), fault };
    subject.lanes.arena().check().map(drop).map_err(fault)
}

/// Bytes that are read before a walk whose misses are counted elsewhere: more than any cache but the last holds.
const SWEPT_BYTES: usize = 64 << 20;

/// Walks without measuring, from caches that hold nothing of the structure.
fn only_walk(arguments: &Arguments, wanted: &Wanted, times: u32) -> Result<Answer> {
    let (method, viewing) = arguments.only(wanted)?;
    each_set(&arguments.sets, true, |subject, _| {
        sound(subject)?;
        let mut built = method.build(subject)?;
        let swept = vec![1u8; SWEPT_BYTES];
        black_box(black_box(&swept).iter().step_by(16).map(|&byte| u64::from(byte)).sum::<u64>());
        let visited: u64 = (0..times).map(|_| summed(subject, &mut built, &viewing).count).sum();
        print_result(&format!("{visited} voxels visited"));
        Ok(())
    })?;
    Ok(Answer::Yes)
}

/// What the machine's own counters say, or why they say nothing.
fn counters_line(arguments: &Arguments) -> String {
    let absent = |why: String| format!("hardware counters: absent: {why}");
    if !arguments.counters {
        return match counters::count(&["true".into()]) {
            Ok(_) => "hardware counters: there; --counters asks them".to_owned(),
            Err(why) => absent(why),
        };
    }
    let Ok(program) = std::env::current_exe() else { return absent("the program does not find itself".into()) };
    let counted = |times: u32| {
        let mut command = vec![program.clone().into_os_string()];
        command.extend(std::env::args_os().skip(1).filter(|word| word != "--counters"));
        command.push(format!("--walks={times}").into());
        counters::count(&command)
    };
    match (counted(COUNTED_WALKS), counted(0)) {
        (Ok(with), Ok(without)) => {
            let part = |&(event, count): &(&str, u64)| {
                let other = without.iter().find(|(name, _)| *name == event).map_or(0, |(_, count)| *count);
                format!("{event} {}", count.saturating_sub(other) / u64::from(COUNTED_WALKS))
            };
            let parts: Vec<String> = with.iter().map(part).collect();
            format!("hardware counters, a walk (mean of {COUNTED_WALKS}): {}", parts.join(", "))
        }
        (Err(why), _) | (_, Err(why)) => absent(why),
    }
}

/// What was found so far.
struct Found {
    levels: Vec<String>,
    report: Report,
    /// How lines come again, of each structure's worst order.
    reuse: Report,
    sums: Vec<SumOfOrders>,
    curves: Vec<(String, String, Vec<f64>)>,
}

/// A structure of a set at one level, over the orders.
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

impl Found {
    fn new(geometry: &Geometry) -> Found {
        let level = |index: usize| format!("L{}", index + 1);
        Found {
            levels: (0..geometry.levels.len()).map(level).collect(),
            report: Report::new(&[
                "set",
                "method",
                "layout",
                "channels",
                "order",
                "level",
                "visible_voxels",
                "misses",
                "misses_per_visible",
                "structure_misses_per_visible",
                "compulsory_per_visible",
                "times_compulsory",
                "overfetch",
                "cold",
                "capacity",
                "conflict",
                "accesses",
                "pages_4k",
                "pages_2m",
            ]),
            reuse: Report::new(&[
                "set",
                "layout",
                "channels",
                "order",
                "used_bytes_per_visible",
                "lines_per_1k_touches",
                "lines_per_64k_touches",
                "lines_in_all",
                "l1_cold",
                "l1_capacity",
                "l1_conflict",
                "tlb_misses_per_1k_visible",
                "pages_4k",
                "pages_2m",
            ]),
            sums: Vec::new(),
            curves: Vec::new(),
        }
    }

    fn add(&mut self, subject: &Subject, measured: &Measured, of_orders: &[(String, CacheFigures)], worst: usize) {
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
                let split = |count: u64| figures.reuse.as_ref().map(|_| count);
                let compulsory = figures.compulsory_lines() as f64;
                self.report.push(vec![
                    subject.name.as_str().into(),
                    measured.walker.method().into(),
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
                    split(level_misses.cold).into(),
                    split(level_misses.capacity).into(),
                    split(level_misses.conflict).into(),
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

    /// Means and worst cases over the orders.
    fn summary(&self) -> Report {
        let mut report = Report::new(&[
            "set",
            "layout",
            "channels",
            "level",
            "compulsory_per_visible",
            "misses_mean",
            "misses_worst",
            "worst_order",
            "times_compulsory_mean",
            "times_compulsory_worst",
            "overfetch_worst",
        ]);
        let mean = |numbers: &[f64]| numbers.iter().sum::<f64>() / numbers.len().max(1) as f64;
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

    /// Misses a visible voxel of each structure: geometric means over sets of means over orders.
    fn plot(&self) -> Plot {
        let mut names: Vec<&str> = Vec::new();
        for sum in &self.sums {
            if !names.contains(&sum.layout.as_str()) {
                names.push(&sum.layout);
            }
        }
        let mean = |of: &dyn Fn(&SumOfOrders) -> f64, level: usize| -> Vec<[f64; 2]> {
            let of_layout = |name: &str| {
                let logarithms: Vec<f64> =
                    self.sums.iter().filter(|s| s.layout == name && s.level == level).map(|s| of(s).ln()).collect();
                (logarithms.iter().sum::<f64>() / logarithms.len().max(1) as f64).exp()
            };
            names.iter().enumerate().map(|(index, name)| [index as f64 + 1.0, of_layout(name)]).collect()
        };
        let average = |numbers: &[f64]| numbers.iter().sum::<f64>() / numbers.len().max(1) as f64;
        let misses = |sum: &SumOfOrders| average(&sum.misses) / sum.visible;
        let least = |sum: &SumOfOrders| average(&sum.compulsory) / sum.visible;
        let mut series: Vec<PlotSeries> = (0..self.levels.len())
            .map(|level| PlotSeries::solid(self.levels[level].clone(), mean(&misses, level)))
            .collect();
        series.push(PlotSeries::dashed("compulsory", mean(&least, 0)));
        Plot {
            title: "Cache misses: mean over orders".into(),
            x: PlotAxis::named("", names.into_iter().map(str::to_owned).collect()),
            y: PlotAxis::logarithmic("misses a visible voxel"),
            series,
        }
    }

    /// Miss ratios by size, of each structure's worst order.
    fn curves(&self) -> Plot {
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
