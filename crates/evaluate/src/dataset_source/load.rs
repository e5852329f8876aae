//! A pair in memory: cameras, poses, truth, pictures under the lights asked for, and what describes an item.

use super::{Entry, PixelFault, Place};
use crate::Error;
use crate::truth::{Precision, TruthPair, TruthView};
use selenograph_dataset::check::reprojection::{OUTLIER, View as WarpView, warp};
use selenograph_dataset::import::stereolunar::{self, Triplet, TripletPair};
use selenograph_dataset::import::{RawView, selenograph};
use selenograph_dataset::pair::{PAIR_NAME, PairRecord, Trajectory, ViewName, image_name, read_json};
use selenograph_dataset::photometric;
use selenograph_geometry::{Body, BodyFixed, Cam, Camera, Rigid3, Vector3};
use selenograph_raster::codec::exr::SampleType;
use selenograph_raster::codec::{jpeg, png};
use selenograph_raster::{Raster, statistics};
use selenograph_reconstruct::View;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Every this many pixels across and down are warped for the overlap.
const OVERLAP_STEP: usize = 2;

/// Cameras, poses and truth of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// The cameras, measured from the corner, with a half-pixel fault mended.
    pub cameras: [Camera; 2],
    /// The poses.
    pub world_from_cam: [Rigid3<BodyFixed, Cam>; 2],
    /// z-depth, metres, NaN where absent.
    pub depth_z: [Raster<f32>; 2],
    /// Whether depth was stored in 11 significant bits.
    pub is_half_float: bool,
}

impl Geometry {
    /// The truth as the metrics take it.
    pub fn truth(&self) -> TruthPair {
        TruthPair {
            views: self.each_view(|camera, world_from_cam, depth_z| TruthView {
                camera: camera.clone(),
                world_from_cam: *world_from_cam,
                depth_z: depth_z.clone(),
                precision: Precision::of(depth_z),
            }),
        }
    }

    /// Something of each view.
    pub fn each_view<'a, T>(
        &'a self,
        mut of: impl FnMut(&'a Camera, &'a Rigid3<BodyFixed, Cam>, &'a Raster<f32>) -> T,
    ) -> [T; 2] {
        [0, 1].map(|k| of(&self.cameras[k], &self.world_from_cam[k], &self.depth_z[k]))
    }

    fn of_raw(raws: &[RawView; 2], pixels: &PixelFault) -> Result<Self, Error> {
        let [a, b] = raws;
        for raw in raws {
            if !raw.depth_z.data.iter().any(|z| z.is_finite() && *z > 0.0) {
                let expected = "depth in at least one pixel";
                return Err(selenograph_dataset::Error::NoTruth { path: raw.path.clone(), expected }.into());
            }
        }
        let as_nan =
            |raw: &RawView| raw.depth_z.map(|&z| if z.is_finite() && z > 0.0 { z } else { f32::NAN });
        Ok(Self {
            cameras: [pixels.mended(&a.camera()?), pixels.mended(&b.camera()?)],
            world_from_cam: [a.world_from_cam()?, b.world_from_cam()?],
            depth_z: [as_nan(a), as_nan(b)],
            is_half_float: raws.iter().any(|raw| raw.depth_stored == SampleType::Half),
        })
    }
}

/// What describes an item, whatever the method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ItemRecord {
    /// Name of the pair: items of one pair share their geometry.
    pub pair: String,
    /// How it was flown; null where nothing tells.
    pub trajectory: Option<Trajectory>,
    /// Number of the light of view A.
    pub light_a: u64,
    /// Number of the light of view B.
    pub light_b: u64,
    /// Angle between the two Suns, degrees; null where a Sun is not known and the lights differ.
    pub illumination_difference_deg: Option<f64>,
    /// Azimuth (clockwise from north) and elevation of A's Sun at the site, degrees; null where it is not known.
    pub sun_a_deg: Option<[f64; 2]>,
    /// The same of B.
    pub sun_b_deg: Option<[f64; 2]>,
    /// Mean of the two cameras' heights over the middle height of the ground that A sees, metres.
    pub altitude_m: f64,
    /// Median of `depth_z / f` of view A, metres per pixel.
    pub gsd_m: f64,
    /// Share of A's pixels whose ground B sees.
    pub overlap_share: f64,
    /// Distance between the cameras over the altitude.
    pub baseline_over_height: f64,
    /// Angle of the rotation between the cameras, degrees.
    pub relative_rotation_deg: f64,
    /// Whether the truth was stored in 11 significant bits: slopes then have a ceiling.
    pub truth_is_half_float: bool,
}

/// A pair in memory.
#[derive(Debug, Clone)]
pub struct LoadedPair {
    /// Its name.
    pub name: String,
    /// How it was flown.
    pub trajectory: Option<Trajectory>,
    /// The body.
    pub body: Body,
    /// Cameras, poses, truth.
    pub geometry: Geometry,
    /// The pictures of A and B as fractions of white, by the number of their light.
    pub pictures: BTreeMap<u64, [Raster<f32>; 2]>,
    /// Lights whose pictures cannot be read, each with the reason.
    pub left_out: Vec<String>,
    /// Azimuth and elevation of the Sun at the site, degrees, by the number of the light.
    pub suns_deg: BTreeMap<u64, [f64; 2]>,
}

