//! Builds the structure of implementation B, voxel by voxel.

use std::collections::HashMap;

use zerocopy::little_endian::{F32, U16, U32};

use super::{NONE, RecordB};
use crate::baselines::allocate::{counted, push};
use crate::baselines::appearance::Appearance;
use crate::subject::VisibleVoxel;
use adjsplat::error::{Error, Result};

/// The structure of implementation B while voxels are added.
pub(super) struct BuilderB {
    pub(super) last: [u16; 3],
    pub(super) records: Vec<RecordB>,
    /// Numbers of the records of virtual voxels (caps, which end scan lines), by position.
    pub(super) caps: HashMap<[u16; 3], u32>,
}

impl BuilderB {
    /// Creates the eight corners of the box, each of which points to the three corners that share an edge with it.
    pub(super) fn new(last: [u16; 3]) -> Result<BuilderB> {
        let mut builder = BuilderB { last, records: Vec::new(), caps: HashMap::new() };
        for corner in 0..8u32 {
            let place = [0, 1, 2].map(|a| if corner >> a & 1 == 0 { 0 } else { last[a] });
            let record = builder.link(place)?;
            for a in 0..3 {
                let pointer = 2 * a + usize::from(corner >> a & 1 == 0);
                builder.records[record as usize].pointers[pointer].set(corner ^ 1 << a);
            }
        }
        Ok(builder)
    }

    pub(super) fn insert(&mut self, voxel: &VisibleVoxel, appearance: &Appearance) -> Result<()> {
        let index = self.link(voxel.position.map(|c| c + 1))?;
        let record = &mut self.records[index as usize];
        record.intensity = voxel.value;
        record.colour = appearance.colour(voxel);
        record.gradient = appearance.gradient(voxel).map(F32::new);
        Ok(())
    }

    /// Adds a new voxel to its three lines, with the missing caps of the lines; returns the number of the voxel's
    /// record.
    fn link(&mut self, place: [u16; 3]) -> Result<u32> {
        let index = counted("voxels of adjacency B", self.records.len() as u64 + 1)? - 1;
        let record = RecordB {
            intensity: 0,
            colour: [0; 4],
            pointers: [U32::new(NONE); 6],
            position: place.map(U16::new),
            gradient: [F32::new(0.0); 3],
        };
        push("adjacency B's records", &mut self.records, record)?;
        let is_cap = [0, 1, 2].map(|axis| place[axis] == 0 || place[axis] == self.last[axis]);
        if is_cap != [false; 3] {
            self.caps.try_reserve(1).map_err(|_| {
                Error::out_of_memory(
                    "the map of adjacency B's caps",
                    (self.caps.len() as u64).saturating_mul(2 * size_of::<([u16; 3], u32)>() as u64),
                )
            })?;
            self.caps.insert(place, index);
        }
        for axis in (0..3).filter(|&axis| !is_cap[axis]) {
            let [low, high] = [self.cap(place, axis, 0)?, self.cap(place, axis, self.last[axis])?];
            let [below, above] = self.neighbours(place, axis, [low, high]);
            *self.pointer(below, axis, true) = U32::new(index);
            *self.pointer(above, axis, false) = U32::new(index);
            *self.pointer(index, axis, false) = U32::new(below);
            *self.pointer(index, axis, true) = U32::new(above);
        }
        Ok(index)
    }

    /// Returns the record of the cap at coordinate `end` of the line through `place`; adds the cap if it is missing.
    fn cap(&mut self, mut place: [u16; 3], axis: usize, end: u16) -> Result<u32> {
        place[axis] = end;
        match self.caps.get(&place) {
            Some(&cap) => Ok(cap),
            None => self.link(place),
        }
    }

    fn pointer(&mut self, record: u32, axis: usize, up: bool) -> &mut U32 {
        &mut self.records[record as usize].pointers[2 * axis + usize::from(up)]
    }

    /// Returns the records below and above a new voxel on its line between two caps. The search starts from both ends,
    /// so that voxels in scan order take one step.
    fn neighbours(&mut self, place: [u16; 3], axis: usize, [low, high]: [u32; 2]) -> [u32; 2] {
        if self.pointer(low, axis, true).get() == NONE {
            return [low, high];
        }
        let (mut below, mut above) = (low, high);
        loop {
            let next = self.pointer(below, axis, true).get();
            if self.records[next as usize].position[axis].get() > place[axis] {
                return [below, next];
            }
            below = next;
            let next = self.pointer(above, axis, false).get();
            if self.records[next as usize].position[axis].get() < place[axis] {
                return [next, above];
            }
            above = next;
        }
    }
}
