//! Visible voxels as arrays: their positions, values and normals, and dense blocks.
//!
//! Python allocates the arrays, and this part fills them. Voxels come by ascending z, then y, then x, as numpy's
//! `nonzero` gives them. A damaged file yields fewer or other voxels than its header says, never more than fit.

use adjsplat::arena::{Coverage, Record, Region, Rows, Voxel};
use adjsplat::classify::normal;
use numpy::{Element, PyArray1, PyArray3, PyArrayMethods, PyReadwriteArray1, PyReadwriteArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::errors::exception;
use crate::model::Model;

/// A number type that values are written as.
trait Value: Element + Copy + Send + Sync {
    /// Returns the nearest number of this type.
    fn nearest(value: f64) -> Self;
}

macro_rules! values {
    ($($whole:ty)* ; $($float:ty)*) => {
        $(impl Value for $whole {
            #[expect(clippy::cast_possible_truncation, clippy::allow_attributes, reason = "saturates")]
            #[allow(clippy::cast_sign_loss, reason = "saturates")]
            fn nearest(value: f64) -> $whole {
                value.round() as $whole
            }
        })*
        $(impl Value for $float {
            #[allow(clippy::cast_possible_truncation, clippy::unnecessary_cast, reason = "rounding is meant")]
            fn nearest(value: f64) -> $float {
                value as $float
            }
        })*
    };
}

values!(u8 i8 u16 i16 u32 i32 ; f32 f64);

/// Returns the value of `$call`, in which `$it` is the numpy array `$out` with the number type that it has.
macro_rules! of_dtype {
    ($out:expr, $array:ident, |$it:ident| $call:expr) => {
        of_dtype!(@ $out, $array, $it, $call, u8 i8 u16 i16 u32 i32 f32 f64)
    };
    (@ $out:expr, $array:ident, $it:ident, $call:expr, $($type:ty)*) => {{
        $(if let Ok($it) = $out.cast::<$array<$type>>() {
            return $call;
        })*
        Err(PyTypeError::new_err("values are written as whole numbers of 8 to 32 bits, float32 or float64"))
    }};
}

impl Model {
    /// Calls `see` with the voxels of each row inside the box `low..high` (x, y, z), by ascending z, then y.
    fn each_row(&self, low: [u32; 3], high: [u32; 3], mut see: impl FnMut(u16, u16, &[Voxel])) -> adjsplat::Result<()> {
        let arena = self.level_arena()?;
        let rows = arena.rows();
        // Rows of one slice come by ascending y.
        (low[2]..high[2]).try_for_each(|z| {
            let slice = Region { xs: low[0]..high[0], ys: low[1]..high[1], zs: z..z + 1 };
            rows.read(slice, &mut see)
        })
    }

    fn each_voxel(&self, mut see: impl FnMut([u16; 3], &Record)) -> adjsplat::Result<()> {
        let dims = self.level_arena()?.facts().grid.dims;
        self.each_row([0; 3], dims, |y, z, voxels| {
            voxels.iter().for_each(|voxel| see([voxel.x, y, z], &voxel.record));
        })
    }

    /// Returns the value of each code.
    fn decoded<T: Value>(&self) -> adjsplat::Result<Vec<T>> {
        let arena = self.level_arena()?;
        let facts = arena.facts();
        Ok((0..=facts.channels.last_value_code()).map(|code| T::nearest(facts.scales.value(code.into()))).collect())
    }

    fn fill_block<T: Value>(&self, out: &Bound<'_, PyArray3<T>>, low: [u32; 3]) -> PyResult<()> {
        let py = out.py();
        let mut out = out.try_readwrite()?;
        let &[depth, height, width] = out.as_array().shape() else { unreachable!("three dimensions") };
        let block = out.as_slice_mut().map_err(|_| PyValueError::new_err("the block must be contiguous"))?;
        let size = [width, height, depth];
        let mut high = [0; 3];
        for (a, points) in self.arena()?.facts().grid.dims.into_iter().enumerate() {
            let end = u32::try_from(size[a]).ok().and_then(|size| low[a].checked_add(size));
            let outside = || PyValueError::new_err("the block reaches beyond the volume");
            high[a] = end.filter(|&end| end <= points).ok_or_else(outside)?;
        }
        let fill = || {
            let values = self.decoded::<T>()?;
            self.each_row(low, high, |y, z, voxels| {
                let [y, z] = [u32::from(y) - low[1], u32::from(z) - low[2]].map(|at| at as usize);
                let row = &mut block[(z * height + y) * width..][..width];
                for voxel in voxels {
                    row[(u32::from(voxel.x) - low[0]) as usize] = values[usize::from(voxel.record.value)];
                }
            })
        };
        py.detach(fill).map_err(exception)
    }

    fn fill_values<T: Value>(&self, out: &Bound<'_, PyArray1<T>>) -> PyResult<usize> {
        let values = self.decoded::<T>().map_err(exception)?;
        let mut array = out.try_readwrite()?;
        let rows = array.as_slice_mut().map_err(not_contiguous)?.iter_mut();
        self.fill(out.py(), rows, |row, _, record| *row = values[usize::from(record.value)])
    }

    /// Calls `write` with a row of `rows` for each visible voxel, while there are rows; returns how many were written.
    fn fill<R: ExactSizeIterator + Send>(
        &self,
        py: Python<'_>,
        mut rows: R,
        mut write: impl FnMut(R::Item, [u16; 3], &Record) + Send,
    ) -> PyResult<usize> {
        let count = rows.len();
        let mut fill = |place: [u16; 3], record: &Record| {
            if let Some(row) = rows.next() {
                write(row, place, record);
            }
        };
        py.detach(|| self.each_voxel(&mut fill)).map_err(exception)?;
        Ok(count - rows.len())
    }
}

fn not_contiguous<E>(_: E) -> PyErr {
    PyValueError::new_err("the array must be contiguous")
}

/// Writes the values of the visible voxels of a block, whose first point is `low` (x, y, z), to `out` (z, y, x).
#[pyfunction]
pub(crate) fn read_block(model: &Model, out: &Bound<'_, PyAny>, low: [u32; 3]) -> PyResult<()> {
    of_dtype!(out, PyArray3, |array| model.fill_block(array, low))
}

/// Writes the value of each visible voxel to `out`; returns how many there were.
#[pyfunction]
pub(crate) fn read_values(model: &Model, out: &Bound<'_, PyAny>) -> PyResult<usize> {
    of_dtype!(out, PyArray1, |array| model.fill_values(array))
}

/// Writes z, y and x of each visible voxel to a row of `out`; returns how many there were.
#[pyfunction]
pub(crate) fn read_positions(model: &Model, py: Python<'_>, mut out: PyReadwriteArray2<'_, u16>) -> PyResult<usize> {
    let rows = out.as_slice_mut().map_err(not_contiguous)?.as_chunks_mut::<3>().0;
    model.fill(py, rows.iter_mut(), |row, [x, y, z], _| *row = [z, y, x])
}

/// Writes the normal of each visible voxel (x, y, z in the world) to a row of `out`; returns how many there were.
#[pyfunction]
pub(crate) fn read_normals(model: &Model, py: Python<'_>, mut out: PyReadwriteArray2<'_, f32>) -> PyResult<usize> {
    let arena = model.arena()?;
    let (bits, grid) = (arena.facts().channels.normal_bits, &arena.facts().grid);
    let rows = out.as_slice_mut().map_err(not_contiguous)?.as_chunks_mut::<3>().0;
    model.fill(py, rows.iter_mut(), |row, _, record| {
        *row = grid.world_normal(normal::decode(record.normal, bits)).map(f32::nearest);
    })
}

/// Writes the gradient magnitude of each visible voxel to `out`; returns how many there were.
#[pyfunction]
pub(crate) fn read_magnitudes(model: &Model, py: Python<'_>, mut out: PyReadwriteArray1<'_, f64>) -> PyResult<usize> {
    let scale = model.arena()?.facts().scales.magnitude_scale;
    let codec = adjsplat::classify::MagnitudeCodec::new(scale).map_err(exception)?;
    let rows = out.as_slice_mut().map_err(not_contiguous)?.iter_mut();
    model.fill(py, rows, |row, _, record| *row = codec.decode(record.magnitude))
}

/// Writes for each visible voxel of a level the share of its block that is visible to `shares`, and the mean place (z, y, x) of
/// what is visible, in points of the level, to a row of `centres`; returns how many there were.
#[pyfunction]
pub(crate) fn read_coverages(
    model: &Model,
    py: Python<'_>,
    mut shares: PyReadwriteArray1<'_, f32>,
    mut centres: PyReadwriteArray2<'_, f32>,
) -> PyResult<usize> {
    let channels = model.arena()?.facts().channels;
    let shares = shares.as_slice_mut().map_err(not_contiguous)?;
    let centres = centres.as_slice_mut().map_err(not_contiguous)?.as_chunks_mut::<3>().0;
    model.fill(py, shares.iter_mut().zip(centres), |(share, centre), [x, y, z], record| {
        let coverage = Coverage::of_code(record.coverage, channels);
        let [dx, dy, dz] = coverage.offset;
        *share = coverage.share;
        *centre = [f32::from(z) + dz, f32::from(y) + dy, f32::from(x) + dx];
    })
}