impl LoadedPair {
    /// Reads a pair with the pictures of its lights; a broken picture costs its light.
    ///
    /// # Errors
    /// [`Error::Dataset`] and [`Error::Raster`] if cameras or truth are missing, broken or of another size.
    pub fn read(entry: &Entry, pixels: &PixelFault) -> Result<Self, Error> {
        let geometry = read_geometry(entry, pixels)?;
        let (mut pictures, mut left_out) = (BTreeMap::new(), Vec::new());
        let lights: BTreeSet<u64> = entry.lights.iter().flatten().copied().collect();
        for light in lights {
            match read_pictures(entry, light, &geometry) {
                Ok(both) => drop(pictures.insert(light, both)),
                Err(error) => left_out.push(format!("{} light {light}: {error}", entry.name)),
            }
        }
        let (body, suns_deg) = body_and_suns(entry)?;
        Ok(Self {
            name: entry.name.clone(),
            trajectory: entry.trajectory,
            body,
            geometry,
            pictures,
            left_out,
            suns_deg,
        })
    }

    /// The pictures of an item with their cameras; `None` for a light that was not read.
    pub fn views(&self, [light_a, light_b]: [u64; 2]) -> Option<[View; 2]> {
        let view = |light: u64, k: usize| {
            Some(View {
                image: self.pictures.get(&light)?[k].clone(),
                camera: self.geometry.cameras[k].clone(),
            })
        };
        Some([view(light_a, 0)?, view(light_b, 1)?])
    }

    /// What describes the items of the lights asked for.
    pub fn items(&self, lights: &[[u64; 2]]) -> Vec<ItemRecord> {
        let of_pair = self.pair_item();
        lights
            .iter()
            .map(|&[light_a, light_b]| {
                let [sun_a_deg, sun_b_deg] =
                    [light_a, light_b].map(|light| self.suns_deg.get(&light).copied());
                let angle_deg =
                    sun_a_deg.zip(sun_b_deg).map(|(a, b)| direction(a).angle(&direction(b)).to_degrees());
                ItemRecord {
                    light_a,
                    light_b,
                    illumination_difference_deg: if light_a == light_b { Some(0.0) } else { angle_deg },
                    sun_a_deg,
                    sun_b_deg,
                    ..of_pair.clone()
                }
            })
            .collect()
    }

    fn pair_item(&self) -> ItemRecord {
        let geometry = &self.geometry;
        let [a, b] = geometry.each_view(|camera, world_from_cam, depth_z| WarpView {
            camera,
            world_from_cam,
            depth_z,
        });
        let warped = warp(&a, &b, OVERLAP_STEP);
        let seen = warped.relative_errors.iter().filter(|error| error.abs() < OUTLIER).count();
        let along = |side: usize| (OVERLAP_STEP / 2..side).step_by(OVERLAP_STEP).count();
        let num_warped = (along(a.camera.width) * along(a.camera.height)).max(1);
        let depths = geometry.depth_z[0].data.iter().map(|z| f64::from(*z));
        let median_z = statistics::median(depths).unwrap_or(f64::NAN);
        let ground = geometry.world_from_cam[0].point(&nalgebra::Point3::new(0.0, 0.0, median_z));
        let ground_height = self.body.height_m(&ground);
        let [high_a, high_b] =
            geometry.world_from_cam.each_ref().map(|pose| self.body.height_m(&pose.origin()) - ground_height);
        let altitude_m = 0.5 * (high_a + high_b);
        let [a_pose, b_pose] = &geometry.world_from_cam;
        ItemRecord {
            pair: self.name.clone(),
            trajectory: self.trajectory,
            light_a: 0,
            light_b: 0,
            illumination_difference_deg: None,
            sun_a_deg: None,
            sun_b_deg: None,
            altitude_m,
            gsd_m: geometry.cameras[0].gsd_m(median_z),
            overlap_share: seen as f64 / num_warped as f64,
            baseline_over_height: (b_pose.origin() - a_pose.origin()).norm() / altitude_m,
            relative_rotation_deg: (&b_pose.inverse() * a_pose).rotation_angle_rad().to_degrees(),
            truth_is_half_float: geometry.is_half_float,
        }
    }
}

/// Unit vector towards a Sun in the site's frame.
fn direction([azimuth_deg, elevation_deg]: [f64; 2]) -> Vector3<f64> {
    let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    Vector3::new(elevation.cos() * azimuth.sin(), elevation.cos() * azimuth.cos(), elevation.sin())
}

