//! Candidates: settings of every knob, each with a name that says them all.
//!
//! In: nothing. Out: the presets on files of 8 and of 16 bits, the dial's rungs, every knob alone away from `standard`, and a grid of
//! combinations of the knobs that matter most for time.

use adjsplat::error::{Error, Result};
use adjsplat::splat::{Blending, KernelShape, Quality, Sampling, Settings, View};
use adjsplat::traverse::{Order, Sense, SplitForm};
use adjsplat_judge::dial;
use adjsplat_judge::dial::Rung;

/// Candidates that belong together: a series of a plot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Family {
    /// `draft`, `standard`, `high`, `reference`.
    Presets,
    /// What `--max-error` chooses from.
    Dial,
    /// Width and cut-off of the kernel.
    Kernel,
    /// Transmittance below which a ray ends.
    Termination,
    /// How many pixels are drawn.
    Sampling,
    /// Bits of values and normals.
    Codes,
    /// Nesting and sense of the walk.
    Order,
    /// What splats take of the light: the classic form, sheet buffers.
    Blending,
    /// Cubes of voxels as one splat.
    Octree,
    /// Several knobs at once.
    Combined,
}

impl Family {
    /// All of them.
    pub const ALL: [Family; 10] = [
        Family::Presets,
        Family::Dial,
        Family::Kernel,
        Family::Termination,
        Family::Sampling,
        Family::Codes,
        Family::Order,
        Family::Blending,
        Family::Octree,
        Family::Combined,
    ];

    /// The family of this name.
    ///
    /// # Errors
    /// [`Error::Input`] with all names if there is none.
    pub fn named(name: &str) -> Result<Family> {
        Family::ALL.into_iter().find(|family| family.name() == name).ok_or_else(|| {
            let names = Family::ALL.map(Family::name).join(", ");
            Error::input("--families", format!("has {name}, but must be of {names}"))
        })
    }

    /// Its name in tables and legends.
    pub fn name(self) -> &'static str {
        match self {
            Family::Presets => "presets",
            Family::Dial => "dial",
            Family::Kernel => "kernel",
            Family::Termination => "termination",
            Family::Sampling => "sampling",
            Family::Codes => "codes",
            Family::Order => "order",
            Family::Blending => "blending",
            Family::Octree => "octree",
            Family::Combined => "combined",
        }
    }
}

/// Which axis of a view's order takes which loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Nesting {
    /// As the view asks.
    Own,
    /// Medium and fast axis in each other's place: what a file with two lanes may have to do.
    MediumFastSwapped,
    /// Slow and fast axis in each other's place: the least aligned axis outermost.
    SlowFastSwapped,
}

/// Who draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drawer {
    /// The renderer on the processor.
    Renderer,
    /// The same splats, of an octree whose cubes are one splat where their error is below this.
    Octree(f32),
}

/// Settings of every knob.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Its series.
    pub family: Family,
    /// The preset that it is, if it is one.
    pub quality: Option<Quality>,
    /// Width and cut-off.
    pub kernel: KernelShape,
    /// Transmittance below which a pixel no longer changes: 0 to 1.
    pub termination: f32,
    /// How many pixels are drawn.
    pub sampling: Sampling,
    /// Bits of a stored value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each component of a stored normal: 0 for none, 8 or 16.
    pub normal_bits: u8,
    /// Which axis takes which loop.
    pub nesting: Nesting,
    /// Which end comes first.
    pub sense: Sense,
    /// What a splat takes of the light.
    pub blending: Blending,
    /// Who draws.
    pub drawer: Drawer,
}

