use super::*;
use selenograph_geometry::{Distortion, PixelConvention, Point2, Rotation3};
use std::path::PathBuf;

const SIZE: PictureSize = PictureSize { width: 640, height: 480, name: None, was_resized: false };

/// Digits written in files keep projections to this.
const SAME_PX: f64 = 1e-9;

fn camera() -> Camera {
    let k = nalgebra::Matrix3::new(700.0, 0.0, 311.25, 0.0, 710.5, 245.75, 0.0, 0.0, 1.0);
    let lens = Distortion { k1: -0.1, k2: 0.02, p1: 1e-3, p2: -2e-3, k3: 0.0 };
    Camera::from_k(640, 480, &k, PixelConvention::Corner).unwrap().with_distortion(lens)
}

fn pose() -> Rigid3<BodyFixed, Cam> {
    Rigid3::new(Rotation3::from_euler_angles(2.9, 0.2, -0.7), Point3::new(1.7e6, -320.0, 45.5))
}

fn file(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    (dir, path)
}

fn read_text(text: &str) -> Result<CameraFile, Error> {
    let (_dir, path) = file("camera.txt", text);
    read(&path, &SIZE)
}

fn refused(text: &str) -> String {
    let error = read_text(text).unwrap_err().to_string();
    assert!(error.contains("camera.txt") && !error.contains('\n'), "{error}");
    error
}

fn assert_same(found: &Camera, expected: &Camera) {
    for (x, y) in [(0.1, -0.2), (-0.35, 0.3), (0.0, 0.0)] {
        let point = Point3::new(100.0 * x, 100.0 * y, 100.0);
        let away = found.project(&point).unwrap() - expected.project(&point).unwrap();
        assert!(away.norm() < SAME_PX, "{found:?}");
    }
}

fn assert_pose(found: Option<WorldPose>, world: &str, metric: bool) {
    let found = found.unwrap();
    assert_eq!((found.world.as_str(), found.metric), (world, metric));
    assert!((found.world_from_cam.origin() - pose().origin()).norm() < 1e-6);
    assert!((found.world_from_cam.rotation() - pose().rotation()).amax() < 1e-12);
}

fn quaternion_toml() -> String {
    let ([w, x, y, z], p) = (pose().quaternion_wxyz(), pose().origin());
    format!(
        "world = \"moon_me\"\nposition_m = [{}, {:?}, {}]\nworld_from_cam_quaternion = {{ qw = {w}, qx = {x}, qy = {y}, qz = {z} }}\n",
        p.x, p.y, p.z
    )
}

const LENS_TOML: &str = "distortion = { k1 = -0.1, k2 = 0.02, p1 = 1e-3, p2 = -2e-3 }\n";

#[test]
fn toml_in_both_pixel_conventions() {
    for (convention, offset) in [("corner", 0.0), ("center", PixelConvention::Center.to_corner_offset())] {
        let text = format!(
            "width_px = 640\nheight_px = 480\nfx_px = 700\nfy_px = 710.5\ncx_px = {}\ncy_px = {}\n\
             pixel_convention = \"{convention}\"\n{LENS_TOML}{}",
            311.25 - offset,
            245.75 - offset,
            quaternion_toml()
        );
        let found = read_text(&text).unwrap();
        assert_eq!((found.format, found.notes.len()), (CameraFormat::Toml, 0));
        assert_same(&found.camera, &camera());
        assert_pose(found.pose, "moon_me", true);
    }
    let short = read_text("fov_deg = 45.0").unwrap();
    assert_same(&short.camera, &Camera::from_fov(640, 480, 45f64.to_radians()).unwrap());
    assert!(short.pose.is_none() && short.notes.len() == 1);
    let square = read_text("fx = 700.0").unwrap();
    assert_eq!((square.camera.cx, square.camera.cy, square.camera.fy), (320.0, 240.0, 700.0));
}

