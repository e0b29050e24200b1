//! How many pixels a draft has, so that it takes a bounded time.
//!
//! In: the time of each draft, and its share of the view's pixels. Out: the share of the next one. A draft takes `a + b p`
//! milliseconds for a share p: the walk over the voxels, and what each pixel costs. It shall take 50 ms; or `1.5 a`, if that
//! is more, as fewer pixels would then hardly help.

/// A draft shall take this long, in milliseconds.
const TARGET_MS: f64 = 50.0;
/// The smallest share of pixels: one of 36.
const LEAST: f64 = 1.0 / 36.0;
/// What an earlier draft counts beside the one after it.
const KEPT: f64 = 0.85;
/// Of times that differ by less than this share, one cannot tell why.
const SIMILAR: f64 = 0.1;

/// The share of pixels that drafts have, and the times of earlier ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DraftSize {
    /// Share of the view's pixels, above 0, at most 1.
    pub(super) share: f64,
    /// Weighted sums of 1, p, t, p p and p t.
    sums: [f64; 5],
}

impl Default for DraftSize {
    fn default() -> DraftSize {
        DraftSize { share: 1.0, sums: [0.0; 5] }
    }
}

impl DraftSize {
    /// Returns the columns and rows of a draft of a view of `size` pixels.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "no larger than the view")]
    pub(super) fn of(&self, size: [u32; 2]) -> [u32; 2] {
        size.map(|side| ((f64::from(side) * self.share.sqrt()).round() as u32).max(1))
    }

    /// Learns that a draft with this share of pixels took so long.
    pub(super) fn took(&mut self, milliseconds: f64, share: f64) {
        let new = [1.0, share, milliseconds, share * share, share * milliseconds];
        for (sum, new) in self.sums.iter_mut().zip(new) {
            *sum = KEPT * *sum + new;
        }
        let [n, p, t, pp, pt] = self.sums;
        let spread = (pp / n - (p / n).powi(2)).max(0.0).sqrt();
        let wanted = if spread > SIMILAR * p / n {
            let slope = ((n * pt - p * t) / (n * pp - p * p)).max(0.0);
            let fixed = ((t - slope * p) / n).max(0.0);
            if slope > 0.0 { (TARGET_MS.max(1.5 * fixed) - fixed) / slope } else { 1.0 }
        } else if !(0.7 * TARGET_MS..=1.3 * TARGET_MS).contains(&milliseconds) {
            // All drafts had about this size. Another size tells more.
            share * (TARGET_MS / milliseconds.max(1.0)).clamp(0.3, 3.0)
        } else {
            share
        };
        // Half of the way, as times vary.
        self.share = (self.share * wanted.clamp(LEAST, 1.0)).sqrt().clamp(LEAST, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the share and the time after some drafts of a volume that takes `fixed + slope * share` milliseconds.
    fn settled(fixed: f64, slope: f64) -> [f64; 2] {
        let mut size = DraftSize::default();
        let noise = [1.0, 1.1, 0.95, 1.05, 0.9];
        for index in 0..60 {
            let share = size.share;
            size.took((fixed + slope * share) * noise[index % 5], share);
        }
        [size.share, fixed + slope * size.share]
    }

    #[test]
    fn a_fast_volume_has_all_pixels() {
        assert!(settled(3.0, 20.0)[0] > 0.95);
    }

    #[test]
    fn a_slow_volume_takes_the_time_that_it_may() {
        for (fixed, slope) in [(5.0, 100.0), (10.0, 400.0), (0.0, 1000.0)] {
            let [share, time] = settled(fixed, slope);
            assert!((30.0..75.0).contains(&time), "{fixed} {slope}: {share} {time}");
        }
    }

    #[test]
    fn pixels_stay_where_leaving_them_out_does_not_help() {
        // The walk alone takes 100 ms: a picture of half as much again.
        let [share, time] = settled(100.0, 300.0);
        assert!((115.0..200.0).contains(&time) && share > 0.06, "{share} {time}");
        assert!(settled(60.0, 20.0)[0] > 0.5);
    }

    #[test]
    fn sizes_are_at_least_a_pixel() {
        assert_eq!(DraftSize { share: LEAST, ..DraftSize::default() }.of([3, 600]), [1, 100]);
        assert_eq!(DraftSize::default().of([934, 624]), [934, 624]);
    }
}
