//! Plots: named series of points. A build with the feature `plot` can draw them.

#[cfg(not(feature = "plot"))]
use adjsplat::error::{Error, Result};

/// An axis of a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotAxis {
    /// The quantity that the axis shows, and its unit.
    pub label: String,
    /// Whether the scale is logarithmic.
    pub logarithmic: bool,
    /// Names of the positions 1, 2, 3 and so on; empty for an axis of numbers.
    pub names: Vec<String>,
}

impl PlotAxis {
    /// Returns an axis with a linear scale.
    pub fn linear(label: &str) -> PlotAxis {
        PlotAxis { label: label.to_owned(), logarithmic: false, names: Vec::new() }
    }

    /// Returns an axis with a logarithmic scale.
    pub fn logarithmic(label: &str) -> PlotAxis {
        PlotAxis { logarithmic: true, ..PlotAxis::linear(label) }
    }

    /// Returns an axis whose positions have names instead of numbers.
    pub fn named(label: &str, names: Vec<String>) -> PlotAxis {
        PlotAxis { names, ..PlotAxis::linear(label) }
    }
}

/// The line through the points of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stroke {
    /// A solid line.
    Solid,
    /// A dashed line.
    Dashed,
    /// No line.
    None,
}

/// A series of points in a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotSeries {
    /// The series' name in the legend.
    pub name: String,
    /// The points, from left to right.
    pub points: Vec<[f64; 2]>,
    /// The line that joins the points.
    pub stroke: Stroke,
    /// Labels of the points, in their order; empty for none.
    pub labels: Vec<String>,
}

impl PlotSeries {
    /// Returns a series whose points are joined by a solid line.
    pub fn solid(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { name: name.into(), points, stroke: Stroke::Solid, labels: Vec::new() }
    }

    /// Returns a series whose points are joined by a dashed line.
    pub fn dashed(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { stroke: Stroke::Dashed, ..PlotSeries::solid(name, points) }
    }

    /// Returns a series of points without a line.
    pub fn points(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { stroke: Stroke::None, ..PlotSeries::solid(name, points) }
    }

    /// Adds a point to the series `name` in `all`, which gets a new series without a line if it has none of that name.
    pub fn add_point(all: &mut Vec<PlotSeries>, name: &str, point: [f64; 2]) {
        match all.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => all.push(PlotSeries::points(name, vec![point])),
        }
    }
}

/// A plot: series of points on two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// The plot's title.
    pub title: String,
    /// The horizontal axis.
    pub x: PlotAxis,
    /// The vertical axis.
    pub y: PlotAxis,
    /// The series to draw. Each name has its own colour, so a solid and a dashed series of one name share theirs.
    pub series: Vec<PlotSeries>,
}

#[cfg(not(feature = "plot"))]
impl Plot {
    /// Fails: this build has no plotting library.
    ///
    /// # Errors
    /// Always [`Error::Input`].
    pub fn to_svg(&self) -> Result<Vec<u8>> {
        Err(Error::input("plot", "cannot be drawn: the feature `plot` of adjsplat-study is off"))
    }

    /// Fails as [`Plot::to_svg`] does: this build has no plotting library.
    ///
    /// # Errors
    /// Always [`Error::Input`].
    pub fn to_png(&self) -> Result<Vec<u8>> {
        self.to_svg()
    }
}
