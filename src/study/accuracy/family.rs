//! Families of candidates: groups that vary the same setting of the renderer.

/// Candidates that vary the same setting: a series of a plot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Family {
    /// The presets `draft`, `standard`, `high` and `reference`.
    Presets,
    /// The settings among which the dial (the search for the fastest settings within a largest error) chooses.
    Dial,
    /// Width and radius of the splat's kernel.
    Kernel,
    /// Transmittance below which a ray ends.
    Termination,
    /// How many pixels are drawn.
    Sampling,
    /// Bits of a stored value and of each component of a normal.
    Codes,
    /// Nesting of the walk's loops, and their direction: front to back or back to front.
    Order,
    /// How splats cover pixels: the classic form, sheet buffers.
    Blending,
    /// An octree that draws cubes of voxels as one splat.
    Octree,
    /// Several settings at once.
    Combined,
}

impl Family {
    /// All families, in order.
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

    /// Returns the family's name in tables and legends.
    pub fn name(self) -> &'static str {
        NAMES[self as usize]
    }
}

/// Names of the families, in the order of the variants.
const NAMES: [&str; Family::ALL.len()] =
    ["presets", "dial", "kernel", "termination", "sampling", "codes", "order", "blending", "octree", "combined"];
