use super::synthetic::{TestView, nadir_pair, oblique_pair, write_own_pair};
use super::*;
use crate::export::stereolunar::{ExportOptions, write_pair};
use crate::stored::{StereoPair, StereoView};
use selenograph_geometry::Matrix4;
use selenograph_raster::Raster;
use selenograph_raster::codec::exr::{Channel, ExrImage, SampleType};
use selenograph_raster::codec::npz::{Array, Values};
use selenograph_raster::codec::{exr, npz};
use std::collections::BTreeMap;
use std::path::PathBuf;

const SIDE: usize = 72;

fn stereo_view(view: &TestView, name: &str) -> StereoView {
    let image = Raster::from_fn(SIDE, SIDE, |x, y| (x + y) as u8);
    StereoView {
        name: name.to_owned(),
        camera: view.camera.clone(),
        world_from_cam: view.world_from_cam,
        depth_z: view.depth_z.clone(),
        images: vec![image; 3],
        slope_rad: None,
        lit: vec![],
    }
}

/// A folder with one clean pair of three lights.
fn clean_folder(k_convention: PixelConvention) -> (tempfile::TempDir, [TestView; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = oblique_pair(SIDE);
    let pair = StereoPair { pair_id: 2, views: [stereo_view(&a, "a"), stereo_view(&b, "b")] };
    let options = ExportOptions { k_convention, ..ExportOptions::default() };
    let stems = write_pair(folder.path(), 2, &pair, &options).unwrap();
    assert_eq!(stems[1], ["im_00014", "im_00015"]);
    (folder, [a, b])
}

fn checked(folder: &tempfile::TempDir) -> Report {
    check(folder.path(), &CheckOptions { step: 1, ..CheckOptions::default() }).unwrap()
}

fn has(report: &Report, severity: Severity, code: Code) -> bool {
    report.findings.iter().any(|finding| finding.severity == severity && finding.code == code)
}

/// Rewrites the depth of one view under all lights.
fn replace_depth(folder: &tempfile::TempDir, view: usize, depth_values: &Raster<f32>, stored: SampleType) {
    for number in [12, 14, 16].map(|first| first + view) {
        let channel = Channel { stored, ..Channel::float("Y", depth_values.data.clone()) };
        let image =
            ExrImage { width: SIDE, height: SIDE, channels: vec![channel], attributes: BTreeMap::new() };
        std::fs::write(file(folder, number, "exr"), exr::encode(&image).unwrap()).unwrap();
    }
}

/// Rewrites the pose of one view under all lights.
fn replace_pose(folder: &tempfile::TempDir, view: usize, pose: &Matrix4<f64>) {
    for number in [12, 14, 16].map(|first| first + view) {
        let path = file(folder, number, "npz");
        let mut arrays = npz::read(&path).unwrap();
        let values = Values::F64(pose.transpose().as_slice().to_vec());
        arrays.insert("cam2world".to_owned(), Array::new(&[4, 4], values));
        std::fs::write(path, npz::encode(&arrays).unwrap()).unwrap();
    }
}

fn file(folder: &tempfile::TempDir, number: usize, extension: &str) -> PathBuf {
    folder.path().join(format!("im_{number:05}.{extension}"))
}

#[test]
fn a_centre_based_export_is_clean_and_a_corner_based_one_is_told() {
    let (folder, _) = clean_folder(PixelConvention::Center);
    let report = checked(&folder);
    assert!(report.is_clean(), "{report}");
    assert_eq!((report.num_pairs, report.num_images, report.kind), (1, 6, FolderKind::Stereolunar));
    assert_eq!(report.principal_point.as_ref().unwrap().verdict, Verdict::HalfPixelMore);
    assert!(report.to_string().contains("centre-based"));
    let (folder, _) = clean_folder(PixelConvention::Corner);
    let report = checked(&folder);
    assert!(has(&report, Severity::Warning, Code::PrincipalPoint), "{report}");
    let warp = report.pairs[0].reprojection.unwrap();
    assert!(warp.median_px < 0.01 && warp.p99_px < 0.2, "{warp:?}");
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["findings"][0]["code"], "principal-point");
    assert!(json["findings"][0]["where"].is_string());
}

#[test]
fn missing_and_truncated_files_are_found() {
    let (folder, _) = clean_folder(PixelConvention::Center);
    std::fs::remove_file(file(&folder, 15, "npz")).unwrap();
    let exr = file(&folder, 12, "exr");
    let bytes = std::fs::read(&exr).unwrap();
    std::fs::write(&exr, &bytes[..bytes.len() / 2]).unwrap();
    let jpg = file(&folder, 16, "jpg");
    std::fs::write(&jpg, b"\xff\xd8\xff\xe0").unwrap();
    let report = checked(&folder);
    let missing = report.findings.iter().find(|f| f.code == Code::MissingFile).unwrap();
    assert!(missing.place.ends_with("im_00015.npz"));
    assert!(missing.hint.as_ref().unwrap().contains("im_00013.npz"), "{missing:?}");
    let broken: Vec<_> = report.findings.iter().filter(|f| f.code == Code::BrokenFile).collect();
    assert_eq!(broken.len(), 2, "{report}");
    // The geometry is still read from what is whole.
    assert_eq!(report.pairs.len(), 1);
}

