//! Follows a chain (a scan line of doubly linked voxels) in the order of an axis.
//!
//! In: a chain between its two caps (the virtual voxels at its ends), and an [`AxisOrder`]. Out: its voxels in that
//! order, found by links alone. If the eye lies between the ends of the axis, the chain has two sides. A back-to-front
//! walk follows it from both ends. A front-to-back walk first follows the links to the voxels where the sides meet.

use adjsplat::traverse::{AxisOrder, Sense, SplitForm};

/// A scan line of linked voxels; the context `C` holds the structure that the links point into.
pub(super) trait Chain<C>: Copy {
    /// Identifies a voxel of the chain.
    type ChainVoxel: Copy;

    /// Returns the neighbour of `from`, the higher one if `up`; `None` if that is a cap (a virtual voxel at an end).
    fn step(self, context: &mut C, from: Self::ChainVoxel, up: bool) -> Option<Self::ChainVoxel>;

    /// Returns a voxel's coordinate on the chain's axis.
    fn coordinate(self, node: Self::ChainVoxel) -> u16;
}

/// Returns whether a walk in this order begins at a chain's high end.
pub(super) fn starts_high(order: AxisOrder) -> bool {
    order == AxisOrder::Descending
}

/// Returns whether a walk in this order needs both ends of a chain.
pub(super) fn needs_both_ends(order: AxisOrder) -> bool {
    matches!(order, AxisOrder::TwoSided { .. })
}

/// Calls `visit` with the voxels of `chain` in the given order.
///
/// `start` is the cap where the order begins, the low cap if the chain has two sides of the eye. `far` is the other
/// cap, used only if the chain has two sides.
#[inline(always)]
pub(super) fn follow<C, L: Chain<C>>(
    order: AxisOrder,
    chain: L,
    [start, far]: [L::ChainVoxel; 2],
    context: &mut C,
    mut visit: impl FnMut(&mut C, L::ChainVoxel),
) {
    match order {
        AxisOrder::Ascending => run(chain, chain.step(context, start, true), true, context, visit),
        AxisOrder::Descending => run(chain, chain.step(context, start, false), false, context, visit),
        AxisOrder::TwoSided { eye, form, sense: Sense::BackToFront } => {
            back_to_front(eye, form, chain, [start, far], context, &mut visit);
        }
        AxisOrder::TwoSided { eye, form, sense: Sense::FrontToBack } => {
            front_to_back(eye, form, chain, start, context, &mut visit);
        }
    }
}

/// Visits `first` and all voxels that follow it in one direction.
#[inline(always)]
fn run<C, L: Chain<C>>(
    chain: L,
    first: Option<L::ChainVoxel>,
    up: bool,
    context: &mut C,
    mut visit: impl FnMut(&mut C, L::ChainVoxel),
) {
    let mut at = first;
    while let Some(node) = at {
        visit(context, node);
        at = chain.step(context, node, up);
    }
}

/// Visits voxels from both ends of the chain toward the eye.
fn back_to_front<C, L: Chain<C>>(
    eye: f64,
    form: SplitForm,
    chain: L,
    [low_cap, high_cap]: [L::ChainVoxel; 2],
    context: &mut C,
    visit: &mut impl FnMut(&mut C, L::ChainVoxel),
) {
    let place = |node| f64::from(chain.coordinate(node));
    let mut low = chain.step(context, low_cap, true);
    let mut high = chain.step(context, high_cap, false);
    match form {
        SplitForm::Split => {
            while let Some(node) = low.filter(|&node| place(node) < eye) {
                visit(context, node);
                low = chain.step(context, node, true);
            }
            while let Some(node) = high.filter(|&node| place(node) > eye) {
                visit(context, node);
                high = chain.step(context, node, false);
            }
            // A voxel on the eye's plane belongs to both sides and is nearest: it comes last.
            if let Some(node) = low.filter(|&node| place(node) == eye) {
                visit(context, node);
            }
        }
        SplitForm::Interleaved => {
            // Before the two ends meet, neither `low` nor `high` is a cap.
            while let (Some(below), Some(above)) = (low, high) {
                let is_last = chain.coordinate(below) == chain.coordinate(above);
                if eye - place(below) >= place(above) - eye {
                    visit(context, below);
                    low = if is_last { None } else { chain.step(context, below, true) };
                } else {
                    visit(context, above);
                    high = if is_last { None } else { chain.step(context, above, false) };
                }
            }
        }
    }
}

/// Visits voxels from where the sides meet toward both ends: the exact reverse of [`back_to_front`].
fn front_to_back<C, L: Chain<C>>(
    eye: f64,
    form: SplitForm,
    chain: L,
    low_cap: L::ChainVoxel,
    context: &mut C,
    visit: &mut impl FnMut(&mut C, L::ChainVoxel),
) {
    let place = |node| f64::from(chain.coordinate(node));
    let mut low = None;
    let mut high = chain.step(context, low_cap, true);
    while let Some(node) = high.filter(|&node| place(node) < eye) {
        low = Some(node);
        high = chain.step(context, node, true);
    }
    match form {
        SplitForm::Split => {
            run(chain, high, true, context, &mut *visit);
            run(chain, low, false, context, visit);
        }
        SplitForm::Interleaved => loop {
            // On a tie of distances the low side counts as farther in the reverse order: it comes second.
            let low_is_next = match (low, high) {
                (Some(below), Some(above)) => eye - place(below) < place(above) - eye,
                (Some(_), None) => true,
                (None, Some(_)) => false,
                (None, None) => break,
            };
            if low_is_next {
                low = low.and_then(|node| {
                    visit(context, node);
                    chain.step(context, node, false)
                });
            } else {
                high = high.and_then(|node| {
                    visit(context, node);
                    chain.step(context, node, true)
                });
            }
        },
    }
}
