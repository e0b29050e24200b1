//! The lanes of an arena: those that it stores, and those derived from them.

use std::sync::{Arc, OnceLock};

use super::lane::Lane;
use super::layout::{Facts, LevelLimits};
use super::levels::MOST_LEVELS;
use super::open::Arena;
use super::owned_lane::OwnedLane;
use super::transpose::transpose;
use crate::classify::TransferFunction;
use crate::error::{Error, Result};
use crate::volume::Axis;

/// Lanes that an arena does not store, derived from the lane along x when first needed.
#[derive(Debug)]
struct DerivedLanes {
    lanes: [OnceLock<OwnedLane>; 3],
    /// Most bytes that derived lanes may take in all.
    memory: u64,
}

impl DerivedLanes {
    /// Creates an empty set that may grow to `memory` bytes.
    fn new(memory: u64) -> DerivedLanes {
        DerivedLanes { lanes: Default::default(), memory }
    }

    /// Returns the lane of `arena` along `axis`. A missing lane is derived once, in about the time of a few frames.
    ///
    /// # Errors
    /// [`Error::Limit`] if the derived lanes would exceed the memory they may take.
    fn lane<'a>(&'a self, arena: &Arena<'a>, axis: Axis) -> Result<Lane<'a>> {
        if let Some(lane) = arena.lane(axis) {
            return Ok(lane);
        }
        let derived = &self.lanes[axis.index()];
        if let Some(lane) = derived.get() {
            return Ok(lane.view());
        }
        let source = arena.x_lane();
        let source = source.at_hand()?;
        let others = self.lanes.iter().filter_map(OnceLock::get).map(|lane| lane.view().bytes()).sum::<u64>();
        // Records take the same space in every lane; tiles, line ends and the current strip take about as much again.
        let need = others.saturating_add(source.bytes().saturating_mul(2));
        if need > self.memory {
            let what = format!("bytes for the lane along {}, which the file does not store", axis.name());
            return Err(Error::Limit { what, need, have: self.memory });
        }
        Ok(derived.get_or_init(|| transpose(&source, axis, arena.facts().tile_order)).view())
    }
}

/// The coarser levels of detail that a source of voxels has, level 1 first.
#[derive(Debug, Clone, Copy, Default)]
pub struct Detail<'a> {
    /// The facts of each level.
    pub levels: &'a [Facts],
    /// The limits of each level; empty if they are not known.
    pub limits: &'a [LevelLimits],
    /// The transfer function with which the voxels and levels were built; `None` if there is none or it is not known.
    pub build_function: Option<&'a TransferFunction>,
}

/// What an arena and its levels need to be drawn beside their bytes: derived lanes, and copies of what the headers say.
#[derive(Debug)]
pub(crate) struct LevelLanes {
    /// The facts of the coarser levels of detail, and their limits; level 1 first.
    pub(crate) levels: Vec<Facts>,
    pub(crate) limits: Vec<LevelLimits>,
    build_function: Option<TransferFunction>,
    /// The derived lanes of the voxels, then those of each level.
    derived: Vec<DerivedLanes>,
}

impl LevelLanes {
    /// Creates an empty set for `arena`, of which `level` returns the levels. Derived lanes of each may take `memory` bytes in all.
    pub(crate) fn new<'a>(
        arena: &Arena<'a>,
        level: impl Fn(u8) -> Option<Arena<'a>>,
        build_function: Option<TransferFunction>,
        memory: u64,
    ) -> LevelLanes {
        let levels = (1..=MOST_LEVELS).map_while(|number| Some(level(number)?.facts().clone()));
        let limits = arena.level_limits().to_vec();
        LevelLanes { limits, build_function, ..LevelLanes::of_levels(levels.collect(), memory) }
    }

    fn of_levels(levels: Vec<Facts>, memory: u64) -> LevelLanes {
        let derived = (0..=levels.len()).map(|_| DerivedLanes::new(memory)).collect();
        LevelLanes { levels, limits: Vec::new(), build_function: None, derived }
    }

    /// Returns the levels, and what they were built with.
    pub(crate) fn detail(&self) -> Detail<'_> {
        let LevelLanes { levels, limits, build_function, .. } = self;
        Detail { levels, limits, build_function: build_function.as_ref() }
    }

    /// Returns the lane of `level` along `axis`; `arena` returns the arena of a level.
    ///
    /// # Errors
    /// [`Error::Input`] if there is no such level; the errors of `arena` and of [`LaneSet::lane`].
    pub(crate) fn lane<'a>(
        &'a self,
        level: usize,
        axis: Axis,
        arena: impl FnOnce(u8) -> Result<Option<Arena<'a>>>,
    ) -> Result<Lane<'a>> {
        let missing = || Error::input("level", format!("{level} is not in the file"));
        let derived = self.derived.get(level).ok_or_else(missing)?;
        let arena = arena(u8::try_from(level).map_err(|_| missing())?)?;
        derived.lane(&arena.ok_or_else(missing)?, axis)
    }
}

/// An arena with a lane along every axis: stored lanes, and missing ones derived when first needed.
#[derive(Debug)]
pub struct LaneSet<'a> {
    arena: Arena<'a>,
    levels: Arc<LevelLanes>,
}

impl<'a> LaneSet<'a> {
    /// Wraps `arena` without its levels of detail. Derived lanes may take `memory` bytes in all; `None` for no limit.
    pub fn new(arena: Arena<'a>, memory: Option<u64>) -> LaneSet<'a> {
        LaneSet::sharing(arena, Arc::new(LevelLanes::of_levels(Vec::new(), memory.unwrap_or(u64::MAX))))
    }

    /// Wraps `arena` and its levels of detail. Derived lanes of each may take `memory` bytes in all; `None` for no limit.
    pub fn with_levels(arena: Arena<'a>, memory: Option<u64>) -> LaneSet<'a> {
        let function = TransferFunction::of_description(arena.description(), arena.facts().grid.mean_spacing());
        let levels = LevelLanes::new(&arena, |level| arena.level(level), function, memory.unwrap_or(u64::MAX));
        LaneSet::sharing(arena, Arc::new(levels))
    }

    /// Wraps `arena`, whose derived lanes outlive this set.
    pub(crate) fn sharing(arena: Arena<'a>, levels: Arc<LevelLanes>) -> LaneSet<'a> {
        LaneSet { arena, levels }
    }

    pub(crate) fn levels(&self) -> &LevelLanes {
        &self.levels
    }

    /// Returns the arena.
    pub fn arena(&self) -> &Arena<'a> {
        &self.arena
    }

    /// Returns the lane along `axis`, deriving it if the arena does not store it.
    ///
    /// # Errors
    /// [`Error::Limit`] if the derived lanes would exceed the memory they may take.
    pub fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.levels.derived[0].lane(&self.arena, axis)
    }
}
