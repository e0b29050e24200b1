//! Plots of what a study found: named series of points, which [`draw`](super::draw) turns into a picture.

#[cfg(not(feature = "plot"))]
use adjsplat::error::{Error, Result};

/// What a plot shows along one side.
#[derive(Debug, Clone, PartialEq)]
pub struct PlotAxis {
    /// What and in which unit.
    pub label: String,
    /// Whether equal distances are equal ratios.
    pub logarithmic: bool,
    /// Names at 1, 2, 3 ...; empty for numbers.
    pub names: Vec<String>,
}

impl PlotAxis {
    /// Numbers, evenly.
    pub fn linear(label: &str) -> PlotAxis {
        PlotAxis { label: label.to_owned(), logarithmic: false, names: Vec::new() }
    }

    /// Numbers, by ratio.
    pub fn logarithmic(label: &str) -> PlotAxis {
        PlotAxis { logarithmic: true, ..PlotAxis::linear(label) }
    }

    /// Names.
    pub fn named(label: &str, names: Vec<String>) -> PlotAxis {
        PlotAxis { names, ..PlotAxis::linear(label) }
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
pub struct PlotSeries {
    /// What the legend calls it.
    pub name: String,
    /// From left to right.
    pub points: Vec<[f64; 2]>,
    /// What joins them.
    pub stroke: Stroke,
    /// What stands beside each point; empty for nothing.
    pub labels: Vec<String>,
}

impl PlotSeries {
    /// Points joined by a line.
    pub fn solid(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { name: name.into(), points, stroke: Stroke::Solid, labels: Vec::new() }
    }

    /// Points joined by a dashed line.
    pub fn dashed(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { stroke: Stroke::Dashed, ..PlotSeries::solid(name, points) }
    }

    /// Points alone.
    pub fn points(name: impl Into<String>, points: Vec<[f64; 2]>) -> PlotSeries {
        PlotSeries { stroke: Stroke::None, ..PlotSeries::solid(name, points) }
    }

    /// Adds a point to the one of `all` that has this name, or to a new one of points alone.
    pub fn add_point(all: &mut Vec<PlotSeries>, name: &str, point: [f64; 2]) {
        match all.iter_mut().find(|series| series.name == name) {
            Some(series) => series.points.push(point),
            None => all.push(PlotSeries::points(name, vec![point])),
        }
    }
}

/// A plot of points, and lines through them.
#[derive(Debug, Clone, PartialEq)]
pub struct Plot {
    /// What it says.
    pub title: String,
    /// From left to right.
    pub x: PlotAxis,
    /// Upward.
    pub y: PlotAxis,
    /// Each in a colour of its own; a solid and a dashed one of the same name share theirs.
    pub series: Vec<PlotSeries>,
}

#[cfg(not(feature = "plot"))]
impl Plot {
    /// Fails: this build has no plotting library.
    ///
    /// # Errors
    /// [`Error::Input`].
    pub fn to_svg(&self) -> Result<Vec<u8>> {
        Err(Error::input("plot", "cannot be drawn: the feature `plot` of adjsplat-study is off"))
    }

    /// Fails, as [`Plot::to_svg`].
    ///
    /// # Errors
    /// [`Error::Input`].
    pub fn to_png(&self) -> Result<Vec<u8>> {
        self.to_svg()
    }
}
