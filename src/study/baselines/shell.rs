//! Shell splatting: rows of visible voxels behind an array of row pointers.
//!
//! For each row of the volume, a pointer says where the row's voxels begin in a list. A voxel has 6 bytes: coordinate
//! on the row 2, value 1, neighbour code (which neighbours are opaque) 1, normal 2.
//!
//! Rows run along x, and x stays the innermost loop in every view: as voxels are points, any nesting is a correct
//! order. So the nesting is the view's with x moved to the end. With [`Lists::Three`] rows run along the view's fast
//! axis, in exact slice order.
//!
//! Bit 2a of the neighbour code is set if the neighbour below on axis a is opaque, bit 2a + 1 for the one above. A
//! voxel can be skipped if its three neighbours toward the eye are opaque. That changes pictures, as a splat is wider
//! than a voxel, so only [`Shell::hide`] turns it on.
//!
//! Source: Udupa and Odhner, "Shell Rendering", CG&A 1993; Botha and Post, "ShellSplatting", VisSym 2003.

use super::allocate::{counted, filled, product, reserved};
use super::{Normal, Receiver, Viewing, Walker, for_each_line, narrow, placed};
use crate::Subject;
use crate::trace::{Trace, WalkerArray, along_axes};
use adjsplat::error::Result;
use adjsplat::traverse::{AxisOrder, Viewpoint};
use adjsplat::volume::Axis;

/// The axes along which rows are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lists {
    /// Only x, as in the cited papers.
    One,
    /// All three axes.
    Three,
}

/// A voxel of a row.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct ShellVoxel {
    /// The voxel's coordinate along the row.
    coordinate: u16,
    normal: u16,
    value: u8,
    opaque_neighbours: u8,
}

const _: () = assert!(size_of::<ShellVoxel>() == 6);

/// The rows along one axis.
#[derive(Debug)]
struct ShellRows {
    axis: Axis,
    /// Index of each row's first voxel, with the lower of the two other axes fastest; then the end of the last row.
    pointers: Vec<u32>,
    voxels: Vec<ShellVoxel>,
    /// For each axis, the distance in `pointers` between rows whose coordinates on it differ by 1.
    stride: [usize; 3],
}

/// Rows of voxels along x, or along each axis.
#[derive(Debug)]
pub struct Shell {
    dims: [u32; 3],
    lists: Vec<ShellRows>,
    hides: bool,
    skipped: u64,
}

impl Shell {
    /// Builds the rows of `subject`. A neighbour is opaque if its opacity is at least `opaque` (above 0, at most 1).
    ///
    /// # Errors
    /// [`Error::Limit`](adjsplat::Error::Limit) if there are 2^32 voxels or memory cannot be had; any error of [`Subject::looks`].
    pub fn new(subject: &Subject, lists: Lists, opaque: f32) -> Result<Shell> {
        let opaque_codes = subject.looks()?.map(|look| 1.0 - (-look[3]).exp2() >= opaque);
        let [width, height, depth] = subject.dims().map(u64::from);
        // There is one bit for each grid point. Neighbours outside the grid wrap to coordinates that are outside too.
        let bit = |[x, y, z]: [u16; 3]| {
            let [x, y, z] = [x, y, z].map(u64::from);
            let inside = x < width && y < height && z < depth;
            inside.then(|| (z * height + y) * width + x)
        };
        let word = |bit: u64| usize::try_from(bit / 64).expect("as many words were allocated");
        let words = product([width, height, depth]).div_ceil(64);
        let mut is_opaque = filled("a bit for each grid point", words, 0u64)?;
        for voxel in subject.voxels.iter().filter(|voxel| opaque_codes[usize::from(voxel.value)]) {
            let bit = bit(voxel.position).expect("voxels lie inside the grid");
            is_opaque[word(bit)] |= 1 << (bit % 64);
        }
        let opaque_neighbours = |position: [u16; 3]| {
            (0..6).fold(0u8, |code, side| {
                let mut near = position;
                let step = if side % 2 == 0 { u16::MAX } else { 1 };
                near[side / 2] = near[side / 2].wrapping_add(step);
                let opaque = bit(near).is_some_and(|bit| is_opaque[word(bit)] >> (bit % 64) & 1 != 0);
                code | u8::from(opaque) << side
            })
        };
        let axes = match lists {
            Lists::One => &Axis::ALL[..1],
            Lists::Three => &Axis::ALL[..],
        };
        let lists = axes.iter().map(|&axis| ShellRows::new(subject, axis, opaque_neighbours));
        Ok(Shell { dims: subject.dims(), lists: lists.collect::<Result<_>>()?, hides: false, skipped: 0 })
    }

    /// Sets whether voxels with three opaque neighbours toward the eye are skipped; off by default.
    pub fn hide(&mut self, hides: bool) {
        self.hides = hides;
    }

    /// Returns the number of voxels that the last walk skipped.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }
}

