//! A rendered pair as the bytes of its files.

use super::scene::{Scene, SceneView};
use crate::Error;
use crate::covisibility::pixel_maps;
use crate::pair::{
    CameraRecord, ExposureRecord, PAIR_NAME, PairRecord, SunRecord, ViewMeasures, angles_name, camera_name,
    correspondence_name, image_name, json_text, lit_name, truth_name,
};
use crate::plan::ground::clearance_m;
use crate::plan::rendering::ToneSection;
use crate::plan::{Campaign, PlacedPair, Row};
use rayon::prelude::*;
use selenograph_geometry::Camera;
use selenograph_raster::Raster;
use selenograph_raster::codec::exr::{self, Attribute, Channel, ExrImage};
use selenograph_raster::codec::png;
use selenograph_render::{Exposure, LightMaps, Truth};
use selenograph_terrain::Terrain;
use std::collections::BTreeMap;
use std::path::Path;

/// Every file of a pair, `pair.json` last.
///
/// # Errors
/// [`Error::Raster`] if a codec refuses.
pub(super) fn encode(
    campaign: &Campaign,
    terrain: &Terrain,
    row: &Row,
    placed: &PlacedPair,
    scene: &Scene,
) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let cameras = scene.views.each_ref().map(|v| camera_record(campaign, terrain, v));
    let exposures = exposures(&campaign.tone, scene);
    let mut files: Vec<(String, Vec<u8>)> = jobs(campaign, scene)
        .into_par_iter()
        .map(|job| job.run(scene, &cameras, &exposures, campaign.tone.bits))
        .collect::<Result<_, _>>()?;
    for camera in &cameras {
        let name = camera_name(camera.view);
        let text = json_text(camera, Path::new(&name))?;
        files.push((name, text.into_bytes()));
    }
    let sums = files
        .iter()
        .map(|(name, bytes)| (name.clone(), selenograph_files::checksum::of_bytes(bytes).to_string()));
    let record = pair_record(campaign, terrain, row, placed, scene, &exposures, sums.collect());
    let text = json_text(&record, Path::new(PAIR_NAME))?;
    files.push((PAIR_NAME.into(), text.into_bytes()));
    Ok(files)
}

/// One file, encoded beside the others; positions are of views and lights.
enum Job {
    Truth(usize),
    Image(usize, usize),
    Lit(usize, usize),
    Correspondence(usize),
    Angles(usize, usize),
}

fn jobs(campaign: &Campaign, scene: &Scene) -> Vec<Job> {
    let mut jobs = Vec::new();
    // The longest first, so that no thread ends on one.
    for view in 0..2 {
        jobs.push(Job::Truth(view));
        if campaign.output.correspondence {
            jobs.push(Job::Correspondence(view));
        }
    }
    for view in 0..2 {
        for light in 0..scene.suns.len() {
            if campaign.output.angles {
                jobs.push(Job::Angles(view, light));
            }
            jobs.push(Job::Image(view, light));
            jobs.push(Job::Lit(view, light));
        }
    }
    jobs
}

impl Job {
    fn run(
        &self,
        scene: &Scene,
        cameras: &[CameraRecord; 2],
        exposures: &[[Exposure; 2]],
        bits: u8,
    ) -> Result<(String, Vec<u8>), Error> {
        Ok(match *self {
            Self::Truth(v) => {
                let view = &scene.views[v];
                (truth_name(view.name), exr::encode(&truth_image(&view.truth, &cameras[v])?)?)
            }
            Self::Correspondence(v) => {
                let view = &scene.views[v];
                (correspondence_name(view.name), exr::encode(&correspondence_image(view))?)
            }
            Self::Angles(v, light) => {
                let view = &scene.views[v];
                let bytes = exr::encode(&angles_image(&view.truth, &view.light[light]))?;
                (angles_name(view.name, light), bytes)
            }
            Self::Image(v, light) => {
                let view = &scene.views[v];
                let (picture, exposure) = (&view.radiance[light], exposures[light][v]);
                let bytes = match bits {
                    8 => png::encode_grey8(&exposure.to_u8(picture))?,
                    _ => png::encode_grey16(&exposure.to_u16(picture))?,
                };
                (image_name(view.name, light), bytes)
            }
            Self::Lit(v, light) => {
                let view = &scene.views[v];
                let mask = view.light[light].lit.iter().map(|lit| lit * u8::MAX).collect();
                let mask = Raster::new(view.truth.width, view.truth.height, mask)?;
                (lit_name(view.name, light), png::encode_grey8(&mask)?)
            }
        })
    }
}

fn text(value: &str) -> Attribute {
    Attribute::Text(value.into())
}

