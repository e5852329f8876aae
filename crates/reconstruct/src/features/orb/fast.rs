//! FAST-9 corners, ranked by Harris' measure.

use rayon::prelude::*;
use selenograph_raster::Raster;

/// The circle of 16 samples, in order.
const CIRCLE: [(i32, i32); 16] = [
    (0, -3),
    (1, -3),
    (2, -2),
    (3, -1),
    (3, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 3),
    (-1, 3),
    (-2, 2),
    (-3, 1),
    (-3, 0),
    (-3, -1),
    (-2, -2),
    (-1, -3),
];

/// Neighbours in a row that must agree.
const ARC: usize = 9;

/// Rows of one piece of work.
const STRIP_ROWS: usize = 32;

/// Harris' measure is `det − k · trace²`.
const HARRIS_K: f32 = 0.04;

/// Radius of the window of Harris' measure.
const HARRIS_RADIUS: usize = 3;

/// A corner of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corner {
    pub x: usize,
    pub y: usize,
    pub response: f32,
}

/// Corners at least `rim` samples from the border (which must be 5 or more), each the strongest of its 3 × 3 neighbours.
pub(super) fn corners(image: &Raster<f32>, threshold: f32, rim: usize) -> Vec<Corner> {
    if image.width <= 2 * rim || image.height <= 2 * rim {
        return Vec::new();
    }
    let mut strength =
        Raster { width: image.width, height: image.height, data: vec![0.0f32; image.data.len()] };
    let offsets = CIRCLE.map(|(dx, dy)| dy as isize * image.width as isize + dx as isize);
    strength.data.par_chunks_mut(image.width * STRIP_ROWS).enumerate().for_each(|(strip_idx, strip)| {
        for (i, row) in strip.chunks_exact_mut(image.width).enumerate() {
            let y = strip_idx * STRIP_ROWS + i;
            if y + 1 < rim || y > image.height - rim {
                continue;
            }
            for (x, strength) in row.iter_mut().enumerate().take(image.width - rim + 1).skip(rim - 1) {
                *strength = score(image, y * image.width + x, &offsets, threshold);
            }
        }
    });
    let rows: Vec<Vec<Corner>> = (rim..image.height - rim)
        .into_par_iter()
        .map(|y| {
            (rim..image.width - rim)
                .filter(|&x| is_strongest(&strength, x, y))
                .map(|x| Corner { x, y, response: harris(image, x, y) })
                .collect()
        })
        .collect();
    rows.into_iter().flatten().collect()
}

/// The largest threshold at which the sample is a corner; 0 if that is below `threshold`.
fn score(image: &Raster<f32>, at: usize, offsets: &[isize; 16], threshold: f32) -> f32 {
    let centre = image.data[at];
    let sample = |i: usize| image.data[at.wrapping_add_signed(offsets[i])];
    // Nine in a row hold two opposite ones of these four pairs' ends.
    let ends = [0, 4, 8, 12].map(sample);
    let brighter = ends.iter().filter(|&&v| v > centre + threshold).count();
    let darker = ends.iter().filter(|&&v| v < centre - threshold).count();
    if brighter < 2 && darker < 2 {
        return 0.0;
    }
    let ring: [f32; 16] = std::array::from_fn(|i| sample(i) - centre);
    let mut best = 0.0f32;
    for start in 0..16 {
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for i in 0..ARC {
            let v = ring[(start + i) % 16];
            low = low.min(v);
            high = high.max(v);
        }
        best = best.max(low).max(-high);
    }
    if best > threshold { best } else { 0.0 }
}

fn is_strongest(strength: &Raster<f32>, x: usize, y: usize) -> bool {
    let v = strength[(x, y)];
    // Of equal neighbours the first counts.
    v > 0.0
        && (y - 1..=y + 1).all(|j| {
            (x - 1..=x + 1).all(|i| {
                let other = strength[(i, j)];
                (i, j) == (x, y) || v > other || (v == other && (j, i) > (y, x))
            })
        })
}

fn harris(image: &Raster<f32>, x: usize, y: usize) -> f32 {
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    let at = |x: usize, y: usize| image.data[y * image.width + x];
    for y in y - HARRIS_RADIUS..=y + HARRIS_RADIUS {
        for x in x - HARRIS_RADIUS..=x + HARRIS_RADIUS {
            let column = |x: usize| at(x, y - 1) + 2.0 * at(x, y) + at(x, y + 1);
            let row = |y: usize| at(x - 1, y) + 2.0 * at(x, y) + at(x + 1, y);
            let (dx, dy) = (column(x + 1) - column(x - 1), row(y + 1) - row(y - 1));
            xx += dx * dx;
            yy += dy * dy;
            xy += dx * dy;
        }
    }
    xx * yy - xy * xy - HARRIS_K * (xx + yy) * (xx + yy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corner_of_a_square_is_found_and_its_sides_are_not() {
        let image = Raster::from_fn(60, 60, |x, y| if x >= 30 && y >= 30 { 200.0 } else { 10.0 });
        let found = corners(&image, 20.0, 10);
        assert!(!found.is_empty());
        assert!(found.iter().all(|c| c.x.abs_diff(30) <= 2 && c.y.abs_diff(30) <= 2), "{found:?}");
    }
}
