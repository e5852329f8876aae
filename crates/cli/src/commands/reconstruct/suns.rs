//! The Suns of both pictures: as they were told, else from times, labels and records.

use crate::args::reconstruct::{Known, SunGiven};
use crate::exit::refuse;
use selenograph_dataset::stored::sun_of_picture;
use selenograph_geometry::sun::{DIRECTION_SIGMA_RAD, sub_solar};
use selenograph_geometry::time::Utc;
use selenograph_geometry::{CamA, CamB, Rigid3, Vector3};
use selenograph_raster::illumination::read_illumination;
use selenograph_reconstruct::priors::{KnownSun, Priors, SunAxes};
use selenograph_reconstruct::scale::World;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A Sun so near to where a camera looks, radians, stands in the picture or behind the ground.
const IN_VIEW_RAD: f64 = 20.0 * std::f64::consts::PI / 180.0;

/// One Sun, for the record.
#[derive(Debug, Clone, Serialize)]
pub struct SunRecord {
    /// What told it.
    from: String,
    /// `cam_a`, or `own` for the axes of the picture's own camera.
    axes: &'static str,
    /// Unit vector towards it.
    direction: [f64; 3],
    /// Standard deviation of the direction, degrees; 0 where nothing tells it.
    sigma_deg: f64,
    /// Above the horizon of the ground that the first camera looks at, degrees; absent where nothing tells what is up.
    #[serde(skip_serializing_if = "Option::is_none")]
    elevation_deg: Option<f64>,
}

impl SunRecord {
    fn sentence(&self, picture: &str) -> String {
        let elevation =
            self.elevation_deg.map_or_else(String::new, |e| format!(", {e:.1}° above the horizon"));
        format!("Sun of picture {picture}: from {}{elevation}", self.from)
    }
}

/// Both Suns as far as they are known, and what is to be said of them.
#[derive(Debug, Default)]
pub struct Suns {
    pub known: [Option<KnownSun>; 2],
    pub records: [Option<SunRecord>; 2],
    /// Files that were read for them.
    pub files: Vec<PathBuf>,
    pub notes: Vec<String>,
    /// Why a picture's own files tell no Sun.
    why_not: [Option<String>; 2],
}

/// What one picture's Sun was asked for by.
struct Picture<'a> {
    idx: usize,
    name: &'static str,
    sun: Option<SunGiven>,
    time: Option<Utc>,
    path: &'a Path,
}

/// A Sun and what told it.
struct Told {
    sun: KnownSun,
    from: String,
}

/// Both Suns, each from the first that tells it: `--sun-…`, `--time-…`, with `with_files` the picture's label and the record of its pair.
///
/// # Errors
/// A Sun or time that needs a place without one; a time at which the Sun does not shine there; labels that cannot be read.
pub fn find(known: &Known, priors: &Priors, paths: &[PathBuf; 2], with_files: bool) -> anyhow::Result<Suns> {
    let mut suns = Suns::default();
    let given = [("a", known.sun_a, known.time_a), ("b", known.sun_b, known.time_b)];
    for (idx, (name, sun, time)) in given.into_iter().enumerate() {
        let picture = Picture { idx, name, sun, time, path: &paths[idx] };
        let told = match suns.told(&picture, known, priors)? {
            None if with_files => suns.by_files(&picture, priors)?,
            told => told,
        };
        suns.known[idx] = told.as_ref().map(|told| told.sun);
        suns.records[idx] = told.map(|Told { sun, from }| SunRecord {
            from,
            axes: match sun.axes {
                SunAxes::Own if idx == 1 => "own",
                _ => "cam_a",
            },
            direction: sun.direction.into(),
            sigma_deg: sun.sigma_rad.to_degrees(),
            elevation_deg: elevation_deg(&sun, idx, priors),
        });
    }
    Ok(suns)
}

