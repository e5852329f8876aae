use super::super::CameraFormat;
use super::super::tests::{assert_same, camera, read_text, refused};

/// As `cv2.FileStorage` writes it; the projection is OpenCV's, measured from the first pixel's centre.
const STORAGE: &str = "%YAML:1.0\n---\ncalibration_time: \"Sat 01 Jan 2022 10:11:12\"\nimage_width: 640\nimage_height: 480\n\
    flags: 0 # none: !!x\nfisheye_model: 0\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 700., 0., 310.75, 0., 710.5,\n       \
    245.25, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ -0.1, 0.02, 1.0e-03, -2.0e-03, 0. ]\n";

const ROS: &str = "image_width: 640\nimage_height: 480\ncamera_name: x\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
    data: [700.0, 0.0, 310.75, 0.0, 710.5, 245.25, 0.0, 0.0, 1.0]\ndistortion_model: plumb_bob  # by ROS\n\
    distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.02, 0.001, -0.002, 0.0]\n";

#[test]
fn opencv_yaml_xml_and_json() {
    let xml = "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_Width>640</image_Width>\n<image_Height>480</image_Height>\n\
        <Camera_Matrix type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  <cols>3</cols>\n  <dt>d</dt>\n  <data>\n    700. 0. 310.75 0. 710.5 245.25 0. 0.\n    1.</data></Camera_Matrix>\n\
        <Distortion_Coefficients type_id=\"opencv-matrix\"><rows>5</rows><cols>1</cols><dt>d</dt><data>\n -1.0e-01 0.02 1e-3 -2e-3 0.</data></Distortion_Coefficients>\n</opencv_storage>\n";
    let json = "{\n  \"image_width\": 640, \"image_height\": 480,\n  \"camera_matrix\": {\"type_id\": \"opencv-matrix\", \"rows\": 3, \"cols\": 3, \"dt\": \"d\", \
        \"data\": [700.0, 0.0, 310.75, 0.0, 710.5, 245.25, 0.0, 0.0, 1.0]},\n  \"dist_coeffs\": [-0.1, 0.02, 0.001, -0.002]\n}\n";
    for text in [STORAGE, xml, json] {
        let found = read_text(text).unwrap();
        assert_eq!((found.format, found.notes.len()), (CameraFormat::OpenCv, 0));
        assert_same(&found.camera, &camera());
    }
    assert!(refused("<?xml version=\"1.0\"?><kml/>").contains("kml"));
    assert!(
        refused("<opencv_storage><image_width>3</image_width></opencv_storage>").contains("camera_matrix")
    );
    assert!(refused("<opencv_storage>").contains("expected"));
    assert!(refused("%YAML:1.0\nx: 1\n").contains("camera_matrix"));
    assert!(refused("K: [1, 2").contains("YAML"));
}

#[test]
fn ros_files_and_printed_messages() {
    let found = read_text(ROS).unwrap();
    assert_eq!(found.format, CameraFormat::OpenCv);
    assert_same(&found.camera, &camera());
    let ros1 = "header: \n  seq: 12\n  stamp: \n    secs: 1\n    nsecs: 2\n  frame_id: \"cam\"\nheight: 480\nwidth: 640\ndistortion_model: \"plumb_bob\"\n\
        D: [-0.1, 0.02, 0.001, -0.002, 0.0]\nK: [700.0, 0.0, 310.75, 0.0, 710.5, 245.25, 0.0, 0.0, 1.0]\nR: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n\
        P: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]\nbinning_x: 0\nbinning_y: 0\nroi: \n  x_offset: 0\n  height: 0\n  width: 0\n  do_rectify: False\n---\n";
    let list = |numbers: &str| numbers.split(' ').map(|n| format!("- {n}\n")).collect::<String>();
    let ros2 = format!(
        "header:\n  stamp:\n    sec: 1\n  frame_id: cam\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\nd:\n{}k:\n{}r:\n{}roi:\n  height: 0\n  width: 0\n---\n",
        list("-0.1 0.02 0.001 -0.002 0.0"),
        list("700.0 0.0 310.75 0.0 710.5 245.25 0.0 0.0 1.0"),
        list("1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0"),
    );
    for text in [ros1, &ros1.repeat(3), &ros2, &ros2.repeat(2), ros2.trim_end_matches("---\n")] {
        assert_same(&read_text(text).unwrap().camera, &camera());
    }
    let other = ros1.replace("K: [700.0", "K: [701.0");
    assert!(refused(&format!("{ros1}{other}")).contains("differ"));
    assert!(
        refused(&ros1.replace(
            "K: [700.0, 0.0, 310.75, 0.0, 710.5, 245.25, 0.0, 0.0, 1.0]",
            "K: [0, 0, 0, 0, 0, 0, 0, 0, 0]"
        ))
        .contains("zeros")
    );
    assert!(refused(&ros1.replace("width: 640", "width: wide")).contains("wide"));
}

#[test]
fn lenses_that_cannot_be_computed_are_refused_by_name() {
    for model in ["equidistant", "fisheye", "kannala_brandt", "division"] {
        assert!(refused(&ROS.replace("plumb_bob", model)).contains(model));
    }
    assert!(refused(&STORAGE.replace("fisheye_model: 0", "fisheye_model: 1")).contains("fisheye_model"));
    assert!(refused(&STORAGE.replace("fisheye_model: 0", "xi: 1.2")).contains("omnidirectional"));
    let with = |tail: &str| ROS.replace("-0.002, 0.0]", &format!("-0.002, 0.0, {tail}]"));
    assert!(refused(&with("0, 0.5, 0")).contains("rational_polynomial"));
    assert!(refused(&with("0, 0, 0, 0, 1e-3, 0, 0")).contains("thin prism"));
    assert!(refused(&with("0, 0, 0, 0, 0, 0, 0, 0, 0.1")).contains("tilted"));
    assert!(refused(&with("0.5")).contains("6 coefficients"));
    let rational = with("0, 0, 0").replace("plumb_bob", "rational_polynomial");
    assert_same(&read_text(&rational).unwrap().camera, &camera());
    assert!(refused(&ROS.replace("700.0, 0.0,", "700.0, 2.0,")).contains("camera"));
    let nan = refused(&ROS.replace("700.0", ".nan"));
    assert!(nan.contains("focal") || nan.contains(".nan"), "{nan}");
    assert!(refused(&ROS.replace("700.0", "wide")).contains("wide"));
}

/// An alias that doubles itself would fill the memory, and brackets the stack.
#[test]
fn hostile_yaml_is_refused() {
    let mut bomb = String::from("camera_matrix: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n");
    for k in 1..12 {
        let before = k - 1;
        bomb += &format!("x{k}: &a{k} [{}]\n", vec![format!("*a{before}"); 10].join(", "));
    }
    assert!(refused(&bomb).contains("expected"));
    assert!(refused(&format!("camera_matrix: {}", "[".repeat(100_000))).contains("expected"));
}
