//! A picture with a title, a colour bar and lines drawn over it.

use super::{Picture, image, open_svg};
use crate::Error;
use crate::chart::Axis;
use crate::color::{Rgb, hex};
use crate::escape::escape;
use selenograph_raster::Raster;
use selenograph_raster::colormap::Colormap;

/// What the colours of a picture mean.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorBar {
    /// The colour map.
    pub map: Colormap,
    /// Value of its first colour.
    pub low: f64,
    /// Value of its last colour.
    pub high: f64,
    /// What it counts, with the unit.
    pub label: String,
}

/// A picture and what is drawn round it.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    picture: Picture,
    title: String,
    bar: Option<ColorBar>,
    keys: Vec<(Rgb, String)>,
    lines: Vec<([f64; 2], [f64; 2], Rgb)>,
    scale: Option<(f64, String)>,
    north_rad: Option<f64>,
    width: f64,
}

const TOP: f64 = 20.0;
/// Room for a colour bar and its label.
pub(super) const BESIDE: f64 = 84.0;

impl Panel {
    /// A picture with a title, 380 CSS pixels wide.
    pub fn new(picture: Picture, title: impl Into<String>) -> Self {
        Self {
            picture,
            title: title.into(),
            bar: None,
            keys: Vec::new(),
            lines: Vec::new(),
            scale: None,
            north_rad: None,
            width: 380.0,
        }
    }

    /// A map of values in colours, with its bar.
    ///
    /// # Errors
    /// [`Error::Picture`] for an empty map.
    pub fn of_values(values: &Raster<f32>, title: impl Into<String>, bar: ColorBar) -> Result<Self, Error> {
        let picture = Picture::exact(&bar.map.paint(values, bar.low, bar.high))?;
        Ok(Self { bar: Some(bar), ..Self::new(picture, title) })
    }

    /// Another width of the picture, CSS pixels.
    pub fn width(mut self, width: f64) -> Self {
        self.width = width;
        self
    }

    /// With a scale bar: length of the picture's width in `unit`.
    pub fn scale_bar(mut self, length: f64, unit: impl Into<String>) -> Self {
        self.scale = Some((length, unit.into()));
        self
    }

    /// With an arrow to the north, radians clockwise from up.
    pub fn north(mut self, clockwise_rad: Option<f64>) -> Self {
        self.north_rad = clockwise_rad;
        self
    }

    /// What single colours mean, below the picture.
    pub fn key(mut self, color: Rgb, meaning: impl Into<String>) -> Self {
        self.keys.push((color, meaning.into()));
        self
    }

    /// A line over the picture, in its pixels.
    pub fn line(mut self, from: [f64; 2], to: [f64; 2], color: Rgb) -> Self {
        self.lines.push((from, to, color));
        self
    }

    /// The drawing.
    pub fn svg(&self) -> String {
        let scale = self.width / self.picture.width.max(1) as f64;
        let height = self.picture.height as f64 * scale;
        let beside = if self.bar.is_some() { BESIDE } else { 0.0 };
        let below = if self.keys.is_empty() { 0.0 } else { 17.0 * self.keys.len() as f64 + 4.0 };
        let mut out = open_svg(self.width + beside, TOP + height + below);
        out += &format!("<text x=\"0\" y=\"13\" font-weight=\"600\">{}</text>\n", escape(&self.title));
        out += &image(&self.picture, 0.0, TOP, self.width, height);
        for (from, to, color) in &self.lines {
            let [x1, y1, x2, y2] = [from[0], from[1], to[0], to[1]].map(|v| v * scale);
            out += &format!(
                "<line x1=\"{x1:.1}\" y1=\"{:.1}\" x2=\"{x2:.1}\" y2=\"{:.1}\" stroke=\"{}\" stroke-width=\"1.5\"/>\n",
                y1 + TOP,
                y2 + TOP,
                hex(*color)
            );
        }
        out += &self.map_marks(height);
        if let Some(bar) = &self.bar {
            out += &bar.svg(self.width + 10.0, TOP, height);
        }
        for (k, (color, meaning)) in self.keys.iter().enumerate() {
            let y = TOP + height + 6.0 + 17.0 * k as f64;
            out += &format!(
                "<rect x=\"0\" y=\"{y:.1}\" width=\"14\" height=\"11\" fill=\"{}\"/><text x=\"20\" y=\"{:.1}\">{}</text>\n",
                hex(*color),
                y + 9.5,
                escape(meaning)
            );
        }
        out + "</svg>\n"
    }
}

