//! GeoKeys → coordinate system; the transform tags → affine map.
//!
//! # Source
//! OGC 19-008r4, "GeoTIFF standard" 1.1, and for what it leaves open (latitudes of true scale, both spellings of a
//! polar map) what GDAL writes.

use crate::dem::info::HeightUnit;
use crate::{Affine, Error};
use selenograph_geometry::proj_string::{self, Crs};
use std::collections::BTreeMap;
use std::path::Path;

const MODEL_TYPE: u16 = 1024;
const RASTER_TYPE: u16 = 1025;
const CITATION: u16 = 1026;
const GEOGRAPHIC_TYPE: u16 = 2048;
const GEOGRAPHIC_CITATION: u16 = 2049;
const PRIME_MERIDIAN: u16 = 2051;
const GEOGRAPHIC_LINEAR_UNITS: u16 = 2052;
const GEOGRAPHIC_LINEAR_UNIT_SIZE: u16 = 2053;
const ANGULAR_UNITS: u16 = 2054;
const ANGULAR_UNIT_SIZE: u16 = 2055;
const SEMI_MAJOR_AXIS: u16 = 2057;
const SEMI_MINOR_AXIS: u16 = 2058;
const INVERSE_FLATTENING: u16 = 2059;
const PRIME_MERIDIAN_LONG: u16 = 2061;
const PROJECTED_TYPE: u16 = 3072;
const PROJECTED_CITATION: u16 = 3073;
const COORDINATE_TRANSFORM: u16 = 3075;
const LINEAR_UNITS: u16 = 3076;
const LINEAR_UNIT_SIZE: u16 = 3077;
const STD_PARALLEL_1: u16 = 3078;
const NAT_ORIGIN_LONG: u16 = 3080;
const NAT_ORIGIN_LAT: u16 = 3081;
const FALSE_EASTING: u16 = 3082;
const FALSE_NORTHING: u16 = 3083;
const CENTER_LONG: u16 = 3088;
const CENTER_LAT: u16 = 3089;
const SCALE_AT_NAT_ORIGIN: u16 = 3092;
const SCALE_AT_CENTER: u16 = 3093;
const STRAIGHT_POLE_LONG: u16 = 3095;
const VERTICAL_UNITS: u16 = 4099;

const GEOGRAPHIC_MODEL: u16 = 2;
const GREENWICH: u16 = 8901;

const USER_DEFINED: u16 = 32767;

/// Names of the coordinate transformations by their code, for messages.
const TRANSFORMS: [&str; 29] = [
    "none",
    "TransverseMercator",
    "TransvMercator_Modified_Alaska",
    "ObliqueMercator",
    "ObliqueMercator_Laborde",
    "ObliqueMercator_Rosenmund",
    "ObliqueMercator_Spherical",
    "Mercator",
    "LambertConfConic_2SP",
    "LambertConfConic_Helmert",
    "LambertAzimEqualArea",
    "AlbersEqualArea",
    "AzimuthalEquidistant",
    "EquidistantConic",
    "Stereographic",
    "PolarStereographic",
    "ObliqueStereographic",
    "Equirectangular",
    "CassiniSoldner",
    "Gnomonic",
    "MillerCylindrical",
    "Orthographic",
    "Polyconic",
    "Robinson",
    "Sinusoidal",
    "VanDerGrinten",
    "NewZealandMapGrid",
    "TransvMercator_SouthOriented",
    "CylindricalEqualArea",
];

/// The keys of a file, by number.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct GeoKeys {
    codes: BTreeMap<u16, u16>,
    numbers: BTreeMap<u16, f64>,
    texts: BTreeMap<u16, String>,
}

impl GeoKeys {
    /// From the three tags; entries that point outside them are left out.
    pub(super) fn parse(directory: &[u64], numbers: &[f64], text: &str) -> Self {
        let mut keys = Self::default();
        let count = directory.get(3).copied().unwrap_or(0) as usize;
        for entry in directory.get(4..).unwrap_or(&[]).chunks_exact(4).take(count) {
            let (key, location, size, value) = (entry[0] as u16, entry[1], entry[2], entry[3]);
            match location {
                0 => drop(keys.codes.insert(key, value as u16)),
                34736 => {
                    if let Some(&number) = numbers.get(value as usize) {
                        keys.numbers.insert(key, number);
                    }
                }
                34737 => {
                    let end = (value as usize).saturating_add(size as usize).min(text.len());
                    if let Some(part) = text.get(value as usize..end) {
                        keys.texts.insert(key, part.trim_end_matches(['|', '\0']).to_owned());
                    }
                }
                _ => {}
            }
        }
        keys
    }

