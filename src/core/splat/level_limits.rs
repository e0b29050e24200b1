//! Measures up to which size levels of detail are as good as the voxels that they stand for.
//!
//! In: an arena with levels, and its transfer function. Out: the limits of each level, by quality. From several directions
//! the voxels are drawn, all of them or those in some parts of the volume, and filtered to smaller pictures. Pictures of each level
//! are compared with these, large ones first, until one keeps the accuracy of the quality. The limits follow from the arena alone,
//! not from memory or threads.

use zerocopy::byteorder::little_endian::F32;

use super::camera::{Projection, ToCamera};
use super::levels::{WORTHWHILE, factors, facts_of, level_order, level_settings, share};
use super::supersample::{SMALL_STRIP_SAMPLES, STRIP_SAMPLES, Supersampling};
use super::{Camera, Frame, Lanes, Orbit, Outline, Quality, Scene, Settings, cpu};
use crate::arena::layout::LevelLimits;
use crate::arena::{Arena, LaneSet};
use crate::error::{Error, Result};
use crate::traverse::VoxelBox;
use crate::volume::Axis;

/// Azimuth and elevation of the views, in degrees: along the three axes, where blocks lie behind one another, and from all other sides.
const DIRECTIONS: [[f64; 2]; 10] = [
    [0.0, 0.0],
    [90.0, 0.0],
    [0.0, 90.0],
    [40.0, 30.0],
    [130.0, -35.0],
    [220.0, 20.0],
    [310.0, -20.0],
    [175.0, 50.0],
    [265.0, 65.0],
    [20.0, -65.0],
];
/// How many mean spacings of voxels may make up a pixel of the pictures that levels are compared with.
const FACTORS: [u32; 11] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48];
/// Pictures whose samples along a side are a multiple of this number can be divided by all [`FACTORS`].
const ALL_FACTORS: u32 = 96;
/// The most samples along a side.
const MOST_SAMPLES: u32 = 3 * ALL_FACTORS;
/// The fewest and the most pixels of the longest edge of a level's voxel in pictures that are compared.
const PIXELS: [f64; 2] = [0.1, 1.4];
/// Fewest pixels that show anything in a picture that says something.
const LEAST_SHOWN: usize = 32;
/// Mean spacings of voxels along each side of a part of a volume that is drawn with finer samples.
const PART: f64 = 128.0;
/// The most bytes that a picture may take for each thread. Planes of long thin volumes take many more than the picture.
const MOST_BYTES: u64 = 16 << 20;
/// With less memory, one thread draws small strips.
const LITTLE: u64 = 256 << 20;

/// The accuracy that a level must have from every direction, in decibels from the voxels: the peak signal-to-noise ratio over the
/// pixels that are not empty. Other directions may have less.
fn aim(quality: Quality) -> f64 {
    if quality == Quality::Draft { 30.0 } else { 38.0 }
}

/// Returns the limits of the levels of `arena`, level 1 first; 0 if they cannot be drawn. Before each
/// picture `progress` receives the number of directions that are done, and of all.
///
/// Lanes that are not stored are not derived: such views walk along another axis, and a view along the only lane is left out.
///
/// # Errors
/// The error of `progress`; those of [`cpu::render`].
pub(crate) fn measure(
    arena: &Arena,
    memory: Option<u64>,
    threads: usize,
    progress: &mut dyn FnMut(u64, u64) -> Result<()>,
) -> Result<Vec<LevelLimits>> {
    let lanes = LaneSet::with_levels(arena.clone(), Some(0));
    let mut limits = vec![LevelLimits::default(); lanes.detail().levels.len()];
    let has_magnitudes = arena.facts().channels.magnitude_bits > 0;
    let function = lanes.detail().build_function;
    let Some(transfer) = function.filter(|function| has_magnitudes || !function.uses_gradient()) else {
        return Ok(limits);
    };
    let has_little = memory.is_some_and(|memory| memory < LITTLE);
    let strip_samples = if has_little { SMALL_STRIP_SAMPLES } else { STRIP_SAMPLES };
    let threads = if has_little { 1 } else { threads.max(1) };
    let resources = Settings { strip_samples, ..Settings::new([1; 2]).with_threads(threads) };
    let scene = Scene { facts: arena.facts(), lanes: &lanes, transfer };
    let mut searches: Vec<Search> = (1..=limits.len()).flat_map(|level| Search::of_level(&scene, level)).collect();
    for number in 0..DIRECTIONS.len() {
        let mut go_on = || progress(number as u64, DIRECTIONS.len() as u64);
        go_on()?;
        let Some(direction) = Direction::draw(&scene, number, &resources)? else { continue };
        for search in &mut searches {
            search.go_on_with(&scene, &direction, &mut go_on)?;
        }
    }
    for search in searches {
        let limits = &mut limits[search.level - 1];
        let limit = if search.quality == Quality::Draft { &mut limits.draft } else { &mut limits.standard };
        *limit = F32::new(search.limit());
    }
    Ok(limits)
}

