//! The order of tiles, and sets of records that are carried from lane to lane.

use adjsplat::arena::{Channels, Lane, OwnedLane, Record, TileOrder};
use adjsplat::internals::{LanePacker, RecordSet, carry, transpose};
use adjsplat::volume::Axis;

fn place(lane: &Lane, u: u32, v: u32, along: u32) -> [u32; 3] {
    let mut at = [0; 3];
    let [a, b] = lane.axis.others();
    (at[a.index()], at[b.index()], at[lane.axis.index()]) = (u, v, along);
    at
}

#[test]
fn a_set_reaches_the_same_voxels_in_every_lane() {
    let dims = [300u32, 21, 17];
    let channels = Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0 };
    let there = |x: u32, y: u32, z: u32| (x * 7 + y * 13 + z * 29).is_multiple_of(5) || (x == 299 && y < 3);
    let chosen = |[x, y, z]: [u32; 3]| (x + 3 * y + 5 * z).is_multiple_of(3);
    let mut packer = LanePacker::new(Axis::X, dims, channels, TileOrder::Hilbert);
    for (z, y) in (0..17).flat_map(|z| (0..21).map(move |y| (z, y))) {
        let line = (0..300u16).filter(|&x| there(x.into(), y, z)).map(|x| (x, Record::default()));
        packer.line(u16::try_from(y).unwrap(), u16::try_from(z).unwrap(), line);
    }
    let x = packer.finish();
    let others = [Axis::Y, Axis::Z].map(|axis| transpose(&x.view(), axis, TileOrder::Hilbert));
    let lanes: Vec<OwnedLane> = std::iter::once(x).chain(others).collect();
    for (from, to) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))).filter(|(a, b)| a != b) {
        let (from, to) = (lanes[from].view(), lanes[to].view());
        let set = RecordSet::new(from.steps.len()).unwrap();
        for line in from.lines() {
            for (along, record) in from.line_voxels(line.records.clone()) {
                if chosen(place(&from, line.u, line.v, along)) {
                    set.insert(record);
                }
            }
        }
        let into = RecordSet::new(to.steps.len()).unwrap();
        carry(&from, &|record| set.contains(record), &to, &into).unwrap();
        assert_eq!(into.count(), set.count(), "{:?} to {:?}", from.axis, to.axis);
        for line in to.lines() {
            for (along, record) in to.line_voxels(line.records.clone()) {
                let at = place(&to, line.u, line.v, along);
                assert_eq!(into.contains(record), chosen(at), "{at:?}, {:?} to {:?}", from.axis, to.axis);
            }
        }
    }
}

#[test]
fn morton_interleaves_bits() {
    assert_eq!(TileOrder::Morton.key(0b11, 0b01), 0b0111);
    assert_eq!(TileOrder::Morton.key(0x1fff, 0), 0x0155_5555);
}

#[test]
fn hilbert_visits_neighbours() {
    let mut tiles: Vec<(u16, u16)> = (0..64).flat_map(|v| (0..64).map(move |u| (u, v))).collect();
    tiles.sort_by_key(|&(u, v)| TileOrder::Hilbert.key(u, v));
    for pair in tiles.windows(2) {
        let apart = pair[0].0.abs_diff(pair[1].0) + pair[0].1.abs_diff(pair[1].1);
        assert_eq!(apart, 1, "{pair:?} follow each other but do not touch");
    }
}

#[test]
fn names_and_codes_return() {
    for order in [TileOrder::Morton, TileOrder::Hilbert, TileOrder::Rows] {
        assert_eq!(TileOrder::from_code(order.code()), Some(order));
        assert_eq!(TileOrder::from_name(order.name()).unwrap(), order);
    }
    assert_eq!(TileOrder::from_code(3), None);
    assert!(TileOrder::from_name("zigzag").is_err());
}
