//! The volume that a command reads: a file of any format, or a phantom.

use std::path::Path;

use clap::Args;

use super::{print_note, starts_as_adj};
use adjsplat::error::{Error, Result};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::source::Unscaled;
use adjsplat::volume::{SampleType, SlabSource};
use adjsplat_readers::{Endian, OpenOptions, RawOptions, open, parse_dims, parse_type};

/// How to read what a file does not say itself.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reading")]
pub(super) struct InputArguments {
    /// Points along x, y, z of a raw file or a phantom: 256x256x128.
    #[arg(long, value_name = "XxYxZ")]
    dims: Option<String>,
    /// Sample type of a raw file or a phantom: u8 i8 u16 i16 u32 i32 f32 f64, with le or be behind it.
    #[arg(long = "type", value_name = "TYPE")]
    sample_type: Option<String>,
    /// Byte order of a raw file: le or be.
    #[arg(long, value_name = "ORDER", value_parser = ["le", "be"])]
    endian: Option<String>,
    /// Bytes to skip at the start of a raw file.
    #[arg(long, value_name = "BYTES")]
    skip: Option<u64>,
    /// Distance between points along x, y, z: 1x1x1.5. Replaces what the file says.
    #[arg(long, value_name = "XxYxZ", allow_hyphen_values = true)]
    spacing: Option<String>,
    /// Which volume of a file that holds several, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    volume: u32,
    /// Which resolution of an OME-Zarr image, from 0, the finest.
    #[arg(long, value_name = "N", default_value_t = 0)]
    level: u32,
    /// Which series of a DICOM folder that holds several: its number in the list that is shown, or its UID's end.
    #[arg(long, value_name = "NUMBER|UID")]
    series: Option<String>,
    /// Take samples as they are stored, without the file's slope and intercept.
    #[arg(long)]
    unscaled: bool,
}

impl InputArguments {
    /// A flag that was given, if any was.
    pub(super) fn given(&self) -> Option<&'static str> {
        let flags = [
            ("--dims", self.dims.is_some()),
            ("--type", self.sample_type.is_some()),
            ("--endian", self.endian.is_some()),
            ("--skip", self.skip.is_some()),
            ("--spacing", self.spacing.is_some()),
            ("--volume", self.volume != 0),
            ("--level", self.level != 0),
            ("--series", self.series.is_some()),
            ("--unscaled", self.unscaled),
        ];
        flags.iter().find(|(_, given)| *given).map(|(flag, _)| *flag)
    }

    /// Opens `input`: a path, or `phantom:NAME`; notes of its reader go to stderr.
    ///
    /// # Errors
    /// As the readers; and [`Error::Input`] for flags that do not go with the input.
    pub(super) fn open(&self, input: &Path) -> Result<Box<dyn SlabSource>> {
        let dims = self.dims.as_deref().map(parse_dims).transpose()?;
        let spacing = self.spacing.as_deref().map(parse_spacing).transpose()?;
        let sample_type = self.sample_type.as_deref().map(parse_type).transpose()?;
        if let Some(phantom) = phantom(input)? {
            if self.level != 0 || self.series.is_some() {
                return Err(Error::input("--level, --series", "are for OME-Zarr and DICOM; leave them out"));
            }
            let sample_type = sample_type.map_or(SampleType::U8, |(ty, _)| ty);
            return phantom.open(dims.unwrap_or([256; 3]), sample_type, spacing.unwrap_or([1.0; 3]));
        }
        if std::fs::metadata(input).is_ok_and(|found| found.is_file()) && starts_as_adj(input)? {
            let why = "is an .adj file, which holds no volume; give the volume that it was built from";
            return Err(Error::input(input.display().to_string(), why));
        }
        let raw = match (dims, sample_type) {
            (Some(dims), Some((ty, endian))) => {
                let endian = match self.endian.as_deref() {
                    Some("be") => Endian::Big,
                    Some(_) => Endian::Little,
                    None => endian,
                };
                Some(RawOptions::new(dims, ty).endian(endian).skip(self.skip.unwrap_or(0)))
            }
            (None, None) => match (&self.endian, self.skip) {
                (None, None) => None,
                _ => return Err(Error::input("--endian, --skip", "are for raw files; give --dims and --type too")),
            },
            (Some(_), None) => return Err(Error::input("--dims", "is for raw files; give --type too, such as u8")),
            (None, Some(_)) => return Err(Error::input("--type", "is for raw files; give --dims too: 256x256x128")),
        };
        let mut options = OpenOptions::new().volume_index(self.volume).level(self.level);
        if let Some(raw) = raw {
            options = options.raw(raw);
        }
        if let Some(spacing) = spacing {
            options = options.spacing(spacing);
        }
        if let Some(series) = &self.series {
            options = options.series(series);
        }
        let source = open(input, &options)?;
        for note in source.notes() {
            print_note(note);
        }
        Ok(if self.unscaled { Box::new(Unscaled::new(source)) } else { source })
    }
}

/// Returns `text`, a reader's error or note, with the flags of this program in place of the library's options.
pub(super) fn with_flags(text: &str) -> String {
    [
        ("describe them with `OpenOptions::raw`", "give --dims 256x256x128 and --type u8 or alike"),
        ("`OpenOptions::level`", "--level"),
        ("`OpenOptions::series`", "--series"),
        ("`OpenOptions::spacing`", "--spacing XxYxZ"),
        ("`dims`", "--dims"),
        ("`skip`", "--skip"),
        ("`type`", "--type"),
    ]
    .iter()
    .fold(text.to_owned(), |text, (option, flag)| text.replace(option, flag))
}

/// The phantom that `phantom:NAME` means.
pub(super) fn phantom(input: &Path) -> Result<Option<Phantom>> {
    let name = input.to_str().and_then(|text| text.strip_prefix("phantom:"));
    name.map(Phantom::from_name).transpose()
}

/// Three distances from text: `1x1x1.5`, or `1,1,1.5`.
fn parse_spacing(text: &str) -> Result<[f64; 3]> {
    let parsed: Option<Vec<f64>> = text.split(['x', 'X', ',']).map(|part| part.trim().parse().ok()).collect();
    let why = || Error::input("spacing", format!("is \"{text}\", but must be three numbers above 0: 1x1x1.5"));
    let spacing: [f64; 3] = parsed.and_then(|numbers| numbers.try_into().ok()).ok_or_else(why)?;
    if spacing.iter().all(|h| h.is_finite() && *h > 0.0) { Ok(spacing) } else { Err(why()) }
}
