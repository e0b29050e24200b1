//! Bodies that the volume's faces cut: their cut is lit as the face, and `cap` closes a contour's surface there.

use adjsplat::build::Built;
use adjsplat::classify::{Cap, TransferFunction, UnlistedLabels, normal};
use adjsplat::volume::SampleType;
use adjsplat_tests::scenes::{at_least, options};

use super::dense::{SampleVolume, random_at};
use super::twin::build_and_compare;

/// The angle between normals of 2 x 8 bits and what they stand for, in degrees.
const CODEC: f64 = 0.64;

/// Builds `volume` and returns its voxels: place, normal, opacity as drawn.
fn voxels(volume: &SampleVolume, transfer: &TransferFunction) -> Vec<([u32; 3], [f32; 3], f64)> {
    let Built { facts, lanes, transfer, .. } = build_and_compare(volume, &options(transfer.clone()));
    let lane = lanes[0].view();
    let codec = adjsplat::classify::MagnitudeCodec::new(facts.scales.magnitude_scale).expect("a sound scale");
    let mut found = Vec::new();
    for line in lane.lines() {
        for (x, record) in lane.line_voxels(line.records) {
            let normal = normal::decode8(u16::try_from(lane.normal_code(record)).expect("2 x 8 bits"));
            let value = facts.scales.value_low + f64::from(lane.value_code(record)) * facts.scales.value_step;
            let opacity = transfer.opacity(value, codec.decode(lane.magnitude_code(record)));
            found.push(([x, line.u, line.v], normal, opacity));
        }
    }
    found
}

fn assert_along(normal: [f32; 3], want: [f64; 3], place: [u32; 3]) {
    let length = want.iter().map(|c| c * c).sum::<f64>().sqrt();
    let cosine = normal.iter().zip(want).map(|(n, w)| f64::from(*n) * w).sum::<f64>() / length;
    assert!(cosine >= CODEC.to_radians().cos(), "{normal:?} at {place:?}, not {want:?}");
}

/// The sum of the outward axes of the faces that `place` is on.
fn outward(dims: [u32; 3], place: [u32; 3]) -> [f64; 3] {
    std::array::from_fn(|a| match place[a] {
        0 => -1.0,
        at if at == dims[a] - 1 => 1.0,
        _ => 0.0,
    })
}

fn assert_faces_are_lit(volume: &SampleVolume, transfer: &TransferFunction) -> usize {
    let dims = volume.header.grid.dims;
    let on_faces = voxels(volume, transfer).into_iter().filter(|(place, ..)| outward(dims, *place) != [0.0; 3]);
    on_faces.map(|(place, normal, _)| assert_along(normal, outward(dims, place), place)).count()
}

#[test]
fn a_mask_that_runs_into_a_face_is_lit_there_as_the_face() {
    for spacing in [[1.0; 3], [1.0, 1.0, 5.0], [5.0, 1.0, 1.0]] {
        // A bar that both faces across y cut, and a ball in a corner.
        let bar = |[x, _, z]: [u32; 3]| (4..9).contains(&x) && (3..8).contains(&z);
        let ball = |p: [u32; 3]| p.iter().map(|c| c * c).sum::<u32>() < 30;
        let mask = |p| f64::from(u8::from(bar(p) || ball(p)));
        let volume = SampleVolume::new([13, 16, 12], SampleType::U8, spacing, mask);
        assert!(assert_faces_are_lit(&volume, &at_least(1.0)) > 50);
        let labels = TransferFunction::labels(Vec::new(), UnlistedLabels::Distinct).expect("sound");
        assert!(assert_faces_are_lit(&volume, &labels) > 50);
    }
}

#[test]
fn noise_does_not_light_the_cut_of_bone() {
    // Just above the threshold the noise is larger than the distance to what is transparent.
    let ct = |p: [u32; 3]| 310.0 + 300.0 * (random_at(p) - 0.2);
    let volume = SampleVolume::new([14, 15, 16], SampleType::I16, [0.5, 0.5, 1.2], ct);
    assert!(assert_faces_are_lit(&volume, &at_least(300.0)) > 500);
    let bone = TransferFunction::preset("ct-bone").expect("a preset");
    assert!(assert_faces_are_lit(&volume, &bone) > 500);
}