#[test]
fn json_of_a_dataset_and_of_the_short_keys() {
    let k = camera().k(PixelConvention::Center);
    let ([qw, qx, qy, qz], p) = (pose().quaternion_wxyz(), pose().origin());
    let record = serde_json::json!({
        "format": "selenograph.camera", "version": 1, "view": "a",
        "k": [[k[(0, 0)], 0.0, k[(0, 2)]], [0.0, k[(1, 1)], k[(1, 2)]], [0.0, 0.0, 1.0]],
        "k_pixel_convention": "center",
        "sensor": {"width_px": 640, "height_px": 480, "width_mm": 6.4, "height_mm": 4.8, "focal_mm": 7.0},
        "distortion": camera().distortion, "world": "moon_me", "world_from_cam": pose().rows_3x4(),
        "position_m": [p.x, p.y, p.z],
        "world_from_cam_quaternion": {"qw": qw, "qx": qx, "qy": qy, "qz": qz}, "tilt_deg": 3.0,
    });
    let found = read_text(&record.to_string()).unwrap();
    assert_same(&found.camera, &camera());
    assert_pose(found.pose, "moon_me", true);
    let mut apart = record.clone();
    apart["position_m"][0] = 0.0.into();
    assert!(refused(&apart.to_string()).contains("agree"));
    let mut mirrored = record.clone();
    for column in 0..3 {
        mirrored["world_from_cam"][2][column] = (-pose().rotation()[(2, column)]).into();
    }
    assert!(refused(&mirrored.to_string()).contains("mirrored"));
    let mut newer = record;
    newer["version"] = 2.into();
    assert!(refused(&newer.to_string()).contains("version 2"));
    assert!(read_text("{\"fov_deg\": 45}").is_ok());
}

#[test]
fn colmap_lists_with_poses() {
    let cam_from_world = pose().inverse();
    let ([w, x, y, z], t) = (cam_from_world.quaternion_wxyz(), cam_from_world.origin());
    let (dir, path) = file(
        "cameras.txt",
        "# Camera list\n1 SIMPLE_PINHOLE 10 10 5 5 5\n7 OPENCV 640 480 700 710.5 311.25 245.75 -0.1 0.02 1e-3 -2e-3\n",
    );
    let images = format!(
        "# Image list\n3 1 0 0 0 0 0 0 1 other.png\n1 2 3\n4 {w} {x} {y} {z} {} {} {} 7 sub/b.png\n\n",
        t.x, t.y, t.z
    );
    assert!(read(&path, &SIZE).unwrap_err().to_string().contains("2 cameras"));
    std::fs::write(dir.path().join("images.txt"), images).unwrap();
    let found = read(&path, &SIZE.named("b.png")).unwrap();
    assert_same(&found.camera, &camera());
    // COLMAP's projection by its own formula: R X + t, then K, measured from the corner.
    let point_in_world = pose().point(&Point3::new(3.0, -4.0, 50.0));
    assert!((cam_from_world.point(&point_in_world) - Point3::new(3.0, -4.0, 50.0)).norm() < 1e-8);
    assert_pose(found.pose, "colmap", false);
    assert!(read(&path, &SIZE.named("c.png")).unwrap_err().to_string().contains("c.png"));
    for (line, fx, k1) in [
        ("1 SIMPLE_PINHOLE 640 480 700 320 240", 700.0, 0.0),
        ("1 PINHOLE 640 480 700 710 320 240", 700.0, 0.0),
        ("1 SIMPLE_RADIAL 640 480 700 320 240 -0.2", 700.0, -0.2),
        ("1 RADIAL 640 480 700 320 240 -0.2 0.1", 700.0, -0.2),
        ("1 FULL_OPENCV 640 480 700 710 320 240 -0.2 0 0 0 0.3 0 0 0", 700.0, -0.2),
    ] {
        let camera = read_text(line).unwrap().camera;
        assert_eq!((camera.fx, camera.distortion.k1, camera.cx), (fx, k1, 320.0), "{line}");
    }
    assert!(refused("1 THIN_PRISM_FISHEYE 640 480 1 2 3").contains("THIN_PRISM_FISHEYE"));
    assert!(refused("1 PINHOLE 640 480 700 710 320").contains("3 parameters"));
}

/// As `cv2.FileStorage` writes it; the projection is OpenCV's, measured from the first pixel's centre.
#[test]
fn opencv_and_ros_yaml() {
    let text = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n\
                dt: d\n   data: [ 700., 0., 310.75, 0., 710.5,\n       245.25, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n\
                rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.02, 1.0e-03, -2.0e-03, 0. ]\n";
    assert_same(&read_text(text).unwrap().camera, &camera());
    let ros = "image_width: 640\nimage_height: 480\ncamera_name: x\ncamera_matrix:\n  rows: 3\n  cols: 3\n\
               data: [700.0, 0.0, 310.75, 0.0, 710.5, 245.25, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob\n\
               distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.02, 0.001, -0.002, 0.0]\n";
    let found = read_text(ros).unwrap();
    assert_eq!(found.format, CameraFormat::OpenCv);
    assert_same(&found.camera, &camera());
    assert!(refused(&ros.replace("plumb_bob", "equidistant")).contains("equidistant"));
    assert!(refused(&ros.replace("-0.002, 0.0]", "-0.002, 0, 0.5]")).contains("6 coefficients"));
    assert!(refused(&ros.replace("700.0, 0.0,", "700.0, 2.0,")).contains("camera"));
    assert!(refused(&ros.replace("700.0", ".nan")).contains("focal"));
    assert!(refused("%YAML:1.0\nx: 1\n").contains("camera_matrix"));
}

