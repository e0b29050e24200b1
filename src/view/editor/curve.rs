//! Points of a curve that can be dragged: their positions ascend, their heights are from 0 to 1. The curve is linear between
//! them, and constant beyond the first and the last.

use std::ops::RangeInclusive;

/// A point of a curve.
pub trait CurvePoint: Copy {
    /// The least position.
    const LEAST: f64;
    /// The most points of a curve.
    const MOST: usize;

    /// Returns position and height.
    fn place(&self) -> [f64; 2];

    /// Returns this point at another position and height.
    #[must_use]
    fn moved(self, position: f64, height: f64) -> Self;

    /// Returns the point at a share of the way to the next.
    #[must_use]
    fn towards(self, next: Self, share: f64) -> Self;
}

/// A curve of one point or more.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve<P>(Vec<P>);

impl<P: CurvePoint> Curve<P> {
    /// Creates a curve of these points, by ascending position; `None` if there are none.
    pub fn new(points: Vec<P>) -> Option<Curve<P>> {
        (!points.is_empty()).then_some(Curve(points))
    }

    /// Creates a curve of these points, by ascending position.
    pub(super) fn of<const COUNT: usize>(points: [P; COUNT]) -> Curve<P> {
        const { assert!(COUNT > 0) };
        Curve(points.to_vec())
    }

    /// Returns the points, by ascending position.
    pub fn points(&self) -> &[P] {
        &self.0
    }

    /// Returns the points, to change all but their places.
    pub(super) fn points_mut(&mut self) -> &mut [P] {
        &mut self.0
    }

    /// Returns the positions of the first point and of the last.
    pub fn ends(&self) -> [f64; 2] {
        [self.0[0], self.0[self.0.len() - 1]].map(|point| point.place()[0])
    }

    /// Returns the positions that a point may move to: those between its neighbours.
    ///
    /// At most two points share a position, which is a jump: a third stays beside them.
    pub fn positions(&self, index: usize) -> RangeInclusive<f64> {
        let position_of =
            |index: Option<usize>| index.and_then(|index| self.0.get(index)).map(|point| point.place()[0]);
        let (before, after) = (position_of(index.checked_sub(1)), position_of(Some(index + 1)));
        let is_jump = |near: Option<f64>, far: Option<usize>| near.is_some() && near == position_of(far);
        let gap = self.least_gap();
        let low = before.map_or(P::LEAST, |low| low + if is_jump(before, index.checked_sub(2)) { gap } else { 0.0 });
        let high = after.map_or(f64::INFINITY, |high| high - if is_jump(after, Some(index + 2)) { gap } else { 0.0 });
        let own = self.0[index].place()[0];
        if low <= high { low..=high } else { own..=own }
    }

    /// Moves a point; it stays between its neighbours, and its height between 0 and 1.
    pub fn move_point(&mut self, index: usize, position: f64, height: f64) {
        let (low, high) = self.positions(index).into_inner();
        let position = if position.is_finite() { position.clamp(low, high) } else { self.0[index].place()[0] };
        self.0[index] = self.0[index].moved(position, if height.is_nan() { 0.0 } else { height.clamp(0.0, 1.0) });
    }

    /// Returns a difference of positions that is too small to see and survives being written as text.
    fn least_gap(&self) -> f64 {
        let largest = self.0.iter().map(|point| point.place()[0].abs()).fold(0.0, f64::max);
        (1e-12 * largest).max(f64::MIN_POSITIVE)
    }

    /// Adds a point that is else as the curve is there, and returns its index; `None` if there are as many as may be.
    ///
    /// Where two points share this position already, none is added, and the index is the first one's.
    pub fn add(&mut self, position: f64, height: f64) -> Option<usize> {
        let position = position.max(P::LEAST);
        let index = self.0.partition_point(|point| point.place()[0] < position);
        if self.0[index..].iter().take_while(|point| point.place()[0] == position).count() >= 2 {
            return Some(index);
        }
        if self.0.len() >= P::MOST {
            return None;
        }
        self.0.insert(index, self.at(position).moved(position, height.clamp(0.0, 1.0)));
        Some(index)
    }

    /// Removes a point; the last one stays.
    pub fn remove(&mut self, index: usize) {
        if self.0.len() > 1 {
            self.0.remove(index);
        }
    }

    /// Returns the height at a position.
    pub fn height(&self, position: f64) -> f64 {
        self.at(position).place()[1]
    }

    /// Returns the point of the curve at a position; beyond its ends the nearest point.
    pub fn at(&self, position: f64) -> P {
        let next = self.0.partition_point(|point| point.place()[0] < position);
        let (before, after) = (self.0[next.saturating_sub(1)], self.0[next.min(self.0.len() - 1)]);
        let [from, to] = [before, after].map(|point| point.place()[0]);
        before.towards(after, if to > from { ((position - from) / (to - from)).clamp(0.0, 1.0) } else { 1.0 })
    }
}
