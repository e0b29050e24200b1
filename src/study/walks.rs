//! Walk times: nanoseconds per visible voxel in each of the 48 orders of parallel views, or in views from an eye.
//!
//! In: a subject and methods. Out: the fastest of several walks of each method in each view, on one thread. A walk
//! adds up coordinates, values and normals, so that it reads everything that a renderer needs; or only coordinates. In
//! each view the methods take turns, so that changes of the machine's speed affect all of them.

use std::hint::black_box;
use std::time::Instant;

use super::baselines::{Method, Viewing, Walker as _};
use super::levels::geometric_mean;
use super::picture;
use super::receive::{CoordinateSum, VoxelSum};
use super::subject::Subject;
use crate::{GoOn, report_step};
use adjsplat::error::Result;
use adjsplat::splat::{Orbit, Settings};
use adjsplat::traverse::{Order, Sense, SplitForm, Viewpoint};

/// Number of orders of parallel views: six nestings, eight directions.
pub const ORDERS: usize = 48;

/// The views in which walks are timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Views {
    /// Parallel views: the [`ORDERS`].
    #[default]
    Parallel,
    /// Perspective views of a turn around the volume, 10 degrees apart, as [`super::speed`] sees them.
    Outside,
    /// Perspective views from an eye near the centre of the volume: the six nestings, front to back and back to front.
    Inside,
}

impl Views {
    /// Returns the views of `subject`.
    ///
    /// # Errors
    /// Any error of creating a camera or an order.
    pub fn of(self, subject: &Subject) -> Result<Vec<Viewing>> {
        match self {
            Views::Parallel => Ok((0..ORDERS).map(|index| Viewing::along(order(index))).collect()),
            Views::Outside => {
                let settings = Settings::every_pixel([300; 2]);
                let turn = (0..36).map(|frame| {
                    let azimuth = f64::from(frame) * 10.0;
                    let orbit = Orbit { azimuth, elevation: 20.0, fov: Some(30.0), ..Orbit::default() };
                    picture::viewing(subject, &picture::camera(subject, orbit, settings.size)?, &settings)
                });
                turn.collect()
            }
            Views::Inside => {
                // Off the planes of the grid, and not in the middle: sides of equal length are a special case.
                let eye = subject.dims().map(|points| f64::from(points) * 0.45 + 0.2);
                let nestings = (0..6).map(|nesting| Viewing::along(Order::parallel(nesting, 0)));
                let views = nestings.flat_map(|along| {
                    let Viewpoint::Parallel { direction: toward } = along.viewpoint else {
                        unreachable!("as asked for")
                    };
                    [Sense::FrontToBack, Sense::BackToFront].map(|sense| {
                        let viewpoint = Viewpoint::Perspective { eye, toward };
                        Viewing::new(viewpoint, subject.dims(), sense, SplitForm::default())
                    })
                });
                views.collect()
            }
        }
    }
}

/// What a walk reads of each voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reading {
    /// Coordinates, value and normal.
    #[default]
    Everything,
    /// Coordinates only.
    Coordinates,
}

/// Walk times of one method.
#[derive(Debug, Clone, PartialEq)]
pub struct Walks {
    /// The measured method.
    pub method: Method,
    /// Nanoseconds per visible voxel, by view. Parallel views come by order: index 8 x nesting + directions, as
    /// [`Order::parallel`] numbers them.
    pub ns: Vec<f64>,
}

impl Walks {
    /// Returns the geometric mean of the times over the views.
    pub fn geometric_mean(&self) -> f64 {
        geometric_mean(&self.ns)
    }

    /// Returns the median of the times over the views.
    pub fn median(&self) -> f64 {
        let mut sorted = self.ns.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        f64::midpoint(sorted[middle], sorted[(sorted.len() - 1) / 2])
    }

    /// Returns the time of the slowest view.
    pub fn worst(&self) -> f64 {
        self.ns.iter().copied().fold(0.0, f64::max)
    }
}

/// Returns order number `index`, below [`ORDERS`].
pub fn order(index: usize) -> Order {
    Order::parallel(index / 8, u8::try_from(index % 8).expect("below 8"))
}

/// Measures every `stride`-th of `views`, each `repetitions` times; `go_on` receives the views done and in total, and
/// can cancel.
///
/// The structures of all methods are in memory at once.
///
/// # Errors
/// Any error of [`Method::build`] and [`Views::of`]; [`Error::Interrupted`](adjsplat::Error::Interrupted) if `go_on` cancels.
pub fn measure(
    subject: &Subject,
    methods: &[Method],
    views: Views,
    stride: usize,
    repetitions: u32,
    reading: Reading,
    go_on: GoOn,
) -> Result<Vec<Walks>> {
    let mut built = methods.iter().map(|method| method.build(subject)).collect::<Result<Vec<_>>>()?;
    let mut found: Vec<Walks> = methods.iter().map(|&method| Walks { method, ns: Vec::new() }).collect();
    let visible = subject.voxels.len().max(1) as f64;
    let views = views.of(subject)?;
    for (index, viewing) in views.iter().enumerate().step_by(stride.max(1)) {
        let mut fastest = vec![f64::INFINITY; methods.len()];
        for _ in 0..repetitions.max(1) {
            for (built, fastest) in built.iter_mut().zip(&mut fastest) {
                let start = Instant::now();
                match reading {
                    Reading::Everything => _ = black_box(built.received::<VoxelSum>(viewing)),
                    Reading::Coordinates => _ = black_box(built.received::<CoordinateSum>(viewing)),
                }
                *fastest = fastest.min(start.elapsed().as_secs_f64());
            }
        }
        for (walks, seconds) in found.iter_mut().zip(fastest) {
            walks.ns.push(seconds * 1e9 / visible);
        }
        report_step(go_on, index as u64 + 1, views.len() as u64)?;
    }
    Ok(found)
}
