//! Pictures of a model by a graphics device, on which its lanes stay from frame to frame.

use std::sync::{Mutex, PoisonError};

use adjsplat::splat::Sampling;
use adjsplat::splat::gpu::adapter::{self, AdapterFacts};
use adjsplat::splat::gpu::{GpuOptions, GpuRenderer};
use numpy::PyArray3;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use self_cell::self_cell;

use crate::errors::exception;
use crate::model::Model;
use crate::render::{Look, camera, picture};

self_cell!(
    /// A renderer with the model that it borrows.
    struct Loaded {
        owner: adjsplat::Model,
        #[not_covariant]
        dependent: GpuRenderer,
    }
);

/// A graphics device that holds a model.
#[pyclass(frozen, module = "adjsplat._native")]
pub(crate) struct Device {
    loaded: Mutex<Loaded>,
    facts: AdapterFacts,
    /// The process that opened the device: a child of it has no device.
    process: u32,
}

#[pymethods]
impl Device {
    /// Opens the best device whose name contains `name`, or the best of all, for pictures of `model`.
    #[new]
    fn new(py: Python<'_>, model: &Model, name: Option<&str>, vram: Option<u64>) -> PyResult<Device> {
        let model = model.0.clone();
        let opened = py.detach(|| {
            let opened = adapter::open(name)?;
            let options = GpuOptions::default();
            let options = options.with_vram(vram.unwrap_or(options.vram));
            let loaded =
                Loaded::try_new(model, |model| GpuRenderer::new(opened.device, opened.queue, model.scene(), options))?;
            Ok(Device { loaded: Mutex::new(loaded), facts: opened.facts, process: std::process::id() })
        });
        opened.map_err(exception)
    }

    /// The device's name.
    #[getter]
    fn name(&self) -> &str {
        &self.facts.name
    }

    /// Draws a picture of `model`, the model that the device holds: linear light, premultiplied.
    fn render<'py>(
        &self,
        py: Python<'py>,
        model: &Model,
        look: Look,
        camera: &str,
        max_error: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        if self.process != std::process::id() {
            return Err(PyRuntimeError::new_err(
                "this renderer's device belongs to the process that opened it; make a new renderer after a fork",
            ));
        }
        let camera = self::camera(camera)?;
        let settings = model.settings(py, &look, &camera, max_error, Some(Sampling::Finer))?;
        let drawn = py.detach(|| {
            let mut loaded = self.loaded.lock().unwrap_or_else(PoisonError::into_inner);
            loaded.with_dependent_mut(|_, renderer| renderer.render(&camera, &settings))
        });
        picture(py, &drawn.map_err(exception)?.0)
    }
}

/// Returns the graphics devices, best first: name, kind, programming interface, driver.
#[pyfunction]
pub(crate) fn devices(py: Python<'_>) -> Vec<(String, String, String, String)> {
    let described = |facts: AdapterFacts| (facts.name, facts.kind.to_owned(), facts.backend, facts.driver);
    py.detach(adapter::adapters).into_iter().map(described).collect()
}