impl ShellRows {
    fn new(subject: &Subject, axis: Axis, opaque_neighbours: impl Fn([u16; 3]) -> u8) -> Result<ShellRows> {
        let count = subject.voxels.len() as u64;
        counted("voxels of shell splatting", count)?;
        let [u, v] = axis.others().map(Axis::index);
        let dims = subject.dims();
        let mut stride = [0; 3];
        stride[u] = 1;
        stride[v] = dims[u] as usize;
        let row = |position: [u16; 3]| (0..3).map(|a| usize::from(position[a]) * stride[a]).sum::<usize>();
        let row_count = u64::from(dims[u]) * u64::from(dims[v]);
        let mut pointers: Vec<u32> = filled("row pointers", row_count + 1, 0)?;
        for voxel in &subject.voxels {
            pointers[row(voxel.position) + 1] += 1;
        }
        let mut next = 0;
        for pointer in &mut pointers {
            next += *pointer;
            *pointer = next;
        }
        // In scan order, the voxels of each row are ascending, for every axis.
        let mut next: Vec<u32> = reserved("row pointers", row_count + 1)?;
        next.extend_from_slice(&pointers);
        let none = ShellVoxel { coordinate: 0, normal: 0, value: 0, opaque_neighbours: 0 };
        let mut voxels = filled("voxels of rows", count, none)?;
        for voxel in &subject.voxels {
            let slot = &mut next[row(voxel.position)];
            voxels[*slot as usize] = ShellVoxel {
                coordinate: voxel.position[axis.index()],
                normal: voxel.normal,
                value: voxel.value,
                opaque_neighbours: opaque_neighbours(voxel.position),
            };
            *slot += 1;
        }
        Ok(ShellRows { axis, pointers, voxels, stride })
    }
}

/// Returns which bits of the neighbour code, on one axis, belong to neighbours toward the eye.
fn toward_eye(viewpoint: Viewpoint, axis: usize, coordinate: u16) -> u8 {
    let sides = match viewpoint {
        Viewpoint::Parallel { direction } => direction[axis].partial_cmp(&0.0),
        Viewpoint::Perspective { eye, .. } => f64::from(coordinate).partial_cmp(&eye[axis]),
    };
    let bits = match sides {
        Some(std::cmp::Ordering::Greater) => 0b01,
        Some(std::cmp::Ordering::Less) => 0b10,
        // The view runs across this axis: both neighbours must be opaque.
        _ => 0b11,
    };
    bits << (2 * axis)
}

impl Walker for Shell {
    fn arrays(&self) -> Vec<WalkerArray> {
        const NAMES: [[&str; 2]; 3] = along_axes!("row pointers along", "voxels along");
        let arrays = |(rows, [pointers, voxels]): (&ShellRows, [&'static str; 2])| {
            [WalkerArray::of(pointers, &rows.pointers), WalkerArray::of(voxels, &rows.voxels)]
        };
        self.lists.iter().zip(NAMES).flat_map(arrays).collect()
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let order = &viewing.order;
        let list = if self.lists.len() == 1 { 0 } else { order.fast.index() };
        let rows = &self.lists[list];
        let [pointer_array, voxel_array] = [2 * list, 2 * list + 1];
        // This is the view's nesting with the rows' axis moved to the end.
        let [slow, medium] = {
            let mut others = [order.slow, order.medium, order.fast].into_iter().filter(|&axis| axis != rows.axis);
            [0; 2].map(|_: usize| others.next().expect("two of three axes").index())
        };
        let fast = rows.axis.index();
        let viewpoint = viewing.viewpoint;
        let mut skipped = 0;
        let mut line = Vec::new();
        for_each_line(order, [slow, medium], self.dims, |s, m| {
            let row = s * rows.stride[slow] + m * rows.stride[medium];
            trace.read(pointer_array, 4 * row, 8);
            let first = rows.pointers[row] as usize;
            let voxels = &rows.voxels[first..rows.pointers[row + 1] as usize];
            if voxels.is_empty() {
                return;
            }
            let (slow_at, medium_at) = (narrow(s), narrow(m));
            let position = placed(placed([0; 3], slow, slow_at), medium, medium_at);
            let across = if self.hides {
                toward_eye(viewpoint, slow, slow_at) | toward_eye(viewpoint, medium, medium_at)
            } else {
                0
            };
            let mut show = |index: usize, voxel: &ShellVoxel, trace: &mut T| {
                trace.read(voxel_array, 6 * (first + index), 6);
                let position = placed(position, fast, voxel.coordinate);
                if self.hides {
                    let hiding = across | toward_eye(viewpoint, fast, voxel.coordinate);
                    if voxel.opaque_neighbours & hiding == hiding {
                        skipped += 1;
                        return;
                    }
                }
                receiver.voxel(position, voxel.value, Normal::Code(voxel.normal));
            };
            match order.along[fast] {
                AxisOrder::Ascending => {
                    voxels.iter().enumerate().for_each(|(index, voxel)| show(index, voxel, trace));
                }
                AxisOrder::Descending => {
                    voxels.iter().enumerate().rev().for_each(|(index, voxel)| show(index, voxel, trace));
                }
                AxisOrder::TwoSided { .. } => {
                    line.clear();
                    for (index, voxel) in voxels.iter().enumerate() {
                        trace.read(voxel_array, 6 * (first + index), 2);
                        line.push(voxel.coordinate);
                    }
                    order.along[fast].for_each_index(&line, |index| show(index, &voxels[index], trace));
                }
            }
        });
        self.skipped = skipped;
    }
}
