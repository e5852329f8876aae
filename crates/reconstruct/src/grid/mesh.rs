//! A pointmap as a surface: which neighbouring pixels lie on the same piece of ground.
//!
//! Neighbours are joined unless an occlusion lies between them. What tells is the angle between their join and the
//! ray: `t = |along the ray| / |across it|`, the tangent of the emission angle. Ground seen at a grazing angle has a large t
//! too, but changes it slowly; an occluding edge is one large t between small ones.

use super::lift::LiftedView;
use rayon::prelude::*;

/// Steeper than this against the ray's perpendicular (87°), neighbours are never joined: such ground is not seen.
const MAX_TANGENT: f32 = 19.0;
/// Below this (76°) they always are: a step of under four pixels' width is relief.
const MIN_TANGENT: f32 = 4.0;
/// Between the two, an edge is a jump if its tangent is so many times those of the edges before and after it.
const JUMP_RATIO: f32 = 3.0;

/// The pixel is joined with its neighbour to the right.
pub const RIGHT: u8 = 1;
/// The pixel is joined with its neighbour below.
pub const DOWN: u8 = 2;

/// Which neighbours of each pixel lie on its piece of ground, as bits [`RIGHT`] and [`DOWN`], row after row; `None` for a
/// view whose camera centre is not known.
pub fn joins(view: &LiftedView) -> Option<Vec<u8>> {
    let center = view.center?;
    let (width, height) = (view.points.width, view.points.height);
    let points = &view.points.data;
    let mut across = vec![f32::NAN; width * height];
    let mut down = vec![f32::NAN; width * height];
    across.par_chunks_mut(width.max(1)).zip(down.par_chunks_mut(width.max(1))).enumerate().for_each(
        |(y, (across, down))| {
            let here = &points[y * width..(y + 1) * width];
            for x in 0..width.saturating_sub(1) {
                across[x] = tangent(&here[x], &here[x + 1], &center);
            }
            if y + 1 < height {
                let below = &points[(y + 1) * width..(y + 2) * width];
                for x in 0..width {
                    down[x] = tangent(&here[x], &below[x], &center);
                }
            }
        },
    );
    let mut joined = vec![0u8; width * height];
    joined.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, joined)| {
        let row = y * width;
        for (x, bits) in joined.iter_mut().enumerate() {
            let i = row + x;
            let before = if x > 0 { across[i - 1] } else { f32::NAN };
            let after = if x + 1 < width { across[i + 1] } else { f32::NAN };
            let above = if y > 0 { down[i - width] } else { f32::NAN };
            let below = if y + 1 < height { down[i + width] } else { f32::NAN };
            *bits = if is_joined(across[i], before, after) { RIGHT } else { 0 }
                | if is_joined(down[i], above, below) { DOWN } else { 0 };
        }
    });
    Some(joined)
}

/// Tangent of the angle between the join of two points and the perpendicular of the ray to their middle.
#[inline]
fn tangent(p: &[f32; 3], q: &[f32; 3], center: &[f32; 3]) -> f32 {
    let d = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
    let r =
        [0.5 * (p[0] + q[0]) - center[0], 0.5 * (p[1] + q[1]) - center[1], 0.5 * (p[2] + q[2]) - center[2]];
    let dot = d[0] * r[0] + d[1] * r[1] + d[2] * r[2];
    let along2 = dot * dot / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
    let across2 = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - along2).max(f32::MIN_POSITIVE);
    (along2 / across2).sqrt()
}

#[inline]
fn is_joined(tangent: f32, before: f32, after: f32) -> bool {
    // Absent points give NaN, which is not below anything.
    if tangent < MIN_TANGENT {
        return true;
    }
    // `max` leaves the NaN of an absent neighbour out.
    tangent < MAX_TANGENT && tangent < JUMP_RATIO * before.max(after)
}