/// Kernels that are swept: from below the draft's to the widest that is used.
const KERNELS: [(f32, f32); 13] = [
    (0.5, 1.5),
    (0.6, 1.5),
    (0.6, 2.0),
    (0.65, 2.0),
    (0.65, 2.5),
    (0.7, 1.5),
    (0.7, 1.8),
    (0.7, 2.0),
    (0.7, 2.1),
    (0.7, 2.3),
    (0.7, 2.5),
    (0.7, 2.8),
    (0.7, 3.0),
];
const TERMINATIONS: [f32; 6] = [0.0, 1e-5, 1.0 / 1024.0, 1.0 / 255.0, 1.0 / 128.0, 1.0 / 32.0];
const SAMPLINGS: [Sampling; 4] = [Sampling::EveryPixel, Sampling::Finer, Sampling::Enough, Sampling::Fewest];
/// Values and normals of 8 and 16 bits, and no normals.
const CODES: [(u8, u8); 5] = [(8, 8), (16, 16), (16, 8), (8, 16), (8, 0)];
const THRESHOLDS: [f32; 3] = [0.01, 0.03, 0.1];
/// What is combined, and with which kernels.
const COMBINED_KERNELS: [(f32, f32); 6] = [(0.6, 1.5), (0.6, 2.0), (0.7, 1.5), (0.7, 1.8), (0.7, 2.1), (0.7, 3.0)];
const COMBINED_TERMINATIONS: [f32; 2] = [1.0 / 128.0, 1.0 / 32.0];

impl Candidate {
    /// A preset on a file with values and normals of so many bits.
    pub fn preset(quality: Quality, bits: u8) -> Candidate {
        Candidate {
            family: Family::Presets,
            quality: Some(quality),
            kernel: quality.kernel(),
            termination: quality.termination(),
            sampling: quality.sampling(),
            value_bits: bits,
            normal_bits: bits,
            nesting: Nesting::Own,
            sense: Sense::FrontToBack,
            blending: Blending::Exponential,
            drawer: Drawer::Renderer,
        }
    }

    /// `standard` on a file of 8 bits, in another series.
    fn away(family: Family) -> Candidate {
        Candidate { family, quality: None, ..Candidate::preset(Quality::Standard, 8) }
    }

    /// The name of the preset that it is; empty for none.
    pub fn quality_name(&self) -> &'static str {
        self.quality.map_or("", Quality::name)
    }

    /// All knobs in one line: `sigma=0.7 radius=2.5 stop=1/1024 sampling=enough values=8 normals=8`, and what is unusual.
    pub fn settings_text(&self) -> String {
        let sampling = self.sampling.name();
        let normals = if self.normal_bits == 0 { "none".to_owned() } else { self.normal_bits.to_string() };
        let mut text = format!(
            "sigma={} radius={} stop={} sampling={sampling} values={} normals={normals}",
            self.kernel.sigma,
            self.kernel.radius,
            share(self.termination),
            self.value_bits,
        );
        match self.nesting {
            Nesting::Own => {}
            Nesting::MediumFastSwapped => text.push_str(" swapped=medium,fast"),
            Nesting::SlowFastSwapped => text.push_str(" swapped=slow,fast"),
        }
        if self.sense == Sense::BackToFront {
            text.push_str(" sense=back-to-front");
        }
        if self.blending != Blending::Exponential {
            text.push_str(&format!(" blending={}", self.blending.name()));
        }
        if let Drawer::Octree(threshold) = self.drawer {
            text.push_str(&format!(" octree={threshold}"));
        }
        text
    }

    /// What the renderer is told, on one thread; `view`: at the picture's size.
    ///
    /// # Errors
    /// As [`Order::new`].
    pub fn settings(&self, view: &View, dims: [u32; 3]) -> Result<Settings> {
        let order = match self.nesting {
            Nesting::Own => None,
            Nesting::MediumFastSwapped | Nesting::SlowFastSwapped => {
                let own = Order::new(view.viewpoint, dims, self.sense, SplitForm::default())?;
                Some(match self.nesting {
                    Nesting::SlowFastSwapped => Order { slow: own.fast, fast: own.slow, ..own },
                    _ => Order { medium: own.fast, fast: own.medium, ..own },
                })
            }
        };
        Ok(Settings {
            quality: self.quality.unwrap_or_default(),
            kernel: Some(self.kernel),
            termination: Some(self.termination),
            sampling: Some(self.sampling),
            sense: self.sense,
            blending: self.blending,
            order,
            ..Settings::every_pixel(view.size)
        })
    }
}