fn body_and_suns(entry: &Entry) -> Result<(Body, BTreeMap<u64, [f64; 2]>), Error> {
    match &entry.place {
        Place::Own(folder) => {
            let record: PairRecord = read_json(&folder.join(PAIR_NAME))?;
            let suns = (0..).zip(&record.suns);
            let known = suns.filter_map(|(light, sun)| Some((light, sun.as_ref()?)));
            let angles = known.map(|(light, sun)| (light, [sun.azimuth_deg, sun.elevation_deg])).collect();
            Ok((record.body, angles))
        }
        // The files hold no Sun; those of the authors' scripts were confirmed on the samples' pictures.
        Place::Triplets(..) => {
            let scripts = photometric::Settings::default();
            let suns = (0..).zip(&scripts.suns);
            let angles = suns.map(|(light, sun)| (light, [sun.azimuth_deg, sun.elevation_deg])).collect();
            Ok((scripts.body, angles))
        }
    }
}

/// Cameras, poses and truth of a pair.
///
/// # Errors
/// [`Error::Dataset`] for files that are missing, broken or contradict each other.
pub fn read_geometry(entry: &Entry, pixels: &PixelFault) -> Result<Geometry, Error> {
    match &entry.place {
        Place::Own(folder) => {
            let [a, b] = ViewName::BOTH.map(|view| selenograph::read_raw_view(folder, view));
            Geometry::of_raw(&[a?.0, b?.0], pixels)
        }
        Place::Triplets(scene, pair) => {
            let [a, b] = [0, 1].map(|view_idx| read_triplet_view(scene, pair, view_idx, pixels));
            Geometry::of_raw(&[a?, b?], pixels)
        }
    }
}

/// The geometry of one view, which every light repeats: lights whose files differ make the pair unusable.
fn read_triplet_view(
    scene: &Path,
    pair: &TripletPair,
    view_idx: usize,
    pixels: &PixelFault,
) -> Result<RawView, Error> {
    let triplets = || pair.lights.values().filter_map(|light| light[view_idx].as_ref());
    let first = |pick: fn(&Triplet) -> Option<&PathBuf>| triplets().find_map(pick);
    let (Some(exr), Some(npz)) = (first(|t| t.exr.as_ref()), first(|t| t.npz.as_ref())) else {
        let stem = stereolunar::stem(2 * stereolunar::LIGHTS_PER_PAIR * pair.pair_id + view_idx as u64);
        let expected = "an .exr and an .npz under at least one light";
        return Err(selenograph_dataset::Error::NoTruth { path: scene.join(stem), expected }.into());
    };
    let raw = stereolunar::read_raw_view(exr, npz, pixels.k_convention)?;
    let bytes = |path: &Path| std::fs::read(path).map_err(Error::io("read", path));
    let (exr_bytes, npz_bytes) = (bytes(exr)?, bytes(npz)?);
    for triplet in triplets() {
        let (other_exr, other_npz) =
            (triplet.exr.as_deref().unwrap_or(exr), triplet.npz.as_deref().unwrap_or(npz));
        // Files that are the same need no decoding.
        if bytes(other_exr)? == exr_bytes && bytes(other_npz)? == npz_bytes {
            continue;
        }
        let other = stereolunar::read_raw_view(other_exr, other_npz, pixels.k_convention)?;
        let bits = |raw: &RawView| raw.depth_z.data.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
        if bits(&other) != bits(&raw) || other.k != raw.k || other.world_from_cam != raw.world_from_cam {
            return Err(Error::Format {
                path: other_exr.to_owned(),
                expected: format!("the depth, pose and camera of {}", exr.display()),
                found: "another one: the lights of a pair share their geometry".into(),
            });
        }
    }
    Ok(raw)
}

fn read_pictures(entry: &Entry, light: u64, geometry: &Geometry) -> Result<[Raster<f32>; 2], Error> {
    let paths: [Option<PathBuf>; 2] = match &entry.place {
        Place::Own(folder) => {
            ViewName::BOTH.map(|view| Some(folder.join(image_name(view, usize::try_from(light).ok()?))))
        }
        Place::Triplets(_, pair) => [0, 1]
            .map(|k| pair.lights.get(&light).and_then(|views| views[k].as_ref()).and_then(|t| t.jpg.clone())),
    };
    let read = |path: &Option<PathBuf>, k: usize| {
        let Some(path) = path else {
            return Err(Error::Format {
                path: PathBuf::from(&entry.name),
                expected: format!("pictures of both views under light {light}"),
                found: "one is missing".into(),
            });
        };
        let is_png = path.extension().is_some_and(|extension| extension == "png");
        let picture = if is_png { png::read(path)? } else { jpeg::read(path)? }.to_unit_grey();
        let size = (geometry.depth_z[k].width, geometry.depth_z[k].height);
        if (picture.width, picture.height) != size {
            return Err(Error::Format {
                path: path.clone(),
                expected: format!("{}×{} pixels, as the truth has", size.0, size.1),
                found: format!("{}×{}", picture.width, picture.height),
            });
        }
        Ok(picture)
    };
    Ok([read(&paths[0], 0)?, read(&paths[1], 1)?])
}
