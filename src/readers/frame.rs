//! Converts a file's coordinate frame to the crate's: right-handed, and R, A, S where it is anatomical.
//!
//! In: spacing, direction and origin as the file states them, and the world that they are in. Out: a checked [`Grid`].
//! If a world axis of the file points the other way, that component of direction and origin is negated. Two negations
//! are a rotation by 180 degrees; one makes a left-handed frame right-handed. So no picture is mirrored.

use std::path::Path;

use adjsplat::error::{Error, Result};
use adjsplat::volume::{Axis, Grid, MAX_DIM};

/// The world coordinate system that the vectors of a file are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum World {
    /// Right-handed: R, A, S, or a frame without anatomical axes.
    RightHanded,
    /// L, P, S, as in DICOM and ITK: x and y are negated.
    LeftPosterior,
    /// L, A, S, or a left-handed frame without anatomical axes: x is negated.
    LeftHanded,
}

impl World {
    fn signs(self) -> [f64; 3] {
        match self {
            World::RightHanded => [1.0, 1.0, 1.0],
            World::LeftPosterior => [-1.0, -1.0, 1.0],
            World::LeftHanded => [-1.0, 1.0, 1.0],
        }
    }
}

/// The position and the axes of a grid, in the coordinates of its file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FileFrame {
    /// The distance between neighbouring points along each index axis.
    pub(super) spacing: [f64; 3],
    /// The world vector of each index axis, of any length; [`FileFrame::grid`] normalises it.
    pub(super) direction: [[f64; 3]; 3],
    /// The world position of the first point.
    pub(super) origin: [f64; 3],
    /// The world coordinate system of direction and origin.
    pub(super) world: World,
    /// The unit of lengths; `None` if the file does not state it.
    pub(super) unit: Option<String>,
}

/// The directions of index axes that are parallel to the world axes.
pub(super) const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl FileFrame {
    /// Returns a frame whose index axes are parallel to the world axes and whose first point is at the world's origin.
    pub(super) fn upright(spacing: [f64; 3]) -> FileFrame {
        FileFrame { spacing, direction: IDENTITY, origin: [0.0; 3], world: World::RightHanded, unit: None }
    }

    /// Returns the frame in which `steps[a]` is the world vector between neighbouring points along index axis `a`.
    pub(super) fn from_steps(steps: [[f64; 3]; 3], origin: [f64; 3], world: World) -> FileFrame {
        FileFrame { spacing: steps.map(length), direction: steps, origin, world, unit: None }
    }

    /// Returns the unit world vector of index axis `axis`.
    #[cfg(feature = "zarr")]
    pub(super) fn unit_direction(&self, axis: usize) -> [f64; 3] {
        self.direction[axis].map(|c| c / length(self.direction[axis]))
    }

    /// Returns the grid of `dims` points in this frame; `spacing`, if it is `Some`, replaces the file's spacing.
    ///
    /// # Errors
    /// [`Error::Format`] that names `rule`, if a dimension is 0, a spacing is not finite and above 0, or the axes are
    /// not independent; [`Error::Limit`] if a dimension is above [`MAX_DIM`].
    pub(super) fn grid(
        self,
        path: &Path,
        rule: &'static str,
        dims: [u64; 3],
        spacing: Option<[f64; 3]>,
    ) -> Result<Grid> {
        let mut grid_dims = [0; 3];
        for axis in Axis::ALL {
            let points = dims[axis.index()];
            if points == 0 {
                let got = format!("0 along {}", axis.name());
                return Err(Error::format(path, 0, rule, "at least one point along each axis", got));
            }
            grid_dims[axis.index()] = match u32::try_from(points) {
                Ok(points) if points <= MAX_DIM => points,
                _ => {
                    let what = format!("{}: points along {}", path.display(), axis.name());
                    return Err(Error::Limit { what, need: points, have: MAX_DIM.into() });
                }
            };
        }
        let spacing = spacing.unwrap_or(self.spacing);
        if !spacing.iter().all(|step| step.is_finite() && *step > 0.0) {
            let [x, y, z] = spacing;
            // Other spacings are of no use for axes without a direction.
            let has_directions = self.direction.iter().all(|axis| length(*axis).is_finite() && length(*axis) > 0.0);
            let expected = match has_directions {
                true => "three spacings above 0 (others can be given with `OpenOptions::spacing`)",
                false => "three spacings above 0, along three independent directions",
            };
            return Err(Error::format(path, 0, rule, expected, format!("{x}, {y}, {z}")));
        }
        let signs = self.world.signs();
        // Adding 0.0 turns -0.0 into 0.0.
        let to_our_world = |v: [f64; 3]| [v[0] * signs[0] + 0.0, v[1] * signs[1] + 0.0, v[2] * signs[2] + 0.0];
        let direction = self.direction.map(|axis| to_our_world(axis.map(|c| c / length(axis))));
        let grid = Grid { dims: grid_dims, spacing, origin: to_our_world(self.origin), direction, unit: self.unit };
        match grid.check() {
            Ok(()) => Ok(grid),
            Err(Error::Input { what, why }) if what.starts_with("spacing") => {
                let why = format!("{why} (others can be given with `OpenOptions::spacing`)");
                Err(Error::input(format!("{}: {what}", path.display()), why))
            }
            Err(Error::Input { what, why }) => {
                let expected = "a finite origin and three independent directions";
                Err(Error::format(path, 0, rule, expected, format!("a grid whose {what} {why}")))
            }
            Err(other) => Err(other),
        }
    }
}

/// Returns the length of `v`.
pub(super) fn length(v: [f64; 3]) -> f64 {
    // `hypot` keeps the length of an axis-aligned vector exact and does not overflow.
    v[0].hypot(v[1]).hypot(v[2])
}

/// Returns the cross product, a vector at right angles to `a` and `b`.
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
