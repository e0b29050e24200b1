//! The sets (volumes and files) of a study: the paper's volumes, phantoms, and files that the user names.

use std::path::{Path, PathBuf};

use clap::Args;

use self::VisibleValues::{AtLeast, Preset};
use super::super::build::classify_with_warnings;
use super::super::input::phantom;
use super::super::progress::{Progress, stop};
use super::super::resources::processors;
use super::super::stored::stored_transfer;
use super::super::values::number;
use super::super::{print_note, starts_as_adj};
use adjsplat::arena::LaneSet;
use adjsplat::build::{BuildOptions, Resources};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::file::{AdjFile, RowsOutput, open_rows};
use adjsplat::internals::description;
use adjsplat::splat::Scene;
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{SampleType, SlabSource};
use adjsplat_judge::reference::Judge;
use adjsplat_readers::open;
use adjsplat_study::Subject;

/// The flags for which sets to study.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Sets")]
pub(super) struct SetArguments {
    /// .adj files with 8-bit values and normals (study accuracy: volumes), and phantom:NAME.
    /// By default the paper's volumes in --data, and four phantoms
    #[arg(value_name = "SET", help_heading = None)]
    sets: Vec<PathBuf>,
    /// Folder with the real volumes frogtissue, ironProt, headsq-quarter, SAG-anon and carotid
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Voxels along each side of phantoms, 8 to 2048; by default 192, with --quick 48
    #[arg(long, value_name = "N", value_parser = number(8..=2048u16))]
    edge: Option<u16>,
    /// Small phantoms and few views: takes under a minute, to see that everything works
    #[arg(long)]
    pub(super) quick: bool,
}

/// A real volume of a study.
#[derive(Debug)]
pub(super) struct RealVolume {
    name: &'static str,
    path: &'static str,
    visible: VisibleValues,
}

/// Which values of a real volume are visible.
#[derive(Debug)]
enum VisibleValues {
    Preset(&'static str),
    AtLeast(f64),
}

impl VisibleValues {
    fn transfer(&self) -> Result<TransferFunction> {
        match self {
            Preset(name) => TransferFunction::preset(name),
            AtLeast(low) => TransferFunction::range(*low, f64::INFINITY),
        }
    }
}

/// The paper's volumes, or similar ones; their names say which.
const PAPER: [RealVolume; 5] = [
    RealVolume { name: "t1-head (for Jeff)", path: "SAG-anon", visible: AtLeast(250.0) },
    RealVolume { name: "frog", path: "frogtissue/frogtissue.mhd", visible: Preset("frog") },
    RealVolume { name: "ct-head (half size)", path: "headsq-quarter/quarter.nhdr", visible: AtLeast(1150.0) },
    RealVolume { name: "carotid (for abdomen)", path: "carotid/carotid.vtk", visible: AtLeast(150.0) },
    RealVolume { name: "iron protein (half)", path: "ironProt/ironProt.vtk", visible: AtLeast(30.0) },
];

/// Real volumes that are not the paper's.
const OTHER_VOLUMES: [RealVolume; 7] = [
    RealVolume { name: "engine", path: "scivis-engine/engine.nii.gz", visible: AtLeast(60.0) },
    RealVolume { name: "fuel", path: "scivis-fuel/fuel.nii.gz", visible: AtLeast(20.0) },
    RealVolume { name: "mr-head", path: "seg3d-MR/MR.nii.gz", visible: AtLeast(120.0) },
    RealVolume { name: "t1-brain", path: "stroke-T1/T1.nii.gz", visible: AtLeast(150.0) },
    RealVolume { name: "orbital", path: "hydrogen/hydrogen.vti", visible: AtLeast(0.05) },
    RealVolume { name: "t1-slab", path: "nifti-zarr/tests/data/example4d.nii.gz", visible: AtLeast(200.0) },
    RealVolume { name: "atlas", path: "allen-human-atlas/AllenAtlas.nii.gz", visible: Preset("labels") },
];

/// The phantoms (computed volumes) of a study.
const PHANTOMS: [&str; 4] = ["phantom:gyroid", "phantom:shells", "phantom:vessels", "phantom:noise"];

/// An `.adj` file that was built or opened for a study.
pub(super) struct Set {
    /// The set's name in tables.
    pub(super) name: String,
    file: AdjFile,
    transfer: TransferFunction,
}

impl Set {
    /// Returns the set's lanes; those that the file does not store are derived.
    pub(super) fn lanes(&self) -> Result<LaneSet<'_>> {
        Ok(LaneSet::new(self.file.arena()?, None))
    }

