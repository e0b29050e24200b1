//! Baselines: other ways to store and walk a volume's visible voxels, each built in full from a
//! [`Subject`](super::Subject).
//!
//! In: a subject and a [`Viewing`]. Out: every visible voxel, delivered to a [`Receiver`] in the method's order. All
//! methods deliver the same codes, so one splatter draws them all.
//!
//! | method | source | order of its voxels |
//! | --- | --- | --- |
//! | traditional | Westover 1990, as Orchard and Möller 2001 measure it | exact slice order |
//! | unordered | Crawfis 1996, as Orchard and Möller 2001 measure it | storage |
//! | octree | Laur and Hanrahan 1991 | octants, back to front |
//! | adjacency A, adjacency B | Orchard and Möller 2001 | exact slice order |
//! | shell | Udupa and Odhner 1993, Botha and Post 2003 | exact, x innermost; with three lists exact slice order |
//! | sorted | renderers of splats today | by distance |
//! | bricks | Museth 2013: leaves of bit masks | exact slice order, or brick by brick |
//! | runs | Lacroute and Levoy 1994: run lengths along each axis | exact slice order |

mod adjacency_a;
mod adjacency_b;
mod allocate;
mod appearance;
mod bricks;
mod follow;
mod method;
mod octree;
mod run_length;
mod shell;
mod sorted;
mod traditional;
mod unordered;

pub use adjacency_a::AdjacencyA;
pub use adjacency_b::{AdjacencyB, Storage};
pub use method::{Method, Structure, names};
pub use octree::Octree;
pub use shell::{Lists, Shell};

use super::trace::{Trace, Untraced, WalkerArray};
use adjsplat::arena::Lane;
use adjsplat::error::Result;
use adjsplat::traverse::{AxisOrder, Batch, Order, Sense, SplitForm, Viewpoint};

/// Returns the indices (0 for x, 1 for y, 2 for z) of an order's slow, medium and fast axis.
pub(super) fn nesting(order: &Order) -> [usize; 3] {
    [order.slow, order.medium, order.fast].map(|axis| axis.index())
}

/// Returns `position` with its coordinate on `axis` replaced. It selects each coordinate: writing to an array in memory
/// and reading it back would stall every voxel.
#[inline(always)]
pub(super) fn placed(position: [u16; 3], axis: usize, coordinate: u16) -> [u16; 3] {
    let [x, y, z] = position;
    [
        if axis == 0 { coordinate } else { x },
        if axis == 1 { coordinate } else { y },
        if axis == 2 { coordinate } else { z },
    ]
}

/// Returns all coordinates of an axis with this number of points, ascending.
fn coordinates(points: u32) -> Vec<u16> {
    (0..=u16::MAX).take(points as usize).collect()
}

/// Calls `visit` with each pair of coordinates on the axes `slow` and `medium` of a grid, in the sequence of `order`.
#[inline(always)]
fn for_each_line(order: &Order, [slow, medium]: [usize; 2], dims: [u32; 3], mut visit: impl FnMut(usize, usize)) {
    let [slow_all, medium_all] = [slow, medium].map(|axis| coordinates(dims[axis]));
    order.along[slow].for_each_index(&slow_all, |s| {
        order.along[medium].for_each_index(&medium_all, |m| visit(s, m));
    });
}

/// Converts a coordinate of the grid, which fits 16 bits.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "grids have at most 65,535 points an axis")]
fn narrow(coordinate: usize) -> u16 {
    coordinate as u16
}

/// A view, in the two forms that walks need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewing {
    /// Nesting (which axis is which loop) and directions, for methods that nest loops.
    pub order: Order,
    /// The same view, for methods that measure distances.
    pub viewpoint: Viewpoint,
}

impl Viewing {
    /// Returns a parallel view whose order is `order`; its axes must all run one way.
    pub fn along(order: Order) -> Viewing {
        let mut direction = [0.0; 3];
        for (axis, share) in [(order.slow, 3.0), (order.medium, 2.0), (order.fast, 1.0)] {
            // In front-to-back order an axis runs in the direction of the view.
            let sign = if matches!(order.along[axis.index()], AxisOrder::Ascending) { 1.0 } else { -1.0 };
            direction[axis.index()] = sign * share;
        }
        Viewing { order, viewpoint: Viewpoint::Parallel { direction } }
    }

