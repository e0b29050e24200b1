//! The visible voxels of a volume with their final codes.

use std::ops::Range;

use super::encoder::VoxelEncoder;
use super::spill::{RowParts, SpilledVoxels};
use crate::arena::layout::Channels;
use crate::arena::{Record, Region, Rows, Voxel};
use crate::error::Result;
use crate::volume::Sample;
use crate::with_sample_type;

/// The visible voxels of a volume, as rows along x.
pub struct ClassifiedRows {
    pub(crate) spill: SpilledVoxels,
    pub(crate) encoder: VoxelEncoder,
}

impl ClassifiedRows {
    fn magnitude(&self, row: &RowParts, index: usize) -> u8 {
        row.magnitude(index).map_or(0, |magnitude| self.encoder.magnitude_code(magnitude))
    }

    fn voxels<T: Sample>(&self, row: &RowParts, range: Range<usize>, voxels: &mut Vec<Voxel>) {
        let normal = self.spill.widths.normal;
        voxels.clear();
        voxels.extend(range.map(|index| Voxel {
            x: row.xs[index].get(),
            record: Record {
                value: self.encoder.code(row.sample::<T>(index)),
                normal: row.normal(index, normal),
                magnitude: self.magnitude(row, index),
                coverage: 0,
            },
        }));
    }
}

impl Rows for ClassifiedRows {
    fn dims(&self) -> [u32; 3] {
        self.spill.dims
    }

    fn channels(&self) -> Channels {
        self.encoder.channels
    }

    fn memory(&self) -> u64 {
        self.spill.store.memory()
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let mut voxels = Vec::new();
        self.spill.read(&region, |y, z, parts| {
            let range = parts.at_or_after(region.xs.start)..parts.at_or_after(region.xs.end);
            if !range.is_empty() {
                with_sample_type!(self.spill.sample_type, T => self.voxels::<T>(&parts, range, &mut voxels));
                row(y, z, &voxels);
            }
        })
    }
}
