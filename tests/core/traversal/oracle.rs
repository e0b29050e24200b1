//! Exact integer geometry: what occludes must come later (back to front), on every ray.
//!
//! Parallel: every full volume from 1^3 to 7^3, every direction of -3..=3 on each axis, every pair of voxels that
//! lies exactly on a ray, all 48 orders. Perspective: eyes at all integers and half-integers from -4 to 11.

use adjsplat::arena::OwnedLane;
use adjsplat::traverse::{AxisOrder, Order, Sense, SplitForm, Viewpoint};
use adjsplat::volume::Axis;
use adjsplat_tests::walks::{eye_orders, parallel_orders};

use crate::traversal::{CodeVolume, visits};

/// Edge of the largest volume.
const EDGE: i64 = 7;

fn cross_is_zero(p: [i64; 3], q: [i64; 3]) -> bool {
    (0..3).all(|a| p[a] * q[(a + 1) % 3] == p[(a + 1) % 3] * q[a])
}

fn dot(p: [i64; 3], q: [i64; 3]) -> i64 {
    (0..3).map(|a| p[a] * q[a]).sum()
}

/// All vectors of integers from -`reach` to `reach`.
fn cube(reach: i64) -> impl Iterator<Item = [i64; 3]> {
    (-reach..=reach).flat_map(move |z| (-reach..=reach).flat_map(move |y| (-reach..=reach).map(move |x| [x, y, z])))
}

fn voxels([nx, ny, nz]: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
}

fn full(dims: [i64; 3]) -> CodeVolume {
    CodeVolume::new(dims.map(|d| u32::try_from(d).unwrap()), |_| 1)
}

/// When each voxel is visited, by `x + 7 y + 49 z`; each exactly once.
fn times(lanes: &[OwnedLane; 3], order: &Order, count: usize) -> Vec<usize> {
    let mut times = vec![usize::MAX; 343];
    let seen = visits(&lanes[order.fast.index()].view(), order);
    assert_eq!(seen.len(), count, "a full volume has {count} voxels");
    for (time, (at, _)) in seen.into_iter().enumerate() {
        let slot = &mut times[(at[0] + 7 * at[1] + 49 * at[2]) as usize];
        assert_eq!(*slot, usize::MAX, "{at:?} was visited twice");
        *slot = time;
    }
    times
}

fn place(p: [i64; 3]) -> usize {
    usize::try_from(p[0] + 7 * p[1] + 49 * p[2]).unwrap()
}

/// Whether the slowest axis along which `v` moves runs from far to near: what decides every pair on a ray.
fn runs_toward_the_eye(order: &Order, v: [i64; 3]) -> bool {
    let deciding = [order.slow, order.medium, order.fast].into_iter().find(|axis| v[axis.index()] != 0).unwrap();
    (order.along[deciding.index()] == AxisOrder::Descending) == (v[deciding.index()] > 0)
}

/// Whether every axis runs from far to near.
fn is_valid(order: &Order, v: [i64; 3]) -> bool {
    (0..3).all(|a| v[a] == 0 || (order.along[a] == AxisOrder::Descending) == (v[a] > 0))
}

#[test]
fn on_every_parallel_ray_the_farther_voxel_comes_first() {
    let directions: Vec<[i64; 3]> = cube(3).filter(|&v| v != [0; 3]).collect();
    let orders: Vec<Order> = parallel_orders().collect();
    // For each difference of two voxels, the directions whose rays join them.
    let reach = EDGE - 1;
    let rays_along: Vec<Vec<usize>> = cube(reach)
        .map(|d| {
            (0..directions.len()).filter(|&v| cross_is_zero(d, directions[v]) && dot(d, directions[v]) > 0).collect()
        })
        .collect();
    let rays_of = |d: [i64; 3]| {
        let index = ((d[2] + reach) * 13 + d[1] + reach) * 13 + d[0] + reach;
        &rays_along[usize::try_from(index).unwrap()]
    };
    let mut checked = 0u64;
    for dims in voxels([EDGE; 3]).map(|at| at.map(|c| c + 1)) {
        let lanes = full(dims).lanes();
        let count = voxels(dims).count();
        let mut has_pair = vec![false; directions.len()];
        let times: Vec<Vec<usize>> = orders.iter().map(|order| times(&lanes, order, count)).collect();
        let mut violated = vec![[false; 48]; directions.len()];
        for p in voxels(dims) {
            for q in voxels(dims) {
                for &v in rays_of([p[0] - q[0], p[1] - q[1], p[2] - q[2]]) {
                    // p is the farther one: it must come first.
                    has_pair[v] = true;
                    checked += 1;
                    for (order, times) in times.iter().enumerate() {
                        violated[v][order] |= times[place(p)] >= times[place(q)];
                    }
                }
            }
        }
        for (v, &direction) in directions.iter().enumerate() {
            for (index, order) in orders.iter().enumerate() {
                // An order that is wrong for this direction must be caught: this tests the test.
                let expected = has_pair[v] && !runs_toward_the_eye(order, direction);
                assert_eq!(violated[v][index], expected, "{dims:?} {direction:?} {order:?}");
                assert!(!(is_valid(order, direction) && violated[v][index]));
            }
            let viewpoint = Viewpoint::Parallel { direction: direction.map(|c| c as f64) };
            let chosen = Order::new(viewpoint, dims.map(|d| d as u32), Sense::BackToFront, SplitForm::Split).unwrap();
            assert!(is_valid(&chosen, direction), "{direction:?} {chosen:?}");
            let [s, m, f] = [chosen.slow, chosen.medium, chosen.fast].map(|axis: Axis| direction[axis.index()].abs());
            assert!(s >= m && m >= f, "{direction:?} {chosen:?}");
        }
    }
    assert!(checked > 400_000, "only {checked} pairs lie on rays");
}

