//! What the builder refuses, what it says, and how it is stopped.

use std::ops::ControlFlow;

use adjsplat::build::{BuildOptions, Observer, Phase, Unobserved, build};
use adjsplat::classify::{Colour, Point, TransferFunction};
use adjsplat::volume::{Axis, SampleType};
use adjsplat::{Error, Result};
use adjsplat_tests::scenes::options;

use super::dense::{SampleVolume, random_at};

fn range(low: f64, high: f64) -> TransferFunction {
    TransferFunction::range(low, high).expect("a sound range")
}

fn rough(sample_type: SampleType) -> SampleVolume {
    SampleVolume::new([12, 11, 10], sample_type, [1.0; 3], |p| 10.0 + (80.0 * random_at(p)).floor())
}

/// The error of building, in one line, and the volume after it.
fn refused(volume: &SampleVolume, options: &BuildOptions) -> String {
    let error = build(&mut volume.clone(), options, &mut Unobserved).map(|built| built.facts).expect_err("refused");
    let line = error.to_string();
    assert!(!line.contains('\n') && !line.ends_with('.'), "{line}");
    line
}

#[test]
fn nothing_visible_says_the_range_of_the_samples_and_what_to_try() {
    let types = [SampleType::U8, SampleType::I8, SampleType::I16, SampleType::U32, SampleType::F32, SampleType::F64];
    for sample_type in types {
        let volume = rough(sample_type);
        let values: Vec<f64> = (0..volume.samples.len()).map(|i| volume.samples.get(i)).collect();
        let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        // Inside the type's range and outside it, closed and open, between two samples and beyond all.
        for shown in
            [range(100.0, 120.0), range(1e5, 2e5), range(100.0, f64::INFINITY), range(20.25, 20.75), range(-9e9, -8e9)]
        {
            let line = refused(&volume, &options(shown));
            assert!(line.starts_with("nothing is visible"), "{line}");
            assert!(line.contains(&format!("from {low} to {high}")), "{}: {line}", sample_type.name());
            // What it says to try works.
            let tried = line.split("the range ").nth(1).expect("it says what to try");
            let (from, to) = tried.split_once("..").expect("a range");
            let tried = range(from.parse().expect("a number"), to.parse().expect("a number"));
            assert!(build(&mut volume.clone(), &options(tried), &mut Unobserved).is_ok(), "{line}");
        }
    }
}

#[test]
fn nothing_visible_where_gradients_are_wanted_and_there_are_none() {
    let flat = SampleVolume::new([5, 5, 5], SampleType::F32, [1.0; 3], |_| 7.0);
    for text in [
        r##"{"kind":"region","knots":[{"value":0,"colour":"#ffffff","opacity":1},{"value":9,"colour":"#ffffff","opacity":1}]}"##,
        r##"{"kind":"contour","contours":[{"value":6.5,"opacity":1}]}"##,
        r##"{"kind":"points","points":[{"value":7,"colour":"#ffffff","opacity":1}],"gradient":[{"magnitude":1,"factor":0},{"magnitude":2,"factor":1}]}"##,
    ] {
        let transfer = TransferFunction::from_json(text).expect("sound");
        let line = refused(&flat, &options(transfer));
        assert!(line.contains("nothing is visible") && line.contains("from 7 to 7"), "{line}");
    }
}

#[test]
fn a_volume_of_no_numbers_says_so() {
    let volume =
        SampleVolume::new([3, 4, 5], SampleType::F32, [1.0; 3], |p| if p[0] == 0 { f64::INFINITY } else { f64::NAN });
    for shown in [range(0.0, 1.0), range(0.0, f64::INFINITY)] {
        let line = refused(&volume, &options(shown));
        assert!(
            line.contains("nothing is visible") && line.contains("none of the samples is a number (60 are not)"),
            "{line}"
        );
    }
}

#[test]
fn options_out_of_range_are_refused_before_a_sample_is_read() {
    let good = options(range(0.0, 255.0));
    let wrong = [
        good.clone().with_lane_count(0),
        good.clone().with_lane_count(4),
        good.clone().with_value_bits(0),
        good.clone().with_value_bits(12),
        good.clone().with_normal_bits(7),
    ];
    for options in wrong {
        let mut volume = rough(SampleType::U8);
        let error = build(&mut volume, &options, &mut Unobserved).map(|built| built.facts).expect_err("refused");
        assert!(matches!(error, Error::Input { .. }), "{error}");
        assert_eq!(volume.slices_read, 0);
    }
}

