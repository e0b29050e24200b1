//! Pictures of a collection, brick by brick: each brick is drawn alone, and its picture put behind those of nearer bricks.
//!
//! Optical depths of a pixel add up to the same sum, so alpha is exact. Colours are exact where a view looks along the
//! cuts' axis; elsewhere splats that reach across a cut are composited a brick at a time (docs/clusters.md has
//! the measured differences).

use std::collections::BTreeSet;

use super::Collection;
use super::levels::WholeLevels;
use crate::arena::Detail;
use crate::arena::layout::Facts;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::model::{drawable_with, missing_values_of};
use crate::splat::camera::Projection;
use crate::splat::camera::ToCamera;
use crate::splat::levels::level_parts;
use crate::splat::setup::walk_order;
use crate::splat::{Camera, Frame, Mode, Outline, Scene, Settings, Stats, View, cpu};
use crate::traverse::VoxelBox;
use crate::volume::grid::coordinate16;

impl Collection {
    /// Returns the [`Camera`] of an orbit around the visible voxels of all bricks, as a picture of the joined file has it.
    ///
    /// # Errors
    /// [`Error::Input`] if a number of the orbit is out of its range; [`Error::Format`] if a file was changed in place.
    pub fn camera(&self, camera: &impl ToCamera, settings: &Settings) -> Result<Camera> {
        camera.to_camera(&self.outline(settings.crop)?, settings.size)
    }

    /// Returns `transfer` with the numbers filled in that follow from all bricks, so that it colours each as a part of the whole: voxel
    /// length, largest magnitude, and where the colours of a range function's open ends stop. For the last one, every voxel is read.
    ///
    /// # Errors
    /// [`Error::Input`] if `transfer` needs gradient magnitudes that are not stored; [`Error::Format`] if a file was changed in place
    /// since it was opened.
    pub fn drawable(&self, transfer: TransferFunction) -> Result<TransferFunction> {
        let files = || self.once().iter().filter_map(|brick| brick.file.as_ref());
        let largest =
            || files().try_fold(0, |largest, file| Ok(file.arena()?.x_lane().largest_value_code().max(largest)));
        drawable_with(&self.manifest().facts(), transfer, largest)
    }

    /// Returns the values that `transfer` shows and the build left out, as ranges `[lowest, highest]`.
    ///
    /// # Errors
    /// [`Error::Input`] if the stored scale of magnitudes is out of range.
    pub fn missing_values(&self, transfer: &TransferFunction) -> Result<Vec<[f64; 2]>> {
        let manifest = self.manifest();
        let missing = missing_values_of(&manifest.facts(), manifest.description().as_bytes(), transfer)?;
        Ok(missing.unwrap_or_default())
    }

