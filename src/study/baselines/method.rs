//! Methods: all structures that studies compare, by name; and any structure, behind one type.

use super::adjacency_a::AdjacencyA;
use super::adjacency_b::{AdjacencyB, Storage};
use super::bricks::{BrickOrder, Bricks};
use super::octree::Octree;
use super::run_length::RunLength;
use super::shell::{Lists, Shell};
use super::sorted::Sorted;
use super::traditional::Traditional;
use super::unordered::Unordered;
use super::{Receiver, Viewing, Walker};
use crate::Subject;
use crate::lane_walk::OwnWalk;
use crate::layouts::LayoutWalk;
use crate::ours::Adjsplat;
use crate::receive::VoxelSum;
use crate::trace::{Trace, WalkerArray};
use adjsplat::error::{Error, Result};

/// Seed of the random order of records in [`Method::AdjacencyBShuffled`].
const SEED: u64 = 2001;
/// Opacity of a voxel, from 0 to 1, from which on its neighbours count it as opaque.
const OPAQUE: f32 = 0.95;

/// A structure that stores and walks visible voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Method {
    /// Our own lanes (all scan lines along one axis).
    Adjsplat,
    /// A dense volume; every grid point is visited.
    Traditional,
    /// A list of the visible voxels, drawn in storage order.
    Unordered,
    /// An [`Octree`] with an error threshold of 0, which draws every voxel.
    Octree,
    /// Linked records beside a dense volume: [`AdjacencyA`].
    AdjacencyA,
    /// Linked records: [`AdjacencyB`], in the order in which they were built.
    AdjacencyB,
    /// [`AdjacencyB`] with its records in random order.
    AdjacencyBShuffled,
    /// A [`Shell`] with rows along x.
    Shell,
    /// A [`Shell`] with rows along each axis.
    ShellThree,
    /// A list of the visible voxels, sorted by distance for each frame.
    Sorted,
    /// Bricks of bit masks, walked slice by slice.
    Bricks,
    /// Bricks of bit masks, walked brick by brick.
    BricksBrickwise,
    /// Lengths of empty and visible runs, along each axis.
    RunLength,
}

impl Method {
    /// All methods, ours first.
    pub const ALL: [Method; 13] = [
        Method::Adjsplat,
        Method::Traditional,
        Method::Unordered,
        Method::Octree,
        Method::AdjacencyA,
        Method::AdjacencyB,
        Method::AdjacencyBShuffled,
        Method::Shell,
        Method::ShellThree,
        Method::Sorted,
        Method::Bricks,
        Method::BricksBrickwise,
        Method::RunLength,
    ];

    /// Returns the method's name in tables and files.
    pub fn name(self) -> &'static str {
        names()[self as usize]
    }

    /// Returns the method of this name.
    ///
    /// # Errors
    /// [`Error::Input`], which lists all names, if there is none.
    pub fn named(name: &str) -> Result<Method> {
        let method = Method::ALL.into_iter().find(|method| method.name() == name);
        method.ok_or_else(|| Error::input("method", format!("is {name}, but must be one of {}", names().join(", "))))
    }

    /// Returns whether voxels come in exact slice order: that of nested loops over the axes of the view's order.
    pub fn is_in_slice_order(self) -> bool {
        use Method::{BricksBrickwise, Octree, Shell, Sorted, Unordered};
        !matches!(self, Unordered | Octree | Shell | Sorted | BricksBrickwise)
    }

    /// Builds the structure for `subject`; our own method derives the lanes that the file does not store.
    ///
    /// # Errors
    /// [`Error::Limit`] if memory cannot be had or the structure would be too large; any error of [`Subject::looks`].
    pub fn build<'a>(self, subject: &'a Subject<'a>) -> Result<Structure<'a>> {
        Ok(match self {
            Method::Adjsplat => Structure::Adjsplat(Adjsplat::new(subject)?),
            Method::Traditional => Structure::Traditional(Traditional::new(subject)?),
            Method::Unordered => Structure::Unordered(Unordered::new(subject)?),
            Method::Octree => Structure::Octree(Octree::new(subject, 0.0)?),
            Method::AdjacencyA => Structure::AdjacencyA(AdjacencyA::new(subject)?),
            Method::AdjacencyB => Structure::AdjacencyB(AdjacencyB::new(subject, Storage::AsBuilt)?),
            Method::AdjacencyBShuffled => Structure::AdjacencyB(AdjacencyB::new(subject, Storage::Shuffled(SEED))?),
            Method::Shell => Structure::Shell(Shell::new(subject, Lists::One, OPAQUE)?),
            Method::ShellThree => Structure::Shell(Shell::new(subject, Lists::Three, OPAQUE)?),
            Method::Sorted => Structure::Sorted(Sorted::new(subject)?),
            Method::Bricks => Structure::Bricks(Bricks::new(subject, BrickOrder::Slices)?),
            Method::BricksBrickwise => Structure::Bricks(Bricks::new(subject, BrickOrder::Bricks)?),
            Method::RunLength => Structure::RunLength(RunLength::new(subject)?),
        })
    }
}

