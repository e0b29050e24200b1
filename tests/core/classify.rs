//! Classification: opacities with known values, what JSON is refused and why, gradients and codes against their
//! bounds.
//!
//! Judged by closed forms (Levoy's formulas worked by hand, linear fields) and by the bounds that the codecs state.

use adjsplat::arena::layout::Scales;
use adjsplat::classify::colour::linear_from_srgb;
use adjsplat::classify::gradient::{GridAxes, length};
use adjsplat::classify::normal::{
    self, Coherence, NONE8, NONE16, decode, decode8, decode16, encode_coherent, encode8, encode16,
};
use adjsplat::classify::{
    Cap, Colour, Contour, Neighbourhood, PRESETS, Point, Quantiser, TransferFunction, UnlistedLabels,
};
use adjsplat::volume::{Grid, SampleType};
use adjsplat_tests::random::Random;

fn grey(value: f64, opacity: f64) -> Point {
    Point { value, colour: Colour::from_bytes([128; 3]), opacity }
}

// ---- transfer functions

#[test]
fn a_contour_has_the_opacities_of_levoys_formula() {
    let contour = |width| {
        let colour = Colour::from_bytes([255; 3]);
        TransferFunction::contours(vec![Contour { value: 128.0, opacity: 0.9, width, colour }]).unwrap()
    };
    let f = contour(2.0);
    for (value, magnitude, opacity) in [
        (128.0, 0.0, 0.9),
        (129.0, 0.0, 0.0),
        (138.0, 10.0, 0.45),
        (118.0, 10.0, 0.45),
        (147.0, 10.0, 0.045),
        (148.0, 10.0, 0.0),
        (149.0, 10.0, 0.0),
        (128.0, 1e-30, 0.9),
        (128.0001, 1e-30, 0.0),
        (f64::NAN, 10.0, 0.0),
        (f64::INFINITY, f64::INFINITY, 0.0),
        (f64::NEG_INFINITY, 10.0, 0.0),
        (128.0, f64::NAN, 0.9),
        (129.0, -5.0, 0.0),
        (1e308, f64::INFINITY, 0.9),
    ] {
        let got = f.opacity(value, magnitude);
        assert!((got - opacity).abs() < 1e-15, "{value} {magnitude}: {got}, not {opacity}");
    }
    assert!(f.uses_gradient());
    assert_eq!(f.domain(10.0), (108.0, 148.0));
    assert_eq!(f.domain(0.0), (128.0, 128.0));

    let hard = contour(0.0);
    assert_eq!([hard.opacity(128.0, 1e9), hard.opacity(128.0001, f64::INFINITY)], [0.9, 0.0]);
    assert!(!hard.uses_gradient());
    assert_eq!(hard.domain(f64::INFINITY), (128.0, 128.0));

    // A magnitude of 5 a millimetre is 10 a voxel of 2 mm.
    let millimetres = contour(2.0).with_voxel_length(2.0).unwrap();
    assert!((millimetres.opacity(138.0, 5.0) - 0.45).abs() < 1e-15);
    assert_eq!(millimetres.domain(5.0), (108.0, 148.0));
    // The function's own unit stays.
    assert_eq!(millimetres.clone().with_voxel_length(7.0).unwrap(), millimetres);
}

#[test]
fn several_contours_add_up_to_what_neither_lets_through() {
    let colour = Colour::from_bytes([255; 3]);
    let both = [(100.0, 0.5), (110.0, 0.8)].map(|(value, opacity)| Contour { value, opacity, width: 2.0, colour });
    let f = TransferFunction::contours(both.to_vec()).unwrap();
    let (a, b) = (0.5 * (1.0 - 4.0 / 20.0), 0.8 * (1.0 - 6.0 / 20.0));
    assert!((f.opacity(104.0, 10.0) - (1.0 - (1.0 - a) * (1.0 - b))).abs() < 1e-15);
    assert_eq!(f.domain(10.0), (80.0, 130.0));
}

#[test]
fn a_region_boundary_has_the_opacities_of_levoys_formula() {
    let f = TransferFunction::region(vec![grey(50.0, 0.0), grey(100.0, 0.6), grey(200.0, 0.2)], 20.0).unwrap();
    for (value, magnitude, opacity) in [
        (49.9, 20.0, 0.0),
        (50.0, 20.0, 0.0),
        (75.0, 20.0, 0.3),
        (75.0, 10.0, 0.15),
        (75.0, 0.0, 0.0),
        (100.0, 20.0, 0.6),
        (150.0, 20.0, 0.4),
        (150.0, 1e30, 0.4),
        (150.0, f64::INFINITY, 0.4),
        (200.0, 20.0, 0.2),
        (200.1, 20.0, 0.0),
    ] {
        let got = f.opacity(value, magnitude);
        assert!((got - opacity).abs() < 1e-15, "{value} {magnitude}: {got}, not {opacity}");
    }
    assert!(f.uses_gradient());
    assert_eq!(f.domain(20.0), (50.0, 200.0));
    let hidden = TransferFunction::region(vec![grey(1.0, 0.0), grey(2.0, 0.0)], 20.0).unwrap();
    let (low, high) = hidden.domain(20.0);
    assert!(low > high, "nothing is visible");
}

#[test]
fn a_range_shows_exactly_the_samples_inside() {
    let f = TransferFunction::range(30.0, 60.0).unwrap();
    let shown = [30.0f64.next_down(), 30.0, 45.0, 60.0, 60.0f64.next_up()].map(|v| f.opacity(v, 0.0));
    assert_eq!(shown, [0.0, 0.8, 0.8, 0.8, 0.0]);
    assert_eq!(f.domain(1.0), (30.0, 60.0));
    assert!(!f.uses_gradient() && f.shaded() && !f.is_labels());

    let open = TransferFunction::range(30.0, f64::INFINITY).unwrap();
    assert_eq!(open.opacity(f64::MAX, 0.0), 0.8);
    assert_eq!(open.opacity(f64::INFINITY, 0.0), 0.0, "a sample that is not finite is not visible");
    assert_eq!(open.domain(1.0), (30.0, f64::INFINITY));
    assert_eq!(open.colour(31.0), open.colour(1e9), "without the data's range there is one colour");
    let closed = open.clone().with_value_range(0.0, 130.0).unwrap();
    assert_ne!(closed.colour(31.0), closed.colour(120.0));
    assert_eq!(closed.colour(30.0), f.colour(30.0));
    assert_eq!(closed.colour(130.0), f.colour(60.0));
    assert_eq!(closed.domain(1.0), open.domain(1.0));
    // All colours are finite where the data's range is a single value, or beyond the open end.
    for single in [open.with_value_range(5.0, 5.0).unwrap(), TransferFunction::range(7.0, 7.0).unwrap()] {
        for value in [-1e308, 5.0, 7.0, 1e308] {
            assert!(single.colour(value).iter().all(|c| (0.0..=1.0).contains(c)));
        }
    }
    assert!(TransferFunction::range(f64::NAN, 1.0).is_err());
    assert!(TransferFunction::range(2.0, 1.0).is_err());
    assert!(TransferFunction::range(f64::INFINITY, f64::INFINITY).is_err());
    assert!(TransferFunction::contour(f64::NAN).is_err());
}

