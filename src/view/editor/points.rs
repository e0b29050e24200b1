//! A transfer function as points that can be dragged: opacities and colours by value, and factors by gradient.

use adjsplat::TransferFunction;
use adjsplat::classify::FactorPoint;
use adjsplat::classify::colour::srgb_from_linear;
use adjsplat::error::Result;
use adjsplat::limits::{MAX_CONTOURS, MAX_TRANSFER_ENTRIES};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::StoredValues;
use super::curve::{Curve, CurvePoint};
use super::maps::{colour_at, mix};

/// A point of a transfer function.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EditPoint {
    /// The value, in the volume's unit.
    pub value: f64,
    /// The colour, sRGB.
    pub colour: [u8; 3],
    /// The opacity, 0 to 1.
    pub opacity: f64,
}

impl CurvePoint for EditPoint {
    const LEAST: f64 = f64::NEG_INFINITY;
    const MOST: usize = MAX_TRANSFER_ENTRIES;

    fn place(&self) -> [f64; 2] {
        [self.value, self.opacity]
    }

    fn moved(self, value: f64, opacity: f64) -> EditPoint {
        EditPoint { value, opacity, ..self }
    }

    fn towards(self, next: EditPoint, share: f64) -> EditPoint {
        EditPoint {
            value: between(self.value, next.value, share),
            colour: mix(self.colour, next.colour, share),
            opacity: between(self.opacity, next.opacity, share),
        }
    }
}

impl CurvePoint for FactorPoint {
    const LEAST: f64 = 0.0;
    const MOST: usize = MAX_CONTOURS;

    fn place(&self) -> [f64; 2] {
        [self.magnitude, self.factor]
    }

    fn moved(self, magnitude: f64, factor: f64) -> FactorPoint {
        FactorPoint { magnitude, factor }
    }

    fn towards(self, next: FactorPoint, share: f64) -> FactorPoint {
        let magnitude = between(self.magnitude, next.magnitude, share);
        FactorPoint { magnitude, factor: between(self.factor, next.factor, share) }
    }
}

fn between(from: f64, to: f64, share: f64) -> f64 {
    from + share * (to - from)
}

/// A transfer function of points.
#[derive(Debug, Clone, PartialEq)]
pub struct PointList {
    /// Opacities and colours by value.
    pub curve: Curve<EditPoint>,
    /// The factors on opacities by the gradient's magnitude; `None` if it does not matter.
    pub gradient: Option<Curve<FactorPoint>>,
    /// Whether voxels are lit.
    pub is_shaded: bool,
    /// Fields of the JSON that the editor leaves as they are.
    kept: Kept,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
struct Kept {
    #[serde(skip_serializing_if = "Option::is_none")]
    reference_length: Option<f64>,
}

/// Points of a ramp of colours, where a colour map is applied to fewer.
const MAP_POINTS: usize = 9;

impl PointList {
    /// Returns the points of a function of the kinds `points` and `range`; `None` for other kinds.
    pub fn of(transfer: &TransferFunction, stored: &StoredValues) -> Option<PointList> {
        let document: Value = serde_json::from_str(&transfer.to_json()).ok()?;
        let kept: Kept = serde_json::from_value(document.clone()).ok()?;
        let is_shaded = transfer.shaded();
        let at = |value: f64, opacity: f64| EditPoint { value, colour: colour_of(transfer, value), opacity };
        match document["kind"].as_str()? {
            "points" => {
                let number = |point: &Value, name: &str| point[name].as_f64();
                let points = document["points"].as_array()?.iter().map(|point| {
                    let colour = serde_json::from_value(point["colour"].clone()).ok().and_then(bytes_of)?;
                    Some(EditPoint { value: number(point, "value")?, colour, opacity: number(point, "opacity")? })
                });
                let gradient: Vec<FactorPoint> = match document.get("gradient") {
                    Some(ramp) => serde_json::from_value(ramp.clone()).ok()?,
                    None => Vec::new(),
                };
                let curve = Curve::new(points.collect::<Option<_>>()?)?;
                Some(PointList { curve, gradient: Curve::new(gradient), is_shaded, kept })
            }
            "range" => {
                let [lowest, highest] = stored.range();
                let (low, high) = (document["low"].as_f64(), document["high"].as_f64());
                let opacity = document["opacity"].as_f64().unwrap_or(0.8);
                let [from, to] = [low.unwrap_or(lowest), high.unwrap_or(highest.max(low.unwrap_or(lowest)))];
                let stops = document["colours"].as_array().map_or(2, Vec::len).max(2);
                let mut points = Vec::new();
                points.extend(low.map(|low| at(low, 0.0)));
                points.extend((0..stops).map(|i| at(from + (to - from) * i as f64 / (stops - 1) as f64, opacity)));
                points.extend(high.map(|high| at(high, 0.0)));
                points.dedup_by(|a, b| a == b);
                Some(PointList { curve: Curve::new(points)?, gradient: None, is_shaded, kept })
            }
            _ => None,
        }
    }

