//! Building models: which voxels of a volume a model keeps, and how it stores them.

use std::path::Path;

use super::Model;
use crate::arena::Levels;
use crate::build::description;
use crate::build::{BuildOptions, Observer, Resources, Unobserved, classify};
use crate::error::Result;
use crate::file::{RowsOutput, bytes_of_rows, scratch_folder, write_rows};
use crate::volume::SlabSource;
use crate::volume::memory::IntoSlices;

/// A build: which samples are visible, how they are stored, and which resources it may use.
///
/// ```
/// use adjsplat::classify::TransferFunction;
/// use adjsplat::{Build, Volume};
/// let volume = Volume::new([8, 8, 8], (0..512u16).collect())?;
/// let model = Build::new(TransferFunction::range(300.0, f64::INFINITY)?).run(&volume)?;
/// assert_eq!(model.visible_voxels(), 212);
/// # Ok::<(), adjsplat::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Build {
    options: BuildOptions,
    memory: Option<u64>,
    threads: usize,
}

impl Build {
    /// Creates a build with all processors; `options` may be a [`TransferFunction`](crate::TransferFunction) alone, for
    /// the default [`BuildOptions`].
    pub fn new(options: impl Into<BuildOptions>) -> Build {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Build { options: options.into(), memory: None, threads }
    }

    /// Stores coarser levels of detail beside the voxels: a number of them, or [`Levels::Auto`].
    pub fn with_levels(mut self, levels: impl Into<Levels>) -> Build {
        self.options.levels = levels.into();
        self
    }

    /// Bounds the memory of the process, in bytes, while [`Build::write`] runs; at least 64 MiB is sensible.
    pub fn with_memory(mut self, bytes: u64) -> Build {
        self.memory = Some(bytes);
        self
    }

    /// Sets the number of threads that work. The result does not depend on it.
    pub fn with_threads(mut self, threads: usize) -> Build {
        self.threads = threads;
        self
    }

    /// Builds a model in memory.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if nothing is visible or an option is out of range;
    /// [`Error::Limit`](crate::Error::Limit) if the allowed memory is too small, or the volume too large;
    /// [`Error::OutOfMemory`](crate::Error::OutOfMemory); errors of reading.
    pub fn run(&self, volume: impl IntoSlices) -> Result<Model> {
        self.run_observed(volume, &mut Unobserved)
    }

    /// Builds a model as [`Build::run`] does; `observer` receives progress and statistics, and can cancel.
    ///
    /// # Errors
    /// The errors of [`Build::run`]; [`Error::Interrupted`](crate::Error::Interrupted) after a cancel.
    pub fn run_observed(&self, volume: impl IntoSlices, observer: &mut dyn Observer) -> Result<Model> {
        let mut source = volume.into_slices();
        let resources = Resources { memory: self.memory, threads: self.threads, folder: None };
        let built = classify(&mut source, &self.options, &resources, observer)?;
        observer.samples(&built.samples);
        let description = description(source.header(), &built)?;
        let output =
            RowsOutput::of_build(&built, &description, &self.options, &Resources { memory: None, ..resources });
        Model::from_bytes(bytes_of_rows(&built.rows, None, &output, observer)?)
    }

    /// Builds an `.adj` file at `path`, in bounded memory, and memory-maps it. The file appears complete or not at all.
    ///
    /// # Errors
    /// The errors of [`Build::run`]; [`Error::Io`](crate::Error::Io) if the file cannot be written.
    pub fn write(&self, volume: impl IntoSlices, path: impl AsRef<Path>) -> Result<Model> {
        self.write_observed(volume, path, &mut Unobserved)
    }

    /// Builds a file as [`Build::write`] does; `observer` receives progress and statistics, and can cancel.
    ///
    /// # Errors
    /// The errors of [`Build::write`]; [`Error::Interrupted`](crate::Error::Interrupted) after a cancel.
    pub fn write_observed(
        &self,
        volume: impl IntoSlices,
        path: impl AsRef<Path>,
        observer: &mut dyn Observer,
    ) -> Result<Model> {
        let (mut source, path) = (volume.into_slices(), path.as_ref());
        let folder = Some(scratch_folder(path)?);
        let resources = Resources { memory: self.memory, threads: self.threads, folder };
        let built = classify(&mut source, &self.options, &resources, observer)?;
        observer.samples(&built.samples);
        let description = description(source.header(), &built)?;
        let output = RowsOutput::of_build(&built, &description, &self.options, &resources);
        write_rows(path, &built.rows, &output, observer)?;
        drop(built);
        Model::open(path)
    }
}
