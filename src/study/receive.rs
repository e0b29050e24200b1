//! What studies do with the voxels that a walk hands over.

use super::baselines::{Node, Normal, Receiver};
use crate::splatter::Splatter;
use adjsplat::arena::Lane;
use adjsplat::traverse::Batch;

/// Adds up what it is given: the least that uses all of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sum {
    /// Voxels and cubes.
    pub count: u64,
    /// Of coordinates, codes and bits of normals; wraps.
    pub of_all: u64,
}

impl Sum {
    /// Adds the voxels of a batch of `lane`, which has normals if `shaded`: array by array, as a renderer reads them.
    #[inline(always)]
    pub fn add(&mut self, lane: &Lane, batch: &Batch, shaded: bool) {
        let mut sum = u64::from(batch.slow) * batch.len() as u64;
        sum += batch.medium.iter().chain(batch.fast).map(|&c| u64::from(c)).sum::<u64>();
        for index in 0..batch.len() {
            sum += lane.values.get(batch.record_index(index)).map_or(0, |&value| u64::from(value));
        }
        if shaded {
            let normals = lane.normals.as_chunks::<2>().0;
            for index in 0..batch.len() {
                sum += normals.get(batch.record_index(index)).map_or(0, |&code| u64::from(u16::from_le_bytes(code)));
            }
        }
        self.count += batch.len() as u64;
        self.of_all = self.of_all.wrapping_add(sum);
    }
}

impl Receiver for Sum {
    #[inline(always)]
    fn voxel(&mut self, [x, y, z]: [u16; 3], value: u8, normal: Normal) {
        let normal = match normal {
            Normal::Code(code) => code.into(),
            Normal::Vector([x, y, z]) => x.to_bits() ^ y.to_bits() ^ z.to_bits(),
        };
        let place = u32::from(x) + u32::from(y) + u32::from(z) + u32::from(value);
        self.count += 1;
        self.of_all = self.of_all.wrapping_add(u64::from(place) + u64::from(normal));
    }

    fn node(&mut self, node: &Node) {
        self.count += 1;
        self.of_all = self.of_all.wrapping_add(node.low.iter().map(|&c| u64::from(c)).sum::<u64>());
    }
}

/// Adds up coordinates alone: what a walk itself costs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Places {
    /// Voxels and cubes.
    pub count: u64,
    /// Of coordinates; wraps.
    pub of_all: u64,
}

impl Places {
    /// Adds those of a batch.
    #[inline(always)]
    pub fn add(&mut self, batch: &Batch) {
        let sum = |along: &[u16]| along.iter().map(|&c| u64::from(c)).sum::<u64>();
        self.count += batch.len() as u64;
        let sum = u64::from(batch.slow) * batch.len() as u64 + sum(batch.medium) + sum(batch.fast);
        self.of_all = self.of_all.wrapping_add(sum);
    }
}

impl Receiver for Places {
    #[inline(always)]
    fn voxel(&mut self, position: [u16; 3], _: u8, _: Normal) {
        self.count += 1;
        self.of_all = self.of_all.wrapping_add(position.iter().map(|&c| u64::from(c)).sum());
    }

    fn node(&mut self, node: &Node) {
        self.voxel(node.low, 0, Normal::Code(0));
    }
}

impl Receiver for Splatter<'_> {
    #[inline(always)]
    fn voxel(&mut self, position: [u16; 3], value: u8, normal: Normal) {
        match normal {
            Normal::Code(code) => self.coded(position, value, code),
            Normal::Vector(normal) => self.cube(position, 0, self.look(value), normal),
        }
    }

    fn node(&mut self, node: &Node) {
        self.cube(node.low, node.level, node.look, node.normal);
    }
}
