//! Lighting in double precision: two-sided Blinn-Phong, like the renderers' lighting.

use glam::DVec3;

use super::voxels::ReferenceVoxel;
use adjsplat::splat::{Lighting, View};
use adjsplat::traverse::Viewpoint;

/// The lighting of a view; directions are along the grid's axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReferenceLights {
    lighting: Lighting,
    toward_light: DVec3,
    /// The direction toward the eye, for parallel views.
    toward_eye: DVec3,
    /// The position of the eye in mean spacings; `None` for a parallel view.
    eye: Option<DVec3>,
    /// The distance between neighbouring voxels on each axis, in mean spacings.
    steps: DVec3,
}

impl ReferenceLights {
    pub(super) fn new(lighting: Lighting, view: &View) -> ReferenceLights {
        let [right, up, forward] = view.axes.map(DVec3::from_array);
        let [x, y, z] = lighting.toward_light;
        let is_perspective = matches!(view.viewpoint, Viewpoint::Perspective { .. });
        ReferenceLights {
            lighting,
            toward_light: (right * x + up * y - forward * z).normalize_or_zero(),
            toward_eye: -forward.normalize_or_zero(),
            eye: is_perspective.then(|| DVec3::from_array(view.eye_scaled)),
            steps: DVec3::from_array(view.steps),
        }
    }

    /// Returns the lit colour of a voxel in linear light; with a highlight it may exceed 1.
    pub(super) fn lit(&self, voxel: &ReferenceVoxel) -> [f64; 3] {
        let colour = voxel.colour.map(f64::from);
        let normal = DVec3::from_array(voxel.normal);
        if normal == DVec3::ZERO {
            return colour;
        }
        let place = self.steps * DVec3::from_array(voxel.position.map(f64::from));
        let toward_eye = self.eye.map_or(self.toward_eye, |eye| (eye - place).normalize_or_zero());
        let halfway = (self.toward_light + toward_eye).normalize_or_zero();
        let Lighting { ambient, diffuse, specular, shininess, .. } = self.lighting;
        let factor = f64::from(ambient) + f64::from(diffuse) * normal.dot(self.toward_light).abs();
        let highlight = f64::from(specular) * normal.dot(halfway).abs().powi(shininess.into());
        colour.map(|c| c * factor + highlight)
    }
}
