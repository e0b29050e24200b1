//! The sets of a study: those of the paper, phantoms, and whatever else is named.

use std::path::{Path, PathBuf};

use clap::Args;

use super::super::build::classify_with_warnings;
use super::super::input::phantom;
use super::super::progress::Progress;
use super::super::resources::thread_count;
use super::super::stored::stored_transfer;
use super::super::{print_note, starts_as_adj};
use adjsplat::arena::{LaneSet, TileOrder};
use adjsplat::build::builder::{BuildOptions, Resources};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::file::{AdjFile, RowsOutput, open_rows};
use adjsplat::internals::description;
use adjsplat::splat::Scene;
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{SampleType, SlabSource};
use adjsplat_judge::reference::splat::Judge;
use adjsplat_readers::open;
use adjsplat_study::Subject;

/// What to study.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Sets")]
pub(super) struct SetArguments {
    /// What to study: .adj files with 8-bit values and normals (for accuracy: volumes), and phantom:NAME. The paper's sets, as far as --data has
    /// them, and four phantoms unless given.
    #[arg(value_name = "SET")]
    sets: Vec<PathBuf>,
    /// Folder with the real volumes frogtissue, ironProt, headsq-quarter, SAG-anon and carotid.
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// Points a side of phantoms; 192 unless given, 48 with --quick.
    #[arg(long, value_name = "N")]
    edge: Option<u16>,
    /// Small phantoms and few views: under a minute, to see that everything works; its figures mean little.
    #[arg(long)]
    pub(super) quick: bool,
}

/// A real volume of a study.
struct Real {
    name: &'static str,
    path: &'static str,
    visible: Visible,
}

/// What of it is visible.
enum Visible {
    Preset(&'static str),
    AtLeast(f64),
}

impl Visible {
    fn transfer(&self) -> Result<TransferFunction> {
        match self {
            Visible::Preset(name) => TransferFunction::preset(name),
            Visible::AtLeast(low) => TransferFunction::range(*low, f64::INFINITY),
        }
    }
}

/// The paper's sets, or what stands in for them: names say which.
const PAPER: [Real; 5] = [
    Real { name: "t1-head (for Jeff)", path: "SAG-anon", visible: Visible::AtLeast(250.0) },
    Real { name: "frog", path: "frogtissue/frogtissue.mhd", visible: Visible::Preset("frog") },
    Real { name: "ct-head (half size)", path: "headsq-quarter/quarter.nhdr", visible: Visible::AtLeast(1150.0) },
    Real { name: "carotid (for abdomen)", path: "carotid/carotid.vtk", visible: Visible::AtLeast(150.0) },
    Real { name: "iron protein (half)", path: "ironProt/ironProt.vtk", visible: Visible::AtLeast(30.0) },
];

/// The other real volumes.
const OTHERS: [Real; 7] = [
    Real { name: "engine", path: "scivis-engine/engine.nii.gz", visible: Visible::AtLeast(60.0) },
    Real { name: "fuel", path: "scivis-fuel/fuel.nii.gz", visible: Visible::AtLeast(20.0) },
    Real { name: "mr-head", path: "seg3d-MR/MR.nii.gz", visible: Visible::AtLeast(120.0) },
    Real { name: "t1-brain", path: "stroke-T1/T1.nii.gz", visible: Visible::AtLeast(150.0) },
    Real { name: "orbital", path: "hydrogen/hydrogen.vti", visible: Visible::AtLeast(0.05) },
    Real { name: "t1-slab", path: "nifti-zarr/tests/data/example4d.nii.gz", visible: Visible::AtLeast(200.0) },
    Real { name: "atlas", path: "allen-human-atlas/AllenAtlas.nii.gz", visible: Visible::Preset("labels") },
];

/// Number `index` of the paper's sets and the others.
fn real(index: usize) -> &'static Real {
    PAPER.get(index).unwrap_or_else(|| &OTHERS[index - PAPER.len()])
}

/// Phantoms of a study.
const PHANTOMS: [&str; 4] = ["phantom:gyroid", "phantom:shells", "phantom:vessels", "phantom:noise"];

