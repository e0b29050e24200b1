//! Where pictures differ.

use adjsplat::splat::{Camera, Code, Frame, Scene, Settings, cpu};

/// The machine code that draws the processor's pictures.
const CODE: Code = Code::Best;

/// Draws a picture on the processor.
pub(crate) fn drawn(scene: &Scene, camera: &Camera, settings: &Settings) -> Frame {
    cpu::render(scene, camera, &settings.clone().with_code(CODE)).unwrap().0
}

/// Largest difference of a sample, and where: column and row.
pub(crate) fn worst(got: &Frame, want: &Frame) -> (f32, [u32; 2]) {
    let apart = got.pixels().iter().zip(want.pixels()).map(|(a, b)| (a - b).abs());
    let (place, worst) = apart.enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap();
    let pixel = (place / 4) as u32;
    (worst, [pixel % got.size()[0], pixel / got.size()[0]])
}
