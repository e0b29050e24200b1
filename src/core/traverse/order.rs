//! The order of a walk: which axis is slow, medium and fast, and in which direction each runs.
//!
//! In: a viewpoint in voxel units (index space). Out: [`Order`].
//!
//! Nested loops over the three axes visit voxels in exact visibility order as soon as each axis runs from its far
//! to its near side (any nesting; proof: the first axis on which two voxels of a ray differ puts the farther one
//! first). The nesting matters for splats that overlap sideways: the axis most aligned with the view is slow
//! (Orchard and Möller 2001, section 3.3), measured in index space so that anisotropic spacing counts.
//!
//! With perspective an axis has two sides of the eye, and each must be visited toward it: one side after the
//! other (Swan 1997), or both in turn, the farther voxel first (Botha and Post 2005), which is also right for
//! splats that overlap across the eye's plane. An eye inside the volume needs nothing more.

use crate::error::{Error, Result};
use crate::volume::Axis;

/// Where the eye is, in index space: voxel (i, j, k) is at point (i, j, k).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Viewpoint {
    /// All rays run along `direction`, away from the eye; any length above 0.
    Parallel {
        /// Index-space direction of view.
        direction: [f64; 3],
    },
    /// All rays start at `eye`.
    Perspective {
        /// The eye's index-space position; it may lie inside the volume.
        eye: [f64; 3],
        /// Index-space direction of view through the picture's centre; decides only the nesting.
        toward: [f64; 3],
    },
}

impl Viewpoint {
    /// Returns a parallel view along `direction`, in index space.
    ///
    /// # Errors
    /// [`Error::Input`] if it is not finite or has length 0.
    pub fn parallel(direction: [f64; 3]) -> Result<Viewpoint> {
        if !direction.iter().all(|part| part.is_finite()) || direction == [0.0; 3] {
            return Err(Error::input("direction of view", format!("is {direction:?}, but must be finite and not 0")));
        }
        Ok(Viewpoint::Parallel { direction })
    }

    /// Returns a view from `eye` toward a direction, both in index space; the eye may lie inside the volume.
    ///
    /// # Errors
    /// [`Error::Input`] if a number is not finite or the direction has length 0.
    pub fn perspective(eye: [f64; 3], toward: [f64; 3]) -> Result<Viewpoint> {
        Viewpoint::parallel(toward)?;
        if !eye.iter().all(|part| part.is_finite()) {
            return Err(Error::input("eye", format!("is {eye:?}, but must be finite")));
        }
        Ok(Viewpoint::Perspective { eye, toward })
    }
}

/// Which end of the visibility order comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Sense {
    /// Far voxels first.
    BackToFront,
    /// Near voxels first: the exact reverse.
    FrontToBack,
}

/// How the two sides of the eye's plane follow each other on an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum SplitForm {
    /// The side of low coordinates, then the other.
    Split,
    /// Both in turn, by distance from the eye's plane; the low side first where they tie.
    #[default]
    Interleaved,
}

/// The order of the coordinates along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AxisOrder {
    /// 0, 1, 2 ...
    Ascending,
    /// The last one first.
    Descending,
    /// Both sides toward the eye's coordinate, or away from it.
    TwoSided {
        /// The eye's coordinate, inside the axis' range.
        eye: f64,
        /// How the sides follow each other.
        form: SplitForm,
        /// Toward the eye, or away from it.
        sense: Sense,
    },
}

impl AxisOrder {
    /// Calls `visit` with the indices of the ascending `coordinates` in this order.
    #[inline]
    pub fn for_each_index(self, coordinates: &[u16], mut visit: impl FnMut(usize)) {
        let count = coordinates.len();
        match self {
            AxisOrder::Ascending => (0..count).for_each(visit),
            AxisOrder::Descending => (0..count).rev().for_each(visit),
            AxisOrder::TwoSided { eye, form, sense } => {
                // Back to front: cursors `low` from the low end up, `high` from the high end down, until they meet.
                // Front to back is its reverse: they start where the others meet and part.
                let meet = coordinates.partition_point(|&c| f64::from(c) < eye);
                match (form, sense) {
                    (SplitForm::Split, Sense::BackToFront) => {
                        // A coordinate equal to the eye's is nearest to both sides: it comes last.
                        let on_plane = coordinates.get(meet).is_some_and(|&c| f64::from(c) == eye);
                        (0..meet).for_each(&mut visit);
                        (meet + usize::from(on_plane)..count).rev().for_each(&mut visit);
                        if on_plane {
                            visit(meet);
                        }
                    }
                    (SplitForm::Split, Sense::FrontToBack) => {
                        let on_plane = coordinates.get(meet).is_some_and(|&c| f64::from(c) == eye);
                        if on_plane {
                            visit(meet);
                        }
                        (meet + usize::from(on_plane)..count).for_each(&mut visit);
                        (0..meet).rev().for_each(&mut visit);
                    }
                    (SplitForm::Interleaved, Sense::BackToFront) => {
                        let (mut low, mut high) = (0, count);
                        while low < high {
                            let below = eye - f64::from(coordinates[low]);
                            let above = f64::from(coordinates[high - 1]) - eye;
                            if below >= above {
                                visit(low);
                                low += 1;
                            } else {
                                high -= 1;
                                visit(high);
                            }
                        }
                    }
                    (SplitForm::Interleaved, Sense::FrontToBack) => {
                        let (mut low, mut high) = (meet, meet);
                        while low > 0 || high < count {
                            let below = if low > 0 { eye - f64::from(coordinates[low - 1]) } else { f64::INFINITY };
                            let above = if high < count { f64::from(coordinates[high]) - eye } else { f64::INFINITY };
                            // On a tie the low side is the farther one of the reverse order: it comes second.
                            if below < above {
                                low -= 1;
                                visit(low);
                            } else {
                                visit(high);
                                high += 1;
                            }
                        }
                    }
                }
            }
        }
    }

