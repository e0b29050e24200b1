//! The twin: every sample of the volume in its turn, and what a lane must hold of it.

use adjsplat::arena::Arena;
use adjsplat::arena::Channels;
use adjsplat::build::{BuildOptions, Built, Unobserved, build};
use adjsplat::classify::{MagnitudeCodec, TransferFunction, normal};
use adjsplat::file::arena_bytes;
use adjsplat::volume::Axis;

use super::dense::SampleVolume;

/// What a record must hold.
struct Expected {
    /// In the sample's own unit.
    value: f64,
    normal: u32,
    magnitude: u8,
}

/// Builds `volume`, compares each lane with the twin voxel by voxel, and has the file checked.
pub(crate) fn build_and_compare(volume: &SampleVolume, options: &BuildOptions) -> Built {
    let built = build(&mut volume.clone(), options, &mut Unobserved).unwrap_or_else(|error| panic!("{error}"));
    compare(volume, options, &built);
    built
}

pub(crate) fn compare(volume: &SampleVolume, options: &BuildOptions, built: &Built) {
    let expected = twin(volume, options, built);
    let visible = expected.iter().flatten().count();
    assert_eq!(built.facts.visible_voxels, visible as u64, "visible voxels");
    assert_eq!(built.facts.grid, volume.header.grid);
    assert_eq!(built.facts.tile_order, options.tile_order);
    assert_eq!(built.lanes.len(), usize::from(options.lane_count));
    let tolerance = value_tolerance(volume, built);
    let [width, height, _] = built.facts.grid.dims.map(|d| d as usize);
    for (lane, axis) in built.lanes.iter().zip(Axis::ALL) {
        let lane = lane.view();
        assert_eq!((lane.axis, lane.dims, lane.channels), (axis, built.facts.grid.dims, built.facts.channels));
        let mut seen = vec![false; expected.len()];
        for line in lane.lines() {
            for (coordinate, record) in lane.line_voxels(line.records) {
                let mut place = [0; 3];
                let [u, v] = axis.others();
                (place[axis.index()], place[u.index()], place[v.index()]) = (coordinate, line.u, line.v);
                let [x, y, z] = place.map(|c| c as usize);
                let index = (z * height + y) * width + x;
                let Some(Expected { value, normal, magnitude }) = &expected[index] else {
                    panic!("lane {}: {place:?} is not visible", axis.name());
                };
                assert!(!seen[index], "lane {}: {place:?} twice", axis.name());
                seen[index] = true;
                let scales = built.facts.scales;
                let decoded = scales.value_low + f64::from(lane.value_code(record)) * scales.value_step;
                assert!((decoded - value).abs() <= tolerance, "{place:?}: {decoded} for {value}, beyond {tolerance}");
                assert_eq!(lane.normal_code(record), *normal, "normal at {place:?}");
                assert_eq!(lane.magnitude_code(record), *magnitude, "magnitude at {place:?}");
            }
        }
        assert_eq!(seen.iter().filter(|seen| **seen).count(), visible, "lane {}", axis.name());
    }
    let bytes = arena_bytes(&built.facts, &built.lanes, "{}");
    let arena = Arena::new(&bytes).unwrap_or_else(|fault| panic!("{fault}"));
    let checked = arena.check().unwrap_or_else(|fault| panic!("{fault}"));
    assert_eq!(checked.visible_voxels, visible as u64);
}

/// Largest difference that a stored value may have: half a code, or none where there is a code for every sample.
fn value_tolerance(volume: &SampleVolume, built: &Built) -> f64 {
    let scales = built.facts.scales;
    let whole = volume.header.sample_type.integer_range().is_some();
    let one_each = whole && (scales.value_step == volume.header.slope.abs() || scales.value_step == 0.0);
    let rounding = 1e-12 * (scales.value_low.abs() + 65_536.0 * scales.value_step);
    if one_each { rounding } else { scales.value_step * 0.5 + rounding }
}