/// Above the horizon of the ground that the first camera looks at, degrees.
fn elevation_deg(sun: &KnownSun, idx: usize, priors: &Priors) -> Option<f64> {
    let cam_a_from_own: Rigid3<CamA, CamB> = match (&priors.cam_b_from_cam_a, sun.axes, idx) {
        (Some(pose), ..) if idx == 1 => pose.cam_b_from_cam_a.inverse(),
        (None, SunAxes::Own, 1) => return None,
        _ => Rigid3::identity(),
    };
    Some(priors.world.elevation_rad(&sun.in_cam_a(&cam_a_from_own))?.to_degrees())
}

impl Suns {
    /// As it was told on the command line.
    fn told(
        &mut self,
        picture: &Picture<'_>,
        known: &Known,
        priors: &Priors,
    ) -> anyhow::Result<Option<Told>> {
        let (option, time_option) = (format!("--sun-{}", picture.name), format!("--time-{}", picture.name));
        let world = &priors.world;
        match (picture.sun, picture.time) {
            (Some(SunGiven::Camera(direction)), _) => {
                let sun = KnownSun { direction: direction.into(), axes: SunAxes::Own, sigma_rad: 0.0 };
                self.notes.extend(absurd(&option, &sun, picture.idx, priors));
                Ok(Some(Told { sun, from: option }))
            }
            (Some(SunGiven::Sky([azimuth, elevation])), _) => {
                let found = world.sky_in_cam_a(azimuth.to_radians(), elevation.to_radians());
                let direction = found.filter(|_| known.world_from_cam_a.is_some()).ok_or_else(|| {
                    refuse(
                        format!("{option} in azimuth and elevation, and nothing says where north is"),
                        "give --world-from-cam-a as well, or the Sun as a vector X,Y,Z in the camera's axes",
                    )
                })?;
                let sun = KnownSun { direction, axes: SunAxes::CamA, sigma_rad: 0.0 };
                Ok(Some(Told { sun, from: option }))
            }
            (None, Some(time)) => {
                let below = sub_solar(time)?;
                let direction = world.sun_in_cam_a(&below).ok_or_else(|| {
                    refuse(
                        format!("{time_option} tells where the Sun stood over the Moon, and nothing says where on the Moon the first camera stood"),
                        format!("give --world-from-cam-a with a pose in `moon_me`, or the Sun itself with {option}"),
                    )
                })?;
                let sun = KnownSun { direction, axes: SunAxes::CamA, sigma_rad: DIRECTION_SIGMA_RAD };
                if let Some(dark) = dark(&sun, picture.idx, priors) {
                    return Err(refuse(
                        format!("{time_option} {time}: the Sun stands {dark}"),
                        format!(
                            "is the time UTC, and the place that of the picture? a Sun that is known otherwise is told by {option} X,Y,Z"
                        ),
                    ));
                }
                Ok(Some(Told { sun, from: format!("{time_option}, {time}") }))
            }
            (None, None) => Ok(None),
        }
    }

    /// From the picture's label, else from the record of the pair that it lies in; what is not used is said.
    fn by_files(&mut self, picture: &Picture<'_>, priors: &Priors) -> anyhow::Result<Option<Told>> {
        let name = picture.path.display();
        if let Some(told) = self.by_label(picture, priors)? {
            return Ok(Some(told));
        }
        match sun_of_picture(picture.path) {
            Ok(None) => Ok(None),
            Ok(Some(found)) => {
                let (direction, sigma_rad) = (found.direction_in_cam, found.sigma_rad);
                let told =
                    Told { sun: KnownSun { direction, axes: SunAxes::Own, sigma_rad }, from: found.from };
                let told = self.unless_dark(picture, priors, told);
                self.files.extend(found.files.into_iter().filter(|_| told.is_some()));
                Ok(told)
            }
            Err(error) => {
                self.not_used(picture, format!("`{name}`: the record of its pair tells no Sun: {error}"));
                Ok(None)
            }
        }
    }

