//! Scenes and cameras of the tests on graphics devices.

use adjsplat::build::Built;
use adjsplat::classify::TransferFunction;
use adjsplat::splat::{Camera, Orbit, Projection};
use adjsplat::volume::SampleType;
use adjsplat_tests::scenes::{Draw as _, built, fitting, transfer};

/// Shaded layers, more opaque where the value changes quickly.
pub(crate) const EDGES: &str = r##"{ "kind": "points", "shaded": true, "points": [
    { "value": 100, "colour": "#ff2010", "opacity": 0.1 },
    { "value": 128, "colour": "#20c040", "opacity": 0.6 },
    { "value": 156, "colour": "#2030ff", "opacity": 0.1 }],
    "gradient": [ { "magnitude": 2, "factor": 0.2 }, { "magnitude": 20, "factor": 1 }] }"##;

/// A phantom in three lanes; `bits` of values, and of normals where the transfer function is shaded.
pub(crate) fn phantom(name: &str, dims: [u64; 3], spacing: [f64; 3], transfer: TransferFunction, bits: u8) -> Built {
    let sample_type = if bits == 8 { SampleType::U8 } else { SampleType::U16 };
    let mut source = adjsplat_tests::scenes::phantom(name, dims, sample_type, spacing);
    built(&mut *source, &fitting(transfer, bits))
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

pub(crate) fn zoomed(
    built: &Built,
    azimuth: f64,
    elevation: f64,
    fov: Option<f64>,
    zoom: f64,
    size: [u32; 2],
) -> Camera {
    built.camera(Orbit { azimuth, elevation, fov, zoom, ..Orbit::default() }, size)
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
