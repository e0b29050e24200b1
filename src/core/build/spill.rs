//! The spill: visible voxels in reading order, kept until their codes can be computed.
//!
//! In: rows of a slice by ascending y, slices by ascending z, with raw samples. Out: the rows of any region. Raw samples
//! are kept because the data's range, which decides the codes, is known only at the end.
//!
//! ```text
//! store:  for each slice that has visible voxels
//!             for each row that has visible voxels
//!                 y u16, count - 1 u16, then one array each: x u16, sample, normal, magnitude f64
//!             the directory: for every eight rows, the byte after them, counted from the slice's start: u64
//! ```
//!
//! All numbers are little endian, except samples and magnitudes, which are native. Memory beside the store: 16 bytes
//! per slice.

use std::ops::Range;

use zerocopy::FromBytes as _;
use zerocopy::byteorder::little_endian::U16;

use super::store::SpillStore;
use crate::arena::Region;
use crate::arena::layout::Channels;
use crate::error::Result;
use crate::volume::{Header, Sample, SampleType};

/// Number of rows that share an entry of a slice's directory.
pub(super) const GROUP_ROWS: u32 = 8;
/// Most bytes that are read at once, unless a single group of rows is larger.
const READ_BYTES: u64 = 1 << 18;

#[derive(Debug, Clone, Copy)]
pub(super) struct VoxelWidths {
    pub(super) sample: usize,
    pub(super) normal: usize,
    pub(super) magnitude: usize,
}

impl VoxelWidths {
    pub(super) fn new(sample_type: SampleType, channels: Channels) -> VoxelWidths {
        VoxelWidths {
            sample: sample_type.bytes(),
            normal: usize::from(channels.normal_bits / 4),
            magnitude: usize::from(channels.magnitude_bits),
        }
    }

    pub(super) fn voxel(self) -> usize {
        2 + self.sample + self.normal + self.magnitude
    }
}

/// Encoded rows of one slice, in complete groups of [`GROUP_ROWS`].
#[derive(Debug, Default)]
pub(super) struct SpilledRows {
    bytes: Vec<u8>,
    /// End of each group of rows in `bytes`.
    group_ends: Vec<usize>,
    voxels: u64,
}

/// The visible voxels of one row, as one array per property.
#[derive(Debug, Default)]
pub(super) struct RowArrays {
    pub(super) xs: Vec<u16>,
    pub(super) samples: Vec<u8>,
    pub(super) normals: Vec<u8>,
    pub(super) magnitudes: Vec<f64>,
}

impl SpilledRows {
    /// Appends the row at `y` and clears `row`.
    pub(super) fn push(&mut self, y: u16, row: &mut RowArrays) {
        let Some(last) = row.xs.len().checked_sub(1) else { return };
        let last = u16::try_from(last).expect("a row has at most 65,535 voxels");
        self.bytes.extend_from_slice(&y.to_le_bytes());
        self.bytes.extend_from_slice(&last.to_le_bytes());
        self.bytes.extend(row.xs.iter().flat_map(|x| x.to_le_bytes()));
        self.bytes.extend_from_slice(&row.samples);
        self.bytes.extend_from_slice(&row.normals);
        self.bytes.extend_from_slice(bytemuck::cast_slice(&row.magnitudes));
        self.voxels += row.xs.len() as u64;
        row.xs.clear();
        row.samples.clear();
        row.normals.clear();
        row.magnitudes.clear();
    }

    pub(super) fn end_group(&mut self) {
        self.group_ends.push(self.bytes.len());
    }
}

/// All visible voxels of a volume, with raw samples instead of codes.
pub(crate) struct SpilledVoxels {
    pub(super) dims: [u32; 3],
    pub(super) sample_type: SampleType,
    pub(super) widths: VoxelWidths,
    pub(super) store: SpillStore,
    /// Range of bytes in the store of each slice's rows; empty, without a directory, if the slice has no visible voxel.
    slices: Vec<Range<u64>>,
    /// Directory of the current slice, which starts at byte `start` of the store.
    directory: Vec<u64>,
    start: u64,
    pub(crate) voxels: u64,
}

impl SpilledVoxels {
    pub(super) fn new(header: &Header, channels: Channels, store: SpillStore) -> SpilledVoxels {
        SpilledVoxels {
            dims: header.grid.dims,
            sample_type: header.sample_type,
            widths: VoxelWidths::new(header.sample_type, channels),
            store,
            slices: Vec::new(),
            directory: Vec::new(),
            start: 0,
            voxels: 0,
        }
    }

