//! Two pictures side by side: where they show the same place, and lines between those on demand.

use super::{Picture, image, open_svg};
use crate::color::{Rgb, hex};
use crate::escape::escape;

/// A line from the left picture to the right one, in the pixels of each (measured from the corner).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// End in the left picture.
    pub left: [f64; 2],
    /// End in the right picture.
    pub right: [f64; 2],
    /// Colour.
    pub color: Rgb,
}

/// Two pictures side by side, `height` CSS pixels high, a title above each, points at the ends of the lines, and the lines in a
/// group of the class `lines`.
pub fn side_by_side(
    left: &Picture,
    right: &Picture,
    titles: [&str; 2],
    lines: &[Line],
    height: f64,
) -> String {
    const GAP: f64 = 12.0;
    const TOP: f64 = 20.0;
    let scale = [left, right].map(|picture| height / picture.height.max(1) as f64);
    let width = [left.width as f64 * scale[0], right.width as f64 * scale[1]];
    let offset = [0.0, width[0] + GAP];
    let mut out = open_svg(offset[1] + width[1], TOP + height);
    for (k, picture) in [left, right].into_iter().enumerate() {
        out += &format!("<text x=\"{:.1}\" y=\"13\">{}</text>\n", offset[k], escape(titles[k]));
        out += &image(picture, offset[k], TOP, width[k], height);
    }
    let (mut between, mut points) = (String::new(), String::new());
    for line in lines {
        let [x1, y1] = line.left.map(|v| v * scale[0]);
        let [x2, y2] = line.right.map(|v| v * scale[1]);
        if [x1, y1, x2, y2].iter().all(|v| v.is_finite()) {
            let (y1, x2, y2, color) = (y1 + TOP, x2 + offset[1], y2 + TOP, hex(line.color));
            between += &format!("<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{color}\"/>\n");
            for (x, y) in [(x1, y1), (x2, y2)] {
                points += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.2\" fill=\"{color}\"/>\n");
            }
        }
    }
    out + &format!(
        "<g class=\"lines\" stroke-width=\"0.9\" stroke-opacity=\"0.75\">\n{between}</g>\n\
         <g stroke=\"#ffffff\" stroke-width=\"0.5\">\n{points}</g>\n</svg>\n"
    )
}
