use super::*;
use crate::camera_file::{self, PictureSize};
use selenograph_geometry::{Distortion, PixelConvention, Rotation3};
use selenograph_raster::Raster;
use std::path::Path;

fn camera(k3: f64) -> Camera {
    let k = selenograph_geometry::Matrix3::new(700.0, 0.0, 311.25, 0.0, 710.5, 245.75, 0.0, 0.0, 1.0);
    let lens = Distortion { k1: -0.1, k2: 0.02, p1: 1e-3, p2: -2e-3, k3 };
    Camera::from_k(640, 480, &k, PixelConvention::Corner).unwrap().with_distortion(lens)
}

fn b_from_a() -> Rigid3<CamB, CamA> {
    Rigid3::new(Rotation3::from_euler_angles(0.05, -0.12, 1.3), Point3::new(-0.8, 0.5, 0.2))
}

/// Thirty points of rough ground, seen without noise; the unit is half a metre.
fn scene(k3: f64) -> Scene {
    let cameras = [camera(k3), camera(0.0)];
    let seen = (0..30).filter_map(|k| {
        let at = Point3::new(
            0.05 * f64::from(k % 6) - 0.1,
            0.04 * f64::from(k / 6) - 0.1,
            4.0 + 0.01 * f64::from(k),
        );
        let [a, b] = [cameras[0].project(&at)?, cameras[1].project(&b_from_a().point(&at))?];
        Some(JudgedMatch { inlier: k % 5 != 0, ..JudgedMatch::unjudged(a, b) })
    });
    let matches: Vec<JudgedMatch> = seen.collect();
    let views = cameras.map(|camera| View { image: Raster::filled(640, 480, 0.4), camera });
    let scale = Sim3::new(0.5, Rigid3::identity()).unwrap();
    let names = ["left/a 1.png".to_owned(), "right/a 1.png".to_owned()];
    Scene::of_pair(names, views.each_ref(), &b_from_a(), &scale, &matches)
}

#[test]
fn a_pair_becomes_a_scene_in_the_unit_of_its_scale() {
    let scene = scene(0.0);
    assert_eq!((scene.views.len(), scene.points.len()), (2, 24));
    let point = &scene.points[0];
    assert!((point.place - Point3::new(-0.025, -0.05, 2.005)).norm() < 1e-9, "{point:?}");
    assert!(point.error_px < 1e-9 && point.grey == 102);
    let centre = scene.views[1].world_from_cam.origin();
    assert!((centre - b_from_a().inverse().origin() * 0.5).norm() < 1e-12);
}

fn write(scene: &Scene, ending: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (name, bytes) in colmap::files(scene) {
        if name.ends_with(ending) {
            std::fs::write(dir.path().join(name), bytes).unwrap();
        }
    }
    dir
}

/// By COLMAP's own words: R X + t, `x/z`, the lens, `f x + c` from the corner.
#[test]
fn colmap_models_reproject_text_and_binary() {
    for (k3, model) in [(0.0, "OPENCV"), (0.01, "FULL_OPENCV")] {
        let scene = scene(k3);
        for ending in [".txt", ".bin"] {
            let dir = write(&scene, ending);
            for (view, wanted) in scene.views.iter().enumerate() {
                let path = Path::new("/somewhere").join(&wanted.name);
                let found = camera_file::read(dir.path(), &PictureSize::new(640, 480).at(&path)).unwrap();
                assert_eq!(found.camera, wanted.camera);
                let cam_from_world = found.pose.unwrap().world_from_cam.inverse();
                for point in &scene.points {
                    let seen = found.camera.project(&cam_from_world.point(&point.place)).unwrap();
                    assert!((seen - point.track[view].1).norm() < 1e-8);
                }
            }
        }
        assert!(String::from_utf8(colmap::files(&scene)[0].1.clone()).unwrap().contains(model));
    }
}

/// Text and binary hold the same; every track leads to the observation that leads to it.
#[test]
fn tracks_and_observations_lead_to_each_other() {
    let scene = scene(0.0);
    let [_, (_, images), (_, points), _, (_, images_binary), (_, points_binary)] = colmap::files(&scene);
    let text = String::from_utf8(images).unwrap();
    let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    let points_of = |image: usize| -> Vec<f64> {
        lines[2 * image + 1].split(' ').map(|word| word.parse().unwrap()).collect()
    };
    let text = String::from_utf8(points).unwrap();
    let mut num_tracks = 0;
    for (line, point) in text.lines().filter(|line| !line.starts_with('#')).zip(&scene.points) {
        let words: Vec<&str> = line.split(' ').collect();
        for (pair, (view, at)) in words[8..].chunks(2).zip(&point.track) {
            let [image, idx] = [pair[0], pair[1]].map(|word| word.parse::<usize>().unwrap());
            let seen = points_of(image - 1)[3 * idx..3 * idx + 3].to_vec();
            assert_eq!((image - 1, seen), (*view, vec![at.x, at.y, words[0].parse().unwrap()]));
            num_tracks += 1;
        }
    }
    assert_eq!(num_tracks, 48);
    let head = 8 + 4 + 7 * 8 + 4;
    let name = "left/a 1.png\0".len();
    assert_eq!(images_binary.len(), 8 + (head - 8 + 8) * 2 + 2 * name + 1 + 48 * 24);
    assert_eq!(points_binary.len(), 8 + 24 * (8 + 24 + 3 + 8 + 8 + 2 * 8));
}

/// By nerfstudio's own words: the camera looks along its −Z, Y is up in it, the picture's first pixel covers 0 to 1.
#[test]
fn nerfstudio_frames_reproject() {
    let scene = scene(0.01);
    let text = nerfstudio::transforms(&scene, "../").unwrap();
    let read: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (view, frame) in read["frames"].as_array().unwrap().iter().enumerate() {
        assert_eq!(frame["file_path"], format!("../{}", scene.views[view].name));
        let number = |key: &str| frame[key].as_f64().unwrap();
        let m = |i: usize, j: usize| frame["transform_matrix"][i][j].as_f64().unwrap();
        let rotation = selenograph_geometry::Matrix3::from_fn(m);
        assert!((rotation.determinant() - 1.0).abs() < 1e-12);
        let centre = Point3::new(m(0, 3), m(1, 3), m(2, 3));
        for point in &scene.points {
            let x = rotation.transpose() * (point.place - centre);
            assert!(x.z < 0.0);
            let (u, v) = (x.x / -x.z, -x.y / -x.z);
            let r2 = u * u + v * v;
            let radial = 1.0 + r2 * (number("k1") + r2 * (number("k2") + r2 * number("k3")));
            let (p1, p2) = (number("p1"), number("p2"));
            let ud = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u);
            let vd = v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v;
            let seen = Point2::new(number("fl_x") * ud + number("cx"), number("fl_y") * vd + number("cy"));
            assert!((seen - point.track[view].1).norm() < 1e-8, "{seen}");
        }
    }
}
