//! The dense twin: nested loops over the whole volume must visit the same voxels in the same sequence.

use std::path::Path;

use adjsplat::arena::OwnedLane;
use adjsplat::traverse::{AxisOrder, Order, Sense, SplitForm};
use adjsplat::volume::{Axis, Samples};
use adjsplat_tests::random::Random;
use adjsplat_tests::real_volume;
use adjsplat_tests::scenes::volume;
use adjsplat_tests::walks::{eye_orders, parallel_orders};
use proptest::prelude::*;

use crate::traversal::{CodeVolume, Visit, visits};

/// The coordinates below `count` in an axis' order, by the words of [`AxisOrder`] alone.
fn sequence(along: AxisOrder, count: u32) -> Vec<u32> {
    let mut all: Vec<u32> = (0..count).collect();
    match along {
        AxisOrder::Ascending => {}
        AxisOrder::Descending => all.reverse(),
        AxisOrder::TwoSided { eye, form, sense } => {
            let distance = |&c: &u32| (f64::from(c) - eye).abs();
            // Far to near; `false` sorts before `true`.
            all.sort_by(|a, b| {
                let [high_a, high_b] = [a, b].map(|&c| f64::from(c) > eye);
                let nearer = distance(b).total_cmp(&distance(a));
                match form {
                    SplitForm::Interleaved => nearer.then(high_a.cmp(&high_b)),
                    SplitForm::Split => {
                        let [on_plane_a, on_plane_b] = [a, b].map(|&c| f64::from(c) == eye);
                        on_plane_a.cmp(&on_plane_b).then(high_a.cmp(&high_b)).then(nearer)
                    }
                }
            });
            if sense == Sense::FrontToBack {
                all.reverse();
            }
        }
    }
    all
}

/// What nested loops visit.
fn dense_visits(volume: &CodeVolume, order: &Order) -> Vec<Visit> {
    let of = |axis: Axis| sequence(order.along[axis.index()], volume.dims[axis.index()]);
    let [slow, medium, fast] = [order.slow, order.medium, order.fast].map(of);
    let mut seen = Vec::new();
    let mut at = [0; 3];
    for &s in &slow {
        at[order.slow.index()] = s;
        for &m in &medium {
            at[order.medium.index()] = m;
            for &f in &fast {
                at[order.fast.index()] = f;
                let code = volume.at(at);
                if code != 0 {
                    seen.push((at, u16::from(code)));
                }
            }
        }
    }
    seen
}

fn reversed(order: AxisOrder) -> AxisOrder {
    match order {
        AxisOrder::Ascending => AxisOrder::Descending,
        AxisOrder::Descending => AxisOrder::Ascending,
        AxisOrder::TwoSided { eye, form, sense: Sense::BackToFront } => {
            AxisOrder::TwoSided { eye, form, sense: Sense::FrontToBack }
        }
        AxisOrder::TwoSided { eye, form, sense: Sense::FrontToBack } => {
            AxisOrder::TwoSided { eye, form, sense: Sense::BackToFront }
        }
    }
}

fn check(volume: &CodeVolume, lanes: &[OwnedLane; 3], order: &Order) {
    let expected = dense_visits(volume, order);
    let lane = lanes[order.fast.index()].view();
    let mut got = visits(&lane, order);
    if expected != got {
        let first = expected.iter().zip(&got).position(|(e, g)| e != g).unwrap_or(expected.len().min(got.len()));
        panic!(
            "{:?}: {order:?}: visit {first} should be {:?} but is {:?}; {} visits should be {}",
            volume.dims,
            expected.get(first),
            got.get(first),
            got.len(),
            expected.len()
        );
    }
    got.reverse();
    let reversed = Order { along: order.along.map(reversed), ..*order };
    assert!(visits(&lane, &reversed) == got, "{:?}: {order:?} does not reverse", volume.dims);
}

/// Eyes outside, beside (face, edge, corner) and inside: at, between and off the grid's planes.
fn eyes(dims: [u32; 3], random: &mut Random) -> Vec<[f64; 3]> {
    let inside = |random: &mut Random| {
        dims.map(|d| {
            let doubled = random.below(2 * u64::from(d)) as f64;
            if random.below(3) == 0 { doubled / 2.1 } else { doubled / 2.0 }
        })
    };
    let mut eyes = vec![inside(random), inside(random)];
    for outside_axes in 1..8 {
        let mut eye = inside(random);
        for a in 0..3 {
            if outside_axes >> a & 1 == 1 {
                eye[a] = if random.below(2) == 0 { -3.5 } else { f64::from(dims[a]) + 2.0 };
            }
        }
        eyes.push(eye);
    }
    eyes
}

fn check_every_order(volume: &CodeVolume, seed: u64) {
    let lanes = volume.lanes();
    parallel_orders().for_each(|order| check(volume, &lanes, &order));
    for eye in eyes(volume.dims, &mut Random(seed)) {
        // The other sense is checked as the reverse.
        for (sense, order) in eye_orders(eye, volume.dims) {
            if sense == Sense::BackToFront {
                check(volume, &lanes, &order);
            }
        }
    }
}