#[test]
fn a_light_with_one_view_is_found() {
    let (folder, _) = clean_folder(PixelConvention::Center);
    for extension in ["jpg", "exr", "npz"] {
        std::fs::remove_file(file(&folder, 17, extension)).unwrap();
    }
    let report = checked(&folder);
    assert!(report.findings.iter().any(|f| f.code == Code::MissingFile && f.place.ends_with("im_00017")));
}

#[test]
fn range_as_z_is_found() {
    let (folder, views) = clean_folder(PixelConvention::Center);
    for (idx, view) in views.iter().enumerate() {
        replace_depth(&folder, idx, &view.range(), SampleType::Float);
    }
    let report = checked(&folder);
    assert!(has(&report, Severity::Error, Code::RangeAsDepth), "{report}");
    assert!(!has(&report, Severity::Error, Code::FlippedPose), "{report}");
}

#[test]
fn half_float_and_absent_depth_are_found() {
    let (folder, views) = clean_folder(PixelConvention::Center);
    let mut depth_values = views[0].depth_z.clone();
    (depth_values.data[5], depth_values.data[6], depth_values.data[7]) = (f32::INFINITY, 0.0, f32::NAN);
    replace_depth(&folder, 0, &depth_values, SampleType::Half);
    // Stored as float, but from a half.
    let rounded = views[1].depth_z.map(|z| f32::from_bits((z.to_bits() + 0x1000) & !0x1fff));
    replace_depth(&folder, 1, &rounded, SampleType::Float);
    let report = checked(&folder);
    assert_eq!(report.findings.iter().filter(|f| f.code == Code::HalfFloatDepth).count(), 2, "{report}");
    assert!(
        has(&report, Severity::Error, Code::AbsentDepth) && has(&report, Severity::Info, Code::AbsentDepth)
    );
}

#[test]
fn flipped_and_broken_poses_are_found() {
    let flips: [(Matrix4<f64>, bool, Code); 4] = [
        (Matrix4::from_diagonal(&[1.0, -1.0, -1.0, 1.0].into()), false, Code::FlippedPose),
        (Matrix4::identity(), true, Code::FlippedPose),
        (Matrix4::from_diagonal(&[1.0, 1.0, -1.0, 1.0].into()), false, Code::NotARotation),
        (Matrix4::from_diagonal(&[1.05, 1.0, 1.0, 1.0].into()), false, Code::NotARotation),
    ];
    for (flip, inverse, code) in flips {
        let (folder, views) = clean_folder(PixelConvention::Center);
        let right = views[1].pose_matrix();
        let wrong = if inverse { right.try_inverse().unwrap() } else { right * flip };
        replace_pose(&folder, 1, &wrong);
        let report = checked(&folder);
        assert!(has(&report, Severity::Error, code), "{flip} {report}");
    }
}

#[test]
fn a_pose_of_another_picture_is_inconsistent_or_shares_nothing() {
    let (folder, views) = clean_folder(PixelConvention::Center);
    let mut pose = views[1].pose_matrix();
    pose[(0, 3)] += 300.0;
    pose[(1, 3)] -= 300.0;
    replace_pose(&folder, 1, &pose);
    assert!(has(&checked(&folder), Severity::Error, Code::Inconsistent));
}

#[test]
fn lights_that_differ_are_found() {
    let (folder, _) = clean_folder(PixelConvention::Center);
    std::fs::copy(file(&folder, 13, "npz"), file(&folder, 14, "npz")).unwrap();
    assert!(has(&checked(&folder), Severity::Warning, Code::LightsDiffer));
}

#[test]
fn an_empty_folder_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    assert!(check(folder.path(), &CheckOptions::default()).is_err());
}

#[test]
fn our_own_pairs_are_clean_until_a_file_changes() {
    let root = tempfile::tempdir().unwrap();
    let views = oblique_pair(SIDE);
    let folder = write_own_pair(root.path(), 7, &views);
    let report = checked(&root);
    assert!(report.findings.is_empty(), "{report}");
    assert_eq!((report.kind, report.num_images), (FolderKind::Selenograph, 4));
    let image = folder.join("a.l1.png");
    let bytes = std::fs::read(&image).unwrap();
    std::fs::write(&image, &bytes[..40]).unwrap();
    std::fs::remove_file(folder.join("b.depth_z.exr")).unwrap();
    let report = checked(&root);
    assert!(
        report.findings.iter().any(|f| f.code == Code::ChangedFile && f.place.ends_with("a.l1.png")),
        "{report}"
    );
    assert!(
        report.findings.iter().any(|f| f.code == Code::MissingFile && f.place.ends_with("b.depth_z.exr"))
    );
    std::fs::write(folder.join("pair.json"), "{").unwrap();
    assert!(has(&checked(&root), Severity::Error, Code::BrokenFile));
}

