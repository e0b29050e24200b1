//! The cost of order and what the structure saves: the same splats drawn as quads into 16-bit floats three times.
//!
//! ```text
//! visit order     as the walk leaves them: a right picture, nothing sorted
//! storage order   as their records lie: a wrong picture, the same work without order
//! sorted          stored in storage order, drawn through indices that each frame sorts by distance
//! ```

use adjsplat::internals::gpu_stages::Splat;
use adjsplat::splat::{Quality, Settings};
use serde::Serialize;

use super::capture::{Capture, Work, capture};
use super::device::Gpu;
use super::quads::Quads;
use super::report::median;
use super::sort::Sorter;
use super::subject::BenchScene;

/// Times that each draw is repeated; the median counts.
const REPEATS: usize = 5;

/// Medians over some views of a turn; times in milliseconds.
#[derive(Debug, Serialize)]
pub(crate) struct OrderRow {
    pub(crate) scene: String,
    pub(crate) size: [u32; 2],
    pub(crate) quality: Quality,
    pub(crate) views: usize,
    /// Splats of the frame.
    pub(crate) splats_of_frame: f64,
    /// Splats that are compared: the first in visit order, as many as fit a binding.
    pub(crate) splats: f64,
    pub(crate) visit_order_ms: f64,
    pub(crate) storage_order_ms: f64,
    pub(crate) sort_ms: f64,
    pub(crate) sorted_ms: f64,
}

/// Milliseconds of one view.
struct OrderTimes {
    visit: f64,
    storage: f64,
    sort: f64,
    sorted: f64,
}

impl OrderTimes {
    fn medians(of: &[OrderTimes]) -> OrderTimes {
        let middle = |part: fn(&OrderTimes) -> f64| median(of.iter().map(part).collect());
        OrderTimes {
            visit: middle(|times| times.visit),
            storage: middle(|times| times.storage),
            sort: middle(|times| times.sort),
            sorted: middle(|times| times.sorted),
        }
    }
}

/// The draws of one view, ready to run.
struct Draws {
    quads: Quads,
    visit: wgpu::Buffer,
    storage: wgpu::Buffer,
    sorting: super::sort::Sorting,
    count: u32,
}

impl Draws {
    fn new(gpu: &Gpu, sorter: &Sorter, capture: &Capture) -> Draws {
        let mut as_stored: Vec<u32> = (0..).take(capture.splats.len()).collect();
        as_stored.sort_unstable_by_key(|&place| capture.records[place as usize]);
        let stored: Vec<Splat> = as_stored.iter().map(|&place| capture.splats[place as usize]).collect();
        let distances: Vec<f32> = as_stored.iter().map(|&place| capture.distances[place as usize]).collect();
        Draws {
            quads: Quads::new(gpu, &capture.uniform),
            visit: gpu.filled("visit order", &capture.splats),
            storage: gpu.filled("storage order", &stored),
            sorting: sorter.prepare(gpu, &distances),
            count: u32::try_from(stored.len()).expect("fewer than a binding's bytes"),
        }
    }

    fn visit(&self, gpu: &Gpu) -> f64 {
        self.quads.draw(gpu, &self.visit, None, self.count)
    }

    fn storage(&self, gpu: &Gpu) -> f64 {
        self.quads.draw(gpu, &self.storage, None, self.count)
    }

    fn sorted(&self, gpu: &Gpu) -> f64 {
        self.quads.draw(gpu, &self.storage, Some(&self.sorting.places), self.count)
    }
}

fn most_splats(gpu: &Gpu) -> usize {
    usize::try_from(gpu.most_binding()).unwrap_or(usize::MAX) / size_of::<Splat>()
}

/// Measures `views` views of a turn; returns also the work of the first.
pub(crate) fn measure(gpu: &Gpu, subject: &BenchScene, settings: &Settings, views: usize) -> (OrderRow, Work) {
    let sorter = Sorter::new(gpu);
    let mut work = None;
    let (mut of_frame, mut compared) = (Vec::new(), Vec::new());
    let times: Vec<OrderTimes> = (0..views)
        .map(|index| {
            let camera = subject.camera(index, views, settings.size);
            let capture = capture(gpu, subject, &camera, settings, most_splats(gpu));
            work.get_or_insert(capture.work);
            of_frame.push(capture.work.splats as f64);
            compared.push(capture.splats.len() as f64);
            let draws = Draws::new(gpu, &sorter, &capture);
            let one = || OrderTimes {
                visit: draws.visit(gpu),
                storage: draws.storage(gpu),
                sort: sorter.sort(gpu, &draws.sorting),
                sorted: draws.sorted(gpu),
            };
            // After a first run the draws take turns, so that other load on the machine meets all alike.
            one();
            OrderTimes::medians(&(0..REPEATS).map(|_| one()).collect::<Vec<_>>())
        })
        .collect();
    let times = OrderTimes::medians(&times);
    let row = OrderRow {
        scene: subject.name.clone(),
        size: settings.size,
        quality: settings.quality,
        views,
        splats_of_frame: median(of_frame),
        splats: median(compared),
        visit_order_ms: times.visit,
        storage_order_ms: times.storage,
        sort_ms: times.sort,
        sorted_ms: times.sorted,
    };
    (row, work.expect("at least one view"))
}

/// Checks the pictures: that of visit order equals the renderer's, the sorted one is close, that of storage order is not.
pub(crate) fn check(gpu: &Gpu, subject: &BenchScene, settings: &Settings) {
    let sorter = Sorter::new(gpu);
    let camera = subject.camera(1, 7, settings.size);
    let capture = capture(gpu, subject, &camera, settings, most_splats(gpu));
    let draws = Draws::new(gpu, &sorter, &capture);
    let frame: Vec<[f32; 4]> = capture.frame.pixels().as_chunks().0.to_vec();
    let pictures = [
        {
            draws.visit(gpu);
            draws.quads.picture(gpu)
        },
        {
            draws.storage(gpu);
            draws.quads.picture(gpu)
        },
        {
            sorter.sort(gpu, &draws.sorting);
            draws.sorted(gpu);
            draws.quads.picture(gpu)
        },
    ];
    let [visit, storage, sorted] = pictures.map(|picture| largest_mean_difference(&frame, &picture));
    println!("mean difference of colour from tiles: visit {visit:.5}, sorted {sorted:.5}, storage {storage:.5}");
    // 16-bit floats and rays that do not end early: a few thousandths where matter is dense.
    assert!(visit < 2e-3, "quads in visit order differ from tiles by {visit} in the mean");
    // Overlapping splats have no single true order: by rows or by distance they differ a little.
    assert!(sorted < 1e-2, "sorted quads differ from tiles by {sorted} in the mean");
    assert!(storage > 3.0 * sorted, "without order the picture should be wrong: {storage} against {sorted}");
}

/// Returns the mean absolute difference over the pixels, of the colour channel where it is largest.
fn largest_mean_difference(frame: &[[f32; 4]], picture: &[[f32; 4]]) -> f64 {
    assert_eq!(frame.len(), picture.len());
    let mean = |c: usize| {
        let differences = frame.iter().zip(picture).map(|(a, b)| f64::from((a[c] - b[c]).abs()));
        differences.sum::<f64>() / frame.len() as f64
    };
    (0..3).map(mean).fold(0.0, f64::max)
}
