//! Levels of detail of bricks: which of them a partition allows, and where a brick lies in each.
//!
//! In: the facts of the whole, and how it is cut. Out: the levels whose blocks lie in one brick each. So the levels of the whole
//! are those of its bricks, side by side. What is seen of a voxel depends on its neighbours, also beyond the brick's border:
//! a brick's levels are made of the voxels in its box and in a margin around it.

use zerocopy::byteorder::little_endian::F32;

use super::Partition;
use crate::arena::layout::{Facts, LevelLimits};
use crate::arena::levels::level_facts;
use crate::arena::{Arena, Detail, Lane, Levels, MOST_LEVELS, Region, Rows};
use crate::error::{Error, Result};
use crate::splat::Lanes;
use crate::volume::Axis;

/// A level of the whole.
#[derive(Debug, Clone)]
pub(super) struct Level {
    /// What the header of the whole's level says; the number of voxels is not known yet.
    pub(super) facts: Facts,
    /// How many points of the level below along each axis become one.
    step: [u32; 3],
    /// How many points of the whole along each axis become one.
    pub(super) factors: [u32; 3],
}

impl Level {
    /// Returns the box of the level in which the blocks of `region`, a box of the whole, are.
    pub(super) fn place(&self, region: &Region) -> Region {
        let side = |a: usize| {
            let side = region.sides()[a];
            side.start / self.factors[a]..side.end.div_ceil(self.factors[a])
        };
        Region { xs: side(0), ys: side(1), zs: side(2) }
    }
}

/// Returns the first `most` levels of the whole, or as many as its grid allows.
pub(super) fn levels_of(whole: &Facts, most: u8) -> Vec<Level> {
    let mut levels: Vec<Level> = Vec::new();
    while levels.len() < most.into() {
        let (below, factors) = levels.last().map_or((whole, [1; 3]), |level| (&level.facts, level.factors));
        let Some((facts, step)) = level_facts(below) else { break };
        levels.push(Level { facts, step, factors: [0, 1, 2].map(|a| factors[a] * step[a]) });
    }
    levels
}

/// Returns how many of `levels`, from the first on, have all their blocks inside single boxes of all `partitions`.
pub(super) fn allowed(partitions: &[Partition], levels: &[Level]) -> usize {
    let of_one = |partition: &Partition| {
        let mut cut = partition.clone();
        let is_whole = |level: &&Level| cut.coarser(level.step).map(|coarse| cut = coarse).is_some();
        levels.iter().take_while(is_whole).count()
    };
    partitions.iter().map(of_one).min().unwrap_or(0)
}

/// Returns the number of levels that bricks hold if `wanted` are asked for.
///
/// # Errors
/// [`Error::Input`] if `wanted` is a number with which bricks would share blocks.
pub(super) fn held(wanted: Levels, whole: &Facts, partitions: &[Partition]) -> Result<u8> {
    let of_grid = match wanted {
        Levels::Count(count) => levels_of(whole, count),
        Levels::Auto => {
            let mut levels = levels_of(whole, MOST_LEVELS);
            let grids: Vec<_> = [&whole.grid].into_iter().chain(levels.iter().map(|level| &level.facts.grid)).collect();
            let useful = (1..=MOST_LEVELS).zip(grids).take_while(|(level, below)| wanted.want(*level, below, u64::MAX));
            let useful = useful.count();
            levels.truncate(useful);
            levels
        }
    };
    let fit = allowed(partitions, &of_grid);
    if let (Levels::Count(_), Some(last)) = (wanted, of_grid.get(fit).and(of_grid.last())) {
        let [x, y, z] = last.factors;
        let why = format!(
            "are {}, but these bricks can hold {fit}; where an axis is cut, bricks need a multiple of {x}x{y}x{z} points \
             along x, y and z, and the last one more than half of that",
            of_grid.len()
        );
        return Err(Error::input("levels of detail", why));
    }
    Ok(u8::try_from(fit).expect("at most 15"))
}

/// Returns the box of voxels that the levels of the brick in `region` are made of: of whole blocks of all `levels`, and wide
/// enough that what is seen of the brick's voxels is known at each level.
pub(super) fn with_margin(region: &Region, whole: [u32; 3], levels: &[Level]) -> Region {
    let Some(last) = levels.last() else { return region.clone() };
    let side = |a: usize| {
        let neighbours = levels.iter().rev().fold(0, |margin, level| margin * level.step[a] + 1);
        let (side, margin) = (region.sides()[a], u32::next_multiple_of(neighbours, last.factors[a]));
        side.start.saturating_sub(margin)..side.end.saturating_add(margin).min(whole[a])
    };
    Region { xs: side(0), ys: side(1), zs: side(2) }
}

