//! The inner loops, compiled for several instruction sets and chosen at run time.
//!
//! All versions give the same bits: they do the same arithmetic, and differ in how many values they compute at once.
//!
//! In: a [`Code`] and the arguments of a loop. Out: its result, by the best instructions that the code allows.

use fearless_simd::Level;
use multiversion::multiversion;
use multiversion::target::match_target;

use super::blend::Blend;
use super::gather::band::Band;
use super::project::Projector;
use super::scatter::maximum::{self, MaximumRays};
use super::scatter::raster;
use super::splats::Splats;
use super::tile_buffer::TileBuffer;
use super::voxel_block::{BLOCK, VoxelBlock};
use crate::splat::Code;
use crate::splat::composite::Look;
use crate::traverse::Batch;

/// Defines a function whose body is compiled for two instruction sets. Its first argument selects one; without the
/// processor's support for it, the simpler one runs.
macro_rules! with_avx2 {
    ($(#[$doc:meta])* $vis:vis fn $name:ident$(<$blend:ident>)?($($arg:ident: $kind:ty),* $(,)?) $(-> $out:ty)? $body:block) => {
        $(#[$doc])*
        $vis fn $name$(<$blend: Blend>)?(code: Code, $($arg: $kind),*) $(-> $out)? {
            #[multiversion(targets("x86_64+avx+avx2"), dispatcher = "direct")]
            fn avx2$(<$blend: Blend>)?($($arg: $kind),*) $(-> $out)? {
                match_target! {
                    "x86_64+avx+avx2" => $body,
                    _ => portable$(::<$blend>)?($($arg),*),
                }
            }

            fn portable$(<$blend: Blend>)?($($arg: $kind),*) $(-> $out)? $body

            match code {
                Code::Best | Code::Avx2 => avx2$(::<$blend>)?($($arg),*),
                Code::Portable | Code::Plain => portable$(::<$blend>)?($($arg),*),
            }
        }
    };
}

/// Does the same for three instruction sets. For bodies that are mostly arithmetic: looking values up and counting take up to
/// 1.5 times as long with AVX-512, because a compiler then gathers values and takes masks apart, bit by bit.
macro_rules! with_avx512 {
    ($(#[$doc:meta])* $vis:vis fn $name:ident$(<$blend:ident>)?($($arg:ident: $kind:ty),* $(,)?) $(-> $out:ty)? $body:block) => {
        $(#[$doc])*
        $vis fn $name$(<$blend: Blend>)?(code: Code, $($arg: $kind),*) $(-> $out)? {
            with_avx2! { fn narrow$(<$blend>)?($($arg: $kind),*) $(-> $out)? $body }

            #[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq"), dispatcher = "direct")]
            fn wide$(<$blend: Blend>)?($($arg: $kind),*) $(-> $out)? {
                match_target! {
                    "x86_64+avx+avx2+avx512f+avx512vl+avx512bw+avx512dq" => $body,
                    _ => narrow$(::<$blend>)?(Code::Avx2, $($arg),*),
                }
            }

            match code {
                Code::Best => wide$(::<$blend>)?($($arg),*),
                _ => narrow$(::<$blend>)?(code, $($arg),*),
            }
        }
    };
}

with_avx2! {
    /// Runs [`Projector::project_block`].
    pub fn project_block(projector: &Projector, voxels: &VoxelBlock, splats: &mut Splats, tiles: &TileBuffer) {
        projector.project_block(voxels, splats, tiles);
    }
}

with_avx512! {
    /// Draws a projected block; returns how many splats were drawn.
    pub fn draw_block<B>(projector: &Projector, splats: &Splats, tiles: &mut TileBuffer) -> u64 {
        raster::draw::<B>(tiles, splats, projector.rays.as_ref(), [projector.cut, projector.stop])
    }
}

with_avx512! {
    /// Runs [`maximum::add`]; returns how many voxels were drawn.
    pub(super) fn draw_maxima(
        projector: &Projector,
        rays: &MaximumRays,
        voxels: &VoxelBlock,
        tiles: &mut TileBuffer,
        slices: &mut [u16],
    ) -> u64 {
        match rays {
            MaximumRays::Parallel { .. } => maximum::add::<false>(projector, rays, voxels, tiles, slices),
            MaximumRays::Perspective { .. } => maximum::add::<true>(projector, rays, voxels, tiles, slices),
        }
    }
}

with_avx2! {
    /// Runs [`Band::visit`].
    pub(super) fn visit_lattice<B>(projector: &Projector, band: &mut Band<B>, batch: &Batch) {
        band.visit(projector, batch);
    }
}

with_avx2! {
    /// Runs [`Band::flush`].
    pub(super) fn flush_lattice<B>(projector: &Projector, band: &mut Band<B>) {
        band.flush(projector);
    }
}

with_avx2! {
    /// Runs [`Projector::colour`] for all voxels of a block.
    pub(super) fn colour(projector: &Projector, voxels: &VoxelBlock, looks: &mut [Look]) {
        let mut all = [0; BLOCK];
        for j in 0..BLOCK {
            all[j] = j as u8;
        }
        projector.colour(voxels, &all[..voxels.count.min(BLOCK)], looks);
    }
}

with_avx512! {
    /// Runs [`Band::take_all`].
    pub(super) fn take_all<B>(projector: &Projector, band: &mut Band<B>) {
        band.take_all(projector);
    }
}

/// Returns the instruction set that `code` selects, for functions that are written with vectors.
pub(super) fn instruction_set(code: Code) -> Level {
    match code {
        Code::Best => Level::new(),
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Code::Avx2 => Level::new().as_avx2().map_or(Level::baseline(), Level::Avx2),
        _ => Level::baseline(),
    }
}
