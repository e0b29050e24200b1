//! Opens the volume that a command reads: a file of any format, slices in several files, or a phantom (a computed
//! volume).

use std::path::{Path, PathBuf};

use clap::Args;

use super::info::is_adj;
use super::values::{LevelChoice, Word, choice, library, resolution};
use super::{print_note, starts_as_adj};
use adjsplat::error::{Error, Result};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, Grid, SampleType, SlabSource};
use adjsplat_readers::{
    AdjustedSource, Endian, OpenOptions, RawOptions, open_slices, parse_dims, parse_type, slices_path,
};

/// What a command reads: a path, `phantom:NAME`, or several files that are the slices of one volume.
#[derive(Debug)]
pub(super) struct Input {
    files: Vec<PathBuf>,
    path: PathBuf,
}

impl Input {
    /// Finds what `arguments`, at least one, name. An argument with `*`, `?` or `[` that is no path itself is a pattern.
    pub(super) fn find(arguments: &[PathBuf]) -> Result<Input> {
        let mut files = Vec::new();
        for argument in arguments {
            match argument.to_str() {
                Some(text) if text.contains(['*', '?', '[']) && !argument.exists() => files.extend(matching(text)?),
                _ => files.push(argument.clone()),
            }
        }
        if files.len() > 1 {
            // A pattern may match what an earlier build wrote beside the slices.
            let mut others = Vec::new();
            for file in std::mem::take(&mut files) {
                if std::fs::metadata(&file).map_err(Error::io("open", &file))?.is_dir() {
                    let why = "is one of several inputs, which must be files of slices; give one input";
                    return Err(Error::input(file.display().to_string(), why));
                }
                if is_adj(&file)? { others.push(file) } else { files.push(file) }
            }
            if files.is_empty() {
                return Err(Error::input("the inputs", "are .adj files, which are no slices of a volume; give one"));
            }
            for file in others {
                print_note(&format!("note: {} is an .adj file, not a slice; it is left out", file.display()));
            }
        }
        let path = match files.as_slice() {
            [one] => one.clone(),
            several => slices_path(several),
        };
        Ok(Input { files, path })
    }

    /// Returns the path of the input; for several files, one that stands for them: `head` for `head/1.tif`.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the paths of the files; folders, which may hold other files, are left out.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.files.iter().filter(|file| !file.is_dir()).cloned()
    }

    /// Returns the paths of the files, and what `source`, which was opened from them, says of others.
    pub(super) fn all_files(&self, source: &dyn SlabSource) -> impl Iterator<Item = PathBuf> {
        self.files().chain(source.data_files())
    }
}

/// Returns the files whose paths match `pattern`: `*` is any text in a name, `?` any character.
fn matching(pattern: &str) -> Result<Vec<PathBuf>> {
    let paths = glob::glob(pattern).map_err(|error| Error::input(pattern, format!("is no pattern: {error}")))?;
    let found: Vec<PathBuf> = paths.flatten().filter(|path| path.is_file()).collect();
    if found.is_empty() {
        let none = std::io::Error::new(std::io::ErrorKind::NotFound, "no file matches this pattern");
        return Err(Error::io("open", Path::new(pattern))(none));
    }
    Ok(found)
}

