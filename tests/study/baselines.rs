//! Every way of walking, beside a dense oracle: the same voxels with the same codes, in the order that it promises.
//!
//! What they cannot catch: an oracle's order that no ray contradicts but that is not the paper's; tests/traversal
//! judges orders. How fast anything is.

use adjsplat::Error;
use adjsplat::arena::{Arena, LaneSet};
use adjsplat::classify::normal;
use adjsplat::file::arena_bytes;
use adjsplat::traverse::{Order, Sense, SplitForm, Viewpoint};
use adjsplat::volume::Axis;
use adjsplat_study::baselines::{AdjacencyA, AdjacencyB, Lists, Octree, Shell, Storage};
use adjsplat_study::baselines::{Normal, Viewing, VoxelCube, names};
use adjsplat_study::subject::VisibleVoxel;
use adjsplat_study::trace::WalkerArray;
use adjsplat_study::{Method, Receiver, Structure, Subject, Trace, Untraced, Walker};
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::{at_least, built, options, volume};
use adjsplat_tests::{real_volume, say};

use crate::oracle::{directions, disorder, eye_viewings, nested, parallel_viewings, slices};
use crate::scene::{VoxelVolume, with_subject};

/// Keeps what a walk hands over.
#[derive(Default)]
struct Seen {
    voxels: Vec<([u16; 3], u8, Normal)>,
    nodes: Vec<VoxelCube>,
}

impl Receiver for Seen {
    fn voxel(&mut self, position: [u16; 3], value: u8, normal: Normal) {
        self.voxels.push((position, value, normal));
    }

    fn cube(&mut self, node: &VoxelCube) {
        self.nodes.push(*node);
    }
}

fn seen(walker: &mut impl Walker, viewing: &Viewing) -> Seen {
    let mut seen = Seen::default();
    walker.walk(viewing, &mut seen, &mut Untraced);
    seen
}

/// Whether a walk handed over these voxels in this sequence, normals as codes or as what codes stand for.
fn assert_same(seen: &Seen, expected: &[VisibleVoxel], has_normals: bool, what: &dyn Fn() -> String) {
    assert!(seen.nodes.is_empty(), "{}: cubes from an exact walk", what());
    assert_eq!(seen.voxels.len(), expected.len(), "{}: how many voxels", what());
    for (index, (&(position, value, normal), voxel)) in seen.voxels.iter().zip(expected).enumerate() {
        assert_eq!((position, value), (voxel.position, voxel.value), "{}: voxel {index}", what());
        let expected = match normal {
            Normal::Code(_) => Normal::Code(voxel.normal),
            Normal::Vector(_) if has_normals => Normal::Vector(normal::decode8(voxel.normal)),
            Normal::Vector(_) => Normal::Vector([0.0; 3]),
        };
        assert_eq!(normal, expected, "{}: normal of voxel {index}", what());
    }
}

fn in_scan_order(mut seen: Seen) -> Seen {
    seen.voxels.sort_by_key(|&([x, y, z], ..)| (z, y, x));
    seen
}

/// Volumes of odd sizes, empty to full.
fn volumes() -> Vec<VoxelVolume> {
    let sizes = [
        ([1, 1, 1], 1000),
        ([9, 1, 20], 300),
        ([1, 40, 1], 500),
        ([17, 9, 33], 30),
        ([17, 9, 33], 0),
        ([8, 16, 8], 1000),
    ];
    let sizes = sizes.into_iter().chain([([13, 21, 10], 200), ([300, 5, 4], 8), ([6, 7, 70], 900)]);
    (1..).zip(sizes).map(|(seed, (dims, per_mille))| VoxelVolume::random(dims, per_mille, seed)).collect()
}

/// Eyes outside, on a border, inside between voxels, on voxels and on planes between bricks.
fn eyes([x, y, z]: [u32; 3]) -> Vec<[f64; 3]> {
    let [x, y, z] = [x, y, z].map(f64::from);
    let half = |c: f64| (c / 2.0).floor();
    vec![
        [-3.0, -1.5, -7.0],
        [x + 4.0, half(y), z + 0.5],
        [half(x), half(y), half(z)],
        [half(x) + 0.5, half(y) - 0.5, half(z)],
        [7.5, 8.0, 15.5],
        [0.0, y - 1.0, 0.5],
    ]
}

