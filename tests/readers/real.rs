//! Real volumes: dimensions, spacing, and the digest that independent readers agreed on.

use adjsplat::volume::{Header, SampleType};
use adjsplat_readers::OpenOptions;
use adjsplat_tests::real_volume;
use sha2::{Digest, Sha256};

use super::sample::read_with;

/// Reads `file` and checks what is known of it; its header, if the folder is here.
fn check(file: &str, ty: SampleType, dims: [u32; 3], spacing: [f64; 3], sha: &str) -> Option<Header> {
    check_volume(file, 0, ty, dims, spacing, sha)
}

fn check_volume(
    file: &str,
    volume_index: u32,
    ty: SampleType,
    dims: [u32; 3],
    spacing: [f64; 3],
    sha: &str,
) -> Option<Header> {
    let path = real_volume(file)?;
    let options = OpenOptions::new().volume_index(volume_index);
    let mut read = read_with(&path, &options).unwrap_or_else(|error| panic!("{error}"));
    if cfg!(target_endian = "big") {
        read.samples.swap_bytes();
    }
    let digest: String = Sha256::digest(read.samples.bytes()).iter().take(8).map(|b| format!("{b:02x}")).collect();
    assert_eq!(read.header.sample_type, ty, "{file}");
    assert_eq!(read.header.grid.dims, dims, "{file}");
    for (got, want) in read.header.grid.spacing.into_iter().zip(spacing) {
        // The manifest rounds to four digits.
        assert!((got - want).abs() < 5e-5, "{file}: spacing {:?}, not {spacing:?}", read.header.grid.spacing);
    }
    assert_eq!(digest, sha, "{file}");
    Some(read.header)
}

#[test]
fn frog_is_read_though_its_header_lies_about_the_compressed_size() {
    let header =
        check("frogtissue/frogtissue.mhd", SampleType::U8, [500, 470, 136], [1.0, 1.0, 1.5], "c8e8ece072131691");
    if let Some(header) = header {
        // ITK's world is L, P, S: half a turn from R, A, S, so never mirrored.
        assert_eq!(header.grid.direction, [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!((header.name.as_str(), header.format), ("frogtissue.mhd", "MetaImage"));
    }
}

#[test]
fn iron_protein_is_read_across_the_blank_line_before_binary() {
    check("ironProt/ironProt.vtk", SampleType::U8, [68; 3], [1.0; 3], "e55377a16495bebf");
}

#[test]
fn ct_head_is_read_from_93_files_and_not_mirrored() {
    let file = "headsq-quarter/quarter.nhdr";
    if let Some(header) = check(file, SampleType::I16, [64, 64, 93], [3.2, 3.2, 1.5], "74011a3339b1a56c") {
        // The file's world is left-handed, so one axis is turned.
        assert_eq!(header.grid.direction, [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    }
}

#[test]
fn engine_is_read() {
    check("scivis-engine/engine.nii.gz", SampleType::U8, [256, 256, 128], [1.0; 3], "0824611d5656143e");
}

#[test]
fn fuel_is_read() {
    check("scivis-fuel/fuel.nii.gz", SampleType::U8, [64, 33, 32], [1.0; 3], "ea73d22cc91396d4");
}

#[test]
fn mr_head_is_read_with_its_scaling() {
    let spacing = [1.0, 0.8984, 0.8984];
    if let Some(header) = check("seg3d-MR/MR.nii.gz", SampleType::U8, [160, 232, 160], spacing, "2ac9c1b3d9324082") {
        assert!((header.slope - 2.007_843_255_996_704).abs() < 1e-12, "{}", header.slope);
        assert_eq!(header.grid.unit.as_deref(), Some("mm"));
        assert!((header.grid.origin[0] + 388.26).abs() < 1e-4, "{:?}", header.grid.origin);
    }
}

#[test]
fn stroke_is_read_with_its_oblique_axes() {
    let file = "stroke-T1/T1.nii.gz";
    if let Some(header) = check(file, SampleType::U8, [124, 160, 140], [1.0; 3], "1713e30068d66d0a") {
        let x = header.grid.direction[0];
        assert!((x[0] - 0.993_592).abs() < 1e-5 && (x[2] + 0.101_51).abs() < 1e-5, "{x:?}");
    }
}

#[test]
fn carotid_is_read_and_its_vectors_are_left_alone() {
    let file = "carotid/carotid.vtk";
    if let Some(header) = check(file, SampleType::F32, [76, 49, 45], [1.0; 3], "9a675d4040f6ce60") {
        assert_eq!(header.grid.origin, [100.0, 80.0, 1.0]);
    }
}

#[test]
fn hydrogen_is_read_from_its_blocks() {
    check("hydrogen/hydrogen.vti", SampleType::F32, [64; 3], [1.0; 3], "789756a94c4e8b43");
}

#[test]
fn atlas_is_read() {
    let file = "allen-human-atlas/AllenAtlas.nii.gz";
    check(file, SampleType::U8, [318, 388, 310], [0.5; 3], "53b416553526ed31");
}

#[test]
fn first_of_two_volumes_is_read_behind_a_header_extension() {
    let file = "nifti-zarr/tests/data/example4d.nii.gz";
    check(file, SampleType::I16, [128, 96, 24], [2.0, 2.0, 2.2], "c375bdf18eba0821");
}

#[test]
fn a_dicom_series_of_192_files_is_stacked() {
    if let Some(header) = check("SAG-anon", SampleType::U16, [256, 256, 192], [0.8594, 0.8594, 0.9], "810caf7501483436")
    {
        // A sagittal head: x runs to the back, y to the feet, z to the patient's right.
        let [x, y, z] = header.grid.direction;
        assert!(x[1] < -0.9 && y[2] < -0.9 && z[0] > 0.9, "{:?}", header.grid.direction);
        assert_eq!((header.slope, header.intercept, header.grid.unit.as_deref()), (1.0, 0.0, Some("mm")));
    }
}

#[test]
fn a_nifti_zarr_is_read_as_the_file_that_it_was_made_from() {
    let folder = "nifti-zarr/tests/data/";
    let file = |name: &str| format!("{folder}{name}");
    let (dims, spacing, sha) = ([128, 96, 24], [2.0, 2.0, 2.2], "c375bdf18eba0821");
    let Some(made) = check(&file("example4d.nii.zarr"), SampleType::I16, dims, spacing, sha) else { return };
    let from = check(&file("example4d.nii.gz"), SampleType::I16, dims, spacing, sha).expect("the folder is here");
    assert_eq!(made.grid, from.grid);
    assert_eq!((made.slope, made.intercept, made.format), (from.slope, from.intercept, "OME-Zarr"));
}
