//! The chain called `sift` on the public sample pairs: what the project promises of every pair and light.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use selenograph_dataset::stored::{self, ReadOptions, StereoView};
use selenograph_geometry::{CamA, CamB, Rigid3};
use selenograph_reconstruct::View;
use selenograph_reconstruct::relative_pose::{SiftOptions, sift};
use std::path::PathBuf;

/// The promise, degrees. The settings were chosen on rendered pairs, not on these.
const MAX_RRA_DEG: f64 = 0.05;
const MAX_RTA_DEG: f64 = 0.2;

fn shared() -> PathBuf {
    std::env::var_os("SELENOGRAPH_SHARED")
        .map_or_else(|| concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared").into(), PathBuf::from)
}

fn view(of: &StereoView, light_idx: usize) -> View {
    View { image: of.images[light_idx].map(|&grey| f32::from(grey) / 255.0), camera: of.camera.clone() }
}

#[test]
fn shared_sift_is_exact_on_every_sample_pair() {
    let root = shared().join("data/stereolunar");
    if !root.is_dir() {
        println!("SKIP shared-data: no `{}`", root.display());
        return;
    }
    println!("RAN shared-data: stereolunar");
    let mut num_pairs = 0;
    for stored in stored::find(&root, ReadOptions::default()).unwrap() {
        let pair = stored.open().unwrap().stereo().unwrap();
        let [a, b] = &pair.views;
        let truth: Rigid3<CamB, CamA> = (&b.world_from_cam.inverse() * &a.world_from_cam).relabel();
        for light_idx in 0..a.images.len() {
            let found = sift(&view(a, light_idx), &view(b, light_idx), &SiftOptions::default()).unwrap();
            let found = found.pose.cam_b_from_cam_a;
            let rra_deg = (&found.inverse() * &truth).rotation_angle_rad().to_degrees();
            let rta_deg = found.origin().coords.angle(&truth.origin().coords).to_degrees();
            println!("{} light {light_idx}: RRA {rra_deg:.4}° RTA {rta_deg:.4}°", a.name);
            assert!(rra_deg < MAX_RRA_DEG && rta_deg < MAX_RTA_DEG);
            num_pairs += 1;
        }
    }
    assert!(num_pairs > 0);
}
