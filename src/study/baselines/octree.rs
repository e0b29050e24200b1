//! Hierarchical splatting: an octree of mean looks, drawn as coarsely as an error allows.
//!
//! In: a subject, a threshold. Out: cubes of voxels, each one splat, where their error is below the threshold, and
//! voxels elsewhere, octant by octant in visibility order. With a threshold of 0 every voxel.
//!
//! ```text
//! branches   8 bytes: first child, which of eight there are; levels from the finest up, each in Morton order
//! looks     32 bytes: mean red, green, blue, optical depth; mean normal; error
//! voxels     3 bytes, in Morton order: value, normal; positions follow from the path
//! ```
//!
//! Means keep what light sees: optical depth is averaged over all cells of the cube, empty ones included, so that the
//! sum over a cube is kept; colour is averaged by optical depth, as colour counts by it. The error is the root mean
//! square over the cells of the distance from their mean, of red, green and blue times opacity, and opacity: 0 where
//! all cells are alike, below 1.
//!
//! The eye's side of the planes that part a cube says which octant is farthest; those are the planes half-way between
//! voxels. No ray meets two octants in the wrong order then, in parallel and from an eye, inside or not. Octants that
//! have no visible voxel are not stored.
//!
//! Source: Laur and Hanrahan, "Hierarchical Splatting: A Progressive Refinement Algorithm for Volume Rendering",
//! SIGGRAPH 1991.

use super::appearance::Appearance;
use super::room::{push, room};
use super::{Node, Normal, Receiver, Viewing, Walker};
use crate::Subject;
use crate::subject::VisibleVoxel;
use crate::trace::{Array, Trace};
use adjsplat::error::{Error, Result};
use adjsplat::traverse::{Sense, Viewpoint};

const BRANCHES: usize = 0;
const LOOKS: usize = 1;
const VALUES: usize = 2;
const NORMALS: usize = 3;

/// A cube's octants.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct Branch {
    /// The first of those that there are, in the finer level; above voxels, in the list of voxels.
    first: u32,
    /// Bit o: whether there is octant o, whose bit a is set in the upper half of axis a.
    octants: u8,
}

const _: () = assert!(size_of::<Branch>() == 8);

/// What a cube looks like as one splat.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct Look {
    /// As [`Node::look`].
    look: [f32; 4],
    normal: [f32; 3],
    error: f32,
}

const _: () = assert!(size_of::<Look>() == 32);

/// A pyramid of looks above voxels.
#[derive(Debug)]
pub struct Octree {
    branches: Vec<Branch>,
    looks: Vec<Look>,
    values: Vec<u8>,
    normals: Vec<u16>,
    /// The root's level: its edge is 2 to this; 0 where there are no voxels.
    levels: u8,
    threshold: f32,
}

impl Octree {
    /// The octree of `subject`. A cube is one splat where its error is below `threshold`, which is 0 (exact) or above.
    ///
    /// # Errors
    /// [`Error::Input`] if the threshold is negative or not finite, [`Error::Limit`] if there are 2^32 voxels or memory
    /// cannot be had; as [`Subject::looks`].
    pub fn new(subject: &Subject, threshold: f32) -> Result<Octree> {
        let count = subject.voxels.len() as u64;
        if count > u32::MAX.into() {
            return Err(Error::Limit { what: "voxels of an octree".into(), need: count, have: u32::MAX.into() });
        }
        let mut ordered = room("voxels in Morton order", count)?;
        ordered.extend(subject.voxels.iter().map(|&voxel| (morton(voxel.position), voxel)));
        ordered.sort_unstable_by_key(|&(code, _)| code);
        let mut octree = Octree {
            branches: Vec::new(),
            looks: Vec::new(),
            values: room("the octree's values", count)?,
            normals: room("the octree's normals", count)?,
            levels: 0,
            threshold: 0.0,
        };
        octree.set_threshold(threshold)?;
        octree.values.extend(ordered.iter().map(|(_, voxel)| voxel.value));
        octree.normals.extend(ordered.iter().map(|(_, voxel)| voxel.normal));
        if count > 0 {
            octree.build(&ordered, subject)?;
        }
        octree.branches.shrink_to_fit();
        octree.looks.shrink_to_fit();
        Ok(octree)
    }