/// Builds every method for `dense`, and calls `check` with each.
fn each_method(dense: &VoxelVolume, normal_bits: u8, mut check: impl FnMut(Method, &mut Structure)) {
    dense.with_subject(normal_bits, |subject| {
        for method in Method::ALL {
            let mut built = method.build(subject).unwrap_or_else(|error| panic!("{}: {error}", method.name()));
            check(method, &mut built);
        }
    });
}

/// The sequence that a method promises; `None` if it promises only that no voxel comes before one that it hides.
fn promised(method: Method, dense: &VoxelVolume, order: &Order) -> Option<Vec<VisibleVoxel>> {
    match method {
        Method::Unordered => Some(dense.visible().collect()),
        // The rows' axis, x, at the end of the view's nesting.
        Method::Shell => {
            let mut axes = [order.slow, order.medium, order.fast];
            axes.sort_by_key(|&axis| axis == Axis::X);
            Some(nested(dense, order, axes))
        }
        _ if method.is_in_slice_order() => Some(slices(dense, order)),
        _ => None,
    }
}

fn check_viewing(method: Method, built: &mut Structure, dense: &VoxelVolume, viewing: &Viewing, has_normals: bool) {
    let what = || format!("{} of {:?}, {viewing:?}", method.name(), dense.dims);
    let seen = seen(built, viewing);
    match promised(method, dense, &viewing.order) {
        Some(expected) => assert_same(&seen, &expected, has_normals, &what),
        None => {
            assert_eq!(disorder(viewing, viewing.sense(), seen.voxels.iter().map(|v| v.0)), 0, "{}", what());
            let expected: Vec<_> = dense.visible().collect();
            assert_same(&in_scan_order(seen), &expected, has_normals, &what);
        }
    }
}

#[test]
fn all_methods_keep_their_order_in_all_parallel_views() {
    for dense in volumes() {
        each_method(&dense, 8, |method, built| {
            for viewing in parallel_viewings() {
                assert_eq!(viewing.sense(), Sense::FrontToBack, "front to back, as it is defined");
                check_viewing(method, built, &dense, &viewing, true);
            }
            for viewing in directions(dense.dims) {
                check_viewing(method, built, &dense, &viewing, true);
            }
        });
    }
}

#[test]
fn all_methods_keep_their_order_from_any_eye() {
    for dense in volumes() {
        each_method(&dense, 8, |method, built| {
            for eye in eyes(dense.dims) {
                for viewing in eye_viewings(eye, dense.dims) {
                    check_viewing(method, built, &dense, &viewing, true);
                }
            }
        });
    }
}

#[test]
fn without_normals_there_are_none() {
    let mut dense = VoxelVolume::random([12, 11, 10], 150, 5);
    for voxel in dense.voxels.iter_mut().flatten() {
        voxel.normal = 0;
    }
    let viewing = parallel_viewings().next().unwrap();
    each_method(&dense, 0, |method, built| check_viewing(method, built, &dense, &viewing, false));
}

#[test]
fn a_list_that_is_not_sorted_is_out_of_order() {
    // Tests the test: the unordered list of a full volume, seen from where its scan order runs toward the eye.
    let dense = VoxelVolume::random([6, 6, 6], 1000, 3);
    let viewing = Viewing::along(Order::parallel(5, 0b111));
    let positions: Vec<_> = dense.visible().map(|voxel| voxel.position).collect();
    // Rays along (-1, -2, -3) join each voxel with the one at that offset, of which there are 5 x 4 x 3.
    assert_eq!(disorder(&viewing, Sense::FrontToBack, positions.iter().copied()), 5 * 4 * 3);
    assert_eq!(disorder(&viewing, Sense::FrontToBack, positions.iter().rev().copied()), 0);
}

