//! Both stages, compiled once for each instruction set and chosen when the program runs.
//!
//! The loops are plain arithmetic on arrays, so all versions give the same bits; only the number of voxels or pixels
//! that go side by side differs.

use multiversion::multiversion;

use super::blend::{Additive, Blend, FrontToBack};
use super::planes::Planes;
use super::project::{Kind, Projector, Voxels};
use super::raster;
use super::raster::{EllipseEach, Limits, Splats};
use super::seen::Seen;
use super::stamp;
use crate::splat::Code;
use crate::traverse::Batch;

/// What a band works with.
pub struct Bench {
    pub planes: Planes,
    pub splats: Box<Splats>,
    pub each: Box<EllipseEach>,
    /// Where the splats of a slice are added up before they are composited, if they are.
    pub sheet: Option<Planes>,
}

/// Projects and draws a block of voxels; gives how many splats were drawn.
pub fn block<B: Blend>(code: Code, projector: &Projector, voxels: &Voxels, bench: &mut Bench, limits: Limits) -> u64 {
    match code {
        Code::Best => block_best::<B>(projector, voxels, bench, limits),
        Code::Avx2 => block_avx2::<B>(projector, voxels, bench, limits),
        Code::Portable | Code::Plain => block_any::<B>(projector, voxels, bench, limits),
    }
}

#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn block_best<B: Blend>(projector: &Projector, voxels: &Voxels, bench: &mut Bench, limits: Limits) -> u64 {
    block_any::<B>(projector, voxels, bench, limits)
}

#[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
fn block_avx2<B: Blend>(projector: &Projector, voxels: &Voxels, bench: &mut Bench, limits: Limits) -> u64 {
    block_any::<B>(projector, voxels, bench, limits)
}

/// As [`block`] front to back, and notes what is seen of the block before it is drawn.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
pub(crate) fn block_seen(projector: &Projector, voxels: &Voxels, bench: &mut Bench, limits: Limits, seen: Seen) -> u64 {
    let Bench { planes, splats, each, .. } = bench;
    projector.block(voxels, splats, each, planes, limits);
    seen.note(projector, voxels, splats, each, planes, limits);
    draw::<FrontToBack>(projector, planes, splats, each, limits)
}

/// [`stamp::Bench::flush`].
pub(super) fn stamped(code: Code, projector: &Projector, bench: &mut stamp::Bench, limits: Limits) -> u64 {
    match code {
        Code::Best => stamped_best(projector, bench, limits),
        Code::Avx2 => stamped_avx2(projector, bench, limits),
        Code::Portable | Code::Plain => bench.flush(projector, limits),
    }
}

#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn stamped_best(projector: &Projector, bench: &mut stamp::Bench, limits: Limits) -> u64 {
    bench.flush(projector, limits)
}

#[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
fn stamped_avx2(projector: &Projector, bench: &mut stamp::Bench, limits: Limits) -> u64 {
    bench.flush(projector, limits)
}

/// [`stamp::Bench::sift`].
pub(super) fn sifted(
    code: Code,
    projector: &Projector,
    bench: &mut stamp::Bench,
    limits: Limits,
    batch: &Batch,
) -> u64 {
    match code {
        Code::Best => sifted_best(projector, bench, limits, batch),
        Code::Avx2 => sifted_avx2(projector, bench, limits, batch),
        Code::Portable | Code::Plain => bench.sift(code, projector, limits, batch),
    }
}

#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
fn sifted_best(projector: &Projector, bench: &mut stamp::Bench, limits: Limits, batch: &Batch) -> u64 {
    bench.sift(Code::Best, projector, limits, batch)
}

#[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
fn sifted_avx2(projector: &Projector, bench: &mut stamp::Bench, limits: Limits, batch: &Batch) -> u64 {
    bench.sift(Code::Avx2, projector, limits, batch)
}

#[inline(always)]
fn block_any<B: Blend>(projector: &Projector, voxels: &Voxels, bench: &mut Bench, limits: Limits) -> u64 {
    let Bench { planes, splats, each, sheet } = bench;
    let limits = if B::STOPS { limits } else { Limits { stop: 0.0, ..limits } };
    projector.block(voxels, splats, each, planes, limits);
    match sheet {
        None => draw::<B>(projector, planes, splats, each, limits),
        Some(sheet) => draw::<Additive>(projector, sheet, splats, each, limits),
    }
}

/// Composites a bench's sheet, if it has one.
#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx+avx2"), dispatcher = "direct")]
pub(crate) fn sheet(bench: &mut Bench, limits: Limits) {
    if let Bench { planes, sheet: Some(sheet), .. } = bench {
        planes.composite(sheet, limits.stop);
    }
}

#[inline(always)]
pub fn draw<B: Blend>(
    projector: &Projector,
    planes: &mut Planes,
    splats: &Splats,
    each: &EllipseEach,
    limits: Limits,
) -> u64 {
    match &projector.kind {
        Kind::Parallel { ellipse, .. } => raster::draw::<B, _>(planes, splats, ellipse, limits),
        Kind::Perspective { .. } => raster::draw::<B, _>(planes, splats, each, limits),
    }
}
