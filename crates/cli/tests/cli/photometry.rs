//! `data check --render`: pictures against renderings of their own depth.

use crate::campaign::{TINY, with_terrain};
use crate::program::{Place, names};

/// The tiny campaign as the authors' scripts light it, with pixels enough for slopes, away from the pole, where azimuths
/// do not depend on a few metres.
pub fn as_the_scripts() -> String {
    TINY.replace(
        "{ azimuth_deg = 180.0, elevation_deg = 15.0 }",
        "{ azimuth_deg = 250.0, elevation_deg = 20.0 }, { azimuth_deg = 180.0, elevation_deg = 15.0 }",
    )
    .replace("= 48", "= 96")
    .replace("{ min = -90.0, max = -89.96 }", "{ min = -89.93, max = -89.91 }")
    .replace("rays_per_pixel = 2", "rays_per_pixel = 32\nshadows = \"attached\"")
}

/// A place with `triplets/nadir` and so on.
pub fn with_triplets() -> Place {
    let place = with_terrain();
    place.write("scripts.toml", as_the_scripts());
    place.run("generate scripts.toml --terrain terrain --out dataset").ok();
    place.run("data export dataset --k-convention corner --out triplets").ok();
    place
}

#[test]
fn our_own_triplets_are_reproduced_and_shown() {
    let place = with_triplets();
    let answer = place.run("data check triplets --render --json --out beside");
    let report = answer.json();
    assert_eq!(report["agrees"], true, "{}", answer.stdout);
    assert_eq!(report["images"].as_array().unwrap().len(), 12);
    // Dynamic pairs tell no site.
    assert_eq!(answer.code, 3, "{}", answer.stderr);
    assert!(answer.stderr.contains("skipped: triplets/dynamic: "), "{}", answer.stderr);
    let pictures = names(&place.path("beside"));
    assert_eq!(pictures.len(), 13);
    assert_eq!(pictures[0], "nadir_im_00000.png");
    let table = place.run("data check triplets/nadir --render").ok().stdout;
    assert!(table.contains("nadir/im_00005.jpg") && table.contains("Pearson: median 0.99"), "{table}");
    assert_eq!(table.lines().count(), 10, "{table}");
}

#[test]
fn pictures_under_other_suns_are_told() {
    let place = with_triplets();
    let at = |n: u32| place.path(&format!("triplets/nadir/im_{n:05}.jpg"));
    // Lights exchanged: azimuth 330 for 180.
    std::fs::rename(at(0), at(99)).unwrap();
    std::fs::rename(at(4), at(0)).unwrap();
    std::fs::rename(at(99), at(4)).unwrap();
    let answer = place.run("data check triplets/nadir --render");
    assert_eq!(answer.code, 1, "{}", answer.stderr);
    assert!(answer.stdout.contains("4 of 6 pictures compared keep the limits"), "{}", answer.stdout);
    assert!(answer.stdout.contains("NOT reproduced"), "{}", answer.stdout);
}

#[test]
fn folders_without_comparable_pictures_are_refused() {
    let place = with_triplets();
    place.run("data check triplets/dynamic --render").refused("no picture of `triplets/dynamic`", "nadir");
    place.run("data check dataset --render --out beside").refused("expected triplets", "");
    place.run("data check triplets --out beside").refused("--render", "");
    assert!(!place.path("beside").exists());
}