#[test]
fn a_sorted_list_has_no_two_voxels_of_a_ray_at_one_distance_from_afar() {
    let dense = VoxelVolume::random([40, 3, 3], 1000, 3);
    let eye = [-3e9, 1.0, 1.0];
    dense.with_subject(8, |subject| {
        let mut built = Method::Sorted.build(subject).unwrap();
        for (sense, expected) in [(Sense::FrontToBack, 0), (Sense::BackToFront, 39)] {
            let viewpoint = Viewpoint::Perspective { eye, toward: [1.0, 0.0, 0.0] };
            let viewing = Viewing::new(viewpoint, dense.dims, sense, SplitForm::Split).unwrap();
            // Single precision would have one distance for all.
            let row = seen(&mut built, &viewing).voxels.into_iter().filter(|v| v.0[1..] == [1, 1]);
            let xs: Vec<u16> = row.map(|v| v.0[0]).collect();
            assert_eq!(xs[0], expected);
            assert!(xs.is_sorted() || xs.iter().rev().is_sorted(), "{xs:?}");
        }
    });
}

/// Fails where an access lies outside an array, and counts.
struct Bounds {
    arrays: Vec<WalkerArray>,
    bytes_read: u64,
    accesses: u64,
}

impl Bounds {
    fn check(&mut self, array: usize, offset: usize, bytes: usize) {
        let WalkerArray { name, bytes: size, .. } = self.arrays[array];
        assert!(bytes > 0 && (offset + bytes) as u64 <= size, "{bytes} bytes at {offset} of {size} of {name}");
        self.accesses += 1;
    }
}

impl Trace for Bounds {
    fn read(&mut self, array: usize, offset: usize, bytes: usize) {
        self.check(array, offset, bytes);
        self.bytes_read += bytes as u64;
    }

    fn write(&mut self, array: usize, offset: usize, bytes: usize) {
        self.check(array, offset, bytes);
    }
}

#[test]
fn traces_stay_within_their_arrays_and_have_every_payload() {
    let dense = VoxelVolume::random([20, 17, 9], 200, 8);
    let voxels = dense.visible().count() as u64;
    let mut viewings: Vec<_> = parallel_viewings().collect();
    viewings.extend(eye_viewings([9.5, 8.0, 4.0], dense.dims));
    each_method(&dense, 8, |method, built| {
        for viewing in &viewings {
            let mut trace = Bounds { arrays: built.arrays(), bytes_read: 0, accesses: 0 };
            let mut traced = Seen::default();
            built.walk(viewing, &mut traced, &mut trace);
            assert_eq!(traced.voxels, seen(built, viewing).voxels, "{}: a trace changes nothing", method.name());
            // Our own walk is traced by its lane's pager.
            if method != Method::Adjsplat {
                // A value and a code, at least.
                assert!(trace.bytes_read >= 3 * voxels, "{}: {} bytes", method.name(), trace.bytes_read);
                assert!(trace.accesses >= voxels, "{}", method.name());
            }
        }
    });
}

/// Virtual voxels by their definition: two caps a line, two a line of a face, two an edge of the box.
fn virtual_voxels(dense: &VoxelVolume) -> u64 {
    let mut count = 8;
    for axis in Axis::ALL.map(Axis::index) {
        let mut lines: Vec<[u16; 3]> = dense.visible().map(|voxel| voxel.position).collect();
        lines.iter_mut().for_each(|line| line[axis] = 0);
        lines.sort_unstable();
        lines.dedup();
        let mut slices: Vec<u16> = dense.visible().map(|voxel| voxel.position[axis]).collect();
        slices.sort_unstable();
        slices.dedup();
        // The slices across an axis are where the four edges along it have voxels.
        count += 2 * lines.len() as u64 + 4 * slices.len() as u64;
    }
    count
}

