//! One pair of triplets, read whole and turned into the files of our own layout.

use super::options::ImportOptions;
use crate::Error;
use crate::check::reprojection::{self, DepthView, warp};
use crate::pair::{
    CameraRecord, ImportedSuns, OverlapRecord, PAIR_NAME, PairRecord, SourceRecord, SunRecord, Trajectory,
    ViewMeasures, ViewName, camera_name, image_name, json_text, truth_name,
};
use crate::photometric::{self, Settings, SiteRule, Skipped};
use crate::stored::triplets::{read_geometry, read_picture, trajectory_of};
use crate::stored::{Place, RawView, Triplet, TripletPair, grey8};
use selenograph_geometry::{
    Body, BodyFixed, Cam, Camera, Geodetic, PixelConvention, Point2, Point3, Rigid3, pixel,
};
use selenograph_raster::codec::exr::{self, Attribute, Channel, ExrImage, SampleType};
use selenograph_raster::codec::png;
use selenograph_raster::{Raster, statistics};
use std::collections::BTreeMap;
use std::path::Path;

/// Side of a pixel on the nominal sensor, millimetres: triplets have no sensor.
const PIXEL_PITCH_MM: f64 = 0.01;
/// Every this many pixels across and down are warped for the overlap.
const OVERLAP_STEP: usize = 2;

/// A pair in memory.
pub struct Imported {
    /// Name of the folder.
    scene: String,
    source_id: u64,
    views: [ImportedView; 2],
    /// Number of each light in the source, and the pictures of A and B.
    lights: Vec<(u64, [Raster<u8>; 2])>,
    files: BTreeMap<String, String>,
}

/// What all pictures of a view share.
struct ImportedView {
    camera: Camera,
    world_from_cam: Rigid3<BodyFixed, Cam>,
    depth_z: Raster<f32>,
    stored: SampleType,
}

/// Reads a pair; `None` where nothing whole is left of it. What is left out is noted.
pub fn read(
    place: &Place,
    pair: &TripletPair,
    options: &ImportOptions,
    skipped: &mut Vec<Skipped>,
) -> Option<Imported> {
    let mut first: Option<[RawView; 2]> = None;
    let (mut lights, mut files) = (Vec::new(), BTreeMap::new());
    for (&light, views) in &pair.lights {
        let missing = missing(place, pair, light, views);
        if !missing.is_empty() {
            skipped.extend(missing);
            continue;
        }
        let stems: Vec<&str> = views.iter().flatten().map(|triplet| triplet.stem.as_str()).collect();
        let mut skip = |reason: String| skipped.push(Skipped { path: place.path(&stems.join(", ")), reason });
        match read_light(place, views, options.k_convention) {
            Err(error) => skip(format!("{error}: its light is left out")),
            Ok((raws, _, _))
                if first
                    .as_ref()
                    .is_some_and(|first| first.iter().zip(&raws).any(|(a, b)| !a.is_same_geometry(b))) =>
            {
                skip(
                    "depth, pose or camera differ from the pair's other lights: its light is left out".into(),
                );
            }
            Ok((raws, pictures, sums)) => {
                lights.push((light, pictures));
                files.extend(sums);
                first.get_or_insert(raws);
            }
        }
    }
    let views = first?.map(|raw| {
        Ok::<_, Error>(ImportedView {
            camera: raw.camera()?,
            world_from_cam: raw.world_from_cam()?,
            depth_z: raw.depth_or_nan(),
            stored: raw.depth_stored,
        })
    });
    match views {
        [Ok(a), Ok(b)] => {
            Some(Imported { scene: place.name(), source_id: pair.pair_id, views: [a, b], lights, files })
        }
        [Err(error), _] | [_, Err(error)] => {
            let path = place.path(&pair.stem(0, ViewName::A));
            skipped.push(Skipped { path, reason: format!("{error}: its pair is left out") });
            None
        }
    }
}

/// The files that a light lacks.
fn missing(place: &Place, pair: &TripletPair, light: u64, views: &[Option<Triplet>; 2]) -> Vec<Skipped> {
    let lacks = ViewName::BOTH.into_iter().zip(views).flat_map(|(view, triplet)| {
        let lacks = triplet.as_ref().map_or_else(|| vec!["jpg", "exr", "npz"], Triplet::missing);
        lacks.into_iter().map(move |extension| format!("{}.{extension}", pair.stem(light, view)))
    });
    lacks
        .map(|name| Skipped {
            path: place.path(&name),
            reason: "the file is missing: this light of its pair is left out".into(),
        })
        .collect()
}

