//! A lane that owns its data, built or derived in memory.

use zerocopy::byteorder::little_endian::{U16, U32};

use super::lane::{Lane, LineEnds};
use super::layout::{Channels, TileRecord, line_end_bytes};
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
    /// Ends of the lines that are not empty: see [`Lane::line_ends`].
    pub line_ends: OwnedLineEnds,
    /// Distances between records: see [`Lane::steps`].
    pub steps: Vec<u8>,
    /// Value codes: see [`Lane::values`].
    pub values: Vec<u8>,
    /// Normal codes: see [`Lane::normals`].
    pub normals: Vec<u8>,
    /// Gradient magnitude codes: see [`Lane::magnitudes`].
    pub magnitudes: Vec<u8>,
}

/// Line ends that own their memory: see [`LineEnds`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum OwnedLineEnds {
    /// Ends of two bytes each.
    Narrow(Vec<U16>),
    /// Ends of four bytes each.
    Wide(Vec<U32>),
}

impl OwnedLineEnds {
    /// Creates an empty list with the width (2 or 4 bytes) that lines of `line_points` grid points need.
    pub fn for_line(line_points: u32) -> OwnedLineEnds {
        if line_end_bytes(line_points) == 2 {
            OwnedLineEnds::Narrow(Vec::new())
        } else {
            OwnedLineEnds::Wide(Vec::new())
        }
    }

    fn len(&self) -> usize {
        match self {
            OwnedLineEnds::Narrow(ends) => ends.len(),
            OwnedLineEnds::Wide(ends) => ends.len(),
        }
    }

    /// Appends the end of the next line.
    ///
    /// # Panics
    /// If a two-byte end overflows, which [`super::layout::NARROW_LINE`] excludes.
    pub fn push(&mut self, end: u32) {
        match self {
            OwnedLineEnds::Narrow(ends) => {
                ends.push(U16::new(u16::try_from(end).expect("64 narrow lines stay below 2^16 records")));
            }
            OwnedLineEnds::Wide(ends) => ends.push(U32::new(end)),
        }
    }
}

impl OwnedLane {
    /// Creates a lane without voxels.
    pub fn new(axis: Axis, dims: [u32; 3], channels: Channels) -> OwnedLane {
        OwnedLane {
            axis,
            dims,
            channels,
            tiles: Vec::new(),
            line_ends: OwnedLineEnds::for_line(dims[axis.index()]),
            steps: Vec::new(),
            values: Vec::new(),
            normals: Vec::new(),
            magnitudes: Vec::new(),
        }
    }

    /// Appends the tiles of `run`, with their lines and records, after the lane's own.
    pub fn append(&mut self, run: TileRun) {
        let (first_line, first_record) = (self.line_ends.len(), self.steps.len() as u64);
        let first_line = u32::try_from(first_line).expect("a face has fewer than 2^32 lines");
        self.tiles.extend(run.tiles.iter().map(|tile| tile.moved(first_line, first_record)));
        run.line_ends.iter().for_each(|&end| self.line_ends.push(end));
        self.steps.extend(run.arrays.steps);
        self.values.extend(run.arrays.values);
        self.normals.extend(run.arrays.normals);
        self.magnitudes.extend(run.arrays.magnitudes);
    }

    /// Returns a view that borrows this lane.
    pub fn view(&self) -> Lane<'_> {
        Lane {
            axis: self.axis,
            dims: self.dims,
            channels: self.channels,
            tiles: &self.tiles,
            line_ends: match &self.line_ends {
                OwnedLineEnds::Narrow(ends) => LineEnds::Narrow(ends),
                OwnedLineEnds::Wide(ends) => LineEnds::Wide(ends),
            },
            steps: &self.steps,
            values: &self.values,
            normals: &self.normals,
            magnitudes: &self.magnitudes,
            patch: None,
            shown: None,
            pager: None,
        }
    }
}
