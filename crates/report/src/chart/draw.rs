//! A chart as SVG.

use super::{Axis, Chart, Mark, Series};
use crate::color::hex;
use crate::escape::escape;

/// Width of an average character of the small font, CSS pixels: for room in the legend and at the ticks.
const CHARACTER: f64 = 6.3;
const SMALL: f64 = 11.5;
const LEGEND_ROW: f64 = 17.0;

/// Where the data are drawn.
struct Plot<'a> {
    chart: &'a Chart,
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    x_ends: [f64; 2],
    y_ends: [f64; 2],
}

impl Chart {
    /// The drawing; one element, usable in a page and as a file.
    pub fn svg(&self) -> String {
        let (legend, legend_rows) = legend(self);
        let plot = Plot::new(self, legend_rows);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" role=\"img\" \
         font-family=\"system-ui, Segoe UI, Roboto, Helvetica Neue, Arial, sans-serif\" font-size=\"{SMALL}\" class=\"drawing\" fill=\"#1c1c20\">\n\
         <rect class=\"paper\" width=\"{w}\" height=\"{h}\" fill=\"#ffffff\"/>\n",
            w = self.width,
            h = self.height
        );
        out += &format!("<title>{}</title>\n", escape(&self.title));
        out += &format!(
            "<text x=\"{:.1}\" y=\"18\" font-size=\"14\" font-weight=\"600\">{}</text>\n",
            plot.left,
            escape(&self.title)
        );
        out += &format!("<g transform=\"translate({:.1} 32)\">\n{legend}</g>\n", plot.left);
        out += &plot.axes();
        // Lines may leave the axes' ranges: they are cut, not drawn over the labels.
        out += &format!(
            "<svg x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" overflow=\"hidden\">\n",
            plot.left, plot.top, plot.width, plot.height
        );
        for (index, series) in self.series.iter().enumerate() {
            out += &plot.series(index, series);
        }
        out + "</svg>\n</svg>\n"
    }
}

/// Marks and names in rows, and how many rows.
fn legend(chart: &Chart) -> (String, usize) {
    let named: Vec<&Series> = chart.series.iter().filter(|series| !series.name.is_empty()).collect();
    let (mut out, mut x, mut row) = (String::new(), 0.0, 0usize);
    if named.len() < 2 && chart.series.len() < 2 {
        return (out, 0);
    }
    for series in named {
        let room = 34.0 + CHARACTER * series.name.chars().count() as f64;
        if x > 0.0 && x + room > chart.width - 90.0 {
            (x, row) = (0.0, row + 1);
        }
        let y = LEGEND_ROW * row as f64;
        let color = hex(series.color);
        out += &match series.mark {
            Mark::Line { dashed } => format!(
                "<line x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{y:.1}\" stroke=\"{color}\" stroke-width=\"2.2\"{}/>\n",
                x + 20.0,
                dashes(dashed)
            ),
            Mark::Dots => {
                format!("<circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"3.2\" fill=\"{color}\"/>\n", x + 10.0)
            }
            Mark::Bars => format!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"12\" height=\"10\" fill=\"{color}\"/>\n",
                x + 4.0,
                y - 5.0
            ),
            Mark::Band(_) | Mark::Intervals(_) => format!(
                "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"20\" height=\"10\" fill=\"{color}\" fill-opacity=\"0.25\"/>\n",
                y - 5.0
            ),
        };
        out += &format!("<text x=\"{:.1}\" y=\"{:.1}\">{}</text>\n", x + 25.0, y + 4.0, escape(&series.name));
        x += room;
    }
    (out, row + 1)
}