#[test]
fn label_maps_take_16_bits_where_needed_and_are_refused_where_those_do_not_do() {
    let labels = || TransferFunction::preset("labels").expect("a preset");
    let many = SampleVolume::new([20, 20, 2], SampleType::U16, [1.0; 3], |[x, y, _]| f64::from(1 + x + 20 * y));
    let line = refused(&many, &options(labels()).with_value_bits(8));
    assert!(line.contains("16-bit values"), "{line}");
    assert!(build(&mut many.clone(), &options(labels()).with_value_bits(16), &mut Unobserved).is_ok());
    let line = refused(&rough(SampleType::F32), &options(labels()));
    assert!(line.contains("whole numbers"), "{line}");
}

#[test]
fn the_samples_are_read_once_unless_what_is_visible_depends_on_all_of_them() {
    let knots = vec![point(10.0), point(50.0)];
    let given = TransferFunction::region(knots, 20.0).expect("sound");
    let mut json: serde_json::Value = serde_json::from_str(&given.to_json()).expect("JSON");
    json.as_object_mut().expect("an object").remove("largest_magnitude").expect("it was given");
    let relative = TransferFunction::from_json(&json.to_string()).expect("sound");
    for (sample_type, shown, passes) in [
        (SampleType::U8, range(5.0, f64::INFINITY), 1),
        (SampleType::I16, range(5.0, 60.0), 1),
        (SampleType::I16, range(5.0, f64::INFINITY), 1),
        (SampleType::F32, range(f64::NEG_INFINITY, 60.0), 1),
        (SampleType::F32, TransferFunction::contour(40.0).expect("sound"), 1),
        (SampleType::U8, TransferFunction::contour(40.0).expect("sound"), 1),
        (SampleType::U8, given, 1),
        (SampleType::U8, relative.clone(), 2),
        (SampleType::F32, relative, 2),
    ] {
        let mut volume = rough(sample_type);
        let built = build(&mut volume, &options(shown), &mut Unobserved).expect("builds");
        assert_eq!(volume.slices_read, 10 * passes, "{}", sample_type.name());
        assert_eq!(built.samples.surveyed, passes == 2);
    }
}

/// Lets `left` reports pass, then stops; writes down what it is told.
struct Stopper {
    left: usize,
    told: Vec<(Phase, u64, u64)>,
}

impl Observer for Stopper {
    fn progress(&mut self, phase: Phase, done: u64, total: u64) -> ControlFlow<()> {
        self.told.push((phase, done, total));
        if self.told.len() > self.left { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

fn point(value: f64) -> Point {
    Point { value, colour: Colour::from_bytes([200, 100, 50]), opacity: 0.5 }
}

fn observed(left: usize) -> (Result<u64>, Vec<(Phase, u64, u64)>) {
    let mut stopper = Stopper { left, told: Vec::new() };
    let options = options(range(5.0, f64::INFINITY));
    let built = build(&mut rough(SampleType::F32), &options, &mut stopper);
    (built.map(|built| built.facts.visible_voxels), stopper.told)
}

#[test]
fn a_build_stops_wherever_its_observer_says_so() {
    let (whole, told) = observed(usize::MAX);
    assert_eq!(whole.expect("builds"), 1320);
    let phases = [Phase::Pack, Phase::Assemble(Axis::X), Phase::Assemble(Axis::Y), Phase::Assemble(Axis::Z)];
    let mut seen: Vec<Phase> = told.iter().map(|(phase, _, _)| *phase).collect();
    seen.dedup();
    assert_eq!(seen, phases);
    assert!(told.iter().all(|(_, done, total)| done <= total));
    for left in 0..told.len() {
        let (result, told) = observed(left);
        assert!(matches!(result, Err(Error::Interrupted)), "after {left}");
        assert_eq!(told.len(), left + 1, "it stops at once");
    }
}

/// It said that nothing is visible, or that a value range cannot be used.
#[test]
fn a_slope_or_an_intercept_that_gives_no_values_is_named() {
    for (slope, intercept, named) in [
        (f64::NAN, 0.0, "slope: is NaN, "),
        (f64::INFINITY, 0.0, "slope: is inf, "),
        (0.0, 0.0, "slope: is 0e0, "),
        (1e-320, 0.0, "slope: is 1e-320, "),
        (1.0, f64::NAN, "intercept: is NaN, "),
        (1.0, f64::NEG_INFINITY, "intercept: is -inf, "),
    ] {
        for shown in [range(0.0, f64::INFINITY), TransferFunction::contour(40.0).expect("sound")] {
            let line = refused(&rough(SampleType::U8).scaled(slope, intercept), &options(shown));
            assert!(line.starts_with(named), "{line}");
        }
    }
}
