//! Pose errors of `sift` and `orb` on a folder of pairs with truth: StereoLunar triplets or our own dataset.
//!
//! `pose_rows DIR [method=sift|orb|orb-refined|features] [key=value …] [-v]`
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "an example for engineers")]

use selenograph_dataset::import::{self, StereoPair};
use selenograph_geometry::{CamA, CamB, PixelConvention, Rigid3};
use selenograph_reconstruct::View;
use selenograph_reconstruct::features::sift::FirstOctave;
use selenograph_reconstruct::relative_pose::{OrbOptions, PairPose, SiftOptions, orb, sift};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Reads the pairs one after the other: hundreds of megabytes together.
fn each_pair(root: &Path, mut f: impl FnMut(&str, &str, StereoPair)) {
    if root.join("pairs").is_dir() {
        for folder in pair_folders(&root.join("pairs")) {
            let Ok((pair, record)) = import::selenograph::read_pair(&folder) else { continue };
            let kind = record.trajectory.map_or("pair", |t| t.as_str());
            f(kind, &format!("{kind}_{}", pair.pair_id), pair);
        }
        return;
    }
    for scene in import::stereolunar::scenes(root).unwrap() {
        for triplets in import::stereolunar::scan(&scene).unwrap() {
            let (pair, _) = import::stereolunar::read_pair(&triplets, PixelConvention::Corner).unwrap();
            let name = scene.file_name().unwrap().to_string_lossy().into_owned();
            f(name.split('_').next().unwrap_or("pair"), &name, pair);
        }
    }
}

fn pair_folders(pairs: &Path) -> Vec<PathBuf> {
    let entries = |folder: &Path| -> Vec<PathBuf> {
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir()).collect()
    };
    let mut folders: Vec<PathBuf> = entries(pairs).iter().flat_map(|shard| entries(shard)).collect();
    folders.sort();
    folders
}

/// Rotation and direction errors, degrees.
fn errors_deg(found: &Rigid3<CamB, CamA>, truth: &Rigid3<CamB, CamA>) -> [f64; 2] {
    let turn = (&found.inverse() * truth).rotation_angle_rad();
    let (t, s) = (found.origin().coords, truth.origin().coords);
    [turn.to_degrees(), t.angle(&s).to_degrees()]
}

struct Arguments(Vec<String>);

impl Arguments {
    fn value(&self, key: &str) -> Option<&str> {
        self.0.iter().find_map(|a| a.strip_prefix(key)?.strip_prefix('='))
    }

    fn set<T: std::str::FromStr>(&self, key: &str, target: &mut T) {
        if let Some(value) = self.value(key).and_then(|v| v.parse().ok()) {
            *target = value;
        }
    }
}

fn sift_options(arguments: &Arguments) -> SiftOptions {
    let mut options = SiftOptions::default();
    arguments.set("contrast", &mut options.features.contrast);
    arguments.set("edge", &mut options.features.edge_ratio);
    arguments.set("keep", &mut options.features.max_keypoints);
    arguments.set("cells", &mut options.features.spread_cells);
    arguments.set("ratio", &mut options.matching.max_ratio);
    arguments.set("threshold", &mut options.threshold_px);
    arguments.set("refined", &mut options.refined_threshold_px);
    if arguments.value("octave") == Some("original") {
        options.features.first_octave = FirstOctave::Original;
    }
    if let Some(subpixel) = &mut options.subpixel {
        arguments.set("spacing", &mut subpixel.spacing_px);
        arguments.set("smoothing", &mut subpixel.smoothing_px);
        arguments.set("blur", &mut subpixel.camera_blur_px);
        arguments.set("return", &mut subpixel.max_return_px);
        arguments.set("correlation", &mut subpixel.min_correlation);
        arguments.set("sigma", &mut subpixel.max_sigma_px);
        arguments.set("passes", &mut subpixel.passes);
    }
    if arguments.value("method") == Some("features") {
        options.subpixel = None;
    }
    options
}