impl<'a> Plot<'a> {
    fn new(chart: &'a Chart, legend_rows: usize) -> Self {
        let all = |axis: usize| chart.series.iter().flat_map(move |s| s.points.iter().map(move |p| p[axis]));
        let bars = chart.series.iter().any(|series| series.mark == Mark::Bars);
        let x_ends = chart.x.ends(all(0));
        // Bars stand on zero.
        let y_ends = if bars && chart.y.scale == super::Scale::Linear {
            chart.y.ends(all(1).chain([0.0]))
        } else {
            chart.y.ends(all(1))
        };
        let longest = chart.y.ticks(y_ends, 6).iter().map(|(_, l)| l.chars().count()).max().unwrap_or(0);
        let left = 34.0 + CHARACTER * longest as f64;
        let top = 30.0 + LEGEND_ROW * legend_rows as f64;
        let width = (chart.width - left - 18.0).max(40.0);
        let bottom = if chart.x.label.is_empty() { 30.0 } else { 46.0 };
        let height = (chart.height - top - bottom).max(40.0);
        Self { chart, left, top, width, height, x_ends, y_ends }
    }

    /// Position inside the plot.
    fn at(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let along = self.chart.x.share(x, self.x_ends)?;
        let up = self.chart.y.share(y, self.y_ends)?;
        // Far outside is as good as a little outside, and keeps the numbers short.
        Some([(along.clamp(-2.0, 3.0)) * self.width, (1.0 - up.clamp(-2.0, 3.0)) * self.height])
    }

    fn axes(&self) -> String {
        let Self { left, top, width, height, .. } = *self;
        let (right, bottom) = (left + width, top + height);
        let mut out = String::from("<g class=\"rules\" stroke=\"#e3e3de\" stroke-width=\"1\">\n");
        let x_ticks = thin(self.chart.x.ticks(self.x_ends, 8), width);
        let y_ticks = self.chart.y.ticks(self.y_ends, 6);
        let place = |axis: &Axis, value: f64, ends| {
            axis.share(value, ends).filter(|s| (-1e-6..=1.000_001).contains(s))
        };
        let xs: Vec<(f64, &str)> = x_ticks
            .iter()
            .filter_map(|(v, l)| Some((left + place(&self.chart.x, *v, self.x_ends)? * width, l.as_str())))
            .collect();
        let ys: Vec<(f64, &str)> = y_ticks
            .iter()
            .filter_map(|(v, l)| Some((bottom - place(&self.chart.y, *v, self.y_ends)? * height, l.as_str())))
            .collect();
        for (x, _) in &xs {
            out +=
                &format!("<line x1=\"{x:.1}\" y1=\"{top:.1}\" x2=\"{x:.1}\" y2=\"{:.1}\"/>\n", bottom + 4.0);
        }
        for (y, _) in &ys {
            out +=
                &format!("<line x1=\"{:.1}\" y1=\"{y:.1}\" x2=\"{right:.1}\" y2=\"{y:.1}\"/>\n", left - 4.0);
        }
        out += &format!(
            "</g>\n<path d=\"M{left:.1} {top:.1}V{bottom:.1}H{right:.1}\" fill=\"none\" class=\"axis\" stroke=\"#55555d\"/>\n<g text-anchor=\"middle\">\n"
        );
        for (x, label) in &xs {
            out += &format!("<text x=\"{x:.1}\" y=\"{:.1}\">{}</text>\n", bottom + 17.0, escape(label));
        }
        out += &format!(
            "<text x=\"{:.1}\" y=\"{:.1}\">{}</text>\n",
            left + width / 2.0,
            bottom + 36.0,
            escape(&self.chart.x.label)
        );
        let middle = top + height / 2.0;
        out += &format!(
            "<text x=\"13\" y=\"{middle:.1}\" transform=\"rotate(-90 13 {middle:.1})\">{}</text>\n</g>\n<g text-anchor=\"end\">\n",
            escape(&self.chart.y.label)
        );
        for (y, label) in &ys {
            out += &format!("<text x=\"{:.1}\" y=\"{:.1}\">{}</text>\n", left - 7.0, y + 4.0, escape(label));
        }
        out + "</g>\n"
    }

