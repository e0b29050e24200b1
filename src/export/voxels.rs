//! The voxels to export: those of an arena that a transfer function shows, slice by slice.

use std::ops::Range;

use adjsplat::arena::layout::Facts;
use adjsplat::arena::{Arena, LaneRows, Record, Region, Rows, VisibleCodes, Voxel};
use adjsplat::classify::{TransferFunction, normal};
use adjsplat::error::{Error, Result};
use adjsplat::internals::{drawable, stored_transfer};
use adjsplat::volume::{Grid, SampleType};
use serde_json::Value;

use super::output::{Progress, Written};
use super::units;

/// The voxels of an arena that are exported, and what the file says of the volume that it was built from.
pub(crate) struct StoredVoxels<'a> {
    pub(crate) arena: &'a Arena<'a>,
    /// The grid with its unit, if the file names one.
    pub(crate) grid: Grid,
    /// The transfer function in force; `None` if the file stores none that can be read and the caller gave none.
    pub(crate) transfer: Option<TransferFunction>,
    /// Number of voxels, at least 1.
    pub(crate) count: u64,
    /// The codes that occur, by code.
    pub(crate) occurring: Vec<bool>,
    /// The type of the samples that the file was built from, if it says so.
    pub(crate) source_type: Option<SampleType>,
    /// The lowest sample of the volume that the file was built from, if it says so.
    pub(crate) source_lowest: Option<f64>,
    rows: Box<dyn Rows + 'a>,
}

impl<'a> StoredVoxels<'a> {
    /// Finds the voxels of `arena` that `transfer` shows; without a function, all of them. Reads the arena once.
    ///
    /// # Errors
    /// [`Error::Input`] if none is visible, or if the function needs gradient magnitudes that are not stored.
    pub(crate) fn new(arena: &'a Arena<'a>, transfer: Option<&TransferFunction>) -> Result<StoredVoxels<'a>> {
        let facts = arena.facts();
        let shown = transfer.map(|transfer| drawable(arena, transfer.clone())).transpose()?;
        let codes = |transfer| VisibleCodes::new(transfer, facts.channels, &facts.scales, 0.0);
        let visible = shown.as_ref().map(codes).transpose()?;
        let lane = arena.x_lane();
        let keep = move |_: [u16; 3], _: usize, record: Record| {
            visible.as_ref().is_none_or(|codes| codes.has(record.value, record.magnitude)).then_some(record)
        };
        // For people, and so not always there.
        let description: Value = serde_json::from_slice(arena.description()).unwrap_or(Value::Null);
        let type_name = description["source"]["sample_type"].as_str();
        let unit = description["unit"].as_str().map(units::symbol);
        let mut voxels = StoredVoxels {
            arena,
            grid: Grid { unit, ..facts.grid.clone() },
            transfer: shown.or_else(|| stored_transfer(arena)),
            count: 0,
            occurring: vec![false; usize::from(facts.channels.last_value_code()) + 1],
            source_type: SampleType::ALL.into_iter().find(|known| Some(known.name()) == type_name),
            source_lowest: description["values"]["lowest"].as_f64(),
            rows: Box::new(LaneRows::new(lane, keep)),
        };
        let (mut count, mut occurring) = (0, std::mem::take(&mut voxels.occurring));
        let [nx, ny, nz] = voxels.grid.dims;
        voxels.read([0..nx, 0..ny, 0..nz], &mut |_, _, row| {
            count += row.len() as u64;
            row.iter().for_each(|voxel| occurring[usize::from(voxel.record.value)] = true);
        })?;
        if count == 0 {
            let why = format!("none of the file's {} voxels; choose other values", facts.visible_voxels);
            return Err(Error::input("nothing is visible", why));
        }
        (voxels.count, voxels.occurring) = (count, occurring);
        Ok(voxels)
    }

    /// Returns the contents of the arena's header.
    pub(crate) fn facts(&self) -> &'a Facts {
        self.arena.facts()
    }

    /// Returns whether values are labels.
    pub(crate) fn is_label_map(&self) -> bool {
        self.transfer.as_ref().is_some_and(TransferFunction::is_labels)
    }

    /// Returns the value of a code.
    pub(crate) fn value(&self, code: u16) -> f64 {
        self.facts().scales.value(code.into())
    }

    /// Returns the values that occur.
    pub(crate) fn values(&self) -> Vec<f64> {
        let codes = (0u16..=u16::MAX).zip(&self.occurring).filter(|(_, occurs)| **occurs);
        codes.map(|(code, _)| self.value(code)).collect()
    }

    /// Returns the unit normal of a record in the world; zero if it has none.
    pub(crate) fn normal(&self, record: Record) -> [f64; 3] {
        self.grid.world_normal(normal::decode(record.normal, self.facts().channels.normal_bits))
    }

    /// Returns the position of a grid point in the world.
    pub(crate) fn position(&self, index: [u16; 3]) -> [f64; 3] {
        let Grid { spacing, origin, direction, .. } = &self.grid;
        std::array::from_fn(|w| {
            origin[w] + (0..3).map(|a| direction[a][w] * (spacing[a] * f64::from(index[a]))).sum::<f64>()
        })
    }

    /// Calls `row` with y, z and the voxels of each row inside the box of ranges along x, y, z.
    ///
    /// Voxels come by ascending x; rows with the same z come by ascending y.
    pub(crate) fn read(&self, [xs, ys, zs]: [Range<u32>; 3], row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        self.rows.read(Region { xs, ys, zs }, row)
    }

    /// Calls `write` with the indices and the record of each voxel, slice by slice, then by ascending y and x. Reports
    /// each slice to `progress`; stops at the first failure.
    pub(crate) fn each(
        &self,
        progress: &Progress,
        mut write: impl FnMut([u16; 3], Record) -> std::io::Result<()>,
    ) -> Written {
        let [nx, ny, nz] = self.grid.dims;
        for slice in 0..nz {
            let mut written = Ok(());
            self.read([0..nx, 0..ny, slice..slice + 1], &mut |y, z, row| {
                if written.is_ok() {
                    written = row.iter().try_for_each(|voxel| write([voxel.x, y, z], voxel.record));
                }
            })?;
            written?;
            progress.step()?;
        }
        Ok(())
    }
}
