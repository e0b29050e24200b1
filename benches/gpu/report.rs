//! The report of the study, as Markdown tables and as JSON.

use adjsplat::splat::Quality;
use serde::Serialize;

use super::limits::LimitRow;
use super::order::OrderRow;
use super::paths::{PathRow, StageTimes};

/// All measurements.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) device: String,
    pub(crate) driver: String,
    pub(crate) kind: &'static str,
    /// Whether draws and sorts are timed by the device's clock; else from submission to completion.
    pub(crate) has_clock: bool,
    /// Whether the host code has debug assertions: its milliseconds mean little then.
    pub(crate) has_debug_assertions: bool,
    /// Gigabytes (10^9) a second, of the copy.
    pub(crate) copy_gigabytes_a_second: Option<f64>,
    pub(crate) copy_bytes: u64,
    pub(crate) paths: Vec<PathRow>,
    pub(crate) order: Vec<OrderRow>,
    pub(crate) limits: Vec<LimitRow>,
}

/// Returns the median of at least one value.
pub(crate) fn median(mut of: Vec<f64>) -> f64 {
    of.sort_by(f64::total_cmp);
    f64::midpoint(of[(of.len() - 1) / 2], of[of.len() / 2])
}

fn milliseconds(time: Option<f64>) -> String {
    time.map_or("-".into(), |ms| format!("{ms:.3}"))
}

fn quality(quality: Quality) -> String {
    format!("{quality:?}").to_lowercase()
}

impl Report {
    /// Prints the measurements as Markdown.
    pub(crate) fn print(&self) {
        println!("{} ({}), {}", self.device, self.kind, self.driver);
        if self.kind == "software" {
            println!("This is a processor that plays a graphics device: nothing here is about cards.");
        }
        if !self.has_clock {
            println!("The device has no clock: draws and sorts are timed from hand-over to done.");
        }
        if self.paths.iter().any(|row| row.stages.is_none()) {
            println!("StageTimes without times: the device has no clock, or one that stops before the work is done.");
        }
        self.print_paths();
        self.print_order();
        self.print_limits();
    }

    fn print_paths(&self) {
        println!("\nThe renderer over a turn; medians of frames; ms.\n");
        println!(
            "| scene | picture | quality | compositor | splats | frames/s | M splats/s | frame | walk | project | bin | \
             composite | stages | read-back | line lists | ms for them |"
        );
        println!("|{}", " --- |".repeat(16));
        for row in &self.paths {
            let stage = |of: fn(&StageTimes) -> f64| milliseconds(row.stages.as_ref().map(of));
            println!(
                "| {} | {}x{} | {} | {} | {:.0} | {:.2} | {:.2} | {:.2} | {} | {} | {} | {} | {} | {:.2} | {} | {:.2} |",
                row.scene,
                row.size[0],
                row.size[1],
                quality(row.quality),
                row.compositor,
                row.splats,
                row.frames_a_second,
                row.splats_a_second * 1e-6,
                row.frame_ms,
                stage(|stages| stages.walk_ms),
                stage(|stages| stages.project_ms),
                stage(|stages| stages.bin_ms),
                stage(|stages| stages.composite_ms),
                stage(|stages| stages.all_ms),
                row.read_back_ms,
                row.line_lists,
                row.line_lists_ms,
            );
        }
    }

    fn print_order(&self) {
        if self.order.is_empty() {
            return;
        }
        println!("\nThe same splats as quads in 16-bit floats; medians of views; ms. Walk: from the table above.\n");
        println!(
            "| scene | splats | of a frame's | walk | in visit order | in storage order | sort | ns a splat | sorted | \
             order costs | structure saves |"
        );
        println!("|{}", " --- |".repeat(11));
        for row in &self.order {
            let of_tiles = self.paths.iter().find(|path| {
                (&path.scene, path.size, path.quality) == (&row.scene, row.size, row.quality)
                    && path.compositor == "tiles"
            });
            // The walk visits all splats of the frame: here the share of those that are compared.
            let share = row.splats / row.splats_of_frame.max(1.0);
            let walk = of_tiles.and_then(|path| path.stages.as_ref()).map(|stages| stages.walk_ms * share);
            let costs = walk.map(|walk| walk + row.visit_order_ms - row.storage_order_ms);
            let saves = walk.map(|walk| row.sort_ms + row.sorted_ms - walk - row.visit_order_ms);
            println!(
                "| {} | {:.0} | {:.0} | {} | {:.3} | {:.3} | {:.3} | {:.2} | {:.3} | {} | {} |",
                row.scene,
                row.splats,
                row.splats_of_frame,
                milliseconds(walk),
                row.visit_order_ms,
                row.storage_order_ms,
                row.sort_ms,
                row.sort_ms * 1e6 / row.splats,
                row.sorted_ms,
                milliseconds(costs),
                milliseconds(saves),
            );
        }
    }

    fn print_limits(&self) {
        let Some(bandwidth) = self.copy_gigabytes_a_second else { return };
        println!(
            "\nBytes against the memory: a copy of {} MiB moves {bandwidth:.1} GB/s, read and written.\n",
            self.copy_bytes >> 20
        );
        println!("| scene | stage | MB | limit, ms | taken, ms | times the limit |");
        println!("|{}", " --- |".repeat(6));
        for row in &self.limits {
            println!(
                "| {} | {} | {:.1} | {:.3} | {} | {} |",
                row.scene,
                row.stage,
                row.bytes as f64 * 1e-6,
                row.limit_ms,
                milliseconds(row.ms),
                row.ms.map_or("-".into(), |ms| format!("{:.1}", ms / row.limit_ms)),
            );
        }
    }
}
