//! What is known of where the pictures were taken, from the command line and the files it names.

use super::inputs::Pictures;
use super::suns::{self, SunRecord, Suns};
use crate::args::reconstruct::Known;
use crate::exit::refuse;
use selenograph_geometry::{Body, BodyFixed, CamA, Point3, Rigid3, Rotation3, Vector3};
use selenograph_raster::dem::OpenOptions;
use selenograph_reconstruct::camera_file::{self, CameraFile, PictureSize, WorldPose};
use selenograph_reconstruct::priors::{KnownLength, KnownPose, Priors, between};
use selenograph_reconstruct::scale::dem::DemPatch;
use selenograph_reconstruct::scale::points::KnownPoints;
use selenograph_reconstruct::scale::{ScaleSource, World};
use selenograph_reconstruct::transform_file;
use serde::Serialize;
use std::path::Path;

/// What was known, for the record.
#[derive(Debug, Default, Serialize)]
pub struct Summary {
    relative_pose: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    world: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    up_in_cam_a: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    altitude_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    baseline_m: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    dem_cell_m: Option<f64>,
    num_points: usize,
    /// Where the size comes from.
    scale_from: Option<ScaleSource>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun_a: Option<SunRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun_b: Option<SunRecord>,
}

/// Everything that is known; with `suns_of_files` the Suns also from the pictures' own files, where shading is looked at.
///
/// # Errors
/// Files that are no poses, elevation models or points; poses of different worlds; a source of size that is not there; a Sun or
/// time that needs a place, or does not light it.
pub fn priors(
    known: &Known,
    suns_of_files: bool,
    pictures: &Pictures,
) -> anyhow::Result<(Priors, Summary, Suns)> {
    let sizes = pictures.sizes();
    let places = [0, 1].map(|k| PictureSize::new(sizes[k][0], sizes[k][1]).at(&pictures.paths[k]));
    let mut priors = Priors {
        baseline: length("--baseline-m", known.baseline_m, known.baseline_sigma_m)?,
        altitude: length("--altitude-m", known.altitude_m, known.altitude_sigma_m)?,
        scale_from: known.scale_from,
        ..Priors::default()
    };
    let mut summary = Summary {
        up_in_cam_a: known.up_in_cam_a,
        altitude_m: known.altitude_m,
        baseline_m: known.baseline_m,
        ..Summary::default()
    };
    if let Some(path) = &known.cam_b_from_cam_a {
        let pose = transform_file::read_pose(path)?;
        priors.cam_b_from_cam_a =
            Some(KnownPose { cam_b_from_cam_a: pose.cam_b_from_cam_a, metric: pose.metric });
    }
    if let Some(path) = &known.world_from_cam_a {
        let pose = world_pose(path, &places[0])?;
        priors.world = world(&pose);
        if let Some(other) = &known.world_from_cam_b {
            priors.cam_b_from_cam_a = Some(relative(path, &pose, other, &places[1])?);
        }
        summary.world = Some(pose.world);
    } else if let Some(up) = known.up_in_cam_a {
        priors.world = World::Level(Rigid3::new(level(&Vector3::from(up)), Point3::origin()));
    }
    let suns = suns::find(known, &priors, &pictures.paths, suns_of_files)?;
    priors.suns = suns.known;
    [summary.sun_a, summary.sun_b] = suns.records.clone();
    summary.relative_pose = priors.cam_b_from_cam_a.is_some();
    if let Some(path) = &known.dem {
        let dem = dem("--dem", path, &priors.world)?;
        summary.dem_cell_m = Some(dem.cell_m());
        priors.dem = Some(dem);
    }
    if let Some(path) = &known.points {
        let points = points(path, &priors.world)?;
        summary.num_points = points.points.len();
        priors.points = Some(points);
    }
    summary.scale_from = priors.scale_from()?;
    Ok((priors, summary, suns))
}

