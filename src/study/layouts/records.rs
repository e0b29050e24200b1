//! Records of a layout: channels of codes (stored numbers), in arrays or interleaved; and payloads shared by all lanes.

use super::lane::BRICK_VALUES;
use crate::lane_walk::store::CHUNK;
use crate::subject::{Subject, VisibleVoxel};
use crate::trace::Trace;
use adjsplat::error::{Error, Result};

/// Number of voxels of a brick along x, y and z: 256 in all.
const BRICK: [u16; 3] = [8, 8, 4];

/// Values and normals, sorted by brick, which are stored once for all lanes.
#[derive(Debug)]
pub(super) struct PayloadBricks {
    /// Number of bricks along x and y.
    pub(super) across: [usize; 2],
    /// For each brick, the index of its first voxel in `payload`.
    pub(super) bases: Vec<u32>,
    /// Values and normals of the voxels, brick by brick.
    pub(super) payload: Records,
}

/// Records of several channels, in one array per channel or interleaved in a single array.
#[derive(Debug, Clone)]
pub(super) struct Records {
    interleaved: bool,
    /// Bytes of a code in each channel.
    widths: Vec<usize>,
    /// The number by which a trace names the first array.
    first_array: usize,
    /// One array per channel; interleaved records are all in array 0, and the others are empty.
    pub(super) arrays: Vec<Vec<u8>>,
}

impl Records {
    pub(super) fn new(interleaved: bool, widths: &[usize], first_array: usize) -> Records {
        Records { interleaved, widths: widths.to_vec(), first_array, arrays: vec![Vec::new(); widths.len()] }
    }

    /// Appends a record, which has one code for each channel.
    pub(super) fn push(&mut self, codes: &[u16]) {
        for (channel, (&code, &width)) in codes.iter().zip(&self.widths).enumerate() {
            let array = if self.interleaved { 0 } else { channel };
            self.arrays[array].extend_from_slice(&code.to_le_bytes()[..width]);
        }
    }

    pub(super) fn len(&self) -> usize {
        let width = if self.interleaved { self.widths.iter().sum() } else { self.widths[0] };
        self.arrays[0].len() / width
    }

    /// Returns the index of the channel's array, the byte offset of the code of `record`, and the bytes from a code to
    /// the next.
    #[inline(always)]
    fn place(&self, channel: usize, record: usize) -> (usize, usize, usize) {
        if self.interleaved {
            let width: usize = self.widths.iter().sum();
            (0, record * width + self.widths[..channel].iter().sum::<usize>(), width)
        } else {
            (channel, record * self.widths[channel], self.widths[channel])
        }
    }

    /// Reads the code of `record` in `channel`, one or two bytes; 0 if the channel has none.
    #[inline(always)]
    pub(super) fn code<T: Trace>(&self, channel: usize, record: usize, trace: &mut T) -> u16 {
        let width = self.widths[channel];
        if width == 0 {
            return 0;
        }
        let (array, at, _) = self.place(channel, record);
        trace.read(self.first_array + array, at, width);
        let bytes = &self.arrays[array][at..at + width];
        u16::from(bytes[0]) | bytes.get(1).map_or(0, |&high| u16::from(high) << 8)
    }

    /// Reads up to sixteen one-byte codes of channel 0 from `record` on; ones fill what is missing at the end.
    #[inline(always)]
    pub(super) fn chunk<T: Trace>(&self, record: usize, trace: &mut T) -> [u8; CHUNK] {
        let (array, at, stride) = self.place(0, record);
        let codes = &self.arrays[array][at..];
        let mut chunk = [1; CHUNK];
        let count = (codes.len() / stride).min(CHUNK);
        trace.read(self.first_array + array, at, count * stride);
        if stride == 1 {
            chunk[..count].copy_from_slice(&codes[..count]);
        } else {
            chunk.iter_mut().zip(codes.iter().step_by(stride)).for_each(|(code, &byte)| *code = byte);
        }
        chunk
    }
}

/// Returns the number of the brick that holds a position; `across` is the number of bricks along x and y.
pub(super) fn brick_of([x, y, z]: [u16; 3], across: [usize; 2]) -> usize {
    let [x, y, z] = [x / BRICK[0], y / BRICK[1], z / BRICK[2]].map(usize::from);
    (z * across[1] + y) * across[0] + x
}

impl PayloadBricks {
    /// Sorts the values and normals into bricks. Also returns each voxel's slot (place in its brick), in the subject's
    /// order.
    pub(super) fn new(subject: &Subject, interleaved: bool, normal_bytes: usize) -> Result<(PayloadBricks, Vec<u8>)> {
        let [nx, ny, nz] = [0, 1, 2].map(|a| (subject.dims()[a] as usize).div_ceil(BRICK[a].into()));
        let across = [nx, ny];
        let mut counts = vec![0u16; nx * ny * nz];
        let mut slots = Vec::with_capacity(subject.voxels.len());
        for voxel in &subject.voxels {
            let count = &mut counts[brick_of(voxel.position, across)];
            slots.push(u8::try_from(*count).expect("a brick has 256 voxels"));
            *count += 1;
        }
        let mut sum = 0u32;
        let mut bases = Vec::with_capacity(counts.len());
        for count in counts {
            bases.push(sum);
            sum = sum.checked_add(count.into()).ok_or_else(|| too_many(subject))?;
        }
        let mut order: Vec<usize> = (0..subject.voxels.len()).collect();
        let place = |index: usize| {
            let brick = brick_of(subject.voxels[index].position, across);
            bases[brick] + u32::from(slots[index])
        };
        order.sort_unstable_by_key(|&index| place(index));
        let mut payload = Records::new(interleaved, &[1, normal_bytes], BRICK_VALUES);
        for index in order {
            let VisibleVoxel { value, normal, .. } = subject.voxels[index];
            payload.push(&[value.into(), normal]);
        }
        Ok((PayloadBricks { across, bases, payload }, slots))
    }
}

fn too_many(subject: &Subject) -> Error {
    Error::Limit {
        what: format!("visible voxels of {} for a study of layouts", subject.name),
        need: subject.voxels.len() as u64,
        have: u32::MAX.into(),
    }
}