    /// Sets the error below which a cube is one splat.
    ///
    /// # Errors
    /// [`Error::Input`] if it is negative or not finite.
    pub fn set_threshold(&mut self, threshold: f32) -> Result<()> {
        if !(threshold >= 0.0 && threshold.is_finite()) {
            let why = format!("is {threshold}, but must be 0 or above");
            return Err(Error::input("the octree's threshold", why));
        }
        self.threshold = threshold;
        Ok(())
    }

    /// Stacks levels until one cube holds all `voxels`, of which there are some.
    fn build(&mut self, voxels: &[(u64, VisibleVoxel)], subject: &Subject) -> Result<()> {
        let (looks, appearance) = (subject.looks()?, Appearance::of(subject)?);
        let mut finer = room("sums of an octree's level", voxels.len() as u64)?;
        finer.extend(
            voxels
                .iter()
                .map(|(code, voxel)| (*code, Sums::of(looks[usize::from(voxel.value)], appearance.gradient(voxel)))),
        );
        let mut first_finer = 0;
        loop {
            self.levels += 1;
            let first = self.branches.len();
            let mut level: Vec<(u64, Sums)> = Vec::new();
            for (index, (code, sums)) in (first_finer..).zip(&finer) {
                let octant = 1 << (code & 7);
                match level.last_mut().filter(|(parent, _)| *parent == code >> 3) {
                    Some((_, total)) => {
                        total.add(sums);
                        self.branches.last_mut().expect("one a parent").octants |= octant;
                    }
                    None => {
                        push("sums of an octree's level", &mut level, (code >> 3, *sums))?;
                        push("the octree's branches", &mut self.branches, Branch { first: index, octants: octant })?;
                    }
                }
            }
            for (_, sums) in &level {
                push("the octree's looks", &mut self.looks, sums.look(self.levels))?;
            }
            first_finer = u32::try_from(first).map_err(|_| Error::Limit {
                what: "branches of an octree".into(),
                need: first as u64,
                have: u32::MAX.into(),
            })?;
            finer = level;
            if finer[0].0 == 0 && finer.len() == 1 {
                return Ok(());
            }
        }
    }
}

/// Bits of x, y and z in turn, x lowest.
fn morton(position: [u16; 3]) -> u64 {
    let spread = |c: u16| {
        let mut bits = u64::from(c);
        bits = (bits | bits << 16) & 0x00ff_0000_ff00_00ff;
        bits = (bits | bits << 8) & 0xf00f_00f0_0f00_f00f;
        bits = (bits | bits << 4) & 0x30c3_0c30_c30c_30c3;
        (bits | bits << 2) & 0x9249_2492_4924_9249
    };
    spread(position[0]) | spread(position[1]) << 1 | spread(position[2]) << 2
}

/// Sums over the cells of a cube, in double precision.
#[derive(Debug, Clone, Copy)]
struct Sums {
    /// Colour times optical depth, and optical depth.
    weighted: [f64; 4],
    /// Normals times optical depth.
    normal: [f64; 3],
    /// Colour times opacity, and opacity; and their squares.
    seen: [f64; 4],
    squares: f64,
}

impl Sums {
    fn of([red, green, blue, depth]: [f32; 4], normal: [f32; 3]) -> Sums {
        let [red, green, blue, depth] = [red, green, blue, depth].map(f64::from);
        let opacity = 1.0 - (-depth).exp2();
        let seen = [red * opacity, green * opacity, blue * opacity, opacity];
        Sums {
            weighted: [red * depth, green * depth, blue * depth, depth],
            normal: normal.map(|c| f64::from(c) * depth),
            seen,
            squares: seen.iter().map(|c| c * c).sum(),
        }
    }

    fn add(&mut self, other: &Sums) {
        let add = |sum: &mut [f64], more: &[f64]| sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        add(&mut self.weighted, &other.weighted);
        add(&mut self.normal, &other.normal);
        add(&mut self.seen, &other.seen);
        self.squares += other.squares;
    }