    /// Returns the view from `viewpoint` of a grid of `dims` points.
    ///
    /// # Errors
    /// Any error of [`Order::new`].
    pub fn new(viewpoint: Viewpoint, dims: [u32; 3], sense: Sense, form: SplitForm) -> Result<Viewing> {
        Ok(Viewing { order: Order::new(viewpoint, dims, sense, form)?, viewpoint })
    }

    /// Returns whether the order is front to back or back to front; the direction of its slow axis decides.
    pub fn sense(&self) -> Sense {
        let axis = self.order.slow.index();
        // In front-to-back order an axis runs away from the eye: up if the eye is below its range.
        let runs_up = match self.order.along[axis] {
            AxisOrder::Ascending => true,
            AxisOrder::Descending => false,
            AxisOrder::TwoSided { sense, .. } => return sense,
        };
        let eye_is_below = match self.viewpoint {
            Viewpoint::Parallel { direction } => direction[axis] >= 0.0,
            Viewpoint::Perspective { eye, .. } => eye[axis] <= 0.0,
        };
        if runs_up == eye_is_below { Sense::FrontToBack } else { Sense::BackToFront }
    }
}

/// A voxel's normal, as a method stores it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Normal {
    /// The code (stored number) that [`adjsplat::classify::normal::decode8`] decodes.
    Code(u16),
    /// The decoded unit vector; zero for a voxel without a normal.
    Vector([f32; 3]),
}

/// A cube of voxels that is drawn as one splat.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelCube {
    /// Coordinates x, y, z of the cube's lowest voxel.
    pub low: [u16; 3],
    /// Base-2 logarithm of the cube's edge in voxels; above 0.
    pub level: u8,
    /// Red, green and blue, averaged with optical depths as weights, and the mean optical depth over all cells of the
    /// cube, empty ones included; in the units of [`Subject::looks`](super::Subject::looks).
    pub look: [f32; 4],
    /// Mean normal of unit length; zero if voxels have no normals.
    pub normal: [f32; 3],
}

/// Receives the voxels of a walk, in visit order.
pub trait Receiver {
    /// Receives a voxel: its coordinates x, y, z, its value code (stored number) and its normal.
    fn voxel(&mut self, position: [u16; 3], value: u8, normal: Normal);
    /// Receives a cube of voxels; only an octree with an error threshold above 0 delivers cubes.
    fn cube(&mut self, cube: &VoxelCube);

    /// Receives the voxels of a batch, which our own walk through `lane` delivers in `order`.
    #[inline(always)]
    fn batch(&mut self, lane: &Lane, order: &Order, batch: &Batch) {
        let [slow, medium, fast] = nesting(order);
        // A subject's lanes have no edits: all records lie in the channels.
        let (values, normals) = (lane.values, lane.normals.as_chunks().0);
        let slice = placed([0; 3], slow, batch.slow);
        let first = batch.record_index(0) - batch.record[0] as usize;
        for ((&m, &f), &record) in batch.medium.iter().zip(batch.fast).zip(batch.record) {
            let position = placed(placed(slice, medium, m), fast, f);
            let record = first + record as usize;
            let normal = normals.get(record).map_or(0, |&code| u16::from_le_bytes(code));
            self.voxel(position, values[record], Normal::Code(normal));
        }
    }
}

/// A structure whose visible voxels can be visited in the order of a view.
pub trait Walker {
    /// Returns the structure's allocations; a trace numbers them in this order.
    fn arrays(&self) -> Vec<WalkerArray>;

    /// Delivers every visible voxel to `receiver`, in the order that this method has for `viewing`.
    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T);

    /// Delivers every visible voxel to a new receiver, and returns it.
    fn received<R: Receiver + Default>(&mut self, viewing: &Viewing) -> R {
        let mut receiver = R::default();
        self.walk(viewing, &mut receiver, &mut Untraced);
        receiver
    }

    /// Returns the bytes that the structure takes between frames.
    fn bytes(&self) -> u64 {
        self.arrays().iter().filter(|array| !array.scratch).map(|array| array.bytes).sum()
    }
}
