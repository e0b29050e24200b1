//! Walks: nanoseconds a visible voxel in each of the 48 orders of parallel views.
//!
//! In: a subject, methods. Out: the fastest of several walks of each method in each order, on one thread; every walk adds
//! up coordinates, values and normals, so nothing that a renderer would read is left unread, or coordinates alone. The
//! methods take turns in every order, so that a change of the machine's pace meets all of them.

use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::Instant;

use super::baselines::{Method, Viewing};
use super::speed::{summed, summed_coordinates};
use super::subject::Subject;
use adjsplat::error::{Error, Result};
use adjsplat::traverse::Order;

/// Orders of parallel views: six nestings, eight directions.
pub const ORDERS: usize = 48;

/// What a walk reads of each voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reading {
    /// Coordinates, value and normal.
    #[default]
    Everything,
    /// Where it is.
    Coordinates,
}

/// What one method's walks took.
#[derive(Debug, Clone, PartialEq)]
pub struct Walks {
    /// The method.
    pub method: Method,
    /// Nanoseconds a visible voxel, by order: nesting x 8 + directions, as [`Order::parallel`] numbers them.
    pub ns: Vec<f64>,
}

impl Walks {
    /// Geometric mean over the orders.
    pub fn geometric_mean(&self) -> f64 {
        (self.ns.iter().map(|ns| ns.ln()).sum::<f64>() / self.ns.len() as f64).exp()
    }

    /// Median over the orders.
    pub fn median(&self) -> f64 {
        let mut sorted = self.ns.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        f64::midpoint(sorted[middle], sorted[(sorted.len() - 1) / 2])
    }

    /// The slowest order.
    pub fn worst(&self) -> f64 {
        self.ns.iter().copied().fold(0.0, f64::max)
    }
}

/// Order number `index`, below [`ORDERS`].
pub fn order(index: usize) -> Order {
    Order::parallel(index / 8, u8::try_from(index % 8).expect("below 8"))
}

/// Measures every `stride`-th order `repetitions` times; `go_on` is told what is done of how much, and may stop it.
///
/// The structures of all `methods` are in memory at once.
///
/// # Errors
/// As building the methods; [`Error::Interrupted`] if `go_on` says so.
pub fn measure(
    subject: &Subject,
    methods: &[Method],
    stride: usize,
    repetitions: u32,
    reading: Reading,
    mut go_on: impl FnMut(u64, u64) -> ControlFlow<()>,
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
