use super::super::tests::{SIZE, assert_pose, assert_same, camera, file, pose, read_text, refused};
use super::super::{PictureSize, read};
use selenograph_geometry::{Point3, Rigid3};

const CAMERAS: &str = "# Camera list\n1 SIMPLE_PINHOLE 10 10 5 5 5\n7 OPENCV 640 480 700 710.5 311.25 245.75 -0.1 0.02 1e-3 -2e-3\n";

/// The pose as a line of `images.txt` has it, up to the name.
fn image_line() -> String {
    let cam_from_world = pose().inverse();
    let ([w, x, y, z], t) = (cam_from_world.quaternion_wxyz(), cam_from_world.origin());
    format!("4 {w} {x} {y} {z} {} {} {} 7", t.x, t.y, t.z)
}

fn at(path: &str) -> PictureSize<'_> {
    SIZE.at(std::path::Path::new(path))
}

#[test]
fn lists_with_poses() {
    let (dir, path) = file("cameras.txt", CAMERAS);
    assert!(read(&path, &SIZE).unwrap_err().to_string().contains("2 cameras"));
    let images =
        format!("\n# Image list\n\n3 1 0 0 0 0 0 0 1 other.png\n1 2 3\n\n{} sub/b c.png\n\n\n", image_line());
    std::fs::write(dir.path().join("images.txt"), images).unwrap();
    for named in [dir.path().to_owned(), path.clone()] {
        let found = read(&named, &at("x/sub/b c.png")).unwrap();
        assert_same(&found.camera, &camera());
        assert_pose(found.pose, "colmap", false);
        assert_eq!(found.notes.len(), 1);
    }
    // COLMAP's projection by its own formula: R X + t, then K, measured from the corner.
    let cam_from_world = pose().inverse();
    let point_in_world = pose().point(&Point3::new(3.0, -4.0, 50.0));
    assert!((cam_from_world.point(&point_in_world) - Point3::new(3.0, -4.0, 50.0)).norm() < 1e-8);
    assert!(read(&path, &at("c.png")).unwrap_err().to_string().contains("c.png"));
}

#[test]
fn lists_of_images_that_cannot_be_are_refused_by_their_own_name() {
    let (dir, path) = file("cameras.txt", "1 PINHOLE 640 480 700 700 320 240\n");
    for (images, word) in [
        ("1 2 0 0 0 0 0 0 1 a.png\n\n", "length 2"),
        ("1 0.9 0.3 0 0 0 0 0 1 a.png\n\n", "quaternion"),
        ("1 1 0 0 0 0 0 0 9 a.png\n\n", "camera 9"),
        ("1 1 0 0 0 0 0 nan 1 a.png\n\n", "finite"),
        ("1 1 0 0 x 0 0 0 1 a.png\n\n", "qw qx"),
        ("1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b.png\n", "points of `a.png`"),
        ("1 1 0 0 0 0 0 0 1 l/a.png\n\n2 1 0 0 0 0 0 0 1 r/a.png\n\n", "equally well"),
    ] {
        std::fs::write(dir.path().join("images.txt"), images).unwrap();
        let error = read(&path, &at("a.png")).unwrap_err().to_string();
        assert!(error.contains(word) && error.contains("images.txt") && !error.contains('\n'), "{error}");
    }
}

#[test]
fn models_are_computed_or_refused_by_name() {
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
    for model in super::MODELS.iter().filter(|m| m.name.contains("FISHEYE") || m.id > 6) {
        let line = format!("1 {} 640 480{}", model.name, " 1".repeat(model.num_params));
        assert!(refused(&line).contains(model.name));
    }
    assert!(refused("1 FULL_OPENCV 640 480 700 710 320 240 0 0 0 0 0 0 0 0.1").contains("k6"));
    assert!(refused("1 THIN_PRISM_FISHEYE 640 480 1 2 3").contains("3 parameters"));
    assert!(refused("1 PINHOLE 640 480 700 710 320").contains("3 parameters"));
    assert!(refused("1 PINHOLE2 640 480 700 710 320 1").contains("PINHOLE2"));
}

fn binary(dir: &std::path::Path, names: &[(&str, u32, Rigid3<super::super::BodyFixed, super::super::Cam>)]) {
    let mut cameras = 2u64.to_le_bytes().to_vec();
    for (id, model, size, params) in [
        (1u32, 0i32, [10u64, 10], vec![5.0f64, 5.0, 5.0]),
        (7, 4, [640, 480], vec![700.0, 710.5, 311.25, 245.75, -0.1, 0.02, 1e-3, -2e-3]),
    ] {
        cameras.extend(id.to_le_bytes());
        cameras.extend(model.to_le_bytes());
        cameras.extend(size.iter().flat_map(|side| side.to_le_bytes()));
        cameras.extend(params.iter().flat_map(|value| value.to_le_bytes()));
    }
    let mut images = (names.len() as u64).to_le_bytes().to_vec();
    for (name, camera_id, world_from_cam) in names {
        let cam_from_world = world_from_cam.inverse();
        images.extend(9u32.to_le_bytes());
        let t = cam_from_world.origin();
        let numbers = cam_from_world.quaternion_wxyz().into_iter().chain([t.x, t.y, t.z]);
        images.extend(numbers.flat_map(f64::to_le_bytes));
        images.extend(camera_id.to_le_bytes());
        images.extend(name.as_bytes());
        images.push(0);
        images.extend(2u64.to_le_bytes());
        images.extend([7; 48]);
    }
    std::fs::write(dir.join("cameras.bin"), cameras).unwrap();
    std::fs::write(dir.join("images.bin"), images).unwrap();
}

#[test]
fn binary_lists() {
    let dir = tempfile::tempdir().unwrap();
    let other = Rigid3::identity();
    binary(dir.path(), &[("left/1.png", 1, other), ("right/1.png", 7, pose())]);
    let path = dir.path().join("cameras.bin");
    let found = read(&path, &at("right/1.png")).unwrap();
    assert_same(&found.camera, &camera());
    assert_pose(found.pose, "colmap", false);
    assert!(read(dir.path(), &at("right/1.png")).is_ok());
    // Known by its bytes too.
    let renamed = dir.path().join("model");
    std::fs::copy(&path, &renamed).unwrap();
    assert!(read(&renamed, &at("right/1.png")).is_ok());
    let images = dir.path().join("images.bin");
    let whole = std::fs::read(&images).unwrap();
    let refused = |path: &std::path::Path| read(path, &at("right/1.png")).unwrap_err().to_string();
    for length in [0, 7, 20, 100, whole.len() - 1] {
        std::fs::write(&images, &whole[..length]).unwrap();
        assert!(refused(&path).contains("images.bin"), "{length}: {}", refused(&path));
    }
    let cameras = std::fs::read(&path).unwrap();
    std::fs::write(&path, &cameras[..cameras.len() - 3]).unwrap();
    assert!(refused(&path).contains("its end inside"));
    std::fs::write(&path, [&u64::MAX.to_le_bytes()[..], &cameras[8..]].concat()).unwrap();
    assert!(refused(&path).contains("its end inside"));
}