/// A set that is ready to be studied.
pub(super) struct Set {
    name: String,
    file: AdjFile,
    transfer: TransferFunction,
}

impl Set {
    /// What tables call it.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Its lanes; those that the file does not store are derived.
    pub(super) fn lanes(&self) -> Result<LaneSet<'_>> {
        Ok(LaneSet::new(self.file.arena()?, None))
    }

    /// What a renderer takes, of its `lanes`.
    pub(super) fn scene<'a>(&'a self, lanes: &'a LaneSet<'a>) -> Scene<'a> {
        Scene { facts: lanes.arena().facts(), lanes, transfer: &self.transfer }
    }

    /// What a study takes.
    pub(super) fn subject<'a>(&self, lanes: &'a LaneSet<'a>) -> Result<Subject<'a>> {
        Subject::new(&self.name, lanes, self.transfer.clone())
    }
}

/// A set as it was read: samples, from which files are built and which a judge sees.
pub(super) struct Unbuilt {
    name: String,
    source: Box<dyn SlabSource>,
    transfer: TransferFunction,
    /// Whether slices were read, so that the source must start over.
    is_read: bool,
}

impl Unbuilt {
    /// The volume at `path`, of which `transfer` says what is visible.
    ///
    /// # Errors
    /// As opening it.
    pub(super) fn of_file(path: &Path, transfer: TransferFunction) -> Result<Unbuilt> {
        let source = open::open(path, &open::OpenOptions::default())?;
        source.notes().iter().for_each(|note| print_note(note));
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Unbuilt { name, source, transfer, is_read: false })
    }

    /// What tables call it.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Whether its voxels are lit, and so have normals.
    pub(super) fn is_shaded(&self) -> bool {
        self.transfer.shaded()
    }

    fn restarted(&mut self) -> Result<&mut dyn SlabSource> {
        if std::mem::replace(&mut self.is_read, true) {
            self.source.rewind()?;
        }
        Ok(&mut *self.source)
    }

    /// The judge of its samples.
    ///
    /// # Errors
    /// As [`Judge::new`].
    pub(super) fn judge(&mut self) -> Result<Judge> {
        let transfer = self.transfer.clone();
        Judge::new(self.restarted()?, &transfer)
    }

    /// A file of it, without a name, in the system's folder for temporary files.
    ///
    /// # Errors
    /// As `adj build`.
    pub(super) fn build(&mut self, value_bits: u8, normal_bits: u8) -> Result<Set> {
        let (name, transfer) = (self.name.clone(), self.transfer.clone());
        build(name, self.restarted()?, transfer, value_bits, normal_bits)
    }
}

/// Where a set comes from.
pub(super) enum Origin {
    /// Samples.
    Volume(Unbuilt),
    /// A file that was built before.
    File(PathBuf),
}

impl SetArguments {
    /// The same with phantoms of `edge` points a side, unless the user said how many.
    pub(super) fn with_edge(&self, edge: u16) -> SetArguments {
        SetArguments { edge: self.edge.or(Some(edge)), ..self.clone() }
    }

    /// The real volumes that --data has beside the paper's, and notes of those that it has not.
    pub(super) fn others(&self) -> Vec<Wanted> {
        self.real(PAPER.len(), &OTHERS)
    }

    fn real(&self, first: usize, list: &[Real]) -> Vec<Wanted> {
        let Some(data) = &self.data else { return Vec::new() };
        let mut wanted = Vec::new();
        for (index, real) in (first..).zip(list) {
            if data.join(real.path).exists() {
                wanted.push(Wanted::Real(index));
            } else {
                print_note(&format!("note: no {} in {}; left out", real.path, data.display()));
            }
        }
        wanted
    }

    /// How many sets there are.
    ///
    /// # Errors
    /// If --data is no folder, or a set cannot be named.
    pub(super) fn list(&self) -> Result<Vec<Wanted>> {
        if let Some(data) = &self.data
            && !data.is_dir()
        {
            return Err(Error::input(data.display().to_string(), "is no folder; give --data the one with the volumes"));
        }
        if !self.sets.is_empty() {
            return Ok(self.sets.iter().cloned().map(Wanted::Named).collect());
        }
        let mut wanted = self.real(0, &PAPER);
        if self.data.is_none() {
            print_note("note: the paper's sets need --data FOLDER; phantoms only");
        }
        wanted.extend(PHANTOMS.map(|name| Wanted::Named(PathBuf::from(name))));
        Ok(wanted)
    }

