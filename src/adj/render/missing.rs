//! Warns if a picture shows places where hidden voxels were removed from the file.

use serde::Deserialize;
use serde_json::{Map, Value};

use adjsplat::arena::Arena;
use adjsplat::error::Result;
use adjsplat::splat::{Camera, Mode, Settings, View};
use adjsplat::traverse::Viewpoint;
use adjsplat_judge::hidden::CLEARANCE;

/// What the description of a file without its hidden voxels has.
#[derive(Deserialize)]
struct Hidden {
    #[serde(rename = "hidden_voxels")]
    _record: Map<String, Value>,
}

/// Returns why the picture may show places where hidden voxels were removed from the file, as part of a warning.
/// Returns `None` if the picture shows no such place.
pub(super) fn shows_missing_voxels(
    arena: &Arena,
    settings: &Settings,
    transfer_given: bool,
    camera: &Camera,
) -> Result<Option<&'static str>> {
    if serde_json::from_slice::<Hidden>(arena.description()).is_err() {
        return Ok(None);
    }
    if settings.mode != Mode::Composite {
        return Ok(Some("this mode shows"));
    }
    if transfer_given {
        return Ok(Some("another transfer function may show"));
    }
    let Some((low, high)) = arena.lanes().next().and_then(|lane| lane.bounds()) else { return Ok(None) };
    if settings.crop.is_some_and(|crop| (0..3).any(|a| crop.low[a] > low[a] || crop.high[a] < high[a])) {
        return Ok(Some("a crop may show"));
    }
    if settings.clip.is_some() {
        return Ok(Some("a clip plane may show"));
    }
    let view = View::new(camera, &arena.facts().grid, settings.size, settings.kernel(), None)?;
    let spacing = arena.facts().grid.spacing;
    let coarsest = spacing.into_iter().fold(0.0, f64::max);
    let near = spacing.map(|step| CLEARANCE * coarsest / step);
    let inside = match view.viewpoint {
        Viewpoint::Parallel { .. } => false,
        Viewpoint::Perspective { eye, .. } => {
            (0..3).all(|a| (f64::from(low[a]) - near[a]..=f64::from(high[a]) + near[a]).contains(&eye[a]))
        }
    };
    Ok(inside.then_some("an eye inside or near may show"))
}
