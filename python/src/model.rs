//! An open model: what its header and its description say.

use std::path::PathBuf;

use adjsplat::arena::Arena;
use adjsplat::collection::Collection;
use adjsplat::error::Error;
use adjsplat::volume::{Axis, Grid};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::bricks::check_bricks;
use crate::errors::exception;
use crate::transfer::parsed;

/// A model of the library, or one of its coarser levels of detail. It never changes, so threads share it.
///
/// Facts, lanes and voxels are those of the level; pictures, edits and exports are for the model itself, level 0.
#[pyclass(frozen, module = "adjsplat._native")]
pub(crate) struct Model(pub(crate) adjsplat::Model, u8);

impl Model {
    /// Returns the model itself, at level 0.
    pub(crate) fn of(model: adjsplat::Model) -> Model {
        Model(model, 0)
    }

    /// Returns the level: the file within the file that holds it.
    pub(crate) fn level_arena(&self) -> adjsplat::Result<Arena<'_>> {
        let missing = || Error::input("level", format!("{} is not in the file", self.1));
        self.0.arena()?.level(self.1).ok_or_else(missing)
    }

    pub(crate) fn arena(&self) -> PyResult<Arena<'_>> {
        self.level_arena().map_err(exception)
    }

    /// Returns the grid of the level.
    fn grid(&self) -> PyResult<Grid> {
        Ok(self.arena()?.facts().grid.clone())
    }
}

/// Returns the axis of this name.
pub(crate) fn axis(name: &str) -> PyResult<Axis> {
    let axis = Axis::ALL.into_iter().find(|axis| axis.name() == name);
    axis.ok_or_else(|| PyValueError::new_err(format!("axis is \"{name}\", but must be x, y or z")))
}

#[pymethods]
impl Model {
    /// Maps an .adj file; or joins a collection in memory, whose bricks are checked first: joined, damage would look sound.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Model> {
        let opened = py.detach(|| {
            if path.is_dir() {
                check_bricks(&Collection::open(&path)?)?;
            }
            adjsplat::Model::open(path)
        });
        opened.map(Model::of).map_err(exception)
    }

    /// Takes the bytes of an .adj file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Model> {
        py.detach(|| adjsplat::Model::from_bytes(bytes.to_vec())).map(Model::of).map_err(exception)
    }

    /// Returns a copy of the bytes of the file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, self.arena()?.bytes()))
    }

    /// Writes the file's bytes to `path`, whole or not at all; returns how many.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<u64> {
        py.detach(|| self.0.save(path)).map_err(exception)
    }

    /// Checks every rule of the format.
    fn verify(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let arena = self.arena()?;
        let checked = py.detach(|| arena.check());
        checked.map(drop).map_err(|fault| exception(Error::Format { path, fault }))
    }

    /// Returns the same voxels with another transfer function, given as JSON.
    fn with_transfer(&self, py: Python<'_>, transfer: &str) -> PyResult<Model> {
        let transfer = parsed(transfer)?;
        py.detach(|| self.0.with_transfer(transfer)).map(Model::of).map_err(exception)
    }

    /// Returns the values that a transfer function shows and the file does not store, as pairs of lowest and highest.
    fn missing_values(&self, py: Python<'_>, transfer: &str) -> PyResult<Vec<[f64; 2]>> {
        let transfer = parsed(transfer)?;
        py.detach(|| self.0.missing_values(&transfer)).map_err(exception)
    }

    /// Points along x, y, z.
    #[getter]
    fn dims(&self) -> PyResult<[u32; 3]> {
        Ok(self.grid()?.dims)
    }

    #[getter]
    fn spacing(&self) -> PyResult<[f64; 3]> {
        Ok(self.grid()?.spacing)
    }

    #[getter]
    fn origin(&self) -> PyResult<[f64; 3]> {
        Ok(self.grid()?.origin)
    }

    /// For each index axis x, y, z its unit vector in the world.
    #[getter]
    fn direction(&self) -> PyResult<[[f64; 3]; 3]> {
        Ok(self.grid()?.direction)
    }

    #[getter]
    fn count(&self) -> PyResult<u64> {
        Ok(self.arena()?.facts().visible_voxels)
    }

    /// Number of coarser levels of detail.
    #[getter]
    fn level_count(&self) -> PyResult<u8> {
        Ok(self.arena()?.level_count())
    }

    /// Returns a coarser level of detail: 1 to `level_count`.
    fn level(&self, number: u8) -> PyResult<Model> {
        let level = Model(self.0.clone(), number);
        level.arena()?;
        Ok(level)
    }

    /// The names of the stored lanes: x, y, z.
    #[getter]
    fn lanes(&self) -> PyResult<Vec<&'static str>> {
        Ok(self.arena()?.lanes().map(|lane| lane.axis.name()).collect())
    }

    /// Bytes of the file, or of the level's part of it.
    #[getter]
    fn nbytes(&self) -> PyResult<usize> {
        Ok(self.arena()?.bytes().len())
    }

    /// A checksum of the header and of the sections' checksums: it differs between files of different content.
    #[getter]
    fn fingerprint(&self) -> PyResult<u64> {
        Ok(self.arena()?.fingerprint())
    }

    /// The description, a JSON text; empty if there is none.
    #[getter]
    fn description(&self) -> PyResult<String> {
        Ok(String::from_utf8_lossy(self.arena()?.description()).into_owned())
    }

    /// The transfer function that pictures are drawn with, as JSON.
    #[getter]
    fn transfer(&self) -> String {
        self.0.transfer().to_json()
    }

    /// Bits of a value, of a component of a normal, of a gradient magnitude, and of a coverage.
    #[getter]
    fn bits(&self) -> PyResult<[u8; 4]> {
        let channels = self.arena()?.facts().channels;
        Ok([channels.value_bits, channels.normal_bits, channels.magnitude_bits, channels.coverage_bits])
    }

    /// The value of code 0, and the difference between neighbouring codes.
    #[getter]
    fn value_scale(&self) -> PyResult<[f64; 2]> {
        let scales = self.arena()?.facts().scales;
        Ok([scales.value_low, scales.value_step])
    }

    /// The lowest and the highest coordinates (x, y, z) of visible voxels; None if a damaged file has none.
    fn bounds(&self, py: Python<'_>) -> PyResult<Option<[[u16; 3]; 2]>> {
        let arena = self.arena()?;
        let bounds = py.detach(|| arena.x_lane().bounds());
        Ok(bounds.map(|(low, high)| [low, high]))
    }
}
