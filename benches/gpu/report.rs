//! The tables and the JSON.

use adjsplat::splat::Quality;
use serde::Serialize;

use super::limits::LimitRow;
use super::order::OrderRow;
use super::paths::PathRow;

/// All that was measured.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) device: String,
    pub(crate) driver: String,
    pub(crate) kind: &'static str,
    /// Whether the device says that it has a clock.
    pub(crate) offers_clock: bool,
    /// Whether it has one that does not stop before the work is done; else stages are not timed.
    pub(crate) has_clock: bool,
    /// Host code with debug assertions: its milliseconds mean little.
    pub(crate) has_debug_assertions: bool,
    /// Gigabytes (10^9) a second, of the copy.
    pub(crate) copy_gigabytes_a_second: Option<f64>,
    pub(crate) copy_bytes: u64,
    pub(crate) paths: Vec<PathRow>,
    pub(crate) order: Vec<OrderRow>,
    pub(crate) limits: Vec<LimitRow>,
}

/// The middle one, of at least one.
pub(crate) fn median(mut of: Vec<f64>) -> f64 {
    of.sort_by(f64::total_cmp);
    of[of.len() / 2]
}

fn quality(quality: Quality) -> String {
    format!("{quality:?}").to_lowercase()
}

impl Report {
    /// Prints what is there as Markdown.
    pub(crate) fn print(&self) {
        println!("{} ({}), {}", self.device, self.kind, self.driver);
        if self.kind == "software" {
            println!("This is a processor that plays a graphics device: nothing here is about cards.");
        }
        if !self.has_clock {
            let why = if self.offers_clock { "'s clock stops before the work is done" } else { " has no clock" };
            println!("The device{why}: draws and sorts are timed from hand-over to done, stages not at all (0).");
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
            println!(
                "| {} | {}x{} | {} | {} | {:.0} | {:.2} | {:.2} | {:.2} | {:.3} | {:.3} | {:.3} | {:.3} | {:.3} | \
                 {:.2} | {} | {:.2} |",
                row.scene,
                row.size[0],
                row.size[1],
                quality(row.quality),
                row.compositor,
                row.splats,
                row.frames_a_second,
                row.splats_a_second * 1e-6,
                row.frame_ms,
                row.walk_ms,
                row.project_ms,
                row.bin_ms,
                row.composite_ms,
                row.device_ms,
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
            // The walk of all of the frame's splats, scaled to those that are compared.
            let of_tiles = self.paths.iter().find(|path| path.scene == row.scene && path.compositor == "tiles");
            let walk = of_tiles.map_or(0.0, |path| path.walk_ms) * row.splats / row.splats_of_frame.max(1.0);
            println!(
                "| {} | {:.0} | {:.0} | {walk:.3} | {:.3} | {:.3} | {:.3} | {:.2} | {:.3} | {:+.3} | {:+.3} |",
                row.scene,
                row.splats,
                row.splats_of_frame,
                row.visit_order_ms,
                row.storage_order_ms,
                row.sort_ms,
                row.sort_ms * 1e6 / row.splats,
                row.sorted_ms,
                walk + row.visit_order_ms - row.storage_order_ms,
                row.sort_ms + row.sorted_ms - walk - row.visit_order_ms,
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
                "| {} | {} | {:.1} | {:.3} | {:.3} | {:.1} |",
                row.scene,
                row.stage,
                row.bytes as f64 * 1e-6,
                row.limit_ms,
                row.ms,
                row.ms / row.limit_ms,
            );
        }
    }
}
