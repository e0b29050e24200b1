//! Pictures of all methods: bit for bit those of the renderer where voxels come in its order, and of the plain loops
//! that give an order otherwise.

use adjsplat::splat::{Camera, Frame, Orbit, Sampling, Settings, cpu};
use adjsplat::traverse::Viewpoint;
use adjsplat_study::baselines::Viewing;
use adjsplat_study::subject::VisibleVoxel;
use adjsplat_study::{Method, Subject, picture};

use crate::oracle::slices;
use crate::scene::VoxelVolume;

const SIZE: [u32; 2] = [96, 80];

/// Views all around, with both projections and an eye inside.
fn cameras(subject: &Subject) -> Vec<Camera> {
    let orbit = |azimuth, elevation, zoom, fov| Orbit { azimuth, elevation, zoom, fov, ..Orbit::default() };
    [
        orbit(20.0, 10.0, 1.0, None),
        orbit(130.0, -35.0, 1.4, None),
        orbit(250.0, 70.0, 0.7, None),
        orbit(45.0, 0.0, 1.0, None),
        orbit(200.0, 25.0, 1.0, Some(40.0)),
        orbit(300.0, -50.0, 3.0, Some(100.0)),
    ]
    .into_iter()
    .map(|orbit| picture::camera(subject, orbit, SIZE).unwrap())
    .collect()
}

fn rendered(subject: &Subject, camera: &Camera, settings: &Settings) -> Frame {
    cpu::render(&picture::scene(subject), camera, settings).unwrap().0
}

#[test]
fn methods_in_slice_order_give_the_renderers_bits() {
    for (dims, per_mille, normal_bits, seed) in
        [([23, 9, 17], 300, 8, 1), ([31, 30, 29], 30, 8, 2), ([12, 40, 7], 700, 0, 3)]
    {
        let dense = VoxelVolume::random(dims, per_mille, seed);
        dense.with_subject(normal_bits, |subject| {
            let settings = Settings::every_pixel(SIZE);
            for (index, camera) in cameras(subject).iter().enumerate() {
                let ours = rendered(subject, camera, &settings);
                assert!(ours.pixels().iter().any(|&value| value > 0.1), "view {index} shows nothing");
                let viewing = picture::viewing(subject, camera, &settings).unwrap();
                let plain = picture::of_voxels(subject, camera, &settings, slices(&dense, &viewing.order)).unwrap();
                assert!(ours == plain, "view {index}: the plain loops");
                for method in Method::ALL.into_iter().filter(|method| method.is_in_slice_order()) {
                    let mut built = method.build(subject).unwrap();
                    let theirs = picture::of_method(subject, camera, &settings, &mut built, true).unwrap();
                    assert!(ours == theirs, "view {index}: {}", method.name());
                }
            }
        });
    }
}

/// The voxels by octants of octants, near ones first: the bits of their coordinates, counted from the near corner, from
/// the largest cube down, the slow axis' before the medium one's before the fast one's.
fn by_octants(dense: &VoxelVolume, viewing: &Viewing) -> Vec<VisibleVoxel> {
    let Viewpoint::Parallel { direction } = viewing.viewpoint else { panic!("for parallel views") };
    let axes = [viewing.order.slow, viewing.order.medium, viewing.order.fast].map(|axis| axis.index());
    let key = |voxel: &VisibleVoxel| {
        let mut key = 0u64;
        for bit in (0..16).rev() {
            for axis in axes {
                let upper = voxel.position[axis] >> bit & 1 == 1;
                key = key << 1 | u64::from(upper != (direction[axis] < 0.0));
            }
        }
        key
    };
    let mut voxels: Vec<VisibleVoxel> = dense.visible().collect();
    voxels.sort_by_key(key);
    voxels
}

#[test]
fn an_octree_without_an_error_gives_the_bits_of_its_order() {
    let dense = VoxelVolume::random([21, 33, 14], 250, 4);
    dense.with_subject(8, |subject| {
        let settings = Settings::every_pixel(SIZE);
        let mut octree = Method::Octree.build(subject).unwrap();
        for camera in &cameras(subject)[..4] {
            let viewing = picture::viewing(subject, camera, &settings).unwrap();
            let theirs = picture::of_method(subject, camera, &settings, &mut octree, true).unwrap();
            let plain = picture::of_voxels(subject, camera, &settings, by_octants(&dense, &viewing)).unwrap();
            assert!(theirs == plain);
        }
    });
}

#[test]
fn any_order_lets_the_same_light_through() {
    // Transmittance is a product; only its rounding knows an order, and rays that end early differ by the threshold.
    let dense = VoxelVolume::random([25, 18, 22], 200, 5);
    dense.with_subject(8, |subject| {
        let settings = Settings::every_pixel(SIZE).with_termination(0.0);
        for camera in &cameras(subject) {
            let ours = rendered(subject, camera, &settings);
            for method in Method::ALL {
                let mut built = method.build(subject).unwrap();
                let theirs = picture::of_method(subject, camera, &settings, &mut built, true).unwrap();
                for (a, b) in ours.pixels().chunks_exact(4).zip(theirs.pixels().chunks_exact(4)) {
                    assert!((a[3] - b[3]).abs() < 2e-5, "{}: {} and {}", method.name(), a[3], b[3]);
                }
            }
        }
    });
}

#[test]
fn without_drawing_nothing_is_drawn() {
    let dense = VoxelVolume::random([9, 9, 9], 500, 6);
    dense.with_subject(8, |subject| {
        let settings = Settings::every_pixel(SIZE).with_sampling(Sampling::EveryPixel);
        let camera = &cameras(subject)[0];
        for method in Method::ALL {
            let mut built = method.build(subject).unwrap();
            let frame = picture::of_method(subject, camera, &settings, &mut built, false).unwrap();
            assert!(frame.pixels().iter().all(|&value| value == 0.0), "{}", method.name());
        }
    });
}
