//! The Pareto front: candidates that no other beats in both time and accuracy.

/// Returns for each of `points` (milliseconds, decibels) whether it is on the front.
/// A point is on it if no other is as fast and as exact, and better in one of the two.
///
/// Equal points are all on it. A point without a time is not. O(n^2) for n points.
pub(super) fn front(points: &[(Option<f64>, f64)]) -> Vec<bool> {
    let beats = |(time, decibels): (f64, f64), (than, worse): (f64, f64)| {
        time <= than && decibels >= worse && (time < than || decibels > worse)
    };
    let timed = |&(time, decibels): &(Option<f64>, f64)| time.map(|time| (time, decibels));
    points
        .iter()
        .map(|point| {
            timed(point).is_some_and(|point| !points.iter().filter_map(timed).any(|other| beats(other, point)))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_nothing_beats_is_on_the_front() {
        let points = [
            (Some(1.0), 30.0),
            (Some(2.0), 40.0),
            (Some(2.0), 40.0),
            (Some(2.5), 39.0),
            (Some(3.0), f64::INFINITY),
            (Some(4.0), f64::INFINITY),
            (None, 90.0),
        ];
        assert_eq!(front(&points), [true, true, true, false, true, false, false]);
    }
}
