//! Times the relative pose of one pair: `pair_pose_bench A.png B.png FOV_DEG [ROUNDS]` (`benches/opencv/run.sh` runs it beside OpenCV).
//!
//! Prints a line a round with the wall time of the whole, its steps, and what was found.
#![allow(clippy::disallowed_methods, reason = "a measuring program reads the clock")]
#![allow(clippy::print_stdout, reason = "an example for engineers")]

use selenograph_geometry::{Camera, mean_focal_px};
use selenograph_pose::relative::{RelativeOptions, estimate};
use selenograph_raster::codec::png;
use selenograph_reconstruct::relative_pose::{SiftOptions, sift};
use selenograph_reconstruct::{View, features, matching};
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
    let options = SiftOptions::default();
    let ms = |since: Instant| 1e3 * since.elapsed().as_secs_f64();
    for _ in 0..rounds {
        let start = Instant::now();
        let found = sift(&a, &b, &options)?;
        let wall_ms = ms(start);
        // The first steps again, by themselves.
        let start = Instant::now();
        let (of_a, of_b) = rayon::join(
            || features::sift::detect(&a.image, &options.features),
            || features::sift::detect(&b.image, &options.features),
        );
        let features_ms = ms(start);
        let start = Instant::now();
        let matches = matching::sift(&of_a, &of_b, &options.matching);
        let matching_ms = ms(start);
        let start = Instant::now();
        let cameras = [&a.camera, &b.camera];
        let threshold = options.threshold_px / mean_focal_px(cameras);
        estimate(
            &matching::on_plane(cameras, &matches),
            &RelativeOptions { threshold, ..RelativeOptions::default() },
        )?;
        let estimate_ms = ms(start);
        println!(
            "selenograph wall_ms={wall_ms:.2} features_ms={features_ms:.2} matching_ms={matching_ms:.2} estimate_ms={estimate_ms:.2} \
             features={},{} matches={} inliers={}",
            of_a.keypoints.len(),
            of_b.keypoints.len(),
            matches.len(),
            found.counts.inliers
        );
    }
    Ok(())
}
