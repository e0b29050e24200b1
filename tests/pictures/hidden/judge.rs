//! The judge: transmittance in front of a voxel, summed over all voxels in double precision, along lines that random
//! picks, and pictures before and after.
//!
//! It shares nothing with what it judges but the definition of a footprint: a Gaussian of the distance from the line,
//! in voxels, cut off, as the line's integral.

use adjsplat::splat::{Quality, Settings};
use adjsplat_judge::hidden::Algorithm;
use adjsplat_tests::at_full;
use adjsplat_tests::pictures::apart;
use adjsplat_tests::random::Random;
use adjsplat_tests::scenes::Draw as _;

use crate::hidden::scenes::{EPS, ShadeVolume, hidden, structure, without};

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Largest transmittance, over `lines` lines from outside through the footprints of hidden voxels, of the layers that
/// lie in front across the line's steepest axis.
fn clearest(dense: &ShadeVolume, hidden: &[bool], quality: Quality, lines: usize) -> f64 {
    let kernel = quality.kernel();
    let (sigma, radius) = (f64::from(kernel.sigma), f64::from(kernel.radius));
    let lost = 1.0 - (-0.5 * (radius / sigma).powi(2)).exp();
    let depth = (-(1.0 - dense.opacity).ln()).min(16.0);
    let weight = |square: f64| {
        if square > radius * radius {
            return 0.0;
        }
        (-0.5 * square / (sigma * sigma)).exp() / (std::f64::consts::TAU * sigma * sigma * lost)
    };
    let voxels: Vec<[f64; 3]> =
        (0..dense.values.len()).filter(|&n| dense.values[n] != 0).map(|n| dense.at(n).map(|c| c as f64)).collect();
    let gone: Vec<[f64; 3]> = (0..hidden.len()).filter(|&n| hidden[n]).map(|n| dense.at(n).map(|c| c as f64)).collect();
    let mut random = Random(7);
    let mut clearest = 0.0f64;
    for line in 0..lines {
        let centre = gone[line * 7919 % gone.len()];
        let along = match line % 3 {
            // Along axes and diagonals too.
            0 => {
                let signs = [0, 1, 2].map(|a| f64::from(u32::try_from(line / 3 / 3usize.pow(a) % 3).unwrap()) - 1.0);
                let length = dot(signs, signs).sqrt();
                if length == 0.0 { [0.0, 0.0, 1.0] } else { signs.map(|c| c / length) }
            }
            _ => random.direction(),
        };
        // A point within the footprint, across the line.
        let offset: [f64; 3] = std::array::from_fn(|_| 2.0 * random.number() - 1.0);
        let aside = dot(offset, along);
        let offset: [f64; 3] = std::array::from_fn(|a| offset[a] - aside * along[a]);
        let length = dot(offset, offset).sqrt().max(1e-9);
        let far = radius * random.number().sqrt() * 0.999;
        let through: [f64; 3] = std::array::from_fn(|a| centre[a] + offset[a] / length * far);
        let steepest = (0..3).max_by(|&a, &b| along[a].abs().total_cmp(&along[b].abs())).unwrap();
        let mut sum = 0.0;
        for voxel in &voxels {
            if (voxel[steepest] - centre[steepest]) * along[steepest] < -0.5 {
                let apart: [f64; 3] = std::array::from_fn(|a| voxel[a] - through[a]);
                let forward = dot(apart, along);
                sum += depth * weight(dot(apart, apart) - forward * forward);
            }
        }
        clearest = clearest.max((-sum).exp());
    }
    clearest
}

