//! The flags for how the picture is made: `--quality`, `--mode` and others.

use clap::Args;

use super::super::values::{Background, Word, background, choice, kernel, number};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::splat::{Blending, KernelShape, Mode, Quality, Sampling, Settings};
use adjsplat::traverse::SplitForm;
use adjsplat_pictures::SampleDepth;

/// The flags for how the picture is made.
#[derive(Debug, Args)]
#[command(next_help_heading = "Look")]
pub(super) struct LookArguments {
    /// How exact the picture is: where splats are cut off, when rays end, which pixels are drawn
    #[arg(long, value_name = "Q", default_value = "standard", value_parser = choice(QUALITIES))]
    quality: Quality,
    /// Which pixels are drawn; by default fewest for draft, enough for standard, finer for high and reference.
    /// Graphics devices and --renderer reference draw finer for fewest and enough
    #[arg(long, value_name = "PIXELS", value_parser = choice(SAMPLINGS))]
    sampling: Option<Sampling>,
    /// Choose the fastest settings whose largest error, of a linear sample from 0 to 1, is at most E. The error is measured
    /// beside --quality reference; of a volume, which is then stored with 16 bits, beside the volume. Of several pictures
    /// three are measured, and others can have a larger error. Choosing takes longer than it saves on a single picture
    #[arg(long, value_name = "E", allow_hyphen_values = true, conflicts_with_all = ["quality", "sampling", "kernel", "termination", "blending"])]
    pub(super) max_error: Option<f64>,
    /// How narrow splats are, 0 (the default) to 1: their standard deviation falls from 0.7 to 0.55 voxels. Thin
    /// structures look thinner; noise and the grid of the voxels show more
    #[arg(long, value_name = "S", allow_hyphen_values = true, conflicts_with_all = ["kernel", "max_error"], value_parser = number(0.0..=1.0f32))]
    sharpness: Option<f32>,
    /// Gaussian of a splat, in voxels: standard deviation (0.2 to 4) and radius (1 to 6 times that), such as 0.6,2;
    /// by default that of --quality and --sharpness
    #[arg(long, value_name = "SIGMA,RADIUS", allow_hyphen_values = true, value_parser = kernel)]
    kernel: Option<KernelShape>,
    /// End a ray when at most this share of its light is left, 0 to 1, which is also the most that a pixel's opacity loses;
    /// by default that of --quality
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = number(0.0..=1.0f32))]
    pub(super) termination: Option<f32>,
    /// What a pixel shows of its ray
    #[arg(long, value_name = "MODE", default_value = "composite", value_parser = choice(MODES))]
    mode: Mode,
    /// How a splat covers what is behind it, in composite mode; linear and sheets need --renderer cpu, and are not
    /// exact for very many very faint layers
    #[arg(long, value_name = "B", default_value = "exponential", value_parser = choice(BLENDINGS))]
    blending: Blending,
    /// Brightness of xray mode, a factor above 0; by default it suits what is visible
    #[arg(long, value_name = "FACTOR", allow_hyphen_values = true)]
    exposure: Option<f32>,
    /// Colour behind the volume: #rrggbb, black, white or transparent; by default white, dark behind what is translucent,
    /// and black in the modes maximum and xray
    #[arg(long, value_name = "COLOUR", value_parser = background)]
    background: Option<Background>,
    /// Draw without lighting
    #[arg(long)]
    unlit: bool,
    /// Order of voxels in perspective, on the two sides of the eye; parallel views have one order
    #[arg(long, value_name = "FORM", default_value = "interleaved", value_parser = choice(FORMS))]
    form: SplitForm,
    /// Bits of each sample of a .png or .apng; .exr always has 32
    #[arg(long, value_name = "BITS", default_value = "8", value_parser = choice(DEPTHS))]
    pub(super) bits: SampleDepth,
}

const QUALITIES: [Word<Quality>; 4] = [
    ("draft", Quality::Draft, "For moving the camera"),
    ("standard", Quality::Standard, "For pictures to look at"),
    ("high", Quality::High, "For pictures to measure in"),
    ("reference", Quality::Reference, "Nothing is left out; slow"),
];