fn main() {
    let arguments = Arguments(std::env::args().skip(1).collect());
    let root = PathBuf::from(&arguments.0[0]);
    let method = arguments.value("method").unwrap_or("sift").to_owned();
    let verbose = arguments.0.iter().any(|a| a == "-v");
    let cross: usize = arguments.value("cross").and_then(|v| v.parse().ok()).unwrap_or(0);
    let options = sift_options(&arguments);
    let mut baseline = OrbOptions::default();
    if method == "orb-refined" {
        baseline.refinement = selenograph_pose::relative::Refinement::Full;
    }
    let mut rows: BTreeMap<String, Vec<Option<[f64; 2]>>> = BTreeMap::new();
    let mut timed: Vec<[f64; 5]> = Vec::new();
    each_pair(&root, |kind, name, pair| {
        let [a, b] = &pair.views;
        let truth: Rigid3<CamB, CamA> = (&b.world_from_cam.inverse() * &a.world_from_cam).relabel();
        let lights = a.images.len();
        for light in 0..lights {
            let view = |v: &import::StereoView, light: usize| View {
                image: v.images[light].map(|&grey| f32::from(grey) / 255.0),
                camera: v.camera.clone(),
            };
            let [a, b] = [view(a, light), view(b, (light + cross) % lights)];
            let found =
                if method.starts_with("orb") { orb(&a, &b, &baseline) } else { sift(&a, &b, &options) };
            let errors = found.as_ref().ok().map(|found| errors_deg(&found.pose.cam_b_from_cam_a, &truth));
            rows.entry(kind.to_owned()).or_default().push(errors);
            if let Ok(found) = &found {
                timed.push(milliseconds(found));
            }
            if verbose {
                print_pair(&format!("{name} light {light}"), &found, errors);
            }
        }
    });
    for (kind, errors) in &rows {
        print_row(&method, kind, errors);
    }
    print_row(&method, "all", &rows.into_values().flatten().collect::<Vec<_>>());
    let median = |i: usize| selenograph_raster::statistics::median(timed.iter().map(|t| t[i])).unwrap_or(0.0);
    println!(
        "median ms: features {:.1} matching {:.1} estimate {:.1} subpixel {:.1} final {:.1}",
        median(0),
        median(1),
        median(2),
        median(3),
        median(4)
    );
}

fn milliseconds(found: &PairPose) -> [f64; 5] {
    let d = &found.durations;
    [d.features, d.matching, d.estimate, d.subpixel, d.refinement].map(|d| 1e3 * d.as_secs_f64())
}

fn print_pair(
    name: &str,
    found: &Result<PairPose, selenograph_pose::relative::CannotSay>,
    errors: Option<[f64; 2]>,
) {
    match (found, errors) {
        (Ok(found), Some([rra, rta])) => {
            let mut residuals: Vec<f64> =
                found.matches.iter().filter(|m| m.inlier).map(|m| m.residual_px.abs()).collect();
            residuals.sort_by(f64::total_cmp);
            let c = &found.counts;
            let sigma = found.pose.covariance.diagonal().map(|v| v.sqrt().to_degrees());
            println!(
                "{name}: RRA {rra:.4} RTA {rta:.4} features {:?} matches {} first {} refined {} inliers {} median residual {:.4} px sigma t {:.3} {:.3}",
                c.features,
                c.matches,
                c.first_inliers,
                c.refined,
                c.inliers,
                residuals.get(residuals.len() / 2).copied().unwrap_or(f64::NAN),
                sigma[3],
                sigma[4]
            );
        }
        (Err(reason), _) => println!("{name}: {reason}"),
        _ => {}
    }
}

fn print_row(method: &str, kind: &str, errors: &[Option<[f64; 2]>]) {
    let answered: Vec<[f64; 2]> = errors.iter().flatten().copied().collect();
    let column = |i: usize| answered.iter().map(move |e| e[i]);
    let median = |i: usize| selenograph_raster::statistics::median(column(i)).unwrap_or(f64::NAN);
    let max = |i: usize| column(i).fold(0.0, f64::max);
    let below = |i: usize| -> String {
        let share =
            |limit: f64| 100.0 * column(i).filter(|e| *e < limit).count() as f64 / errors.len() as f64;
        [2.0, 5.0, 15.0, 30.0].map(|limit| format!("{:.0}", share(limit))).join("/")
    };
    println!(
        "{method} {kind}: n {} no answer {} RRA median {:.4} max {:.4} @2/5/15/30 {}  RTA median {:.4} max {:.4} @2/5/15/30 {}",
        errors.len(),
        errors.len() - answered.len(),
        median(0),
        max(0),
        below(0),
        median(1),
        max(1),
        below(1)
    );
}
