//! An open model: what its header and its description say.

use std::path::PathBuf;

use adjsplat::arena::Arena;
use adjsplat::volume::Axis;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::exception;
use crate::transfer::parsed;

/// A model of the library. It never changes, so threads share it.
#[pyclass(frozen, module = "adjsplat._native")]
pub(crate) struct Model(pub(crate) adjsplat::Model);

impl Model {
    pub(crate) fn arena(&self) -> PyResult<Arena<'_>> {
        self.0.arena().map_err(exception)
    }
}

/// Returns the axis of this name.
pub(crate) fn axis(name: &str) -> PyResult<Axis> {
    let axis = Axis::ALL.into_iter().find(|axis| axis.name() == name);
    axis.ok_or_else(|| PyValueError::new_err(format!("axis is \"{name}\", but must be x, y or z")))
}

#[pymethods]
impl Model {
    /// Maps an .adj file.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Model> {
        py.detach(|| adjsplat::Model::open(path)).map(Model).map_err(exception)
    }

    /// Takes the bytes of an .adj file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, bytes: &[u8]) -> PyResult<Model> {
        py.detach(|| adjsplat::Model::from_bytes(bytes.to_vec())).map(Model).map_err(exception)
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
        checked.map(drop).map_err(|fault| exception(adjsplat::Error::Format { path, fault }))
    }

    /// Returns the same voxels with another transfer function, given as JSON.
    fn with_transfer(&self, py: Python<'_>, transfer: &str) -> PyResult<Model> {
        let transfer = parsed(transfer)?;
        py.detach(|| self.0.with_transfer(transfer)).map(Model).map_err(exception)
    }

    /// Returns the values that a transfer function shows and the file does not store, as pairs of lowest and highest.
    fn missing_values(&self, py: Python<'_>, transfer: &str) -> PyResult<Vec<[f64; 2]>> {
        let transfer = parsed(transfer)?;
        py.detach(|| self.0.missing_values(&transfer)).map_err(exception)
    }

    /// Points along x, y, z.
    #[getter]
    fn dims(&self) -> [u32; 3] {
        self.0.grid().dims
    }

    #[getter]
    fn spacing(&self) -> [f64; 3] {
        self.0.grid().spacing
    }

    #[getter]
    fn origin(&self) -> [f64; 3] {
        self.0.grid().origin
    }

    /// For each index axis x, y, z its unit vector in the world.
    #[getter]
    fn direction(&self) -> [[f64; 3]; 3] {
        self.0.grid().direction
    }

    #[getter]
    fn count(&self) -> u64 {
        self.0.visible_voxels()
    }

    /// The names of the stored lanes: x, y, z.
    #[getter]
    fn lanes(&self) -> PyResult<Vec<&'static str>> {
        Ok(self.arena()?.lanes().map(|lane| lane.axis.name()).collect())
    }

    /// Bytes of the file.
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

    /// Bits of a value, of a component of a normal, and of a gradient magnitude.
    #[getter]
    fn bits(&self) -> PyResult<[u8; 3]> {
        let channels = self.arena()?.facts().channels;
        Ok([channels.value_bits, channels.normal_bits, channels.magnitude_bits])
    }

    /// The value of code 0, and the difference between neighbouring codes.
    #[getter]
    fn value_scale(&self) -> PyResult<[f64; 2]> {
        let scales = self.arena()?.facts().scales;
        Ok([scales.value_low, scales.value_step])
    }

    /// The lowest and the highest coordinates (x, y, z) of visible voxels; None if a damaged file has none.
    fn bounds(&self, py: Python<'_>) -> PyResult<Option<[[u16; 3]; 2]>> {
        let bounds = py.detach(|| self.0.bounds()).map_err(exception)?;
        Ok(bounds.map(|bounds| [bounds.low, bounds.high]))
    }
}
