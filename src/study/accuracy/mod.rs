//! Accuracy: what each setting of the renderer saves in time and costs in error.
//!
//! In: a [`JudgedSet`], which is a volume's reference renderer and files built from the volume; views; candidates. Out:
//! each candidate's time, its error against the reference, and the candidates that no other beats in both. Submodules
//! also measure how much pictures [pop](popping) where the order switches, and the [three parts](model) of the error.
//!
//! ```text
//! volume -> judge -> picture of each view, in double precision --\
//!        \-> files -> every candidate's picture of each view ----> metrics -> front of (time, PSNR)
//! ```
//!
//! Errors are measured first, on all threads, as pictures do not depend on the number of threads. Then candidates are
//! timed in turns on one thread, so that changes of the machine's speed affect all; the fastest round counts.

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
use adjsplat::splat::{Camera, Frame, Scene, cpu};
use adjsplat_judge::reference::Judge;

/// A file of a set, with the bits of its values and normals.
#[derive(Debug, Clone, Copy)]
pub struct StoredFile<'a> {
    /// Bits of a value: 8 or 16.
    pub value_bits: u8,
    /// Bits of each component of a normal: 0 for none, 8 or 16.
    pub normal_bits: u8,
    /// The scene in the file.
    pub scene: Scene<'a>,
}

/// A volume under study, with its reference renderer and files.
#[derive(Debug)]
pub struct JudgedSet<'a> {
    /// The set's name in tables.
    pub name: &'a str,
    /// The reference renderer of the volume.
    pub judge: &'a Judge,
    /// Files built from the volume, all with different channels.
    pub files: Vec<StoredFile<'a>>,
    /// The file with 8-bit values and normals, for the octree; `None` draws no octree.
    pub subject: Option<&'a Subject<'a>>,
}

impl<'a> JudgedSet<'a> {
    /// Returns the scene of the file whose values and normals have these bits.
    ///
    /// # Errors
    /// [`Error::Input`] if the set has no such file.
    pub fn file(&self, value_bits: u8, normal_bits: u8) -> Result<Scene<'a>> {
        let found = self.files.iter().find(|file| (file.value_bits, file.normal_bits) == (value_bits, normal_bits));
        found.map(|file| file.scene).ok_or_else(|| {
            let why = format!("has no file with values of {value_bits} and normals of {normal_bits} bits");
            Error::input(self.name, why)
        })
    }

    /// Draws a candidate's picture with the renderer.
    fn render(&self, candidate: &Candidate, camera: &Camera, size: [u32; 2], threads: usize) -> Result<Frame> {
        let scene = self.file(candidate.value_bits, candidate.normal_bits)?;
        let settings = candidate.settings(camera, self.judge.visible().grid(), size)?.with_threads(threads);
        let settings = settings.with_stop(self.judge.stop().cloned());
        Ok(cpu::render(&scene, camera, &settings)?.0)
    }

    /// Returns whether the set has the file that `candidate` draws.
    pub fn can_draw(&self, candidate: &Candidate) -> bool {
        match candidate.drawer {
            Drawer::Renderer => self.file(candidate.value_bits, candidate.normal_bits).is_ok(),
            Drawer::Octree(_) => self.subject.is_some(),
        }
    }
}