/// The voxels from one direction.
struct Direction {
    /// All of them; `None` if they would take too much memory.
    all: Option<DrawnSamples>,
    /// Those in some parts of the volume, on samples as fine as voxels; empty if the samples of `all` are as fine.
    parts: Vec<DrawnSamples>,
}

impl Direction {
    /// Draws the voxels from direction `number` of [`DIRECTIONS`]; `None` if they cannot be drawn, or not in [`MOST_BYTES`].
    fn draw(scene: &Scene, number: usize, resources: &Settings) -> Result<Option<Direction>> {
        let draw = |crop| match DrawnSamples::draw(scene, DIRECTIONS[number], crop, resources) {
            Err(Error::Input { .. } | Error::Limit { .. }) => Ok(None),
            drawn => drawn,
        };
        let all = draw(None)?;
        let mut parts = Vec::new();
        if all.as_ref().is_none_or(|all| all.width > 1) {
            // Where no picture shows all, the middle alone says too little: half of the corners is seen from each direction.
            let corners = (0..8usize).filter(|corner| all.is_none() && corner.count_ones() as usize % 2 == number % 2);
            let corners = corners.map(|corner| [0, 1, 2].map(|axis| [0.25, 0.75][corner >> axis & 1]));
            for place in std::iter::once([0.5; 3]).chain(corners) {
                let part = part(scene, place).map(|part| draw(Some(part))).transpose()?.flatten();
                parts.extend(part.filter(|part| part.width == 1));
            }
        }
        Ok((all.is_some() || !parts.is_empty()).then_some(Direction { all, parts }))
    }
}

/// Returns a box of whole blocks of all levels around a place, given as shares of the sides of the box of all visible voxels.
fn part(scene: &Scene, place: [f64; 3]) -> Option<VoxelBox> {
    let grid = &scene.facts.grid;
    let (low, high) = scene.lanes.lane(Axis::X).ok()?.bounds()?;
    let blocks = scene.lanes.detail().levels.last().map_or([1; 3], |level| factors(grid, &level.grid));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65,535")]
    let side = |a: usize| {
        let centre = (f64::from(low[a]) + place[a] * f64::from(high[a].saturating_sub(low[a]))) as u32;
        let half = (PART / 2.0 * grid.mean_spacing() / grid.spacing[a]).ceil().clamp(0.0, 65_535.0) as u32;
        let first = centre.saturating_sub(half) / blocks[a] * blocks[a];
        let end = (centre + half + 1).next_multiple_of(blocks[a]);
        [first, end - 1].map(|point| u16::try_from(point.min(grid.dims[a] - 1)).unwrap_or(u16::MAX))
    };
    let sides = [0, 1, 2].map(side);
    Some(VoxelBox { low: sides.map(|[low, _]| low), high: sides.map(|[_, high]| high) })
}

/// A picture of the voxels.
struct DrawnSamples {
    camera: Camera,
    settings: Settings,
    picture: Frame,
    /// How many mean spacings of voxels a sample is wide.
    width: u32,
}

