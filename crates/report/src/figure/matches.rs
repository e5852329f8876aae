//! Two pictures side by side with lines between them.

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

/// Two pictures side by side, `height` CSS pixels high, with lines between them and a title above each.
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
    for line in lines {
        let [x1, y1] = line.left.map(|v| v * scale[0]);
        let [x2, y2] = line.right.map(|v| v * scale[1]);
        if [x1, y1, x2, y2].iter().all(|v| v.is_finite()) {
            let (y1, x2, y2, color) = (y1 + TOP, x2 + offset[1], y2 + TOP, hex(line.color));
            out += &format!(
                "<path d=\"M{x1:.1} {y1:.1}L{x2:.1} {y2:.1}\" stroke=\"{color}\" stroke-width=\"0.9\" stroke-opacity=\"0.75\"/>\
                 <circle cx=\"{x1:.1}\" cy=\"{y1:.1}\" r=\"1.8\" fill=\"{color}\"/><circle cx=\"{x2:.1}\" cy=\"{y2:.1}\" r=\"1.8\" fill=\"{color}\"/>\n"
            );
        }
    }
    out + "</svg>\n"
}
