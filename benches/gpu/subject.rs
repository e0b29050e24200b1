//! The scenes of the study: phantoms built on the spot ("gyroid:512"), or .adj files.

use std::path::Path;

use adjsplat::arena::LaneSet;
use adjsplat::arena::layout::Facts;
use adjsplat::build::{BuildOptions, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::file::AdjFile;
use adjsplat::splat::{Camera, Orbit, Scene, Surround};
use adjsplat::volume::phantom::Phantom;
use adjsplat::volume::{Axis, SampleType};

/// A scene with its name, and what a turn around it needs.
pub(crate) struct BenchScene<'a> {
    pub(crate) name: String,
    pub(crate) scene: Scene<'a>,
    around: Surround,
}

impl BenchScene<'_> {
    /// Returns the camera of view `index` of `count` of a turn, in perspective.
    pub(crate) fn camera(&self, index: usize, count: usize, size: [u32; 2]) -> Camera {
        let azimuth = 360.0 * index as f64 / count as f64 + 10.0;
        let orbit = Orbit { azimuth, elevation: 20.0, fov: Some(30.0), ..Orbit::default() };
        Camera::orbiting(orbit, self.around, size).expect("a sound orbit")
    }
}

/// Calls `with` with the scene of that name.
pub(crate) fn with_scene(name: &str, with: &mut dyn FnMut(&BenchScene)) -> Result<(), String> {
    if let Some((phantom, side)) = name.split_once(':') {
        let phantom = Phantom::from_name(phantom).map_err(|fault| fault.to_string())?;
        let side: u64 = side.parse().map_err(|_| format!("\"{name}\" has no side, as gyroid:512 has"))?;
        let (low, high) = phantom.visible_range();
        let options = BuildOptions::new(TransferFunction::range(low, high).map_err(|fault| fault.to_string())?)
            .with_normal_bits(8);
        let built = phantom
            .open([side; 3], SampleType::U8, [1.0; 3])
            .and_then(|mut source| build(&mut *source, &options, &mut Unobserved))
            .map_err(|fault| fault.to_string())?;
        let bounds = built.lanes[0].view().bounds();
        with(&subject(
            format!("{} {side}^3", phantom.name()),
            &built.facts,
            bounds,
            Scene { facts: &built.facts, lanes: &built.lanes, transfer: &built.transfer },
        ));
        return Ok(());
    }
    let path = Path::new(name);
    let file = AdjFile::open(path).map_err(|fault| fault.to_string())?;
    let arena = file.arena().map_err(|fault| fault.to_string())?;
    let description: serde_json::Value =
        serde_json::from_slice(arena.description()).map_err(|fault| format!("{name}: {fault}"))?;
    let transfer: TransferFunction = serde_json::from_value(description["transfer_function"].clone())
        .map_err(|fault| format!("{name} stores no transfer function: {fault}"))?;
    let facts = arena.facts().clone();
    let lanes = LaneSet::new(arena, None);
    let bounds = lanes.lane(Axis::X).map_err(|fault| fault.to_string())?.bounds();
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    with(&subject(stem, &facts, bounds, Scene { facts: &facts, lanes: &lanes, transfer: &transfer }));
    Ok(())
}

fn subject<'a>(name: String, facts: &Facts, bounds: Option<([u16; 3], [u16; 3])>, scene: Scene<'a>) -> BenchScene<'a> {
    let grid = &facts.grid;
    let around = match bounds {
        Some((low, high)) => Surround::of_voxels(grid, low, high),
        None => Surround::of_grid(grid),
    };
    BenchScene { name, scene, around }
}
