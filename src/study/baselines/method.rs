//! Methods: all ways of walking that studies compare, by name.
//!
//! In: a name and a subject. Out: a structure that can be walked, whichever it is.

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
use crate::ours::Adjsplat;
use crate::trace::{Array, Trace};
use adjsplat::error::{Error, Result};

/// Seed of the records' order in [`Method::AdjacencyBShuffled`].
const SEED: u64 = 2001;
/// From what opacity on the code of a voxel's neighbours says that they are opaque.
const OPAQUE: f32 = 0.95;

/// A way of walking.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Method {
    /// Our own: [`Adjsplat`].
    Adjsplat,
    /// [`Traditional`].
    Traditional,
    /// [`Unordered`].
    Unordered,
    /// [`Octree`] with a threshold of 0.
    Octree,
    /// [`AdjacencyA`].
    AdjacencyA,
    /// [`AdjacencyB`], records in the order in which they were made.
    AdjacencyB,
    /// [`AdjacencyB`], records in random order.
    AdjacencyBShuffled,
    /// [`Shell`] with rows along x.
    Shell,
    /// [`Shell`] with rows along each axis.
    ShellThree,
    /// [`Sorted`].
    Sorted,
    /// [`Bricks`] in exact slice order.
    Bricks,
    /// [`Bricks`], brick by brick.
    BricksBrickwise,
    /// [`RunLength`].
    RunLength,
}

impl Method {
    /// All of them, ours first.
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

    /// Its name in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Method::Adjsplat => "adjsplat",
            Method::Traditional => "traditional",
            Method::Unordered => "unordered",
            Method::Octree => "octree",
            Method::AdjacencyA => "adjacency_a",
            Method::AdjacencyB => "adjacency_b",
            Method::AdjacencyBShuffled => "adjacency_b_shuffled",
            Method::Shell => "shell",
            Method::ShellThree => "shell_three",
            Method::Sorted => "sorted",
            Method::Bricks => "bricks",
            Method::BricksBrickwise => "bricks_brickwise",
            Method::RunLength => "run_length",
        }
    }

    /// The method of this name.
    ///
    /// # Errors
    /// [`Error::Input`] with all names if there is none.
    pub fn named(name: &str) -> Result<Method> {
        let method = Method::ALL.into_iter().find(|method| method.name() == name);
        method.ok_or_else(|| Error::input("method", format!("is {name}, but must be one of {}", names().join(", "))))
    }

    /// Whether voxels come in exact slice order: nested loops in the order's nesting and directions.
    pub fn is_in_slice_order(self) -> bool {
        match self {
            Method::Adjsplat
            | Method::Traditional
            | Method::AdjacencyA
            | Method::AdjacencyB
            | Method::AdjacencyBShuffled
            | Method::ShellThree
            | Method::Bricks
            | Method::RunLength => true,
            Method::Unordered | Method::Octree | Method::Shell | Method::Sorted | Method::BricksBrickwise => false,
        }
    }

    /// Its structure for `subject`. [`Method::Adjsplat`] has all three lanes derived, if the arena lacks some.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`] or the structure cannot be as large; as [`Subject::looks`].
    pub fn build<'a>(self, subject: &'a Subject<'a>) -> Result<Built<'a>> {
        Ok(match self {
            Method::Adjsplat => Built::Adjsplat(Adjsplat::new(subject)?),
            Method::Traditional => Built::Traditional(Traditional::new(subject)?),
            Method::Unordered => Built::Unordered(Unordered::new(subject)?),
            Method::Octree => Built::Octree(Octree::new(subject, 0.0)?),
            Method::AdjacencyA => Built::AdjacencyA(AdjacencyA::new(subject)?),
            Method::AdjacencyB => Built::AdjacencyB(AdjacencyB::new(subject, Storage::Built)?),
            Method::AdjacencyBShuffled => Built::AdjacencyB(AdjacencyB::new(subject, Storage::Shuffled(SEED))?),
            Method::Shell => Built::Shell(Shell::new(subject, Lists::One, OPAQUE)?),
            Method::ShellThree => Built::Shell(Shell::new(subject, Lists::Three, OPAQUE)?),
            Method::Sorted => Built::Sorted(Sorted::new(subject)?),
            Method::Bricks => Built::Bricks(Bricks::new(subject, BrickOrder::Slices)?),
            Method::BricksBrickwise => Built::Bricks(Bricks::new(subject, BrickOrder::Bricks)?),
            Method::RunLength => Built::RunLength(RunLength::new(subject)?),
        })
    }
}

/// The names of all methods.
pub fn names() -> [&'static str; Method::ALL.len()] {
    Method::ALL.map(Method::name)
}

/// A structure of any method.
#[derive(Debug)]
#[expect(missing_docs, reason = "each variant is the structure that it is named for")]
pub enum Built<'a> {
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
}

/// Calls the same of whichever structure it is.
macro_rules! whichever {
    ($built:expr, $walker:ident => $call:expr) => {
        match $built {
            Built::Adjsplat($walker) => $call,
            Built::Traditional($walker) => $call,
            Built::Unordered($walker) => $call,
            Built::Octree($walker) => $call,
            Built::AdjacencyA($walker) => $call,
            Built::AdjacencyB($walker) => $call,
            Built::Shell($walker) => $call,
            Built::Sorted($walker) => $call,
            Built::Bricks($walker) => $call,
            Built::RunLength($walker) => $call,
        }
    };
}

impl Walker for Built<'_> {
    fn method(&self) -> &'static str {
        whichever!(self, walker => walker.method())
    }

    fn arrays(&self) -> Vec<Array> {
        whichever!(self, walker => walker.arrays())
    }

    fn walk<R: Receiver, T: Trace>(&mut self, viewing: &Viewing, receiver: &mut R, trace: &mut T) {
        whichever!(self, walker => walker.walk(viewing, receiver, trace));
    }
}
