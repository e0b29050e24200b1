//! The spill: visible voxels as they come, row after row, until it is known what their codes mean.
//!
//! In: rows of a slice by ascending y, slices by ascending z, each voxel with its sample as it was read. Out: the rows
//! of any region. Samples stay raw, so that the range of the data need not be known before they are read.
//!
//! ```text
//! store:  for each slice that is not empty
//!             for each row that is not empty
//!                 y u16, count - 1 u16, then one array each: x u16, sample, normal, magnitude f64
//!             for every eight rows, where they end, from the slice's start: u64
//! ```
//!
//! All little endian but the samples and magnitudes, which are the machine's. Memory beside the store: 16 bytes a
//! slice.

use std::ops::Range;

use super::plan::Plan;
use super::store::Store;
use crate::arena::layout::Channels;
use crate::arena::pack::Record;
use crate::arena::rows::{Region, Rows, Voxel};
use crate::error::Result;
use crate::volume::{Header, Sample, SampleType};
use crate::with_sample_type;

/// Rows that share an entry of a slice's directory.
pub(super) const GROUP_ROWS: u32 = 8;
/// Bytes to read at once, where rows are small.
const READ_BYTES: u64 = 1 << 18;

/// Bytes of a voxel's parts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Widths {
    pub(super) sample: usize,
    pub(super) normal: usize,
    pub(super) magnitude: usize,
}

impl Widths {
    pub(super) fn new(sample_type: SampleType, channels: Channels) -> Widths {
        Widths {
            sample: sample_type.bytes(),
            normal: usize::from(channels.normal_bits / 4),
            magnitude: usize::from(channels.magnitude_bits),
        }
    }

    /// Bytes of a voxel.
    pub(super) fn voxel(self) -> usize {
        2 + self.sample + self.normal + self.magnitude
    }
}

/// Some rows of a slice, whole groups of them.
#[derive(Debug, Default)]
pub(super) struct SpilledRows {
    bytes: Vec<u8>,
    /// Where each group ends in `bytes`.
    group_ends: Vec<usize>,
    voxels: u64,
}

/// The voxels of the row at hand, one array each.
#[derive(Debug, Default)]
pub(super) struct RowArrays {
    pub(super) xs: Vec<u16>,
    pub(super) samples: Vec<u8>,
    pub(super) normals: Vec<u8>,
    pub(super) magnitudes: Vec<f64>,
}

impl SpilledRows {
    /// Appends the row at `y`, and empties it.
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

    /// Ends a group of rows.
    pub(super) fn end_group(&mut self) {
        self.group_ends.push(self.bytes.len());
    }
}

/// All visible voxels of a volume.
pub(super) struct Spill {
    dims: [u32; 3],
    sample_type: SampleType,
    widths: Widths,
    store: Store,
    /// Where each slice's rows are in the store; empty, without a directory, if it has none.
    slices: Vec<Range<u64>>,
    /// The directory of the slice at hand, and where that slice starts.
    directory: Vec<u64>,
    start: u64,
    voxels: u64,
}

impl Spill {
    pub(super) fn new(header: &Header, channels: Channels, store: Store) -> Spill {
        Spill {
            dims: header.grid.dims,
            sample_type: header.sample_type,
            widths: Widths::new(header.sample_type, channels),
            store,
            slices: Vec::new(),
            directory: Vec::new(),
            start: 0,
            voxels: 0,
        }
    }

    /// Visible voxels so far.
    pub(super) fn voxels(&self) -> u64 {
        self.voxels
    }

    /// Bytes that are held in memory.
    pub(super) fn memory(&self) -> u64 {
        self.store.memory()
    }

    /// Appends the next rows of the slice at hand.
    pub(super) fn append(&mut self, rows: &SpilledRows) -> Result<()> {
        let before = self.store.len() - self.start;
        self.directory.extend(rows.group_ends.iter().map(|&end| before + end as u64));
        self.voxels += rows.voxels;
        self.store.append(&rows.bytes)
    }

    /// Ends the slice at hand.
    pub(super) fn end_slice(&mut self) -> Result<()> {
        let end = self.store.len();
        self.slices.push(self.start..end);
        if end > self.start {
            self.store.append(bytemuck::cast_slice(&self.directory))?;
        }
        self.directory.clear();
        self.start = self.store.len();
        Ok(())
    }

