//! Times the relative pose of one pair: `pair_pose_bench A.png B.png FOV_DEG [ROUNDS]` (`benches/opencv/run.sh` runs it beside OpenCV).
//!
//! Prints a line a round with the wall time of the whole, its steps, and what was found.
#![allow(clippy::print_stdout, reason = "an example for engineers")]

use selenograph_geometry::Camera;
use selenograph_raster::codec::png;
use selenograph_reconstruct::View;
use selenograph_reconstruct::relative_pose::{SiftOptions, sift};
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [a, b, fov_deg, rest @ ..] = arguments.as_slice() else {
        return Err("usage: pair_pose_bench A.png B.png FOV_DEG [ROUNDS]".into());
    };
    let fov_rad = fov_deg.parse::<f64>()?.to_radians();
    let rounds: usize = rest.first().map_or(Ok(5), |rounds| rounds.parse())?;
    let view = |path: &str| -> Result<View, Box<dyn std::error::Error>> {
        let image = png::read(Path::new(path))?.to_unit_grey();
        let camera = Camera::from_fov(image.width, image.height, fov_rad)?;
        Ok(View { image, camera })
    };
    let (a, b) = (view(a)?, view(b)?);
    for _ in 0..rounds {
        let start = Instant::now();
        let found = sift(&a, &b, &SiftOptions::default())?;
        let wall_ms = 1e3 * start.elapsed().as_secs_f64();
        let d = &found.durations;
        let [features, matching, estimate, subpixel, refinement] =
            [d.features, d.matching, d.estimate, d.subpixel, d.refinement].map(|d| 1e3 * d.as_secs_f64());
        println!(
            "selenograph wall_ms={wall_ms:.2} features_ms={features:.2} matching_ms={matching:.2} estimate_ms={estimate:.2} \
             subpixel_ms={subpixel:.2} refinement_ms={refinement:.2} features={},{} inliers={}",
            found.counts.features[0], found.counts.features[1], found.counts.inliers
        );
    }
    Ok(())
}
