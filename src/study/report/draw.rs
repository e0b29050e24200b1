//! Draws plots as SVG or PNG with the plotting library of the feature `plot`.

use kuva::plot::scatter::ScatterPlot;
use kuva::plot::{LinePlot, LineStyle};
use kuva::render::layout::Layout;
use kuva::render::plots::Plot as Drawn;

use super::plot::{Plot, Stroke};
use crate::baselines::Method;
use adjsplat::error::{Error, Result};

/// One colour per method. They differ for most viewers and in print (Okabe and Ito 2008); darker and lighter ones
/// follow.
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
            // A logarithmic axis cannot show 0 and negative numbers.
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
                // Marks of a series without a line are larger.
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

    /// Returns the plot as SVG.
    pub fn to_svg(&self) -> Result<Vec<u8>> {
        let (plots, layout) = self.drawn();
        Ok(kuva::render_to_svg(plots, layout).into_bytes())
    }

    /// Returns the plot as a PNG file, with two pixels for each unit of the SVG.
    ///
    /// # Errors
    /// [`Error::Input`] if the plot cannot be rasterised.
    pub fn to_png(&self) -> Result<Vec<u8>> {
        let (plots, layout) = self.drawn();
        kuva::render_to_png(plots, layout, 2.0).map_err(|why| Error::input("plot", why))
    }
}
