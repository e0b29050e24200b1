//! Lighting in double precision: Blinn-Phong with two-sided normals, as `splat/shade.rs` describes it.
//!
//! It is not continuous: a normal seen exactly from the side is turned one way or the other, and the light is elsewhere.
//! So a renderer whose stored normal turns another way may be 7e-3 away at that voxel (tests/reference/renderer.rs).

use glam::DVec3;

use super::voxels::Voxel;
use crate::splat::{Lighting, View};

/// A view's lighting, in the index axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lights {
    lighting: Lighting,
    toward_light: DVec3,
    /// Of a parallel view.
    toward_eye: DVec3,
    /// The eye, in mean voxels; `None` for a parallel view.
    eye: Option<DVec3>,
    /// Distance between voxels on each axis, in mean voxels.
    steps: DVec3,
}

impl Lights {
    pub(super) fn new(lighting: Lighting, view: &View) -> Lights {
        let [right, up, forward] = view.axes.map(DVec3::from_array);
        let [x, y, z] = lighting.toward_light;
        Lights {
            lighting,
            toward_light: (right * x + up * y - forward * z).normalize_or_zero(),
            toward_eye: -forward.normalize_or_zero(),
            eye: view.eye().map(|_| DVec3::from_array(view.eye_scaled)),
            steps: DVec3::from_array(view.steps),
        }
    }

    /// The colour that the eye sees of a voxel, linear; a highlight may take it above 1.
    pub(super) fn lit(&self, voxel: &Voxel) -> [f64; 3] {
        let colour = voxel.colour.map(f64::from);
        let normal = DVec3::from_array(voxel.normal);
        if normal == DVec3::ZERO {
            return colour;
        }
        let place = self.steps * DVec3::from_array(voxel.position.map(f64::from));
        let toward_eye = self.eye.map_or(self.toward_eye, |eye| (eye - place).normalize_or_zero());
        let normal = if normal.dot(toward_eye) < 0.0 { -normal } else { normal };
        let half = (self.toward_light + toward_eye).normalize_or_zero();
        let Lighting { ambient, diffuse, specular, shininess, .. } = self.lighting;
        let factor = f64::from(ambient) + f64::from(diffuse) * normal.dot(self.toward_light).max(0.0);
        let highlight = f64::from(specular) * normal.dot(half).max(0.0).powi(shininess.into());
        colour.map(|c| c * factor + highlight)
    }
}
