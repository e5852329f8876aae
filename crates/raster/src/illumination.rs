//! What a picture's label says of the Sun that lit it.

use crate::Error;
use crate::codec::picture::{described_by, isis};
use crate::content::Content;
use crate::dem::{pds3, pds4};
use selenograph_geometry::sun::{self, SubSolar};
use selenograph_geometry::time::Utc;
use std::path::{Path, PathBuf};

/// The Sun stands over another point by 0.1° after this time: a picture that took longer has no one Sun.
const MAX_SECONDS: f64 = 720.0;

/// The Sun is never further from the Moon's equator, degrees: 1.54° of Cassini's laws and the physical librations.
const MAX_LATITUDE_DEG: f64 = 1.65;

/// Two statements of one label that differ by more are said, degrees.
const DISAGREEMENT_DEG: f64 = 1.0;

/// What a label says of the Sun.
///
/// Only what a standard defines is read: the point of the body below the Sun, and the time (UTC) of the picture. Azimuths of the Sun are not:
/// `SUB_SOLAR_AZIMUTH` of PDS3 and `SubSolarAzimuth` of ISIS count from the right in the plane of the picture, which may have been turned
/// or projected since; `SUB_SOLAR_GROUND_AZIMUTH`, `SubSolarGroundAzimuth` and `sun_azimuth` of missions' own dictionaries count from what
/// each producer took. A label that has one is answered with a note.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Illumination {
    /// The file with the label.
    pub label: PathBuf,
    /// The point of the Moon below the Sun, as stated.
    pub sub_solar: Option<SubSolar>,
    /// The middle of the time in which the picture was taken.
    pub taken: Option<Utc>,
    /// The keywords that say so: those of the point, and those of the time.
    pub keywords: [String; 2],
    /// What was said and is not believed or not defined, in sentences.
    pub notes: Vec<String>,
}

/// The Sun of a label.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelSun {
    /// Where it stood.
    pub sub_solar: SubSolar,
    /// Standard deviation of the direction, radians; 0 where the label states the point.
    pub sigma_rad: f64,
    /// The keywords it is from, for people.
    pub from: String,
}

impl Illumination {
    /// The Sun: the point that is stated, else the one of the time.
    pub fn sun(&self) -> Option<LabelSun> {
        if let Some(sub_solar) = self.sub_solar {
            return Some(LabelSun { sub_solar, sigma_rad: 0.0, from: self.keywords[0].clone() });
        }
        let taken = self.taken?;
        let from = format!("{}, {taken}", self.keywords[1]);
        Some(LabelSun { sub_solar: sun::sub_solar(taken).ok()?, sigma_rad: sun::DIRECTION_SIGMA_RAD, from })
    }
}

/// Reads what the label of a picture says of the Sun: attached, detached or beside it, as [`crate::codec::picture::read_picture`] finds it; `None` for
/// pictures without a label and labels that say nothing.
///
/// # Errors
/// [`Error::Io`] and [`Error::Malformed`] for a label that cannot be read.
pub fn read_illumination(path: &Path) -> Result<Option<Illumination>, Error> {
    let (label, content) = described_by(path)?;
    let said = match content {
        Content::Pds3 => pds3::keywords(&label)?.read(&PDS3, &label),
        Content::Xml => pds4::keywords(&label)?.read(&PDS4, &label),
        Content::Isis => isis::keywords(&label)?.read(&ISIS, &label),
        _ => return Ok(None),
    };
    let says_nothing = said.sub_solar.is_none() && said.taken.is_none() && said.notes.is_empty();
    Ok((!says_nothing).then_some(said))
}

/// What the formats call it.
struct Names {
    target: &'static str,
    latitude: &'static [&'static str],
    longitude: &'static [&'static str],
    longitude_direction: &'static str,
    start: &'static str,
    stop: &'static str,
    /// Azimuths of the Sun without a reference.
    undefined: &'static [&'static str],
}

const PDS3: Names = Names {
    target: "TARGET_NAME",
    latitude: &["SUB_SOLAR_LATITUDE"],
    longitude: &["SUB_SOLAR_LONGITUDE"],
    longitude_direction: "POSITIVE_LONGITUDE_DIRECTION",
    start: "START_TIME",
    stop: "STOP_TIME",
    undefined: &["SUB_SOLAR_AZIMUTH", "SUB_SOLAR_GROUND_AZIMUTH", "SOLAR_AZIMUTH", "SUN_AZIMUTH"],
};

const PDS4: Names = Names {
    target: "Target_Identification/name",
    latitude: &["subsolar_latitude", "sub_solar_latitude"],
    longitude: &["subsolar_longitude", "sub_solar_longitude"],
    longitude_direction: "longitude_direction",
    start: "start_date_time",
    stop: "stop_date_time",
    undefined: &["subsolar_azimuth", "sub_solar_azimuth", "solar_azimuth", "sun_azimuth"],
};

const ISIS: Names = Names {
    target: "TargetName",
    latitude: &["SubSolarLatitude"],
    longitude: &["SubSolarLongitude"],
    longitude_direction: "LongitudeDirection",
    start: "StartTime",
    stop: "StopTime",
    undefined: &["SubSolarAzimuth", "SubSolarGroundAzimuth", "SolarAzimuth", "SunAzimuth"],
};

