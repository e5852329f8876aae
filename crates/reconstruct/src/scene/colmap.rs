//! COLMAP's model: cameras, images and points with their tracks, as text and as binary files.
//!
//! Both hold the same numbers. Pixels are measured from the corner, poses are `cam_from_world`, numbers of cameras, images and
//! points begin with 1.
//!
//! # Source
//! COLMAP's documentation, "Output format".

use super::Scene;
use crate::camera_file::colmap::models::{FULL_OPENCV, Model, OPENCV, PINHOLE};
use selenograph_geometry::{Camera, Point2};
use std::fmt::Write as _;

/// A file's name and its bytes.
pub type File = (&'static str, Vec<u8>);

/// A pixel and the number of its point.
type Observation = (Point2<f64>, u64);

/// A scene by COLMAP's numbers.
struct Numbered<'a> {
    scene: &'a Scene,
    cameras: Vec<&'a Camera>,
    /// Position of each view's camera in `cameras`.
    camera_of: Vec<usize>,
    /// What each view sees.
    seen: Vec<Vec<Observation>>,
    /// The track of each point, as image and position among what it sees.
    tracks: Vec<Vec<(usize, usize)>>,
}

/// The six files of a model.
pub fn files(scene: &Scene) -> [File; 6] {
    let model = Numbered::new(scene);
    [
        ("cameras.txt", model.cameras_text().into_bytes()),
        ("images.txt", model.images_text().into_bytes()),
        ("points3D.txt", model.points_text().into_bytes()),
        ("cameras.bin", model.cameras_binary()),
        ("images.bin", model.images_binary()),
        ("points3D.bin", model.points_binary()),
    ]
}

/// The simplest model that holds a camera exactly, and its parameters.
fn parameters(camera: &Camera) -> (&'static Model, Vec<f64>) {
    let d = &camera.distortion;
    let pinhole = [camera.fx, camera.fy, camera.cx, camera.cy];
    if d.is_none() {
        (&PINHOLE, pinhole.to_vec())
    } else if d.k3 == 0.0 {
        (&OPENCV, pinhole.into_iter().chain([d.k1, d.k2, d.p1, d.p2]).collect())
    } else {
        (&FULL_OPENCV, pinhole.into_iter().chain([d.k1, d.k2, d.p1, d.p2, d.k3, 0.0, 0.0, 0.0]).collect())
    }
}

impl<'a> Numbered<'a> {
    fn new(scene: &'a Scene) -> Self {
        let mut cameras: Vec<&Camera> = Vec::new();
        let camera_of = scene.views.iter().map(|view| {
            cameras.iter().position(|camera| **camera == view.camera).unwrap_or_else(|| {
                cameras.push(&view.camera);
                cameras.len() - 1
            })
        });
        let camera_of = camera_of.collect();
        let mut seen: Vec<Vec<Observation>> = vec![Vec::new(); scene.views.len()];
        let tracks = scene.points.iter().zip(1..).map(|(point, id)| {
            let track = point.track.iter().map(|&(view, at)| {
                seen[view].push((at, id));
                (view, seen[view].len() - 1)
            });
            track.collect()
        });
        let tracks = tracks.collect();
        Self { scene, cameras, camera_of, seen, tracks }
    }

    fn cameras_text(&self) -> String {
        let mut text = String::from(
            "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n",
        );
        for (camera, id) in self.cameras.iter().zip(1..) {
            let (model, params) = parameters(camera);
            let _ =
                writeln!(text, "{id} {} {} {} {}", model.name, camera.width, camera.height, joined(&params));
        }
        text
    }

    fn images_text(&self) -> String {
        let mut text = String::from(
            "# Image list with two lines of data per image:\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n\
             #   POINTS2D[] as (X, Y, POINT3D_ID)\n",
        );
        for (idx, view) in self.scene.views.iter().enumerate() {
            let numbers = joined(&self.pose(idx));
            let _ = writeln!(text, "{} {numbers} {} {}", idx + 1, self.camera_of[idx] + 1, view.name);
            let points = self.seen[idx].iter().map(|(at, id)| format!("{} {} {id}", at.x, at.y));
            let _ = writeln!(text, "{}", points.collect::<Vec<_>>().join(" "));
        }
        text
    }

    fn points_text(&self) -> String {
        let mut text = String::from(
            "# 3D point list with one line of data per point:\n\
             #   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n",
        );
        for ((point, track), id) in self.scene.points.iter().zip(&self.tracks).zip(1..) {
            let (p, grey) = (&point.place, point.grey);
            let _ = write!(text, "{id} {} {} {} {grey} {grey} {grey} {}", p.x, p.y, p.z, point.error_px);
            for (view, at) in track {
                let _ = write!(text, " {} {at}", view + 1);
            }
            text.push('\n');
        }
        text
    }

    fn cameras_binary(&self) -> Vec<u8> {
        let mut bytes = (self.cameras.len() as u64).to_le_bytes().to_vec();
        for (camera, id) in self.cameras.iter().zip(1u32..) {
            let (model, params) = parameters(camera);
            bytes.extend(id.to_le_bytes());
            bytes.extend(model.id.to_le_bytes());
            bytes.extend(
                [camera.width, camera.height].into_iter().flat_map(|side| (side as u64).to_le_bytes()),
            );
            bytes.extend(params.into_iter().flat_map(f64::to_le_bytes));
        }
        bytes
    }

    fn images_binary(&self) -> Vec<u8> {
        let mut bytes = (self.scene.views.len() as u64).to_le_bytes().to_vec();
        for (idx, view) in self.scene.views.iter().enumerate() {
            bytes.extend((idx as u32 + 1).to_le_bytes());
            bytes.extend(self.pose(idx).into_iter().flat_map(f64::to_le_bytes));
            bytes.extend((self.camera_of[idx] as u32 + 1).to_le_bytes());
            bytes.extend(view.name.as_bytes());
            bytes.push(0);
            bytes.extend((self.seen[idx].len() as u64).to_le_bytes());
            for (at, id) in &self.seen[idx] {
                bytes.extend([at.x, at.y].into_iter().flat_map(f64::to_le_bytes));
                bytes.extend(id.to_le_bytes());
            }
        }
        bytes
    }

    fn points_binary(&self) -> Vec<u8> {
        let mut bytes = (self.scene.points.len() as u64).to_le_bytes().to_vec();
        for ((point, track), id) in self.scene.points.iter().zip(&self.tracks).zip(1u64..) {
            bytes.extend(id.to_le_bytes());
            bytes.extend(point.place.iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend([point.grey; 3]);
            bytes.extend(point.error_px.to_le_bytes());
            bytes.extend((track.len() as u64).to_le_bytes());
            bytes.extend(
                track
                    .iter()
                    .flat_map(|(view, at)| [*view as u32 + 1, *at as u32].map(u32::to_le_bytes))
                    .flatten(),
            );
        }
        bytes
    }

    /// `qw qx qy qz tx ty tz` of `cam_from_world`.
    fn pose(&self, view: usize) -> [f64; 7] {
        let cam_from_world = self.scene.views[view].world_from_cam.inverse();
        let ([w, x, y, z], t) = (cam_from_world.quaternion_wxyz(), cam_from_world.origin());
        [w, x, y, z, t.x, t.y, t.z]
    }
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}
