//! Long lines, culling, transposition, damaged lanes, and viewpoints at the edge of sense.

use adjsplat::arena::layout::line_end_bytes;
use adjsplat::arena::{Channels, OwnedLane, TileOrder};
use adjsplat::internals::transpose;
use adjsplat::traverse::{AxisOrder, Batch, Order, Sense, SplitForm, Viewpoint, VoxelBox, walk};
use adjsplat::volume::Axis;
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::{PLAIN, WIDE};
use adjsplat_tests::walks::{each_voxel, eye_orders, parallel_orders};
use proptest::prelude::*;
use zerocopy::byteorder::little_endian::{U16, U32, U64};

use crate::traversal::{CodeVolume, Crop, visits};

/// The longest axis there is.
const LONGEST: u32 = 65_535;

fn long(axis: Axis, code: impl Fn(u32) -> u8) -> CodeVolume {
    let mut dims = [1; 3];
    dims[axis.index()] = LONGEST;
    CodeVolume::new(dims, |at| code(at[axis.index()]))
}

fn assert_all_orders(volume: &CodeVolume, axis: Axis, coordinates: &[u32]) {
    let lanes = volume.lanes();
    for order in parallel_orders() {
        let seen = visits(&lanes[order.fast.index()].view(), &order).into_iter().map(|(at, _)| at[axis.index()]);
        match order.along[axis.index()] {
            AxisOrder::Ascending => assert!(seen.eq(coordinates.iter().copied()), "{order:?}"),
            _ => assert!(seen.eq(coordinates.iter().rev().copied()), "{order:?}"),
        }
    }
    let mut eye = [0.0; 3];
    eye[axis.index()] = 30_000.5;
    for (sense, order) in eye_orders(eye, volume.dims) {
        let mut seen: Vec<u32> =
            visits(&lanes[order.fast.index()].view(), &order).iter().map(|(at, _)| at[axis.index()]).collect();
        if sense == Sense::FrontToBack {
            seen.reverse();
        }
        // Both sides run toward the eye.
        assert!(seen.iter().filter(|&&c| c <= 30_000).is_sorted(), "{order:?}");
        assert!(seen.iter().rev().filter(|&&c| c > 30_000).is_sorted(), "{order:?}");
        seen.sort_unstable();
        assert_eq!(seen, coordinates);
    }
}

#[test]
fn the_longest_line_full() {
    for axis in Axis::ALL {
        assert_all_orders(&long(axis, |c| 1 + (c % 255) as u8), axis, &(0..LONGEST).collect::<Vec<_>>());
    }
}

#[test]
fn the_longest_line_with_a_voxel_at_each_end() {
    for axis in Axis::ALL {
        for ends in [vec![0, LONGEST - 1], vec![0], vec![LONGEST - 1]] {
            let volume = long(axis, |c| u8::from(ends.contains(&c)));
            assert_all_orders(&volume, axis, &ends);
            let last = ends[ends.len() - 1];
            let first_gaps = ends[0] / 255;
            let rest = if ends.len() == 2 { (last - ends[0] - 1) / 255 } else { 0 };
            assert_eq!(volume.lanes()[axis.index()].view().stepping_voxels(), u64::from(first_gaps + rest));
        }
    }
}

#[test]
fn an_eye_near_an_end_of_a_long_line() {
    for length in [16_383, 16_384, 16_385, 40_000, LONGEST] {
        let volume = CodeVolume::new([length, 1, 1], |[x, ..]| u8::from(x % 7 < 3));
        let ascending: Vec<u16> = (0..length).filter(|x| x % 7 < 3).map(|x| x as u16).collect();
        let lane = volume.pack(Axis::X, PLAIN, TileOrder::Morton);
        for eye in [0.3, 40.0, 700.5, f64::from(length) / 2.0, f64::from(length) - 700.0, f64::from(length) - 1.5] {
            for (_, order) in eye_orders([eye, 0.0, 0.0], volume.dims).filter(|(_, order)| order.fast == Axis::X) {
                let mut expected = Vec::new();
                order.along[0].for_each_index(&ascending, |index| expected.push(u32::from(ascending[index])));
                let seen: Vec<u32> = visits(&lane.view(), &order).iter().map(|(at, _)| at[0]).collect();
                assert!(seen == expected, "{length} points: {order:?}");
            }
        }
    }
}

