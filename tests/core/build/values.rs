//! Value codes: which values come back exactly, by how much others are rounded, and when 16 bits are taken.

use adjsplat::build::{BuildOptions, Built, Unobserved, build};
use adjsplat::classify::TransferFunction;
use adjsplat::volume::Sample;
use adjsplat::{Error, Volume};

/// Builds one row of `samples`, all of them visible, with values of `bits`.
fn row<T: Sample>(samples: &[T], transfer: TransferFunction, bits: Option<u8>) -> Result<Built, Error> {
    let volume = Volume::new([samples.len() as u64, 1, 1], samples.to_vec()).unwrap();
    let options = BuildOptions::new(transfer).with_lane_count(1).with_value_bits(bits);
    build(&mut volume.slices(), &options, &mut Unobserved)
}

/// Returns the largest difference of a stored value to its sample; the build must have said the same.
fn rounding<T: Sample>(samples: &[T], bits: u8) -> f64 {
    let built = row(samples, TransferFunction::range(f64::NEG_INFINITY, f64::INFINITY).unwrap(), Some(bits)).unwrap();
    let (lane, scales) = (built.lanes[0].view(), built.facts.scales);
    let stored =
        lane.lines().flat_map(|line| lane.line_voxels(line.records)).map(|(_, record)| lane.value_code(record));
    let differences = stored
        .zip(samples)
        .map(|(code, sample)| (scales.value(code.into()) - sample.to_f64()).abs())
        .collect::<Vec<_>>();
    assert_eq!(differences.len(), samples.len());
    let largest = differences.into_iter().fold(0.0, f64::max);
    assert!((built.samples.rounding - largest).abs() <= 1e-9 * largest, "{} for {largest}", built.samples.rounding);
    largest
}

#[test]
fn few_whole_values_far_apart_are_stored_exactly() {
    // Their differences are multiples of 9: 11,111 of them.
    assert_eq!(rounding(&[1i32, 1000, 100_000], 16), 0.0);
    assert!(rounding(&[1i32, 1000, 100_000], 8) > 0.0);
    let sixteen_bits_from_eight: Vec<u16> = (0..=255).map(|value| value * 257).collect();
    assert_eq!(rounding(&sixteen_bits_from_eight, 8), 0.0);
    let negative: Vec<i16> = (-128..128).map(|value| value * 10 + 3).collect();
    assert_eq!(rounding(&negative, 8), 0.0);
    assert_eq!(rounding(&[7.0f64], 8), 0.0);
}

#[test]
fn whole_numbers_in_floats_are_stored_exactly() {
    let whole: Vec<f32> = (0..1000).map(|value| (value * 7 % 581) as f32).collect();
    assert_eq!(rounding(&whole, 16), 0.0);
    // One that is not whole has the others rounded too.
    let mixed: Vec<f32> = whole.iter().copied().chain([0.5]).collect();
    assert!(rounding(&mixed, 16) > 0.0);
}

#[test]
fn rounding_is_at_most_half_a_step_and_is_told() {
    let values: Vec<i16> = (0..3000).collect();
    let step = 2999.0 / 255.0;
    let largest = rounding(&values, 8);
    assert!(largest > 0.45 * step && largest <= 0.5 * step * (1.0 + 1e-12), "{largest} of {step}");
}

#[test]
fn values_take_16_bits_where_8_would_turn_visible_voxels_transparent() {
    // With 8 bits, the values of neighbouring codes are 251 apart, with none from 30,118 to 30,368.
    let slope: Vec<u16> = (0..4000).map(|x| x * 16).collect();
    let narrow = |bits| {
        let points = r##"{ "kind": "points", "points": [
            { "value": 0, "colour": "#ffffff", "opacity": 0.5 }, { "value": 30000, "colour": "#ffffff", "opacity": 0 },
            { "value": 30190, "colour": "#ffffff", "opacity": 0 }, { "value": 30240, "colour": "#ffffff", "opacity": 0.9 },
            { "value": 30290, "colour": "#ffffff", "opacity": 0 }, { "value": 64000, "colour": "#ffffff", "opacity": 0.5 }
        ] }"##;
        row(
            &slope[1..].iter().map(|v| v + u16::from(v % 3 == 0)).collect::<Vec<_>>(),
            TransferFunction::from_json(points).unwrap(),
            bits,
        )
        .unwrap()
    };
    let eight = narrow(Some(8));
    assert!(eight.samples.blurred_away > 0 && eight.facts.channels.value_bits == 8);
    let chosen = narrow(None);
    assert_eq!((chosen.samples.blurred_away, chosen.facts.channels.value_bits), (0, 16));
    // Without need, 8 bits stay.
    let whole = row(&slope, TransferFunction::range(-1e9, 1e9).unwrap(), None).unwrap();
    assert_eq!(whole.facts.channels.value_bits, 8);
}

#[test]
fn labels_that_8_bits_do_not_tell_apart_take_16() {
    let labels: Vec<u16> = (1..=900).collect();
    let palette = TransferFunction::preset("labels").unwrap();
    let error = row(&labels, palette.clone(), Some(8)).unwrap_err().to_string();
    assert!(error.contains("16-bit"), "{error}");
    let built = row(&labels, palette.clone(), None).unwrap();
    assert_eq!((built.facts.channels.value_bits, built.samples.rounding), (16, 0.0));
    assert_eq!(row(&[1u16, 2, 3], palette, None).unwrap().facts.channels.value_bits, 8);
}