    /// Returns the scene that a renderer draws of this set; `lanes` is what [`lanes`](Self::lanes) returned.
    pub(super) fn scene<'a>(&'a self, lanes: &'a LaneSet<'a>) -> Scene<'a> {
        Scene { facts: lanes.arena().facts(), lanes, transfer: &self.transfer }
    }

    /// Returns the set as the subject of a study, which every method is built from.
    pub(super) fn subject<'a>(&self, lanes: &'a LaneSet<'a>) -> Result<Subject<'a>> {
        Subject::new(&self.name, lanes, self.transfer.clone())
    }
}

/// A set as a volume: files are built from it, and the reference renderer draws it.
pub(super) struct SetVolume {
    /// The set's name in tables.
    pub(super) name: String,
    source: Box<dyn SlabSource>,
    transfer: TransferFunction,
    /// Whether slices were read, so that the source must go back to the first slice.
    is_read: bool,
}

impl SetVolume {
    /// Opens the volume at `path`; `transfer` says what is visible.
    pub(super) fn of_file(path: &Path, transfer: TransferFunction) -> Result<SetVolume> {
        let source = open::open(path, &open::OpenOptions::default())?;
        source.notes().iter().for_each(|note| print_note(note));
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(SetVolume { name, source, transfer, is_read: false })
    }

    /// Returns whether the set's voxels are lit and so need normals.
    pub(super) fn is_shaded(&self) -> bool {
        self.transfer.shaded()
    }

    fn restarted(&mut self) -> Result<&mut dyn SlabSource> {
        if std::mem::replace(&mut self.is_read, true) {
            self.source.rewind()?;
        }
        Ok(&mut *self.source)
    }

    /// Returns the reference renderer of the set's samples.
    pub(super) fn judge(&mut self) -> Result<Judge> {
        let transfer = self.transfer.clone();
        Ok(Judge::new(self.restarted()?, &transfer)?.with_stop(stop()))
    }

    /// Builds an `.adj` file of the volume, without a name, in the system's folder for temporary files.
    pub(super) fn build(&mut self, value_bits: u8, normal_bits: u8) -> Result<Set> {
        let (name, transfer) = (self.name.clone(), self.transfer.clone());
        let normal_bits = if transfer.shaded() { normal_bits } else { 0 };
        let options = BuildOptions::new(transfer).with_value_bits(value_bits).with_normal_bits(normal_bits);
        let folder = std::env::temp_dir();
        let resources = Resources { memory: None, threads: processors(), folder: Some(folder.clone()) };
        let source = self.restarted()?;
        let header = source.header().clone();
        let visible = classify_with_warnings(source, &options, &resources, true)?;
        let description = description(&header, &visible)?;
        let output = RowsOutput::of_build(&visible, &description, &options, &resources);
        let file = open_rows(&folder, &visible.rows, &output, &mut Progress::new(true))?;
        Ok(Set { name, file, transfer: visible.transfer.clone() })
    }
}

/// What a set is opened as.
pub(super) enum SetInput {
    /// A volume, whose samples are read.
    Volume(SetVolume),
    /// An `.adj` file that was built before.
    File(PathBuf),
}

impl SetArguments {
    /// Returns the paths of the sets that the user names.
    pub(super) fn files(&self) -> &[PathBuf] {
        &self.sets
    }

