//! GLB (glTF 2.0, one binary file): points with colours, about a local origin.
//!
//! glTF has Y up and no coordinate system: a position is (x, height, −y) of the cloud, and `asset.extras` states the origin to
//! add and the frame. Confidence, sigma and view are application attributes (their names begin with an underscore).
//!
//! # Source
//! Khronos 2021, "glTF 2.0 Specification", §3.7.2 (meshes), §4.4 (GLB).

use super::Cloud;
use serde_json::{Value, json};

const FLOAT: u32 = 5126;
const UNSIGNED_BYTE: u32 = 5121;
const ARRAY_BUFFER: u32 = 34962;
const POINTS: u32 = 0;
/// Position, colour with alpha, confidence, sigma, view as a float (glTF allows no single bytes).
const STRIDE: usize = 12 + 4 + 4 + 4 + 4;

/// The file's bytes.
pub fn encode(cloud: &Cloud) -> Vec<u8> {
    let num_bytes = STRIDE * cloud.points.len();
    let mut text = json_chunk(cloud, num_bytes).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + num_bytes;
    let mut bytes = Vec::with_capacity(total);
    bytes.extend(b"glTF");
    bytes.extend(2u32.to_le_bytes());
    bytes.extend((total as u32).to_le_bytes());
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(text);
    bytes.extend((num_bytes as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    for point in &cloud.points {
        let [x, y, h] = point.position;
        let mut record = [0; STRIDE];
        for (i, value) in [x, h, -y].iter().enumerate() {
            record[4 * i..4 * i + 4].copy_from_slice(&value.to_le_bytes());
        }
        record[12..15].copy_from_slice(&point.color);
        record[15] = u8::MAX;
        // glTF forbids NaN: an unknown sigma is −1.
        let sigma = if point.sigma.is_finite() { point.sigma } else { -1.0 };
        for (i, value) in [point.confidence, sigma, f32::from(point.view)].iter().enumerate() {
            record[16 + 4 * i..20 + 4 * i].copy_from_slice(&value.to_le_bytes());
        }
        bytes.extend_from_slice(&record);
    }
    bytes
}

fn json_chunk(cloud: &Cloud, num_bytes: usize) -> Value {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for point in &cloud.points {
        let [x, y, h] = point.position;
        for (axis, value) in [x, h, -y].into_iter().enumerate() {
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
    }
    let accessor = |offset: usize, component: u32, shape: &str| {
        json!({"bufferView": 0, "byteOffset": offset, "componentType": component, "type": shape,
               "count": cloud.points.len()})
    };
    let mut position = accessor(0, FLOAT, "VEC3");
    position["min"] = json!(low);
    position["max"] = json!(high);
    let mut color = accessor(12, UNSIGNED_BYTE, "VEC4");
    color["normalized"] = json!(true);
    json!({
        "asset": {
            "version": "2.0",
            "generator": "selenograph",
            "extras": {
                "frame": cloud.frame,
                "metric": cloud.metric,
                "origin_x_y_height": cloud.origin,
                "axes": "glTF (X, Y, Z) = (x, height, -y)",
                "attributes": "_CONFIDENCE in 0..1; _SIGMA along the ray, -1 where not known; _VIEW 0 = A, 1 = B"
            }
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "cloud"}],
        "meshes": [{"primitives": [{"mode": POINTS, "attributes":
            {"POSITION": 0, "COLOR_0": 1, "_CONFIDENCE": 2, "_SIGMA": 3, "_VIEW": 4}}]}],
        "accessors": [position, color, accessor(16, FLOAT, "SCALAR"), accessor(20, FLOAT, "SCALAR"),
                      accessor(24, FLOAT, "SCALAR")],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": num_bytes, "byteStride": STRIDE,
                         "target": ARRAY_BUFFER}],
        "buffers": [{"byteLength": num_bytes}]
    })
}