/// The flags for what a volume's file does not say itself.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reading")]
pub(super) struct InputArguments {
    /// Voxels along x, y and z: 256x256x128. Needed for a raw file and for raw slices, one a file; 256x256x256 by
    /// default for a phantom
    #[arg(long, value_name = "XxYxZ", value_parser = library(parse_dims))]
    dims: Option<[u64; 3]>,
    /// Type of a voxel: u8, i8, u16, i16, u32, i32, f32 or f64; add be for big endian (u16be).
    /// Needed for a raw file; u8 by default for a phantom
    #[arg(long = "type", value_name = "TYPE", value_parser = library(type_and_order))]
    sample_type: Option<(SampleType, Option<Endian>)>,
    /// Byte order of a raw file: little or big endian; by default what --type says
    #[arg(long, value_name = "ORDER", value_parser = choice([("le", Endian::Little, ""), ("be", Endian::Big, "")]))]
    endian: Option<Endian>,
    /// Bytes to skip at the start of a raw file; 0 by default
    #[arg(long, value_name = "BYTES")]
    skip: Option<u64>,
    /// Distance between voxels along x, y and z, above 0: 1x1x1.5. Replaces the file's own
    #[arg(long, value_name = "XxYxZ", allow_hyphen_values = true, value_parser = spacing)]
    spacing: Option<[f64; 3]>,
    /// Number of the volume to read, from 0, if the file holds several
    #[arg(long, value_name = "N", default_value_t = 0)]
    volume: u32,
    /// Resolution to read of an OME-Zarr image; 0 is the finest
    #[arg(long, value_name = "N", default_value = "0", allow_hyphen_values = true, value_parser = resolution)]
    pub(super) level: LevelChoice,
    /// DICOM series to read if the folder holds several: its number in the list that adj prints, or the end of its UID
    #[arg(long, value_name = "NUMBER|UID")]
    series: Option<String>,
    /// Follow names of data files that lead out of the folder of their NRRD or MetaImage header; for files you trust
    #[arg(long)]
    outside_files: bool,
    /// Keep voxels as stored: do not apply the file's slope and intercept
    #[arg(long)]
    unscaled: bool,
    /// Axes that run the other way than the file says, with commas between: z mirrors the volume from top to bottom
    #[arg(long, value_name = "AXES", value_delimiter = ',', value_parser = choice(AXES))]
    flip: Vec<Axis>,
}

impl InputArguments {
    /// Returns the flags of this group that are on the command line and are for volumes alone.
    pub(super) fn given(&self) -> impl Iterator<Item = &'static str> {
        let flags = [
            ("--dims", self.dims.is_some()),
            ("--type", self.sample_type.is_some()),
            ("--endian", self.endian.is_some()),
            ("--skip", self.skip.is_some()),
            ("--spacing", self.spacing.is_some()),
            ("--volume", self.volume != 0),
            ("--series", self.series.is_some()),
            ("--outside-files", self.outside_files),
            ("--unscaled", self.unscaled),
            ("--flip", !self.flip.is_empty()),
        ];
        flags.into_iter().filter_map(|(flag, given)| given.then_some(flag))
    }

    /// Returns `--level` if it asks for another resolution than the finest.
    pub(super) fn level_given(&self) -> Option<&'static str> {
        (self.resolution() != 0).then_some("--level")
    }

    /// Returns the resolution to read of an image.
    fn resolution(&self) -> u32 {
        match self.level {
            LevelChoice::Auto => 0,
            LevelChoice::Number(level) => level,
        }
    }

    /// Opens `input`. Prints the notes of the file's reader to stderr.
    pub(super) fn open(&self, input: &Input) -> Result<Box<dyn SlabSource>> {
        let source = self.as_it_says(input)?;
        if !self.unscaled && self.flip.is_empty() {
            return Ok(source);
        }
        Ok(Box::new(AdjustedSource::new(source, |header| {
            if self.unscaled {
                (header.slope, header.intercept) = (1.0, 0.0);
            }
            self.flip.iter().for_each(|&axis| flip(&mut header.grid, axis));
        })))
    }

    /// Opens `input` as its file describes it.
    fn as_it_says(&self, Input { files, path: input }: &Input) -> Result<Box<dyn SlabSource>> {
        if let Some(phantom) = phantom(input)? {
            let takes = ["--dims", "--type", "--spacing", "--unscaled", "--flip"];
            if let Some(flag) = self.given().chain(self.level_given()).find(|flag| !takes.contains(flag)) {
                return Err(Error::input(flag, "is for files, but the input is a phantom; leave it out"));
            }
            let sample_type = self.sample_type.map_or(SampleType::U8, |(sample_type, _)| sample_type);
            return phantom.open(self.dims.unwrap_or([256; 3]), sample_type, self.spacing.unwrap_or([1.0; 3]));
        }
        if std::fs::metadata(input).is_ok_and(|found| found.is_file()) && starts_as_adj(input)? {
            let why = "is an .adj file, which holds no volume; give the volume that it was built from";
            return Err(Error::input(input.display().to_string(), why));
        }
        let mut options =
            OpenOptions::new().volume_index(self.volume).level(self.resolution()).outside_files(self.outside_files);
        if let Some(raw) = self.raw()? {
            options = options.raw(raw);
        }
        if let Some(spacing) = self.spacing {
            options = options.spacing(spacing);
        }
        if let Some(series) = &self.series {
            options = options.series(series);
        }
        let source = open_slices(files, &options)?;
        for note in source.notes() {
            print_note(note);
        }
        Ok(source)
    }

    /// Returns how to read a raw file; `None` if the flags for raw files are not given.
    fn raw(&self) -> Result<Option<RawOptions>> {
        match (self.dims, self.sample_type) {
            (Some(_), Some((sample_type, Some(of_type)))) if self.endian.is_some_and(|endian| endian != of_type) => {
                let [order, other] = match of_type {
                    Endian::Little => ["le", "be"],
                    Endian::Big => ["be", "le"],
                };
                let why = format!("says {order}, but --endian says {other}; give one of them");
                Err(Error::input(format!("--type {}{order}", sample_type.name()), why))
            }
            (Some(dims), Some((sample_type, endian))) => {
                let raw = RawOptions::new(dims, sample_type).endian(self.endian.or(endian).unwrap_or(Endian::Little));
                Ok(Some(raw.skip(self.skip.unwrap_or(0))))
            }
            (None, None) if self.endian.is_some() || self.skip.is_some() => {
                Err(Error::input("--endian, --skip", "are for raw files; give --dims and --type too"))
            }
            (None, None) => Ok(None),
            (Some(_), None) => Err(Error::input("--dims", "is for raw files; give --type too, such as u8")),
            (None, Some(_)) => Err(Error::input("--type", "is for raw files; give --dims too: 256x256x128")),
        }
    }
}

