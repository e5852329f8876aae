//! `render`: one picture with all its truth maps.

use super::albedo::{self, AlbedoRecord};
use super::run_record::{NO_OUTCOME, write_record};
use crate::args::render::{CameraPlace, Law, Light, Render, ShadowKind};
use crate::exit::{Outcome, refuse};
use crate::ui::Ui;
use selenograph_dataset::pair::{CameraRecord, ViewMeasures, ViewName};
use selenograph_files::{FolderKind, record};
use selenograph_geometry::{Camera, Geodetic, lookat, units};
use selenograph_raster::codec::exr::{self, Attribute, Channel, ExrImage};
use selenograph_raster::codec::png;
use selenograph_raster::colormap::Colormap;
use selenograph_raster::{Raster, statistics};
use selenograph_render::brdf::{Brdf, Hapke, Hapke1963, LunarLambert, Minnaert};
use selenograph_render::{
    Interpolation, LightMaps, RadianceSettings, Shadows, Sun, Tone, Tracer, Truth, Viewpoint, radiance,
};
use selenograph_terrain::Terrain;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Side of a pixel on the nominal sensor, millimetres: only for the record.
const PIXEL_PITCH_MM: f64 = 0.01;
/// Slopes from here on have the brightest colour, degrees.
const STEEP_DEG: f64 = 40.0;

static PICTURE: FolderKind = FolderKind {
    command: "render",
    what: "a rendered picture's folder",
    is_own: |folder| record::is_of(folder, PICTURE.command),
    names: &["run.toml", "record.json", "picture.png", "depth_z.png", "slope.png", "lit.png", "truth.exr"],
    parts: &[],
};

/// What is written beside the maps.
#[derive(Serialize)]
struct Record {
    camera: CameraRecord,
    sun_azimuth_deg: f64,
    sun_elevation_deg: f64,
    sun_direction: [f64; 3],
    shadows: Shadows,
    brdf: Brdf,
    #[serde(skip_serializing_if = "Option::is_none")]
    albedo: Option<AlbedoRecord>,
    rays_per_pixel: u32,
    psf_sigma_px: f64,
    /// Level = gain × I/F, in shares of full scale.
    gain: f64,
    num_sky: usize,
    num_absent: usize,
    lit_share: f64,
}

/// Everything that was computed.
struct Picture {
    view: Viewpoint,
    truth: Truth,
    light: LightMaps,
    radiance: Raster<f32>,
}

/// Renders and writes a folder.
///
/// # Errors
/// No terrain, a camera below ground or off the terrain, settings without sense, a target that cannot be written.
pub fn run(args: &Render, ui: &Ui) -> anyhow::Result<Outcome> {
    let draft = args.target.folder(&PICTURE)?;
    let terrain = ui.timed("open terrain", || Terrain::open(&args.terrain))?;
    let tracer = Tracer::new(&terrain, Interpolation::default());
    let place = ground(&terrain, &args.camera)?;
    let view =
        Viewpoint { camera: camera(&args.camera)?, world_from_cam: pose(&terrain, &place, &args.camera)? };
    let sun = sun(&terrain, &place, &args.light)?;
    if args.light.sun_elevation_deg < 0.0 {
        ui.note("note: the Sun is below the horizon at the place looked at: expect a dark picture");
    }
    let shadows = match args.light.shadows {
        ShadowKind::Cast => Shadows::Cast,
        ShadowKind::Attached => Shadows::Attached,
    };
    let (albedo, albedo_record) = ui.timed("albedo", || albedo::read(&args.albedo, &terrain.body, ui))?;
    let settings = RadianceSettings {
        rays_per_pixel: args.rays_per_pixel,
        psf_sigma_px: args.psf_sigma_px,
        shadows,
        brdf: law(args.brdf),
        albedo,
        ..RadianceSettings::default()
    };
    settings.validate()?;
    let truth = ui.timed("truth", || Truth::cast(&tracer, &view))?;
    if truth.depth_z.iter().all(|z| z.is_nan()) {
        return Err(refuse(
            "no pixel sees the terrain",
            "look at a place that the terrain covers, or take a larger terrain",
        ));
    }
    if truth.num_absent > 0 {
        ui.note(&format!(
            "note: {} of {} pixels look past the terrain or into holes of it; they are NaN in the maps",
            truth.num_absent,
            truth.depth_z.len()
        ));
    }
    let light = ui.timed("light maps", || LightMaps::cast(&tracer, &view, &truth, &sun, shadows));
    let mut pictures = ui.timed("radiance", || radiance(&tracer, &view, &truth, &[sun], &settings))?;
    let Some(radiance) = pictures.pop() else { return Ok(Outcome::Done) };
    let picture = Picture { view, truth, light, radiance };
    let record = Record { albedo: albedo_record, ..record(args, &terrain, &picture, &sun, &settings) };
    ui.timed("encode and write", || write(draft.path(), &picture, &record))?;
    let read: Vec<PathBuf> =
        [args.terrain.join("terrain.json")].into_iter().chain(args.albedo.albedo.clone()).collect();
    write_record(draft.path(), PICTURE.command, &read, &record, NO_OUTCOME)?;
    draft.commit()?;
    if ui.json {
        ui.data_json(&record)?;
    } else {
        ui.note(&format!("picture, truth maps and record: {}", args.target.out.display()));
    }
    Ok(Outcome::Done)
}

