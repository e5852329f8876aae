//! How much a pixel of a view counts beside the other view: less towards the border of what was measured.
//!
//! Two views disagree a little about the same ground. Where the surface of one ends at full weight, the fused heights would have a
//! step along its border, which slopes and hillshades show as a wall. Where a view is alone, nothing changes.

use super::lift::LiftedView;
use crate::prediction::Fill;

/// Pixels from the border at which a view has its full weight: as wide as what windows of matching bend at the edge of a picture.
const REACH: u16 = 16;

/// The least weight: that of the border.
pub const LEAST: f64 = 1.0 / REACH as f64;

/// For each pixel, rows first: in (0, 1], rising with the distance (of a king's moves) from what was not measured and from the
/// picture's edge.
pub fn weights(view: &LiftedView) -> Vec<f32> {
    let (width, height) = (view.points.width, view.points.height);
    let measured = |i: usize| view.fill.data[i] == Fill::Measured && !view.points.data[i][0].is_nan();
    let steps = steps_inside(width, height, measured, REACH);
    // What was not measured has no border of its own: it counts as little as a border, wherever it counts.
    steps.into_iter().map(|steps| f32::from(steps.max(1)) / f32::from(REACH)).collect()
}

/// For each of `width × height` samples, rows first, the distance (of a king's moves) from the next one that is not inside, or from
/// beyond the edge: 0 where it is not inside itself, `reach` at most.
pub fn steps_inside(width: usize, height: usize, inside: impl Fn(usize) -> bool, reach: u16) -> Vec<u16> {
    let mut steps: Vec<u16> = (0..width * height).map(|i| if inside(i) { reach } else { 0 }).collect();
    // Once downwards with the neighbours above and left, once upwards with the others.
    let relax = |steps: &mut Vec<u16>, x: usize, y: usize, near: [(isize, isize); 4]| {
        let at = |dx: isize, dy: isize| {
            let x = x.checked_add_signed(dx).filter(|x| *x < width)?;
            let y = y.checked_add_signed(dy).filter(|y| *y < height)?;
            Some(steps[y * width + x])
        };
        let nearest = near.map(|(dx, dy)| at(dx, dy).unwrap_or(0)).into_iter().min().unwrap_or(0);
        let own = &mut steps[y * width + x];
        *own = (*own).min(nearest + 1);
    };
    for y in 0..height {
        for x in 0..width {
            relax(&mut steps, x, y, [(-1, 0), (-1, -1), (0, -1), (1, -1)]);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            relax(&mut steps, x, y, [(1, 0), (1, 1), (0, 1), (-1, 1)]);
        }
    }
    steps
}
