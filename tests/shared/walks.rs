//! Orders of walks, and what walks visit.

use adjsplat::arena::Lane;
use adjsplat::traverse::{Batch, Order, Sense, SplitForm, Viewpoint, walk};

/// Returns all 48 orders of parallel views.
pub fn parallel_orders() -> impl Iterator<Item = Order> {
    (0..6).flat_map(|nesting| (0..8).map(move |descending| Order::parallel(nesting, descending)))
}

/// Returns six directions of view, one for each nesting of the axes.
pub fn directions() -> [[f64; 3]; 6] {
    [[3.0, 2.0, 1.0], [3.0, 1.0, -2.0], [2.0, 3.0, 1.0], [1.0, 3.0, 2.0], [-2.0, 1.0, 3.0], [1.0, 2.0, -3.0]]
}

/// Returns the viewpoints of an eye: six nestings, two forms, two senses.
pub fn eye_viewpoints(eye: [f64; 3]) -> impl Iterator<Item = (Viewpoint, SplitForm, Sense)> {
    directions().into_iter().flat_map(move |toward| {
        let viewpoint = Viewpoint::Perspective { eye, toward };
        [SplitForm::Split, SplitForm::Interleaved].into_iter().flat_map(move |form| {
            [Sense::BackToFront, Sense::FrontToBack].into_iter().map(move |sense| (viewpoint, form, sense))
        })
    })
}

/// Returns the orders of an eye with their senses: six nestings, two forms, two senses.
pub fn eye_orders(eye: [f64; 3], dims: [u32; 3]) -> impl Iterator<Item = (Sense, Order)> {
    eye_viewpoints(eye).map(move |(viewpoint, form, sense)| {
        (sense, Order::new(viewpoint, dims, sense, form).expect("a sound viewpoint"))
    })
}

/// Calls `see` with the place and the record of each voxel of a batch.
pub fn each_voxel(order: &Order, batch: &Batch, mut see: impl FnMut([u32; 3], usize)) {
    assert!(!batch.is_empty() && batch.medium.len() == batch.len() && batch.record.len() == batch.len());
    for index in 0..batch.len() {
        let mut at = [0; 3];
        at[order.slow.index()] = batch.slow.into();
        at[order.medium.index()] = batch.medium[index].into();
        at[order.fast.index()] = batch.fast[index].into();
        see(at, batch.record_index(index));
    }
}

/// Returns what `look` makes of every voxel that a walk visits, by its place and its record.
pub fn visited<T>(lane: &Lane, order: &Order, mut look: impl FnMut([u32; 3], usize) -> T) -> Vec<T> {
    let mut seen = Vec::new();
    walk(lane, order, &mut |batch: &Batch| each_voxel(order, batch, |at, record| seen.push(look(at, record))));
    seen
}
