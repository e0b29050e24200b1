//! Which levels of detail a view draws, and where.
//!
//! In: a scene whose lanes have coarser levels, a view, settings. Out: parts of the volume, nearest first, each with its
//! level. A parallel view has one part. A perspective has one for each run of slices along the slow axis: its level follows
//! from the nearest place of the run. Parts meet at whole blocks, so no voxel is drawn twice or left out, and the order of
//! the slices stays exact.
//!
//! A level is drawn if the longest edge of its voxels is at most as many pixels as its limit for the quality
//! (docs/studies/levels.md), and if it has clearly fewer voxels than level 0. All renderers and judges take the same choice from here.

use std::collections::BTreeSet;
use std::ops::Range;

use super::block_kernel::Blocks;
use super::kernel::Quality;
use super::view::PixelMap;
use super::{Blending, Camera, Lanes, Mode, Scene, Settings, View};
use crate::arena::layout::Facts;
use crate::arena::visible::are_alike;
use crate::arena::{Detail, Lane};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::traverse::{Order, Viewpoint, VoxelBox};
use crate::volume::{Axis, Grid};

/// A level with more voxels than this, for each voxel of level 0, is not drawn: its voxels lie beside the points of the grid, and
/// drawing one takes 1.1 to 1.8 times as long as drawing one of level 0.
pub(super) const WORTHWHILE: f64 = 0.4;

/// The most pixels of a draft's level whose limit is not known, as files had none before version 1.3: level 1 of shells has 30.8 dB there, which is
/// the least of all sets.
const UNMEASURED: f64 = 0.5;

/// Least thickness of a crop, in blocks of a level, along each axis that it cuts, for the level to be drawn. In a draft the crop is
/// rounded to whole blocks: one of a single slice would vanish, or become a block thick.
const CROP_BLOCKS: u32 = 16;

/// A part of the volume, and the level that it is drawn from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LevelPart {
    /// The level: 0 for the voxels themselves.
    pub level: usize,
    /// The voxels of the part, in coordinates of its level; `None` for all.
    pub crop: Option<VoxelBox>,
}

/// A scene at one of its levels.
pub struct LevelScene<'a> {
    facts: &'a Facts,
    lanes: &'a dyn Lanes,
    level: usize,
    transfer: TransferFunction,
    /// Whether the scene is drawn with the function that it was built with, but for lengths.
    is_as_built: bool,
}

impl LevelScene<'_> {
    /// Returns the scene, which renderers draw as any other.
    pub fn scene(&self) -> Scene<'_> {
        Scene { facts: self.facts, lanes: self, transfer: &self.transfer }
    }
}

impl Lanes for LevelScene<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lanes.lane_of(self.level, axis)
    }

    fn detail(&self) -> Detail<'_> {
        let build_function = self.lanes.detail().build_function;
        let build_function = if self.is_as_built { Some(&self.transfer) } else { build_function };
        Detail { build_function, ..Detail::default() }
    }
}

impl LevelPart {
    /// Returns the scene at the part's level. Lengths of the transfer function stay those of level 0's voxels.
    ///
    /// # Errors
    /// [`Error::Input`] if the spacing of level 0 cannot be a length of the transfer function.
    pub fn scene<'a>(&self, scene: &Scene<'a>) -> Result<LevelScene<'a>> {
        let length = scene.facts.grid.mean_spacing();
        let reference = scene.transfer.reference_length().unwrap_or(length);
        let transfer = scene.transfer.clone().with_voxel_length(length)?.with_reference_length(reference)?;
        let is_as_built = scene.lanes.detail().build_function == Some(scene.transfer);
        Ok(LevelScene {
            facts: facts_of(scene, self.level),
            lanes: scene.lanes,
            level: self.level,
            transfer,
            is_as_built,
        })
    }

    /// Returns the settings with which the part is drawn.
    pub fn settings(&self, scene: &Scene, settings: &Settings) -> Settings {
        let settings = level_settings(settings, &scene.facts.grid, &facts_of(scene, self.level).grid);
        Settings { crop: self.crop, ..settings }
    }
}

