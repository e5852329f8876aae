//! What one view of a pair sees of the other: where each pixel's ground lies in the other picture, and whether it is seen
//! there or hidden.
//!
//! Occlusion is decided by casting the other camera's ray at the very point: no depth maps are compared, so nothing
//! depends on their resolution.

use crate::pair::OverlapRecord;
use crate::plan::coverage::in_frame;
use rayon::prelude::*;
use selenograph_geometry::{Point2, Point3};
use selenograph_render::{Hit, Tracer, Truth, Viewpoint};

/// A ray that stops this far before the point is taken to have reached it, metres: far above the rounding of positions at
/// the Moon's radius (1e-9 m), even where it is stretched by a grazing view, and far below any relief.
const REACHED_M: f64 = 1e-3;

/// Where a pixel's ground is in the other view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sight {
    /// The pixel sees no ground.
    Absent,
    /// Its ground is outside the other picture.
    Outside,
    /// Inside the frame, but other ground is before it.
    Hidden(Point2<f64>),
    /// Seen at this pixel of the other view.
    Seen(Point2<f64>),
}

/// Where a point lies in a view.
pub fn sight(tracer: &Tracer<'_>, point: &Point3<f64>, view: &Viewpoint) -> Sight {
    let at = match view.project(point) {
        Some(at) if in_frame(&view.camera, Some(at)) => at,
        _ => return Sight::Outside,
    };
    let ray = point - view.origin();
    let range = ray.norm();
    // Beyond the point nothing matters.
    match tracer.first_hit(view.origin(), ray / range, 0.0, range + REACHED_M) {
        Hit::Surface(hit) if hit.t < range - REACHED_M => Sight::Hidden(at),
        _ => Sight::Seen(at),
    }
}

/// For every pixel of a view, where its ground is in the other view. Rows first; `stride` > 1 takes one pixel of so many along
/// each axis.
pub fn correspondence(
    tracer: &Tracer<'_>,
    from: &Viewpoint,
    truth: &Truth,
    other: &Viewpoint,
    stride: usize,
) -> Vec<Sight> {
    let stride = stride.max(1);
    let (cols, rows) = (truth.width.div_ceil(stride), truth.height.div_ceil(stride));
    (0..cols * rows)
        .into_par_iter()
        .map(|n| match truth.point(from, n % cols * stride, n / cols * stride) {
            Some(point) => sight(tracer, &point, other),
            None => Sight::Absent,
        })
        .collect()
}

/// Shares of all pixels: in the other frame, and seen there.
pub fn shares(sights: &[Sight]) -> (f64, f64) {
    let count = |wanted: fn(&Sight) -> bool| sights.iter().filter(|s| wanted(s)).count() as f64;
    let all = sights.len().max(1) as f64;
    let seen = count(|s| matches!(s, Sight::Seen(_)));
    ((seen + count(|s| matches!(s, Sight::Hidden(_)))) / all, seen / all)
}

/// The overlap of a pair both ways.
pub fn overlap(a_in_b: &[Sight], b_in_a: &[Sight]) -> OverlapRecord {
    let ((a_in_b, a_seen_by_b), (b_in_a, b_seen_by_a)) = (shares(a_in_b), shares(b_in_a));
    OverlapRecord { a_in_b, b_in_a, a_seen_by_b, b_seen_by_a }
}

/// The pixel maps of a full correspondence: columns and rows in the other view from its corner (NaN outside its frame), and
/// 1 where the ground is seen there.
pub fn pixel_maps(sights: &[Sight]) -> [Vec<f32>; 3] {
    let at = |pick: fn(&Point2<f64>) -> f64| {
        sights
            .iter()
            .map(|s| match s {
                Sight::Seen(p) | Sight::Hidden(p) => pick(p) as f32,
                Sight::Absent | Sight::Outside => f32::NAN,
            })
            .collect()
    };
    let seen = sights.iter().map(|s| f32::from(u8::from(matches!(s, Sight::Seen(_))))).collect();
    [at(|p| p.x), at(|p| p.y), seen]
}

#[cfg(test)]
pub(crate) mod tests;