impl Panel {
    /// Scale bar at the lower left, arrow at the upper right: white with a dark rim, to be seen on any map.
    fn map_marks(&self, height: f64) -> String {
        let mut out = String::from(
            "<g fill=\"#ffffff\" stroke=\"#000000\" stroke-width=\"2.5\" paint-order=\"stroke\" font-weight=\"600\">\n",
        );
        if let Some((length, unit)) = self.scale.as_ref().filter(|(length, _)| *length > 0.0) {
            let round = round_below(0.3 * length);
            let (bar, y) = (round / length * self.width, TOP + height - 12.0);
            out += &format!(
                "<rect x=\"10\" y=\"{y:.1}\" width=\"{bar:.1}\" height=\"4\"/><text x=\"10\" y=\"{:.1}\">{}</text>\n",
                y - 5.0,
                escape(&length_words(round, unit))
            );
        }
        if let Some(angle) = self.north_rad {
            let (x, y) = (self.width - 22.0, TOP + 24.0);
            out += &format!(
                "<g transform=\"translate({x:.1} {y:.1})\"><path transform=\"rotate({:.1})\" d=\"M0 -15L6 9L0 4L-6 9Z\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">N</text></g>\n",
                angle.to_degrees(),
                -20.0 * angle.sin(),
                20.0 * angle.cos() + 4.0
            );
        }
        out + "</g>\n"
    }
}

/// The largest of 1, 2 and 5 times a power of ten that is not above a length.
fn round_below(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    [5.0, 2.0].map(|m| m * power).into_iter().find(|round| *round <= length).unwrap_or(power)
}

/// Kilometres from a thousand metres on.
fn length_words(length: f64, unit: &str) -> String {
    let (length, unit) =
        if unit == "m" && length >= 1000.0 { (length / 1000.0, "km") } else { (length, unit) };
    format!("{} {unit}", crate::number::significant(length, 1))
}

impl ColorBar {
    /// The bar with its ticks, `height` high.
    pub(super) fn svg(&self, x: f64, y: f64, height: f64) -> String {
        const STEPS: usize = 48;
        let mut out = String::new();
        let step = height / STEPS as f64;
        for k in 0..STEPS {
            let color = self.map.color(1.0 - (k as f64 + 0.5) / STEPS as f64);
            out += &format!(
                "<rect x=\"{x:.1}\" y=\"{:.2}\" width=\"13\" height=\"{:.2}\" fill=\"{}\"/>\n",
                y + k as f64 * step,
                step + 0.5,
                hex(color)
            );
        }
        let axis = Axis::new("").between(self.low, self.high);
        let ends = axis.ends(std::iter::empty());
        for (value, label) in axis.ticks(ends, 5) {
            if let Some(share) = axis.share(value, ends).filter(|share| (0.0..=1.0).contains(share)) {
                let at = y + (1.0 - share) * height;
                out += &format!(
                    "<path d=\"M{:.1} {at:.1}h4\" class=\"axis\" stroke=\"#55555d\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>\n",
                    x + 13.0,
                    x + 19.0,
                    (at + 4.0).clamp(y + 8.0, y + height),
                    escape(&label)
                );
            }
        }
        let middle = y + height / 2.0;
        out + &format!(
            "<text x=\"{0:.1}\" y=\"{middle:.1}\" text-anchor=\"middle\" transform=\"rotate(-90 {0:.1} {middle:.1})\">{1}</text>\n",
            x + 70.0,
            escape(&self.label)
        )
    }
}