/// Returns the settings with which a level is drawn, given its grid and that of level 0.
pub fn level_settings(settings: &Settings, grid: &Grid, level: &Grid) -> Settings {
    Settings { blocks: Blocks(factors(grid, level)), level: Some(0), ..settings.clone() }
}

/// Returns the most pixels that the longest edge of a voxel of `level` may have; 0 if the level is never drawn.
fn most_pixels(scene: &Scene, level: usize, quality: Quality) -> f64 {
    let limits = scene.lanes.detail().limits;
    let pixels = match (level.checked_sub(1), quality) {
        (None, _) => return f64::INFINITY,
        (Some(below), Quality::Draft) => limits.get(below).map_or(UNMEASURED, |limits| limits.draft.get().into()),
        (Some(below), Quality::Standard) => limits.get(below).map_or(0.0, |limits| limits.standard.get().into()),
        (_, Quality::High | Quality::Reference) => 0.0,
    };
    // A damaged file may have anything.
    if pixels >= 0.0 { pixels } else { 0.0 }
}

/// Returns how many voxels a level has for each of level 0.
pub(super) fn share(scene: &Scene, level: usize) -> f64 {
    facts_of(scene, level).visible_voxels as f64 / scene.facts.visible_voxels as f64
}

/// Returns whether the levels fit the function that the scene is drawn with: their voxels are as opaque as the blocks that they stand
/// for if opacities are those of the build. A T1 head, built from 100 up and drawn from 180 up, had 22 dB at level 1.
fn fit(scene: &Scene) -> bool {
    scene.lanes.detail().build_function.is_none_or(|own| are_alike(own, scene.transfer, scene.facts))
}

/// Returns the facts of a level, which the scene has.
pub(crate) fn facts_of<'a>(scene: &Scene<'a>, level: usize) -> &'a Facts {
    level.checked_sub(1).map_or(scene.facts, |below| &scene.lanes.detail().levels[below])
}

/// Returns the order in which a view visits the voxels of a level.
///
/// # Errors
/// The errors of [`View::new`]; [`Error::Input`] if there is no such level.
pub fn level_order(scene: &Scene, level: usize, camera: &Camera, settings: &Settings) -> Result<Order> {
    if level > scene.lanes.detail().levels.len() {
        return Err(Error::input("level", format!("{level} is not in the file")));
    }
    let grid = &facts_of(scene, level).grid;
    let settings = level_settings(settings, &scene.facts.grid, grid);
    let view = View::new(camera, grid, settings.size, settings.kernel(), settings.near)?;
    super::setup::walk_order(&view, grid, &settings)
}

