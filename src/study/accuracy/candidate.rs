//! Candidates: settings of the renderer that the study compares.

use super::family::Family;
use adjsplat::error::Result;
use adjsplat::splat::{Blending, KernelShape, Quality, Sampling, Settings, View};
use adjsplat::traverse::{Order, Sense, SplitForm};

/// Which axis of a view's order becomes which loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Nesting {
    /// As the view asks.
    Own,
    /// Medium and fast axis exchanged, as a file with two lanes may need.
    MediumFastSwapped,
    /// Slow and fast axis exchanged: the least aligned axis is outermost.
    SlowFastSwapped,
}

/// What draws a candidate's picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drawer {
    /// The renderer on the processor.
    Renderer,
    /// The same splatter with an octree, whose cubes are one splat if their error is below this threshold.
    Octree(f32),
}

/// Settings of the renderer and of the file that it draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The family that it belongs to.
    pub family: Family,
    /// The preset that it is; `None` for other settings.
    pub quality: Option<Quality>,
    /// Width and radius of the kernel.
    pub kernel: KernelShape,
    /// Transmittance from 0 to 1 below which a pixel is finished.
    pub termination: f32,
    /// How many pixels are drawn.
    pub sampling: Sampling,
    /// Bits of a stored value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each component of a stored normal: 0 for none, 8 or 16.
    pub normal_bits: u8,
    /// Which axis becomes which loop.
    pub nesting: Nesting,
    /// Front to back or back to front.
    pub sense: Sense,
    /// How a splat covers a pixel.
    pub blending: Blending,
    /// What draws it.
    pub drawer: Drawer,
}

impl Candidate {
    /// Returns a preset for a file with values and normals of `bits` bits.
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

    /// Returns `standard` on a file of 8 bits, as a start for other settings of `family`.
    pub(super) fn away(family: Family) -> Candidate {
        Candidate { family, quality: None, ..Candidate::preset(Quality::Standard, 8) }
    }

    /// Returns the name of the preset; empty if it is none.
    pub fn quality_name(&self) -> &'static str {
        self.quality.map_or("", Quality::name)
    }

    /// Returns all settings in one line, such as `sigma=0.7 radius=2.5 stop=1/1024 sampling=enough values=8 normals=8`.
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

    /// Returns the renderer's settings on one thread; `view` must have the picture's size.
    ///
    /// # Errors
    /// Those of [`Order::new`].
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

/// Formats 0.0009765625 as 1/1024.
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