/// 1/1024 rather than 0.0009765625.
fn share(part: f32) -> String {
    let times = (1.0 / part).round();
    if (2.0..=4096.0).contains(&times) && (1.0 / times - part).abs() <= f32::EPSILON * part {
        format!("1/{times}")
    } else if part > 0.0 && part < 1e-3 {
        format!("{part:e}")
    } else {
        part.to_string()
    }
}

/// Everything that the study compares, each settings once; `quick`: presets and a few knobs.
pub fn candidates(quick: bool) -> Vec<Candidate> {
    let mut all = Vec::new();
    for bits in [8, 16] {
        for quality in Quality::ALL {
            all.push(Candidate::preset(quality, bits));
        }
    }
    let mut add = |candidate: Candidate| {
        let known =
            |other: &Candidate| Candidate { family: other.family, quality: other.quality, ..candidate } == *other;
        if !all.iter().any(known) {
            all.push(candidate);
        }
    };
    // The dial's error leaves out what a file left out: here its files leave out least.
    for Rung { kernel, termination, sampling } in dial::RUNGS {
        let stored = Candidate { value_bits: 16, normal_bits: 16, ..Candidate::away(Family::Dial) };
        add(Candidate { kernel, termination, sampling, ..stored });
    }
    let step = if quick { 3 } else { 1 };
    for &(sigma, radius) in KERNELS.iter().step_by(step) {
        add(Candidate { kernel: KernelShape { sigma, radius }, ..Candidate::away(Family::Kernel) });
    }
    for &termination in TERMINATIONS.iter().step_by(step) {
        add(Candidate { termination, ..Candidate::away(Family::Termination) });
    }
    for sampling in SAMPLINGS {
        add(Candidate { sampling, ..Candidate::away(Family::Sampling) });
    }
    for (value_bits, normal_bits) in CODES {
        add(Candidate { value_bits, normal_bits, ..Candidate::away(Family::Codes) });
    }
    for nesting in [Nesting::MediumFastSwapped, Nesting::SlowFastSwapped] {
        add(Candidate { nesting, ..Candidate::away(Family::Order) });
    }
    add(Candidate { sense: Sense::BackToFront, ..Candidate::away(Family::Order) });
    for blending in [Blending::Linear, Blending::Sheets] {
        // They have no coarser pixels: beside them stands standard with finer ones.
        add(Candidate { blending, sampling: Sampling::Finer, ..Candidate::away(Family::Blending) });
    }
    for &threshold in THRESHOLDS.iter().step_by(step) {
        let drawer = Drawer::Octree(threshold);
        add(Candidate { drawer, sampling: Sampling::EveryPixel, ..Candidate::away(Family::Octree) });
    }
    if quick {
        return all;
    }
    for (sigma, radius) in COMBINED_KERNELS {
        for sampling in [Sampling::Enough, Sampling::Fewest] {
            let kernel = KernelShape { sigma, radius };
            add(Candidate { kernel, sampling, ..Candidate::away(Family::Combined) });
            for termination in COMBINED_TERMINATIONS {
                add(Candidate { kernel, termination, sampling, ..Candidate::away(Family::Combined) });
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_name_every_knob_and_no_two_candidates_are_the_same() {
        let standard = Candidate::preset(Quality::Standard, 8);
        assert_eq!(standard.settings_text(), "sigma=0.7 radius=2.5 stop=1/1024 sampling=enough values=8 normals=8");
        let high = Candidate::preset(Quality::High, 16);
        assert_eq!(high.settings_text(), "sigma=0.7 radius=3 stop=1e-5 sampling=finer values=16 normals=16");
        for quick in [true, false] {
            let all = candidates(quick);
            let names: std::collections::BTreeSet<String> = all.iter().map(Candidate::settings_text).collect();
            assert_eq!(names.len(), all.len());
            for family in Family::ALL.into_iter().filter(|family| !(quick && *family == Family::Combined)) {
                assert!(all.iter().any(|candidate| candidate.family == family), "{family:?}");
            }
        }
    }
}
