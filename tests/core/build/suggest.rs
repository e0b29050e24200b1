//! Histograms, and what they suggest to show, on volumes of which the answer is known.

use adjsplat::build::{Histogram, Suggestion, Unobserved};
use adjsplat::volume::{Header, Sample, Samples, SlabSource, VolumeSlices};
use adjsplat::{Error, Volume};

/// Returns the histogram of `samples` in one row.
fn histogram<T: Sample>(samples: Vec<T>) -> Histogram {
    let volume = Volume::new([samples.len() as u64, 1, 1], samples).unwrap();
    Histogram::of(&mut volume.slices(), &mut Unobserved).unwrap()
}

/// Returns `count` samples each of some values.
fn samples<T: Copy>(groups: &[(T, usize)]) -> Vec<T> {
    groups.iter().flat_map(|&(value, count)| std::iter::repeat_n(value, count)).collect()
}

#[test]
fn whole_numbers_have_a_bin_each_and_others_as_many_as_there_are() {
    let whole = histogram(samples(&[(-7i16, 2), (0, 1), (3, 5)]));
    assert!(whole.is_exact);
    assert_eq!((whole.lowest, whole.highest, whole.bin_width, whole.counts.len()), (-7.0, 3.0, 1.0, 11));
    assert_eq!((whole.counts[0], whole.counts[7], whole.counts[10]), (2, 1, 5));
    assert_eq!(whole.mean, 1.0 / 8.0);
    assert_eq!(whole.quantile(0.25), -7.0);
    assert_eq!(whole.quantile(0.26), 0.0);
    assert_eq!(whole.share([0.0, f64::INFINITY]), 6.0 / 8.0);
    assert_eq!(whole.rebinned(2), [2, 6]);
    let real = histogram(vec![0.0f32, f32::NAN, 0.5, f32::INFINITY, 1.0]);
    assert!(!real.is_exact);
    assert_eq!((real.lowest, real.highest, real.not_finite, real.total()), (0.0, 1.0, 2, 3));
    assert!((real.quantile(0.5) - 0.5).abs() < real.bin_width);
    // The difference of the ends overflows; halves do not.
    let extreme = histogram(vec![-f64::MAX, 0.0, f64::MAX]);
    assert_eq!((extreme.counts[0], extreme.total(), *extreme.counts.last().unwrap()), (1, 3, 1));
    let middle = extreme.value(extreme.counts.len() / 2);
    assert!(middle.abs() < extreme.bin_width && extreme.share([0.5 * f64::MAX, f64::MAX]) == 1.0 / 3.0, "{middle}");
    let none = histogram(vec![f32::NAN]);
    assert!(none.counts.is_empty() && none.quantile(0.5) == f64::NEG_INFINITY);
}

/// Counts how many slices are read.
struct CountedSlices<'v>(VolumeSlices<'v>, u32);

impl SlabSource for CountedSlices<'_> {
    fn header(&self) -> &Header {
        self.0.header()
    }

    fn read_slice(&mut self, slice: &mut Samples) -> Result<(), Error> {
        self.1 += 1;
        self.0.read_slice(slice)
    }

    fn rewind(&mut self) -> Result<(), Error> {
        self.0.rewind()
    }
}

#[test]
fn samples_of_at_most_16_bits_are_read_once_for_a_histogram() {
    fn read<T: Sample>(samples: Vec<T>) -> (u32, Histogram) {
        let volume = Volume::new([2, 1, 5], samples).unwrap();
        let mut source = CountedSlices(volume.slices(), 0);
        let histogram = Histogram::of(&mut source, &mut Unobserved).unwrap();
        source.read_slice(&mut source.header().new_slice().unwrap()).unwrap();
        (source.1 - 1, histogram)
    }
    const VALUES: [i16; 10] = [i16::MIN, -7, -7, 0, 3, 3, 3, 900, 900, i16::MAX];
    let (passes, small) = read(VALUES.to_vec());
    let (wide_passes, wide) = read(VALUES.map(i32::from).to_vec());
    assert_eq!((passes, wide_passes), (5, 10));
    assert_eq!((small.lowest, small.highest, small.mean), (wide.lowest, wide.highest, wide.mean));
    assert!(small.is_exact && small.counts == wide.counts && small.counts.len() == 65_536);
    assert_eq!((read(vec![5u8; 10]).0, read(vec![0.5f32; 10]).0), (5, 10));
}

#[test]
fn mean_gradients_are_large_where_materials_meet() {
    // Along x: 10 ten times, then 20 ten times; the two values beside the step have half the step as gradient.
    let volume = Volume::new([20, 1, 1], samples(&[(10u8, 10), (20, 10)])).unwrap();
    let mut source = volume.slices();
    let histogram = Histogram::of(&mut source, &mut Unobserved).unwrap();
    let gradients = histogram.gradients(&mut source, 11, &mut Unobserved).unwrap();
    assert_eq!(gradients.len(), 11);
    for (bin, gradient) in gradients.iter().enumerate() {
        let want = if bin == 0 || bin == 10 { 5.0 / 10.0 } else { 0.0 };
        assert!((gradient - want).abs() < 1e-6, "{bin}: {gradient}");
    }
}

#[test]
fn what_is_shown_first_fits_the_values() {
    let suggested = |histogram: Histogram| Suggestion::of(&histogram).unwrap();
    // Two groups, with the background in the majority: all values between them part them as well.
    assert_eq!(suggested(histogram(samples(&[(10u8, 700), (12, 100), (80, 150), (90, 50)]))), Suggestion::From(80.0));
    // Noise fills most of the volume, and a vessel is far above it.
    let noise = samples(&[(0u16, 100), (100, 300), (120, 300), (140, 250), (500, 20)]);
    assert_eq!(suggested(histogram(noise)), Suggestion::From(500.0));
    assert_eq!(suggested(histogram(samples(&[(0u8, 90), (1, 5), (2, 5)]))), Suggestion::Labels);
    assert_eq!(suggested(histogram(samples(&[(0.0f32, 90), (0.5, 5), (1.0, 5)]))), Suggestion::From(0.5));
    let head = [(-1000i16, 500), (-30, 100), (40, 300), (60, 100), (900, 20), (2500, 1)];
    assert_eq!(suggested(histogram(samples(&head))), Suggestion::Preset("ct-bone".into()));
    let shifted = head.map(|(value, count)| ((value + 1024) as u16, count));
    assert_eq!(suggested(histogram(samples(&shifted))), Suggestion::Preset("ct-bone+1024".into()));
    let soft = [(-1000i16, 500), (-30, 100), (40, 300), (120, 100)];
    assert_eq!(suggested(histogram(samples(&soft))), Suggestion::Preset("ct-skin".into()));
    for suggestion in [Suggestion::Labels, Suggestion::From(3.0), Suggestion::Preset("ct-skin+1024".into())] {
        suggestion.transfer().unwrap();
    }
    for one in [histogram(vec![4u8, 4]), histogram(vec![f64::NAN])] {
        assert!(matches!(Suggestion::of(&one), Err(Error::Input { .. })));
    }
}
