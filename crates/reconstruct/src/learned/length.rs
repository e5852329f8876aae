//! The length of a translation in a pointmap's unit.

use super::arrays::Pointmap;
use crate::evidence::Warning;
use crate::relative_pose::JudgedMatch;
use selenograph_geometry::{CamA, CamB, Camera, Point2, Rigid3, pixel, robust::MAD_TO_SIGMA};
use selenograph_pose::decompose::Motion;
use selenograph_pose::triangulate;

/// A spread of the ratios above this is said.
const LARGEST_SPREAD: f64 = 0.1;

/// How large a pointmap is beside the points in which the matches' rays meet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    /// Length in the pointmap's unit over length in the pose's unit.
    pub ratio: f64,
    /// Spread of the single ratios, as a share of it.
    pub spread: f64,
}

impl Measured {
    pub fn warning(&self) -> Option<Warning> {
        (self.spread > LARGEST_SPREAD).then_some(Warning::PointsDisagree { spread: self.spread })
    }
}

/// Ratio of the pointmaps' ranges to those of the triangulated matches, by its weighted median; `None` without a match that
/// agrees.
///
/// The inverse range of a triangulated point is linear in the noise of the match, so that the median has no bias; its weight is the
/// sine of the parallax, which is what the noise is divided by, times the point's confidence.
pub(super) fn measure(
    maps: &[Pointmap; 2],
    cam_b_from_cam_a: &Rigid3<CamB, CamA>,
    cameras: [&Camera; 2],
    matches: &[JudgedMatch],
) -> Option<Measured> {
    let motion =
        Motion { rotation: cam_b_from_cam_a.rotation(), translation: cam_b_from_cam_a.origin().coords };
    let mut ratios = Vec::new();
    for m in matches.iter().filter(|m| m.inlier) {
        let (Some(ray_a), Some(ray_b)) = (cameras[0].ray_z1(&m.a), cameras[1].ray_z1(&m.b)) else { continue };
        let Some(met) = triangulate::optimal(&motion, &ray_a, &ray_b) else { continue };
        for (map, at) in maps.iter().zip([&m.a, &m.b]) {
            let Some((range, confidence)) = range_at(map, at) else { continue };
            let weight = met.parallax_rad.sin() * f64::from(confidence);
            let ratio = range / met.x_in_a.coords.norm();
            if ratio.is_finite() && ratio > 0.0 && weight > 0.0 {
                ratios.push((ratio, weight));
            }
        }
    }
    let ratio = weighted_median(&mut ratios)?;
    let mut off: Vec<(f64, f64)> =
        ratios.iter().map(|(r, weight)| ((r / ratio - 1.0).abs(), *weight)).collect();
    Some(Measured { ratio, spread: MAD_TO_SIGMA * weighted_median(&mut off)? })
}

/// Distance from camera A of the point at a pixel, and its confidence.
fn range_at(map: &Pointmap, at: &Point2<f64>) -> Option<(f64, f32)> {
    let x = usize::try_from(pixel::index_of(at.x)).ok()?;
    let y = usize::try_from(pixel::index_of(at.y)).ok()?;
    let [px, py, pz] = map.points.get(x, y)?.map(f64::from);
    Some(((px * px + py * py + pz * pz).sqrt(), *map.confidence.get(x, y)?))
}

/// The value with half of the weight on either side.
fn weighted_median(values: &mut [(f64, f64)]) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    values
        .iter()
        .find(|(_, weight)| {
            sum += weight;
            sum >= half
        })
        .map(|(value, _)| *value)
}
