//! Collections: volumes in several files, their plans, and their pictures brick by brick.

use std::path::PathBuf;

use adjsplat::build::{BuildOptions, Resources};
use adjsplat::collection::{self, Partition};
use adjsplat::error::Error;
use adjsplat::internals::stored_transfer;
use adjsplat::splat::Camera;
use numpy::PyArray3;
use pyo3::prelude::*;

use crate::build::{Packing, threads_or_all, warnings};
use crate::errors::exception;
use crate::model::Model;
use crate::render::{self, Look, camera, picture};
use crate::source::Source;
use crate::transfer::parsed;
use crate::watch::{Watch, unless_interrupted};

/// How the bricks of a volume are built; it travels as JSON.
#[pyclass(frozen, module = "adjsplat._native")]
pub(crate) struct Plan(collection::Plan);

/// What a step of a plan may use.
fn resources(memory: Option<u64>, threads: Option<usize>, folder: PathBuf) -> PyResult<Resources> {
    Ok(Resources { memory, threads: threads_or_all(threads)?, folder: Some(folder) })
}

#[pymethods]
impl Plan {
    /// Plans bricks, for each partition of at most so many points (x, y, z), of a volume that need not have samples yet; `transfer` is JSON.
    #[new]
    fn new(
        source: &Source,
        transfer: &str,
        packing: Packing,
        bricks: Vec<[u32; 3]>,
        preview: Option<u32>,
    ) -> PyResult<Plan> {
        let options: BuildOptions = packing.options(parsed(transfer)?);
        let header = source.volume().header().clone();
        let plan = collection::Plan::new(&header, options, &bricks).map_err(exception)?;
        Ok(Plan(match preview {
            Some(every) => plan.with_preview(every),
            None => plan,
        }))
    }

    /// Reads the text of `to_json`.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Plan> {
        collection::Plan::from_json(text).map(Plan).map_err(exception)
    }

    /// Returns the plan as JSON.
    fn to_json(&self) -> String {
        self.0.to_json()
    }

    /// Number of coarser levels of detail that bricks hold.
    #[getter]
    fn level_count(&self) -> usize {
        self.0.level_count()
    }

    /// Number of bricks in each partition.
    #[getter]
    fn counts(&self) -> PyResult<Vec<usize>> {
        let partitions = self.0.partitions().map_err(exception)?;
        Ok(partitions.iter().map(Partition::len).collect())
    }

    /// Returns the lowest point and the size (x, y, z) of the samples that a brick is built from.
    fn samples_of(&self, index: usize) -> PyResult<[[u32; 3]; 2]> {
        let region = self.0.samples_of(index).map_err(exception)?;
        Ok([region.low(), region.size()])
    }

    /// Returns whether bricks can be built.
    fn is_agreed(&self) -> PyResult<bool> {
        self.0.is_agreed().map_err(exception)
    }

    /// Scans a brick and returns what was found, as JSON.
    fn scan(
        &self,
        py: Python<'_>,
        index: usize,
        source: &Source,
        memory: Option<u64>,
        threads: Option<usize>,
    ) -> PyResult<String> {
        let resources = resources(memory, threads, std::env::temp_dir())?;
        let raised = source.raised.clone();
        let mut watch = Watch::new(None, raised.clone());
        let found = py.detach(|| self.0.scan(index, &mut **source.volume(), &resources, &mut watch));
        Ok(serde_json::to_string(&raised.or(found)?).expect("numbers are plain JSON"))
    }

    /// Adds what scans of all bricks found.
    fn agree(&self, findings: Vec<String>) -> PyResult<Plan> {
        let parsed = findings.iter().map(|text| serde_json::from_str(text)).collect::<Result<Vec<_>, _>>();
        let parsed = parsed.map_err(|fault| exception(Error::input("findings", fault.to_string())))?;
        self.0.clone().agree(&parsed).map(Plan).map_err(exception)
    }

    /// Builds a brick as a file in `folder`; returns its number of visible voxels.
    fn build(
        &self,
        py: Python<'_>,
        index: usize,
        source: &Source,
        folder: PathBuf,
        memory: Option<u64>,
        threads: Option<usize>,
    ) -> PyResult<u64> {
        let resources = resources(memory, threads, folder.clone())?;
        let raised = source.raised.clone();
        let mut watch = Watch::new(None, raised.clone());
        let built = py.detach(|| self.0.build(index, &mut **source.volume(), &folder, &resources, &mut watch));
        raised.or(built)
    }

    /// Makes a collection of the bricks in `folder`.
    fn finish(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        let raised = crate::watch::Raised::default();
        let mut watch = Watch::new(None, raised.clone());
        let finished = py.detach(|| self.0.finish(&folder, &mut watch));
        raised.or(finished).map(drop)
    }

    /// Returns what a user should know of the samples, one line each.
    fn warnings(&self) -> PyResult<Vec<String>> {
        self.0.samples().map(|samples| warnings(&samples)).map_err(exception)
    }
}

