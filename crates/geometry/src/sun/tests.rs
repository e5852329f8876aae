//! The Sun over the Moon against published numbers, an ephemeris and another theory of the Moon's rotation.

use super::series::librations;
use super::*;
use crate::units::wrap_360_deg;
use nalgebra::Rotation3;

/// 1992 April 12, 0h TD: the day of Meeus' examples 47.a, 53.a and 53.b.
const EXAMPLE: f64 = -0.077_221_081_451;

/// Of the axes of inertia, as the book has it.
fn as_printed(arguments: &Arguments) -> Physical {
    let f = arguments.angles_deg[3].to_radians();
    let physical = Physical::at(arguments);
    Physical {
        rho: physical.rho - 0.022_45 * f.sin(),
        sigma: physical.sigma + 0.022_44 * f.cos(),
        ..physical
    }
}

fn at(centuries: f64) -> SubSolar {
    let arguments = Arguments::at(centuries);
    below(&arguments, Physical::at(&arguments))
}

fn at_as_printed(centuries: f64) -> SubSolar {
    let arguments = Arguments::at(centuries);
    below(&arguments, as_printed(&arguments))
}

fn utc(text: &str) -> Utc {
    text.parse().unwrap()
}

/// A difference of two longitudes, degrees in `[-180, 180)`.
fn turned(degrees: f64) -> f64 {
    wrap_360_deg(degrees + 180.0) - 180.0
}

#[test]
fn librations_are_those_of_the_book() {
    let arguments = Arguments::at(EXAMPLE);
    let moon = Ecliptic { lon_deg: 133.162_655, lat_deg: -3.229_126, distance_m: 368_409_700.0 };
    let physical = as_printed(&arguments);
    for (found, book) in [(physical.rho, -0.010_42), (physical.sigma, -0.015_74), (physical.tau, 0.026_73)] {
        assert!((found - book).abs() < 6e-6, "{found} against {book}");
    }
    let found = librations(&arguments, physical, &moon);
    let [optical, whole] = [found.optical_deg, found.place_deg()];
    for (found, book, half_digit) in [
        (optical[0], -1.206, 5e-4),
        (optical[1], 4.194, 5e-4),
        (found.physical_deg[0], -0.025, 5e-4),
        (found.physical_deg[1], 0.006, 5e-4),
        (whole[0], -1.23, 5e-3),
        (whole[1], 4.20, 5e-3),
    ] {
        assert!((found - book).abs() < half_digit, "{found} against {book}");
    }
}

#[test]
fn the_sun_of_the_book_stands_where_it_says() {
    let found = at_as_printed(EXAMPLE);
    assert!((found.lon_rad.to_degrees() - 67.89).abs() < 5e-3, "{}", found.lon_rad.to_degrees());
    assert!((found.lat_rad.to_degrees() - 1.46).abs() < 5e-3, "{}", found.lat_rad.to_degrees());
    // Colongitude 22.11°: the longitude of the morning terminator, counted westwards.
    assert!((wrap_360_deg(90.0 - found.lon_rad.to_degrees()) - 22.11).abs() < 5e-3);
}

#[test]
fn the_moon_is_where_the_book_says_as_far_as_it_matters() {
    let moon = series::moon(&Arguments::at(EXAMPLE));
    assert!(turned(moon.lon_deg - 133.162_655).abs() < 0.05, "{}", moon.lon_deg);
    assert!((moon.lat_deg + 3.229_126).abs() < 0.05, "{}", moon.lat_deg);
    assert!((moon.distance_m - 368_409_700.0).abs() < 500_000.0, "{}", moon.distance_m);
}

/// Apollo 15 metric camera, frames 0297 and 0300: the Sun of JPL's DE405 in the mean-Earth frame of DE403, from the tables
/// `SunPosition` and `BodyRotation` of their ISIS labels (USGS, public domain). Their times are `StartTime`.
const APOLLO: [(&str, [f64; 3]); 2] = [
    ("1971-07-31T01:25:02.243", [0.240_969_992, 78.738_229_197, 151_913_064_820.0]),
    ("1971-07-31T01:26:17.923", [0.240_951_892, 78.727_528_910, 151_913_115_579.0]),
];

#[test]
fn the_sun_of_an_ephemeris_stands_where_it_says() {
    for (time, [lat_deg, lon_deg, distance_m]) in APOLLO {
        let found = sub_solar(utc(time)).unwrap();
        let off = [found.lat_rad.to_degrees() - lat_deg, found.lon_rad.to_degrees() - lon_deg];
        println!("{time}: off by {:+.4}° in latitude, {:+.4}° in longitude", off[0], off[1]);
        assert!(off.iter().all(|off| off.abs() < 0.004), "{off:?}");
        assert!((found.distance_m / distance_m - 1.0).abs() < 1e-4, "{}", found.distance_m);
    }
}