    /// Appends the next rows of the current slice.
    pub(super) fn append(&mut self, rows: &SpilledRows) -> Result<()> {
        let before = self.store.len - self.start;
        self.directory.extend(rows.group_ends.iter().map(|&end| before + end as u64));
        self.voxels += rows.voxels;
        self.store.append(&rows.bytes)
    }

    pub(super) fn end_slice(&mut self) -> Result<()> {
        let end = self.store.len;
        self.slices.push(self.start..end);
        if end > self.start {
            self.store.append(bytemuck::cast_slice(&self.directory))?;
        }
        self.directory.clear();
        self.start = self.store.len;
        Ok(())
    }

    /// Calls `row` with y, z and all voxels of each row inside the y and z ranges of `region`.
    pub(super) fn read(&self, region: &Region, mut row: impl FnMut(u16, u16, RowParts)) -> Result<()> {
        let (mut directory, mut bytes) = (Vec::new(), Vec::new());
        let groups = self.dims[1].div_ceil(GROUP_ROWS);
        let (first, last) = (region.ys.start / GROUP_ROWS, region.ys.end.div_ceil(GROUP_ROWS).min(groups));
        for z in region.zs.start..region.zs.end.min(self.dims[2]) {
            let slice = &self.slices[z as usize];
            if slice.is_empty() || first >= last {
                continue;
            }
            let z = u16::try_from(z).expect("a grid has at most 65,535 slices");
            // Read the directory from the end of the group before `first`, where `first` starts; group 0 starts at 0.
            let from = slice.end + 8 * u64::from(first.saturating_sub(1));
            let ends = self.store.read(from, slice.end + 8 * u64::from(last), &mut directory)?;
            let mut ends = ends.as_chunks().0.iter().map(|&end| u64::from_ne_bytes(end)).peekable();
            let mut start = if first == 0 { 0 } else { ends.next().expect("the group before the first") };
            while let Some(mut end) = ends.next() {
                while let Some(next) = ends.next_if(|next| next - start <= READ_BYTES) {
                    end = next;
                }
                let mut remaining = self.store.read(slice.start + start, slice.start + end, &mut bytes)?;
                while let Some((head, after)) = remaining.split_first_chunk::<4>() {
                    let [y, last] = <[U16; 2]>::read_from_bytes(head).expect("four bytes").map(U16::get);
                    let count = usize::from(last) + 1;
                    let (xs, after) = after.split_at(2 * count);
                    let xs = <[U16]>::ref_from_bytes(xs).expect("two bytes a voxel, at any address");
                    let (samples, after) = after.split_at(self.widths.sample * count);
                    let (normals, after) = after.split_at(self.widths.normal * count);
                    let (magnitudes, after) = after.split_at(self.widths.magnitude * count);
                    remaining = after;
                    if region.ys.contains(&y.into()) {
                        row(y, z, RowParts { xs, samples, normals, magnitudes });
                    }
                }
                start = end;
            }
        }
        Ok(())
    }
}

pub(super) struct RowParts<'a> {
    pub(super) xs: &'a [U16],
    samples: &'a [u8],
    normals: &'a [u8],
    magnitudes: &'a [u8],
}

impl RowParts<'_> {
    /// Returns the index of the first voxel whose coordinate is at least `x`.
    pub(super) fn at_or_after(&self, x: u32) -> usize {
        self.xs.partition_point(|here| u32::from(here.get()) < x)
    }

    pub(super) fn normal(&self, index: usize, width: usize) -> u32 {
        match width {
            0 => 0,
            2 => u16::from_le_bytes(self.normals.as_chunks().0[index]).into(),
            _ => u32::from_le_bytes(self.normals.as_chunks().0[index]),
        }
    }

    pub(super) fn magnitude(&self, index: usize) -> Option<f64> {
        self.magnitudes.as_chunks().0.get(index).map(|&bytes| f64::from_ne_bytes(bytes))
    }

    #[inline(always)]
    pub(super) fn sample<T: Sample>(&self, index: usize) -> T {
        bytemuck::pod_read_unaligned(&self.samples[index * size_of::<T>()..][..size_of::<T>()])
    }
}