/// Greatest common divisor; of 0 and n it is n.
fn gcd(a: i64, b: i64) -> i64 {
    if b == 0 { a.abs() } else { gcd(b, a % b) }
}

/// Rays from an eye: for each voxel the number of its ray, and its distance in units of the ray's shortest
/// integer vector. Coordinates are doubled, so that half-integers are exact.
fn rays_from(eye_doubled: [i64; 3], dims: [i64; 3]) -> Vec<(usize, i64)> {
    let mut rays: std::collections::HashMap<[i64; 3], usize> = std::collections::HashMap::new();
    let mut of_voxels = vec![(0, 0); 343];
    for p in voxels(dims) {
        let d = [0, 1, 2].map(|a| 2 * p[a] - eye_doubled[a]);
        let distance = gcd(gcd(d[0], d[1]), d[2]);
        let next = rays.len();
        let ray = *rays.entry(d.map(|c| c / distance.max(1))).or_insert(next);
        of_voxels[place(p)] = (ray, distance);
    }
    of_voxels
}

#[test]
fn rays_are_the_pairs_of_zero_cross_product() {
    let dims = [EDGE; 3];
    for eye in [[-8, 3, 5], [6, 6, 6], [7, 5, 22], [0, 0, 0], [1, 12, 13]] {
        let rays = rays_from(eye, dims);
        for p in voxels(dims) {
            for q in voxels(dims) {
                let [from_p, from_q] = [p, q].map(|r| [0, 1, 2].map(|a| 2 * r[a] - eye[a]));
                let on_a_ray = cross_is_zero(from_p, from_q) && dot(from_p, from_q) > 0;
                let (ray_p, ray_q) = (rays[place(p)], rays[place(q)]);
                assert_eq!(on_a_ray, ray_p.0 == ray_q.0 && ray_p.1 > 0, "{eye:?} {p:?} {q:?}");
                if on_a_ray {
                    assert_eq!(ray_p.1 > ray_q.1, dot(from_p, from_p) > dot(from_q, from_q));
                }
            }
        }
    }
}

/// Walks all orders of one eye.
fn check_eye(eye_doubled: [i64; 3], dims: [i64; 3], lanes: &[OwnedLane; 3]) {
    let rays = rays_from(eye_doubled, dims);
    let count = voxels(dims).count();
    let mut latest = vec![0i64; 343];
    for (sense, order) in eye_orders(eye_doubled.map(|c| c as f64 / 2.0), dims.map(|d| d as u32)) {
        let back_to_front = sense == Sense::BackToFront;
        latest.fill(if back_to_front { i64::MAX } else { i64::MIN });
        let seen = visits(&lanes[order.fast.index()].view(), &order);
        assert_eq!(seen.len(), count);
        for (at, _) in seen {
            let (ray, distance) = rays[place(at.map(i64::from))];
            let before = std::mem::replace(&mut latest[ray], distance);
            let is_ordered = if back_to_front { distance < before } else { distance > before };
            assert!(is_ordered, "{at:?} is too late on its ray from {eye_doubled:?} / 2, {order:?}");
        }
    }
}

#[test]
fn on_every_ray_from_an_eye_the_farther_voxel_comes_first() {
    let dims = [EDGE; 3];
    let lanes = full(dims).lanes();
    for eye in cube(15).map(|c| c.map(|c| c + 7)) {
        check_eye(eye, dims, &lanes);
    }
}

#[test]
fn on_every_ray_from_an_eye_of_a_box_the_farther_voxel_comes_first() {
    // Every fifth eye: the cube above has them all.
    for dims in [[7, 2, 5], [1, 6, 3], [4, 7, 1], [1, 1, 7]] {
        let lanes = full(dims).lanes();
        for eye in cube(15).map(|c| c.map(|c| c + 7)).step_by(5) {
            check_eye(eye, dims, &lanes);
        }
    }
}

#[test]
fn an_eye_that_is_taken_for_another_is_caught() {
    // Tests the test: the order for an eye at the low corner, judged from the high one.
    let dims = [EDGE; 3];
    let lanes = full(dims).lanes();
    let rays = rays_from([14; 3], dims);
    let (_, order) = eye_orders([0.0; 3], [7; 3]).next().expect("there are 24");
    let mut latest = vec![i64::MAX; 343];
    let violations = visits(&lanes[order.fast.index()].view(), &order).into_iter().filter(|(at, _)| {
        let (ray, distance) = rays[place(at.map(i64::from))];
        std::mem::replace(&mut latest[ray], distance) <= distance
    });
    // Of 343 voxels at offsets 1..=7 from the eye 307 have coprime offsets: the rest hide behind another.
    assert_eq!(violations.count(), 343 - 307);
}
