//! The walk that visits one brick after the other.

use super::nesting::AxisNesting;
use super::walk::BrickWalk;
use super::{EDGE, NONE, TABLE};
use crate::baselines::{Receiver, coordinates, narrow};
use crate::trace::Trace;
use adjsplat::traverse::{AxisOrder, Order};

/// The coordinates of an axis, grouped by brick.
struct AxisBricks {
    /// Indices of the bricks along the axis, in visit order.
    sequence: Vec<u16>,
    /// For each brick of the axis, the coordinates in it.
    places: Vec<BrickCoordinates>,
}

/// The coordinates that a brick covers along an axis, in visit order.
struct BrickCoordinates {
    sequence: Vec<u16>,
    /// `Some(true)` if the coordinates ascend, `Some(false)` if they descend, `None` if they do neither.
    up: Option<bool>,
}

impl BrickCoordinates {
    fn new(sequence: Vec<u16>) -> BrickCoordinates {
        let descends = sequence.is_sorted_by(|a, b| a > b);
        let up = if sequence.is_sorted() { Some(true) } else { descends.then_some(false) };
        BrickCoordinates { sequence, up }
    }
}

impl AxisBricks {
    fn new(order: AxisOrder, points: u32) -> AxisBricks {
        let all: Vec<u16> = coordinates(points);
        let in_order = |order: AxisOrder, coordinates: &[u16], base: u16| {
            let mut sequence = Vec::with_capacity(coordinates.len());
            order.for_each_index(coordinates, |index| sequence.push(coordinates[index] - base));
            sequence
        };
        let places =
            all.chunks(EDGE).map(|brick| BrickCoordinates::new(in_order(order, brick, brick[0]))).collect::<Vec<_>>();
        // Borders of bricks lie half-way between voxels. The brick that holds the eye is the nearest one from both
        // sides.
        let of_bricks = match order {
            AxisOrder::TwoSided { eye, form, sense } => {
                AxisOrder::TwoSided { eye: ((eye + 0.5) / EDGE as f64).floor(), form, sense }
            }
            one_way => one_way,
        };
        let sequence = in_order(of_bricks, &all[..places.len()], 0);
        AxisBricks { sequence, places }
    }
}

/// Visits the volume's bricks one after the other, and all voxels of each.
pub(super) fn by_bricks<R: Receiver, T: Trace>(walk: &mut BrickWalk<R, T>, order: &Order) {
    let (bricks, nesting) = (walk.bricks, walk.nesting);
    let AxisNesting { slow, medium, fast } = nesting;
    let stride = [1, bricks.counts[0], bricks.counts[0] * bricks.counts[1]];
    let axis = |axis: usize| AxisBricks::new(order.along[axis], bricks.dims[axis]);
    let (slow_bricks, medium_bricks, fast_bricks) = (axis(slow), axis(medium), axis(fast));
    for &s in &slow_bricks.sequence {
        let slow_places = &slow_bricks.places[usize::from(s)].sequence;
        for &m in &medium_bricks.sequence {
            let medium_places = &medium_bricks.places[usize::from(m)].sequence;
            for &f in &fast_bricks.sequence {
                let cell =
                    usize::from(s) * stride[slow] + usize::from(m) * stride[medium] + usize::from(f) * stride[fast];
                walk.trace.read(TABLE, 4 * cell, 4);
                if bricks.table[cell] == NONE {
                    continue;
                }
                let brick = bricks.table[cell] as usize;
                let fast_places = &fast_bricks.places[usize::from(f)];
                let base = narrow(EDGE * usize::from(f));
                for &slow_place in slow_places {
                    let plane = nesting.plane(&bricks.masks[brick], usize::from(slow_place), brick, walk.trace);
                    if plane == 0 {
                        continue;
                    }
                    walk.position[slow] = narrow(EDGE * usize::from(s)) + slow_place;
                    for &medium_place in medium_places {
                        let voxels = plane.to_le_bytes()[usize::from(medium_place)];
                        if voxels == 0 {
                            continue;
                        }
                        walk.position[medium] = narrow(EDGE * usize::from(m)) + medium_place;
                        let row = walk.row_payload(brick, usize::from(slow_place), usize::from(medium_place));
                        if let Some(up) = fast_places.up {
                            walk.row(&row, voxels, base, up);
                        } else {
                            for &place in fast_places.sequence.iter().filter(|&&place| voxels >> place & 1 != 0) {
                                let before = (voxels & ((1 << place) - 1)).count_ones() as usize;
                                let payload = walk.payload(&row, before, usize::from(place));
                                walk.show(base + place, payload);
                            }
                        }
                    }
                }
            }
        }
    }
}
