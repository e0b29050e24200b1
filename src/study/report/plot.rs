//! Plots: named series of points. With the feature `plot` they can be drawn.

#[cfg(not(feature = "plot"))]
use adjsplat::error::{Error, Result};

/// An axis of a plot.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotAxis {
    /// Its quantity and unit.
    pub label: String,
    /// Whether the scale is logarithmic.
    pub logarithmic: bool,
    /// Names of the positions 1, 2, 3 and so on; empty for numbers.
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

    /// Returns an axis of names.
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
    /// Its name in the legend.
    pub name: String,
    /// The points, from left to right.
    pub points: Vec<[f64; 2]>,
    /// The line through them.
    pub stroke: Stroke,
    /// Labels of the points; empty for none.
    pub labels: Vec<String>,
}

impl PlotSeries {
    /// Returns points on a solid line.
    pub fn solid(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { name: name.into(), points, stroke: Stroke::Solid, labels: Vec::new() }
    }

    /// Returns points on a dashed line.
    pub fn dashed(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { stroke: Stroke::Dashed, ..PlotSeries::solid(name, points) }
    }

    /// Returns points without a line.
    pub fn points(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { stroke: Stroke::None, ..PlotSeries::solid(name, points) }
    }

    /// Adds a point to the series `name` of `all`; makes one without a line if there is none.
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
    /// Its title.
    pub title: String,
    /// The horizontal axis.
    pub x: PlotAxis,
    /// The vertical axis.
    pub y: PlotAxis,
    /// The series. Each name has its own colour, so a solid and a dashed series of one name share theirs.
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

    /// Fails, as [`Plot::to_svg`].
    ///
    /// # Errors
    /// Always [`Error::Input`].
    pub fn to_png(&self) -> Result<Vec<u8>> {
        self.to_svg()
    }
}