#[test]
fn lines_longer_than_a_batch_and_batches_of_many_lines() {
    for dims in [[5_000, 5, 2], [3, 5_000, 2], [2, 3, 5_000], [200, 90, 3], [3, 200, 90], [90, 3, 200]] {
        let volume = CodeVolume::new(dims, |[x, y, z]| 1 + ((x * 7 + y * 5 + z * 3) % 255) as u8);
        let lanes = volume.lanes();
        for order in parallel_orders() {
            let seen = visits(&lanes[order.fast.index()].view(), &order);
            assert_eq!(seen.len(), volume.codes.len());
            let key = |at: [u32; 3]| {
                [order.slow, order.medium, order.fast].map(|axis| match order.along[axis.index()] {
                    AxisOrder::Descending => LONGEST - at[axis.index()],
                    _ => at[axis.index()],
                })
            };
            assert!(seen.is_sorted_by(|a, b| key(a.0) < key(b.0)), "{dims:?} {order:?}");
            assert!(seen.iter().all(|&(at, code)| code == u16::from(volume.at(at))), "{dims:?} {order:?}");
        }
    }
}

/// A volume of `dims` with about one in `one_in` samples visible.
fn random_volume(dims: [u32; 3], one_in: u64, seed: u64) -> CodeVolume {
    let mut random = Random(seed);
    CodeVolume::new(dims, |_| if random.below(one_in) == 0 { 1 + random.below(255) as u8 } else { 0 })
}

fn a_volume() -> impl Strategy<Value = CodeVolume> {
    ([1u32..=40, 1..=40, 1..=40], prop_oneof![Just(1u64), Just(4), Just(60)], any::<u64>())
        .prop_map(|(dims, one_in, seed)| random_volume(dims, one_in, seed))
}

/// A visitor that keeps the boxes it is asked about and holds the walk to them.
struct Boxes {
    order: Order,
    tiles: Vec<VoxelBox>,
    rows: Vec<VoxelBox>,
}

impl adjsplat::traverse::Visitor for Boxes {
    fn wants_tile(&mut self, bounds: &VoxelBox) -> bool {
        self.tiles.push(*bounds);
        true
    }

    fn wants_row(&mut self, bounds: &VoxelBox) -> bool {
        self.rows.push(*bounds);
        true
    }