    pub(super) fn is_empty(&self) -> bool {
        self.codes.is_empty() && self.texts.is_empty()
    }

    /// Whether coordinates belong to pixel centres (`RasterPixelIsPoint`).
    pub(super) fn is_point(&self) -> bool {
        self.codes.get(&RASTER_TYPE) == Some(&2)
    }

    /// The name that the file gives its coordinate system.
    pub(super) fn citation(&self) -> Option<&str> {
        [PROJECTED_CITATION, CITATION, GEOGRAPHIC_CITATION]
            .iter()
            .find_map(|key| self.texts.get(key))
            .map(String::as_str)
    }

    fn first_number(&self, keys: &[u16]) -> Option<f64> {
        keys.iter().find_map(|key| self.numbers.get(key)).copied()
    }

    /// Metres per unit of length by its code; `None` for a unit without a size.
    fn length_unit_m(&self, code: u16, size: u16) -> Option<f64> {
        match self.codes.get(&code) {
            None | Some(0 | 9001) => Some(1.0),
            Some(9036) => Some(1000.0),
            Some(9002) => Some(0.3048),
            Some(9003) => Some(1200.0 / 3937.0),
            Some(_) => self.first_number(&[size]),
        }
    }

    /// Metres per unit of a projected map.
    fn linear_unit_m(&self, path: &Path) -> Result<f64, Error> {
        self.length_unit_m(LINEAR_UNITS, LINEAR_UNIT_SIZE).ok_or_else(|| Error::NoGeoreference {
            path: path.to_owned(),
            what: "its GeoKeys name a length unit without its size".to_owned(),
        })
    }

    /// Degrees per angular unit of the file.
    fn angular_unit_deg(&self, path: &Path) -> Result<f64, Error> {
        let code = self.codes.get(&ANGULAR_UNITS).copied().unwrap_or(9102);
        match code {
            0 | 9102 | 9122 => Ok(1.0),
            9101 => Ok(1f64.to_degrees()),
            9103 => Ok(1.0 / 60.0),
            9104 => Ok(1.0 / 3600.0),
            9105 | 9106 => Ok(0.9),
            _ => self.first_number(&[ANGULAR_UNIT_SIZE]).map(f64::to_degrees).ok_or_else(|| {
                Error::Unsupported {
                    path: path.to_owned(),
                    what: "angular unit",
                    found: format!("EPSG:{code}"),
                    supported: "degrees, radians, grads, minutes, seconds",
                }
            }),
        }
    }

    /// Metres or degrees per unit of the map.
    pub(super) fn map_unit(&self, path: &Path) -> Result<f64, Error> {
        match self.codes.get(&MODEL_TYPE) {
            Some(&GEOGRAPHIC_MODEL) => self.angular_unit_deg(path),
            _ => self.linear_unit_m(path),
        }
    }

    /// East longitude of the meridian that longitudes count from, degrees.
    fn prime_meridian_deg(&self, path: &Path) -> Result<f64, Error> {
        let code = self.codes.get(&PRIME_MERIDIAN).copied();
        match (self.first_number(&[PRIME_MERIDIAN_LONG]), code) {
            (Some(longitude), _) => Ok(longitude * self.angular_unit_deg(path)?),
            (None, None | Some(0 | GREENWICH | USER_DEFINED)) => Ok(0.0),
            (None, Some(code)) => Err(Error::Unsupported {
                path: path.to_owned(),
                what: "prime meridian",
                found: format!("EPSG:{code}"),
                supported: "0, or one whose longitude stands in the file",
            }),
        }
    }

    /// What is to be added to the longitudes of a geographic map, degrees.
    pub(super) fn first_longitude_deg(&self, path: &Path) -> Result<f64, Error> {
        match self.codes.get(&MODEL_TYPE) {
            Some(&GEOGRAPHIC_MODEL) => self.prime_meridian_deg(path),
            _ => Ok(0.0),
        }
    }