#[test]
fn points_are_linear_between_and_step_where_two_share_a_value() {
    let step = vec![grey(10.0, 0.0), grey(10.0, 0.4), grey(20.0, 0.8), grey(20.0, 0.0)];
    let f = TransferFunction::points(step, Vec::new()).unwrap();
    let got = [9.9, 10.0, 15.0, 20.0, 20.1].map(|v| f.opacity(v, 0.0));
    assert!(got.iter().zip([0.0, 0.4, 0.6, 0.8, 0.0]).all(|(a, b)| (a - b).abs() < 1e-15), "{got:?}");
    assert_eq!(f.domain(0.0), (10.0, 20.0));

    let ends = TransferFunction::points(vec![grey(0.0, 0.1), grey(1.0, 0.2)], Vec::new()).unwrap();
    assert_eq!([ends.opacity(-1e300, 0.0), ends.opacity(1e300, 0.0)], [0.1, 0.2], "the ends go on");
    assert_eq!(ends.domain(0.0), (f64::NEG_INFINITY, f64::INFINITY));

    let inner = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.5), (3.0, 0.0), (4.0, 0.0)].map(|(v, o)| grey(v, o));
    assert_eq!(TransferFunction::points(inner.to_vec(), Vec::new()).unwrap().domain(0.0), (1.0, 3.0));

    let huge = TransferFunction::points(vec![grey(-1.7e308, 0.0), grey(1.7e308, 1.0)], Vec::new()).unwrap();
    assert_eq!(huge.opacity(0.0, 0.0), 0.5);
    let tiny = TransferFunction::points(vec![grey(0.0, 0.0), grey(5e-324, 1.0)], Vec::new()).unwrap();
    assert_eq!([tiny.opacity(0.0, 0.0), tiny.opacity(5e-324, 0.0)], [0.0, 1.0]);
}

#[test]
fn a_gradient_ramp_multiplies_and_bounds_the_domain() {
    let f = TransferFunction::from_json(
        r##"{"kind":"points","points":[{"value":0,"colour":"#000000","opacity":0},{"value":10,"colour":"#ffffff","opacity":1}],
            "gradient":[{"magnitude":5,"factor":0},{"magnitude":15,"factor":1}]}"##,
    )
    .unwrap();
    assert_eq!([0.0, 5.0, 10.0, 15.0, 99.0].map(|m| f.opacity(10.0, m)), [0.0, 0.0, 0.5, 1.0, 1.0]);
    assert!(f.uses_gradient());
    assert_eq!(f.domain(6.0), (0.0, f64::INFINITY));
    let (low, high) = f.domain(5.0);
    assert!(low > high, "no magnitude up to 5 is visible");
}