    fn visit(&mut self, batch: &Batch) {
        let order = self.order;
        let slow = order.slow.index();
        self.rows.retain(|row| row.low[slow] == batch.slow);
        each_voxel(&order, batch, |at, _| {
            let holds = |b: &VoxelBox| (0..3).all(|a| u32::from(b.low[a]) <= at[a] && at[a] <= b.high[a].into());
            assert!(self.tiles.iter().any(holds) && self.rows.iter().any(holds), "{at:?} is in no box: {order:?}");
        });
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_refused_box_changes_nothing_else(volume in a_volume(), seed in any::<u64>()) {
        let lanes = volume.lanes();
        let mut random = Random(seed);
        let ends = volume.dims.map(|d| [(); 2].map(|()| random.below(d.into()) as u32));
        let (low, high) = (ends.map(|[a, b]| a.min(b)), ends.map(|[a, b]| a.max(b)));
        let eye = volume.dims.map(|d| f64::from(d) * 0.4);
        for order in parallel_orders().chain(eye_orders(eye, volume.dims).map(|(_, order)| order)) {
            let lane = lanes[order.fast.index()].view();
            let mut crop = Crop { lane, order, low, high, seen: Vec::new() };
            walk(&lane, &order, &mut crop);
            let mut expected = visits(&lane, &order);
            expected.retain(|&(at, _)| crop.holds(at));
            prop_assert!(expected == crop.seen, "{:?} {order:?}", volume.dims);
            walk(&lane, &order, &mut Boxes { order, tiles: Vec::new(), rows: Vec::new() });
        }
    }

    #[test]
    fn a_derived_lane_is_the_packed_one_byte_for_byte(volume in a_volume(), curve in 0u8..3) {
        let tile_order = TileOrder::from_code(curve).expect("there are three");
        for channels in [PLAIN, WIDE, Channels { value_bits: 16, normal_bits: 8, magnitude_bits: 0, coverage_bits: 0, coherence: false }] {
            let x_lane = volume.pack(Axis::X, channels, tile_order);
            for axis in [Axis::Y, Axis::Z] {
                let derived = transpose(&x_lane.view(), axis, tile_order);
                prop_assert!(derived == volume.pack(axis, channels, tile_order), "{:?} {axis:?}", volume.dims);
            }
        }
    }

    #[test]
    fn a_damaged_lane_is_walked_to_an_end(volume in a_volume(), seed in any::<u64>()) {
        let mut random = Random(seed);
        for mut lane in volume.lanes() {
            for _ in 0..12 {
                damage(&mut lane, &mut random);
                let eye = volume.dims.map(|d| f64::from(d) * 0.4);
                for order in parallel_orders().chain(eye_orders(eye, volume.dims).map(|(_, order)| order)) {
                    if order.fast == lane.axis {
                        let mut visited = 0;
                        walk(&lane.view(), &order, &mut |batch: &Batch| {
                            visited += batch.len();
                            for index in 0..batch.len() {
                                assert!(batch.record_index(index) < lane.steps.len(), "a record outside the lane");
                            }
                        });
                        prop_assert!(visited <= lane.steps.len());
                    }
                }
            }
            if lane.axis == Axis::X {
                transpose(&lane.view(), Axis::Y, TileOrder::Rows);
                transpose(&lane.view(), Axis::Z, TileOrder::Morton);
            }
        }
    }
}

/// Changes one thing of the lane to something random or extreme.
fn damage(lane: &mut OwnedLane, random: &mut Random) {
    let wild = match random.below(4) {
        0 => u64::MAX,
        1 => 0,
        2 => random.below(300),
        _ => random.next(),
    };
    let count = lane.tiles.len() as u64;
    match random.below(10) {
        0 if !lane.steps.is_empty() => {
            let place = random.below(lane.steps.len() as u64) as usize;
            lane.steps[place..].iter_mut().take(40).for_each(|step| *step = wild as u8);
        }
        1 => lane.steps.truncate(random.below(lane.steps.len() as u64 + 1) as usize),
        2 | 3 if !lane.line_ends.is_empty() => {
            let place = random.below(lane.view().line_ends.len() as u64) as usize;
            let width = usize::from(line_end_bytes(lane.dims[lane.axis.index()]));
            lane.line_ends[width * place..][..width].copy_from_slice(&wild.to_le_bytes()[..width]);
        }
        2 | 3 => {}
        _ if count == 0 => {}
        4 => {
            let copy = lane.tiles[random.below(count) as usize];
            lane.tiles.push(copy);
        }
        kind => {
            let tile = &mut lane.tiles[random.below(count) as usize];
            match kind {
                5 => tile.first_record = U64::new(wild),
                6 => tile.first_line = U32::new(wild as u32),
                7 => tile.occupancy = U64::new(wild),
                8 => tile.tile_u = U16::new(wild as u16),
                _ => tile.tile_v = U16::new(wild as u16),
            }
        }
    }
}

fn order_of(direction: [f64; 3]) -> adjsplat::Result<Order> {
    Order::new(Viewpoint::Parallel { direction }, [4; 3], Sense::BackToFront, SplitForm::default())
}

#[test]
fn the_axis_most_along_the_view_is_slow_and_ties_go_to_the_first() {
    use Axis::{X, Y, Z};
    for (direction, nesting) in [
        ([1.0, 1.0, 1.0], [X, Y, Z]),
        ([-1.0, 1.0, -1.0], [X, Y, Z]),
        ([0.0, 0.0, 1.0], [Z, X, Y]),
        ([0.0, -2.0, 0.0], [Y, X, Z]),
        ([1.0, 2.0, 2.0], [Y, Z, X]),
        ([3.0, -4.0, 3.5], [Y, Z, X]),
        ([2.0, -1.0, -2.0], [X, Z, Y]),
        ([1.0, 1.0 + f64::EPSILON, 1.0], [Y, X, Z]),
        ([1.0, 1.0 - f64::EPSILON, 1.0], [X, Z, Y]),
        ([5e-324, 0.0, 1e-323], [Z, X, Y]),
        ([f64::MAX, f64::MIN, 0.0], [X, Y, Z]),
    ] {
        let order = order_of(direction).unwrap();
        assert_eq!([order.slow, order.medium, order.fast], nesting, "{direction:?}");
        for (along, c) in order.along.into_iter().zip(direction) {
            // Back to front: from where the view goes to where it comes from.
            assert_eq!(along, if c >= 0.0 { AxisOrder::Descending } else { AxisOrder::Ascending });
        }
    }
}

#[test]
fn a_negative_zero_is_a_zero() {
    let plain = order_of([0.0, 1.0, 0.0]).unwrap();
    assert_eq!(order_of([-0.0, 1.0, -0.0]).unwrap(), plain);
    let eye = |x: f64| {
        let viewpoint = Viewpoint::Perspective { eye: [x, 1.5, 1.5], toward: [0.0, x, 1.0] };
        Order::new(viewpoint, [4; 3], Sense::FrontToBack, SplitForm::Split).unwrap()
    };
    assert_eq!(eye(0.0), eye(-0.0));
}

#[test]
fn a_viewpoint_without_meaning_is_refused() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for a in 0..3 {
            let mut direction = [1.0; 3];
            direction[a] = bad;
            assert!(matches!(order_of(direction), Err(adjsplat::Error::Input { .. })));
            for (eye, toward) in [(direction, [1.0; 3]), ([1.0; 3], direction)] {
                let viewpoint = Viewpoint::Perspective { eye, toward };
                assert!(Order::new(viewpoint, [4; 3], Sense::BackToFront, SplitForm::Split).is_err());
            }
        }
    }
    assert!(order_of([0.0, -0.0, 0.0]).is_err());
    let viewpoint = Viewpoint::Perspective { eye: [1.0; 3], toward: [0.0; 3] };
    assert!(Order::new(viewpoint, [4; 3], Sense::BackToFront, SplitForm::Split).is_err());
}

