//! Real volumes: the counts and gaps that independent readers found.

use adjsplat::arena::Lane;
use adjsplat::classify::TransferFunction;
use adjsplat::volume::{Header, SlabSource};
use adjsplat_readers::AdjustedSource;
use adjsplat_tests::real_volume;
use adjsplat_tests::scenes::{at_least, built, options, volume};

use super::dense::SampleVolume;
use super::twin::compare;

/// A real volume's samples as they are stored; `None` where they are not on this machine.
pub(crate) fn real(file: &str) -> Option<Box<dyn SlabSource>> {
    // Counts are of stored numbers; the MR head has a slope.
    let unscaled = |header: &mut Header| (header.slope, header.intercept) = (1.0, 0.0);
    Some(Box::new(AdjustedSource::new(volume(&real_volume(file)?), unscaled)))
}

/// Builds one bare lane of `file` for each threshold and checks how many voxels it has.
fn check_counts(file: &str, counts: &[(f64, u64)]) {
    for &(iso, visible) in counts {
        let Some(mut source) = real(file) else { return };
        let options = options(at_least(iso)).with_lane_count(1).with_normal_bits(0);
        let built = built(&mut *source, &options);
        assert_eq!(built.facts.visible_voxels, visible, "{file} >= {iso}");
    }
}

/// Builds `file` in full and compares it with the twin.
fn check_voxels(file: &str, iso: f64, visible: u64) {
    let Some(mut source) = real(file) else { return };
    let options = options(at_least(iso));
    let built = built(&mut *source, &options);
    assert_eq!(built.facts.visible_voxels, visible, "{file} >= {iso}");
    source.rewind().expect("the file is still there");
    compare(&SampleVolume::read(&mut *source), &options, &built);
}

#[test]
fn iron_protein() {
    check_voxels("ironProt/ironProt.vtk", 30.0, 35_511);
    check_voxels("ironProt/ironProt.vtk", 128.0, 9_338);
}

#[test]
fn ct_head() {
    check_voxels("headsq-quarter/quarter.nhdr", 500.0, 144_968);
    check_voxels("headsq-quarter/quarter.nhdr", 1150.0, 34_295);
}

#[test]
fn fuel() {
    check_voxels("scivis-fuel/fuel.nii.gz", 20.0, 5_740);
    check_voxels("scivis-fuel/fuel.nii.gz", 100.0, 1_660);
}

#[test]
fn carotid() {
    check_voxels("carotid/carotid.vtk", 150.0, 6_288);
    check_voxels("carotid/carotid.vtk", 250.0, 1_844);
}

#[test]
fn engine() {
    check_counts("scivis-engine/engine.nii.gz", &[(60.0, 1_216_893), (180.0, 69_847)]);
}

#[test]
fn mr_head() {
    check_counts("seg3d-MR/MR.nii.gz", &[(40.0, 3_097_308), (120.0, 943_538)]);
}

#[test]
fn stroke() {
    check_counts("stroke-T1/T1.nii.gz", &[(1.0, 1_088_315), (150.0, 296_578)]);
}

#[test]
fn four_dimensional_head() {
    check_counts("nifti-zarr/tests/data/example4d.nii.gz", &[(200.0, 101_409)]);
}

#[test]
fn atlas_of_138_labels() {
    let Some(mut source) = real("allen-human-atlas/AllenAtlas.nii.gz") else { return };
    let all = TransferFunction::preset("labels").expect("a preset");
    let options = options(all).with_lane_count(1).with_normal_bits(0);
    let built = built(&mut *source, &options);
    assert_eq!(built.facts.visible_voxels, 13_963_402);
    // Labels keep codes of their own.
    assert_eq!(built.facts.scales.value_step, 1.0);
}

/// Longest distance between neighbouring voxels of a line, how many exceed 255, and the stepping voxels that lie
/// between the voxels of lines, not before their first.
fn gaps(lane: &Lane) -> (u32, usize, u64) {
    let (mut longest, mut long, mut bridges) = (0, 0, 0);
    for line in lane.lines() {
        let places: Vec<u32> = lane.line_voxels(line.records).map(|(at, _)| at).collect();
        for pair in places.windows(2) {
            let gap = pair[1] - pair[0];
            longest = longest.max(gap);
            long += usize::from(gap > 255);
            bridges += u64::from(gap.div_ceil(255) - 1);
        }
    }
    (longest, long, bridges)
}

#[test]
fn frog_has_gaps_that_need_stepping_voxels() {
    let Some(mut source) = real("frogtissue/frogtissue.mhd") else { return };
    let options = options(at_least(1.0)).with_normal_bits(0);
    let built = built(&mut *source, &options);
    assert_eq!(built.facts.visible_voxels, 1_156_957);
    let lanes: Vec<Lane> = built.lanes.iter().map(|lane| lane.view()).collect();
    let [x, y, z] = [gaps(&lanes[0]), gaps(&lanes[1]), gaps(&lanes[2])];
    assert_eq!([(x.0, x.1), (y.0, y.1), (z.0, z.1)], [(277, 65), (396, 1132), (60, 0)]);
    // First voxels may be far from the low cap too: those add to what lies between.
    assert!(lanes[0].stepping_voxels() >= x.2 && x.2 == 65);
    assert!(lanes[1].stepping_voxels() >= y.2 && y.2 == 1132);
    assert_eq!(lanes[2].stepping_voxels(), 0);
}
