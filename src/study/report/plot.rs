//! Plots of what a study found.
//!
//! In: named series of points. Out: SVG, or PNG of the same drawing. The drawing itself is the library's.

use kuva::plot::scatter::ScatterPlot;
use kuva::plot::{LinePlot, LineStyle};
use kuva::render::layout::Layout;
use kuva::render::plots::Plot as Drawn;

use crate::error::{Error, Result};
use crate::study::baselines::Method;

/// What a plot shows along one side.
#[derive(Debug, Clone, PartialEq)]
pub struct Side {
    /// What and in which unit.
    pub label: String,
    /// Whether equal distances are equal ratios.
    pub logarithmic: bool,
    /// Names at 1, 2, 3 ...; empty for numbers.
    pub names: Vec<String>,
}

impl Side {
    /// Numbers, evenly.
    pub fn linear(label: &str) -> Side {
        Side { label: label.to_owned(), logarithmic: false, names: Vec::new() }
    }

    /// Numbers, by ratio.
    pub fn logarithmic(label: &str) -> Side {
        Side { logarithmic: true, ..Side::linear(label) }
    }

    /// Names.
    pub fn named(label: &str, names: Vec<String>) -> Side {
        Side { names, ..Side::linear(label) }
    }
}

/// How a series' points are joined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stroke {
    /// By a line.
    Solid,
    /// By a dashed line.
    Dashed,
    /// Not at all.
    None,
}

/// Points that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// What the legend calls it.
    pub name: String,
    /// From left to right.
    pub points: Vec<[f64; 2]>,
    /// What joins them.
    pub stroke: Stroke,
    /// What stands beside each point; empty for nothing.
    pub labels: Vec<String>,
}

impl Series {
    /// Points joined by a line.
    pub fn solid(name: impl Into<String>, points: Vec<[f64; 2]>) -> Series {
        Series { name: name.into(), points, stroke: Stroke::Solid, labels: Vec::new() }
    }

    /// Points joined by a dashed line.
    pub fn dashed(name: impl Into<String>, points: Vec<[f64; 2]>) -> Series {
        Series { stroke: Stroke::Dashed, ..Series::solid(name, points) }
    }

    /// Points alone.
    pub fn points(name: impl Into<String>, points: Vec<[f64; 2]>) -> Series {
        Series { stroke: Stroke::None, ..Series::solid(name, points) }
    }

    /// Adds a point to the one of `all` that has this name, or to a new one of points alone.
    pub fn add_point(all: &mut Vec<Series>, name: &str, point: [f64; 2]) {
        match all.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => all.push(Series::points(name, vec![point])),
        }
    }
}

/// A plot of points, and lines through them.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// What it says.
    pub title: String,
    /// From left to right.
    pub x: Side,
    /// Upward.
    pub y: Side,
    /// Each in a colour of its own; a solid and a dashed one of the same name share theirs.
    pub series: Vec<Series>,
}

/// Colours that stay apart for most eyes and in print (Okabe and Ito 2008), then darker and lighter ones: one for each
/// method, of which no plot has more.
const COLOURS: [&str; Method::ALL.len()] = [
    "#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c6d31", "#7f7f7f", "#7b4173",
    "#b5cf6b", "#ff9896", "#00441b",
];

impl Plot {
    fn drawn(&self) -> (Vec<Drawn>, Layout) {
        let mut names: Vec<&str> = Vec::new();
        let mut plots = Vec::new();
        for series in &self.series {
            let known = names.iter().position(|name| *name == series.name);
            let index = known.unwrap_or_else(|| {
                names.push(&series.name);
                names.len() - 1
            });
            let colour = COLOURS[index % COLOURS.len()];
            // What is 0 or less has no place among ratios.
            let shown = |&[x, y]: &[f64; 2]| (!self.x.logarithmic || x > 0.0) && (!self.y.logarithmic || y > 0.0);
            let at: Vec<usize> = (0..series.points.len()).filter(|&at| shown(&series.points[at])).collect();
            let points: Vec<(f64, f64)> = at.iter().map(|&at| series.points[at].into()).collect();
            if points.is_empty() {
                continue;
            }
            let legend = known.is_none().then(|| series.name.clone());
            let mut marks = ScatterPlot::new().with_data(points.iter().copied()).with_color(colour).with_size(3.0);
            if !series.labels.is_empty() {
                let label = |&at: &usize| series.labels.get(at).map_or("", String::as_str);
                marks = marks.with_labels(at.iter().map(label)).with_repel_labels();
            }
            if series.stroke == Stroke::None {
                // Without a line to see, marks are larger.
                marks = marks.with_size(4.0);
                plots.push(Drawn::Scatter(legend.into_iter().fold(marks, ScatterPlot::with_legend)));
                continue;
            }
            let mut line = LinePlot::new().with_data(points).with_color(colour).with_stroke_width(1.6);
            if series.stroke == Stroke::Dashed {
                line = line.with_line_style(LineStyle::Dashed);
            }
            plots.push(Drawn::Line(legend.into_iter().fold(line, LinePlot::with_legend)));
            plots.push(Drawn::Scatter(marks));
        }
        let mut layout = Layout::auto_from_plots(&plots)
            .with_title(self.title.clone())
            .with_width(860.0)
            .with_height(520.0)
            .with_x_label(self.x.label.clone())
            .with_y_label(self.y.label.clone());
        if self.x.logarithmic {
            layout = layout.with_log_x();
        }
        if self.y.logarithmic {
            layout = layout.with_log_y();
        }
        if !self.x.names.is_empty() {
            layout = layout.with_x_categories(self.x.names.clone()).with_x_tick_rotate(-30.0);
        }
        (plots, layout)
    }

    /// As scalable vector graphics.
    pub fn svg(&self) -> String {
        let (plots, layout) = self.drawn();
        kuva::render_to_svg(plots, layout)
    }

    /// As a PNG file's bytes, twice as many pixels a side as the SVG has units.
    ///
    /// # Errors
    /// [`Error::Input`] if the drawing cannot be made into pixels.
    pub fn png(&self) -> Result<Vec<u8>> {
        let (plots, layout) = self.drawn();
        kuva::render_to_png(plots, layout, 2.0).map_err(|why| Error::input("plot", why))
    }
}
