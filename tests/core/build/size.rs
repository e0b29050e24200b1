//! Bytes a visible voxel: whole files, all tables counted, with a value of one byte and a normal of two.

use adjsplat::build::{Unobserved, build};
use adjsplat::file::arena_bytes;
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{SampleType, SlabSource};
use adjsplat_tests::scenes::{at_least, built, options};

use super::real::real;

/// Bytes a visible voxel of files with one lane and with three.
fn check(source: Option<Box<dyn SlabSource>>, iso: f64, one_bar: f64, three_bar: f64) {
    let Some(mut source) = source else { return };
    let built = built(&mut *source, &options(at_least(iso)));
    let name = source.header().name.clone();
    // About as long as what the program writes.
    let description = format!("{{\"transfer_function\":\"{}\"}}", "x".repeat(500));
    for (lanes, bar) in [(1, one_bar), (3, three_bar)] {
        let bytes = arena_bytes(&built.facts, &built.lanes[..lanes], &description).len();
        let each = bytes as f64 / built.facts.visible_voxels as f64;
        assert!(each <= bar, "{name} >= {iso}: {each:.3} bytes a visible voxel in {lanes} lanes, bar {bar}");
    }
}

#[test]
fn solids_and_surfaces() {
    check(real("frogtissue/frogtissue.mhd"), 1.0, 4.7, 14.5);
    check(real("headsq-quarter/quarter.nhdr"), 1150.0, 4.7, 14.5);
    check(real("scivis-engine/engine.nii.gz"), 60.0, 4.7, 14.5);
    check(real("seg3d-MR/MR.nii.gz"), 120.0, 4.7, 14.5);
}

#[test]
fn thin_vessels() {
    check(real("carotid/carotid.vtk"), 150.0, 5.6, 17.0);
}

#[test]
fn one_percent_noise() {
    let noise = Phantom::from_name("noise").expect("a phantom");
    check(Some(noise.open([256; 3], SampleType::U8, [1.0; 3]).expect("sound")), 1.0, 5.7, 17.0);
}

#[test]
fn a_lane_alone_is_the_same_as_with_others() {
    let gyroid = || Phantom::Gyroid.open([70, 60, 50], SampleType::U8, [1.0; 3]).expect("sound");
    let all = built(&mut *gyroid(), &options(at_least(150.0)));
    let one = options(at_least(150.0)).with_lane_count(1);
    let one = build(&mut *gyroid(), &one, &mut Unobserved).expect("builds");
    assert!(one.lanes[0] == all.lanes[0] && one.facts == all.facts);
}
