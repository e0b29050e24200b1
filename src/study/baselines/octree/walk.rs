//! The walk through an octree.

use super::{Branch, CubeLook, Octree};
use crate::baselines::{Normal, Receiver, Viewing, VoxelCube, Walker};
use crate::trace::{Trace, WalkerArray};
use adjsplat::traverse::{Sense, Viewpoint};

const BRANCHES: usize = 0;
const LOOKS: usize = 1;
const VALUES: usize = 2;
const NORMALS: usize = 3;

/// A walk: the octree, the view, the receiver and the trace.
struct OctreeWalk<'a, R, T> {
    octree: &'a Octree,
    viewpoint: Viewpoint,
    sense: Sense,
    /// Octants in the view's nesting: their numbers, to be XORed with that of the first octant to visit.
    octants: [u8; 8],
    receiver: &'a mut R,
    trace: &'a mut T,
}

impl<R: Receiver, T: Trace> OctreeWalk<'_, R, T> {
    /// Returns the number of the octant to visit first, in the cube whose lowest voxel is `low`; `half_edge` is in
    /// voxels.
    #[inline(always)]
    fn first_octant(&self, low: [u32; 3], half_edge: u32) -> u8 {
        let near = match self.viewpoint {
            Viewpoint::Parallel { direction } => octant(direction.map(|c| c < 0.0)),
            Viewpoint::Perspective { eye, .. } => {
                octant([0, 1, 2].map(|a| eye[a] >= f64::from(low[a] + half_edge) - 0.5))
            }
        };
        if self.sense == Sense::FrontToBack { near } else { !near & 7 }
    }

    /// Visits the cube of `branch`, whose lowest voxel is `low` and whose edge is 2^`level` voxels.
    fn cube(&mut self, branch: usize, low: [u32; 3], level: u8) {
        let octree = self.octree;
        if octree.threshold > 0.0 {
            self.trace.read(LOOKS, 32 * branch + 28, 4);
            let CubeLook { look, normal, error } = octree.looks[branch];
            if error < octree.threshold {
                self.trace.read(LOOKS, 32 * branch, 28);
                self.receiver.cube(&VoxelCube { low: narrow_place(low), level, look, normal });
                return;
            }
        }
        self.trace.read(BRANCHES, 8 * branch, 5);
        let Branch { first, octants } = octree.branches[branch];
        let half_edge = 1u32 << (level - 1);
        let begin = self.first_octant(low, half_edge);
        for relative in self.octants {
            let octant = begin ^ relative;
            if octants >> octant & 1 == 0 {
                continue;
            }
            let child = first as usize + RANKS[usize::from(octants) & ((1 << octant) - 1)] as usize;
            let at = [0, 1, 2].map(|a| low[a] + if octant >> a & 1 == 0 { 0 } else { half_edge });
            if level > 1 {
                self.cube(child, at, level - 1);
            } else {
                self.trace.read(VALUES, child, 1);
                self.trace.read(NORMALS, 2 * child, 2);
                self.receiver.voxel(narrow_place(at), octree.values[child], Normal::Code(octree.normals[child]));
            }
        }
    }
}

/// For each byte, the number of its set bits.
const RANKS: [u8; 256] = {
    let mut ranks = [0; 256];
    let mut byte = 1;
    while byte < 256 {
        ranks[byte] = ranks[byte / 2] + if byte % 2 == 1 { 1 } else { 0 };
        byte += 1;
    }
    ranks
};

fn octant(upper: [bool; 3]) -> u8 {
    u8::from(upper[0]) | u8::from(upper[1]) << 1 | u8::from(upper[2]) << 2
}

/// Converts a cube's lowest corner, which lies inside the grid, to 16-bit coordinates.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "see above")]
fn narrow_place(place: [u32; 3]) -> [u16; 3] {
    place.map(|c| c as u16)
}

impl Walker for Octree {
    fn arrays(&self) -> Vec<WalkerArray> {
        vec![
            WalkerArray::of("branches", &self.branches),
            WalkerArray::of("looks", &self.looks),
            WalkerArray::of("values", &self.values),
            WalkerArray::of("normals", &self.normals),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let Some(root) = self.branches.len().checked_sub(1) else { return };
        let order = &viewing.order;
        // Bit 0 of an octant's place in the sequence belongs to the fast axis.
        let octants = [0, 1, 2, 3, 4, 5, 6, 7u8].map(|place| {
            (place & 1) << order.fast.index()
                | (place >> 1 & 1) << order.medium.index()
                | (place >> 2) << order.slow.index()
        });
        let (viewpoint, sense) = (viewing.viewpoint, viewing.sense());
        OctreeWalk { octree: self, viewpoint, sense, octants, receiver, trace }.cube(root, [0; 3], self.levels);
    }
}
