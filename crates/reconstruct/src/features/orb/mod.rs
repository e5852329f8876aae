//! Oriented FAST corners with rotated binary descriptors: the baseline of the paper.
//!
//! # Source
//! Rublee et al. 2011, "ORB: an efficient alternative to SIFT or SURF", ICCV; Rosten & Drummond 2006, "Machine learning for
//! high-speed corner detection" (FAST-9). The paper that uses it as its baseline states no settings; ours are those of
//! OpenCV but for the number of features. The pairs of the descriptor are drawn from a Gaussian by seed (Calonder et al. 2010,
//! "BRIEF", its layout G II), not learned as OpenCV's are.

mod brief;
mod fast;

use super::intensity::Intensity;
use super::{Features, Keypoint, coordinate_of};
use rayon::prelude::*;
use selenograph_geometry::Point2;
use selenograph_raster::Raster;
use selenograph_raster::resample::area_mean;
use serde::{Deserialize, Serialize};

pub use brief::Descriptor;
use brief::PATCH_RADIUS;

/// Samples at the rim without keypoints.
const RIM: usize = PATCH_RADIUS + 4;

/// Keypoints of one piece of work.
const CHUNK: usize = 128;

/// How features are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// At most so many keypoints, shared among the levels by their area's side.
    pub max_keypoints: usize,
    /// From one level to the next the picture shrinks by this.
    pub scale_factor: f64,
    /// Levels of the pyramid.
    pub num_levels: usize,
    /// FAST: how much nine neighbours in a row must be brighter, or darker, in grey levels of 255.
    pub fast_threshold: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self { max_keypoints: 5000, scale_factor: 1.2, num_levels: 8, fast_threshold: 20.0 }
    }
}

/// The features of a picture; none where it shows nothing (one grey level, no data).
pub fn detect(picture: &Raster<f32>, options: &Options) -> Features<Descriptor> {
    let Some(intensity) = Intensity::new(picture) else { return Features::default() };
    let pattern = brief::pattern();
    let mut features = Features::default();
    for (level, quota) in quotas(options).into_iter().enumerate() {
        let scale = options.scale_factor.powi(level as i32);
        let [width, height] =
            [picture.width, picture.height].map(|side| (side as f64 / scale).round() as usize);
        if width.min(height) <= 2 * RIM {
            break;
        }
        let image =
            if level == 0 { intensity.image.clone() } else { area_mean(&intensity.image, width, height) };
        let image = image.map(|grey| 255.0 * grey.clamp(0.0, 1.0));
        let place =
            Place { scale: [picture.width as f64 / width as f64, picture.height as f64 / height as f64] };
        let mut corners = fast::corners(&image, options.fast_threshold, RIM);
        corners.retain(|corner| {
            let [x, y] = place.position(corner);
            intensity.is_known_around(x, y, PATCH_RADIUS as f64 * scale)
        });
        corners.sort_by(|p, q| q.response.total_cmp(&p.response));
        corners.truncate(quota);
        let smooth = super::blur::gaussian(&image, brief::SMOOTHING_SIGMA);
        let described: Vec<Vec<(Keypoint, Descriptor)>> = corners
            .par_chunks(CHUNK)
            .map(|chunk| chunk.iter().map(|c| describe(&image, &smooth, c, &pattern, &place)).collect())
            .collect();
        for (keypoint, descriptor) in described.into_iter().flatten() {
            features.keypoints.push(keypoint);
            features.descriptors.push(descriptor);
        }
    }
    features
}

/// How a level's samples lie on the picture.
struct Place {
    scale: [f64; 2],
}

impl Place {
    fn coordinates(&self, corner: &fast::Corner) -> [f64; 2] {
        let at = |idx: usize, axis: usize| coordinate_of(idx as f64) * self.scale[axis];
        [at(corner.x, 0), at(corner.y, 1)]
    }

    fn position(&self, corner: &fast::Corner) -> [f64; 2] {
        self.coordinates(corner).map(selenograph_geometry::pixel::sample_position)
    }
}

fn describe(
    image: &Raster<f32>,
    smooth: &Raster<f32>,
    corner: &fast::Corner,
    pattern: &brief::Pattern,
    place: &Place,
) -> (Keypoint, Descriptor) {
    let angle_rad = brief::direction(image, corner.x, corner.y);
    let [x, y] = place.coordinates(corner);
    let keypoint = Keypoint {
        at: Point2::new(x, y),
        sigma_px: (PATCH_RADIUS as f64 * place.scale[0]) as f32,
        angle_rad,
        response: corner.response,
    };
    (keypoint, brief::describe(smooth, corner.x, corner.y, angle_rad, pattern))
}

/// Keypoints of each level: a geometric series that sums to the whole.
fn quotas(options: &Options) -> Vec<usize> {
    let factor = 1.0 / options.scale_factor.max(1.0 + 1e-6);
    let first =
        options.max_keypoints as f64 * (1.0 - factor) / (1.0 - factor.powi(options.num_levels as i32));
    (0..options.num_levels).map(|level| (first * factor.powi(level as i32)).round() as usize).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotas_sum_to_the_whole() {
        let quotas = quotas(&Options::default());
        assert_eq!(quotas.len(), 8);
        assert!((4996..=5004).contains(&quotas.iter().sum::<usize>()), "{quotas:?}");
        assert!(quotas.windows(2).all(|pair| pair[0] > pair[1]));
    }

    #[test]
    fn pictures_without_content_have_no_features() {
        for level in [0.0, 1.0, f32::NAN] {
            let flat = Raster { width: 80, height: 60, data: vec![level; 4800] };
            assert!(detect(&flat, &Options::default()).keypoints.is_empty());
        }
        let small = Raster::from_fn(9, 9, |x, y| (x * y) as f32);
        assert!(detect(&small, &Options::default()).keypoints.is_empty());
    }
}