    fn by_label(&mut self, picture: &Picture<'_>, priors: &Priors) -> anyhow::Result<Option<Told>> {
        let Some(said) = read_illumination(picture.path)? else { return Ok(None) };
        let label = said.label.display();
        for note in &said.notes {
            self.not_used(picture, format!("`{label}`: {note}"));
        }
        let Some(found) = said.sun() else { return Ok(None) };
        let from = format!("`{label}`, {}", found.from);
        let Some(direction) = priors.world.sun_in_cam_a(&found.sub_solar) else {
            self.not_used(
                picture,
                format!("the Sun of {from} is not used: it needs the place of the first camera, --world-from-cam-a with a pose in `moon_me`"),
            );
            return Ok(None);
        };
        let sun = KnownSun { direction, axes: SunAxes::CamA, sigma_rad: found.sigma_rad };
        let told = self.unless_dark(picture, priors, Told { sun, from });
        self.files.extend(told.is_some().then(|| said.label.clone()));
        Ok(told)
    }

    fn unless_dark(&mut self, picture: &Picture<'_>, priors: &Priors, told: Told) -> Option<Told> {
        let Some(dark) = dark(&told.sun, picture.idx, priors) else { return Some(told) };
        self.not_used(picture, format!("the Sun of {} is not used: it stands {dark}", told.from));
        None
    }

    fn not_used(&mut self, picture: &Picture<'_>, why: String) {
        self.why_not[picture.idx] = Some(why.clone());
        self.notes.push(why);
    }

    /// Which is not known, and why the pictures' own files do not tell it; `None` where both are.
    pub fn missing(&self) -> Option<String> {
        let missing = match &self.known {
            [Some(_), Some(_)] => return None,
            [None, None] => "no Sun is given",
            [None, Some(_)] => "the Sun of the first picture is not known",
            [Some(_), None] => "the Sun of the second picture is not known",
        };
        let reasons = self.known.iter().zip(&self.why_not).filter(|(known, _)| known.is_none());
        let why = reasons.filter_map(|(_, why)| why.as_deref()).next();
        let why = why.map_or_else(String::new, |why| format!(" ({why})"));
        Some(format!("{missing}{why}"))
    }

    /// Both are needed by what the command line asks for.
    ///
    /// # Errors
    /// A Sun that nothing tells.
    pub fn both(&self, asked: &str) -> anyhow::Result<()> {
        let Some(missing) = self.missing() else { return Ok(()) };
        Err(refuse(
            format!("{asked} looks at shading, and {missing}"),
            "give --sun-a and --sun-b (AZ,EL or X,Y,Z), or --time-a and --time-b (UTC) with --world-from-cam-a; labels that state a time or the \
             point below the Sun tell theirs with it, pictures in a pair folder of ours or of triplets by themselves; or take --method stereo",
        ))
    }

    /// Leaves out what the pictures' own files tell of Suns that are of no use.
    pub fn without_files(&mut self) {
        let why_not = &self.why_not;
        self.notes.retain(|note| !why_not.iter().flatten().any(|why| why == note));
    }

    /// What was found, in sentences.
    pub fn sentences(&self) -> impl Iterator<Item = String> {
        let named = ["A", "B"].into_iter().zip(&self.records);
        named.filter_map(|(picture, record)| Some(record.as_ref()?.sentence(picture)))
    }
}

/// How far below the horizon a Sun stands that does not light the ground.
fn dark(sun: &KnownSun, idx: usize, priors: &Priors) -> Option<String> {
    let elevation = elevation_deg(sun, idx, priors).filter(|elevation| *elevation <= 0.0)?;
    let ground = match (&priors.world, priors.world.ground()) {
        (World::Body { .. }, Some(place)) => {
            format!("the ground at {:.2}°, {:.2}°", place.lat_rad.to_degrees(), place.lon_rad.to_degrees())
        }
        _ => "the ground".to_owned(),
    };
    Some(format!("{:.1}° below the horizon of {ground} that the first camera looks at", -elevation))
}

/// What makes a vector in camera axes one that no Sun of this picture has.
fn absurd(option: &str, sun: &KnownSun, idx: usize, priors: &Priors) -> Option<String> {
    if let Some(dark) = dark(sun, idx, priors) {
        return Some(format!("the Sun of {option} stands {dark}"));
    }
    let off = sun.direction.angle(&Vector3::z());
    (off < IN_VIEW_RAD).then(|| {
        format!(
            "the Sun of {option} stands {:.0}° off the axis along which the camera looks (Z is forward): in the picture or behind the ground",
            off.to_degrees()
        )
    })
}
