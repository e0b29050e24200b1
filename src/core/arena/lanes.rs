//! The lanes of an arena, stored or derived.

use std::sync::OnceLock;

use super::lane::{Lane, OwnedLane};
use super::open::Arena;
use super::transpose::transpose;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::volume::Axis;

/// Lanes that an arena does not store, made from the one along x on first need.
#[derive(Debug)]
pub struct DerivedLanes {
    lanes: [OnceLock<OwnedLane>; 3],
    /// Bytes that they may take.
    memory: u64,
}

impl DerivedLanes {
    /// Returns an empty set, which may grow to `memory` bytes.
    pub fn new(memory: u64) -> DerivedLanes {
        DerivedLanes { lanes: Default::default(), memory }
    }

    /// Returns the lane of `arena` along `axis`; a missing one is derived, once, in about the time of a few frames.
    ///
    /// # Errors
    /// [`Error::Limit`] if a derived lane would not fit the memory.
    pub fn lane<'a>(&'a self, arena: &Arena<'a>, axis: Axis) -> Result<Lane<'a>> {
        if let Some(lane) = arena.lane(axis) {
            return Ok(lane);
        }
        let derived = &self.lanes[axis.index()];
        if let Some(lane) = derived.get() {
            return Ok(lane.view());
        }
        let source = arena.lane(Axis::X).expect("by R10 every arena that opens has the lane along x");
        let others = self.lanes.iter().filter_map(OnceLock::get).map(|lane| lane.view().bytes()).sum::<u64>();
        // Records need the same room in every lane; directories and the strip at hand add about as much again.
        let need = others.saturating_add(source.bytes().saturating_mul(2));
        if need > self.memory {
            let what = format!("bytes for the lane along {}, which the file does not store", axis.name());
            return Err(Error::Limit { what, need, have: self.memory });
        }
        Ok(derived.get_or_init(|| transpose(&source, axis, arena.facts().tile_order)).view())
    }
}

/// An arena with a lane along every axis: those that it stores, and those made from them on first need.
#[derive(Debug)]
pub struct LaneSet<'a> {
    arena: Arena<'a>,
    derived: DerivedLanes,
}

impl<'a> LaneSet<'a> {
    /// Lanes of `arena`; derived ones may take `memory` bytes in all, `None` for no limit.
    pub fn new(arena: Arena<'a>, memory: Option<u64>) -> LaneSet<'a> {
        LaneSet { arena, derived: DerivedLanes::new(memory.unwrap_or(u64::MAX)) }
    }

    /// Lanes of `arena`; derived ones may take what `limits` allow.
    pub fn within(arena: Arena<'a>, limits: &Limits) -> LaneSet<'a> {
        LaneSet::new(arena, Some(limits.derived_bytes))
    }

    /// The arena.
    pub fn arena(&self) -> &Arena<'a> {
        &self.arena
    }

    /// The lane along `axis`, see [`DerivedLanes::lane`].
    ///
    /// # Errors
    /// [`Error::Limit`] if a derived lane would not fit the memory.
    pub fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        self.derived.lane(&self.arena, axis)
    }
}