/// The text of a keyword and its unit.
pub(crate) type Stated = (String, Option<String>);

/// The first value of each keyword that was asked for, by its name.
pub(crate) struct Keywords(pub(crate) Vec<(&'static str, Stated)>);

/// All names that are looked for.
pub(crate) fn names() -> impl Iterator<Item = &'static str> {
    [&PDS3, &PDS4, &ISIS].into_iter().flat_map(|names| {
        let one = [names.target, names.longitude_direction, names.start, names.stop];
        one.into_iter().chain([names.latitude, names.longitude, names.undefined].concat())
    })
}

impl Keywords {
    /// The value of a keyword that has one.
    fn get(&self, name: &str) -> Option<&Stated> {
        let (_, stated) = self.0.iter().find(|(key, _)| *key == name)?;
        let is_absent = ["", "N/A", "UNK", "NULL", "NONE", "UNKNOWN"];
        (!is_absent.contains(&stated.0.to_ascii_uppercase().as_str())).then_some(stated)
    }

    fn first(&self, names: &'static [&'static str]) -> Option<(&'static str, &Stated)> {
        names.iter().find_map(|name| Some((*name, self.get(name)?)))
    }

    fn read(&self, names: &Names, label: &Path) -> Illumination {
        let mut notes = Vec::new();
        for name in names.undefined {
            if let Some((value, _)) = self.get(name) {
                notes.push(format!("{name} = {value} is not used: it does not say what it counts from"));
            }
        }
        let mut said = Illumination {
            label: label.to_owned(),
            sub_solar: None,
            taken: None,
            keywords: Default::default(),
            notes,
        };
        if let Some((target, _)) = self.get(names.target)
            && !target.eq_ignore_ascii_case("moon")
        {
            said.notes.push(format!("{} is {target}: the Sun of the Moon does not light it", names.target));
            return said;
        }
        self.point(names, &mut said);
        self.time(names, &mut said);
        if let (Some(stated), Some(Ok(timed))) = (said.sub_solar, said.taken.map(sun::sub_solar)) {
            let apart = stated.position().coords.angle(&timed.position().coords).to_degrees();
            if apart > DISAGREEMENT_DEG {
                let [point, time] = &said.keywords;
                said.notes.push(format!("{point} and {time} differ by {apart:.1}°: the first is taken"));
            }
        }
        said
    }

    fn point(&self, names: &Names, said: &mut Illumination) {
        let (lat, lon) = match (self.first(names.latitude), self.first(names.longitude)) {
            (Some(lat), Some(lon)) => (lat, lon),
            (None, None) => return,
            (Some((name, _)), None) | (None, Some((name, _))) => {
                return said
                    .notes
                    .push(format!("{name} stands alone: a point has a latitude and a longitude"));
            }
        };
        let mut angle = |(name, (text, unit)): (&str, &Stated), largest: f64| {
            let in_degrees = unit.as_deref().is_none_or(|unit| unit.to_ascii_lowercase().starts_with("deg"));
            let degrees = text.parse::<f64>().ok().filter(|v| in_degrees && v.abs() <= largest);
            if degrees.is_none() {
                let unit = unit.as_deref().unwrap_or_default();
                let note =
                    format!("{name} = {text} {unit} is not used: expected up to {largest}° of the Moon");
                said.notes.push(note.replace("  ", " "));
            }
            degrees
        };
        let (Some(lat_deg), Some(lon_deg)) = (angle(lat, MAX_LATITUDE_DEG), angle(lon, 360.0)) else {
            return;
        };
        let westwards = self
            .get(names.longitude_direction)
            .is_some_and(|(word, _)| word.to_ascii_lowercase().contains("west"));
        said.sub_solar = Some(SubSolar::from_deg(lat_deg, if westwards { -lon_deg } else { lon_deg }));
        said.keywords[0] = format!("{} and {}", lat.0, lon.0);
    }

    fn time(&self, names: &Names, said: &mut Illumination) {
        let mut utc = |name: &str| {
            let (text, _) = self.get(name)?;
            let time = text.parse::<Utc>().and_then(|time| sun::sub_solar(time).map(|_| time));
            time.map_err(|error| said.notes.push(format!("{name} is not used: {error}"))).ok()
        };
        let Some(start) = utc(names.start) else { return };
        let Some(stop) = utc(names.stop) else {
            (said.taken, said.keywords[1]) = (Some(start), names.start.to_owned());
            return;
        };
        let seconds = start.seconds_to(stop);
        if (0.0..=MAX_SECONDS).contains(&seconds) {
            said.taken = Some(start.middle(stop));
            said.keywords[1] = format!("the middle of {} and {}", names.start, names.stop);
        } else {
            said.notes.push(format!(
                "{} and {} are not used: they lie {:.2} h apart, and within 0.2 h the Sun stands still",
                names.start,
                names.stop,
                seconds / 3600.0
            ));
        }
    }
}