    /// Returns these arguments with `edge` as the default of `--edge`.
    pub(super) fn with_edge(&self, edge: u16) -> SetArguments {
        SetArguments { edge: self.edge.or(Some(edge)), ..self.clone() }
    }

    /// Lists the real volumes in --data that are not the paper's; prints a note for each that is missing.
    pub(super) fn others(&self) -> Vec<SetChoice> {
        self.real(&OTHER_VOLUMES)
    }

    fn real(&self, list: &'static [RealVolume]) -> Vec<SetChoice> {
        let Some(data) = &self.data else { return Vec::new() };
        let (there, missing): (Vec<_>, Vec<_>) = list.iter().partition(|real| data.join(real.path).exists());
        for real in missing {
            print_note(&format!("note: no {} in {}; left out", real.path, data.display()));
        }
        there.into_iter().map(SetChoice::Real).collect()
    }

    /// Lists the sets to study.
    pub(super) fn list(&self) -> Result<Vec<SetChoice>> {
        if let Some(data) = &self.data
            && !data.is_dir()
        {
            return Err(Error::input(data.display().to_string(), "is no folder; give --data the one with the volumes"));
        }
        if !self.sets.is_empty() {
            return Ok(self.sets.iter().cloned().map(SetChoice::Named).collect());
        }
        let mut wanted = self.real(&PAPER);
        if self.data.is_none() {
            print_note("note: the paper's sets need --data FOLDER; phantoms only");
        }
        wanted.extend(PHANTOMS.map(|name| SetChoice::Named(PathBuf::from(name))));
        Ok(wanted)
    }

    /// Builds or opens a set, with values and normals of 8 bits.
    pub(super) fn load(&self, wanted: &SetChoice) -> Result<Set> {
        match self.read(wanted)? {
            SetInput::Volume(mut volume) => volume.build(8, 8),
            SetInput::File(path) => opened(&path),
        }
    }

    /// Opens a set: a volume for reading its samples, or the path of an `.adj` file.
    pub(super) fn read(&self, wanted: &SetChoice) -> Result<SetInput> {
        let (name, source, transfer) = match wanted {
            SetChoice::Named(path) => {
                let Some(made_up) = phantom(path)? else { return Ok(SetInput::File(path.clone())) };
                let edge = self.edge.unwrap_or(if self.quick { 48 } else { 192 });
                let (low, high) = made_up.visible_range();
                let source = made_up.open([edge.into(); 3], SampleType::U8, [1.0; 3])?;
                (format!("{} {edge}^3", made_up.name()), source, TransferFunction::range(low, high)?)
            }
            SetChoice::Noise { share, edge } => {
                let noise = Phantom::Noise { visible: *share };
                let source = noise.open([(*edge).into(); 3], SampleType::U8, [1.0; 3])?;
                (format!("noise {:.0} %", 100.0 * share), source, TransferFunction::range(1.0, 255.0)?)
            }
            SetChoice::Real(real) => {
                let folder = self.data.as_deref().unwrap_or(Path::new("."));
                let source = open::open(folder.join(real.path), &open::OpenOptions::default())?;
                (real.name.to_owned(), source, real.visible.transfer()?)
            }
        };
        Ok(SetInput::Volume(SetVolume { name, source, transfer, is_read: false }))
    }
}

/// A set to study.
#[derive(Debug, Clone)]
pub(super) enum SetChoice {
    /// A file or a phantom.
    Named(PathBuf),
    /// A volume in `--data`.
    Real(&'static RealVolume),
    /// A volume of noise in which this share of voxels is visible.
    Noise { share: f64, edge: u16 },
}

fn opened(path: &Path) -> Result<Set> {
    if path.is_file() && !starts_as_adj(path)? {
        let why = "is no .adj file; build one first: adj build VOLUME --range LOW.. -o FILE.adj";
        return Err(Error::input(path.display().to_string(), why));
    }
    let file = AdjFile::open(path)?;
    let transfer = stored_transfer(&file.arena()?, path)?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Set { name, file, transfer })
}
