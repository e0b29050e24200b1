//! The oracle: orders by their definitions, and rays in integers.

use std::collections::HashMap;

use adjsplat::traverse::{AxisOrder, Order, Sense, SplitForm, Viewpoint};
use adjsplat::volume::Axis;
use adjsplat_study::baselines::Viewing;
use adjsplat_study::subject::VisibleVoxel;
use adjsplat_tests::walks::{eye_viewpoints, parallel_orders};

use crate::scene::VoxelVolume;

/// The coordinates of an axis of `points`, in order: sorted by what the order promises.
fn along(order: AxisOrder, points: u32) -> Vec<u16> {
    let mut coordinates: Vec<u16> = (0..u16::try_from(points).unwrap()).collect();
    match order {
        AxisOrder::Ascending => {}
        AxisOrder::Descending => coordinates.reverse(),
        AxisOrder::TwoSided { eye, form, sense } => {
            let distance = |c: u16| (f64::from(c) - eye).abs();
            // Back to front; the far ones first. 0: the low side, 1: the high side, 2: on the eye's plane.
            let side = |c: u16| if f64::from(c) < eye { 0 } else { 1 + u8::from(f64::from(c) == eye) };
            let by_distance = |a: u16, b: u16| distance(b).total_cmp(&distance(a));
            coordinates.sort_by(|&a, &b| match form {
                SplitForm::Split => side(a).cmp(&side(b)).then(by_distance(a, b)),
                SplitForm::Interleaved => by_distance(a, b).then(a.cmp(&b)),
            });
            if sense == Sense::FrontToBack {
                coordinates.reverse();
            }
        }
    }
    coordinates
}

/// The voxels of a volume by nested loops over `axes`, the outermost first.
pub(crate) fn nested(dense: &VoxelVolume, order: &Order, axes: [Axis; 3]) -> Vec<VisibleVoxel> {
    let [slow, medium, fast] = axes.map(Axis::index);
    let [slow_all, medium_all, fast_all] = [slow, medium, fast].map(|a| along(order.along[a], dense.dims[a]));
    let mut voxels = Vec::new();
    let mut position = [0; 3];
    for &s in &slow_all {
        for &m in &medium_all {
            for &f in &fast_all {
                (position[slow], position[medium], position[fast]) = (s, m, f);
                voxels.extend(dense.at(position));
            }
        }
    }
    voxels
}

/// In the order's own nesting.
pub(crate) fn slices(dense: &VoxelVolume, order: &Order) -> Vec<VisibleVoxel> {
    nested(dense, order, [order.slow, order.medium, order.fast])
}

/// All 48 orders of parallel views.
pub(crate) fn parallel_viewings() -> impl Iterator<Item = Viewing> {
    parallel_orders().map(Viewing::along)
}

/// Views along whole-numbered directions, in both senses.
pub(crate) fn directions(dims: [u32; 3]) -> Vec<Viewing> {
    let mut viewings = Vec::new();
    for direction in [[0, 0, 1], [1, -1, 0], [-1, 0, 0], [1, 1, 1], [-1, 2, 1], [2, -1, -2], [-1, -1, 1], [0, -2, 1]] {
        for sense in [Sense::BackToFront, Sense::FrontToBack] {
            let viewpoint = Viewpoint::Parallel { direction: direction.map(f64::from) };
            viewings.push(Viewing::new(viewpoint, dims, sense, SplitForm::Split).unwrap());
        }
    }
    viewings
}

/// The views from an eye: six nestings, both forms, both senses.
pub(crate) fn eye_viewings(eye: [f64; 3], dims: [u32; 3]) -> Vec<Viewing> {
    let viewing = |(viewpoint, form, sense)| Viewing::new(viewpoint, dims, sense, form).unwrap();
    eye_viewpoints(eye).map(viewing).collect()
}

/// Greatest common divisor; of 0 and n it is n.
fn gcd(a: i64, b: i64) -> i64 {
    if b == 0 { a.abs() } else { gcd(b, a % b) }
}

/// The ray of a voxel, and its distance along it; exact where directions are whole and eyes are halves.
fn ray(viewpoint: Viewpoint, position: [u16; 3]) -> ([i64; 3], i64) {
    let p = position.map(i64::from);
    let whole = |c: f64| {
        assert_eq!(c.fract(), 0.0, "an oracle in integers");
        c as i64
    };
    match viewpoint {
        Viewpoint::Parallel { direction } => {
            let v = direction.map(whole);
            let cross = [0, 1, 2].map(|a| {
                let (b, c) = ((a + 1) % 3, (a + 2) % 3);
                p[b] * v[c] - p[c] * v[b]
            });
            (cross, (0..3).map(|a| p[a] * v[a]).sum())
        }
        Viewpoint::Perspective { eye, .. } => {
            let offset = [0, 1, 2].map(|a| 2 * p[a] - whole(2.0 * eye[a]));
            let distance = gcd(gcd(offset[0], offset[1]), offset[2]);
            (offset.map(|c| c / distance.max(1)), distance)
        }
    }
}

/// How many voxels of `positions` come after one of their ray that they should precede.
pub(crate) fn disorder(viewing: &Viewing, sense: Sense, positions: impl Iterator<Item = [u16; 3]>) -> usize {
    let mut last: HashMap<[i64; 3], i64> = HashMap::new();
    let mut wrong = 0;
    for position in positions {
        let (ray, distance) = ray(viewing.viewpoint, position);
        let before = last.insert(ray, distance);
        wrong += usize::from(before.is_some_and(|before| match sense {
            Sense::BackToFront => distance >= before,
            Sense::FrontToBack => distance <= before,
        }));
    }
    wrong
}