#[test]
fn an_eye_at_the_edge_of_the_grid_sees_one_side() {
    let along = |x: f64| {
        let viewpoint = Viewpoint::Perspective { eye: [x, 9.0, 9.0], toward: [1.0; 3] };
        Order::new(viewpoint, [4; 3], Sense::BackToFront, SplitForm::Split).unwrap().along[0]
    };
    assert_eq!(along(0.0), AxisOrder::Descending);
    assert_eq!(along(3.0), AxisOrder::Ascending);
    assert_eq!(along(-1e300), AxisOrder::Descending);
    assert!(matches!(along(5e-324), AxisOrder::TwoSided { .. }));
}

#[test]
#[should_panic(expected = "along its fast axis")]
fn a_walk_needs_the_lane_along_its_fast_axis() {
    let lanes = random_volume([3; 3], 2, 1).lanes();
    walk(&lanes[0].view(), &Order::parallel(0, 0), &mut |_: &Batch| ());
}

#[test]
fn an_empty_volume_has_nothing_to_visit() {
    let lanes = CodeVolume::new([9, 2, 1], |_| 0).lanes();
    for order in parallel_orders() {
        assert!(visits(&lanes[order.fast.index()].view(), &order).is_empty());
    }
}

#[test]
fn a_tile_beyond_any_channel_does_not_carry_others_past_the_end() {
    // Both tiles lie in one slice. Offsets from a base near 2^64 once wrapped to the sound tile's records.
    let mut lane = CodeVolume::new([4, 16, 1], |_| 1).pack(Axis::X, PLAIN, TileOrder::Rows);
    lane.tiles[0].first_record = U64::new(u64::MAX);
    // z slow, y medium, x fast.
    let order = Order::parallel(5, 0);
    let mut records = Vec::new();
    walk(&lane.view(), &order, &mut |batch: &Batch| {
        records.extend((0..batch.len()).map(|index| batch.record_index(index)));
    });
    assert_eq!(records, (32..64).collect::<Vec<_>>());
}

#[test]
fn a_line_that_starts_near_the_end_of_32_bits_is_no_line() {
    // In 32 bits the second line, from 2^32 - 1 to 12, has 13 records: in truth it has none.
    let mut lane = long(Axis::X, |x| u8::from(x < 20)).pack(Axis::X, PLAIN, TileOrder::Morton);
    lane.line_ends = [u32::MAX, 12].map(u32::to_le_bytes).concat();
    lane.tiles[0].occupancy = U64::new(0b11);
    lane.dims = [LONGEST, 2, 1];
    for order in parallel_orders().filter(|order| order.fast == Axis::X) {
        walk(&lane.view(), &order, &mut |batch: &Batch| panic!("visits record {}", batch.record_index(0)));
    }
}

#[test]
fn codes_past_the_end_are_zero_however_far() {
    let lane = CodeVolume::new([3, 1, 1], |_| 7).pack(Axis::X, WIDE, TileOrder::Morton);
    for record in [3, usize::MAX / 4, usize::MAX / 2, usize::MAX] {
        let lane = lane.view();
        assert_eq!((lane.value_code(record), lane.normal_code(record), lane.magnitude_code(record)), (0, 0, 0));
    }
}