/// The place looked at, on the terrain.
fn ground(terrain: &Terrain, camera: &CameraPlace) -> anyhow::Result<Geodetic> {
    let flat = Geodetic::from_deg(camera.lat_deg, camera.lon_deg, 0.0);
    if !(camera.lat_deg.abs() <= 90.0 && camera.lon_deg.is_finite()) {
        return Err(refuse(
            format!("no such place: latitude {}°, longitude {}°", camera.lat_deg, camera.lon_deg),
            "latitudes are -90 to 90 degrees, longitudes count eastwards",
        ));
    }
    let sample = terrain.sample(&terrain.body.point(&flat)).ok_or_else(|| {
        refuse(
            format!(
                "the terrain has no height at latitude {}°, longitude {}°",
                camera.lat_deg, camera.lon_deg
            ),
            "`selenograph dem info` tells what a file covers",
        )
    })?;
    Ok(Geodetic { height_m: sample.height_m, ..flat })
}

fn camera(place: &CameraPlace) -> anyhow::Result<Camera> {
    Ok(Camera::from_fov(place.width as usize, place.height as usize, place.fov_deg.to_radians())?)
}

/// The camera stands back from the place against its heading, so that the line of sight leans by the tilt.
fn pose(
    terrain: &Terrain,
    place: &Geodetic,
    camera: &CameraPlace,
) -> anyhow::Result<selenograph_geometry::Rigid3<selenograph_geometry::BodyFixed, selenograph_geometry::Cam>>
{
    if !(0.0..=85.0).contains(&camera.tilt_deg) || !camera.altitude_m.is_finite() {
        return Err(refuse(
            format!("tilt {}° at altitude {} m", camera.tilt_deg, camera.altitude_m),
            "--tilt-deg is 0 (straight down) to 85, --altitude-m is in metres",
        ));
    }
    let body = &terrain.body;
    let heading = camera.heading_deg.to_radians();
    let tilt = camera.tilt_deg.to_radians();
    let towards_camera =
        body.direction(place, heading + std::f64::consts::PI, std::f64::consts::FRAC_PI_2 - tilt);
    let origin = body.point(place) + towards_camera * (camera.altitude_m / tilt.cos());
    let right = body.direction(place, heading + std::f64::consts::FRAC_PI_2, 0.0);
    Ok(lookat::from_forward_and_right(origin, &-towards_camera, &right)?)
}

fn sun(terrain: &Terrain, place: &Geodetic, light: &Light) -> anyhow::Result<Sun> {
    let (azimuth, elevation) = (light.sun_azimuth_deg.to_radians(), light.sun_elevation_deg.to_radians());
    Ok(Sun::at_site(&terrain.body, place, azimuth, elevation)?)
}

/// A law with its usual parameters.
pub fn law(law: Law) -> Brdf {
    match law {
        Law::Lambert => Brdf::Lambert,
        Law::LommelSeeliger => Brdf::LommelSeeliger,
        Law::LunarLambert => Brdf::LunarLambert(LunarLambert::default()),
        // The exponent that fits the StereoLunar pictures best.
        Law::Minnaert => Brdf::Minnaert(Minnaert { k: 0.63 }),
        Law::Hapke1963 => Brdf::Hapke1963(Hapke1963::default()),
        Law::Hapke => Brdf::Hapke(Hapke::default()),
    }
}

