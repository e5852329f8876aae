//! Pictures and cameras as they were named on the command line.

use crate::args::reconstruct::{Cameras, Reconstruct};
use crate::commands::network::builtin;
use crate::exit::refuse;
use selenograph_geometry::Camera;
use selenograph_raster::codec::picture::{PictureFile, read_picture};
use selenograph_reconstruct::View;
use selenograph_reconstruct::camera_file::{self, PictureSize};
use selenograph_reconstruct::evidence::FocalSource;
use selenograph_reconstruct::exif::{self, Exif};
use selenograph_reconstruct::pipeline::Reconstruction;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// The field of view that is assumed where nothing tells: that of the paper's camera, and an ordinary one.
const ASSUMED_FOV_DEG: f64 = 45.0;

/// Both pictures with their cameras.
pub struct Pictures {
    pub views: [View; 2],
    pub paths: [PathBuf; 2],
    /// Whether a camera was given, or told by the pictures themselves; else the views' cameras hold a guess.
    pub camera_known: bool,
    /// Where focal lengths come from that EXIF tells.
    pub told: Option<FocalSource>,
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
            &self.products.reference,
            &self.matches,
            &self.network.weights,
        ];
        let named = optional.into_iter().flatten().filter(|path| *path != Path::new(builtin::NAME)).cloned();
        [self.a.clone(), self.b.clone()].into_iter().chain(named.flat_map(whole)).collect()
    }
}

/// A file itself; of a folder (a COLMAP model) the files in it.
fn whole(path: PathBuf) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(&path) else { return vec![path] };
    let mut files: Vec<PathBuf> =
        entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    files.sort();
    files
}

/// Reads both pictures and finds their cameras.
///
/// # Errors
/// Files that are no pictures or no cameras; a picture of one grey level, or stored mirrored; a camera of another size than its
/// picture; one camera for two sizes.
pub fn read(args: &Reconstruct) -> anyhow::Result<Pictures> {
    let [a, b] = [&args.a, &args.b].map(|path| picture(path));
    let (a, b) = (a?, b?);
    let mut notes = Vec::new();
    let tags = [upright(&a, &mut notes)?, upright(&b, &mut notes)?];
    let found = cameras(&args.cameras, [&a, &b], tags, &mut notes)?;
    for file in [&a, &b] {
        let name = file.path.display();
        notes.extend(file.notes.iter().map(|note| format!("`{name}`: {note}")));
    }
    let [camera_a, camera_b] = found.cameras;
    Ok(Pictures {
        views: [View { image: a.grey, camera: camera_a }, View { image: b.grey, camera: camera_b }],
        paths: [args.a.clone(), args.b.clone()],
        camera_known: found.known,
        told: found.told,
        notes,
    })
}

/// What EXIF tells of a picture, and that it is not stored mirrored.
pub fn upright(file: &PictureFile, notes: &mut Vec<String>) -> anyhow::Result<Exif> {
    let tags = exif::read(&file.data_path)?.unwrap_or_default();
    let name = file.path.display();
    if tags.is_mirrored() {
        return Err(refuse(
            format!(
                "`{name}` is stored mirrored (EXIF orientation {}): no camera shows the world so",
                tags.orientation
            ),
            "store it upright, for example with `magick mogrify -auto-orient`",
        ));
    }
    notes.extend(tags.turned().map(|turned| format!("`{name}`: {turned}")));
    Ok(tags)
}

/// A picture with more than one grey level.
///
/// # Errors
/// A file that is no picture, or of one grey level.
pub fn picture(path: &Path) -> anyhow::Result<PictureFile> {
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

/// Cameras and where they come from.
struct Found {
    cameras: [Camera; 2],
    known: bool,
    told: Option<FocalSource>,
}

impl Found {
    fn given(cameras: [Camera; 2]) -> Self {
        Self { cameras, known: true, told: None }
    }
}

fn cameras(
    choice: &Cameras,
    files: [&PictureFile; 2],
    tags: [Exif; 2],
    notes: &mut Vec<String>,
) -> anyhow::Result<Found> {
    let named = [&choice.camera, &choice.camera_a].into_iter().any(Option::is_some);
    let is_given = named || choice.focal_px.or(choice.fov_deg).is_some();
    if !is_given && let Some(told) = told(tags, files, notes)? {
        return Ok(told);
    }
    let sizes = files.map(|file| [file.grey.width, file.grey.height]);
    let mut read = |path: &Path, k: usize| -> anyhow::Result<Camera> {
        let [width, height] = sizes[k];
        let file = camera_file::read(path, &PictureSize::new(width, height).at(&files[k].path))?;
        notes.extend(file.notes.iter().map(|note| format!("`{}`: {note}", path.display())));
        Ok(file.camera)
    };
    if let (Some(a), Some(b)) = (&choice.camera_a, &choice.camera_b) {
        return Ok(Found::given([read(a, 0)?, read(b, 1)?]));
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
        return Ok(Found::given([read(path, 0)?, read(path, 1)?]));
    }
    let (camera, known) = if let Some(focal_px) = choice.focal_px {
        let fov_rad = 2.0 * (width as f64 / (2.0 * focal_px)).atan();
        // A focal length that is none gives no field of view that is one.
        (Camera::from_fov(width, height, if focal_px > 0.0 { fov_rad } else { focal_px })?, true)
    } else {
        let fov_deg = choice.fov_deg.unwrap_or(ASSUMED_FOV_DEG);
        (Camera::from_fov(width, height, fov_deg.to_radians())?, choice.fov_deg.is_some())
    };
    Ok(Found { cameras: [camera.clone(), camera], known, told: None })
}

/// The cameras that EXIF tells; what only one of two pictures of one size tells is taken for both.
fn told(tags: [Exif; 2], files: [&PictureFile; 2], notes: &mut Vec<String>) -> anyhow::Result<Option<Found>> {
    let sizes = files.map(|file| [file.grey.width, file.grey.height]);
    let own = [0, 1].map(|k| tags[k].focal(sizes[k][0], sizes[k][1]));
    let other = |k: usize| own[1 - k].as_ref().filter(|_| sizes[0] == sizes[1]);
    let (Some(a), Some(b)) = (own[0].as_ref().or(other(0)), own[1].as_ref().or(other(1))) else {
        return Ok(None);
    };
    for (k, focal) in [a, b].into_iter().enumerate() {
        let whose = if own[k].is_some() { "EXIF" } else { "EXIF of the other picture" };
        let name = files[k].path.display();
        notes.push(format!("`{name}`: focal length {:.1} px: {whose} has {}", focal.focal_px[0], focal.how));
    }
    let source = FocalSource::Exif { focal_px: [a.focal_px[0], b.focal_px[0]] };
    let cameras = [a.camera(sizes[0][0], sizes[0][1])?, b.camera(sizes[1][0], sizes[1][1])?];
    Ok(Some(Found { cameras, known: true, told: Some(source) }))
}
