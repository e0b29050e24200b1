//! The order of tiles.

use adjsplat::arena::TileOrder;

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
