//! Pictures and cameras as they were named on the command line.

use crate::args::reconstruct::{Cameras, Reconstruct};
use crate::commands::network::builtin;
use crate::exit::refuse;
use selenograph_geometry::Camera;
use selenograph_raster::codec::picture::{PictureFile, read_picture};
use selenograph_reconstruct::View;
use selenograph_reconstruct::camera_file::{self, PictureSize};
use selenograph_reconstruct::evidence::FocalSource;
use selenograph_reconstruct::pipeline::Reconstruction;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The field of view that is assumed where nothing tells: that of the paper's camera, and an ordinary one.
const ASSUMED_FOV_DEG: f64 = 45.0;

/// Both pictures with their cameras.
pub struct Pictures {
    pub views: [View; 2],
    pub paths: [PathBuf; 2],
    /// Whether a camera was given; else the views' cameras hold a guess.
    pub camera_known: bool,
    /// What had to be decided while reading.
    pub notes: Vec<String>,
}

impl Pictures {
    /// Columns and rows of each.
    pub fn sizes(&self) -> [[usize; 2]; 2] {
        self.views.each_ref().map(|view| [view.image.width, view.image.height])
    }
}

/// The cameras for the record.
#[derive(Serialize)]
pub struct CameraSummary {
    focal: FocalSource,
    /// `[fx, fy, cx, cy]` of each view, pixels from the corner.
    a_px: [f64; 4],
    b_px: [f64; 4],
}

impl CameraSummary {
    pub fn new(found: &Reconstruction) -> Self {
        let numbers = |camera: &Camera| [camera.fx, camera.fy, camera.cx, camera.cy];
        let [a, b] = &found.cameras;
        Self { focal: found.focal, a_px: numbers(a), b_px: numbers(b) }
    }
}

impl Reconstruct {
    /// Every file that is named.
    pub fn files(&self) -> Vec<PathBuf> {
        let (cameras, known) = (&self.cameras, &self.known);
        let optional = [
            &cameras.camera,
            &cameras.camera_a,
            &cameras.camera_b,
            &known.cam_b_from_cam_a,
            &known.world_from_cam_a,
            &known.world_from_cam_b,
            &known.dem,
            &known.points,
            &self.network.weights,
        ];
        let named = optional.into_iter().flatten().filter(|path| *path != Path::new(builtin::NAME)).cloned();
        [self.a.clone(), self.b.clone()].into_iter().chain(named).collect()
    }
}

/// Reads both pictures and finds their cameras.
///
/// # Errors
/// Files that are no pictures or no cameras; a picture of one grey level; a camera of another size than its picture; one camera
/// for two sizes.
pub fn read(args: &Reconstruct) -> anyhow::Result<Pictures> {
    let [a, b] = [&args.a, &args.b].map(|path| picture(path));
    let (a, b) = (a?, b?);
    let mut notes = Vec::new();
    let (cameras, camera_known) = cameras(&args.cameras, [&a, &b], &mut notes)?;
    for file in [&a, &b] {
        let name = file.path.display();
        notes.extend(file.notes.iter().map(|note| format!("`{name}`: {note}")));
    }
    let [camera_a, camera_b] = cameras;
    Ok(Pictures {
        views: [View { image: a.grey, camera: camera_a }, View { image: b.grey, camera: camera_b }],
        paths: [args.a.clone(), args.b.clone()],
        camera_known,
        notes,
    })
}

fn picture(path: &Path) -> anyhow::Result<PictureFile> {
    let file = read_picture(path)?;
    let levels = file.grey.data.iter().copied().filter(|level| level.is_finite());
    let (low, high) = levels.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    if low < high {
        return Ok(file);
    }
    let what = match low {
        0.0 => "all black".to_owned(),
        1.0 => "all white".to_owned(),
        level => format!("one grey level ({level}) everywhere"),
    };
    Err(refuse(
        format!("`{}` is {what}: nothing in it can be found in another picture", path.display()),
        "take a picture with light and shade; shadowed ground may need a longer exposure",
    ))
}

fn cameras(
    choice: &Cameras,
    files: [&PictureFile; 2],
    notes: &mut Vec<String>,
) -> anyhow::Result<([Camera; 2], bool)> {
    let sizes = files.map(|file| [file.grey.width, file.grey.height]);
    let mut read = |path: &Path, k: usize| -> anyhow::Result<Camera> {
        let name = files[k].path.file_name().map(|name| name.to_string_lossy().into_owned());
        let [width, height] = sizes[k];
        let size = PictureSize::new(width, height);
        let size = match &name {
            Some(name) => size.named(name),
            None => size,
        };
        let file = camera_file::read(path, &size)?;
        notes.extend(file.notes.iter().map(|note| format!("`{}`: {note}", path.display())));
        Ok(file.camera)
    };
    if let (Some(a), Some(b)) = (&choice.camera_a, &choice.camera_b) {
        return Ok(([read(a, 0)?, read(b, 1)?], true));
    }
    let [[width, height], other] = sizes;
    if [width, height] != other {
        return Err(refuse(
            format!(
                "the pictures have different sizes, {width}×{height} and {}×{}: they cannot be of one camera",
                other[0], other[1]
            ),
            "pass --camera-a and --camera-b",
        ));
    }
    if let Some(path) = &choice.camera {
        // A list of cameras may hold one for each picture.
        return Ok(([read(path, 0)?, read(path, 1)?], true));
    }
    let (camera, known) = if let Some(focal_px) = choice.focal_px {
        let fov_rad = 2.0 * (width as f64 / (2.0 * focal_px)).atan();
        // A focal length that is none gives no field of view that is one.
        (Camera::from_fov(width, height, if focal_px > 0.0 { fov_rad } else { focal_px })?, true)
    } else {
        let fov_deg = choice.fov_deg.unwrap_or(ASSUMED_FOV_DEG);
        (Camera::from_fov(width, height, fov_deg.to_radians())?, choice.fov_deg.is_some())
    };
    Ok(([camera.clone(), camera], known))
}