const SAMPLINGS: [Word<Sampling>; 4] = [
    ("fewest", Sampling::Fewest, "Fewer than enough, for moving the camera"),
    ("enough", Sampling::Enough, "As many as splats need, on the lattice of the slices; the picture is interpolated"),
    ("every", Sampling::EveryPixel, "All pixels of the picture"),
    ("finer", Sampling::Finer, "Several for each pixel where voxels are smaller than pixels"),
];

const MODES: [Word<Mode>; 4] = [
    ("composite", Mode::Composite, "Splats blended from front to back, with lighting"),
    (
        "maximum",
        Mode::Maximum,
        "The largest value along the ray, interpolated, in its colour; --quality, --sampling, --kernel, --sharpness, --termination and --unlit change nothing",
    ),
    ("maximum-grey", Mode::MaximumGrey, "The same in grey"),
    ("xray", Mode::Additive, "The sum along the ray; --termination changes nothing"),
];

const BLENDINGS: [Word<Blending>; 3] = [
    ("exponential", Blending::Exponential, "The integral along the ray"),
    ("linear", Blending::Linear, "Opacity times weight, the classic form"),
    ("sheets", Blending::Sheets, "The integral of the sum of each slice's splats"),
];

const FORMS: [Word<SplitForm>; 2] = [
    ("interleaved", SplitForm::Interleaved, "In turns; right where splats overlap"),
    ("split", SplitForm::Split, "One side after the other"),
];

const DEPTHS: [Word<SampleDepth>; 2] = [("8", SampleDepth::Eight, ""), ("16", SampleDepth::Sixteen, "")];

impl LookArguments {
    /// Returns the settings for a picture of `size`, drawn by `threads`.
    ///
    /// # Errors
    /// [`Error::Input`] for a flag that does not go with `--mode`, or a value out of range.
    pub(super) fn settings(&self, size: [u32; 2], threads: usize) -> Result<Settings> {
        let mut settings = Settings::new(size);
        (settings.quality, settings.mode, settings.blending) = (self.quality, self.mode, self.blending);
        if settings.blending != Blending::Exponential && settings.mode != Mode::Composite {
            return Err(Error::input("--blending", "is for --mode composite; leave it out"));
        }
        settings.sampling = self.sampling;
        (settings.kernel, settings.termination, settings.form) = (self.kernel, self.termination, self.form);
        if let Some(sharpness) = self.sharpness {
            settings.kernel = Some(self.quality.kernel().sharpened(sharpness)?);
        }
        if self.unlit {
            settings.lighting = None;
        }
        if self.exposure.is_some() && settings.mode != Mode::Additive {
            return Err(Error::input("--exposure", "is for --mode xray; leave it out"));
        }
        settings.exposure = self.exposure;
        settings.threads = threads;
        settings.check()?;
        Ok(settings)
    }

    /// Returns whether the command line gives a colour behind the picture.
    pub(super) fn is_over_colour(&self) -> bool {
        matches!(self.background, Some(Background::Colour(_)))
    }

    /// Returns the colour behind what `transfer` shows, linear; `None` for transparent.
    pub(super) fn background(&self, transfer: &TransferFunction) -> Option<[f32; 3]> {
        match self.background {
            Some(Background::Transparent) => None,
            Some(Background::Colour(colour)) => Some(colour),
            None if self.mode != Mode::Composite => Some([0.0; 3]),
            // White would shine through, and wash the colours out.
            None if transfer.is_translucent() => Some(DARK),
            None => Some([1.0; 3]),
        }
    }
}

/// The background behind what is translucent, linear: #14181d.
const DARK: [f32; 3] = [0.006_995_41, 0.009_134_059, 0.012_286_488];

/// Formats the settings that `--max-error` chose as flags.
pub(super) fn chosen(settings: &Settings, measured: f64) -> String {
    let KernelShape { sigma, radius } = settings.kernel();
    let (termination, sampling) = (settings.termination(), settings.sampling().name());
    let level = settings.level.filter(|level| *level > 0).map_or(String::new(), |level| format!(" --level {level}"));
    format!(
        "--kernel {sigma},{radius} --termination {termination} --sampling {sampling}{level}: largest error measured {measured:.2e}"
    )
}
