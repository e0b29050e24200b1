//! Every kind of transfer function, and what needs a first reading.

use adjsplat::classify::{Cap, Colour, Contour, FactorPoint, Label, Point, TransferFunction, UnlistedLabels};
use adjsplat::volume::SampleType;
use adjsplat_tests::scenes::options;

use super::dense::{SampleVolume, random_at};
use super::twin::build_and_compare;

/// A blob with some roughness, 0 to 200.
pub(super) fn blob([x, y, z]: [u32; 3]) -> f64 {
    let d = [f64::from(x) - 11.3, f64::from(y) - 9.1, (f64::from(z) - 7.4) * 1.3];
    let r = d.iter().map(|c| c * c).sum::<f64>().sqrt();
    (200.0 - 17.0 * r).max(0.0) + 10.0 * random_at([x, y, z])
}

fn volume(sample_type: SampleType) -> SampleVolume {
    let volume = SampleVolume::new([23, 20, 17], sample_type, [0.9, 1.1, 1.3], |p| {
        if sample_type == SampleType::I8 { blob(p) / 2.0 } else { blob(p) }
    });
    if sample_type == SampleType::U16 { volume.scaled(0.5, 20.0) } else { volume }
}

fn point(value: f64, opacity: f64) -> Point {
    Point { value, colour: Colour::from_bytes([200, 100, 50]), opacity }
}

/// Builds each type's volume in each width; the number of visible voxels of each.
fn each(transfer: &TransferFunction, surveyed: bool) -> Vec<u64> {
    let types = [SampleType::U8, SampleType::I8, SampleType::U16, SampleType::I16, SampleType::F32, SampleType::F64];
    let mut counts = Vec::new();
    for sample_type in types {
        let volume = volume(sample_type);
        for (value_bits, normal_bits) in [(8, 8), (16, 0), (16, 16)] {
            let options = options(transfer.clone()).with_value_bits(value_bits).with_normal_bits(normal_bits);
            let built = build_and_compare(&volume, &options);
            assert_eq!(built.samples.surveyed, surveyed, "{}", sample_type.name());
            assert_eq!(options.needs_survey(), surveyed);
            counts.push(built.facts.visible_voxels);
        }
    }
    counts
}

#[test]
fn points() {
    let points = vec![
        point(20.0, 0.0),
        point(40.0, 0.3),
        point(60.0, 0.0),
        point(80.0, 0.0),
        point(90.0, 1.0),
        point(99.0, 0.0),
    ];
    each(&TransferFunction::points(points, Vec::new()).expect("sound"), false);
    // Opaque beyond its last point: where the data ends must be known.
    let open = vec![point(20.0, 0.0), point(40.0, 0.3)];
    each(&TransferFunction::points(open, Vec::new()).expect("sound"), false);
    // A step: the more opaque side holds at the value itself.
    let step = vec![point(50.0, 0.0), point(50.0, 0.8), point(70.0, 0.8), point(70.0, 0.0)];
    each(&TransferFunction::points(step, Vec::new()).expect("sound"), false);
}

#[test]
fn points_with_a_gradient_ramp() {
    let points = vec![point(20.0, 0.0), point(40.0, 0.3), point(99.0, 0.3), point(100.0, 0.0)];
    // Neither flat places nor steep ones.
    let ramp = [(7.5, 0.0), (9.0, 1.0), (17.0, 1.0), (17.5, 0.0)];
    let ramp = ramp.map(|(magnitude, factor)| FactorPoint { magnitude, factor }).to_vec();
    let plain = each(&TransferFunction::points(points.clone(), Vec::new()).expect("sound"), false);
    let ramped = each(&TransferFunction::points(points, ramp).expect("sound"), false);
    assert!(plain.iter().zip(&ramped).all(|(plain, ramped)| ramped < plain), "{plain:?} {ramped:?}");
}

#[test]
fn ranges_closed_and_open() {
    each(&TransferFunction::range(30.0, 70.0).expect("sound"), false);
    each(&TransferFunction::range(30.0, f64::INFINITY).expect("sound"), false);
    each(&TransferFunction::range(f64::NEG_INFINITY, 70.0).expect("sound"), false);
    each(&TransferFunction::range(f64::NEG_INFINITY, f64::INFINITY).expect("sound"), false);
}

