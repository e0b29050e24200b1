//! `adj study cache`: counts cache misses of walks, in a model.

use std::hint::black_box;
use std::io::BufWriter;
use std::path::PathBuf;

use clap::Args;

use super::super::build::TILE_ORDERS;
use super::super::progress::interrupted;
use super::super::values::{choice, library};
use super::super::{Answer, print_result};
use super::cache_tables::CacheTables;
use super::orders::{Orders, name as order_name, parse as parse_orders};
use super::output::{OutputArguments, check_plots, write_plots};
use super::sets::SetArguments;
use super::{CODES, MethodArguments, each_set};
use adjsplat::arena::{OwnedLane, TileOrder};
use adjsplat::error::{Error, Result};
use adjsplat::file::write_atomically_unless;
use adjsplat::traverse::Order;
use adjsplat_study::baselines::{Method, Structure, Viewing, Walker as _};
use adjsplat_study::cache::counters;
use adjsplat_study::cache::{CacheFigures, Geometry, TraceWriter, measure};
use adjsplat_study::lane_walk::{CodesRead, OwnWalk, repacked};
use adjsplat_study::{GoOn, Subject, report_step};

/// Count the cache misses of every method, in a model that is the same on every machine
#[derive(Debug, Args)]
#[command(
    after_help = "Misses are lines loaded into a level, per visible voxel; \"compulsory\" is the number of lines that the used bytes would fill. Each walk starts with empty caches. The table sums up the orders; --json and --csv have every one.\n\nExamples:\n  adj study cache head.adj --methods adjsplat,bricks,adjacency_b --plot misses.svg\n  adj study cache head.adj --methods adjsplat --orders +z+y+x --trace walk.trace"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    methods: MethodArguments,
    /// Orders in which parallel views visit voxels: a number of the 48, all, or names with commas between;
    /// +z-y+x is z ascending (slowest), y descending, x ascending (fastest)
    #[arg(long, value_name = "all|N|NAMES", default_value = "7", allow_hyphen_values = true, value_parser = library(parse_orders))]
    orders: Orders,
    /// What our walk reads of each voxel, with commas between
    #[arg(long, value_name = "CHANNELS", value_delimiter = ',', default_value = "value+normal", value_parser = choice(CODES))]
    channels: Vec<CodesRead>,
    /// Orders of the tiles (8 x 8 scan lines) in our file, with commas between
    #[arg(long, value_name = "ORDERS", value_delimiter = ',', default_value = "morton", value_parser = choice(TILE_ORDERS))]
    tile_order: Vec<TileOrder>,
    /// Size and ways of the first level; none to leave it out
    #[arg(long, value_name = "SIZE/WAYS", default_value = "32KiB/8", help_heading = "Caches")]
    l1: String,
    /// Size and ways of the second level; none to leave it out
    #[arg(long, value_name = "SIZE/WAYS", default_value = "1MiB/16", help_heading = "Caches")]
    l2: String,
    /// Size and ways of the third level; none to leave it out
    #[arg(long, value_name = "SIZE/WAYS", default_value = "8MiB/16", help_heading = "Caches")]
    l3: String,
    /// Bytes of a cache line: a power of two from 16 to 4096
    #[arg(long, value_name = "BYTES", default_value_t = 64, help_heading = "Caches")]
    line: u64,
    /// Levels of the TLB (address translations of 4 KiB pages), nearest first, with commas between
    #[arg(
        long,
        value_name = "PAGES/WAYS",
        value_delimiter = ',',
        default_value = "64/full,1536/12",
        help_heading = "Caches"
    )]
    tlb: Vec<String>,
    /// Draw into this file the miss ratios of fully associative caches of every size, in each method's worst order
    #[arg(long, value_name = "FILE.svg|FILE.png", help_heading = "Results")]
    curves: Vec<PathBuf>,
    /// Write the memory accesses of one set, method and order to this file (formats/adj-trace-1.md)
    #[arg(long, value_name = "FILE")]
    trace: Option<PathBuf>,
    /// Count one set, method and order with the machine's own counters too, through perf
    #[arg(long)]
    counters: bool,
    /// Walk this often without measuring, and print how many voxels were visited: for counters and cachegrind
    #[arg(long, value_name = "N", hide = true)]
    walks: Option<u32>,
    #[command(flatten)]
    sets: SetArguments,
    #[command(flatten)]
    output: OutputArguments,
}

/// Number of walks in one run under the machine's counters.
const COUNTED_WALKS: u32 = 16;

/// A structure to measure, with its name in tables.
pub(super) struct Measured<'a> {
    pub(super) method: Method,
    pub(super) layout: String,
    pub(super) codes: Option<CodesRead>,
    pub(super) walk: Structure<'a>,
}

impl Arguments {
    fn geometry(&self) -> Result<Geometry> {
        let levels: Vec<String> =
            [&self.l1, &self.l2, &self.l3].into_iter().filter(|level| *level != "none").cloned().collect();
        Geometry::parse(self.line, &levels, &self.tlb)
    }

    /// Returns the only method and order to measure, which some flags need; fails if there are several.
    fn only(&self) -> Result<(Method, Viewing)> {
        match (&self.structures()[..], &self.orders.0[..], self.sets.list()?.len()) {
            (&[(method, _)], &[order], 1) => Ok((method, Viewing::along(order))),
            _ => {
                let why = "need one set, one method and one order: phantom:gyroid --methods adjsplat --orders +z+y+x";
                Err(Error::input("--trace and --counters", why))
            }
        }
    }

