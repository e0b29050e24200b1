//! The bytes of colour and gradient that methods of the year 2001 computed in advance and stored with each voxel.

use crate::Subject;
use crate::subject::VisibleVoxel;
use adjsplat::classify::normal;
use adjsplat::error::Result;

/// The colours of all value codes (stored numbers of values), and whether voxels have normals.
#[derive(Debug, Clone)]
pub(super) struct Appearance {
    /// Linear red, green, blue and opacity of each value code. Boxed, so that structures that hold it stay small.
    colours: Box<[[u8; 4]; 256]>,
    has_normals: bool,
}

impl Appearance {
    /// Computes the colours of a subject's value codes.
    pub(super) fn of(subject: &Subject) -> Result<Appearance> {
        let colours = Box::new(subject.looks()?.map(colour));
        Ok(Appearance { colours, has_normals: subject.facts.channels.normal_bits > 0 })
    }

    /// Returns the voxel's linear red, green, blue and opacity. Opacity is above 0, as 0 marks cells without a visible
    /// voxel.
    pub(super) fn colour(&self, voxel: &VisibleVoxel) -> [u8; 4] {
        self.colours[usize::from(voxel.value)]
    }

    /// Returns the voxel's gradient as a unit vector; zero if it has no normal.
    pub(super) fn gradient(&self, voxel: &VisibleVoxel) -> [f32; 3] {
        if self.has_normals { normal::decode8(voxel.normal) } else { [0.0; 3] }
    }
}

/// Returns the bytes of red, green, blue and opacity of a look (colour and optical depth); opacity is at least 1.
fn colour([red, green, blue, depth]: [f32; 4]) -> [u8; 4] {
    let opacity = 1.0 - (-depth).exp2();
    let [red, green, blue, opacity] = [red, green, blue, opacity].map(byte);
    [red, green, blue, opacity.max(1)]
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte's range")]
fn byte(part: f32) -> u8 {
    (part.clamp(0.0, 1.0) * 255.0).round() as u8
}
