//! A model: the visible voxels of a volume, ready to walk and to draw.
//!
//! In: a volume ([`Build`]), or an `.adj` file. Out: a [`Model`], which owns what it needs, so threads, windows and
//! other languages can hold it. It puts together what `arena`, `file`, `traverse` and `splat` do apart.

mod build;
mod transfer;
mod voxels;

use std::path::Path;
use std::sync::Arc;

pub use build::Build;
pub use transfer::{drawable, missing_values, stored_transfer};
pub use voxels::{ModelVoxel, Voxels};

use crate::arena::lanes::DerivedLanes;
use crate::arena::layout::Facts;
use crate::arena::{Arena, Lane};
use crate::classify::TransferFunction;
use crate::error::{Error, FormatFault, Result};
use crate::file::{AdjFile, write_atomically};
use crate::limits::Limits;
use crate::splat::camera::ToCamera;
use crate::splat::{Camera, Frame, Lanes, Scene, Settings, Stats, Surround, cpu};
use crate::traverse::{Batch, Order, Sense, SplitForm, Viewpoint, VoxelBox, walk};
use crate::volume::{Axis, Grid};

/// The visible voxels of a volume and the transfer function that they are drawn with.
///
/// Memory: that of the file's map or of the structure itself. A clone is cheap and shares it; so do threads. A lane that
/// is not stored is derived when a view first needs it, and kept.
#[derive(Debug, Clone)]
pub struct Model {
    stored: Arc<Stored>,
    transfer: Arc<TransferFunction>,
}

/// What clones of a model share.
#[derive(Debug)]
struct Stored {
    bytes: Bytes,
    facts: Facts,
    derived: DerivedLanes,
}

#[derive(Debug)]
enum Bytes {
    Mapped(AdjFile),
    InMemory(Vec<u8>),
}

impl Stored {
    fn arena(&self) -> Result<Arena<'_>> {
        match &self.bytes {
            Bytes::Mapped(file) => file.arena(),
            Bytes::InMemory(bytes) => Arena::new(bytes).map_err(in_memory),
        }
    }
}

fn in_memory(fault: FormatFault) -> Error {
    Error::Format { path: "memory".into(), fault }
}

impl Model {
    /// Maps the `.adj` file at `path`; O(header).
    ///
    /// # Errors
    /// As [`Model::open_with`].
    pub fn open(path: impl AsRef<Path>) -> Result<Model> {
        Model::open_with(path, &Limits::default())
    }

    /// Maps an `.adj` file that need not be trusted: any content is safe to walk and to draw.
    ///
    /// # Errors
    /// As [`AdjFile::open_with`]; [`Error::Input`] if the file stores no transfer function that can be read.
    pub fn open_with(path: impl AsRef<Path>, limits: &Limits) -> Result<Model> {
        let file = AdjFile::open_with(path.as_ref(), limits)?;
        let derived = DerivedLanes::new(limits.derived_bytes);
        Model::new(Bytes::Mapped(file), derived, path.as_ref())
    }

