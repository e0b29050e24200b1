//! Measures up to which size levels of detail are as good as the voxels that they stand for.
//!
//! In: an arena with levels, and its transfer function. Out: the limits of each level, by quality. From several directions
//! the voxels are drawn once, with a voxel a pixel, and filtered to smaller pictures. Pictures of each level are compared with these,
//! large ones first, until one keeps the accuracy of the quality. The limits follow from the arena alone, not from memory or
//! threads.

use zerocopy::byteorder::little_endian::F32;

use super::camera::{Projection, ToCamera};
use super::levels::{WORTHWHILE, level_order};
use super::supersample::Supersampling;
use super::{Camera, Frame, Lanes, Orbit, Outline, Quality, Scene, Settings, cpu};
use crate::arena::layout::{Facts, LevelLimits};
use crate::arena::{Arena, Lane};
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::volume::Axis;

/// Azimuth and elevation of the views, in degrees: along the three axes, where blocks lie behind one another, and five others.
const DIRECTIONS: [[f64; 2]; 8] =
    [[0.0, 0.0], [90.0, 0.0], [0.0, 90.0], [35.0, 25.0], [300.0, 50.0], [200.0, 5.0], [125.0, -30.0], [250.0, -20.0]];
/// How many samples along a side become one pixel of a picture that levels are compared with. A voxel of mean spacing has one sample.
const FACTORS: [u32; 11] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48];
/// Pictures with a multiple of so many samples a side can be divided by all [`FACTORS`].
const ALL_FACTORS: u32 = 96;
/// The most samples along a side. Of larger volumes the picture shows the middle.
const MOST_SAMPLES: u32 = 8 * ALL_FACTORS;
/// The fewest and the most pixels of the longest edge of a level's voxel in pictures that are compared.
const PIXELS: [f64; 2] = [0.1, 1.4];
/// Fewest pixels that show anything in a picture that says something.
const LEAST_SHOWN: usize = 32;
/// Width of the edge that is not compared, in pixels, of a picture of a volume's middle: what is beyond it is not in the samples.
const EDGE: usize = 2;

/// The accuracy that a level must have from every direction, in decibels from the voxels: the peak signal-to-noise ratio over the
/// pixels that are not empty. Pictures at the quality should have 30 and 38, and other directions have a little less than these.
fn aim(quality: Quality) -> f64 {
    if quality == Quality::Draft { 30.2 } else { 38.2 }
}

/// Returns the limits of the levels of `arena`, level 1 first; 0 if they cannot be drawn. `progress` receives the directions that are
/// done and in all, before each picture.
///
/// Lanes that are not stored are not derived: views that need them are left out.
///
/// # Errors
/// The error of `progress`; those of [`cpu::render`].
pub(crate) fn measure(
    arena: &Arena,
    threads: usize,
    progress: &mut dyn FnMut(u64, u64) -> Result<()>,
) -> Result<Vec<LevelLimits>> {
    let levels: Vec<Arena> = (0..=arena.level_count()).filter_map(|level| arena.level(level)).collect();
    let facts: Vec<Facts> = levels[1..].iter().map(|level| level.facts().clone()).collect();
    let mut limits = vec![LevelLimits::default(); facts.len()];
    let function = TransferFunction::of_description(arena.description(), arena.facts().grid.mean_spacing());
    let has_magnitudes = arena.facts().channels.magnitude_bits > 0;
    let Some(transfer) = function.filter(|function| has_magnitudes || !function.uses_gradient()) else {
        return Ok(limits);
    };
    let lanes = StoredLanes { levels, facts };
    let scene = Scene { facts: arena.facts(), lanes: &lanes, transfer: &transfer };
    let mut searches: Vec<Search> = (1..=limits.len()).flat_map(|level| Search::of_level(&scene, level)).collect();
    let outline = Outline::of_lane(&scene.facts.grid, lanes.lane(Axis::X)?, None);
    for (done, direction) in (0..).zip(DIRECTIONS) {
        let mut go_on = || progress(done, DIRECTIONS.len() as u64);
        go_on()?;
        let samples = match Samples::draw(&scene, &outline, direction, threads) {
            Ok(Some(samples)) => samples,
            Ok(None) => continue,
            Err(Error::Input { .. } | Error::Limit { .. }) => return Ok(limits),
            Err(error) => return Err(error),
        };
        for search in &mut searches {
            search.go_on_with(&scene, &samples, &mut go_on)?;
        }
    }
    for search in searches {
        let limits = &mut limits[search.level - 1];
        let limit = if search.quality == Quality::Draft { &mut limits.draft } else { &mut limits.standard };
        *limit = F32::new(search.limit());
    }
    Ok(limits)
}

/// The lanes that an arena and its levels store.
struct StoredLanes<'a> {
    /// The arena itself, then its levels.
    levels: Vec<Arena<'a>>,
    /// The facts of the levels, level 1 first.
    facts: Vec<Facts>,
}

impl Lanes for StoredLanes<'_> {
    fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.lane_of(0, axis)
    }

    fn levels(&self) -> &[Facts] {
        &self.facts
    }

    fn lane_of(&self, level: usize, axis: Axis) -> Result<Lane<'_>> {
        let lane = self.levels.get(level).and_then(|level| level.lane(axis));
        lane.ok_or_else(|| Error::input("lane", format!("along {} is not stored", axis.name())))
    }
}

