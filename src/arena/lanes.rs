//! The lanes of an arena, stored or derived.

use std::sync::OnceLock;

use super::lane::{Lane, OwnedLane};
use super::open::Arena;
use super::transpose::transpose;
use crate::error::{Error, Result};
use crate::volume::Axis;

/// An arena with a lane along every axis: those that it stores, and those made from them on first need.
#[derive(Debug)]
pub struct LaneSet<'a> {
    arena: Arena<'a>,
    derived: [OnceLock<OwnedLane>; 3],
    /// Bytes that derived lanes may take; `None` for no limit.
    memory: Option<u64>,
}

impl<'a> LaneSet<'a> {
    /// Lanes of `arena`; derived ones may take `memory` bytes in all.
    pub fn new(arena: Arena<'a>, memory: Option<u64>) -> LaneSet<'a> {
        LaneSet { arena, derived: Default::default(), memory }
    }

    /// The arena.
    pub fn arena(&self) -> &Arena<'a> {
        &self.arena
    }

    /// The lane along `axis`; a missing one is derived, once, in about the time of a few frames.
    ///
    /// # Errors
    /// [`Error::Limit`] if a derived lane would not fit the memory.
    pub fn lane(&self, axis: Axis) -> Result<Lane<'_>> {
        if let Some(lane) = self.arena.lane(axis) {
            return Ok(lane);
        }
        let derived = &self.derived[axis.index()];
        if let Some(lane) = derived.get() {
            return Ok(lane.view());
        }
        let source = self.arena.lane(Axis::X).expect("by R10 every arena that opens has the lane along x");
        if let Some(memory) = self.memory {
            let others = self.derived.iter().filter_map(OnceLock::get).map(|lane| lane.view().bytes()).sum::<u64>();
            // Records need the same room in every lane; directories and the strip at hand add about as much again.
            let need = others + 2 * source.bytes();
            if need > memory {
                let what = format!("deriving the lane along {} (or build with --lanes xyz)", axis.name());
                return Err(Error::Limit { what, need, have: memory });
            }
        }
        Ok(derived.get_or_init(|| transpose(&source, axis, self.arena.facts().tile_order)).view())
    }
}