    /// The look of a cube of edge 2 to `level`.
    fn look(&self, level: u8) -> Look {
        let cells = (3.0 * f64::from(level)).exp2();
        let [red, green, blue, depth] = self.weighted;
        let by_depth = if depth > 0.0 { 1.0 / depth } else { 0.0 };
        let length = self.normal.iter().map(|c| c * c).sum::<f64>().sqrt();
        let unit = if length > 0.0 { 1.0 / length } else { 0.0 };
        let variance = self.squares / cells - self.seen.iter().map(|sum| (sum / cells) * (sum / cells)).sum::<f64>();
        Look {
            look: [red * by_depth, green * by_depth, blue * by_depth, depth / cells].map(narrow),
            normal: self.normal.map(|c| narrow(c * unit)),
            error: narrow(variance.max(0.0).sqrt()),
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding is meant")]
fn narrow(number: f64) -> f32 {
    number as f32
}

/// A walk at work.
struct Walk<'a, R, T> {
    octree: &'a Octree,
    viewpoint: Viewpoint,
    sense: Sense,
    /// Octants relative to the first one to be visited, in the view's nesting.
    octants: [u8; 8],
    receiver: &'a mut R,
    trace: &'a mut T,
}

impl<R: Receiver, T: Trace> Walk<'_, R, T> {
    /// The octant that comes first in a cube at `low` whose half edge is `half`.
    #[inline(always)]
    fn first_octant(&self, low: [u32; 3], half: u32) -> u8 {
        let near = match self.viewpoint {
            Viewpoint::Parallel { direction } => octant(direction.map(|c| c < 0.0)),
            Viewpoint::Perspective { eye, .. } => octant([0, 1, 2].map(|a| eye[a] >= f64::from(low[a] + half) - 0.5)),
        };
        if self.sense == Sense::FrontToBack { near } else { !near & 7 }
    }

    /// Visits the cube of `branch`, whose lowest voxel is `low` and whose edge is 2 to `level`.
    fn cube(&mut self, branch: usize, low: [u32; 3], level: u8) {
        let octree = self.octree;
        if octree.threshold > 0.0 {
            self.trace.read(LOOKS, 32 * branch + 28, 4);
            let Look { look, normal, error } = octree.looks[branch];
            if error < octree.threshold {
                self.trace.read(LOOKS, 32 * branch, 28);
                self.receiver.node(&Node { low: narrow_place(low), level, look, normal });
                return;
            }
        }
        self.trace.read(BRANCHES, 8 * branch, 5);
        let Branch { first, octants } = octree.branches[branch];
        let half = 1u32 << (level - 1);
        let begin = self.first_octant(low, half);
        for relative in self.octants {
            let octant = begin ^ relative;
            if octants >> octant & 1 == 0 {
                continue;
            }
            let child = first as usize + RANKS[usize::from(octants) & ((1 << octant) - 1)] as usize;
            let at = [0, 1, 2].map(|a| low[a] + if octant >> a & 1 == 0 { 0 } else { half });
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

/// How many bits of a byte are set.
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

/// A cube that holds a voxel begins inside the grid.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "see above")]
fn narrow_place(place: [u32; 3]) -> [u16; 3] {
    place.map(|c| c as u16)
}

impl Walker for Octree {
    fn method(&self) -> &'static str {
        "octree"
    }

    fn arrays(&self) -> Vec<Array> {
        vec![
            Array::of("branches", &self.branches),
            Array::of("looks", &self.looks),
            Array::of("values", &self.values),
            Array::of("normals", &self.normals),
        ]
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        let Some(root) = self.branches.len().checked_sub(1) else { return };
        let order = &viewing.order;
        // Bit 0 of a place in the sequence is the fast axis'.
        let octants = [0, 1, 2, 3, 4, 5, 6, 7u8].map(|place| {
            (place & 1) << order.fast.index()
                | (place >> 1 & 1) << order.medium.index()
                | (place >> 2) << order.slow.index()
        });
        let (viewpoint, sense) = (viewing.viewpoint, viewing.sense());
        Walk { octree: self, viewpoint, sense, octants, receiver, trace }.cube(root, [0; 3], self.levels);
    }
}
