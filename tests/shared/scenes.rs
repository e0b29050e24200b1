//! Structures in memory, cameras around them, and pictures of them.

use std::path::{Path, PathBuf};

use adjsplat::arena::Channels;
use adjsplat::arena::Record;
use adjsplat::arena::layout::{Facts, Scales};
use adjsplat::arena::{OwnedLane, TileOrder};
use adjsplat::build::{BuildOptions, Built, SampleSummary, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::internals::LanePacker;
use adjsplat::internals::transpose;
use adjsplat::splat::{Camera, Frame, Orbit, Scene, Settings, Stats, Surround, cpu};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, Grid, SampleType, SlabSource};
use adjsplat_readers::open::{OpenOptions, open};

use crate::files::real_volume;

/// Values in 8 bits and nothing else.
pub const PLAIN: Channels =
    Channels { value_bits: 8, normal_bits: 0, magnitude_bits: 0, coverage_bits: 0, coherence: false };
/// Values and normals in 8 bits: what a build gives by default.
pub const LIT: Channels =
    Channels { value_bits: 8, normal_bits: 8, magnitude_bits: 0, coverage_bits: 0, coherence: false };
/// Every channel at its widest.
pub const WIDE: Channels =
    Channels { value_bits: 16, normal_bits: 16, magnitude_bits: 8, coverage_bits: 0, coherence: false };
/// Values and normals in 8 bits, coverages and coherences: what a level of detail has.
pub const COVERED: Channels =
    Channels { value_bits: 8, normal_bits: 8, magnitude_bits: 0, coverage_bits: 8, coherence: true };

/// A value is its code.
pub const CODES: Scales = Scales { value_low: 0.0, value_step: 1.0, magnitude_scale: 1.0 };

/// A transfer function for the gyroid, not shaded: red to blue by value, opaque enough that order matters.
pub const LAYERS: &str = r##"{ "kind": "points", "shaded": false, "points": [
    { "value": 100, "colour": "#ff2010", "opacity": 0.1 },
    { "value": 128, "colour": "#20c040", "opacity": 0.6 },
    { "value": 156, "colour": "#2030ff", "opacity": 0.1 }] }"##;

/// As [`LAYERS`], shaded.
pub const LIT_LAYERS: &str = r##"{ "kind": "points", "shaded": true, "points": [
    { "value": 100, "colour": "#ff2010", "opacity": 0.1 },
    { "value": 128, "colour": "#20c040", "opacity": 0.6 },
    { "value": 156, "colour": "#2030ff", "opacity": 0.1 }] }"##;

/// Returns the transfer function of a JSON text.
pub fn transfer(json: &str) -> TransferFunction {
    TransferFunction::from_json(json).unwrap()
}

/// Returns a transfer function that shows samples from `low` on.
pub fn at_least(low: f64) -> TransferFunction {
    TransferFunction::range(low, f64::INFINITY).unwrap()
}

/// Opens a phantom as a volume.
pub fn phantom(name: &str, dims: [u64; 3], sample_type: SampleType, spacing: [f64; 3]) -> Box<dyn SlabSource> {
    Phantom::from_name(name).unwrap().open(dims, sample_type, spacing).unwrap()
}

/// Opens the volume of a file.
pub fn volume(path: &Path) -> Box<dyn SlabSource> {
    open(path, &OpenOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns real volumes with what to show of them; none where they are not at hand.
pub fn real_volumes() -> Vec<(PathBuf, TransferFunction)> {
    let contours = r##"{ "kind": "contour", "contours": [
        { "value": 30, "opacity": 0.25, "colour": "#6fa8dc" }, { "value": 128, "opacity": 0.95, "colour": "#e69138" }] }"##;
    let preset = |name: &str| TransferFunction::preset(name).unwrap();
    let volumes = [
        ("frogtissue/frogtissue.mhd", preset("frog")),
        ("ironProt/ironProt.vtk", transfer(contours)),
        ("headsq-quarter/quarter.nhdr", preset("ct-bone+1024")),
        ("carotid/carotid.vtk", at_least(150.0)),
        ("SAG-anon", at_least(400.0)),
        ("scivis-engine/engine.nii.gz", at_least(180.0)),
        ("scivis-fuel/fuel.nii.gz", at_least(20.0)),
        ("hydrogen/hydrogen.vti", at_least(0.05)),
        ("allen-human-atlas/AllenAtlas.nii.gz", at_least(138.0)),
        ("nifti-zarr/tests/data/example4d.nii.gz", at_least(400.0)),
        ("seg3d-MR/MR.nii.gz", at_least(200.0)),
        ("stroke-T1/T1.nii.gz", at_least(180.0)),
    ];
    volumes.into_iter().filter_map(|(file, transfer)| Some((real_volume(file)?, transfer))).collect()
}

