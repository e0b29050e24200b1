//! A lane that owns its data, built or derived in memory.

use super::lane::{Lane, LineEnds, stored_line_ends};
use super::layout::{Channels, TileRecord};
use super::pack::TileRun;
use crate::volume::Axis;

/// A lane that owns its data; the fields have the same meaning as those of [`Lane`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnedLane {
    /// The axis along which the lane's lines run.
    pub axis: Axis,
    /// Number of grid points along x, y, z.
    pub dims: [u32; 3],
    /// Widths of the channels.
    pub channels: Channels,
    /// Tiles that are not empty: see [`Lane::tiles`].
    pub tiles: Vec<TileRecord>,
    /// Bytes of the ends of the lines that are not empty: see [`LineEnds::new`] and [`Lane::line_ends`].
    pub line_ends: Vec<u8>,
    /// Distances between records: see [`Lane::steps`].
    pub steps: Vec<u8>,
    /// Value codes: see [`Lane::values`].
    pub values: Vec<u8>,
    /// Normal codes: see [`Lane::normals`].
    pub normals: Vec<u8>,
    /// Gradient magnitude codes: see [`Lane::magnitudes`].
    pub magnitudes: Vec<u8>,
    /// Coverage codes: see [`Lane::coverages`].
    pub coverages: Vec<u8>,
}

impl OwnedLane {
    /// Creates a lane without voxels.
    pub fn new(axis: Axis, dims: [u32; 3], channels: Channels) -> OwnedLane {
        let [line_ends, steps, values, normals, magnitudes, coverages] = [const { Vec::new() }; 6];
        OwnedLane { axis, dims, channels, tiles: Vec::new(), line_ends, steps, values, normals, magnitudes, coverages }
    }

    /// Appends the tiles of `run`, with their lines and records, after the lane's own.
    pub fn append(&mut self, run: TileRun) {
        let (first_line, first_record) = (self.view().line_ends.len(), self.steps.len() as u64);
        let first_line = u32::try_from(first_line).expect("a face has fewer than 2^32 lines");
        self.tiles.extend(run.tiles.iter().map(|tile| tile.moved(first_line, first_record)));
        self.line_ends.extend(stored_line_ends(&run.line_ends, self.dims[self.axis.index()]));
        self.steps.extend(run.arrays.steps);
        self.values.extend(run.arrays.values);
        self.normals.extend(run.arrays.normals);
        self.magnitudes.extend(run.arrays.magnitudes);
        self.coverages.extend(run.arrays.coverages);
    }

    /// Returns a view that borrows this lane.
    pub fn view(&self) -> Lane<'_> {
        Lane {
            axis: self.axis,
            dims: self.dims,
            channels: self.channels,
            tiles: &self.tiles,
            line_ends: LineEnds::new(&self.line_ends, self.dims[self.axis.index()]),
            steps: &self.steps,
            values: &self.values,
            normals: &self.normals,
            magnitudes: &self.magnitudes,
            coverages: &self.coverages,
            elsewhere: None,
            patch: None,
            shown: None,
            omitted: None,
            pager: None,
        }
    }
}