#[test]
fn contours_count_widths_in_the_volumes_own_voxels() {
    each(&TransferFunction::contour(60.0).expect("sound"), false);
    let colour = Colour::from_bytes([1, 2, 3]);
    let contour = |value, opacity, width| Contour { value, opacity, width, colour };
    let several = vec![contour(30.0, 0.1, 0.5), contour(50.0, 0.0, 9.0), contour(80.0, 0.9, 1.5)];
    each(&TransferFunction::contours(several).expect("sound"), false);
    // Half as long a voxel, twice the gradient: the same voxels.
    let count = |spacing: [f64; 3]| {
        let mut volume = volume(SampleType::F32);
        volume.header.grid.spacing = spacing;
        build_and_compare(&volume, &options(TransferFunction::contour(60.0).expect("sound"))).facts.visible_voxels
    };
    assert_eq!(count([1.0, 1.0, 1.0]), count([0.5, 0.5, 0.5]));
    for cap in [Cap::Above, Cap::Below] {
        each(&TransferFunction::contour(60.0).expect("sound").with_cap(cap).expect("a contour"), false);
    }
    let grid = volume(SampleType::F32).header.grid;
    assert!((grid.mean_spacing() - (0.9f64 * 1.1 * 1.3).cbrt()).abs() < 1e-15);
}

#[test]
fn region_boundaries_are_relative_to_the_largest_gradient_of_the_data() {
    let knots = vec![point(10.0, 0.0), point(50.0, 0.4), point(95.0, 0.7)];
    let given = TransferFunction::region(knots, 20.0).expect("sound");
    each(&given, false);
    let mut json: serde_json::Value = serde_json::from_str(&given.to_json()).expect("JSON");
    json.as_object_mut().expect("an object").remove("largest_magnitude").expect("it was given");
    let relative = TransferFunction::from_json(&json.to_string()).expect("sound");
    each(&relative, true);
    let built = build_and_compare(&volume(SampleType::F64), &options(relative));
    let largest = built.facts.scales.magnitude_scale;
    let codes = built.lanes[0].view().magnitudes;
    // The voxel of the largest gradient may be invisible, but some visible one comes near.
    assert!(largest > 17.0 && codes.iter().any(|&code| code > 230), "{largest}");
    let filled: serde_json::Value = serde_json::from_str(&built.transfer.to_json()).expect("JSON");
    assert_eq!(filled["largest_magnitude"], largest);
}

#[test]
fn labels_shade_by_their_smoothed_visibility() {
    let label = |label| Label { label, name: String::new(), colour: Colour::from_bytes([9, 9, 9]), opacity: 1.0 };
    let some =
        TransferFunction::labels(vec![label(3), label(5), label(12)], UnlistedLabels::Transparent).expect("sound");
    let all = TransferFunction::labels(Vec::new(), UnlistedLabels::Distinct).expect("sound");
    let but_seven =
        TransferFunction::labels(vec![Label { opacity: 0.0, ..label(7) }], UnlistedLabels::Distinct).expect("sound");
    for dims in [[23, 20, 17], [1, 1, 1], [5, 1, 3], [1, 2, 40], [2, 3, 1]] {
        for sample_type in [SampleType::U8, SampleType::I16, SampleType::U32] {
            let volume = SampleVolume::new(dims, sample_type, [1.0, 1.0, 1.5], |p| 3.0 + (blob(p) / 16.0).floor());
            for transfer in [&some, &all, &but_seven] {
                if dims[0] < 20 && std::ptr::eq(transfer, &some) {
                    continue; // may hold none of the three
                }
                for normal_bits in [0, 8, 16] {
                    build_and_compare(&volume, &options(transfer.clone()).with_normal_bits(normal_bits));
                }
            }
        }
    }
    // Inside a solid of many labels, off the volume's faces, there is no surface, so no normal: labels as such do not shade.
    let solid = SampleVolume::new([9, 9, 9], SampleType::U8, [1.0; 3], |p| 1.0 + (random_at(p) * 50.0).floor());
    let built = build_and_compare(&solid, &options(all));
    let none = u32::from(adjsplat::classify::normal::NONE8);
    let lane = built.lanes[0].view();
    assert_eq!((0..729).filter(|&record| lane.normal_code(record) == none).count(), 7 * 7 * 7);
}
