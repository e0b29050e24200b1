//! Lighting: Blinn-Phong with two-sided normals and a light that moves with the camera.
//!
//! In: a unit normal and a unit vector toward the eye, both by index axis. Out: a factor on the voxel's colour and a
//! white highlight to add. Both sides of a surface are lit alike: cosines count without their sign, so that light is a
//! continuous function of the normal. (Were normals turned toward the eye, a normal across the view would make light
//! jump by half; a rounded code could turn it.) A voxel without a normal keeps its colour as it is: its ambient weight is 1.

use serde::{Deserialize, Serialize};

use super::arith::{at_least, keep_if};
use super::view::View;
use crate::error::{Error, Result};

/// Weights of the lighting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lighting {
    /// Light from everywhere, 0 to 1.
    pub ambient: f32,
    /// Light by the cosine to the light's direction, 0 to 1.
    pub diffuse: f32,
    /// Highlight, 0 to 1.
    pub specular: f32,
    /// Exponent of the highlight, 1 to 255: larger is glossier.
    pub shininess: u8,
    /// Toward the light: right, up, toward the viewer. Finite, not 0.
    pub toward_light: [f64; 3],
}

impl Default for Lighting {
    fn default() -> Lighting {
        Lighting { ambient: 0.25, diffuse: 0.75, specular: 0.2, shininess: 24, toward_light: [-0.35, 0.45, 1.0] }
    }
}

impl Lighting {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Input`] if a number is outside its range.
    pub fn check(&self) -> Result<()> {
        let weights = [("ambient", self.ambient), ("diffuse", self.diffuse), ("specular", self.specular)];
        for (name, weight) in weights {
            if !(0.0..=1.0).contains(&weight) {
                return Err(Error::input(format!("lighting {name}"), format!("is {weight}, but must be 0 to 1")));
            }
        }
        if self.shininess == 0 {
            return Err(Error::input("lighting shininess", "is 0, but must be 1 to 255"));
        }
        let light = glam::DVec3::from_array(self.toward_light);
        if light.is_finite() && light.try_normalize().is_some() {
            Ok(())
        } else {
            Err(Error::input("light direction", format!("is {:?}, but must be finite and not 0", self.toward_light)))
        }
    }
}

/// The lighting of a view, by index axis.
#[derive(Debug, Clone, Copy)]
pub struct Lights {
    pub(crate) ambient: f32,
    pub(crate) diffuse: f32,
    pub(crate) specular: f32,
    pub(crate) shininess: u8,
    pub(crate) light: [f32; 3],
    /// Toward the eye of a parallel view.
    pub(crate) eye: [f32; 3],
}

impl Lights {
    /// The lighting in a view's axes; `lighting` is checked.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    pub(crate) fn new(lighting: &Lighting, view: &View) -> Lights {
        let [right, up, forward] = view.axes.map(glam::DVec3::from_array);
        let [x, y, z] = lighting.toward_light;
        let light = (right * x + up * y - forward * z).normalize_or_zero();
        let eye = (-forward).normalize_or_zero();
        let single = |vector: glam::DVec3| vector.to_array().map(|c| c as f32);
        Lights {
            ambient: lighting.ambient,
            diffuse: lighting.diffuse,
            specular: lighting.specular,
            shininess: lighting.shininess,
            light: single(light),
            eye: single(eye),
        }
    }

    /// Factor on the colour, and highlight, for a normal (zero for none) and the unit vector toward the eye.
    #[inline(always)]
    pub(crate) fn shade(&self, normal: [f32; 3], eye: [f32; 3]) -> [f32; 2] {
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let half = [self.light[0] + eye[0], self.light[1] + eye[1], self.light[2] + eye[2]];
        let half_length = at_least(dot(half, half), 1e-12).sqrt();
        let lit = dot(normal, self.light).abs();
        let glance = (dot(normal, half) / half_length).abs();
        // The exponent's bits are the same for all voxels, so that this too runs side by side.
        let (mut power, mut square) = (1.0, glance);
        for bit in 0..8 {
            if self.shininess >> bit & 1 == 1 {
                power *= square;
            }
            square *= square;
        }
        let has_normal = dot(normal, normal) > 0.5;
        let factor = self.ambient + self.diffuse * lit;
        [1.0 + keep_if(has_normal, factor - 1.0), keep_if(has_normal, self.specular * power)]
    }
}
