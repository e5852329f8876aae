//! Medians of time and error of the relative pose on simulated scenes: `cargo run --release --example pose_bench`.
#![allow(clippy::print_stdout, reason = "an example's result is what it prints")]

use selenograph_pose::problems::{Scene, SceneKind};
use selenograph_pose::relative::{Order, Refinement, RelativeOptions, estimate};
use std::time::Instant;

const FOCAL: f64 = 618.0;
const TRIALS: u64 = 40;

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn main() {
    let nadir = SceneKind::Nadir { relief_parallax: 0.9 / FOCAL };
    for (name, kind, outliers) in [
        ("general 30 % outliers", SceneKind::General, 0.3),
        ("general 60 % outliers", SceneKind::General, 0.6),
        ("nadir, rounded, 0 %", nadir, 0.0),
        ("nadir, rounded, 30 %", nadir, 0.3),
    ] {
        for refinement in [Refinement::None, Refinement::Local, Refinement::Full] {
            let (mut times, mut rotations, mut directions, mut samples) = (vec![], vec![], vec![], vec![]);
            let mut failed = 0;
            for seed in 0..TRIALS {
                let scene = Scene::new(&kind, 2000, seed).with_outliers(outliers);
                let scene = if outliers == 0.0 || name.starts_with("nadir") {
                    scene.with_rounding(1.0 / FOCAL)
                } else {
                    scene.with_noise(0.3 / FOCAL)
                };
                let options = RelativeOptions {
                    threshold: 1.0 / FOCAL,
                    seed,
                    refinement,
                    order: Order::Random,
                    ..RelativeOptions::default()
                };
                let start = Instant::now();
                let found = estimate(&scene.matches, &options);
                times.push(start.elapsed().as_secs_f64() * 1e3);
                match found {
                    Ok(found) => {
                        rotations.push(scene.rotation_error_rad(&found.cam_b_from_cam_a).to_degrees());
                        directions.push(scene.direction_error_rad(&found.cam_b_from_cam_a).to_degrees());
                        samples.push(found.iterations as f64);
                    }
                    Err(_) => failed += 1,
                }
            }
            let worst = directions.iter().copied().fold(0.0, f64::max);
            println!(
                "{name:24} {refinement:?}: {:.2} ms, {:.0} samples, rotation {:.4}°, direction {:.4}° (worst {worst:.3}°), failed {failed}",
                median(&mut times),
                median(&mut samples),
                median(&mut rotations),
                median(&mut directions)
            );
        }
    }
}