#[test]
fn bytes_are_those_of_the_paper() {
    for dense in volumes() {
        let visible = dense.visible().count() as u64;
        let s = visible + virtual_voxels(&dense);
        let [w, h, d] = dense.dims.map(u64::from);
        dense.with_subject(8, |subject| {
            let bytes = |method: Method| method.build(subject).unwrap().bytes();
            assert_eq!(bytes(Method::Traditional), 17 * w * h * d);
            assert_eq!(bytes(Method::AdjacencyA), 5 * (w + 2) * (h + 2) * (d + 2) + 28 * s);
            assert_eq!(bytes(Method::AdjacencyB), 47 * s);
            assert_eq!(bytes(Method::AdjacencyBShuffled), 47 * s);
            assert_eq!(bytes(Method::Unordered), 23 * visible);
            assert_eq!(bytes(Method::Sorted), 10 * visible);
            assert_eq!(bytes(Method::Shell), 4 * (h * d + 1) + 6 * visible);
            let bricks = w.div_ceil(8) * h.div_ceil(8) * d.div_ceil(8);
            let full = bytes(Method::Bricks) - 4 * bricks - 3 * visible;
            assert!(full.is_multiple_of(84) && full / 84 <= bricks.min(visible), "{full} bytes of bricks");
            let lanes = Axis::ALL.map(|axis| subject.lane(axis).bytes()).iter().sum::<u64>();
            assert_eq!(bytes(Method::Adjsplat), lanes);
        });
    }
}

#[test]
fn adjacency_a_takes_voxels_in_and_out() {
    for (seed, dims) in [(1, [7, 6, 5]), (2, [1, 9, 4]), (3, [12, 1, 1]), (4, [3, 3, 3])] {
        let full = VoxelVolume::random(dims, 1000, seed);
        let mut random = Random(seed);
        let mut now = VoxelVolume::random(dims, 100, seed + 10);
        let viewings: Vec<_> = parallel_viewings().step_by(7).chain(eye_viewings([2.5, 2.0, 1.0], dims)).collect();
        let mut structure = now.with_subject(8, |subject| AdjacencyA::new(subject).unwrap());
        let mut most_records = 0;
        for round in 0..12 {
            // Rounds that mostly add and rounds that mostly remove, to the last voxel and back.
            let adds = if round % 4 < 2 { 90 } else { 2 };
            for _ in 0..full.voxels.len() {
                let index = random.below(full.voxels.len() as u64) as usize;
                let voxel = full.voxels[index].unwrap();
                if random.below(100) < adds {
                    structure.insert(&voxel).unwrap();
                    now.voxels[index] = Some(voxel);
                } else {
                    let was_there = now.voxels[index].take().is_some();
                    assert_eq!(structure.remove(voxel.position).unwrap(), was_there);
                }
            }
            if round == 11 {
                for voxel in now.voxels.iter_mut().filter_map(Option::take) {
                    structure.remove(voxel.position).unwrap();
                }
            }
            let (visible, virtual_voxels) = (now.visible().count() as u64, virtual_voxels(&now));
            assert_eq!((structure.visible(), structure.virtual_voxels()), (visible, virtual_voxels), "{dims:?}");
            most_records = most_records.max(visible + virtual_voxels);
            for viewing in &viewings {
                let what = || format!("{dims:?} round {round}, {viewing:?}");
                assert_same(&seen(&mut structure, viewing), &slices(&now, &viewing.order), true, &what);
            }
        }
        // Freed records are used again: there are never more than the most that were there at once, between rounds
        // and within them, when each voxel is there.
        let most = full.voxels.len() as u64 + virtual_voxels(&full);
        let cells = dims.iter().map(|&d| u64::from(d) + 2).product::<u64>();
        let records = (structure.bytes() - 5 * cells) / 28;
        // An array that grows doubles.
        assert!(records >= most_records && records <= 2 * most, "{records} records for {most_records} to {most}");
        assert_eq!(structure.visible() + structure.virtual_voxels(), 8, "nothing but corners is left");
    }
}

#[test]
fn adjacency_a_refuses_voxels_outside_its_grid() {
    VoxelVolume::random([3, 4, 5], 500, 1).with_subject(8, |subject| {
        let mut structure = AdjacencyA::new(subject).unwrap();
        for position in [[3, 0, 0], [0, 4, 0], [0, 0, 5], [u16::MAX, 0, 0]] {
            let voxel = VisibleVoxel { position, value: 1, normal: 0 };
            assert!(matches!(structure.insert(&voxel), Err(Error::Input { .. })), "{position:?}");
            assert!(matches!(structure.remove(position), Err(Error::Input { .. })), "{position:?}");
        }
    });
}