#[test]
fn colours_are_mixed_in_linear_light() {
    let text = r##"{"kind":"points","points":[{"value":0,"colour":"#000000","opacity":1},{"value":1,"colour":[1,1,1],"opacity":1}]}"##;
    let f = TransferFunction::from_json(text).unwrap();
    assert_eq!([0.0, 0.5, 1.0].map(|v| f.colour(v)[0]), [0.0, 0.5, 1.0]);
    assert_eq!(f.colour(f64::NAN), [0.0; 3]);
    assert!((linear_from_srgb(0.5) - 0.214_041).abs() < 1e-6);
    assert_eq!(Colour::from_hex("#fF8000").unwrap().to_string(), "#ff8000");
    for wrong in ["ff8000", "#ff80", "#ff80000", "#gg0000", "#+f8000", "#é8000"] {
        assert!(Colour::from_hex(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn presets_are_valid_and_come_back_from_json_bit_for_bit() {
    for (name, _) in PRESETS {
        let f = TransferFunction::preset(name).unwrap();
        assert_eq!(TransferFunction::from_json(&f.to_json()).unwrap(), f, "{name}");
    }
    let bone = TransferFunction::preset("ct-bone").unwrap();
    let stored = TransferFunction::preset("ct-bone+1024").unwrap();
    assert_eq!(bone.domain(0.0).0 + 1024.0, stored.domain(0.0).0);
    assert_eq!(bone.opacity(300.0, 0.0), stored.opacity(1324.0, 0.0));
    assert_eq!(stored.domain(0.0).0, 1150.0, "where bone begins in the head of the manifest");
    assert!(TransferFunction::preset("ct-skin+1024").unwrap().opacity(550.0, 0.0) > 0.1);
    for wrong in ["bone", "ct-bone+", "ct-bone+x", "ct-bone+inf", "ct", ""] {
        assert!(TransferFunction::preset(wrong).is_err(), "{wrong}");
    }
    let message = TransferFunction::preset("bone").unwrap_err().to_string();
    assert_eq!(message, "preset \"bone\": is not one of ct-bone, ct-skin, ct-angio, mr, labels, frog, gyroid");
    let awkward = TransferFunction::range(0.1 + 0.2, 1.0 / 3.0).unwrap().with_reference_length(1e-7).unwrap();
    assert_eq!(TransferFunction::from_json(&awkward.to_json()).unwrap(), awkward);
    let open = TransferFunction::range(f64::NEG_INFINITY, 4.0).unwrap().with_shaded(false);
    assert_eq!(TransferFunction::from_json(&open.to_json()).unwrap(), open);
}

#[test]
fn thin_bones_do_not_look_like_vessels_in_a_ct_angiogram() {
    let angio = TransferFunction::preset("ct-angio").unwrap();
    // Vessels with contrast agent have 200 to 400, ribs 600 and more; the edges of both pass through 200.
    let [vessel, rib] = [300.0, 600.0].map(|value| angio.colour(value));
    assert!(vessel[0] > 4.0 * vessel[1], "red: {vessel:?}");
    assert!(rib[0] < 1.5 * rib[1], "ivory: {rib:?}");
    let [edge, inside] = [200.0, 600.0].map(|value| angio.opacity(value, 0.0));
    assert!(edge < 0.3 && inside > 0.8, "the inside shows through the edge: {edge}, {inside}");
}

#[test]
fn wrong_json_is_refused_with_the_place_and_the_remedy() {
    let point = |value: &str, opacity: &str| format!(r##"{{"value":{value},"colour":"#ffffff","opacity":{opacity}}}"##);
    let points = |list: &[String]| format!(r#"{{"kind":"points","points":[{}]}}"#, list.join(","));
    let regions = |list: &[String]| format!(r#"{{"kind":"region","knots":[{}]}}"#, list.join(","));
    let contour = |fields: &str| format!(r#"{{"kind":"contour","contours":[{{{fields}}}]}}"#);
    let (zero, one) = (point("0", "0"), point("1", "1"));
    for (text, part) in [
        (String::new(), "line 1"),
        ("[]".into(), "line 1"),
        ("{}".into(), "missing field `kind`"),
        (r#"{"kind":"cubic"}"#.into(), "unknown variant `cubic`"),
        (r#"{"kind":"points"}"#.into(), "needs the field \"points\""),
        (r#"{"kind":"range","low":1,"colour":"red"}"#.into(), "unknown field `colour`"),
        (r#"{"kind":"range","low":1,"contours":[]}"#.into(), "contours: belongs to the kind \"contour\""),
        (r#"{"kind":"range","low":2,"high":1}"#.into(), "must go from a lower to a higher"),
        (r#"{"kind":"range","low":NaN}"#.into(), "line 1 column"),
        (r#"{"kind":"range","low":1e999}"#.into(), "out of range"),
        (r#"{"kind":"range","low":1,"low":2}"#.into(), "duplicate field"),
        (r#"{"kind":"range","colours":[]}"#.into(), "colours: has 0, but needs at least 1"),
        (r##"{"kind":"range","colours":["#12345"]}"##.into(), "must be \"#rrggbb\""),
        (r#"{"kind":"range","colours":[[0,0,2]]}"#.into(), "must have 0 to 1"),
        (r#"{"kind":"range","colours":[[0,0]]}"#.into(), "invalid length 2"),
        (r#"{"kind":"range","colours":[[0,0,0,0]]}"#.into(), "invalid length 4"),
        (r#"{"kind":"range","colours":[7]}"#.into(), "expected a colour"),
        (r#"{"kind":"range","opacity":-0.1}"#.into(), "opacity: is -0.1, but must be from 0 to 1"),
        (r#"{"kind":"range","value_range":[2,1]}"#.into(), "value_range: has its lowest"),
        (r#"{"kind":"range","reference_length":0}"#.into(), "reference_length: is 0"),
        (points(&[]), "points: has 0, but needs at least 1"),
        (points(&[zero.clone(), point("1", "1.5")]), "points[1].opacity: is 1.5"),
        (points(&[one.clone(), zero.clone()]), "points[1].value: is 0, below the 1 before it; sort them"),
        (points(&[zero.clone(), zero.clone(), zero.clone()]), "points[2].value: is 0, as two before it"),
        (points(&[point("null", "0")]), "line 1"),
        (points(&[point("\"1\"", "0")]), "line 1"),
        (
            format!(r#"{{"kind":"points","points":[{one}],"gradient":[{{"magnitude":-1,"factor":0}}]}}"#),
            "gradient[0].magnitude: is -1",
        ),
        (
            format!(r#"{{"kind":"points","points":[{one}],"gradient":[{{"magnitude":1,"factor":2}}]}}"#),
            "gradient[0].factor: is 2",
        ),
        (regions(std::slice::from_ref(&zero)), "knots: has 1, but needs at least 2"),
        (regions(&[zero.clone(), zero.clone()]), "knots[1].value: is 0, as the one before it"),
        (regions(&[one.clone(), zero.clone()]), "knots[1].value: is 0, below the 1 before it"),
        (contour(r#""value":1e400,"opacity":1"#), "out of range"),
        (contour(r#""value":1,"opacity":1,"width":-1"#), "contours[0].width: is -1"),
        (contour(r#""value":1,"opacity":1,"width":Infinity"#), "line 1"),
        (contour(r#""value":1,"opacity":1,"radius":2"#), "unknown field `radius`"),
        (r#"{"kind":"contour","contours":[],"voxel_length":1}"#.into(), "contours: has 0"),
        (r#"{"kind":"contour","contours":[{"value":1,"opacity":1}],"voxel_length":0}"#.into(), "voxel_length: is 0"),
        (r#"{"kind":"contour","contours":[{"value":1,"opacity":1}],"cap":true}"#.into(), "line 1"),
        (r#"{"kind":"contour","contours":[{"value":1,"opacity":1}],"cap":"both"}"#.into(), "`above` or `below`"),
        (r#"{"kind":"contour","contours":[{"value":1,"opacity":1,"width":0}],"cap":"above"}"#.into(), "cap: needs exactly"),
        (
            r#"{"kind":"contour","contours":[{"value":1,"opacity":1},{"value":2,"opacity":1}],"cap":"above"}"#.into(),
            "cap: needs exactly one contour",
        ),
        (r#"{"kind":"range","low":1,"cap":"above"}"#.into(), "cap: belongs to the kind \"contour\""),
        (r##"{"kind":"labels","labels":[{"label":1.5,"name":"a","colour":"#000000"}]}"##.into(), "1.5"),
        (
            r##"{"kind":"labels","labels":[{"label":1,"name":"a","colour":"#000000"},{"label":1,"name":"b","colour":"#000000"}]}"##
                .into(),
            "labels: has label 1 twice",
        ),
        (
            r##"{"kind":"labels","labels":[{"label":3,"name":"a","colour":"#000000","opacity":9}]}"##.into(),
            "opacity of label 3: is 9",
        ),
        (r#"{"kind":"labels","labels":[],"others":"all"}"#.into(), "unknown variant `all`"),
        (r#"{"kind":"range"} {}"#.into(), "trailing characters"),
    ] {
        let error = TransferFunction::from_json(&text).expect_err(&text).to_string();
        assert!(error.starts_with("transfer function") && error.contains(part), "{text}\n gives {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    let accepted = [r#"{"kind":"range"}"#, r#"{"kind":"range","low":null,"high":1e308}"#];
    assert!(accepted.iter().all(|text| TransferFunction::from_json(text).is_ok()));
}

#[test]
fn palettes_come_from_json_slicer_tables_and_built_in() {
    let table = "# comment\n0 background 0 0 0 0\n\n 7 left_lung  255 128 0 51\n3 liver with spaces 1 2 3 255\n";
    let f = TransferFunction::from_ctbl(table).unwrap();
    assert!(f.is_labels() && !f.uses_gradient());
    assert_eq!([0.0, 3.0, 7.0, 4.0, 3.5, -3.0].map(|v| f.opacity(v, 0.0)), [0.0, 1.0, 0.2, 0.0, 0.0, 0.0]);
    assert_eq!(f.colour(7.0), Colour::from_bytes([255, 128, 0]).linear());
    assert!(["left lung", "liver with spaces"].iter().all(|name| f.to_json().contains(name)));
    assert_eq!(f.domain(0.0), (3.0, 7.0));
    assert_eq!(TransferFunction::from_json(&f.to_json()).unwrap(), f);
    for (text, part) in [
        ("", "has no labels"),
        ("1 a 1 2 3", "line 1: has fewer"),
        ("# x\nx a 1 2 3 4", "line 2: does not start with a whole number"),
        ("1 a 1 2 256 4", "line 1: must end in r g b a"),
        ("1 a 1 2 3 4\n1 b 1 2 3 4", "line 2: repeats a label"),
    ] {
        let error = TransferFunction::from_ctbl(text).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }

    let frog = TransferFunction::preset("frog").unwrap();
    assert!(frog.to_json().contains("skeleton"));
    assert_eq!([0.0, 1.0, 15.0, 16.0, 29.0].map(|v| frog.opacity(v, 0.0)), [0.0, 1.0, 1.0, 0.0, 0.0]);
    assert_eq!(frog.domain(0.0), (1.0, 15.0));

    let any = TransferFunction::preset("labels").unwrap();
    assert_eq!([-1.0, 0.0, 1.0, 141.0, 65_535.0].map(|v| any.opacity(v, 0.0)), [0.0, 0.0, 1.0, 1.0, 1.0]);
    assert_eq!(any.domain(0.0), (1.0, f64::INFINITY));
    let distance = |a: f64, b: f64| {
        let (a, b) = (any.colour(a), any.colour(b));
        (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
    };
    for a in 1..40 {
        assert!(distance(a.into(), f64::from(a) + 1.0) > 0.1, "neighbours {a} differ");
        for b in 1..a {
            assert!(distance(a.into(), b.into()) > 0.008, "{a} and {b} differ");
        }
    }
    let hidden = TransferFunction::labels(Vec::new(), UnlistedLabels::Transparent).unwrap();
    assert!(hidden.domain(0.0).0 > hidden.domain(0.0).1);
}

#[test]
fn a_file_that_cannot_be_used_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.json");
    let error = TransferFunction::read(&path).unwrap_err().to_string();
    assert!(error.starts_with("cannot read ") && error.ends_with("mine.json"), "{error}");
    std::fs::write(&path, r#"{"kind":"range","opacity":2}"#).unwrap();
    let error = TransferFunction::read(&path).unwrap_err().to_string();
    assert!(error.contains("mine.json: transfer function: opacity: is 2"), "{error}");
    let table = folder.path().join("mine.CTBL");
    std::fs::write(&table, "1 a 1 2 3 255").unwrap();
    assert!(TransferFunction::read(&table).unwrap().is_labels());
}

// ---- gradients

/// Gradients at every sample of a field of `dims`.
fn gradients(dims: [usize; 3], spacing: [f64; 3], field: impl Fn([usize; 3]) -> f32) -> Vec<([usize; 3], [f64; 3])> {
    let slice = |z: usize| -> Vec<f32> {
        (0..dims[1]).flat_map(|y| (0..dims[0]).map(move |x| [x, y, z])).map(&field).collect()
    };
    let slices: Vec<Vec<f32>> = (0..dims[2]).map(slice).collect();
    let mut all = Vec::new();
    for z in 0..dims[2] {
        let below = z.checked_sub(1).map(|z| &slices[z][..]);
        let above = slices.get(z + 1).map(|slice| &slice[..]);
        let here = Neighbourhood::new(below, &slices[z], above, [dims[0], dims[1]], spacing);
        for y in 0..dims[1] {
            all.extend((0..dims[0]).map(|x| ([x, y, z], here.slopes(x, y))));
        }
    }
    all
}

/// Slopes along axes that are not at right angles were taken for the gradient's components: 37 degrees off here.
#[test]
fn gradients_of_sheared_grids_are_those_of_the_world() {
    let gradient = [0.3, -0.5, 0.8];
    for (direction, size) in [
        ([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]], 1.0),
        ([[0.0, 0.28, 0.96], [0.6, 0.8, 0.0], [-1.0, 0.0, 0.0]], 1e200),
        ([[0.0, 0.6, 0.8], [0.0, -0.8, 0.6], [1.0, 0.0, 0.0]], 1e-200),
    ] {
        let grid = Grid { direction, ..Grid::new([2, 2, 2], [1.0; 3]).unwrap() };
        let axes = GridAxes::of(&grid);
        let slopes = direction.map(|axis| (0..3).map(|w| axis[w] * gradient[w] * size).sum());
        assert!((axes.magnitude(slopes) / (size * length(gradient)) - 1.0).abs() < 1e-12, "{direction:?}");
        let along = axes.along(slopes);
        let world: [f64; 3] = std::array::from_fn(|w| (0..3).map(|a| direction[a][w] * along[a]).sum());
        for w in 0..3 {
            assert!((world[w] / length(world) - gradient[w] / length(gradient)).abs() < 1e-12, "{direction:?}");
        }
    }
}

/// Rounded to single precision, samples near 2e9 differ by multiples of 128, and a ball of 200 levels was lit as flat steps.
#[test]
fn small_differences_of_large_samples_have_gradients() {
    let samples = [0, 1, 3].map(|level| 2_000_000_000 + level);
    let row = Neighbourhood::new(None, &samples, None, [3, 1], [1.0; 3]);
    assert_eq!([0, 1, 2].map(|x| row.slopes(x, 0)[0]), [1.0, 1.5, 2.0]);
    let values = [0.0, 0.25, 0.5].map(|level| 1e9 + level);
    let row = Neighbourhood::new(None, &values, None, [3, 1], [1.0; 3]).scaled(2.0, 1e9);
    assert_eq!([0, 1, 2].map(|x| row.slopes(x, 0)[0]), [0.5; 3]);
    let ends = [f64::MIN, 0.0, f64::MAX];
    let row = Neighbourhood::new(None, &ends, None, [3, 1], [1e-9; 3]);
    assert_eq!([0, 1, 2].map(|x| row.slopes(x, 0)[0]), [f64::MAX; 3]);
}

#[test]
fn gradients_are_exact_on_linear_fields_at_faces_too() {
    let (a, b, c) = (3.0, -7.0, 0.5);
    for (spacing, dims) in [([1.0, 1.0, 5.0], [4, 5, 6]), ([0.25, 2.0, 8.0], [2, 3, 2]), ([1.0, 1.0, 5.0], [3, 1, 4])] {
        #[expect(clippy::cast_possible_truncation, reason = "small whole numbers and halves")]
        let field = |at: [usize; 3]| {
            let world = [0, 1, 2].map(|axis| at[axis] as f64 * spacing[axis]);
            (a * world[0] + b * world[1] + c * world[2]) as f32
        };
        let expected = [a, if dims[1] == 1 { 0.0 } else { b }, c];
        for (at, gradient) in gradients(dims, spacing, field) {
            for axis in 0..3 {
                assert!((gradient[axis] - expected[axis]).abs() < 1e-14, "{at:?} {gradient:?}");
            }
        }
    }
}

#[test]
fn gradients_next_to_samples_that_are_not_finite_are_one_sided() {
    for poison in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        // 10 x, with the middle poisoned.
        let field = |[x, y, z]: [usize; 3]| if [x, y, z] == [2, 1, 1] { poison } else { 10.0 * x as f32 };
        for (at, gradient) in gradients([5, 3, 3], [1.0; 3], field) {
            assert!(gradient.iter().all(|c| c.is_finite()), "{at:?} {gradient:?}");
            if at != [2, 1, 1] {
                assert_eq!(gradient, [10.0, 0.0, 0.0], "{at:?}");
            }
        }
    }
    for (at, gradient) in gradients([3, 3, 3], [1.0; 3], |_| f32::NAN) {
        assert_eq!(gradient, [0.0; 3], "{at:?}");
    }
    assert_eq!(gradients([1, 1, 1], [1.0; 3], |_| 5.0)[0].1, [0.0; 3]);
}

#[test]
fn gradients_and_normals_survive_extreme_ranges_and_spacings() {
    let checker = |amplitude: f32| move |[x, _, _]: [usize; 3]| if x < 2 { -amplitude } else { amplitude };
    for amplitude in [f32::MAX, 1e38, 1.0, 1e-38, 1e-45] {
        for spacing in [1e-310, 1e-30, 1.0, 1e30] {
            for (at, gradient) in gradients([4, 2, 2], [spacing; 3], checker(amplitude)) {
                assert!(gradient.iter().all(|c| c.is_finite()));
                assert!(length(gradient).is_finite());
                let normal = decode8(encode8(gradient));
                let inside = (1..=2).contains(&at[0]);
                assert_eq!(normal, [if inside { -1.0 } else { 0.0 }, 0.0, 0.0], "{amplitude} {spacing} {at:?}");
            }
        }
    }
    // Three axes with the same tiny spacing: the direction holds.
    let diagonal = |[x, y, z]: [usize; 3]| (x + y + z) as f32 * 1e37;
    for (_, gradient) in gradients([3, 3, 3], [1e-308; 3], diagonal) {
        assert!(decode16(encode16(gradient)).iter().all(|c| (c + 1.0 / 3f32.sqrt()).abs() < 1e-4));
    }
    for size in [1e-200, 1e-150, 1e-100, 1.0, 1e100, 1e150, 1e200] {
        let found = length([3.0 * size, 4.0 * size, 12.0 * size]);
        assert!((found / size - 13.0).abs() < 1e-14, "{size} {found}");
    }
    assert_eq!(length([0.0; 3]), 0.0);
}

#[test]
fn gradients_of_steps_in_every_integer_type_keep_their_sign() {
    for (low, high) in [(0.0, 255.0), (0.0, 65_535.0), (-1024.0, 3071.0)] {
        for (at, gradient) in gradients([2, 2, 4], [1.0, 1.0, 5.0], |[_, _, z]| if z < 2 { low } else { high }) {
            let expected = if (1..=2).contains(&at[2]) { f64::from(high - low) / 10.0 } else { 0.0 };
            assert!((gradient[2] - expected).abs() < 1e-9, "{at:?} {gradient:?}");
        }
    }
}

// ---- normals

/// Mean and largest angle, in degrees, between directions and their decoded codes.
fn angles(count: u32, code: impl Fn([f64; 3]) -> [f32; 3]) -> (f64, f64) {
    let mut random = Random(0x00ad_75b1);
    let (mut sum, mut most) = (0.0, 0.0f64);
    for _ in 0..count {
        let n = random.direction();
        let d = code(n.map(|c| -c)).map(f64::from);
        let cross = [n[1] * d[2] - n[2] * d[1], n[2] * d[0] - n[0] * d[2], n[0] * d[1] - n[1] * d[0]];
        let sine = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
        let cosine = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
        let angle = sine.atan2(cosine).to_degrees();
        sum += angle;
        most = most.max(angle);
    }
    (sum / f64::from(count), most)
}

#[test]
fn normals_are_within_the_stated_angles() {
    let (mean, most) = angles(2_000_000, |g| decode8(encode8(g)));
    assert!(mean < 0.3152 && most < 0.6381, "2x8: mean {mean}, largest {most}");
    let (mean, most) = angles(2_000_000, |g| decode16(encode16(g)));
    assert!(mean < 0.001_23 && most < 0.002_48, "2x16: mean {mean}, largest {most}");
}

#[test]
fn coherent_normals_are_within_the_stated_angles_and_keep_their_coherence() {
    for (alike, bare) in [(1.0, 0.0), (0.93, 0.11), (0.7, 0.9), (0.4, 0.04), (-0.3, 0.3)] {
        let wanted = Coherence { alike, bare };
        // The nearest numbers.
        let got = Coherence {
            alike: [1.0, 0.85, 0.6, 0.25]
                .into_iter()
                .min_by(|a: &f32, b| (a - alike).abs().total_cmp(&(b - alike).abs()))
                .unwrap(),
            bare: if bare > 0.1 { 0.2 } else { 0.0 },
        };
        for (bits, most_mean, most_angle) in [(8, 0.97, 2.41), (16, 0.0038, 0.0094)] {
            let (mean, most) = angles(200_000, |gradient| {
                let code = encode_coherent(gradient, wanted, bits);
                assert_eq!(Coherence::of_code(code, bits), got, "{code:#x}");
                decode(code, bits)
            });
            assert!(mean < most_mean && most < most_angle, "{wanted:?}, 2x{bits}: mean {mean}, largest {most}");
            let none = encode_coherent([0.0; 3], wanted, bits);
            assert_eq!((none, Coherence::of_code(none, bits)), (normal::none(bits), Coherence::ONE));
        }
    }
}

#[test]
fn every_code_decodes_to_a_unit_vector() {
    let length_error = |v: [f32; 3]| (v.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt() - 1.0).abs();
    for code in 0..=u16::MAX {
        let v = decode8(code);
        if code == NONE8 {
            assert_eq!(v, [0.0; 3]);
        } else {
            assert!(length_error(v) < 1e-6, "{code:#x} {v:?}");
            // And comes back as a code of the same vector.
            let again = decode8(encode8(v.map(|c| f64::from(-c))));
            assert!((0..3).all(|c| (again[c] - v[c]).abs() < 1e-6), "{code:#x} {v:?} {again:?}");
        }
    }
    let mut random = Random(9);
    for _ in 0..1_000_000 {
        let code = u32::try_from(random.next() >> 32).unwrap();
        assert!(code == NONE16 || length_error(decode16(code)) < 1e-6, "{code:#x}");
    }
    assert_eq!(decode16(NONE16), [0.0; 3]);
}

#[test]
fn normals_of_axes_diagonals_and_fold_edges_are_right() {
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut gradient = [0.0; 3];
            gradient[axis] = -7.5 * sign;
            for normal in [decode8(encode8(gradient)), decode16(encode16(gradient))] {
                #[expect(clippy::cast_possible_truncation, reason = "plus or minus 1")]
                let expected: [f32; 3] = std::array::from_fn(|a| if a == axis { sign as f32 } else { 0.0 });
                assert_eq!(normal, expected);
            }
        }
    }
    let close = |gradient: [f64; 3]| {
        let size = length(gradient);
        let (narrow, wide) = (decode8(encode8(gradient)), decode16(encode16(gradient)));
        for c in 0..3 {
            assert!((f64::from(narrow[c]) + gradient[c] / size).abs() < 0.0112, "{gradient:?} {narrow:?}");
            assert!((f64::from(wide[c]) + gradient[c] / size).abs() < 4.5e-5, "{gradient:?} {wide:?}");
        }
    };
    for bits in 0..8 {
        close([0, 1, 2].map(|a| if bits >> a & 1 == 0 { 1.0 } else { -1.0 }));
    }
    for (a, b) in [(0.3, 0.7), (-0.3, 0.7), (0.3, -0.7), (-0.3, -0.7), (1.0, 1e-20), (1e-20, -1.0)] {
        for zero in [0.0, -0.0] {
            close([a, b, zero]);
            close([a, zero, b]);
            close([zero, a, b]);
        }
    }
}

#[test]
fn a_gradient_without_direction_has_no_normal() {
    for none in [[0.0; 3], [-0.0; 3], [f64::NAN, 1.0, 0.0], [f64::INFINITY, 1.0, 1.0], [1.0, 0.0, f64::NEG_INFINITY]] {
        assert_eq!((encode8(none), encode16(none)), (NONE8, NONE16), "{none:?}");
    }
    for tiny in [5e-324, 1e-310, 1e-200, 1e-40, 1e200, 1.7e308] {
        assert_eq!(decode8(encode8([0.0, tiny, 0.0])), [0.0, -1.0, 0.0], "{tiny}");
        assert_eq!(encode8([tiny; 3]), encode8([1.0; 3]), "{tiny}");
    }
}

// ---- value codes

#[test]
fn whole_number_samples_come_back_bit_for_bit() {
    for (ty, slope, intercept, low, high, bits) in [
        (SampleType::U8, 1.0, 0.0, 1.0, 255.0, 8),
        (SampleType::U8, 1.0, 0.0, f64::NEG_INFINITY, f64::INFINITY, 8),
        (SampleType::U8, 1.0 / 3.0, 0.1, 5.0, 60.0, 8),
        (SampleType::U8, -0.7, 3.3, -150.0, 2.0, 8),
        (SampleType::I16, 1.0, -1024.0, 130.5, 380.25, 8),
        (SampleType::I16, 1.0, -1024.0, 130.0, 3000.0, 16),
        (SampleType::U16, 1.0 / 257.0, 0.0, 0.0, 255.0, 16),
        (SampleType::I8, 1.0, 0.0, -128.0, 127.0, 8),
        (SampleType::U32, 1e-3, 1e6, 4_000_000.0, 4_000_000.25, 8),
        (SampleType::I32, 1e6, 0.1, -2e15, -1.99996e15, 16),
    ] {
        let q = Quantiser::new([low, high], bits, ty, slope, intercept).unwrap();
        assert!(q.is_lossless(), "{ty:?} {slope}");
        let (first, last) = ty.integer_range().unwrap();
        let mut expected = 0u32;
        // Walks raw samples near the range, in the order of values.
        let start = (((low - intercept) / slope).round() - 5.0 * slope.signum()).clamp(first, last);
        let mut raw = start;
        while (first..=last).contains(&raw) {
            let value = raw * slope + intercept;
            if value > high {
                break;
            }
            if value >= low {
                let code = q.encode(value);
                assert_eq!(u32::from(code), expected, "{ty:?} {raw}");
                assert_eq!(q.decode(code).to_bits(), value.to_bits());
                expected += 1;
            }
            raw += slope.signum();
        }
        assert_eq!(u32::from(q.largest_code()) + 1, expected);
        assert_eq!((q.decode(0), q.decode(q.largest_code())), (q.low(), q.high()));
    }
}

/// Readers compute values from codes alone. A float64 export lost the voxels at the top when it was built again with the same range.
#[test]
fn no_code_has_a_value_beyond_the_range() {
    let mut random = Random(5);
    let mut ranges =
        vec![[-1.7, 0.42], [-2.19, 2.05], [-1.7e308, 1.7e308], [0.0, 5e-324], [-1e300, 1.0], [1e16, 1e16 + 4.0]];
    ranges.extend((0..2000).map(|_| {
        let [low, size] = [0; 2].map(|_| (random.number() * 1000.0).round() / 100.0);
        [low - 5.0, low - 5.0 + size + 0.01]
    }));
    for [low, high] in ranges {
        for bits in [8, 16] {
            let q = Quantiser::new([low, high], bits, SampleType::F64, 1.0, 0.0).unwrap();
            let scales = Scales { value_low: q.low(), value_step: q.step(), magnitude_scale: 0.0 };
            let last = scales.value(q.largest_code().into());
            let step = q.step();
            assert!(last <= high && high - last <= 1e-9 * step + high.abs() * 1e-15 + 5e-324, "{low} {high}: {last}");
        }
    }
}

#[test]
fn other_values_are_within_half_a_step_and_attain_both_ends() {
    let mut random = Random(77);
    for (ty, low, high, bits) in [
        (SampleType::F32, 0.05, 1.0, 8),
        (SampleType::F32, -1e38, 1e38, 16),
        (SampleType::F64, -1.7e308, 1.7e308, 8),
        (SampleType::F32, 1e-38, 3e-38, 8),
        (SampleType::F64, 0.0, 5e-324, 8),
        (SampleType::U16, 100.0, 4000.0, 8),
        (SampleType::I16, 0.1, 3926.7, 8),
    ] {
        let q = Quantiser::new([low, high], bits, ty, 1.0, 0.0).unwrap();
        assert!(!q.is_lossless());
        assert_eq!((q.encode(q.low()), q.encode(q.high())), (0, q.largest_code()));
        assert_eq!((q.decode(0), q.decode(q.largest_code())), (q.low(), q.high()));
        assert_eq!(q.decode(u16::MAX), q.high());
        assert_eq!([f64::NAN, f64::NEG_INFINITY, f64::INFINITY].map(|v| q.encode(v)), [0, 0, q.largest_code()]);
        for _ in 0..20_000 {
            let share = random.number();
            let value = q.low() * (1.0 - share) + q.high() * share;
            let error = (q.decode(q.encode(value)) - value).abs();
            assert!(error <= q.step() / 2.0 * (1.0 + 1e-9) + 5e-324, "{ty:?} {value}: {error}, step {}", q.step());
        }
    }
    let whole = Quantiser::new([0.1, 3926.7], 8, SampleType::I16, 1.0, 0.0).unwrap();
    assert_eq!((whole.low(), whole.high()), (1.0, 3926.0), "shrunk to samples");
}

#[test]
fn degenerate_and_wrong_ranges_of_values() {
    for (ty, low, high) in [(SampleType::F32, 3.5, 3.5), (SampleType::U8, 3.0, 3.0), (SampleType::U8, 3.2, 3.8)] {
        let q = Quantiser::new([low, high], 8, ty, 1.0, 0.0).unwrap();
        assert_eq!((q.largest_code(), q.decode(0), q.decode(9), q.encode(3.1)), (0, low, low, 0), "{ty:?} {low}");
    }
    let inf = f64::INFINITY;
    for (low, high, bits, ty, slope, part) in [
        (2.0, 1.0, 8, SampleType::U8, 1.0, "low end"),
        (f64::NAN, 1.0, 8, SampleType::U8, 1.0, "low end"),
        (0.0, 1.0, 12, SampleType::U8, 1.0, "8 or 16"),
        (0.0, 1.0, 8, SampleType::U8, 0.0, "slope"),
        (0.0, 1.0, 8, SampleType::U8, f64::NAN, "slope"),
        (0.0, inf, 8, SampleType::F32, 1.0, "finite ends"),
    ] {
        let error = Quantiser::new([low, high], bits, ty, slope, 0.0).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn labels_keep_their_codes_or_say_which_bits_would_do() {
    let labels = |high: f64, bits, ty| Quantiser::for_labels([1.0, high], bits, ty, 1.0, 0.0);
    assert_eq!(labels(141.0, 8, SampleType::U8).unwrap().encode(141.0), 140);
    assert_eq!(labels(256.0, 8, SampleType::U16).unwrap().largest_code(), 255);
    let error = labels(257.0, 8, SampleType::U16).unwrap_err().to_string();
    assert!(error.contains("use 16-bit values"), "{error}");
    assert!(labels(257.0, 16, SampleType::U16).is_ok());
    let error = labels(70_000.0, 16, SampleType::U32).unwrap_err().to_string();
    assert!(error.contains("renumber"), "{error}");
    let error = labels(70_000.0, 8, SampleType::U32).unwrap_err().to_string();
    assert!(error.contains("renumber"), "{error}");
    assert!(labels(3.0, 8, SampleType::F32).unwrap_err().to_string().contains("whole numbers"));
}

const EVERYWHERE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

fn range(low: f64, high: f64) -> TransferFunction {
    TransferFunction::range(low, high).unwrap()
}

fn json(text: &str) -> TransferFunction {
    TransferFunction::from_json(text).unwrap()
}

#[test]
fn what_was_not_stored_is_found_exactly() {
    let (low, high) = (f64::NEG_INFINITY, f64::INFINITY);
    let missing = |shown: &TransferFunction, stored: &TransferFunction| shown.missing_from(stored, EVERYWHERE, high);
    assert_eq!(missing(&range(20.0, 60.0), &range(20.0, 60.0)), [[0.0; 2]; 0]);
    assert_eq!(missing(&range(30.0, 50.0), &range(20.0, 60.0)), [[0.0; 2]; 0]);
    assert_eq!(missing(&range(20.0, 60.0), &range(30.0, 50.0)), [[20.0, 30.0], [50.0, 60.0]]);
    assert_eq!(missing(&range(20.0, 60.0), &range(70.0, 80.0)), [[20.0, 60.0]]);
    assert_eq!(missing(&range(low, high), &range(70.0, high)), [[low, 70.0]]);
    assert_eq!(missing(&range(low, high), &range(low, high)), [[0.0; 2]; 0]);
    // The volume has no other values.
    assert_eq!(range(low, high).missing_from(&range(70.0, 255.0), [70.0, 255.0], high), [[0.0; 2]; 0]);
    assert_eq!(range(low, high).missing_from(&range(70.0, 255.0), [0.0, 255.0], high), [[0.0, 70.0]]);
    // A ramp is visible from beyond its transparent knot on: the knot's own value is stored by the range alone.
    let ramp = r##"{"kind":"points","points":[{"value":20,"colour":"#fff000","opacity":0},{"value":60,"colour":"#fff000","opacity":1}]}"##;
    assert_eq!(missing(&range(20.0, 60.0), &json(ramp)), [[20.0, 20.0]]);
    assert_eq!(missing(&json(ramp), &range(20.0, 60.0)), [[60.0, high]]);
    // Knots that rounding put apart are the same.
    assert_eq!(missing(&range(0.3, 1.0), &range(0.1 + 0.2, 1.0)), [[0.3, 0.3]; 0]);
}

#[test]
fn a_cap_that_was_not_built_is_missing_and_json_keeps_it() {
    let open = TransferFunction::contour(50.0).unwrap();
    let [above, below] = [Cap::Above, Cap::Below].map(|side| open.clone().with_cap(side).unwrap());
    assert_eq!((open.cap(), above.cap()), (None, Some(Cap::Above)));
    assert!(above.to_json().contains(r#""cap": "above""#) && !open.to_json().contains("cap"));
    for function in [&open, &above, &below] {
        assert_eq!(&json(&function.to_json()), function);
    }
    assert_eq!(above.missing_from(&open, EVERYWHERE, 0.0), [[50.0, f64::INFINITY]]);
    assert_eq!(below.missing_from(&open, [0.0, 100.0], 0.0), [[0.0, 50.0]]);
    assert_eq!(above.missing_from(&above, EVERYWHERE, 9.0), [[0.0; 2]; 0]);
    assert_eq!(open.missing_from(&above, EVERYWHERE, 9.0), [[0.0; 2]; 0]);
    let error = range(1.0, 2.0).with_cap(Cap::Above).unwrap_err().to_string();
    assert!(error.contains("cap: closes the surface of an iso-value"), "{error}");
    // Only what is visible without a gradient has an inside.
    let ramp = |least: f64| {
        json(&format!(
            r##"{{"kind":"points","points":[{{"value":1,"colour":"#ffffff","opacity":1}}],
                "gradient":[{{"magnitude":1,"factor":{least}}},{{"magnitude":2,"factor":1}}]}}"##
        ))
    };
    let shown = [&range(1.0, 9.0), &ramp(0.1), &ramp(0.0), &open].map(|function| function.shows_cut(5.0));
    assert_eq!(shown, [true, true, false, false]);
    let shown = [49.0, 50.0, 51.0].map(|value| [above.shows_cut(value), below.shows_cut(value)]);
    assert_eq!(shown, [[false, true], [false, false], [true, false]]);
}

#[test]
fn labels_that_were_not_stored_are_whole_numbers() {
    let palette = |labels: &[i64], others: UnlistedLabels| {
        let label = |&label: &i64| adjsplat::classify::Label {
            label,
            name: String::new(),
            colour: Colour::from_hex("#ffffff").unwrap(),
            opacity: 1.0,
        };
        TransferFunction::labels(labels.iter().map(label).collect(), others).unwrap()
    };
    let (few, more) =
        (palette(&[1, 2, 7], UnlistedLabels::Transparent), palette(&[1, 2, 5, 7, 9], UnlistedLabels::Transparent));
    let all = palette(&[], UnlistedLabels::Distinct);
    let values = [0.0, 20.0];
    assert_eq!(few.missing_from(&more, values, 0.0), [[0.0; 2]; 0]);
    assert_eq!(more.missing_from(&few, values, 0.0), [[5.0, 5.0], [9.0, 9.0]]);
    assert_eq!(all.missing_from(&few, values, 0.0), [[3.0, 6.0], [8.0, 20.0]]);
    assert_eq!(all.missing_from(&few, EVERYWHERE, 0.0), [[3.0, 6.0], [8.0, f64::INFINITY]]);
    assert_eq!(range(0.0, 8.0).missing_from(&few, values, 0.0), [[0.0, 0.0], [3.0, 6.0], [8.0, 8.0]]);
    assert_eq!(few.missing_from(&range(1.0, 7.0), values, 0.0), [[0.0; 2]; 0]);
}

/// A function of whole-number knots from 0 to 40, of any kind but labels.
fn any_function(random: &mut Random) -> TransferFunction {
    let mut pick = |most: u64| random.next() % (most + 1);
    let mut knots: Vec<u64> = (0..=pick(3) + 1).map(|_| pick(40)).collect();
    knots.sort_unstable();
    knots.dedup();
    let point = |value: &u64, opacity: u64| {
        format!(r##"{{"value":{value},"colour":"#fff000","opacity":{}}}"##, opacity as f64 / 2.0)
    };
    let kind = pick(4);
    match kind {
        0 => range(knots[0] as f64, knots[knots.len() - 1] as f64),
        1 | 2 => {
            let points: Vec<String> = knots.iter().map(|value| point(value, pick(2))).collect();
            let (from, factor) = (pick(5), pick(1));
            let ramp = format!(
                r#","gradient":[{{"magnitude":{from},"factor":{}}},{{"magnitude":{},"factor":{factor}}}]"#,
                1 - factor,
                from + 1 + pick(5)
            );
            let ramp = if kind == 1 { "" } else { &ramp };
            json(&format!(r#"{{"kind":"points","points":[{}]{ramp}}}"#, points.join(",")))
        }
        3 if knots.len() > 1 => {
            let points: Vec<String> = knots.iter().map(|value| point(value, pick(2))).collect();
            json(&format!(r#"{{"kind":"region","knots":[{}]}}"#, points.join(",")))
        }
        _ => {
            let contours: Vec<String> = knots
                .iter()
                .map(|value| format!(r#"{{"value":{value},"opacity":0.5,"width":{}}}"#, pick(6) as f64 / 2.0))
                .collect();
            json(&format!(r#"{{"kind":"contour","contours":[{}]}}"#, contours.join(",")))
        }
    }
}

#[test]
fn what_was_not_stored_is_what_asking_everywhere_finds() {
    let mut random = Random(7);
    let (mut found, mut clean) = (0, 0);
    for _ in 0..400 {
        let (shown, stored) = (any_function(&mut random), any_function(&mut random));
        assert_eq!(shown.missing_from(&shown, EVERYWHERE, 9.0), [[0.0; 2]; 0], "{shown:?}");
        let missing = shown.missing_from(&stored, [-3.0, 43.0], 9.0);
        // On a lattice that meets every knot and the inside of every piece.
        let magnitudes = || (0..=216).map(|i| f64::from(i) / 24.0);
        let mut lattice = (-72..=1032).map(|i| f64::from(i) / 24.0);
        let is_missing =
            |value: f64| magnitudes().any(|m| shown.opacity(value, m) > 1e-12 && stored.opacity(value, m) == 0.0);
        let mut some = false;
        lattice
            .try_for_each(|value| {
                let listed = missing.iter().any(|[from, to]| (from..=to).contains(&&value));
                some |= listed;
                if is_missing(value) { listed.then_some(()) } else { Some(()) }
            })
            .unwrap_or_else(|| panic!("not all of it: {missing:?}\n{shown:?}\n{stored:?}"));
        for &[from, to] in &missing {
            // Fine enough for pieces that lie between the lattice's points.
            let inside = (1..96).map(|i| from + (to - from) * f64::from(i) / 96.0).chain([from, to]);
            let real = inside.into_iter().any(|value| {
                (0..=1_800).any(|i| {
                    let m = f64::from(i) / 200.0;
                    shown.opacity(value, m) > 0.0 && stored.opacity(value, m) == 0.0
                })
            });
            assert!(real, "{from}..{to} is not missing\n{shown:?}\n{stored:?}");
        }
        (found, clean) = (found + i32::from(some), clean + i32::from(missing.is_empty()));
    }
    assert!(found > 100 && clean > 20, "{found} with something missing, {clean} without");
}
