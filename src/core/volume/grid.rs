//! The regular grid of a volume: point counts, spacing, and position in world space.

use std::ops::RangeInclusive;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Largest number of grid points along an axis.
pub const MAX_DIM: u32 = 65_535;

/// Largest difference of a direction's squared length from 1: it admits unit vectors written with three digits.
const UNIT_TOLERANCE: f64 = 2e-3;
/// Spacings that can be drawn. Squares of a picture's lengths, also from far and through a strong zoom, are numbers then.
pub const SPACINGS: RangeInclusive<f64> = 1e-100..=1e100;

/// One of the grid's three index axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Axis {
    /// First index of a grid point; samples that follow each other in memory differ in x.
    X = 0,
    /// Second index of a grid point.
    Y = 1,
    /// Third index of a grid point; volumes are read slice by slice along it.
    Z = 2,
}

impl Axis {
    /// All axes: x, y, z.
    pub const ALL: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

    /// Returns the axis' index: 0 for x, 1 for y, 2 for z.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Returns the axis with index 0, 1 or 2; `None` for any other index.
    pub fn from_index(index: usize) -> Option<Axis> {
        Axis::ALL.get(index).copied()
    }

    /// Returns the two other axes, the one with the lower index first.
    pub const fn others(self) -> [Axis; 2] {
        match self {
            Axis::X => [Axis::Y, Axis::Z],
            Axis::Y => [Axis::X, Axis::Z],
            Axis::Z => [Axis::X, Axis::Y],
        }
    }

    /// Returns the axis' name: "x", "y" or "z".
    pub const fn name(self) -> &'static str {
        ["x", "y", "z"][self.index()]
    }
}

/// A regular grid of sample points and its position in world space.
///
/// Point `i` lies at `origin + direction * (spacing .* i)`. World axes are right-handed. Where a file names an
/// anatomical frame they are R, A, S: x to the patient's right, y to the front, z to the head.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Number of points along x, y, z; each 1 to [`MAX_DIM`].
    pub dims: [u32; 3],
    /// Distance between neighbouring points along x, y, z, in `unit`; in [`SPACINGS`].
    pub spacing: [f64; 3],
    /// World position of point (0, 0, 0), in `unit`.
    pub origin: [f64; 3],
    /// World directions of the index axes, as unit vectors: axis `a` points along `direction[a]`. Their squared lengths
    /// are within 0.002 of 1.
    pub direction: [[f64; 3]; 3],
    /// Unit of spacing and origin, such as "mm", if the volume names one. That of a model is [`Model::unit`](crate::Model::unit).
    pub unit: Option<String>,
}

impl Grid {
    /// Creates a grid whose origin is the world's and whose index axes point along the world axes.
    ///
    /// # Errors
    /// The errors of [`Grid::check`].
    pub fn new(dims: [u64; 3], spacing: [f64; 3]) -> Result<Grid> {
        for axis in Axis::ALL {
            check_limit(axis, dims[axis.index()])?;
        }
        let dims = dims.map(|points| u32::try_from(points).expect("bounded above"));
        let direction = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let grid = Grid { dims, spacing, origin: [0.0; 3], direction, unit: None };
        grid.check()?;
        Ok(grid)
    }

    /// Checks that dimensions, spacing, origin and direction are usable.
    ///
    /// # Errors
    /// [`Error::Input`] if a dimension is 0, a spacing is not in [`SPACINGS`], or origin or direction is not finite or
    /// the direction is singular; [`Error::Limit`] if a dimension is above [`MAX_DIM`].
    pub fn check(&self) -> Result<()> {
        for axis in Axis::ALL {
            let a = axis.index();
            if self.dims[a] == 0 {
                return Err(Error::input(format!("dimension {}", axis.name()), "is 0, but must be at least 1"));
            }
            check_limit(axis, self.dims[a].into())?;
            let step = self.spacing[a];
            if !(step.is_finite() && step > 0.0) {
                let why = format!("is {step}, but must be a finite number above 0");
                return Err(Error::input(format!("spacing {}", axis.name()), why));
            }
            if !SPACINGS.contains(&step) {
                let why = format!("is {step:e}, but only 1e-100 to 1e100 can be drawn; give it in another unit");
                return Err(Error::input(format!("spacing {}", axis.name()), why));
            }
        }
        if !self.origin.iter().all(|c| c.is_finite()) {
            return Err(Error::input("origin", "is not finite"));
        }
        for (axis, [a, b, c]) in Axis::ALL.into_iter().zip(self.direction) {
            let square = a * a + b * b + c * c;
            // NaN is left to the determinant.
            if (square - 1.0).abs() > UNIT_TOLERANCE {
                let why =
                    format!("has the length {}; divide it by this, and multiply the spacing by it", square.sqrt());
                return Err(Error::input(format!("direction {}", axis.name()), why));
            }
        }
        let determinant = self.determinant();
        if !(determinant.is_finite() && determinant.abs() > 1e-6) {
            return Err(Error::input("direction", "has axes that are not finite or lie in one plane"));
        }
        Ok(())
    }