fn record(
    args: &Render,
    terrain: &Terrain,
    picture: &Picture,
    sun: &Sun,
    settings: &RadianceSettings,
) -> Record {
    let truth = &picture.truth;
    let num_valid = truth.depth_z.iter().filter(|z| z.is_finite()).count();
    let view = &picture.view;
    let below = terrain.sample(&view.origin());
    let depths = truth.depth_z.iter().copied();
    let measures = ViewMeasures {
        altitude_over_terrain_m: below.map(|s| terrain.body.height_m(&view.origin()) - s.height_m),
        gsd_m: statistics::median(depths).map(|z| view.camera.gsd_m(z)),
        valid_share: num_valid as f64 / truth.depth_z.len() as f64,
    };
    let num_lit = picture.light.lit.iter().filter(|lit| **lit != 0).count();
    Record {
        camera: CameraRecord::new(
            ViewName::A,
            &terrain.body,
            &view.camera,
            &view.world_from_cam,
            PIXEL_PITCH_MM,
            measures,
        ),
        sun_azimuth_deg: units::wrap_360_deg(args.light.sun_azimuth_deg),
        sun_elevation_deg: args.light.sun_elevation_deg,
        sun_direction: sun.direction.into_inner().into(),
        shadows: settings.shadows,
        brdf: settings.brdf,
        albedo: None,
        rays_per_pixel: settings.rays_per_pixel,
        psf_sigma_px: settings.psf_sigma_px,
        gain: Tone::default().exposures(&[&picture.radiance])[0].gain,
        num_sky: truth.num_sky,
        num_absent: truth.num_absent,
        lit_share: num_lit as f64 / num_valid.max(1) as f64,
    }
}

fn write(folder: &Path, picture: &Picture, record: &Record) -> anyhow::Result<()> {
    let Picture { truth, light, radiance, .. } = picture;
    let (width, height) = (truth.width, truth.height);
    let raster = |data: Vec<f32>| Raster { width, height, data };
    let exposure = &Tone::default().exposures(&[radiance])[0];
    let depth_z = raster(truth.depth_z.iter().map(|z| *z as f32).collect());
    let slope_deg = raster(truth.slope_rad.iter().map(|s| s.to_degrees()).collect());
    let (near, far) =
        statistics::summary(truth.depth_z.iter().copied()).map_or((0.0, 1.0), |s| (s.min, s.max));
    let lit = Raster { width, height, data: light.lit.iter().map(|lit| 255 * lit).collect() };
    let files = [
        ("picture.png", png::encode_grey16(&exposure.to_u16(radiance))?),
        ("depth_z.png", png::encode_rgb8(&Colormap::Viridis.paint(&depth_z, near, far))?),
        ("slope.png", png::encode_rgb8(&Colormap::Inferno.paint(&slope_deg, 0.0, STEEP_DEG))?),
        ("lit.png", png::encode_grey8(&lit)?),
        ("truth.exr", exr::encode(&maps(picture))?),
        ("record.json", (serde_json::to_string_pretty(record)? + "\n").into_bytes()),
    ];
    for (name, bytes) in files {
        selenograph_files::write(&folder.join(name), bytes)?;
    }
    Ok(())
}

fn maps(picture: &Picture) -> ExrImage {
    let Picture { truth, light, radiance, .. } = picture;
    let double = |values: &[f64]| values.iter().map(|v| *v as f32).collect::<Vec<f32>>();
    let axis = |k: usize| truth.normal.iter().map(|n| n[k]).collect::<Vec<f32>>();
    let channels = vec![
        Channel::float("depth_z", double(&truth.depth_z)),
        Channel::float("range", double(&truth.range)),
        Channel::float("normal.X", axis(0)),
        Channel::float("normal.Y", axis(1)),
        Channel::float("normal.Z", axis(2)),
        Channel::float("slope", truth.slope_rad.clone()),
        Channel::float("height", truth.height_m.clone()),
        Channel::float("cell", truth.cell_m.clone()),
        Channel::float("valid", truth.depth_z.iter().map(|z| f32::from(u8::from(z.is_finite()))).collect()),
        Channel::float("incidence", light.incidence_rad.clone()),
        Channel::float("emission", light.emission_rad.clone()),
        Channel::float("phase", light.phase_rad.clone()),
        Channel::float("lit", light.lit.iter().map(|lit| f32::from(*lit)).collect()),
        Channel::float("radiance_factor", radiance.data.clone()),
    ];
    let text = |text: &str| Attribute::Text(text.to_owned());
    ExrImage {
        width: truth.width,
        height: truth.height,
        channels,
        attributes: BTreeMap::from([
            ("kind".to_owned(), text("depth_z")),
            ("unit".to_owned(), text("m and rad")),
        ]),
    }
}
