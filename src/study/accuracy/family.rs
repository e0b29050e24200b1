//! Families of candidates.

use adjsplat::error::{Error, Result};

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