/// Largest change of a pixel over 200 views (40 but with `ADJ_FULL=1`) from where chance has it and 26 along axes and diagonals, in turn parallel
/// and perspective.
pub(crate) fn worst_change(before: &ShadeVolume, after: &ShadeVolume, quality: Quality) -> f64 {
    let (before, after) = (structure(before), structure(after));
    let side = 112;
    let settings = Settings::every_pixel([side; 2]).with_quality(quality).with_termination(0.0).with_lighting(None);
    let mut random = Random(11);
    let angles = [-90.0, -45.0, 0.0, 45.0, 90.0];
    let straight = (0..8).flat_map(|turn| [1, 2, 3].map(|e| (45.0 * f64::from(turn), angles[e])));
    let poles = [(0.0, -90.0), (0.0, 90.0)];
    let mut views: Vec<(f64, f64)> = straight.chain(poles).collect();
    assert_eq!(views.len(), 26);
    views.extend(
        (0..at_full(200, 40)).map(|_| (360.0 * random.number(), (2.0 * random.number() - 1.0).asin().to_degrees())),
    );
    let mut worst = 0.0f64;
    for (number, (azimuth, elevation)) in views.into_iter().enumerate() {
        let fov = (number % 2 == 1).then_some(30.0);
        let camera = before.orbit(azimuth, elevation, fov, [side; 2]);
        worst = worst.max(apart(&before.frame(&camera, &settings), &after.frame(&camera, &settings)));
    }
    worst
}

/// Blocks of 4 voxels, most of them there, in random shades: thick parts and gaps.
fn blocks(side: usize, share: f64, seed: u64) -> ShadeVolume {
    let mut random = Random(seed);
    let count = side.div_ceil(6);
    let there: Vec<bool> = (0..count.pow(3)).map(|_| random.number() < share).collect();
    let shade: Vec<u8> = (0..side.pow(3)).map(|n| u8::try_from(1 + n * 37 % 255).unwrap()).collect();
    ShadeVolume::new([side; 3], 1.0, |[x, y, z]| {
        let block = ((z / 6) * count + y / 6) * count + x / 6;
        if there[block] { shade[(z * side + y) * side + x] } else { 0 }
    })
}

#[test]
fn what_is_certified_has_nothing_clear_in_front_along_any_line() {
    let solid = ShadeVolume::new([20; 3], 1.0, |_| 9);
    for (name, dense) in [("solid", solid), ("blocks", blocks(24, 0.93, 3))] {
        let (gone, found) = hidden(&dense, Algorithm::Certified);
        assert!(found.count > 150, "{name}: {}", found.count);
        for quality in [Quality::Draft, Quality::Standard, Quality::High] {
            let clearest = clearest(&dense, &gone, quality, 1_500);
            assert!(clearest <= EPS, "{name} {quality:?}: {clearest} of the light comes through");
        }
    }
}

#[test]
fn pictures_before_and_after_differ_by_less_than_eps() {
    for (name, dense) in [
        ("blocks", blocks(24, 0.93, 3)),
        ("holes", blocks(24, 0.75, 5)),
        ("translucent", ShadeVolume { opacity: 0.9, ..blocks(30, 0.96, 8) }),
    ] {
        for algorithm in [Algorithm::Sampled, Algorithm::Certified] {
            let (gone, found) = hidden(&dense, algorithm);
            let worst = worst_change(&dense, &without(&dense, &gone), Quality::Standard);
            println!("{name} {algorithm:?}: {} of {} hidden, worst {worst:.6}", found.count, dense.count());
            assert!(worst <= EPS, "{name} {algorithm:?}: {worst}");
        }
    }
}

#[test]
fn noise_is_culled_only_where_lines_prove_it() {
    for share in [0.5, 0.98] {
        let mut random = Random(21);
        let there: Vec<bool> = (0..4096).map(|_| random.number() < share).collect();
        let dense = ShadeVolume::new([16; 3], 1.0, |[x, y, z]| u8::from(there[(z * 16 + y) * 16 + x]) * 77);
        let (gone, _) = hidden(&dense, Algorithm::Sampled);
        if gone.contains(&true) {
            let worst = worst_change(&dense, &without(&dense, &gone), Quality::High);
            assert!(worst <= EPS, "{share}: {worst}");
        }
        assert_eq!(gone.contains(&true), share > 0.9, "{share}");
    }
}
