//! Accuracy: what each knob of the renderer saves in time and costs in error.
//!
//! In: a [`JudgedSet`] set, which is a volume's judge and files built from the same volume; views; candidate settings. Out: for
//! every candidate its time and its distance from the judge's picture, and which candidates no other beats in both. Apart
//! from that: what [popping] the order brings, and how the error falls in [three](model).
//!
//! ```text
//! volume -> judge -> picture of each view, in double precision --\
//!        \-> files -> every candidate's picture of each view ----> metrics -> front of (time, PSNR)
//! ```
//!
//! Errors are measured first, on all threads, for a picture does not depend on their number; times afterwards, one
//! candidate after the other on one thread, round by round, so that a change of the machine's pace meets all of them; the
//! fastest round counts.

mod candidate;
mod family;
mod front;
mod measure;
pub mod model;
pub mod popping;
mod sweep;
mod truth;
mod view;

pub use candidate::Candidate;
use candidate::Drawer;
pub use family::Family;
pub use measure::{Effort, Outcome, mark_front, measure};
pub use sweep::candidates;
pub use view::{JudgedView, views};

use super::subject::Subject;
use adjsplat::error::{Error, Result};
use adjsplat::splat::Scene;
use adjsplat_judge::reference::Judge;

/// A file of a set.
#[derive(Debug, Clone, Copy)]
pub struct StoredFile<'a> {
    /// Bits of a value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each component of a normal: 0 for none, 8 or 16.
    pub normal_bits: u8,
    /// What it shows.
    pub scene: Scene<'a>,
}

/// A set under study.
#[derive(Debug)]
pub struct JudgedSet<'a> {
    /// What tables call it.
    pub name: &'a str,
    /// The judge of the volume.
    pub judge: &'a Judge,
    /// Files built from the volume, no two with the same channels.
    pub files: Vec<StoredFile<'a>>,
    /// The file with 8-bit values and normals as other methods take it; without it no octree is drawn.
    pub subject: Option<&'a Subject<'a>>,
}

impl<'a> JudgedSet<'a> {
    /// The file with these channels.
    ///
    /// # Errors
    /// [`Error::Input`] if the set has none.
    pub fn file(&self, value_bits: u8, normal_bits: u8) -> Result<Scene<'a>> {
        let found = self.files.iter().find(|file| (file.value_bits, file.normal_bits) == (value_bits, normal_bits));
        found.map(|file| file.scene).ok_or_else(|| {
            let why = format!("has no file with values of {value_bits} and normals of {normal_bits} bits");
            Error::input(self.name, why)
        })
    }

    /// Whether the set has what `candidate` draws.
    pub fn can_draw(&self, candidate: &Candidate) -> bool {
        match candidate.drawer {
            Drawer::Renderer => self.file(candidate.value_bits, candidate.normal_bits).is_ok(),
            Drawer::Octree(_) => self.subject.is_some(),
        }
    }
}