    fn reversed(self) -> AxisOrder {
        match self {
            AxisOrder::Ascending => AxisOrder::Descending,
            AxisOrder::Descending => AxisOrder::Ascending,
            AxisOrder::TwoSided { eye, form, sense } => AxisOrder::TwoSided { eye, form, sense: sense.reversed() },
        }
    }
}

impl Sense {
    /// The other one.
    pub fn reversed(self) -> Sense {
        match self {
            Sense::BackToFront => Sense::FrontToBack,
            Sense::FrontToBack => Sense::BackToFront,
        }
    }
}

/// The nesting of a walk and the direction of each of its axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Order {
    /// Axis of the outermost loop.
    pub slow: Axis,
    /// Axis of the middle loop.
    pub medium: Axis,
    /// Axis of the innermost loop, along which the lane's lines run.
    pub fast: Axis,
    /// Direction of each axis, by the axis' index (not by nesting).
    pub along: [AxisOrder; 3],
}

impl Order {
    /// The order for a viewpoint over a grid of `dims` points.
    ///
    /// Ties between axes go to x before y before z, so that the choice is deterministic; a direction's component
    /// of 0 counts as above 0.
    ///
    /// # Errors
    /// [`Error::Input`] if a component is not finite or the direction of view is 0.
    pub fn new(viewpoint: Viewpoint, dims: [u32; 3], sense: Sense, form: SplitForm) -> Result<Order> {
        let (nesting, eye) = match viewpoint {
            Viewpoint::Parallel { direction } => (direction, None),
            Viewpoint::Perspective { eye, toward } => (toward, Some(eye)),
        };
        if !nesting.iter().chain(eye.iter().flatten()).all(|c| c.is_finite()) {
            return Err(Error::input("viewpoint", format!("is {viewpoint:?}, but must be finite")));
        }
        if nesting == [0.0; 3] {
            return Err(Error::input("direction of view", "has length 0"));
        }
        let mut axes = Axis::ALL;
        axes.sort_by(|a, b| nesting[b.index()].abs().total_cmp(&nesting[a.index()].abs()));
        let [slow, medium, fast] = axes;
        let along = Axis::ALL.map(|axis| {
            let a = axis.index();
            let last = f64::from(dims[a]) - 1.0;
            // Back to front: from the far side toward the eye.
            let back_to_front = match eye {
                None if nesting[a] >= 0.0 => AxisOrder::Descending,
                None => AxisOrder::Ascending,
                Some(eye) if eye[a] <= 0.0 => AxisOrder::Descending,
                Some(eye) if eye[a] >= last => AxisOrder::Ascending,
                Some(eye) => AxisOrder::TwoSided { eye: eye[a], form, sense: Sense::BackToFront },
            };
            match sense {
                Sense::BackToFront => back_to_front,
                Sense::FrontToBack => back_to_front.reversed(),
            }
        });
        Ok(Order { slow, medium, fast, along })
    }

    /// One of the 48 orders of parallel views: `nesting` 0..6 in lexical order of the axes, bit a of `descending`
    /// set where axis a runs down.
    ///
    /// # Panics
    /// If `nesting` is not below 6.
    pub fn parallel(nesting: usize, descending: u8) -> Order {
        const NESTINGS: [[Axis; 3]; 6] = [
            [Axis::X, Axis::Y, Axis::Z],
            [Axis::X, Axis::Z, Axis::Y],
            [Axis::Y, Axis::X, Axis::Z],
            [Axis::Y, Axis::Z, Axis::X],
            [Axis::Z, Axis::X, Axis::Y],
            [Axis::Z, Axis::Y, Axis::X],
        ];
        let [slow, medium, fast] = NESTINGS[nesting];
        let along = [0, 1, 2].map(|a| match descending >> a & 1 {
            0 => AxisOrder::Ascending,
            _ => AxisOrder::Descending,
        });
        Order { slow, medium, fast, along }
    }

    /// The same voxels, last first.
    pub fn reversed(self) -> Order {
        Order { along: self.along.map(AxisOrder::reversed), ..self }
    }
}