    /// Returns a ramp over the stored values, to begin with.
    pub fn ramp(stored: &StoredValues) -> PointList {
        let [low, high] = stored.range();
        let colours = super::maps::MAPS[7].1;
        let point = |share: f64, opacity| EditPoint {
            value: low + share * (high - low),
            colour: colour_at(colours, share),
            opacity,
        };
        let curve = Curve::of([point(0.0, 0.0), point(0.5, 0.3), point(1.0, 0.9)]);
        PointList { curve, gradient: None, is_shaded: true, kept: Kept::default() }
    }

    /// Colours the values from the first point to the last by a colour map; opacities stay.
    pub fn apply_map(&mut self, colours: &[[u8; 3]]) {
        let [low, high] = self.curve.ends();
        if self.curve.points().len() < MAP_POINTS && high > low {
            for part in 1..MAP_POINTS - 1 {
                let value = low + (high - low) * part as f64 / (MAP_POINTS - 1) as f64;
                if self.curve.points().iter().all(|point| (point.value - value).abs() > 0.02 * (high - low)) {
                    self.curve.add(value, self.curve.height(value));
                }
            }
        }
        for point in self.curve.points_mut() {
            let share = if high > low { (point.value - low) / (high - low) } else { 1.0 };
            point.colour = colour_at(colours, share);
        }
    }