type Light = ([RawView; 2], [Raster<u8>; 2], Vec<(String, String)>);

/// Both views under one light, and the checksums of their files.
fn read_light(
    place: &Place,
    views: &[Option<Triplet>; 2],
    k_convention: PixelConvention,
) -> Result<Light, Error> {
    let mut sums = Vec::new();
    let mut read = |triplet: &Option<Triplet>| {
        let Some(Triplet { jpg: Some(jpg), exr: Some(exr), npz: Some(npz), .. }) = triplet else {
            return Err(Error::unexpected(Path::new("triplet"), "three files", "fewer"));
        };
        for file in [jpg, exr, npz] {
            sums.push((file.clone(), selenograph_files::checksum::of_bytes(&place.read(file)?).to_string()));
        }
        let raw = read_geometry(place, [exr, npz], k_convention)?;
        let picture = read_picture(place, jpg, (raw.depth_z.width, raw.depth_z.height))?;
        Ok((raw, grey8(&picture)))
    };
    let ((raw_a, picture_a), (raw_b, picture_b)) = (read(&views[0])?, read(&views[1])?);
    Ok(([raw_a, raw_b], [picture_a, picture_b], sums))
}

impl Imported {
    /// Number of pictures.
    pub fn num_images(&self) -> usize {
        2 * self.lights.len()
    }

    /// Whether a depth was stored in 11 significant bits.
    pub fn is_half(&self) -> bool {
        self.views.iter().any(|view| view.stored == SampleType::Half)
    }

    /// Every file of the pair, `pair.json` last.
    ///
    /// # Errors
    /// [`Error::Raster`] if a codec refuses, [`Error::Geometry`] for optical axes without a crossing.
    pub fn encode(&self, pair_id: u64, options: &ImportOptions) -> Result<Vec<(String, Vec<u8>)>, Error> {
        let mut files = Vec::new();
        for (view, name) in self.views.iter().zip(ViewName::BOTH) {
            let camera = view.record(name, &options.body);
            let text = json_text(&camera, Path::new(&camera_name(name)))?;
            files.push((truth_name(name), exr::encode(&view.truth(&text))?));
            files.push((camera_name(name), text.into_bytes()));
        }
        for (light_idx, (_, pictures)) in self.lights.iter().enumerate() {
            for (picture, name) in pictures.iter().zip(ViewName::BOTH) {
                files.push((image_name(name, light_idx), png::encode_grey8(picture)?));
            }
        }
        let sums = files
            .iter()
            .map(|(name, bytes)| (name.clone(), selenograph_files::checksum::of_bytes(bytes).to_string()));
        let record = self.record(pair_id, options, sums.collect())?;
        files.push((PAIR_NAME.into(), json_text(&record, Path::new(PAIR_NAME))?.into_bytes()));
        Ok(files)
    }

    fn suns(
        &self,
        rule: Option<SiteRule>,
        site: &Geodetic,
        options: &ImportOptions,
    ) -> Vec<Option<SunRecord>> {
        let known = Settings::default().suns;
        let sun = |light: u64| {
            if options.suns == ImportedSuns::Unknown || rule.is_none() {
                return None;
            }
            let angles = known.get(usize::try_from(light).ok()?)?;
            Some(SunRecord::new(angles, &options.body, site, 0.0))
        };
        self.lights.iter().map(|(light, _)| sun(*light)).collect()
    }

    fn record(
        &self,
        pair_id: u64,
        options: &ImportOptions,
        files: BTreeMap<String, String>,
    ) -> Result<PairRecord, Error> {
        let (body, [a, b]) = (&options.body, &self.views);
        let trajectory = trajectory_of(&self.scene);
        let rule = trajectory.and_then(SiteRule::of_trajectory);
        let views = [&a.depth_view(), &b.depth_view()];
        let site = site(trajectory, views, body)?;
        let suns = self.suns(rule, &site, options);
        Ok(PairRecord {
            trajectory,
            source: Some(SourceRecord {
                format: "stereolunar".into(),
                scene: self.scene.clone(),
                pair_id: self.source_id,
                lights: self.lights.iter().map(|(light, _)| *light).collect(),
                k_pixel_convention: options.k_convention,
                depth_stored: if self.is_half() { "half" } else { "float" }.into(),
                suns: if suns.iter().any(Option::is_some) { options.suns } else { ImportedSuns::Unknown },
                files: self.files.clone(),
            }),
            suns,
            overlap: overlap(views),
            files,
            ..PairRecord::new(pair_id, body, &site, [&a.world_from_cam, &b.world_from_cam])
        })
    }
}