fn length(name: &str, metres: Option<f64>, sigma_m: Option<f64>) -> anyhow::Result<Option<KnownLength>> {
    let Some(metres) = metres else { return Ok(None) };
    let sigma_m = sigma_m.unwrap_or(0.0);
    if metres > 0.0 && metres.is_finite() && sigma_m >= 0.0 && sigma_m.is_finite() {
        return Ok(Some(KnownLength { metres, sigma_m }));
    }
    Err(refuse(
        format!("{name} {metres} with sigma {sigma_m}: no such length"),
        "lengths are in metres, above zero; a sigma of 0 means that it is not known",
    ))
}

fn world_pose(path: &Path, picture: &PictureSize) -> anyhow::Result<WorldPose> {
    place(path, camera_file::read(path, picture)?)
}

/// The place that a camera file tells.
///
/// # Errors
/// One that tells none.
pub fn place(path: &Path, file: CameraFile) -> anyhow::Result<WorldPose> {
    file.pose.ok_or_else(|| {
        refuse(
            format!("`{}` holds a camera without a place", path.display()),
            "it needs world, and world_from_cam or position_m with world_from_cam_quaternion (docs/formats.md)",
        )
    })
}

/// The body that a world's name says, if it says one.
pub fn body(name: &str) -> Option<Body> {
    [Body::moon(), Body::mars()].into_iter().find(|body| body.frame == name)
}

/// What a pose says of the world around it.
fn world(pose: &WorldPose) -> World {
    let world_from_cam_a: Rigid3<BodyFixed, CamA> = pose.world_from_cam.relabel();
    match (body(&pose.world), pose.world.as_str()) {
        (Some(body), _) => World::Body { body, body_from_cam_a: world_from_cam_a },
        (None, "enu") => World::Level(world_from_cam_a.relabel()),
        // Any other frame may lie as it likes.
        (None, _) => World::Unknown,
    }
}

fn relative(path: &Path, pose: &WorldPose, other: &Path, picture: &PictureSize) -> anyhow::Result<KnownPose> {
    let second = world_pose(other, picture)?;
    if second.world != pose.world || second.metric != pose.metric {
        return Err(refuse(
            format!(
                "`{}` is in the world `{}`, `{}` in `{}`",
                path.display(),
                pose.world,
                other.display(),
                second.world
            ),
            "both poses must be in one world",
        ));
    }
    let known = between(&pose.world_from_cam.relabel(), &second.world_from_cam.relabel());
    Ok(KnownPose { metric: pose.metric, ..known })
}

/// A frame whose Z is up and whose X is the camera's, made level.
fn level(up: &Vector3<f64>) -> Rotation3<f64> {
    let seed = if up.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
    let north = up.cross(&seed).normalize();
    let east = north.cross(up);
    Rotation3::from_matrix_unchecked(selenograph_geometry::Matrix3::from_rows(&[
        east.transpose(),
        north.transpose(),
        up.transpose(),
    ]))
}

/// The part of an elevation model round the ground that a camera can see; `option` named it.
///
/// # Errors
/// A world that is no body's, a file that cannot be read or lies elsewhere.
pub fn dem(option: &str, path: &Path, world: &World) -> anyhow::Result<DemPatch> {
    let World::Body { body, body_from_cam_a } = world else {
        return Err(refuse(
            format!("{option} needs the place of the first camera on a body"),
            "pass --world-from-cam-a with a pose in `moon_me`",
        ));
    };
    let origin = body_from_cam_a.origin();
    // Four heights away the ground is seen at 76°; a pose may be off by kilometres.
    let reach_m = 4.0 * body.height_m(&origin).abs() + 20_000.0;
    let dem = DemPatch::read(path, &OpenOptions::default(), &origin, reach_m)?;
    dem.body().same_sphere(
        format_args!("`{}`", path.display()),
        body,
        format_args!("the first camera's world `{}`", body.frame),
    )?;
    Ok(dem)
}

/// Known points from a table; those with a latitude are on the body of the first camera, or on the Moon.
fn points(path: &Path, world: &World) -> anyhow::Result<KnownPoints> {
    let body = match world {
        World::Body { body, .. } => Some(body),
        World::Level(_) | World::Unknown => None,
    };
    Ok(KnownPoints::read_csv(path, body)?)
}