    /// Calls `row` with y, z and the parts of each row of the groups that `region` touches.
    fn read(&self, region: &Region, mut row: impl FnMut(u16, u16, RowParts)) -> Result<()> {
        let (mut directory, mut bytes) = (Vec::new(), Vec::new());
        let groups = self.dims[1].div_ceil(GROUP_ROWS);
        let (first, last) = (region.ys.start / GROUP_ROWS, region.ys.end.div_ceil(GROUP_ROWS).min(groups));
        for z in region.zs.start..region.zs.end.min(self.dims[2]) {
            let slice = &self.slices[z as usize];
            if slice.is_empty() || first >= last {
                continue;
            }
            let z = u16::try_from(z).expect("a grid has at most 65,535 slices");
            // Ends of the groups from the one before the first on; what is before group 0 ends at 0.
            let from = slice.end + 8 * u64::from(first.saturating_sub(1));
            let ends = self.store.read(from, slice.end + 8 * u64::from(last), &mut directory)?;
            let ends = ends.chunks_exact(8).map(|end| u64::from_ne_bytes(end.try_into().expect("eight bytes")));
            let mut ends = ends.peekable();
            let mut start = if first == 0 { 0 } else { ends.next().expect("the group before the first") };
            while let Some(mut end) = ends.next() {
                while let Some(next) = ends.next_if(|next| next - start <= READ_BYTES) {
                    end = next;
                }
                let mut rest = self.store.read(slice.start + start, slice.start + end, &mut bytes)?;
                while let Some((head, after)) = rest.split_first_chunk::<4>() {
                    let y = u16::from_le_bytes([head[0], head[1]]);
                    let count = usize::from(u16::from_le_bytes([head[2], head[3]])) + 1;
                    let (xs, after) = after.split_at(2 * count);
                    let (samples, after) = after.split_at(self.widths.sample * count);
                    let (normals, after) = after.split_at(self.widths.normal * count);
                    let (magnitudes, after) = after.split_at(self.widths.magnitude * count);
                    rest = after;
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

/// The arrays of one row.
struct RowParts<'a> {
    xs: &'a [u8],
    samples: &'a [u8],
    normals: &'a [u8],
    magnitudes: &'a [u8],
}

impl RowParts<'_> {
    fn x(&self, index: usize) -> u16 {
        u16::from_le_bytes([self.xs[2 * index], self.xs[2 * index + 1]])
    }

    /// The index of the first voxel at or after `x`.
    fn at(&self, x: u32) -> usize {
        let (mut low, mut high) = (0, self.xs.len() / 2);
        while low < high {
            let middle = usize::midpoint(low, high);
            if u32::from(self.x(middle)) < x { low = middle + 1 } else { high = middle }
        }
        low
    }

    fn normal(&self, index: usize, width: usize) -> u32 {
        match width {
            0 => 0,
            2 => u16::from_le_bytes([self.normals[2 * index], self.normals[2 * index + 1]]).into(),
            _ => u32::from_le_bytes(self.normals[4 * index..][..4].try_into().expect("four bytes")),
        }
    }

    fn magnitude(&self, index: usize) -> Option<f64> {
        let bytes = self.magnitudes.get(8 * index..8 * index + 8)?;
        Some(f64::from_ne_bytes(bytes.try_into().expect("eight bytes")))
    }

    #[inline(always)]
    fn sample<T: Sample>(&self, index: usize) -> T {
        bytemuck::pod_read_unaligned(&self.samples[index * size_of::<T>()..][..size_of::<T>()])
    }
}

/// A spill whose codes are known: the rows of a build.
pub struct SpilledVolume {
    pub(super) spill: Spill,
    pub(super) plan: Plan,
}

impl SpilledVolume {
    /// Voxels with z in `zs` that can be seen but are stored under a code whose value is transparent.
    pub(super) fn blurred_away(&self, zs: Range<u32>) -> Result<u64> {
        let [width, height, _] = self.spill.dims;
        let mut blurred = 0u64;
        self.spill.read(&Region { xs: 0..width, ys: 0..height, zs }, |_, _, row| {
            with_sample_type!(self.spill.sample_type, T => {
                let voxels = 0..row.xs.len() / 2;
                blurred += voxels.filter(|&i| self.plan.blurs_away(row.sample::<T>(i), self.magnitude(&row, i))).count() as u64;
            });
        })?;
        Ok(blurred)
    }

    fn magnitude(&self, row: &RowParts, index: usize) -> u8 {
        row.magnitude(index).map_or(0, |magnitude| self.plan.magnitudes.encode(magnitude))
    }

    fn voxels<T: Sample>(&self, row: &RowParts, range: Range<usize>, voxels: &mut Vec<Voxel>) {
        let normal = self.spill.widths.normal;
        voxels.clear();
        voxels.extend(range.map(|index| Voxel {
            x: row.x(index),
            record: Record {
                value: self.plan.code(row.sample::<T>(index)),
                normal: row.normal(index, normal),
                magnitude: self.magnitude(row, index),
            },
        }));
    }
}

impl Rows for SpilledVolume {
    fn dims(&self) -> [u32; 3] {
        self.spill.dims
    }

    fn channels(&self) -> Channels {
        self.plan.channels
    }

    fn memory(&self) -> u64 {
        self.spill.memory()
    }

    fn read(&self, region: Region, row: &mut dyn FnMut(u16, u16, &[Voxel])) -> Result<()> {
        let mut voxels = Vec::new();
        self.spill.read(&region, |y, z, parts| {
            let range = parts.at(region.xs.start)..parts.at(region.xs.end);
            if !range.is_empty() {
                with_sample_type!(self.spill.sample_type, T => self.voxels::<T>(&parts, range, &mut voxels));
                row(y, z, &voxels);
            }
        })
    }
}