impl DrawnSamples {
    /// Draws the voxels, or those in a `crop`, with samples as fine as [`MOST_SAMPLES`] allow, but no finer than voxels.
    fn draw(
        scene: &Scene,
        [azimuth, elevation]: [f64; 2],
        crop: Option<VoxelBox>,
        resources: &Settings,
    ) -> Result<Option<DrawnSamples>> {
        let outline = Outline::of_lane(&scene.facts.grid, scene.lanes.lane(Axis::X)?, crop);
        let orbit = Orbit { azimuth, elevation, ..Orbit::default() };
        let Projection::Parallel { height } = orbit.to_camera(&outline, [ALL_FACTORS; 2])?.projection() else {
            return Ok(None);
        };
        let voxel = scene.facts.grid.mean_spacing();
        let is_enough = |width: &u32| height <= f64::from(MOST_SAMPLES * width) * voxel;
        let Some(width) = FACTORS.into_iter().find(is_enough) else { return Ok(None) };
        let sample = f64::from(width) * voxel;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 288")]
        let side = ((height / sample).ceil().max(1.0) as u32).next_multiple_of(ALL_FACTORS);
        let settings = resources.clone().with_size([side; 2]).with_level(0).with_crop(crop);
        let camera = orbit.with_zoom(height / (f64::from(side) * sample)).to_camera(&outline, settings.size)?;
        let Some(drawn) = along_stored(scene, &camera, &settings)? else { return Ok(None) };
        if need(scene, &camera, &drawn)? > MOST_BYTES {
            return Ok(None);
        }
        let (picture, _) = cpu::render(scene, &camera, &drawn)?;
        Ok(Some(DrawnSamples { camera, settings, picture, width }))
    }

    /// Returns the difference of a picture of a level, whose pixels are `factor` mean spacings wide: a multiple of a sample.
    fn difference(&self, scene: &Scene, level: usize, quality: Quality, factor: u32) -> Result<Difference> {
        let factor = factor / self.width;
        let settings = self.settings.clone().with_level(level).with_quality(quality);
        let settings = settings.with_size(self.settings.size.map(|side| side / factor));
        let Some(settings) = along_stored(scene, &self.camera, &settings)? else { return Ok(Difference::LARGE) };
        if need(scene, &self.camera, &settings)? > MOST_BYTES {
            return Ok(Difference::LARGE);
        }
        let (picture, _) = cpu::render(scene, &self.camera, &settings)?;
        Ok(match Supersampling::of_pixels(factor, settings.size) {
            None => Difference::between(&self.picture, &picture),
            Some(filter) => Difference::between(&filter.picture(&self.picture, settings.threads)?, &picture),
        })
    }
}

/// How unlike pictures are.
#[derive(Clone, Copy, Default)]
struct Difference {
    /// The sum of the squares of the differences of all parts of pixels.
    squares: f64,
    /// Number of pixels that are not empty in one of two pictures.
    shown: usize,
}

impl Difference {
    /// That of a picture that cannot be drawn.
    const LARGE: Difference = Difference { squares: f64::INFINITY, shown: 1 };

    fn between(right: &Frame, other: &Frame) -> Difference {
        let pixels = right.pixels().as_chunks::<4>().0.iter().zip(other.pixels().as_chunks::<4>().0);
        let mut difference = Difference::default();
        for (right, other) in pixels.filter(|(right, other)| **right != [0.0; 4] || **other != [0.0; 4]) {
            let squares = right.iter().zip(other).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            difference = difference.and(Difference { squares, shown: 1 });
        }
        difference
    }

    /// Returns that of two pairs of pictures.
    fn and(self, other: Difference) -> Difference {
        Difference { squares: self.squares + other.squares, shown: self.shown + other.shown }
    }

    /// Returns whether enough is to be seen, and the peak signal-to-noise ratio over the pixels that are not empty is at least `aim`
    /// decibels.
    fn is_good(self, aim: f64) -> bool {
        self.shown >= LEAST_SHOWN && self.squares <= 10.0f64.powf(-aim / 10.0) * (4 * self.shown) as f64
    }
}

/// The search for the limit of a level at a quality.
struct Search {
    level: usize,
    quality: Quality,
    /// The factors that may do, largest pictures first, each with the pixels of the longest edge of the level's voxels.
    sizes: Vec<(u32, f64)>,
    /// The index of the first one that is good from all directions so far.
    good: usize,
    /// Whether anything was to be seen.
    has_seen: bool,
}