    fn series(&self, index: usize, series: &Series) -> String {
        let color = hex(series.color);
        match &series.mark {
            Mark::Line { dashed } => format!(
                "<path d=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.8\" stroke-linejoin=\"round\"{}/>\n",
                self.path(&series.points),
                dashes(*dashed)
            ),
            Mark::Dots => {
                let dots = series
                    .points
                    .iter()
                    .filter_map(|p| self.at(*p))
                    .map(|[x, y]| format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.6\"/>\n"));
                format!("<g fill=\"{color}\" fill-opacity=\"0.75\">\n{}</g>\n", dots.collect::<String>())
            }
            Mark::Bars => self.bars(index, series),
            Mark::Intervals(intervals) => {
                let lines = intervals.iter().filter_map(|[x, low, high]| {
                    let ([x, bottom], [_, top]) = (self.at([*x, *low])?, self.at([*x, *high])?);
                    Some(format!("M{x:.1} {bottom:.1}V{top:.1}"))
                });
                format!(
                    "<path d=\"{}\" stroke=\"{color}\" stroke-width=\"1.2\"/>\n",
                    lines.collect::<String>()
                )
            }
            Mark::Band(band) => {
                let edge = |k: usize| band.iter().filter_map(move |b| self.at([b[0], b[k]]));
                let outline = edge(2).chain(edge(1).collect::<Vec<_>>().into_iter().rev());
                let points: Vec<String> = outline.map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
                format!("<polygon points=\"{}\" fill=\"{color}\" fill-opacity=\"0.2\"/>\n", points.join(" "))
            }
        }
    }

    fn path(&self, points: &[[f64; 2]]) -> String {
        let (mut out, mut pen_down) = (String::new(), false);
        for point in points {
            match self.at(*point) {
                Some([x, y]) => {
                    out += &format!("{}{x:.1} {y:.1}", if pen_down { "L" } else { "M" });
                    pen_down = true;
                }
                None => pen_down = false,
            }
        }
        out
    }

    fn bars(&self, index: usize, series: &Series) -> String {
        let groups: Vec<usize> =
            (0..self.chart.series.len()).filter(|k| self.chart.series[*k].mark == Mark::Bars).collect();
        let place = groups.iter().position(|k| *k == index).unwrap_or(0) as f64;
        let spacing = spacing(&series.points).min(self.x_ends[1] - self.x_ends[0]);
        let room = spacing / (self.x_ends[1] - self.x_ends[0]) * self.width * 0.8;
        let width = (room / groups.len() as f64).max(1.0);
        let floor = self.at([self.x_ends[0], 0.0]).map_or(self.height, |[_, y]| y).clamp(0.0, self.height);
        let bars = series.points.iter().filter_map(|p| self.at(*p)).map(|[x, y]| {
            let left = x - room / 2.0 + place * width;
            let (top, bottom) = (y.min(floor), y.max(floor));
            format!(
                "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{:.1}\"/>\n",
                bottom - top
            )
        });
        format!("<g fill=\"{}\">\n{}</g>\n", hex(series.color), bars.collect::<String>())
    }
}

/// Distance between neighbouring bars, in units of the axis.
fn spacing(points: &[[f64; 2]]) -> f64 {
    let mut places: Vec<f64> = points.iter().map(|p| p[0]).filter(|x| x.is_finite()).collect();
    places.sort_unstable_by(f64::total_cmp);
    let gaps = places.windows(2).map(|pair| pair[1] - pair[0]).filter(|gap| *gap > 0.0);
    let gap = gaps.fold(f64::INFINITY, f64::min);
    if gap.is_finite() { gap } else { 1.0 }
}

/// Labels that would run into each other are left out.
fn thin(ticks: Vec<(f64, String)>, width: f64) -> Vec<(f64, String)> {
    let longest = ticks.iter().map(|(_, label)| label.chars().count()).max().unwrap_or(0);
    let room = (width / (CHARACTER * (longest as f64 + 2.0))).max(1.0);
    let every = (ticks.len() as f64 / room).ceil().max(1.0) as usize;
    ticks.into_iter().step_by(every).collect()
}

fn dashes(dashed: bool) -> &'static str {
    if dashed { " stroke-dasharray=\"6 4\"" } else { "" }
}