    /// Returns the smallest of the three spacings.
    pub fn finest_spacing(&self) -> f64 {
        self.spacing.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Returns the edge of a cube with the volume of one cell: for axes at right angles, the geometric mean of the
    /// spacings; less in a sheared grid, whose cells are flatter.
    ///
    /// It is the default of a transfer function's reference length, so that opacities refer to one voxel.
    pub fn mean_spacing(&self) -> f64 {
        // Logarithms: the product of three tiny or huge spacings would underflow or overflow.
        let mean = (self.spacing.iter().map(|h| h.ln()).sum::<f64>() / 3.0).exp();
        if self.is_sheared() { mean * self.determinant().abs().cbrt() } else { mean }
    }

    /// Returns whether the axes are not at right angles, as those of a CT scan with a tilted gantry.
    pub fn is_sheared(&self) -> bool {
        // Directions of files are rounded: so small a difference is no shear.
        (self.determinant().abs() - 1.0).abs() >= 1e-6
    }

    /// Returns the volume of the cell that the directions span, negative if they are left-handed; 1 or -1 unless the
    /// grid is sheared.
    fn determinant(&self) -> f64 {
        let [x, y, z] = self.direction;
        x[0] * (y[1] * z[2] - y[2] * z[1]) - x[1] * (y[0] * z[2] - y[2] * z[0]) + x[2] * (y[0] * z[1] - y[1] * z[0])
    }

    /// Returns the unit vector in the world of a normal with these components along the grid's axes, as stored normals have; 0 for none.
    pub fn world_normal(&self, components: [f32; 3]) -> [f64; 3] {
        let axes = DMat3::from_cols_array_2d(&self.direction);
        (axes * DVec3::from_array(components.map(f64::from))).normalize_or_zero().to_array()
    }

    /// Returns the components of a world vector along the grid's axes, in world length.
    pub fn axes_from_world(&self, vector: [f64; 3]) -> [f64; 3] {
        let axes = DMat3::from_cols_array_2d(&self.direction);
        (axes.inverse() * DVec3::from_array(vector)).to_array()
    }

    /// Returns the grid of the `size` points from point `low` on, which keep their positions in the world.
    pub(crate) fn part(&self, low: [u32; 3], size: [u32; 3]) -> Grid {
        let mut part = Grid { dims: size, ..self.clone() };
        for (a, low) in low.into_iter().enumerate() {
            for w in 0..3 {
                part.origin[w] += self.direction[a][w] * (self.spacing[a] * f64::from(low));
            }
        }
        part
    }

    /// Returns the number of samples in one z-slice.
    pub fn slice_len(&self) -> u64 {
        u64::from(self.dims[0]) * u64::from(self.dims[1])
    }

    /// Returns the number of samples in the volume: below 2^48 if [`Grid::check`] accepts the grid, else at most [`u64::MAX`].
    pub fn points(&self) -> u64 {
        self.slice_len().saturating_mul(self.dims[2].into())
    }
}

/// Returns a coordinate inside a grid in 16 bits.
pub(crate) fn coordinate16(coordinate: u32) -> u16 {
    u16::try_from(coordinate).expect("a grid has at most 65,535 points an axis")
}

fn check_limit(axis: Axis, points: u64) -> Result<()> {
    if points > u64::from(MAX_DIM) {
        let what = format!("dimension {}", axis.name());
        return Err(Error::Limit { what, need: points, have: MAX_DIM.into() });
    }
    Ok(())
}