/// Returns the levels that a view draws, coarsest first, each with the order in which its voxels are visited.
///
/// # Errors
/// The errors of [`level_parts`].
pub fn drawn_levels(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Vec<(usize, Order)>> {
    let levels: BTreeSet<usize> = level_parts(scene, camera, settings)?.iter().map(|part| part.level).collect();
    let with_order = |level| Ok((level, level_order(scene, level, camera, settings)?));
    levels.into_iter().rev().map(with_order).collect()
}

/// Returns the parts that a view draws, nearest first.
///
/// Only composites with exponential blending choose levels; other modes, other blendings, and a set order draw
/// level 0. So does standard quality where a crop or a clip plane cuts blocks: it would cut the level elsewhere.
///
/// # Errors
/// [`Error::Input`] if `settings` ask for a level that the scene does not have; the errors of [`Settings::check`] and [`View::new`].
pub fn level_parts(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Vec<LevelPart>> {
    settings.check()?;
    let view = View::new(camera, &scene.facts.grid, settings.size, settings.kernel(), settings.near)?;
    let levels = scene.lanes.detail().levels.len();
    if let Some(level) = settings.level {
        if level > levels {
            return Err(Error::input("level", format!("is {level}, but the file has levels 0 to {levels}")));
        }
        return Ok(LevelPart::within(scene, level, settings.crop).into_iter().collect());
    }
    let whole = vec![LevelPart { level: 0, crop: settings.crop }];
    let is_composite = settings.mode == Mode::Composite && settings.blending == Blending::Exponential;
    if levels == 0 || !is_composite || settings.order.is_some() {
        return Ok(whole);
    }
    if settings.quality == Quality::Standard && settings.clip.is_some() {
        return Ok(whole);
    }
    let levels = (1..=levels).take_while(|&level| keeps_crop(scene, level, settings)).count();
    let edge = |level: usize| {
        let grid = &facts_of(scene, level).grid;
        grid.spacing.into_iter().fold(0.0, f64::max) / view.mean_voxel
    };
    // The distance from the eye, in mean spacings of level 0, from which on a level is drawn; 0 or infinity in parallel views.
    let distances: Vec<f64> = (0..=levels)
        .map(|level| {
            if level > 0 && share(scene, level) > WORTHWHILE {
                return f64::INFINITY;
            }
            let most = most_pixels(scene, level, settings.quality);
            match &view.map {
                PixelMap::Parallel { scale, .. } if edge(level) * scale <= most => 0.0,
                PixelMap::Parallel { .. } => f64::INFINITY,
                PixelMap::Perspective { focal, .. } => edge(level) * focal / most * steepest(&view, *focal),
            }
        })
        .collect();
    let coarsest = |distance: f64| (0..=levels).rev().find(|level| distances[*level] <= distance).unwrap_or(0);
    let do_fit = || settings.quality != Quality::Standard || fit(scene);
    let Viewpoint::Perspective { eye, .. } = view.viewpoint else {
        let level = Some(coarsest(0.0)).filter(|level| *level > 0 && do_fit()).unwrap_or(0);
        return Ok(LevelPart::within(scene, level, settings.crop).into_iter().collect());
    };
    let slow = super::setup::walk_order(&view, &scene.facts.grid, settings)?.slow.index();
    let runs = runs(scene, slow, eye[slow], view.steps[slow], coarsest);
    if matches!(runs[..], [(0, _)]) || !do_fit() {
        return Ok(whole);
    }
    let part = |(level, slices): (usize, Range<u32>)| {
        let mut crop = settings.crop.unwrap_or(VoxelBox::ALL);
        let last = u16::try_from(slices.end - 1).unwrap_or(u16::MAX);
        crop.low[slow] = crop.low[slow].max(u16::try_from(slices.start).unwrap_or(u16::MAX));
        crop.high[slow] = crop.high[slow].min(last);
        (crop.low[slow] <= crop.high[slow]).then(|| LevelPart::within(scene, level, Some(crop))).flatten()
    };
    Ok(runs.into_iter().filter_map(part).collect())
}

/// Returns whether a level shows the crop well: along each axis that it cuts, the crop has at least [`CROP_BLOCKS`], which are whole
/// unless in a draft.
fn keeps_crop(scene: &Scene, level: usize, settings: &Settings) -> bool {
    let Some(crop) = settings.crop else { return true };
    let factors = factors(&scene.facts.grid, &facts_of(scene, level).grid);
    (0..3).all(|a| {
        let (points, factor) = (scene.facts.grid.dims[a], factors[a]);
        let (first, end) = (u32::from(crop.low[a]), points.min(u32::from(crop.high[a]) + 1));
        let is_whole = first.is_multiple_of(factor) && (end.is_multiple_of(factor) || end == points);
        let is_thick = end.saturating_sub(first) >= CROP_BLOCKS * factor;
        (first, end) == (0, points) || is_thick && (is_whole || settings.quality == Quality::Draft)
    })
}

/// Returns how much farther from the eye a voxel may be than it is along the view axis: the inverse cosine of the angle
/// between the view axis and the picture's corners.
fn steepest(view: &View, focal: f64) -> f64 {
    let [columns, rows] = view.size.map(f64::from);
    (1.0 + (columns * columns + rows * rows) / (4.0 * focal * focal)).sqrt()
}

/// Returns runs of slices of level 0 along the slow axis, nearest first, with the level of each. `eye` is the eye's place on
/// the axis, in slices, `step` their distance in mean spacings.
fn runs(scene: &Scene, slow: usize, eye: f64, step: f64, coarsest: impl Fn(f64) -> usize) -> Vec<(usize, Range<u32>)> {
    let slices = scene.facts.grid.dims[slow];
    // Blocks of the coarsest level that any slice is drawn from: all runs begin and end at such.
    let distance = |slice: u32| (f64::from(slice) - eye).abs() * step;
    let most = coarsest(distance(0).max(distance(slices - 1)));
    let block = factors(&scene.facts.grid, &facts_of(scene, most).grid)[slow];
    let mut runs: Vec<(usize, Range<u32>)> = Vec::new();
    for first in (0..slices).step_by(block as usize) {
        let end = slices.min(first + block);
        let holds_eye = (f64::from(first) - 0.5..f64::from(end) - 0.5).contains(&eye);
        let nearest = if holds_eye { 0.0 } else { distance(first).min(distance(end - 1)) };
        // Offsets and kernels reach out of a block by less than it is long.
        let level = coarsest((nearest - f64::from(block) * step).max(0.0));
        match runs.last_mut() {
            Some((last, run)) if *last == level => run.end = end,
            _ => runs.push((level, first..end)),
        }
    }
    let place = |run: &Range<u32>| {
        let (first, last) = (f64::from(run.start) - 0.5, f64::from(run.end) - 0.5);
        if eye < first { first - eye } else { (eye - last).max(0.0) }
    };
    runs.sort_by(|(_, a), (_, b)| place(a).total_cmp(&place(b)));
    runs
}

/// Returns how many points of `fine` along each axis are one of `coarse`.
pub(crate) fn factors(fine: &Grid, coarse: &Grid) -> [u32; 3] {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a power of two of at most 2^15")]
    [0, 1, 2].map(|a| (coarse.spacing[a] / fine.spacing[a]).round().clamp(1.0, 32_768.0) as u32)
}

impl LevelPart {
    /// Returns the part of a level whose blocks have their centres in `crop`, a box of voxels of level 0; `None` if there are
    /// none.
    fn within(scene: &Scene, level: usize, crop: Option<VoxelBox>) -> Option<LevelPart> {
        let Some(crop) = crop.filter(|_| level > 0) else { return Some(LevelPart { level, crop }) };
        let factors = factors(&scene.facts.grid, &facts_of(scene, level).grid);
        let mut of_level = VoxelBox { low: [0; 3], high: [0; 3] };
        for (a, factor) in factors.into_iter().enumerate() {
            // Twice the centre of block i is 2 factor i + factor - 1.
            let (low, high) = (2 * u32::from(crop.low[a]), 2 * u32::from(crop.high[a]));
            let first = (low + 1).saturating_sub(factor).div_ceil(2 * factor);
            let last = (high + 1).saturating_sub(factor) / (2 * factor);
            if high + 1 < factor && u32::from(crop.high[a]) + 1 < scene.facts.grid.dims[a] {
                return None;
            }
            of_level.low[a] = u16::try_from(first).unwrap_or(u16::MAX);
            // The last block may reach beyond the grid's end.
            let is_end = u32::from(crop.high[a]) + 1 >= scene.facts.grid.dims[a];
            of_level.high[a] = if is_end { u16::MAX } else { u16::try_from(last).unwrap_or(u16::MAX) };
        }
        of_level.is_ordered().then_some(LevelPart { level, crop: Some(of_level) })
    }
}
