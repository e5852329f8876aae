//! A cloud of points to turn and to come close to, drawn by a short script of our own (it needs no WebGL).

use crate::base64;
use crate::escape::escape;

pub(crate) const SCRIPT: &str = include_str!("viewer.js");

/// More than this is slow on a phone and makes pages of many megabytes.
const MAX_POINTS: usize = 100_000;
/// Places per axis: 16 bits.
const STEPS: f64 = 65_535.0;

/// A point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Where it is, in any right-handed frame.
    pub position: [f32; 3],
    /// How bright the picture is there.
    pub grey: u8,
    /// 1 or 2: which view it belongs to (orange or blue).
    pub view: u8,
}

/// Points, thinned and packed.
#[derive(Debug, Clone, PartialEq)]
pub struct PointView {
    packed: Vec<u8>,
    num_shown: usize,
    num_all: usize,
    /// Half the side of the cube that is shown.
    half: f64,
    /// Height of its middle.
    middle: f64,
    unit: String,
    axes: [String; 3],
}

impl PointView {
    /// Points in a frame whose up is `up`. Absent (not finite) points are left out; of more than 100 000 a fixed
    /// part is shown.
    pub fn new(points: &[Point], up: [f64; 3]) -> Self {
        let finite = |point: &&Point| point.position.iter().all(|v| v.is_finite());
        let num_all = points.iter().filter(finite).count();
        let keep = MAX_POINTS as f64 / num_all.max(1) as f64;
        let axes = axes(up);
        let shown: Vec<([f64; 3], &Point)> = points
            .iter()
            .filter(finite)
            .enumerate()
            .filter(|(index, _)| scattered(*index) < keep)
            .map(|(_, point)| {
                let p = point.position.map(f64::from);
                (axes.map(|axis| axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]), point)
            })
            .collect();
        let (centre, half) = cube(shown.iter().map(|(p, _)| *p));
        let mut packed = Vec::with_capacity(8 * shown.len());
        for (position, point) in &shown {
            for k in 0..3 {
                let share = ((position[k] - centre[k]) / half * 0.5 + 0.5).clamp(0.0, 1.0);
                packed.extend_from_slice(&((share * STEPS).round() as u16).to_le_bytes());
            }
            packed.extend_from_slice(&[point.grey, point.view]);
        }
        let axes = ["x", "y", "height"].map(str::to_owned);
        Self { packed, num_shown: shown.len(), num_all, half, middle: centre[2], unit: String::new(), axes }
    }

    /// The unit of lengths, the height of the points' zero, and the names of the axes, for scale and keys.
    pub fn described(mut self, unit: &str, zero_height: f64, axes: [&str; 3]) -> Self {
        self.unit = unit.to_owned();
        self.middle += zero_height;
        self.axes = axes.map(str::to_owned);
        self
    }

    pub(crate) fn html(&self, number: usize, caption: &str) -> String {
        let count = if self.num_shown < self.num_all {
            format!("{} of {} points", self.num_shown, self.num_all)
        } else {
            format!("{} points", self.num_all)
        };
        format!(
            "<figure class=\"points\">\n\
             <canvas id=\"points-{number}\" width=\"900\" height=\"520\" data-half=\"{}\" data-middle=\"{}\" data-unit=\"{}\" data-axes=\"{}\" data-points=\"{}\"></canvas>\n\
             <div class=\"controls\" data-for=\"points-{number}\"></div>\n\
             <figcaption>{} ({count}). Drag to turn, wheel to come closer, drag with shift to move, double-click to start again.</figcaption>\n\
             </figure>\n",
            self.half,
            self.middle,
            escape(&self.unit),
            escape(&self.axes.join(",")),
            base64::encode(&self.packed),
            escape(caption)
        )
    }
}

/// Right, forward and up, orthonormal.
fn axes(up: [f64; 3]) -> [[f64; 3]; 3] {
    let normalised = |v: [f64; 3]| {
        let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
        if length > 0.0 && length.is_finite() { v.map(|c| c / length) } else { [0.0, 0.0, 1.0] }
    };
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let up = normalised(up);
    // The frame's x as far as it is level; of a frame whose x is up, its y.
    let seed = if up[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let forward = normalised(cross(up, seed));
    [cross(forward, up), forward, up]
}

/// Centre and half side of a cube that holds all but the outermost points.
fn cube(points: impl Iterator<Item = [f64; 3]> + Clone) -> ([f64; 3], f64) {
    let mut ends = [[0.0, 1.0]; 3];
    for (k, ends) in ends.iter_mut().enumerate() {
        let along = points.clone().map(|p| p[k]);
        if let Some(found) = selenograph_raster::statistics::quantiles(along, [0.002, 0.998]) {
            *ends = found;
        }
    }
    let half = ends.iter().map(|[low, high]| 0.5 * (high - low)).fold(0.0, f64::max);
    (ends.map(|[low, high]| 0.5 * (low + high)), if half > 0.0 { half * 1.05 } else { 1.0 })
}

/// A number in `[0, 1)` that spreads evenly over indices without lining up with rows (splitmix64's finaliser).
fn scattered(index: usize) -> f64 {
    let mut bits = (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(position: [f32; 3], view: u8) -> Point {
        Point { position, grey: 128, view }
    }

    #[test]
    fn eight_bytes_a_point_within_the_cube() {
        let points = [point([0.0, 0.0, 10.0], 1), point([4.0, 2.0, 12.0], 2), point([f32::NAN, 0.0, 0.0], 1)];
        let view = PointView::new(&points, [0.0, 0.0, 1.0]);
        assert_eq!((view.num_shown, view.num_all, view.packed.len()), (2, 2, 16));
        let number = |at: usize| u16::from_le_bytes([view.packed[at], view.packed[at + 1]]);
        // Up is the third axis; the longest side fills the cube but for its margin.
        assert!(number(0) < number(8) && number(4) < number(12));
        assert!(number(0) > 500 && number(8) < 65_035);
        assert_eq!(view.packed[6..8], [128, 1]);
        let html = view.described("m", 100.0, ["east", "north", "height"]).html(1, "c");
        // Heights 10 and 12 over a zero of 100: the middle is at 111.
        assert!(html.contains("data-unit=\"m\" data-axes=\"east,north,height\""), "{html}");
        let middle = html.split("data-middle=\"").nth(1).unwrap().split('"').next().unwrap();
        assert!((middle.parse::<f64>().unwrap() - 111.0).abs() < 0.1, "{middle}");
    }

    #[test]
    fn large_clouds_are_thinned_evenly_and_the_same_every_time() {
        let points: Vec<Point> = (0..400_000)
            .map(|k| point([(k % 640) as f32, (k / 640) as f32, 0.0], 1 + u8::from(k % 2 == 0)))
            .collect();
        let view = PointView::new(&points, [0.0, 0.0, -1.0]);
        assert!(view.num_shown.abs_diff(MAX_POINTS) < 2000, "{}", view.num_shown);
        assert_eq!(view, PointView::new(&points, [0.0, 0.0, -1.0]));
        assert!(view.html(1, "c").contains(&format!("{} of 400000 points", view.num_shown)));
    }

    #[test]
    fn no_points_are_no_trouble() {
        assert!(PointView::new(&[], [0.0; 3]).html(1, "").contains("0 points"));
        let axes = axes([1.0, 0.0, 0.0]);
        assert_eq!(axes[2], [1.0, 0.0, 0.0]);
    }
}
