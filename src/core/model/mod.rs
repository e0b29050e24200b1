//! A model: the visible voxels of a volume, ready to walk and to draw.
//!
//! In: a volume ([`Build`]), or an `.adj` file. Out: a [`Model`], which owns what it needs, so threads, windows and
//! other languages can hold it. It combines the modules `arena`, `file`, `traverse` and `splat`.

mod build;
mod transfer;
mod voxels;

use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;

pub use build::Build;
pub use transfer::{drawable, missing_values, stored_transfer};
pub(crate) use transfer::{drawable_with, missing_values_of};
pub use voxels::{ModelVoxel, Voxels};

use crate::arena::lanes::LevelLanes;
use crate::arena::layout::Facts;
use crate::arena::{Arena, CodeCounts, Detail, Directory, Lane};
use crate::build::Unobserved;
use crate::classify::TransferFunction;
use crate::collection::Collection;
use crate::error::{Error, Result};
use crate::file::{AdjFile, write_atomically};
use crate::limits::Limits;
use crate::splat::camera::ToCamera;
use crate::splat::setup::walk_order;
use crate::splat::{Camera, Frame, Lanes, Orbit, Outline, Scene, Settings, Stats, View, cpu};
use crate::traverse::{Batch, Order, Sense, SplitForm, Viewpoint, VoxelBox, walk};
use crate::volume::{Axis, Grid};

/// The visible voxels of a volume and the transfer function that they are drawn with.
///
/// Its bytes are a mapped file or lie in memory; clones are cheap and share them, also between threads. A lane (all
/// scan lines along one axis) that is not stored is derived when a view first needs it, and kept.
#[derive(Debug, Clone)]
pub struct Model {
    stored: Arc<Stored>,
    transfer: Arc<TransferFunction>,
}

/// The part of a model that its clones share.
#[derive(Debug)]
struct Stored {
    bytes: Bytes,
    facts: Facts,
    lanes: LevelLanes,
}

#[derive(Debug)]
enum Bytes {
    Mapped(AdjFile),
    InMemory(Vec<u8>),
    /// The channels are not in memory; counts of their codes, those of level 0 first.
    Elsewhere(Arc<Directory>, Vec<CodeCounts>),
}

impl Bytes {
    fn arena(&self) -> Result<Arena<'_>> {
        match self {
            Bytes::Mapped(file) => file.arena(),
            Bytes::InMemory(bytes) => Arena::new(bytes).map_err(|fault| Error::Format { path: "memory".into(), fault }),
            Bytes::Elsewhere(directory, codes) => Ok(directory.arena(&codes[0])),
        }
    }

    /// Returns the arena of a level; `None` if there is no such level.
    fn level(&self, level: u8) -> Result<Option<Arena<'_>>> {
        let Bytes::Elsewhere(directory, codes) = self else { return Ok(self.arena()?.level(level)) };
        let codes = codes.get(usize::from(level));
        Ok(directory.level(level.into()).zip(codes).map(|(directory, codes)| directory.arena(codes)))
    }
}

impl Model {
    /// Opens the `.adj` file or the collection at `path`, with default limits. A file is memory-mapped, and only its header is
    /// read. A collection is read as a whole and joined in memory.
    ///
    /// # Errors
    /// The errors of [`Model::open_with`].
    pub fn open(path: impl AsRef<Path>) -> Result<Model> {
        Model::open_with(path, &Limits::default())
    }

    /// Memory-maps an `.adj` file that need not be trusted: any content is safe to walk and to draw.
    ///
    /// A [`Collection`] is joined in memory, in at most the bytes that `limits` allow for derived lanes.
    ///
    /// # Errors
    /// The errors of [`AdjFile::open_with`]; [`Error::Input`] if the file stores no readable transfer function, or if a
    /// collection lacks bricks.
    pub fn open_with(path: impl AsRef<Path>, limits: &Limits) -> Result<Model> {
        if Collection::is_at(path.as_ref()) {
            let collection = Collection::open_with(path.as_ref(), limits)?;
            collection.require_all()?;
            let threads = std::thread::available_parallelism().map_or(1, usize::from);
            let bytes = collection.joined_bytes(usize::MAX, limits.derived_bytes, threads, &mut Unobserved)?;
            return Model::new(Bytes::InMemory(bytes), limits.derived_bytes, path.as_ref());
        }
        let file = AdjFile::open_with(path.as_ref(), limits)?;
        Model::new(Bytes::Mapped(file), limits.derived_bytes, path.as_ref())
    }