/// Returns the rows of level `number` of a file, 0 for the file itself; with a `window`, those in that box.
///
/// # Errors
/// [`Error::Input`] if the file has no such level.
pub(super) fn rows_of<'a>(arena: &Arena<'a>, number: u8, window: Option<&Region>) -> Result<Box<dyn Rows + 'a>> {
    let missing = || Error::input("level", format!("{number} is not in a brick"));
    let level = arena.level(number).ok_or_else(missing)?;
    Ok(Box::new(match window {
        Some(window) => level.rows().cropped(window),
        None => level.rows(),
    }))
}

/// The limit that counts for a brick whose level is never good enough, in pixels: smaller than any that is measured.
const LEAST_LIMIT: f64 = 0.04;

/// Returns the limits of the `count` levels of a whole, from the number of visible voxels and the limits of each brick; none if a brick
/// does not say its own.
///
/// Squares of errors rise about in proportion to the size of a level's voxels in pixels, and those of a picture are the means of those of
/// its bricks. So the limit of the whole is the harmonic mean, in which bricks count by their voxels.
pub(super) fn limits_of_whole<'a>(
    count: usize,
    bricks: impl Iterator<Item = (u64, &'a [LevelLimits])>,
) -> Vec<LevelLimits> {
    let (mut all, mut sums) = (0.0, vec![[0.0; 2]; count]);
    for (voxels, limits) in bricks {
        if limits.len() < count {
            return Vec::new();
        }
        all += voxels as f64;
        for (sums, LevelLimits { standard, draft }) in sums.iter_mut().zip(limits) {
            for (sum, limit) in sums.iter_mut().zip([standard, draft]) {
                *sum += voxels as f64 / f64::from(limit.get()).max(LEAST_LIMIT);
            }
        }
    }
    #[expect(clippy::cast_possible_truncation, reason = "a limit needs no more than the digits of a single")]
    let limit = |sum: f64| {
        let mean = all / sum;
        F32::new(if mean > 1.01 * LEAST_LIMIT { mean as f32 } else { 0.0 })
    };
    sums.into_iter().map(|[standard, draft]| LevelLimits { standard: limit(standard), draft: limit(draft) }).collect()
}

/// The levels of the whole, whose lanes nobody has: enough to choose a level by.
pub(super) struct WholeLevels<'a>(pub(super) Detail<'a>);

impl Lanes for WholeLevels<'_> {
    fn lane(&self, _axis: Axis) -> Result<Lane<'_>> {
        Err(Error::input("lane", "of the whole is in its bricks"))
    }

    fn detail(&self) -> Detail<'_> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn limits(all: &[[f32; 2]]) -> Vec<LevelLimits> {
        all.iter().map(|&[standard, draft]| LevelLimits { standard: standard.into(), draft: draft.into() }).collect()
    }

    #[test]
    fn the_limits_of_a_whole_are_harmonic_means_of_those_of_bricks_by_their_voxels() {
        let of = |bricks: &[(u64, Vec<LevelLimits>)]| {
            limits_of_whole(1, bricks.iter().map(|(voxels, limits)| (*voxels, &limits[..])))
        };
        let same = limits(&[[0.5, 1.25]]);
        assert_eq!(of(&[(10, same.clone()), (1, same.clone())]), same);
        // 4 / (3 / 1.5 + 1 / 0.5) and 4 / (3 / 0.25 + 1 / 0.25).
        assert_eq!(of(&[(3, limits(&[[1.5, 0.25]])), (1, limits(&[[0.5, 0.25]]))]), limits(&[[1.0, 0.25]]));
        // A level that is never good enough in a small brick may be drawn, one that is so in all may not.
        let [mean] = of(&[(99, limits(&[[1.0, 0.0]])), (1, limits(&[[0.0, 0.0]]))])[..] else { panic!() };
        assert!((0.8..0.81).contains(&mean.standard.get()) && mean.draft.get() == 0.0, "{mean:?}");
        assert_eq!(of(&[(10, same), (1, Vec::new())]), []);
    }
}
