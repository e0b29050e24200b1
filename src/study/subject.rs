//! Subjects: the scenes for which the methods of a study build their structures.
//!
//! In: a file with 8-bit values and with normals of 2 x 8 bits or none. Out: its visible voxels in scan order (x
//! fastest) and its three lanes.

use adjsplat::arena::layout::Facts;
use adjsplat::arena::{Lane, LaneSet};
use adjsplat::classify::TransferFunction;
use adjsplat::error::{Error, Result};
use adjsplat::internals::scatter::Table;
use adjsplat::splat::{Scene, Settings};
use adjsplat::traverse::{Batch, Order, walk};
use adjsplat::volume::Axis;

/// A visible voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VisibleVoxel {
    /// Coordinates along x, y and z.
    pub position: [u16; 3],
    /// The voxel's value code (stored number).
    pub value: u8,
    /// The voxel's normal code (stored number); 0 if there are no normals.
    pub normal: u16,
}

/// A scene that a study draws with every method.
#[derive(Debug)]
pub struct Subject<'a> {
    /// The subject's name in tables.
    pub name: String,
    /// The grid, and how values and normals are coded.
    pub facts: &'a Facts,
    /// The transfer function: the colour and opacity of each value.
    pub transfer: TransferFunction,
    /// The three lanes (all scan lines along one axis each), stored or derived.
    pub lanes: &'a LaneSet<'a>,
    /// The visible voxels in scan order: x fastest, then y, then z.
    pub voxels: Vec<VisibleVoxel>,
}

impl<'a> Subject<'a> {
    /// Reads the visible voxels of `lanes`, which `transfer` colours. O(voxels); takes 10 bytes per voxel.
    ///
    /// # Errors
    /// [`Error::Input`] if values do not have 8 bits or normals neither 2 x 8 bits nor none; [`Error::Limit`] if memory
    /// cannot be had; any error of deriving a lane.
    pub fn new(name: &str, lanes: &'a LaneSet<'a>, transfer: TransferFunction) -> Result<Subject<'a>> {
        let facts = lanes.arena().facts();
        let channels = facts.channels;
        if channels.value_bits != 8 || !matches!(channels.normal_bits, 0 | 8) || channels.magnitude_bits != 0 {
            let why = "has other channels than the methods of a study store; build it with values of 8 bits, normals of 8 \
                       bits or none, and no gradient opacity";
            return Err(Error::input(name, why));
        }
        let mut voxels = Vec::new();
        let count = usize::try_from(facts.visible_voxels).unwrap_or(usize::MAX);
        voxels.try_reserve_exact(count).map_err(|_| {
            Error::out_of_memory(
                format!("the voxels of {name}"),
                facts.visible_voxels.saturating_mul(size_of::<VisibleVoxel>() as u64),
            )
        })?;
        let lane = lanes.lane(Axis::X)?;
        // The nesting z, y, x, all ascending, gives scan order.
        walk(&lane, &Order::parallel(5, 0), &mut |batch: &Batch| {
            for index in 0..batch.len() {
                let record = batch.record_index(index);
                let value = u8::try_from(lane.value_code(record)).expect("values are 8-bit");
                let normal = u16::try_from(lane.normal_code(record)).expect("normals are 2 x 8 bits");
                voxels.push(VisibleVoxel {
                    position: [batch.fast[index], batch.medium[index], batch.slow],
                    value,
                    normal,
                });
            }
        });
        Ok(Subject { name: name.to_owned(), facts, transfer, lanes, voxels })
    }

    /// Returns the grid points along x, y and z.
    pub fn dims(&self) -> [u32; 3] {
        self.facts.grid.dims
    }

    /// Returns the lane along `axis`.
    ///
    /// # Panics
    /// If it cannot be derived; studies derive all lanes before they begin.
    pub fn lane(&self, axis: Axis) -> Lane<'_> {
        self.lanes.lane(axis).expect("lanes of a study fit its memory")
    }

    /// Returns linear red, green, blue and optical depth per mean spacing in units of ln 2, for each value code.
    ///
    /// # Errors
    /// [`Error`] if the file's scales are out of range.
    pub fn looks(&self) -> Result<[[f32; 4]; 256]> {
        let scene = Scene { facts: self.facts, lanes: self.lanes, transfer: &self.transfer };
        let table =
            Table::new(&scene, &self.lane(Axis::X), &Settings::every_pixel([1; 2]), self.facts.grid.mean_spacing())?;
        Ok(*table.of_bytes().expect("looks depend on 8-bit values alone"))
    }
}