    /// Creates a model from the bytes of an `.adj` file.
    ///
    /// # Errors
    /// [`Error::Format`] if they are no `.adj` file; [`Error::Input`] if they store no readable transfer function.
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Model> {
        Model::new(Bytes::InMemory(bytes), u64::MAX, "memory".as_ref())
    }

    /// Creates a model of a file of which only the directory is in memory; `codes` counts the voxels of each level of detail that
    /// have arrived, those of level 0 first. Where it is shorter, no voxels have.
    ///
    /// Its pictures are drawn by a graphics device that [receives](crate::splat::gpu::Resident::receive) the channels; lanes
    /// that the file does not store are not derived.
    ///
    /// # Errors
    /// [`Error::Input`], which names the file as `name`, if it stores no readable transfer function.
    pub fn from_directory(directory: Arc<Directory>, mut codes: Vec<CodeCounts>, name: &str) -> Result<Model> {
        codes.resize(directory.level_count() + 1, CodeCounts::default());
        Model::new(Bytes::Elsewhere(directory, codes), 0, name.as_ref())
    }

    /// Derived lanes of each level may take `derived_bytes` in all.
    fn new(bytes: Bytes, derived_bytes: u64, path: &Path) -> Result<Model> {
        let arena = bytes.arena()?;
        let transfer = stored_transfer(&arena).ok_or_else(|| {
            Error::input(path.display().to_string(), "stores no transfer function that this library reads")
        })?;
        let facts = arena.facts().clone();
        let level = |level| bytes.level(level).ok().flatten();
        let lanes = LevelLanes::new(&arena, level, Some(transfer.clone()), derived_bytes);
        Ok(Model { stored: Arc::new(Stored { bytes, facts, lanes }), transfer: Arc::new(transfer) })
    }

    /// Returns the same voxels, drawn with another transfer function.
    ///
    /// Voxels that `transfer` shows but the build left out stay invisible: see [`Model::missing_values`].
    ///
    /// # Errors
    /// [`Error::Input`] if `transfer` needs gradient magnitudes that are not stored.
    pub fn with_transfer(&self, transfer: TransferFunction) -> Result<Model> {
        let transfer = drawable(&self.arena()?, transfer)?;
        Ok(Model { stored: self.stored.clone(), transfer: Arc::new(transfer) })
    }

    /// Returns the values that `transfer` shows and the build left out, as ranges `[lowest, highest]`.
    ///
    /// # Errors
    /// [`Error::Input`] if the stored scale of magnitudes is out of range.
    pub fn missing_values(&self, transfer: &TransferFunction) -> Result<Vec<[f64; 2]>> {
        Ok(missing_values(&self.arena()?, transfer)?.unwrap_or_default())
    }

    /// Returns the transfer function that pictures are drawn with.
    pub fn transfer(&self) -> &TransferFunction {
        &self.transfer
    }

    /// Returns the unit of lengths that the file's description states; its grid has none.
    pub fn unit(&self) -> Option<String> {
        #[derive(Deserialize)]
        struct Description {
            unit: Option<String>,
        }
        let Description { unit } = serde_json::from_slice(self.arena().ok()?.description()).ok()?;
        unit
    }

    /// Returns the grid: the number of voxels along each axis, and their positions in the world.
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
    /// The errors of [`Model::arena`].
    pub fn bounds(&self) -> Result<Option<VoxelBox>> {
        let bounds = self.arena()?.x_lane().bounds();
        Ok(bounds.map(|(low, high)| VoxelBox { low, high }))
    }

    /// Calls `visit` with all visible voxels in exact visibility order, near voxels first, in groups from one slice.
    ///
    /// # Errors
    /// [`Error::Input`] if the viewpoint cannot be used; [`Error::Limit`] if the walk needs a lane that is not stored
    /// and cannot be derived within the model's limits.
    pub fn walk(&self, viewpoint: &Viewpoint, visit: impl FnMut(&Voxels)) -> Result<()> {
        let order = Order::new(*viewpoint, self.grid().dims, Sense::FrontToBack, SplitForm::default())?;
        self.walk_lane(&self.lane(order.fast)?.at_hand()?, viewpoint, visit)
    }