#[test]
fn a_shuffle_changes_where_records_lie_and_nothing_else() {
    let dense = VoxelVolume::random([19, 18, 17], 300, 2);
    // Scan order.
    let viewing = Viewing::along(Order::parallel(5, 0));
    /// Reads that are not just behind the one before.
    struct Jumps(usize, u64);
    impl Trace for Jumps {
        fn read(&mut self, _: usize, offset: usize, _: usize) {
            self.1 += u64::from(offset.abs_diff(self.0) > 4096);
            self.0 = offset;
        }
        fn write(&mut self, _: usize, _: usize, _: usize) {}
    }
    dense.with_subject(8, |subject| {
        let mut jumps = [Storage::AsBuilt, Storage::Shuffled(1), Storage::Shuffled(2)].map(|storage| {
            let mut structure = AdjacencyB::new(subject, storage).unwrap();
            assert_eq!(structure.virtual_voxels(), virtual_voxels(&dense));
            assert!(structure.build_bytes() > 0);
            let (mut seen, mut jumps) = (Seen::default(), Jumps(0, 0));
            structure.walk(&viewing, &mut seen, &mut jumps);
            assert_same(&seen, &slices(&dense, &viewing.order), true, &|| format!("{storage:?}"));
            jumps.1
        });
        jumps[1..].sort_unstable();
        assert!(jumps[1] > 2 * jumps[0], "{jumps:?}: far reads in order, and shuffled");
    });
}

#[test]
fn an_octree_keeps_optical_depth_and_nears_the_voxels_as_its_threshold_falls() {
    let dense = VoxelVolume::random([21, 30, 12], 250, 4);
    dense.with_subject(8, |subject| {
        let looks = subject.looks().unwrap();
        let depth = |value: u8| f64::from(looks[usize::from(value)][3]);
        let total: f64 = dense.visible().map(|voxel| depth(voxel.value)).sum();
        let mut octree = Octree::new(subject, 0.0).unwrap();
        let viewing = parallel_viewings().next().unwrap();
        let (mut error_before, mut splats_before) = (f64::INFINITY, 0);
        let mut kinds = 0;
        for threshold in [10.0, 0.4, 0.3, 0.28, 0.25, 0.2, 0.15, 0.1, 0.0] {
            octree.set_threshold(threshold).unwrap();
            let seen = seen(&mut octree, &viewing);
            kinds |= u8::from(!seen.nodes.is_empty()) | u8::from(!seen.voxels.is_empty()) << 1;
            let mut covered = vec![0u8; 32 * 32 * 32];
            let (mut sum, mut error) = (0.0, 0.0);
            for &([x, y, z], value, _) in &seen.voxels {
                covered[(usize::from(z) * 32 + usize::from(y)) * 32 + usize::from(x)] += 1;
                sum += depth(value);
            }
            for node in &seen.nodes {
                assert!(node.level > 0, "{node:?}");
                let edge = 1u16 << node.level;
                sum += f64::from(node.look[3]) * f64::from(edge).powi(3);
                let length: f32 = node.normal.iter().map(|c| c * c).sum();
                // Three squares, each rounded.
                assert!((length - 1.0).abs() < 4.0 * f32::EPSILON, "{node:?}");
                assert!(node.look[..3].iter().all(|c| (0.0..=1.0).contains(c)), "{node:?}");
                let cells = (0..edge).flat_map(|z| (0..edge).flat_map(move |y| (0..edge).map(move |x| [x, y, z])));
                for cell in cells {
                    let at = [0, 1, 2].map(|a| node.low[a] + cell[a]);
                    let [x, y, z] = at.map(usize::from);
                    covered[(z * 32 + y) * 32 + x] += 1;
                    let inside = (0..3).all(|a| u32::from(at[a]) < dense.dims[a]);
                    let exact = if inside { dense.at(at).map_or(0.0, |voxel| depth(voxel.value)) } else { 0.0 };
                    error += (exact - f64::from(node.look[3])).powi(2);
                }
            }
            // Depths are rounded to single precision, once each: relative to their sum, at most 2^-24.
            assert!((sum - total).abs() <= total * 6e-8, "{threshold}: {sum} for {total}");
            assert!(covered.iter().all(|&times| times <= 1), "cubes and voxels do not overlap");
            let all = dense.visible().all(|voxel| {
                let [x, y, z] = voxel.position.map(usize::from);
                covered[(z * 32 + y) * 32 + x] == 1
            });
            assert!(all, "{threshold}: every visible voxel is in a cube or alone");
            // A cut that refines another has at most its squared error (the variance is the sum of those within
            // parts and of that between their means); rounding of the means is below 1e-6 of it.
            assert!(error <= error_before * (1.0 + 1e-6), "{threshold}: {error} after {error_before}");
            let splats = seen.voxels.len() + seen.nodes.len();
            assert!(splats >= splats_before, "{threshold}: {splats} after {splats_before}");
            (error_before, splats_before) = (error, splats);
        }
        assert_eq!((error_before, splats_before), (0.0, dense.visible().count()), "exact at 0");
        assert_eq!(kinds, 3, "thresholds that draw cubes and ones that draw voxels");
        for threshold in [-0.1, f32::NAN, f32::INFINITY] {
            assert!(matches!(octree.set_threshold(threshold), Err(Error::Input { .. })), "{threshold}");
        }
    });
}

