//! The compiled part of the Python package `adjsplat`: arrays in, models and pictures out.
//!
//! The Python files in `python/adjsplat` are what users see: they check arguments, name things as Python does and
//! document them. This part stays thin: each function takes plain values, detaches from the interpreter while the
//! library works, and turns the library's errors into exceptions. `_native.pyi` states its types.
//!
//! ```text
//! source -> build -> model -> voxels, lanes          numpy arrays
//!                      |-> edit, export -> file
//!                      '-> view -> render, device -> pictures -> compare, files
//! ```

mod bricks;
mod build;
mod device;
mod edit;
mod errors;
mod export;
mod lanes;
mod model;
mod pictures;
mod render;
mod source;
mod transfer;
mod voxels;
mod watch;

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    // The crate imports numpy's interface at its first use, and panics if Ctrl-C interrupts that.
    drop(PyArray1::<f32>::zeros(py, 0, false).readonly());
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("FormatError", py.get_type::<errors::FormatError>())?;
    module.add("DeviceError", py.get_type::<errors::DeviceError>())?;
    module.add_class::<model::Model>()?;
    module.add_class::<source::Source>()?;
    module.add_class::<device::Device>()?;
    module.add_class::<bricks::Plan>()?;
    module.add_class::<bricks::Collection>()?;
    module.add_function(wrap_pyfunction!(bricks::split, module)?)?;
    module.add_function(wrap_pyfunction!(source::array_source, module)?)?;
    module.add_function(wrap_pyfunction!(source::file_source, module)?)?;
    module.add_function(wrap_pyfunction!(build::build, module)?)?;
    module.add_function(wrap_pyfunction!(lanes::lane_section, module)?)?;
    module.add_function(wrap_pyfunction!(voxels::read_block, module)?)?;
    module.add_function(wrap_pyfunction!(voxels::read_values, module)?)?;
    module.add_function(wrap_pyfunction!(voxels::read_positions, module)?)?;
    module.add_function(wrap_pyfunction!(voxels::read_normals, module)?)?;
    module.add_function(wrap_pyfunction!(voxels::read_magnitudes, module)?)?;
    module.add_function(wrap_pyfunction!(voxels::read_coverages, module)?)?;
    module.add_function(wrap_pyfunction!(render::cameras, module)?)?;
    module.add_function(wrap_pyfunction!(render::render, module)?)?;
    module.add_function(wrap_pyfunction!(edit::save_edited, module)?)?;
    module.add_function(wrap_pyfunction!(export::export, module)?)?;
    module.add_function(wrap_pyfunction!(transfer::transfer_json, module)?)?;
    module.add_function(wrap_pyfunction!(transfer::transfer_preset, module)?)?;
    module.add_function(wrap_pyfunction!(transfer::transfer_file, module)?)?;
    module.add_function(wrap_pyfunction!(transfer::transfer_opacities, module)?)?;
    module.add_function(wrap_pyfunction!(transfer::transfer_colours, module)?)?;
    module.add_function(wrap_pyfunction!(device::devices, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::compare, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::read_picture, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::check_picture_path, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::encode_png, module)?)?;
    module.add_function(wrap_pyfunction!(pictures::write_pictures, module)?)?;
    Ok(())
}
