//! `adj study accuracy`: what speed costs.

mod popping;
mod split;
mod trade;

use clap::Args;

use super::super::classification::ClassificationArguments;
use super::super::progress::{Progress, interrupted};
use super::super::resources::thread_count;
use super::super::{Answer, starts_as_adj};
use super::output::OutputArguments;
use super::sets::{Origin, Set, SetArguments, Unbuilt, Wanted};
use adjsplat::arena::LaneSet;
use adjsplat::error::{Error, Result};
use adjsplat_judge::reference::Judge;
use adjsplat_study::accuracy::{JudgedSet, StoredFile};

/// What every knob of the renderer saves in time and costs in error, beside the judge in double precision.
#[derive(Debug, Args)]
#[command(
    after_help = "Sets are volumes (the flags say what of them is visible) and phantoms: the judge sees samples, which .adj files do not hold. Errors are of linear premultiplied samples.\nThe last rows are over all sets: times are geometric means, errors the worst. \"front\": nothing else is both faster and nearer.\n\nExamples:\n  adj study accuracy head.nii.gz --range 60.. --plot accuracy.svg --json accuracy.json\n  adj study accuracy head.nii.gz --iso 60 --popping\n  adj study accuracy phantom:gyroid --model --quick"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    sets: SetArguments,
    #[command(flatten)]
    visible: ClassificationArguments,
    /// Also the other real volumes in --data: engine, fuel, MR head, T1 brain, orbital, T1 slab, atlas.
    #[arg(long, requires = "data")]
    all: bool,
    /// What pictures jump by where the order of the walk switches, instead.
    #[arg(long, group = "part")]
    popping: bool,
    /// The error in three (model, order, arithmetic), of sets of up to 64^3 points, instead; phantoms of 40^3.
    #[arg(long, group = "part")]
    model: bool,
    /// Which candidates, with commas between: presets, dial, kernel, termination, sampling, codes, order, blending, octree,
    /// combined; all unless given.
    #[arg(long, value_name = "FAMILIES", value_delimiter = ',', conflicts_with = "part")]
    families: Vec<String>,
    /// Rounds of timing, of which the fastest counts; 0 for errors alone. 5 unless given, 1 with --quick.
    #[arg(long, value_name = "N")]
    repetitions: Option<u32>,
    #[command(flatten)]
    output: OutputArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    arguments.output.check()?;
    if arguments.repetitions.is_some_and(|rounds| rounds > 1000) {
        return Err(Error::input("--repetitions", "are more than 1000, which is more than a machine's pace needs"));
    }
    if arguments.popping {
        popping::run(arguments)
    } else if arguments.model {
        split::run(arguments)
    } else {
        trade::run(arguments)
    }
}

impl Arguments {
    /// Calls `study` with one set after another, as its judge and its files see it.
    ///
    /// # Errors
    /// As reading and building a set; [`Error::Input`] for a set without samples; whatever `study` fails with.
    fn each_judged(
        &self,
        sets: &SetArguments,
        wants_octree: bool,
        mut study: impl FnMut(&JudgedSet, &mut dyn FnMut(u64, u64) -> std::ops::ControlFlow<()>) -> Result<()>,
    ) -> Result<()> {
        let mut list = sets.list()?;
        if self.all {
            list.extend(sets.others());
        }
        let mut progress = Progress::new(self.output.quiet);
        for (index, wanted) in list.iter().enumerate() {
            let mut volume = volume(sets, wanted, &self.visible)?;
            let judge = volume.judge()?;
            let files = files(&mut volume)?;
            let lanes = files.iter().map(|(_, set)| set.lanes()).collect::<Result<Vec<LaneSet>>>()?;
            let what = format!("{}/{} {}", index + 1, list.len(), volume.name());
            let stored = files.iter().zip(&lanes);
            let stored = stored.map(|(&([value_bits, normal_bits], ref set), lanes)| StoredFile {
                value_bits,
                normal_bits,
                scene: set.scene(lanes),
            });
            let subject = if wants_octree { Some(files[0].1.subject(&lanes[0])?) } else { None };
            let judged =
                JudgedSet { name: volume.name(), judge: &judge, files: stored.collect(), subject: subject.as_ref() };
            study(&judged, &mut |done, total| {
                progress.show(&what, done, total);
                if interrupted() { std::ops::ControlFlow::Break(()) } else { std::ops::ControlFlow::Continue(()) }
            })?;
        }
        Ok(())
    }

    fn threads(&self) -> Result<usize> {
        thread_count(None)
    }
}

fn volume(sets: &SetArguments, wanted: &Wanted, visible: &ClassificationArguments) -> Result<Unbuilt> {
    if interrupted() {
        return Err(Error::Interrupted);
    }
    match sets.read(wanted)? {
        Origin::Volume(volume) => Ok(volume),
        Origin::File(path) => {
            if path.is_file() && starts_as_adj(&path)? {
                let why =
                    "is an .adj file, which has no samples to judge pictures by; give the volume it was built from";
                return Err(Error::input(path.display().to_string(), why));
            }
            Unbuilt::of_file(&path, visible.required(&path)?)
        }
    }
}

/// Files with values and normals of all numbers of bits, the one with 8 of both first. Voxels that are not lit have no
/// normals, whatever is asked for.
fn files(volume: &mut Unbuilt) -> Result<Vec<([u8; 2], Set)>> {
    let channels: &[[u8; 2]] =
        if volume.is_shaded() { &[[8, 8], [16, 16], [16, 8], [8, 16], [8, 0]] } else { &[[8, 8], [16, 16]] };
    channels.iter().map(|&[values, normals]| Ok(([values, normals], volume.build(values, normals)?))).collect()
}

/// Judges whose set has nothing visible have nothing to show.
fn bounds(judge: &Judge, name: &str) -> Result<([u16; 3], [u16; 3])> {
    judge.visible().bounds().ok_or_else(|| Error::input(name, "has no visible voxels; there is no picture to compare"))
}