/// The Sun of the same series in the Moon's axes after the report of the IAU's working group on cartographic coordinates for 2009
/// (Archinal et al. 2011, table 2): a theory of the rotation that shares nothing with Eckhardt's but the Moon, made for the mean-Earth axes
/// and good to 0.004°.
fn by_rotation_elements(centuries: f64) -> Vector3<f64> {
    let days = 36_525.0 * centuries;
    let sin_cos = [
        (125.045, -0.052_992_1),
        (250.089, -0.105_984_2),
        (260.008, 13.012_000_9),
        (176.625, 13.340_715_4),
        (357.529, 0.985_600_3),
        (311.589, 26.405_708_4),
        (134.963, 13.064_993_0),
        (276.617, 0.328_714_6),
        (34.226, 1.748_487_7),
        (15.134, -0.158_976_3),
        (119.743, 0.003_609_6),
        (239.961, 0.164_357_3),
        (25.053, 12.959_008_8),
    ]
    .map(|(start, rate): (f64, f64)| (start + rate * days).to_radians().sin_cos());
    let sines = |terms: &[(usize, f64)]| terms.iter().map(|(k, size)| size * sin_cos[k - 1].0).sum::<f64>();
    let cosines = |terms: &[(usize, f64)]| terms.iter().map(|(k, size)| size * sin_cos[k - 1].1).sum::<f64>();
    let right_ascension = 269.9949
        + 0.0031 * centuries
        + sines(&[
            (1, -3.8787),
            (2, -0.1204),
            (3, 0.0700),
            (4, -0.0172),
            (6, 0.0072),
            (10, -0.0052),
            (13, 0.0043),
        ]);
    let declination = 66.5392
        + 0.0130 * centuries
        + cosines(&[
            (1, 1.5419),
            (2, 0.0239),
            (3, -0.0278),
            (4, 0.0068),
            (6, -0.0029),
            (7, 0.0009),
            (10, 0.0008),
            (13, -0.0009),
        ]);
    let prime_meridian = 38.3213 + 13.176_358_15 * days - 1.4e-12 * days * days
        + sines(&[
            (1, 3.5610),
            (2, 0.1208),
            (3, -0.0642),
            (4, 0.0158),
            (5, 0.0252),
            (6, -0.0066),
            (7, -0.0047),
        ])
        + sines(&[(8, -0.0046), (9, 0.0028), (10, 0.0052), (11, 0.0040), (12, 0.0019), (13, -0.0044)]);
    // The Sun from the Moon on the ecliptic of date, then of J2000 (Meeus, chapter 21), then on the equator of J2000.
    let (sun, moon) = (series::sun(centuries), series::moon(&Arguments::at(centuries)));
    let vector = |place: &Ecliptic| {
        let (lon, lat) = (place.lon_deg.to_radians(), place.lat_deg.to_radians());
        Vector3::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin()) * place.distance_m
    };
    let about = |axis: Vector3<f64>, degrees: f64| {
        Rotation3::from_axis_angle(&nalgebra::Unit::new_unchecked(axis), degrees.to_radians())
    };
    let (x, z) = (Vector3::x(), Vector3::z());
    let tilt = (47.0029 * centuries - 0.033_02 * centuries * centuries) / 3600.0;
    let node = 174.876_384 - 869.8089 * centuries / 3600.0;
    let precession = (5029.0966 * centuries + 1.111_13 * centuries * centuries) / 3600.0;
    let of_date = vector(&sun) - vector(&moon);
    let equator =
        about(x, 23.439_291_1) * about(z, node) * about(x, tilt) * about(z, -node - precession) * of_date;
    let body = about(z, -prime_meridian) * about(x, declination - 90.0) * about(z, -right_ascension - 90.0);
    (body * equator).normalize()
}

#[test]
fn another_theory_of_the_rotation_agrees_for_a_century_and_a_half() {
    let (mut largest, mut num) = (0.0f64, 0);
    let mut day = -18_262.0;
    while day < 36_525.0 {
        let centuries = day / 36_525.0;
        let found = at(centuries).position().coords.normalize();
        largest = largest.max(found.angle(&by_rotation_elements(centuries)).to_degrees());
        (num, day) = (num + 1, day + 5.3);
    }
    println!("{num} days: at most {largest:.4}°");
    assert!(largest < 0.006, "{largest}");
}

#[test]
fn principal_axes_are_no_mean_earth_axes() {
    let off = at_as_printed(EXAMPLE).position().coords.angle(&by_rotation_elements(EXAMPLE));
    assert!(off.to_degrees() > 0.008, "{}", off.to_degrees());
}

#[test]
fn from_the_ground_the_sun_stands_lower_than_from_the_centre() {
    let sun = sub_solar(utc("2009-11-29T14:51:21.968")).unwrap();
    let moon = Body::moon();
    // 90° away from the point below it, the Sun's centre is below the horizon by the parallax.
    let place = Geodetic { lat_rad: 0.0, lon_rad: sun.lon_rad + std::f64::consts::FRAC_PI_2, height_m: 0.0 };
    let (_, elevation) = moon.azimuth_elevation(&place, &sun.direction_from(&moon.point(&place)));
    let parallax = (moon.radius_m / sun.distance_m).asin();
    assert!((elevation + parallax).abs() < 1e-9, "{elevation}");
    assert!(parallax.to_degrees() < 0.0007);
    let below = Geodetic { lat_rad: sun.lat_rad, lon_rad: sun.lon_rad, height_m: 0.0 };
    let (_, overhead) = moon.azimuth_elevation(&below, &sun.direction_from(&moon.point(&below)));
    assert!((overhead.to_degrees() - 90.0).abs() < 1e-6, "{overhead}");
}

#[test]
fn other_centuries_are_refused() {
    for text in ["1949-12-30T00:00:00", "2100-01-05T00:00:00", "0001-01-01T00:00:00"] {
        let error = sub_solar(utc(text)).unwrap_err();
        let says = format!("the Sun's place over the Moon is known from 1950 to 2100, not for {text}Z");
        assert_eq!(error.to_string(), says);
    }
    assert!(sub_solar(utc("1950-01-02T00:00")).is_ok() && sub_solar(utc("2099-12-30T00:00")).is_ok());
}