#[test]
fn asp_pinhole() {
    let (r, c) = (pose().rotation(), pose().origin());
    let rows: Vec<String> = r.transpose().iter().map(f64::to_string).collect();
    // A pitch of 0.005 mm.
    let text = format!(
        "VERSION_4\nPINHOLE\nfu = {}\nfv = {}\ncu = {}\ncv = {}\nu_direction = 1 0 0\nv_direction = 0 1 0\n\
         w_direction = 0 0 1\nC = {} {} {}\nR = {}\npitch = 0.005\nTSAI\nk1 = -0.1\nk2 = 0.02\np1 = 0.001\np2 = -0.002\n",
        700.0 * 0.005,
        710.5 * 0.005,
        311.25 * 0.005,
        245.75 * 0.005,
        c.x,
        c.y,
        c.z,
        rows.join(" ")
    );
    let found = read_text(&text).unwrap();
    assert_eq!(found.format, CameraFormat::Asp);
    assert_same(&found.camera, &camera());
    assert_pose(found.pose, "body_fixed", true);
    assert!(refused(&text.replace("TSAI", "RPC")).contains("RPC"));
    assert!(refused(&text.replace("v_direction = 0 1 0", "v_direction = 0 -1 0")).contains("v_direction"));
    assert!(refused(&text.replace("pitch = 0.005", "")).contains("pitch"));
}

#[test]
fn cameras_that_cannot_be_are_refused_in_one_line() {
    for (text, word) in [
        ("", "empty"),
        ("hello", "hello"),
        ("fx_px = -700.0", "focal"),
        ("fx_px = nan", "focal"),
        ("fov_deg = 190.0", "field of view"),
        ("fov_deg = 45.0\nfx_px = 700.0", "both"),
        ("world = \"enu\"", "fx_px or fov_deg"),
        ("fx_px = 700.0\ncx_px = 3.0\ncy_px = 3.0", "pixel_convention"),
        ("fov_deg = 45.0\nposition_m = [0, 0, 0]", "quaternion"),
        ("fov_deg = 45.0\nworld_from_cam = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]", "world"),
        ("fov_deg = 45.0\nworld = \"enu\"\nworld_from_cam = [[1,0,0,0],[0,1,0,0],[0,0,-1,0]]", "mirrored"),
        ("fov_deg = 45.0\nworld = \"enu\"\nworld_from_cam = [[2,0,0,0],[0,1,0,0],[0,0,1,0]]", "identity"),
        ("fov_deg = 45.0\nfocal = 3", "focal"),
        ("fov_deg = 45.0\ndistortion = { k1 = inf }", "distortion"),
        ("fov_deg = ", "line 1"),
        ("{\"k\": 3}", "JSON"),
    ] {
        let error = refused(text);
        assert!(error.contains(word), "{text:?}: {error}");
    }
    let (dir, _) = file("x", "");
    assert!(matches!(read(&dir.path().join("none"), &SIZE), Err(Error::Io { .. })));
}

#[test]
fn another_size_is_refused_unless_the_picture_was_resized() {
    let (_dir, path) = file("camera.toml", "width_px = 640\nheight_px = 480\nfov_deg = 45.0");
    let half = PictureSize::new(320, 240);
    let error = read(&path, &half).unwrap_err();
    assert!(matches!(error, Error::CameraSize { in_proportion: true, .. }) && error.hint().is_some());
    let found = read(&path, &PictureSize { was_resized: true, ..half }).unwrap();
    let pixel = found.camera.project(&Point3::new(1.0, 2.0, 10.0)).unwrap();
    let full = read(&path, &SIZE).unwrap().camera.project(&Point3::new(1.0, 2.0, 10.0)).unwrap();
    assert!((pixel - Point2::new(full.x / 2.0, full.y / 2.0)).norm() < SAME_PX);
    let crop = PictureSize { was_resized: true, ..PictureSize::new(320, 320) };
    assert!(matches!(read(&path, &crop), Err(Error::CameraSize { in_proportion: false, .. })));
}