/// A small volume with `share` of 256 samples visible.
fn small_volume() -> impl Strategy<Value = (CodeVolume, u64)> {
    let share = prop_oneof![Just(0u64), Just(256), Just(3), Just(30), Just(128), Just(250)];
    ([1u32..=20, 1..=20, 1..=20], share, any::<u64>()).prop_map(|(dims, share, seed)| {
        let mut random = Random(seed);
        let code = |random: &mut Random| if random.below(256) < share { 1 + random.below(255) as u8 } else { 0 };
        (CodeVolume::new(dims, |_| code(&mut random)), seed)
    })
}

/// A volume long along one axis, whose gaps need no, one or two stepping voxels, just so or just not.
fn long_volume() -> impl Strategy<Value = (CodeVolume, u64)> {
    (0usize..3, 200u32..=1_100, 1u32..=9, 1u32..=3, any::<u64>()).prop_map(|(axis, long, wide, thin, seed)| {
        let mut random = Random(seed);
        let mut dims = [wide, thin, thin];
        dims.swap(0, axis);
        dims[axis] = long;
        let mut volume = CodeVolume::new(dims, |_| 0);
        for line in 0..volume.codes.len() / long as usize {
            let mut at = u64::MAX;
            loop {
                let gap = [1, 1, 2, 254, 255, 256, 257, 509, 510, 511, 512, 766][random.below(12) as usize];
                at = at.wrapping_add(gap);
                if at >= long.into() {
                    break;
                }
                let [u, v] = Axis::ALL[axis].others();
                let mut place = [0; 3];
                place[axis] = at as u32;
                place[u.index()] = line as u32 % dims[u.index()];
                place[v.index()] = line as u32 / dims[u.index()];
                let [nx, ny, _] = dims;
                let index = (place[2] * ny + place[1]) * nx + place[0];
                volume.codes[index as usize] = 1 + random.below(255) as u8;
            }
        }
        (volume, seed)
    })
}

impl std::fmt::Debug for CodeVolume {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?}, {} visible", self.dims, self.codes.iter().filter(|&&code| code != 0).count())
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn small_volumes_are_walked_as_plain_loops_do((volume, seed) in small_volume()) {
        check_every_order(&volume, seed);
    }

    #[test]
    fn long_volumes_are_walked_as_plain_loops_do((volume, seed) in long_volume()) {
        check_every_order(&volume, seed);
    }
}

/// A real volume of samples from `iso` up; checks how many there are.
fn real_codes(path: &Path, iso: f64, visible: usize) -> CodeVolume {
    let mut source = volume(path);
    let header = source.header().clone();
    let mut slice = Samples::zeros(header.sample_type, header.grid.slice_len() as usize);
    let mut codes = Vec::new();
    for _ in 0..header.grid.dims[2] {
        source.read_slice(&mut slice).expect("a real volume can be read");
        // Neighbours differ in code, so that a wrong record shows.
        codes.extend((0..slice.len()).map(|i| if slice.get(i) >= iso { 1 + (i % 251) as u8 } else { 0 }));
    }
    assert_eq!(codes.iter().filter(|&&code| code != 0).count(), visible, "{}", path.display());
    CodeVolume { dims: header.grid.dims, codes }
}

#[test]
fn real_volumes_are_walked_as_plain_loops_do() {
    for (path, iso, visible, has_stepping) in [
        ("frogtissue/frogtissue.mhd", 1.0, 1_156_957, true),
        ("ironProt/ironProt.vtk", 30.0, 35_511, false),
        ("headsq-quarter/quarter.nhdr", 1_150.0, 34_295, false),
        ("scivis-fuel/fuel.nii.gz", 20.0, 5_740, false),
    ] {
        let Some(path) = real_volume(path) else { return };
        let volume = real_codes(&path, iso, visible);
        let lanes = volume.lanes();
        assert_eq!(lanes.iter().any(|lane| lane.view().stepping_voxels() > 0), has_stepping);
        // Each nesting once, with six of the eight sign patterns; the reverses are checked too. All 48 orders and more
        // eyes are walked on random volumes, which are smaller than the frog.
        for nesting in 0..6 {
            check(&volume, &lanes, &Order::parallel(nesting, [0, 1, 2, 3, 5, 6][nesting]));
        }
        // Inside and face-on, every nesting, in one of the two forms.
        let middle = volume.dims.map(|d| f64::from(d) / 2.0);
        for eye in [[middle[0], middle[1] - 0.3, middle[2] + 0.2], [middle[0] + 0.3, middle[1], 200.0]] {
            for (index, (_, order)) in eye_orders(eye, volume.dims).enumerate() {
                if index % 4 == (index / 4) % 2 * 2 {
                    check(&volume, &lanes, &order);
                }
            }
        }
    }
}