/// The place that a pair of triplets is told about: by its trajectory's rule, else where A's axis meets A's median depth; in
/// both cases at that ground's height.
///
/// # Errors
/// [`Error::Geometry`] for optical axes without a crossing.
pub(crate) fn site(
    trajectory: Option<Trajectory>,
    [a, b]: [&DepthView<'_>; 2],
    body: &Body,
) -> Result<Geodetic, Error> {
    let depths = a.depth_z.data.iter().map(|z| f64::from(*z)).filter(|z| z.is_finite() && *z > 0.0);
    let median_z = statistics::median(depths).unwrap_or(0.0);
    let ground = body.place(&a.world_from_cam.point(&Point3::new(0.0, 0.0, median_z)));
    Ok(match trajectory.and_then(SiteRule::of_trajectory) {
        Some(rule) => {
            let place = photometric::site(rule, &[*a.world_from_cam, *b.world_from_cam], body)?;
            Geodetic { height_m: ground.height_m, ..place }
        }
        None => ground,
    })
}

/// By warping depth: ground is seen unless the other view has nearer ground there.
pub(crate) fn overlap([a, b]: [&DepthView<'_>; 2]) -> OverlapRecord {
    let shares = |from: &DepthView, to: &DepthView| {
        let warped = warp(from, to, OVERLAP_STEP);
        let along = |side: usize| (OVERLAP_STEP / 2..side).step_by(OVERLAP_STEP).count();
        let all = (along(from.camera.width) * along(from.camera.height)).max(1) as f64;
        let seen = warped.relative_errors.iter().filter(|error| **error < reprojection::OUTLIER).count();
        (warped.num_inside as f64 / all, seen as f64 / all)
    };
    let ((a_in_b, a_seen_by_b), (b_in_a, b_seen_by_a)) = (shares(a, b), shares(b, a));
    OverlapRecord { a_in_b, b_in_a, a_seen_by_b, b_seen_by_a }
}

impl ImportedView {
    fn depth_view(&self) -> DepthView<'_> {
        DepthView { camera: &self.camera, world_from_cam: &self.world_from_cam, depth_z: &self.depth_z }
    }

    fn depths(&self) -> impl Iterator<Item = f64> + Clone + '_ {
        self.depth_z.data.iter().map(|z| f64::from(*z)).filter(|z| z.is_finite())
    }

    fn record(&self, name: ViewName, body: &Body) -> CameraRecord {
        let measures = ViewMeasures::of_depth(self.depths(), &self.camera);
        CameraRecord::new(name, body, &self.camera, &self.world_from_cam, PIXEL_PITCH_MM, measures)
    }

    /// `a.depth_z.exr`, with what the source knows: no normals, no slopes.
    fn truth(&self, camera: &str) -> ExrImage {
        let (width, height) = (self.depth_z.width, self.depth_z.height);
        let range = Raster::from_fn(width, height, |x, y| {
            let center = Point2::new(pixel::center_of(x), pixel::center_of(y));
            let range = self.camera.range_from_depth_z(&center, f64::from(self.depth_z[(x, y)]));
            range.map_or(f32::NAN, |range| range as f32)
        });
        let valid = self.depth_z.data.iter().map(|z| f32::from(u8::from(z.is_finite()))).collect();
        let text = |text: &str| Attribute::Text(text.to_owned());
        let mut attributes = BTreeMap::from([
            ("kind".to_owned(), text("selenograph.truth")),
            ("unit".to_owned(), text("depth_z: m along the optical axis; range: m along the ray")),
            ("camera".to_owned(), text(camera)),
        ]);
        if self.stored == SampleType::Half {
            let note = "imported from half float: 11 significant bits, steps of 8 to 32 m from 8 to 65 km; do not take slopes";
            attributes.insert("note".to_owned(), text(note));
        }
        ExrImage {
            width,
            height,
            channels: vec![
                Channel::float("depth_z", self.depth_z.data.clone()),
                Channel::float("range", range.data),
                Channel::float("valid", valid),
            ],
            attributes,
        }
    }
}
