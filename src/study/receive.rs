//! Receivers: what studies do with the voxels of a walk.

use super::baselines::{Normal, Receiver, VoxelCube};
use crate::splatter::Splatter;
use adjsplat::arena::Lane;
use adjsplat::traverse::{Batch, Order};

/// Adds up coordinates, codes and normals: the least work that uses everything a voxel has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct VoxelSum {
    /// Number of voxels and cubes that were received.
    pub count: u64,
    /// Sum of coordinates, codes and bits of normals, modulo the range of its type.
    pub of_all: u64,
}

impl Receiver for VoxelSum {
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

    fn cube(&mut self, cube: &VoxelCube) {
        self.count += 1;
        self.of_all = self.of_all.wrapping_add(cube.low.iter().map(|&c| u64::from(c)).sum::<u64>());
    }

    /// Adds array by array, as a renderer reads them.
    #[inline(always)]
    fn batch(&mut self, lane: &Lane, _: &Order, batch: &Batch) {
        let mut sum = sum_of_coordinates(batch);
        for index in 0..batch.len() {
            sum += lane.values.get(batch.record_index(index)).map_or(0, |&value| u64::from(value));
        }
        if lane.channels.normal_bits > 0 {
            let normals = lane.normals.as_chunks::<2>().0;
            for index in 0..batch.len() {
                sum += normals.get(batch.record_index(index)).map_or(0, |&code| u64::from(u16::from_le_bytes(code)));
            }
        }
        self.count += batch.len() as u64;
        self.of_all = self.of_all.wrapping_add(sum);
    }
}

#[inline(always)]
fn sum_of_coordinates(batch: &Batch) -> u64 {
    let sum = batch.medium.iter().chain(batch.fast).map(|&c| u64::from(c)).sum::<u64>();
    u64::from(batch.slow) * batch.len() as u64 + sum
}

/// Adds up coordinates only, which measures the cost of the walk itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CoordinateSum {
    /// Number of voxels and cubes that were received.
    pub count: u64,
    /// Sum of coordinates, modulo the range of its type.
    pub of_all: u64,
}

impl Receiver for CoordinateSum {
    #[inline(always)]
    fn voxel(&mut self, position: [u16; 3], _: u8, _: Normal) {
        self.count += 1;
        self.of_all = self.of_all.wrapping_add(position.iter().map(|&c| u64::from(c)).sum());
    }

    fn cube(&mut self, cube: &VoxelCube) {
        self.voxel(cube.low, 0, Normal::Code(0));
    }

    #[inline(always)]
    fn batch(&mut self, _: &Lane, _: &Order, batch: &Batch) {
        self.count += batch.len() as u64;
        self.of_all = self.of_all.wrapping_add(sum_of_coordinates(batch));
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

    fn cube(&mut self, cube: &VoxelCube) {
        self.cube(cube.low, cube.level, cube.look, cube.normal);
    }

    fn batch(&mut self, _: &Lane, _: &Order, batch: &Batch) {
        self.batch(batch);
    }
}