    /// Takes the bytes of an `.adj` file.
    ///
    /// # Errors
    /// [`Error::Format`] if they are no arena; [`Error::Input`] if they store no transfer function that can be read.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Model> {
        Model::new(Bytes::InMemory(bytes), DerivedLanes::new(u64::MAX), "memory".as_ref())
    }

    fn new(bytes: Bytes, derived: DerivedLanes, path: &Path) -> Result<Model> {
        let arena = match &bytes {
            Bytes::Mapped(file) => file.arena()?,
            Bytes::InMemory(bytes) => Arena::new(bytes).map_err(in_memory)?,
        };
        let transfer = stored_transfer(&arena).ok_or_else(|| {
            Error::input(path.display().to_string(), "stores no transfer function that this library reads")
        })?;
        let facts = arena.facts().clone();
        Ok(Model { stored: Arc::new(Stored { bytes, facts, derived }), transfer: Arc::new(transfer) })
    }

    /// Returns the same voxels, drawn with another transfer function.
    ///
    /// Values that it shows but the build left out stay away: see [`Model::missing_values`].
    ///
    /// # Errors
    /// [`Error::Input`] if it needs gradient magnitudes that are not stored.
    pub fn with_transfer(&self, transfer: TransferFunction) -> Result<Model> {
        let transfer = drawable(&self.arena()?, transfer)?;
        Ok(Model { stored: self.stored.clone(), transfer: Arc::new(transfer) })
    }

    /// Returns the values, as ranges of lowest and highest, that `transfer` shows and the build left out.
    ///
    /// # Errors
    /// [`Error::Input`] if the stored scales cannot be used.
    pub fn missing_values(&self, transfer: &TransferFunction) -> Result<Vec<[f64; 2]>> {
        Ok(missing_values(&self.arena()?, transfer)?.unwrap_or_default())
    }

    /// Returns the transfer function that pictures are drawn with.
    pub fn transfer(&self) -> &TransferFunction {
        &self.transfer
    }

    /// Returns where the voxels sit in the world.
    pub fn grid(&self) -> &Grid {
        &self.stored.facts.grid
    }

    /// Returns the number of visible voxels.
    pub fn visible_voxels(&self) -> u64 {
        self.stored.facts.visible_voxels
    }

    /// Returns the smallest box of voxel coordinates that holds all visible voxels. O(tiles).
    ///
    /// # Errors
    /// As [`Model::arena`].
    pub fn bounds(&self) -> Result<Option<VoxelBox>> {
        let bounds = self.arena()?.lane(Axis::X).and_then(|lane| lane.bounds());
        Ok(bounds.map(|(low, high)| VoxelBox { low, high }))
    }

    /// Calls `visit` with all visible voxels in exact visibility order, near voxels first, some at a time.
    ///
    /// # Errors
    /// [`Error::Input`] if the viewpoint cannot be used; [`Error::Limit`] if a lane would have to be derived beyond
    /// the limits.
    pub fn walk(&self, viewpoint: &Viewpoint, mut visit: impl FnMut(&Voxels)) -> Result<()> {
        let facts = &self.stored.facts;
        let order = Order::new(*viewpoint, facts.grid.dims, Sense::FrontToBack, SplitForm::default())?;
        let lane = self.lane(order.fast)?;
        walk(&lane, &order, &mut |batch: &Batch| visit(&Voxels::new(batch, &lane, facts, &order)));
        Ok(())
    }

    /// Draws a picture on the processor.
    ///
    /// `camera` is a [`Camera`], or an [`Orbit`](crate::splat::Orbit) around the visible voxels (or around the crop).
    ///
    /// # Errors
    /// As [`cpu::render`].
    pub fn render(&self, camera: &impl ToCamera, settings: &Settings) -> Result<Frame> {
        Ok(self.render_with_stats(camera, settings)?.0)
    }

    /// Draws a picture as [`Model::render`] does, and says what it took.
    ///
    /// # Errors
    /// As [`cpu::render`].
    pub fn render_with_stats(&self, camera: &impl ToCamera, settings: &Settings) -> Result<(Frame, Stats)> {
        cpu::render(&self.scene(), &self.camera(camera, settings)?, settings)
    }

    /// Returns the camera that [`Model::render`] uses for an orbit.
    ///
    /// # Errors
    /// [`Error::Input`] if a number of the orbit is out of its range.
    pub fn camera(&self, camera: &impl ToCamera, settings: &Settings) -> Result<Camera> {
        let bounds = settings.crop.map_or_else(|| self.bounds(), |crop| Ok(Some(crop)))?;
        let around = match bounds {
            Some(VoxelBox { low, high }) => Surround::of_voxels(self.grid(), low, high),
            None => Surround::of_grid(self.grid()),
        };
        camera.to_camera(around, settings.size)
    }

    /// Returns the scene for renderers that are called directly, such as [`GpuRenderer`](crate::splat::gpu::GpuRenderer).
    pub fn scene(&self) -> Scene<'_> {
        Scene { facts: &self.stored.facts, lanes: self, transfer: &self.transfer }
    }

    /// Returns the structure itself.
    ///
    /// # Errors
    /// [`Error::Format`] if the file was changed in place since it was opened.
    pub fn arena(&self) -> Result<Arena<'_>> {
        self.stored.arena()
    }

    /// Writes the model as an `.adj` file and returns its bytes.
    ///
    /// # Errors
    /// As [`write_atomically`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<u64> {
        let arena = self.arena()?;
        write_atomically(path.as_ref(), |out| {
            out.write_all(arena.bytes())?;
            Ok(arena.bytes().len() as u64)
        })
    }
}

impl Lanes for Model {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.stored.derived.lane(&self.arena()?, axis)
    }
}
