//! `adj study accuracy`: measures how much error each gain of speed costs.

mod popping;
mod split;
mod trade;

use clap::Args;

use super::super::classification::ClassificationArguments;
use super::super::progress::{Progress, interrupted};
use super::super::values::{Word, choice, number};
use super::super::{Answer, starts_as_adj};
use super::output::OutputArguments;
use super::sets::{Set, SetArguments, SetChoice, SetInput, SetVolume};
use adjsplat::arena::LaneSet;
use adjsplat::error::{Error, Result};
use adjsplat_judge::reference::Judge;
use adjsplat_study::GoOn;
use adjsplat_study::accuracy::{Family, JudgedSet, StoredFile};

/// Measure what each setting of the renderer saves in time and costs in error, against a reference in double precision
#[derive(Debug, Args)]
#[command(
    after_help = "Sets are volumes (the flags say what is visible) and phantoms: the reference needs the volume, which .adj files do not hold. Errors are of linear premultiplied samples.\nThe last rows are over all sets: times are geometric means, errors the worst. \"front\": no other candidate is both faster and more exact.\n\nExamples:\n  adj study accuracy head.nii.gz --range 60.. --plot accuracy.svg --json accuracy.json\n  adj study accuracy head.nii.gz --iso 60 --popping\n  adj study accuracy phantom:gyroid --model --quick"
)]
pub(super) struct Arguments {
    /// Also study the other real volumes in --data: engine, fuel, MR head, T1 brain, orbital, T1 slab, atlas
    #[arg(long, requires = "data")]
    all: bool,
    /// Measure instead how much pictures jump where the order of voxels switches
    #[arg(long, group = "part")]
    popping: bool,
    /// Split the error instead into three parts (model, order, arithmetic); sets of up to 64^3 voxels, phantoms of 40^3
    #[arg(long, group = "part")]
    model: bool,
    /// Settings to try, with commas between; all by default
    #[arg(long, value_name = "FAMILIES", value_delimiter = ',', conflicts_with = "part", value_parser = choice(FAMILIES))]
    families: Vec<Family>,
    /// Rounds of timing, 0 to 1000, of which the fastest counts; 0 measures errors alone.
    /// By default 5, with --quick 1
    #[arg(long, value_name = "N", value_parser = number(0..=1000u32))]
    repetitions: Option<u32>,
    #[command(flatten)]
    sets: SetArguments,
    #[command(flatten)]
    visible: ClassificationArguments,
    #[command(flatten)]
    output: OutputArguments,
}

const FAMILIES: [Word<Family>; 10] = [
    ("presets", Family::Presets, "Draft, standard, high, reference"),
    ("dial", Family::Dial, "What adj render --max-error chooses from"),
    ("kernel", Family::Kernel, "Width and cut-off of splats"),
    ("termination", Family::Termination, "When rays end"),
    ("sampling", Family::Sampling, "How many pixels are drawn"),
    ("codes", Family::Codes, "Bits of values and normals"),
    ("order", Family::Order, "Order of voxels"),
    ("blending", Family::Blending, "How splats cover each other"),
    ("octree", Family::Octree, "Cubes of voxels as one splat"),
    ("combined", Family::Combined, "Several at once"),
];

pub(super) fn run(arguments: &Arguments) -> Result<Answer> {
    arguments.output.check(arguments.sets.files(), &[])?;
    if arguments.popping {
        popping::run(arguments)
    } else if arguments.model {
        split::run(arguments)
    } else {
        trade::run(arguments)
    }
}

impl Arguments {
    /// Calls `study` for one set after another, with its judge and its files.
    fn each_judged(
        &self,
        sets: &SetArguments,
        wants_octree: bool,
        mut study: impl FnMut(&JudgedSet, GoOn) -> Result<()>,
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
            let what = format!("{}/{} {}", index + 1, list.len(), volume.name);
            let stored = files.iter().zip(&lanes);
            let stored = stored.map(|(&([value_bits, normal_bits], ref set), lanes)| StoredFile {
                value_bits,
                normal_bits,
                scene: set.scene(lanes),
            });
            let subject = if wants_octree { Some(files[0].1.subject(&lanes[0])?) } else { None };
            let judged =
                JudgedSet { name: &volume.name, judge: &judge, files: stored.collect(), subject: subject.as_ref() };
            study(&judged, &mut |done, total| progress.show(&what, done, total))?;
        }
        Ok(())
    }
}

fn volume(sets: &SetArguments, wanted: &SetChoice, visible: &ClassificationArguments) -> Result<SetVolume> {
    if interrupted() {
        return Err(Error::Interrupted);
    }
    match sets.read(wanted)? {
        SetInput::Volume(volume) => Ok(volume),
        SetInput::File(path) => {
            std::fs::metadata(&path).map_err(Error::io("open", &path))?;
            if path.is_file() && starts_as_adj(&path)? {
                let why =
                    "is an .adj file, which has no samples to judge pictures by; give the volume it was built from";
                return Err(Error::input(path.display().to_string(), why));
            }
            let unsaid = "say it with --range, --iso, --tf, --levoy or --labels; adj info shows the values of a volume";
            let transfer = visible.transfer(&path)?.ok_or_else(|| Error::input("what is visible", unsaid))?;
            SetVolume::of_file(&path, transfer)
        }
    }
}

/// Builds files with values and normals of 8 and 16 bits; the file with 8 bits for both comes first.
/// Unlit voxels have no normals.
fn files(volume: &mut SetVolume) -> Result<Vec<([u8; 2], Set)>> {
    let channels: &[[u8; 2]] =
        if volume.is_shaded() { &[[8, 8], [16, 16], [16, 8], [8, 16], [8, 0]] } else { &[[8, 8], [16, 16]] };
    channels.iter().map(|&[values, normals]| Ok(([values, normals], volume.build(values, normals)?))).collect()
}

/// Returns the bounds of the visible voxels.
fn bounds(judge: &Judge, name: &str) -> Result<([u16; 3], [u16; 3])> {
    judge.visible().bounds().ok_or_else(|| Error::input(name, "has no visible voxels; there is no picture to compare"))
}
