//! Hierarchical splatting: an octree of mean looks (colour and optical depth), drawn as coarsely as an error allows.
//!
//! In: a subject and a threshold. Out: octant by octant in visibility order, cubes of voxels as one splat where their
//! error is below the threshold, and voxels elsewhere. With a threshold of 0 only voxels are drawn.
//!
//! ```text
//! branches   8 bytes: first child, and which of eight exist; levels from the finest up, each in Morton order
//! looks     32 bytes: mean red, green, blue, optical depth; mean normal; error
//! voxels     3 bytes, in Morton order: value, normal; positions follow from the path through the branches
//! ```
//!
//! Optical depth is averaged over all cells of a cube, empty ones included, so that its sum is kept. Colour is averaged
//! by optical depth. The error is the root mean square distance of the cells from their mean, in opacity and in red,
//! green and blue times opacity: 0 if all cells are equal, below 1.
//!
//! The planes that split a cube lie half-way between voxels. The eye's side of them decides which octant is farthest,
//! so no ray meets two octants in the wrong order, even from inside. Empty octants are not stored.
//!
//! Source: Laur and Hanrahan, "Hierarchical Splatting: A Progressive Refinement Algorithm for Volume Rendering",
//! SIGGRAPH 1991.

mod sums;
mod walk;

use self::sums::CubeSums;
use super::allocate::{counted, push, reserved};
use super::appearance::Appearance;
use crate::Subject;
use crate::subject::VisibleVoxel;
use adjsplat::error::{Error, Result};

/// The children of a cube, one for each octant that has voxels.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct Branch {
    /// Index of the first existing child in the next finer level; at the finest level, in the list of voxels.
    first: u32,
    /// Bit o is set if octant o exists; bit a of the number o is set in the upper half of axis a.
    octants: u8,
}

const _: () = assert!(size_of::<Branch>() == 8);

/// The mean look (colour and optical depth), normal and error of a cube that is drawn as one splat.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct CubeLook {
    /// Mean colour and optical depth, as in [`VoxelCube::look`](super::VoxelCube::look).
    look: [f32; 4],
    normal: [f32; 3],
    error: f32,
}

const _: () = assert!(size_of::<CubeLook>() == 32);

/// An octree whose inner nodes are cubes and whose leaves are voxels.
#[derive(Debug)]
pub struct Octree {
    branches: Vec<Branch>,
    looks: Vec<CubeLook>,
    values: Vec<u8>,
    normals: Vec<u16>,
    /// The root's level: its edge is 2^level voxels; 0 if there are no voxels.
    levels: u8,
    threshold: f32,
}

impl Octree {
    /// Builds the octree of `subject`. A cube is drawn as one splat if its error is below `threshold`; with 0 all
    /// voxels are drawn.
    ///
    /// # Errors
    /// [`Error::Input`] if the threshold is negative or not finite, [`Error::Limit`] if there are 2^32 voxels or memory
    /// cannot be had; any error of [`Subject::looks`].
    pub fn new(subject: &Subject, threshold: f32) -> Result<Octree> {
        let count = subject.voxels.len() as u64;
        counted("voxels of an octree", count)?;
        let mut ordered = reserved("voxels in Morton order", count)?;
        ordered.extend(subject.voxels.iter().map(|&voxel| (morton(voxel.position), voxel)));
        ordered.sort_unstable_by_key(|&(code, _)| code);
        let mut octree = Octree {
            branches: Vec::new(),
            looks: Vec::new(),
            values: reserved("the octree's values", count)?,
            normals: reserved("the octree's normals", count)?,
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

    /// Sets the error below which a cube is drawn as one splat.
    ///
    /// # Errors
    /// [`Error::Input`] if the threshold is negative or not finite.
    pub fn set_threshold(&mut self, threshold: f32) -> Result<()> {
        if !(threshold >= 0.0 && threshold.is_finite()) {
            let why = format!("is {threshold}, but must be 0 or above");
            return Err(Error::input("the octree's threshold", why));
        }
        self.threshold = threshold;
        Ok(())
    }

    /// Adds levels, from the finest up, until one cube holds all `voxels`, of which there is at least one.
    fn build(&mut self, voxels: &[(u64, VisibleVoxel)], subject: &Subject) -> Result<()> {
        let (looks, appearance) = (subject.looks()?, Appearance::of(subject)?);
        let mut finer = reserved("sums of an octree's level", voxels.len() as u64)?;
        finer.extend(
            voxels.iter().map(|(code, voxel)| {
                (*code, CubeSums::of(looks[usize::from(voxel.value)], appearance.gradient(voxel)))
            }),
        );
        let mut first_finer = 0;
        loop {
            self.levels += 1;
            let first = self.branches.len();
            let mut level: Vec<(u64, CubeSums)> = Vec::new();
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
            first_finer = counted("branches of an octree", first as u64)?;
            finer = level;
            if finer[0].0 == 0 && finer.len() == 1 {
                return Ok(());
            }
        }
    }
}

/// Interleaves the bits of x, y and z; the lowest bit is that of x.
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