    /// Returns the transfer function.
    ///
    /// # Errors
    /// [`adjsplat::Error::Input`] if the numbers cannot be used.
    pub fn transfer(&self) -> Result<TransferFunction> {
        let point =
            |point: &EditPoint| json!({ "value": point.value, "colour": hex(point.colour), "opacity": point.opacity });
        let mut document = json!({
            "kind": "points",
            "points": self.curve.points().iter().map(point).collect::<Vec<_>>(),
            "shaded": self.is_shaded,
        });
        if let Some(ramp) = &self.gradient {
            document["gradient"] = json!(ramp.points());
        }
        if let Some(length) = self.kept.reference_length {
            document["reference_length"] = json!(length);
        }
        TransferFunction::from_json(&document.to_string())
    }
}

/// Returns the sRGB colour of a value.
pub(super) fn colour_of(transfer: &TransferFunction, value: f64) -> [u8; 3] {
    transfer.colour(value).map(|part| byte(srgb_from_linear(part.into())))
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 255")]
fn byte(part: f64) -> u8 {
    (part.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Returns a colour as the JSON writes it.
pub(super) fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Returns the bytes of a colour of the JSON.
pub(super) fn bytes_of(colour: Value) -> Option<[u8; 3]> {
    match colour {
        Value::String(text) => adjsplat::classify::Colour::from_hex(&text).ok().map(|colour| colour.srgb().map(byte)),
        Value::Array(parts) => {
            let parts: Vec<f64> = parts.iter().filter_map(Value::as_f64).collect();
            <[f64; 3]>::try_from(parts).ok().map(|parts| parts.map(byte))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored() -> StoredValues {
        StoredValues { low: 10.0, step: 2.0, counts: vec![1; 101], largest_magnitude: None }
    }

    #[test]
    fn a_range_becomes_points_that_look_the_same() {
        for (low, high) in [(60.0, f64::INFINITY), (60.0, 150.0), (f64::NEG_INFINITY, 100.0)] {
            let range = TransferFunction::range(low, high).unwrap().with_value_range(10.0, 210.0).unwrap();
            let points = PointList::of(&range, &stored()).unwrap().transfer().unwrap();
            for value in [10.0, 59.0, 60.0, 61.0, 100.0, 101.0, 149.0, 150.0, 151.0, 210.0] {
                assert_eq!(points.opacity(value, 0.0), range.opacity(value, 0.0), "{low}..{high} at {value}");
                if range.opacity(value, 0.0) > 0.0 {
                    let far = (0..3).map(|c| (points.colour(value)[c] - range.colour(value)[c]).abs());
                    assert!(far.fold(0.0, f32::max) < 0.01, "{low}..{high} at {value}");
                }
            }
        }
    }

    #[test]
    fn points_come_back_as_they_were() {
        let text = r##"{"kind":"points","points":[{"value":60.0,"colour":"#7a4a32","opacity":0.0},
            {"value":110.0,"colour":"#d9a066","opacity":0.5}],
            "gradient":[{"magnitude":3.0,"factor":0.25},{"magnitude":8.0,"factor":1.0},{"magnitude":8.0,"factor":0.5}],
            "reference_length":2.0,"shaded":false}"##;
        let function = TransferFunction::from_json(text).unwrap();
        let again = PointList::of(&function, &stored()).unwrap().transfer().unwrap();
        assert_eq!(again.to_json(), function.to_json());
    }

    #[test]
    fn a_point_stays_between_its_neighbours() {
        let mut list = PointList::ramp(&stored());
        list.curve.move_point(1, 1e9, 7.0);
        assert_eq!((list.curve.points()[1].value, list.curve.points()[1].opacity), (210.0, 1.0));
        list.curve.move_point(1, f64::NAN, f64::NAN);
        assert_eq!((list.curve.points()[1].value, list.curve.points()[1].opacity), (210.0, 0.0));
        assert!(list.transfer().is_ok());
    }

    #[test]
    fn a_third_point_dragged_onto_a_jump_keeps_the_function_valid() {
        for to in [210.0, 1e9] {
            let mut list = PointList::ramp(&stored());
            list.curve.move_point(1, 210.0, 0.5);
            list.curve.move_point(0, to, 0.5);
            assert!(list.curve.points()[0].value > 209.999 && list.transfer().is_ok());
        }
        let mut list = PointList::ramp(&stored());
        list.curve.move_point(1, 10.0, 0.5);
        list.curve.move_point(2, -1e9, 0.5);
        assert!(list.curve.points()[2].value < 10.001 && list.transfer().is_ok());
        assert_eq!((list.curve.add(10.0, 0.2), list.curve.points().len()), (Some(0), 3));
    }

    #[test]
    fn a_new_point_changes_nothing_until_it_is_moved() {
        let mut list = PointList::ramp(&stored());
        let before = list.transfer().unwrap();
        let index = list.curve.add(60.0, list.curve.height(60.0));
        assert_eq!(index, Some(1));
        let after = list.transfer().unwrap();
        for value in [10.0, 40.0, 60.0, 90.0, 200.0] {
            assert!((before.opacity(value, 0.0) - after.opacity(value, 0.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn a_colour_map_keeps_opacities() {
        let mut list = PointList::ramp(&stored());
        let before = list.clone();
        list.apply_map(super::super::maps::MAPS[1].1);
        for value in [10.0, 30.0, 110.0, 160.0, 210.0] {
            assert!((list.curve.height(value) - before.curve.height(value)).abs() < 1e-12);
        }
        assert_eq!(list.curve.at(10.0).colour, [68, 1, 84]);
        assert_eq!(list.curve.at(210.0).colour, [253, 231, 37]);
    }

    #[test]
    fn the_last_point_stays() {
        let mut list = PointList::ramp(&stored());
        (0..5).for_each(|_| list.curve.remove(0));
        assert_eq!(list.curve.points().len(), 1);
        assert!(list.transfer().is_ok() && list.curve.height(3.0) == 0.9);
    }
}