    fn edge(&self) -> Result<u16> {
        let edge = self.edge.unwrap_or(if self.quick { 48 } else { 192 });
        if !(8..=2048).contains(&edge) {
            return Err(Error::input("--edge", format!("is {edge}, but must be 8 to 2048")));
        }
        Ok(edge)
    }

    /// Builds or opens one, with 8-bit values and normals.
    ///
    /// # Errors
    /// As `adj build` and opening a file.
    pub(super) fn load(&self, wanted: &Wanted) -> Result<Set> {
        match self.read(wanted)? {
            Origin::Volume(mut volume) => volume.build(8, 8),
            Origin::File(path) => opened(&path),
        }
    }

    /// Opens one for reading, if it is a volume.
    ///
    /// # Errors
    /// As opening a volume.
    pub(super) fn read(&self, wanted: &Wanted) -> Result<Origin> {
        let (name, source, transfer) = match wanted {
            Wanted::Named(path) => {
                let Some(made_up) = phantom(path)? else { return Ok(Origin::File(path.clone())) };
                let edge = self.edge()?;
                let (low, high) = made_up.visible_range();
                let source = made_up.open([edge.into(); 3], SampleType::U8, [1.0; 3])?;
                (format!("{} {edge}^3", made_up.name()), source, TransferFunction::range(low, high)?)
            }
            Wanted::Noise { share, edge } => {
                let noise = Phantom::Noise { visible: *share };
                let source = noise.open([(*edge).into(); 3], SampleType::U8, [1.0; 3])?;
                (format!("noise {:.0} %", 100.0 * share), source, TransferFunction::range(1.0, 255.0)?)
            }
            Wanted::Real(index) => {
                let real = real(*index);
                let folder = self.data.as_deref().unwrap_or(Path::new("."));
                let source = open::open(&folder.join(real.path), &open::OpenOptions::default())?;
                (real.name.to_owned(), source, real.visible.transfer()?)
            }
        };
        Ok(Origin::Volume(Unbuilt { name, source, transfer, is_read: false }))
    }
}

/// A set that was asked for.
#[derive(Debug, Clone)]
pub(super) enum Wanted {
    /// A file or a phantom.
    Named(PathBuf),
    /// Number of a real volume: the paper's, then the others.
    Real(usize),
    /// Noise with this share of visible voxels.
    Noise { share: f64, edge: u16 },
}

fn opened(path: &Path) -> Result<Set> {
    if !starts_as_adj(path)? {
        let why = "is no .adj file; build one first: adj build VOLUME --range LOW.. -o FILE.adj";
        return Err(Error::input(path.display().to_string(), why));
    }
    let file = AdjFile::open(path)?;
    let transfer = stored_transfer(&file.arena()?, path)?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Set { name, file, transfer })
}

fn build(
    name: String,
    source: &mut dyn SlabSource,
    transfer: TransferFunction,
    value_bits: u8,
    normal_bits: u8,
) -> Result<Set> {
    let normal_bits = if transfer.shaded() { normal_bits } else { 0 };
    let options = BuildOptions { transfer, lane_count: 3, tile_order: TileOrder::Morton, value_bits, normal_bits };
    let folder = std::env::temp_dir();
    let resources = Resources { memory: None, threads: thread_count(None)?, folder: Some(folder.clone()) };
    let header = source.header().clone();
    let visible = classify_with_warnings(source, &options, &resources, true)?;
    let description = description(&header, &visible);
    let output = RowsOutput {
        facts: visible.facts.clone(),
        description: &description,
        lane_count: options.lane_count,
        memory: None,
        threads: resources.threads,
    };
    let file = open_rows(&folder, &visible.rows, &output, &mut Progress::new(true))?;
    let transfer = visible.transfer.clone();
    Ok(Set { name, file, transfer })
}