/// A brick: its lowest point and size (x, y, z), its number of visible voxels, and its file.
type Listed = ([u32; 3], [u32; 3], u64, Option<String>);

/// An open collection.
#[pyclass(frozen, module = "adjsplat._native")]
pub(crate) struct Collection(collection::Collection);

#[pymethods]
impl Collection {
    /// Opens the collection in a folder; with `partial` bricks may be missing.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf, partial: bool) -> PyResult<Collection> {
        let opened = py.detach(|| {
            let collection = collection::Collection::open(path)?;
            if !partial {
                collection.require_all()?;
            }
            Ok(collection)
        });
        opened.map(Collection).map_err(exception)
    }

    /// Points along x, y, z.
    #[getter]
    fn dims(&self) -> [u32; 3] {
        self.0.grid().dims
    }

    /// Number of visible voxels of the whole.
    #[getter]
    fn count(&self) -> u64 {
        self.0.manifest().visible_voxels
    }

    /// Number of coarser levels of detail that bricks hold.
    #[getter]
    fn level_count(&self) -> usize {
        self.0.levels().len()
    }

    /// The paths of the bricks, the preview and the manifest.
    #[getter]
    fn files(&self) -> Vec<PathBuf> {
        self.0.files().collect()
    }

    /// The bricks, partition after partition.
    #[getter]
    fn bricks(&self) -> Vec<Listed> {
        let entries = self.0.bricks().iter().map(|brick| &brick.entry);
        entries.map(|entry| (entry.low, entry.size, entry.visible_voxels, entry.file.clone())).collect()
    }

    /// What is wrong with bricks and the preview, one line each.
    #[getter]
    fn faults(&self) -> Vec<String> {
        self.0.faults().iter().chain(self.0.preview_fault()).map(ToString::to_string).collect()
    }

    /// The name of the preview's file; None if there is none that can be used.
    #[getter]
    fn preview(&self) -> Option<String> {
        let usable = self.0.preview().and(self.0.manifest().preview.as_ref());
        usable.map(|preview| preview.file.clone())
    }

    /// Checks every byte of every brick and of the preview; returns what is wrong, one line each.
    fn check(&self, py: Python<'_>) -> Vec<String> {
        py.detach(|| self.0.check().iter().map(ToString::to_string).collect())
    }

    /// Joins the bricks to a file and opens it. `checks`: whether every byte of the bricks is checked first, and whether those that
    /// are damaged are left out. Also returns what is wrong with bricks that are left out, one line each.
    fn join(
        &self,
        py: Python<'_>,
        path: PathBuf,
        checks: [bool; 2],
        memory: Option<u64>,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Model, Vec<String>)> {
        let threads = threads_or_all(threads)?;
        let raised = crate::watch::Raised::default();
        let mut watch = Watch::new(progress, raised.clone());
        let joined = py.detach(|| {
            let mut checked = None;
            match checks {
                [true, true] => checked.insert(collection::Collection::open(self.0.path())?).leave_out_damaged(),
                [true, false] => check_bricks(&self.0)?,
                [false, _] => {}
            }
            let collection = checked.as_ref().unwrap_or(&self.0);
            collection.join(&path, memory, threads, &mut watch)?;
            Ok((adjsplat::Model::open(&path)?, collection.faults().iter().map(ToString::to_string).collect()))
        });
        raised.or(joined).map(|(model, faults)| (Model::of(model), faults))
    }

    /// Returns the camera of each orbit (azimuth, elevation), as JSON: all look at one point and have one scale.
    fn cameras(
        &self,
        py: Python<'_>,
        look: Look,
        orbits: Vec<[f64; 2]>,
        zoom: f64,
        perspective: Option<f64>,
        up: &str,
    ) -> PyResult<Vec<String>> {
        let orbits = render::orbits(&orbits, zoom, perspective, up)?;
        let settings = look.settings()?;
        let framed = || Camera::framing(&orbits, &self.0.outline(settings.crop)?, settings.size);
        py.detach(framed).map(|cameras| render::json(&cameras)).map_err(exception)
    }

    /// Returns the indices of the bricks that have files, the nearest first.
    fn front_to_back(&self, look: Look, camera: &str) -> PyResult<Vec<usize>> {
        let (settings, camera) = (look.settings()?, self::camera(camera)?);
        let order = self.0.front_to_back(&camera, &settings).map_err(exception)?;
        Ok(order.into_iter().filter(|&index| self.0.bricks()[index].file.is_some()).collect())
    }

    /// Returns a transfer function (JSON) with the numbers filled in that follow from all bricks, and the values that it shows and the
    /// build left out.
    fn drawable(&self, py: Python<'_>, transfer: &str) -> PyResult<(String, Vec<[f64; 2]>)> {
        let transfer = parsed(transfer)?;
        let filled_in = || {
            let transfer = self.0.drawable(transfer)?;
            let missing = self.0.missing_values(&transfer)?;
            Ok((transfer.to_json(), missing))
        };
        py.detach(filled_in).map_err(exception)
    }

    /// Draws one brick; None if nothing of it is in the picture. `transfer` is JSON that [`Collection::drawable`] returned; without,
    /// the file's own.
    fn render_brick<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        look: Look,
        camera: &str,
        transfer: Option<&str>,
    ) -> PyResult<Option<Bound<'py, PyArray3<f32>>>> {
        let (settings, camera) = (look.settings()?, self::camera(camera)?);
        let given = transfer.map(parsed).transpose()?;
        let missing = || match self.0.bricks().get(index).and_then(|brick| brick.entry.file.as_ref()) {
            Some(name) => Error::input(self.0.path().join(name).display().to_string(), "is missing or cannot be used"),
            None => Error::input("brick", format!("{index} does not exist, or has no file")),
        };
        let drawn = unless_interrupted(py, |stop| {
            let file = self.0.bricks().get(index).and_then(|brick| brick.file.as_ref()).ok_or_else(missing)?;
            let arena = file.arena()?;
            let transfer = match given {
                Some(transfer) => transfer,
                None => stored_transfer(&arena).ok_or_else(|| {
                    Error::input(file.path().display().to_string(), "stores no transfer function that can be read")
                })?,
            };
            self.0.render_brick(index, &transfer, &camera, &settings.with_stop(stop))
        })?;
        match drawn {
            Some((frame, stats)) if stats.splats_drawn > 0 => picture(py, &frame).map(Some),
            _ => Ok(None),
        }
    }
}

