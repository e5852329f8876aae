//! Plots as SVG: lines, points, bars, bands, with axes, ticks, units and a legend; alone in a file or inside a page.

mod axis;
mod draw;
mod kinds;

pub use axis::Axis;
use axis::Scale;
pub use kinds::{Profile, cumulative, profile, reliability, residual};

use crate::color::{self, Rgb};

/// How the points of a series are shown.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Mark {
    /// Joined; broken where a coordinate is not finite.
    Line { dashed: bool },
    /// One dot each.
    Dots,
    /// One bar each, from zero (or the axis' lower end).
    Bars,
    /// Vertical intervals `[x, low, high]`.
    Intervals(Vec<[f64; 3]>),
    /// The area between `[x, low, high]`.
    Band(Vec<[f64; 3]>),
}

/// Points of one name and colour.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Series {
    name: String,
    color: Rgb,
    mark: Mark,
    points: Vec<[f64; 2]>,
}

/// A plot.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    title: String,
    width: f64,
    height: f64,
    x: Axis,
    y: Axis,
    series: Vec<Series>,
}

impl Chart {
    /// An empty one of 540 × 360 CSS pixels.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), width: 540.0, height: 360.0, x, y, series: Vec::new() }
    }

    /// Another size, CSS pixels.
    pub fn size(mut self, width: f64, height: f64) -> Self {
        (self.width, self.height) = (width, height);
        self
    }

    fn with(mut self, name: impl Into<String>, color: Rgb, mark: Mark, points: Vec<[f64; 2]>) -> Self {
        self.series.push(Series { name: name.into(), color, mark, points });
        self
    }

    /// A line through the points; one that is not finite breaks it.
    pub fn line(self, name: impl Into<String>, color: Rgb, points: Vec<[f64; 2]>) -> Self {
        self.with(name, color, Mark::Line { dashed: false }, points)
    }

    /// A dashed line through the points.
    pub(crate) fn dashed(self, name: impl Into<String>, color: Rgb, points: Vec<[f64; 2]>) -> Self {
        self.with(name, color, Mark::Line { dashed: true }, points)
    }

    /// A dot per point.
    pub fn dots(self, name: impl Into<String>, color: Rgb, points: Vec<[f64; 2]>) -> Self {
        self.with(name, color, Mark::Dots, points)
    }

    /// A bar per point; bars of several series at the same place stand side by side.
    pub(crate) fn bars(self, name: impl Into<String>, color: Rgb, points: Vec<[f64; 2]>) -> Self {
        self.with(name, color, Mark::Bars, points)
    }

    /// Vertical intervals `[x, low, high]`; without a name they are not in the legend.
    pub fn intervals(self, name: impl Into<String>, color: Rgb, intervals: Vec<[f64; 3]>) -> Self {
        let points = ends(&intervals);
        self.with(name, color, Mark::Intervals(intervals), points)
    }

    /// The area between `[x, low, high]`.
    pub(crate) fn band(self, name: impl Into<String>, color: Rgb, band: Vec<[f64; 3]>) -> Self {
        let points = ends(&band);
        self.with(name, color, Mark::Band(band), points)
    }

    /// A group of bars per category and a bar per series: `values[series][category]`.
    pub fn grouped_bars(
        title: impl Into<String>,
        categories: &[String],
        y: Axis,
        series: &[(String, Vec<f64>)],
    ) -> Self {
        let mut chart = Self::new(title, Axis::categories(categories), y);
        for (k, (name, values)) in series.iter().enumerate() {
            let points = values.iter().enumerate().map(|(i, v)| [i as f64, *v]).collect();
            chart = chart.bars(name.clone(), color::series(k), points);
        }
        chart
    }
}

fn ends(intervals: &[[f64; 3]]) -> Vec<[f64; 2]> {
    intervals.iter().flat_map(|[x, low, high]| [[*x, *low], [*x, *high]]).collect()
}

#[cfg(test)]
mod tests;
