//! `data import`: triplets into our own layout.

use crate::photometry::with_triplets;

#[test]
fn triplets_become_a_dataset_that_every_command_reads() {
    let place = with_triplets();
    let summary = place.run("data import triplets --out again --suns scripts --json").ok().json();
    assert_eq!((&summary["num_pairs"], &summary["num_images"]), (&3.into(), &18.into()));
    let check = place.run("data check again --json").ok().json();
    assert_eq!((&check["kind"], &check["num_pairs"]), (&"selenograph".into(), &3.into()));
    place.run("data sheet again --out sheets").ok();
    place.run("data split again --out split.json --val-share 0.34").ok();
    place.run("data export again --out back --k-convention corner").ok();
    let table = |folder: &str| place.run(&format!("data check {folder}/nadir --render")).ok().stdout;
    assert!(table("back").contains("6 of 6 pictures"), "{}", table("back"));
    place.run("data import triplets --out again").refused("`again` exists", "--force");
    place.run("data import dataset --out other").refused("expected whole triplets", "");
    // Another principal point than the files have: the check tells.
    place.run("data import triplets --out shifted --k-convention center").ok();
    let shifted = place.run("data check shifted");
    assert!(shifted.stdout.contains("rincipal point"), "{}", shifted.stdout);
}

#[test]
fn a_missing_camera_costs_its_light_and_is_told() {
    let place = with_triplets();
    std::fs::remove_file(place.path("triplets/oblique/im_00003.npz")).unwrap();
    let answer = place.run("data import triplets --out again --json");
    assert_eq!(answer.code, 3, "{}", answer.stderr);
    assert_eq!(answer.json()["num_images"], 16);
    let told = "skipped: triplets/oblique/im_00003.npz: the file is missing";
    assert!(answer.stderr.starts_with(told) && answer.stderr.lines().count() == 1, "{}", answer.stderr);
    place.run("data check again").ok();
}