/// Checks every byte of every brick.
///
/// # Errors
/// [`Error::Format`] that names the first brick that is damaged.
pub(crate) fn check_bricks(collection: &collection::Collection) -> adjsplat::Result<()> {
    collection.bricks().iter().try_for_each(|brick| brick.check().map(drop))
}

/// Splits a model in the new folder `path` into bricks, for each partition of at most so many points (x, y, z).
#[pyfunction]
pub(crate) fn split(
    py: Python<'_>,
    model: &Model,
    path: PathBuf,
    bricks: Vec<[u32; 3]>,
    preview: Option<u32>,
    memory: Option<u64>,
    threads: Option<usize>,
) -> PyResult<()> {
    let threads = threads_or_all(threads)?;
    let arena = model.arena()?;
    if stored_transfer(&arena).as_ref() != Some(model.0.transfer()) {
        let why = "is not the one that the model was built with, which bricks keep; split the model without with_transfer, \
                   and draw the bricks with Collection.render(transfer=...)";
        return Err(exception(Error::input("transfer function", why)));
    }
    let raised = crate::watch::Raised::default();
    let mut watch = Watch::new(None, raised.clone());
    let done = py.detach(|| {
        let dims = arena.facts().grid.dims;
        let partitions =
            bricks.iter().map(|&size| Partition::into_boxes(dims, size)).collect::<adjsplat::Result<Vec<_>>>()?;
        collection::split(&arena, &partitions, preview, &path, memory, threads, &mut watch)
    });
    raised.or(done).map(drop)
}