    /// Returns the outline of the visible voxels of all bricks; with a `crop`, of those in that box.
    ///
    /// # Errors
    /// [`Error::Format`] if a file was changed in place since it was opened.
    pub fn outline(&self, crop: Option<VoxelBox>) -> Result<Outline<'_>> {
        let mut lanes = Vec::new();
        for brick in self.once() {
            let Some(file) = &brick.file else { continue };
            let lane = file.arena()?.x_lane();
            lanes.push((brick.entry.low.map(coordinate16), lane));
        }
        Ok(Outline::of_lanes(self.grid(), lanes, crop))
    }

    /// Returns the indices of the bricks of one partition, the nearest first: none hides an earlier one.
    ///
    /// The partition is one that cuts only the axis along which the view looks most, if there is one: its picture is exact.
    ///
    /// # Errors
    /// [`Error::Input`] if the camera cannot be used.
    pub fn front_to_back(&self, camera: &Camera, settings: &Settings) -> Result<Vec<usize>> {
        let view = View::new(camera, self.grid(), settings.size, settings.kernel(), settings.near)?;
        let slow = walk_order(&view, self.grid(), settings)?.slow;
        let cuts = self.manifest().cuts();
        let number = cuts.iter().position(|partition| partition.cuts_only(slow)).unwrap_or(0);
        let first = self.bricks_of(number).start;
        let order = cuts[number].front_to_back(view.viewpoint)?;
        Ok(order.into_iter().map(|index| first + index).collect())
    }

    /// Draws brick `index` alone, with the transfer function of the whole, which [`Collection::drawable`] returns; `None` if nothing
    /// of it is to be drawn.
    ///
    /// # Errors
    /// The errors of [`cpu::render`].
    ///
    /// # Panics
    /// If there is no brick `index`.
    pub fn render_brick(
        &self,
        index: usize,
        transfer: &TransferFunction,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<Option<(Frame, Stats)>> {
        let brick = &self.bricks()[index];
        let Some(crop) = cropped(settings.crop, brick.entry.low, brick.entry.size) else { return Ok(None) };
        let Some(lanes) = brick.lanes()? else { return Ok(None) };
        let scene = Scene { facts: lanes.arena().facts(), lanes: &lanes, transfer };
        let level = self.level(transfer, camera, settings)?;
        let settings = Settings { crop, level, ..settings.clone() };
        cpu::render(&scene, camera, &settings).map(Some)
    }

    /// Returns the level of detail that all bricks are drawn from; `None` if each is drawn from the levels that suit its distance
    /// from the eye, as in perspective.
    fn level(&self, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Result<Option<usize>> {
        let scene = Scene { facts: &self.manifest().facts(), lanes: &WholeLevels(self.detail()), transfer };
        if let Some(level) = settings.level {
            if level > self.levels().len() {
                let why = format!("is {level}, but the collection has levels 0 to {}", self.levels().len());
                return Err(Error::input("level", why));
            }
            return Ok(Some(level));
        }
        if matches!(camera.projection(), Projection::Perspective { .. }) {
            return Ok(None);
        }
        // A crop that leaves no block of the level leaves nothing to draw.
        Ok(Some(level_parts(&scene, camera, settings)?.first().map_or(0, |part| part.level)))
    }

    /// Returns how many coarser levels of detail to join, so that pictures are the same as with all levels.
    ///
    /// # Errors
    /// [`Error::Input`] if a camera or the level cannot be used.
    pub fn levels_needed(&self, transfer: &TransferFunction, cameras: &[Camera], settings: &Settings) -> Result<usize> {
        let facts = Facts { visible_voxels: self.visible_voxels(), ..self.manifest().facts() };
        let parts = |camera: &Camera, count: usize| {
            let lanes = WholeLevels(Detail { levels: &self.levels()[..count], ..self.detail() });
            level_parts(&Scene { facts: &facts, lanes: &lanes, transfer }, camera, settings)
        };
        let mut needed = 0;
        for camera in cameras {
            let all = parts(camera, self.levels().len())?;
            while !parts(camera, needed).is_ok_and(|parts| parts == all) {
                needed += 1;
            }
        }
        Ok(needed)
    }

    /// Returns the levels of detail that a picture of all bricks shows, finest first; 0 for the voxels themselves.
    ///
    /// # Errors
    /// [`Error::Input`] if the camera or the level cannot be used.
    pub fn levels_drawn(
        &self,
        transfer: &TransferFunction,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<BTreeSet<usize>> {
        let level = self.level(transfer, camera, settings)?;
        if let Some(level) = level {
            return Ok(BTreeSet::from([level]));
        }
        let mut drawn = BTreeSet::new();
        for index in self.front_to_back(camera, settings)? {
            let brick = &self.bricks()[index];
            let Some(crop) = cropped(settings.crop, brick.entry.low, brick.entry.size) else { continue };
            let Some(lanes) = brick.lanes()? else { continue };
            let scene = Scene { facts: lanes.arena().facts(), lanes: &lanes, transfer };
            let parts = level_parts(&scene, camera, &Settings { crop, level, ..settings.clone() })?;
            drawn.extend(parts.into_iter().map(|part| part.level));
        }
        Ok(drawn)
    }

    /// Draws a picture brick by brick, on the processor; returns it with the sums of the bricks' counts and times.
    ///
    /// Bricks with faults are left out: ask [`Collection::require_all`] first.
    ///
    /// # Errors
    /// The errors of [`Collection::front_to_back`] and [`Collection::render_bricks`].
    pub fn render(&self, transfer: &TransferFunction, camera: &Camera, settings: &Settings) -> Result<(Frame, Stats)> {
        self.render_bricks(&self.front_to_back(camera, settings)?, transfer, camera, settings)
    }

    /// Draws a picture of `bricks`, the nearest first: some of those that [`Collection::front_to_back`] returns.
    ///
    /// Pictures of consecutive parts of its list give the whole picture when [`Frame::put_behind`] puts them together.
    ///
    /// # Errors
    /// [`Error::Input`] in the maximum modes, whose values are interpolated across bricks (join them first), and in the
    /// additive mode without an exposure; the errors of [`cpu::render`].
    pub fn render_bricks(
        &self,
        bricks: &[usize],
        transfer: &TransferFunction,
        camera: &Camera,
        settings: &Settings,
    ) -> Result<(Frame, Stats)> {
        if settings.mode.is_maximum() {
            let why = "interpolates between bricks, so it cannot be drawn brick by brick; join them first";
            return Err(Error::input("mode maximum", why));
        }
        if settings.mode == Mode::Additive && settings.exposure.is_none() {
            let why = "must be given to draw brick by brick: by default each brick would have its own";
            return Err(Error::input("exposure", why));
        }
        let mut picture = Frame::transparent(settings.size)?;
        let mut all = Stats::default();
        for &index in bricks {
            let Some((frame, stats)) = self.render_brick(index, transfer, camera, settings)? else { continue };
            if stats.splats_drawn > 0 {
                picture.put_behind(&frame, settings.mode);
            }
            all.add(&stats);
        }
        Ok((picture, all))
    }
}

/// Returns the part of `crop` in a brick, counted from the brick's lowest point; `None` if there is none. No crop stays none.
#[expect(clippy::option_option, reason = "whether to draw, and what of it")]
fn cropped(crop: Option<VoxelBox>, low: [u32; 3], size: [u32; 3]) -> Option<Option<VoxelBox>> {
    let Some(crop) = crop else { return Some(None) };
    let mut part = crop;
    for a in 0..3 {
        let (first, last) = (low[a], low[a] + size[a] - 1);
        let (from, to) = (u32::from(crop.low[a]).max(first), u32::from(crop.high[a]).min(last));
        if from > to {
            return None;
        }
        [part.low[a], part.high[a]] = [from - low[a], to - low[a]].map(|c| u16::try_from(c).expect("inside a brick"));
    }
    Some(Some(part))
}