#[test]
fn a_uniform_cube_is_one_splat() {
    let dense = VoxelVolume::new([8, 8, 8], |_| Some((100, 0x1234)));
    dense.with_subject(8, |subject| {
        let look = subject.looks().unwrap()[100];
        let mut octree = Octree::new(subject, 1e-3).unwrap();
        let seen = seen(&mut octree, &parallel_viewings().next().unwrap());
        let [node] = seen.nodes[..] else { panic!("{} cubes", seen.nodes.len()) };
        assert_eq!((node.low, node.level, seen.voxels.len()), ([0; 3], 3, 0));
        for (got, want) in node.look.iter().zip(look) {
            // 512 equal numbers, added and divided in double precision.
            assert!((got - want).abs() <= want * f32::EPSILON, "{got} for {want}");
        }
        for (got, want) in node.normal.iter().zip(normal::decode8(0x1234)) {
            // The code's vector has unit length up to rounding; the mean's is made unit again.
            assert!((got - want).abs() <= 2.0 * f32::EPSILON, "{got} for {want}");
        }
    });
}

#[test]
fn a_shell_hides_what_opaque_neighbours_enclose_and_nothing_else() {
    // Value 255 has an opacity of 0.9, value 0 of 0.02.
    let mut random = Random(6);
    let dense = VoxelVolume::new([9, 10, 11], |_| {
        let kind = random.below(10);
        (kind > 0).then_some((if kind > 2 { 255 } else { 0 }, 0))
    });
    let opaque = |at: [i64; 3]| {
        let inside = (0..3).all(|a| (0..i64::from(dense.dims[a])).contains(&at[a]));
        inside && dense.at(at.map(|c| c as u16)).is_some_and(|voxel| voxel.value == 255)
    };
    let mut viewings = directions(dense.dims);
    viewings.extend(eye_viewings([4.0, 5.5, -20.0], dense.dims));
    dense.with_subject(8, |subject| {
        let mut shell = Shell::new(subject, Lists::Three, 0.8).unwrap();
        let mut hidden_ever = 0;
        for viewing in &viewings {
            shell.hide(false);
            let all = seen(&mut shell, viewing).voxels;
            assert_eq!(shell.skipped(), 0);
            shell.hide(true);
            let shown = seen(&mut shell, viewing).voxels;
            let hidden = |at: [u16; 3]| {
                (0..3).all(|a| {
                    let toward = match viewing.viewpoint {
                        Viewpoint::Parallel { direction } => -direction[a],
                        Viewpoint::Perspective { eye, .. } => eye[a] - f64::from(at[a]),
                    };
                    // Across the view both sides must be opaque.
                    [-1, 1].into_iter().filter(|&side| f64::from(side) * toward >= 0.0).all(|side| {
                        let mut near = at.map(i64::from);
                        near[a] += i64::from(side);
                        opaque(near)
                    })
                })
            };
            let expected: Vec<_> = all.iter().filter(|voxel| !hidden(voxel.0)).copied().collect();
            assert_eq!(shown, expected, "{viewing:?}");
            assert_eq!(shell.skipped(), (all.len() - shown.len()) as u64);
            hidden_ever += shell.skipped();
        }
        assert!(hidden_ever > 1000, "{hidden_ever} voxels were hidden in all views");
    });
}

