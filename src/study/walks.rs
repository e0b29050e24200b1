//! Walk times: nanoseconds per visible voxel in each of the 48 orders of parallel views.
//!
//! In: a subject and methods. Out: the fastest of several walks of each method in each order, on one thread. A walk
//! adds up coordinates, values and normals, so that it reads everything that a renderer needs; or only coordinates. In
//! each order the methods take turns, so that changes of the machine's speed affect all of them.

use std::hint::black_box;
use std::time::Instant;

use super::baselines::{Method, Viewing};
use super::speed::{summed, summed_coordinates};
use super::subject::Subject;
use crate::GoOn;
use adjsplat::error::{Error, Result};
use adjsplat::traverse::Order;

/// Number of orders of parallel views: six nestings, eight directions.
pub const ORDERS: usize = 48;

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
    /// Nanoseconds per visible voxel, by order: index 8 x nesting + directions, as [`Order::parallel`] numbers them.
    pub ns: Vec<f64>,
}

impl Walks {
    /// Returns the geometric mean of the times over the orders.
    pub fn geometric_mean(&self) -> f64 {
        (self.ns.iter().map(|ns| ns.ln()).sum::<f64>() / self.ns.len() as f64).exp()
    }

    /// Returns the median of the times over the orders.
    pub fn median(&self) -> f64 {
        let mut sorted = self.ns.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        f64::midpoint(sorted[middle], sorted[(sorted.len() - 1) / 2])
    }

    /// Returns the time of the slowest order.
    pub fn worst(&self) -> f64 {
        self.ns.iter().copied().fold(0.0, f64::max)
    }
}

/// Returns order number `index`, below [`ORDERS`].
pub fn order(index: usize) -> Order {
    Order::parallel(index / 8, u8::try_from(index % 8).expect("below 8"))
}

/// Measures every `stride`-th order, each `repetitions` times; `go_on` receives the orders done and in total, and can
/// cancel.
///
/// The structures of all methods are in memory at once.
///
/// # Errors
/// Any error of [`Method::build`]; [`Error::Interrupted`] if `go_on` cancels.
pub fn measure(
    subject: &Subject,
    methods: &[Method],
    stride: usize,
    repetitions: u32,
    reading: Reading,
    go_on: GoOn,
) -> Result<Vec<Walks>> {
    let mut built = methods.iter().map(|method| method.build(subject)).collect::<Result<Vec<_>>>()?;
    let mut found: Vec<Walks> = methods.iter().map(|&method| Walks { method, ns: Vec::new() }).collect();
    let visible = subject.voxels.len().max(1) as f64;
    for index in (0..ORDERS).step_by(stride.max(1)) {
        let viewing = Viewing::along(order(index));
        let mut fastest = vec![f64::INFINITY; methods.len()];
        for _ in 0..repetitions.max(1) {
            for (built, fastest) in built.iter_mut().zip(&mut fastest) {
                let start = Instant::now();
                match reading {
                    Reading::Everything => _ = black_box(summed(subject, built, &viewing)),
                    Reading::Coordinates => _ = black_box(summed_coordinates(subject, built, &viewing)),
                }
                *fastest = fastest.min(start.elapsed().as_secs_f64());
            }
        }
        for (walks, seconds) in found.iter_mut().zip(fastest) {
            walks.ns.push(seconds * 1e9 / visible);
        }
        if go_on(index as u64 + 1, ORDERS as u64).is_break() {
            return Err(Error::Interrupted);
        }
    }
    Ok(found)
}