/// Returns options for three lanes with values and normals in 8 bits.
pub fn options(transfer: TransferFunction) -> BuildOptions {
    BuildOptions::new(transfer).with_normal_bits(8)
}

/// Returns options for three lanes with values in `bits`, and normals too where the transfer function is shaded.
pub fn fitting(transfer: TransferFunction, bits: u8) -> BuildOptions {
    let normal_bits = if transfer.shaded() { bits } else { 0 };
    options(transfer).with_value_bits(bits).with_normal_bits(normal_bits)
}

/// Builds the lanes of a volume.
pub fn built(source: &mut dyn SlabSource, options: &BuildOptions) -> Built {
    build(source, options, &mut Unobserved).unwrap_or_else(|error| panic!("{error}"))
}

/// Returns a shaded transfer function for a phantom: red at its lowest visible value to blue at its highest.
pub fn red_to_blue(name: &str, [red, blue]: [f64; 2]) -> TransferFunction {
    let (low, high) = Phantom::from_name(name).unwrap().visible_range();
    transfer(&format!(
        r##"{{ "kind": "points", "shaded": true, "points": [
            {{ "value": {low}, "colour": "#ff4020", "opacity": {red} }},
            {{ "value": {high}, "colour": "#2060ff", "opacity": {blue} }}] }}"##
    ))
}

/// Builds a phantom of bytes from red to blue, with these opacities.
pub fn built_phantom(name: &str, dims: [u64; 3], opacities: [f64; 2]) -> Built {
    built(&mut *phantom(name, dims, SampleType::U8, [1.0; 3]), &options(red_to_blue(name, opacities)))
}

/// Packs the lane along an axis, line by line, of the voxels that `record` gives a record.
pub fn lane(
    axis: Axis,
    dims: [u32; 3],
    channels: Channels,
    tile_order: TileOrder,
    record: impl Fn([u16; 3]) -> Option<Record>,
) -> OwnedLane {
    let mut packer = LanePacker::new(axis, dims, channels, tile_order);
    let ([u_axis, v_axis], along) = (axis.others().map(Axis::index), axis.index());
    let dims = dims.map(|points| u16::try_from(points).expect("grids have at most 65,535 points an axis"));
    for (v, u) in (0..dims[v_axis]).flat_map(|v| (0..dims[u_axis]).map(move |u| (v, u))) {
        let voxel = |c| {
            let mut at = [0; 3];
            (at[along], at[u_axis], at[v_axis]) = (c, u, v);
            record(at).map(|record| (c, record))
        };
        let mut voxels = (0..dims[along]).filter_map(voxel).peekable();
        if voxels.peek().is_some() {
            packer.line(u, v, voxels);
        }
    }
    packer.finish()
}

/// Packs the voxels that `record` gives a record into three lanes; their values are their codes.
pub fn packed(
    grid: Grid,
    channels: Channels,
    transfer: TransferFunction,
    record: impl Fn([u16; 3]) -> Option<Record>,
) -> Built {
    let tile_order = TileOrder::Morton;
    let x = lane(Axis::X, grid.dims, channels, tile_order, record);
    let visible_voxels = x.view().record_count() - x.view().stepping_voxels();
    let derived = [Axis::Y, Axis::Z].map(|axis| transpose(&x.view(), axis, tile_order));
    let facts = Facts { grid, channels, tile_order, scales: CODES, visible_voxels };
    Built { facts, lanes: std::iter::once(x).chain(derived).collect(), transfer, samples: SampleSummary::default() }
}

/// What tests draw of a structure.
pub trait Draw {
    /// Returns the structure as a scene.
    fn scene(&self) -> Scene<'_>;

    /// Returns the sphere around the grid.
    fn surround(&self) -> Surround;

    /// Returns a camera on an orbit around the grid.
    fn camera(&self, orbit: Orbit, size: [u32; 2]) -> Camera {
        Camera::orbiting(orbit, self.surround(), size).unwrap()
    }

    /// Returns a camera that shows all of the grid: parallel, or with a field of view in degrees.
    fn orbit(&self, azimuth: f64, elevation: f64, fov: Option<f64>, size: [u32; 2]) -> Camera {
        self.camera(Orbit { azimuth, elevation, fov, ..Orbit::default() }, size)
    }

    /// Draws on the processor.
    fn render(&self, camera: &Camera, settings: &Settings) -> (Frame, Stats) {
        cpu::render(&self.scene(), camera, settings).unwrap()
    }

    /// Draws on the processor and returns the picture alone.
    fn frame(&self, camera: &Camera, settings: &Settings) -> Frame {
        self.render(camera, settings).0
    }
}

impl Draw for Built {
    fn scene(&self) -> Scene<'_> {
        Scene { facts: &self.facts, lanes: &self.lanes, transfer: &self.transfer }
    }

    fn surround(&self) -> Surround {
        Surround::of_grid(&self.facts.grid)
    }
}
