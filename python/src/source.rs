//! Volumes to build from: Python's arrays, slice by slice, and files of every format.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use adjsplat::error::{Error, Result};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Grid, Header, PartSource, Sample, SampleType, Samples, SlabSource};
use adjsplat::{TransferFunction, with_samples};
use adjsplat_readers::{AdjustedSource, OpenOptions, RawOptions, open_slices, parse_type};
use numpy::{Element, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors::{exception, in_python};
use crate::watch::Raised;

/// A volume that a build can read, and what Python raised while it was read.
#[pyclass(frozen, module = "adjsplat._native")]
pub(crate) struct Source {
    volume: Mutex<Box<dyn SlabSource>>,
    pub(crate) raised: Raised,
    /// The transfer function that suits a computed volume.
    pub(crate) own_transfer: Option<TransferFunction>,
}

impl Source {
    fn new(volume: Box<dyn SlabSource>, raised: Raised) -> Source {
        Source { volume: Mutex::new(volume), raised, own_transfer: None }
    }

    pub(crate) fn volume(&self) -> MutexGuard<'_, Box<dyn SlabSource>> {
        self.volume.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Source {
    /// Points along x, y, z.
    #[getter]
    fn dims(&self) -> [u32; 3] {
        self.volume().header().grid.dims
    }

    /// Remarks on how the volume was read, which name arguments of `build`.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.volume().notes().iter().map(|note| in_python(note)).collect()
    }
}

/// The place of a volume's points in the world.
#[derive(FromPyObject)]
pub(crate) struct Place {
    spacing: Option<[f64; 3]>,
    origin: Option<[f64; 3]>,
    /// For each index axis x, y, z its unit vector in the world.
    direction: Option<[[f64; 3]; 3]>,
    unit: Option<String>,
}

impl Place {
    fn set(&self, grid: &mut Grid) {
        grid.spacing = self.spacing.unwrap_or(grid.spacing);
        grid.origin = self.origin.unwrap_or(grid.origin);
        grid.direction = self.direction.unwrap_or(grid.direction);
        if let Some(unit) = &self.unit {
            grid.unit = Some(unit.clone());
        }
    }
}

/// An array whose slices Python hands over.
struct ArraySource {
    header: Header,
    /// A Python function: the index of a slice in, a contiguous array (y, x) of the sample type out.
    slice: Py<PyAny>,
    next: u32,
    buffer_bytes: u64,
    raised: Raised,
}

impl SlabSource for ArraySource {
    fn header(&self) -> &Header {
        &self.header
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<()> {
        let copied = Python::attach(|py| {
            let array = self.slice.call1(py, (self.next,))?.into_bound(py);
            with_samples!(slice, samples => copy(&array, samples))
        });
        self.next += 1;
        copied.map_err(|failure| self.raised.keep(failure))
    }

    fn rewind(&mut self) -> Result<()> {
        self.next = 0;
        Ok(())
    }

    fn buffer_bytes(&self) -> u64 {
        self.buffer_bytes
    }
}

/// Copies a slice. Python may change the array meanwhile only if it does so without its lock.
fn copy<T: Sample + Element>(array: &Bound<'_, PyAny>, samples: &mut [T]) -> PyResult<()> {
    let array = array.cast::<PyArray2<T>>()?.try_readonly()?;
    let from = array.as_slice().map_err(|_| PyValueError::new_err("a slice must be contiguous"))?;
    if from.len() != samples.len() {
        let [have, need] = [from.len(), samples.len()];
        return Err(PyValueError::new_err(format!("a slice has {have} samples, but the array's shape needs {need}")));
    }
    samples.copy_from_slice(from);
    Ok(())
}

/// Wraps an array of `dims` points (x, y, z), whose slices the function `slice` returns; its reader keeps
/// `buffer_bytes` of memory.
#[pyfunction]
pub(crate) fn array_source(
    slice: Py<PyAny>,
    dims: [u64; 3],
    sample_type: &str,
    name: String,
    place: Place,
    buffer_bytes: u64,
) -> PyResult<Source> {
    let (sample_type, _) = parse_type(sample_type).map_err(exception)?;
    let mut grid = Grid::new(dims, [1.0; 3]).map_err(exception)?;
    place.set(&mut grid);
    grid.check().map_err(exception)?;
    let header = Header { grid, sample_type, slope: 1.0, intercept: 0.0, name, format: "array" };
    let raised = Raised::default();
    let source = ArraySource { header, slice, next: 0, buffer_bytes, raised: raised.clone() };
    Ok(Source::new(Box::new(source), raised))
}

/// What a file does not say itself, and which of its volumes is meant.
#[derive(FromPyObject)]
pub(crate) struct Reading {
    /// Points along x, y, z, and the type of samples, such as `u16be`: of a file without a header, or a phantom.
    raw: Option<([u64; 3], String)>,
    skip: u64,
    volume: u32,
    level: u32,
    series: Option<String>,
    outside_files: bool,
    unscaled: bool,
}

/// Opens the volume in `files`, or the computed volume `phantom:NAME`; with `part`, a lowest point and a size (x, y, z), that
/// box of it.
#[pyfunction]
pub(crate) fn file_source(
    py: Python<'_>,
    files: Vec<PathBuf>,
    reading: Reading,
    place: Place,
    part: Option<[[u32; 3]; 2]>,
) -> PyResult<Source> {
    let opened = || -> Result<(Box<dyn SlabSource>, Option<TransferFunction>)> {
        let (source, transfer) = match phantom(&files)? {
            Some(phantom) => {
                let (low, high) = phantom.visible_range();
                let (dims, sample_type) = match &reading.raw {
                    Some((dims, name)) => (*dims, parse_type(name)?.0),
                    None => ([256; 3], SampleType::U8),
                };
                let source = phantom.open(dims, sample_type, place.spacing.unwrap_or([1.0; 3]))?;
                (source, Some(TransferFunction::range(low, high)?))
            }
            None => (open_slices(&files, &reading.options(&place)?)?, None),
        };
        let adjusted = AdjustedSource::new(source, |header| {
            if reading.unscaled {
                (header.slope, header.intercept) = (1.0, 0.0);
            }
            place.set(&mut header.grid);
        });
        adjusted.header().grid.check()?;
        Ok(match part {
            Some([low, size]) => (Box::new(PartSource::new(adjusted, low, size)?) as Box<dyn SlabSource>, transfer),
            None => (Box::new(adjusted), transfer),
        })
    };
    let (volume, own_transfer) = py.detach(opened).map_err(exception)?;
    Ok(Source { own_transfer, ..Source::new(volume, Raised::default()) })
}

/// Returns the phantom that the only name stands for.
fn phantom(files: &[PathBuf]) -> Result<Option<Phantom>> {
    let [file] = files else { return Ok(None) };
    let name = file.to_str().and_then(|text| text.strip_prefix("phantom:"));
    name.map(Phantom::from_name).transpose()
}

impl Reading {
    fn options(&self, place: &Place) -> Result<OpenOptions> {
        let mut options =
            OpenOptions::new().volume_index(self.volume).level(self.level).outside_files(self.outside_files);
        if let Some((dims, name)) = &self.raw {
            let (sample_type, endian) = parse_type(name)?;
            options = options.raw(RawOptions::new(*dims, sample_type).endian(endian).skip(self.skip));
        } else if self.skip != 0 {
            return Err(Error::input("skip", "is for raw files; give shape and dtype too"));
        }
        if let Some(spacing) = place.spacing {
            options = options.spacing(spacing);
        }
        if let Some(series) = &self.series {
            options = options.series(series);
        }
        Ok(options)
    }
}
