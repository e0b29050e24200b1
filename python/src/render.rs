//! Pictures of a model by the processor, and the settings and cameras that all pictures share.

use adjsplat::splat::{Camera, ClipPlane, Frame, Mode, Orbit, Quality, Sampling, Settings, Up};
use adjsplat::traverse::VoxelBox;
use adjsplat_judge::dial;
use numpy::{IntoPyArray, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::build::threads_or_all;
use crate::errors::exception;
use crate::model::Model;
use crate::watch::{Raised, unless_interrupted};

/// How a picture is made.
#[derive(FromPyObject)]
pub(crate) struct Look {
    /// Columns and rows.
    size: [u32; 2],
    quality: String,
    mode: String,
    sampling: Option<String>,
    lighting: bool,
    exposure: Option<f32>,
    sharpness: Option<f32>,
    /// Lowest and highest coordinates (x, y, z) of the voxels to draw, inclusive.
    crop: Option<[[u16; 3]; 2]>,
    /// A point of the plane in front of which voxels are drawn, and its normal, in the world.
    clip: Option<[[f64; 3]; 2]>,
    /// The level of detail to draw; without, those that suit the picture.
    level: Option<usize>,
    threads: Option<usize>,
}

/// Returns what `names` gives for `name`, or an error that lists them.
fn named<T: Copy>(what: &str, name: &str, names: &[(&str, T)]) -> PyResult<T> {
    let found = names.iter().find(|(known, _)| *known == name).map(|(_, value)| *value);
    found.ok_or_else(|| {
        let known: Vec<&str> = names.iter().map(|(known, _)| *known).collect();
        PyValueError::new_err(format!("{what} is \"{name}\", but must be one of {}", known.join(", ")))
    })
}

impl Look {
    pub(crate) fn settings(&self) -> PyResult<Settings> {
        let quality = named("quality", &self.quality, &Quality::ALL.map(|quality| (quality.name(), quality)))?;
        let modes = [
            ("composite", Mode::Composite),
            ("maximum", Mode::Maximum),
            ("maximum-grey", Mode::MaximumGrey),
            ("xray", Mode::Additive),
        ];
        let samplings = Sampling::ALL.map(|sampling| (sampling.name(), sampling));
        let sampling = self.sampling.as_ref().map(|name| named("sampling", name, &samplings)).transpose()?;
        let crop = self.crop.map(|[low, high]| VoxelBox { low, high });
        let mut settings = Settings::new(self.size)
            .with_quality(quality)
            .with_mode(named("mode", &self.mode, &modes)?)
            .with_sampling(sampling)
            .with_exposure(self.exposure)
            .with_crop(crop)
            .with_clip(self.clip.map(|[point, normal]| ClipPlane { point, normal }))
            .with_level(self.level)
            .with_threads(threads_or_all(self.threads)?);
        if let Some(sharpness) = self.sharpness {
            settings.kernel = Some(quality.kernel().sharpened(sharpness).map_err(exception)?);
        }
        if !self.lighting {
            settings.lighting = None;
        }
        settings.check().map_err(exception)?;
        Ok(settings)
    }
}

/// Parses a camera's JSON.
pub(crate) fn camera(text: &str) -> PyResult<Camera> {
    serde_json::from_str(text).map_err(|fault| {
        // A fault of a number names the camera itself.
        let why = fault.to_string();
        let why = why.strip_prefix("camera").map_or(why.as_str(), |why| why.trim_start_matches([':', ' ']));
        PyValueError::new_err(format!("camera: {why}"))
    })
}

/// Returns a picture as an array of rows, columns and four numbers.
pub(crate) fn picture<'py>(py: Python<'py>, frame: &Frame) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let [columns, rows] = frame.size().map(|side| side as usize);
    frame.pixels().to_vec().into_pyarray(py).reshape([rows, columns, 4])
}

impl Model {
    /// Returns the settings of `look`; the fastest within `max_error`, if that is given. A renderer that draws one sampling
    /// only, whatever the settings say, gives it.
    pub(crate) fn settings(
        &self,
        py: Python<'_>,
        look: &Look,
        camera: &Camera,
        max_error: Option<f64>,
        only_sampling: Option<Sampling>,
    ) -> PyResult<Settings> {
        let mut settings = look.settings()?;
        let Some(bound) = max_error else { return Ok(settings) };
        settings.sampling = only_sampling;
        let raised = Raised::default();
        let chosen = py.detach(|| {
            let go_on = || raised.may_go_on();
            dial::choose(&self.0.scene(), &[*camera], &settings, bound, go_on)
        });
        Ok(raised.or(chosen)?.settings)
    }
}

/// Returns the camera of each orbit (azimuth, elevation), as JSON: all look at one point and have one scale.
#[pyfunction]
pub(crate) fn cameras(
    model: &Model,
    py: Python<'_>,
    look: Look,
    orbits: Vec<[f64; 2]>,
    zoom: f64,
    perspective: Option<f64>,
    up: &str,
) -> PyResult<Vec<String>> {
    let orbits = self::orbits(&orbits, zoom, perspective, up)?;
    let settings = look.settings()?;
    py.detach(|| model.0.cameras(&orbits, &settings)).map(|cameras| json(&cameras)).map_err(exception)
}

/// Returns orbits, given as azimuth and elevation.
pub(crate) fn orbits(angles: &[[f64; 2]], zoom: f64, fov: Option<f64>, up: &str) -> PyResult<Vec<Orbit>> {
    let up = Up::from_name(up).map_err(exception)?;
    Ok(angles.iter().map(|&[azimuth, elevation]| Orbit { azimuth, elevation, zoom, fov, up }).collect())
}

/// Returns each camera as JSON.
pub(crate) fn json(cameras: &[Camera]) -> Vec<String> {
    cameras.iter().map(|camera| serde_json::to_string(camera).expect("a camera's numbers are finite")).collect()
}

/// Draws a picture on the processor: linear light, premultiplied.
#[pyfunction]
pub(crate) fn render<'py>(
    model: &Model,
    py: Python<'py>,
    look: Look,
    camera: &str,
    max_error: Option<f64>,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    let camera = self::camera(camera)?;
    let settings = model.settings(py, &look, &camera, max_error, None)?;
    let frame = unless_interrupted(py, |stop| model.0.render(&camera, &settings.with_stop(stop)))?;
    picture(py, &frame)
}