    /// Lists the structures to measure: each method once, and ours with each tile order and each choice of codes to
    /// read.
    fn structures(&self) -> Vec<(Method, Option<(TileOrder, CodesRead)>)> {
        let forms = |&tile_order| self.channels.iter().map(move |&codes| Some((tile_order, codes)));
        let of_method = |method| match method {
            Method::Adjsplat => self.tile_order.iter().flat_map(forms).map(|form| (method, form)).collect(),
            _ => vec![(method, None)],
        };
        self.methods.chosen().into_iter().flat_map(of_method).collect()
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    let geometry = arguments.geometry()?;
    if let Some(times) = arguments.walks {
        return only_walk(arguments, times);
    }
    if arguments.trace.is_some() || arguments.counters {
        arguments.only()?;
    }
    let more = [("--curves", arguments.curves.as_slice()), ("--trace", arguments.trace.as_slice())];
    arguments.output.check(arguments.sets.files(), &more)?;
    check_plots(&arguments.curves)?;

    let mut tables = CacheTables::new(&geometry);
    let structures = arguments.structures();
    each_set(&arguments.sets, arguments.sets.list()?, arguments.output.quiet, |subject, go_on| {
        sound(subject)?;
        for (index, &(method, form)) in structures.iter().enumerate() {
            let lanes;
            let mut measured = match form {
                Some((tile_order, codes)) => {
                    lanes = repacked(subject, tile_order);
                    let layout = match tile_order {
                        TileOrder::Morton => method.name().to_owned(),
                        TileOrder::Hilbert | TileOrder::Rows => format!("{}-{}", method.name(), tile_order.name()),
                    };
                    let walk = OwnWalk::new(lanes.each_ref().map(OwnedLane::view), codes);
                    Measured { method, layout, codes: Some(codes), walk: Structure::OwnWalk(walk) }
                }
                None => {
                    let walk = method.build(subject)?;
                    Measured { method, layout: method.name().to_owned(), codes: None, walk }
                }
            };
            study(subject, &arguments.orders.0, &geometry, &mut measured, &mut tables, &mut |done, total| {
                go_on(index as u64 * total + done, structures.len() as u64 * total)
            })?;
            if let Some(path) = &arguments.trace {
                let viewing = Viewing::along(arguments.orders.0[0]);
                write_atomically_unless(&interrupted, path, |out| {
                    let mut out = BufWriter::new(out);
                    let mut writer = TraceWriter::new(&mut out, &measured.walk.arrays())?;
                    measured.walk.traced(&viewing, &mut writer);
                    writer.finish()?;
                    std::io::Write::flush(&mut out)
                })?;
            }
        }
        Ok(())
    })?;
    let summary = tables.summary();
    arguments.output.write(&tables.report, &tables.plot())?;
    write_plots(&arguments.curves, &tables.curves())?;
    print_result(&format!("{}\n{}\n{}", summary.table(&[]), tables.reuse.table(&[]), counters_line(arguments)));
    Ok(Answer::Yes)
}

/// Measures one structure in every order, and the worst order once more with reuse distances.
fn study(
    subject: &Subject,
    orders: &[Order],
    geometry: &Geometry,
    measured: &mut Measured,
    tables: &mut CacheTables,
    go_on: GoOn,
) -> Result<()> {
    let total = orders.len() as u64 + 1;
    let mut of_orders = Vec::new();
    for (index, order) in orders.iter().enumerate() {
        let (figures, visited) = measure(&mut measured.walk, &Viewing::along(*order), geometry, false);
        debug_assert_eq!(visited, subject.voxels.len() as u64, "{} visits each voxel once", measured.layout);
        of_orders.push((order_name(order), figures));
        report_step(go_on, index as u64 + 1, total)?;
    }
    let first_misses = |figures: &CacheFigures| figures.levels.first().map_or(figures.touches, |level| level.all);
    let worst = (0..of_orders.len()).max_by_key(|&index| first_misses(&of_orders[index].1)).unwrap_or(0);
    let (with_reuse, _) = measure(&mut measured.walk, &Viewing::along(orders[worst]), geometry, true);
    of_orders[worst].1 = with_reuse;
    tables.add(subject, measured, &of_orders, worst);
    Ok(())
}

/// Checks that the lanes are valid: walks of damaged lanes would differ.
fn sound(subject: &Subject) -> Result<()> {
    let fault = |fault| Error::Format { path: PathBuf::from(&subject.name), fault };
    subject.lanes.arena().check().map(drop).map_err(fault)
}

/// Bytes to read before a walk whose misses other tools count: more than fits any cache but the last one.
const SWEPT_BYTES: usize = 64 << 20;

/// Walks `times` times without measuring, after reading other memory so that the caches do not hold the structure.
fn only_walk(arguments: &Arguments, times: u32) -> Result<Answer> {
    let (method, viewing) = arguments.only()?;
    each_set(&arguments.sets, arguments.sets.list()?, true, |subject, _| {
        sound(subject)?;
        let mut walk = method.build(subject)?;
        let swept = vec![1u8; SWEPT_BYTES];
        black_box(black_box(&swept).iter().step_by(16).map(|&byte| u64::from(byte)).sum::<u64>());
        let visited: u64 = (0..times).map(|_| walk.summed(&viewing).count).sum();
        print_result(&format!("{visited} voxels visited"));
        Ok(())
    })?;
    Ok(Answer::Yes)
}

/// Returns a line with the figures of the machine's own counters, or with the reason why there are none.
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
            let per_walk = |&(event, count): &(&str, u64)| {
                let empty = without.iter().find(|(name, _)| *name == event).map_or(0, |(_, count)| *count);
                format!("{event} {}", count.saturating_sub(empty) / u64::from(COUNTED_WALKS))
            };
            let parts: Vec<String> = with.iter().map(per_walk).collect();
            format!("hardware counters, a walk (mean of {COUNTED_WALKS}): {}", parts.join(", "))
        }
        (Err(why), _) | (_, Err(why)) => absent(why),
    }
}