/// `a.depth_z.exr`.
fn truth_image(truth: &Truth, camera: &CameraRecord) -> Result<ExrImage, Error> {
    let single = |values: &[f64]| values.iter().map(|v| *v as f32).collect::<Vec<f32>>();
    let normal = |axis: usize| truth.normal.iter().map(|n| n[axis]).collect::<Vec<f32>>();
    let valid = (0..truth.depth_z.len()).map(|n| f32::from(u8::from(truth.is_valid(n)))).collect();
    let camera_json = json_text(camera, Path::new("camera"))?;
    Ok(ExrImage {
        width: truth.width,
        height: truth.height,
        channels: vec![
            Channel::float("depth_z", single(&truth.depth_z)),
            Channel::float("range", single(&truth.range)),
            Channel::float("normal.X", normal(0)),
            Channel::float("normal.Y", normal(1)),
            Channel::float("normal.Z", normal(2)),
            Channel::float("slope", truth.slope_rad.clone()),
            Channel::float("valid", valid),
        ],
        attributes: BTreeMap::from([
            ("kind".into(), text("selenograph.truth")),
            (
                "unit".into(),
                text(
                    "depth_z: m along the optical axis; range: m along the ray; normal: unit vector, world axes; slope: rad",
                ),
            ),
            ("camera".into(), text(&camera_json)),
        ]),
    })
}

/// `a.in_b.exr`.
fn correspondence_image(view: &SceneView) -> ExrImage {
    let [u, v, seen] = pixel_maps(&view.sights);
    ExrImage {
        width: view.truth.width,
        height: view.truth.height,
        channels: vec![Channel::float("u", u), Channel::float("v", v), Channel::float("seen", seen)],
        attributes: BTreeMap::from([
            ("kind".into(), text("selenograph.correspondence")),
            ("unit".into(), text("u, v: px of the other view from its corner; seen: 1 unless hidden")),
        ]),
    }
}

/// `a.l0.angles.exr`.
fn angles_image(truth: &Truth, light: &LightMaps) -> ExrImage {
    ExrImage {
        width: truth.width,
        height: truth.height,
        channels: vec![
            Channel::float("incidence", light.incidence_rad.clone()),
            Channel::float("emission", light.emission_rad.clone()),
            Channel::float("phase", light.phase_rad.clone()),
        ],
        attributes: BTreeMap::from([
            ("kind".into(), text("selenograph.angles")),
            ("unit".into(), text("rad")),
        ]),
    }
}

/// Per light, the exposures of A and B.
fn exposures(tone: &ToneSection, scene: &Scene) -> Vec<[Exposure; 2]> {
    let [a, b] = &scene.views;
    let rule = tone.tone();
    (a.radiance.iter().zip(&b.radiance))
        .map(|(a, b)| {
            let both = rule.exposures(&[a, b]);
            [both[0], both[1]]
        })
        .collect()
}

fn camera_record(campaign: &Campaign, terrain: &Terrain, view: &SceneView) -> CameraRecord {
    let camera: &Camera = &view.view.camera;
    let measures = ViewMeasures {
        altitude_over_terrain_m: clearance_m(terrain, &view.view.origin()),
        ..ViewMeasures::of_depth(view.truth.depth_z.iter().copied(), camera)
    };
    let pitch = campaign.camera.pixel_pitch_mm;
    CameraRecord::new(view.name, &terrain.body, camera, &view.view.world_from_cam, pitch, measures)
}

fn pair_record(
    campaign: &Campaign,
    terrain: &Terrain,
    row: &Row,
    placed: &PlacedPair,
    scene: &Scene,
    exposures: &[[Exposure; 2]],
    files: BTreeMap<String, String>,
) -> PairRecord {
    let [a, b] = scene.views.each_ref().map(|view| &view.view);
    let radius_deg = campaign.render.sun_angular_radius_deg;
    let suns = placed
        .suns
        .iter()
        .map(|angles| Some(SunRecord::new(angles, &terrain.body, &placed.site, radius_deg)));
    let exposure = |light_idx: usize, v: usize| {
        let view = &scene.views[v];
        let picture = &view.radiance[light_idx];
        let num_pixels = picture.data.len().max(1) as f64;
        let Exposure { gain, offset } = exposures[light_idx][v];
        let num_lit = view.light[light_idx].lit.iter().filter(|lit| **lit > 0).count();
        ExposureRecord {
            light_idx,
            view: view.name,
            tone: campaign.tone.kind.as_str().into(),
            gain,
            offset,
            bits: campaign.tone.bits,
            saturated_share: exposures[light_idx][v].num_clipped(picture) as f64 / num_pixels,
            lit_share: num_lit as f64 / num_pixels,
        }
    };
    PairRecord {
        trajectory: Some(row.trajectory),
        suns: suns.collect(),
        exposures: (0..scene.suns.len()).flat_map(|light| [exposure(light, 0), exposure(light, 1)]).collect(),
        overlap: scene.overlap,
        files,
        ..PairRecord::new(row.pair_id, &terrain.body, &placed.site, [&a.world_from_cam, &b.world_from_cam])
    }
}
