//! The lanes of an arena: those that it stores, and those derived from them.

use std::sync::OnceLock;

use super::lane::Lane;
use super::open::Arena;
use super::owned_lane::OwnedLane;
use super::transpose::transpose;
use crate::error::{Error, Result};
use crate::volume::Axis;

/// Lanes that an arena does not store, derived from the lane along x when first needed.
#[derive(Debug)]
pub(crate) struct DerivedLanes {
    lanes: [OnceLock<OwnedLane>; 3],
    /// Most bytes that derived lanes may take in all.
    memory: u64,
}

impl DerivedLanes {
    /// Creates an empty set that may grow to `memory` bytes.
    pub(crate) fn new(memory: u64) -> DerivedLanes {
        DerivedLanes { lanes: Default::default(), memory }
    }

    /// Returns the most bytes that derived lanes may take in all.
    pub(crate) fn memory(&self) -> u64 {
        self.memory
    }

    /// Returns the lane of `arena` along `axis`. A missing lane is derived once, in about the time of a few frames.
    ///
    /// # Errors
    /// [`Error::Limit`] if the derived lanes would exceed the memory they may take.
    pub(crate) fn lane<'a>(&'a self, arena: &Arena<'a>, axis: Axis) -> Result<Lane<'a>> {
        if let Some(lane) = arena.lane(axis) {
            return Ok(lane);
        }
        let derived = &self.lanes[axis.index()];
        if let Some(lane) = derived.get() {
            return Ok(lane.view());
        }
        let source = arena.lane(Axis::X).expect("by R10 every arena that opens has the lane along x");
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

/// An arena with a lane along every axis: stored lanes, and missing ones derived when first needed.
#[derive(Debug)]
pub struct LaneSet<'a> {
    arena: Arena<'a>,
    derived: DerivedLanes,
}

impl<'a> LaneSet<'a> {
    /// Wraps `arena`. Derived lanes may take `memory` bytes in all; `None` for no limit.
    pub fn new(arena: Arena<'a>, memory: Option<u64>) -> LaneSet<'a> {
        LaneSet { arena, derived: DerivedLanes::new(memory.unwrap_or(u64::MAX)) }
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
        self.derived.lane(&self.arena, axis)
    }
}