    /// The unit of heights: metres where the file says nothing.
    pub(super) fn vertical_unit(&self, path: &Path) -> Result<HeightUnit, Error> {
        match self.codes.get(&VERTICAL_UNITS) {
            None | Some(0 | 9001) => Ok(HeightUnit::Metre),
            Some(9036) => Ok(HeightUnit::Kilometre),
            Some(code) => Err(Error::Unsupported {
                path: path.to_owned(),
                what: "height unit",
                found: match code {
                    9002 => "foot".to_owned(),
                    9003 => "US survey foot".to_owned(),
                    _ => format!("EPSG:{code}"),
                },
                supported: "metres and kilometres",
            }),
        }
    }

    /// The coordinate system.
    ///
    /// # Errors
    /// [`Error::NoGeoreference`] where the keys say too little, [`Error::UnknownProjection`] or
    /// [`Error::CoordinateSystem`] where they name something else than a supported map of a sphere.
    pub(super) fn crs(&self, path: &Path) -> Result<Crs, Error> {
        let text = match self.iau_code() {
            Some(code) if self.prime_meridian_deg(path)? == 0.0 => code,
            Some(code) => {
                return Err(Error::Unsupported {
                    path: path.to_owned(),
                    what: "prime meridian",
                    found: format!("another than that of {code}"),
                    supported: "0, or one whose map is described by its parameters",
                });
            }
            None => self.proj_text(path)?,
        };
        proj_string::parse(&text).map_err(|source| Error::CoordinateSystem { path: path.to_owned(), source })
    }

    /// `IAU_2015:30135` and the like: named in a citation, or as the number of the system.
    fn iau_code(&self) -> Option<String> {
        if let Some(code) =
            [PROJECTED_TYPE, GEOGRAPHIC_TYPE].iter().find_map(|key| self.codes.get(key)).copied()
            && (30100..30200).contains(&code)
        {
            return Some(format!("IAU_2015:{code}"));
        }
        // A full set of parameters says more than a name.
        if self.codes.contains_key(&COORDINATE_TRANSFORM) || self.numbers.contains_key(&SEMI_MAJOR_AXIS) {
            return None;
        }
        self.texts.values().find_map(|text| {
            let start = text.find("IAU_2015:").or_else(|| text.find("IAU:"))?;
            let code: String = text[start..]
                .chars()
                .take_while(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | ':'))
                .collect();
            Some(code)
        })
    }

    fn proj_text(&self, path: &Path) -> Result<String, Error> {
        let missing = |what: &str| Error::NoGeoreference { path: path.to_owned(), what: what.to_owned() };
        let unknown = |name: String| Error::UnknownProjection { path: path.to_owned(), name };
        if self.is_empty() {
            return Err(missing("it has no GeoKeys, so its coordinate system is unknown"));
        }
        let model = self.codes.get(&MODEL_TYPE).copied();
        for key in [PROJECTED_TYPE, GEOGRAPHIC_TYPE] {
            if let Some(&code) = self.codes.get(&key)
                && code != 0
                && code != USER_DEFINED
            {
                return Err(unknown(format!("EPSG:{code}")));
            }
        }
        let radius = self.radius().ok_or_else(|| missing("its GeoKeys give no radius of the sphere"))?;
        match (model, self.codes.get(&COORDINATE_TRANSFORM).copied()) {
            (Some(GEOGRAPHIC_MODEL), _) => Ok(format!("+proj=longlat {radius}")),
            (Some(1) | None, Some(transform)) => {
                let projection = self.projection_text(transform, path)?.ok_or_else(|| {
                    let name = TRANSFORMS.get(usize::from(transform));
                    unknown(
                        name.map_or_else(|| format!("coordinate transform {transform}"), |n| (*n).to_owned()),
                    )
                })?;
                Ok(format!("{projection} {radius}"))
            }
            (Some(1) | None, None) => Err(missing("its GeoKeys name no projection")),
            (Some(other), _) => Err(unknown(format!("model type {other}"))),
        }
    }

    fn radius(&self) -> Option<String> {
        let unit_m = self.length_unit_m(GEOGRAPHIC_LINEAR_UNITS, GEOGRAPHIC_LINEAR_UNIT_SIZE)?;
        let a = self.first_number(&[SEMI_MAJOR_AXIS])? * unit_m;
        let b = match (
            self.first_number(&[SEMI_MINOR_AXIS]).map(|b| b * unit_m),
            self.first_number(&[INVERSE_FLATTENING]),
        ) {
            (Some(b), _) if b > 0.0 => b,
            (_, Some(inverse)) if inverse != 0.0 => a * (1.0 - 1.0 / inverse),
            _ => a,
        };
        Some(format!("+a={a} +b={b}"))
    }

    /// `None` for a projection that is not computed here.
    fn projection_text(&self, transform: u16, path: &Path) -> Result<Option<String>, Error> {
        let (deg, unit_m) = (self.angular_unit_deg(path)?, self.linear_unit_m(path)?);
        let angle = |keys: &[u16]| self.first_number(keys).map(|v| v * deg);
        let latitude = angle(&[NAT_ORIGIN_LAT, CENTER_LAT]);
        let longitude = angle(&[STRAIGHT_POLE_LONG, NAT_ORIGIN_LONG, CENTER_LONG]).unwrap_or(0.0)
            + self.prime_meridian_deg(path)?;
        let scale = self.first_number(&[SCALE_AT_NAT_ORIGIN, SCALE_AT_CENTER]);
        let true_scale = angle(&[STD_PARALLEL_1]);
        let offsets = format!(
            "+lon_0={longitude} +x_0={} +y_0={}",
            self.first_number(&[FALSE_EASTING]).unwrap_or(0.0) * unit_m,
            self.first_number(&[FALSE_NORTHING]).unwrap_or(0.0) * unit_m,
        );
        let centre = latitude.or(true_scale);
        Ok(match transform {
            15 => centre.map(|centre| format!("{} {offsets}", polar_text(centre, true_scale, scale))),
            14 | 16 => {
                latitude.map(|lat| format!("+proj=stere +lat_0={lat} +k={} {offsets}", scale.unwrap_or(1.0)))
            }
            17 => Some(format!(
                "+proj=eqc +lat_ts={} +lat_0={} {offsets}",
                true_scale.unwrap_or(0.0),
                latitude.unwrap_or(0.0)
            )),
            21 => Some(format!("+proj=ortho +lat_0={} {offsets}", latitude.unwrap_or(0.0))),
            _ => None,
        })
    }
}