#[test]
fn sizes_are_refused_before_memory_is_taken() {
    let corner = |dims: [u32; 3]| {
        let position = dims.map(|d| u16::try_from(d - 1).unwrap());
        std::iter::once(VisibleVoxel { position, value: 200, normal: 0 })
    };
    // Petabytes.
    let dims = [60_000, 60_000, 50_000];
    with_subject(dims, corner(dims), 8, |subject| {
        let bytes = [17 * 60_000u64.pow(2) * 50_000, 5 * 60_002u64.pow(2) * 50_002];
        for (method, bytes) in [Method::Traditional, Method::AdjacencyA].into_iter().zip(bytes) {
            let Err(Error::Limit { what, need, .. }) = method.build(subject) else {
                panic!("{} was built", method.name());
            };
            assert!(what.contains("memory for") && need == bytes, "{what}: {need}");
        }
        // These do not depend on the volume's size.
        for method in [Method::AdjacencyB, Method::Unordered, Method::Octree, Method::Sorted] {
            let mut built = method.build(subject).unwrap();
            let viewing = parallel_viewings().last().unwrap();
            assert_eq!(seen(&mut built, &viewing).voxels[0].0, [59_999, 59_999, 49_999], "{}", method.name());
        }
    });
    // With its caps an axis of 65,535 points does not fit two bytes.
    for (points, fits) in [(65_534, true), (65_535, false)] {
        let dims = [2, points, 1];
        with_subject(dims, corner(dims), 8, |subject| {
            for method in [Method::AdjacencyA, Method::AdjacencyB] {
                let built = method.build(subject);
                assert_eq!(built.is_ok(), fits, "{} of {points}", method.name());
                if let Ok(mut built) = built {
                    for viewing in parallel_viewings().chain(eye_viewings([0.5, 70.0, 3.0], dims)) {
                        assert_eq!(seen(&mut built, &viewing).voxels.len(), 1);
                    }
                }
            }
        });
    }
}

#[test]
fn methods_have_names() {
    for (method, name) in Method::ALL.into_iter().zip(names()) {
        assert_eq!(Method::named(name).unwrap(), method);
    }
    let error = Method::named("quicksort").unwrap_err().to_string();
    assert!(error.contains("quicksort") && error.contains("adjacency_b_shuffled"), "{error}");
}

#[test]
fn the_frog_has_as_many_virtual_voxels_as_its_lines_ask_for() {
    let Some(path) = real_volume("frogtissue/frogtissue.mhd") else { return };
    let options = options(at_least(1.0)).with_lane_count(1);
    let built = built(&mut *volume(&path), &options);
    let bytes = arena_bytes(&built.facts, &built.lanes, "{}");
    let lanes = LaneSet::new(Arena::new(&bytes).unwrap(), None);
    let subject = Subject::new("frog", &lanes, built.transfer.clone()).unwrap();
    let mut structure = AdjacencyB::new(&subject, Storage::AsBuilt).unwrap();
    let (visible, virtual_voxels) = (structure.visible(), structure.virtual_voxels());
    let s = visible + virtual_voxels;
    say(&format!(
        "frog: {visible} visible and {virtual_voxels} virtual voxels, s = {s}, {:.1} % virtual; {} bytes",
        100.0 * virtual_voxels as f64 / s as f64,
        structure.bytes()
    ));
    assert_eq!(visible, built.facts.visible_voxels);
    assert_eq!(structure.bytes(), 47 * s);
    let mut walked = 0u64;
    struct Count<'a>(&'a mut u64);
    impl Receiver for Count<'_> {
        fn voxel(&mut self, _: [u16; 3], _: u8, _: Normal) {
            *self.0 += 1;
        }
        fn cube(&mut self, _: &VoxelCube) {}
    }
    structure.walk(&parallel_viewings().last().unwrap(), &mut Count(&mut walked), &mut Untraced);
    assert_eq!(walked, visible);
}
