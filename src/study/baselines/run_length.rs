//! Run lengths: each line's empty and visible runs, and the visible voxels' payload; walked in exact slice order.
//!
//! Lines are stored along each of the three axes, as the shear-warp algorithm stores them for its viewing axes.
//!
//! ```text
//! lines    8 bytes for each line of the volume: where its pairs and its payload begin
//! pairs    2 bytes: the length of an empty run and of a visible run, 0 to 255 each; they fill the line
//! payload  3 bytes per visible voxel, in the order of lines: value 1, normal 2
//! ```
//!
//! As pairs fill the line, they can be read from its end too. The original stores where each slice begins, not each
//! line, as it visits the lines of a slice always in the same order.
//!
//! Source: Lacroute and Levoy, "Fast Volume Rendering Using a Shear-Warp Factorization of the Viewing
//! Transformation", SIGGRAPH 1994.

use super::allocate::{counted, filled, push, reserved};
use super::{Normal, Receiver, Viewing, Walker, for_each_line, narrow, nesting, placed};
use crate::Subject;
use crate::subject::VisibleVoxel;
use crate::trace::{Trace, WalkerArray, along_axes};
use adjsplat::error::Result;
use adjsplat::traverse::AxisOrder;
use adjsplat::volume::Axis;

/// Number of arrays per axis: lines, pairs, values, normals.
const ARRAYS: usize = 4;

/// Where a line's pairs and payload begin.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C)]
struct LineStart {
    pair: u32,
    payload: u32,
}

/// The lines along one axis.
#[derive(Debug)]
struct RunLines {
    /// The start of each line, sorted with the lower of the two other axes fastest; then the end of the last line.
    starts: Vec<LineStart>,
    /// Lengths of an empty run and of the visible run after it.
    pairs: Vec<[u8; 2]>,
    values: Vec<u8>,
    normals: Vec<u16>,
    /// For each axis, the distance in `starts` between lines whose coordinates on it differ by 1.
    stride: [usize; 3],
}

/// Run lengths along each axis.
#[derive(Debug)]
pub struct RunLength {
    dims: [u32; 3],
    lines: [RunLines; 3],
}

impl RunLength {
    /// Builds the runs of `subject`.
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if there are 2^32 voxels or runs along an axis, or memory cannot be had.
    pub fn new(subject: &Subject) -> Result<RunLength> {
        let [x, y, z] = Axis::ALL.map(|axis| RunLines::new(subject, axis));
        Ok(RunLength { dims: subject.dims(), lines: [x?, y?, z?] })
    }
}

impl RunLines {
    fn new(subject: &Subject, axis: Axis) -> Result<RunLines> {
        let [u, v] = axis.others().map(Axis::index);
        let fast = axis.index();
        let dims = subject.dims();
        let mut stride = [0; 3];
        (stride[u], stride[v]) = (1, dims[u] as usize);
        let line = |voxel: &VisibleVoxel| usize::from(voxel.position[u]) + usize::from(voxel.position[v]) * stride[v];
        let count = subject.voxels.len() as u64;
        let mut ordered: Vec<VisibleVoxel> = reserved("voxels in the order of lines", count)?;
        ordered.extend_from_slice(&subject.voxels);
        // Stable: within a line, scan order is ascending for every axis.
        ordered.sort_by_key(line);
        let line_count = u64::from(dims[u]) * u64::from(dims[v]);
        let mut lines = RunLines {
            starts: filled("lines of runs", line_count + 1, LineStart::default())?,
            pairs: Vec::new(),
            values: reserved("the runs' values", count)?,
            normals: reserved("the runs' normals", count)?,
            stride,
        };
        lines.values.extend(ordered.iter().map(|voxel| voxel.value));
        lines.normals.extend(ordered.iter().map(|voxel| voxel.normal));
        let mut at = 0;
        for index in 0..lines.starts.len() {
            let [pair, payload] =
                [lines.pairs.len(), at].map(|count| counted("voxels or runs along an axis", count as u64));
            lines.starts[index] = LineStart { pair: pair?, payload: payload? };
            let voxels = ordered[at..].iter().take_while(|voxel| line(voxel) == index);
            let from = at;
            let mut next = 0;
            for voxel in voxels {
                let coordinate = u32::from(voxel.position[fast]);
                if at == from || coordinate != next {
                    lines.empty(coordinate - next)?;
                }
                lines.visible()?;
                next = coordinate + 1;
                at += 1;
            }
            if at > from {
                lines.empty(dims[fast] - next)?;
            }
        }
        lines.pairs.shrink_to_fit();
        Ok(lines)
    }