/// By sample, x fastest: what is stored of it, if it is visible.
fn twin(volume: &SampleVolume, options: &BuildOptions, built: &Built) -> Vec<Option<Expected>> {
    // The same function, with what the volume decides filled in: it must not change what was given.
    let transfer = &built.transfer;
    assert_eq!(transfer.shaded(), options.transfer.shaded());
    assert_eq!(transfer.uses_gradient(), options.transfer.uses_gradient());
    let uses_gradient = transfer.uses_gradient();
    let Channels { value_bits, normal_bits, magnitude_bits, .. } = built.facts.channels;
    assert_eq!((value_bits, normal_bits), (options.value_bits.unwrap_or(value_bits), options.normal_bits));
    assert_eq!(magnitude_bits, if uses_gradient { 8 } else { 0 });
    let magnitudes = MagnitudeCodec::new(built.facts.scales.magnitude_scale).expect("a sound scale");
    // 8-bit samples have the range of their type.
    let samples = (built.samples.lowest, built.samples.highest);
    let (lowest, highest) = match volume.header.sample_type.integer_range() {
        Some(ends) if volume.header.sample_type.bytes() == 1 => ends,
        _ => samples,
    };
    let cap_magnitude = transfer.cap_magnitude(lowest, highest);
    let field = Field::of(volume, transfer);
    let dims = volume.header.grid.dims.map(i64::from);
    let mut expected = Vec::new();
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                let value = volume.value([x, y, z]).expect("inside");
                let needed = uses_gradient || normal_bits > 0;
                let mut gradient = if needed { field.gradient([x, y, z]) } else { [0.0; 3] };
                let mut magnitude = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
                if let Some(inward) = inward(dims, [x, y, z]) {
                    let is_cut = transfer.shows_cut(value);
                    if let (true, Some(capped)) = (is_cut, cap_magnitude) {
                        magnitude = capped;
                    }
                    if is_cut || cap_magnitude.is_some() {
                        gradient = inward;
                    }
                }
                let visible = transfer.opacity(value, magnitude) > 0.0;
                expected.push(visible.then(|| Expected {
                    value,
                    normal: match normal_bits {
                        0 => 0,
                        8 => normal::encode8(gradient).into(),
                        _ => normal::encode16(gradient),
                    },
                    magnitude: if uses_gradient { magnitudes.encode(magnitude) } else { 0 },
                }));
            }
        }
    }
    expected
}

/// The gradient that lights a body's cut: from the volume's faces inward. On an axis of one point, from the lower one.
fn inward(dims: [i64; 3], place: [i64; 3]) -> Option<[f64; 3]> {
    let along = |axis: usize| [(0, 1.0), (dims[axis] - 1, -1.0)].into_iter().find(|(end, _)| place[axis] == *end);
    let faces: [Option<(i64, f64)>; 3] = std::array::from_fn(along);
    // No component has the sign that zeros have of their own: it shows in the code of a normal.
    faces.iter().any(Option::is_some).then(|| faces.map(|face| face.map_or(-0.0, |(_, step)| step)))
}

/// What gradients are taken of, in single precision: the values, or the smoothed visibility of labels.
struct Field {
    dims: [i64; 3],
    spacing: [f64; 3],
    values: Vec<f64>,
}

impl Field {
    fn of(volume: &SampleVolume, transfer: &TransferFunction) -> Field {
        let dims = volume.header.grid.dims.map(i64::from);
        let mut field = Field { dims, spacing: volume.header.grid.spacing, values: Vec::new() };
        let places = (0..dims[2]).flat_map(|z| (0..dims[1]).flat_map(move |y| (0..dims[0]).map(move |x| [x, y, z])));
        let value = |place| volume.value(place).expect("inside");
        field.values = if transfer.is_labels() {
            places.map(|place| f64::from(transfer.opacity(value(place), 0.0) > 0.0)).collect()
        } else {
            places.map(value).collect()
        };
        if transfer.is_labels() {
            field.smooth();
        }
        field
    }

    /// The binomial filter along each axis, edges repeating. Exact: sixteenths of sixteenths of sixteenths.
    fn smooth(&mut self) {
        for axis in 0..3 {
            let old = self.values.clone();
            let old = Field { dims: self.dims, spacing: self.spacing, values: old };
            for index in 0..self.values.len() {
                let place = self.place(index);
                let tap = |offset: i64| {
                    let mut near = place;
                    near[axis] = (place[axis] + offset).clamp(0, self.dims[axis] - 1);
                    old.at(near).expect("clamped")
                };
                self.values[index] = (tap(-2) + 4.0 * tap(-1) + 6.0 * tap(0) + 4.0 * tap(1) + tap(2)) / 16.0;
            }
        }
    }

    fn place(&self, index: usize) -> [i64; 3] {
        let index = i64::try_from(index).expect("small");
        [index % self.dims[0], index / self.dims[0] % self.dims[1], index / (self.dims[0] * self.dims[1])]
    }

    fn at(&self, place: [i64; 3]) -> Option<f64> {
        let inside = place.iter().zip(self.dims).all(|(p, d)| (0..d).contains(p));
        let index = (place[2] * self.dims[1] + place[1]) * self.dims[0] + place[0];
        inside.then(|| self.values[usize::try_from(index).expect("inside")])
    }

    /// Central differences; one-sided where a neighbour is missing or no number; 0 where both are.
    fn gradient(&self, place: [i64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let neighbour = |offset: i64| {
                let mut near = place;
                near[axis] += offset;
                self.at(near).filter(|value| value.is_finite())
            };
            let here = self.at(place).expect("inside");
            let inverse = 1.0 / self.spacing[axis];
            match (neighbour(-1), neighbour(1)) {
                (Some(before), Some(after)) => (after - before) * 0.5 * inverse,
                (None, Some(after)) => (after - here) * inverse,
                (Some(before), None) => (here - before) * inverse,
                (None, None) => 0.0,
            }
        })
    }
}