#[test]
fn our_own_records_have_to_keep_their_convention() {
    let root = tempfile::tempdir().unwrap();
    let mut views = oblique_pair(SIDE);
    for view in &mut views {
        let half = selenograph_geometry::pixel::HALF_PIXEL;
        view.camera = numbers::moved(&view.camera, -half, -half);
    }
    write_own_pair(root.path(), 0, &views);
    assert!(has(&checked(&root), Severity::Error, Code::PrincipalPoint));
}

/// Rewrites a number in a record, and the checksum of the record where `pair.json` holds it.
fn edit(folder: &Path, name: &str, change: impl Fn(&mut serde_json::Value)) {
    let read = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(folder.join(name)).unwrap()).unwrap()
    };
    let write = |name: &str, value: &serde_json::Value| {
        let text = serde_json::to_string_pretty(value).unwrap();
        std::fs::write(folder.join(name), &text).unwrap();
        blake3::hash(text.as_bytes()).to_hex().to_string()
    };
    let mut record = read(name);
    change(&mut record);
    let sum = write(name, &record);
    if name != "pair.json" {
        let mut pair = read("pair.json");
        pair["files"][name] = sum.into();
        write("pair.json", &pair);
    }
}

#[test]
fn every_derived_number_of_a_record_is_derived_again() {
    let views = oblique_pair(SIDE);
    let cases: [(&str, &str, f64); 14] = [
        ("pair.json", "/baseline_m", 2.0),
        ("pair.json", "/baseline_over_height", 2.0),
        ("pair.json", "/baseline_vector_m/1", 1.01),
        ("pair.json", "/cam_b_from_cam_a/0/3", 1.01),
        ("pair.json", "/altitude_ratio", 1.1),
        ("pair.json", "/convergence_deg", 1.1),
        ("pair.json", "/site/latitude_deg", 0.999),
        ("pair.json", "/suns/1/azimuth_deg", 1.5),
        ("pair.json", "/suns/0/direction/0", -1.0),
        ("pair.json", "/overlap/a_in_b", 0.8),
        ("a.camera.json", "/altitude_above_sphere_m", 1.1),
        ("b.camera.json", "/tilt_deg", 1.1),
        ("a.camera.json", "/gsd_m", 1.1),
        ("b.camera.json", "/valid_share", 0.5),
    ];
    for (name, pointer, factor) in cases {
        let root = tempfile::tempdir().unwrap();
        let folder = write_own_pair(root.path(), 7, &views);
        edit(&folder, name, |record| {
            let number = record.pointer_mut(pointer).unwrap();
            *number = (number.as_f64().unwrap() * factor).into();
        });
        let report = checked(&root);
        let found = report.findings.iter().find(|f| f.code == Code::Record);
        assert!(found.is_some_and(|f| f.place.ends_with(name)), "{name} {pointer}: {report}");
    }
}

#[test]
fn an_altitude_over_the_terrain_is_held_against_the_ground_below() {
    let found = |views: &[TestView; 2], altitude: fn(f64) -> Option<f64>| {
        let root = tempfile::tempdir().unwrap();
        let folder = write_own_pair(root.path(), 7, views);
        edit(&folder, "b.camera.json", |record| {
            let told = record["altitude_over_terrain_m"].as_f64().unwrap();
            record["altitude_over_terrain_m"] = altitude(told).into();
        });
        let report = checked(&root);
        let found = report.findings.iter().find(|f| f.code == Code::Record).cloned();
        found.map(|f| (f.place.ends_with("b.camera.json"), f.message.contains("altitude_over_terrain_m")))
    };
    let (seen, unseen) = (nadir_pair(SIDE), oblique_pair(SIDE));
    for views in [&seen, &unseen] {
        assert_eq!(found(views, Some), None);
        assert_eq!(found(views, |altitude_m| Some(-altitude_m)), Some((true, true)));
    }
    assert_eq!(found(&seen, |altitude_m| Some(1.05 * altitude_m)), Some((true, true)));
    assert_eq!(found(&seen, |_| None), Some((true, true)));
    // No view sees the ground below: that it is above ground is all that can be said.
    assert_eq!(found(&unseen, |altitude_m| Some(1.05 * altitude_m)), None);
}

#[test]
fn the_ratio_of_baseline_and_height_is_one_number() {
    let root = tempfile::tempdir().unwrap();
    let folder = write_own_pair(root.path(), 7, &oblique_pair(SIDE));
    let record: crate::pair::PairRecord = crate::pair::read_json(&folder.join("pair.json")).unwrap();
    assert!((checked(&root).pairs[0].baseline_over_height - record.baseline_over_height).abs() < 1e-9);
}