    /// Walks as [`Model::walk`] does, but only over the voxels of `lane`: of the model's, or of some of its tiles.
    ///
    /// # Errors
    /// [`Error::Input`] if the viewpoint cannot be used.
    pub fn walk_lane(&self, lane: &Lane, viewpoint: &Viewpoint, mut visit: impl FnMut(&Voxels)) -> Result<()> {
        let facts = &self.stored.facts;
        let order = Order::new(*viewpoint, facts.grid.dims, Sense::FrontToBack, SplitForm::default())?;
        let order = order.with_fast(lane.axis);
        walk(lane, &order, &mut |batch: &Batch| visit(&Voxels::new(batch, lane, facts, &order)));
        Ok(())
    }

    /// Returns the order in which a picture visits the voxels, along which axis for instance lines run.
    ///
    /// # Errors
    /// [`Error::Input`] if the camera or the settings cannot be used.
    pub fn order(&self, camera: &Camera, settings: &Settings) -> Result<Order> {
        let view = View::new(camera, self.grid(), settings.size, settings.kernel(), settings.near)?;
        walk_order(&view, self.grid(), settings)
    }

    /// Draws a picture on the processor.
    ///
    /// `camera` is a [`Camera`], or an [`Orbit`](crate::splat::Orbit) around the visible voxels (or around the crop).
    ///
    /// # Errors
    /// The errors of [`cpu::render`].
    pub fn render(&self, camera: &impl ToCamera, settings: &Settings) -> Result<Frame> {
        Ok(self.render_with_stats(camera, settings)?.0)
    }

    /// Draws a picture as [`Model::render`] does, and also returns counts and times.
    ///
    /// # Errors
    /// The errors of [`cpu::render`].
    pub fn render_with_stats(&self, camera: &impl ToCamera, settings: &Settings) -> Result<(Frame, Stats)> {
        cpu::render(&self.scene(), &self.camera(camera, settings)?, settings)
    }

    /// Returns the [`Camera`] that [`Model::render`] uses for `camera`, such as an orbit.
    ///
    /// # Errors
    /// [`Error::Input`] if a number of the orbit is out of its range.
    pub fn camera(&self, camera: &impl ToCamera, settings: &Settings) -> Result<Camera> {
        let lane = Lanes::lane(self, Axis::X)?;
        camera.to_camera(&Outline::of_lane(self.grid(), lane, settings.crop), settings.size)
    }

    /// Returns the cameras of several orbits, such as the frames of a turn: they look at one point and have one scale.
    ///
    /// # Errors
    /// The errors of [`Camera::framing`].
    pub fn cameras(&self, orbits: &[Orbit], settings: &Settings) -> Result<Vec<Camera>> {
        let lane = Lanes::lane(self, Axis::X)?;
        Camera::framing(orbits, &Outline::of_lane(self.grid(), lane, settings.crop), settings.size)
    }

    /// Returns the scene for renderers that you call directly, such as [`GpuRenderer`](crate::splat::gpu::GpuRenderer).
    pub fn scene(&self) -> Scene<'_> {
        Scene { facts: &self.stored.facts, lanes: self, transfer: &self.transfer }
    }

    /// Returns the arena: the stored structure, with its lanes, tiles and records.
    ///
    /// # Errors
    /// [`Error::Format`] if the file was changed in place since it was opened.
    pub fn arena(&self) -> Result<Arena<'_>> {
        self.stored.bytes.arena()
    }

    /// Writes the model as an `.adj` file and returns its length in bytes. The file keeps the transfer function that the model was
    /// built with, not that of [`Model::with_transfer`].
    ///
    /// # Errors
    /// The errors of [`write_atomically`].
    pub fn save(&self, path: impl AsRef<Path>) -> Result<u64> {
        let arena = self.arena()?;
        arena.lanes().try_for_each(|lane| lane.at_hand().map(|_| ()))?;
        write_atomically(path.as_ref(), |out| {
            out.write_all(arena.bytes())?;
            Ok(arena.bytes().len() as u64)
        })
    }
}

impl Lanes for Model {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane_of(0, axis)
    }

    fn detail(&self) -> Detail<'_> {
        self.stored.lanes.detail()
    }

    fn lane_of(&self, level: usize, axis: Axis) -> Result<Lane<'_>> {
        self.stored.lanes.lane(level, axis, |level| self.stored.bytes.level(level))
    }
}