/// Values of `--flip`.
const AXES: [Word<Axis>; 3] = [("x", Axis::X, ""), ("y", Axis::Y, ""), ("z", Axis::Z, "")];

/// Turns an axis of the grid around in the world; the points as a whole stay in their place.
fn flip(grid: &mut Grid, axis: Axis) {
    let a = axis.index();
    let length = grid.spacing[a] * f64::from(grid.dims[a] - 1);
    for (origin, part) in grid.origin.iter_mut().zip(&mut grid.direction[a]) {
        *origin += *part * length;
        *part = -*part;
    }
}

/// Returns the phantom that `phantom:NAME` names; `None` for any other input.
pub(super) fn phantom(input: &Path) -> Result<Option<Phantom>> {
    let name = input.to_str().and_then(|text| text.strip_prefix("phantom:"));
    name.map(Phantom::from_name).transpose()
}

/// Parses a sample type: `u16`, or with the byte order, which is `None` if the text does not say it, `u16be`.
fn type_and_order(text: &str) -> Result<(SampleType, Option<Endian>)> {
    let (sample_type, endian) = parse_type(text)?;
    let says_order = text.len() > sample_type.name().len();
    Ok((sample_type, says_order.then_some(endian)))
}

/// Parses three distances: `1x1x1.5` or `1,1,1.5`.
fn spacing(text: &str) -> Result<[f64; 3], String> {
    let step = |part: &str| part.trim().parse().ok().filter(|step: &f64| step.is_finite() && *step > 0.0);
    let steps: Option<Vec<f64>> = text.split(['x', 'X', ',']).map(step).collect();
    steps.and_then(|steps| steps.try_into().ok()).ok_or_else(|| "must be three numbers above 0: 1x1x1.5".into())
}
