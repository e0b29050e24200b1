//! Shapes whose hidden voxels are known.

use std::ops::ControlFlow;

use adjsplat::Error;
use adjsplat::splat::Quality;
use adjsplat_judge::hidden::{Algorithm, Culling, find};
use adjsplat_tests::at_full;
use adjsplat_tests::scenes::Draw as _;

use crate::hidden::judge::worst_change;
use crate::hidden::scenes::{EPS, ShadeVolume, culling, find_in, hidden, structure, without};

const BOTH: [Algorithm; 2] = [Algorithm::Sampled, Algorithm::Certified];

fn distance([x, y, z]: [usize; 3], centre: f64) -> f64 {
    [x, y, z].map(|c| (c as f64 - centre).powi(2)).iter().sum::<f64>().sqrt()
}

fn ball(side: usize, inner: f64, outer: f64) -> ShadeVolume {
    let centre = (side as f64 - 1.0) / 2.0;
    ShadeVolume::new([side; 3], 1.0, |at| u8::from((inner..=outer).contains(&distance(at, centre))) * 99)
}

#[test]
fn a_ball_keeps_its_skin_and_what_is_certified_is_sampled_too() {
    let dense = ball(41, 0.0, 19.0);
    let [sampled, certified] = BOTH.map(|algorithm| hidden(&dense, algorithm).0);
    for (index, (&sampled, &certified)) in sampled.iter().zip(&certified).enumerate() {
        let depth = 19.0 - distance(dense.at(index), 20.0);
        assert!(!sampled || depth > 2.0, "a voxel {depth} below the surface is sampled");
        assert!(!certified || sampled, "{:?} is certified but was seen", dense.at(index));
        // Nothing comes through five opaque voxels.
        assert!(dense.values[index] == 0 || depth < 7.0 || sampled, "{depth} deep and not sampled");
        assert!(dense.values[index] == 0 || depth < 10.0 || certified, "{depth} deep and not certified");
    }
}

#[test]
fn a_thin_shell_hides_nothing_of_itself_but_a_ball_within() {
    let thin = ball(33, 14.0, 16.0);
    for algorithm in BOTH {
        assert_eq!(hidden(&thin, algorithm).1.count, 0, "{algorithm:?}");
    }
    // A closed shell of four voxels around a ball.
    let both = ShadeVolume::new([45; 3], 1.0, |at| {
        let distance = distance(at, 22.0);
        u8::from(distance <= 8.0 || (17.0..=21.5).contains(&distance)) * 50
    });
    let (gone, _) = hidden(&both, Algorithm::Sampled);
    assert!(gone[both.place([22; 3])], "the middle of a ball in a closed shell is hidden");
    assert!(worst_change(&both, &without(&both, &gone), Quality::Standard) <= EPS);
}