impl Search {
    /// Returns the searches for a level; none if it is never drawn.
    fn of_level(scene: &Scene, level: usize) -> Vec<Search> {
        let longest = facts_of(scene, level).grid.spacing.into_iter().fold(0.0, f64::max);
        let edge = longest / scene.facts.grid.mean_spacing();
        let sizes = FACTORS.into_iter().map(|factor| (factor, edge / f64::from(factor)));
        let sizes: Vec<_> = sizes.filter(|(_, pixels)| (PIXELS[0]..=PIXELS[1]).contains(pixels)).collect();
        let search = |quality| Search { level, quality, sizes: sizes.clone(), good: 0, has_seen: false };
        if share(scene, level) <= WORTHWHILE {
            [Quality::Standard, Quality::Draft].map(search).into()
        } else {
            Vec::new()
        }
    }

    /// Leaves out sizes at which the level is not good enough from a direction.
    fn go_on_with(
        &mut self,
        scene: &Scene,
        Direction { all, parts }: &Direction,
        go_on: &mut dyn FnMut() -> Result<()>,
    ) -> Result<()> {
        let (level, quality, aim) = (self.level, self.quality, aim(self.quality));
        let mut difference = |samples: &[DrawnSamples], factor: u32| {
            samples.iter().try_fold(Difference::default(), |sum, samples| {
                go_on()?;
                Ok::<_, Error>(sum.and(samples.difference(scene, level, quality, factor)?))
            })
        };
        // Sizes that are finer than the samples of all are left to the parts.
        let mut of_all = self.sizes.len();
        if let Some(all) = all {
            for at in self.good..self.sizes.len() {
                let (factor, _) = self.sizes[at];
                if factor.is_multiple_of(all.width) {
                    let difference = difference(std::slice::from_ref(all), factor)?;
                    self.has_seen |= difference.shown > 0;
                    if difference.shown == 0 || difference.is_good(aim) {
                        of_all = at;
                        break;
                    }
                    self.good = at + 1;
                }
            }
        }
        while self.good < of_all {
            let difference = difference(parts, self.sizes[self.good].0)?;
            self.has_seen |= difference.shown > 0;
            let says_nothing = difference.shown == 0 && all.is_none();
            if says_nothing || difference.is_good(aim) {
                break;
            }
            self.good += 1;
        }
        Ok(())
    }

    /// Returns the limit, in pixels; 0 if no size is small enough.
    #[expect(clippy::cast_possible_truncation, reason = "a limit needs no more than the digits of a single")]
    fn limit(&self) -> f32 {
        let good = self.sizes.get(self.good).filter(|_| self.has_seen);
        // Sizes are compared as doubles: rounding must not make the limit smaller.
        good.map_or(0.0, |(_, pixels)| (pixels * 1.000_001) as f32)
    }
}

/// Returns the settings with which a view walks along a lane that is stored; `None` if none can be walked from there.
fn along_stored(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<Option<Settings>> {
    let level = settings.level.unwrap_or(0);
    let order = level_order(scene, level, camera, settings)?;
    let is_stored = |axis: Axis| scene.lanes.lane_of(level, axis).is_ok();
    if is_stored(order.fast) {
        return Ok(Some(settings.clone()));
    }
    let other = order.medium;
    Ok(is_stored(other).then(|| settings.clone().with_order(order.with_fast(other))))
}

/// Returns the bytes that one thread needs to draw a picture where memory is short.
fn need(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<u64> {
    let level = settings.level.unwrap_or(0);
    let grid = &facts_of(scene, level).grid;
    let bounds = scene.lanes.lane_of(level, Axis::X)?.bounds();
    let Some((low, high)) = bounds else { return Ok(0) };
    let settings = level_settings(settings, &scene.facts.grid, grid).with_threads(1);
    let settings = Settings { strip_samples: SMALL_STRIP_SAMPLES, ..settings };
    let canvas = cpu::canvas(grid, &VoxelBox { low, high }, camera, &settings)?;
    let is_perspective = matches!(camera.projection(), Projection::Perspective { .. });
    Ok(cpu::memory_need(grid.dims, 0, canvas, is_perspective, &settings))
}
