//! Pictures, cameras and Suns as they were named on the command line.

use crate::args::reconstruct::SunGiven;
use crate::args::refine::Refine;
use crate::commands::reconstruct::inputs::{picture, upright};
use crate::commands::reconstruct::known::{body, place};
use crate::exit::refuse;
use selenograph_geometry::{Body, BodyFixed, Cam, Rigid3, Vector3};
use selenograph_reconstruct::View;
use selenograph_reconstruct::camera_file::{self, PictureSize};
use selenograph_reconstruct::refine::PlacedPicture;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Pictures with all that is known of them.
pub struct Pictures {
    pub placed: Vec<PlacedPicture>,
    pub paths: Vec<PathBuf>,
    pub suns: Vec<SunRecord>,
    /// What had to be decided while reading.
    pub notes: Vec<String>,
}

/// A Sun for the record.
#[derive(Debug, Clone, Serialize)]
pub struct SunRecord {
    /// Unit vector towards it in the body's axes.
    direction: [f64; 3],
    /// Azimuth from north and elevation at the ground below the first camera, degrees.
    azimuth_deg: f64,
    elevation_deg: f64,
}

/// Reads all pictures and finds their places.
///
/// # Errors
/// Not one camera and one Sun for each picture; files that are none; a picture of one grey level; a camera without a place, or on
/// another body than the elevation model.
pub fn read(args: &Refine, dem_body: &Body) -> anyhow::Result<Pictures> {
    let count = args.pictures.len();
    for (option, what, found) in
        [("--camera", "cameras", args.cameras.len()), ("--sun", "Suns", args.suns.len())]
    {
        if found != count {
            return Err(refuse(
                format!("{count} pictures and {found} {what}: expected one for each"),
                format!("give {option} once for each picture, in their order"),
            ));
        }
    }
    let mut pictures =
        Pictures { placed: Vec::new(), paths: args.pictures.clone(), suns: Vec::new(), notes: Vec::new() };
    let mut seen = Vec::with_capacity(count);
    for (path, camera) in args.pictures.iter().zip(&args.cameras) {
        seen.push(view(path, camera, dem_body, args, &mut pictures.notes)?);
    }
    let first = seen.first().map_or_else(Rigid3::identity, |(_, pose)| *pose);
    for ((view, body_from_cam), given) in seen.into_iter().zip(&args.suns) {
        let sun = sun(*given, dem_body, &first, &body_from_cam);
        pictures.suns.push(SunRecord::new(&sun, dem_body, &first));
        pictures.placed.push(PlacedPicture { view, body_from_cam, sun, sun_sigma_rad: 0.0 });
    }
    Ok(pictures)
}

/// A picture, its camera and where that stands on the body.
fn view(
    path: &Path,
    camera: &Path,
    dem_body: &Body,
    args: &Refine,
    notes: &mut Vec<String>,
) -> anyhow::Result<(View, Rigid3<BodyFixed, Cam>)> {
    let file = picture(path)?;
    upright(&file, notes)?;
    notes.extend(file.notes.iter().map(|note| format!("`{}`: {note}", path.display())));
    let size = PictureSize::new(file.grey.width, file.grey.height).at(path);
    let read = camera_file::read(camera, &size)?;
    notes.extend(read.notes.iter().map(|note| format!("`{}`: {note}", camera.display())));
    let (intrinsics, pose) = (read.camera.clone(), place(camera, read)?);
    let Some(own) = body(&pose.world) else {
        return Err(refuse(
            format!(
                "`{}` has its place in the world `{}`: expected one on a body",
                camera.display(),
                pose.world
            ),
            format!("the world of a camera over this elevation model is `{}`", dem_body.frame),
        ));
    };
    dem_body.same_sphere(
        format_args!("`{}`", args.dem.display()),
        &own,
        format_args!("the world `{}` of `{}`", own.frame, camera.display()),
    )?;
    Ok((View { image: file.grey, camera: intrinsics }, pose.world_from_cam))
}

/// Unit vector to a Sun in the body's axes.
fn sun(
    given: SunGiven,
    body: &Body,
    first: &Rigid3<BodyFixed, Cam>,
    body_from_cam: &Rigid3<BodyFixed, Cam>,
) -> Vector3<f64> {
    match given {
        SunGiven::Camera(direction) => body_from_cam.vector(&Vector3::from(direction)),
        SunGiven::Sky([azimuth, elevation]) => {
            body.direction(&body.place(&first.origin()), azimuth.to_radians(), elevation.to_radians())
        }
    }
}

impl SunRecord {
    fn new(sun: &Vector3<f64>, body: &Body, first: &Rigid3<BodyFixed, Cam>) -> Self {
        let (azimuth, elevation) = body.azimuth_elevation(&body.place(&first.origin()), sun);
        Self {
            direction: (*sun).into(),
            azimuth_deg: azimuth.to_degrees(),
            elevation_deg: elevation.to_degrees(),
        }
    }
}