#[test]
fn nothing_at_the_end_of_a_pinhole_is_removed() {
    // Kernels of both sides close a hole of one voxel in opaque matter; one of three lets light through.
    for (axis, half) in [(0, 1), (1, 1), (2, 1), (2, 0)] {
        let dense = ShadeVolume::new([25; 3], 1.0, |at| {
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            let hole = others.iter().all(|&a| at[a].abs_diff(12) <= half) && at[axis] < 12;
            u8::from(!hole) * 120
        });
        for algorithm in BOTH {
            let (gone, found) = hidden(&dense, algorithm);
            // All that touches the hole, its end too.
            for depth in 0..13 {
                for (u, v) in (11 - half..14 + half).flat_map(|u| (11 - half..14 + half).map(move |v| (u, v))) {
                    let mut at = [0; 3];
                    (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (depth, u, v);
                    assert!(!gone[dense.place(at)], "{algorithm:?}: {at:?} lies at the hole");
                }
            }
            assert!(found.count > 500 || algorithm == Algorithm::Certified, "{algorithm:?}: {}", found.count);
            let worst = worst_change(&dense, &without(&dense, &gone), Quality::Standard);
            assert!(worst <= EPS, "{algorithm:?}: {worst}");
        }
    }
}

#[test]
fn the_walls_of_a_slanted_tunnel_stay() {
    let dense = ShadeVolume::new([32, 28, 30], 1.0, |[x, y, z]| {
        // Two voxels wide, at a slope of 2 to 5.
        let axis = [10.0 + z as f64 * 0.4, 8.0 + z as f64 * 0.3];
        let hole = (x as f64 - axis[0]).abs() <= 1.0 && (y as f64 - axis[1]).abs() <= 1.0;
        u8::from(!hole) * 200
    });
    for algorithm in BOTH {
        let (gone, found) = hidden(&dense, algorithm);
        let near = |index: usize| {
            let [x, y, z] = dense.at(index).map(|c| c as f64);
            (x - 10.0 - z * 0.4).abs() <= 2.0 && (y - 8.0 - z * 0.3).abs() <= 2.0
        };
        assert!((0..gone.len()).all(|index| !(gone[index] && near(index))), "{algorithm:?}: a wall is gone");
        assert!(found.count > 0, "{algorithm:?}");
        assert!(worst_change(&dense, &without(&dense, &gone), Quality::Standard) <= EPS, "{algorithm:?}");
    }
}

#[test]
fn slabs_lose_their_middle_only_from_some_thickness_on() {
    let counts = |algorithm: Algorithm, opacity: f64| {
        let thicknesses = at_full(&[1, 4, 8, 9, 10, 11, 12, 13, 14, 15, 16, 20, 24][..], &[8, 9, 11, 12, 14, 16, 20]);
        let count = |&thickness| hidden(&ShadeVolume::new([30, 30, thickness], opacity, |_| 1), algorithm).1.count;
        thicknesses.iter().map(|thickness| (*thickness, count(thickness))).collect::<Vec<_>>()
    };
    let first = |counts: &[(usize, u64)]| counts.iter().find(|(_, count)| *count > 0).map(|(thickness, _)| *thickness);
    let [sampled, certified] = BOTH.map(|algorithm| counts(algorithm, 1.0));
    for counts in [&sampled, &certified] {
        assert!(counts.is_sorted_by_key(|(_, count)| *count), "{counts:?}");
    }
    println!("opaque slabs: sampled from {:?}, certified from {:?}", first(&sampled), first(&certified));
    // Where views see three voxels past an edge by the widest kernel, one stays beside what is seen, on both sides.
    assert!(first(&sampled) >= Some(9) && first(&sampled) <= Some(12), "{sampled:?}");
    assert!(first(&certified) >= first(&sampled) && first(&certified) <= Some(16), "{certified:?}");
    // Less opaque ones must be thicker. How the pixels of views lie counts at the margin, so that counts may go down.
    let translucent = counts(Algorithm::Sampled, 0.9);
    assert!(first(&translucent) > first(&sampled) && first(&translucent).is_some(), "{translucent:?}");
}

#[test]
fn translucent_voxels_stay() {
    let dense = ShadeVolume { opacity: 0.1, ..ball(31, 0.0, 14.0) };
    for algorithm in BOTH {
        assert_eq!(hidden(&dense, algorithm).1.count, 0, "{algorithm:?}");
    }
}

#[test]
fn anisotropic_grids_are_judged_in_their_own_units() {
    let dense = ShadeVolume { spacing: [1.0, 2.0, 0.5], ..ShadeVolume::new([28, 24, 40], 1.0, |_| 3) };
    for algorithm in BOTH {
        let (gone, found) = hidden(&dense, algorithm);
        assert!(found.count > 1_000, "{algorithm:?}: {}", found.count);
        assert!(worst_change(&dense, &without(&dense, &gone), Quality::Standard) <= EPS, "{algorithm:?}");
    }
}

#[test]
fn lines_of_voxels_and_single_ones_are_no_special_case() {
    for dims in [[1, 1, 1], [1, 1, 90], [90, 1, 1], [1, 90, 1], [40, 40, 1]] {
        for algorithm in BOTH {
            assert_eq!(hidden(&ShadeVolume::new(dims, 1.0, |_| 5), algorithm).1.count, 0, "{dims:?} {algorithm:?}");
        }
    }
    let nothing = structure(&ShadeVolume::new([4; 3], 1.0, |_| 0));
    let none = find(&nothing.scene(), &culling(Algorithm::Sampled), &mut |_, _, _| ControlFlow::Continue(()));
    assert!(none.unwrap_err().to_string().contains("no voxels"));
}

/// What is left hides as much or less: nothing more is found in it.
#[test]
fn removing_again_removes_nothing() {
    let dense = ball(31, 0.0, 14.0);
    for algorithm in BOTH {
        let (gone, found) = hidden(&dense, algorithm);
        assert!(found.count > 100, "{algorithm:?}: {}", found.count);
        assert_eq!(hidden(&without(&dense, &gone), algorithm).1.count, 0, "{algorithm:?}");
    }
}

#[test]
fn thresholds_from_none_to_all() {
    let model = structure(&ball(25, 0.0, 11.0));
    let run = |eps: f64| {
        let culling = Culling { eps, ..culling(Algorithm::Sampled) };
        find(&model.scene(), &culling, &mut |_, _, _| ControlFlow::Continue(()))
    };
    for eps in [0.0, 1.0, -0.5, f64::NAN, f64::INFINITY] {
        assert!(matches!(run(eps), Err(Error::Input { .. })), "{eps}");
    }
    let [few, most] = [1e-9, 0.999].map(|eps| run(eps).unwrap());
    assert!(few.worst_difference <= 1e-9 && most.worst_difference <= 0.999);
    assert!(few.count < most.count, "{} {}", few.count, most.count);
}

#[test]
fn little_memory_means_more_passes_and_the_same_voxels() {
    let model = structure(&ball(30, 0.0, 14.0));
    let run = |memory: u64, threads: usize| {
        let culling = Culling { memory, threads, ..culling(Algorithm::Sampled) };
        find(&model.scene(), &culling, &mut |_, _, _| ControlFlow::Continue(()))
    };
    let whole = find_in(&model, Algorithm::Sampled);
    let Err(Error::Limit { need, .. }) = run(1, 1) else { panic!("one byte is enough?") };
    let tight = run(need, 1).unwrap();
    assert!(tight.passes > whole.passes, "{} {}", tight.passes, whole.passes);
    let records = 0..whole.records.lane_records();
    assert!(records.clone().all(|index| tight.records.contains(index) == whole.records.contains(index)));
    assert!(whole.count > 1_000);
    assert!(matches!(run(need - 1, 1), Err(Error::Limit { .. })));
}

#[test]
fn a_search_stops_when_asked_to() {
    let model = structure(&ball(20, 0.0, 9.0));
    for algorithm in BOTH {
        let stopped = find(&model.scene(), &culling(algorithm), &mut |_, done, _| {
            if done >= 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        assert!(matches!(stopped, Err(Error::Interrupted)), "{algorithm:?}");
    }
}