/// The voxels from one direction.
struct Samples {
    camera: Camera,
    settings: Settings,
    picture: Frame,
    /// Width of the edge of pictures that is not compared, in pixels.
    edge: usize,
}

impl Samples {
    /// Draws the voxels; `None` if the file lacks the lane for that.
    fn draw(
        scene: &Scene,
        outline: &Outline,
        [azimuth, elevation]: [f64; 2],
        threads: usize,
    ) -> Result<Option<Samples>> {
        let orbit = Orbit { azimuth, elevation, ..Orbit::default() };
        let Projection::Parallel { height } = orbit.to_camera(outline, [ALL_FACTORS; 2])?.projection() else {
            return Ok(None);
        };
        let sample = scene.facts.grid.mean_spacing();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 768 after the clamp")]
        let side = ((height / sample).ceil().clamp(1.0, MOST_SAMPLES.into()) as u32).next_multiple_of(ALL_FACTORS);
        let edge = if f64::from(side) * sample < height { EDGE } else { 0 };
        let settings = Settings::new([side; 2]).with_threads(threads.max(1)).with_level(0);
        let camera = orbit.with_zoom(height / (f64::from(side) * sample)).to_camera(outline, settings.size)?;
        if !is_stored(scene, 0, &camera, &settings) {
            return Ok(None);
        }
        let (picture, _) = cpu::render(scene, &camera, &settings)?;
        Ok(Some(Samples { camera, settings, picture, edge }))
    }

    /// Returns the decibels of a picture of a level, in which `factor` samples along a side become a pixel; infinity if nothing is
    /// to be seen, `None` if it shows too little.
    fn accuracy(&self, scene: &Scene, level: usize, quality: Quality, factor: u32) -> Result<Option<f64>> {
        let settings = self.settings.clone().with_level(level).with_quality(quality);
        let settings = settings.with_size(self.settings.size.map(|side| side / factor));
        let (picture, _) = cpu::render(scene, &self.camera, &settings)?;
        match Supersampling::of_pixels(factor, settings.size) {
            None => Ok(decibels(&self.picture, &picture, self.edge)),
            Some(filter) => Ok(decibels(&filter.picture(&self.picture, settings.threads)?, &picture, self.edge)),
        }
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
        let facts = &scene.lanes.levels()[level - 1];
        let longest = facts.grid.spacing.into_iter().fold(0.0, f64::max);
        let edge = longest / scene.facts.grid.mean_spacing();
        let sizes = FACTORS.into_iter().map(|factor| (factor, edge / f64::from(factor)));
        let sizes: Vec<_> = sizes.filter(|(_, pixels)| (PIXELS[0]..=PIXELS[1]).contains(pixels)).collect();
        let search = |quality| Search { level, quality, sizes: sizes.clone(), good: 0, has_seen: false };
        let is_worthwhile = facts.visible_voxels as f64 <= WORTHWHILE * scene.facts.visible_voxels as f64;
        if is_worthwhile { [Quality::Standard, Quality::Draft].map(search).into() } else { Vec::new() }
    }

    /// Leaves out sizes at which the level is not good enough from the direction of `samples`.
    fn go_on_with(&mut self, scene: &Scene, samples: &Samples, go_on: &mut dyn FnMut() -> Result<()>) -> Result<()> {
        if !is_stored(scene, self.level, &samples.camera, &samples.settings) {
            return Ok(());
        }
        while let Some(&(factor, _)) = self.sizes.get(self.good) {
            go_on()?;
            let accuracy = samples.accuracy(scene, self.level, self.quality, factor)?.unwrap_or(0.0);
            self.has_seen |= accuracy.is_finite();
            if accuracy >= aim(self.quality) {
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
        good.map_or(0.0, |(_, pixels)| *pixels as f32)
    }
}

/// Returns whether the lane that a view of a level walks is stored.
fn is_stored(scene: &Scene, level: usize, camera: &Camera, settings: &Settings) -> bool {
    let order = level_order(scene, level, camera, settings);
    order.is_ok_and(|order| scene.lanes.lane_of(level, order.fast).is_ok())
}

/// Returns the peak signal-to-noise ratio of a picture over the pixels that are not empty in one of the two, without those at an edge of this
/// width; infinity if all are empty, `None` if there are too few.
fn decibels(right: &Frame, other: &Frame, edge: usize) -> Option<f64> {
    let columns = right.size()[0] as usize;
    let inner = |at: &usize| {
        let (x, y) = (at % columns, at / columns);
        x.min(y) >= edge && x.max(y) + edge < columns
    };
    let (rights, others) = (right.pixels().as_chunks::<4>().0, other.pixels().as_chunks::<4>().0);
    let (mut squares, mut shown) = (0.0, 0);
    for at in (0..rights.len()).filter(inner) {
        if rights[at] != [0.0; 4] || others[at] != [0.0; 4] {
            squares += rights[at].iter().zip(&others[at]).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            shown += 1;
        }
    }
    match shown {
        0 => Some(f64::INFINITY),
        1..LEAST_SHOWN => None,
        _ => Some(-10.0 * (squares / (4 * shown) as f64).max(f64::MIN_POSITIVE).log10()),
    }
}