    /// Appends `count` empty voxels to the line; visible voxels may follow in its last pair.
    fn empty(&mut self, mut count: u32) -> Result<()> {
        loop {
            let part = u8::try_from(count).unwrap_or(u8::MAX);
            push("pairs of runs", &mut self.pairs, [part, 0])?;
            count -= u32::from(part);
            if count == 0 {
                return Ok(());
            }
        }
    }

    /// Appends a visible voxel to the last pair.
    fn visible(&mut self) -> Result<()> {
        match self.pairs.last_mut().filter(|pair| pair[1] < u8::MAX) {
            Some(pair) => pair[1] += 1,
            None => push("pairs of runs", &mut self.pairs, [0, 1])?,
        }
        Ok(())
    }
}

impl Walker for RunLength {
    fn arrays(&self) -> Vec<WalkerArray> {
        const NAMES: [[&str; ARRAYS]; 3] = along_axes!("lines along", "pairs along", "values along", "normals along");
        let arrays = |(lines, names): (&RunLines, [&'static str; ARRAYS])| {
            [
                WalkerArray::of(names[0], &lines.starts),
                WalkerArray::of(names[1], &lines.pairs),
                WalkerArray::of(names[2], &lines.values),
                WalkerArray::of(names[3], &lines.normals),
            ]
        };
        self.lines.iter().zip(NAMES).flat_map(arrays).collect()
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let [slow, medium, fast] = nesting(order);
        let lines = &self.lines[fast];
        let array = ARRAYS * fast;
        let last = usize::try_from(self.dims[fast]).expect("an axis has at most 65,535 points");
        let mut row: Vec<u16> = Vec::new();
        for_each_line(order, [slow, medium], self.dims, |s, m| {
            let line = s * lines.stride[slow] + m * lines.stride[medium];
            trace.read(array, 8 * line, 16);
            let [start, end] = [lines.starts[line], lines.starts[line + 1]];
            if start.payload == end.payload {
                return;
            }
            let position = placed(placed([0; 3], slow, narrow(s)), medium, narrow(m));
            let mut show = |coordinate: u16, payload: usize, trace: &mut T| {
                trace.read(array + 2, payload, 1);
                trace.read(array + 3, 2 * payload, 2);
                let position = placed(position, fast, coordinate);
                receiver.voxel(position, lines.values[payload], Normal::Code(lines.normals[payload]));
            };
            let first_pair = start.pair as usize;
            let pairs = lines.pairs[first_pair..end.pair as usize].iter().enumerate();
            let mut payload = start.payload as usize;
            match order.along[fast] {
                AxisOrder::Ascending => {
                    let mut at = 0;
                    for (index, &[empty, visible]) in pairs {
                        trace.read(array + 1, 2 * (first_pair + index), 2);
                        at += usize::from(empty);
                        for _ in 0..visible {
                            show(narrow(at), payload, trace);
                            at += 1;
                            payload += 1;
                        }
                    }
                }
                AxisOrder::Descending => {
                    let mut at = last;
                    payload = end.payload as usize;
                    for (index, &[empty, visible]) in pairs.rev() {
                        trace.read(array + 1, 2 * (first_pair + index), 2);
                        for _ in 0..visible {
                            at -= 1;
                            payload -= 1;
                            show(narrow(at), payload, trace);
                        }
                        at -= usize::from(empty);
                    }
                }
                AxisOrder::TwoSided { .. } => {
                    row.clear();
                    let mut at = 0;
                    for (index, &[empty, visible]) in pairs {
                        trace.read(array + 1, 2 * (first_pair + index), 2);
                        at += usize::from(empty);
                        row.extend((at..at + usize::from(visible)).map(narrow));
                        at += usize::from(visible);
                    }
                    order.along[fast].for_each_index(&row, |index| show(row[index], payload + index, trace));
                }
            }
        });
    }
}