/// Returns the names of all methods, in the order of the variants.
pub fn names() -> [&'static str; Method::ALL.len()] {
    [
        "adjsplat",
        "traditional",
        "unordered",
        "octree",
        "adjacency_a",
        "adjacency_b",
        "adjacency_b_shuffled",
        "shell",
        "shell_three",
        "sorted",
        "bricks",
        "bricks_brickwise",
        "run_length",
    ]
}

/// A structure that can be walked: a method built it, or it is made of lanes whose accesses are studied.
#[derive(Debug)]
#[expect(missing_docs, reason = "each variant is the structure that it is named for")]
#[expect(clippy::large_enum_variant, reason = "a study holds a few of them")]
pub enum Structure<'a> {
    Adjsplat(Adjsplat<'a>),
    Traditional(Traditional),
    Unordered(Unordered),
    Octree(Octree),
    AdjacencyA(AdjacencyA),
    AdjacencyB(AdjacencyB),
    Shell(Shell),
    Sorted(Sorted),
    Bricks(Bricks),
    RunLength(RunLength),
    /// Our own lanes, of which each access can be traced.
    OwnWalk(OwnWalk<'a>),
    /// Lanes in another memory layout.
    Layout(LayoutWalk),
}

/// These functions are not generic: they are compiled once, here.
impl Structure<'_> {
    /// Walks the structure and adds up all that voxels have.
    pub fn summed(&mut self, viewing: &Viewing) -> VoxelSum {
        self.received(viewing)
    }

    /// Walks the structure, adds up all that voxels have, and gives each memory access to `trace`.
    pub fn traced(&mut self, viewing: &Viewing, mut trace: &mut dyn Trace) -> VoxelSum {
        let mut sum = VoxelSum::default();
        self.walk(viewing, &mut sum, &mut trace);
        sum
    }
}

/// Calls the same method of whichever structure the enum holds.
macro_rules! whichever {
    ($built:expr, $walker:ident => $call:expr) => {
        match $built {
            Structure::Adjsplat($walker) => $call,
            Structure::Traditional($walker) => $call,
            Structure::Unordered($walker) => $call,
            Structure::Octree($walker) => $call,
            Structure::AdjacencyA($walker) => $call,
            Structure::AdjacencyB($walker) => $call,
            Structure::Shell($walker) => $call,
            Structure::Sorted($walker) => $call,
            Structure::Bricks($walker) => $call,
            Structure::RunLength($walker) => $call,
            Structure::OwnWalk($walker) => $call,
            Structure::Layout($walker) => $call,
        }
    };
}

impl Walker for Structure<'_> {
    fn arrays(&self) -> Vec<WalkerArray> {
        whichever!(self, walker => walker.arrays())
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        whichever!(self, walker => walker.walk(viewing, receiver, trace));
    }
}
