//! Candidates: settings of the renderer that the study compares.

use super::family::Family;
use adjsplat::error::Result;
use adjsplat::splat::{Blending, Camera, KernelShape, Quality, Sampling, Settings, View};
use adjsplat::traverse::{Order, Sense, SplitForm};
use adjsplat::volume::Grid;

/// Says which axis of a view's order becomes which loop of the walk: slow (outermost), medium or fast (innermost).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Nesting {
    /// The axes keep the loops that the view gives them.
    Own,
    /// Exchanges the medium and the fast axis, as a file with only two lanes may need.
    MediumFastSwapped,
    /// Exchanges the slow and the fast axis: the axis least aligned with the view is outermost.
    SlowFastSwapped,
}

/// What draws a candidate's picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drawer {
    /// The renderer on the processor.
    Renderer,
    /// The same splatter with an octree, which draws a cube as one splat if the cube's error is below this threshold.
    Octree(f32),
}

/// Settings of the renderer, and of the file that it draws, which are compared with other candidates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The family (candidates that vary the same setting) that the candidate belongs to.
    pub family: Family,
    /// The preset that has these settings; `None` if they are not a preset's.
    pub quality: Option<Quality>,
    /// Width (standard deviation) and radius of the splat's Gaussian kernel.
    pub kernel: KernelShape,
    /// Transmittance from 0 to 1 below which a pixel is finished, so that no more splats are added to it.
    pub termination: f32,
    /// How many pixels are drawn.
    pub sampling: Sampling,
    /// Bits of a stored value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each component of a stored normal: 0 for none, 8 or 16.
    pub normal_bits: u8,
    /// Which axis of the view becomes which loop of the walk.
    pub nesting: Nesting,
    /// Whether splats are composited front to back or back to front.
    pub sense: Sense,
    /// How a splat covers what is behind it in a pixel.
    pub blending: Blending,
    /// What draws the candidate's picture.
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

    /// Returns the preset `standard` on a file of 8 bits; the caller then changes the setting that `family` varies.
    pub(super) fn away(family: Family) -> Candidate {
        Candidate { family, quality: None, ..Candidate::preset(Quality::Standard, 8) }
    }

    /// Returns the name of the candidate's preset; an empty text if it has none.
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

    /// Returns the renderer's settings for one thread and a picture of `size`.
    ///
    /// # Errors
    /// Any error of [`View::new`] and [`Order::new`].
    pub fn settings(&self, camera: &Camera, grid: &Grid, size: [u32; 2]) -> Result<Settings> {
        let view = View::new(camera, grid, size, Quality::Reference.kernel(), None)?;
        let own = Order::new(view.viewpoint, grid.dims, self.sense, SplitForm::default())?;
        let order = match self.nesting {
            Nesting::Own => None,
            Nesting::MediumFastSwapped => Some(Order { medium: own.fast, fast: own.medium, ..own }),
            Nesting::SlowFastSwapped => Some(Order { slow: own.fast, fast: own.slow, ..own }),
        };
        Ok(Settings::every_pixel(size)
            .with_quality(self.quality.unwrap_or_default())
            .with_kernel(self.kernel)
            .with_termination(self.termination)
            .with_sampling(self.sampling)
            .with_sense(self.sense)
            .with_blending(self.blending)
            .with_order(order))
    }
}

/// Formats a fraction as one over a whole number: 0.0009765625 as 1/1024.
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
