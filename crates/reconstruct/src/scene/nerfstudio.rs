//! nerfstudio's `transforms.json`.
//!
//! Poses lead from the camera to the world, with camera axes X right, Y up, Z backward (OpenGL's); pixels are measured from the
//! corner. `OPENCV` is its name of a pinhole with Brown's lens.
//!
//! # Source
//! nerfstudio's documentation, "Data conventions".

use super::{Scene, SceneView};
use crate::Error;
use serde_json::{Value, json};

/// The text of the file. `prefix` leads from its folder to that of the pictures (empty, or with a `/` at its end).
///
/// # Errors
/// [`Error::Value`] for numbers that JSON cannot hold.
pub fn transforms(scene: &Scene, prefix: &str) -> Result<String, Error> {
    let frames: Vec<Value> = scene.views.iter().map(|view| frame(view, prefix)).collect();
    let text = serde_json::to_string_pretty(&json!({ "camera_model": "OPENCV", "frames": frames }));
    text.map(|text| text + "\n").map_err(|e| Error::Value {
        key: "transforms",
        expected: "numbers that JSON can hold",
        found: e.to_string(),
    })
}

fn frame(view: &SceneView, prefix: &str) -> Value {
    let (camera, d) = (&view.camera, &view.camera.distortion);
    let [x, y, z] =
        view.world_from_cam.rows_3x4().map(|[right, down, forward, at]| [right, -down, -forward, at]);
    json!({
        "file_path": format!("{prefix}{}", view.name),
        "w": camera.width, "h": camera.height,
        "fl_x": camera.fx, "fl_y": camera.fy, "cx": camera.cx, "cy": camera.cy,
        "k1": d.k1, "k2": d.k2, "k3": d.k3, "p1": d.p1, "p2": d.p2,
        "transform_matrix": [x, y, z, [0.0, 0.0, 0.0, 1.0]],
    })
}
