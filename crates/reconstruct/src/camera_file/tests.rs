use super::*;
use selenograph_geometry::{Distortion, PixelConvention, Point2, Rotation3};
use std::path::PathBuf;

pub(super) const SIZE: PictureSize = PictureSize { width: 640, height: 480, path: None, was_resized: false };

/// Digits written in files keep projections to this.
const SAME_PX: f64 = 1e-9;

pub(super) fn camera() -> Camera {
    let k = selenograph_geometry::Matrix3::new(700.0, 0.0, 311.25, 0.0, 710.5, 245.75, 0.0, 0.0, 1.0);
    let lens = Distortion { k1: -0.1, k2: 0.02, p1: 1e-3, p2: -2e-3, k3: 0.0 };
    Camera::from_k(640, 480, &k, PixelConvention::Corner).unwrap().with_distortion(lens)
}

pub(super) fn pose() -> Rigid3<BodyFixed, Cam> {
    Rigid3::new(Rotation3::from_euler_angles(2.9, 0.2, -0.7), Point3::new(1.7e6, -320.0, 45.5))
}

pub(super) fn file(name: &str, text: &str) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    std::fs::write(&path, text).unwrap();
    (dir, path)
}

pub(super) fn read_text(text: &str) -> Result<CameraFile, Error> {
    let (_dir, path) = file("camera.txt", text);
    read(&path, &SIZE)
}

pub(super) fn refused(text: &str) -> String {
    let error = read_text(text).unwrap_err().to_string();
    assert!(error.contains("camera.txt") && !error.contains('\n'), "{error}");
    error
}

pub(super) fn assert_same(found: &Camera, expected: &Camera) {
    for (x, y) in [(0.1, -0.2), (-0.35, 0.3), (0.0, 0.0)] {
        let point = Point3::new(100.0 * x, 100.0 * y, 100.0);
        let away = found.project(&point).unwrap() - expected.project(&point).unwrap();
        assert!(away.norm() < SAME_PX, "{found:?}");
    }
}

pub(super) fn assert_pose(found: Option<WorldPose>, world: &str, metric: bool) {
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

/// A pitch of 0.005 mm; the principal point is measured from the first pixel's centre.
fn tsai() -> String {
    let (r, c) = (pose().rotation(), pose().origin());
    let rows: Vec<String> = r.transpose().iter().map(f64::to_string).collect();
    format!(
        "VERSION_4\nPINHOLE\nfu = {}\nfv = {}\ncu = {}\ncv = {}\nu_direction = 1 0 0\nv_direction = 0 1 0\n\
         w_direction = 0 0 1\nC = {} {} {}\nR = {}\npitch = 0.005\nTSAI\nk1 = -0.1\nk2 = 0.02\np1 = 0.001\np2 = -0.002\n",
        700.0 * 0.005,
        710.5 * 0.005,
        310.75 * 0.005,
        245.25 * 0.005,
        c.x,
        c.y,
        c.z,
        rows.join(" ")
    )
}

#[test]
fn asp_pinhole() {
    let text = tsai();
    let found = read_text(&text).unwrap();
    assert_eq!(found.format, CameraFormat::Asp);
    assert_same(&found.camera, &camera());
    assert_pose(found.pose, "body_fixed", true);
    for lens in ["RPC5", "BrownConrady", "Photometrix", "AdjustableTSAI", "FISHEYE"] {
        assert!(refused(&text.replace("TSAI", lens)).contains(lens));
    }
    assert!(refused(&text.replace("v_direction = 0 1 0", "v_direction = 0 -1 0")).contains("v_direction"));
    assert!(refused(&text.replace("pitch = 0.005", "")).contains("pitch"));
    assert!(refused(&text.replace("TSAI\n", "")).contains("name of a lens"));
    assert!(refused(&text.replace("VERSION_4", "VERSION_5")).contains("VERSION_5"));
    assert!(refused(&text.replace("PINHOLE", "OPTICAL_BAR")).contains("OPTICAL_BAR"));
    // Camera axes with Y up and the view along −Z, turned in R as well.
    let turned = text
        .replace("v_direction = 0 1 0", "v_direction = 0 -1 0")
        .replace("w_direction = 0 0 1", "w_direction = 0 0 -1");
    let line = turned.lines().find(|line| line.starts_with("R = ")).unwrap();
    let r: Vec<f64> = line[4..].split(' ').map(|word| word.parse().unwrap()).collect();
    let flipped: Vec<String> =
        r.iter().enumerate().map(|(i, v)| if i % 3 == 0 { *v } else { -v }.to_string()).collect();
    let found = read_text(&turned.replace(line, &format!("R = {}", flipped.join(" ")))).unwrap();
    assert_pose(found.pose, "body_fixed", true);
}

#[test]
fn asp_pinhole_of_before_version_4() {
    let text = tsai();
    let version_3 = text.replace("VERSION_4\nPINHOLE\n", "VERSION_3\n");
    let version_2 = text.replace("VERSION_4\nPINHOLE\n", "VERSION_2\n").replace("TSAI\n", "");
    let version_1 = version_2.replace("VERSION_2\n", "");
    for text in [&version_3, &version_2, &version_1] {
        let found = read_text(text).unwrap();
        assert_same(&found.camera, &camera());
        assert_pose(found.pose, "body_fixed", true);
    }
    let plain = "fu = 60\nfv = 60\ncu = 16\ncv = 16\nu_direction = 1 0 0\nv_direction = 0 1 0\nw_direction = 0 0 1\n\
                 C = 1 2 3\nR = 1 0 0 0 1 0 0 0 1\nk1 = -0.33\nk2 = 0.12\np1 = 0.001\np2 = 0.002\n";
    let found = read_text(plain).unwrap();
    let camera = &found.camera;
    assert_eq!(
        (camera.fx, camera.cx, camera.distortion.k1, camera.distortion.p2),
        (60.0, 16.5, -0.33, 0.002)
    );
    assert!(found.notes.iter().any(|note| note.contains("pitch")));
    assert!(refused(&version_3.replace("pitch = 0.005\n", "")).contains("pitch"));
    assert!(refused(&plain.replace("k1 = -0.33\n", "")).contains("k1"));
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
