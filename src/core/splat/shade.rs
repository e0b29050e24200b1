//! Lighting: Blinn-Phong with two-sided normals and a light that moves with the camera.
//!
//! In: a unit normal and a unit vector toward the eye, along the grid's axes. Out: a factor on the voxel's colour and a
//! white highlight to add. Both sides of a surface are lit alike: cosines count without their sign, so that light is a
//! continuous function of the normal. (If normals were turned toward the eye, light would jump where a normal is across
//! the view, because rounding can turn it.) A voxel without a normal keeps its colour. A voxel of a level of detail stands for
//! several normals: a share of its light is that of their mean, a share that of no normal; the rest is the mean over all directions.

use serde::{Deserialize, Serialize};

use super::arith::{at_least, keep_if};
use super::require;
use super::view::View;
use crate::classify::normal::Coherence;
use crate::error::Result;

/// The light on voxels, and how they reflect it (Blinn-Phong). The light moves with the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Lighting {
    /// Weight of the light that comes from all directions, 0 to 1.
    pub ambient: f32,
    /// Weight of the light that is proportional to the cosine between normal and light direction, 0 to 1.
    pub diffuse: f32,
    /// Weight of the highlight, 0 to 1.
    pub specular: f32,
    /// Exponent of the highlight, 1 to 255; larger is glossier.
    pub shininess: u8,
    /// Direction toward the light, by its components to the right, up, and toward the viewer. Finite, not 0.
    pub toward_light: [f64; 3],
}

impl Default for Lighting {
    fn default() -> Lighting {
        Lighting { ambient: 0.25, diffuse: 0.75, specular: 0.2, shininess: 24, toward_light: [-0.35, 0.45, 1.0] }
    }
}

impl Lighting {
    /// Checks that all numbers are in their ranges.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) if a number is outside its range.
    pub fn check(&self) -> Result<()> {
        let Lighting { ambient, diffuse, specular, .. } = *self;
        let weights = [("lighting ambient", ambient), ("lighting diffuse", diffuse), ("lighting specular", specular)];
        for (name, weight) in weights {
            require((0.0..=1.0).contains(&weight), name, format_args!("is {weight}, but must be 0 to 1"))?;
        }
        require(self.shininess > 0, "lighting shininess", "is 0, but must be 1 to 255")?;
        let light = glam::DVec3::from_array(self.toward_light);
        let is_direction = light.is_finite() && light.try_normalize().is_some();
        let why = format_args!("is {:?}, but must be finite and not 0", self.toward_light);
        require(is_direction, "light direction", why)
    }
}

/// The lighting of a view; components of vectors are along the grid's axes.
#[derive(Debug, Clone, Copy)]
pub struct Lights {
    pub(crate) lighting: Lighting,
    /// Unit vector toward the light.
    pub(crate) light: [f32; 3],
    /// Unit vector toward the eye of a parallel view.
    pub(crate) eye: [f32; 3],
}

impl Lights {
    /// Creates the lighting of a view; `lighting` must have been checked.
    #[expect(clippy::cast_possible_truncation, reason = "single precision is the renderer's")]
    pub(crate) fn new(lighting: &Lighting, view: &View) -> Lights {
        let [right, up, forward] = view.axes.map(glam::DVec3::from_array);
        let [x, y, z] = lighting.toward_light;
        let light = (right * x + up * y - forward * z).normalize_or_zero();
        let eye = (-forward).normalize_or_zero();
        let single = |vector: glam::DVec3| vector.to_array().map(|c| c as f32);
        Lights { lighting: *lighting, light: single(light), eye: single(eye) }
    }

    /// Returns factors on colours, and highlights, of several voxels, from the x, y and z components of their unit normals
    /// (0 for none) and of unit vectors from them to the eye.
    ///
    /// All voxels take each step together, so that a compiler uses vectors.
    #[inline(always)]
    pub(crate) fn shade<const N: usize>(&self, normals: [&[f32; N]; 3], eyes: &[[f32; N]; 3]) -> [[f32; N]; 2] {
        let Lighting { ambient, diffuse, specular, shininess, .. } = self.lighting;
        let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let normal = |k: usize| [normals[0][k], normals[1][k], normals[2][k]];
        let has_normal = |k: usize| dot(normal(k), normal(k)) > 0.5;
        let (mut factors, mut squares) = ([0.0; N], [0.0; N]);
        for k in 0..N {
            let eye = [eyes[0][k], eyes[1][k], eyes[2][k]];
            let halfway = [self.light[0] + eye[0], self.light[1] + eye[1], self.light[2] + eye[2]];
            let length = at_least(dot(halfway, halfway), 1e-12).sqrt();
            squares[k] = (dot(normal(k), halfway) / length).abs();
            let factor = ambient + diffuse * dot(normal(k), self.light).abs();
            factors[k] = 1.0 + keep_if(has_normal(k), factor - 1.0);
        }
        // The power by repeated squaring: the exponent is the same for all voxels.
        let mut powers = [1.0; N];
        for bit in 0..8 {
            if shininess >> bit & 1 == 1 {
                for k in 0..N {
                    powers[k] *= squares[k];
                }
            }
            squares.iter_mut().for_each(|square| *square *= *square);
        }
        let mut highlights = [0.0; N];
        for k in 0..N {
            highlights[k] = keep_if(has_normal(k), specular * powers[k]);
        }
        [factors, highlights]
    }

    /// Returns the factor and the highlight of a voxel that stands for several normals, from those of their mean.
    #[inline(always)]
    pub(crate) fn scatter(&self, [factor, highlight]: [f32; 2], Coherence { alike, bare }: Coherence) -> [f32; 2] {
        let Lighting { ambient, diffuse, specular, shininess, .. } = self.lighting;
        // The means over all directions of a cosine without its sign, and of a power of it.
        let (cosine, power) = (0.5, 1.0 / (f32::from(shininess) + 1.0));
        let (one, rest) = ((1.0 - bare) * alike, (1.0 - bare) * (1.0 - alike));
        [one * factor + rest * (ambient + diffuse * cosine) + bare, one * highlight + rest * (specular * power)]
    }
}
