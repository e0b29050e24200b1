//! The candidates that the study compares: presets on files of 8 and of 16 bits, the dial's settings, `standard` with
//! one setting changed, and combinations of the settings that matter most for time. The dial searches the fastest
//! settings.

use super::candidate::{Candidate, Drawer, Nesting};
use super::family::Family;
use adjsplat::splat::{Blending, KernelShape, Quality, Sampling};
use adjsplat::traverse::Sense;
use adjsplat_judge::dial::{RUNGS, Rung};

/// Kernels: each standard deviation in voxels with its radii, from narrower than that of `draft` to the widest in use.
const KERNELS: [(f32, &[f32]); 4] =
    [(0.5, &[1.5]), (0.6, &[1.5, 2.0]), (0.65, &[2.0, 2.5]), (0.7, &[1.5, 1.8, 2.0, 2.1, 2.3, 2.5, 2.8, 3.0])];
const TERMINATIONS: [f32; 6] = [0.0, 1e-5, 1.0 / 1024.0, 1.0 / 255.0, 1.0 / 128.0, 1.0 / 32.0];
const SAMPLINGS: [Sampling; 4] = [Sampling::EveryPixel, Sampling::Finer, Sampling::Enough, Sampling::Fewest];
/// Pairs of bits: of a value, and of each component of a normal.
const CODES: [(u8, u8); 5] = [(8, 8), (16, 16), (16, 8), (8, 16), (8, 0)];
const THRESHOLDS: [f32; 3] = [0.01, 0.03, 0.1];
/// Kernels (standard deviation, radius) that are combined with several terminations.
const COMBINED_KERNELS: [(f32, f32); 6] = [(0.6, 1.5), (0.6, 2.0), (0.7, 1.5), (0.7, 1.8), (0.7, 2.1), (0.7, 3.0)];
const COMBINED_TERMINATIONS: [f32; 2] = [1.0 / 128.0, 1.0 / 32.0];

/// Returns all candidates, no two with equal settings; if `quick`, only the presets and a few others.
pub fn candidates(quick: bool) -> Vec<Candidate> {
    let mut all = Vec::new();
    for bits in [8, 16] {
        for quality in Quality::ALL {
            all.push(Candidate::preset(quality, bits));
        }
    }
    let mut add = |candidate: Candidate| {
        let known =
            |other: &Candidate| Candidate { family: other.family, quality: other.quality, ..candidate } == *other;
        if !all.iter().any(known) {
            all.push(candidate);
        }
    };
    // The dial's error does not include that of the file, so its candidates get the most exact file.
    for Rung { kernel, termination, sampling } in RUNGS {
        let stored = Candidate { value_bits: 16, normal_bits: 16, ..Candidate::away(Family::Dial) };
        add(Candidate { kernel, termination, sampling, ..stored });
    }
    let step = if quick { 3 } else { 1 };
    let kernels =
        KERNELS.iter().flat_map(|&(sigma, radii)| radii.iter().map(move |&radius| KernelShape { sigma, radius }));
    for kernel in kernels.step_by(step) {
        add(Candidate { kernel, ..Candidate::away(Family::Kernel) });
    }
    for &termination in TERMINATIONS.iter().step_by(step) {
        add(Candidate { termination, ..Candidate::away(Family::Termination) });
    }
    for sampling in SAMPLINGS {
        add(Candidate { sampling, ..Candidate::away(Family::Sampling) });
    }
    for (value_bits, normal_bits) in CODES {
        add(Candidate { value_bits, normal_bits, ..Candidate::away(Family::Codes) });
    }
    for nesting in [Nesting::MediumFastSwapped, Nesting::SlowFastSwapped] {
        add(Candidate { nesting, ..Candidate::away(Family::Order) });
    }
    add(Candidate { sense: Sense::BackToFront, ..Candidate::away(Family::Order) });
    for blending in [Blending::Linear, Blending::Sheets] {
        // These forms of blending cannot draw coarser pixels, so all are compared on finer pixels.
        add(Candidate { blending, sampling: Sampling::Finer, ..Candidate::away(Family::Blending) });
    }
    for &threshold in THRESHOLDS.iter().step_by(step) {
        let drawer = Drawer::Octree(threshold);
        add(Candidate { drawer, sampling: Sampling::EveryPixel, ..Candidate::away(Family::Octree) });
    }
    if quick {
        return all;
    }
    for (sigma, radius) in COMBINED_KERNELS {
        for sampling in [Sampling::Enough, Sampling::Fewest] {
            let kernel = KernelShape { sigma, radius };
            add(Candidate { kernel, sampling, ..Candidate::away(Family::Combined) });
            for termination in COMBINED_TERMINATIONS {
                add(Candidate { kernel, termination, sampling, ..Candidate::away(Family::Combined) });
            }
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_name_every_knob_and_no_two_candidates_are_the_same() {
        let standard = Candidate::preset(Quality::Standard, 8);
        assert_eq!(standard.settings_text(), "sigma=0.7 radius=3 stop=1/1024 sampling=enough values=8 normals=8");
        let high = Candidate::preset(Quality::High, 16);
        assert_eq!(high.settings_text(), "sigma=0.7 radius=3 stop=1e-5 sampling=finer values=16 normals=16");
        for quick in [true, false] {
            let all = candidates(quick);
            let names: std::collections::BTreeSet<String> = all.iter().map(Candidate::settings_text).collect();
            assert_eq!(names.len(), all.len());
            for family in Family::ALL.into_iter().filter(|family| !(quick && *family == Family::Combined)) {
                assert!(all.iter().any(|candidate| candidate.family == family), "{family:?}");
            }
        }
    }
}