#[test]
fn grids_of_one_slice_line_or_point_face_the_lower_side() {
    for dims in [[7, 6, 1], [1, 5, 1], [1, 1, 1], [1, 8, 9]] {
        let volume = SampleVolume::new(dims, SampleType::U8, [1.0; 3], |p| 100.0 + (random_at(p) * 50.0).floor());
        let count = assert_faces_are_lit(&volume, &at_least(60.0));
        assert_eq!(count as u64, volume.header.grid.points(), "{dims:?}");
    }
}

/// A ball around the middle of the lower face across z; its surface, of value 50, goes through two voxels.
fn half_ball(sample_type: SampleType, spacing: [f64; 3]) -> SampleVolume {
    SampleVolume::new([25, 25, 14], sample_type, spacing, |[x, y, z]| {
        let [x, y] = [x, y].map(|c| f64::from(c) - 12.0);
        let distance = (x * x + y * y + f64::from(z * z)).sqrt();
        50.0 + 50.0 * (9.0 - distance).clamp(-1.0, 1.0)
    })
}

#[test]
fn a_surface_ends_open_at_a_face_and_a_cap_closes_it() {
    for (sample_type, spacing) in
        [(SampleType::U8, [1.0; 3]), (SampleType::I16, [1.0, 1.0, 5.0]), (SampleType::F32, [1e-3, 1e-3, 2e-3])]
    {
        let volume = half_ball(sample_type, spacing);
        let surface = TransferFunction::contour(50.0).expect("sound");
        let is_middle = |place: [u32; 3]| place[2] == 0 && place[..2].iter().all(|&c| c.abs_diff(12) < 5);
        let open = voxels(&volume, &surface);
        assert!(!open.iter().any(|(place, ..)| is_middle(*place)), "a surface has no inside");
        // At the rim the surface is lit as the surface.
        let rim = open.iter().filter(|(place, ..)| place[2] == 0);
        assert!(rim.clone().count() > 20 && rim.clone().all(|(_, normal, _)| normal[2].abs() < 0.5));

        let capped = voxels(&volume, &surface.clone().with_cap(Cap::Above).expect("a contour"));
        let cap: Vec<_> = capped.iter().filter(|(place, ..)| is_middle(*place)).collect();
        assert_eq!(cap.len(), 81);
        for (place, normal, opacity) in cap {
            assert_along(*normal, [0.0, 0.0, -1.0], *place);
            // The depth's own magnitude, and half a code of it.
            assert!((0.9 * (1.0 - 1.03 / 16.0)..=0.9).contains(opacity), "{opacity} at {place:?}");
        }
        // Elsewhere nothing changes: what is not on a face is there in both.
        let inside = |found: &[([u32; 3], [f32; 3], f64)]| -> Vec<([u32; 3], [f32; 3])> {
            found.iter().filter(|(place, ..)| place[2] > 0).map(|&(place, normal, _)| (place, normal)).collect()
        };
        let (open, capped) = (inside(&open), inside(&capped));
        assert_eq!(open, capped);
    }
}

#[test]
fn a_cap_below_closes_the_faces_around_the_ball() {
    let volume = half_ball(SampleType::I16, [1.0; 3]);
    let below = TransferFunction::contour(50.0).expect("sound").with_cap(Cap::Below).expect("a contour");
    let found = voxels(&volume, &below);
    assert!(!found.iter().any(|(place, ..)| *place == [12, 12, 0]));
    let dims = volume.header.grid.dims;
    assert_eq!(found.iter().filter(|(place, ..)| place[2] == dims[2] - 1).count(), 625);
    assert!(found.iter().any(|(place, normal, _)| *place == [0, 0, 0] && normal.iter().all(|c| *c < -0.5)));
}

#[test]
fn a_cap_over_a_body_without_any_gradient_is_visible() {
    // Nothing but one value, above the surface's: the bound of gradients is 0.
    for sample_type in [SampleType::U8, SampleType::F32] {
        let volume = SampleVolume::new([5, 6, 7], sample_type, [1.0, 1.0, 5.0], |_| 5.0);
        let capped = TransferFunction::contour(3.0).expect("sound").with_cap(Cap::Above).expect("a contour");
        assert_eq!(assert_faces_are_lit(&volume, &capped), 5 * 6 * 7 - 3 * 4 * 5);
    }
}