/// In a polar map the latitude of origin is the pole, with a scale there, or (as in PROJ and GDAL) the latitude of
/// true scale.
fn polar_text(latitude: f64, true_scale: Option<f64>, scale: Option<f64>) -> String {
    let pole = 90f64.copysign(latitude);
    let at_pole = (latitude.abs() - 90.0).abs() < 1e-9;
    match (at_pole, true_scale) {
        (true, Some(lat_ts)) if scale.is_none() => format!("+proj=stere +lat_0={pole} +lat_ts={lat_ts}"),
        (true, _) => format!("+proj=stere +lat_0={pole} +k={}", scale.unwrap_or(1.0)),
        (false, _) => format!("+proj=stere +lat_0={pole} +lat_ts={latitude}"),
    }
}

/// The affine map of the transform tags, as the file means it (area or point); `None` if it has none.
pub(super) fn affine_of_tags(
    matrix: Option<&[f64]>,
    scale: Option<&[f64]>,
    tie: Option<&[f64]>,
) -> Option<Affine> {
    if let Some([a, b, _, x0, d, e, _, y0, ..]) = matrix {
        return Some(Affine::new([*x0, *a, *b, *y0, *d, *e]));
    }
    match (scale, tie) {
        (Some([step_x, step_y, ..]), Some([column, row, _, x, y, _, ..])) => {
            // The standard counts rows downwards whatever the sign; so does GDAL.
            let (step_x, step_y) = (*step_x, step_y.abs());
            Some(Affine::north_up(x - column * step_x, y + row * step_y, step_x, step_y))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selenograph_geometry::{Pole, Projection};

    fn keys(codes: &[(u16, u16)], numbers: &[(u16, f64)]) -> GeoKeys {
        GeoKeys {
            codes: codes.iter().copied().collect(),
            numbers: numbers.iter().copied().collect(),
            texts: BTreeMap::new(),
        }
    }

    fn parsed(codes: &[(u16, u16)], numbers: &[(u16, f64)]) -> Result<Crs, Error> {
        keys(codes, numbers).crs(Path::new("x.tif"))
    }

    const MOON: (u16, f64) = (SEMI_MAJOR_AXIS, 1_737_400.0);

    #[test]
    fn the_spellings_of_a_polar_map_agree() {
        let codes = |ct| [(MODEL_TYPE, 1), (COORDINATE_TRANSFORM, ct)];
        let south = Projection::south_polar(1_737_400.0);
        for numbers in [
            vec![MOON, (NAT_ORIGIN_LAT, -90.0), (SCALE_AT_NAT_ORIGIN, 1.0), (STRAIGHT_POLE_LONG, 0.0)],
            vec![MOON, (NAT_ORIGIN_LAT, -90.0), (STD_PARALLEL_1, -90.0)],
            vec![MOON, (STD_PARALLEL_1, -90.0)],
        ] {
            assert_eq!(parsed(&codes(15), &numbers).unwrap().projection, south);
        }
        for ct in [14, 16] {
            let numbers = [MOON, (CENTER_LAT, -90.0), (CENTER_LONG, 0.0)];
            assert_eq!(parsed(&codes(ct), &numbers).unwrap().projection, south);
        }
        let mars = [(SEMI_MAJOR_AXIS, 3_396_190.0), (NAT_ORIGIN_LAT, 70.0)];
        let Projection::PolarStereographic { pole, k0, .. } = parsed(&codes(15), &mars).unwrap().projection
        else {
            panic!("not polar")
        };
        assert_eq!(pole, Pole::North);
        assert!((k0 - f64::midpoint(1.0, 70f64.to_radians().sin())).abs() < 1e-15);
    }

    #[test]
    fn what_has_no_closed_form_is_refused_by_name() {
        let refused =
            |codes: &[(u16, u16)], numbers: &[(u16, f64)]| parsed(codes, numbers).unwrap_err().to_string();
        assert!(refused(&[(MODEL_TYPE, 1), (COORDINATE_TRANSFORM, 7)], &[MOON]).contains("Mercator"));
        assert!(refused(&[(MODEL_TYPE, 1), (PROJECTED_TYPE, 32661)], &[MOON]).contains("EPSG:32661"));
        assert!(refused(&[(MODEL_TYPE, 1), (COORDINATE_TRANSFORM, 15)], &[]).contains("no radius"));
        let ellipsoid = [(SEMI_MAJOR_AXIS, 3_396_190.0), (INVERSE_FLATTENING, 169.89)];
        assert!(refused(&[(MODEL_TYPE, 2)], &ellipsoid).contains("sphere"));
        assert!(GeoKeys::default().crs(Path::new("x")).unwrap_err().to_string().contains("GeoKeys"));
    }

    #[test]
    fn a_code_in_the_citation_is_enough() {
        let text = "IAU_2015:30135 - Moon (2015) - Sphere|";
        let directory = [1, 1, 0, 2, 1024, 0, 1, 1, 3073, 34737, text.len() as u64, 0];
        let keys = GeoKeys::parse(&directory, &[], text);
        assert_eq!(keys.crs(Path::new("x")).unwrap().projection, Projection::south_polar(1_737_400.0));
    }

    #[test]
    fn transform_tags_become_affine_maps() {
        let scale = affine_of_tags(None, Some(&[5.0, 5.0, 0.0]), Some(&[10.0, 20.0, 0.0, 100.0, 200.0, 0.0]));
        assert_eq!(scale.unwrap().apply(10.0, 20.0), [100.0, 200.0]);
        assert_eq!(scale.unwrap().apply(11.0, 21.0), [105.0, 195.0]);
        let mut matrix = [0.0; 16];
        (matrix[0], matrix[1], matrix[3], matrix[4], matrix[5], matrix[7]) = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0);
        let matrix = affine_of_tags(Some(&matrix), None, None).unwrap();
        assert_eq!(matrix.coefficients, [3.0, 1.0, 2.0, 6.0, 4.0, 5.0]);
        assert!(affine_of_tags(None, Some(&[5.0, 5.0, 0.0]), None).is_none());
        assert!(affine_of_tags(None, None, Some(&[0.0; 12])).is_none());
    }
}
