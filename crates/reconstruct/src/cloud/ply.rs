//! PLY, binary little endian: f32 positions about an origin that the header states in a comment.
//!
//! # Source
//! Turk 1994, "The PLY polygon file format".

use super::{Cloud, CloudPoint};

/// Bytes of one point.
pub const POINT_BYTES: usize = 12 + 3 + 1 + 1 + 4 + 4;

/// The file's bytes.
pub fn encode(cloud: &Cloud) -> Vec<u8> {
    let header = header(cloud);
    let mut bytes = Vec::with_capacity(header.len() + POINT_BYTES * cloud.points.len());
    bytes.extend_from_slice(header.as_bytes());
    for point in &cloud.points {
        bytes.extend_from_slice(&record(point));
    }
    bytes
}

fn header(cloud: &Cloud) -> String {
    let [x, y, z] = cloud.origin;
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment selenograph\ncomment frame {}\ncomment metric {}\n\
         comment origin {x} {y} {z} (add it to every position)\n\
         comment view 0 = A, 1 = B; fill 1 = measured, 2 = completed; sigma along the ray, nan = not known\n\
         element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar view\nproperty uchar fill\n\
         property float confidence\nproperty float sigma\nend_header\n",
        cloud.frame,
        cloud.metric,
        cloud.points.len()
    )
}

#[inline]
fn record(point: &CloudPoint) -> [u8; POINT_BYTES] {
    let mut bytes = [0; POINT_BYTES];
    for (i, value) in point.position.iter().enumerate() {
        bytes[4 * i..4 * i + 4].copy_from_slice(&value.to_le_bytes());
    }
    bytes[12..15].copy_from_slice(&point.color);
    bytes[15] = point.view;
    bytes[16] = point.fill;
    bytes[17..21].copy_from_slice(&point.confidence.to_le_bytes());
    bytes[21..25].copy_from_slice(&point.sigma.to_le_bytes());
    bytes
}
