//! Scenes and cameras that the tests share.

use std::path::{Path, PathBuf};

use adjsplat::arena::TileOrder;
use adjsplat::build::{BuildOptions, Built, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Camera, Orbit, Projection, Scene, Surround};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{SampleType, SlabSource};
use adjsplat_readers::open;

use crate::device::say;

/// Red to blue by value, opaque enough that order matters.
pub(crate) const LAYERS: &str = r##"{ "kind": "points", "shaded": true, "points": [
    { "value": 100, "colour": "#ff2010", "opacity": 0.1 },
    { "value": 128, "colour": "#20c040", "opacity": 0.6 },
    { "value": 156, "colour": "#2030ff", "opacity": 0.1 }] }"##;

/// The same, more so where the value changes quickly.
pub(crate) const EDGES: &str = r##"{ "kind": "points", "shaded": true, "points": [
    { "value": 100, "colour": "#ff2010", "opacity": 0.1 },
    { "value": 128, "colour": "#20c040", "opacity": 0.6 },
    { "value": 156, "colour": "#2030ff", "opacity": 0.1 }],
    "gradient": [ { "magnitude": 2, "factor": 0.2 }, { "magnitude": 20, "factor": 1 }] }"##;

/// A transfer function from its text.
pub(crate) fn transfer(text: &str) -> TransferFunction {
    TransferFunction::from_json(text).unwrap()
}

/// A phantom in three lanes; `bits` of values, and of normals where the transfer function is shaded.
pub(crate) fn phantom(name: &str, dims: [u64; 3], spacing: [f64; 3], transfer: TransferFunction, bits: u8) -> Built {
    let sample_type = if bits == 8 { SampleType::U8 } else { SampleType::U16 };
    let mut source = Phantom::from_name(name).unwrap().open(dims, sample_type, spacing).unwrap();
    built(&mut *source, transfer, bits)
}

/// A solid block, each voxel of `opacity`.
pub(crate) fn block(dims: [u64; 3], colour: &str, opacity: f64) -> Built {
    let text = format!(
        r#"{{ "kind": "points", "shaded": false, "points": [
            {{ "value": 0, "colour": "{colour}", "opacity": {opacity} }},
            {{ "value": 255, "colour": "{colour}", "opacity": {opacity} }}] }}"#
    );
    phantom("constant", dims, [1.0; 3], transfer(&text), 8)
}

pub(crate) fn built(source: &mut dyn SlabSource, transfer: TransferFunction, bits: u8) -> Built {
    let normal_bits = if transfer.shaded() { bits } else { 0 };
    let tile_order = TileOrder::Morton;
    let options = BuildOptions { transfer, lane_count: 3, tile_order, value_bits: bits, normal_bits };
    build(source, &options, &mut Unobserved).unwrap()
}

/// A built structure as a scene.
pub(crate) fn scene(built: &Built) -> Scene<'_> {
    Scene { facts: &built.facts, lanes: &built.lanes, transfer: &built.transfer }
}

/// A camera on an orbit around all of the grid.
pub(crate) fn orbit(built: &Built, azimuth: f64, elevation: f64, fov: Option<f64>, size: [u32; 2]) -> Camera {
    zoomed(built, azimuth, elevation, fov, 1.0, size)
}

pub(crate) fn zoomed(
    built: &Built,
    azimuth: f64,
    elevation: f64,
    fov: Option<f64>,
    zoom: f64,
    size: [u32; 2],
) -> Camera {
    let around = Surround::of_grid(&built.facts.grid);
    Camera::orbiting(Orbit { azimuth, elevation, fov, zoom, ..Orbit::default() }, around, size).unwrap()
}

/// A camera at a place of the grid, in voxels, that looks along `toward`, in voxels.
pub(crate) fn inside(built: &Built, eye: [f64; 3], toward: [f64; 3]) -> Camera {
    let grid = &built.facts.grid;
    let world = |at: [f64; 3]| -> [f64; 3] {
        let along = |a: usize| at[a] * grid.spacing[a];
        std::array::from_fn(|c| grid.origin[c] + (0..3).map(|a| grid.direction[a][c] * along(a)).sum::<f64>())
    };
    let target = std::array::from_fn(|a| eye[a] + toward[a]);
    Camera::new(world(eye), world(target), [0.1, 0.2, 1.0], Projection::Perspective { fov: 75.0 }).unwrap()
}

/// Real volumes with what to show of them; none, said loudly, where they are not at hand.
pub(crate) fn real_volumes() -> Vec<(PathBuf, TransferFunction)> {
    let folder = adjsplat_tests::repository().join("../shared/data");
    if !folder.is_dir() {
        say(&format!("SKIPPED: {} is not there", folder.display()));
        return Vec::new();
    }
    let contours = r##"{ "kind": "contour", "contours": [
        { "value": 30, "opacity": 0.25, "colour": "#6fa8dc" }, { "value": 128, "opacity": 0.95, "colour": "#e69138" }] }"##;
    let range = |low: f64| TransferFunction::range(low, f64::INFINITY).unwrap();
    let preset = |name: &str| TransferFunction::preset(name).unwrap();
    let sets = [
        ("frogtissue/frogtissue.mhd", preset("frog")),
        ("ironProt/ironProt.vtk", transfer(contours)),
        ("headsq-quarter/quarter.nhdr", preset("ct-bone+1024")),
        ("SAG-anon", range(400.0)),
        ("scivis-engine/engine.nii.gz", range(180.0)),
        ("scivis-fuel/fuel.nii.gz", range(20.0)),
        ("carotid/carotid.vtk", range(150.0)),
        ("hydrogen/hydrogen.vti", range(0.05)),
        ("allen-human-atlas/AllenAtlas.nii.gz", range(138.0)),
        ("nifti-zarr/tests/data/example4d.nii.gz", range(400.0)),
        ("seg3d-MR/MR.nii.gz", range(200.0)),
        ("stroke-T1/T1.nii.gz", range(180.0)),
    ];
    sets.map(|(file, transfer)| (folder.join(file), transfer)).to_vec()
}

/// A real volume, 8-bit values and normals.
pub(crate) fn real(path: &Path, transfer: TransferFunction) -> Built {
    built(&mut *open::open(path, &open::OpenOptions::default()).unwrap(), transfer, 8)
}
